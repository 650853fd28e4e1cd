//! Draws of noise, whitened as the fit of each one's own noise would have whitened it.
//!
//! A fit of the noise follows what its data happen to hold: where chance looks a little like a drift, a little drift is
//! found, and what that whitens holds less of it. Draws that are whitened by the noise they were drawn with hold all of
//! it; a search of noise finds less than a search of them, and p-values are too large. So the noise of every draw is
//! fitted too, at a few trial values of each component's `a²`, `b²` and τ:
//!
//! ```math
//! -2 \ln L = q + C,\qquad q = y^\mathsf{T}(I + K)^{-1} y,\quad y = \hat T^{-1} w,\qquad
//! \frac{\partial C}{\partial v} = \operatorname{tr}\bigl(P (I + v M)^{-1} M\bigr)
//!   \approx \frac{1}{v}\,\overline{w^\mathsf{T} w - w^\mathsf{T} (I + v M)^{-1} w}
//! ```
//!
//! w the sums `Uᵀ w` of a draw by block, off what the fit of the model is free to do (P), and `vM` what one of `a²` and
//! `b²` adds to the others' covariance, in its metric. The mean over the draws stands for the trace (Hutchinson 1990), and
//! so charges for the basis without a matrix of its size. Scatter is known from far more numbers, and stays.
//!
//! # Source
//! The parameters of the bootstrap are estimated anew in every draw: Davison & Hinkley, *Bootstrap Methods and their
//! Application* (1997), ch. 4. Hutchinson, *A stochastic estimator of the trace*, Commun. Stat. Simul. 19 (1990).
//!
//! # Verified
//! `tests/noise_likelihood/draws.rs`: against fits of the whole restricted likelihood to each draw.

use rayon::prelude::*;

use super::blocks::Blocks;
use super::error::{NoiseError, length};
use super::filter::Filter;
use super::fit::LONGEST_MEMORY;
use super::sums::{Logs, reach_of};
use crate::least_squares::Real;

/// What an offset or a drift adds to the variance of the mean that shows it, in units of what scatter leaves there.
const COARSE: [f64; 4] = [0.1, 0.3, 1.0, 3.0];
/// Trial values around what was found, in standard deviations of its logarithm.
const AROUND: [f64; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
/// Less than this, in the same units, is nothing; and a logarithm is known if its standard deviation is less than 1.
const NOTHING: f64 = 0.05;
const KNOWN: f64 = 1.0;
/// On the way to trial values one is at most so many times the one before.
const STEP: f64 = 3.4;
/// Memories to try besides the one that was found.
const MEMORIES: usize = 3;
/// A trace is the mean over so many draws.
const TRACE_DRAWS: usize = 40;

/// A trial value of a variance in units of scatter; values that are no trials lie on the way of an integral.
#[derive(Clone, Copy)]
struct Trial {
    value: f64,
    is_tried: bool,
}

/// What the sums of one draw make of the likelihood at their best.
#[derive(Clone, Copy)]
struct Best {
    minus_twice_ln: f64,
    logs: Logs,
}

/// One component.
struct Component<'a> {
    blocks: &'a Blocks,
    reach: Vec<f64>,
    own: Logs,
    n_draws: usize,
    /// `T⁻¹ Uᵀ w`, (n_blocks, n_draws).
    coloured: Vec<f64>,
    /// `Uᵀ w` of the draws that stand for a trace, (n_blocks, n_traced), and the mean of their squares.
    traced: Vec<f64>,
    n_traced: usize,
    traced_square: f64,
}

impl Blocks {
    /// By how much `Uᵀ w` of each draw changes when the noise is fitted to it as it was to the data.
    ///
    /// `logs`: the noise that the draws were whitened with. `shortest_memory`: as for [`super::Likelihood::fit`].
    /// `sums`: `Uᵀ w` of each component, (n_blocks, `n_draws`) row by row; so is what is given.
    ///
    /// # Errors
    /// [`NoiseError`] for lengths that do not fit, and for a covariance that is not positive definite.
    pub fn fitted_to_draws(
        &self,
        weights: &[[f64; 3]],
        logs: &[Logs; 3],
        shortest_memory: f64,
        sums: [&[f64]; 3],
        n_draws: usize,
    ) -> Result<[Vec<f64>; 3], NoiseError> {
        length("weights", weights.len(), self.n_rows())?;
        for own in sums {
            length("sums of draws", own.len(), self.len() * n_draws)?;
        }
        let of_component = |c: usize| {
            if n_draws == 0 || !weights.iter().any(|weight| weight[c] > 0.0) {
                return Some(vec![0.0; sums[c].len()]);
            }
            let whole = Component::new(self, reach_of(self, c, weights), logs[c], sums[c], n_draws)?;
            whole.changes(&whole.best(shortest_memory)?, sums[c])
        };
        let found: Vec<Option<Vec<f64>>> = (0..3).into_par_iter().map(of_component).collect();
        let mut changes: [Vec<f64>; 3] = Default::default();
        for ((component, found), change) in found.into_iter().enumerate().zip(&mut changes) {
            *change = found.ok_or(NoiseError::NotDefinite { component })?;
        }
        Ok(changes)
    }
}

impl<'a> Component<'a> {
    fn new(blocks: &'a Blocks, reach: Vec<f64>, own: Logs, sums: &[f64], n_draws: usize) -> Option<Self> {
        let n_traced = n_draws.min(TRACE_DRAWS);
        let traced: Vec<f64> =
            sums.chunks_exact(n_draws).flat_map(|block| &block[..n_traced]).copied().collect();
        let traced_square = traced.iter().map(|value| value * value).sum::<f64>() / n_traced as f64;
        let own = [0.0, own[1], own[2], own[3]];
        let mut coloured = sums.to_vec();
        filtered(blocks, &reach, own, &mut coloured, n_draws, Filter::unwhiten)?;
        Some(Self { blocks, reach, own, n_draws, coloured, traced, n_traced, traced_square })
    }

    /// Whitens `width` columns in place.
    fn whiten(&self, logs: Logs, rows: &mut [f64], width: usize) -> Option<()> {
        filtered(self.blocks, &self.reach, logs, rows, width, Filter::whiten)
    }

    /// Squares of `width` columns, whitened.
    fn whitened_squares<T: Real>(&self, logs: Logs, rows: &[T], width: usize) -> Option<Vec<T>> {
        let mut squares = vec![T::default(); width];
        for (session, own) in self.blocks.sessions().iter().enumerate() {
            let filter: Filter = self.blocks.filter(session, &self.reach, logs)?;
            filter.add_squares(&rows[own.start * width..own.end * width], &mut squares);
        }
        Some(squares)
    }

    /// The best of the trial values for each draw.
    fn best(&self, shortest_memory: f64) -> Option<Vec<Best>> {
        let offsets = self.offsets();
        let charges = self.charges_of_offsets(&offsets)?;
        let tried: Vec<(Trial, f64)> =
            offsets.into_iter().zip(charges).filter(|(trial, _)| trial.is_tried).collect();
        let found = (tried.into_par_iter())
            .map(|(offset, charge)| self.best_drifts(offset.value, charge, shortest_memory))
            .collect::<Option<Vec<_>>>()?;
        let better = |a: Best, b: Best| if b.minus_twice_ln < a.minus_twice_ln { b } else { a };
        found.into_iter().reduce(|a, b| a.into_iter().zip(b).map(|(a, b)| better(a, b)).collect())
    }

    /// C of offsets where nothing drifts.
    fn charges_of_offsets(&self, offsets: &[Trial]) -> Option<Vec<f64>> {
        let taken: Vec<f64> = (offsets.par_iter())
            .map(|offset| {
                let logs = [0.0, offset.value.ln(), f64::NEG_INFINITY, 0.0];
                let squares = self.whitened_squares(logs, &self.traced, self.n_traced)?;
                Some(self.traced_square - squares.iter().sum::<f64>() / self.n_traced as f64)
            })
            .collect::<Option<_>>()?;
        let mut charge = Charge::default();
        Some(offsets.iter().zip(taken).map(|(offset, taken)| charge.up_to(offset.value, taken)).collect())
    }

    /// The best of the drifts beside an offset.
    fn best_drifts(&self, offset2: f64, charge_of_offset: f64, shortest_memory: f64) -> Option<Vec<Best>> {
        let alone = [0.0, offset2.ln(), f64::NEG_INFINITY, 0.0];
        let mut traced = self.traced.clone();
        filtered(self.blocks, &self.reach, alone, &mut traced, self.n_traced, Filter::unwhiten)?;
        let width = self.n_draws + self.n_traced;
        // In single precision: which trial value is the best for a draw is asked thousands of times.
        let both: Vec<f32> = (self.coloured.chunks_exact(self.n_draws))
            .zip(traced.chunks_exact(self.n_traced))
            .flat_map(|(drawn, traced)| drawn.iter().chain(traced).map(|&value| value as f32))
            .collect();
        let mut best = vec![Best { minus_twice_ln: f64::INFINITY, logs: alone }; self.n_draws];
        for (number, memory) in self.memories(shortest_memory).into_iter().enumerate() {
            let mut charge = Charge { sum: charge_of_offset, ..Charge::default() };
            let drifts = self.drifts(memory, shortest_memory);
            // No drift has no memory: it is tried once.
            for drift in drifts.into_iter().filter(|drift| number == 0 || drift.value > 0.0) {
                let logs = [0.0, alone[1], drift.value.ln(), memory.ln()];
                let squares = self.whitened_squares(logs, &both, width)?;
                let left = squares[self.n_draws..].iter().copied().map(f64::from).sum::<f64>()
                    / self.n_traced as f64;
                let charge = charge.up_to(drift.value, self.traced_square - left);
                for (best, &square) in best.iter_mut().zip(&squares).filter(|_| drift.is_tried) {
                    let square = f64::from(square);
                    if charge + square < best.minus_twice_ln {
                        *best = Best { minus_twice_ln: charge + square, logs };
                    }
                }
            }
        }
        Some(best)
    }

    /// `T Uᵀ y` less `Uᵀ w` of every draw at its best.
    fn changes(&self, best: &[Best], sums: &[f64]) -> Option<Vec<f64>> {
        let mut ways: Vec<(Logs, Vec<usize>)> = Vec::new();
        for (draw, one) in best.iter().enumerate() {
            match ways.iter_mut().find(|(logs, _)| *logs == one.logs) {
                Some((_, draws)) => draws.push(draw),
                None => ways.push((one.logs, vec![draw])),
            }
        }
        let whitened = (ways.into_par_iter())
            .map(|(logs, draws)| {
                let own = self.coloured.chunks_exact(self.n_draws);
                let mut rows: Vec<f64> =
                    own.flat_map(|block| draws.iter().map(|&draw| block[draw])).collect();
                self.whiten(logs, &mut rows, draws.len())?;
                Some((draws, rows))
            })
            .collect::<Option<Vec<_>>>()?;
        let mut changes: Vec<f64> = sums.iter().map(|sum| -sum).collect();
        for (draws, rows) in whitened {
            let blocks = changes.chunks_exact_mut(self.n_draws).zip(rows.chunks_exact(draws.len()));
            for (target, row) in blocks {
                draws.iter().zip(row).for_each(|(&draw, value)| target[draw] += value);
            }
        }
        Some(changes)
    }

    fn offsets(&self) -> Vec<Trial> {
        let mut passes: Vec<i64> = self.blocks.passes().to_vec();
        passes.sort_unstable();
        passes.dedup();
        let count = passes.len().max(1) as f64;
        let reach2: f64 = self.reach.iter().map(|reach| reach * reach).sum();
        trials(self.own[1].exp(), reach2 / count, count)
    }

    fn drifts(&self, memory: f64, shortest_memory: f64) -> Vec<Trial> {
        let count = self.reach.len().max(1) as f64;
        let reach2 = self.reach.iter().map(|reach| reach * reach).sum::<f64>() / count;
        let sessions = self.blocks.sessions().len().max(1) as f64;
        let per_memory = (memory / shortest_memory).clamp(1.0, count / sessions);
        trials(self.own[2].exp(), reach2 * per_memory, (count / per_memory).max(sessions))
    }

    /// From the shortest to the longest, and the one that was found.
    fn memories(&self, shortest: f64) -> Vec<f64> {
        let (low, high) = (shortest.min(LONGEST_MEMORY).ln(), LONGEST_MEMORY.ln());
        let mut all: Vec<f64> =
            (0..MEMORIES).map(|i| low + (high - low) * i as f64 / (MEMORIES - 1) as f64).collect();
        all.push(self.own[3]);
        all.into_iter().map(f64::exp).collect()
    }
}

/// Applies the filter of each session to `width` numbers of each of its blocks, in place; `None` where there is none.
fn filtered(
    blocks: &Blocks,
    reach: &[f64],
    logs: Logs,
    rows: &mut [f64],
    width: usize,
    apply: impl Fn(&Filter, &mut [f64], usize),
) -> Option<()> {
    for (session, own) in blocks.sessions().iter().enumerate() {
        let filter: Filter = blocks.filter(session, reach, logs)?;
        apply(&filter, &mut rows[own.start * width..own.end * width], width);
    }
    Some(())
}

/// C on the way from no variance to more of it.
#[derive(Clone, Copy, Default)]
struct Charge {
    sum: f64,
    value: f64,
    taken: f64,
}

impl Charge {
    /// Goes on to a larger value, at which whitening takes off so much: by the trapezoid in its logarithm, and from 0 by a
    /// straight line.
    fn up_to(&mut self, value: f64, taken: f64) -> f64 {
        if value > 0.0 {
            self.sum +=
                if self.value > 0.0 { 0.5 * (taken + self.taken) * (value / self.value).ln() } else { taken };
        }
        (self.value, self.taken) = (value, taken);
        self.sum
    }
}

/// Trial values of a variance, from 0 on: around what was found where `count` numbers tell its size, else from nothing to
/// clearly more than `scale`, the reach squared of one of them, would hide.
fn trials(own: f64, scale: f64, count: f64) -> Vec<Trial> {
    let shows = own * scale;
    let std = (2.0 / count).sqrt() * (1.0 + 1.0 / shows.max(f64::MIN_POSITIVE));
    let is_known = shows > NOTHING && std < KNOWN;
    let mut found: Vec<Trial> = [0.0]
        .iter()
        .chain(&COARSE)
        .map(|share| Trial { value: share / scale, is_tried: !is_known })
        .collect();
    if is_known {
        found.extend(AROUND.iter().map(|way| Trial { value: own * (std * way).exp(), is_tried: true }));
    } else if shows > NOTHING {
        found.push(Trial { value: own, is_tried: true });
    }
    found.sort_by(|a, b| a.value.total_cmp(&b.value));
    // Beyond the last that is tried nothing is asked.
    let last = found.iter().rposition(|trial| trial.is_tried).unwrap_or(0);
    found.truncate(last + 1);
    // From the coarse values to those around what was found in steps of no more than the coarse ones'.
    let mut whole: Vec<Trial> = Vec::with_capacity(found.len());
    for trial in found {
        while let Some(&Trial { value: before, .. }) = whole.last()
            && before > 0.0
            && trial.value > STEP * before
        {
            whole.push(Trial { value: STEP * before, is_tried: false });
        }
        whole.push(trial);
    }
    whole
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Blocks of two sessions, passes of five blocks, and numbers that stand for white noise.
    fn scene(seed: u64, n_draws: usize) -> (Blocks, Vec<f64>, Vec<f64>) {
        let (sessions, per_session) = (2, 30);
        let count = sessions * per_session;
        let time = (0..count).map(|i| (i % per_session) as f64 / per_session as f64).collect();
        let passes = (0..count).map(|i| (i / 5) as i64).collect();
        let blocks = Blocks::new((0..count).collect(), &[0, per_session], passes, time).unwrap();
        let mut state = seed;
        let mut next = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        // Sums of twelve uniform numbers: nearly normal.
        let sums = (0..count * n_draws).map(|_| (0..12).map(|_| next()).sum::<f64>() - 6.0).collect();
        let reach = (0..count).map(|_| 2.0 + next()).collect();
        (blocks, reach, sums)
    }

    #[test]
    fn the_charge_is_the_logarithm_of_the_determinant_where_the_basis_is_empty() {
        let (blocks, reach, sums) = scene(1, TRACE_DRAWS);
        let own = [0.0, -16.0, -16.0, -1.0];
        let one = Component::new(&blocks, reach.clone(), own, &sums, TRACE_DRAWS).unwrap();
        let offsets = one.offsets();
        let ln_determinant = |logs: Logs| -> f64 {
            (0..2).map(|session| blocks.filter::<f64>(session, &reach, logs).unwrap().ln_determinant).sum()
        };
        for (offset, charge) in offsets.iter().zip(one.charges_of_offsets(&offsets).unwrap()) {
            let exact = ln_determinant([0.0, offset.value.ln(), f64::NEG_INFINITY, 0.0]);
            // A trapezoid over steps of a factor of three, and the mean over forty draws of twelve passes.
            assert!((charge - exact).abs() < 0.05 + 0.12 * exact, "{charge} for {exact}");
        }
    }

    #[test]
    fn what_is_known_is_tried_around_itself_and_what_is_not_from_nothing_on() {
        let known = trials(0.5, 20.0, 100.0);
        let tried: Vec<f64> = known.iter().filter(|one| one.is_tried).map(|one| one.value).collect();
        assert_eq!(tried.len(), AROUND.len());
        assert!(tried[0] < 0.5 && 0.5 < tried[4] && (tried[2] - 0.5).abs() < 1e-12);
        assert!(known.windows(2).all(|two| two[0].value <= two[1].value));
        let steps = known.windows(2).filter(|two| two[0].value > 0.0);
        assert!(steps.into_iter().all(|two| two[1].value <= STEP * (1.0 + 1e-12) * two[0].value));
        let unknown = trials(1e-7, 20.0, 100.0);
        assert!(unknown.iter().all(|one| one.is_tried) && unknown[0].value == 0.0);
        assert_eq!(unknown.len(), 1 + COARSE.len());
    }

    proptest! {
        #[test]
        fn what_is_whitened_comes_back(seed in any::<u64>(), a in -6.0..3.0_f64, b in -6.0..3.0_f64, t in -3.0..0.5_f64) {
            let (blocks, reach, sums) = scene(seed, 3);
            let one = Component::new(&blocks, reach, [0.0, -16.0, -16.0, 0.0], &sums, 3).unwrap();
            let mut rows = sums.clone();
            let logs = [0.0, a, b, t];
            one.whiten(logs, &mut rows, 3).unwrap();
            let squares = one.whitened_squares(logs, &sums, 3).unwrap();
            for (draw, square) in squares.iter().enumerate() {
                let whole: f64 = rows.iter().skip(draw).step_by(3).map(|value| value * value).sum();
                prop_assert!((whole - square).abs() < 1e-9 * whole);
            }
            filtered(&blocks, &one.reach, logs, &mut rows, 3, Filter::unwhiten).unwrap();
            for (back, sum) in rows.iter().zip(&sums) {
                prop_assert!((back - sum).abs() < 1e-9);
            }
        }
    }
}
