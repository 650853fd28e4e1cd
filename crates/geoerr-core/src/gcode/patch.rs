//! The inverse of a machine in a small box, as a polynomial.

use super::path::PathMap;
use crate::volumetric::Approach;

/// Coefficients of a quadratic in each of three variables.
const TERMS: usize = 27;

/// Places of the nodes in a box from −1 to 1, beside 0: those of Chebyshev's third polynomial.
const NODE: f64 = 0.866_025_403_784_438_6;

/// Where the polynomial is held against the machine: the extremes of Chebyshev's third polynomial, shares of the box.
const PROBES: [f64; 4] = [0.0, 0.25, 0.75, 1.0];

/// Corrections that change faster than this (mm/mm) are left to Newton's method.
const STEEPEST: f64 = 0.1;

/// Commands for the targets that lie in one box of commands, in which the machine's errors are smooth.
///
/// The correction, command less target, is a quadratic in each coordinate of the target, through 27 commands that
/// Newton's method has found.
#[derive(Debug)]
pub struct Patch {
    /// The box of commands.
    low_mm: [f64; 3],
    high_mm: [f64; 3],
    /// Middle of the box of targets, and one over half its width.
    middle_mm: [f64; 3],
    per_half_mm: [f64; 3],
    /// Of `1, u, u²` times `1, v, v²` times `1, w, w²`, the first of them running fastest. The fourth component fills
    /// a vector register.
    terms: [[f64; 4]; TERMS],
    /// Derivative of the correction in the middle, row by component.
    pub slopes: [[f64; 3]; 3],
    /// Bound of the second derivative of the correction along any line, 1/mm.
    pub bend_per_mm: f64,
    /// Largest distance of a target from the middle.
    pub radius_mm: f64,
}

impl Patch {
    /// The patch of a box of commands; None where it would leave more than `tolerance_mm`.
    pub fn new(map: &impl PathMap, low_mm: [f64; 3], high_mm: [f64; 3], tolerance_mm: f64) -> Option<Self> {
        let still = Approach::default();
        let inside = |share: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|axis| low_mm[axis] + share[axis] * (high_mm[axis] - low_mm[axis]))
        };
        let (mut least_mm, mut most_mm) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for corner in places([0.0, 1.0]) {
            let target_mm = map.actual(&inside(corner), &still);
            for axis in 0..3 {
                least_mm[axis] = least_mm[axis].min(target_mm[axis]);
                most_mm[axis] = most_mm[axis].max(target_mm[axis]);
            }
        }
        let middle_mm: [f64; 3] = std::array::from_fn(|axis| 0.5 * (least_mm[axis] + most_mm[axis]));
        let half_mm: [f64; 3] = std::array::from_fn(|axis| 0.5 * (most_mm[axis] - least_mm[axis]));
        let mut terms = [[0.0; 4]; TERMS];
        for (term, node) in terms.iter_mut().zip(places([-NODE, 0.0, NODE])) {
            let target_mm: [f64; 3] =
                std::array::from_fn(|axis| middle_mm[axis] + node[axis] * half_mm[axis]);
            let command_mm = map.command_for(&target_mm, &still, 1e-3 * tolerance_mm).ok()?;
            if !is_between(&command_mm, &low_mm, &high_mm) {
                return None;
            }
            for axis in 0..3 {
                term[axis] = command_mm[axis] - target_mm[axis];
            }
        }
        for stride in [1, 3, 9] {
            interpolate(&mut terms, stride);
        }
        let per_half_mm = half_mm.map(|half| 1.0 / half);
        let radius_mm = half_mm.iter().map(|half| half * half).sum::<f64>().sqrt();
        let slopes = slopes(&terms, &per_half_mm);
        let bend_per_mm = bend(&terms, &per_half_mm);
        let patch = Self { low_mm, high_mm, middle_mm, per_half_mm, terms, slopes, bend_per_mm, radius_mm };
        let is_steep = steepest(&terms, &per_half_mm) > STEEPEST;
        let misses = places(PROBES).any(|share| {
            let command_mm = inside(share);
            let found_mm = patch.command_for(&map.actual(&command_mm, &still));
            let off = (0..3).map(|axis| (found_mm[axis] - command_mm[axis]).powi(2)).sum::<f64>();
            // Not a number is a miss.
            !(off <= tolerance_mm * tolerance_mm)
        });
        (!is_steep && !misses).then_some(patch)
    }

    /// The command for a target; right where it lies in the patch's own box: [`holds`](Self::holds).
    #[inline]
    pub fn command_for(&self, target_mm: &[f64; 3]) -> [f64; 3] {
        let [u, v, w]: [f64; 3] =
            std::array::from_fn(|axis| (target_mm[axis] - self.middle_mm[axis]) * self.per_half_mm[axis]);
        let (planes, _) = self.terms.as_chunks::<9>();
        let [a, b, c]: [[f64; 4]; 3] = std::array::from_fn(|plane| {
            let (rows, _) = planes[plane].as_chunks::<3>();
            let [a, b, c]: [[f64; 4]; 3] =
                std::array::from_fn(|row| quadratic(&rows[row][0], &rows[row][1], &rows[row][2], u));
            quadratic(&a, &b, &c, v)
        });
        let correction_mm = quadratic(&a, &b, &c, w);
        std::array::from_fn(|axis| target_mm[axis] + correction_mm[axis])
    }

    /// Whether a command lies in the patch's box.
    #[inline]
    pub fn holds(&self, command_mm: &[f64; 3]) -> bool {
        is_between(command_mm, &self.low_mm, &self.high_mm)
    }
}

#[inline]
fn is_between(at_mm: &[f64; 3], low_mm: &[f64; 3], high_mm: &[f64; 3]) -> bool {
    (0..3).all(|axis| low_mm[axis] <= at_mm[axis] && at_mm[axis] <= high_mm[axis])
}

#[inline]
fn quadratic(a: &[f64; 4], b: &[f64; 4], c: &[f64; 4], at: f64) -> [f64; 4] {
    std::array::from_fn(|k| a[k] + at * (b[k] + at * c[k]))
}

/// All triples of `values`, the first of them running fastest.
fn places<const N: usize>(values: [f64; N]) -> impl Iterator<Item = [f64; 3]> {
    (0..N * N * N).map(move |place| [values[place % N], values[place / N % N], values[place / (N * N)]])
}

/// Values at the three nodes of one variable into coefficients.
fn interpolate(terms: &mut [[f64; 4]; TERMS], stride: usize) {
    for first in (0..TERMS).filter(|place| place / stride % 3 == 0) {
        for k in 0..4 {
            let [below, at, above] = [0, 1, 2].map(|node| terms[first + node * stride][k]);
            terms[first][k] = at;
            terms[first + stride][k] = (above - below) / (2.0 * NODE);
            terms[first + 2 * stride][k] = (above + below - 2.0 * at) / (2.0 * NODE * NODE);
        }
    }
}

/// Exponents of the three variables in a term.
fn exponents(term: usize) -> [usize; 3] {
    [term % 3, term / 3 % 3, term / 9]
}

/// First derivatives in the middle: row by component, column by axis.
fn slopes(terms: &[[f64; 4]; TERMS], per_half_mm: &[f64; 3]) -> [[f64; 3]; 3] {
    let linear = [1, 3, 9];
    std::array::from_fn(|row| std::array::from_fn(|axis| terms[linear[axis]][row] * per_half_mm[axis]))
}

/// Bound of the derivative by `of` variables, each an axis, anywhere in the box.
fn bound(terms: &[[f64; 4]; TERMS], per_half_mm: &[f64; 3], of: &[usize]) -> f64 {
    let mut bound = 0.0;
    for (place, term) in terms.iter().enumerate() {
        let mut left = exponents(place);
        let mut factor = 1.0;
        for &axis in of {
            factor *= left[axis] as f64 * per_half_mm[axis];
            left[axis] = left[axis].saturating_sub(1);
        }
        bound += factor * term.iter().map(|c| c * c).sum::<f64>().sqrt();
    }
    bound
}

fn steepest(terms: &[[f64; 4]; TERMS], per_half_mm: &[f64; 3]) -> f64 {
    (0..3).map(|axis| bound(terms, per_half_mm, &[axis]).powi(2)).sum::<f64>().sqrt()
}

fn bend(terms: &[[f64; 4]; TERMS], per_half_mm: &[f64; 3]) -> f64 {
    let squares = (0..9).map(|pair| bound(terms, per_half_mm, &[pair / 3, pair % 3]).powi(2));
    squares.sum::<f64>().sqrt()
}
