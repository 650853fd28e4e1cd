//! Axes that corrections turn round, and what their play holds back.
//!
//! A program tells the direction of an axis by what it moves ([`Course`]). Where its correction moves the axis back from
//! where that came (it rests in the program, or creeps), the axis crosses its play there: it stands still until the play
//! is crossed, and what is proportional to its direction has the other sign behind. A little of that is left to the play,
//! as a part of the tolerance that a path then has no use of; more turns the axis where that way back begins, so that the
//! path takes up the play there, as at a reversal of the program.
//!
//! Moves that pass untouched (arcs) are no part of that: their drives are followed stroke by stroke, and behind them each
//! axis is where these have left it in its play, whatever the program's next direction.

use super::course::Course;
use super::frame::{Effects, Frame, Kept, KeptFrames, Place};
use super::known::Known;
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
    /// How far the last one is behind it.
    behind_mm: f64,
}

impl Side {
    const UNKNOWN: Self =
        Self { of_program: 0.0, taken_up: 0.0, reach_mm: f64::NEG_INFINITY, behind_mm: 0.0 };

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
        self.behind_mm = self.reach_mm - along_mm;
        self.behind_mm
    }

    /// Behind these places of its drive, to which it has gone from one to the next, and before a move of the program in
    /// this direction.
    fn gone(self, places_mm: &[f64], play_mm: f64, of_program: f64) -> Self {
        let (mut taken_up, mut behind_mm) = (self.taken_up, self.behind_mm);
        for pair in places_mm.windows(2) {
            let step_mm = pair[1] - pair[0];
            if taken_up == 0.0 && step_mm != 0.0 {
                // Nothing says that its play was ever on the other side.
                taken_up = step_mm.signum();
            }
            behind_mm = (behind_mm - taken_up * step_mm).max(0.0);
            if behind_mm >= play_mm {
                (taken_up, behind_mm) = (-taken_up, 0.0);
            }
        }
        if taken_up == 0.0 {
            return Self::begun(of_program);
        }
        let at_mm = places_mm.last().copied().unwrap_or_default();
        // For the program's direction this place is commanded from the other end of the play.
        let across_mm = if taken_up == of_program { 0.0 } else { play_mm };
        Self { of_program, taken_up, reach_mm: taken_up * at_mm + behind_mm - across_mm, behind_mm }
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
    /// Where the rewritten program puts the machine.
    frame: Frame,
    kept: KeptFrames,
    /// Places to which each drive has gone one way after the other since the last move that was corrected, and where it
    /// began; empty where the next move goes on from there.
    gone_mm: [Vec<f64>; 3],
}

impl Turns {
    /// Before a program; for errors that depend on the directions of these axes.
    pub fn new(has_direction: [bool; 3]) -> Self {
        let n_axes = has_direction.iter().filter(|&&it_has| it_has).count().max(1);
        let share_held = SHARE_HELD / (n_axes as f64).sqrt();
        Self {
            has_direction,
            share_held,
            sides: [Side::UNKNOWN; 3],
            ended_turned: false,
            frame: Frame::default(),
            kept: KeptFrames::default(),
            gone_mm: Default::default(),
        }
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

    /// Takes over what a line does that passes as it is.
    pub fn pass(&mut self, effects: &Effects) {
        self.frame.set_position(effects.forget, &Known::NONE);
        let from_mm = self.frame.position_mm;
        self.frame.apply(effects);
        self.kept.apply(effects.kept, &mut self.frame);
        let goes_back = matches!(effects.kept, Kept::TakeUp { moves: true, .. });
        if effects.place == Place::Keep && effects.forget == [false; 3] && !goes_back {
            return;
        }
        let strokes = effects.passage.strokes(&from_mm, &self.frame.position_mm);
        for (axis, strokes) in strokes.into_iter().enumerate() {
            let goes_home = matches!(effects.place, Place::Home(mask, _) if mask[axis]);
            let gone_mm = &mut self.gone_mm[axis];
            match strokes {
                Some(strokes) if !goes_back && !goes_home => {
                    if gone_mm.is_empty() {
                        gone_mm.push(from_mm.numbers()[axis]);
                    }
                    gone_mm.extend(strokes);
                }
                _ => {
                    self.sides[axis] = Side::UNKNOWN;
                    gone_mm.clear();
                }
            }
        }
    }

    /// A move that is commanded by these nodes where directions are the program's, and may be off by `limit_mm`: what has
    /// to change of that; None where nothing has.
    pub fn follow(
        &mut self,
        map: &impl PathMap,
        course: &Course,
        nodes: &[Node],
        limit_mm: f64,
    ) -> Option<Turned> {
        let most_held_mm = self.share_held * limit_mm;
        for axis in self.directed() {
            let of_program = course.begin.direction[axis];
            let side = self.sides[axis];
            let is_told = !self.gone_mm[axis].is_empty() && of_program != 0.0;
            let play_mm = if is_told { self.play_here_mm(map, course, nodes, axis) } else { 0.0 };
            if is_told && play_mm > most_held_mm {
                self.sides[axis] = side.gone(&self.gone_mm[axis], play_mm, of_program);
            } else if of_program != side.of_program {
                self.sides[axis] = Side::begun(of_program);
            }
            self.gone_mm[axis].clear();
        }
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
        let begins_turned = begins != course.begin.direction;
        let is_as_programmed = !began_turned && !begins_turned && !is_turn && !ends_turned;
        self.arrive(map, course, nodes);
        (!is_as_programmed).then_some(Turned { begins, stretches, is_turn })
    }

    /// The play of an axis where the machine stands before a move; of what is not known of that, where the move goes.
    fn play_here_mm(&self, map: &impl PathMap, course: &Course, nodes: &[Node], axis: usize) -> f64 {
        let Some(first) = nodes.first() else { return 0.0 };
        let here_mm = Known::all(first.command_mm).updated(&self.frame.position_mm);
        play_mm(map, &course.begin, here_mm.numbers(), axis)
    }

    /// The machine stands where the last of a move's nodes puts it: turned axes across their play.
    fn arrive(&mut self, map: &impl PathMap, course: &Course, nodes: &[Node]) {
        let Some(last) = nodes.last() else { return };
        let mut at_mm = last.command_mm;
        for axis in self.directed() {
            let side = self.sides[axis];
            if side.taken_up != side.of_program {
                at_mm[axis] += side.taken_up * play_mm(map, &course.at(1.0), &last.command_mm, axis);
            }
        }
        self.frame.position_mm = at_mm.into();
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
