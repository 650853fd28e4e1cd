//! A long move from box to box: where to cut it, by one command at each face on its way.
//!
//! [`split`](crate::gcode::path::split) looks at each half of what it cuts again, place by place. In a grid that is not
//! needed: in a box the correction is a polynomial, of which the box says how much it bends, so that the commands at the
//! faces tell how far off any piece between two of them is.

use super::super::patch::{Patch, STEEPEST};
use super::super::path::{Closeness, Node, PathMap, between, distance, norm};
use super::{Grid, Home, Near, Solved};
use crate::arithmetic::{Arithmetic, Kernel, run_widest};

/// The tool is off by at most so much more than its command, as errors change by less than that.
const TOOL_PER_COMMAND: f64 = 1.0 + STEEPEST;

/// Where the way bends out of a box, the next one's correction changes by less than twice the steepest otherwise.
const BEYOND: f64 = 1.0 + 2.0 * STEEPEST;

/// A move through more boxes is left to [`split`](crate::gcode::path::split).
const MOST_BOXES: usize = 256;

/// So does one that would need more pieces than this in one box.
const MOST_PARTS: f64 = 32.0;

/// What is left of a cubic beside the quadratic through its ends and its middle, at most: third derivative times length
/// cubed by this, `72 √3`.
const CUBIC: f64 = 124.707_658_144_959_16;

/// Faces nearer to each other, or to an end, than this share of the move are one place.
const LEAST_SHARE: f64 = 1e-9;

/// What is known of a move on its way. Memory that calls share.
#[derive(Debug, Default)]
pub struct Walk {
    stops: Vec<Stop>,
    pieces: Vec<Node>,
}

/// A place on the way, and the command for it.
#[derive(Clone, Copy, Debug)]
struct Stop {
    node: Node,
    home: u32,
    /// Command less ideal.
    correction_mm: [f64; 3],
    /// By how much, at most, the correction leaves the straight line to the next stop.
    bulge_mm: f64,
}

impl Grid {
    /// The nodes at which a move between two solved places has to be commanded, its end the last, so that the tool stays
    /// within the limit of where it should be at each share; None where boxes do not tell.
    ///
    /// A piece from one stop to another is commanded along the straight line between their corrections. At the stops on
    /// its way their own corrections tell how far that line is off; between two of them it is off by no more than the
    /// larger one of both and the bulge. Each piece reaches as far as it may.
    pub fn walk<'a, 'w>(
        &'a self,
        map: &impl PathMap,
        begin: &Solved,
        end: &Solved,
        closeness: &Closeness,
        near: &mut Near<'a>,
        walk: &'w mut Walk,
    ) -> Option<&'w [Node]> {
        let most_mm = closeness.limit_mm / TOOL_PER_COMMAND - 2.0 * closeness.newton_mm;
        let way = OnTheWay { grid: self, map, begin: &begin.node, end };
        run_widest(Finding { way, begin, near, stops: &mut walk.stops, most_mm })?;
        let (stops, pieces) = (&walk.stops, &mut walk.pieces);
        pieces.clear();
        let (mut from, last) = (0, stops.len() - 1);
        while from < last {
            let to = furthest(stops, from, most_mm)?;
            let length_mm = distance(&stops[from].node.ideal_mm, &stops[to].node.ideal_mm);
            if to < last && length_mm < closeness.shortest_mm {
                return None;
            }
            pieces.push(stops[to].node);
            from = to;
        }
        Some(pieces)
    }
}

struct Finding<'a, 'm, M> {
    way: OnTheWay<'a, 'm, M>,
    begin: &'m Solved,
    near: &'m mut Near<'a>,
    stops: &'m mut Vec<Stop>,
    most_mm: f64,
}

impl<M: PathMap> Kernel for Finding<'_, '_, M> {
    type Output = Option<()>;

    #[inline(always)]
    fn run<A: Arithmetic>(self) -> Option<()> {
        self.way.find::<A>(self.begin, self.near, self.stops, self.most_mm)
    }
}

/// A move whose stops are being found.
struct OnTheWay<'a, 'm, M> {
    grid: &'a Grid,
    map: &'m M,
    begin: &'m Node,
    end: &'m Solved,
}

impl<'a, M: PathMap> OnTheWay<'a, '_, M> {
    /// Goes from box to box: a stop at each face that commands go through, and at the end.
    #[inline(always)]
    fn find<A: Arithmetic>(
        &self,
        begin: &Solved,
        near: &mut Near<'a>,
        stops: &mut Vec<Stop>,
        most_mm: f64,
    ) -> Option<()> {
        let first = Stop::at(0.0, begin)?;
        let way_mm = std::array::from_fn(|axis| self.end.node.ideal_mm[axis] - self.begin.ideal_mm[axis]);
        let mut cells = self.grid.cells_at(first.home);
        let mut home = self.grid.home_at(self.map, &cells)?;
        stops.clear();
        stops.push(first);
        for _ in 0..MOST_BOXES {
            let here = stops.last()?.node;
            let (more, axis, is_up) = home.patch.way_out(&here.command_mm, &way_mm);
            let share = here.share + more;
            if share > 1.0 - LEAST_SHARE {
                return self.go_to::<A>(home, Stop::at(1.0, self.end)?, near, stops, most_mm);
            }
            cells[axis] = if is_up { cells[axis] + 1 } else { cells[axis].checked_sub(1)? };
            if cells[axis] == self.grid.axes[axis].n_cells() {
                return None;
            }
            let next = self.grid.home_at(self.map, &cells)?;
            if more > LEAST_SHARE {
                let stop = self.stop::<A>(share, &[home, next], near)?;
                self.go_to::<A>(home, stop, near, stops, most_mm)?;
            }
            home = next;
        }
        None
    }

    /// A place on the way, by the first of these boxes that holds its command; else by any.
    #[inline(always)]
    fn stop<A: Arithmetic>(&self, share: f64, homes: &[Home<'a>], near: &mut Near<'a>) -> Option<Stop> {
        let ideal_mm = between(&self.begin.ideal_mm, &self.end.node.ideal_mm, share);
        for home in homes {
            let command_mm = home.patch.command_for::<A>(&ideal_mm);
            if home.patch.holds(&command_mm) {
                return Some(Stop::new(Node { share, ideal_mm, command_mm }, home.place));
            }
        }
        let (command_mm, home) = self.grid.command_for::<A>(self.map, &ideal_mm, near)?;
        Some(Stop::new(Node { share, ideal_mm, command_mm }, home))
    }

    /// Adds the next stop of a box, and others before it where the box bends too much for one piece.
    #[inline(always)]
    fn go_to<A: Arithmetic>(
        &self,
        home: Home<'a>,
        next: Stop,
        near: &mut Near<'a>,
        stops: &mut Vec<Stop>,
        most_mm: f64,
    ) -> Option<()> {
        let before = stops.last_mut()?;
        let from = before.node.share;
        before.bulge_mm = self.bulge_mm::<A>(home.patch, before, &next)?;
        if before.bulge_mm > most_mm {
            // What bends goes with the square of the length; half of the limit is left to the stops on a piece's way.
            let n_parts = (2.0 * before.bulge_mm / most_mm).sqrt().ceil();
            if !(..=MOST_PARTS).contains(&n_parts) {
                return None;
            }
            for part in 1..n_parts as u32 {
                let share = from + f64::from(part) / n_parts * (next.node.share - from);
                let stop = self.stop::<A>(share, &[home], near)?;
                let before = stops.last_mut()?;
                before.bulge_mm = self.bulge_mm::<A>(home.patch, before, &stop)?;
                stops.push(stop);
            }
            let before = stops.last_mut()?;
            before.bulge_mm = self.bulge_mm::<A>(home.patch, before, &next)?;
        }
        stops.push(next);
        Some(())
    }

    /// By how much, at most, the correction leaves the straight line between two stops of a box.
    ///
    /// By as much as in the middle, were it a quadratic along the way; else by `T L³/(72 √3)` more, at most, where its third
    /// derivative is T. A stop may lie beyond a face, which was met to the first order only: so far another polynomial
    /// holds, and its derivative is another one.
    #[inline(always)]
    fn bulge_mm<A: Arithmetic>(&self, patch: &Patch, from: &Stop, to: &Stop) -> Option<f64> {
        let length_mm = distance(&from.node.ideal_mm, &to.node.ideal_mm);
        let middle_mm = between(&from.node.ideal_mm, &to.node.ideal_mm, 0.5);
        let command_mm = patch.command_for::<A>(&middle_mm);
        let off = |axis: usize| {
            command_mm[axis] - middle_mm[axis] - 0.5 * (from.correction_mm[axis] + to.correction_mm[axis])
        };
        let bend_mm = norm(&std::array::from_fn(off))
            + patch.twist_per_mm2 * (length_mm * (length_mm * length_mm)) / CUBIC;
        let mut kink_mm: f64 = 0.0;
        for stop in [from, to] {
            if !patch.holds(&stop.node.command_mm) {
                let outside_mm = patch.outside_mm(&stop.node.command_mm);
                kink_mm = kink_mm.max(patch.turn_to(self.grid.made(stop.home)?) * (outside_mm + bend_mm));
            }
        }
        Some(BEYOND * bend_mm + kink_mm)
    }
}

impl Stop {
    /// None where no box found the command.
    #[inline]
    fn at(share: f64, solved: &Solved) -> Option<Self> {
        Some(Self::new(Node { share, ..solved.node }, solved.home?))
    }

    #[inline]
    fn new(node: Node, home: u32) -> Self {
        let correction_mm = std::array::from_fn(|axis| node.command_mm[axis] - node.ideal_mm[axis]);
        Self { node, home, correction_mm, bulge_mm: 0.0 }
    }
}

/// The furthest stop that a piece may reach; None where it may not even reach the next.
fn furthest(stops: &[Stop], from: usize, most_mm: f64) -> Option<usize> {
    let mut beyond = stops.len() - 1;
    if is_near(stops, from, beyond, most_mm) {
        return Some(beyond);
    }
    let mut to = from + 1;
    if to == beyond || !is_near(stops, from, to, most_mm) {
        return None;
    }
    while beyond - to > 1 {
        let middle = to + (beyond - to) / 2;
        if is_near(stops, from, middle, most_mm) {
            to = middle;
        } else {
            beyond = middle;
        }
    }
    Some(to)
}

/// Whether commands along the straight line between the corrections of two stops are off by at most so much.
fn is_near(stops: &[Stop], from: usize, to: usize, most_mm: f64) -> bool {
    let (begin, end) = (&stops[from], &stops[to]);
    let per_share = 1.0 / (end.node.share - begin.node.share);
    let mut bulge_before_mm = begin.bulge_mm;
    for stop in &stops[from + 1..to] {
        let share = (stop.node.share - begin.node.share) * per_share;
        let line_mm = between(&begin.correction_mm, &end.correction_mm, share);
        let off_mm = norm(&std::array::from_fn(|axis| stop.correction_mm[axis] - line_mm[axis]));
        // Not a number is not near.
        if !(..=most_mm).contains(&(off_mm + bulge_before_mm.max(stop.bulge_mm))) {
            return false;
        }
        bulge_before_mm = stop.bulge_mm;
    }
    begin.bulge_mm <= most_mm
}

#[cfg(test)]
mod tests {
    use super::super::tests::{NEWTON_MM, RANGE_MM, machine, place};
    use super::*;
    use crate::arithmetic::Separate;
    use crate::gcode::course::Course;
    use crate::gcode::path::split;
    use crate::volumetric::Approach;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_tool_is_where_it_should_be_all_along_each_piece(
            ends in proptest::array::uniform2(place()),
            reach in prop_oneof![Just(1.0), Just(0.2)],
            size in prop_oneof![Just(0.1), Just(1.0), Just(3.0)],
            limit_mm in prop_oneof![Just(0.02), Just(0.0048), Just(0.0008)],
        ) {
            let machine = machine(size);
            let grid = Grid::new(&machine, &RANGE_MM, NEWTON_MM).unwrap();
            let closeness = Closeness { limit_mm, newton_mm: NEWTON_MM, shortest_mm: 1e-3 };
            let to_mm = between(&ends[0], &ends[1], reach);
            let found = grid.solved(&machine, &ends[0]).zip(grid.solved(&machine, &to_mm));
            let Some((begin, end)) = found else { return Ok(()) };
            let mut walk = Walk::default();
            let Some(pieces) = grid.walk(&machine, &begin, &end, &closeness, &mut Near::default(), &mut walk) else { return Ok(()) };
            prop_assert_eq!(pieces.last(), Some(&Node { share: 1.0, ..end.node }));
            let mut from = Node { share: 0.0, ..begin.node };
            for to in pieces {
                prop_assert!(to.share > from.share);
                for step in 0..=50 {
                    let share = f64::from(step) / 50.0;
                    let command_mm = between(&from.command_mm, &to.command_mm, share);
                    let actual_mm = machine.actual(&command_mm, &Approach::default());
                    let off_mm = distance(&actual_mm, &between(&from.ideal_mm, &to.ideal_mm, share));
                    prop_assert!(off_mm <= limit_mm, "{off_mm} at {share}");
                }
                from = *to;
            }
        }
    }

    proptest! {
        #[test]
        fn a_correction_bends_and_twists_no_more_than_its_box_says(
            begin in place(),
            way in [-1.0_f64..1.0, -1.0_f64..1.0, -1.0_f64..1.0],
            size in prop_oneof![Just(0.1), Just(3.0)],
        ) {
            let machine = machine(size);
            let grid = Grid::new(&machine, &RANGE_MM, NEWTON_MM).unwrap();
            let Some(patch) = grid.cells_of(&begin).and_then(|cells| grid.patch(&machine, &cells)) else {
                return Ok(());
            };
            let step_mm = norm(&way);
            prop_assume!(step_mm > 0.1);
            let at = |steps: f64| std::array::from_fn::<f64, 3, _>(|axis| begin[axis] + steps * way[axis]);
            let targets = [0.0, 1.0, 2.0, 3.0].map(at);
            let commands = targets.map(|target_mm| patch.command_for::<Separate>(&target_mm));
            prop_assume!(commands.iter().all(|command_mm| patch.holds(command_mm)));
            let difference = |weights: [f64; 4]| {
                norm(&std::array::from_fn(|axis| {
                    (0..4).map(|k| weights[k] * (commands[k][axis] - targets[k][axis])).sum::<f64>()
                }))
            };
            let rounding_mm = 1e-12;
            prop_assert!(difference([1.0, -2.0, 1.0, 0.0]) <= patch.bend_per_mm * step_mm.powi(2) + rounding_mm);
            prop_assert!(difference([-1.0, 3.0, -3.0, 1.0]) <= patch.twist_per_mm2 * step_mm.powi(3) + rounding_mm);
        }
    }

    #[test]
    fn there_are_fewer_pieces_than_where_the_worst_place_is_cut() {
        let machine = machine(1.0);
        let grid = Grid::new(&machine, &RANGE_MM, NEWTON_MM).unwrap();
        let mut walk = Walk::default();
        for limit_mm in [0.02, 0.0048, 0.0024, 0.0008] {
            let closeness = Closeness { limit_mm, newton_mm: NEWTON_MM, shortest_mm: 1e-3 };
            let (mut n_walked, mut n_split) = (0, 0);
            for turn in 0..60 {
                let angle = 0.1 * f64::from(turn);
                let at = |side: f64| {
                    let (x, y) = (side * 60.0 * angle.cos(), side * 60.0 * angle.sin());
                    grid.solved(&machine, &[90.0 + 0.3 * f64::from(turn) + x, 85.0 + y, 20.0 + 5.0 * side])
                        .unwrap()
                };
                let (begin, end) = (at(-1.0), at(1.0));
                n_walked += grid
                    .walk(&machine, &begin, &end, &closeness, &mut Near::default(), &mut walk)
                    .unwrap()
                    .len();
                let start = Node { share: 0.0, ..begin.node };
                let pieces =
                    split(&machine, &Course::default(), &start, &end.node, &closeness, &mut Vec::new());
                n_split += pieces.unwrap().map_or(1, |pieces| pieces.len());
            }
            assert!(n_walked < n_split, "{limit_mm}: {n_walked} walked, {n_split} split");
        }
    }
}
