//! One error function of one axis position: a table, straight lines between its entries.

use super::KinematicsError;

/// A function of an axis position given at some positions: straight between neighbours, and with its end
/// values held outside.
///
/// Values are millimetres or radians; the table does not care which.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    positions_mm: Vec<f64>,
    values: Vec<f64>,
    /// Slope of the cell that begins at the entry; one fewer than entries.
    slopes: Vec<f64>,
}

impl Table {
    /// The function that is 0 everywhere.
    pub fn zero() -> Self {
        Self::default()
    }

    /// A table of `values` (mm or rad) at strictly increasing `positions_mm`; one entry is a constant.
    ///
    /// # Errors
    /// [`KinematicsError::TableLengths`], [`KinematicsError::EmptyTable`],
    /// [`KinematicsError::NonFiniteEntry`], [`KinematicsError::PositionsNotIncreasing`], and
    /// [`KinematicsError::SlopeOverflow`] for neighbours so close that their slope is not a number.
    pub fn new(positions_mm: Vec<f64>, values: Vec<f64>) -> Result<Self, KinematicsError> {
        if positions_mm.len() != values.len() {
            return Err(KinematicsError::TableLengths {
                n_positions: positions_mm.len(),
                n_values: values.len(),
            });
        }
        if positions_mm.is_empty() {
            return Err(KinematicsError::EmptyTable);
        }
        let mut slopes = Vec::with_capacity(positions_mm.len() - 1);
        for index in 0..positions_mm.len() {
            if !positions_mm[index].is_finite() || !values[index].is_finite() {
                return Err(KinematicsError::NonFiniteEntry { index });
            }
            if index == 0 {
                continue;
            }
            let (previous_mm, position_mm) = (positions_mm[index - 1], positions_mm[index]);
            if previous_mm >= position_mm {
                return Err(KinematicsError::PositionsNotIncreasing { index, position_mm, previous_mm });
            }
            let slope = (values[index] - values[index - 1]) / (position_mm - previous_mm);
            if !slope.is_finite() {
                return Err(KinematicsError::SlopeOverflow { index });
            }
            slopes.push(slope);
        }
        Ok(Self { positions_mm, values, slopes })
    }

    /// Value at `q_mm`; NaN for NaN.
    pub fn value(&self, q_mm: f64) -> f64 {
        self.value_and_slope(q_mm).0
    }

    /// Slope at `q_mm`; at a knot the one to its right, so 0 at and beyond the last.
    pub fn slope(&self, q_mm: f64) -> f64 {
        self.value_and_slope(q_mm).1
    }

    /// Positions of the entries, increasing: between neighbours the function is a straight line.
    pub fn knots(&self) -> &[f64] {
        &self.positions_mm
    }

    /// Whether the function is 0 everywhere.
    pub fn is_zero(&self) -> bool {
        self.values.iter().all(|&value| value == 0.0)
    }

    pub(super) fn value_and_slope(&self, q_mm: f64) -> (f64, f64) {
        if q_mm.is_nan() {
            return (f64::NAN, f64::NAN);
        }
        match self.positions_mm.partition_point(|&knot| knot <= q_mm) {
            0 => (self.values.first().copied().unwrap_or(0.0), 0.0),
            n if n == self.positions_mm.len() => (self.values[n - 1], 0.0),
            n => {
                let slope = self.slopes[n - 1];
                (self.values[n - 1] + slope * (q_mm - self.positions_mm[n - 1]), slope)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        Table::new(vec![-10.0, 0.0, 30.0], vec![1.0, 3.0, -3.0]).unwrap()
    }

    #[test]
    fn values_by_hand() {
        // -10 → 1, half way to 0 → 2, 0 → 3, a third of the way to 30 → 1; ends held.
        for (q, value) in [(-99.0, 1.0), (-10.0, 1.0), (-5.0, 2.0), (0.0, 3.0), (10.0, 1.0), (30.0, -3.0)] {
            assert_eq!(table().value(q), value, "at {q}");
        }
        assert_eq!(table().value(1e9), -3.0);
    }

    #[test]
    fn slope_is_right_hand() {
        for (q, slope) in [(-10.1, 0.0), (-10.0, 0.2), (-0.1, 0.2), (0.0, -0.2), (29.9, -0.2), (30.0, 0.0)] {
            assert_eq!(table().slope(q), slope, "at {q}");
        }
    }

    #[test]
    fn one_entry_is_a_constant() {
        let constant = Table::new(vec![5.0], vec![0.25]).unwrap();
        for q in [-1e3, 5.0, 1e3] {
            assert_eq!((constant.value(q), constant.slope(q)), (0.25, 0.0));
        }
    }

    #[test]
    fn zero_and_nan() {
        assert_eq!((Table::zero().value(3.0), Table::zero().slope(3.0)), (0.0, 0.0));
        assert!(Table::zero().knots().is_empty() && Table::zero().is_zero() && !table().is_zero());
        assert!(table().value(f64::NAN).is_nan() && table().slope(f64::NAN).is_nan());
    }

    #[test]
    fn refusals() {
        use KinematicsError as E;
        let refusal = |p: &[f64], v: &[f64]| Table::new(p.to_vec(), v.to_vec()).unwrap_err();
        assert_eq!(refusal(&[0.0], &[]), E::TableLengths { n_positions: 1, n_values: 0 });
        assert_eq!(refusal(&[], &[]), E::EmptyTable);
        assert_eq!(refusal(&[0.0, f64::NAN], &[0.0, 0.0]), E::NonFiniteEntry { index: 1 });
        assert_eq!(refusal(&[0.0], &[f64::INFINITY]), E::NonFiniteEntry { index: 0 });
        let expected = E::PositionsNotIncreasing { index: 2, position_mm: 1.0, previous_mm: 1.0 };
        assert_eq!(refusal(&[0.0, 1.0, 1.0], &[0.0; 3]), expected);
        assert_eq!(refusal(&[0.0, 1e-320], &[0.0, 1.0]), E::SlopeOverflow { index: 1 });
    }
}
