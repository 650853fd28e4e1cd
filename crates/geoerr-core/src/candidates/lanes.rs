//! Sums over rows, compiled for the widest registers that the machine has.
//!
//! Lanes are fixed and products are not fused with sums: the bytes are the same on every machine.

use pulp::Arch;

use super::tile::ROWS;
use crate::least_squares::Real;

/// Lanes of a sum: one widest register in single precision.
const LANES: usize = 16;

/// `Σ a b`.
pub(super) fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    Arch::new().dispatch(
        #[inline(always)]
        || sum_of_products(a, b),
    )
}

/// Adds to the sums of blocks what a column and weights give in each run of rows (first, end, block).
pub(super) fn add_by_run<T: Real>(
    sums: &mut [T],
    column: &[T],
    weights: &[T],
    runs: &[(usize, usize, usize)],
) {
    Arch::new().dispatch(
        #[inline(always)]
        || {
            for &(start, end, block) in runs {
                sums[block] += sum_of_products(&column[start..end], &weights[start..end]);
            }
        },
    );
}

/// Adds to every column of `target` the same rows of a column of `from`, row by row times `scale`.
pub(super) fn add_scaled_columns<T: Real>(
    target: &mut [T],
    scale: &[T],
    from: &[T],
    n_rows: usize,
    start: usize,
) {
    Arch::new().dispatch(
        #[inline(always)]
        || {
            for (target, from) in target.chunks_exact_mut(scale.len()).zip(from.chunks_exact(n_rows)) {
                for ((value, &a), &b) in target.iter_mut().zip(scale).zip(&from[start..]) {
                    *value += a * b;
                }
            }
        },
    );
}

/// `Σ f d g e`, in blocks whose sums are added in double precision.
pub(super) fn product_of_four<T: Real>(f: &[T], d: &[T], g: &[T], e: &[T]) -> f64 {
    Arch::new().dispatch(
        #[inline(always)]
        || {
            let mut total = 0.0;
            let blocks = f.chunks(ROWS).zip(d.chunks(ROWS)).zip(g.chunks(ROWS)).zip(e.chunks(ROWS));
            for (((f, d), g), e) in blocks {
                let (f_lanes, f_rest) = f.as_chunks::<LANES>();
                let (d_lanes, d_rest) = d.as_chunks::<LANES>();
                let (g_lanes, g_rest) = g.as_chunks::<LANES>();
                let (e_lanes, e_rest) = e.as_chunks::<LANES>();
                let mut sums = [T::default(); LANES];
                for (((f, d), g), e) in f_lanes.iter().zip(d_lanes).zip(g_lanes).zip(e_lanes) {
                    for lane in 0..LANES {
                        sums[lane] += (f[lane] * d[lane]) * (g[lane] * e[lane]);
                    }
                }
                total += sums.iter().map(|&lane| lane.double()).sum::<f64>();
                for (((&f, &d), &g), &e) in f_rest.iter().zip(d_rest).zip(g_rest).zip(e_rest) {
                    total += ((f * d) * (g * e)).double();
                }
            }
            total
        },
    )
}

#[inline(always)]
fn sum_of_products<T: Real>(a: &[T], b: &[T]) -> T {
    let (a_lanes, a_rest) = a.as_chunks::<LANES>();
    let (b_lanes, b_rest) = b.as_chunks::<LANES>();
    let mut sums = [T::default(); LANES];
    for (a, b) in a_lanes.iter().zip(b_lanes) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let mut sum = T::default();
    for lane in sums {
        sum += lane;
    }
    for (&a, &b) in a_rest.iter().zip(b_rest) {
        sum += a * b;
    }
    sum
}
