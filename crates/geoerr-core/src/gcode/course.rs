//! How the axes of a program come to each place: direction, travel since the reversal, speed.
//!
//! The program's own moves count, not what a correction adds to them: an axis that rests keeps its last direction, until
//! its correction turns it ([`Turns`](super::turns::Turns)). Of moves that pass untouched, arcs too, every stroke counts. Before
//! an axis first moves from a known place, and after homing or a line after which it may be anywhere, its direction is
//! not known and counts as 0, so that whatever is proportional to it is left out. Travel counts from the first known motion.
//! With that motion wind-up begins settled, as in a sequence of measured rows: the axis comes from far in its direction.

use super::frame::Mask;
use super::known::Known;
use super::passage::Passage;
use crate::volumetric::{Approach, MAX_WINDUPS, Windup};

/// Motion that is none: rounding of sums of increments.
const STILL_MM: f64 = 1e-9;

const SECONDS_A_MINUTE: f64 = 60.0;

/// The approach along one straight move.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Course {
    /// At its begin: with the directions and speeds of the move itself.
    pub begin: Approach,
    /// Travel of each axis from begin to end.
    pub travel_mm: [f64; 3],
}

impl Course {
    /// At a share of the move, 0 to 1.
    #[inline]
    pub fn at(&self, share: f64) -> Approach {
        let travel_mm = std::array::from_fn(|axis| self.begin.travel_mm[axis] + share * self.travel_mm[axis]);
        Approach { travel_mm, ..self.begin }
    }

    /// From one share of the move to another, by axes of these directions: those that differ have been turned.
    pub fn stretch(&self, from: f64, to: f64, direction: &[f64; 3], windups: &[Windup]) -> Self {
        let mut begin = self.at(from);
        for (axis, direction) in direction.iter().enumerate() {
            if *direction != begin.direction[axis] {
                begin = begin.turned(axis, windups);
            }
        }
        Self { begin, travel_mm: self.travel_mm.map(|travel| (to - from) * travel) }
    }
}

/// Directions and travels as a program goes on.
#[derive(Debug, Clone, Default)]
pub struct Past {
    direction: [f64; 3],
    travel_mm: [f64; 3],
    windups: Vec<Windup>,
    /// As in an [`Approach`].
    left_unwound: [f64; MAX_WINDUPS],
    extremes: Extremes,
}

/// What the motion of a program comes to, by axis: what a model was fitted to may be far from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extremes {
    /// Least travel between two reversals; infinite where there are none.
    pub shortest_stroke_mm: [f64; 3],
    /// Largest speed.
    pub fastest_mm_s: [f64; 3],
}

impl Default for Extremes {
    fn default() -> Self {
        Self { shortest_stroke_mm: [f64::INFINITY; 3], fastest_mm_s: [0.0; 3] }
    }
}

impl Past {
    /// Before a program of a machine with these wind-ups.
    pub fn new(windups: &[Windup]) -> Self {
        Self { windups: windups.to_vec(), ..Self::default() }
    }

    /// A straight move; `speed_mm_min` is 0 where it is not known.
    pub fn straight(&mut self, from_mm: &Known, to_mm: &Known, speed_mm_min: f64) -> Course {
        let moved = |axis: usize| {
            let step_mm = to_mm.numbers()[axis] - from_mm.numbers()[axis];
            if step_mm.is_nan() { 0.0 } else { step_mm }
        };
        let step_mm: [f64; 3] = std::array::from_fn(moved);
        let length_mm = step_mm.iter().map(|step| step * step).sum::<f64>().sqrt();
        let mut course = Course::default();
        for (axis, step) in step_mm.into_iter().enumerate() {
            if step.abs() > STILL_MM {
                self.turn_to(axis, step.signum());
                course.travel_mm[axis] = step.abs();
                let speed = speed_mm_min / SECONDS_A_MINUTE * step / length_mm;
                course.begin.velocity_mm_s[axis] = speed;
                let fastest = &mut self.extremes.fastest_mm_s[axis];
                *fastest = fastest.max(speed.abs());
            }
            course.begin.direction[axis] = self.direction[axis];
            course.begin.travel_mm[axis] = self.travel_mm[axis];
            self.travel_mm[axis] += course.travel_mm[axis];
        }
        course.begin.feed_mm_min = speed_mm_min;
        course.begin.left_unwound = self.left_unwound;
        course
    }

    /// A move that passes untouched, from one place to another.
    pub fn pass(&mut self, passage: &Passage, from_mm: &Known, to_mm: &Known) {
        let still_mm = passage.miss_mm(from_mm, to_mm).max(STILL_MM);
        for (axis, strokes) in passage.strokes(from_mm, to_mm).into_iter().enumerate() {
            let Some(strokes) = strokes else {
                (self.direction[axis], self.travel_mm[axis]) = (0.0, 0.0);
                continue;
            };
            let mut at_mm = from_mm.numbers()[axis];
            for end_mm in strokes {
                let step_mm = end_mm - at_mm;
                if step_mm.abs() > still_mm {
                    self.turn_to(axis, step_mm.signum());
                    self.travel_mm[axis] += step_mm.abs();
                    at_mm = end_mm;
                }
            }
        }
    }

    /// An axis moves in a direction; its travel begins anew where that is another one.
    #[inline]
    fn turn_to(&mut self, axis: usize, direction: f64) {
        if self.direction[axis] != direction {
            self.turn_round(axis);
            (self.direction[axis], self.travel_mm[axis]) = (direction, 0.0);
        }
    }

    /// Ends the stroke of an axis, or begins its first.
    fn turn_round(&mut self, axis: usize) {
        let (is_first, stroke_mm) = (self.direction[axis] == 0.0, self.travel_mm[axis]);
        if !is_first {
            let shortest = &mut self.extremes.shortest_stroke_mm[axis];
            *shortest = shortest.min(stroke_mm);
        }
        for (windup, left) in self.windups.iter().zip(&mut self.left_unwound) {
            if windup.axis == axis {
                *left = if is_first { 1.0 } else { windup.left_by(stroke_mm, *left) };
            }
        }
    }

    /// What the moves so far came to.
    pub fn extremes(&self) -> Extremes {
        self.extremes
    }

    /// These axes have moved in a way that is not known.
    pub fn forget(&mut self, axes: Mask) {
        for axis in (0..3).filter(|&axis| axes[axis]) {
            (self.direction[axis], self.travel_mm[axis]) = (0.0, 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gcode::passage::{Arc, Centre};

    #[test]
    fn wind_up_is_carried_from_stroke_to_stroke() {
        let windups = [Windup { axis: 0, length_mm: 4.0 }, Windup { axis: 1, length_mm: 1.0 }];
        let mut past = Past::new(&windups);
        let at = |x: f64| Known::from([Some(x), Some(0.0), Some(0.0)]);
        // The recursion of rows: w = −d/2 + (w_rev + d/2)e^(−s/λ), from w = −d/2.
        let (mut before, mut d, mut s, mut w_rev, mut w) = (0.0_f64, 1.0, 0.0, -0.5, -0.5);
        for place in [3.0, 1.0, 1.5, 2.0, -9.0, -8.0, -8.5] {
            let step: f64 = place - before;
            if step.signum() != d {
                (d, s, w_rev) = (step.signum(), 0.0, w);
            }
            s += step.abs();
            w = -0.5 * d + (w_rev + 0.5 * d) * (-s / 4.0).exp();
            let end = past.straight(&at(before), &at(place), 0.0).at(1.0);
            let told = -0.5 * d + d * (1.0 - end.left_unwound[0]) * (-end.travel_mm[0] / 4.0).exp();
            assert!((told - w).abs() < 1e-15, "{place}: {told} and {w}");
            before = place;
        }
        // What has moved in a way that is not known begins settled again; y never moved.
        past.forget([true, false, false]);
        assert_eq!(past.straight(&at(-8.5), &at(-8.0), 0.0).begin.left_unwound[..2], [1.0, 0.0]);
    }

    #[test]
    fn what_is_wound_up_stays_where_a_correction_turns_an_axis() {
        let windups = [Windup { axis: 0, length_mm: 4.0 }, Windup { axis: 1, length_mm: 1.0 }];
        let begin = Approach {
            direction: [1.0, -1.0, 1.0],
            travel_mm: [2.0, 3.0, 0.0],
            left_unwound: [0.3, 0.6, 0.0, 0.0, 0.0, 0.0],
            ..Approach::default()
        };
        let course = Course { begin, travel_mm: [5.0, 0.0, 0.0] };
        let wound = |at: &Approach| {
            let (d, s, g) = (at.direction[0], at.travel_mm[0], at.left_unwound[0]);
            -0.5 * d + d * (1.0 - g) * (-s / 4.0).exp()
        };
        let stretch = course.stretch(0.2, 0.6, &[-1.0, -1.0, 1.0], &windups);
        assert_eq!(stretch.begin.direction, [-1.0, -1.0, 1.0]);
        assert_eq!(stretch.begin.travel_mm, [0.0, 3.0, 0.0]);
        assert!((wound(&stretch.begin) - wound(&course.at(0.2))).abs() < 1e-15);
        assert!((stretch.travel_mm[0] - 2.0).abs() < 1e-15);
        assert_eq!(stretch.begin.left_unwound[1], 0.6);
        assert_eq!(course.stretch(0.0, 1.0, &begin.direction, &windups), course);
    }

    #[test]
    fn an_arc_that_passes_is_a_stroke_behind_another() {
        let half = |end: f64| {
            let arc =
                Arc { plane: [0, 1], is_clockwise: false, centre: Centre::At([0.0; 2]), is_whole: false };
            let (from, to) = (Known::all([0.0, -5.0, 1.0]), Known::all([0.0, end, 1.0]));
            let mut past = Past::default();
            past.straight(&Known::all([0.0, -5.0, 0.0]), &from, 0.0);
            past.pass(&Passage::Arc(arc), &from, &to);
            past.straight(&to, &to, 0.0)
        };
        // Over x = 5 and back; z rests. Where the arc misses its end by a thousandth, y has not turned there.
        for end in [5.0, 4.999] {
            assert_eq!(half(end).begin.direction, [-1.0, 1.0, 1.0]);
            assert!((half(end).begin.travel_mm[0] - 5.0).abs() < 2e-3);
            assert!((half(end).begin.travel_mm[1] - 10.0).abs() < 2e-3);
        }
        let mut past = Past::default();
        past.straight(&Known::all([0.0; 3]), &Known::all([1.0; 3]), 0.0);
        past.pass(&Passage::Unknown, &Known::all([1.0; 3]), &Known::all([2.0; 3]));
        let at = Known::all([2.0; 3]);
        assert_eq!(past.straight(&at, &at, 0.0).begin, Approach::default());
    }

    #[test]
    fn there_and_back_by_hand() {
        let mut past = Past::default();
        let at = |x: f64, y: f64| Known::from([Some(x), Some(y), None]);
        let first = past.straight(&at(0.0, 0.0), &at(3.0, 4.0), 600.0);
        assert_eq!(first.begin.direction, [1.0, 1.0, 0.0]);
        assert_eq!(first.begin.travel_mm, [0.0; 3]);
        assert_eq!(first.begin.velocity_mm_s, [6.0, 8.0, 0.0]);
        assert_eq!(first.at(0.5).travel_mm, [1.5, 2.0, 0.0]);
        let second = past.straight(&at(3.0, 4.0), &at(1.0, 4.0), 60.0);
        assert_eq!(second.begin.direction, [-1.0, 1.0, 0.0], "y rests and keeps its direction");
        assert_eq!(second.begin.travel_mm, [0.0, 4.0, 0.0]);
        assert_eq!(second.at(1.0).travel_mm, [2.0, 4.0, 0.0]);
        assert_eq!(past.extremes().shortest_stroke_mm, [3.0, f64::INFINITY, f64::INFINITY]);
        assert_eq!(past.extremes().fastest_mm_s, [6.0, 8.0, 0.0]);
        past.forget([true, false, false]);
        let third = past.straight(&[None, Some(4.0), None].into(), &at(9.0, 5.0), 0.0);
        assert_eq!(third.begin.direction, [0.0, 1.0, 0.0]);
        assert_eq!(third.begin.velocity_mm_s, [0.0; 3]);
        assert_eq!(third.at(1.0).travel_mm, [0.0, 5.0, 0.0]);
        // It moved in a way that is not known: how far before this reversal nobody knows.
        past.straight(&at(9.0, 5.0), &at(8.0, 5.0), 0.0);
        assert_eq!(past.extremes().shortest_stroke_mm, [3.0, f64::INFINITY, f64::INFINITY]);
    }
}
