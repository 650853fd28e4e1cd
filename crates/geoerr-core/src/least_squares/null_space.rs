//! A null space written so that a person can read which unknowns mix.

use super::matrix::Matrix;

/// Of the entries that could be a pivot the first one is taken whose size is at least this part of the largest.
const PIVOT_AT_LEAST: f64 = 0.5;

/// Entries that differ by less than this part count as equally large.
const EQUAL: f64 = 1e-9;

/// The reduced echelon form of an orthonormal null space (n, d) in scaled unknowns, in the caller's units.
///
/// Each vector has an unknown of its own (its pivot, in which the others are 0), so unknowns that do not mix do not meet in a
/// vector; entries below `noise` times the vector's largest scaled one are 0; the largest entry is 1. Vectors stand in the
/// order of their pivots.
pub(super) fn readable(scaled: &Matrix, scale: &[f64], noise: f64) -> Matrix {
    let (n, d) = (scaled.n_rows(), scaled.n_columns());
    // One vector a column of `vectors`: elimination works on columns.
    let mut vectors = scaled.clone();
    let mut pivots = Vec::with_capacity(d);
    for step in 0..d {
        let Some((pivot, vector)) = find_pivot(&vectors, &pivots, step) else { break };
        swap_columns(&mut vectors, step, vector);
        pivots.push(pivot);
        let own = vectors[(pivot, step)];
        vectors.column_mut(step).iter_mut().for_each(|value| *value /= own);
        vectors[(pivot, step)] = 1.0;
        let source = vectors.column(step).to_vec();
        for other in (0..d).filter(|&other| other != step) {
            let factor = vectors[(pivot, other)];
            for (value, from) in vectors.column_mut(other).iter_mut().zip(&source) {
                *value -= factor * from;
            }
            vectors[(pivot, other)] = 0.0;
        }
    }
    let mut order: Vec<usize> = (0..pivots.len()).collect();
    order.sort_by_key(|&vector| pivots[vector]);
    let mut result = Matrix::zeros(n, pivots.len());
    for (to, &from) in order.iter().enumerate() {
        let vector = vectors.column(from);
        let cutoff = noise * largest(vector);
        let target = result.column_mut(to);
        for ((target, &value), &scale) in target.iter_mut().zip(vector).zip(scale) {
            *target = if value.abs() <= cutoff { 0.0 } else { value / scale };
        }
        let size = largest(target);
        let leader = target.iter().position(|value| value.abs() >= (1.0 - EQUAL) * size).unwrap_or(0);
        let leading = target[leader];
        target.iter_mut().for_each(|value| *value /= leading);
    }
    result
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest, value| largest.max(value.abs()))
}

/// Row of the pivot and the vector that has it, among the vectors from `step` on.
fn find_pivot(vectors: &Matrix, taken: &[usize], step: usize) -> Option<(usize, usize)> {
    let candidate = |row: usize| {
        (step..vectors.n_columns())
            .map(|vector| (vectors[(row, vector)].abs(), vector))
            .fold((0.0, step), |best, now| if now.0 > best.0 { now } else { best })
    };
    let free = || (0..vectors.n_rows()).filter(|row| !taken.contains(row));
    let size = free().map(|row| candidate(row).0).fold(0.0, f64::max);
    let row = free().find(|&row| candidate(row).0 >= PIVOT_AT_LEAST * size && size > 0.0)?;
    Some((row, candidate(row).1))
}

fn swap_columns(matrix: &mut Matrix, left: usize, right: usize) {
    if left != right {
        let n = matrix.n_rows();
        let (first, second) = (left.min(right), left.max(right));
        let (head, tail) = matrix.as_mut_slice().split_at_mut(second * n);
        head[first * n..][..n].swap_with_slice(&mut tail[..n]);
    }
}
