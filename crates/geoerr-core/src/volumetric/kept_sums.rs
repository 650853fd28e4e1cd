//! What blocks of sightings sum up to, kept for another design of the same ones that has most columns in common.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Mutex;

use super::block::Block;
use super::problem::NUMBERS_OF_A_ROW;
use crate::least_squares::Matrix;

/// Sums of blocks, by their first rows.
#[derive(Debug, Default)]
pub struct KeptSums {
    of_blocks: Mutex<BTreeMap<usize, KnownSums>>,
}

/// `AᵀA` of some rows of a design, and the same with every row's products times its weight, where there are weights.
#[derive(Debug, Clone)]
pub(super) struct KnownSums {
    end: usize,
    gram: Matrix,
    weighted: Option<Matrix>,
}

impl KeptSums {
    /// Number of columns of the design that they are of; nothing where none was kept.
    pub(super) fn n_columns(&self) -> Option<usize> {
        self.locked().values().next().map(|sums| sums.gram.n_columns())
    }

    /// Those of a block of rows, if they are with weights or without as is asked.
    pub(super) fn of(&self, rows: &Range<usize>, has_weights: bool) -> Option<KnownSums> {
        let own = self.locked().get(&rows.start).cloned();
        own.filter(|sums| sums.end == rows.end && sums.weighted.is_some() == has_weights)
    }

    pub(super) fn keep(&self, rows: &Range<usize>, gram: &Matrix, weighted: Option<&Matrix>) {
        let sums = KnownSums { end: rows.end, gram: gram.clone(), weighted: weighted.cloned() };
        self.locked().insert(rows.start, sums);
    }

    fn locked(&self) -> std::sync::MutexGuard<'_, BTreeMap<usize, KnownSums>> {
        // What another thread was about to keep when it panicked is not there.
        self.of_blocks.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl KnownSums {
    /// As [`Block::sums_of`], for a design that has these sums' columns at `places` and others beside.
    pub(super) fn beside(
        &self,
        block: &Block<'_>,
        places: &[Option<usize>],
        sightings: &[usize],
        numbers: &[[f64; NUMBERS_OF_A_ROW]],
        weights: Option<&[f64]>,
        row_scale: &[f64],
    ) -> (Matrix, Option<Matrix>, Vec<f64>) {
        let n = block.n_columns();
        let columns: Vec<usize> = (0..n).filter(|&column| places[column].is_none()).collect();
        let d = columns.len();
        // The columns themselves, times their weights where there are any, and the numbers.
        let width = if weights.is_some() { 2 * d + 1 } else { d + 1 };
        let products = block.products_with(sightings, row_scale, width, |first, rows| {
            let own = block.entries_of(&columns, rows, row_scale);
            let mut all = Vec::with_capacity(rows.len() * width);
            for at in 0..rows.len() {
                let entries = &own[at * d..][..d];
                all.extend_from_slice(entries);
                if let Some(weights) = weights {
                    let own = &weights[NUMBERS_OF_A_ROW * (first + at)..][..NUMBERS_OF_A_ROW];
                    all.extend(entries.iter().map(|entry| std::array::from_fn(|c| entry[c] * own[c])));
                }
                all.push(numbers[first + at]);
            }
            all
        });
        let gram = begun(&self.gram, places, &columns, &products[..n * d]);
        let weighted =
            self.weighted.as_ref().map(|known| begun(known, places, &columns, &products[n * d..][..n * d]));
        (gram, weighted, products[n * (width - 1)..].to_vec())
    }
}

/// A symmetric matrix (n, n) of which most is known: for each column, where the same one is in `known`; `made` are the
/// other `columns` (n, d), one after the other.
pub(super) fn begun(known: &Matrix, places: &[Option<usize>], columns: &[usize], made: &[f64]) -> Matrix {
    let n = places.len();
    let mut whole = Matrix::from_fn(n, n, |row, column| {
        places[row].zip(places[column]).map_or(0.0, |place| known[place])
    });
    for (&column, made) in columns.iter().zip(made.chunks_exact(n)) {
        for (row, &value) in made.iter().enumerate() {
            whole[(row, column)] = value;
            whole[(column, row)] = value;
        }
    }
    whole
}
