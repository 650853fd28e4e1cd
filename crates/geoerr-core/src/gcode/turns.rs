//! Axes that corrections turn round, and what their play holds back.
//!
//! A program tells the direction of an axis by what it moves ([`Course`]). Where its correction moves the axis back from
//! where that came (it rests in the program, or creeps), the axis crosses its play there: it stands still until the play
//! is crossed, and what is proportional to its direction has the other sign behind. A little of that is left to the play,
//! as a part of the tolerance that a path then has no use of; more turns the axis where that way back begins, so that the
//! path takes up the play there, as at a reversal of the program.

use super::course::Course;
use super::path::{Node, PathMap, norm};
use crate::volumetric::{Approach, Windup};

/// Of what a move may be off where an axis rests or creeps, what is left to play.
const SHARE_HELD: f64 = 0.4;

/// An axis that goes less than this of a move's length creeps: corrections may turn it. They change by far less.
const CREEPING: f64 = 0.1;

/// Where an axis stands in its play. Commands are those of the program's directions, whatever was turned since.
#[derive(Clone, Copy, Debug)]
struct Side {
    /// Direction of the program, as in a [`Course`].
    of_program: f64,
    /// Direction in which the axis has taken up its play.
    taken_up: f64,
    /// Farthest command in that direction, along it.
    reach_mm: f64,
}

impl Side {
    const UNKNOWN: Self = Self { of_program: 0.0, taken_up: 0.0, reach_mm: f64::NEG_INFINITY };

    /// What the program turns, or comes to from an unknown way, has taken up its play in the program's direction.
    fn begun(of_program: f64) -> Self {
        Self { of_program, taken_up: of_program, ..Self::UNKNOWN }
    }

    fn turn(&mut self) {
        self.taken_up = -self.taken_up;
        self.reach_mm = f64::NEG_INFINITY;
    }

    /// How far a command is behind the farthest, which it may be itself.
    fn back_mm(&mut self, command_mm: f64) -> f64 {
        let along_mm = self.taken_up * command_mm;
        self.reach_mm = self.reach_mm.max(along_mm);
        self.reach_mm - along_mm
    }
}

/// A stretch of a move, to where the next one begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Share of the move at which it begins.
    pub share: f64,
    /// Direction in which each axis has taken up its play.
    pub direction: [f64; 3],
}

/// A move that has to be commanded otherwise than by the program's directions alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Turned {
    /// Direction in which each axis has taken up its play at its begin.
    pub begins: [f64; 3],
    /// Its further stretches.
    pub stretches: Vec<Stretch>,
    /// Whether an axis is turned in it against the program's direction.
    pub is_turn: bool,
}

impl Turned {
    /// A part of the move, which lies in one stretch.
    pub fn stretch(&self, course: &Course, from: f64, to: f64, windups: &[Windup]) -> Course {
        let of = self.stretches.iter().rfind(|stretch| stretch.share <= from);
        let direction = of.map_or(self.begins, |stretch| stretch.direction);
        course.stretch(from, to, &direction, windups)
    }

    /// The last stretch.
    pub fn last_stretch(&self, course: &Course, windups: &[Windup]) -> Course {
        self.stretch(course, self.stretches.last().map_or(0.0, |last| last.share), 1.0, windups)
    }
}

/// Follows which axes are turned, as a program goes on.
#[derive(Debug)]
pub struct Turns {
    has_direction: [bool; 3],
    /// Of what a move may be off, what is left to the play of one axis.
    share_held: f64,
    sides: [Side; 3],
    /// Whether the last move ended with an axis turned.
    ended_turned: bool,
}

impl Turns {
    /// Before a program; for errors that depend on the directions of these axes.
    pub fn new(has_direction: [bool; 3]) -> Self {
        let n_axes = has_direction.iter().filter(|&&it_has| it_has).count().max(1);
        let share_held = SHARE_HELD / (n_axes as f64).sqrt();
        Self { has_direction, share_held, sides: [Side::UNKNOWN; 3], ended_turned: false }
    }

    /// Whether any axis can be turned.
    pub fn any(&self) -> bool {
        self.has_direction != [false; 3]
    }

    /// The part of the tolerance that the path of a move has use of.
    pub fn share_of_path(&self, course: &Course) -> f64 {
        let step_mm = course.travel_mm;
        let length_mm = norm(&step_mm);
        let creeps = |axis| course.begin.direction[axis] != 0.0 && step_mm[axis] < CREEPING * length_mm;
        if self.directed().any(creeps) { 1.0 - SHARE_HELD } else { 1.0 }
    }

    /// A move that is commanded by these nodes where directions are the program's, and may be off by `limit_mm`: what has
    /// to change of that; None where nothing has. `is_first` where it comes from a place that no corrected move has
    /// reached.
    pub fn follow(
        &mut self,
        map: &impl PathMap,
        course: &Course,
        nodes: &[Node],
        is_first: bool,
        limit_mm: f64,
    ) -> Option<Turned> {
        for axis in self.directed() {
            let of_program = course.begin.direction[axis];
            if is_first || of_program != self.sides[axis].of_program {
                self.sides[axis] = Side::begun(of_program);
            }
        }
        let most_held_mm = self.share_held * limit_mm;
        let mut begins = self.directions(course);
        let mut stretches: Vec<Stretch> = Vec::new();
        let mut is_turn = false;
        let mut begin: Option<&Node> = None;
        for node in nodes {
            for axis in self.directed() {
                let back_mm = self.sides[axis].back_mm(node.command_mm[axis]);
                if back_mm <= most_held_mm
                    || play_mm(map, &course.at(node.share), &node.command_mm, axis) <= most_held_mm
                {
                    continue;
                }
                let side = &mut self.sides[axis];
                side.turn();
                side.back_mm(node.command_mm[axis]);
                is_turn |= side.taken_up != side.of_program;
                let share = begin.map_or(0.0, |begin| begin.share);
                let direction = self.directions(course);
                match stretches.last_mut() {
                    Some(last) if last.share == share => last.direction = direction,
                    None if share == 0.0 => begins = direction,
                    _ => stretches.push(Stretch { share, direction }),
                }
            }
            begin = Some(node);
        }
        let ends_turned = self.is_turned();
        let began_turned = std::mem::replace(&mut self.ended_turned, ends_turned);
        let is_as_programmed = !began_turned && !is_turn && !ends_turned;
        (!is_as_programmed).then_some(Turned { begins, stretches, is_turn })
    }

    fn directed(&self) -> impl Iterator<Item = usize> + use<> {
        let has_direction = self.has_direction;
        (0..3).filter(move |&axis| has_direction[axis])
    }

    /// Those in which play is taken up now; the program's of axes without any.
    fn directions(&self, course: &Course) -> [f64; 3] {
        std::array::from_fn(|axis| {
            if self.has_direction[axis] { self.sides[axis].taken_up } else { course.begin.direction[axis] }
        })
    }

    fn is_turned(&self) -> bool {
        self.directed().any(|axis| self.sides[axis].taken_up != self.sides[axis].of_program)
    }
}

/// How far an axis at a command can be moved back before the tool follows: what its error along itself is less than if
/// the axis had been turned.
fn play_mm(map: &impl PathMap, approach: &Approach, command_mm: &[f64; 3], axis: usize) -> f64 {
    let turned = approach.turned(axis, map.windups());
    let [one, other] = map.actual_of_two(&[*command_mm; 2], &[*approach, turned]);
    approach.direction[axis] * (other[axis] - one[axis])
}
