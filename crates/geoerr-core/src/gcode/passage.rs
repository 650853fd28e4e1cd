//! The ways of moves that pass untouched: where each axis turns on them, and so from where it comes behind them.

use std::f64::consts::{PI, TAU};

use super::known::Known;

/// Places that differ by less are the same: rounding of sums of increments.
const SAME_MM: f64 = 1e-9;

/// An arc turns by less than a whole circle and a half.
const MOST_HALF_TURNS: u32 = 4;

/// Each has the place where an axis turns closer by the share of the radius by which it grows in a radian.
const STEPS_TO_TURN: usize = 4;

/// Places by which an axis goes one way after the other, the last of them its end; None where they are not known.
pub type Strokes = Option<Vec<f64>>;

/// How an untouched move gets to its end.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Passage {
    /// No axis turns.
    #[default]
    Straight,
    /// Two of them may.
    Arc(Arc),
    /// Nobody knows.
    Unknown,
}

impl Passage {
    /// Those of each axis, of a move from one place to another.
    pub fn strokes(&self, from_mm: &Known, to_mm: &Known) -> [Strokes; 3] {
        let straight = |axis: usize| from_mm.get(axis).and(to_mm.get(axis)).map(|end_mm| vec![end_mm]);
        match self {
            Self::Unknown => [const { None }; 3],
            Self::Straight => std::array::from_fn(straight),
            Self::Arc(arc) => {
                let mut strokes = std::array::from_fn(straight);
                for (of_plane, axis) in arc.plane.into_iter().enumerate() {
                    strokes[axis] = arc.turn(from_mm, to_mm).map(|turn| turn.strokes(of_plane));
                }
                strokes
            }
        }
    }

    /// The same, of a whole circle where an arc ends where it begins.
    pub fn between(self, from_mm: &Known, to_mm: &Known) -> Self {
        let Self::Arc(arc) = self else { return self };
        let is_there = |axis: usize| (from_mm.numbers()[axis] - to_mm.numbers()[axis]).abs() <= SAME_MM;
        Self::Arc(Arc { is_whole: arc.plane.into_iter().all(is_there), ..arc })
    }

    /// By how much the ends of a move miss its arc: shorter strokes are rounding.
    pub fn miss_mm(&self, from_mm: &Known, to_mm: &Known) -> f64 {
        let Self::Arc(arc) = self else { return 0.0 };
        arc.turn(from_mm, to_mm).map_or(0.0, |turn| (turn.radii_mm[1] - turn.radii_mm[0]).abs())
    }
}

/// Where the centre of an arc is, in its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Centre {
    /// From its begin.
    FromBegin([f64; 2]),
    /// Machine coordinates.
    At([f64; 2]),
    /// So far from both ends; of the longer way round below 0.
    Radius(f64),
}

/// An arc, or a helix, as its line tells it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc {
    /// Axes of its plane: from the first to the second it turns counter-clockwise.
    pub plane: [usize; 2],
    /// `G2`.
    pub is_clockwise: bool,
    /// Its centre.
    pub centre: Centre,
    /// Whether it is a whole circle of the program: one that begins where a correction has put the machine ends beside its
    /// begin.
    pub is_whole: bool,
}

/// An arc between two places. Where their distances from the centre differ, the radius goes evenly from one to the other.
struct Turn {
    end_mm: [f64; 2],
    centre_mm: [f64; 2],
    radii_mm: [f64; 2],
    /// Angle at which it begins, and by which it turns; below 0 of `G2`.
    begin_rad: f64,
    turn_rad: f64,
}

impl Arc {
    fn turn(&self, from_mm: &Known, to_mm: &Known) -> Option<Turn> {
        let in_plane = |place: &Known| -> Option<[f64; 2]> {
            Some([place.get(self.plane[0])?, place.get(self.plane[1])?])
        };
        let (begin_mm, end_mm) = (in_plane(from_mm)?, in_plane(to_mm)?);
        let sense = if self.is_clockwise { -1.0 } else { 1.0 };
        let centre_mm = match self.centre {
            Centre::FromBegin(offset_mm) => [begin_mm[0] + offset_mm[0], begin_mm[1] + offset_mm[1]],
            Centre::At(centre_mm) => centre_mm,
            Centre::Radius(radius_mm) => centre_by_radius(begin_mm, end_mm, sense * radius_mm)?,
        };
        let [from, to] = [begin_mm, end_mm].map(|at| [at[0] - centre_mm[0], at[1] - centre_mm[1]]);
        let [begin_rad, end_rad] = [from, to].map(|[x, y]| y.atan2(x));
        let way_rad = (sense * (end_rad - begin_rad)).rem_euclid(TAU);
        let more_rad = if self.is_whole && way_rad < PI { TAU } else { 0.0 };
        let radii_mm = [from, to].map(|[x, y]| x.hypot(y));
        Some(Turn { end_mm, centre_mm, radii_mm, begin_rad, turn_rad: sense * (way_rad + more_rad) })
    }
}

/// The centre of an arc by its radius, which counts from the left of its chord.
fn centre_by_radius(begin_mm: [f64; 2], end_mm: [f64; 2], radius_mm: f64) -> Option<[f64; 2]> {
    let half_mm = [0, 1].map(|k| 0.5 * (end_mm[k] - begin_mm[k]));
    let length_mm = half_mm[0].hypot(half_mm[1]);
    let rise_mm = (radius_mm * radius_mm - length_mm * length_mm).max(0.0).sqrt();
    let rise = rise_mm.copysign(radius_mm) / length_mm;
    let centre_mm =
        [begin_mm[0] + half_mm[0] - rise * half_mm[1], begin_mm[1] + half_mm[1] + rise * half_mm[0]];
    (length_mm > 0.0).then_some(centre_mm)
}

impl Turn {
    /// Those of an axis of its plane, by its number there.
    fn strokes(&self, of_plane: usize) -> Vec<f64> {
        let sense = self.turn_rad.signum();
        let (way_rad, wider_mm) = (self.turn_rad.abs(), self.radii_mm[1] - self.radii_mm[0]);
        // From where the axis is highest, in the arc's sense.
        let begin_rad = sense * (self.begin_rad - 0.5 * PI * of_plane as f64);
        let radius_at = |angle_rad: f64| self.radii_mm[0] + wider_mm * (angle_rad - begin_rad) / way_rad;
        let mut strokes = Vec::new();
        for half_turn in 0..=MOST_HALF_TURNS {
            let circles_rad = ((begin_rad / PI).floor() + f64::from(half_turn)) * PI;
            // An axis of a circle turns there; where the radius grows, a little behind.
            let mut angle_rad = circles_rad;
            for _ in 0..STEPS_TO_TURN {
                angle_rad = circles_rad + (wider_mm / way_rad / radius_at(angle_rad)).atan();
            }
            if angle_rad > begin_rad && angle_rad < begin_rad + way_rad {
                strokes.push(self.centre_mm[of_plane] + radius_at(angle_rad) * angle_rad.cos());
            }
        }
        strokes.push(self.end_mm[of_plane]);
        strokes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known(x: f64, y: f64, z: f64) -> Known {
        Known::all([x, y, z])
    }

    fn arc(is_clockwise: bool, centre: Centre) -> Arc {
        Arc { plane: [0, 1], is_clockwise, centre, is_whole: false }
    }

    fn near(strokes: &Strokes, expected: &[f64]) {
        let strokes = strokes.as_ref().unwrap();
        assert_eq!(strokes.len(), expected.len(), "{strokes:?}");
        assert!(strokes.iter().zip(expected).all(|(one, other)| (one - other).abs() < 1e-9), "{strokes:?}");
    }

    #[test]
    fn an_axis_turns_where_it_is_farthest() {
        let (from, to) = (known(13.0, 4.0, 1.0), known(7.0, 4.0, 2.0));
        // A circle of 5 about (10, 0): over its top, and round its other side.
        for (is_clockwise, x, y) in
            [(false, &[7.0][..], &[5.0, 4.0][..]), (true, &[15.0, 5.0, 7.0], &[-5.0, 4.0])]
        {
            let sign = if is_clockwise { -1.0 } else { 1.0 };
            for centre in
                [Centre::FromBegin([-3.0, -4.0]), Centre::At([10.0, 0.0]), Centre::Radius(5.0 * sign)]
            {
                let passage = Passage::Arc(arc(is_clockwise, centre));
                let [of_x, of_y, of_z] = passage.strokes(&from, &to);
                near(&of_x, x);
                near(&of_y, y);
                near(&of_z, &[2.0]);
                assert!(passage.miss_mm(&from, &to) < 1e-12);
            }
        }
        let unknown = [Some(1.0), None, Some(2.0)].into();
        let passage = Passage::Arc(arc(false, Centre::FromBegin([-3.0, -4.0])));
        assert_eq!(passage.strokes(&from, &unknown), [None, None, Some(vec![2.0])]);
        assert_eq!(Passage::Straight.strokes(&from, &unknown), [Some(vec![1.0]), None, Some(vec![2.0])]);
        assert_eq!(Passage::Unknown.strokes(&from, &to), [None, None, None]);
    }

    #[test]
    fn a_whole_circle_of_the_program_is_one_from_beside_its_begin() {
        let (place, corrected) = (known(3.0, 4.0, 0.0), known(3.01, 4.02, 0.0));
        for is_clockwise in [false, true] {
            let arc = Passage::Arc(arc(is_clockwise, Centre::FromBegin([-3.0, -4.0])));
            let passage = arc.between(&place, &place);
            assert_ne!(passage, arc);
            let (first, second) = if is_clockwise { (5.0, -5.0) } else { (-5.0, 5.0) };
            near(&passage.strokes(&place, &place)[0], &[first, second, 3.0]);
            let [of_x, ..] = passage.strokes(&corrected, &place);
            assert_eq!(of_x.map(|strokes| strokes.len()), Some(3));
            assert_eq!(passage.between(&corrected, &place), arc);
        }
    }

    #[test]
    fn planes_turn_from_their_first_axis_to_their_second() {
        // G18: from Z to X.
        let zx = Arc { plane: [2, 0], ..arc(false, Centre::FromBegin([-2.0, 0.0])) };
        let [of_x, of_y, of_z] = Passage::Arc(zx).strokes(&known(0.0, 0.0, 2.0), &known(0.0, 3.0, -2.0));
        near(&of_x, &[2.0, 0.0]);
        near(&of_y, &[3.0]);
        near(&of_z, &[-2.0]);
    }
}
