//! Numbers with their derivatives by ln a², ln b² and ln τ.

use std::ops::{Add, Div, Mul, Sub};

/// A number and its three derivatives.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Dual {
    pub value: f64,
    pub slopes: [f64; 3],
}

impl Dual {
    /// A number that depends on nothing.
    pub fn constant(value: f64) -> Self {
        Self { value, slopes: [0.0; 3] }
    }

    /// The logarithm.
    pub fn ln(self) -> Self {
        Self { value: self.value.ln(), slopes: self.slopes.map(|slope| slope / self.value) }
    }

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
