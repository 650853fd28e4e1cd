//! How the kernels multiply and add: fused where the processor can.
//!
//! A kernel is written once, for numbers, in loops that the compiler turns into vector registers; `pulp` picks the widest
//! ones when the program runs, and with them whether products are fused.

use pulp::{Arch, Simd, WithSimd};

/// Runs what is compiled for the widest vector registers that the machine has.
///
/// The closure has to be `#[inline(always)]`. It is called by reference: a closure that needs nothing of its own and is
/// called by value gets a function of its own around it, which is compiled for the narrow registers of any machine.
#[inline(always)]
pub(crate) fn in_wide_registers<R>(run: impl FnMut() -> R) -> R {
    struct Run<F>(F);
    impl<R, F: FnMut() -> R> WithSimd for Run<F> {
        type Output = R;

        #[inline(always)]
        fn with_simd<S: Simd>(mut self, _: S) -> R {
            (self.0)()
        }
    }
    Arch::new().dispatch(Run(run))
}

/// Something that is done in one kind of arithmetic.
pub(crate) trait Kernel {
    type Output;

    /// Has to be `#[inline(always)]`, as everything that it calls.
    fn run<A: Arithmetic>(self) -> Self::Output;
}

/// Runs a kernel compiled for the widest vector registers that the machine has, its products fused where they are wide.
#[inline(always)]
pub(crate) fn run_widest<K: Kernel>(kernel: K) -> K::Output {
    struct Run<K>(K);
    impl<K: Kernel> WithSimd for Run<K> {
        type Output = K::Output;

        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> K::Output {
            if S::IS_SCALAR { self.0.run::<Separate>() } else { self.0.run::<Fused>() }
        }
    }
    Arch::new().dispatch(Run(kernel))
}

/// As [`run_widest`], in registers of 512 bits where the machine has them: for kernels whose time is arithmetic.
///
/// What waits for memory, or for a sum before it, gains nothing there.
#[inline(always)]
pub(crate) fn run_in_512_bits<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("fma")
    {
        #[target_feature(enable = "avx512f,avx512dq,avx512vl,fma")]
        fn run<K: Kernel>(kernel: K) -> K::Output {
            kernel.run::<Fused>()
        }
        // SAFETY: the machine has what the function is compiled for; that was asked just now.
        #[allow(unsafe_code)]
        return unsafe { run(kernel) };
    }
    run_widest(kernel)
}

/// As [`in_wide_registers`], in registers of 512 bits where the machine has them.
#[inline(always)]
pub(crate) fn in_512_bits<R>(run: impl FnMut() -> R) -> R {
    struct Run<F>(F);
    impl<R, F: FnMut() -> R> Kernel for Run<F> {
        type Output = R;

        #[inline(always)]
        fn run<A: Arithmetic>(mut self) -> R {
            (self.0)()
        }
    }
    run_in_512_bits(Run(run))
}

/// How `a · b + c` is made: rounded once where the processor can, twice where it would have to pretend.
pub(crate) trait Arithmetic {
    fn mul_add(a: f64, b: f64, c: f64) -> f64;

    /// The same in single precision.
    fn mul_add_f32(a: f32, b: f32, c: f32) -> f32;
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

    #[inline(always)]
    fn mul_add_f32(a: f32, b: f32, c: f32) -> f32 {
        a.mul_add(b, c)
    }
}

impl Arithmetic for Separate {
    #[inline(always)]
    fn mul_add(a: f64, b: f64, c: f64) -> f64 {
        a * b + c
    }

    #[inline(always)]
    fn mul_add_f32(a: f32, b: f32, c: f32) -> f32 {
        a * b + c
    }
}

/// `a·b + c·d`.
#[inline(always)]
pub(crate) fn two<A: Arithmetic>(a: f64, b: f64, c: f64, d: f64) -> f64 {
    A::mul_add(a, b, c * d)
}

/// Two values. `array::map` and `array::from_fn` need not be inlined, and what is not is compiled for any machine.
#[inline(always)]
pub(crate) fn both<T>(value: impl Fn(usize) -> T) -> [T; 2] {
    [value(0), value(1)]
}

/// Three values, as [`both`].
#[inline(always)]
pub(crate) fn all_three<T>(value: impl Fn(usize) -> T) -> [T; 3] {
    [value(0), value(1), value(2)]
}
