//! Draws of noise brought off a basis, each whitened by the noise that its own fit would find.

use rayon::prelude::*;

use super::blocks::Blocks;
use super::error::{NoiseError, length};
use super::lanes::add_scaled;
use super::sums::{Logs, reach_of, units_of};
use crate::least_squares::{add_cross_product, add_product_by_rows};

/// Rows of one step: a thread's own, joined in their order.
const ROWS: usize = 1024;

/// Sums by block of one component, row after row.
struct OfBlocks {
    /// `Uᵀ` of the basis, (n_blocks, r).
    basis: Vec<f64>,
    /// `Uᵀ` of the draws, (n_blocks, n_draws).
    draws: Vec<f64>,
}

impl Blocks {
    /// Takes off draws of whitened noise, in place, what a fit is free to do, and what its noise would take for drift.
    ///
    /// `drawn`: (n, 3, `n_draws`), row by row, in single precision: it is chance. `basis`: (n, 3, r), orthonormal.
    /// `logs`: the noise that the draws are whitened with. `size`: standard deviation of the draws, where tails were cut.
    ///
    /// # Errors
    /// [`NoiseError`] for lengths that do not fit, and for a covariance that is not positive definite.
    #[expect(clippy::too_many_arguments, reason = "the draws, and all that a fit of their noise depends on")]
    pub fn take_off(
        &self,
        drawn: &mut [f32],
        n_draws: usize,
        basis: &[f64],
        weights: &[[f64; 3]],
        logs: &[Logs; 3],
        shortest_memory: f64,
        size: f64,
    ) -> Result<(), NoiseError> {
        let n = self.n_rows();
        length("weights", weights.len(), n)?;
        length("draws", drawn.len(), 3 * n * n_draws)?;
        let r = basis.len() / (3 * n).max(1);
        length("basis", basis.len(), 3 * n * r)?;
        if n == 0 || n_draws == 0 {
            return Ok(());
        }
        let mut inside = products(drawn, n_draws, basis, r);
        let unit = [0, 1, 2].map(|c| units_of(self, c, weights, &reach_of(self, c, weights)));
        let of_blocks: Vec<OfBlocks> = (unit.par_iter().enumerate())
            .map(|(c, unit)| {
                let (basis, draws) =
                    rayon::join(|| self.sums(c, unit, basis, r), || self.sums(c, unit, &*drawn, n_draws));
                let mut own = OfBlocks { basis, draws };
                add_product_by_rows(&mut own.draws, &own.basis, &inside, self.len(), -1.0);
                let per_size = 1.0 / size.max(f64::MIN_POSITIVE);
                own.draws.iter_mut().for_each(|sum| *sum *= per_size);
                own
            })
            .collect();
        let sums = [0, 1, 2].map(|c| &of_blocks[c].draws[..]);
        let mut changes = self.fitted_to_draws(weights, logs, shortest_memory, sums, n_draws)?;
        for (own, change) in of_blocks.iter().zip(&mut changes) {
            change.iter_mut().for_each(|value| *value *= size);
            add_cross_product(&mut inside, &own.basis, change, self.len());
        }
        let single = |values: Vec<f64>| values.into_iter().map(|value| value as f32).collect::<Vec<f32>>();
        let (inside, changes) = (single(inside), changes.map(single));
        let steps = drawn.par_chunks_mut(3 * ROWS * n_draws).zip(basis.par_chunks(3 * ROWS * r.max(1)));
        steps.enumerate().for_each(|(step, (drawn, basis))| {
            let rows = drawn.chunks_exact_mut(3 * n_draws).zip(&self.of_row()[step * ROWS..]);
            for (number, (row, &block)) in rows.enumerate() {
                for (c, own) in row.chunks_exact_mut(n_draws).enumerate() {
                    let weight = unit[c][step * ROWS + number];
                    let change = &changes[c][block * n_draws..(block + 1) * n_draws];
                    add_scaled(own, weight as f32, change);
                }
            }
            let basis: Vec<f32> = basis.iter().map(|&value| value as f32).collect();
            let n_rows = drawn.len() / n_draws;
            add_product_by_rows(drawn, &basis, &inside, n_rows, -1.0);
        });
        Ok(())
    }
}

/// `Qᵀ w`, (r, n_draws): in single precision within a step of rows, in double between them.
fn products(drawn: &[f32], n_draws: usize, basis: &[f64], r: usize) -> Vec<f64> {
    let steps = drawn.par_chunks(3 * ROWS * n_draws).zip(basis.par_chunks(3 * ROWS * r.max(1)));
    let of_steps: Vec<Vec<f32>> = steps
        .map(|(drawn, basis)| {
            let basis: Vec<f32> = basis.iter().map(|&value| value as f32).collect();
            let mut own = vec![0.0; r * n_draws];
            add_cross_product(&mut own, &basis, drawn, drawn.len() / n_draws);
            own
        })
        .collect();
    let mut sum = vec![0.0; r * n_draws];
    for own in of_steps {
        sum.iter_mut().zip(own).for_each(|(sum, value)| *sum += f64::from(value));
    }
    sum
}
