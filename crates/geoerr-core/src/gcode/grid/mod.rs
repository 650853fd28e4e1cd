//! A machine everywhere in its range by polynomials in boxes, made where a program first comes.
//!
//! Newton's method asks a machine three times for its errors with all derivatives; a program of short moves asks it a
//! million times in the same few boxes. A box's polynomials ([`Patch`]) answer from 27 coefficients, and say besides
//! how much a line through it can bend, so that most moves need not be looked at for splitting either.
//!
//! What a box's polynomials are, and whether it has any, depends on the machine alone: the same target has the same
//! command in every program, on any number of threads, whatever was forgotten in between.

mod edges;
mod walk;

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use self::edges::Edges;
use super::patch::Patch;
use super::path::{Closeness, Node, PathMap, square};
use crate::arithmetic::{Arithmetic, Kernel, run_widest};
use crate::volumetric::{Approach, MotionNeeds, Windup};
pub use walk::Walk;

/// More rows of boxes than this are too many to list: 12 MB.
const MOST_ROWS: usize = 1 << 19;

/// When so many boxes have polynomials all are forgotten: they would fill 30 MB.
const MOST_MADE: usize = 1 << 14;

/// Share of Newton's tolerance that a polynomial may leave.
const SHARE_OF_TOLERANCE: f64 = 0.5;

/// How often a command may point to another box before Newton's method is asked.
const MOST_HOPS: usize = 3;

/// Boxes between the knots of a machine whose errors depend on the position alone.
#[derive(Debug)]
pub struct Grid {
    axes: [Edges; 3],
    /// Rows of boxes along x, listed where a program first comes: few programs fill a machine.
    rows: Vec<OnceLock<Row>>,
    n_made: AtomicUsize,
    tolerance_mm: f64,
}

/// What is known of each box of a row: nothing yet, that it has no polynomials, or its polynomials.
type Row = Box<[OnceLock<Option<Box<Patch>>>]>;

/// A box and its polynomials.
#[derive(Clone, Copy, Debug)]
struct Home<'a> {
    place: u32,
    patch: &'a Patch,
}

/// The last two boxes that were asked: where most moves end, in the program's places and in commands.
#[derive(Debug, Default)]
pub struct Near<'a> {
    homes: [Option<Home<'a>>; 2],
    /// The one that was asked last.
    last: usize,
}

impl<'a> Near<'a> {
    /// The box of a place, where it has polynomials.
    #[inline(always)]
    fn home_of(&mut self, grid: &'a Grid, map: &impl PathMap, at_mm: &[f64; 3]) -> Option<Home<'a>> {
        for which in [self.last, 1 - self.last] {
            if let Some(home) = self.homes[which].filter(|home| home.patch.owns(at_mm)) {
                self.last = which;
                return Some(home);
            }
        }
        self.another_home(grid, map, at_mm)
    }

    /// The same where neither of the last two is it: apart, so that asking those is compiled into each search.
    #[inline(never)]
    fn another_home(&mut self, grid: &'a Grid, map: &impl PathMap, at_mm: &[f64; 3]) -> Option<Home<'a>> {
        let home = grid.home_of(map, at_mm)?;
        self.last = 1 - self.last;
        self.homes[self.last] = Some(home);
        Some(home)
    }

    #[inline]
    fn patch_at(&self, place: u32) -> Option<&'a Patch> {
        self.homes.iter().flatten().find(|home| home.place == place).map(|home| home.patch)
    }
}

/// A solved place.
#[derive(Clone, Copy, Debug)]
pub struct Solved {
    /// Where, and what to command.
    pub node: Node,
    /// The box whose polynomial found the command.
    home: Option<u32>,
}

impl Grid {
    /// A grid of the machine's range; None where polynomials cannot stand for it.
    pub fn new(map: &impl PathMap, range_mm: &[(f64, f64); 3], newton_mm: f64) -> Option<Self> {
        if map.is_nominal() || map.needs().any() {
            return None;
        }
        let edges = |axis: usize| Edges::new(range_mm[axis], map.knots(axis));
        let axes = [edges(0)?, edges(1)?, edges(2)?];
        let n_rows = axes[1].n_cells() * axes[2].n_cells();
        // Places of boxes are counted in 32 bits.
        if n_rows > MOST_ROWS || u32::try_from(n_rows * axes[0].n_cells()).is_err() {
            return None;
        }
        let rows = std::iter::repeat_with(OnceLock::new).take(n_rows).collect();
        let tolerance_mm = SHARE_OF_TOLERANCE * newton_mm;
        Some(Self { axes, rows, n_made: AtomicUsize::new(0), tolerance_mm })
    }

    /// Forgets polynomials where there are too many.
    pub fn tidy(&mut self) {
        if *self.n_made.get_mut() > MOST_MADE {
            self.rows.fill_with(OnceLock::new);
            *self.n_made.get_mut() = 0;
        }
    }

    /// Where a command puts the tool, where a polynomial has it.
    #[inline]
    fn actual(&self, map: &impl PathMap, command_mm: &[f64; 3]) -> Option<[f64; 3]> {
        Some(self.patch(map, &self.cells_of(command_mm)?)?.actual(command_mm))
    }

    /// The same for two commands, where the first one's polynomial has both.
    #[inline]
    fn actual_of_two(&self, map: &impl PathMap, commands_mm: &[[f64; 3]; 2]) -> Option<[[f64; 3]; 2]> {
        let patch = self.patch(map, &self.cells_of(&commands_mm[0])?)?;
        patch.nearly_holds(&commands_mm[1]).then(|| patch.actual_of_two(commands_mm))
    }

    /// A place solved, where a polynomial has its command; `near` are boxes that were asked before.
    #[inline(always)]
    pub fn solve<'a, A: Arithmetic>(
        &'a self,
        map: &impl PathMap,
        ideal_mm: &[f64; 3],
        near: &mut Near<'a>,
    ) -> Option<Solved> {
        let (command_mm, home) = self.command_for::<A>(map, ideal_mm, near)?;
        let node = Node { share: 1.0, ideal_mm: *ideal_mm, command_mm };
        Some(Solved { node, home: Some(home) })
    }

    /// The same of a place alone.
    pub fn solved(&self, map: &impl PathMap, ideal_mm: &[f64; 3]) -> Option<Solved> {
        run_widest(Solving { grid: self, map, ideal_mm })
    }

    /// The command for a place, and the box whose polynomial has it.
    ///
    /// Compiled into what asks for it, so that the numbers stay in registers: the larger things that are made of them
    /// would be waited for when they are copied.
    #[inline(always)]
    fn command_for<'a, A: Arithmetic>(
        &'a self,
        map: &impl PathMap,
        ideal_mm: &[f64; 3],
        near: &mut Near<'a>,
    ) -> Option<([f64; 3], u32)> {
        let mut at_mm = *ideal_mm;
        for _ in 0..MOST_HOPS {
            let home = near.home_of(self, map, &at_mm)?;
            let command_mm = home.patch.command_for::<A>(ideal_mm);
            if home.patch.holds(&command_mm) {
                return Some((command_mm, home.place));
            }
            at_mm = command_mm;
        }
        None
    }

    /// The box of a place, where it has polynomials.
    fn home_of(&self, map: &impl PathMap, at_mm: &[f64; 3]) -> Option<Home<'_>> {
        self.home_at(map, &self.cells_of(at_mm)?)
    }

    /// A box, where it has polynomials.
    #[inline]
    fn home_at(&self, map: &impl PathMap, cells: &[usize; 3]) -> Option<Home<'_>> {
        Some(Home { place: self.place_of(cells) as u32, patch: self.patch(map, cells)? })
    }

    /// Whether a straight move between two solved places is known to stay straight enough whole.
    ///
    /// Between commands that are right at its ends the command of a move is off by at most `M L²/8` where the second
    /// derivative of the correction is at most M, and by `V L/4` where its first derivative changes by at most V on
    /// the way. Where the way leaves the boxes by as much as it is off, that is a fifth more, as corrections change by
    /// less than a tenth; for the same reason the tool is off by at most an eighth more than the command; and the bound
    /// that [`split`](super::path::split) goes by is at most a quarter above that: together less than twice as much.
    #[inline(always)]
    pub fn is_straight(&self, begin: &Solved, end: &Solved, near: &Near<'_>, closeness: &Closeness) -> bool {
        let (Some(from), Some(to)) = (begin.home, end.home) else { return false };
        let Some(patch) = near.patch_at(to).or_else(|| self.made(to)) else { return false };
        let way_mm: [f64; 3] =
            std::array::from_fn(|axis| end.node.ideal_mm[axis] - begin.node.ideal_mm[axis]);
        let length_mm2 = square(&way_mm);
        let off_mm = if from == to {
            0.125 * patch.bend_per_mm * length_mm2
        } else {
            let Some(other) = self.made(from).filter(|_| self.are_neighbours(from, to)) else { return false };
            let jump = patch.jump_to(other);
            let bends = (patch.bend_per_mm + other.bend_per_mm) * (patch.radius_mm + other.radius_mm);
            0.25 * (jump + bends) * length_mm2.sqrt()
        };
        2.0 * (off_mm + 2.0 * closeness.newton_mm) <= closeness.limit_mm
    }

    #[inline]
    fn cells_of(&self, at_mm: &[f64; 3]) -> Option<[usize; 3]> {
        Some([self.axes[0].cell(at_mm[0])?, self.axes[1].cell(at_mm[1])?, self.axes[2].cell(at_mm[2])?])
    }

    #[inline]
    fn place_of(&self, cells: &[usize; 3]) -> usize {
        (cells[2] * self.axes[1].n_cells() + cells[1]) * self.axes[0].n_cells() + cells[0]
    }

    #[inline]
    fn cells_at(&self, place: u32) -> [usize; 3] {
        let (nx, ny) = (self.axes[0].n_cells(), self.axes[1].n_cells());
        let place = place as usize;
        [place % nx, place / nx % ny, place / nx / ny]
    }

    #[inline]
    fn made(&self, place: u32) -> Option<&Patch> {
        let (row, cell) = (place as usize / self.axes[0].n_cells(), place as usize % self.axes[0].n_cells());
        self.rows.get(row)?.get()?.get(cell)?.get()?.as_deref()
    }

    #[inline]
    fn patch(&self, map: &impl PathMap, cells: &[usize; 3]) -> Option<&Patch> {
        let row = self.rows.get(cells[2] * self.axes[1].n_cells() + cells[1])?.get_or_init(|| self.list());
        row.get(cells[0])?.get_or_init(|| self.make(map, cells)).as_deref()
    }

    #[cold]
    fn list(&self) -> Row {
        // Memory of polynomials that have not been made yet: a box listed is a hundredth of a box made.
        self.n_made.fetch_add(1 + self.axes[0].n_cells() / 100, Ordering::Relaxed);
        std::iter::repeat_with(OnceLock::new).take(self.axes[0].n_cells()).collect()
    }

    #[cold]
    fn make(&self, map: &impl PathMap, cells: &[usize; 3]) -> Option<Box<Patch>> {
        self.n_made.fetch_add(1, Ordering::Relaxed);
        let ends: [(f64, f64); 3] = std::array::from_fn(|axis| self.axes[axis].ends(cells[axis]));
        Patch::new(map, ends.map(|(low, _)| low), ends.map(|(_, high)| high), self.tolerance_mm).map(Box::new)
    }

    /// Whether two boxes share a face: a line from one to the other then lies in these two.
    #[inline]
    fn are_neighbours(&self, one: u32, other: u32) -> bool {
        let (one, other) = (self.cells_at(one), self.cells_at(other));
        (0..3).map(|axis| one[axis].abs_diff(other[axis])).sum::<usize>() == 1
    }
}

/// A machine that answers by its grid where it can.
#[derive(Debug)]
pub struct Gridded<'a, M> {
    /// The machine.
    pub map: &'a M,
    /// Its grid.
    pub grid: Option<&'a Grid>,
}

struct Solving<'a, M> {
    grid: &'a Grid,
    map: &'a M,
    ideal_mm: &'a [f64; 3],
}

impl<M: PathMap> Kernel for Solving<'_, M> {
    type Output = Option<Solved>;

    #[inline(always)]
    fn run<A: Arithmetic>(self) -> Option<Solved> {
        self.grid.solve::<A>(self.map, self.ideal_mm, &mut Near::default())
    }
}

impl<M: PathMap> PathMap for Gridded<'_, M> {
    fn command_for(
        &self,
        ideal_mm: &[f64; 3],
        approach: &Approach,
        tolerance_mm: f64,
    ) -> Result<[f64; 3], f64> {
        match self.grid.and_then(|grid| grid.solved(self.map, ideal_mm)) {
            Some(solved) => Ok(solved.node.command_mm),
            None => self.map.command_for(ideal_mm, approach, tolerance_mm),
        }
    }

    #[inline]
    fn actual(&self, command_mm: &[f64; 3], approach: &Approach) -> [f64; 3] {
        let by_grid = self.grid.and_then(|grid| grid.actual(self.map, command_mm));
        by_grid.unwrap_or_else(|| self.map.actual(command_mm, approach))
    }

    #[inline]
    fn actual_of_two(&self, commands_mm: &[[f64; 3]; 2], approaches: &[Approach; 2]) -> [[f64; 3]; 2] {
        let by_grid = self.grid.and_then(|grid| grid.actual_of_two(self.map, commands_mm));
        by_grid.unwrap_or_else(|| [0, 1].map(|which| self.actual(&commands_mm[which], &approaches[which])))
    }

    #[inline]
    fn knots(&self, axis: usize) -> &[f64] {
        self.map.knots(axis)
    }

    fn is_nominal(&self) -> bool {
        self.map.is_nominal()
    }

    fn most_crossings(&self) -> usize {
        self.map.most_crossings()
    }

    fn needs(&self) -> MotionNeeds {
        self.map.needs()
    }

    fn windups(&self) -> &[Windup] {
        self.map.windups()
    }
}

impl Solved {
    /// A place that Newton's method has solved.
    pub fn by_newton(node: Node) -> Self {
        Self { node, home: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::Separate;
    use crate::gcode::course::Course;
    use crate::gcode::path::{distance, split};
    use crate::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Squareness, Table};
    use proptest::prelude::*;

    pub const RANGE_MM: [(f64, f64); 3] = [(-5.0, 210.0), (0.0, 180.0), (0.0, 60.0)];

    /// All 21 errors, with knots that differ from axis to axis.
    pub fn machine(size: f64) -> MachineModel {
        let mut errors = ErrorTables::default();
        for (a, axis) in Axis::ALL.into_iter().enumerate() {
            let knots: Vec<f64> = (0..12).map(|k| f64::from(k) * (17.0 + 3.0 * a as f64)).collect();
            for (c, component) in Component::ALL.into_iter().enumerate() {
                let largest = size * if c < 3 { 0.3 } else { 1e-3 };
                let phase = (6 * a + c) as f64;
                let values = knots.iter().map(|q| largest * (q / 40.0 + phase).sin()).collect();
                errors.set(axis, component, Table::new(knots.clone(), values).unwrap());
            }
        }
        let squareness = Squareness { s_xy_rad: -4e-3 * size, s_xz_rad: 1e-3 * size, s_yz_rad: 3e-3 * size };
        errors.set_squareness(squareness).unwrap();
        MachineModel::new(Chain::parse("wYbXZt").unwrap(), errors, [5.0, -20.0, -30.0])
    }

    pub fn place() -> impl Strategy<Value = [f64; 3]> {
        // Beyond the range too.
        RANGE_MM.map(|(low, high)| low - 3.0..high + 3.0)
    }

    pub const NEWTON_MM: f64 = 1e-7;

    proptest! {
        #[test]
        fn a_solved_command_puts_the_tool_there(
            targets in proptest::collection::vec(place(), 1..40),
            size in prop_oneof![Just(0.01), Just(1.0), Just(5.0)],
        ) {
            let machine = machine(size);
            let grid = Grid::new(&machine, &RANGE_MM, NEWTON_MM).unwrap();
            let still = Approach::default();
            for target_mm in &targets {
                if let Some(solved) = grid.solved(&machine, target_mm) {
                    let command_mm = solved.node.command_mm;
                    let place_mm = machine.actual(&command_mm, &still);
                    prop_assert!(distance(&place_mm, target_mm) <= NEWTON_MM);
                    let by_grid = grid.actual(&machine, &command_mm).unwrap();
                    prop_assert!(distance(&by_grid, &place_mm) <= NEWTON_MM);
                }
            }
        }

        #[test]
        fn two_commands_at_once_are_where_each_of_them_is(
            one in place(),
            step in [-8.0_f64..8.0, -8.0_f64..8.0, -8.0_f64..8.0],
            at_knot in proptest::bool::ANY,
        ) {
            let machine = machine(1.0);
            let grid = Grid::new(&machine, &RANGE_MM, NEWTON_MM).unwrap();
            let mut other: [f64; 3] = std::array::from_fn(|axis| one[axis] + step[axis]);
            if at_knot {
                // As a crossing is worked out: by a rounding beside the knot.
                let knots = MachineModel::knots(&machine, Axis::X);
                other[0] = knots[knots.partition_point(|&knot| knot < one[0]) % knots.len()] + 1e-13;
            }
            if let Some(both) = grid.actual_of_two(&machine, &[one, other]) {
                for (by_grid, command_mm) in both.iter().zip([one, other]) {
                    let place_mm = machine.actual(&command_mm, &Approach::default());
                    prop_assert!(distance(by_grid, &place_mm) <= NEWTON_MM);
                }
            }
        }

        #[test]
        fn the_box_that_was_asked_before_changes_nothing(
            begin in place(),
            steps in proptest::collection::vec([-6.0_f64..6.0, -6.0_f64..6.0, -2.0_f64..2.0], 1..30),
        ) {
            let machine = machine(1.0);
            let grid = Grid::new(&machine, &RANGE_MM, NEWTON_MM).unwrap();
            let (mut near, mut at) = (Near::default(), begin);
            for step in steps {
                at = std::array::from_fn(|axis| at[axis] + step[axis]);
                let by_near = grid.solve::<Separate>(&machine, &at, &mut near).map(|solved| (solved.node, solved.home));
                let alone = grid.solve::<Separate>(&machine, &at, &mut Near::default()).map(|solved| (solved.node, solved.home));
                prop_assert_eq!(by_near, alone);
            }
        }

        #[test]
        fn what_is_called_straight_is_not_split(
            begin in place(),
            steps in proptest::collection::vec([-12.0_f64..12.0, -12.0_f64..12.0, -4.0_f64..4.0], 1..20),
            size in prop_oneof![Just(0.1), Just(1.0), Just(3.0)],
            limit_mm in prop_oneof![Just(0.0048), Just(0.0008)],
        ) {
            let machine = machine(size);
            let grid = Grid::new(&machine, &RANGE_MM, NEWTON_MM).unwrap();
            let closeness = Closeness { limit_mm, newton_mm: NEWTON_MM, shortest_mm: 1e-3 };
            let ends = steps.iter().scan(begin, |at, step| {
                *at = std::array::from_fn(|axis| at[axis] + step[axis]);
                Some(*at)
            });
            let solved: Vec<Option<Solved>> = ends.map(|end| grid.solved(&machine, &end)).collect();
            for pair in solved.windows(2) {
                let (Some(from), Some(to)) = (&pair[0], &pair[1]) else { continue };
                if grid.is_straight(from, to, &Near::default(), &closeness) {
                    let start = Node { share: 0.0, ..from.node };
                    let pieces =
                        split(&machine, &Course::default(), &start, &to.node, &closeness, &mut Vec::new());
                    prop_assert_eq!(pieces, Ok(None));
                }
            }
        }
    }

    #[test]
    fn most_short_moves_are_seen_to_be_straight() {
        let machine = machine(1.0);
        let grid = Grid::new(&machine, &RANGE_MM, NEWTON_MM).unwrap();
        let closeness = Closeness { limit_mm: 0.0048, newton_mm: NEWTON_MM, shortest_mm: 1e-3 };
        let at = |i: u32| {
            let turn = 0.02 * f64::from(i);
            grid.solved(&machine, &[100.0 + 50.0 * turn.cos(), 90.0 + 50.0 * turn.sin(), 7.0]).unwrap()
        };
        let n_straight =
            (0..300).filter(|&i| grid.is_straight(&at(i), &at(i + 1), &Near::default(), &closeness)).count();
        assert!(n_straight > 290, "{n_straight}");
    }

    #[test]
    fn what_was_forgotten_is_found_again_the_same() {
        let machine = machine(1.0);
        let mut grid = Grid::new(&machine, &RANGE_MM, NEWTON_MM).unwrap();
        let target_mm = [33.3, 44.4, 5.5];
        let before = grid.solved(&machine, &target_mm).unwrap().node;
        *grid.n_made.get_mut() = MOST_MADE + 1;
        grid.tidy();
        assert_eq!(*grid.n_made.get_mut(), 0);
        assert_eq!(grid.solved(&machine, &target_mm).unwrap().node, before);
    }

    #[test]
    fn a_wave_too_short_for_a_quadratic_is_left_to_newton() {
        let mut errors = ErrorTables::default();
        // A step of a tenth of a millimetre within a hundredth.
        let table = Table::new(vec![0.0, 50.0, 50.01, 200.0], vec![0.0, 0.0, 0.1, 0.1]).unwrap();
        errors.set(Axis::X, Component::X, table);
        let machine = MachineModel::new(Chain::parse("wbXYZt").unwrap(), errors, [0.0; 3]);
        let grid = Grid::new(&machine, &RANGE_MM, NEWTON_MM).unwrap();
        assert!(grid.actual(&machine, &[50.005, 10.0, 10.0]).is_none());
        assert!(grid.actual(&machine, &[60.0, 10.0, 10.0]).is_some());
    }

    #[test]
    fn no_grid_where_nothing_is_wrong_or_too_much_to_list() {
        let none = MachineModel::new(Chain::parse("wbXYZt").unwrap(), ErrorTables::default(), [0.0; 3]);
        assert!(Grid::new(&none, &RANGE_MM, NEWTON_MM).is_none());
        assert!(Grid::new(&machine(1.0), &[(0.0, 2e4); 3], NEWTON_MM).is_none());
        assert!(Grid::new(&machine(1.0), &[(f64::NEG_INFINITY, f64::INFINITY); 3], NEWTON_MM).is_none());
    }
}
