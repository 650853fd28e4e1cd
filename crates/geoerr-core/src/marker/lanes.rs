//! Sixteen pixels that take every step together, in single precision: one widest register.
//!
//! Products are not fused with sums here, so that lanes have the same bytes on every machine.

use std::ops::{Add, AddAssign, Div, Mul, Sub};

/// So large that it has no fraction, nor has what is added to it: 1.5 · 2²³.
pub(super) const SHIFT: f32 = 12_582_912.0;
/// Below this eˣ is nothing beside 1 in single precision. Were it kept, products of such numbers would be subnormal, and
/// each of them takes as long as a hundred others.
const LEAST_EXPONENT: f32 = -20.0;
/// Pixels of a block.
pub(super) const WIDTH: usize = 16;

/// One number of each pixel of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lanes(pub [f32; WIDTH]);

impl Lanes {
    pub(super) const ZERO: Self = Self([0.0; WIDTH]);

    #[inline(always)]
    pub(super) fn splat(value: f32) -> Self {
        Self([value; WIDTH])
    }

    #[inline(always)]
    pub(super) fn from_fn(value: impl FnMut(usize) -> f32) -> Self {
        Self(std::array::from_fn(value))
    }

    /// The first of some numbers; 0 where there are no more.
    #[inline(always)]
    pub(super) fn first_of(numbers: &[f32]) -> Self {
        match numbers.first_chunk() {
            Some(&own) => Self(own),
            None => Self::from_fn(|lane| numbers.get(lane).copied().unwrap_or(0.0)),
        }
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }

    /// All of them together, in double precision.
    #[inline(always)]
    pub(super) fn sum(self) -> f64 {
        let mut sums = self.0.map(f64::from);
        let mut n = WIDTH;
        while n > 1 {
            n /= 2;
            for lane in 0..n {
                sums[lane] += sums[lane + n];
            }
        }
        sums[0]
    }

    /// The nearest whole number, of halves the even one, of numbers that are not in the millions.
    #[inline(always)]
    pub(super) fn rounded(self) -> Self {
        self + SHIFT - Self::splat(SHIFT)
    }

    /// Φ and φ of the normal distribution, from one exponential (Abramowitz & Stegun 7.1.26, |error| < 2·10⁻⁷).
    #[inline(always)]
    pub(super) fn normal_distribution(self) -> (Self, Self) {
        const PER_SQRT_2: f32 = 0.327_591_1 * std::f32::consts::FRAC_1_SQRT_2;
        const PER_SQRT_2_PI: f32 = 0.398_942_3;
        let exponential = (self * self * -0.5).exp_of_negative();
        let k = Self::splat(1.0) / (self.abs() * PER_SQRT_2 + 1.0);
        let poly =
            k * ((((k * 1.061_405_4 + -1.453_152) * k + 1.421_413_7) * k + -0.284_496_74) * k + 0.254_829_6);
        let tail = poly * exponential * 0.5;
        let whole = Self::from_fn(|i| if self.0[i] > 0.0 { 1.0 - tail.0[i] } else { tail.0[i] });
        (whole, exponential * PER_SQRT_2_PI)
    }

    /// eˣ of numbers that are not above 0, to 10⁻⁷ of itself; 0 below [`LEAST_EXPONENT`].
    ///
    /// Cephes' polynomial; the whole part is found by the bits of a number so large that it has no fraction.
    #[inline(always)]
    fn exp_of_negative(self) -> Self {
        Self::from_fn(|i| {
            let x = if self.0[i] > LEAST_EXPONENT { self.0[i] } else { LEAST_EXPONENT };
            let shifted = x * std::f32::consts::LOG2_E + SHIFT;
            let whole = shifted - SHIFT;
            let r = (x - whole * 0.693_359_4) - whole * -2.121_944_4e-4;
            let p = ((((1.987_569_1e-4 * r + 1.398_199_9e-3) * r + 8.333_452e-3) * r + 4.166_579_6e-2) * r
                + 1.666_666_5e-1)
                * r
                + 0.5;
            let power = f32::from_bits(shifted.to_bits().wrapping_add(127) << 23);
            if self.0[i] > LEAST_EXPONENT { (p * r * r + r + 1.0) * power } else { 0.0 }
        })
    }
}

macro_rules! lane_operator {
    ($operator:ident, $method:ident) => {
        impl $operator for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self::from_fn(|i| self.0[i].$method(other.0[i]))
            }
        }

        impl $operator<f32> for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f32) -> Self {
                Self::from_fn(|i| self.0[i].$method(other))
            }
        }
    };
}

lane_operator!(Add, add);
lane_operator!(Sub, sub);
lane_operator!(Mul, mul);
lane_operator!(Div, div);

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_distribution_is_that_of_the_error_function() {
        // Φ from SciPy 1.17.1, `scipy.stats.norm.cdf`.
        let known = [
            (-8.0, 6.220_960_6e-16),
            (-3.0, 0.001_349_898),
            (-1.0, 0.158_655_25),
            (0.0, 0.5),
            (0.3, 0.617_911_4),
            (2.5, 0.993_790_3),
            (9.0, 1.0),
            (-40.0, 0.0),
        ];
        for (z, phi) in known {
            let (whole, density) = Lanes::splat(z).normal_distribution();
            assert!((whole.0[3] - phi).abs() < 3e-7, "{z}: {}", whole.0[3]);
            let exact = (-0.5 * f64::from(z).powi(2)).exp() / (2.0 * std::f64::consts::PI).sqrt();
            assert!((f64::from(density.0[0]) - exact).abs() < 1e-7 * exact.max(1e-3), "{z}");
        }
    }

    #[test]
    fn products_of_densities_are_never_subnormal() {
        for step in 0..4_000 {
            let (_, density) = Lanes::splat(0.01 * step as f32).normal_distribution();
            let own = density.0[0];
            assert!(own == 0.0 || own * own * own > f32::MIN_POSITIVE, "{step}: {own}");
        }
    }
}
