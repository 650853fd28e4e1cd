//! The root of a covariance, as a whole or of a bordered system.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::bordered_root::BorderedRoot;
use super::dense;
use super::matrix::{Matrix, norm};

/// F (n, rank) with F Fᵀ the unscaled covariance.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) enum Root {
    Whole(Matrix),
    Bordered(BorderedRoot),
}

impl Root {
    /// All of it; of many groups mostly zeros.
    pub fn to_matrix(&self) -> Cow<'_, Matrix> {
        match self {
            Self::Whole(root) => Cow::Borrowed(root),
            Self::Bordered(root) => Cow::Owned(root.rows(0..root.n_rows())),
        }
    }

    /// The first rows, (count, rank).
    pub fn first_rows(&self, count: usize) -> Matrix {
        match self {
            Self::Whole(root) => Matrix::from_fn(count, root.n_columns(), |row, j| root[(row, j)]),
            Self::Bordered(root) => root.rows(0..count),
        }
    }

    /// Lengths of the rows, (n,).
    pub fn row_norms(&self) -> Vec<f64> {
        match self {
            Self::Whole(root) => {
                let of = |row| norm(&(0..root.n_columns()).map(|j| root[(row, j)]).collect::<Vec<_>>());
                (0..root.n_rows()).map(of).collect()
            }
            Self::Bordered(root) => root.row_norms(),
        }
    }

    /// `F Fᵀ g`.
    pub fn times_transposed_times(&self, g: &[f64]) -> Vec<f64> {
        match self {
            Self::Whole(root) => {
                let along = dense::transposed_product(root, &Matrix::from_column(g.to_vec()));
                dense::product(root, &along).into_values()
            }
            Self::Bordered(root) => root.times(&root.transposed_times(g)),
        }
    }
}
