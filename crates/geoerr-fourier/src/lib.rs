//! Fast Fourier transforms of both kinds of numbers.
//!
//! A planner compiles into whoever plans, and was a third of the core: here it compiles once, beside what the core waits
//! for anyway, and neither again when the core changes nor for its tests.

use std::sync::Arc;

pub use rustfft::num_complex::Complex;
pub use rustfft::{Fft, FftNum};

/// Numbers that are transformed.
pub trait Transformed: FftNum {
    /// The forward transform of that many numbers.
    fn forward(n: usize) -> Arc<dyn Fft<Self>>;
}

impl Transformed for f32 {
    fn forward(n: usize) -> Arc<dyn Fft<Self>> {
        rustfft::FftPlanner::new().plan_fft_forward(n)
    }
}

impl Transformed for f64 {
    fn forward(n: usize) -> Arc<dyn Fft<Self>> {
        rustfft::FftPlanner::new().plan_fft_forward(n)
    }
}
