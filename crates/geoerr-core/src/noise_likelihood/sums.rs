//! All of the likelihood that does not depend on its parameters: sums by blocks and over rows.

use rayon::prelude::*;

use super::blocks::Blocks;
use super::error::{NoiseError, length};
use super::lanes::add_scaled;
use crate::least_squares::{Matrix, StridedRows, add_lower_outer};

/// `ln σ², ln a², ln b², ln τ` of one component.
pub type Logs = [f64; 4];

/// The restricted likelihood of the noise of whitened residuals, as a function of four numbers for each component.
#[derive(Clone, Debug)]
pub struct Likelihood {
    pub(super) blocks: Blocks,
    pub(super) n_basis: usize,
    pub(super) components: Vec<Component>,
}

/// One component.
#[derive(Clone, Debug)]
pub(super) struct Component {
    /// Measured numbers.
    pub n_numbers: usize,
    /// Root of the sum of squared weights of each block.
    pub reach: Vec<f64>,
    /// `Uᵀ y`, by block.
    pub sums: Vec<f64>,
    /// `Aᵀ U`, (r, n_blocks).
    pub basis_sums: Matrix,
    /// `Aᵀ (I − U Uᵀ) A`, the lower triangle.
    pub inside: Matrix,
    /// `Aᵀ (I − U Uᵀ) y`.
    pub pull: Vec<f64>,
    /// `yᵀ (I − U Uᵀ) y`.
    pub square: f64,
}

impl Component {
    /// Whether anything was measured.
    pub fn is_used(&self) -> bool {
        self.n_numbers > 0
    }
}

impl Likelihood {
    /// Makes the sums.
    ///
    /// `weights`: what an offset of one unit does to each number, 0 where nothing counts; `residual`: whitened, 0 where
    /// the weight is; `basis`: `n_basis` columns of each component, row by row (n, 3, `n_basis`).
    ///
    /// # Errors
    /// [`NoiseError::Length`].
    pub fn new(
        blocks: Blocks,
        weights: &[[f64; 3]],
        residual: &[[f64; 3]],
        basis: &[f64],
        n_basis: usize,
    ) -> Result<Self, NoiseError> {
        let n = blocks.n_rows();
        length("weights", weights.len(), n)?;
        length("the residual", residual.len(), n)?;
        length("the basis", basis.len(), 3 * n * n_basis)?;
        let components = (0..3)
            .into_par_iter()
            .map(|c| {
                let basis = StridedRows::new(basis, c * n_basis, n_basis, 3 * n_basis, n);
                component(&blocks, c, weights, residual, &basis)
            })
            .collect();
        Ok(Self { blocks, n_basis, components })
    }

    /// The likelihood with more columns: the sums of those that it has are not made again.
    ///
    /// `weights`, `residual` and `basis` are those that the sums were made of; `columns` is (n, 3, `n_columns`).
    ///
    /// # Errors
    /// [`NoiseError::Length`].
    pub fn with_columns(
        &self,
        weights: &[[f64; 3]],
        residual: &[[f64; 3]],
        basis: &[f64],
        columns: &[f64],
        n_columns: usize,
    ) -> Result<Self, NoiseError> {
        let n = self.blocks.n_rows();
        length("the basis", basis.len(), 3 * n * self.n_basis)?;
        let only = Self::new(self.blocks.clone(), weights, residual, columns, n_columns)?;
        let (r, width) = (self.n_basis, self.n_basis + n_columns);
        let components = (self.components.par_iter().zip(&only.components).enumerate())
            .map(|(c, (old, new))| {
                let old_rows = StridedRows::new(basis, c * r, r, 3 * r, n);
                let new_rows = StridedRows::new(columns, c * n_columns, n_columns, 3 * n_columns, n);
                let mut across = new_rows.transposed_product(&old_rows);
                for block in 0..self.blocks.len() {
                    let of_new = new.basis_sums.column(block);
                    for (j, &of_old) in old.basis_sums.column(block).iter().enumerate() {
                        add_scaled(across.column_mut(j), -of_old, of_new);
                    }
                }
                let mut inside = Matrix::zeros(width, width);
                for j in 0..r {
                    inside.column_mut(j)[..r].copy_from_slice(old.inside.column(j));
                    inside.column_mut(j)[r..].copy_from_slice(across.column(j));
                }
                for j in 0..n_columns {
                    inside.column_mut(r + j)[r..].copy_from_slice(new.inside.column(j));
                }
                let mut basis_sums = Matrix::zeros(width, self.blocks.len());
                for block in 0..self.blocks.len() {
                    let (of_old, of_new) = basis_sums.column_mut(block).split_at_mut(r);
                    of_old.copy_from_slice(old.basis_sums.column(block));
                    of_new.copy_from_slice(new.basis_sums.column(block));
                }
                let pull = [old.pull.as_slice(), &new.pull].concat();
                let (reach, sums) = (old.reach.clone(), old.sums.clone());
                let Component { n_numbers, square, .. } = *old;
                Component { n_numbers, reach, sums, basis_sums, inside, pull, square }
            })
            .collect();
        Ok(Self { blocks: self.blocks.clone(), n_basis: width, components })
    }

    /// The blocks.
    #[must_use]
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }

    /// Whether anything was measured of each component.
    #[must_use]
    pub fn is_used(&self) -> Vec<bool> {
        self.components.iter().map(Component::is_used).collect()
    }
}

fn component(
    blocks: &Blocks,
    c: usize,
    weights: &[[f64; 3]],
    residual: &[[f64; 3]],
    basis: &StridedRows<'_>,
) -> Component {
    let reach = reach_of(blocks, c, weights);
    let mut sums = vec![0.0; blocks.len()];
    let mut basis_sums = Matrix::zeros(basis.n_columns(), blocks.len());
    let mut pull = vec![0.0; basis.n_columns()];
    for block in 0..blocks.len() {
        let target = basis_sums.column_mut(block);
        for &row in blocks.rows(block) {
            let unit = unit_of(weights[row][c], reach[block]);
            let y = residual[row][c];
            sums[block] += unit * y;
            add_scaled(target, unit, basis.row(row));
            add_scaled(&mut pull, y, basis.row(row));
        }
    }
    let mut inside = basis.lower_gram();
    add_lower_outer(&mut inside, -1.0, &basis_sums);
    for (block, &sum) in sums.iter().enumerate() {
        add_scaled(&mut pull, -sum, basis_sums.column(block));
    }
    let whole: f64 = residual.iter().map(|y| y[c] * y[c]).sum();
    let square = whole - sums.iter().map(|sum| sum * sum).sum::<f64>();
    let n_numbers = weights.iter().filter(|weight| weight[c] > 0.0).count();
    Component { n_numbers, reach, sums, basis_sums, inside, pull, square }
}

/// Root of the sum of squared weights of each block, of one component.
pub(super) fn reach_of(blocks: &Blocks, c: usize, weights: &[[f64; 3]]) -> Vec<f64> {
    (0..blocks.len())
        .map(|block| blocks.rows(block).iter().map(|&row| weights[row][c].powi(2)).sum::<f64>().sqrt())
        .collect()
}

/// Entries of U of a component, row by row.
pub(super) fn units_of(blocks: &Blocks, c: usize, weights: &[[f64; 3]], reach: &[f64]) -> Vec<f64> {
    let rows = blocks.of_row().iter().zip(weights);
    rows.map(|(&block, weight)| unit_of(weight[c], reach[block])).collect()
}

/// Entry of U.
pub(super) fn unit_of(weight: f64, reach: f64) -> f64 {
    if reach > 0.0 { weight / reach } else { 0.0 }
}
