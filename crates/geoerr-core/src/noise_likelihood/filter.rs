//! `I + K` of one component and session, factorized in the order of time at a cost that grows with its blocks alone.
//!
//! The drift keeps `e^(-Δ/τ)` of itself from one block to the next and gains the rest anew; an offset stays as it is
//! from the first block of its pass to the last. What blocks have in common is then a state of few numbers, the drift
//! and the offsets of the passes that are under way, and a Kalman filter gives what each block says beyond those
//! before it: the rows of the inverse Cholesky factor. Back in time it gives the inverse.
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

use pulp::Arch;

use super::sums::Logs;
use crate::least_squares::Matrix;

/// The factorized matrix.
pub(super) struct Filter {
    steps: Vec<Step>,
    n_offsets: usize,
}

/// One block.
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
    keep: f64,
}

/// Places of the offsets of passes in a state: those of passes that are over are used again.
fn places(passes: &[i64]) -> (Vec<(usize, bool, bool)>, usize) {
    let mut open: Vec<Option<i64>> = Vec::new();
    let mut found = Vec::with_capacity(passes.len());
    for (block, &pass) in passes.iter().enumerate() {
        let known = open.iter().position(|&one| one == Some(pass));
        let place = known.or_else(|| open.iter().position(Option::is_none)).unwrap_or_else(|| {
            open.push(None);
            open.len() - 1
        });
        let ends = !passes[block + 1..].contains(&pass);
        open[place] = (!ends).then_some(pass);
        found.push((place, known.is_none(), ends));
    }
    (found, open.len())
}

impl Filter {
    /// Of blocks in the order of time, `reach` the root of the sum of squared weights of each; `None` where a variance
    /// is not finite.
    pub fn new(passes: &[i64], time: &[f64], reach: &[f64], logs: Logs) -> Option<Self> {
        let [offset2, drift2, memory] = [logs[1], logs[2], logs[3]].map(f64::exp);
        let (places, n_offsets) = places(passes);
        // The covariance of what is not known of the state: offsets, then the drift.
        let drift = n_offsets;
        let mut state = Matrix::zeros(n_offsets + 1, n_offsets + 1);
        state[(drift, drift)] = drift2;
        let mut steps = Vec::with_capacity(time.len());
        for (block, &(offset, begins, ends)) in places.iter().enumerate() {
            if begins {
                for other in 0..=drift {
                    state[(offset, other)] = 0.0;
                    state[(other, offset)] = 0.0;
                }
                state[(offset, offset)] = offset2;
            }
            let reach = reach[block];
            let shared: Vec<f64> =
                (0..=drift).map(|i| reach * (state[(i, drift)] + state[(i, offset)])).collect();
            let variance = 1.0 + reach * (shared[drift] + shared[offset]);
            if !variance.is_finite() {
                return None;
            }
            for j in 0..=drift {
                for i in 0..=drift {
                    state[(i, j)] -= shared[i] * shared[j] / variance;
                }
            }
            let keep = time.get(block + 1).map_or(0.0, |next| (-(next - time[block]) / memory).exp());
            for other in 0..=drift {
                state[(drift, other)] *= keep;
                state[(other, drift)] *= keep;
            }
            state[(drift, drift)] += drift2 * (1.0 - keep * keep);
            if ends {
                for other in 0..=drift {
                    state[(offset, other)] = 0.0;
                    state[(other, offset)] = 0.0;
                }
            }
            let gain = |place: usize| shared[place] / variance;
            let others = (0..n_offsets).filter(|&place| place != offset && shared[place] != 0.0);
            let others = others.map(|place| (place, gain(place))).collect();
            let (drift_gain, offset_gain) = (gain(drift), gain(offset));
            steps.push(Step { offset, begins, ends, reach, variance, drift_gain, offset_gain, others, keep });
        }
        Some(Self { steps, n_offsets })
    }

    /// `ln det (I + K)`.
    pub fn ln_determinant(&self) -> f64 {
        self.steps.iter().map(|step| step.variance.ln()).sum()
    }

    /// `(I + K)⁻¹ B` in place: `rows` has `width` numbers of B for each block.
    pub fn solve(&self, rows: &mut [f64], width: usize) {
        Arch::new().dispatch(
            #[inline(always)]
            || {
                self.beyond(rows, width);
                self.back(rows, width);
            },
        );
    }

    /// `T B` in place, T the inverse Cholesky factor in the order of time: `T (I + K) Tᵀ = I`.
    pub fn whiten(&self, rows: &mut [f64], width: usize) {
        Arch::new().dispatch(
            #[inline(always)]
            || {
                self.beyond(rows, width);
                for (own, step) in rows.chunks_exact_mut(width.max(1)).zip(&self.steps) {
                    let per_root = 1.0 / step.variance.sqrt();
                    own.iter_mut().for_each(|value| *value *= per_root);
                }
            },
        );
    }

    /// Takes off each block's numbers what those before it foretell.
    #[inline(always)]
    fn beyond(&self, rows: &mut [f64], width: usize) {
        let mut drift = vec![0.0; width];
        let mut offsets = vec![vec![0.0; width]; self.n_offsets];
        for (own, step) in rows.chunks_exact_mut(width.max(1)).zip(&self.steps) {
            let offset = &mut offsets[step.offset];
            if step.begins {
                offset.fill(0.0);
            }
            for ((value, drift), offset) in own.iter_mut().zip(&mut drift).zip(offset) {
                *value -= step.reach * (*drift + *offset);
                *drift = step.keep * (*drift + step.drift_gain * *value);
                *offset += step.offset_gain * *value;
            }
            for &(place, gain) in &step.others {
                offsets[place].iter_mut().zip(&*own).for_each(|(offset, value)| *offset += gain * value);
            }
        }
    }

    /// The same back in time, by the transposes.
    #[inline(always)]
    fn back(&self, rows: &mut [f64], width: usize) {
        let mut drift = vec![0.0; width];
        let mut offsets = vec![vec![0.0; width]; self.n_offsets];
        for (own, step) in rows.chunks_exact_mut(width.max(1)).zip(&self.steps).rev() {
            let per_variance = 1.0 / step.variance;
            if step.ends {
                offsets[step.offset].fill(0.0);
            }
            own.iter_mut().for_each(|value| *value *= per_variance);
            for &(place, gain) in &step.others {
                own.iter_mut().zip(&offsets[place]).for_each(|(value, offset)| *value -= gain * offset);
            }
            for ((value, drift), offset) in own.iter_mut().zip(&mut drift).zip(&mut offsets[step.offset]) {
                *drift *= step.keep;
                *value -= step.drift_gain * *drift + step.offset_gain * *offset;
                *drift += step.reach * *value;
                *offset += step.reach * *value;
            }
        }
    }
}
