//! What the whitened design has in some rows, and its products with vectors.

use std::ops::Range;

use rayon::prelude::*;

use super::block::{Block, Place, Seen, dot};
use super::gram::added_up;
use super::problem::{BLOCK_ROWS, NUMBERS_OF_A_ROW};
use crate::least_squares::Matrix;

/// What turns displacements into numbers is a kilobyte a row; of so many rows it stays in the nearest cache from part to
/// part.
const ROWS_IN_CACHE: usize = 32;

impl Block<'_> {
    /// Writes the whitened design of some rows, column by column: three numbers a row, `3 · rows` in a column.
    /// `out` must be 0 and hold `3 · rows · n_columns` numbers. Each row is multiplied by its `row_scale`.
    pub fn fill(&self, rows: &[usize], row_scale: &[f64], out: &mut [f64]) {
        let height = NUMBERS_OF_A_ROW * rows.len();
        self.each_run(rows, row_scale, |first, at, direction, values| {
            for (k, value) in values.iter().enumerate() {
                let place = (first + k) * height + NUMBERS_OF_A_ROW * at;
                let entry = &mut out[place..place + NUMBERS_OF_A_ROW];
                entry.iter_mut().zip(direction).for_each(|(entry, along)| *entry += along * value);
            }
        });
    }

    /// The same of some columns, in the order given: `3 · rows` numbers each.
    pub fn fill_columns(&self, rows: &[usize], columns: &[usize], row_scale: &[f64], out: &mut [f64]) {
        let height = NUMBERS_OF_A_ROW * rows.len();
        let mut place = vec![None; self.n_columns()];
        columns.iter().enumerate().for_each(|(k, &column)| place[column] = Some(k));
        let is_wanted = |columns: Range<usize>| place[columns].iter().any(Option::is_some);
        self.each_run_where(rows, row_scale, is_wanted, |first, at, direction, values| {
            for (value, k) in values.iter().zip(&place[first..]) {
                if let Some(k) = k {
                    let entry = &mut out[k * height + NUMBERS_OF_A_ROW * at..][..NUMBERS_OF_A_ROW];
                    entry.iter_mut().zip(direction).for_each(|(entry, along)| *entry += along * value);
                }
            }
        });
    }

    /// `Aᵀ r` of the whitened design with whitened residuals, both multiplied by `row_scale`.
    pub fn gradient(&self, whitened: &[[f64; 3]], row_scale: &[f64]) -> Vec<f64> {
        let rows: Vec<usize> = (0..whitened.len()).collect();
        self.products_with(&rows, row_scale, 1, |_, rows| {
            rows.iter().map(|&row| whitened[row].map(|r| row_scale[row] * r)).collect()
        })
    }

    /// Columns (n, d) of `AᵀA` of the whitened design, each row multiplied by its `row_scale`: those of some unknowns.
    pub fn gram_columns(&self, columns: &[usize], row_scale: &[f64]) -> Matrix {
        let rows: Vec<usize> = (0..row_scale.len()).collect();
        let own = |_, rows: &[usize]| self.entries_of(columns, rows, row_scale);
        let products = self.products_with(&rows, row_scale, columns.len(), own);
        Matrix::from_columns(self.n_columns(), columns.len(), products).unwrap_or_default()
    }

    /// `AᵀB` (n, d), column by column, of the whitened design of some rows; `numbers` gives B of some of them, d times
    /// three numbers a row, from the place of the first one on.
    pub(super) fn products_with(
        &self,
        rows: &[usize],
        row_scale: &[f64],
        d: usize,
        numbers: impl Fn(usize, &[usize]) -> Vec<[f64; NUMBERS_OF_A_ROW]> + Sync,
    ) -> Vec<f64> {
        let sums: Vec<Vec<f64>> = rows
            .par_chunks(BLOCK_ROWS)
            .enumerate()
            .map(|(chunk, rows)| {
                self.products_of_some(rows, row_scale, d, &numbers(chunk * BLOCK_ROWS, rows))
            })
            .collect();
        added_up(&sums, self.n_columns() * d)
    }

    /// The same of rows that are made at once. Numbers are turned into the frames in which a machine moves: a part then
    /// has one product of vectors a row, and no three numbers.
    fn products_of_some(
        &self,
        rows: &[usize],
        row_scale: &[f64],
        d: usize,
        numbers: &[[f64; NUMBERS_OF_A_ROW]],
    ) -> Vec<f64> {
        let n = self.n_columns();
        let mut sum = vec![0.0; n * d];
        let mut along = Vec::new();
        for (rows, numbers) in rows.chunks(ROWS_IN_CACHE).zip(numbers.chunks((ROWS_IN_CACHE * d).max(1))) {
            let sights = self.sights(rows, row_scale);
            let seen: Vec<Seen> = (sights.iter().zip(numbers.chunks_exact(d.max(1))))
                .flat_map(|(sight, own)| own.iter().map(|own| sight.seen_by(own)))
                .collect();
            self.each_part(
                rows,
                |_| true,
                |part, runs| {
                    along.clear();
                    let place = Place::of(part.channel);
                    for (sight, own) in sights.iter().zip(seen.chunks_exact(d.max(1))) {
                        along.extend(own.iter().map(|seen| part.factor * sight.along(seen, place)));
                    }
                    runs.each(rows, |at, first, values| {
                        for (k, along) in along[at * d..][..d].iter().enumerate() {
                            add_multiple(&mut sum[k * n + first..], *along, values);
                        }
                    });
                },
            );
            self.each_entry_of_frames(rows, &sights, |column, at, entry| {
                for (k, own) in numbers[at * d..][..d].iter().enumerate() {
                    sum[k * n + column] += dot(entry, own);
                }
            });
        }
        sum
    }

    /// The largest entry of some columns (d) of the whitened design in any row, without its sign; or the first row and column
    /// whose entry is not finite.
    pub fn largest_entries(&self, columns: &[usize]) -> Result<Vec<f64>, (usize, usize)> {
        let d = columns.len();
        let rows: Vec<usize> = (0..self.problem.n_rows()).collect();
        let row_scale = vec![1.0; rows.len()];
        let of_some = |rows: &[usize]| {
            let mut largest = vec![0.0_f64; d];
            for (number, entry) in self.entries_of(columns, rows, &row_scale).iter().enumerate() {
                let (at, k) = (number / d, number % d);
                if entry.iter().any(|value| !value.is_finite()) {
                    return Err((rows[at], columns[k]));
                }
                largest[k] = entry.iter().fold(largest[k], |most, value| most.max(value.abs()));
            }
            Ok(largest)
        };
        let parts: Vec<Result<Vec<f64>, (usize, usize)>> = rows.par_chunks(BLOCK_ROWS).map(of_some).collect();
        let mut total = vec![0.0_f64; d];
        for part in parts {
            total.iter_mut().zip(part?).for_each(|(total, own)| *total = total.max(own));
        }
        Ok(total)
    }

    /// Entries of some columns (d) in some rows: three whitened numbers each, row after row.
    pub(super) fn entries_of(
        &self,
        columns: &[usize],
        rows: &[usize],
        row_scale: &[f64],
    ) -> Vec<[f64; NUMBERS_OF_A_ROW]> {
        let d = columns.len();
        let mut place = vec![None; self.n_columns()];
        columns.iter().enumerate().for_each(|(k, &column)| place[column] = Some(k));
        let mut entries = vec![[0.0; NUMBERS_OF_A_ROW]; rows.len() * d];
        let is_wanted = |columns: Range<usize>| place[columns].iter().any(Option::is_some);
        self.each_run_where(rows, row_scale, is_wanted, |first, at, direction, values| {
            for (value, k) in values.iter().zip(&place[first..]) {
                if let Some(k) = k {
                    let entry = &mut entries[at * d + k];
                    entry.iter_mut().zip(direction).for_each(|(entry, along)| *entry += along * value);
                }
            }
        });
        entries
    }

    /// How a correction of all unknowns moves the whitened numbers of some rows, to first order, each multiplied by its
    /// `row_scale`.
    pub fn first_order(&self, rows: &[usize], row_scale: &[f64], correction: &[f64]) -> Vec<[f64; 3]> {
        let of_some = |rows: &[usize]| {
            let sights = self.sights(rows, row_scale);
            let mut moved = vec![Seen::default(); rows.len()];
            self.each_part(
                rows,
                |_| true,
                |part, runs| {
                    let place = Place::of(part.channel);
                    runs.each(rows, |at, first, values| {
                        let amount: f64 =
                            values.iter().zip(&correction[first..]).map(|(value, x)| value * x).sum();
                        sights[at].add(&mut moved[at], place, part.factor * amount);
                    });
                },
            );
            let mut whitened: Vec<[f64; 3]> =
                sights.iter().zip(&moved).map(|(sight, moved)| sight.numbers_of(moved)).collect();
            self.each_entry_of_frames(rows, &sights, |column, at, entry| {
                whitened[at].iter_mut().zip(entry).for_each(|(sum, by)| *sum += by * correction[column]);
            });
            whitened
        };
        let of_many = |rows: &[usize]| rows.chunks(ROWS_IN_CACHE).flat_map(of_some).collect::<Vec<_>>();
        rows.par_chunks(BLOCK_ROWS).map(of_many).collect::<Vec<_>>().concat()
    }
}

/// Adds a multiple of values, mostly the four of a cubic spline.
#[inline]
fn add_multiple(sum: &mut [f64], by: f64, values: &[f64]) {
    if let (Some(sum), Ok(values)) = (sum.first_chunk_mut::<4>(), <&[f64; 4]>::try_from(values)) {
        for (sum, value) in sum.iter_mut().zip(values) {
            *sum += by * value;
        }
        return;
    }
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += by * value);
}
