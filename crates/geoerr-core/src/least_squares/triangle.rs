//! What a tall system leaves behind when its rows have passed: a triangle.

use serde::{Deserialize, Serialize};

use super::blocks::{Design, Spares, StoredDesign, check_finite, tree};
use super::dense;
use super::error::LeastSquaresError;
use super::matrix::{Matrix, norm};

/// The triangle `R` and `Qᵀb` of a tall `[A | b] = Q [R | Qᵀb]`, with what is left of b.
///
/// Everything that least squares needs of any number of rows in `(n + k)²` numbers. Two triangles merge, rows can be
/// appended (priors, soft constraints), and a new right-hand side needs no second factorisation
/// ([`Solution::solve_normal`](super::Solution::solve_normal)).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Triangle {
    pub(super) n_rows: usize,
    pub(super) n_columns: usize,
    /// Of `[A | b]` as one matrix: R, Qᵀb beside it, below that the triangle of what is left of b.
    pub(super) whole: Matrix,
    /// Norms of the columns of A, where `whole` has others: with rows that only hold a restriction, or of a part of A.
    pub(super) norms: Option<Vec<f64>>,
}

impl Triangle {
    /// A system without rows.
    #[must_use]
    pub fn empty(n_columns: usize, n_rhs: usize) -> Self {
        Self { n_rows: 0, n_columns, whole: Matrix::zeros(n_columns + n_rhs, n_columns + n_rhs), norms: None }
    }

    /// Householder QR of every block, merged pairwise in a fixed tree: the same bytes for any number of threads.
    ///
    /// A column that is zero throughout a block costs nothing there. Error: that of Householder QR (backward stable column
    /// by column) with `m` the rows of a block plus the columns times the height of the tree.
    ///
    /// # Errors
    /// The design's own, and [`LeastSquaresError`] for entries that are not finite.
    ///
    /// # Source
    /// Demmel, Grigori, Hoemmen, Langou 2012, "Communication-optimal parallel and sequential QR and LU factorizations",
    /// SIAM J. Sci. Comput. 34, A206 (TSQR with a binary tree).
    pub fn of<D: Design + ?Sized>(design: &D) -> Result<Self, D::Error> {
        let (n_columns, n_rhs) = (design.n_columns(), design.n_rhs());
        if n_columns == 0 {
            return Err(LeastSquaresError::NoColumns.into());
        }
        let blocks = design.blocks();
        let spares = Spares::default();
        let make = |block: usize| {
            let rows = blocks.rows(block);
            spares.with_block(design, rows.clone(), |block| {
                check_finite(block, rows.start)?;
                Ok(of_block(block))
            })
        };
        let whole = tree(0..blocks.len(), &make, &dense::merged_triangle)?;
        let Some(whole) = whole else { return Ok(Self::empty(n_columns, n_rhs)) };
        if let Some((_, column)) = whole.first_non_finite() {
            return Err(LeastSquaresError::Overflow { column }.into());
        }
        Ok(Self { n_rows: design.n_rows(), n_columns, whole, norms: None })
    }

    /// Adds rows of `[A | b]`: priors, or constraints with weights.
    ///
    /// # Errors
    /// [`LeastSquaresError`] for another number of columns and for entries that are not finite.
    pub fn append(&mut self, rows: &Matrix) -> Result<(), LeastSquaresError> {
        let width = self.whole.n_columns();
        if rows.n_columns() != width {
            return Err(LeastSquaresError::ColumnsDiffer { expected: width, found: rows.n_columns() });
        }
        let nothing = Matrix::zeros(rows.n_rows(), 0);
        let mut other = Self::of(&StoredDesign::new(rows, &nothing)?)?;
        other.n_columns = self.n_columns;
        *self = std::mem::replace(self, Self::empty(0, 0)).merged(other)?;
        Ok(())
    }

    /// The triangle of the rows of both.
    ///
    /// # Errors
    /// [`LeastSquaresError::ColumnsDiffer`] for systems of another width.
    pub fn merged(self, other: Self) -> Result<Self, LeastSquaresError> {
        for (expected, found) in
            [(self.n_columns, other.n_columns), (self.whole.n_columns(), other.whole.n_columns())]
        {
            if expected != found {
                return Err(LeastSquaresError::ColumnsDiffer { expected, found });
            }
        }
        let is_held = self.norms.is_some() || other.norms.is_some();
        let norms = is_held
            .then(|| self.norms().iter().zip(other.norms()).map(|(one, other)| one.hypot(other)).collect());
        Ok(Self {
            n_rows: self.n_rows + other.n_rows,
            n_columns: self.n_columns,
            whole: dense::merged_triangle(self.whole, other.whole),
            norms,
        })
    }

    /// Norms of the columns of A.
    pub(super) fn norms(&self) -> Vec<f64> {
        let of_whole =
            || (0..self.n_columns).map(|column| norm(&self.whole.column(column)[..self.n_columns]));
        self.norms.clone().unwrap_or_else(|| of_whole().collect())
    }

    /// Rows that have passed.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// Unknowns.
    #[must_use]
    pub fn n_columns(&self) -> usize {
        self.n_columns
    }

    /// Right-hand sides.
    #[must_use]
    pub fn n_rhs(&self) -> usize {
        self.whole.n_columns() - self.n_columns
    }

    /// R, upper triangular (n, n): `RᵀR = AᵀA`.
    #[must_use]
    pub fn r(&self) -> Matrix {
        Matrix::from_fn(self.n_columns, self.n_columns, |row, column| self.whole[(row, column)])
    }

    /// Qᵀb, (n, k).
    #[must_use]
    pub fn qtb(&self) -> Matrix {
        Matrix::from_fn(self.n_columns, self.n_rhs(), |row, rhs| self.whole[(row, self.n_columns + rhs)])
    }

    /// Sum of squares of each right-hand side that no row of R holds; of a singular R, `Qᵀb − R x` holds the rest.
    #[must_use]
    pub fn rest_ss(&self) -> Vec<f64> {
        let left = |rhs: usize| norm(&self.whole.column(self.n_columns + rhs)[self.n_columns..]);
        (0..self.n_rhs()).map(|rhs| left(rhs) * left(rhs)).collect()
    }
}

/// The triangle of one block, which is used up; columns of zeros are left out of the work.
fn of_block(block: &mut Matrix) -> Matrix {
    let n = block.n_columns();
    let in_use = columns_in_use(block);
    if in_use.len() == n {
        return dense::triangle(block);
    }
    let small = dense::triangle(&mut block.with_columns(in_use.iter().copied()));
    scattered(&small, &in_use, n)
}

/// The columns that are not zero throughout.
pub(super) fn columns_in_use(block: &Matrix) -> Vec<usize> {
    (0..block.n_columns()).filter(|&column| block.column(column).iter().any(|&value| value != 0.0)).collect()
}

/// A square matrix over some of `n` columns as one over all of them.
pub(super) fn scattered(small: &Matrix, columns: &[usize], n: usize) -> Matrix {
    let mut result = Matrix::zeros(n, n);
    for (from, &to) in columns.iter().enumerate() {
        for (value, &row) in small.column(from).iter().zip(columns) {
            result[(row, to)] = *value;
        }
    }
    result
}
