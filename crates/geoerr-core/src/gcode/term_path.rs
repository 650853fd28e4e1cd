//! A machine of terms as the map that paths are split by.

use super::knots::knots;
use super::path::{PathMap, inverse_of};
use crate::kinematics::Axis;
use crate::volumetric::{Approach, MotionNeeds, TermMachine, Windup};

/// A machine of terms, with the places between which its error is all but a parabola.
#[derive(Debug, Clone)]
pub struct TermPath {
    machine: TermMachine,
    knots_mm: [Vec<f64>; 3],
}

/// Tables of a usual machine have fewer entries than this: they are cut as ever.
const MOST_CROSSINGS: usize = 64;

/// Where smoothness is tested: shares of the ranges of the other two axes. Odd numbers, that no period divides.
const ELSEWHERE: [f64; 3] = [0.137, 0.521, 0.943];

impl TermPath {
    /// Finds the cuts within the range of each axis, (low, high).
    pub fn new(machine: TermMachine, range_mm: &[(f64, f64); 3]) -> Self {
        let knots_mm = Axis::ALL.map(|axis| find_knots(&machine, axis, range_mm));
        Self { machine, knots_mm }
    }
}

impl PathMap for TermPath {
    fn command_for(
        &self,
        ideal_mm: &[f64; 3],
        approach: &Approach,
        tolerance_mm: f64,
    ) -> Result<[f64; 3], f64> {
        inverse_of(&self.machine.at(*approach), ideal_mm, tolerance_mm)
    }

    #[inline]
    fn actual(&self, command_mm: &[f64; 3], approach: &Approach) -> [f64; 3] {
        let error_mm = self.machine.error(command_mm, &[0.0; 3], approach);
        std::array::from_fn(|axis| command_mm[axis] + error_mm[axis])
    }

    #[inline]
    fn knots(&self, axis: usize) -> &[f64] {
        &self.knots_mm[axis]
    }

    fn is_nominal(&self) -> bool {
        self.machine.is_nominal()
    }

    fn most_crossings(&self) -> usize {
        MOST_CROSSINGS
    }

    fn needs(&self) -> MotionNeeds {
        self.machine.needs()
    }

    fn windups(&self) -> &[Windup] {
        self.machine.windups()
    }
}

fn find_knots(machine: &TermMachine, axis: Axis, range_mm: &[(f64, f64); 3]) -> Vec<f64> {
    let a = axis.index();
    let mut knots_mm = machine.knots(axis).to_vec();
    if machine.is_nominal() {
        return knots_mm;
    }
    // Amplitudes, not places, depend on direction and speed: any will do.
    let approach = Approach {
        direction: [1.0; 3],
        travel_mm: [50.0; 3],
        velocity_mm_s: [10.0; 3],
        feed_mm_min: 600.0,
        ..Approach::default()
    };
    for share in ELSEWHERE {
        let others = range_mm.map(|(low, high)| low + share * (high - low));
        let error = |position: f64| {
            let mut q_mm = others;
            q_mm[a] = position;
            machine.error(&q_mm, &[0.0; 3], &approach)
        };
        knots_mm = knots(range_mm[a], &knots_mm, error);
    }
    knots_mm
}
