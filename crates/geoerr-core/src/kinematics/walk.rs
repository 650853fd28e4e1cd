//! The walk along a chain: one point, carriage by carriage, nominal position and displacement apart.

use super::chain::{Axis, Chain};
use super::rotation::Rotation;
use super::vec3::{Vec3, add};

/// A point on its way: the sum is where it is. Kept apart so that a displacement keeps its own digits.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    /// Where the machine without errors has the point.
    pub(super) nominal: Vec3,
    /// Actual minus nominal.
    pub(super) displacement: Vec3,
}

impl Placed {
    #[inline]
    pub(super) fn position(&self) -> Vec3 {
        add(&self.nominal, &self.displacement)
    }
}

/// What one carriage does beyond its nominal motion.
pub(super) struct Carriage {
    /// `q (â' − â) + δ`.
    pub(super) translation: Vec3,
    /// R(ε).
    pub(super) rotation: Rotation,
}

impl Chain {
    /// A point of the tool in the base frame: `T p = R(ε) p + q â' + δ` for each tool axis, outermost first.
    #[inline]
    pub(super) fn tool_to_base(
        &self,
        q_mm: &Vec3,
        point: Placed,
        carriage: impl Fn(Axis) -> Carriage,
    ) -> Placed {
        let Placed { mut nominal, mut displacement } = point;
        for &axis in self.tool_axes().iter().rev() {
            let Carriage { translation, rotation } = carriage(axis);
            let turned = rotation.displacement(&add(&nominal, &displacement));
            nominal[axis.index()] += q_mm[axis.index()];
            displacement = std::array::from_fn(|c| displacement[c] + turned[c] + translation[c]);
        }
        Placed { nominal, displacement }
    }

    /// A point of the base frame in the work's: `T⁻¹ p = R(ε) (p + q â' + δ)` for each work axis, innermost first.
    #[inline]
    pub(super) fn base_to_work(
        &self,
        q_mm: &Vec3,
        point: Placed,
        carriage: impl Fn(Axis) -> Carriage,
    ) -> Placed {
        let Placed { mut nominal, mut displacement } = point;
        for &axis in self.work_axes() {
            let Carriage { translation, rotation } = carriage(axis);
            nominal[axis.index()] += q_mm[axis.index()];
            displacement = add(&displacement, &translation);
            displacement = add(&displacement, &rotation.displacement(&add(&nominal, &displacement)));
        }
        Placed { nominal, displacement }
    }

    /// A point of the work in the base frame: `T w = R(−ε) w − q â' − δ` for each work axis, outermost first.
    #[inline]
    pub(super) fn work_to_base(
        &self,
        q_mm: &Vec3,
        point: Placed,
        carriage: impl Fn(Axis) -> Carriage,
    ) -> Placed {
        let Placed { mut nominal, mut displacement } = point;
        for &axis in self.work_axes().iter().rev() {
            let Carriage { translation, rotation } = carriage(axis);
            let turned = rotation.inverse().displacement(&add(&nominal, &displacement));
            nominal[axis.index()] -= q_mm[axis.index()];
            displacement = std::array::from_fn(|c| displacement[c] + turned[c] - translation[c]);
        }
        Placed { nominal, displacement }
    }
}
