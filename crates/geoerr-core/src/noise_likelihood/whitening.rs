//! The inverse root of the covariance: `V^(-1/2) = σ⁻¹ (I + U (T − I) Uᵀ)` with `T (I + K) Tᵀ = I`.

use rayon::prelude::*;

use super::blocks::Blocks;
use super::error::{NoiseError, length};
use super::lanes::add_scaled;
use super::sums::{Likelihood, Logs, reach_of, unit_of};
use crate::least_squares::{
    Matrix, orthonormalizing, product_with_upper, product_with_upper_transposed, set_rows_times_upper,
};

/// Rows that are written as one piece of work.
const ROWS_OF_A_PIECE: usize = 256;

/// `V^(-1/2)` or its transpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// `V^(-1/2)`.
    Forward,
    /// `V^(-T/2)`.
    Transposed,
}

/// Rows that are whitened and multiplied at once: what a core's own cache holds.
const ROWS_AT_ONCE: usize = 64;

/// What whitens three components.
#[derive(Clone, Debug)]
pub struct Whitening<'a> {
    /// Which rows belong together.
    pub blocks: &'a Blocks,
    /// Scatter from row to row.
    pub sigma: [f64; 3],
    /// Entry of U of each row, by component.
    pub unit: [&'a [f64]; 3],
    /// `(T − I)ᵀ` of each component and session, upper triangles.
    pub less_one: [Vec<Matrix>; 3],
}

impl Blocks {
    /// `(T − I)ᵀ` of each component and session, upper triangles.
    ///
    /// # Errors
    /// [`NoiseError`] for another number of weights, and for a covariance that is not positive definite.
    pub fn less_one(&self, weights: &[[f64; 3]], logs: &[Logs; 3]) -> Result<[Vec<Matrix>; 3], NoiseError> {
        length("weights", weights.len(), self.n_rows())?;
        let reach = [0, 1, 2].map(|c| reach_of(self, c, weights));
        let n_sessions = self.sessions().len();
        let mut found = (0..3 * n_sessions)
            .into_par_iter()
            .map(|task| {
                let (component, session) = (task / n_sessions, task % n_sessions);
                let filter = self.filter(session, &reach[component], logs[component]);
                let filter = filter.ok_or(NoiseError::NotDefinite { component })?;
                let mut less_one = Matrix::identity(self.sessions()[session].len());
                let n = less_one.n_columns();
                filter.whiten(less_one.as_mut_slice(), n);
                for j in 0..n {
                    less_one[(j, j)] -= 1.0;
                }
                Ok(less_one)
            })
            .collect::<Result<Vec<_>, NoiseError>>()?
            .into_iter();
        Ok([0, 1, 2].map(|_| found.by_ref().take(n_sessions).collect()))
    }
}

impl Whitening<'_> {
    /// Applies it to `values`, (n, 3, `width`) row by row.
    ///
    /// # Errors
    /// [`NoiseError::Length`].
    pub fn apply(&self, values: &[f64], width: usize, direction: Direction) -> Result<Vec<f64>, NoiseError> {
        let n = self.blocks.n_rows();
        length("values", values.len(), 3 * n * width)?;
        for (unit, less_one) in self.unit.iter().zip(&self.less_one) {
            length("entries of U", unit.len(), n)?;
            length("sessions of a transform", less_one.len(), self.blocks.sessions().len())?;
            for (matrix, session) in less_one.iter().zip(self.blocks.sessions()) {
                length("a transform", matrix.as_slice().len(), session.len().pow(2))?;
            }
        }
        let n_sessions = self.blocks.sessions().len();
        let more: Vec<Matrix> = (0..3 * n_sessions)
            .into_par_iter()
            .map(|task| self.more(task / n_sessions, task % n_sessions, values, width, direction))
            .collect();
        let mut of_block: Vec<(usize, usize)> = Vec::with_capacity(self.blocks.len());
        for (session, own) in self.blocks.sessions().iter().enumerate() {
            of_block.extend((0..own.len()).map(|at| (session, at)));
        }
        let mut result = vec![0.0; values.len()];
        result.par_chunks_mut((3 * width * ROWS_OF_A_PIECE).max(1)).enumerate().for_each(
            |(piece, target)| {
                for (at, target) in target.chunks_exact_mut(width).enumerate() {
                    let (row, c) = (piece * ROWS_OF_A_PIECE + at / 3, at % 3);
                    let (session, place) = of_block[self.blocks.of_row()[row]];
                    let more = more[c * n_sessions + session].column(place);
                    let own = &values[(3 * row + c) * width..][..width];
                    let (unit, per_sigma) = (self.unit[c][row], 1.0 / self.sigma[c]);
                    for (target, (value, more)) in target.iter_mut().zip(own.iter().zip(more)) {
                        *target = (value + unit * more) * per_sigma;
                    }
                }
            },
        );
        Ok(result)
    }

    /// `((T − I) Uᵀ values)ᵀ` of one component and session, (`width`, its blocks).
    fn more(&self, c: usize, session: usize, values: &[f64], width: usize, direction: Direction) -> Matrix {
        let own = self.blocks.sessions()[session].clone();
        let mut sums = Matrix::zeros(width, own.len());
        for (at, block) in own.enumerate() {
            let target = sums.column_mut(at);
            for &row in self.blocks.rows(block) {
                let unit = self.unit[c][row];
                for (sum, value) in target.iter_mut().zip(&values[(3 * row + c) * width..][..width]) {
                    *sum += unit * value;
                }
            }
        }
        match direction {
            Direction::Forward => product_with_upper(&sums, &self.less_one[c][session]),
            Direction::Transposed => product_with_upper_transposed(&sums, &self.less_one[c][session]),
        }
    }
}

impl Likelihood {
    /// The basis, whitened and made orthonormal, (n, 3, r) row by row; `None` where its columns are too much alike for
    /// that in one product.
    ///
    /// `weights` and `basis` are those that the sums were made of.
    ///
    /// # Errors
    /// [`NoiseError`] for other lengths, and for a covariance that is not positive definite.
    pub fn whitened_basis(
        &self,
        weights: &[[f64; 3]],
        basis: &[f64],
        logs: &[Logs; 3],
    ) -> Result<Option<Vec<f64>>, NoiseError> {
        let (blocks, r) = (&self.blocks, self.n_basis);
        length("weights", weights.len(), blocks.n_rows())?;
        length("the basis", basis.len(), 3 * blocks.n_rows() * r)?;
        let parts = self.parts(logs)?;
        let mut gram = self.h(&parts, logs);
        for (component, logs) in self.components.iter().zip(logs).filter(|(one, _)| !one.is_used()) {
            add_scaled(gram.as_mut_slice(), (-logs[0]).exp(), component.inside.as_slice());
        }
        let Some(factor) = orthonormalizing(&gram) else { return Ok(None) };
        let mut more: [Option<Matrix>; 3] = [None, None, None];
        for part in &parts {
            let sums = &self.components[part.component].basis_sums;
            let mut whitened = sums.clone();
            for (own, filter) in self.by_session(whitened.as_mut_slice(), r).into_iter().zip(&part.filters) {
                filter.whiten(own, r);
            }
            add_scaled(whitened.as_mut_slice(), -1.0, sums.as_slice());
            more[part.component] = Some(whitened);
        }
        let per_sigma = logs.map(|logs| (-0.5 * logs[0]).exp());
        let mut result = vec![0.0; basis.len()];
        let pieces = result
            .par_chunks_mut((3 * r * ROWS_AT_ONCE).max(1))
            .zip(basis.par_chunks((3 * r * ROWS_AT_ONCE).max(1)));
        pieces.enumerate().for_each(|(piece, (target, rows))| {
            let mut whitened = rows.to_vec();
            for (at, own) in whitened.chunks_exact_mut(r).enumerate() {
                let (row, c) = (piece * ROWS_AT_ONCE + at / 3, at % 3);
                let block = blocks.of_row()[row];
                if let Some(more) = &more[c] {
                    let unit = unit_of(weights[row][c], self.components[c].reach[block]);
                    add_scaled(own, unit, more.column(block));
                }
                own.iter_mut().for_each(|value| *value *= per_sigma[c]);
            }
            set_rows_times_upper(target, &whitened, &factor);
        });
        Ok(Some(result))
    }
}
