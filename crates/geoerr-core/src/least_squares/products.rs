//! Products of tall blocks in either precision, on the calling thread.

use std::ops::{Add, AddAssign, Mul, MulAssign, Sub, SubAssign};

use faer::linalg::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::registers::WideRegisters;

/// Numbers that products are made of: `f32` where a ranking is enough, `f64` where digits count.
pub trait Real:
    faer::traits::RealField
    + Copy
    + Default
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + Send
    + Sync
    + sealed::Sealed
{
    /// Distance from 1 to the next number.
    const EPSILON: f64;

    /// The nearest number of this kind.
    fn nearest(value: f64) -> Self;

    /// This number in double precision, exactly.
    fn double(self) -> f64;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

impl Real for f32 {
    const EPSILON: f64 = f32::EPSILON as f64;

    #[inline(always)]
    fn nearest(value: f64) -> Self {
        value as Self
    }

    #[inline(always)]
    fn double(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    const EPSILON: f64 = f64::EPSILON;

    #[inline(always)]
    fn nearest(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn double(self) -> f64 {
        self
    }
}

/// `sum += leftᵀ · right`: `left` (n × m) column after column, `right` (n × k) and `sum` (m × k) row after row.
///
/// Slices whose lengths are not those of such matrices are cut to what fits.
pub fn add_product_of_rows<T: Real>(sum: &mut [T], left: &[T], right: &[T], n_rows: usize) {
    let _wide = WideRegisters;
    let (m, k) = (left.len() / n_rows.max(1), right.len() / n_rows.max(1));
    if sum.len() < m * k || n_rows == 0 || m == 0 || k == 0 {
        return;
    }
    let left = MatRef::from_column_major_slice(&left[..n_rows * m], n_rows, m);
    let right = MatRef::from_row_major_slice(&right[..n_rows * k], n_rows, k);
    let sum = MatMut::from_row_major_slice_mut(&mut sum[..m * k], m, k);
    matmul::matmul(sum, Accum::Add, left.transpose(), right, T::nearest(1.0), Par::Seq);
}

/// `sum += leftᵀ · right`: `left` (n × m) and `right` (n × k) column after column, `sum` (m × k) row after row.
pub fn add_product_of_columns<T: Real>(sum: &mut [T], left: &[T], right: &[T], n_rows: usize) {
    let _wide = WideRegisters;
    let (m, k) = (left.len() / n_rows.max(1), right.len() / n_rows.max(1));
    if sum.len() < m * k || n_rows == 0 || m == 0 || k == 0 {
        return;
    }
    let left = MatRef::from_column_major_slice(&left[..n_rows * m], n_rows, m);
    let right = MatRef::from_column_major_slice(&right[..n_rows * k], n_rows, k);
    let sum = MatMut::from_row_major_slice_mut(&mut sum[..m * k], m, k);
    matmul::matmul(sum, Accum::Add, left.transpose(), right, T::nearest(1.0), Par::Seq);
}

/// `sum += leftᵀ · right`, all row after row: `left` (n × m), `right` (n × k).
pub fn add_cross_product<T: Real>(sum: &mut [T], left: &[T], right: &[T], n_rows: usize) {
    let _wide = WideRegisters;
    let (m, k) = (left.len() / n_rows.max(1), right.len() / n_rows.max(1));
    if sum.len() < m * k || n_rows == 0 || m == 0 || k == 0 {
        return;
    }
    let left = MatRef::from_row_major_slice(&left[..n_rows * m], n_rows, m);
    let right = MatRef::from_row_major_slice(&right[..n_rows * k], n_rows, k);
    let sum = MatMut::from_row_major_slice_mut(&mut sum[..m * k], m, k);
    matmul::matmul(sum, Accum::Add, left.transpose(), right, T::nearest(1.0), Par::Seq);
}

/// `sum += scale · left · right`, all row after row: `left` (n × m), `right` (m × k).
pub fn add_product_by_rows<T: Real>(sum: &mut [T], left: &[T], right: &[T], n_rows: usize, scale: f64) {
    let _wide = WideRegisters;
    let m = left.len() / n_rows.max(1);
    let k = right.len() / m.max(1);
    if sum.len() < n_rows * k || n_rows == 0 || m == 0 || k == 0 {
        return;
    }
    let left = MatRef::from_row_major_slice(&left[..n_rows * m], n_rows, m);
    let right = MatRef::from_row_major_slice(&right[..m * k], m, k);
    let sum = MatMut::from_row_major_slice_mut(&mut sum[..n_rows * k], n_rows, k);
    matmul::matmul(sum, Accum::Add, left, right, T::nearest(scale), Par::Seq);
}
