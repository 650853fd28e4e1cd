//! Series that formulas are proportional to, as combinations of few columns, a block of rows at a time.
//!
//! A temperature behind lags of any length changes little within a block of rows: there dozens of series are combinations
//! `S = C E` of a few columns, and so are their sums with anything. Columns are found by elimination with complete
//! pivoting, until less than [`ACCURACY`] of its largest value is left of each series. Of noise there are at most as many
//! columns as series.
//!
//! Source: Bebendorf, Approximation of boundary element matrices, Numer. Math. 86 (2000), whose crosses these are, with
//! all that is left in view.

use std::ops::Range;

use rayon::prelude::*;

use super::lanes;
use super::sources::{Sources, number};
use crate::least_squares::Real;

/// Rows of one block.
pub(super) const ROWS: usize = 512;
/// What may be left of a series, in its largest value: hardly more than single precision rounds.
const ACCURACY: f64 = 2e-7;
/// Fewest series that are worth it.
const WORTHWHILE: usize = 8;

/// The series of all formulas that are proportional to theirs.
pub(super) struct SeriesBlocks<T> {
    /// By series: its place among those that take part.
    place_of: Vec<Option<usize>>,
    blocks: Vec<Block<T>>,
}

/// Some rows of all series.
pub(super) struct Block<T> {
    pub rows: Range<usize>,
    pub n_columns: usize,
    /// Column after column.
    pub columns: Vec<T>,
    /// Series after series: what it has of each column.
    shares: Vec<T>,
}

impl<T: Real> SeriesBlocks<T> {
    /// Finds the columns of every block; `None` where there are few series.
    pub(super) fn new(sources: &Sources<'_>) -> Option<Self> {
        let mut place_of = vec![None; sources.series.len()];
        let followed = (sources.formulas.iter())
            .filter(|formula| formula.is_multiple_of_series())
            .filter_map(|formula| formula.series);
        for [_, series] in followed {
            place_of[series] = Some(0);
        }
        let own: Vec<usize> = (0..place_of.len()).filter(|&series| place_of[series].is_some()).collect();
        if own.len() < WORTHWHILE {
            return None;
        }
        own.iter().enumerate().for_each(|(place, &series)| place_of[series] = Some(place));
        let series: Vec<&[f64]> = own.iter().map(|&series| sources.series[series]).collect();
        let sizes: Vec<f64> = (series.par_iter())
            .map(|one| {
                one.iter()
                    .filter(|value| value.is_finite())
                    .fold(0.0, |most: f64, value| most.max(value.abs()))
            })
            .collect();
        let n_rows = sources.rows.n_rows;
        let blocks = (0..n_rows.div_ceil(ROWS))
            .into_par_iter()
            .map(|block| Block::new(&series, &sizes, block * ROWS..((block + 1) * ROWS).min(n_rows)))
            .collect();
        Some(Self { place_of, blocks })
    }

    pub(super) fn blocks(&self) -> &[Block<T>] {
        &self.blocks
    }

    /// Place of a series among those that take part.
    pub(super) fn place(&self, series: usize) -> Option<usize> {
        self.place_of[series]
    }
}

impl<T: Real> Block<T> {
    fn new(series: &[&[f64]], sizes: &[f64], rows: Range<usize>) -> Self {
        let n = rows.len();
        // In double precision: what single precision rounds would be eliminated as if it were of the series.
        let mut left: Vec<f64> = Vec::with_capacity(series.len() * n);
        for one in series {
            left.extend(one[rows.clone()].iter().map(|&value| number::<f64>(value)));
        }
        // Squares of the largest numbers left, in that of the largest of all rows.
        let per_size: Vec<f64> =
            sizes.iter().map(|size| if *size > 0.0 { size.powi(-2) } else { 0.0 }).collect();
        let nothing = vec![0.0; n];
        let mut most: Vec<f64> = (left.chunks_exact_mut(n).zip(&per_size))
            .map(|(own, per_size)| lanes::take_off(own, 0.0, &nothing) * per_size)
            .collect();
        let (mut columns, mut by_column): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        let mut n_columns = 0;
        while n_columns < n.min(series.len()) {
            let largest =
                (0..most.len()).fold(0, |best, place| if most[place] > most[best] { place } else { best });
            if most[largest] <= ACCURACY.powi(2) {
                break;
            }
            let own = &left[largest * n..(largest + 1) * n];
            let at = (0..n)
                .fold(0, |best, row| if own[row] * own[row] > own[best] * own[best] { row } else { best });
            let per_pivot = 1.0 / own[at];
            columns.extend(own.iter().map(|&value| value * per_pivot));
            let column = &columns[n_columns * n..];
            for (place, own) in left.chunks_exact_mut(n).enumerate() {
                if most[place] <= ACCURACY.powi(2) {
                    by_column.push(0.0);
                    continue;
                }
                by_column.push(own[at]);
                if place == largest {
                    own.fill(0.0);
                    most[place] = 0.0;
                } else {
                    most[place] = lanes::take_off(own, own[at], column) * per_size[place];
                }
            }
            n_columns += 1;
        }
        let mut shares = Vec::new();
        lanes::transpose(&mut shares, &by_column, series.len());
        let single = |values: Vec<f64>| values.into_iter().map(T::nearest).collect();
        Self { rows, n_columns, columns: single(columns), shares: single(shares) }
    }

    /// What a series, by its place, has of each column.
    pub(super) fn shares(&self, place: usize) -> &[T] {
        &self.shares[place * self.n_columns..(place + 1) * self.n_columns]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_made_of(series: &[Vec<f64>], most_columns: usize) {
        let sizes: Vec<f64> =
            series.iter().map(|one| one.iter().fold(0.0_f64, |most, value| most.max(value.abs()))).collect();
        let n = series[0].len();
        let columns: Vec<&[f64]> = series.iter().map(Vec::as_slice).collect();
        let block: Block<f64> = Block::new(&columns, &sizes, 0..n);
        assert!(block.n_columns <= most_columns, "{} columns", block.n_columns);
        for ((place, own), size) in series.iter().enumerate().zip(sizes) {
            for (row, value) in own.iter().enumerate() {
                let columns = block.columns.iter().skip(row).step_by(n);
                let made: f64 = block.shares(place).iter().zip(columns).map(|(share, own)| share * own).sum();
                assert!((made - value).abs() <= 1.001 * ACCURACY * size, "{made} for {value}");
            }
        }
    }

    #[test]
    fn lags_are_combinations_of_few_columns() {
        let warming = |tau: f64| (0..200).map(|row| 20.0 + 30.0 * (-f64::from(row) / tau).exp()).collect();
        assert_made_of(&(1..40).map(|tau| warming(150.0 * f64::from(tau))).collect::<Vec<_>>(), 8);
    }

    #[test]
    fn noise_is_made_of_itself() {
        let mut state = 7_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let series: Vec<Vec<f64>> = (0..9).map(|_| (0..50).map(|_| next()).collect()).collect();
        assert_made_of(&series, 9);
    }

    #[test]
    fn nothing_is_made_of_nothing() {
        assert_made_of(&[vec![0.0; 5], vec![0.0; 5]], 0);
    }
}
