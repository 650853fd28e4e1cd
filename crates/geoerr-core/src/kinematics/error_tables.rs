//! The 21 errors of a machine: 18 functions of one axis position each, and three squarenesses.

use serde::{Deserialize, Serialize};

use super::chain::Axis;
use super::directions;
use super::{KinematicsError, Table};

/// Direction of an error: along or about a base axis. ISO 230-1 writes `E`, this, then the moving axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Component {
    /// Translation along x, mm.
    X,
    /// Translation along y, mm.
    Y,
    /// Translation along z, mm.
    Z,
    /// Rotation about x, rad, right-handed.
    A,
    /// Rotation about y, rad, right-handed.
    B,
    /// Rotation about z, rad, right-handed.
    C,
}

impl Component {
    /// X, Y, Z, A, B, C: the order of every array of six.
    pub const ALL: [Self; 6] = [Self::X, Self::Y, Self::Z, Self::A, Self::B, Self::C];

    /// 0 to 5: the component's place in every array of six.
    #[inline]
    pub const fn index(self) -> usize {
        self as usize
    }
}

/// Included angle of two axes' positive directions, less 90° (Li §4.3), each in rad.
///
/// The positive direction is that of the tool relative to the work for growing coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Squareness {
    /// Between +X and +Y.
    pub s_xy_rad: f64,
    /// Between +X and +Z.
    pub s_xz_rad: f64,
    /// Between +Y and +Z.
    pub s_yz_rad: f64,
}

/// The 21 errors. What is not set is 0.
///
/// ```
/// # use geoerr_core::kinematics::{Axis, Component, ErrorTables, Table};
/// let mut errors = ErrorTables::default();
/// errors.set(Axis::X, Component::C, Table::new(vec![0.0, 400.0], vec![0.0, 1e-4])?); // ε_zx
/// assert_eq!(errors.table(Axis::X, Component::C).value(500.0), 1e-4); // the end value is held
/// assert_eq!(ErrorTables::parse_name("ECX")?, (Axis::X, Component::C));
/// # Ok::<(), geoerr_core::kinematics::KinematicsError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ErrorTables {
    tables: [[Table; 6]; 3],
    squareness: Squareness,
}

impl ErrorTables {
    /// Replaces the error function of `axis` in direction `component` (mm or rad).
    pub fn set(&mut self, axis: Axis, component: Component, table: Table) {
        self.tables[axis.index()][component.index()] = table;
    }

    /// Replaces the three squarenesses.
    ///
    /// # Errors
    /// [`KinematicsError::Squareness`] where a number is not finite or no three directions have these angles.
    pub fn set_squareness(&mut self, squareness: Squareness) -> Result<(), KinematicsError> {
        directions::deviations(&squareness)?;
        self.squareness = squareness;
        Ok(())
    }

    /// The error function of `axis` in direction `component`.
    pub fn table(&self, axis: Axis, component: Component) -> &Table {
        &self.tables[axis.index()][component.index()]
    }

    /// The six error functions of `axis`, in the order of [`Component::ALL`].
    pub fn of_axis(&self, axis: Axis) -> &[Table; 6] {
        &self.tables[axis.index()]
    }

    /// The three squarenesses.
    pub fn squareness(&self) -> &Squareness {
        &self.squareness
    }

    /// Whether every error is 0 everywhere.
    pub fn is_zero(&self) -> bool {
        self.squareness == Squareness::default() && self.tables.iter().flatten().all(Table::is_zero)
    }

    /// Reads an ISO 230-1 name such as `ECX` (Li's ε_zx).
    ///
    /// # Errors
    /// [`KinematicsError::UnknownErrorFunction`].
    pub fn parse_name(name: &str) -> Result<(Axis, Component), KinematicsError> {
        let parsed = match *name.as_bytes() {
            [b'E', direction, axis] => {
                let place = b"XYZABC".iter().position(|&letter| letter == direction);
                Axis::from_letter(axis).zip(place.map(|place| Component::ALL[place]))
            }
            _ => None,
        };
        parsed.ok_or_else(|| KinematicsError::UnknownErrorFunction { name: name.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names() {
        assert_eq!(ErrorTables::parse_name("EXX"), Ok((Axis::X, Component::X)));
        assert_eq!(ErrorTables::parse_name("EBZ"), Ok((Axis::Z, Component::B)));
        for name in ["", "EC0Y", "exx", "EXA", "EDX", "XXX"] {
            let refused = Err(KinematicsError::UnknownErrorFunction { name: name.to_owned() });
            assert_eq!(ErrorTables::parse_name(name), refused);
        }
    }

    #[test]
    fn impossible_squareness_is_refused_and_leaves_the_old_one() {
        let mut errors = ErrorTables::default();
        let good = Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 };
        errors.set_squareness(good).unwrap();
        // Z 17° from X and from Y, which stand at 90°: no such direction.
        let flat = Squareness { s_xy_rad: 0.0, s_xz_rad: -1.27, s_yz_rad: -1.27 };
        for bad in [flat, Squareness { s_xy_rad: f64::NAN, ..good }, Squareness { s_xy_rad: 2.0, ..good }] {
            assert!(matches!(errors.set_squareness(bad), Err(KinematicsError::Squareness { .. })));
            assert_eq!(errors.squareness(), &good);
        }
    }
}
