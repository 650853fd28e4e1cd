//! The inverse root of the covariance: `V^(-1/2) = σ⁻¹ (I + U (T − I) Uᵀ)` with `T (I + K) Tᵀ = I`.

use rayon::prelude::*;

use serde::{Deserialize, Serialize};

use super::blocks::Blocks;
use super::error::{NoiseError, length};
use super::filter::Filter;
use super::lanes::add_scaled;
use super::sums::{Likelihood, Logs, reach_of, unit_of, units_of};
use crate::least_squares::{Matrix, Real, orthonormalizing, set_rows_times_upper};

/// Rows that are written as one piece of work.
const ROWS_OF_A_PIECE: usize = 256;

/// What is applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// `V^(-1/2)`.
    Forward,
    /// `V^(-T/2)`.
    Transposed,
    /// `V^(1/2)`: what `Forward` has whitened comes back.
    Back,
}

/// Rows that are whitened and multiplied at once: what a core's own cache holds.
const ROWS_AT_ONCE: usize = 64;

/// What whitens three components.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Whitening {
    blocks: Blocks,
    /// Scatter from row to row.
    sigma: [f64; 3],
    /// Entry of U of each row, by component.
    unit: [Vec<f64>; 3],
    /// `I + K` of each component and session.
    filters: [Vec<Filter>; 3],
}

impl Blocks {
    /// What whitens noise of these logarithms.
    ///
    /// # Errors
    /// [`NoiseError`] for another number of weights, and for a covariance that is not positive definite.
    pub fn whitening(&self, weights: &[[f64; 3]], logs: &[Logs; 3]) -> Result<Whitening, NoiseError> {
        length("weights", weights.len(), self.n_rows())?;
        let reach = [0, 1, 2].map(|c| reach_of(self, c, weights));
        let unit = [0, 1, 2].map(|c| units_of(self, c, weights, &reach[c]));
        let mut filters = [0, 1, 2].map(|_| Vec::new());
        for (component, own) in filters.iter_mut().enumerate() {
            let of_session = |session| self.filter(session, &reach[component], logs[component]);
            let all: Option<Vec<Filter>> = (0..self.sessions().len()).map(of_session).collect();
            *own = all.ok_or(NoiseError::NotDefinite { component })?;
        }
        let sigma = logs.map(|logs| (0.5 * logs[0]).exp());
        Ok(Whitening { blocks: self.clone(), sigma, unit, filters })
    }
}

impl Whitening {
    /// Applies it to `values`, (n, 3, `width`) row by row.
    ///
    /// # Errors
    /// [`NoiseError::Length`].
    pub fn apply(&self, values: &[f64], width: usize, direction: Direction) -> Result<Vec<f64>, NoiseError> {
        length("values", values.len(), 3 * self.n_rows() * width)?;
        let more: Vec<Vec<f64>> = (0..3_usize)
            .into_par_iter()
            .map(|c| {
                let sums = self.blocks.sums(c, &self.unit[c], values, width);
                let mut more = sums.clone();
                self.filter_rows(c, &mut more, width, |filter, rows, width| match direction {
                    Direction::Forward => filter.whiten(rows, width),
                    Direction::Transposed => filter.whiten_transposed(rows, width),
                    Direction::Back => filter.unwhiten(rows, width),
                });
                add_scaled(&mut more, -1.0, &sums);
                more
            })
            .collect();
        let scale = match direction {
            Direction::Forward | Direction::Transposed => self.sigma.map(|sigma| 1.0 / sigma),
            Direction::Back => self.sigma,
        };
        let mut result = vec![0.0; values.len()];
        result.par_chunks_mut((3 * width * ROWS_OF_A_PIECE).max(1)).enumerate().for_each(
            |(piece, target)| {
                for (at, target) in target.chunks_exact_mut(width).enumerate() {
                    let (row, c) = (piece * ROWS_OF_A_PIECE + at / 3, at % 3);
                    let more = &more[c][self.block(row) * width..][..width];
                    let own = &values[(3 * row + c) * width..][..width];
                    let unit = self.unit[c][row];
                    for (target, (value, more)) in target.iter_mut().zip(own.iter().zip(more)) {
                        *target = (value + unit * more) * scale[c];
                    }
                }
            },
        );
        Ok(result)
    }

    /// Number of rows.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.blocks.n_rows()
    }

    /// Number of blocks.
    #[must_use]
    pub fn n_blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Block of a row.
    #[must_use]
    pub fn block(&self, row: usize) -> usize {
        self.blocks.of_row()[row]
    }

    /// Scatter from row to row, of each component.
    #[must_use]
    pub fn sigma(&self) -> [f64; 3] {
        self.sigma
    }

    /// Entry of U of each row, of a component.
    #[must_use]
    pub fn unit(&self, c: usize) -> &[f64] {
        &self.unit[c]
    }

    /// `(Tᵀ − I) S` of one component, S sums by block, `width` of each, row after row.
    #[must_use]
    pub fn transposed_less_one<T: Real>(&self, c: usize, sums: &[T], width: usize) -> Vec<T> {
        self.less_one(c, sums, width, Filter::whiten_transposed)
    }

    /// `(TᵀT − I) S`, what is not white in the inverse of the noise, likewise.
    #[must_use]
    pub fn inverse_less_one<T: Real>(&self, c: usize, sums: &[T], width: usize) -> Vec<T> {
        self.less_one(c, sums, width, Filter::solve)
    }

    fn less_one<T: Real>(
        &self,
        c: usize,
        sums: &[T],
        width: usize,
        apply: impl Fn(&Filter, &mut [T], usize),
    ) -> Vec<T> {
        let mut result = sums.to_vec();
        self.filter_rows(c, &mut result, width, apply);
        result.iter_mut().zip(sums).for_each(|(value, &sum)| *value -= sum);
        result
    }

    /// Applies the filter of each session to `width` numbers of each of its blocks, in place.
    fn filter_rows<T: Real>(
        &self,
        c: usize,
        rows: &mut [T],
        width: usize,
        apply: impl Fn(&Filter, &mut [T], usize),
    ) {
        for (own, filter) in self.blocks.sessions().iter().zip(&self.filters[c]) {
            apply(filter, &mut rows[own.start * width..own.end * width], width);
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
