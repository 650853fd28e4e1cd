//! What blocks of sightings sum up to, kept for another design of the same ones that has most columns in common.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};

use super::block::Block;
use super::gram::SumsOfSightings;
use super::problem::NUMBERS_OF_A_ROW;
use crate::least_squares::Matrix;

/// Sums of blocks, by their first rows.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct KeptSums {
    of_blocks: Mutex<BTreeMap<usize, Arc<KnownSums>>>,
}

/// `AᵀA` of some rows of a design, and the same with every row's products times its weight, where there are weights.
#[derive(Debug, Serialize, Deserialize)]
struct KnownSums {
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
    fn of(&self, rows: &Range<usize>, has_weights: bool) -> Option<Arc<KnownSums>> {
        let own = self.locked().get(&rows.start).map(Arc::clone);
        own.filter(|sums| sums.end == rows.end && sums.weighted.is_some() == has_weights)
    }

    pub(super) fn keep(&self, rows: &Range<usize>, gram: &Matrix, weighted: Option<&Matrix>) {
        let sums = KnownSums { end: rows.end, gram: gram.clone(), weighted: weighted.cloned() };
        self.locked().insert(rows.start, Arc::new(sums));
    }

    fn locked(&self) -> MutexGuard<'_, BTreeMap<usize, Arc<KnownSums>>> {
        // What another thread was about to keep when it panicked is not there.
        self.of_blocks.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Sums of another design, where each column of a design is among its own, and which ones are not.
#[derive(Debug)]
pub(super) struct Begun<'a> {
    pub known: &'a KeptSums,
    pub places: &'a [Option<usize>],
    pub columns: Vec<usize>,
}

impl Begun<'_> {
    /// As [`Block::sums_of`], of a block of rows whose sums are known of the other design.
    pub(super) fn sums_of(
        &self,
        block: &Block<'_>,
        rows: &Range<usize>,
        sightings: &[usize],
        numbers: &[[f64; NUMBERS_OF_A_ROW]],
        weights: Option<&[f64]>,
        row_scale: &[f64],
    ) -> Option<SumsOfSightings> {
        let known = self.known.of(rows, weights.is_some())?;
        let (n, d) = (block.n_columns(), self.columns.len());
        // The columns themselves, times their weights where there are any, and the numbers.
        let width = if weights.is_some() { 2 * d + 1 } else { d + 1 };
        let products = block.products_with(sightings, row_scale, width, |first, rows| {
            let own = block.entries_of(&self.columns, rows, row_scale);
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
        let whole = |known: &Matrix, made: &[f64]| begun(known, self.places, &self.columns, &made[..n * d]);
        let gram = whole(&known.gram, &products);
        let weighted = known.weighted.as_ref().map(|known| whole(known, &products[n * d..]));
        Some((gram, weighted, products[n * (width - 1)..].to_vec()))
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
