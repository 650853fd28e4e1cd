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
//! Of an integral the slope is known before it is taken: `$b = \sum_j s_j I_j$` of the intervals' integrals `$I_j$`, with
//! `$s_j$` the sum of the slope's weights behind interval j, and so a weighted sum of the angles. What is added up is then
//! each interval's integral less the line's share: two passes, and nothing large is taken off in the end.
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

use crate::arithmetic::{Arithmetic, Kernel, run_widest, two};

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
    /// Room for more or fewer results than there are values.
    #[error("{found} results for {needed} values")]
    OtherNumberOfResults {
        /// Number of results.
        found: usize,
        /// Number of values.
        needed: usize,
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
    let mut results = vec![0.0; values.len()];
    integrate_straightness_into(position_mm, values, rule, &mut results)?;
    Ok(results)
}

/// As [`integrate_straightness`], for whoever has memory already: as many results as values.
///
/// # Errors
/// As [`integrate_straightness`], and for another number of results, which are not touched then.
pub fn integrate_straightness_into(
    position_mm: &[f64],
    values: &[f64],
    rule: Rule,
    results: &mut [f64],
) -> Result<(), StraightnessError> {
    check(position_mm, values)?;
    check_results(values, results)?;
    let pieces = Pieces::new(position_mm, rule);
    let slope_weights = pieces.slope_weights(position_mm);
    for_each_part(values, results, position_mm.len(), |functions, results| {
        run_widest(Integration { pieces: &pieces, slope_weights: &slope_weights, functions, results });
    });
    Ok(())
}

/// Takes the least-squares line off functions of position: no slope is left, and the first value is 0.
///
/// Layout and treatment of values as in [`integrate_straightness`].
///
/// # Errors
/// As [`integrate_straightness`].
pub fn remove_line(position_mm: &[f64], values: &[f64]) -> Result<Vec<f64>, StraightnessError> {
    let mut results = vec![0.0; values.len()];
    remove_line_into(position_mm, values, &mut results)?;
    Ok(results)
}

/// As [`remove_line`], for whoever has memory already: as many results as values.
///
/// # Errors
/// As [`integrate_straightness_into`].
pub fn remove_line_into(
    position_mm: &[f64],
    values: &[f64],
    results: &mut [f64],
) -> Result<(), StraightnessError> {
    check(position_mm, values)?;
    check_results(values, results)?;
    let slope_weights = slope_weights(position_mm);
    for_each_part(values, results, position_mm.len(), |functions, results| {
        run_widest(Removal { slope_weights: &slope_weights, position_mm, functions, results });
    });
    Ok(())
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

fn check_results(values: &[f64], results: &[f64]) -> Result<(), StraightnessError> {
    if results.len() == values.len() {
        Ok(())
    } else {
        Err(StraightnessError::OtherNumberOfResults { found: results.len(), needed: values.len() })
    }
}

/// Functions whose sums run side by side: one sum waits for itself at every sample.
const FUNCTIONS: usize = 8;

/// Lanes of a sum.
const LANES: usize = 4;

/// Applies `work` to some whole functions and their results, in parallel where that pays.
fn for_each_part(
    values: &[f64],
    results: &mut [f64],
    n_positions: usize,
    work: impl Fn(&[f64], &mut [f64]) + Sync,
) {
    let n_group = FUNCTIONS * n_positions;
    if values.len() <= PARALLEL_ABOVE || rayon::current_num_threads() == 1 {
        return work(values, results);
    }
    let part = (PARALLEL_ABOVE / 4).next_multiple_of(n_group);
    values
        .par_chunks(part)
        .zip(results.par_chunks_mut(part))
        .for_each(|(functions, results)| work(functions, results));
}

/// Integrates functions and takes their lines off.
struct Integration<'a> {
    pieces: &'a Pieces,
    slope_weights: &'a [f64],
    functions: &'a [f64],
    results: &'a mut [f64],
}

impl Kernel for Integration<'_> {
    type Output = ();

    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let n_positions = self.slope_weights.len();
        let n_group = FUNCTIONS * n_positions;
        for (functions, results) in self.functions.chunks(n_group).zip(self.results.chunks_mut(n_group)) {
            for (function, result) in
                functions.chunks_exact(n_positions).zip(results.chunks_exact_mut(n_positions))
            {
                let slope = weighted_sum::<A>(self.slope_weights, function, 0.0);
                // What begins as no number stays none.
                result[0] = if slope.is_finite() { 0.0 } else { f64::NAN };
                self.pieces.integrate::<A>(function, slope, &mut result[1..]);
            }
            add_up(results, n_positions);
        }
    }
}

/// Takes the lines off functions: slope, then first value.
struct Removal<'a> {
    slope_weights: &'a [f64],
    position_mm: &'a [f64],
    functions: &'a [f64],
    results: &'a mut [f64],
}

impl Kernel for Removal<'_> {
    type Output = ();

    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let (n_positions, first_mm) = (self.position_mm.len(), self.position_mm[0]);
        for (function, result) in
            self.functions.chunks_exact(n_positions).zip(self.results.chunks_exact_mut(n_positions))
        {
            let slope = weighted_sum::<A>(self.slope_weights, function, function[0]);
            if !slope.is_finite() {
                result.fill(f64::NAN);
                continue;
            }
            for ((result, value), position_mm) in result.iter_mut().zip(function).zip(self.position_mm) {
                *result = A::mul_add(-slope, position_mm - first_mm, *value - function[0]);
            }
        }
    }
}

/// `Σ weight · (value − reference)`.
#[inline(always)]
fn weighted_sum<A: Arithmetic>(weights: &[f64], values: &[f64], reference: f64) -> f64 {
    let (weights, weights_rest) = weights.as_chunks::<LANES>();
    let (chunks, values_rest) = values.as_chunks::<LANES>();
    let mut sums = [[0.0; LANES]; 2];
    for (place, (weights, values)) in weights.iter().zip(chunks).enumerate() {
        let sums = &mut sums[place % 2];
        for lane in 0..LANES {
            sums[lane] = A::mul_add(weights[lane], values[lane] - reference, sums[lane]);
        }
    }
    let mut rest = 0.0;
    for (weight, value) in weights_rest.iter().zip(values_rest) {
        rest = A::mul_add(*weight, value - reference, rest);
    }
    let [mut sums, other] = sums;
    for lane in 0..LANES {
        sums[lane] += other[lane];
    }
    ((sums[0] + sums[2]) + (sums[1] + sums[3])) + rest
}

/// Replaces the numbers of each function by their running sums.
#[inline(always)]
fn add_up(results: &mut [f64], n_positions: usize) {
    let mut functions = results.chunks_exact_mut(n_positions);
    if functions.len() == FUNCTIONS
        && let (Some(a), Some(b), Some(c), Some(d)) =
            (functions.next(), functions.next(), functions.next(), functions.next())
        && let (Some(e), Some(f), Some(g), Some(h)) =
            (functions.next(), functions.next(), functions.next(), functions.next())
    {
        let mut sums = [0.0; FUNCTIONS];
        let first = a.iter_mut().zip(b).zip(c).zip(d);
        let second = e.iter_mut().zip(f).zip(g).zip(h);
        for ((((a, b), c), d), (((e, f), g), h)) in first.zip(second) {
            for (sum, value) in sums.iter_mut().zip([a, b, c, d, e, f, g, h]) {
                *sum += *value;
                *value = *sum;
            }
        }
        return;
    }
    for function in results.chunks_exact_mut(n_positions) {
        let mut sum = 0.0;
        for value in function {
            sum += *value;
            *value = sum;
        }
    }
}

/// Every interval's integral as a weighted sum of samples.
enum Pieces {
    /// Half the length of every interval.
    Trapezoids { half_mm: Vec<f64> },
    /// For every interval its length, and the weights of the sample before it, of its two ends, and of the sample after it.
    Parabolas { step_mm: Vec<f64>, weights_mm: [Vec<f64>; 4] },
}

impl Pieces {
    fn new(position_mm: &[f64], rule: Rule) -> Self {
        let n_intervals = position_mm.len() - 1;
        let step_mm: Vec<f64> = position_mm.windows(2).map(|pair| pair[1] - pair[0]).collect();
        if rule == Rule::Trapezoid || n_intervals == 1 {
            return Self::Trapezoids { half_mm: step_mm.iter().map(|step| 0.5 * step).collect() };
        }
        let mut weights_mm = std::array::from_fn(|_| vec![0.0; n_intervals]);
        let [before, first, second, after] = &mut weights_mm;
        for k in 0..n_intervals {
            if k % 2 == 0 && k + 1 < n_intervals {
                [first[k], second[k], after[k]] = under_parabola(step_mm[k], step_mm[k + 1]);
            } else {
                // The same parabola seen from the other end.
                [second[k], first[k], before[k]] = under_parabola(step_mm[k], step_mm[k - 1]);
            }
        }
        Self::Parabolas { step_mm, weights_mm }
    }

    /// What each sample weighs in the slope of the whole integral; see the head of this file.
    fn slope_weights(&self, position_mm: &[f64]) -> Vec<f64> {
        let n_intervals = position_mm.len() - 1;
        let mut of_interval = slope_weights(position_mm);
        // Of an interval all that lies behind it.
        for k in (0..n_intervals).rev() {
            of_interval[k] += of_interval[k + 1];
        }
        let of_interval = &of_interval[1..];
        let mut of_sample = vec![0.0; position_mm.len()];
        for (k, own) in of_interval.iter().enumerate() {
            match self {
                Self::Trapezoids { half_mm } => {
                    of_sample[k] += own * half_mm[k];
                    of_sample[k + 1] += own * half_mm[k];
                }
                Self::Parabolas { weights_mm: [before, first, second, after], .. } => {
                    of_sample[k] += own * first[k];
                    of_sample[k + 1] += own * second[k];
                    if k > 0 {
                        of_sample[k - 1] += own * before[k];
                    }
                    if k + 1 < n_intervals {
                        of_sample[k + 2] += own * after[k];
                    }
                }
            }
        }
        of_sample
    }

    /// Each interval's integral less that of a slope.
    #[inline(always)]
    fn integrate<A: Arithmetic>(&self, function: &[f64], slope: f64, integrals: &mut [f64]) {
        let n = integrals.len();
        let (starts, ends) = (&function[..n], &function[1..]);
        let (step_mm, weights_mm) = match self {
            Self::Trapezoids { half_mm } => {
                let twice = 2.0 * slope;
                for (((integral, half), start), end) in
                    integrals.iter_mut().zip(half_mm).zip(starts).zip(ends)
                {
                    *integral = half * ((start + end) - twice);
                }
                return;
            }
            Self::Parabolas { step_mm, weights_mm } => (&step_mm[..n], weights_mm),
        };
        let [before, first, second, after] = weights_mm.each_ref().map(|weights| &weights[..n]);
        let inner = n - 1;
        // The first interval has no sample before it, the last none after it.
        let own = A::mul_add(first[0], starts[0], two::<A>(second[0], ends[0], after[0], ends[1]));
        integrals[0] = A::mul_add(-slope, step_mm[0], own);
        let own = A::mul_add(
            before[inner],
            starts[inner - 1],
            two::<A>(first[inner], starts[inner], second[inner], ends[inner]),
        );
        integrals[inner] = A::mul_add(-slope, step_mm[inner], own);
        let weights =
            before[1..inner].iter().zip(&first[1..inner]).zip(&second[1..inner]).zip(&after[1..inner]);
        let samples = starts[..inner - 1].iter().zip(&starts[1..inner]).zip(&ends[1..inner]).zip(&ends[2..]);
        for (((integral, step), (((wb, w0), w1), wa)), (((fb, f0), f1), fa)) in
            integrals[1..inner].iter_mut().zip(&step_mm[1..inner]).zip(weights).zip(samples)
        {
            let outer = A::mul_add(-slope, *step, two::<A>(*wb, *fb, *wa, *fa));
            *integral = two::<A>(*w0, *f0, *w1, *f1) + outer;
        }
    }
}

/// Weights of three samples, `step` and then `next` apart, for the integral of their parabola over the first interval.
fn under_parabola(step: f64, next: f64) -> [f64; 3] {
    let both = step + next;
    let far = -step.powi(3) / (6.0 * next * both);
    let near = step * (step + 3.0 * next) / (6.0 * next);
    let first = step * (2.0 * step + 3.0 * next) / (6.0 * both);
    [first, near, far]
}

/// What each value of a piecewise-linear function weighs in the slope of its line; see the head of this file.
fn slope_weights(position_mm: &[f64]) -> Vec<f64> {
    let (first, last) = (position_mm[0], position_mm[position_mm.len() - 1]);
    let length_mm = last - first;
    let mut weights = vec![0.0; position_mm.len()];
    for (k, pair) in position_mm.windows(2).enumerate() {
        // In units of the length, and of the distance from the range's middle: no large numbers are subtracted.
        let step = (pair[1] - pair[0]) / length_mm;
        let centre = 0.5 * ((pair[0] - first) - (last - pair[1])) / length_mm;
        weights[k] += step * (6.0 * centre - step) / length_mm;
        weights[k + 1] += step * (6.0 * centre + step) / length_mm;
    }
    weights
}
