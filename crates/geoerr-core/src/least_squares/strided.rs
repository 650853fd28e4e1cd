//! Products of rows as NumPy has them: one after another, a component's part of each.

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
        self.sum_of_pieces(self.n_columns, self.n_rows, |sum, from, n_rows| {
            dense::add_lower_gram_of_rows(sum, self.from(from), self.stride, n_rows);
        })
    }

    /// `AᵀB`, in parallel.
    #[must_use]
    pub fn transposed_product(&self, other: &StridedRows<'_>) -> Matrix {
        let n_rows = self.n_rows.min(other.n_rows);
        self.sum_of_pieces(other.n_columns, n_rows, |sum, from, n_rows| {
            let (left, right) = ((self.from(from), self.stride), (other.from(from), other.stride));
            dense::add_product_of_strided_rows(sum, left, right, n_rows);
        })
    }

    fn from(&self, row: usize) -> &'a [f64] {
        &self.values[self.first + row * self.stride..]
    }

    /// Sums up what `add(sum, first row, number of rows)` adds to matrices as wide as this one's columns are high.
    fn sum_of_pieces(
        &self,
        width: usize,
        n_rows: usize,
        add: impl Fn(&mut Matrix, usize, usize) + Sync,
    ) -> Matrix {
        let mut whole = Matrix::zeros(self.n_columns, width);
        if self.n_columns == 0 || width == 0 {
            return whole;
        }
        let starts: Vec<usize> = (0..n_rows).step_by(ROWS_OF_A_PIECE).collect();
        let pieces: Vec<Matrix> = (starts.par_iter())
            .map(|&start| {
                let mut sum = Matrix::zeros(self.n_columns, width);
                let end = n_rows.min(start + ROWS_OF_A_PIECE);
                for from in (start..end).step_by(ROWS_AT_ONCE) {
                    add(&mut sum, from, ROWS_AT_ONCE.min(end - from));
                }
                sum
            })
            .collect();
        for piece in &pieces {
            whole.as_mut_slice().iter_mut().zip(piece.as_slice()).for_each(|(sum, part)| *sum += part);
        }
        whole
    }
}
