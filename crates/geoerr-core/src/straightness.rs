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
    let pieces = Pieces::new(position_mm, rule);
    let line = Line::new(position_mm);
    Ok(for_each_function(values, position_mm.len(), |functions, results| {
        run_widest(Integration { pieces: &pieces, line: &line, position_mm, functions, results });
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
    Ok(for_each_function(values, position_mm.len(), |functions, results| {
        results.copy_from_slice(functions);
        run_widest(Removal { line: &line, position_mm, results });
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

/// Functions whose sums run side by side: one sum waits for itself at every sample.
const FUNCTIONS: usize = 4;

/// Numbers that stay in the fastest cache beside what they are made of.
const MOST_IN_CACHE: usize = 1024;

/// Lanes of a sum: two of the widest registers.
const LANES: usize = 16;

/// Applies `work` to some functions at once, in order, in parallel where that pays.
fn for_each_function(
    values: &[f64],
    n_positions: usize,
    work: impl Fn(&[f64], &mut [f64]) + Sync,
) -> Vec<f64> {
    let n_group = FUNCTIONS * n_positions;
    if n_group <= MOST_IN_CACHE && (values.len() <= PARALLEL_ABOVE || rayon::current_num_threads() == 1) {
        // Made where it stays in the cache, and written once: the result's memory is not cleared before.
        let mut result = Vec::with_capacity(values.len());
        let mut group = [0.0; MOST_IN_CACHE];
        for functions in values.chunks(n_group) {
            let results = &mut group[..functions.len()];
            work(functions, results);
            result.extend_from_slice(results);
        }
        return result;
    }
    let mut result = vec![0.0; values.len()];
    values
        .par_chunks(n_group)
        .zip(result.par_chunks_mut(n_group))
        .with_min_len(PARALLEL_ABOVE.div_ceil(4 * n_group))
        .for_each(|(functions, results)| work(functions, results));
    result
}

/// Integrates functions and takes their lines off.
struct Integration<'a> {
    pieces: &'a Pieces,
    line: &'a Line,
    position_mm: &'a [f64],
    functions: &'a [f64],
    results: &'a mut [f64],
}

impl Kernel for Integration<'_> {
    type Output = ();

    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let n_positions = self.position_mm.len();
        for (function, result) in
            self.functions.chunks_exact(n_positions).zip(self.results.chunks_exact_mut(n_positions))
        {
            result[0] = 0.0;
            self.pieces.integrate::<A>(function, &mut result[1..]);
        }
        add_up(self.results, n_positions);
        for result in self.results.chunks_exact_mut(n_positions) {
            self.line.remove::<A>(self.position_mm, result);
        }
    }
}

/// Takes the lines off functions.
struct Removal<'a> {
    line: &'a Line,
    position_mm: &'a [f64],
    results: &'a mut [f64],
}

impl Kernel for Removal<'_> {
    type Output = ();

    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        for result in self.results.chunks_exact_mut(self.position_mm.len()) {
            self.line.remove::<A>(self.position_mm, result);
        }
    }
}

/// Replaces the numbers of each function by their running sums.
#[inline(always)]
fn add_up(results: &mut [f64], n_positions: usize) {
    let mut functions = results.chunks_exact_mut(n_positions);
    if let (Some(a), Some(b), Some(c), Some(d), None) =
        (functions.next(), functions.next(), functions.next(), functions.next(), functions.next())
    {
        let mut sums = [0.0; FUNCTIONS];
        for (((a, b), c), d) in a.iter_mut().zip(b).zip(c).zip(d) {
            for (sum, value) in sums.iter_mut().zip([a, b, c, d]) {
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
    /// For every interval the weights of the sample before it, of its two ends, and of the sample after it.
    Parabolas { weights_mm: [Vec<f64>; 4] },
}

impl Pieces {
    fn new(position_mm: &[f64], rule: Rule) -> Self {
        let n_intervals = position_mm.len() - 1;
        let step_mm = |interval: usize| position_mm[interval + 1] - position_mm[interval];
        if rule == Rule::Trapezoid || n_intervals == 1 {
            return Self::Trapezoids { half_mm: (0..n_intervals).map(|k| 0.5 * step_mm(k)).collect() };
        }
        let mut weights_mm = std::array::from_fn(|_| vec![0.0; n_intervals]);
        let [before, first, second, after] = &mut weights_mm;
        for k in 0..n_intervals {
            if k % 2 == 0 && k + 1 < n_intervals {
                [first[k], second[k], after[k]] = under_parabola(step_mm(k), step_mm(k + 1));
            } else {
                // The same parabola seen from the other end.
                [second[k], first[k], before[k]] = under_parabola(step_mm(k), step_mm(k - 1));
            }
        }
        Self::Parabolas { weights_mm }
    }

    /// Each interval's integral.
    #[inline(always)]
    fn integrate<A: Arithmetic>(&self, function: &[f64], integrals: &mut [f64]) {
        let n = integrals.len();
        let (starts, ends) = (&function[..n], &function[1..]);
        let weights_mm = match self {
            Self::Trapezoids { half_mm } => {
                for (((integral, half), start), end) in
                    integrals.iter_mut().zip(half_mm).zip(starts).zip(ends)
                {
                    *integral = half * (start + end);
                }
                return;
            }
            Self::Parabolas { weights_mm } => weights_mm,
        };
        let [before, first, second, after] = weights_mm.each_ref().map(|weights| &weights[..n]);
        let inner = n - 1;
        // The first interval has no sample before it, the last none after it.
        integrals[0] = A::mul_add(first[0], starts[0], two::<A>(second[0], ends[0], after[0], ends[1]));
        integrals[inner] = A::mul_add(
            before[inner],
            starts[inner - 1],
            two::<A>(first[inner], starts[inner], second[inner], ends[inner]),
        );
        let weights =
            before[1..inner].iter().zip(&first[1..inner]).zip(&second[1..inner]).zip(&after[1..inner]);
        let samples = starts[..inner - 1].iter().zip(&starts[1..inner]).zip(&ends[1..inner]).zip(&ends[2..]);
        for ((integral, (((wb, w0), w1), wa)), (((fb, f0), f1), fa)) in
            integrals[1..inner].iter_mut().zip(weights).zip(samples)
        {
            *integral = two::<A>(*w0, *f0, *w1, *f1) + two::<A>(*wb, *fb, *wa, *fa);
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
    #[inline(always)]
    fn remove<A: Arithmetic>(&self, position_mm: &[f64], values: &mut [f64]) {
        let (first_mm, first_value) = (position_mm[0], values[0]);
        let (weights, weights_rest) = self.slope_weights.as_chunks::<LANES>();
        let (chunks, values_rest) = values.as_chunks::<LANES>();
        let mut sums = [0.0; LANES];
        for (weights, values) in weights.iter().zip(chunks) {
            for lane in 0..LANES {
                sums[lane] = A::mul_add(weights[lane], values[lane] - first_value, sums[lane]);
            }
        }
        let rest: f64 =
            weights_rest.iter().zip(values_rest).map(|(w, value)| w * (value - first_value)).sum();
        let slope = sums.iter().sum::<f64>() + rest;
        if !slope.is_finite() {
            values.fill(f64::NAN);
            return;
        }
        for (value, position_mm) in values.iter_mut().zip(position_mm) {
            *value = A::mul_add(-slope, position_mm - first_mm, *value - first_value);
        }
    }
}
