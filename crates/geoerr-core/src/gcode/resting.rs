//! Axes that a program leaves at rest while corrections move them.
//!
//! A correction takes the direction of an axis from the program ([`Course`]). Where it moves an axis that rests back
//! from where that came, by more than its play, the play is taken up on the other side, and what is proportional to the
//! direction is corrected with the wrong sign.

use super::course::Course;
use super::path::Node;

/// How far corrections have moved each axis back since the program last moved it.
#[derive(Debug, Default)]
pub struct Resting {
    /// Farthest command of each axis in its direction since then, which an axis that has one has.
    farthest_mm: [f64; 3],
    /// Whether that was told since then.
    is_told: [bool; 3],
}

impl Resting {
    /// Whether a move, written as `nodes`, moves an axis back by more than `limit_mm` that rests in it: once for each
    /// rest.
    pub fn is_turned(
        &mut self,
        course: &Course,
        nodes: &[Node],
        has_direction: [bool; 3],
        limit_mm: f64,
    ) -> bool {
        let farthest_mm = &mut self.farthest_mm;
        let mut is_turned = false;
        for axis in (0..3).filter(|&axis| has_direction[axis]) {
            let direction = course.begin.direction[axis];
            if course.travel_mm[axis] > 0.0 || direction == 0.0 {
                let end_mm = nodes.last().map_or(f64::NAN, |end| end.command_mm[axis]);
                (farthest_mm[axis], self.is_told[axis]) = (direction * end_mm, false);
                continue;
            }
            for node in nodes {
                let along_mm = direction * node.command_mm[axis];
                farthest_mm[axis] = farthest_mm[axis].max(along_mm);
                if farthest_mm[axis] - along_mm > limit_mm && !self.is_told[axis] {
                    self.is_told[axis] = true;
                    is_turned = true;
                }
            }
        }
        is_turned
    }
}
