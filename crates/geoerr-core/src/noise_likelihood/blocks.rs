//! Blocks of rows, sorted by session and time, and the covariance that they share.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::dual::Number;
use super::error::{NoiseError, length};
use super::filter::{Filter, Places};
use super::sums::Logs;
use crate::arithmetic::in_wide_registers;

/// Which block each row belongs to.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Blocks {
    of_row: Vec<usize>,
    sessions: Vec<Range<usize>>,
    pass_number: Vec<i64>,
    /// By session: of the passes of its blocks.
    places: Vec<Places>,
    time: Vec<f64>,
    /// Rows, block by block, and where each block begins.
    rows: Vec<usize>,
    first: Vec<usize>,
}

impl Blocks {
    /// `of_row`: block of each row; `session_starts`: first block of each session; `pass_number`, `time`: of each block.
    ///
    /// # Errors
    /// [`NoiseError`] for lengths that do not fit, and for blocks that are not in the order of time within their session.
    pub fn new(
        of_row: Vec<usize>,
        session_starts: &[usize],
        pass_number: Vec<i64>,
        time: Vec<f64>,
    ) -> Result<Self, NoiseError> {
        let count = time.len();
        length("passes of blocks", pass_number.len(), count)?;
        if let Some((row, &block)) = of_row.iter().enumerate().find(|&(_, &block)| block >= count) {
            return Err(NoiseError::BadBlock { row, block, count });
        }
        length("blocks before the first session", session_starts.first().copied().unwrap_or(count), 0)?;
        let ends = session_starts.iter().skip(1).copied().chain([count]);
        let sessions: Vec<Range<usize>> =
            session_starts.iter().copied().zip(ends).map(|(a, b)| a..b).collect();
        if let Some(own) = sessions.iter().find(|own| own.start > own.end) {
            return Err(NoiseError::NotInOrder { block: own.end });
        }
        for own in &sessions {
            let is_later = |&block: &usize| time[block - 1] <= time[block];
            // NaN is in no order either.
            if let Some(block) = (own.start + 1..own.end).find(|block| !is_later(block)) {
                return Err(NoiseError::NotInOrder { block });
            }
        }
        let mut first = vec![0; count + 1];
        for &block in &of_row {
            first[block + 1] += 1;
        }
        for block in 0..count {
            first[block + 1] += first[block];
        }
        let mut next = first.clone();
        let mut rows = vec![0; of_row.len()];
        for (row, &block) in of_row.iter().enumerate() {
            rows[next[block]] = row;
            next[block] += 1;
        }
        let places = sessions.iter().map(|own| Places::new(&pass_number[own.clone()])).collect();
        Ok(Self { of_row, sessions, pass_number, places, time, rows, first })
    }

    /// Number of rows.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.of_row.len()
    }

    /// Number of blocks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no block.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Blocks of each session.
    #[must_use]
    pub fn sessions(&self) -> &[Range<usize>] {
        &self.sessions
    }

    /// Pass of each block.
    pub(super) fn passes(&self) -> &[i64] {
        &self.pass_number
    }

    /// Block of each row.
    pub(super) fn of_row(&self) -> &[usize] {
        &self.of_row
    }

    /// Rows of a block.
    pub(super) fn rows(&self, block: usize) -> &[usize] {
        &self.rows[self.first[block]..self.first[block + 1]]
    }

    /// `Uᵀ` of `width` numbers of each row on one component, (n_blocks, `width`): `unit` has the entries of U, and `values`
    /// all three components of each row.
    pub(super) fn sums<T: Copy + Into<f64>>(
        &self,
        c: usize,
        unit: &[f64],
        values: &[T],
        width: usize,
    ) -> Vec<f64> {
        let mut sums = vec![0.0; self.len() * width];
        for ((&block, &weight), row) in
            self.of_row.iter().zip(unit).zip(values.chunks_exact((3 * width).max(1)))
        {
            let own = &mut sums[block * width..(block + 1) * width];
            in_wide_registers(
                #[inline(always)]
                || {
                    for (sum, &value) in own.iter_mut().zip(&row[c * width..]) {
                        *sum += weight * value.into();
                    }
                },
            );
        }
        sums
    }

    /// `I + K` of one session, factorized. `reach` is the root of the sum of squared weights of each block.
    pub(super) fn filter<N: Number>(&self, session: usize, reach: &[f64], logs: Logs) -> Option<Filter<N>> {
        let own = self.sessions[session].clone();
        Filter::new(&self.places[session], &self.time[own.clone()], &reach[own], logs)
    }
}
