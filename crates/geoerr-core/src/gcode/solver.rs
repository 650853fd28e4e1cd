//! The moves of a block solved: commands for their ends, and pieces where a whole move would leave the tolerance.

use rayon::prelude::*;

use super::block::{Block, MOVES_PER_TASK, Way};
use super::course::Course;
use super::grid::{Grid, Gridded, Near, Solved, Walk};
use super::options::Options;
use super::path::{Closeness, Node, PathMap, SplitError, split};
use super::reader::Move;

/// Share of the tolerance that is left to what the bound of [`split`] does not cover (terms beyond the quadratic, the
/// turn of a rounding error by the machine): together they are orders below it.
const MARGIN: f64 = 0.02;

/// Remaining error of a solved command, where the tolerance does not ask for less.
const NEWTON_MM: f64 = 1e-7;

/// What the moves of a task are solved and split with.
#[derive(Debug)]
struct Memory<'a, 'b> {
    near: Near<'a>,
    walk: Walk,
    crossings: Vec<f64>,
    /// Pieces of the task's moves.
    pieces: &'b mut Vec<Node>,
}

/// Solves moves; knows where the last one ended.
#[derive(Debug)]
pub struct Solver {
    grid: Option<Grid>,
    /// For words in millimetres and in inches.
    closeness: [Closeness; 2],
    newton_mm: f64,
    last: Option<Solved>,
}

impl Solver {
    /// For a machine that nothing has moved yet.
    pub fn new(map: &impl PathMap, options: &Options) -> Self {
        let newton_mm = NEWTON_MM.min(1e-3 * options.tolerance_mm);
        let closeness = [false, true].map(|is_inch| closeness(options, newton_mm, is_inch));
        let grid = Grid::new(map, &options.range_mm, newton_mm);
        Self { grid, closeness, newton_mm, last: None }
    }

    /// How closely moves are followed: with words in millimetres, and in inches.
    pub fn closenesses(&self) -> &[Closeness; 2] {
        &self.closeness
    }

    /// Solves the moves of a block, which comes behind the one before.
    pub fn solve(&mut self, block: &mut Block, map: &impl PathMap) {
        if let Some(grid) = &mut self.grid {
            grid.tidy();
        }
        let (moves, courses) = (&block.moves, &block.courses);
        block.ends.clear();
        block.ends.resize(moves.len(), None);
        block.ways.clear();
        block.ways.resize(moves.len(), Way::Whole);
        let n_tasks = moves.len().div_ceil(MOVES_PER_TASK);
        block.pieces.resize_with(n_tasks.max(block.pieces.len()), Vec::new);
        let ends = block.ends.par_chunks_mut(MOVES_PER_TASK);
        let ways = block.ways.par_chunks_mut(MOVES_PER_TASK);
        let tasks = ends.zip(ways.zip(&mut block.pieces)).enumerate();
        tasks.for_each(|(task, (ends, (ways, pieces)))| {
            pieces.clear();
            let first = task * MOVES_PER_TASK;
            let (near, walk, crossings) = (Near::default(), Walk::default(), Vec::new());
            let mut memory = Memory { near, walk, crossings, pieces };
            // Solved twice rather than waited for.
            let last = match first.checked_sub(1) {
                Some(before) => self.end(map, &moves[before], courses.get(before), &mut memory.near).ok(),
                None => self.last,
            };
            let mut before = last.as_ref();
            for (index, (end, way)) in (first..).zip(ends.iter_mut().zip(ways)) {
                let (a_move, course) = (&moves[index], courses.get(index));
                if let Some(grid) = &self.grid {
                    *end = grid.solve(map, &a_move.end_mm, &mut memory.near);
                }
                if end.is_none() {
                    match self.end_by_newton(map, a_move, course) {
                        Ok(solved) => *end = Some(solved),
                        Err(remaining_mm) => *way = Way::Refused(SplitError::NotSolved(remaining_mm)),
                    }
                }
                if let Some(solved) = end
                    && let Some(other) = self.other_way(map, a_move, course, before, solved, &mut memory)
                {
                    *way = other;
                }
                before = end.as_ref();
            }
        });
        if let Some(end) = block.ends.last() {
            self.last = *end;
        }
    }

    /// The end of a move; else the distance that the best command leaves.
    #[inline]
    fn end<'a>(
        &'a self,
        map: &impl PathMap,
        a_move: &Move,
        course: Option<&Course>,
        near: &mut Near<'a>,
    ) -> Result<Solved, f64> {
        let by_grid = self.grid.as_ref().and_then(|grid| grid.solve(map, &a_move.end_mm, near));
        by_grid.map_or_else(|| self.end_by_newton(map, a_move, course), Ok)
    }

    fn end_by_newton(
        &self,
        map: &impl PathMap,
        a_move: &Move,
        course: Option<&Course>,
    ) -> Result<Solved, f64> {
        let ideal_mm = a_move.end_mm;
        if map.is_nominal() {
            return Ok(Solved::by_newton(Node { share: 1.0, ideal_mm, command_mm: ideal_mm }));
        }
        let approach = course.map_or_else(Default::default, |course| course.at(1.0));
        let command_mm = map.command_for(&ideal_mm, &approach, self.newton_mm)?;
        Ok(Solved::by_newton(Node { share: 1.0, ideal_mm, command_mm }))
    }

    /// The way to the end of a move; None where it is whole.
    #[inline]
    fn other_way<'a>(
        &'a self,
        map: &impl PathMap,
        a_move: &Move,
        course: Option<&Course>,
        begin: Option<&Solved>,
        end: &Solved,
        memory: &mut Memory<'a, '_>,
    ) -> Option<Way> {
        // A move from a place that no corrected move has reached has no straight path to keep.
        let begin = begin.filter(|_| !a_move.is_first)?;
        let closeness = &self.closeness[usize::from(a_move.is_inch)];
        if let Some(grid) = &self.grid {
            if grid.is_straight(begin, end, &memory.near, closeness) {
                return None;
            }
            if let Some(found) = grid.walk(map, begin, end, closeness, &mut memory.near, &mut memory.walk) {
                return (found.len() > 1).then(|| added(memory.pieces, found));
            }
        }
        let begin = Node { share: 0.0, ..begin.node };
        let map = Gridded { map, grid: self.grid.as_ref() };
        let course = course.copied().unwrap_or_default();
        match split(&map, &course, &begin, &end.node, closeness, &mut memory.crossings) {
            Ok(found) => found.map(|found| added(memory.pieces, &found)),
            Err(error) => Some(Way::Refused(error)),
        }
    }
}

/// The way by these pieces, behind those of moves before.
fn added(pieces: &mut Vec<Node>, found: &[Node]) -> Way {
    let first = pieces.len() as u32;
    pieces.extend_from_slice(found);
    Way::Pieces { first, behind: pieces.len() as u32 }
}

fn closeness(options: &Options, newton_mm: f64, is_inch: bool) -> Closeness {
    let half_step_mm = options.half_step_mm(is_inch);
    Closeness {
        limit_mm: (1.0 - MARGIN) * options.tolerance_mm - 3.0_f64.sqrt() * half_step_mm,
        newton_mm,
        shortest_mm: 20.0 * half_step_mm,
    }
}
