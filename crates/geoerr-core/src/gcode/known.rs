//! Numbers of x, y and z, of which some may not be known.

use super::frame::Mask;

/// One number for each of x, y, z; not a number where it is not known, so that no sum with it is known either.
#[derive(Clone, Copy, Debug)]
pub struct Known([f64; 3]);

impl Known {
    /// Nothing is known.
    pub const NONE: Self = Self([f64::NAN; 3]);

    /// All are known.
    pub const fn all(numbers: [f64; 3]) -> Self {
        Self(numbers)
    }

    /// The numbers; not a number where one is not known.
    #[inline]
    pub fn numbers(&self) -> &[f64; 3] {
        &self.0
    }

    /// A number, where it is known.
    #[inline]
    pub fn get(&self, axis: usize) -> Option<f64> {
        let number = self.0[axis];
        (!number.is_nan()).then_some(number)
    }

    /// A number is known from now on, or is no longer.
    #[inline]
    pub fn set(&mut self, axis: usize, number: Option<f64>) {
        self.0[axis] = number.unwrap_or(f64::NAN);
    }

    /// All three, where all are known.
    #[inline]
    pub fn whole(&self) -> Option<[f64; 3]> {
        let [x, y, z] = self.0;
        // A sum is not a number where one of its parts is none, or where infinities cancel: those are no places.
        (!(x + y + z).is_nan()).then_some(self.0)
    }

    /// Whether none is known.
    #[inline]
    pub fn is_none(&self) -> bool {
        self.0[0].is_nan() & self.0[1].is_nan() & self.0[2].is_nan()
    }

    /// Which are known.
    pub fn mask(&self) -> Mask {
        self.0.map(|number| !number.is_nan())
    }

    /// With those of another where it has them.
    pub fn updated(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|axis| other.get(axis).unwrap_or(self.0[axis])))
    }
}

impl From<[f64; 3]> for Known {
    fn from(numbers: [f64; 3]) -> Self {
        Self(numbers)
    }
}

impl From<[Option<f64>; 3]> for Known {
    fn from(numbers: [Option<f64>; 3]) -> Self {
        Self(numbers.map(|number| number.unwrap_or(f64::NAN)))
    }
}

impl PartialEq for Known {
    fn eq(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.get(axis) == other.get(axis))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_known_stays_apart() {
        let mut known = Known::from([Some(1.0), None, Some(3.0)]);
        assert_eq!((known.get(0), known.get(1), known.whole()), (Some(1.0), None, None));
        assert_eq!(known.mask(), [true, false, true]);
        assert_eq!(known, known, "unknown is unknown");
        assert_ne!(known, Known::all([1.0, 2.0, 3.0]));
        known.set(1, Some(2.0));
        assert_eq!(known.whole(), Some([1.0, 2.0, 3.0]));
        known.set(0, None);
        assert_eq!(known.updated(&Known::from([Some(7.0), None, None])), Known::all([7.0, 2.0, 3.0]));
        assert!(Known::NONE.is_none() && !known.is_none());
    }
}
