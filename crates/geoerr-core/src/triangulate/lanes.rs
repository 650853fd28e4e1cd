//! A handful of numbers that take every step together, so that the compiler can use vector registers.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// Points that one pass of the kernel carries.
///
/// Measured for two reweightings with `cargo bench -p geoerr-bench --bench triangulate`: 4 lanes are some 5 % faster than
/// 2 or 8 on SSE2, and than 8 when built for a CPU with AVX; with more lanes the kernel's numbers spill from the registers.
pub const WIDTH: usize = 4;

/// One number for each of [`WIDTH`] points.
#[derive(Clone, Copy, Debug)]
pub struct Lanes(pub [f64; WIDTH]);

impl Lanes {
    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(value: f64) -> Self {
        Self([value; WIDTH])
    }

    /// Lane `i` holds `value(i)`.
    #[inline(always)]
    pub fn from_fn(value: impl FnMut(usize) -> f64) -> Self {
        Self(std::array::from_fn(value))
    }

    /// Square root, lane by lane.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self(self.0.map(f64::sqrt))
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

        impl $operator<f64> for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
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

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(Neg::neg))
    }
}
