//! Wide registers after a product of matrices.
//!
//! Assembly kernels for AVX-512 (faer's `private-gemm-x86`, and those of some BLAS) return with the upper halves of the
//! vector registers in use. Until something clears them, every scalar instruction of code that is compiled for any x86-64
//! drags them along: formulas that are evaluated after a product on the same thread were measured 5 to 8 times slower. A
//! function that is compiled for wide registers clears them as it returns, so one is called.

use std::hint::black_box;

use faer::ColRef;

/// Clears the upper halves of the vector registers, where there are any: some ten nanoseconds.
pub fn clear_wide_registers() {
    black_box(ColRef::from_slice(black_box(&[1.0_f64; 32])).norm_l2());
}

/// Clears them at the end of a scope that multiplies matrices.
pub(super) struct WideRegisters;

impl Drop for WideRegisters {
    fn drop(&mut self) {
        clear_wide_registers();
    }
}
