//! Straightness: an angle integrated along its own axis, and the line that is taken off every straightness.
//!
//! A table of positions and values stands for its piecewise-linear interpolant, here as everywhere in geoerr.
//!
//! # The gauge
//! Straightness has no least-squares slope over the *range* and is 0 at the first point: slope first, then the first
//! value. The line is that of the continuous interpolant, `min ∫ (f(x) − a − b x)² dx`, in closed form, not that of the
//! samples: it is the limit of an ever finer uniform grid and does not depend on where the samples lie.
//!
//! ```math
//! b = \frac{12}{L^3}\int (x-\bar x)\,f\,dx = \frac{12}{L^3}\sum_k h_k\Bigl(c_k\,\bar f_k + \tfrac{1}{12}h_k\,\Delta f_k\Bigr)
//! ```
//!
//! | symbol | code | meaning | unit |
//! |---|---|---|---|
//! | `$L$`, `$\bar x$` | `length_mm` | length and middle of the range | mm |
//! | `$h_k/L$`, `$c_k/L$` | `step`, `centre` | length of interval k; its middle minus `$\bar x$` | - |
//! | `$\bar f_k$`, `$\Delta f_k$` | `value` | mean and difference of the values at its two ends | any |
//! | `$b$` | `slope` | slope of the line | any/mm |
//!
//! Everything is linear in the values, so callers may push the columns of a covariance's root (or an identity matrix) through
//! as a batch of functions.
//!
//! # Source
//! Li et al. 2023, Eq. 19 (prints `dx` for all axes; which sign belongs to which function is the caller's matter).
//! Simpson's rule on unequal intervals: Cartwright 2017, the cumulative form that SciPy's `cumulative_simpson` has.
//!
//! # Verified
//! `tests/straightness.rs`: polynomials to the order of each rule, linearity, invariance to lines and to added samples on
//! the interpolant. `tests/geometry/test_straightness.py`: SciPy, and mpmath with 50 digits.

use rayon::prelude::*;

/// Numbers below which the calling thread does all functions itself.
const PARALLEL_ABOVE: usize = 32_768;

/// Why positions or values are refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StraightnessError {
    /// A range needs two ends.
    #[error("{found} positions: a range needs at least two")]
    TooFewPositions {
        /// Number of positions.
        found: usize,
    },
    /// A position that is not finite.
    #[error("position {index} is {position_mm}, not a finite number")]
    PositionNotFinite {
        /// Index of the position.
        index: usize,
        /// Its value.
        position_mm: f64,
    },
    /// Positions that do not rise.
    #[error("position {index} is {position_mm} mm after {previous_mm} mm: positions must rise")]
    PositionsNotRising {
        /// Index of the position that does not rise.
        index: usize,
        /// The position before it.
        previous_mm: f64,
        /// Its value.
        position_mm: f64,
    },
    /// Values that are not whole functions.
    #[error("{found} values are not a whole number of functions of {n_positions} positions")]
    NotWholeFunctions {
        /// Number of values.
        found: usize,
        /// Number of positions.
        n_positions: usize,
    },
}

/// How an integral is taken between samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Exact for piecewise-linear functions.
    Trapezoid,
    /// Each interval under the parabola through it and a neighbour; exact for parabolas on any spacing.
    ///
    /// Intervals 0, 2, 4, ... take the sample after them, the others and the last the sample before them, so that two
    /// intervals together are Simpson's rule. Two samples alone are a trapezoid.
    Simpson,
}

/// Integrates functions of position, each from the first position, and takes their lines off.
///
/// `values` holds one function after another, each with one value at every position; so does the result, whose unit is
/// that of the values times mm. A function with a value that is not finite becomes NaN, the others are unharmed.
///
/// # Errors
/// [`StraightnessError`] for positions that do not rise and values that are not whole functions.
///
/// # Examples
/// ```
/// use geoerr_core::straightness::{Rule, integrate_straightness};
/// // A constant angle is a slope, and a slope is squareness, not straightness.
/// let straightness = integrate_straightness(&[0.0, 50.0, 200.0], &[1e-5; 3], Rule::Trapezoid)?;
/// assert!(straightness.iter().all(|value| value.abs() < 1e-18));
/// # Ok::<(), geoerr_core::straightness::StraightnessError>(())
/// ```
pub fn integrate_straightness(
    position_mm: &[f64],
    values: &[f64],
    rule: Rule,
) -> Result<Vec<f64>, StraightnessError> {
    check(position_mm, values)?;
    let pieces = pieces(position_mm, rule);
    let line = Line::new(position_mm);
    Ok(for_each_function(values, position_mm.len(), |function, result| {
        let mut sum = 0.0;
        result[0] = 0.0;
        for (piece, value) in pieces.iter().zip(&mut result[1..]) {
            let [w0, w1, w2] = piece.weights;
            let [f0, f1, f2] = piece.samples.map(|index| function[index]);
            sum += w0 * f0 + w1 * f1 + w2 * f2;
            *value = sum;
        }
        line.remove(position_mm, result);
    }))
}

/// Takes the least-squares line off functions of position: no slope is left, and the first value is 0.
///
/// Layout and treatment of values as in [`integrate_straightness`].
///
/// # Errors
/// As [`integrate_straightness`].
pub fn remove_line(position_mm: &[f64], values: &[f64]) -> Result<Vec<f64>, StraightnessError> {
    check(position_mm, values)?;
    let line = Line::new(position_mm);
    Ok(for_each_function(values, position_mm.len(), |function, result| {
        result.copy_from_slice(function);
        line.remove(position_mm, result);
    }))
}

fn check(position_mm: &[f64], values: &[f64]) -> Result<(), StraightnessError> {
    let n_positions = position_mm.len();
    if n_positions < 2 {
        return Err(StraightnessError::TooFewPositions { found: n_positions });
    }
    for (index, &position_mm) in position_mm.iter().enumerate() {
        if !position_mm.is_finite() {
            return Err(StraightnessError::PositionNotFinite { index, position_mm });
        }
    }
    for (index, pair) in position_mm.windows(2).enumerate() {
        if pair[1] <= pair[0] {
            return Err(StraightnessError::PositionsNotRising {
                index: index + 1,
                previous_mm: pair[0],
                position_mm: pair[1],
            });
        }
    }
    if !values.len().is_multiple_of(n_positions) {
        return Err(StraightnessError::NotWholeFunctions { found: values.len(), n_positions });
    }
    Ok(())
}

/// Applies `work` to every function, in order, in parallel where that pays.
fn for_each_function(
    values: &[f64],
    n_positions: usize,
    work: impl Fn(&[f64], &mut [f64]) + Sync,
) -> Vec<f64> {
    let mut result = vec![0.0; values.len()];
    if values.len() <= PARALLEL_ABOVE {
        for (function, result) in values.chunks_exact(n_positions).zip(result.chunks_exact_mut(n_positions)) {
            work(function, result);
        }
    } else {
        let rows_at_once = PARALLEL_ABOVE.div_ceil(4 * n_positions);
        values
            .par_chunks_exact(n_positions)
            .zip(result.par_chunks_exact_mut(n_positions))
            .with_min_len(rows_at_once)
            .for_each(|(function, result)| work(function, result));
    }
    result
}

/// One interval's integral as a weighted sum of samples; a weight of 0 where fewer than three are used.
struct Piece {
    samples: [usize; 3],
    weights: [f64; 3],
}

fn pieces(position_mm: &[f64], rule: Rule) -> Vec<Piece> {
    let n_intervals = position_mm.len() - 1;
    let step_mm = |interval: usize| position_mm[interval + 1] - position_mm[interval];
    (0..n_intervals)
        .map(|k| match rule {
            Rule::Simpson if n_intervals > 1 => {
                let is_last = k + 1 == n_intervals;
                if k % 2 == 0 && !is_last {
                    Piece { samples: [k, k + 1, k + 2], weights: under_parabola(step_mm(k), step_mm(k + 1)) }
                } else {
                    // The same parabola seen from the other end.
                    let weights = under_parabola(step_mm(k), step_mm(k - 1));
                    Piece { samples: [k + 1, k, k - 1], weights }
                }
            }
            _ => {
                let half = 0.5 * step_mm(k);
                Piece { samples: [k, k + 1, k + 1], weights: [half, half, 0.0] }
            }
        })
        .collect()
}

/// Weights of three samples, `step` and then `next` apart, for the integral of their parabola over the first interval.
fn under_parabola(step: f64, next: f64) -> [f64; 3] {
    let both = step + next;
    let far = -step.powi(3) / (6.0 * next * both);
    let near = step * (step + 3.0 * next) / (6.0 * next);
    let first = step * (2.0 * step + 3.0 * next) / (6.0 * both);
    [first, near, far]
}

/// The least-squares line of a piecewise-linear function; see the head of this file.
struct Line {
    /// `slope = Σ weight · value`.
    slope_weights: Vec<f64>,
}

impl Line {
    fn new(position_mm: &[f64]) -> Self {
        let (first, last) = (position_mm[0], position_mm[position_mm.len() - 1]);
        let length_mm = last - first;
        let mut slope_weights = vec![0.0; position_mm.len()];
        for (k, pair) in position_mm.windows(2).enumerate() {
            // In units of the length, and of the distance from the range's middle: no large numbers are subtracted.
            let step = (pair[1] - pair[0]) / length_mm;
            let centre = 0.5 * ((pair[0] - first) - (last - pair[1])) / length_mm;
            slope_weights[k] += step * (6.0 * centre - step) / length_mm;
            slope_weights[k + 1] += step * (6.0 * centre + step) / length_mm;
        }
        Self { slope_weights }
    }

    /// Takes slope, then first value, off one function.
    fn remove(&self, position_mm: &[f64], values: &mut [f64]) {
        let (first_mm, first_value) = (position_mm[0], values[0]);
        let slope: f64 =
            self.slope_weights.iter().zip(values.iter()).map(|(w, value)| w * (value - first_value)).sum();
        if !slope.is_finite() {
            values.fill(f64::NAN);
            return;
        }
        for (value, position_mm) in values.iter_mut().zip(position_mm) {
            *value = (*value - first_value) - slope * (position_mm - first_mm);
        }
    }
}
