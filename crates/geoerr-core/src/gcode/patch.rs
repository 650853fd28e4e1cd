//! A machine and its inverse in a small box, as polynomials.

use super::path::PathMap;
use crate::arithmetic::{Arithmetic, Kernel, run_widest};

/// Coefficients of a quadratic in each of three variables.
const TERMS: usize = 27;

/// Places of the nodes in a box from −1 to 1, beside 0: those of Chebyshev's third polynomial.
const NODE: f64 = 0.866_025_403_784_438_6;

/// Where the polynomial is held against the machine: the extremes of Chebyshev's third polynomial, shares of the box.
const PROBES: [f64; 4] = [0.0, 0.25, 0.75, 1.0];

/// Errors that change faster than this (mm/mm) are left to Newton's method.
pub const STEEPEST: f64 = 0.1;

/// A place at a knot is at most so far from it.
const ROUNDED_MM: f64 = 1e-9;

/// A smaller miss leaves less than a rounding after its step.
const SETTLED_MM: f64 = 1e-13;

/// Steps to a command at most, each of which leaves at most that share of the miss.
const STEPS: usize = 16;

/// A machine in one box of commands, in which its errors are smooth: commands for targets, and places for commands.
///
/// The error, place less command, is a quadratic in each coordinate of the command, through 27 places; the correction,
/// command less target, one in each coordinate of the target. Both are held against 64 places of the machine.
#[derive(Debug)]
pub struct Patch {
    /// The box of commands.
    low_mm: [f64; 3],
    high_mm: [f64; 3],
    correction: Quadratic,
    error: Quadratic,
    /// Derivative of the correction in the middle, row by component.
    slopes: [[f64; 3]; 3],
    /// Bound of the second derivative of the correction along any line, 1/mm.
    pub bend_per_mm: f64,
    /// Bound of its third derivative, 1/mm².
    pub twist_per_mm2: f64,
    /// Largest distance of a target from the middle.
    pub radius_mm: f64,
}

impl Patch {
    /// The patch of a box of commands; None where it would be off by more than `tolerance_mm`.
    pub fn new(map: &impl PathMap, low_mm: [f64; 3], high_mm: [f64; 3], tolerance_mm: f64) -> Option<Self> {
        let is_near =
            |off_mm: [f64; 3]| off_mm.iter().map(|c| c * c).sum::<f64>() <= tolerance_mm * tolerance_mm;
        let error = Quadratic::through(&low_mm, &high_mm, |nodes_mm| Some(map.errors_of_lattice(nodes_mm)))?;
        // Not a number is steep.
        if !(..=STEEPEST).contains(&error.steepest()) {
            return None;
        }
        let probes_mm: [[f64; 4]; 3] = std::array::from_fn(|axis| {
            PROBES.map(|share| low_mm[axis] + share * (high_mm[axis] - low_mm[axis]))
        });
        let commands_mm: Vec<[f64; 3]> = lattice(&probes_mm).collect();
        let errors_mm = map.errors_of_lattice(&probes_mm);
        let places_mm: Vec<[f64; 3]> = commands_mm
            .iter()
            .zip(&errors_mm)
            .map(|(command_mm, error_mm)| plus(command_mm, error_mm))
            .collect();
        let by_error_mm = error.added_to_each(&commands_mm);
        if !places_mm
            .iter()
            .zip(&by_error_mm)
            .all(|(place_mm, by_error_mm)| is_near(minus(place_mm, by_error_mm)))
        {
            return None;
        }
        let (mut least_mm, mut most_mm) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for place_mm in &places_mm {
            for axis in 0..3 {
                least_mm[axis] = least_mm[axis].min(place_mm[axis]);
                most_mm[axis] = most_mm[axis].max(place_mm[axis]);
            }
        }
        let correction = Quadratic::through(&least_mm, &most_mm, |nodes_mm| {
            let targets_mm: Vec<[f64; 3]> = lattice(nodes_mm).collect();
            let commands_mm = error.settled(&targets_mm);
            let pairs = commands_mm.iter().zip(&targets_mm);
            let correction = |(command_mm, target_mm)| {
                is_between(command_mm, &low_mm, &high_mm).then(|| minus(command_mm, target_mm))
            };
            pairs.map(correction).collect()
        })?;
        let half_mm = minus(&most_mm, &least_mm).map(|width| 0.5 * width);
        let patch = Self {
            low_mm,
            high_mm,
            slopes: correction.slopes(),
            bend_per_mm: correction.bend(),
            twist_per_mm2: correction.twist(),
            radius_mm: half_mm.iter().map(|half| half * half).sum::<f64>().sqrt(),
            correction,
            error,
        };
        let by_correction_mm = patch.correction.added_to_each(&places_mm);
        let mut misses = by_correction_mm
            .iter()
            .zip(&commands_mm)
            .map(|(by_correction_mm, command_mm)| minus(by_correction_mm, command_mm));
        (misses.all(is_near) && patch.correction.steepest() <= STEEPEST).then_some(patch)
    }

    /// The command for a target; right where it lies in the patch's own box: [`holds`](Self::holds).
    #[inline(always)]
    pub fn command_for<A: Arithmetic>(&self, target_mm: &[f64; 3]) -> [f64; 3] {
        let [x, y, z, _] = added::<A>(&self.correction, target_mm);
        [x, y, z]
    }

    /// Where a command of the box puts the tool.
    #[inline]
    pub fn actual(&self, command_mm: &[f64; 3]) -> [f64; 3] {
        self.error.added_to(command_mm)
    }

    /// The same for two commands.
    #[inline]
    pub fn actual_of_two(&self, commands_mm: &[[f64; 3]; 2]) -> [[f64; 3]; 2] {
        [self.actual(&commands_mm[0]), self.actual(&commands_mm[1])]
    }

    /// Whether a command lies in the patch's box, or by a rounding outside.
    #[inline]
    pub fn nearly_holds(&self, command_mm: &[f64; 3]) -> bool {
        (0..3).all(|axis| {
            self.low_mm[axis] - ROUNDED_MM <= command_mm[axis]
                && command_mm[axis] <= self.high_mm[axis] + ROUNDED_MM
        })
    }

    /// How far outside the patch's box a command lies, along one axis; 0 inside.
    #[inline]
    pub fn outside_mm(&self, command_mm: &[f64; 3]) -> f64 {
        let beyond =
            |axis: usize| (self.low_mm[axis] - command_mm[axis]).max(command_mm[axis] - self.high_mm[axis]);
        (0..3).map(beyond).fold(0.0, f64::max)
    }

    /// Where commands leave the box as their target goes on by shares of `way_mm`: that share, the axis, and whether upwards.
    ///
    /// Of the first order: off by what the correction bends on the way.
    #[inline]
    pub fn way_out(&self, command_mm: &[f64; 3], way_mm: &[f64; 3]) -> (f64, usize, bool) {
        let mut first = (f64::INFINITY, 0, true);
        for axis in 0..3 {
            let turn: f64 = (0..3).map(|along| self.slopes[axis][along] * way_mm[along]).sum();
            let goes_mm = way_mm[axis] + turn;
            let face_mm = if goes_mm > 0.0 { self.high_mm[axis] } else { self.low_mm[axis] };
            let share = (face_mm - command_mm[axis]) / goes_mm;
            if share < first.0 {
                first = (share, axis, goes_mm > 0.0);
            }
        }
        first
    }

    /// By how much, at most, the derivative of the correction differs here and in another box.
    #[inline]
    pub fn turn_to(&self, other: &Self) -> f64 {
        self.jump_to(other) + self.bend_per_mm * self.radius_mm + other.bend_per_mm * other.radius_mm
    }

    /// By how much the derivative of the correction differs in the middle of this and of another box.
    #[inline]
    pub fn jump_to(&self, other: &Self) -> f64 {
        let both = self.slopes.iter().flatten().zip(other.slopes.iter().flatten());
        both.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
    }

    /// Whether a command lies in the patch's box.
    #[inline]
    pub fn holds(&self, command_mm: &[f64; 3]) -> bool {
        is_between(command_mm, &self.low_mm, &self.high_mm)
    }

    /// Whether a place lies in the patch's box as boxes share out the machine: upper faces belong to the next.
    #[inline]
    pub fn owns(&self, at_mm: &[f64; 3]) -> bool {
        // All three are asked: what is known at once need not be guessed.
        let is_in = |axis: usize| (self.low_mm[axis] <= at_mm[axis]) & (at_mm[axis] < self.high_mm[axis]);
        is_in(0) & is_in(1) & is_in(2)
    }
}

/// Three numbers that are quadratics in each coordinate.
#[derive(Debug)]
struct Quadratic {
    /// Middle of the box, and one over half its width.
    middle_mm: [f64; 3],
    per_half_mm: [f64; 3],
    /// Of `1, u, u²` times `1, v, v²` times `1, w, w²`, the first of them running fastest. The fourth component fills
    /// a vector register.
    terms: [[f64; 4]; TERMS],
}

impl Quadratic {
    /// Through what `values` gives at the nodes of a box, a lattice; None where it gives nothing.
    fn through(
        low_mm: &[f64; 3],
        high_mm: &[f64; 3],
        values: impl FnOnce(&[[f64; 3]; 3]) -> Option<Vec<[f64; 3]>>,
    ) -> Option<Self> {
        let middle_mm: [f64; 3] = std::array::from_fn(|axis| 0.5 * (low_mm[axis] + high_mm[axis]));
        let half_mm: [f64; 3] = std::array::from_fn(|axis| 0.5 * (high_mm[axis] - low_mm[axis]));
        let nodes_mm =
            std::array::from_fn(|axis| [-NODE, 0.0, NODE].map(|node| middle_mm[axis] + node * half_mm[axis]));
        let mut terms = [[0.0; 4]; TERMS];
        for (term, [x, y, z]) in terms.iter_mut().zip(values(&nodes_mm)?) {
            *term = [x, y, z, 0.0];
        }
        for stride in [1, 3, 9] {
            interpolate(&mut terms, stride);
        }
        Some(Self { middle_mm, per_half_mm: half_mm.map(|half| 1.0 / half), terms })
    }

    /// A place, and what the quadratic gives there.
    #[inline]
    fn added_to(&self, at_mm: &[f64; 3]) -> [f64; 3] {
        let [x, y, z, _] = run_widest(AddingOnce { quadratic: self, at_mm });
        [x, y, z]
    }

    /// The same for many: none waits for what another's sums wait for.
    fn added_to_each(&self, at_mm: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let mut sums_mm = at_mm.to_vec();
        run_widest(Adding { quadratic: self, at_mm: &mut sums_mm });
        sums_mm
    }

    /// Where the quadratic is added to give these: each step leaves less than a tenth, from a millimetre to the last digit.
    fn settled(&self, wanted_mm: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let mut found_mm = wanted_mm.to_vec();
        run_widest(Settling { quadratic: self, wanted_mm, found_mm: &mut found_mm });
        found_mm
    }

    /// First derivatives in the middle: row by component, column by axis.
    fn slopes(&self) -> [[f64; 3]; 3] {
        let linear = [1, 3, 9];
        std::array::from_fn(|row| {
            std::array::from_fn(|axis| self.terms[linear[axis]][row] * self.per_half_mm[axis])
        })
    }

    /// Bound of a derivative, so many times by each axis, anywhere in the box: of terms of these sizes.
    fn bound(&self, sizes: &[f64; TERMS], times: [usize; 3]) -> f64 {
        let mut bound = 0.0;
        for k in times[2]..3 {
            for j in times[1]..3 {
                for i in times[0]..3 {
                    let factor = FALLING[times[0]][i] * FALLING[times[1]][j] * FALLING[times[2]][k];
                    bound += factor * sizes[i + 3 * j + 9 * k];
                }
            }
        }
        (0..3).fold(bound, |bound, axis| bound * self.per_half_mm[axis].powi(times[axis] as i32))
    }

    /// Bound of the derivatives of one order along any line: those by axes, and how often each stands in the sum of squares.
    fn bounds(&self, derivatives: &[(f64, [usize; 3])]) -> f64 {
        let sizes = self.terms.map(|term| term.iter().map(|c| c * c).sum::<f64>().sqrt());
        derivatives.iter().map(|&(n, times)| n * self.bound(&sizes, times).powi(2)).sum::<f64>().sqrt()
    }

    /// Bound of the first derivative along any line.
    fn steepest(&self) -> f64 {
        self.bounds(&[(1.0, [1, 0, 0]), (1.0, [0, 1, 0]), (1.0, [0, 0, 1])])
    }

    /// Bound of the second derivative along any line.
    fn bend(&self) -> f64 {
        let own = [(1.0, [2, 0, 0]), (1.0, [0, 2, 0]), (1.0, [0, 0, 2])];
        let mixed = [(2.0, [1, 1, 0]), (2.0, [1, 0, 1]), (2.0, [0, 1, 1])];
        self.bounds(&[own, mixed].concat())
    }

    /// Bound of the third derivative along any line; no coordinate has one of its own.
    fn twist(&self) -> f64 {
        let two_and_one = [[2, 1, 0], [2, 0, 1], [1, 2, 0], [0, 2, 1], [1, 0, 2], [0, 1, 2]];
        let mixed = two_and_one.map(|times| (3.0, times));
        self.bounds(&[&mixed[..], &[(6.0, [1, 1, 1])]].concat())
    }
}

/// Derivatives of `1, u, u²` at 1, by how many times.
const FALLING: [[f64; 3]; 3] = [[1.0, 1.0, 1.0], [0.0, 1.0, 2.0], [0.0, 0.0, 2.0]];

#[inline]
fn plus(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] + b[axis])
}

#[inline]
fn minus(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

#[inline]
fn is_between(at_mm: &[f64; 3], low_mm: &[f64; 3], high_mm: &[f64; 3]) -> bool {
    let is_in = |axis: usize| (low_mm[axis] <= at_mm[axis]) & (at_mm[axis] <= high_mm[axis]);
    is_in(0) & is_in(1) & is_in(2)
}

/// Adds what a quadratic gives to places.
struct Adding<'a> {
    quadratic: &'a Quadratic,
    at_mm: &'a mut [[f64; 3]],
}

impl Kernel for Adding<'_> {
    type Output = ();

    /// In loops, for what a library's function is called with is compiled for narrow registers.
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        for at_mm in self.at_mm {
            let [x, y, z, _] = added::<A>(self.quadratic, at_mm);
            *at_mm = [x, y, z];
        }
    }
}

/// Looks for the places to which a quadratic is added to give others, from those on.
struct Settling<'a> {
    quadratic: &'a Quadratic,
    wanted_mm: &'a [[f64; 3]],
    found_mm: &'a mut [[f64; 3]],
}

impl Kernel for Settling<'_> {
    type Output = ();

    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        for _ in 0..STEPS {
            // By component, as they are worked out.
            let mut largest_mm = [0.0_f64; 4];
            for (at_mm, [x, y, z]) in self.found_mm.iter_mut().zip(self.wanted_mm) {
                let (given_mm, wanted_mm) = (added::<A>(self.quadratic, at_mm), [*x, *y, *z, 0.0]);
                let [before_x, before_y, before_z] = *at_mm;
                let before_mm = [before_x, before_y, before_z, 0.0];
                let mut next_mm = [0.0; 4];
                for k in 0..4 {
                    let miss_mm = given_mm[k] - wanted_mm[k];
                    next_mm[k] = before_mm[k] - miss_mm;
                    largest_mm[k] = largest_mm[k].max(miss_mm.abs());
                }
                *at_mm = [next_mm[0], next_mm[1], next_mm[2]];
            }
            if largest_mm[0].max(largest_mm[1]).max(largest_mm[2]) < SETTLED_MM {
                break;
            }
        }
    }
}

/// Adds what a quadratic gives to one place.
struct AddingOnce<'a> {
    quadratic: &'a Quadratic,
    at_mm: &'a [f64; 3],
}

impl Kernel for AddingOnce<'_> {
    /// With the fourth component: were it not wanted, three would be worked out in a narrow register and a half.
    type Output = [f64; 4];

    #[inline(always)]
    fn run<A: Arithmetic>(self) -> [f64; 4] {
        added::<A>(self.quadratic, self.at_mm)
    }
}

#[inline(always)]
fn added<A: Arithmetic>(to: &Quadratic, at_mm: &[f64; 3]) -> [f64; 4] {
    let Quadratic { middle_mm, per_half_mm, terms } = to;
    let u = (at_mm[0] - middle_mm[0]) * per_half_mm[0];
    let v = (at_mm[1] - middle_mm[1]) * per_half_mm[1];
    let w = (at_mm[2] - middle_mm[2]) * per_half_mm[2];
    let a = plane::<A>(terms, 0, u, v);
    let b = plane::<A>(terms, 9, u, v);
    let c = plane::<A>(terms, 18, u, v);
    let [x, y, z, rest] = quadratic::<A>(&a, &b, &c, w);
    [at_mm[0] + x, at_mm[1] + y, at_mm[2] + z, rest]
}

/// The sum of nine terms.
#[inline(always)]
fn plane<A: Arithmetic>(terms: &[[f64; 4]; TERMS], first: usize, u: f64, v: f64) -> [f64; 4] {
    let t = terms;
    let a = quadratic::<A>(&t[first], &t[first + 1], &t[first + 2], u);
    let b = quadratic::<A>(&t[first + 3], &t[first + 4], &t[first + 5], u);
    let c = quadratic::<A>(&t[first + 6], &t[first + 7], &t[first + 8], u);
    quadratic::<A>(&a, &b, &c, v)
}

#[inline(always)]
fn quadratic<A: Arithmetic>(a: &[f64; 4], b: &[f64; 4], c: &[f64; 4], at: f64) -> [f64; 4] {
    let mut sum = [0.0; 4];
    for k in 0..4 {
        sum[k] = A::mul_add(at, A::mul_add(at, c[k], b[k]), a[k]);
    }
    sum
}

/// The places of a lattice, the first coordinate running fastest.
fn lattice<const N: usize>(at_mm: &[[f64; N]; 3]) -> impl Iterator<Item = [f64; 3]> {
    (0..N * N * N).map(|place| [at_mm[0][place % N], at_mm[1][place / N % N], at_mm[2][place / (N * N)]])
}

/// Values at the three nodes of one variable into coefficients.
fn interpolate(terms: &mut [[f64; 4]; TERMS], stride: usize) {
    for first in (0..TERMS).filter(|place| (place / stride).is_multiple_of(3)) {
        let [below, at, above] = [0, 1, 2].map(|node| terms[first + node * stride]);
        terms[first] = at;
        terms[first + stride] = std::array::from_fn(|k| (above[k] - below[k]) / (2.0 * NODE));
        terms[first + 2 * stride] =
            std::array::from_fn(|k| (above[k] + below[k] - 2.0 * at[k]) / (2.0 * NODE * NODE));
    }
}
