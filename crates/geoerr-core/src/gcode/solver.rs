//! The moves of a block solved: commands for their ends, and pieces where a whole move would leave the tolerance.

use rayon::prelude::*;

use super::block::{Block, Way};
use super::course::Course;
use super::grid::{Grid, Gridded, Near, Solved, Walk};
use super::options::Options;
use super::path::{Closeness, Node, PathMap, SplitError, split};
use super::reader::Move;

/// Moves that one thread takes at a time.
const MOVES_PER_TASK: usize = 64;

/// Share of the tolerance that is left to what the bound of [`split`] does not cover (terms beyond the quadratic, the
/// turn of a rounding error by the machine): together they are orders below it.
const MARGIN: f64 = 0.02;

/// Remaining error of a solved command, where the tolerance does not ask for less.
const NEWTON_MM: f64 = 1e-7;

/// What the moves of a task are solved and split with.
#[derive(Debug, Default)]
struct Memory<'a> {
    near: Near<'a>,
    walk: Walk,
    crossings: Vec<f64>,
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
        let ends = block.ends.par_chunks_mut(MOVES_PER_TASK);
        let tasks = ends.zip(block.ways.par_chunks_mut(MOVES_PER_TASK)).enumerate();
        tasks.for_each(|(task, (ends, ways))| {
            let first = task * MOVES_PER_TASK;
            let mut memory = Memory::default();
            // Solved twice rather than waited for.
            let mut before = match first.checked_sub(1) {
                Some(before) => self.end(map, &moves[before], courses.get(before), &mut memory.near).ok(),
                None => self.last,
            };
            for (index, (end, way)) in (first..).zip(ends.iter_mut().zip(ways)) {
                let (a_move, course) = (&moves[index], courses.get(index));
                match self.end(map, a_move, course, &mut memory.near) {
                    Ok(solved) => {
                        *end = Some(solved);
                        *way = self.way(map, a_move, course, before.as_ref(), &solved, &mut memory);
                    }
                    Err(remaining_mm) => *way = Way::Refused(SplitError::NotSolved(remaining_mm)),
                }
                before = *end;
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
        let ideal_mm = a_move.end_mm;
        if map.is_nominal() {
            return Ok(Solved::by_newton(Node { share: 1.0, ideal_mm, command_mm: ideal_mm }));
        }
        if let Some(solved) = self.grid.as_ref().and_then(|grid| grid.solve(map, &ideal_mm, near)) {
            return Ok(solved);
        }
        let command_mm = map.command_for(
            &ideal_mm,
            &course.map_or_else(Default::default, |course| course.at(1.0)),
            self.newton_mm,
        )?;
        Ok(Solved::by_newton(Node { share: 1.0, ideal_mm, command_mm }))
    }

    #[inline]
    fn way<'a>(
        &'a self,
        map: &impl PathMap,
        a_move: &Move,
        course: Option<&Course>,
        begin: Option<&Solved>,
        end: &Solved,
        memory: &mut Memory<'a>,
    ) -> Way {
        // A move from a place that no corrected move has reached has no straight path to keep.
        let Some(begin) = begin.filter(|_| !a_move.is_first) else { return Way::Whole };
        let closeness = &self.closeness[usize::from(a_move.is_inch)];
        if let Some(grid) = &self.grid {
            if grid.is_straight(begin, end, &memory.near, closeness) {
                return Way::Whole;
            }
            if let Some(pieces) = grid.walk(map, begin, end, closeness, &mut memory.near, &mut memory.walk) {
                return if let [_] = pieces { Way::Whole } else { Way::Pieces(pieces.to_vec()) };
            }
        }
        let begin = Node { share: 0.0, ..begin.node };
        let map = Gridded { map, grid: self.grid.as_ref() };
        let course = course.copied().unwrap_or_default();
        match split(&map, &course, &begin, &end.node, closeness, &mut memory.crossings) {
            Ok(None) => Way::Whole,
            Ok(Some(pieces)) => Way::Pieces(pieces),
            Err(error) => Way::Refused(error),
        }
    }
}

fn closeness(options: &Options, newton_mm: f64, is_inch: bool) -> Closeness {
    let half_step_mm = options.half_step_mm(is_inch);
    Closeness {
        limit_mm: (1.0 - MARGIN) * options.tolerance_mm - 3.0_f64.sqrt() * half_step_mm,
        newton_mm,
        shortest_mm: 20.0 * half_step_mm,
    }
}
