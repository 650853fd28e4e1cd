//! Straight moves through a machine that bends them: where to split so that the path stays straight enough.

use super::course::Course;
use crate::kinematics::{Axis, MachineModel};
use crate::newton::{ErrorMap, NewtonError, command_for};
use crate::volumetric::{Approach, MotionNeeds, Windup};

/// What compensation needs to know of a machine. Positions are those of a machine without errors: a tool position
/// less the tool offset.
pub trait PathMap: Sync {
    /// The command that puts the tool where a machine without errors would have it at `ideal_mm`.
    ///
    /// # Errors
    /// The distance that the best command leaves, mm; NaN where the model gives none.
    fn command_for(
        &self,
        ideal_mm: &[f64; 3],
        approach: &Approach,
        tolerance_mm: f64,
    ) -> Result<[f64; 3], f64>;

    /// Where `command_mm` puts the tool.
    fn actual(&self, command_mm: &[f64; 3], approach: &Approach) -> [f64; 3];

    /// [`actual`](Self::actual) of two commands with no knot between them: one question for both, where that is quicker.
    #[inline]
    fn actual_of_two(&self, commands_mm: &[[f64; 3]; 2], approaches: &[Approach; 2]) -> [[f64; 3]; 2] {
        [0, 1].map(|which| self.actual(&commands_mm[which], &approaches[which]))
    }

    /// Actual less commanded, of an approach that is none, at each place of a lattice, the first coordinate running fastest.
    fn errors_of_lattice<const N: usize>(&self, at_mm: &[[f64; N]; 3]) -> Vec<[f64; 3]> {
        let error = |place: usize| -> [f64; 3] {
            let k = [place % N, place / N % N, place / (N * N)];
            let command_mm = std::array::from_fn(|axis| at_mm[axis][k[axis]]);
            let actual_mm = self.actual(&command_mm, &Approach::default());
            std::array::from_fn(|axis| actual_mm[axis] - command_mm[axis])
        };
        (0..N * N * N).map(error).collect()
    }

    /// Coordinates of `axis` (0 to 2) between which [`actual`](Self::actual) is smooth, increasing.
    fn knots(&self, axis: usize) -> &[f64];

    /// Whether the machine has no errors.
    fn is_nominal(&self) -> bool;

    /// A piece with more crossings of knots than this is halved where it is over the limit, not cut where it is worst: a
    /// wave is as bad at each of its crests, and looking for the worst again and again costs the square of their number.
    fn most_crossings(&self) -> usize {
        usize::MAX
    }

    /// What of an approach the errors depend on.
    fn needs(&self) -> MotionNeeds {
        MotionNeeds::default()
    }

    /// The wind-ups that an approach tells what strokes before left of.
    fn windups(&self) -> &[Windup] {
        &[]
    }
}

/// The command of a map for a place; else the distance that the best command leaves.
pub(super) fn inverse_of(
    map: &impl ErrorMap,
    ideal_mm: &[f64; 3],
    tolerance_mm: f64,
) -> Result<[f64; 3], f64> {
    match command_for(map, ideal_mm, tolerance_mm) {
        Ok(solution) => Ok(solution.command_mm),
        Err(NewtonError::NotConverged { remaining_mm, .. }) => Err(remaining_mm),
        Err(NewtonError::NonFinite | NewtonError::Tolerance { .. }) => Err(f64::NAN),
    }
}

impl PathMap for MachineModel {
    fn command_for(&self, ideal_mm: &[f64; 3], _: &Approach, tolerance_mm: f64) -> Result<[f64; 3], f64> {
        inverse_of(self, ideal_mm, tolerance_mm)
    }

    #[inline]
    fn actual(&self, command_mm: &[f64; 3], _: &Approach) -> [f64; 3] {
        let error_mm = self.error(command_mm, &[0.0; 3]);
        std::array::from_fn(|axis| command_mm[axis] + error_mm[axis])
    }

    fn errors_of_lattice<const N: usize>(&self, at_mm: &[[f64; N]; 3]) -> Vec<[f64; 3]> {
        MachineModel::errors_of_lattice(self, at_mm)
    }

    #[inline]
    fn knots(&self, axis: usize) -> &[f64] {
        MachineModel::knots(self, Axis::ALL[axis])
    }

    fn is_nominal(&self) -> bool {
        MachineModel::is_nominal(self)
    }
}

/// A point of a move: ideal position and the command that reaches it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Share of the move's length that lies behind it, 0 to 1.
    pub share: f64,
    /// Where the tool should be.
    pub ideal_mm: [f64; 3],
    /// What to command.
    pub command_mm: [f64; 3],
}

/// Travel behind a reversal, in lengths of a wind-up, between which e^(−travel/length) is followed as a parabola.
const WINDINGS: [f64; 9] = [0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0];

/// How closely to follow.
#[derive(Clone, Copy, Debug)]
pub struct Closeness {
    /// Largest distance of actual and ideal tool position at the same share of the move.
    pub limit_mm: f64,
    /// Remaining error of a solved command.
    pub newton_mm: f64,
    /// No piece is made shorter.
    pub shortest_mm: f64,
}

/// Why a move cannot be split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SplitError {
    /// No command found; the distance that the best one leaves.
    NotSolved(f64),
    /// The shortest piece deviates by this much.
    NotHeld(f64),
}

/// The nodes behind `start` at which the move has to be commanded, `end` the last; None where `end` is enough.
///
/// `crossings` is memory that calls share.
///
/// `start` may be commanded for another approach (that of the move before): what it is off by is part of the first
/// piece's deviation, as long as it is below half of the limit; a larger jump begins with a node of share 0 that
/// commands the start anew.
///
/// The deviation of a piece is the distance between the actual tool position and the ideal one *at the same share of
/// the move*. It is never smaller than the distance from the ideal line, so the path is within the tolerance either
/// way; and it also keeps the tool, and what it deposits or cuts, at the right place along the line.
///
/// Tables are straight between knots, so the deviation along a piece is smooth between the places where a commanded
/// axis crosses a knot, and there all but quadratic (a rotation that changes evenly times a lever that does): its ends
/// `d_0, d_1` and its middle `d_m` bound it by `max(|d_0|, |d_m|, |d_1|) + |d_m − (d_0 + d_1)/2| / 4`.
/// A piece over the limit is split where the deviation is largest. (Where a machine has a `Grid`, its boxes are asked first:
/// `Grid::walk`.)
///
/// # Errors
/// [`SplitError::NotSolved`] where a node has no command; [`SplitError::NotHeld`] where the shortest pieces deviate.
///
/// # Source
/// Li et al. 2023, Eqs. 24 to 27, for each node; the splitting and its bound are geoerr's own.
///
/// # Verified by
/// `tests/gcode/round_trip.rs` (paths of drawn programs on four chains, 51 samples a piece, within tolerances of 1 to
/// 20 µm) and, by a second reader, on the programs of real slicers (`tests/compensate/test_real_programs.py`).
pub fn split(
    map: &impl PathMap,
    course: &Course,
    start: &Node,
    end: &Node,
    closeness: &Closeness,
    crossings: &mut Vec<f64>,
) -> Result<Option<Vec<Node>>, SplitError> {
    if map.is_nominal() {
        return Ok(None);
    }
    let on = Moved { map, course, is_still: !map.needs().any() };
    let mut pieces = Vec::new();
    let mut start = start;
    let anew;
    let mut at_start = [0.0; 3];
    if map.needs().any() {
        at_start = on.deviation(start, end, 0.0);
        // A jump that is not a number is refused below, with the path.
        if norm(&at_start) > 0.5 * closeness.limit_mm {
            anew = on.solved(start, end, 0.0, closeness.newton_mm)?;
            start = &anew;
            at_start = [0.0; 3];
            pieces.push(anew);
        }
    }
    let Some(first) = on.worst(start, end, at_start, closeness.limit_mm, crossings) else {
        if !pieces.is_empty() {
            pieces.push(*end);
        }
        return Ok((!pieces.is_empty()).then_some(pieces));
    };
    let length_mm = distance(&start.ideal_mm, &end.ideal_mm);
    let mut ahead = vec![*end];
    let mut from = *start;
    let mut over = Some(first);
    while let Some(to) = ahead.last() {
        match over {
            None => {
                from = *to;
                pieces.push(from);
                ahead.pop();
                at_start = [0.0; 3];
            }
            Some(Worst { deviation_mm, at }) => {
                if (to.share - from.share) * length_mm < 2.0 * closeness.shortest_mm {
                    return Err(SplitError::NotHeld(deviation_mm));
                }
                let share = from.share + at * (to.share - from.share);
                ahead.push(on.solved(start, end, share, closeness.newton_mm)?);
            }
        }
        over = ahead.last().and_then(|to| on.worst(&from, to, at_start, closeness.limit_mm, crossings));
    }
    Ok(Some(pieces))
}

/// The place of a piece where it is furthest off.
#[derive(Clone, Copy, Debug)]
struct Worst {
    deviation_mm: f64,
    /// Share of the piece, strictly between 0 and 1.
    at: f64,
}

/// A machine on its way along one move. Nodes' shares are those of the move.
struct Moved<'a, M> {
    map: &'a M,
    course: &'a Course,
    /// Whether the approach does not matter.
    is_still: bool,
}

impl<M: PathMap> Moved<'_, M> {
    /// Where the piece has to be split; None where it stays within the limit. `at_start` is its begin's deviation.
    fn worst(
        &self,
        from: &Node,
        to: &Node,
        at_start: [f64; 3],
        limit_mm: f64,
        crossings: &mut Vec<f64>,
    ) -> Option<Worst> {
        knot_crossings(self.map, from, to, crossings);
        self.windings(from, to, crossings);
        crossings.push(1.0);
        let mut over: Option<Worst> = None;
        let mut largest_mm = limit_mm;
        let halves = crossings.len() > self.map.most_crossings();
        // The ends are solved: what remains there is orders below the limit.
        let mut left = 0.0;
        let mut at_left = at_start;
        for &right in crossings.iter() {
            let middle = 0.5 * (left + right);
            let [at_middle, at_right] = if right < 1.0 {
                self.deviation_of_two(from, to, [middle, right])
            } else {
                [self.deviation(from, to, middle), [0.0; 3]]
            };
            let bend: [f64; 3] = std::array::from_fn(|c| at_middle[c] - 0.5 * (at_left[c] + at_right[c]));
            let squares = [square(&at_left), square(&at_middle), square(&at_right)];
            let bound_mm = squares[0].max(squares[1]).max(squares[2]).sqrt() + 0.25 * square(&bend).sqrt();
            if bound_mm > largest_mm || bound_mm.is_nan() {
                largest_mm = bound_mm;
                if halves {
                    return Some(Worst { deviation_mm: bound_mm, at: crossings[crossings.len() / 2] });
                }
                let at = if right < 1.0 && squares[2] > squares[1] { right } else { middle };
                over = Some(Worst { deviation_mm: bound_mm, at });
            }
            (left, at_left) = (right, at_right);
        }
        over
    }

    /// Adds the shares of the piece between which what winds up behind a reversal is all but a parabola.
    fn windings(&self, from: &Node, to: &Node, crossings: &mut Vec<f64>) {
        let n_knots = crossings.len();
        for windup in self.map.windups() {
            let (gone_mm, travel_mm) =
                (self.course.begin.travel_mm[windup.axis], self.course.travel_mm[windup.axis]);
            for lengths in WINDINGS {
                let of_move = (lengths * windup.length_mm - gone_mm) / travel_mm;
                let share = (of_move - from.share) / (to.share - from.share);
                if (1e-9..=1.0 - 1e-9).contains(&share) {
                    crossings.push(share);
                }
            }
        }
        if crossings.len() > n_knots {
            crossings.sort_by(f64::total_cmp);
        }
    }

    /// Actual minus ideal tool position at a share of a piece.
    #[inline]
    fn deviation(&self, from: &Node, to: &Node, share: f64) -> [f64; 3] {
        let approach = self.approach(from, to, share);
        let actual = self.map.actual(&between(&from.command_mm, &to.command_mm, share), &approach);
        off(&actual, from, to, share)
    }

    /// The same at two shares that no knot is between.
    #[inline]
    fn deviation_of_two(&self, from: &Node, to: &Node, shares: [f64; 2]) -> [[f64; 3]; 2] {
        let commands_mm = shares.map(|share| between(&from.command_mm, &to.command_mm, share));
        let approaches = shares.map(|share| self.approach(from, to, share));
        let [one, other] = self.map.actual_of_two(&commands_mm, &approaches);
        [off(&one, from, to, shares[0]), off(&other, from, to, shares[1])]
    }

    #[inline]
    fn approach(&self, from: &Node, to: &Node, share: f64) -> Approach {
        if self.is_still {
            return Approach::default();
        }
        self.course.at(from.share + share * (to.share - from.share))
    }

    /// A node of the move that is commanded for its own approach.
    fn solved(&self, start: &Node, end: &Node, share: f64, newton_mm: f64) -> Result<Node, SplitError> {
        let ideal_mm = between(&start.ideal_mm, &end.ideal_mm, share);
        let approach = self.course.at(share);
        let command_mm =
            self.map.command_for(&ideal_mm, &approach, newton_mm).map_err(SplitError::NotSolved)?;
        Ok(Node { share, ideal_mm, command_mm })
    }
}

/// Shares of the piece at which a commanded axis crosses a knot, increasing.
fn knot_crossings(map: &impl PathMap, from: &Node, to: &Node, crossings: &mut Vec<f64>) {
    crossings.clear();
    for axis in 0..3 {
        let (begin, end) = (from.command_mm[axis], to.command_mm[axis]);
        let (low, high) = if begin < end { (begin, end) } else { (end, begin) };
        let knots = map.knots(axis);
        let first = knots.partition_point(|&knot| knot <= low);
        let crossed = knots[first..].iter().take_while(|&&knot| knot < high);
        crossings.extend(crossed.map(|knot| (knot - begin) / (end - begin)));
    }
    // Crossings at the very ends say nothing that the ends do not.
    crossings.retain(|share| (1e-9..=1.0 - 1e-9).contains(share));
    crossings.sort_by(f64::total_cmp);
}

/// The place at a share of the way from one to another.
#[inline]
pub fn between(a: &[f64; 3], b: &[f64; 3], share: f64) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] + share * (b[axis] - a[axis]))
}

/// An actual tool position less the ideal one at a share of a piece.
#[inline]
fn off(actual: &[f64; 3], from: &Node, to: &Node, share: f64) -> [f64; 3] {
    let ideal = between(&from.ideal_mm, &to.ideal_mm, share);
    std::array::from_fn(|axis| actual[axis] - ideal[axis])
}

/// Distance of two points, mm.
pub fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    norm(&[a[0] - b[0], a[1] - b[1], a[2] - b[2]])
}

/// Length of a vector.
#[inline]
pub fn norm(v: &[f64; 3]) -> f64 {
    square(v).sqrt()
}

/// Its square.
#[inline]
pub fn square(v: &[f64; 3]) -> f64 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::{Chain, Component, ErrorTables, Squareness, Table};

    fn machine(errors: ErrorTables) -> MachineModel {
        MachineModel::new(Chain::parse("wbXYZt").unwrap(), errors, [1.0, 2.0, -3.0])
    }

    fn node(map: &impl PathMap, share: f64, ideal_mm: [f64; 3]) -> Node {
        Node { share, ideal_mm, command_mm: map.command_for(&ideal_mm, &Approach::default(), 1e-7).unwrap() }
    }

    const CLOSE: Closeness = Closeness { limit_mm: 0.005, newton_mm: 1e-7, shortest_mm: 1e-3 };

    #[test]
    fn squareness_alone_bends_nothing() {
        let mut errors = ErrorTables::default();
        errors
            .set_squareness(Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 })
            .unwrap();
        let map = machine(errors);
        let (start, end) = (node(&map, 0.0, [0.0; 3]), node(&map, 1.0, [400.0, 300.0, 200.0]));
        assert_eq!(split(&map, &Course::default(), &start, &end, &CLOSE, &mut Vec::new()), Ok(None));
    }

    #[test]
    fn a_kink_is_split_at_the_kink() {
        let mut errors = ErrorTables::default();
        errors.set(Axis::X, Component::Y, Table::new(vec![0.0, 100.0, 400.0], vec![0.0, 0.5, -0.2]).unwrap());
        let map = machine(errors);
        let (start, end) = (node(&map, 0.0, [0.0; 3]), node(&map, 1.0, [400.0, 0.0, 0.0]));
        let pieces = split(&map, &Course::default(), &start, &end, &CLOSE, &mut Vec::new()).unwrap().unwrap();
        assert_eq!(pieces.len(), 2);
        assert!((pieces[0].share - 0.25).abs() < 1e-12, "{}", pieces[0].share);
        assert_eq!(pieces[1], end);
    }

    #[test]
    fn what_no_piece_can_follow_is_said() {
        // A step of a millimetre within a micrometre of travel.
        let mut errors = ErrorTables::default();
        errors.set(
            Axis::X,
            Component::Y,
            Table::new(vec![0.0, 100.0, 100.001, 200.0], vec![0.0, 0.0, 1.0, 1.0]).unwrap(),
        );
        let map = machine(errors);
        let (start, end) = (node(&map, 0.0, [0.0; 3]), node(&map, 1.0, [200.0, 0.0, 0.0]));
        let close = Closeness { limit_mm: 1e-6, shortest_mm: 0.1, ..CLOSE };
        match split(&map, &Course::default(), &start, &end, &close, &mut Vec::new()) {
            Ok(None) => panic!("a step is no straight line"),
            Ok(Some(pieces)) => {
                let on = Moved { map: &map, course: &Course::default(), is_still: true };
                let mut from = start;
                for piece in pieces {
                    for i in 0..=100 {
                        assert!(norm(&on.deviation(&from, &piece, f64::from(i) * 0.01)) < 1e-6);
                    }
                    from = piece;
                }
            }
            Err(error) => assert!(matches!(error, SplitError::NotHeld(_))),
        }
    }
}
