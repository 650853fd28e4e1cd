//! `I + K` of one component and session, factorized in the order of time at a cost that grows with its blocks alone.
//!
//! The drift keeps `e^(-Δ/τ)` of itself from one block to the next and gains the rest anew; an offset stays as it is
//! from the first block of its pass to the last. What blocks have in common is then a state of few numbers, the drift
//! and the offsets of the passes that are under way, and a Kalman filter gives what each block says beyond those
//! before it: the rows of the inverse Cholesky factor. Back in time it gives the inverse. K itself, and its derivatives
//! by ln a², ln b² and ln τ, act on columns by sums that run along the blocks.
//!
//! | symbol | code | meaning |
//! |---|---|---|
//! | `$f_i$` | `variance` | of a block given those before it, scatter 1 |
//! | `$k_i$` | `drift_gain`, `offset_gain`, `others` | what a block adds to each number of the state, per unit beyond what was foretold |
//! | `$e_i$` | `keep` | share of the drift that the next block has of it |
//!
//! # Source
//! Anderson & Moore, *Optimal Filtering* (1979), ch. 3 and 7; de Jong, *A cross-validation filter for time series models*,
//! Biometrika 75 (1988), for the inverse.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use super::dual::Number;
use super::lanes::{add_scaled, dot};
use super::sums::Logs;
use crate::arithmetic::in_wide_registers;
use crate::least_squares::Real;

/// The factorized matrix; of its determinant the derivatives where `N` has them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Filter<N = f64> {
    steps: Vec<Step>,
    n_offsets: usize,
    /// Variance of an offset and of the drift, scatter 1.
    offset2: f64,
    drift2: f64,
    /// `ln det (I + K)`.
    pub ln_determinant: N,
}

/// One block.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Step {
    /// Place of its pass's offset.
    offset: usize,
    /// Whether it is the first or the last block of its pass.
    begins: bool,
    ends: bool,
    /// What the state does to it.
    reach: f64,
    variance: f64,
    drift_gain: f64,
    offset_gain: f64,
    /// Places and gains of the offsets of other passes that are under way.
    others: Vec<(usize, f64)>,
    /// Memories until the next block, and what the drift keeps of itself; 0 after the last.
    gap: f64,
    keep: f64,
}

/// Where a state has the offsets of passes: places of those that are over are used again.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Places {
    /// By block: the place of its pass, and whether it begins and ends its pass.
    of_block: Vec<(usize, bool, bool)>,
    n_offsets: usize,
}

impl Places {
    /// Of blocks in the order of time.
    pub fn new(passes: &[i64]) -> Self {
        let last: HashMap<i64, usize> =
            passes.iter().enumerate().map(|(block, &pass)| (pass, block)).collect();
        let mut open: Vec<Option<i64>> = Vec::new();
        let mut of_block = Vec::with_capacity(passes.len());
        for (block, &pass) in passes.iter().enumerate() {
            let known = open.iter().position(|&one| one == Some(pass));
            let place = known.or_else(|| open.iter().position(Option::is_none)).unwrap_or_else(|| {
                open.push(None);
                open.len() - 1
            });
            let ends = last[&pass] == block;
            open[place] = (!ends).then_some(pass);
            of_block.push((place, known.is_none(), ends));
        }
        Self { of_block, n_offsets: open.len() }
    }
}

/// The covariance of what is not known of a state: offsets, then the drift.
struct Unknown<N> {
    values: Vec<N>,
    width: usize,
}

impl<N: Number> Unknown<N> {
    fn get(&self, i: usize, j: usize) -> N {
        self.values[i * self.width + j]
    }

    /// A number of the state that has nothing to do with the others.
    fn reset(&mut self, place: usize, variance: N) {
        for other in 0..self.width {
            self.values[place * self.width + other] = N::default();
            self.values[other * self.width + place] = N::default();
        }
        self.values[place * self.width + place] = variance;
    }

    fn learn(&mut self, shared: &[N], variance: N) {
        for (i, &first) in shared.iter().enumerate() {
            let per_variance = first / variance;
            for (j, &second) in shared.iter().enumerate() {
                let value = &mut self.values[i * self.width + j];
                *value = *value - per_variance * second;
            }
        }
    }

    fn scale(&mut self, place: usize, keep: N) {
        for other in 0..self.width {
            for at in [place * self.width + other, other * self.width + place] {
                self.values[at] = self.values[at] * keep;
            }
        }
    }
}

impl<N: Number> Filter<N> {
    /// Of blocks in the order of time, `reach` the root of the sum of squared weights of each; `None` where a variance
    /// is not finite.
    pub fn new(places: &Places, time: &[f64], reach: &[f64], logs: Logs) -> Option<Self> {
        let [offset2, drift2, memory] = [logs[1], logs[2], logs[3]].map(f64::exp);
        let of_offset = N::depending(offset2, 0, offset2);
        let of_drift = N::depending(drift2, 1, drift2);
        let n_offsets = places.n_offsets;
        let (drift, width) = (n_offsets, n_offsets + 1);
        let mut unknown = Unknown { values: vec![N::default(); width * width], width };
        unknown.reset(drift, of_drift);
        let mut ln_determinant = N::default();
        let mut steps = Vec::with_capacity(time.len());
        let mut shared = vec![N::default(); width];
        for (block, &(offset, begins, ends)) in places.of_block.iter().enumerate() {
            if begins {
                unknown.reset(offset, of_offset);
            }
            let does = N::constant(reach[block]);
            for (i, shared) in shared.iter_mut().enumerate() {
                *shared = does * (unknown.get(i, drift) + unknown.get(i, offset));
            }
            let variance = N::constant(1.0) + does * (shared[drift] + shared[offset]);
            if !variance.value().is_finite() {
                return None;
            }
            ln_determinant = ln_determinant + variance.ln();
            unknown.learn(&shared, variance);
            let gap = time.get(block + 1).map_or(f64::INFINITY, |next| (next - time[block]) / memory);
            let keep = (-gap).exp();
            let gap = if keep > 0.0 { gap } else { 0.0 };
            let kept = N::depending(keep, 2, keep * gap);
            unknown.scale(drift, kept);
            let place = drift * width + drift;
            unknown.values[place] = unknown.values[place] + of_drift * (N::constant(1.0) - kept * kept);
            if ends {
                unknown.reset(offset, N::default());
            }
            let gain = |place: usize| shared[place].value() / variance.value();
            let others = (0..n_offsets).filter(|&place| place != offset && shared[place].value() != 0.0);
            steps.push(Step {
                offset,
                begins,
                ends,
                reach: reach[block],
                variance: variance.value(),
                drift_gain: gain(drift),
                offset_gain: gain(offset),
                others: others.map(|place| (place, gain(place))).collect(),
                gap,
                keep,
            });
        }
        Some(Self { steps, n_offsets, offset2, drift2, ln_determinant })
    }

    /// `(I + K)⁻¹ B` in place: `rows` has `width` numbers of B for each block.
    pub fn solve<T: Real>(&self, rows: &mut [T], width: usize) {
        in_wide_registers(
            #[inline(always)]
            || {
                self.beyond(rows, width);
                self.back(rows, width, |variance| 1.0 / variance);
            },
        );
    }

    /// `T B` in place, T the inverse Cholesky factor in the order of time: `T (I + K) Tᵀ = I`.
    pub fn whiten<T: Real>(&self, rows: &mut [T], width: usize) {
        in_wide_registers(
            #[inline(always)]
            || {
                self.beyond(rows, width);
                for (own, step) in rows.chunks_exact_mut(width.max(1)).zip(&self.steps) {
                    let per_root = T::nearest(1.0 / step.variance.sqrt());
                    own.iter_mut().for_each(|value| *value *= per_root);
                }
            },
        );
    }

    /// `Tᵀ B` in place.
    pub fn whiten_transposed<T: Real>(&self, rows: &mut [T], width: usize) {
        in_wide_registers(
            #[inline(always)]
            || self.back(rows, width, |variance| 1.0 / variance.sqrt()),
        );
    }

    /// Adds the squares of the columns of `T B` to `squares`: as `whiten`, of which only that is wanted.
    pub fn add_squares<T: Real>(&self, rows: &[T], squares: &mut [T]) {
        in_wide_registers(
            #[inline(always)]
            || self.squares_beyond(rows, squares),
        );
    }

    #[inline(always)]
    fn squares_beyond<T: Real>(&self, rows: &[T], squares: &mut [T]) {
        let width = squares.len();
        let [mut drift, mut beyond] = [vec![T::default(); width], vec![T::default(); width]];
        let mut offsets = vec![vec![T::default(); width]; self.n_offsets];
        for (own, step) in rows.chunks_exact(width.max(1)).zip(&self.steps) {
            let offset = &mut offsets[step.offset];
            if step.begins {
                offset.fill(T::default());
            }
            let per_variance = T::nearest(1.0 / step.variance);
            let [reach, keep, drift_gain, offset_gain] = step.numbers::<T>();
            let state = drift.iter_mut().zip(offset).zip(&mut beyond);
            for ((&value, square), ((drift, offset), beyond)) in own.iter().zip(&mut *squares).zip(state) {
                *beyond = value - reach * (*drift + *offset);
                *square += per_variance * *beyond * *beyond;
                *drift = keep * (*drift + drift_gain * *beyond);
                *offset += offset_gain * *beyond;
            }
            for &(place, gain) in &step.others {
                let gain = T::nearest(gain);
                offsets[place].iter_mut().zip(&beyond).for_each(|(offset, &value)| *offset += gain * value);
            }
        }
    }

    /// `T⁻¹ B` in place: what `whiten` has taken off comes back.
    pub fn unwhiten<T: Real>(&self, rows: &mut [T], width: usize) {
        in_wide_registers(
            #[inline(always)]
            || self.foretold_again(rows, width),
        );
    }

    #[inline(always)]
    fn foretold_again<T: Real>(&self, rows: &mut [T], width: usize) {
        let mut drift = vec![T::default(); width];
        let mut offsets = vec![vec![T::default(); width]; self.n_offsets];
        for (own, step) in rows.chunks_exact_mut(width.max(1)).zip(&self.steps) {
            let root = T::nearest(step.variance.sqrt());
            own.iter_mut().for_each(|value| *value *= root);
            for &(place, gain) in &step.others {
                let gain = T::nearest(gain);
                offsets[place].iter_mut().zip(&*own).for_each(|(offset, &value)| *offset += gain * value);
            }
            let offset = &mut offsets[step.offset];
            if step.begins {
                offset.fill(T::default());
            }
            let [reach, keep, drift_gain, offset_gain] = step.numbers::<T>();
            for ((value, drift), offset) in own.iter_mut().zip(&mut drift).zip(offset) {
                let beyond = *value;
                *value += reach * (*drift + *offset);
                *drift = keep * (*drift + drift_gain * beyond);
                *offset += offset_gain * beyond;
            }
        }
    }

    /// Takes off each block's numbers what those before it foretell.
    #[inline(always)]
    fn beyond<T: Real>(&self, rows: &mut [T], width: usize) {
        let mut drift = vec![T::default(); width];
        let mut offsets = vec![vec![T::default(); width]; self.n_offsets];
        for (own, step) in rows.chunks_exact_mut(width.max(1)).zip(&self.steps) {
            let offset = &mut offsets[step.offset];
            if step.begins {
                offset.fill(T::default());
            }
            let [reach, keep, drift_gain, offset_gain] = step.numbers::<T>();
            for ((value, drift), offset) in own.iter_mut().zip(&mut drift).zip(offset) {
                *value -= reach * (*drift + *offset);
                *drift = keep * (*drift + drift_gain * *value);
                *offset += offset_gain * *value;
            }
            for &(place, gain) in &step.others {
                let gain = T::nearest(gain);
                offsets[place].iter_mut().zip(&*own).for_each(|(offset, &value)| *offset += gain * value);
            }
        }
    }

    /// The same back in time, by the transposes, of numbers scaled by what a block's variance gives.
    #[inline(always)]
    fn back<T: Real>(&self, rows: &mut [T], width: usize, scale: impl Fn(f64) -> f64) {
        let mut drift = vec![T::default(); width];
        let mut offsets = vec![vec![T::default(); width]; self.n_offsets];
        for (own, step) in rows.chunks_exact_mut(width.max(1)).zip(&self.steps).rev() {
            let scale = T::nearest(scale(step.variance));
            if step.ends {
                offsets[step.offset].fill(T::default());
            }
            own.iter_mut().for_each(|value| *value *= scale);
            for &(place, gain) in &step.others {
                let gain = T::nearest(gain);
                own.iter_mut().zip(&offsets[place]).for_each(|(value, &offset)| *value -= gain * offset);
            }
            let [reach, keep, drift_gain, offset_gain] = step.numbers::<T>();
            for ((value, drift), offset) in own.iter_mut().zip(&mut drift).zip(&mut offsets[step.offset]) {
                *drift *= keep;
                *value -= drift_gain * *drift + offset_gain * *offset;
                *drift += reach * *value;
                *offset += reach * *value;
            }
        }
    }

    /// `tr(Bᵀ ∂K B)` by ln a², ln b², ln τ: `rows` has `width` numbers of B for each block.
    pub fn slope_traces(&self, rows: &[f64], width: usize) -> [f64; 3] {
        let [mut drift, mut fading] = [vec![0.0; width], vec![0.0; width]];
        let mut offsets = vec![vec![0.0; width]; self.n_offsets];
        let [mut own_squares, mut by_offset, mut by_drift, mut by_fading] = [0.0; 4];
        for (own, step) in rows.chunks_exact(width.max(1)).zip(&self.steps) {
            let offset = &mut offsets[step.offset];
            if step.begins {
                offset.fill(0.0);
            }
            own_squares += step.reach * step.reach * dot(own, own);
            by_offset += step.reach * dot(own, offset);
            by_drift += step.reach * dot(own, &drift);
            by_fading += step.reach * dot(own, &fading);
            add_scaled(offset, step.reach, own);
            add_scaled(&mut drift, step.reach, own);
            run_on(&mut drift, &mut fading, step);
        }
        [
            self.offset2 * (own_squares + 2.0 * by_offset),
            self.drift2 * (own_squares + 2.0 * by_drift),
            self.drift2 * 2.0 * by_fading,
        ]
    }

    /// `∂K v` by ln a², ln b², ln τ.
    pub fn slopes_times(&self, v: &[f64]) -> [Vec<f64>; 3] {
        let mut result = [0, 1, 2].map(|_| vec![0.0; v.len()]);
        for (block, (v, step)) in v.iter().zip(&self.steps).enumerate() {
            result[0][block] = self.offset2 * step.reach * step.reach * v;
            result[1][block] = self.drift2 * step.reach * step.reach * v;
        }
        for is_back in [false, true] {
            let [mut drift, mut fading] = [[0.0], [0.0]];
            let mut offsets = vec![0.0; self.n_offsets];
            for at in 0..v.len() {
                let block = if is_back { v.len() - 1 - at } else { at };
                let step = &self.steps[block];
                if if is_back { step.ends } else { step.begins } {
                    offsets[step.offset] = 0.0;
                }
                if is_back {
                    run_on(&mut drift, &mut fading, step);
                }
                result[0][block] += self.offset2 * step.reach * offsets[step.offset];
                result[1][block] += self.drift2 * step.reach * drift[0];
                result[2][block] += self.drift2 * step.reach * fading[0];
                offsets[step.offset] += step.reach * v[block];
                drift[0] += step.reach * v[block];
                if !is_back {
                    run_on(&mut drift, &mut fading, step);
                }
            }
        }
        result
    }
}

impl Step {
    /// `reach`, `keep`, `drift_gain` and `offset_gain`.
    #[inline(always)]
    fn numbers<T: Real>(&self) -> [T; 4] {
        [self.reach, self.keep, self.drift_gain, self.offset_gain].map(T::nearest)
    }
}

/// Sums that fade with the drift, and the same times the memories that have passed, from one block to the next.
fn run_on(drift: &mut [f64], fading: &mut [f64], step: &Step) {
    for (drift, fading) in drift.iter_mut().zip(fading) {
        *fading = step.keep * (*fading + step.gap * *drift);
        *drift *= step.keep;
    }
}
