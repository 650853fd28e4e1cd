//! A system in rows as NumPy has them: multiplied as they lie, turned into columns where a triangle is made of them.

use std::ops::Range;

use super::blocks::Design;
use super::error::LeastSquaresError;
use super::matrix::Matrix;
use super::strided::StridedRows;

/// Rows that are turned into columns together: two cache lines of each column.
const TILE: usize = 16;
/// In so many rows of a block each column has an entry, or columns that have none are looked for.
const ROWS_LOOKED_AT: usize = 16;

/// A system whose rows lie one behind the other, row by row.
#[derive(Clone, Copy, Debug)]
pub struct RowDesign<'a> {
    a: StridedRows<'a>,
    b: StridedRows<'a>,
    n_rows: usize,
}

impl<'a> RowDesign<'a> {
    /// `a` (n × `n_columns`) and `b` (n × `n_rhs`), row by row.
    ///
    /// # Errors
    /// [`LeastSquaresError::RowsDiffer`] for another number of rows in `b`.
    pub fn new(
        (a, n_columns): (&'a [f64], usize),
        (b, n_rhs): (&'a [f64], usize),
        n_rows: usize,
    ) -> Result<Self, LeastSquaresError> {
        for (values, width) in [(a, n_columns), (b, n_rhs)] {
            let found = values.len().checked_div(width).unwrap_or(n_rows);
            if found != n_rows {
                return Err(LeastSquaresError::RowsDiffer { expected: n_rows, found });
            }
        }
        let rows = |values: &'a [f64], width| StridedRows::new(values, 0, width, width, n_rows);
        Ok(Self { a: rows(a, n_columns), b: rows(b, n_rhs), n_rows })
    }

    /// Whether every column surely has an entry in these rows.
    fn is_dense(&self, rows: Range<usize>) -> bool {
        let mut in_use = vec![false; self.a.n_columns()];
        for row in rows.take(ROWS_LOOKED_AT) {
            for (in_use, &value) in in_use.iter_mut().zip(self.a.row(row)) {
                *in_use |= value != 0.0;
            }
        }
        in_use.iter().all(|&in_use| in_use)
    }
}

impl Design for RowDesign<'_> {
    type Error = LeastSquaresError;

    fn n_rows(&self) -> usize {
        self.n_rows
    }

    fn n_columns(&self) -> usize {
        self.a.n_columns()
    }

    fn n_rhs(&self) -> usize {
        self.b.n_columns()
    }

    fn fill(&self, rows: Range<usize>, block: &mut Matrix) -> Result<(), LeastSquaresError> {
        let (a, b) = block.as_mut_slice().split_at_mut(rows.len() * self.n_columns());
        turn(&self.a, rows.clone(), a);
        turn(&self.b, rows, b);
        Ok(())
    }

    fn lower_gram_of(&self, rows: Range<usize>) -> Option<Matrix> {
        if !self.is_dense(rows.clone()) {
            return None;
        }
        let n = self.n_columns();
        let mut whole = Matrix::zeros(n + self.n_rhs(), n + self.n_rhs());
        self.a.add_lower_gram_of(rows.clone(), &mut whole);
        let products = self.a.transposed_product_of(&self.b, rows.clone());
        let of_rhs = self.b.lower_gram_of(rows);
        for rhs in 0..self.n_rhs() {
            for (column, &value) in products.column(rhs).iter().enumerate() {
                whole[(n + rhs, column)] = value;
            }
            whole.column_mut(n + rhs)[n..].copy_from_slice(of_rhs.column(rhs));
        }
        Some(whole)
    }

    fn residual_products_of(&self, rows: Range<usize>, x: &Matrix) -> Option<Matrix> {
        Some(self.a.residual_products_of(&self.b, rows, x))
    }
}

/// Rows as columns.
fn turn(source: &StridedRows<'_>, rows: Range<usize>, target: &mut [f64]) {
    let (width, height) = (source.n_columns(), rows.len());
    for first in (0..height).step_by(TILE) {
        let row = |i: usize| source.row(rows.start + first + i);
        if height - first >= TILE {
            let rows: [&[f64]; TILE] = std::array::from_fn(row);
            for column in 0..width {
                let values: [f64; TILE] = rows.map(|row| row[column]);
                target[column * height + first..][..TILE].copy_from_slice(&values);
            }
        } else {
            for i in 0..height - first {
                for (column, value) in row(i).iter().enumerate() {
                    target[column * height + first + i] = *value;
                }
            }
        }
    }
}
