//! What a fit leaves, as candidates are judged against it.

use std::ops::Range;

use rayon::prelude::*;

use super::error::{CandidateError, length};
use super::lanes;
use super::moments::Moments;
use crate::least_squares::Real;
use crate::noise_likelihood::Whitening;

/// Share of a sum that is rounding, in units of the precision.
const ROUNDED: f64 = 64.0;

/// Rows that are laid out and whitened together.
const ROWS: usize = 1024;

/// Whitened displacement of every row by one unit on a channel: a column of n numbers for each component.
pub type Directions<'a> = [&'a [f64]; 3];

/// What candidates are judged against, whitened, the components of a row one after the other.
#[derive(Clone, Copy, Debug)]
pub struct Whitened<'a, T> {
    /// The orthonormal basis of what the model is free to do, (n, 3, `n_basis`).
    pub basis: &'a [f64],
    /// What it leaves, (n, 3).
    pub residual: &'a [f64],
    /// Draws of noise off the basis, (n, 3, `n_draws`).
    pub draws: &'a [T],
}

/// Everything that candidates are multiplied with, in the precision of the products.
#[derive(Clone, Debug)]
pub struct Scene<T> {
    pub(super) n_rows: usize,
    pub(super) n_basis: usize,
    pub(super) n_draws: usize,
    /// By channel and component; empty where a channel does nothing on a component.
    pub(super) directions: Vec<[Vec<T>; 3]>,
    /// By component, row after row: `V^(-T/2)` times Q, r and the draws.
    pub(super) back: [Vec<T>; 3],
    pub(super) noise: Whitening,
    /// Runs of rows of one block.
    pub(super) runs: Vec<Run>,
}

/// Neighbouring rows, or moments, of one block of the noise.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    pub(super) start: usize,
    pub(super) end: usize,
    pub(super) block: usize,
}

impl<T: Real> Scene<T> {
    /// Puts a scene together.
    ///
    /// # Errors
    /// [`CandidateError`] for lengths that do not fit.
    pub fn new(
        directions: &[Directions<'_>],
        whitened: Whitened<'_, T>,
        noise: Whitening,
    ) -> Result<Self, CandidateError> {
        let n_rows = noise.n_rows();
        for column in directions.iter().flatten() {
            length("a channel's displacement", column.len(), n_rows)?;
        }
        let [n_basis, n_draws] =
            [whitened.basis.len(), whitened.draws.len()].map(|all| all / (3 * n_rows).max(1));
        length("basis", whitened.basis.len(), 3 * n_rows * n_basis)?;
        length("residual", whitened.residual.len(), 3 * n_rows)?;
        length("draws", whitened.draws.len(), 3 * n_rows * n_draws)?;
        let runs = runs_of(&noise);
        let (back, directions) = rayon::join(
            || whitened.back(&noise, &runs, [n_basis, n_draws]),
            || (directions.par_iter()).map(|own| acting(own, noise.sigma())).collect(),
        );
        Ok(Self { n_rows, n_basis, n_draws, directions, back, noise, runs })
    }

    /// Number of columns of what candidates are multiplied with.
    pub(super) fn width(&self) -> usize {
        self.n_basis + 1 + self.n_draws
    }

    /// Components on which a channel does something.
    pub(super) fn components(&self, channel: usize) -> impl Iterator<Item = usize> + '_ {
        (0..3).filter(move |&c| !self.directions[channel][c].is_empty())
    }

    /// What sums by block give beyond white noise in one component, `(TᵀT − I)` times them: column after column, a number
    /// for each block in each.
    pub(super) fn beyond_white_of_columns(&self, c: usize, sums: &[T]) -> Vec<T> {
        let n_blocks = self.noise.n_blocks().max(1);
        let width = sums.len() / n_blocks;
        let (mut rows, mut columns) = (Vec::new(), Vec::new());
        lanes::transpose(&mut rows, sums, n_blocks);
        let beyond = self.noise.inverse_less_one(c, &rows, width);
        lanes::transpose(&mut columns, &beyond, width.max(1));
        columns
    }

    /// Weights of moments in the information of two channels, `Σ_c d_c e_c / σ_c²` over their rows; nothing where they
    /// share no component.
    pub(super) fn weights(
        &self,
        one: usize,
        two: usize,
        moments: &Moments,
        here: Range<usize>,
    ) -> Option<Vec<T>> {
        let mut weights: Option<Vec<T>> = None;
        for c in self.components(one) {
            let (d, e) = (&self.directions[one][c], &self.directions[two][c]);
            if e.is_empty() {
                continue;
            }
            let per_variance = T::nearest(1.0 / self.noise.sigma()[c].powi(2));
            let weights = weights.get_or_insert_with(|| vec![T::default(); here.len()]);
            for (weight, moment) in weights.iter_mut().zip(here.clone()) {
                for row in moments.rows(moment) {
                    *weight += d[row] * e[row] * per_variance;
                }
            }
        }
        weights
    }

    /// What moments of a channel add to the sum of their block, `d u / σ` over their rows, on one component.
    pub(super) fn unit(&self, channel: usize, c: usize, moments: &Moments, here: Range<usize>) -> Vec<T> {
        let per_sigma = 1.0 / self.noise.sigma()[c];
        let (along, unit) = (&self.directions[channel][c], self.noise.unit(c));
        here.map(|moment| {
            let mut sum = T::default();
            for row in moments.rows(moment) {
                sum += along[row] * T::nearest(unit[row] * per_sigma);
            }
            sum
        })
        .collect()
    }

    /// What functions on a channel are multiplied with is the sum over components of these: a scale for each row, and basis,
    /// residual and draws of each.
    pub(super) fn terms(&self, channel: usize) -> Vec<(&[T], &[T])> {
        self.components(channel).map(|c| (&self.directions[channel][c][..], &self.back[c][..])).collect()
    }

    /// Sets a target to weights of rows in the information of two channels: 0 where they share no component.
    pub(super) fn set_weights_of_rows(
        &self,
        target: &mut Vec<T>,
        [one, two]: [usize; 2],
        here: Range<usize>,
    ) {
        target.clear();
        target.resize(here.len(), T::default());
        for c in self.components(one) {
            let [d, e] = [one, two].map(|channel| &self.directions[channel][c]);
            if !e.is_empty() {
                let per_variance = T::nearest(1.0 / self.noise.sigma()[c].powi(2));
                lanes::add_scaled_products(target, per_variance, &d[here.clone()], &e[here.clone()]);
            }
        }
    }

    /// Sets a target to what rows add to the sum of their block for a displacement of 1 on one component, `u / σ`.
    pub(super) fn set_unit_of_rows(&self, target: &mut Vec<T>, c: usize, here: Range<usize>) {
        let per_sigma = 1.0 / self.noise.sigma()[c];
        target.clear();
        target.extend(self.noise.unit(c)[here].iter().map(|unit| T::nearest(unit * per_sigma)));
    }

    /// What a function on a channel is multiplied with, moment after moment: basis, residual and draws of the channel.
    pub(super) fn set_operand(
        &self,
        target: &mut Vec<T>,
        channel: usize,
        moments: &Moments,
        here: Range<usize>,
    ) {
        let width = self.width();
        target.resize(here.len() * width, T::default());
        let rows = here.map(|moment| moments.rows(moment));
        lanes::set_sums_of_rows(target, width, width, rows, &self.terms(channel));
    }
}

impl<T: Real> Whitened<'_, T> {
    /// By component, row after row: `V^(-T/2)` times basis, residual and draws.
    fn back(&self, noise: &Whitening, runs: &[Run], [n_basis, n_draws]: [usize; 2]) -> [Vec<T>; 3] {
        let width = n_basis + 1 + n_draws;
        let mut back = [0, 1, 2].map(|_| vec![T::default(); noise.n_rows() * width]);
        back.par_iter_mut().enumerate().for_each(|(c, back)| {
            back.par_chunks_mut(ROWS * width).enumerate().for_each(|(step, rows)| {
                for (number, row) in rows.chunks_exact_mut(width).enumerate() {
                    let at = 3 * (step * ROWS + number) + c;
                    let (basis, rest) = row.split_at_mut(n_basis);
                    for (value, &own) in basis.iter_mut().zip(&self.basis[at * n_basis..]) {
                        *value = T::nearest(own);
                    }
                    rest[0] = T::nearest(self.residual[at]);
                    rest[1..].copy_from_slice(&self.draws[at * n_draws..][..n_draws]);
                }
            });
            whiten_transposed(noise, c, runs, width, back);
        });
        back
    }
}

fn runs_of(noise: &Whitening) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for row in 0..noise.n_rows() {
        let block = noise.block(row);
        match runs.last_mut() {
            Some(run) if run.block == block => run.end = row + 1,
            _ => runs.push(Run { start: row, end: row + 1, block }),
        }
    }
    runs
}

/// A channel's displacement on the components where it does something: more than rounding of sums makes of the largest.
///
/// Frames that are known only so well turn every displacement a little.
fn acting<T: Real>(direction: &Directions<'_>, sigma: [f64; 3]) -> [Vec<T>; 3] {
    let sizes = [0, 1, 2]
        .map(|c| direction[c].iter().fold(0.0_f64, |largest, value| largest.max(value.abs())) / sigma[c]);
    let least = ROUNDED * T::EPSILON * sizes.into_iter().fold(0.0, f64::max);
    [0, 1, 2].map(|c| {
        let acts = sizes[c] > least;
        if acts { direction[c].iter().map(|&value| T::nearest(value)).collect() } else { Vec::new() }
    })
}

/// Applies `V^(-T/2)` to the columns of one component, in place.
fn whiten_transposed<T: Real>(noise: &Whitening, c: usize, runs: &[Run], width: usize, rows: &mut [T]) {
    let unit = noise.unit(c);
    let mut sums = vec![T::default(); noise.n_blocks() * width];
    for run in runs {
        let sum = &mut sums[run.block * width..(run.block + 1) * width];
        for (row, &u) in rows[run.start * width..].chunks_exact(width).zip(&unit[run.start..run.end]) {
            lanes::add_scaled(sum, T::nearest(u), row);
        }
    }
    let more = noise.transposed_less_one(c, &sums, width);
    let per_sigma = T::nearest(1.0 / noise.sigma()[c]);
    rows.par_chunks_mut(ROWS * width).enumerate().for_each(|(step, rows)| {
        for (row, values) in (step * ROWS..).zip(rows.chunks_exact_mut(width)) {
            let more = &more[noise.block(row) * width..][..width];
            lanes::add_scaled_and_scale(values, T::nearest(unit[row]), more, per_sigma);
        }
    });
}

/// Runs of a block of moments, counted from its first one.
pub(super) fn runs_within(runs: &[Run], here: &Range<usize>) -> Vec<Run> {
    let first = runs.partition_point(|run| run.end <= here.start);
    (runs[first..].iter().take_while(|run| run.start < here.end))
        .map(|run| Run {
            start: run.start.max(here.start) - here.start,
            end: run.end.min(here.end) - here.start,
            block: run.block,
        })
        .collect()
}
