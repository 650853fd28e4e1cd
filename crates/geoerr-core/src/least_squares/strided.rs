//! Products of rows as NumPy has them: one after another, a component's part of each.

use std::ops::Range;

use rayon::prelude::*;

use super::dense;
use super::matrix::Matrix;

/// Rows whose product is one piece of work: the bytes of a sum depend on it, so it is the same everywhere.
const ROWS_OF_A_PIECE: usize = 1024;
/// Rows that are multiplied at once: what a core's own cache holds.
const ROWS_AT_ONCE: usize = 256;

/// A matrix in rows at equal distances.
#[derive(Clone, Copy, Debug)]
pub struct StridedRows<'a> {
    values: &'a [f64],
    first: usize,
    n_columns: usize,
    stride: usize,
    n_rows: usize,
}

impl<'a> StridedRows<'a> {
    /// Rows of `n_columns` numbers that begin at `first`, `first + stride`, …; fewer where `values` ends before.
    #[must_use]
    pub fn new(values: &'a [f64], first: usize, n_columns: usize, stride: usize, n_rows: usize) -> Self {
        let beyond_first = values.len().checked_sub(first + n_columns);
        let fit = beyond_first.map_or(0, |rest| 1 + rest.checked_div(stride).unwrap_or(n_rows));
        Self { values, first, n_columns, stride: stride.max(n_columns), n_rows: n_rows.min(fit) }
    }

    /// Number of rows.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// Number of columns.
    #[must_use]
    pub fn n_columns(&self) -> usize {
        self.n_columns
    }

    /// One row.
    #[must_use]
    pub fn row(&self, row: usize) -> &'a [f64] {
        &self.values[self.first + row * self.stride..][..self.n_columns]
    }

    /// `AᵀA`, the lower triangle, in parallel.
    #[must_use]
    pub fn lower_gram(&self) -> Matrix {
        self.sum_of_pieces(self.n_columns, self.n_rows, |rows| self.lower_gram_of(rows))
    }

    /// `AᵀB`, in parallel.
    #[must_use]
    pub fn transposed_product(&self, other: &StridedRows<'_>) -> Matrix {
        let n_rows = self.n_rows.min(other.n_rows);
        self.sum_of_pieces(other.n_columns, n_rows, |rows| self.transposed_product_of(other, rows))
    }

    /// `AᵀA` of some rows, the lower triangle.
    pub(super) fn lower_gram_of(&self, rows: Range<usize>) -> Matrix {
        let mut sum = Matrix::zeros(self.n_columns, self.n_columns);
        self.add_lower_gram_of(rows, &mut sum);
        sum
    }

    /// Adds it to the leading columns of a sum that may be larger.
    pub(super) fn add_lower_gram_of(&self, rows: Range<usize>, sum: &mut Matrix) {
        for rows in at_once(rows) {
            dense::add_lower_gram_of_rows(sum, self.n_columns, self.from(rows.start), rows.len());
        }
    }

    /// `AᵀB` of some rows.
    pub(super) fn transposed_product_of(&self, other: &StridedRows<'_>, rows: Range<usize>) -> Matrix {
        let mut sum = Matrix::zeros(self.n_columns, other.n_columns);
        for rows in at_once(rows) {
            dense::add_product_of_strided_rows(
                &mut sum,
                self.from(rows.start),
                other.from(rows.start),
                rows.len(),
            );
        }
        sum
    }

    /// `[Aᵀr, rᵀr]` of some rows, with `r = b − A x`.
    pub(super) fn residual_products_of(&self, b: &StridedRows<'_>, rows: Range<usize>, x: &Matrix) -> Matrix {
        let mut sums = Matrix::zeros(self.n_columns + 1, x.n_columns());
        for rows in at_once(rows) {
            let mut residual =
                Matrix::from_fn(rows.len(), x.n_columns(), |row, rhs| b.row(rows.start + row)[rhs]);
            dense::subtract_product_of_strided_rows(&mut residual, self.from(rows.start), x);
            dense::add_transposed_product_of_strided_rows(&mut sums, self.from(rows.start), &residual);
            for rhs in 0..x.n_columns() {
                sums[(self.n_columns, rhs)] += residual.column(rhs).iter().map(|r| r * r).sum::<f64>();
            }
        }
        sums
    }

    /// The numbers from a row on, and the distance of rows.
    fn from(&self, row: usize) -> (&'a [f64], usize) {
        (&self.values[self.first + row * self.stride..], self.stride)
    }

    /// Sums up pieces, which are as wide as this one's columns are high.
    fn sum_of_pieces(
        &self,
        width: usize,
        n_rows: usize,
        of: impl Fn(Range<usize>) -> Matrix + Sync,
    ) -> Matrix {
        let mut whole = Matrix::zeros(self.n_columns, width);
        if self.n_columns == 0 || width == 0 {
            return whole;
        }
        let starts: Vec<usize> = (0..n_rows).step_by(ROWS_OF_A_PIECE).collect();
        let pieces: Vec<Matrix> =
            starts.par_iter().map(|&start| of(start..n_rows.min(start + ROWS_OF_A_PIECE))).collect();
        for piece in &pieces {
            whole.as_mut_slice().iter_mut().zip(piece.as_slice()).for_each(|(sum, part)| *sum += part);
        }
        whole
    }
}

/// Rows in portions that a core's own cache holds.
fn at_once(rows: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    rows.clone().step_by(ROWS_AT_ONCE).map(move |from| from..rows.end.min(from + ROWS_AT_ONCE))
}
