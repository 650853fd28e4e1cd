//! Numbers of twice the digits, for what is worked out once for a rig.
//!
//! An error of a rig's constants is the same for every point and does not average out: with these it is one rounding
//! of each constant, whatever the cameras.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// An unevaluated sum `high + low` with `|low|` at most half a rounding of `high`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Double {
    high: f64,
    low: f64,
}

impl Double {
    /// The nearest double.
    pub(super) fn rounded(self) -> f64 {
        self.high
    }

    /// `a + b` with nothing lost (Knuth).
    fn sum_of(a: f64, b: f64) -> Self {
        let high = a + b;
        let b_in_sum = high - a;
        Self { high, low: (a - (high - b_in_sum)) + (b - b_in_sum) }
    }

    /// `a · b` with nothing lost.
    fn product_of(a: f64, b: f64) -> Self {
        let high = a * b;
        Self { high, low: a.mul_add(b, -high) }
    }
}

impl From<f64> for Double {
    fn from(value: f64) -> Self {
        Self { high: value, low: 0.0 }
    }
}

impl Add for Double {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let (high, low) = (Self::sum_of(self.high, other.high), Self::sum_of(self.low, other.low));
        let near = Self::sum_of(high.high, high.low + low.high);
        Self::sum_of(near.high, near.low + low.low)
    }
}

impl Neg for Double {
    type Output = Self;
    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl Sub for Double {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Double {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let product = Self::product_of(self.high, other.high);
        Self::sum_of(product.high, product.low + (self.high * other.low + self.low * other.high))
    }
}

impl Div for Double {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let first = Self::from(self.high / other.high);
        let rest = self - first * other;
        let second = Self::from(rest.high / other.high);
        let rest = rest - second * other;
        first + second + Self::from(rest.high / other.high)
    }
}

#[cfg(test)]
mod tests {
    use super::Double;

    /// `(1/3)·3 − 1` and `(10²⁰ + 1/7) − 10²⁰` are wrong in double precision by a rounding and altogether.
    #[test]
    fn thirty_digits_survive() {
        let third = Double::from(1.0) / Double::from(3.0);
        let nothing = third * Double::from(3.0) - Double::from(1.0);
        assert!(nothing.rounded().abs() < 1e-31);
        let seventh = Double::from(1.0) / Double::from(7.0);
        let back = (Double::from(1e10) + seventh) - Double::from(1e10) - seventh;
        assert!(back.rounded().abs() < 1e-21);
    }
}
