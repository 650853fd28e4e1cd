//! The exact chain at one position, from the numbers that displace it there.

use super::chain::{Axis, Chain};
use super::channel::{Carrier, Channel};
use super::directions;
use super::error_tables::Squareness;
use super::rotation::Rotation;
use super::vec3::{Vec3, add, scale};
use super::walk::{Carriage, Placed};

/// What displaces the machine at one position: a number for each of its channels, mm and rad.
///
/// | field | channels |
/// |---|---|
/// | `joints[axis][component]` | `EXX EYX EZX EAX EBX ECX`, then those of Y and of Z |
/// | `squareness` | `S_xy S_xz S_yz` |
/// | `tool`, `work`, `target` | `tool-x ...`, `work-x ...`, `target-x ...` |
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Displacements {
    /// δ (mm) and ε (rad) of each axis: [`Axis::index`], [`Component::index`](super::Component::index).
    pub joints: [[f64; 6]; 3],
    /// S_xy, S_xz, S_yz, rad.
    pub squareness: [f64; 3],
    /// The tool's own displacement, base frame, mm.
    pub tool: [f64; 3],
    /// The work's own displacement, base frame, mm.
    pub work: [f64; 3],
    /// The target's own displacement on the body that carries it, mm. It turns with that body; on the base there is none.
    pub target: [f64; 3],
}

impl Displacements {
    /// From one number a channel, in the order of [`Channel::ALL`].
    pub fn from_channels(numbers: &[f64; Channel::MACHINE_COUNT]) -> Self {
        let three = |first: usize| std::array::from_fn(|c| numbers[first + c]);
        Self {
            joints: std::array::from_fn(|axis| std::array::from_fn(|c| numbers[6 * axis + c])),
            squareness: three(18),
            tool: three(21),
            work: three(24),
            target: three(27),
        }
    }
}

impl Chain {
    /// Where the machine without errors has the point, mm.
    ///
    /// `offset_mm` counts from the machine's tool point for [`Carrier::Tool`] and [`Carrier::Relative`], from the
    /// base origin for [`Carrier::Work`] and [`Carrier::Base`], at x = y = z = 0.
    pub fn nominal(
        &self,
        carrier: Carrier,
        q_mm: &[f64; 3],
        offset_mm: &[f64; 3],
        tool_offset_mm: &[f64; 3],
    ) -> [f64; 3] {
        let moved = |mut point: Vec3, axes: &[Axis], sign: f64| {
            for axis in axes {
                point[axis.index()] += sign * q_mm[axis.index()];
            }
            point
        };
        match carrier {
            Carrier::Tool => moved(add(tool_offset_mm, offset_mm), self.tool_axes(), 1.0),
            Carrier::Work => moved(*offset_mm, self.work_axes(), -1.0),
            Carrier::Base => *offset_mm,
            Carrier::Relative => moved(add(tool_offset_mm, offset_mm), &Axis::ALL, 1.0),
        }
    }

    /// Actual minus nominal position of the point, mm, in the base frame ([`Carrier::Relative`]: in the work's).
    ///
    /// Summed apart from the position: it keeps its own digits, and is exactly 0 where nothing displaces. NaN
    /// where no three directions have the squarenesses.
    ///
    /// ```math
    /// \begin{aligned}
    /// \text{tool:}&\quad T_{tool}(\mathbf l + \mathbf d_{target}) + \mathbf d_{tool}\\
    /// \text{work:}&\quad T_{work}(\mathbf w + \mathbf d_{target}) + \mathbf d_{work}\\
    /// \text{base:}&\quad \mathbf l\\
    /// \text{relative:}&\quad T_{work}^{-1}\bigl(T_{tool}(\mathbf l + \mathbf d_{target}) + \mathbf d_{tool} - \mathbf d_{work}\bigr)
    /// \end{aligned}
    /// ```
    ///
    /// # Source
    /// Li et al. 2023, Eqs. 6 to 8, with full rotations and unit directions.
    ///
    /// # Verified by
    /// `tests/kinematics/displacements.rs`: nalgebra's isometries on all 24 chains, and the machine from tables bit for bit.
    pub fn displacement(
        &self,
        carrier: Carrier,
        q_mm: &[f64; 3],
        offset_mm: &[f64; 3],
        tool_offset_mm: &[f64; 3],
        displacements: &Displacements,
    ) -> [f64; 3] {
        let Displacements { joints, squareness, tool, work, target } = displacements;
        let skew = skew(squareness);
        let carriage = |axis: Axis| {
            let [dx, dy, dz, ex, ey, ez] = joints[axis.index()];
            Carriage {
                translation: add(&scale(q_mm[axis.index()], &skew[axis.index()]), &[dx, dy, dz]),
                rotation: Rotation::new(&[ex, ey, ez]),
            }
        };
        let on_tool = || {
            let point = Placed { nominal: add(tool_offset_mm, offset_mm), displacement: *target };
            let mut placed = self.tool_to_base(q_mm, point, carriage);
            placed.displacement = add(&placed.displacement, tool);
            placed
        };
        match carrier {
            Carrier::Tool => on_tool().displacement,
            Carrier::Work => {
                let point = Placed { nominal: *offset_mm, displacement: *target };
                add(&self.work_to_base(q_mm, point, carriage).displacement, work)
            }
            // A marker on the base is part of the measurement: no carriage, and no work or tool to displace.
            Carrier::Base => [0.0; 3],
            Carrier::Relative => {
                let mut placed = on_tool();
                placed.displacement = std::array::from_fn(|c| placed.displacement[c] - work[c]);
                self.base_to_work(q_mm, placed, carriage).displacement
            }
        }
    }

    /// Where the point is: [`nominal`](Self::nominal) plus [`displacement`](Self::displacement), mm.
    pub fn position(
        &self,
        carrier: Carrier,
        q_mm: &[f64; 3],
        offset_mm: &[f64; 3],
        tool_offset_mm: &[f64; 3],
        displacements: &Displacements,
    ) -> [f64; 3] {
        let nominal = self.nominal(carrier, q_mm, offset_mm, tool_offset_mm);
        add(&nominal, &self.displacement(carrier, q_mm, offset_mm, tool_offset_mm, displacements))
    }
}

fn skew(squareness: &[f64; 3]) -> [Vec3; 3] {
    let &[s_xy_rad, s_xz_rad, s_yz_rad] = squareness;
    // One row's impossible angles are that row's trouble only.
    directions::deviations(&Squareness { s_xy_rad, s_xz_rad, s_yz_rad }).unwrap_or([[f64::NAN; 3]; 3])
}
