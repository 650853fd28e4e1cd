//! `AᵀA` of the whitened design, and what its rows make of matrices, from the entries that are not 0.
//!
//! A sighting sees of every function along an axis the few splines about its position, and of all frames its own: some
//! eighty entries of five hundred. They lie in runs of neighbouring columns, and the product of two runs is a small block.

use std::ops::Range;

use rayon::prelude::*;

use super::problem::Block;
use crate::arithmetic::in_wide_registers;
use crate::least_squares::{Forms, Matrix};

/// Sightings of one sum. The sums are added up in their order, whatever thread made them.
const SIGHTINGS: usize = 1024;
/// Sightings whose entries are gathered together: they fit into the cache.
const TOGETHER: usize = 64;
/// Rows and columns of a tile of a matrix: two of them fit into the nearest cache.
const TILE: usize = 32;
/// Columns that are multiplied at once; runs are filled up with zeros to whole lanes.
const LANES: usize = 4;

impl Block<'_> {
    /// `AᵀA` of the whitened design, each row multiplied by its `row_scale`.
    ///
    /// An entry that is not finite leaves a sum that is not. The bytes do not depend on the number of threads.
    pub fn gram(&self, row_scale: &[f64]) -> Matrix {
        self.gram_and_products(&all_rows(row_scale), &[], row_scale).0
    }

    /// The same of some sightings alone, and `Aᵀ b` (n) with three numbers b of each of them, where there are any.
    pub fn gram_and_products(
        &self,
        rows: &[usize],
        numbers: &[[f64; 3]],
        row_scale: &[f64],
    ) -> (Matrix, Vec<f64>) {
        let n = self.n_columns();
        let stride = n + LANES;
        let total = self.summed(rows, row_scale, n * stride + n, || {
            let mut runs = Vec::new();
            move |sum: &mut [f64], at: usize, entries: &[Entry]| {
                let (gram, products) = sum.split_at_mut(n * stride);
                set_runs(&mut runs, entries);
                in_wide_registers(
                    #[inline(always)]
                    || add_products(gram, stride, &runs),
                );
                if let Some(b) = numbers.get(at) {
                    for (column, a) in entries {
                        products[*column] += a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
                    }
                }
            }
        });
        let (gram, products) = total.split_at(n * stride);
        (with_transposed(gram, n, stride), products.to_vec())
    }

    /// Of each of the three numbers of some sightings, `a` a row of the whitened design, `aᵀx` for a direction x (n) and
    /// `aᵀ M a` for a symmetric M (n, n).
    pub fn forms_of(&self, rows: &[usize], row_scale: &[f64], direction: &[f64], matrix: &Matrix) -> Forms {
        let n = self.n_columns();
        let stride = n + LANES;
        // Lanes beyond the end of a run meet zeros, and so must be numbers.
        let mut padded = vec![0.0; n * stride];
        for (target, column) in padded.chunks_exact_mut(stride).zip(0..n) {
            target[..n].copy_from_slice(matrix.column(column));
        }
        let mut forms = Forms::default();
        let mut runs = Vec::new();
        self.each_sighting(rows, row_scale, |_, entries| {
            let mut along = [0.0; 3];
            for (column, numbers) in entries {
                for (along, number) in along.iter_mut().zip(numbers) {
                    *along += number * direction[*column];
                }
            }
            forms.along.extend(along);
            set_runs(&mut runs, entries);
            let mut squares = [0.0; 3];
            in_wide_registers(
                #[inline(always)]
                || squares = quadratic_forms(&padded, stride, &runs),
            );
            forms.squares.extend(squares);
        });
        forms
    }

    /// `AᵀA x` (n, d) and `xᵀAᵀA x` (d, d) of the whitened design for some directions x (n, d).
    pub fn along(&self, directions: &Matrix, row_scale: &[f64]) -> (Matrix, Matrix) {
        let (n, d) = (directions.n_rows(), directions.n_columns());
        let by_column = directions.transposed();
        let by_column = &by_column;
        let total = self.summed(&all_rows(row_scale), row_scale, (n + d) * d, || {
            let mut moved = [vec![0.0; d], vec![0.0; d], vec![0.0; d]];
            move |sum: &mut [f64], _, entries: &[Entry]| {
                in_wide_registers(
                    #[inline(always)]
                    || add_along(sum, &mut moved, entries, by_column),
                );
            }
        });
        let (across, squares) = total.split_at(n * d);
        (
            Matrix::from_fn(n, d, |row, column| across[row * d + column]),
            Matrix::from_fn(d, d, |row, column| squares[row * d + column]),
        )
    }

    /// Sums of so many numbers over sightings, to which what `adding` makes adds the entries of one, the `at`-th of them.
    fn summed<F: FnMut(&mut [f64], usize, &[Entry])>(
        &self,
        rows: &[usize],
        row_scale: &[f64],
        size: usize,
        adding: impl Fn() -> F + Sync,
    ) -> Vec<f64> {
        let sums: Vec<Vec<f64>> = rows
            .par_chunks(SIGHTINGS)
            .enumerate()
            .map(|(chunk, rows)| {
                let mut sum = vec![0.0; size];
                let mut add = adding();
                self.each_sighting(rows, row_scale, |at, entries| {
                    add(&mut sum, SIGHTINGS * chunk + at, entries)
                });
                sum
            })
            .collect();
        let mut total = vec![0.0; size];
        for sum in &sums {
            total.iter_mut().zip(sum).for_each(|(total, sum)| *total += sum);
        }
        total
    }

    /// Visits sightings in their order, each with its place in it and its entries that are not 0.
    fn each_sighting(&self, rows: &[usize], row_scale: &[f64], mut visit: impl FnMut(usize, &[Entry])) {
        let mut entries = Vec::new();
        for (chunk, rows) in rows.chunks(TOGETHER).enumerate() {
            entries.resize_with(rows.len(), Vec::new);
            entries.iter_mut().for_each(Vec::clear);
            self.each_entry(rows, row_scale, |column, at, numbers| {
                // Unknowns that rows share are asked of all of them.
                if *numbers != [0.0; 3] {
                    entries[at].push((column, *numbers));
                }
            });
            entries.iter().enumerate().for_each(|(at, entries)| visit(TOGETHER * chunk + at, entries));
        }
    }
}

/// `H + Hᵀ` (n, n) of a square H by rows, tile by tile: what is read across its rows stays in the cache.
fn with_transposed(half: &[f64], n: usize, stride: usize) -> Matrix {
    let mut sum = Matrix::zeros(n, n);
    for (columns, rows) in tiles(n).flat_map(|columns| tiles(n).map(move |rows| (columns.clone(), rows))) {
        for column in columns {
            let target = &mut sum.column_mut(column)[rows.clone()];
            for (value, row) in target.iter_mut().zip(rows.clone()) {
                *value = half[row * stride + column] + half[column * stride + row];
            }
        }
    }
    sum
}

fn tiles(n: usize) -> impl Iterator<Item = Range<usize>> {
    (0..n).step_by(TILE).map(move |first| first..n.min(first + TILE))
}

fn all_rows(row_scale: &[f64]) -> Vec<usize> {
    (0..row_scale.len()).collect()
}

/// A column and what a sighting's three numbers have in it.
type Entry = (usize, [f64; 3]);

/// Entries of one sighting in neighbouring columns.
#[derive(Clone, Copy)]
struct Run {
    first: usize,
    count: usize,
    /// By component; zeros beyond `count`.
    values: [[f64; LANES]; 3],
}

fn set_runs(runs: &mut Vec<Run>, entries: &[Entry]) {
    runs.clear();
    let neighbours = entries.chunk_by(|one, next| one.0 + 1 == next.0);
    for own in neighbours.flat_map(|neighbours| neighbours.chunks(LANES)) {
        let mut run = Run { first: own[0].0, count: own.len(), values: [[0.0; LANES]; 3] };
        for (lane, (_, numbers)) in own.iter().enumerate() {
            for (values, number) in run.values.iter_mut().zip(numbers) {
                values[lane] = *number;
            }
        }
        runs.push(run);
    }
}

/// Adds each product of two entries once, in whatever order their columns come, and a half of each square.
#[inline(always)]
fn add_products(sum: &mut [f64], stride: usize, runs: &[Run]) {
    for (number, one) in runs.iter().enumerate() {
        for other in &runs[..number] {
            add_block(sum, stride, one, other);
        }
        let half = Run { values: one.values.map(|values| values.map(|value| 0.5 * value)), ..*one };
        add_block(sum, stride, one, &half);
    }
}

#[inline(always)]
fn add_block(sum: &mut [f64], stride: usize, one: &Run, other: &Run) {
    let [u, v, w] = &other.values;
    for lane in 0..one.count {
        let [a, b, c] = one.values.map(|values| values[lane]);
        let row = &mut sum[(one.first + lane) * stride + other.first..][..LANES];
        for (at, target) in row.iter_mut().enumerate() {
            *target += a * u[at] + b * v[at] + c * w[at];
        }
    }
}

/// `aᵀ M a` of a sighting's three numbers, each pair of entries once.
#[inline(always)]
fn quadratic_forms(matrix: &[f64], stride: usize, runs: &[Run]) -> [f64; 3] {
    let mut squares = [0.0; 3];
    for (number, one) in runs.iter().enumerate() {
        let mut across = [0.0; 3];
        for other in &runs[..number] {
            add_form(&mut across, matrix, stride, one, other);
        }
        let mut own = [0.0; 3];
        add_form(&mut own, matrix, stride, one, one);
        for (square, (across, own)) in squares.iter_mut().zip(across.iter().zip(own)) {
            *square += 2.0 * across + own;
        }
    }
    squares
}

#[inline(always)]
fn add_form(sums: &mut [f64; 3], matrix: &[f64], stride: usize, one: &Run, other: &Run) {
    let mut moved = [[0.0; LANES]; 3];
    for lane in 0..one.count {
        let row = &matrix[(one.first + lane) * stride + other.first..][..LANES];
        for (moved, values) in moved.iter_mut().zip(&one.values) {
            for (moved, entry) in moved.iter_mut().zip(row) {
                *moved += values[lane] * entry;
            }
        }
    }
    for (sum, (moved, values)) in sums.iter_mut().zip(moved.iter().zip(&other.values)) {
        *sum += moved.iter().zip(values).map(|(moved, value)| moved * value).sum::<f64>();
    }
}

/// Adds what a sighting gives to `AᵀA x` and behind it to `xᵀAᵀA x`; `moved` is what it sees of x.
#[inline(always)]
fn add_along(sum: &mut [f64], moved: &mut [Vec<f64>; 3], entries: &[Entry], by_column: &Matrix) {
    moved.iter_mut().for_each(|moved| moved.fill(0.0));
    for &(column, numbers) in entries {
        for (moved, number) in moved.iter_mut().zip(numbers) {
            for (moved, along) in moved.iter_mut().zip(by_column.column(column)) {
                *moved += number * along;
            }
        }
    }
    let d = by_column.n_rows();
    let (across, squares) = sum.split_at_mut(by_column.n_columns() * d);
    let [u, v, w] = &*moved;
    for &(column, [a, b, c]) in entries {
        for (((sum, u), v), w) in across[column * d..][..d].iter_mut().zip(u).zip(v).zip(w) {
            *sum += a * u + b * v + c * w;
        }
    }
    for (row, squares) in squares.chunks_exact_mut(d).enumerate() {
        let [a, b, c] = [u[row], v[row], w[row]];
        for (((sum, u), v), w) in squares.iter_mut().zip(u).zip(v).zip(w) {
            *sum += a * u + b * v + c * w;
        }
    }
}
