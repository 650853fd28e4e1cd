//! The triangle of a tall system from its Gram matrix, where that tells as surely as QR what the system determines.
//!
//! Eigenvalues of the Gram matrix are right to ε, singular values below √ε are lost in it. Where all directions are
//! either well above the tolerance that rank is decided by or well below it, nothing hangs on those that are lost; one
//! more pass over the rows says what they are, and turns them where the rows see least.
//!
//! # Source
//! Golub & Van Loan, *Matrix Computations*, 4th ed., 8.1 (what a small change of a matrix does to its eigenvectors: the
//! step that turns them). Björck 1996, 2.2.4 (error of normal equations after column scaling).
//!
//! # Verified
//! `tests/least_squares/quick_triangle.rs`: rank, null space, covariance and steps against those of QR, in a restriction too.

use super::blocks::{Design, Spares, tree};
use super::dense;
use super::error::LeastSquaresError;
use super::gram::{CONDITION_LIMIT, cholesky_with_condition, gram_of, scaled_gram, sum};
use super::matrix::{Matrix, norm};
use super::triangle::Triangle;

/// What is dropped is below the tolerance by this factor, singular values of columns of norm 1.
const SURELY_DROPPED: f64 = 0.1;
/// Eigenvalues are right to this many ε times their number.
const ROUNDED: f64 = 4.0;
/// Sums of squares below this have lost digits.
const LEAST_SQUARE: f64 = f64::MIN_POSITIVE / f64::EPSILON;

impl Triangle {
    /// The triangle of the columns alone, for deciding rank at a tolerance (relative to the largest singular value of
    /// columns of norm 1): from the Gram matrix where that shows it, otherwise by QR.
    ///
    /// Half of QR's operations at the speed of a product of matrices. A covariance is wrong by `κ²ε`, 2·10⁻⁷ at the
    /// most; steps from gradients ([`Solution::solve_normal`](super::Solution::solve_normal)) lead to the same minimum.
    ///
    /// # Errors
    /// As [`Triangle::of`].
    pub fn for_rank<D: Design + ?Sized>(design: &D, tolerance: f64) -> Result<Self, D::Error> {
        Self::for_rank_within(design, tolerance, &Matrix::zeros(0, design.n_columns()))
    }

    /// The same for solutions x that are all restricted to `C x = 0`, with C (p, n) the `constraints`.
    ///
    /// Where these fix all that the rows leave free, as a gauge does, rows that hold them make the system definite: no
    /// eigenvector is looked for, and in the restriction the triangle is the same.
    ///
    /// # Errors
    /// As [`Triangle::of`].
    pub fn for_rank_within<D: Design + ?Sized>(
        design: &D,
        tolerance: f64,
        constraints: &Matrix,
    ) -> Result<Self, D::Error> {
        let (n_rows, n_columns) = (design.n_rows(), design.n_columns());
        if constraints.n_columns() != n_columns {
            let (expected, found) = (n_columns, constraints.n_columns());
            return Err(LeastSquaresError::ColumnsDiffer { expected, found }.into());
        }
        if design.n_rhs() == 0
            && let Some((whole, norms)) = from_gram(design, tolerance, constraints)?
        {
            return Ok(Self { n_rows, n_columns, whole, norms });
        }
        let triangle = Self::of(design)?;
        let norms = design.norms().map(<[f64]>::to_vec).or(triangle.norms);
        Ok(Self { norms, ..triangle })
    }
}

/// A triangle, and the norms that its columns have without the rows of the restriction, where it holds these.
type Whole = (Matrix, Option<Vec<f64>>);

fn from_gram<D: Design + ?Sized>(
    design: &D,
    tolerance: f64,
    constraints: &Matrix,
) -> Result<Option<Whole>, D::Error> {
    let n = design.n_columns();
    let least_dropped = (SURELY_DROPPED * tolerance).powi(2);
    if n == 0 || least_dropped < ROUNDED * n as f64 * f64::EPSILON {
        return Ok(None);
    }
    let gram = gram_of(design)?;
    // A column of which nothing is seen may be one of zeros, or one whose squares are no numbers.
    if gram.first_non_finite().is_some() || (0..n).any(|column| gram[(column, column)] < LEAST_SQUARE) {
        return Ok(None);
    }
    let (unit, scale) = scaled_gram(&gram, n, design.norms())?;
    let well_conditioned = |matrix: Matrix| {
        cholesky_with_condition(matrix).filter(|(_, condition)| *condition < CONDITION_LIMIT)
    };
    let (mut triangle, is_held) = if let Some((triangle, _)) = well_conditioned(unit.clone()) {
        (triangle, false)
    } else if let Some((triangle, _)) = held(&unit, &scale, constraints).and_then(well_conditioned) {
        (triangle, true)
    } else if let Some(directions) = Directions::of(&unit, least_dropped)? {
        (directions.turned(design, &scale)?, false)
    } else {
        return Ok(None);
    };
    for (column, scale) in scale.iter().enumerate() {
        triangle.column_mut(column).iter_mut().for_each(|value| *value *= scale);
    }
    let is_other = is_held || design.norms().is_some();
    Ok(Some((triangle, is_other.then_some(scale))))
}

/// A scaled Gram matrix with what rows of the constraints, each of norm 1 in scaled unknowns, add to it; `None` without any.
fn held(unit: &Matrix, scale: &[f64], constraints: &Matrix) -> Option<Matrix> {
    let (p, n) = (constraints.n_rows(), constraints.n_columns());
    let mut columns = Matrix::from_fn(n, p, |column, row| constraints[(row, column)] / scale[column]);
    for row in 0..p {
        let size = norm(columns.column(row));
        if size > 0.0 {
            columns.column_mut(row).iter_mut().for_each(|value| *value /= size);
        }
    }
    let more = dense::gram(&columns.transposed());
    (p > 0).then(|| Matrix::from_fn(n, n, |row, column| unit[(row, column)] + more[(row, column)]))
}

/// Eigenvectors of a scaled Gram matrix, in two lots far from one another.
struct Directions {
    /// Roots of the eigenvalues of those that are kept.
    sizes: Vec<f64>,
    /// (n, r).
    kept: Matrix,
    /// (n, d).
    dropped: Matrix,
}

impl Directions {
    /// `None` where some are neither surely kept nor surely dropped.
    fn of<E: From<LeastSquaresError>>(unit: &Matrix, least_dropped: f64) -> Result<Option<Self>, E> {
        let (values, vectors) = dense::symmetric_eigen(unit)?;
        let largest = values.last().copied().unwrap_or(0.0);
        let n_dropped = values.iter().take_while(|&&value| value < least_dropped * largest).count();
        let least_kept = largest / CONDITION_LIMIT.powi(2);
        if largest <= 0.0 || values.get(n_dropped).is_some_and(|&value| value < least_kept) {
            return Ok(None);
        }
        Ok(Some(Self {
            sizes: values[n_dropped..].iter().map(|value| value.sqrt()).collect(),
            kept: vectors.with_columns(n_dropped..values.len()),
            dropped: vectors.with_columns(0..n_dropped),
        }))
    }

    /// The triangle of the scaled system, its dropped directions as the rows themselves see them.
    fn turned<D: Design + ?Sized>(mut self, design: &D, scale: &[f64]) -> Result<Matrix, D::Error> {
        let (n, r, d) = (scale.len(), self.kept.n_columns(), self.dropped.n_columns());
        let (across, squares) = seen(design, &self.dropped, scale)?;
        // Of every dropped direction what it has of the kept ones.
        let mut along = dense::transposed_product(&self.kept, &across);
        for column in 0..d {
            for (value, size) in along.column_mut(column).iter_mut().zip(&self.sizes) {
                *value /= size * size;
            }
        }
        let wrongly_kept = dense::product(&self.dropped, &along.transposed());
        let wrongly_dropped = dense::product(&self.kept, &along);
        for column in 0..r {
            add(self.kept.column_mut(column), 1.0, wrongly_kept.column(column));
        }
        for column in 0..d {
            add(self.dropped.column_mut(column), -1.0, wrongly_dropped.column(column));
        }
        // What the rows see of them then: the squares less what the kept directions take.
        let taken = Matrix::from_fn(r, d, |row, column| along[(row, column)] * self.sizes[row]);
        let taken = dense::gram(&taken);
        let left = Matrix::from_fn(d, d, |row, column| squares[(row, column)] - taken[(row, column)]);
        let (values, vectors) = dense::symmetric_eigen(&left)?;
        let turned = dense::product(&self.dropped, &vectors);
        let mut rows = Matrix::from_fn(n, n, |row, column| {
            if row < r {
                self.sizes[row] * self.kept[(column, row)]
            } else {
                values[row - r].max(0.0).sqrt() * turned[(column, row - r)]
            }
        });
        Ok(dense::triangle(&mut rows))
    }
}

fn add(target: &mut [f64], factor: f64, values: &[f64]) {
    target.iter_mut().zip(values).for_each(|(target, value)| *target += factor * value);
}

/// What the rows of a scaled system see of some directions x (n, d): `AᵀA x` (n, d) and `xᵀAᵀA x` (d, d).
fn seen<D: Design + ?Sized>(
    design: &D,
    directions: &Matrix,
    scale: &[f64],
) -> Result<(Matrix, Matrix), D::Error> {
    let (n, d) = (directions.n_rows(), directions.n_columns());
    let unscaled = Matrix::from_fn(n, d, |row, column| directions[(row, column)] / scale[row]);
    let (mut across, squares) = match design.along(&unscaled) {
        Some(known) => known,
        None => along_rows(design, &unscaled)?,
    };
    for column in 0..d {
        across.column_mut(column).iter_mut().zip(scale).for_each(|(value, scale)| *value /= scale);
    }
    Ok((across, squares))
}

fn along_rows<D: Design + ?Sized>(design: &D, directions: &Matrix) -> Result<(Matrix, Matrix), D::Error> {
    let (n, d) = (directions.n_rows(), directions.n_columns());
    let blocks = design.blocks();
    let spares = Spares::default();
    let make = |block: usize| {
        spares.with_block(design, blocks.rows(block), |block| {
            let moved = dense::leading_product(block, directions);
            Ok((dense::leading_transposed_product(block, n, &moved), dense::gram(&moved)))
        })
    };
    let both = |left: (Matrix, Matrix), right: (Matrix, Matrix)| (sum(left.0, right.0), sum(left.1, right.1));
    let nothing = || (Matrix::zeros(n, d), Matrix::zeros(d, d));
    Ok(tree(0..blocks.len(), &make, &both)?.unwrap_or_else(nothing))
}
