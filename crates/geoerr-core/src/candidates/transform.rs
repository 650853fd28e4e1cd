//! Fast Fourier transforms of both kinds of numbers.

use std::sync::Arc;

use rustfft::{Fft, FftNum, FftPlanner};

use crate::least_squares::Real;

/// Numbers that are transformed.
///
/// Each kind plans here and not where numbers are generic: all of the planner would be compiled again in every crate that
/// scans, which is more than a third of what binds this one.
pub trait Transformed: Real + FftNum {
    /// The forward transform of that many numbers.
    fn forward(n: usize) -> Arc<dyn Fft<Self>>;
}

impl Transformed for f32 {
    fn forward(n: usize) -> Arc<dyn Fft<Self>> {
        FftPlanner::new().plan_fft_forward(n)
    }
}

impl Transformed for f64 {
    fn forward(n: usize) -> Arc<dyn Fft<Self>> {
        FftPlanner::new().plan_fft_forward(n)
    }
}
