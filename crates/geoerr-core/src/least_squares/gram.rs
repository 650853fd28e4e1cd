//! Normal equations, where they are good enough, and the proof that they were.
//!
//! `AᵀA` costs half of QR's operations at the speed of a matrix product, but squares the condition number: a Cholesky solution
//! is wrong by about `κ²ε`. One pass over the rows with the residuals of that solution leaves `(κ²ε)²` of it
//! (a step of iterative refinement), and its size shows what the first solution was worth. So the path is taken only where
//! the condition is below [`CONDITION_LIMIT`], and kept only where the correction was as small as that promises.
//!
//! # Source
//! Björck 1996, 2.2.4 (error of the normal equations after column scaling), 2.9.3 (their refinement).
//!
//! # Verified
//! `tests/least_squares/normal_equations.rs`: x, residuals and standard errors against QR at conditions 1 to 10¹².
//! `tests/least_squares/test_least_squares.py`: both against mpmath with 60 digits.

use super::blocks::{Design, Spares, check_finite, tree};
use super::dense;
use super::error::LeastSquaresError;
use super::matrix::{Matrix, norm};
use super::rank::surely_kept;
use super::solution::{Options, Reduced, Solution, divide_columns, scales, solve};
use super::triangle::{Triangle, columns_in_use, scattered};

/// Condition (Frobenius norms, columns of norm 1) above which normal equations are not used.
///
/// `κ²ε` is 2·10⁻⁷ there: what the covariance may be wrong by, relatively, and what refinement starts from.
pub const CONDITION_LIMIT: f64 = 3e4;

/// How a design is fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Normal equations where their accuracy is proven, QR otherwise.
    #[default]
    Fastest,
    /// QR.
    Qr,
}

/// A solution and the way it was found.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The solution.
    pub solution: Solution,
    /// Whether normal equations served.
    pub is_from_normal_equations: bool,
}

/// Fits a design: two or three passes over its rows with [`Method::Fastest`], one with [`Method::Qr`].
///
/// # Errors
/// The design's own, and [`LeastSquaresError`] as [`Triangle::of`] and [`solve`](super::solve).
///
/// # Examples
/// ```
/// use geoerr_core::least_squares::{LeastSquaresError, Method, Options, design_fn, fit};
/// // A line through 10,000 points that nobody keeps.
/// let line = design_fn(10_000, 2, |rows, block| {
///     for (at, row) in rows.enumerate() {
///         let q = row as f64 / 10_000.0;
///         block[(at, 0)] = 1.0;
///         block[(at, 1)] = q;
///         block[(at, 2)] = 3.0 - 2.0 * q;
///     }
///     Ok::<(), LeastSquaresError>(())
/// });
/// let fit = fit(&line, &Options::default(), Method::Fastest)?;
/// assert!(fit.is_from_normal_equations);
/// assert!((fit.solution.x[(0, 0)] - 3.0).abs() < 1e-14 && (fit.solution.x[(1, 0)] + 2.0).abs() < 1e-14);
/// # Ok::<(), LeastSquaresError>(())
/// ```
pub fn fit<D: Design + ?Sized>(design: &D, options: &Options, method: Method) -> Result<Fit, D::Error> {
    if design.n_columns() == 0 {
        return Err(LeastSquaresError::NoColumns.into());
    }
    if method == Method::Fastest
        && let Some(solution) = by_normal_equations(design, options)?
    {
        return Ok(Fit { solution, is_from_normal_equations: true });
    }
    let solution = solve(&Triangle::of(design)?, options)?;
    Ok(Fit { solution, is_from_normal_equations: false })
}

/// `[A | b]ᵀ [A | b]`, block by block, summed in a fixed tree; not finite where an entry is not.
pub(super) fn gram_of<D: Design + ?Sized>(design: &D) -> Result<Matrix, D::Error> {
    if let Some(gram) = design.gram() {
        return Ok(gram);
    }
    let n = design.n_columns() + design.n_rhs();
    let blocks = design.blocks();
    let spares = Spares::default();
    let make = |block: usize| {
        if let Some(gram) = design.lower_gram_of(blocks.rows(block)) {
            return Ok(gram);
        }
        spares.with_block(design, blocks.rows(block), |block| {
            let in_use = columns_in_use(block);
            Ok(if in_use.len() == n {
                dense::lower_gram(block)
            } else {
                scattered(&dense::lower_gram(&block.with_columns(in_use.iter().copied())), &in_use, n)
            })
        })
    };
    let mut whole = tree(0..blocks.len(), &make, &sum)?.unwrap_or_else(|| Matrix::zeros(n, n));
    dense::mirror_lower(&mut whole);
    Ok(whole)
}

pub(super) fn sum(mut left: Matrix, right: Matrix) -> Matrix {
    left.as_mut_slice().iter_mut().zip(right.as_slice()).for_each(|(left, right)| *left += right);
    left
}

fn by_normal_equations<D: Design + ?Sized>(
    design: &D,
    options: &Options,
) -> Result<Option<Solution>, D::Error> {
    let gram = gram_of(design)?;
    if gram.first_non_finite().is_some() {
        return Ok(None);
    }
    let Some((reduced, condition)) = factored(design, &gram, options)? else { return Ok(None) };
    // What matters of b here is its size: with unknowns near 0 the correction is measured against what b could have made.
    let n = design.n_columns();
    let reach: Vec<f64> = (n..gram.n_columns()).map(|column| gram[(column, column)].sqrt()).collect();
    let mut solution = reduced.solve(options)?;
    solution.root_error = condition * condition * f64::EPSILON;
    let residual = residual_products(design, &solution.x)?;
    for (rhs, reach) in reach.iter().enumerate() {
        let gradient = residual.column(rhs);
        let step = solution.solve_normal(&gradient[..n])?;
        let sizes = [&step, solution.x.column(rhs)]
            .map(|x| norm(&x.iter().zip(&solution.scale).map(|(x, scale)| x * scale).collect::<Vec<_>>()));
        if !is_proven(sizes[0], sizes[1], *reach, condition) {
            return Ok(None);
        }
        let gain: f64 = gradient.iter().zip(&step).map(|(g, step)| g * step).sum();
        solution.residual_ss[rhs] = (gradient[n] - gain).max(0.0);
        solution.x.column_mut(rhs).iter_mut().zip(&step).for_each(|(x, step)| *x += step);
    }
    Ok(Some(solution))
}

/// Whether a correction is no larger than `κ²ε` allows, with a factor for dimensions.
fn is_proven(step: f64, unknowns: f64, reach: f64, condition: f64) -> bool {
    let relative = condition * condition * f64::EPSILON;
    step <= CORRECTION_ROOM
        * (relative * unknowns + relative * reach / condition.max(1.0) + f64::EPSILON * reach)
}

const CORRECTION_ROOM: f64 = 100.0;

/// The Gram matrix of the first n columns brought to norm 1, and the norms that they had; or by other norms.
pub(super) fn scaled_gram(
    gram: &Matrix,
    n: usize,
    norms: Option<&[f64]>,
) -> Result<(Matrix, Vec<f64>), LeastSquaresError> {
    let own = |column: usize| gram[(column, column)].sqrt();
    let scale = scales((0..n).map(|column| norms.map_or_else(|| own(column), |norms| norms[column])))?;
    let mut scaled = Matrix::from_fn(n, n, |row, column| gram[(row, column)] / scale[row]);
    divide_columns(&mut scaled, &scale);
    Ok((scaled, scale))
}

/// The scaled and restricted Cholesky factor, and its condition; `None` where normal equations will not do.
fn factored<D: Design + ?Sized>(
    design: &D,
    gram: &Matrix,
    options: &Options,
) -> Result<Option<(Reduced, f64)>, LeastSquaresError> {
    let (n, k) = (design.n_columns(), design.n_rhs());
    let (mut scaled, scale) = scaled_gram(gram, n, None)?;
    let mut right = Matrix::from_fn(n, k, |row, rhs| gram[(row, n + rhs)] / scale[row]);
    let basis = options.restriction.basis(&scale)?;
    if let Some(basis) = &basis {
        scaled = dense::transposed_product(basis, &dense::product(&scaled, basis));
        right = dense::transposed_product(basis, &right);
    }
    let Some((triangle, condition)) = cholesky_with_condition(scaled) else { return Ok(None) };
    let limit = CONDITION_LIMIT.min(1.0 / surely_kept(design.n_rows(), n, options.rank_tolerance));
    if condition.is_nan() || condition >= limit {
        return Ok(None);
    }
    dense::solve_upper_transposed(&triangle, &mut right);
    let residual_ss = vec![0.0; k];
    let reduced = Reduced { n_rows: design.n_rows(), scale, triangle, qtb: right, residual_ss, basis };
    Ok(Some((reduced, condition)))
}

/// The Cholesky factor of a matrix, and its condition in Frobenius norms.
pub(super) fn cholesky_with_condition(matrix: Matrix) -> Option<(Matrix, f64)> {
    let triangle = dense::cholesky(matrix)?;
    let inverse = dense::upper_inverse(&triangle);
    let condition = norm(triangle.as_slice()) * norm(inverse.as_slice());
    Some((triangle, condition))
}

/// For each right-hand side a column `[Aᵀr, rᵀr]` with `r = b − A x`: one pass over the rows.
///
/// With [`Solution::solve_normal`] the step from any x, of the linear problem or of a Gauss–Newton iteration that keeps its
/// factors.
///
/// # Errors
/// The design's own, and [`LeastSquaresError`] for entries that are not finite and for an x of another shape.
pub fn residual_products<D: Design + ?Sized>(design: &D, x: &Matrix) -> Result<Matrix, D::Error> {
    let (n, k) = (design.n_columns(), design.n_rhs());
    if x.n_rows() != n {
        return Err(LeastSquaresError::RowsDiffer { expected: n, found: x.n_rows() }.into());
    }
    if x.n_columns() != k {
        return Err(LeastSquaresError::ColumnsDiffer { expected: k, found: x.n_columns() }.into());
    }
    let blocks = design.blocks();
    let spares = Spares::default();
    let make = |block: usize| {
        let rows = blocks.rows(block);
        // What is not finite is looked for by columns.
        let known = design.residual_products_of(rows.clone(), x);
        if let Some(sums) = known.filter(|sums| sums.first_non_finite().is_none()) {
            return Ok(sums);
        }
        spares.with_block(design, rows.clone(), |block| {
            let residual = dense::residuals(block, x);
            let gradient = dense::leading_transposed_product(block, n, &residual);
            if gradient.first_non_finite().is_some() {
                check_finite(block, rows.start)?;
            }
            Ok(Matrix::from_fn(n + 1, k, |row, rhs| match row {
                row if row < n => gradient[(row, rhs)],
                _ => residual.column(rhs).iter().map(|r| r * r).sum(),
            }))
        })
    };
    Ok(tree(0..blocks.len(), &make, &sum)?.unwrap_or_else(|| Matrix::zeros(n + 1, k)))
}
