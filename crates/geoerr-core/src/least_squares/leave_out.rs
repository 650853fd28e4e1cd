//! What the rest of the rows says about a block of them.
//!
//! ```math
//! e_b = (I - H_{bb})^{-1} r_b,\qquad H_{bb} = A_b\,(A^\mathsf{T}A)^{+} A_b^\mathsf{T} = W W^\mathsf{T},\quad W = A_b F
//! ```
//!
//! | symbol | code | meaning | shape |
//! |---|---|---|---|
//! | `$r_b$` | `residual` | residuals of the block, all rows fitted | m_b |
//! | `$e_b$` | `held_out` | residuals of the block against the fit to all other rows | m_b |
//! | `$F$` | `root` | root of the unscaled covariance | (n, rank) |
//! | `$H_{bb}$` | - | the block's part of the hat matrix, eigenvalues in 0..1 | (m_b, m_b) |
//!
//! An eigenvalue of 1 is a direction in the block's observations that the rest says nothing about. Blocks of more rows than
//! are made at once go another way to the same ([`Tall`](super::leave_out_tall)).
//!
//! # Source
//! Cook & Weisberg 1982, *Residuals and Influence in Regression*, A.2 and 3.4 (deletion of sets of rows).
//!
//! # Verified
//! `tests/least_squares/leave_out.rs`: refits without the block.

use std::ops::Range;

use rayon::prelude::*;

use super::blocks::{Blocks, Design, Spares, check_finite};
use super::definite::Definite;
use super::dense;
use super::error::LeastSquaresError;
use super::gram::CONDITION_LIMIT;
use super::leave_out_bordered::Bordered;
use super::leave_out_tall::Tall;
use super::matrix::Matrix;
use super::root::Root;
use super::solution::Solution;

/// An eigenvalue of H above 1 minus this, or minus what rounding of F may change: the rest does not determine the block.
const NOT_DETERMINED: f64 = 1e-8;

/// Eigenvalues of H are wrong by the relative error of F times about the root of its dimensions.
const ERRORS_OF_ROOT: f64 = 100.0;

/// Rows that are made and multiplied at once.
pub(super) const ROWS_AT_ONCE: usize = 512;

/// Every block against the fit to the other blocks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LeftOut {
    /// Residual of every row, all rows fitted.
    pub residual: Vec<f64>,
    /// Residual of every row against the fit without its block; NaN where the other blocks do not determine it.
    pub held_out: Vec<f64>,
    /// Whether the other blocks determine what the block would measure.
    pub is_determined: Vec<bool>,
    /// Of every block the variances of the prediction of its rows by the other blocks, for residuals of variance 1, each
    /// times the row's weight and summed: of weights of 1 the trace of `H_bb (I − H_bb)⁻¹`. NaN where it is not determined.
    pub prediction_variance: Vec<f64>,
}

impl LeftOut {
    /// Of one block about which the rest says too little.
    pub(super) fn not_determined(residual: Vec<f64>) -> Self {
        let held_out = vec![f64::NAN; residual.len()];
        Self { residual, held_out, is_determined: vec![false], prediction_variance: vec![f64::NAN] }
    }

    pub(super) fn append(&mut self, mut other: Self) {
        self.residual.append(&mut other.residual);
        self.held_out.append(&mut other.held_out);
        self.is_determined.append(&mut other.is_determined);
        self.prediction_variance.append(&mut other.prediction_variance);
    }
}

/// Leaves every block of rows out in turn, exactly and without a second fit.
///
/// `blocks` are the blocks to leave out and need not be those of the design; one right-hand side.
///
/// # Errors
/// The design's own, and [`LeastSquaresError`] for entries that are not finite, for a solution of another system, and for a
/// right-hand side that there is not.
pub fn leave_blocks_out<D: Design + ?Sized>(
    design: &D,
    solution: &Solution,
    blocks: &Blocks,
    rhs: usize,
) -> Result<LeftOut, D::Error> {
    let x = solution.unknowns(rhs)?;
    left_out(design, solution, blocks, rhs, Some(x), &vec![0; blocks.len()], None)
}

/// The same for a design whose right-hand side holds the residuals themselves, as after the last step of an iteration.
///
/// `own` gives for every block how many unknowns are its own (the pose of an instrument that measured nothing else, say):
/// as many directions in which the rest says nothing are left at their best, instead of making the block not determined.
/// `weights` (rows), 1 where there are none, are those of [`LeftOut::prediction_variance`].
///
/// # Errors
/// As [`leave_blocks_out`], and where `own` is not as long as there are blocks, or `weights` as there are rows.
pub fn leave_blocks_out_of_residuals<D: Design + ?Sized>(
    design: &D,
    solution: &Solution,
    blocks: &Blocks,
    own: &[usize],
    weights: Option<&[f64]>,
) -> Result<LeftOut, D::Error> {
    check_lengths(blocks, own, weights)?;
    left_out(design, solution, blocks, 0, None, own, weights)
}

/// The same for a solution of a bordered system ([`BorderedTriangle::solve`](super::BorderedTriangle::solve)), at a cost that
/// grows with the rows. `group` (rows) is the group of each row; rows of one stand together in every block.
///
/// # Errors
/// As [`leave_blocks_out_of_residuals`], and where the solution is none of a bordered system.
pub fn leave_bordered_blocks_out<D: Design + ?Sized>(
    design: &D,
    solution: &Solution,
    group: &[usize],
    blocks: &Blocks,
    own: &[usize],
    weights: Option<&[f64]>,
) -> Result<LeftOut, D::Error> {
    check_lengths(blocks, own, weights)?;
    check_system(design, solution, blocks, 0)?;
    let n_groups = match &solution.root {
        Root::Bordered(root) => root.groups.len(),
        Root::Whole(_) => 0,
    };
    if let Some(&found) = group.iter().find(|&&group| group >= n_groups) {
        return Err(LeastSquaresError::RowsDiffer { expected: n_groups, found }.into());
    }
    if group.len() != blocks.n_rows() {
        return Err(LeastSquaresError::RowsDiffer { expected: blocks.n_rows(), found: group.len() }.into());
    }
    let Root::Bordered(root) = &solution.root else { return Ok(LeftOut::default()) };
    Bordered { design, root, group, limit: limit_at(error_of_sums(solution)), weights }.left_out(blocks, own)
}

fn check_lengths(blocks: &Blocks, own: &[usize], weights: Option<&[f64]>) -> Result<(), LeastSquaresError> {
    let n_weights = weights.map_or(blocks.n_rows(), <[f64]>::len);
    for (expected, found) in [(blocks.len(), own.len()), (blocks.n_rows(), n_weights)] {
        if expected != found {
            return Err(LeastSquaresError::RowsDiffer { expected, found });
        }
    }
    Ok(())
}

fn check_system<D: Design + ?Sized>(
    design: &D,
    solution: &Solution,
    blocks: &Blocks,
    rhs: usize,
) -> Result<(), LeastSquaresError> {
    let n_columns = solution.scale.len();
    if design.n_columns() != n_columns {
        let (expected, found) = (n_columns, design.n_columns());
        return Err(LeastSquaresError::ColumnsDiffer { expected, found });
    }
    if design.n_rows() != blocks.n_rows() {
        let (expected, found) = (design.n_rows(), blocks.n_rows());
        return Err(LeastSquaresError::RowsDiffer { expected, found });
    }
    if rhs >= design.n_rhs() {
        return Err(LeastSquaresError::NoSuchRightHandSide { index: rhs, n_rhs: design.n_rhs() });
    }
    Ok(())
}

/// From which eigenvalue on the rest determines nothing, by the relative error of F.
fn limit_at(error: f64) -> f64 {
    1.0 - NOT_DETERMINED.max(ERRORS_OF_ROOT * error)
}

/// The relative error of sums of products of the rows with F.
fn error_of_sums(solution: &Solution) -> f64 {
    solution.root_error.max(solution.condition * solution.condition * f64::EPSILON)
}

fn left_out<D: Design + ?Sized>(
    design: &D,
    solution: &Solution,
    blocks: &Blocks,
    rhs: usize,
    x: Option<&[f64]>,
    own: &[usize],
    weights: Option<&[f64]>,
) -> Result<LeftOut, D::Error> {
    check_system(design, solution, blocks, rhs)?;
    let n_columns = solution.scale.len();
    let root = &*solution.root.to_matrix();
    let limit = limit_at(solution.root_error);
    let groups = grouped(blocks);
    let spares = Spares::default();
    let x = x.map(|x| Matrix::from_column(x.to_vec()));
    let is_well_conditioned = solution.condition < CONDITION_LIMIT;
    let tall = Tall {
        design,
        spares: &spares,
        root,
        rhs,
        x: x.as_ref(),
        limit: limit_at(error_of_sums(solution)),
        weights,
    };
    let of_group = |group: &Range<usize>| -> Result<LeftOut, D::Error> {
        let rows = blocks.rows(group.start).start..blocks.rows(group.end - 1).end;
        if is_well_conditioned && rows.len() > ROWS_AT_ONCE.max(root.n_columns()) {
            return tall.left_out(rows, own[group.start]);
        }
        spares.with_block(design, rows.clone(), |made| {
            check_finite(made, rows.start)?;
            let w = dense::leading_product(made, root);
            let residual = residuals(made, n_columns + rhs, x.as_ref());
            let mut result = LeftOut::default();
            for block in group.clone() {
                let at = blocks.rows(block).start - rows.start..blocks.rows(block).end - rows.start;
                let weights = weights.map(|weights| &weights[blocks.rows(block)]);
                result.append(of_block(&w, &residual[at.clone()], at, limit, own[block], weights)?);
            }
            Ok(result)
        })
    };
    let parts: Vec<Result<LeftOut, D::Error>> = groups.par_iter().map(of_group).collect();
    let mut result = LeftOut::default();
    for part in parts {
        result.append(part?);
    }
    Ok(result)
}

/// What unknowns leave of a column of the right-hand side; the column itself where it holds the residuals.
pub(super) fn residuals(made: &Matrix, column: usize, x: Option<&Matrix>) -> Vec<f64> {
    let b = made.column(column);
    let Some(x) = x else { return b.to_vec() };
    b.iter().zip(dense::leading_product(made, x).as_slice()).map(|(b, fitted)| b - fitted).collect()
}

/// Neighbouring blocks whose rows are made at once.
fn grouped(blocks: &Blocks) -> Vec<Range<usize>> {
    let mut groups: Vec<Range<usize>> = Vec::new();
    for block in 0..blocks.len() {
        match groups.last_mut() {
            Some(group) if blocks.rows(block).end - blocks.rows(group.start).start <= ROWS_AT_ONCE => {
                group.end = block + 1;
            }
            _ => groups.push(block..block + 1),
        }
    }
    groups
}

fn of_block(
    w: &Matrix,
    residual: &[f64],
    rows: Range<usize>,
    limit: f64,
    own: usize,
    weights: Option<&[f64]>,
) -> Result<LeftOut, LeastSquaresError> {
    let (height, rank) = (rows.len(), w.n_columns());
    let part = Matrix::from_fn(rank, height, |j, row| w[(rows.start + row, j)]);
    let right = Matrix::from_column(residual.to_vec());
    let inside = if height <= rank { dense::gram(&part) } else { dense::gram(&part.transposed()) };
    let known = match predicted(&part, &inside, &right, limit) {
        Some(known) => Some(known),
        None => by_directions(&part, &inside, &right, limit, own)?,
    };
    let Some((held_out, variances)) = known else {
        return Ok(LeftOut::not_determined(residual.to_vec()));
    };
    Ok(LeftOut {
        residual: residual.to_vec(),
        held_out,
        is_determined: vec![true],
        prediction_variance: vec![weighted_sum(&variances, weights)],
    })
}

/// The sum of some numbers, each times its weight.
pub(super) fn weighted_sum(values: &[f64], weights: Option<&[f64]>) -> f64 {
    match weights {
        Some(weights) => values.iter().zip(weights).map(|(value, weight)| value * weight).sum(),
        None => values.iter().sum(),
    }
}

/// Residuals of a block against the rest, and variances of its prediction.
type ByTheRest = (Vec<f64>, Vec<f64>);

/// What the rest predicts, where it says something about every direction of the block; `part` (rank, height) is Wᵀ,
/// `inside` the smaller of W Wᵀ and WᵀW.
///
/// `(I − W Wᵀ)⁻¹ = I + W (I − WᵀW)⁻¹ Wᵀ`: the smaller of the two is factorized.
fn predicted(part: &Matrix, inside: &Matrix, right: &Matrix, limit: f64) -> Option<ByTheRest> {
    let (rank, height) = (part.n_rows(), part.n_columns());
    let is_low = height <= rank;
    let left = Definite::complement(inside, limit)?;
    // Columns whose products with one another are what is to be added to I, or the whole where that is smaller.
    let mut spread = if is_low { Matrix::identity(height) } else { part.clone() };
    left.whiten(&mut spread);
    let more = dense::transposed_product(&spread, &dense::product(&spread, right));
    let squares = (0..height).map(|row| spread.column(row).iter().map(|value| value * value).sum::<f64>());
    Some(if is_low {
        (more.into_values(), squares.map(|square| square - 1.0).collect())
    } else {
        let held = right.as_slice().iter().zip(more.as_slice()).map(|(r, more)| r + more).collect();
        (held, squares.collect())
    })
}

/// The same by the directions of H in the block: where the rest says nothing about at most `own` of them, those are left
/// at their best. Nothing where there are more.
fn by_directions(
    part: &Matrix,
    inside: &Matrix,
    right: &Matrix,
    limit: f64,
    own: usize,
) -> Result<Option<ByTheRest>, LeastSquaresError> {
    let (rank, height) = (part.n_rows(), part.n_columns());
    // Columns of `spread` are the directions, of squared length λ; residuals have no part in those of length 1.
    let (values, vectors) = dense::symmetric_eigen(inside)?;
    let spread = if height <= rank {
        Matrix::from_fn(height, height, |row, j| vectors[(row, j)] * values[j].max(0.0).sqrt())
    } else {
        dense::transposed_product(part, &vectors)
    };
    if values.iter().filter(|&&value| value >= limit).count() > own {
        return Ok(None);
    }
    let gain = |j: usize| if values[j] < limit { 1.0 / (1.0 - values[j]) } else { 0.0 };
    let along = dense::transposed_product(&spread, right);
    let amplified = Matrix::from_fn(values.len(), 1, |j, _| along[(j, 0)] * gain(j));
    let correction = dense::product(&spread, &amplified);
    let held = right.as_slice().iter().zip(correction.as_slice()).map(|(r, correction)| r + correction);
    let variance = |row| (0..values.len()).map(|j| spread[(row, j)] * spread[(row, j)] * gain(j)).sum();
    Ok(Some((held.collect(), (0..height).map(variance).collect())))
}
