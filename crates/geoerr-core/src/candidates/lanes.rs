//! Sums over rows, compiled for the widest registers that the machine has.
//!
//! Lanes are fixed and products are not fused with sums: the bytes are the same on every machine.

use super::scene::Run;
use super::sources::number;
use crate::arithmetic::in_wide_registers;
use crate::least_squares::Real;

/// Columns that [`spread`] sums in registers, at a few nodes.
pub(super) const SPREAD: usize = 8;
/// Lanes of a sum: one widest register in single precision.
const LANES: usize = 16;

/// `Σ a b`.
pub(super) fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    in_wide_registers(
        #[inline(always)]
        || sum_of_products(a, b),
    )
}

/// `target += scale · from`.
pub(super) fn add_scaled<T: Real>(target: &mut [T], scale: T, from: &[T]) {
    in_wide_registers(
        #[inline(always)]
        || add_scaled_here(target, scale, from),
    );
}

/// Adds rows to nodes: each, of `stride` numbers (so many [`SPREAD`] of them), times its weights to as many nodes as it
/// has of those. `taps` has the first node and the weights of each row, nodes rising.
///
/// Of the nodes the first [`SPREAD`] columns lie together, node after node, then the next ones.
/// The sums of nodes that a row touches stay in registers until no more rows do.
pub(super) fn spread<T: Real, const TAPS: usize>(
    nodes: &mut [T],
    rows: &[T],
    stride: usize,
    taps: &[(usize, [T; TAPS])],
) {
    in_wide_registers(
        #[inline(always)]
        || {
            let n = SPREAD * (nodes.len() / stride.max(1));
            for (number, nodes) in nodes.chunks_exact_mut(n.max(1)).enumerate() {
                spread_here(nodes, rows, stride, taps, number * SPREAD);
            }
        },
    );
}

/// [`SPREAD`] columns of [`spread`], from one on.
#[inline(always)]
fn spread_here<T: Real, const TAPS: usize>(
    nodes: &mut [T],
    rows: &[T],
    stride: usize,
    taps: &[(usize, [T; TAPS])],
    at: usize,
) {
    let mut sums = [[T::default(); SPREAD]; TAPS];
    let mut node = taps.first().map_or(0, |one| one.0);
    for (row, &(first, weights)) in rows.chunks_exact(stride).zip(taps) {
        for _ in 0..(first - node).min(TAPS) {
            add_node(nodes, node * SPREAD, &sums[0]);
            node += 1;
            sums.copy_within(1.., 0);
            sums[TAPS - 1] = [T::default(); SPREAD];
        }
        node = first;
        let mut own = [T::default(); SPREAD];
        own.copy_from_slice(&row[at..at + SPREAD]);
        for (sums, weight) in sums.iter_mut().zip(weights) {
            for (sum, value) in sums.iter_mut().zip(own) {
                *sum += weight * value;
            }
        }
    }
    for (tap, sums) in sums.iter().enumerate() {
        add_node(nodes, (node + tap) * SPREAD, sums);
    }
}

/// Sets rows to sums of some rows of all terms: of those `width` numbers each, times the scale of the row; a row that is
/// set has `stride` numbers, of which others than so many are left.
pub(super) fn set_sums_of_rows<T: Real, Rows: IntoIterator<Item = usize>>(
    target: &mut [T],
    stride: usize,
    width: usize,
    rows: impl Iterator<Item = Rows> + Clone,
    terms: &[(&[T], &[T])],
) {
    in_wide_registers(
        #[inline(always)]
        || {
            for (target, rows) in target.chunks_exact_mut(stride.max(1)).zip(rows.clone()) {
                let (target, mut rows) = (&mut target[..width], rows.into_iter());
                match rows.next() {
                    Some(first) if !terms.is_empty() => {
                        combine(target, terms, first, |value, sum| *value = sum);
                    }
                    _ => target.fill(T::default()),
                }
                rows.for_each(|row| combine(target, terms, row, |value, sum| *value += sum));
            }
        },
    );
}

/// Takes what the terms, three or fewer, have in a row together.
#[inline(always)]
fn combine<T: Real>(target: &mut [T], terms: &[(&[T], &[T])], row: usize, take: impl Fn(&mut T, T)) {
    debug_assert!(terms.len() <= 3, "a row has three components");
    let n = target.len();
    match *terms {
        [one] => {
            let (s, a) = scaled_row(one, row, n);
            target.iter_mut().zip(a).for_each(|(value, &a)| take(value, s * a));
        }
        [one, two] => {
            let ((s, a), (t, b)) = (scaled_row(one, row, n), scaled_row(two, row, n));
            for ((value, &a), &b) in target.iter_mut().zip(a).zip(b) {
                take(value, s * a + t * b);
            }
        }
        [one, two, three] => {
            let (s, a) = scaled_row(one, row, n);
            let ((t, b), (u, c)) = (scaled_row(two, row, n), scaled_row(three, row, n));
            for (((value, &a), &b), &c) in target.iter_mut().zip(a).zip(b).zip(c) {
                take(value, s * a + t * b + u * c);
            }
        }
        _ => {}
    }
}

/// The scale of a term's row, and its n numbers.
#[inline(always)]
fn scaled_row<'a, T: Real>((scales, values): (&[T], &'a [T]), row: usize, n: usize) -> (T, &'a [T]) {
    (scales[row], &values[row * n..(row + 1) * n])
}

#[inline(always)]
fn add_node<T: Real>(nodes: &mut [T], at: usize, sums: &[T; SPREAD]) {
    for (value, &sum) in nodes[at..at + SPREAD].iter_mut().zip(sums) {
        *value += sum;
    }
}

/// `target = by · (target + scale · from)`.
pub(super) fn add_scaled_and_scale<T: Real>(target: &mut [T], scale: T, from: &[T], by: T) {
    in_wide_registers(
        #[inline(always)]
        || {
            for (value, &add) in target.iter_mut().zip(from) {
                *value = (*value + scale * add) * by;
            }
        },
    );
}

/// The same as [`add_scaled`], in double precision, with what is given in another.
pub(super) fn add_as_double<T: Real>(target: &mut [f64], scale: f64, from: &[T]) {
    in_wide_registers(
        #[inline(always)]
        || {
            for (value, add) in target.iter_mut().zip(from) {
                *value += scale * add.double();
            }
        },
    );
}

/// `target += a b`, number by number.
pub(super) fn add_products<T: Real>(target: &mut [T], a: &[T], b: &[T]) {
    in_wide_registers(
        #[inline(always)]
        || {
            for ((value, &a), &b) in target.iter_mut().zip(a).zip(b) {
                *value += a * b;
            }
        },
    );
}

/// Sets `target` to `a b`, number by number.
pub(super) fn set_products<T: Real>(target: &mut [T], a: &[T], b: &[T]) {
    in_wide_registers(
        #[inline(always)]
        || {
            for ((value, &a), &b) in target.iter_mut().zip(a).zip(b) {
                *value = a * b;
            }
        },
    );
}

/// The same of numbers in double precision, each rounded first; 0 for what is not finite.
pub(super) fn set_products_of_numbers<T: Real>(target: &mut [T], a: &[f64], b: &[f64]) {
    in_wide_registers(
        #[inline(always)]
        || {
            for ((value, &a), &b) in target.iter_mut().zip(a).zip(b) {
                *value = number::<T>(a) * number::<T>(b);
            }
        },
    );
}

/// `target *= by`, number by number.
pub(super) fn multiply<T: Real>(target: &mut [T], by: &[T]) {
    in_wide_registers(
        #[inline(always)]
        || {
            for (value, &by) in target.iter_mut().zip(by) {
                *value *= by;
            }
        },
    );
}

/// `target += scale · a b`, number by number.
pub(super) fn add_scaled_products<T: Real>(target: &mut [T], scale: T, a: &[T], b: &[T]) {
    in_wide_registers(
        #[inline(always)]
        || {
            for ((value, &a), &b) in target.iter_mut().zip(a).zip(b) {
                *value += a * b * scale;
            }
        },
    );
}

/// `target -= scale · from`; the largest square that is left.
pub(super) fn take_off<T: Real>(target: &mut [T], scale: T, from: &[T]) -> T {
    in_wide_registers(
        #[inline(always)]
        || {
            let n = target.len().min(from.len());
            let (lanes, rest) = target[..n].as_chunks_mut::<LANES>();
            let (from_lanes, from_rest) = from[..n].as_chunks::<LANES>();
            let mut most = [T::default(); LANES];
            for (values, from) in lanes.iter_mut().zip(from_lanes) {
                for lane in 0..LANES {
                    values[lane] -= scale * from[lane];
                    most[lane] = larger(values[lane] * values[lane], most[lane]);
                }
            }
            for ((value, &from), most) in rest.iter_mut().zip(from_rest).zip(&mut most) {
                *value -= scale * from;
                *most = larger(*value * *value, *most);
            }
            most.into_iter().fold(T::default(), larger)
        },
    )
}

#[inline(always)]
fn larger<T: Real>(a: T, b: T) -> T {
    if a > b { a } else { b }
}

/// [`add_scaled`] inside a loop that is compiled for wide registers.
#[inline(always)]
fn add_scaled_here<T: Real>(target: &mut [T], scale: T, from: &[T]) {
    for (value, &add) in target.iter_mut().zip(from) {
        *value += scale * add;
    }
}

/// Sets sums of a column and weights, run after run of rows.
pub(super) fn set_by_run<T: Real>(sums: &mut [T], column: &[T], weights: &[T], runs: &[Run]) {
    in_wide_registers(
        #[inline(always)]
        || {
            for (sum, run) in sums.iter_mut().zip(runs) {
                *sum = sum_of_products(&column[run.start..run.end], &weights[run.start..run.end]);
            }
        },
    );
}

/// Adds to the sums of blocks what a column and weights give in each run of rows.
pub(super) fn add_by_run<T: Real>(sums: &mut [T], column: &[T], weights: &[T], runs: &[Run]) {
    in_wide_registers(
        #[inline(always)]
        || {
            for run in runs {
                sums[run.block] += sum_of_products(&column[run.start..run.end], &weights[run.start..run.end]);
            }
        },
    );
}

/// `Σ f g w` of columns of `n` numbers, for each pair of columns and the weights named with it.
pub(super) fn add_weighted<T: Real>(
    sums: &mut [f64],
    pairs: &[[usize; 3]],
    columns: &[T],
    weights: &[T],
    n: usize,
) {
    in_wide_registers(
        #[inline(always)]
        || {
            for (sum, &[f, g, w]) in sums.iter_mut().zip(pairs) {
                let [f, g] = [f, g].map(|column| &columns[column * n..(column + 1) * n]);
                *sum += sum_of_three(f, g, &weights[w * n..(w + 1) * n]).double();
            }
        },
    );
}

/// `fᵀ M g` with a symmetric M of so many diagonals, the main one first, each as long as f and g.
pub(super) fn banded<T: Real>(f: &[T], g: &[T], diagonals: &[Vec<T>]) -> f64 {
    in_wide_registers(
        #[inline(always)]
        || {
            let mut total = 0.0;
            for (off, diagonal) in diagonals.iter().enumerate() {
                let n = f.len() - off.min(f.len());
                total += sum_of_three(&f[..n], &g[off..], &diagonal[..n]).double();
                if off > 0 {
                    total += sum_of_three(&g[..n], &f[off..], &diagonal[..n]).double();
                }
            }
            total
        },
    )
}

/// Column after column of `n` numbers becomes row after row.
pub(super) fn transpose<T: Real>(target: &mut Vec<T>, from: &[T], n: usize) {
    const SIDE: usize = 16;
    let m = from.len() / n;
    target.clear();
    target.resize(from.len(), T::default());
    // A square at a time, each of its rows written at once: rows a power of two apart would push each other out of the
    // cache.
    let mut square = [[T::default(); SIDE]; SIDE];
    for column in (0..m).step_by(SIDE) {
        let width = SIDE.min(m - column);
        for row in (0..n).step_by(SIDE) {
            let height = SIDE.min(n - row);
            for (j, own) in square[..width].iter_mut().enumerate() {
                own[..height].copy_from_slice(&from[(column + j) * n + row..][..height]);
            }
            for i in 0..height {
                let target = &mut target[(row + i) * m + column..][..width];
                for (value, own) in target.iter_mut().zip(&square) {
                    *value = own[i];
                }
            }
        }
    }
}

#[inline(always)]
fn sum_of_three<T: Real>(a: &[T], b: &[T], c: &[T]) -> T {
    let n = a.len().min(b.len()).min(c.len());
    let (a_lanes, a_rest) = a[..n].as_chunks::<LANES>();
    let (b_lanes, b_rest) = b[..n].as_chunks::<LANES>();
    let (c_lanes, c_rest) = c[..n].as_chunks::<LANES>();
    let mut sums = [T::default(); LANES];
    for ((a, b), c) in a_lanes.iter().zip(b_lanes).zip(c_lanes) {
        for lane in 0..LANES {
            sums[lane] += (a[lane] * b[lane]) * c[lane];
        }
    }
    let mut sum = T::default();
    for lane in sums {
        sum += lane;
    }
    for ((&a, &b), &c) in a_rest.iter().zip(b_rest).zip(c_rest) {
        sum += (a * b) * c;
    }
    sum
}

#[inline(always)]
fn sum_of_products<T: Real>(a: &[T], b: &[T]) -> T {
    let n = a.len().min(b.len());
    let (a_lanes, a_rest) = a[..n].as_chunks::<LANES>();
    let (b_lanes, b_rest) = b[..n].as_chunks::<LANES>();
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
