//! The walk along a chain: one point, carriage by carriage, nominal position and displacement apart.

use super::chain::{Axis, Chain};
use super::rotation::Rotation;
use super::vec3::{Vec3, add, cross};

/// A point on its way: the sum is where it is. Kept apart so that a displacement keeps its own digits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    /// Where the machine without errors has the point.
    pub(crate) nominal: Vec3,
    /// Actual minus nominal.
    pub(crate) displacement: Vec3,
}

impl Placed {
    #[inline]
    pub(crate) fn position(&self) -> Vec3 {
        add(&self.nominal, &self.displacement)
    }

    /// A point on a carriage of the tool's side, in front of it: `R(ε) p + q â' + δ`.
    #[inline]
    pub(crate) fn carried(self, axis: Axis, q_mm: f64, carriage: &Carriage) -> Self {
        let Self { mut nominal, displacement } = self;
        let turned = carriage.rotation.displacement(&add(&nominal, &displacement));
        nominal[axis.index()] += q_mm;
        let displacement = std::array::from_fn(|c| displacement[c] + turned[c] + carriage.translation[c]);
        Self { nominal, displacement }
    }

    /// A point in front of a carriage of the work's side, seen from it: `R(ε) (p + q â' + δ)`.
    #[inline]
    pub(crate) fn seen_from(self, axis: Axis, q_mm: f64, carriage: &Carriage) -> Self {
        let Self { mut nominal, mut displacement } = self;
        nominal[axis.index()] += q_mm;
        displacement = add(&displacement, &carriage.translation);
        displacement = add(&displacement, &carriage.rotation.displacement(&add(&nominal, &displacement)));
        Self { nominal, displacement }
    }
}

/// What one carriage does beyond its nominal motion.
#[derive(Clone, Copy)]
pub(crate) struct Carriage {
    /// `q (â' − â) + δ`.
    pub(crate) translation: Vec3,
    /// R(ε).
    pub(crate) rotation: Rotation,
}

/// Derivatives of a carriage's motion by one axis position, beyond the nominal motion.
pub(crate) struct Rate {
    pub(crate) by: Axis,
    /// `d(q (â' − â) + δ)`.
    pub(crate) translation: Vec3,
    /// `dε`.
    pub(crate) rotation: Vec3,
}

/// A carriage with its derivatives by the N positions that move it.
pub(crate) struct Motion<const N: usize> {
    pub(crate) carriage: Carriage,
    pub(crate) rates: [Rate; N],
}

/// Where a point of the tool stands on its way, with its derivatives by the three axis positions, as vectors.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moving {
    pub(crate) displacement: Vec3,
    pub(crate) columns: [Vec3; 3],
}

impl Moving {
    pub(crate) const NONE: Self = Self { displacement: [0.0; 3], columns: [[0.0; 3]; 3] };
}

impl Chain {
    /// Actual minus nominal position of a point of the tool seen from the work, and `d position / d q`, row by
    /// component, column by axis.
    ///
    /// `point` is what the point's own displacement on the tool is, `between` that of tool minus work in the base.
    /// `d(R v)/dq = ω × (R v) + R dv/dq`, with ω the angular velocity of the carriage.
    #[inline]
    pub(crate) fn error_and_jacobian<const N: usize>(
        &self,
        q_mm: &Vec3,
        lever_mm: &Vec3,
        point: Moving,
        between: &Moving,
        motion: impl Fn(Axis) -> Motion<N>,
    ) -> (Vec3, [Vec3; 3]) {
        let mut nominal = *lever_mm;
        let Moving { displacement: mut error, mut columns } = point;
        for &axis in self.tool_axes().iter().rev() {
            let a = axis.index();
            let Motion { carriage, rates } = motion(axis);
            let before = add(&nominal, &error);
            let turned = carriage.rotation.displacement(&before);
            for column in &mut columns {
                *column = carriage.rotation.apply(column);
            }
            let arm = add(&before, &turned);
            for rate in &rates {
                let velocity = carriage.rotation.velocity(&rate.rotation);
                let column = &mut columns[rate.by.index()];
                *column = add(column, &add(&rate.translation, &cross(&velocity, &arm)));
            }
            columns[a][a] += 1.0;
            nominal[a] += q_mm[a];
            error = std::array::from_fn(|c| error[c] + turned[c] + carriage.translation[c]);
        }
        error = add(&error, &between.displacement);
        for (column, more) in columns.iter_mut().zip(&between.columns) {
            *column = add(column, more);
        }
        for &axis in self.work_axes() {
            let a = axis.index();
            let Motion { carriage, rates } = motion(axis);
            nominal[a] += q_mm[a];
            error = add(&error, &carriage.translation);
            error = add(&error, &carriage.rotation.displacement(&add(&nominal, &error)));
            for rate in &rates {
                let column = &mut columns[rate.by.index()];
                *column = add(column, &rate.translation);
            }
            columns[a][a] += 1.0;
            for column in &mut columns {
                *column = carriage.rotation.apply(column);
            }
            let arm = add(&nominal, &error);
            for rate in &rates {
                let velocity = carriage.rotation.velocity(&rate.rotation);
                let column = &mut columns[rate.by.index()];
                *column = add(column, &cross(&velocity, &arm));
            }
        }
        (error, std::array::from_fn(|row| std::array::from_fn(|column| columns[column][row])))
    }

    /// A point of the tool in the base frame: `T p = R(ε) p + q â' + δ` for each tool axis, outermost first.
    #[inline]
    pub(crate) fn tool_to_base(
        &self,
        q_mm: &Vec3,
        point: Placed,
        carriage: impl Fn(Axis) -> Carriage,
    ) -> Placed {
        let on_the_way = self.tool_axes().iter().rev();
        on_the_way.fold(point, |point, &axis| point.carried(axis, q_mm[axis.index()], &carriage(axis)))
    }

    /// A point of the base frame in the work's: `T⁻¹ p = R(ε) (p + q â' + δ)` for each work axis, innermost first.
    #[inline]
    pub(crate) fn base_to_work(
        &self,
        q_mm: &Vec3,
        point: Placed,
        carriage: impl Fn(Axis) -> Carriage,
    ) -> Placed {
        let on_the_way = self.work_axes().iter();
        on_the_way.fold(point, |point, &axis| point.seen_from(axis, q_mm[axis.index()], &carriage(axis)))
    }

    /// A point of the work in the base frame: `T w = R(−ε) w − q â' − δ` for each work axis, outermost first.
    #[inline]
    pub(crate) fn work_to_base(
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
