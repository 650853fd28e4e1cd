//! How the kernels multiply and add: fused where the processor can.
//!
//! A kernel is written once, for numbers, in loops that the compiler turns into vector registers; `pulp` picks the widest
//! ones when the program runs, and with them whether products are fused.

/// How `a · b + c` is made: rounded once where the processor can, twice where it would have to pretend.
pub(crate) trait Arithmetic {
    fn mul_add(a: f64, b: f64, c: f64) -> f64;
}

/// One rounding.
pub(crate) struct Fused;

/// Two roundings.
pub(crate) struct Separate;

impl Arithmetic for Fused {
    #[inline(always)]
    fn mul_add(a: f64, b: f64, c: f64) -> f64 {
        a.mul_add(b, c)
    }
}

impl Arithmetic for Separate {
    #[inline(always)]
    fn mul_add(a: f64, b: f64, c: f64) -> f64 {
        a * b + c
    }
}

/// `a·b + c·d`.
#[inline(always)]
pub(crate) fn two<A: Arithmetic>(a: f64, b: f64, c: f64, d: f64) -> f64 {
    A::mul_add(a, b, c * d)
}
