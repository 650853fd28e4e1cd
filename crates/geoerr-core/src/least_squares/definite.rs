//! Symmetric positive definite matrices, factorized once: `M = RᵀR` with an upper triangle R.

use super::dense;
use super::matrix::Matrix;

/// A factorized symmetric positive definite matrix.
#[derive(Clone, Debug)]
pub struct Definite {
    triangle: Matrix,
}

impl Definite {
    /// Factorizes; only the lower triangle is read. `None` unless positive definite to working precision.
    #[must_use]
    pub fn of(matrix: Matrix) -> Option<Self> {
        Some(Self { triangle: dense::cholesky(matrix)? })
    }

    /// `I − M` for a symmetric M (both triangles), where all its eigenvalues are below a limit of 1 or less.
    pub(super) fn complement(matrix: &Matrix, limit: f64) -> Option<Self> {
        let n = matrix.n_columns();
        let beyond = |most: f64| {
            Self::of(Matrix::from_fn(
                n,
                n,
                |i, j| if i == j { most - matrix[(i, j)] } else { -matrix[(i, j)] },
            ))
        };
        beyond(limit)?;
        beyond(1.0)
    }

    /// `ln det M`.
    #[must_use]
    pub fn ln_determinant(&self) -> f64 {
        let n = self.triangle.n_columns();
        2.0 * (0..n).map(|j| self.triangle[(j, j)].ln()).sum::<f64>()
    }

    /// `R⁻¹`, an upper triangle.
    #[must_use]
    pub fn root_inverse(&self) -> Matrix {
        dense::upper_inverse(&self.triangle)
    }

    /// `R⁻ᵀ B`, in place: its Gram matrix is `Bᵀ M⁻¹ B`.
    pub fn whiten(&self, right: &mut Matrix) {
        dense::solve_upper_transposed(&self.triangle, right);
    }

    /// `M⁻¹ B`, in place.
    pub fn solve(&self, right: &mut Matrix) {
        self.whiten(right);
        dense::solve_upper(&self.triangle, right);
    }
}
