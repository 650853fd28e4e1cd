//! Numbers with their derivatives by ln a², ln b² and ln τ, and without.

use std::ops::{Add, Div, Mul, Sub};

/// A number and its three derivatives.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Dual {
    pub value: f64,
    pub slopes: [f64; 3],
}

/// What a filter is worked out with: with derivatives where they are asked for.
pub(super) trait Number:
    Copy + Default + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// A number that depends on nothing.
    fn constant(value: f64) -> Self;

    /// A number with its derivative by one of the three.
    fn depending(value: f64, by: usize, slope: f64) -> Self;

    /// The number itself.
    fn value(self) -> f64;

    /// The logarithm.
    fn ln(self) -> Self;
}

impl Number for f64 {
    fn constant(value: f64) -> Self {
        value
    }

    fn depending(value: f64, _: usize, _: f64) -> Self {
        value
    }

    fn value(self) -> f64 {
        self
    }

    fn ln(self) -> Self {
        Self::ln(self)
    }
}

impl Number for Dual {
    fn constant(value: f64) -> Self {
        Self { value, slopes: [0.0; 3] }
    }

    fn depending(value: f64, by: usize, slope: f64) -> Self {
        let mut slopes = [0.0; 3];
        slopes[by] = slope;
        Self { value, slopes }
    }

    fn value(self) -> f64 {
        self.value
    }

    fn ln(self) -> Self {
        Self { value: self.value.ln(), slopes: self.slopes.map(|slope| slope / self.value) }
    }
}

impl Dual {
    fn with(self, other: Self, value: f64, slope: impl Fn(f64, f64) -> f64) -> Self {
        Self { value, slopes: [0, 1, 2].map(|i| slope(self.slopes[i], other.slopes[i])) }
    }
}

impl Add for Dual {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        self.with(other, self.value + other.value, |a, b| a + b)
    }
}

impl Sub for Dual {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self.with(other, self.value - other.value, |a, b| a - b)
    }
}

impl Mul for Dual {
    type Output = Self;

    #[expect(clippy::suspicious_arithmetic_impl, reason = "the rule of products")]
    fn mul(self, other: Self) -> Self {
        self.with(other, self.value * other.value, |a, b| a * other.value + self.value * b)
    }
}

impl Div for Dual {
    type Output = Self;

    #[expect(clippy::suspicious_arithmetic_impl, reason = "the rule of quotients")]
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        self.with(other, value, |a, b| (a - value * b) / other.value)
    }
}
