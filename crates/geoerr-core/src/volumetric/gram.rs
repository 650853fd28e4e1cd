//! `AᵀA` of the whitened design, and what its rows make of matrices, cell by cell.
//!
//! A sighting sees of every function along an axis the few splines about its position, and of all frames its own: some
//! ninety columns of two hundred to five hundred. Sightings of one cell (the same splines, the same frame) see the same
//! ones, so that all of them are multiplied at once as a small dense matrix over these columns.

use std::ops::Range;

use rayon::prelude::*;

use super::block::Block;
use super::problem::NUMBERS_OF_A_ROW;
use crate::least_squares::{Matrix, lower_gram, product, transposed_product};

/// Sightings of one sum, at least, and sums at most: each is a matrix. They are added up in their order, whatever thread
/// made them.
const SIGHTINGS: usize = 1024;
const SUMS: usize = 64;
/// Sightings that are multiplied together at most: their matrix fits into the cache.
const MOST_TOGETHER: usize = 64;
/// With fewer, the next cell's go along: it has most columns in common.
const LEAST_TOGETHER: usize = 16;
/// Rows and columns of a tile of a matrix: two of them fit into the nearest cache.
const TILE: usize = 32;

/// `AᵀA` of some sightings, the same with weights where there are any, and `Aᵀ b`.
pub(super) type SumsOfSightings = (Matrix, Option<Matrix>, Vec<f64>);

/// Sums of so many numbers, added up in their order, whatever thread made them.
pub(super) fn added_up(sums: &[Vec<f64>], size: usize) -> Vec<f64> {
    let mut total = vec![0.0; size];
    for sum in sums {
        total.iter_mut().zip(sum).for_each(|(total, part)| *total += part);
    }
    total
}

impl Block<'_> {
    /// `AᵀA` of the whitened design, each row multiplied by its `row_scale`.
    ///
    /// An entry that is not finite leaves a sum that is not. The bytes do not depend on the number of threads.
    pub fn gram(&self, row_scale: &[f64]) -> Matrix {
        let n = self.n_columns();
        let half = self.summed(&all_rows(row_scale), row_scale, n * n, |sum, together| {
            add_half_of_gram(sum, n, &together.columns, &together.design);
        });
        with_transposed(&half, n)
    }

    /// The same of some sightings alone, again with their products times `weights` (three a sighting) where there are
    /// any, and `Aᵀ b` (n) with three numbers b of each of them.
    pub fn sums_of(
        &self,
        rows: &[usize],
        numbers: &[[f64; 3]],
        weights: Option<&[f64]>,
        row_scale: &[f64],
    ) -> SumsOfSightings {
        let n = self.n_columns();
        let n_of_weighted = if weights.is_some() { n * n } else { 0 };
        let total = self.summed(rows, row_scale, n * n + n_of_weighted + n, |sum, together| {
            let Together { columns, places, design } = together;
            let (gram, rest) = sum.split_at_mut(n * n);
            let (weighted, products) = rest.split_at_mut(n_of_weighted);
            add_half_of_gram(gram, n, columns, design);
            if let Some(weights) = weights {
                add_half_of_gram(weighted, n, columns, &with_roots(design, places, weights));
            }
            let b = Matrix::from_column(places.iter().flat_map(|&at| numbers[at]).collect());
            let own = transposed_product(design, &b);
            columns.iter().zip(own.as_slice()).for_each(|(&column, product)| products[column] += product);
        });
        let (gram, rest) = total.split_at(n * n);
        let (weighted, products) = rest.split_at(n_of_weighted);
        let weighted = weights.map(|_| with_transposed(weighted, n));
        (with_transposed(gram, n), weighted, products.to_vec())
    }

    /// `AᵀA x` (n, d) and `xᵀAᵀA x` (d, d) of the whitened design for some directions x (n, d).
    pub fn along(&self, directions: &Matrix, row_scale: &[f64]) -> (Matrix, Matrix) {
        let (n, d) = (directions.n_rows(), directions.n_columns());
        let total = self.summed(&all_rows(row_scale), row_scale, n * d + d * d, |sum, together| {
            let Together { columns, design, .. } = together;
            let own = Matrix::from_fn(columns.len(), d, |i, j| directions[(columns[i], j)]);
            let moved = product(design, &own);
            let (across, squares) = sum.split_at_mut(n * d);
            let products = transposed_product(design, &moved);
            for (j, across) in across.chunks_exact_mut(n).enumerate() {
                for (&column, value) in columns.iter().zip(products.column(j)) {
                    across[column] += value;
                }
            }
            let own = transposed_product(&moved, &moved);
            squares.iter_mut().zip(own.as_slice()).for_each(|(sum, value)| *sum += value);
        });
        let (across, squares) = total.split_at(n * d);
        (
            Matrix::from_fn(n, d, |row, column| across[column * n + row]),
            Matrix::from_fn(d, d, |row, column| squares[column * d + row]),
        )
    }

    /// `A F` of the whitened design of some sightings for a matrix F (n, r): for each of them three rows of r numbers, one
    /// after the other.
    pub fn times(&self, matrix: &Matrix, rows: &[usize], row_scale: &[f64]) -> Vec<f64> {
        let width = matrix.n_columns();
        let mut products = vec![0.0; NUMBERS_OF_A_ROW * width * rows.len()];
        let of_chunk = |(rows, out): (&[usize], &mut [f64])| {
            self.each_together(&self.by_cell(rows), rows, row_scale, |together| {
                let Together { columns, places, design } = together;
                let own = Matrix::from_fn(columns.len(), width, |i, j| matrix[(columns[i], j)]);
                let moved = product(design, &own);
                for (number, &at) in places.iter().enumerate() {
                    for c in 0..NUMBERS_OF_A_ROW {
                        let row = &mut out[(NUMBERS_OF_A_ROW * at + c) * width..][..width];
                        for (j, value) in row.iter_mut().enumerate() {
                            *value = moved[(NUMBERS_OF_A_ROW * number + c, j)];
                        }
                    }
                }
            });
        };
        if width > 0 {
            let chunks = products.par_chunks_mut(NUMBERS_OF_A_ROW * width * SIGHTINGS);
            rows.par_chunks(SIGHTINGS).zip(chunks).for_each(of_chunk);
        }
        products
    }

    /// Sums of so many numbers over sightings, to which `add` adds what some of them together have.
    fn summed(
        &self,
        rows: &[usize],
        row_scale: &[f64],
        size: usize,
        add: impl Fn(&mut [f64], &Together) + Sync,
    ) -> Vec<f64> {
        let sums: Vec<Vec<f64>> = self
            .by_cell(rows)
            .par_chunks(SIGHTINGS.max(rows.len().div_ceil(SUMS)))
            .map(|cells| {
                let mut sum = vec![0.0; size];
                self.each_together(cells, rows, row_scale, |together| add(&mut sum, together));
                sum
            })
            .collect();
        added_up(&sums, size)
    }

    /// Visits sightings of one cell together, or of some neighbouring ones.
    fn each_together(
        &self,
        cells: &[(u64, usize)],
        rows: &[usize],
        row_scale: &[f64],
        mut visit: impl FnMut(&Together),
    ) {
        let (mut slots, mut values) = (vec![usize::MAX; self.n_columns()], Vec::new());
        for range in cuts(cells) {
            let places: Vec<usize> = cells[range].iter().map(|&(_, at)| at).collect();
            let together = self.together(places, rows, row_scale, &mut slots, values);
            visit(&together);
            values = together.design.into_values();
        }
    }

    /// The design of some sightings over the columns that they have; `slots`, where columns begin, are free, and so again.
    /// It is laid out in the memory of `values`: of one lot after the other that is the same.
    fn together(
        &self,
        places: Vec<usize>,
        rows: &[usize],
        row_scale: &[f64],
        slots: &mut [usize],
        mut values: Vec<f64>,
    ) -> Together {
        let own: Vec<usize> = places.iter().map(|&at| rows[at]).collect();
        let height = NUMBERS_OF_A_ROW * own.len();
        let mut columns = Vec::new();
        values.clear();
        self.each_run(&own, row_scale, |first, at, direction, run| {
            // Unknowns that rows share are asked of all of them.
            if *direction == [0.0; 3] {
                return;
            }
            for (column, value) in (first..).zip(run) {
                if slots[column] == usize::MAX {
                    slots[column] = values.len();
                    columns.push(column);
                    values.resize(values.len() + height, 0.0);
                }
                let entry = &mut values[slots[column] + NUMBERS_OF_A_ROW * at..][..NUMBERS_OF_A_ROW];
                entry.iter_mut().zip(direction).for_each(|(entry, along)| *entry += along * value);
            }
        });
        columns.iter().for_each(|&column| slots[column] = usize::MAX);
        let design = Matrix::from_columns(height, columns.len(), values).unwrap_or_default();
        Together { places, columns, design }
    }
}

/// Some sightings, by their places among those that were asked for, and their whitened design over the columns in which
/// some of them have an entry, in whatever order.
struct Together {
    places: Vec<usize>,
    columns: Vec<usize>,
    design: Matrix,
}

/// Where cells in their order are cut, so that many sightings of one cell, or all of few cells, are together.
fn cuts(cells: &[(u64, usize)]) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for cell in cells.chunk_by(|one, next| one.0 == next.0) {
        for part in cell.chunks(MOST_TOGETHER) {
            match ranges.last_mut() {
                Some(range) if range.len() < LEAST_TOGETHER => range.end += part.len(),
                last => {
                    let first = last.map_or(0, |range| range.end);
                    ranges.push(first..first + part.len());
                }
            }
        }
    }
    ranges
}

/// Adds to H (n, n), by columns, the lower triangle of the products over the columns that there are, and a half of their
/// squares: `H + Hᵀ` is the sum, in whatever order columns come.
fn add_half_of_gram(half: &mut [f64], n: usize, columns: &[usize], design: &Matrix) {
    let own = lower_gram(design);
    for (j, &column) in columns.iter().enumerate() {
        let target = &mut half[n * column..][..n];
        target[column] += 0.5 * own[(j, j)];
        for (&row, value) in columns.iter().zip(own.column(j)).skip(j + 1) {
            target[row] += value;
        }
    }
}

/// The design of some sightings with each of their numbers times the root of its weight.
fn with_roots(design: &Matrix, places: &[usize], weights: &[f64]) -> Matrix {
    let three = |&at: &usize| weights[NUMBERS_OF_A_ROW * at..][..NUMBERS_OF_A_ROW].iter().map(|w| w.sqrt());
    let roots: Vec<f64> = places.iter().flat_map(three).collect();
    let mut weighted = design.clone();
    for column in 0..weighted.n_columns() {
        weighted.column_mut(column).iter_mut().zip(&roots).for_each(|(value, root)| *value *= root);
    }
    weighted
}

/// `H + Hᵀ` (n, n) of a square H, tile by tile: what is read across its columns stays in the cache.
fn with_transposed(half: &[f64], n: usize) -> Matrix {
    let mut sum = Matrix::zeros(n, n);
    for (columns, rows) in tiles(n).flat_map(|columns| tiles(n).map(move |rows| (columns.clone(), rows))) {
        for column in columns {
            let target = &mut sum.column_mut(column)[rows.clone()];
            for (value, row) in target.iter_mut().zip(rows.clone()) {
                *value = half[row * n + column] + half[column * n + row];
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
