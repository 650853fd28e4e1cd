//! The order of a machine's axes: its structural code.

use serde::{Deserialize, Serialize};

use super::KinematicsError;

/// One of the three linear axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Axis {
    /// The axis X.
    X,
    /// The axis Y.
    Y,
    /// The axis Z.
    Z,
}

impl Axis {
    /// X, Y, Z.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// 0, 1, 2: the axis's place in every array of three.
    #[inline]
    pub const fn index(self) -> usize {
        self as usize
    }

    pub(super) const fn from_letter(letter: u8) -> Option<Self> {
        match letter {
            b'X' => Some(Self::X),
            b'Y' => Some(Self::Y),
            b'Z' => Some(Self::Z),
            _ => None,
        }
    }
}

/// A structural code, work to tool: which axes carry the work and which the tool, and in which order.
///
/// All 24 orders of X, Y, Z and the base `b` are machines: Li's printer is `wZbXYt`, a gantry mill `wbXYZt`.
///
/// ```
/// # use geoerr_core::kinematics::{Axis, Chain};
/// let knee_mill = Chain::parse("wXYbZt")?;
/// assert_eq!(knee_mill.work_axes(), [Axis::Y, Axis::X]); // the base carries Y, Y carries X
/// assert_eq!(knee_mill.tool_axes(), [Axis::Z]);
/// # Ok::<(), geoerr_core::kinematics::KinematicsError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Chain {
    /// Work axes from the base outwards, then tool axes from the base outwards.
    order: [Axis; 3],
    n_work: usize,
}

impl Chain {
    /// Reads a structural code.
    ///
    /// # Errors
    /// [`KinematicsError::Chain`] unless `code` is `w`, each of `X Y Z b` once, `t`.
    pub fn parse(code: &str) -> Result<Self, KinematicsError> {
        let refused = || KinematicsError::Chain { code: code.to_owned() };
        let inner = code.strip_prefix('w').and_then(|rest| rest.strip_suffix('t')).ok_or_else(refused)?;
        let &[a, b, c, d] = inner.as_bytes() else { return Err(refused()) };
        let n_work = inner.bytes().position(|letter| letter == b'b').ok_or_else(refused)?;
        let mut order = [Axis::X; 3];
        let mut seen = [false; 3];
        let letters = [a, b, c, d].into_iter().enumerate().filter(|&(place, _)| place != n_work);
        for (slot, (_, letter)) in letters.enumerate() {
            let axis = Axis::from_letter(letter).ok_or_else(refused)?;
            if std::mem::replace(&mut seen[axis.index()], true) {
                return Err(refused());
            }
            order[slot] = axis;
        }
        order[..n_work].reverse();
        Ok(Self { order, n_work })
    }

    /// The axes that carry the work, from the base outwards.
    #[inline]
    pub fn work_axes(&self) -> &[Axis] {
        &self.order[..self.n_work]
    }

    /// The axes that carry the tool, from the base outwards.
    #[inline]
    pub fn tool_axes(&self) -> &[Axis] {
        &self.order[self.n_work..]
    }

    /// The axes on the way from the tool to the work, and for each whether it carries the tool.
    pub(super) fn way_to_work(&self) -> [(Axis, bool); 3] {
        let n_tool = self.tool_axes().len();
        std::array::from_fn(|step| {
            if step < n_tool { (self.order[2 - step], true) } else { (self.order[step - n_tool], false) }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn li_printer() {
        let chain = Chain::parse("wZbXYt").unwrap();
        assert_eq!(chain.work_axes(), [Axis::Z]);
        assert_eq!(chain.tool_axes(), [Axis::X, Axis::Y]);
    }

    #[test]
    fn base_at_either_end() {
        assert_eq!(Chain::parse("wbXYZt").unwrap().tool_axes(), [Axis::X, Axis::Y, Axis::Z]);
        assert_eq!(Chain::parse("wXYZbt").unwrap().work_axes(), [Axis::Z, Axis::Y, Axis::X]);
        assert!(Chain::parse("wXYZbt").unwrap().tool_axes().is_empty());
    }

    #[test]
    fn refusals() {
        for code in
            ["", "w", "wt", "XYbZ", "wXYZt", "wXXbZt", "wXYbbt", "wxybzt", "wXYbAt", "wXYbZZt", "wXYbéᵗ"]
        {
            assert_eq!(Chain::parse(code), Err(KinematicsError::Chain { code: code.to_owned() }));
        }
    }
}
