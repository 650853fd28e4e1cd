//! A machine with its errors: where a commanded position really puts the tool.

use super::chain::{Axis, Chain};
use super::directions;
use super::error_tables::ErrorTables;
use super::rotation::Rotation;
use super::vec3::{Vec3, add, scale};
use super::walk::{Carriage, Motion, Moving, Placed, Rate};

/// A machine of three linear axes with its 21 errors.
///
/// | symbol | code | meaning | unit |
/// |---|---|---|---|
/// | `$q$` | `q_mm` | commanded axis positions x, y, z | mm |
/// | `$\mathbf l$` | tool offset + `offset_mm` | from the carriage origin to the point that is asked for | mm |
/// | `$\hat{\mathbf a}'$` | `skew` + unit vector | direction of axis a, with its squareness | - |
/// | `$\boldsymbol\delta_a, \boldsymbol\varepsilon_a$` | `translation`, `rotation` | errors of axis a at its position | mm, rad |
///
/// Positions are nominal plus error, and errors are summed apart from positions: a machine without errors
/// gives `q + l` bit for bit, and an error keeps its own sixteen digits however far from the origin it acts.
///
/// # Source
/// Li et al. 2023, Eqs. 6 to 8, with full rotations and unit directions.
///
/// # Verified by
/// `tests/kinematics/` for all 24 chains: first-order sums (what is left falls by 100 when errors shrink by 10), matrix
/// products by nalgebra, Abbe transfer, squareness, derivatives by differences; and `tests/model/` against quaternions
/// with 40 digits: positions within 1.7e-13 mm at 700 mm, errors within 2e-15 mm, Jacobian within 8e-16.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineModel {
    chain: Chain,
    errors: ErrorTables,
    tool_offset_mm: Vec3,
    axes: [AxisErrors; 3],
    is_nominal: bool,
}

/// The six error functions of one axis on the union of their knots, so that one search finds all six.
#[derive(Debug, Clone, PartialEq)]
struct AxisErrors {
    /// Direction of the axis minus its nominal direction.
    skew: Vec3,
    knots_mm: Vec<f64>,
    /// Values and right-hand slopes at the knots.
    cells: Vec<Cell>,
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Cell {
    values: [f64; 6],
    slopes: [f64; 6],
}

impl AxisErrors {
    fn new(errors: &ErrorTables, axis: Axis, skew: Vec3) -> Self {
        let tables = errors.of_axis(axis);
        let mut knots_mm: Vec<f64> = tables.iter().flat_map(|table| table.knots()).copied().collect();
        knots_mm.sort_by(f64::total_cmp);
        knots_mm.dedup();
        let cells = knots_mm
            .iter()
            .map(|&knot| {
                let both = std::array::from_fn::<_, 6, _>(|c| tables[c].value_and_slope(knot));
                Cell { values: both.map(|(value, _)| value), slopes: both.map(|(_, slope)| slope) }
            })
            .collect();
        Self { skew, knots_mm, cells }
    }

    #[inline]
    fn motion(&self, q_mm: f64, axis: Axis) -> Motion<1> {
        let (values, slopes) = match self.knots_mm.partition_point(|&knot| knot <= q_mm) {
            0 => (self.cells.first().copied().unwrap_or_default().values, [0.0; 6]),
            n => {
                // The slopes at the last knot are 0, as all tables have ended there.
                let cell = &self.cells[n - 1];
                let into_cell = q_mm - self.knots_mm[n - 1];
                (std::array::from_fn(|c| cell.values[c] + cell.slopes[c] * into_cell), cell.slopes)
            }
        };
        let [dx, dy, dz, ex, ey, ez] = values;
        let [dx_rate, dy_rate, dz_rate, ex_rate, ey_rate, ez_rate] = slopes;
        Motion {
            carriage: Carriage {
                translation: add(&scale(q_mm, &self.skew), &[dx, dy, dz]),
                rotation: Rotation::new(&[ex, ey, ez]),
            },
            rates: [Rate {
                by: axis,
                translation: add(&self.skew, &[dx_rate, dy_rate, dz_rate]),
                rotation: [ex_rate, ey_rate, ez_rate],
            }],
        }
    }
}

impl MachineModel {
    /// A machine of the given chain with its errors; `tool_offset_mm` from the carriage origin to the tool point.
    pub fn new(chain: Chain, errors: ErrorTables, tool_offset_mm: [f64; 3]) -> Self {
        // `ErrorTables` holds only squarenesses that have directions.
        let skew = directions::deviations(errors.squareness()).unwrap_or_default();
        let axes = Axis::ALL.map(|axis| AxisErrors::new(&errors, axis, skew[axis.index()]));
        let is_nominal = errors.is_zero();
        Self { chain, errors, tool_offset_mm, axes, is_nominal }
    }

    /// The order of the axes.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// The errors that the machine was made with.
    pub fn errors(&self) -> &ErrorTables {
        &self.errors
    }

    /// From the carriage origin to the tool point.
    pub fn tool_offset_mm(&self) -> &[f64; 3] {
        &self.tool_offset_mm
    }

    /// Whether the machine has no errors at all.
    pub fn is_nominal(&self) -> bool {
        self.is_nominal
    }

    /// Union of the knots of the axis's error functions, increasing: between neighbouring knots of all three
    /// axes the map from commanded to actual position is smooth.
    pub fn knots(&self, axis: Axis) -> &[f64] {
        &self.axes[axis.index()].knots_mm
    }

    /// Where the machine without errors has the point: `q + tool offset + offset`.
    #[inline]
    pub fn nominal_tool_from_work(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3]) -> [f64; 3] {
        add(q_mm, &self.lever(offset_mm))
    }

    /// Position of a point at `offset_mm` from the tool point, on the tool, seen from the work.
    ///
    /// `q + tool offset + offset`, bit for bit, where the machine has no errors.
    #[inline]
    pub fn tool_from_work(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3]) -> [f64; 3] {
        add(&self.nominal_tool_from_work(q_mm, offset_mm), &self.error(q_mm, offset_mm))
    }

    /// Actual minus nominal position of a point at `offset_mm` from the tool point, seen from the work, mm.
    pub fn error(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3]) -> [f64; 3] {
        let tool = self.tool_side(q_mm, offset_mm);
        self.chain.base_to_work(q_mm, tool, |axis| self.carriage(q_mm, axis)).displacement
    }

    /// [`error`](Self::error) of the tool point at each place of a lattice of axis positions, the first of them running
    /// fastest: what a position does to its own axis is worked out once, and so is where the first carriages on the way
    /// from the tool put it, which the others' positions do not change.
    pub fn errors_of_lattice<const N: usize>(&self, q_mm: &[[f64; N]; 3]) -> Vec<[f64; 3]> {
        let carriages = Axis::ALL.map(|axis| {
            let a = axis.index();
            q_mm[a].map(|q| self.axes[a].motion(q, axis).carriage)
        });
        let way = self.chain.way_to_work();
        let passed = |point: Placed, step: usize, k: usize| {
            let (axis, carries_tool) = way[step];
            let (q_mm, carriage) = (q_mm[axis.index()][k], &carriages[axis.index()][k]);
            if carries_tool {
                point.carried(axis, q_mm, carriage)
            } else {
                point.seen_from(axis, q_mm, carriage)
            }
        };
        let strides = way.map(|(axis, _)| N.pow(axis.index() as u32));
        let mut errors_mm = vec![[0.0; 3]; N * N * N];
        let tool = Placed { nominal: self.lever(&[0.0; 3]), displacement: [0.0; 3] };
        for i in 0..N {
            let behind_one = passed(tool, 0, i);
            for j in 0..N {
                let behind_two = passed(behind_one, 1, j);
                for k in 0..N {
                    let place = i * strides[0] + j * strides[1] + k * strides[2];
                    errors_mm[place] = passed(behind_two, 2, k).displacement;
                }
            }
        }
        errors_mm
    }

    /// Position of a point at `offset_mm` from the tool point, on the tool, in the base frame: what a camera
    /// on the floor sees of it. Only the tool side's axes move it.
    pub fn tool_from_base(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3]) -> [f64; 3] {
        self.tool_side(q_mm, offset_mm).position()
    }

    /// Position of a point on the work, at `offset_mm` from the base origin when x = y = z = 0, in the base
    /// frame: what a camera on the floor sees of it. Only the work side's axes move it.
    pub fn work_from_base(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3]) -> [f64; 3] {
        let point = Placed { nominal: *offset_mm, displacement: [0.0; 3] };
        self.chain.work_to_base(q_mm, point, |axis| self.carriage(q_mm, axis)).position()
    }

    /// `d tool_from_work / d q`, row by component, column by axis; at a knot the derivative to its right.
    #[inline]
    pub fn jacobian(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3]) -> [[f64; 3]; 3] {
        self.error_and_jacobian(q_mm, offset_mm).1
    }

    /// [`error`](Self::error) and [`jacobian`](Self::jacobian) in one pass through the chain.
    ///
    /// `d(R v)/dq = ω × (R v) + R dv/dq`, with ω the angular velocity of the carriage.
    pub fn error_and_jacobian(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
        let motion = |axis: Axis| self.axes[axis.index()].motion(q_mm[axis.index()], axis);
        self.chain.error_and_jacobian(q_mm, &self.lever(offset_mm), Moving::NONE, &Moving::NONE, motion)
    }

    #[inline]
    fn lever(&self, offset_mm: &Vec3) -> Vec3 {
        add(&self.tool_offset_mm, offset_mm)
    }

    #[inline]
    fn carriage(&self, q_mm: &Vec3, axis: Axis) -> Carriage {
        self.axes[axis.index()].motion(q_mm[axis.index()], axis).carriage
    }

    /// A point on the tool, in the base frame.
    #[inline]
    fn tool_side(&self, q_mm: &Vec3, offset_mm: &Vec3) -> Placed {
        let point = Placed { nominal: self.lever(offset_mm), displacement: [0.0; 3] };
        self.chain.tool_to_base(q_mm, point, |axis| self.carriage(q_mm, axis))
    }
}
