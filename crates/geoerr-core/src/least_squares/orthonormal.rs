//! An orthonormal basis of tall columns, from their Gram matrix.
//!
//! With the columns brought to length 1 and `RᵀR` their Gram matrix, `A R⁻¹` is orthonormal to `‖R⁻¹‖²ε`: where that is
//! small, and it is where the columns are nearly orthonormal already, one pass is enough. Otherwise eigenvectors of the
//! Gram matrix tell which directions are columns of their own, and a second pass makes them orthonormal to rounding.
//!
//! # Source
//! Yamamoto, Nakatsukasa, Yanagisawa & Fukaya, *Roundoff error analysis of the CholeskyQR2 algorithm*, ETNA 44 (2015).
//!
//! # Verified
//! `tests/least_squares/orthonormal.rs`.

use rayon::prelude::*;

use super::dense;
use super::error::LeastSquaresError;
use super::matrix::Matrix;
use super::strided::StridedRows;

/// `‖R⁻¹‖²` (Frobenius) by column above which a single pass is not orthonormal enough: to 10⁻¹³ by column.
const ONE_PASS: f64 = 100.0;
/// Eigenvalues below this are columns inside the others.
const INSIDE: f64 = 1e-9;
/// Rows that are multiplied at once.
const ROWS_AT_ONCE: usize = 256;

/// Orthonormal columns, row by row, and their number; columns inside the others, and 0, are left out.
///
/// `rows` has `n_columns` numbers a row. The bytes do not depend on the number of threads.
///
/// # Errors
/// [`LeastSquaresError::NonFinite`] for entries that are not finite.
pub fn orthonormal(rows: &[f64], n_columns: usize) -> Result<(Vec<f64>, usize), LeastSquaresError> {
    let gram = gram_of(rows, n_columns)?;
    if let Some(factor) = orthonormalizing(&gram) {
        return Ok((times_upper(rows, &factor), n_columns));
    }
    let (factor, count) = independent(&gram)?;
    let once = times(rows, &factor);
    match orthonormalizing(&gram_of(&once, count)?) {
        Some(factor) => Ok((times_upper(&once, &factor), count)),
        None => Ok((once, count)),
    }
}

/// The upper triangle that makes columns with this Gram matrix (its lower triangle) orthonormal to rounding in one
/// product; `None` where columns are too much alike for that.
#[must_use]
pub fn orthonormalizing(gram: &Matrix) -> Option<Matrix> {
    let (unit, size) = scaled(gram);
    let mut inverse = dense::upper_inverse(&dense::cholesky(unit)?);
    let squares: f64 = inverse.as_slice().iter().map(|value| value * value).sum();
    if !squares.is_finite() || squares > ONE_PASS * size.len() as f64 {
        return None;
    }
    for j in 0..size.len() {
        for (value, size) in inverse.column_mut(j).iter_mut().zip(&size) {
            *value /= size;
        }
    }
    Some(inverse)
}

/// What makes columns orthonormal but for rounding that columns alike have made larger, and how many there are then.
fn independent(gram: &Matrix) -> Result<(Matrix, usize), LeastSquaresError> {
    let (mut unit, size) = scaled(gram);
    dense::mirror_lower(&mut unit);
    let (values, vectors) = dense::symmetric_eigen(&unit)?;
    let kept: Vec<usize> = (0..size.len()).filter(|&j| values[j] > INSIDE).collect();
    let factor = Matrix::from_fn(size.len(), kept.len(), |i, j| {
        vectors[(i, kept[j])] / (size[i] * values[kept[j]].sqrt())
    });
    Ok((factor, kept.len()))
}

/// The Gram matrix of columns brought to length 1, and the lengths that they had.
fn scaled(gram: &Matrix) -> (Matrix, Vec<f64>) {
    let n = gram.n_columns();
    let size: Vec<f64> =
        (0..n).map(|j| Some(gram[(j, j)].sqrt()).filter(|&size| size > 0.0).unwrap_or(1.0)).collect();
    let mut unit = gram.clone();
    for j in 0..n {
        for (value, of_row) in unit.column_mut(j).iter_mut().zip(&size) {
            *value /= of_row * size[j];
        }
    }
    (unit, size)
}

fn gram_of(rows: &[f64], n_columns: usize) -> Result<Matrix, LeastSquaresError> {
    let n_rows = rows.len().checked_div(n_columns).unwrap_or(0);
    let gram = StridedRows::new(rows, 0, n_columns, n_columns, n_rows).lower_gram();
    if gram.first_non_finite().is_some() {
        let at = rows.iter().position(|value| !value.is_finite()).unwrap_or(0);
        return Err(LeastSquaresError::NonFinite { row: at / n_columns, column: at % n_columns });
    }
    Ok(gram)
}

/// `A · upper` for rows of A.
fn times_upper(rows: &[f64], upper: &Matrix) -> Vec<f64> {
    by_pieces(rows, upper, |target, rows| dense::set_rows_times_upper(target, rows, upper))
}

/// `A · factor` for rows of A.
fn times(rows: &[f64], factor: &Matrix) -> Vec<f64> {
    by_pieces(rows, factor, |target, rows| dense::set_rows_times(target, rows, factor))
}

fn by_pieces(rows: &[f64], factor: &Matrix, product: impl Fn(&mut [f64], &[f64]) + Sync) -> Vec<f64> {
    let (width, found) = (factor.n_rows(), factor.n_columns());
    if found == 0 {
        return Vec::new();
    }
    let mut result = vec![0.0; rows.len() / width * found];
    let pieces = result.par_chunks_mut(ROWS_AT_ONCE * found).zip(rows.par_chunks(ROWS_AT_ONCE * width));
    pieces.for_each(|(target, rows)| product(target, rows));
    result
}
