//! A machine of terms under given conditions: fast error, exact Jacobian, and what its inverse needs.
//!
//! ```math
//! \frac{d\mathbf p}{dq_b} = \hat{\mathbf b} + \sum_c \frac{\partial \mathbf E}{\partial g_c}\,\frac{\partial g_c}{\partial q_b}
//!   + \text{levers}, \qquad g_c = \sum_{parts\ on\ c} f(q;\ conditions,\ approach)
//! ```
//!
//! Parts are put in once ([`bind`]): bases on joint errors of their own axis become one [`CurveSet`](crate::bases::CurveSet) an
//! axis, formulas that are the same everywhere become constants; what is left is evaluated at each position. Parts on the rig's
//! channels are left out: the machine does not have them.

mod approach;
mod bind;

use std::collections::BTreeMap;

use rayon::prelude::*;

pub use approach::{Approach, MAX_WINDUPS, MotionNeeds, Windup};

use self::bind::{Bound, Numbers, Question};
use super::{VolumetricError, VolumetricModel};
use crate::bases::BasisError;
use crate::kinematics::{
    Axis, BLOCK_ROWS, Carriage, Chain, Displacements, KinematicsError, Motion, Moving, Placed, Rate,
    Rotation, Squareness, Vec3, View, add, deviation_rates, deviations, scale,
};
use crate::newton::{Commands, ErrorMap, NewtonError, commands_by_row};

/// What cannot be made a machine.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MachineError {
    /// Conditions that formulas need and nobody gave.
    #[error("conditions that are needed and not given: {}", names.join(", "))]
    MissingConditions {
        /// Their names, sorted.
        names: Vec<String>,
    },
    /// A parameter that is not finite.
    #[error("a parameter of term {term} has no value")]
    NoValue {
        /// The term's number.
        term: usize,
    },
    /// Formulas that were parsed with other variables.
    #[error("a formula has {found} variables, {needed} are named")]
    VariableCount {
        /// Of the formula.
        found: usize,
        /// Named.
        needed: usize,
    },
    /// Squarenesses that no three directions have.
    #[error(transparent)]
    Kinematics(#[from] KinematicsError),
    /// A basis whose coefficients do not fit.
    #[error(transparent)]
    Basis(#[from] BasisError),
    /// Parameters that do not fit the model.
    #[error(transparent)]
    Volumetric(#[from] VolumetricError),
}

/// A machine whose errors are terms, with parameters and conditions put in.
///
/// Methods as those of [`MachineModel`](crate::kinematics::MachineModel), at an [`Approach`]: direction, travel and speed, on
/// which some formulas depend.
///
/// # Verified by
/// `tests/term_machine.rs`: all 24 chains against [`displacements`](super::displacements) and, for tables, against
/// `MachineModel`; Jacobians against differences; the inverse against the machine itself.
#[derive(Debug, Clone)]
pub struct TermMachine {
    chain: Chain,
    tool_offset_mm: Vec3,
    bound: Bound,
    /// Directions of the axes less nominal ones, at the constant squarenesses.
    skew: [Vec3; 3],
    has_squareness_laws: bool,
    kinks_mm: [Vec<f64>; 3],
    rig_terms: Vec<usize>,
}

impl TermMachine {
    /// Puts parameters and conditions into a model.
    ///
    /// Variables that each move gives (`d_x s_x v_x ... feed`) need no condition; a condition that is given has precedence.
    /// `variables` names those of the model's formulas, in their order.
    ///
    /// # Errors
    /// [`MachineError`].
    pub fn new(
        model: &VolumetricModel,
        coefficients: &[f64],
        inner: &[f64],
        variables: &[String],
        conditions: &BTreeMap<String, f64>,
    ) -> Result<Self, MachineError> {
        let bound = Bound::new(model, coefficients, inner, variables, conditions)?;
        let is_rig = |term: &super::Term| term.parts.iter().any(|part| part.channel.is_rig());
        let rig_terms =
            model.terms().iter().enumerate().filter(|(_, term)| is_rig(term)).map(|(number, _)| number);
        let kinks_mm = Axis::ALL.map(|axis| {
            let curves = bound.curves[axis.index()].kinks().iter().copied();
            let mut kinks_mm: Vec<f64> = curves.chain(bound.kinks_of_laws(axis)).collect();
            kinks_mm.sort_by(f64::total_cmp);
            kinks_mm.dedup();
            kinks_mm
        });
        Ok(Self {
            chain: *model.chain(),
            tool_offset_mm: *model.tool_offset_mm(),
            skew: deviations(&squareness(&bound.constants))?,
            has_squareness_laws: bound.has_squareness_laws(),
            rig_terms: rig_terms.collect(),
            kinks_mm,
            bound,
        })
    }

    /// The order of the axes.
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// From the carriage origin to the tool point.
    pub fn tool_offset_mm(&self) -> &[f64; 3] {
        &self.tool_offset_mm
    }

    /// Whether the machine has no errors at all.
    pub fn is_nominal(&self) -> bool {
        self.bound.is_nominal
    }

    /// What of an approach the errors depend on.
    pub fn needs(&self) -> MotionNeeds {
        self.bound.needs
    }

    /// Names of the variables that each approach gives.
    pub fn motion_names(&self) -> &[String] {
        &self.bound.motion_names
    }

    /// Wind-ups that an approach tells what strokes before left of ([`Approach::left_unwound`]), in its order.
    pub fn windups(&self) -> &[Windup] {
        &self.bound.windups
    }

    /// Numbers of the terms of which some wind-up is as behind a long stroke, whatever strokes came before: its length
    /// differs from place to place, or there are more than [`MAX_WINDUPS`].
    pub fn long_stroke_terms(&self) -> &[usize] {
        &self.bound.long_stroke_terms
    }

    /// Numbers of the terms that act on the rig: left out.
    pub fn rig_terms(&self) -> &[usize] {
        &self.rig_terms
    }

    /// Positions where a curve has a kink, or may have one, increasing. Formulas may have further ones.
    pub fn knots(&self, axis: Axis) -> &[f64] {
        &self.kinks_mm[axis.index()]
    }

    /// Where the machine without errors has the point: `q + tool offset + offset`.
    #[inline]
    pub fn nominal_tool_from_work(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3]) -> [f64; 3] {
        add(q_mm, &self.lever(offset_mm))
    }

    /// Actual minus nominal position of a point at `offset_mm` from the tool point, seen from the work, mm.
    pub fn error(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3], approach: &Approach) -> [f64; 3] {
        let state = self.state(q_mm, offset_mm, &add(q_mm, offset_mm), approach);
        let mut tool = self.on_tool(q_mm, offset_mm, &state);
        tool.displacement = std::array::from_fn(|c| tool.displacement[c] - state.numbers.work[c]);
        self.chain.base_to_work(q_mm, tool, |axis| self.carriage(q_mm, axis, &state)).displacement
    }

    /// Position of a point at `offset_mm` from the tool point, on the tool, seen from the work.
    #[inline]
    pub fn tool_from_work(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3], approach: &Approach) -> [f64; 3] {
        add(&self.nominal_tool_from_work(q_mm, offset_mm), &self.error(q_mm, offset_mm, approach))
    }

    /// Position of a point at `offset_mm` from the tool point, on the tool, in the base frame.
    pub fn tool_from_base(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3], approach: &Approach) -> [f64; 3] {
        let state = self.state(q_mm, offset_mm, &add(q_mm, offset_mm), approach);
        self.on_tool(q_mm, offset_mm, &state).position()
    }

    /// Position of a point on the work, at `offset_mm` from the base origin when x = y = z = 0, in the base frame.
    pub fn work_from_base(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3], approach: &Approach) -> [f64; 3] {
        let state = self.state(q_mm, offset_mm, offset_mm, approach);
        let point = Placed { nominal: *offset_mm, displacement: state.numbers.target };
        let mut placed = self.chain.work_to_base(q_mm, point, |axis| self.carriage(q_mm, axis, &state));
        placed.displacement = add(&placed.displacement, &state.numbers.work);
        placed.position()
    }

    /// `d tool_from_work / d q`, row by component, column by axis; at a kink the derivative to its right.
    #[inline]
    pub fn jacobian(&self, q_mm: &[f64; 3], offset_mm: &[f64; 3], approach: &Approach) -> [[f64; 3]; 3] {
        self.error_and_jacobian(q_mm, offset_mm, approach).1
    }

    /// [`error`](Self::error) and [`jacobian`](Self::jacobian) in one pass through the chain.
    ///
    /// Direction, travel and speed are held.
    pub fn error_and_jacobian(
        &self,
        q_mm: &[f64; 3],
        offset_mm: &[f64; 3],
        approach: &Approach,
    ) -> ([f64; 3], [[f64; 3]; 3]) {
        let lever_mm = self.lever(offset_mm);
        if !self.bound.has_laws() {
            let constants = &self.bound.constants;
            let still = |displacement: Vec3| Moving { displacement, ..Moving::NONE };
            let between = std::array::from_fn(|c| constants.tool[c] - constants.work[c]);
            let motion = |axis: Axis| {
                let a = axis.index();
                let (values, slopes) = self.bound.curves[a].values_and_slopes(q_mm[a]);
                let [dx, dy, dz, ex, ey, ez] = values;
                let skew = &self.skew[a];
                let rate = Rate {
                    by: axis,
                    translation: add(skew, &[slopes[0], slopes[1], slopes[2]]),
                    rotation: [slopes[3], slopes[4], slopes[5]],
                };
                let translation = add(&scale(q_mm[a], skew), &[dx, dy, dz]);
                Motion {
                    carriage: Carriage { translation, rotation: Rotation::new(&[ex, ey, ez]) },
                    rates: [rate],
                }
            };
            let point = still(constants.target);
            return self.chain.error_and_jacobian(q_mm, &lever_mm, point, &still(between), motion);
        }
        self.error_and_full_jacobian(q_mm, offset_mm, &lever_mm, approach)
    }

    /// The same with laws, which may depend on the position of every axis wherever they act.
    fn error_and_full_jacobian(
        &self,
        q_mm: &Vec3,
        offset_mm: &Vec3,
        lever_mm: &Vec3,
        approach: &Approach,
    ) -> (Vec3, [Vec3; 3]) {
        let place_mm = add(q_mm, offset_mm);
        let Numbers { values, rates } = self.numbers(q_mm, offset_mm, &place_mm, approach);
        let skew = self.skew_at(&values);
        let skew_rates = self.has_squareness_laws.then(|| deviation_rates(&squareness(&values)));
        let motion = |axis: Axis| {
            let a = axis.index();
            let (curves, slopes) = self.bound.curves[a].values_and_slopes(q_mm[a]);
            let [dx, dy, dz, ex, ey, ez]: [f64; 6] = std::array::from_fn(|c| curves[c] + values.joints[a][c]);
            let rates = Axis::ALL.map(|by| {
                let b = by.index();
                let mut of: [f64; 6] = rates[b].joints[a];
                if b == a {
                    of = std::array::from_fn(|c| of[c] + slopes[c] + if c < 3 { skew[a][c] } else { 0.0 });
                }
                let mut translation = [of[0], of[1], of[2]];
                if let Some(skew_rates) = &skew_rates {
                    for (by_pair, change) in skew_rates[a].iter().zip(rates[b].squareness) {
                        translation = add(&translation, &scale(q_mm[a] * change, by_pair));
                    }
                }
                Rate { by, translation, rotation: [of[3], of[4], of[5]] }
            });
            let translation = add(&scale(q_mm[a], &skew[a]), &[dx, dy, dz]);
            Motion { carriage: Carriage { translation, rotation: Rotation::new(&[ex, ey, ez]) }, rates }
        };
        let point = Moving { displacement: values.target, columns: std::array::from_fn(|b| rates[b].target) };
        let between = Moving {
            displacement: std::array::from_fn(|c| values.tool[c] - values.work[c]),
            columns: std::array::from_fn(|b| std::array::from_fn(|c| rates[b].tool[c] - rates[b].work[c])),
        };
        self.chain.error_and_jacobian(q_mm, lever_mm, point, &between, motion)
    }

    /// Positions of one point for each row, mm; one offset or approach stands for all rows.
    ///
    /// # Errors
    /// [`VolumetricError::Length`].
    pub fn positions(
        &self,
        view: View,
        q_mm: &[[f64; 3]],
        offsets_mm: &[[f64; 3]],
        approaches: &[Approach],
    ) -> Result<Vec<[f64; 3]>, VolumetricError> {
        self.for_each_row(q_mm, offsets_mm, approaches, |q, l, approach| match view {
            View::ToolFromWork => self.tool_from_work(q, l, approach),
            View::ToolError => self.error(q, l, approach),
            View::ToolFromBase => self.tool_from_base(q, l, approach),
            View::WorkFromBase => self.work_from_base(q, l, approach),
        })
    }

    /// [`jacobian`](Self::jacobian) for each row; one offset or approach stands for all rows.
    ///
    /// # Errors
    /// [`VolumetricError::Length`].
    pub fn jacobians(
        &self,
        q_mm: &[[f64; 3]],
        offsets_mm: &[[f64; 3]],
        approaches: &[Approach],
    ) -> Result<Vec<[[f64; 3]; 3]>, VolumetricError> {
        self.for_each_row(q_mm, offsets_mm, approaches, |q, l, approach| self.jacobian(q, l, approach))
    }

    /// Commands for each target, as [`commands_for`](crate::newton::commands_for); one approach stands for all rows.
    ///
    /// # Errors
    /// [`MachineInverseError`].
    pub fn commands_for(
        &self,
        targets_mm: &[[f64; 3]],
        approaches: &[Approach],
        tolerance_mm: f64,
    ) -> Result<Commands, MachineInverseError> {
        one_or_all("approaches", approaches.len(), targets_mm.len())?;
        Ok(commands_by_row(|row| self.at(*of_row(approaches, row)), targets_mm, tolerance_mm)?)
    }

    /// The machine at one approach.
    #[inline]
    pub fn at(&self, approach: Approach) -> Approached<'_> {
        Approached { machine: self, approach }
    }

    fn for_each_row<T: Send>(
        &self,
        q_mm: &[[f64; 3]],
        offsets_mm: &[[f64; 3]],
        approaches: &[Approach],
        evaluate: impl Fn(&Vec3, &Vec3, &Approach) -> T + Sync,
    ) -> Result<Vec<T>, VolumetricError> {
        one_or_all("offsets", offsets_mm.len(), q_mm.len())?;
        one_or_all("approaches", approaches.len(), q_mm.len())?;
        let rows = (0..q_mm.len()).into_par_iter().with_min_len(BLOCK_ROWS);
        Ok(rows.map(|row| evaluate(&q_mm[row], of_row(offsets_mm, row), of_row(approaches, row))).collect())
    }

    #[inline]
    fn lever(&self, offset_mm: &Vec3) -> Vec3 {
        add(&self.tool_offset_mm, offset_mm)
    }

    #[inline]
    fn numbers(&self, q_mm: &Vec3, offset_mm: &Vec3, place_mm: &Vec3, approach: &Approach) -> Numbers {
        self.bound.numbers(&Question { q_mm, offset_mm, place_mm, approach })
    }

    fn skew_at(&self, values: &Displacements) -> [Vec3; 3] {
        if !self.has_squareness_laws {
            return self.skew;
        }
        // One position's impossible angles are that position's trouble only.
        deviations(&squareness(values)).unwrap_or([[f64::NAN; 3]; 3])
    }

    #[inline]
    fn state(&self, q_mm: &Vec3, offset_mm: &Vec3, place_mm: &Vec3, approach: &Approach) -> State {
        if !self.bound.has_laws() {
            return State { numbers: self.bound.constants, skew: self.skew };
        }
        let numbers = self.numbers(q_mm, offset_mm, place_mm, approach).values;
        State { numbers, skew: self.skew_at(&numbers) }
    }

    #[inline]
    fn carriage(&self, q_mm: &Vec3, axis: Axis, state: &State) -> Carriage {
        let a = axis.index();
        let (curves, _) = self.bound.curves[a].values_and_slopes(q_mm[a]);
        let own = &state.numbers.joints[a];
        let [dx, dy, dz, ex, ey, ez]: [f64; 6] = std::array::from_fn(|c| curves[c] + own[c]);
        Carriage {
            translation: add(&scale(q_mm[a], &state.skew[a]), &[dx, dy, dz]),
            rotation: Rotation::new(&[ex, ey, ez]),
        }
    }

    /// A point on the tool, in the base frame.
    #[inline]
    fn on_tool(&self, q_mm: &Vec3, offset_mm: &Vec3, state: &State) -> Placed {
        let point = Placed { nominal: self.lever(offset_mm), displacement: state.numbers.target };
        let mut placed = self.chain.tool_to_base(q_mm, point, |axis| self.carriage(q_mm, axis, state));
        placed.displacement = add(&placed.displacement, &state.numbers.tool);
        placed
    }
}

/// Why a batch of targets cannot be solved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MachineInverseError {
    /// Arrays of different lengths.
    #[error(transparent)]
    Rows(#[from] VolumetricError),
    /// A tolerance that is none.
    #[error(transparent)]
    Newton(#[from] NewtonError),
}

/// A machine at one approach: what Newton's method holds.
#[derive(Debug, Clone, Copy)]
pub struct Approached<'a> {
    machine: &'a TermMachine,
    approach: Approach,
}

impl ErrorMap for Approached<'_> {
    #[inline]
    fn error_and_jacobian(&self, q_mm: &[f64; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
        self.machine.error_and_jacobian(q_mm, &[0.0; 3], &self.approach)
    }
}

/// What displaces the machine at one position, beside the curves.
struct State {
    numbers: Displacements,
    skew: [Vec3; 3],
}

fn squareness(numbers: &Displacements) -> Squareness {
    let [s_xy_rad, s_xz_rad, s_yz_rad] = numbers.squareness;
    Squareness { s_xy_rad, s_xz_rad, s_yz_rad }
}

fn one_or_all(what: &'static str, found: usize, needed: usize) -> Result<(), VolumetricError> {
    if found == 1 || found == needed { Ok(()) } else { Err(VolumetricError::Length { what, found, needed }) }
}

#[inline]
fn of_row<T>(rows: &[T], row: usize) -> &T {
    if rows.len() == 1 { &rows[0] } else { &rows[row] }
}
