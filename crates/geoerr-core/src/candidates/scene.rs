//! What a fit leaves, as candidates are judged against it.

use rayon::prelude::*;

use super::error::CandidateError;
use super::noise::{Noise, length};
use crate::least_squares::Real;

/// Whitened displacement of every row by one unit on a channel: a column of n numbers for each component.
pub type Directions = [Vec<f64>; 3];

/// Everything that candidates are multiplied with, in the precision of the products.
#[derive(Clone, Debug)]
pub struct Scene<T> {
    pub(super) n_rows: usize,
    pub(super) n_basis: usize,
    pub(super) n_draws: usize,
    /// By channel and component; empty where a channel does nothing on a component.
    pub(super) directions: Vec<[Vec<T>; 3]>,
    /// By component, column after column: `V^(-T/2)` times Q, r and the draws.
    pub(super) back: [Vec<T>; 3],
    pub(super) noise: Noise,
    /// Runs of rows of one block: first row, end, block.
    pub(super) runs: Vec<(usize, usize, usize)>,
}

impl<T: Real> Scene<T> {
    /// Puts a scene together.
    ///
    /// `whitened` has, for each component, `n_basis + 1 + n_draws` columns of n numbers: the orthonormal basis of what
    /// the model is free to do, what it leaves, and draws of noise off the basis.
    ///
    /// # Errors
    /// [`CandidateError`] for lengths that do not fit.
    pub fn new(
        n_rows: usize,
        n_basis: usize,
        n_draws: usize,
        directions: &[Directions],
        whitened: [Vec<T>; 3],
        noise: Noise,
    ) -> Result<Self, CandidateError> {
        noise.check(n_rows)?;
        for column in directions.iter().flatten() {
            length("a channel's displacement", column.len(), n_rows)?;
        }
        for columns in &whitened {
            length("basis, residual and draws", columns.len(), n_rows * (n_basis + 1 + n_draws))?;
        }
        let mut runs: Vec<(usize, usize, usize)> = Vec::new();
        for (row, &block) in noise.block.iter().enumerate() {
            match runs.last_mut() {
                Some(run) if run.2 == block => run.1 = row + 1,
                _ => runs.push((row, row + 1, block)),
            }
        }
        let directions = (directions.iter())
            .map(|of_channel| {
                [0, 1, 2].map(|c| {
                    let column = &of_channel[c];
                    let acts = column.iter().any(|&value| value != 0.0);
                    if acts { column.iter().map(|&value| T::nearest(value)).collect() } else { Vec::new() }
                })
            })
            .collect();
        let mut back = whitened;
        for (c, columns) in back.iter_mut().enumerate() {
            columns
                .par_chunks_exact_mut(n_rows.max(1))
                .for_each(|column| whiten_transposed(&noise, c, &runs, column));
        }
        Ok(Self { n_rows, n_basis, n_draws, directions, back, noise, runs })
    }

    /// Number of columns of what candidates are multiplied with.
    pub(super) fn width(&self) -> usize {
        self.n_basis + 1 + self.n_draws
    }
}

/// Applies `V^(-T/2)` to a column of one component, in place.
fn whiten_transposed<T: Real>(noise: &Noise, c: usize, runs: &[(usize, usize, usize)], column: &mut [T]) {
    let unit = &noise.unit[c];
    let mut sums = vec![0.0; noise.n_blocks];
    for &(start, end, block) in runs {
        let own = column[start..end].iter().zip(&unit[start..end]);
        sums[block] += own.map(|(value, &u)| value.double() * u).sum::<f64>();
    }
    let mut more = vec![0.0; noise.n_blocks];
    for (session, less_one) in noise.sessions.iter().zip(&noise.less_one[c]) {
        let of_session = &sums[session.clone()];
        for (target, row) in more[session.clone()].iter_mut().zip(less_one.chunks_exact(session.len())) {
            *target = row.iter().zip(of_session).map(|(&t, &sum)| t * sum).sum();
        }
    }
    let per_sigma = 1.0 / noise.sigma[c];
    for &(start, end, block) in runs {
        for (value, &u) in column[start..end].iter_mut().zip(&unit[start..end]) {
            *value = T::nearest((value.double() + u * more[block]) * per_sigma);
        }
    }
}
