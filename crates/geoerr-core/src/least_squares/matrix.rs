//! The one dense matrix that crosses this module's border: column by column in one vector.

use std::ops::{Index, IndexMut};

use serde::{Deserialize, Serialize};

/// A dense matrix of `f64`, column-major and without gaps.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Matrix {
    n_rows: usize,
    n_columns: usize,
    values: Vec<f64>,
}

impl Matrix {
    /// All zeros.
    #[must_use]
    pub fn zeros(n_rows: usize, n_columns: usize) -> Self {
        Self { n_rows, n_columns, values: vec![0.0; n_rows * n_columns] }
    }

    /// Ones on the diagonal.
    #[must_use]
    pub fn identity(n: usize) -> Self {
        Self::from_fn(n, n, |row, column| if row == column { 1.0 } else { 0.0 })
    }

    /// The value of `entry(row, column)` everywhere.
    #[must_use]
    pub fn from_fn(n_rows: usize, n_columns: usize, mut entry: impl FnMut(usize, usize) -> f64) -> Self {
        let mut result = Self::zeros(n_rows, n_columns);
        for column in 0..n_columns {
            for (row, value) in result.column_mut(column).iter_mut().enumerate() {
                *value = entry(row, column);
            }
        }
        result
    }

    /// Columns laid one after another; `None` unless there are `n_rows · n_columns` values.
    #[must_use]
    pub fn from_columns(n_rows: usize, n_columns: usize, values: Vec<f64>) -> Option<Self> {
        (n_rows.checked_mul(n_columns) == Some(values.len())).then_some(Self { n_rows, n_columns, values })
    }

    /// Columns laid one after another, as many values as that takes.
    pub(super) fn of_values(n_rows: usize, n_columns: usize, values: Vec<f64>) -> Self {
        Self { n_rows, n_columns, values }
    }

    /// One column.
    #[must_use]
    pub fn from_column(values: Vec<f64>) -> Self {
        Self { n_rows: values.len(), n_columns: 1, values }
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

    /// One column.
    #[must_use]
    pub fn column(&self, column: usize) -> &[f64] {
        &self.values[column * self.n_rows..][..self.n_rows]
    }

    /// One column, to write.
    pub fn column_mut(&mut self, column: usize) -> &mut [f64] {
        &mut self.values[column * self.n_rows..][..self.n_rows]
    }

    /// All columns, one after another.
    #[must_use]
    pub fn as_slice(&self) -> &[f64] {
        &self.values
    }

    /// All columns, one after another, to write.
    pub fn as_mut_slice(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// All columns, one after another; the memory changes hands.
    #[must_use]
    pub fn into_values(self) -> Vec<f64> {
        self.values
    }

    /// Rows become columns.
    #[must_use]
    pub fn transposed(&self) -> Self {
        Self::from_fn(self.n_columns, self.n_rows, |row, column| self[(column, row)])
    }

    /// A copy of some of the columns, in the order of `columns`.
    #[must_use]
    pub fn with_columns(&self, columns: impl IntoIterator<Item = usize>) -> Self {
        let mut values = Vec::new();
        let mut n_columns = 0;
        for column in columns {
            values.extend_from_slice(self.column(column));
            n_columns += 1;
        }
        Self { n_rows: self.n_rows, n_columns, values }
    }

    /// Row and column of the first entry that is not finite, rows before columns.
    #[must_use]
    pub fn first_non_finite(&self) -> Option<(usize, usize)> {
        let is_clean = |column: &[f64]| column.iter().fold(true, |clean, value| clean & value.is_finite());
        let bad = (0..self.n_columns).filter(|&column| !is_clean(self.column(column))).filter_map(|column| {
            Some((self.column(column).iter().position(|value| !value.is_finite())?, column))
        });
        bad.min()
    }
}

impl Index<(usize, usize)> for Matrix {
    type Output = f64;

    fn index(&self, (row, column): (usize, usize)) -> &f64 {
        &self.column(column)[row]
    }
}

impl IndexMut<(usize, usize)> for Matrix {
    fn index_mut(&mut self, (row, column): (usize, usize)) -> &mut f64 {
        &mut self.column_mut(column)[row]
    }
}

/// Euclidean norm that neither overflows nor underflows on the way.
pub(super) fn norm(values: &[f64]) -> f64 {
    let largest = values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    let sum: f64 = values.iter().map(|value| (value / largest) * (value / largest)).sum();
    largest * sum.sqrt()
}
