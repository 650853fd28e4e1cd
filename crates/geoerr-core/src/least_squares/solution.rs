//! From a triangle to a solution that says what the data determine.
//!
//! ```math
//! y = D x,\quad R_s = R D^{-1},\quad y = N z,\quad R_s N = U\,\Sigma\,V^\mathsf{T},\quad
//! x = D^{-1} N V_1 \Sigma_1^{-1} U_1^\mathsf{T} Q^\mathsf{T} b,\quad F = D^{-1} N V_1 \Sigma_1^{-1},\quad (A^\mathsf{T}A)^{+} = F F^\mathsf{T}
//! ```
//!
//! | symbol | code | meaning | shape |
//! |---|---|---|---|
//! | `$D$` | `scale` | norms of the columns of A (1 for a column of zeros) | n |
//! | `$N$` | `basis` | orthonormal basis of the restriction in scaled unknowns | (n, m) |
//! | `$V_1, \Sigma_1$` | - | what is determined: singular values above the tolerance | (m, r), r |
//! | `$F$` | `root` | root of the unscaled covariance on what is determined | (n, r) |
//! | `$N V_0$` | `null_scaled` | what is not determined, orthonormal, scaled unknowns | (n, m − r) |
//!
//! # Source
//! Golub & Van Loan, *Matrix Computations*, 4th ed., 5.3 (least squares), 5.5 (rank), 6.2 (restrictions by an orthogonal
//! complement). Björck, *Numerical Methods for Least Squares Problems*, 1996, 2.7.3 (condition of the column-scaled matrix),
//! 6.6.5 (corrected semi-normal equations).
//!
//! # Verified
//! `tests/least_squares/` of this crate: nalgebra's SVD, known null spaces, Monte-Carlo of the covariance, refits, NIST's
//! certified values. `tests/least_squares/` of the project: NumPy, and mpmath with 60 digits.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::dense;
use super::error::LeastSquaresError;
use super::matrix::{Matrix, norm};
use super::null_space::readable;
use super::rank::{RankDecision, decide, surely_kept};
use super::restriction::Restriction;
use super::root::Root;
use super::triangle::Triangle;

/// How a triangle is solved.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// Singular values below this part of the largest (columns of norm 1) count as 0.
    ///
    /// Without it: rows × ε, moved to the widest gap in the neighbourhood; see [`RankDecision`]. Below 16 × (rows of a
    /// block) × ε it has no effect: what is smaller within a block did not survive its QR.
    pub rank_tolerance: Option<f64>,
    /// The subspace that the solution must lie in.
    pub restriction: Restriction,
    /// Singular values are wanted even where the condition shows full rank without them.
    pub wants_singular_values: bool,
}

/// A solution, and what of it the data determine.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Solution {
    /// The unknowns (n, k): of all minimisers the one whose scaled norm is smallest.
    pub x: Matrix,
    /// Sum of squared residuals of each right-hand side.
    pub residual_ss: Vec<f64>,
    /// Rows minus rank; 0 where there are fewer rows than that.
    pub degrees_of_freedom: usize,
    /// Unknowns that the restriction leaves free.
    pub n_free: usize,
    /// How many of them the data determine, and how clearly so.
    pub rank: RankDecision,
    /// Largest singular value over the smallest kept one, columns of norm 1; without singular values an estimate from below,
    /// seldom by more than a tenth.
    pub condition: f64,
    /// Singular values of the scaled and restricted system, largest first, where they were needed or wanted.
    pub singular_values: Option<Vec<f64>>,
    /// Which unknowns the data and the restriction determine.
    pub is_determined: Vec<bool>,
    /// What is not determined (n, d), in the caller's units, reduced echelon form with 1 the largest entry.
    pub null_space: Matrix,
    pub(super) scale: Vec<f64>,
    pub(super) root: Root,
    /// What `root` may be wrong by, relatively: ε times the condition, or its square.
    pub(super) root_error: f64,
    pub(super) null_scaled: Matrix,
    pub(super) noise: f64,
}

/// A linear function of the unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Functional {
    /// Its value.
    pub value: f64,
    /// Its variance for residuals of variance 1.
    pub variance: f64,
}

/// Solves the least-squares problem that a triangle stands for.
///
/// # Errors
/// [`LeastSquaresError`] for a tolerance outside [0, 1) and a restriction of another size.
///
/// # Examples
/// ```
/// use geoerr_core::least_squares::{Matrix, Options, StoredDesign, Triangle, solve};
/// // Two unknowns of which only the sum is seen.
/// let a = Matrix::from_fn(4, 2, |_, _| 1.0);
/// let b = Matrix::from_column(vec![2.0, 2.0, 4.0, 4.0]);
/// let solution = solve(&Triangle::of(&StoredDesign::new(&a, &b)?)?, &Options::default())?;
/// assert_eq!(solution.rank.rank, 1);
/// assert!(!solution.is_determined[0] && solution.is_estimable(&[1.0, 1.0])?);
/// assert!((solution.null_space[(0, 0)] - 1.0).abs() < 1e-14 && (solution.null_space[(1, 0)] + 1.0).abs() < 1e-14);
/// assert!((solution.x[(0, 0)] + solution.x[(1, 0)] - 3.0).abs() < 1e-14);
/// # Ok::<(), geoerr_core::least_squares::LeastSquaresError>(())
/// ```
pub fn solve(triangle: &Triangle, options: &Options) -> Result<Solution, LeastSquaresError> {
    let (r, qtb) = (triangle.r(), triangle.qtb());
    let scale = scales(triangle.norms().into_iter())?;
    let mut scaled = r;
    divide_columns(&mut scaled, &scale);
    let basis = options.restriction.basis(&scale)?;
    let mut reduced = Reduced {
        n_rows: triangle.n_rows(),
        scale,
        triangle: scaled,
        qtb,
        residual_ss: triangle.rest_ss(),
        basis: None,
    };
    if let Some(basis) = basis {
        reduced.restrict(basis);
    }
    reduced.solve(options)
}

/// Column norms as scales: 1 for a column of zeros.
pub(super) fn scales(norms: impl Iterator<Item = f64>) -> Result<Vec<f64>, LeastSquaresError> {
    let scale = |(column, norm): (usize, f64)| match norm {
        0.0 => Ok(1.0),
        norm if norm.is_finite() => Ok(norm),
        _ => Err(LeastSquaresError::Overflow { column }),
    };
    norms.enumerate().map(scale).collect()
}

pub(super) fn divide_columns(matrix: &mut Matrix, scale: &[f64]) {
    for (column, &scale) in scale.iter().enumerate() {
        matrix.column_mut(column).iter_mut().for_each(|value| *value /= scale);
    }
}

/// A scaled triangle in the free unknowns z, on its way to a solution.
pub(super) struct Reduced {
    pub n_rows: usize,
    pub scale: Vec<f64>,
    /// (m, m), upper.
    pub triangle: Matrix,
    /// (m, k).
    pub qtb: Matrix,
    pub residual_ss: Vec<f64>,
    /// (n, m), orthonormal; `None` stands for the identity.
    pub basis: Option<Matrix>,
}

impl Reduced {
    fn restrict(&mut self, basis: Matrix) {
        let (n, m, k) = (basis.n_rows(), basis.n_columns(), self.qtb.n_columns());
        let restricted = dense::product(&self.triangle, &basis);
        let mut both = Matrix::from_fn(n, m + k, |row, column| match column.checked_sub(m) {
            None => restricted[(row, column)],
            Some(rhs) => self.qtb[(row, rhs)],
        });
        let whole = dense::triangle(&mut both);
        self.triangle = Matrix::from_fn(m, m, |row, column| whole[(row, column)]);
        self.qtb = Matrix::from_fn(m, k, |row, rhs| whole[(row, m + rhs)]);
        for (rhs, sum) in self.residual_ss.iter_mut().enumerate() {
            let rest = norm(&whole.column(m + rhs)[m..]);
            *sum += rest * rest;
        }
        self.basis = Some(basis);
    }

    pub fn solve(self, options: &Options) -> Result<Solution, LeastSquaresError> {
        let asked = options.rank_tolerance;
        if let Some(tolerance) = asked.filter(|tolerance| !(0.0..1.0).contains(tolerance)) {
            return Err(LeastSquaresError::Tolerance { tolerance });
        }
        let m = self.triangle.n_columns();
        let inverse = inverse_if_finite(&self.triangle);
        let bound = inverse
            .as_ref()
            .map_or(f64::INFINITY, |inverse| norm(self.triangle.as_slice()) * norm(inverse.as_slice()));
        let is_surely_full = bound * surely_kept(self.n_rows, m, asked) < 1.0;
        if let (true, false, Some(inverse)) = (is_surely_full, options.wants_singular_values, &inverse) {
            let condition = largest_singular(&self.triangle) * largest_singular(inverse);
            let rank = RankDecision { gap: 1.0 / (condition * f64::EPSILON), ..decide(&[], 0, 0, asked) };
            let tolerance = asked.unwrap_or(super::rank::default_tolerance(self.n_rows, m));
            let rank = RankDecision { rank: m, tolerance, ..rank };
            let mut z = self.qtb.clone();
            dense::solve_upper(&self.triangle, &mut z);
            let parts = Parts {
                z,
                root: inverse.clone(),
                null: Matrix::zeros(m, 0),
                unexplained: Matrix::zeros(0, 0),
            };
            return Ok(self.finish(parts, rank, condition, None));
        }
        let svd = dense::svd(&self.triangle)?;
        let rank = decide(&svd.values, self.n_rows, m, asked);
        let r = rank.rank;
        let condition = if r == 0 { 1.0 } else { svd.values[0] / svd.values[r - 1] };
        let coordinates = dense::transposed_product(&svd.u, &self.qtb);
        let k = coordinates.n_columns();
        let parts = match inverse.filter(|_| r == m) {
            Some(inverse) => {
                let mut z = self.qtb.clone();
                dense::solve_upper(&self.triangle, &mut z);
                Parts { z, root: inverse, null: Matrix::zeros(m, 0), unexplained: Matrix::zeros(0, k) }
            }
            None => {
                let root = Matrix::from_fn(m, r, |row, j| svd.v[(row, j)] / svd.values[j]);
                let explained = Matrix::from_fn(r, k, |row, rhs| coordinates[(row, rhs)]);
                Parts {
                    z: dense::product(&root, &explained),
                    root,
                    null: svd.v.with_columns(r..m),
                    unexplained: Matrix::from_fn(m - r, k, |row, rhs| coordinates[(r + row, rhs)]),
                }
            }
        };
        Ok(self.finish(parts, rank, condition, Some(svd.values)))
    }

    fn finish(
        self,
        parts: Parts,
        rank: RankDecision,
        condition: f64,
        singular_values: Option<Vec<f64>>,
    ) -> Solution {
        let in_scaled = |free: Matrix| match &self.basis {
            Some(basis) => dense::product(basis, &free),
            None => free,
        };
        let in_units = |free: Matrix| {
            let mut values = in_scaled(free);
            for column in 0..values.n_columns() {
                values
                    .column_mut(column)
                    .iter_mut()
                    .zip(&self.scale)
                    .for_each(|(value, scale)| *value /= scale);
            }
            values
        };
        let mut residual_ss = self.residual_ss.clone();
        for (rhs, sum) in residual_ss.iter_mut().enumerate() {
            if parts.unexplained.n_rows() > 0 {
                let rest = norm(parts.unexplained.column(rhs));
                *sum += rest * rest;
            }
        }
        let noise = noise_of(condition);
        let null_scaled = in_scaled(parts.null);
        let n = self.scale.len();
        let mixes = |row: usize| {
            let row: Vec<f64> = (0..null_scaled.n_columns()).map(|j| null_scaled[(row, j)]).collect();
            norm(&row)
        };
        Solution {
            x: in_units(parts.z),
            residual_ss,
            degrees_of_freedom: self.n_rows.saturating_sub(rank.rank),
            n_free: self.triangle.n_columns(),
            rank,
            condition,
            singular_values,
            is_determined: (0..n).map(|row| mixes(row) <= noise).collect(),
            null_space: readable(&null_scaled, &self.scale, noise),
            root: Root::Whole(in_units(parts.root)),
            root_error: condition * f64::EPSILON,
            null_scaled,
            noise,
            scale: self.scale,
        }
    }
}

/// A null vector is wrong by about ε times the condition of what is kept; this leaves room for dimensions.
const NOISE_OF_NULL_VECTORS: f64 = 1e3;

/// Entries of null vectors, of norm 1 in scaled unknowns, below this are 0.
pub(super) fn noise_of(condition: f64) -> f64 {
    (NOISE_OF_NULL_VECTORS * condition * f64::EPSILON).clamp(1e-9, 1e-3)
}

struct Parts {
    z: Matrix,
    root: Matrix,
    null: Matrix,
    unexplained: Matrix,
}

fn inverse_if_finite(triangle: &Matrix) -> Option<Matrix> {
    let n = triangle.n_columns();
    if (0..n).any(|j| triangle[(j, j)] == 0.0) {
        return None;
    }
    Some(dense::upper_inverse(triangle)).filter(|inverse| inverse.first_non_finite().is_none())
}

/// Largest singular value of a triangle, from below.
fn largest_singular(triangle: &Matrix) -> f64 {
    let times = |vector: &Matrix| dense::product(triangle, vector);
    largest_singular_of(triangle.n_columns(), &times, &|image| dense::transposed_product(triangle, image))
}

/// Largest singular value of a matrix with n columns by power iteration, from below; of its products with vectors, and of
/// those of its transpose.
pub(super) fn largest_singular_of(
    n: usize,
    times: &impl Fn(&Matrix) -> Matrix,
    transposed_times: &impl Fn(&Matrix) -> Matrix,
) -> f64 {
    // A start without symmetry, so that no singular vector of a structured triangle is orthogonal to it.
    let start = |row: usize| 1.0 + 0.5 * (row as f64 * 0.618_033_988_749_895).fract();
    let mut vector = Matrix::from_column((0..n).map(start).collect());
    let mut value = 0.0;
    for _ in 0..POWER_STEPS {
        let size = norm(vector.as_slice());
        if size == 0.0 {
            return value;
        }
        vector.as_mut_slice().iter_mut().for_each(|entry| *entry /= size);
        let image = times(&vector);
        value = norm(image.as_slice());
        vector = transposed_times(&image);
    }
    value
}

const POWER_STEPS: usize = 12;

impl Solution {
    fn n(&self) -> usize {
        self.scale.len()
    }

    /// Whether it is one of a bordered system.
    #[must_use]
    pub fn is_bordered(&self) -> bool {
        matches!(self.root, Root::Bordered(_))
    }

    fn check(&self, length: usize) -> Result<(), LeastSquaresError> {
        if length == self.n() {
            Ok(())
        } else {
            Err(LeastSquaresError::RowsDiffer { expected: self.n(), found: length })
        }
    }

    /// Covariance (n, n) of the unknowns for residuals of variance 1: `(AᵀA)⁺` in the restriction.
    ///
    /// Rows and columns of what is not determined are NaN. Linear functions that are determined although their unknowns are
    /// not: [`functional`](Self::functional).
    #[must_use]
    pub fn covariance(&self) -> Matrix {
        let mut result = dense::gram(&self.root.to_matrix().transposed());
        for (index, _) in self.is_determined.iter().enumerate().filter(|(_, is_determined)| !**is_determined)
        {
            result.column_mut(index).fill(f64::NAN);
            (0..self.n()).for_each(|column| result[(index, column)] = f64::NAN);
        }
        result
    }

    /// Standard errors of the unknowns for residuals of variance 1; NaN where not determined.
    #[must_use]
    pub fn standard_errors(&self) -> Vec<f64> {
        let errors = self.spread().into_iter().zip(&self.is_determined);
        errors.map(|(error, &is_determined)| if is_determined { error } else { f64::NAN }).collect()
    }

    /// The same, of what is not determined as `F` below has it.
    #[must_use]
    pub fn spread(&self) -> Vec<f64> {
        self.root.row_norms()
    }

    /// A root F (n, rank) of the unscaled covariance: `F Fᵀ = (AᵀA)⁺` in the restriction.
    #[must_use]
    pub fn covariance_root(&self) -> Cow<'_, Matrix> {
        self.root.to_matrix()
    }

    /// Its first rows: those of so many unknowns.
    ///
    /// # Errors
    /// [`LeastSquaresError::RowsDiffer`] for more than there are.
    pub fn covariance_root_of_first(&self, count: usize) -> Result<Matrix, LeastSquaresError> {
        if count > self.n() {
            return Err(LeastSquaresError::RowsDiffer { expected: self.n(), found: count });
        }
        Ok(self.root.first_rows(count))
    }

    /// Whether the data and the restriction determine `cᵀx`: c is orthogonal to what they do not.
    ///
    /// # Errors
    /// [`LeastSquaresError::RowsDiffer`] for a vector of another length.
    pub fn is_estimable(&self, c: &[f64]) -> Result<bool, LeastSquaresError> {
        self.check(c.len())?;
        let scaled = Matrix::from_column(c.iter().zip(&self.scale).map(|(c, scale)| c / scale).collect());
        let mixed = dense::transposed_product(&self.null_scaled, &scaled);
        Ok(norm(mixed.as_slice()) <= self.noise * norm(scaled.as_slice()))
    }

    /// `cᵀx` for one right-hand side, with its variance; `None` where it is not determined.
    ///
    /// # Errors
    /// [`LeastSquaresError`] for a vector of another length and a right-hand side that there is not.
    pub fn functional(&self, c: &[f64], rhs: usize) -> Result<Option<Functional>, LeastSquaresError> {
        let x = self.unknowns(rhs)?;
        if !self.is_estimable(c)? {
            return Ok(None);
        }
        let along = dense::transposed_product(&self.root.to_matrix(), &Matrix::from_column(c.to_vec()));
        let size = norm(along.as_slice());
        let value = c.iter().zip(x).map(|(c, x)| c * x).sum();
        Ok(Some(Functional { value, variance: size * size }))
    }

    pub(super) fn unknowns(&self, rhs: usize) -> Result<&[f64], LeastSquaresError> {
        let n_rhs = self.x.n_columns();
        if rhs >= n_rhs {
            return Err(LeastSquaresError::NoSuchRightHandSide { index: rhs, n_rhs });
        }
        Ok(self.x.column(rhs))
    }

    /// `(AᵀA)⁺ g` in the restriction, for `g = Aᵀr`: a Gauss–Newton step with the factors of an earlier one.
    ///
    /// For a linear problem one step from a solution removes what rounding left of it (corrected semi-normal equations).
    ///
    /// # Errors
    /// [`LeastSquaresError::RowsDiffer`] for a vector of another length.
    pub fn solve_normal(&self, atr: &[f64]) -> Result<Vec<f64>, LeastSquaresError> {
        self.check(atr.len())?;
        Ok(self.root.times_transposed_times(atr))
    }

    /// By how much the sum of squared residuals grows when `functionals` (n, q) of x are all held at 0.
    ///
    /// The numerator of an F-test with q degrees of freedom, without a second fit. `None` where one of them is not
    /// determined or they depend on one another.
    ///
    /// # Errors
    /// [`LeastSquaresError`] for another number of rows and a right-hand side that there is not.
    ///
    /// # Source
    /// Seber & Lee, *Linear Regression Analysis*, 2nd ed., Theorem 4.1.
    pub fn growth_without(&self, functionals: &Matrix, rhs: usize) -> Result<Option<f64>, LeastSquaresError> {
        let x = self.unknowns(rhs)?;
        self.check(functionals.n_rows())?;
        for column in 0..functionals.n_columns() {
            if !self.is_estimable(functionals.column(column))? {
                return Ok(None);
            }
        }
        let mut along = dense::transposed_product(&self.root.to_matrix(), functionals);
        let spread = dense::triangle(&mut along);
        let q = functionals.n_columns();
        let sizes = (0..q).map(|column| norm(spread.column(column)));
        let is_dependent =
            sizes.enumerate().any(|(j, size)| spread[(j, j)].abs() <= DEPENDENT_FUNCTIONALS * size);
        if is_dependent {
            return Ok(None);
        }
        let mut values = dense::transposed_product(functionals, &Matrix::from_column(x.to_vec()));
        dense::solve_upper_transposed(&spread, &mut values);
        let size = norm(values.as_slice());
        Ok(Some(size * size))
    }
}

/// A functional whose part across the others is below this counts as their combination.
const DEPENDENT_FUNCTIONALS: f64 = 1e-10;
