//! Sums and scaled sums, compiled for the widest registers that the machine has.
//!
//! Lanes are fixed and products are not fused with sums: the bytes are the same on every machine.

use crate::arithmetic::in_wide_registers;
use crate::least_squares::Real;

/// Lanes of a sum: two of the widest registers.
const LANES: usize = 16;

/// `Σ a b`.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    in_wide_registers(
        #[inline(always)]
        || {
            let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
            let mut sums = [0.0; LANES];
            for (a, b) in a.iter().zip(b) {
                for lane in 0..LANES {
                    sums[lane] += a[lane] * b[lane];
                }
            }
            let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
            sums.iter().sum::<f64>() + rest
        },
    )
}

/// `sum += factor · values`.
pub(super) fn add_scaled<T: Real>(sum: &mut [T], factor: T, values: &[T]) {
    in_wide_registers(
        #[inline(always)]
        || sum.iter_mut().zip(values).for_each(|(sum, &value)| *sum += factor * value),
    );
}

/// `M v` for a symmetric matrix of n columns, one after another, of which the lower triangle is there.
pub(super) fn times_lower_symmetric(lower: &[f64], v: &[f64]) -> Vec<f64> {
    let n = v.len();
    let mut result = vec![0.0; n];
    for (j, column) in lower.chunks_exact(n.max(1)).enumerate() {
        result[j] += dot(&column[j..], &v[j..]);
        add_scaled(&mut result[j + 1..], v[j], &column[j + 1..]);
    }
    result
}

/// `tr(M N)` for symmetric matrices of n columns of which the lower triangles are there.
pub(super) fn lower_inner(m: &[f64], n: &[f64], n_columns: usize) -> f64 {
    let columns = m.chunks_exact(n_columns.max(1)).zip(n.chunks_exact(n_columns.max(1)));
    columns.enumerate().map(|(j, (m, n))| 2.0 * dot(&m[j..], &n[j..]) - m[j] * n[j]).sum()
}
