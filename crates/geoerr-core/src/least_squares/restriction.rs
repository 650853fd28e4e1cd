//! Exact linear restrictions: the subspace in which a solution is looked for.

use super::LeastSquaresError;
use super::dense;
use super::matrix::{Matrix, norm};

/// A subspace of the unknowns that a solution must lie in.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Restriction {
    /// All unknowns free.
    #[default]
    None,
    /// `C x = 0`, (p, n): every row a constraint that holds exactly. Rows may repeat one another.
    Constraints(Matrix),
    /// `x = N z`, (n, m): x is a combination of these columns.
    Basis(Matrix),
}

/// Relative size of a singular value of C or N (rows of C and columns of N of norm 1) below which it counts as 0.
const DEPENDENT: f64 = 1e-12;

impl Restriction {
    /// An orthonormal basis (n, m) of the subspace in scaled unknowns `y = scale · x`; `None` for all of them.
    pub(super) fn basis(&self, scale: &[f64]) -> Result<Option<Matrix>, LeastSquaresError> {
        match self {
            Self::None => Ok(None),
            Self::Constraints(c) => {
                check(c.n_columns(), scale.len(), c)?;
                let mut rows = c.transposed();
                multiply_rows(&mut rows, scale, |value, scale| value / scale);
                let (u, rank) = range_of(rows)?;
                Ok(Some(u.with_columns(rank..scale.len())))
            }
            Self::Basis(n) => {
                if n.n_rows() != scale.len() {
                    return Err(LeastSquaresError::RowsDiffer { expected: scale.len(), found: n.n_rows() });
                }
                check(scale.len(), scale.len(), n)?;
                let mut columns = n.clone();
                multiply_rows(&mut columns, scale, |value, scale| value * scale);
                let (u, rank) = range_of(columns)?;
                Ok(Some(u.with_columns(0..rank)))
            }
        }
    }
}

fn check(found: usize, expected: usize, matrix: &Matrix) -> Result<(), LeastSquaresError> {
    if found != expected {
        return Err(LeastSquaresError::ColumnsDiffer { expected, found });
    }
    match matrix.first_non_finite() {
        Some((row, column)) => Err(LeastSquaresError::NonFinite { row, column }),
        None => Ok(()),
    }
}

fn multiply_rows(matrix: &mut Matrix, factors: &[f64], by: impl Fn(f64, f64) -> f64) {
    for column in 0..matrix.n_columns() {
        for (value, &factor) in matrix.column_mut(column).iter_mut().zip(factors) {
            *value = by(*value, factor);
        }
    }
}

/// All left singular vectors of the columns, each brought to norm 1, and how many of them span the columns.
fn range_of(mut columns: Matrix) -> Result<(Matrix, usize), LeastSquaresError> {
    for column in 0..columns.n_columns() {
        let size = norm(columns.column(column));
        if size > 0.0 {
            columns.column_mut(column).iter_mut().for_each(|value| *value /= size);
        }
    }
    let svd = dense::svd(&columns)?;
    let largest = svd.values.first().copied().unwrap_or(0.0);
    let rank = svd.values.iter().take_while(|&&value| value > DEPENDENT * largest).count();
    Ok((svd.u, rank))
}
