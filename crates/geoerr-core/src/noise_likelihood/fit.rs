//! The maximum of the restricted likelihood.
//!
//! Steps are in what the covariance is linear in, relative to where it is: `σ²`, `σ²a²` and the drift's variance per
//! time `σ²b²/τ`; and in `ln τ`. What data say of a drift with a long memory is its variance per time, so that a step
//! in τ alone does not move it.

use super::box_step::{box_step, quadratic};
use super::error::NoiseError;
use super::slopes::{PARAMETERS, Slopes};
use super::sums::{Component, Likelihood, Logs};
use crate::least_squares::Matrix;

/// Logarithms of variance ratios beyond these are nothing, or all there is.
const LEAST_LOG: f64 = -16.0;
const MOST_LOG: f64 = 9.0;
/// A drift with a longer memory, in spans of its session, is a straight line.
pub(super) const LONGEST_MEMORY: f64 = 2.0;
/// The interval of ln τ has at least this length.
const LEAST_INTERVAL: f64 = 0.1;
/// In one step σ² falls to a fifth and rises fivefold at most, and τ changes by a factor of e: so far the model of the
/// function can be believed.
const VARIANCE_STEP: (f64, f64) = (-0.8, 4.0);
const MEMORY_STEP: f64 = 1.0;
/// Of a ratio at least this much is left by one step.
const LEAST_LEFT: f64 = 1e-7;
/// −2 ln L is found to this: a fiftieth of what chance alone gains by one parameter.
const CLOSE_ENOUGH: f64 = 0.02;
/// So many evaluations are enough, or nothing is.
const MOST_EVALUATIONS: usize = 60;
const MOST_REFUSED: usize = 8;
/// Damping, relative to the diagonal of the information.
const FIRST_DAMPING: f64 = 1e-3;
const LEAST_DAMPING: f64 = 1e-9;
const DAMPING_AFTER_REFUSAL: f64 = 0.1;
/// A step that gains less than this share of what was foretold is refused.
const LEAST_SHARE: f64 = 0.01;
/// Blocks differ by at least this share of what scatter makes of them, where a fit starts.
const LEAST_BETWEEN: f64 = 0.1;

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitted {
    /// By component; zeros for one of which nothing was measured.
    pub logs: [Logs; 3],
    /// −2 ln L, but for a constant.
    pub minus_twice_ln_likelihood: f64,
    /// Evaluations of the likelihood that it took.
    pub n_evaluations: usize,
}

impl Likelihood {
    /// Fits the parameters of all components.
    ///
    /// `shortest_memory`: drifts that forget faster, in spans of a session, are offsets of passes. The restricted
    /// likelihood charges for the basis; to compare models with different bases it must not be.
    ///
    /// # Errors
    /// [`NoiseError::NotDefinite`] where there is no likelihood at the start.
    pub fn fit(
        &self,
        start: Option<[Logs; 3]>,
        shortest_memory: f64,
        is_restricted: bool,
    ) -> Result<Fitted, NoiseError> {
        let bounds = Bounds::new(shortest_memory);
        let mut logs = start.unwrap_or_else(|| self.start(&bounds)).map(|logs| bounds.clamped(logs));
        for (component, logs) in self.components.iter().zip(&mut logs) {
            if !component.is_used() {
                *logs = [0.0; 4];
            }
        }
        let mut damping = FIRST_DAMPING;
        let mut n_evaluations = 1;
        let first = self.evaluate(&logs, is_restricted)?;
        let (mut value, mut slopes) = (first.value, first.slopes());
        'steps: while n_evaluations < MOST_EVALUATIONS {
            let model = Model::new(self, &logs, &bounds, &slopes);
            let Some((_, gain)) = model.step(LEAST_DAMPING) else { break };
            if gain < CLOSE_ENOUGH {
                break;
            }
            for _ in 0..MOST_REFUSED {
                let Some((trial, foretold)) = model.step(damping) else { break 'steps };
                if foretold < 0.1 * CLOSE_ENOUGH {
                    break 'steps;
                }
                n_evaluations += 1;
                let tried = self.evaluate(&trial, is_restricted);
                let gained = tried.as_ref().map_or(f64::NEG_INFINITY, |tried| value - tried.value);
                let share = gained / foretold;
                let Some(tried) = tried.ok().filter(|_| share > LEAST_SHARE) else {
                    damping = (10.0 * damping).max(DAMPING_AFTER_REFUSAL);
                    continue;
                };
                if share > 0.7 {
                    damping = (0.1 * damping).max(LEAST_DAMPING);
                } else if share < 0.25 {
                    damping *= 5.0;
                }
                (value, slopes) = (tried.value, tried.slopes());
                logs = trial;
                continue 'steps;
            }
            break;
        }
        Ok(Fitted { logs, minus_twice_ln_likelihood: value, n_evaluations })
    }

    /// −2 ln L, but for a constant, and its gradient by the parameters of each component.
    ///
    /// # Errors
    /// [`NoiseError::NotDefinite`].
    pub fn minus_twice_ln(
        &self,
        logs: &[Logs; 3],
        is_restricted: bool,
    ) -> Result<(f64, [Logs; 3]), NoiseError> {
        let evaluated = self.evaluate(logs, is_restricted)?;
        let slopes = evaluated.slopes();
        let mut gradient = [[0.0; 4]; 3];
        for (part, slope) in evaluated.parts.iter().zip(slopes.gradient.chunks_exact(PARAMETERS)) {
            gradient[part.component].copy_from_slice(slope);
        }
        Ok((evaluated.value, gradient))
    }

    /// Scatter within blocks, and half of what blocks differ by beyond that for offsets and drift each.
    fn start(&self, bounds: &Bounds) -> [Logs; 3] {
        let n_all: usize = self.components.iter().map(|component| component.n_numbers).sum();
        let free = (1.0 - self.n_basis as f64 / n_all.max(1) as f64).max(0.1);
        let of = |component: &Component| {
            let measured = component.reach.iter().filter(|&&reach| reach > 0.0).count();
            let count = (measured as f64).max(1.0);
            let between: f64 = component.sums.iter().map(|sum| sum * sum).sum::<f64>() / count;
            let within = component.square / component.n_numbers.saturating_sub(measured).max(1) as f64;
            // Rows that hardly scatter within blocks start at a share of what they scatter by as a whole.
            let variance = within.max(1e-6 * between).max(1e-300) / free;
            let reach2 = component.reach.iter().map(|reach| reach * reach).sum::<f64>() / count;
            let shared = (between / variance - 1.0).max(LEAST_BETWEEN) / reach2.max(1e-300);
            [variance.ln(), (0.5 * shared).ln(), (0.5 * shared).ln(), 0.5 * (bounds.low[3] + bounds.high[3])]
        };
        [0, 1, 2].map(|c| of(&self.components[c]))
    }
}

/// Bounds of the parameters of a component.
struct Bounds {
    low: Logs,
    high: Logs,
}

impl Bounds {
    fn new(shortest_memory: f64) -> Self {
        let longest = LONGEST_MEMORY.ln();
        let shortest = shortest_memory.ln().min(longest - LEAST_INTERVAL);
        Self {
            low: [f64::NEG_INFINITY, LEAST_LOG, LEAST_LOG, shortest],
            high: [f64::INFINITY, MOST_LOG, MOST_LOG, longest],
        }
    }

    fn clamped(&self, mut logs: Logs) -> Logs {
        for (i, value) in logs.iter_mut().enumerate() {
            *value = value.clamp(self.low[i], self.high[i]);
        }
        logs
    }
}

/// The likelihood as a quadratic function of a step.
struct Model<'a> {
    used: Vec<usize>,
    logs: &'a [Logs; 3],
    bounds: &'a Bounds,
    gradient: Vec<f64>,
    information: Matrix,
    low: Vec<f64>,
    high: Vec<f64>,
}

/// Derivatives of (ln σ², ln a², ln b², ln τ) by the logarithms of σ², σ²a², σ²b²/τ and τ.
const LOGS_BY_STEP: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [-1.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]];

impl<'a> Model<'a> {
    fn new(likelihood: &Likelihood, logs: &'a [Logs; 3], bounds: &'a Bounds, slopes: &Slopes) -> Self {
        let used: Vec<usize> = (0..3).filter(|&c| likelihood.components[c].is_used()).collect();
        let count = PARAMETERS * used.len();
        let by_step = Matrix::from_fn(count, count, |i, j| {
            if i / PARAMETERS == j / PARAMETERS { LOGS_BY_STEP[i % PARAMETERS][j % PARAMETERS] } else { 0.0 }
        });
        let turned = |i: usize, of: &dyn Fn(usize) -> f64| -> f64 {
            (0..count).map(|k| by_step[(k, i)] * of(k)).sum()
        };
        let gradient = (0..count).map(|i| turned(i, &|k| slopes.gradient[k])).collect();
        let information =
            Matrix::from_fn(count, count, |i, j| turned(i, &|k| turned(j, &|l| slopes.information[(k, l)])));
        let (mut low, mut high) = (Vec::new(), Vec::new());
        for &c in &used {
            let own = &logs[c];
            let down = |i: usize| bounds.low[i] - own[i];
            let up = |i: usize| bounds.high[i] - own[i];
            let ratio = |i: usize| (down(i).exp_m1().max(LEAST_LEFT - 1.0), up(i).exp_m1());
            let memory = (down(3).max(-MEMORY_STEP), up(3).min(MEMORY_STEP));
            // Where there is no drift it has no memory.
            let memory = if own[2] <= bounds.low[2] { (0.0, 0.0) } else { memory };
            for (least, most) in [VARIANCE_STEP, ratio(1), ratio(2), memory] {
                low.push(least);
                high.push(most);
            }
        }
        Self { used, logs, bounds, gradient, information, low, high }
    }

    /// Where the best step leads, and by how much −2 ln L falls on the way if the model is right.
    fn step(&self, damping: f64) -> Option<([Logs; 3], f64)> {
        let mut damped = self.information.clone();
        let count = self.gradient.len();
        let largest = (0..count).map(|i| damped[(i, i)]).fold(0.0, f64::max);
        for i in 0..count {
            damped[(i, i)] += damping * damped[(i, i)].max(1e-12 * largest);
        }
        let step = box_step(&self.gradient, &damped, &self.low, &self.high)?;
        let gain = -quadratic(&self.gradient, &self.information, &step);
        let mut logs = *self.logs;
        for (&c, step) in self.used.iter().zip(step.chunks_exact(PARAMETERS)) {
            let by = [step[0].ln_1p(), step[1].ln_1p(), step[2].ln_1p(), step[3]];
            for (log, by_step) in logs[c].iter_mut().zip(&LOGS_BY_STEP) {
                *log += by_step.iter().zip(by).map(|(factor, by)| factor * by).sum::<f64>();
            }
            logs[c] = self.bounds.clamped(logs[c]);
        }
        Some((logs, gain))
    }
}
