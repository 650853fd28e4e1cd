//! Sums over rows times waves, at all multiples of one frequency: `Σ_i y_i e^(2πi k u_i)`, u in turns.
//!
//! Rows are spread on an even grid by a kernel of few nodes, the grid is transformed, and the kernel's own transform is
//! divided out: a transform for rows at any places, at the cost of one for even ones.
//!
//! Source: Greengard & Lee, Accelerating the nonuniform fast Fourier transform, SIAM Review 46 (2004); kernel of Kaiser &
//! Bessel as in Fessler & Sutton, IEEE Trans. Signal Processing 51 (2003). Verified in `tests/candidates` against sums
//! written out.

use std::f64::consts::PI;

use geoerr_fourier::{Complex, Transformed};

use super::lanes;
use crate::least_squares::Real;

/// Nodes of one row: an error of 10⁻⁵ of the largest sum.
const TAPS: usize = 7;
/// The grid has so many nodes or more for each wave of the highest frequency: half as many again as Nyquist asks for.
const NODES_PER_WAVE: usize = 3;
const FEWEST_NODES: usize = 64;
/// Places at which a polynomial meets the kernel: between them it misses by 10⁻⁹ of the kernel's largest value.
const NODES: usize = 12;
/// Columns that are transformed beside each other.
const BESIDE: usize = 16;
/// Nodes before the first one and after the last one, for rows near either end: they are of the other end.
const MARGIN: usize = TAPS.div_ceil(2);
/// Places whose sums wait in the nearest cache to be spread.
const WAITING: usize = 32;

/// Places of rows on an even grid around one turn.
pub(super) struct Spectrum {
    n_nodes: usize,
    /// How steep the kernel is.
    steepness: f64,
    /// Rows in the order of their places.
    rows: Vec<usize>,
    places: Vec<Place>,
}

/// Rows of one place, which are added before they are spread.
struct Place {
    /// The first of them in `rows`, and the one after the last.
    start: usize,
    end: usize,
    /// Counted with the nodes before the first one.
    first_node: usize,
    weights: [f64; TAPS],
}

impl Spectrum {
    /// Lays out rows at places in turns; those that are no numbers are left out.
    pub(super) fn new(turns: &[f64], highest: usize) -> Self {
        let n_nodes = quickly_transformed((NODES_PER_WAVE * highest).max(FEWEST_NODES));
        let steepness = steepness(n_nodes as f64 / (2 * highest.max(1)) as f64);
        let mut at: Vec<(usize, f64)> = (turns.iter().enumerate())
            .filter(|(_, turn)| turn.is_finite())
            .map(|(row, turn)| (row, (turn - turn.floor()) * n_nodes as f64))
            .collect();
        at.sort_by(|(row, place), (other_row, other)| place.total_cmp(other).then(row.cmp(other_row)));
        let kernel = Kernel::new(steepness);
        let mut end = 0;
        let places = (at.chunk_by(|one, other| one.1.to_bits() == other.1.to_bits()))
            .map(|own| {
                end += own.len();
                let place = own[0].1;
                let first = (place - 0.5 * TAPS as f64).ceil();
                Place {
                    start: end - own.len(),
                    end,
                    first_node: (first + MARGIN as f64) as usize,
                    weights: kernel.weights(first - place),
                }
            })
            .collect();
        let rows = at.into_iter().map(|(row, _)| row).collect();
        Self { n_nodes, steepness, rows, places }
    }

    /// Gives, for each of some harmonics, the sums with the cosine and those with the sine, `width` of each.
    ///
    /// What is summed are the rows of all terms, `width` numbers each, times the scale of the row.
    pub(super) fn sums<T: Real + Transformed>(
        &self,
        width: usize,
        harmonics: &[usize],
        terms: &[(&[T], &[T])],
    ) -> Vec<T> {
        // Two real columns are one complex one.
        let half = width.div_ceil(2);
        let stride = (2 * half).next_multiple_of(lanes::SPREAD);
        let mut grid = vec![T::default(); (self.n_nodes + 2 * MARGIN) * stride];
        let mut waiting = vec![T::default(); WAITING * stride];
        for places in self.places.chunks(WAITING) {
            let rows = places.iter().map(|place| self.rows[place.start..place.end].iter().copied());
            lanes::set_sums_of_rows(&mut waiting, stride, width, rows, terms);
            let taps = places.iter().map(|place| (place.first_node, place.weights.map(T::nearest)));
            lanes::spread(&mut grid, &waiting, stride, &taps.collect::<Vec<_>>());
        }
        for columns in grid.chunks_exact_mut((self.n_nodes + 2 * MARGIN) * lanes::SPREAD) {
            self.close(columns);
        }
        let transform = T::forward(self.n_nodes);
        let nothing = Complex::new(T::default(), T::default());
        let mut columns = vec![nothing; BESIDE * self.n_nodes];
        let mut scratch = vec![nothing; transform.get_inplace_scratch_len()];
        let scales: Vec<T> = harmonics.iter().map(|&k| T::nearest(0.5 / self.kernel_at(k))).collect();
        let mut sums = vec![T::default(); harmonics.len() * 2 * width];
        for first in (0..half).step_by(BESIDE) {
            let n_beside = BESIDE.min(half - first);
            let pairs = columns.chunks_exact_mut(self.n_nodes).take(n_beside).enumerate();
            for (beside, column) in pairs {
                let (number, at) =
                    (2 * (first + beside) / lanes::SPREAD, 2 * (first + beside) % lanes::SPREAD);
                let own = &grid[(number * (self.n_nodes + 2 * MARGIN) + MARGIN) * lanes::SPREAD..];
                for (value, row) in column.iter_mut().zip(own.as_chunks::<{ lanes::SPREAD }>().0) {
                    *value = Complex::new(row[at], row[at + 1]);
                }
            }
            transform.process_with_scratch(&mut columns[..n_beside * self.n_nodes], &mut scratch);
            for ((&k, &scale), sums) in harmonics.iter().zip(&scales).zip(sums.chunks_exact_mut(2 * width)) {
                for beside in 0..n_beside {
                    let own = &columns[beside * self.n_nodes..(beside + 1) * self.n_nodes];
                    let (z, mirrored) = (own[k], own[self.n_nodes - k]);
                    let [a, b, c, d] = [z.re, z.im, mirrored.re, mirrored.im].map(|one| scale * one);
                    // Sums of the first column a + c and b − d, of the second b + d and c − a, times cosine and −sine.
                    let column = 2 * (first + beside);
                    sums[column] = a + c;
                    sums[width + column] = d - b;
                    if column + 1 < width {
                        sums[column + 1] = b + d;
                        sums[width + column + 1] = a - c;
                    }
                }
            }
        }
        sums
    }

    /// Adds the nodes beyond either end to those of the other end, whose they are.
    fn close<T: Real>(&self, nodes: &mut [T]) {
        let (before, rest) = nodes.split_at_mut(MARGIN * lanes::SPREAD);
        let (own, after) = rest.split_at_mut(self.n_nodes * lanes::SPREAD);
        let last = own.len() - before.len();
        own[last..].iter_mut().zip(before).for_each(|(sum, value)| *sum += *value);
        own.iter_mut().zip(after).for_each(|(sum, value)| *sum += *value);
    }

    /// The kernel's transform at a harmonic.
    fn kernel_at(&self, harmonic: usize) -> f64 {
        let phase = PI * TAPS as f64 * harmonic as f64 / self.n_nodes as f64;
        let root = (self.steepness.powi(2) - phase.powi(2)).sqrt();
        TAPS as f64 * root.sinh() / root
    }
}

/// Kaiser & Bessel's kernel at a distance in nodes.
fn kernel(distance: f64, steepness: f64) -> f64 {
    let inside = 1.0 - (2.0 * distance / TAPS as f64).powi(2);
    if inside < 0.0 { 0.0 } else { bessel_i0(steepness * inside.sqrt()) }
}

/// The kernel between one node of the grid and the next, a polynomial for each tap: its series at every row would take
/// longer than all else.
struct Kernel {
    /// Chebyshev's nodes of the distance of the first tap.
    nodes: [f64; NODES],
    /// By tap: divided differences.
    differences: [[f64; NODES]; TAPS],
}

impl Kernel {
    fn new(steepness: f64) -> Self {
        let half = 0.5 * TAPS as f64;
        let nodes = std::array::from_fn(|j| 0.5 + 0.5 * (PI * (j as f64 + 0.5) / NODES as f64).cos() - half);
        let differences = std::array::from_fn(|tap| {
            let mut own: [f64; NODES] = nodes.map(|distance: f64| kernel(distance + tap as f64, steepness));
            for order in 1..NODES {
                for j in (order..NODES).rev() {
                    own[j] = (own[j] - own[j - 1]) / (nodes[j] - nodes[j - order]);
                }
            }
            own
        });
        Self { nodes, differences }
    }

    /// Weights of all taps, by the distance of the first one.
    fn weights(&self, distance: f64) -> [f64; TAPS] {
        self.differences.map(|own| {
            let above = own[..NODES - 1].iter().zip(&self.nodes).rev();
            above.fold(own[NODES - 1], |sum, (difference, node)| sum * (distance - node) + difference)
        })
    }
}

/// For a grid of so many times the nodes that are needed, but not many more than twice (Beatty, Nishimura & Pauly 2005).
fn steepness(oversampling: f64) -> f64 {
    let ratio = oversampling.min(2.0);
    PI * ((TAPS as f64 / ratio * (ratio - 0.5)).powi(2) - 0.8).sqrt()
}

/// The next length that is a power of two, or three times one.
fn quickly_transformed(least: usize) -> usize {
    let power = least.next_power_of_two();
    if 3 * power / 4 >= least { 3 * power / 4 } else { power }
}

/// The modified Bessel function of order 0, by its series.
fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let (mut sum, mut term, mut n) = (1.0, 1.0, 1.0);
    while term > 1e-17 * sum {
        term *= quarter / (n * n);
        sum += term;
        n += 1.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_meet_the_kernel() {
        for oversampling in [1.5, 1.7, 2.0] {
            let steepness = steepness(oversampling);
            let (polynomials, most) = (Kernel::new(steepness), kernel(0.0, steepness));
            for step in 0..=1000 {
                let distance = f64::from(step) / 1000.0 - 0.5 * TAPS as f64;
                for (tap, weight) in polynomials.weights(distance).into_iter().enumerate() {
                    let miss = weight - kernel(distance + tap as f64, steepness);
                    assert!(miss.abs() < 1e-9 * most, "{oversampling} {distance} {tap}: {miss}");
                }
            }
        }
    }
}
