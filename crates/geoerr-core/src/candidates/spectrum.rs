//! Sums over rows times waves, at all multiples of one frequency: `Σ_i y_i e^(2πi k u_i)`, u in turns.
//!
//! Rows are spread on an even grid by a kernel of few nodes, the grid is transformed, and the kernel's own transform is
//! divided out: a transform for rows at any places, at the cost of one for even ones.
//!
//! Source: Greengard & Lee, Accelerating the nonuniform fast Fourier transform, SIAM Review 46 (2004); kernel of Kaiser &
//! Bessel as in Fessler & Sutton, IEEE Trans. Signal Processing 51 (2003). Verified in `tests/candidates` against sums
//! written out.

use std::f64::consts::PI;

use rustfft::num_complex::Complex;
use rustfft::{FftNum, FftPlanner};

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
                    first_node: (first + n_nodes as f64) as usize % n_nodes,
                    weights: kernel.weights(first - place),
                }
            })
            .collect();
        let rows = at.into_iter().map(|(row, _)| row).collect();
        Self { n_nodes, steepness, rows, places }
    }

    /// Gives, for each of some harmonics, the sums with the cosine and those with the sine, `width` of each.
    ///
    /// `add_row` adds the numbers of a row.
    pub(super) fn sums<T: Real + FftNum>(
        &self,
        width: usize,
        harmonics: &[usize],
        mut add_row: impl FnMut(&mut [T], usize),
    ) -> Vec<T> {
        // Two real columns are one complex one.
        let half = width.div_ceil(2);
        let mut grid = vec![T::default(); self.n_nodes * 2 * half];
        let mut own = vec![T::default(); width];
        for place in &self.places {
            own.fill(T::default());
            for &row in &self.rows[place.start..place.end] {
                add_row(&mut own, row);
            }
            for (tap, weight) in place.weights.into_iter().enumerate() {
                let node = (place.first_node + tap) % self.n_nodes;
                lanes::add_scaled(&mut grid[node * 2 * half..][..width], T::nearest(weight), &own);
            }
        }
        let transform = FftPlanner::new().plan_fft_forward(self.n_nodes);
        let nothing = Complex::new(T::default(), T::default());
        let mut columns = vec![nothing; BESIDE * self.n_nodes];
        let mut scratch = vec![nothing; transform.get_inplace_scratch_len()];
        let scales: Vec<f64> = harmonics.iter().map(|&k| 1.0 / self.kernel_at(k)).collect();
        let mut sums = vec![T::default(); harmonics.len() * 2 * width];
        for first in (0..half).step_by(BESIDE) {
            let n_beside = BESIDE.min(half - first);
            for (node, row) in grid.chunks_exact(2 * half).enumerate() {
                for (beside, pair) in row[2 * first..].as_chunks::<2>().0.iter().take(n_beside).enumerate() {
                    columns[beside * self.n_nodes + node] = Complex::new(pair[0], pair[1]);
                }
            }
            transform.process_with_scratch(&mut columns[..n_beside * self.n_nodes], &mut scratch);
            for ((&k, &scale), sums) in harmonics.iter().zip(&scales).zip(sums.chunks_exact_mut(2 * width)) {
                for beside in 0..n_beside {
                    let own = &columns[beside * self.n_nodes..(beside + 1) * self.n_nodes];
                    let (z, mirrored) = (own[k], own[self.n_nodes - k]);
                    let [a, b, c, d] =
                        [z.re, z.im, mirrored.re, mirrored.im].map(|one| 0.5 * scale * one.double());
                    // Sums of the first column a + c and b − d, of the second b + d and c − a, times cosine and −sine.
                    let column = 2 * (first + beside);
                    sums[column] = T::nearest(a + c);
                    sums[width + column] = T::nearest(d - b);
                    if column + 1 < width {
                        sums[column + 1] = T::nearest(b + d);
                        sums[width + column + 1] = T::nearest(a - c);
                    }
                }
            }
        }
        sums
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
