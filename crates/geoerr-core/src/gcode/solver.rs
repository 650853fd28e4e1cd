//! The moves of a block solved: commands for their ends, and pieces where a whole move would leave the tolerance.

use rayon::prelude::*;

use super::block::{Block, EndOfMove, MOVES_PER_TASK, Way};
use super::course::Course;
use super::grid::{Grid, Gridded, Near, Solved, Walk};
use super::options::Options;
use super::path::{Closeness, Node, PathMap, SplitError, split};
use super::reader::Target;
use super::turns::{Turned, Turns};
use crate::arithmetic::{Arithmetic, Kernel, run_widest};

/// Share of the tolerance that is left to what the bound of [`split`] does not cover (terms beyond the quadratic, the
/// turn of a rounding error by the machine): together they are orders below it.
const MARGIN: f64 = 0.02;

/// Tasks that a thread takes at once: with more, others would wait for the last that does.
const TASKS_AT_ONCE: usize = 4;

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

/// Moves that are solved together.
struct Task<'a, 'b, M> {
    solver: &'a Solver,
    map: &'a M,
    /// All moves of their block, and how they approach their places.
    targets: &'b [Target],
    courses: &'b [Course],
    /// Which of the block's moves is the first.
    first: usize,
    /// Where the one before it ended.
    last: Option<Solved>,
    ends: &'b mut [Option<Solved>],
    ways: &'b mut [Way],
    memory: Memory<'a, 'b>,
}

impl<M: PathMap> Kernel for Task<'_, '_, M> {
    type Output = ();

    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let Self { solver, map, targets, courses, first, last, ends, ways, mut memory } = self;
        let mut before = last.as_ref();
        for (index, (end, way)) in (first..).zip(ends.iter_mut().zip(ways)) {
            let (target, course) = (&targets[index], courses.get(index));
            if let Some(grid) = &solver.grid {
                *end = grid.solve::<A>(map, &target.end_mm, &mut memory.near);
            }
            if end.is_none() {
                match solver.end_by_newton(map, target, course) {
                    Ok(solved) => *end = Some(solved),
                    Err(remaining_mm) => *way = Way::Refused(SplitError::NotSolved(remaining_mm)),
                }
            }
            if let Some(solved) = end
                && let Some(other) = solver.other_way(map, target, course, before, solved, &mut memory)
            {
                *way = other;
            }
            before = end.as_ref();
        }
    }
}

/// Solves moves; knows where the last one ended.
#[derive(Debug)]
pub struct Solver {
    grid: Option<Grid>,
    /// For words in millimetres and in inches.
    closeness: [Closeness; 2],
    newton_mm: f64,
    /// Where the last move ended, by the program's directions.
    last: Option<Solved>,
    turns: Turns,
    /// Where it ended by those that corrections have turned.
    last_turned: Option<Solved>,
}

impl Solver {
    /// For a machine that nothing has moved yet.
    pub fn new(map: &impl PathMap, options: &Options) -> Self {
        let newton_mm = NEWTON_MM.min(1e-3 * options.tolerance_mm);
        let closeness = [false, true].map(|is_inch| closeness(options, newton_mm, is_inch));
        let grid = Grid::new(map, &options.range_mm, newton_mm);
        let turns = Turns::new(map.needs().direction);
        Self { grid, closeness, newton_mm, last: None, turns, last_turned: None }
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
        let (targets, courses) = (&block.targets, &block.courses);
        block.ends.clear();
        block.ends.resize(targets.len(), None);
        block.ways.clear();
        block.ways.resize(targets.len(), Way::Whole);
        let n_tasks = targets.len().div_ceil(MOVES_PER_TASK);
        block.pieces.resize_with(n_tasks.max(block.pieces.len()), Vec::new);
        let ends = block.ends.par_chunks_mut(MOVES_PER_TASK);
        let ways = block.ways.par_chunks_mut(MOVES_PER_TASK);
        let tasks = ends.zip(ways.zip(&mut block.pieces)).enumerate();
        tasks.with_max_len(TASKS_AT_ONCE).for_each(|(task, (ends, (ways, pieces)))| {
            pieces.clear();
            let first = task * MOVES_PER_TASK;
            let (near, walk, crossings) = (Near::default(), Walk::default(), Vec::new());
            let memory = Memory { near, walk, crossings, pieces };
            // Solved twice rather than waited for.
            let last = match first.checked_sub(1) {
                Some(before) => self.end(map, &targets[before], courses.get(before)).ok(),
                None => self.last,
            };
            run_widest(Task { solver: self, map, targets, courses, first, last, ends, ways, memory });
        });
        if let Some(end) = block.ends.last() {
            self.last = *end;
        }
        block.turns.clear();
        if self.turns.any() {
            self.take_up_play(block, map);
        }
    }

    /// Solves moves of a block again in which corrections have turned axes, or that come to such.
    fn take_up_play(&mut self, block: &mut Block, map: &impl PathMap) {
        let mut found = Vec::new();
        let mut passed = block.passed().peekable();
        for end in block.ends_of_moves() {
            while let Some((_, effects)) = passed.next_if(|(n_before, _)| *n_before <= end.index) {
                self.turns.pass(effects);
            }
            // Behind what is refused nothing is written.
            let (Ok(nodes), Some(course)) = (block.nodes_of(&end), block.courses.get(end.index)) else {
                continue;
            };
            let limit_mm = self.closeness[usize::from(end.target.is_inch)].limit_mm;
            if let Some(turned) = self.turns.follow(map, course, nodes, limit_mm) {
                found.push((end.index, turned));
            }
        }
        passed.for_each(|(_, effects)| self.turns.pass(effects));
        block.turns.extend(found.iter().filter(|(_, turned)| turned.is_turn).map(|(index, _)| *index));
        let ends: Vec<Result<Solved, f64>> = found
            .par_iter()
            .map(|(index, turned)| {
                let course = turned.last_stretch(&block.courses[*index], map.windups());
                self.end_by_newton(map, &block.targets[*index], Some(&course))
            })
            .collect();
        for ((index, _), end) in found.iter().zip(ends) {
            match end {
                Ok(end) => block.ends[*index] = Some(end),
                Err(remaining_mm) => block.ways[*index] = Way::Refused(SplitError::NotSolved(remaining_mm)),
            }
        }
        let so_far = &*block;
        let ways: Vec<Result<Vec<Node>, SplitError>> = found
            .par_iter()
            .map(|(index, turned)| {
                let begin = match index.checked_sub(1) {
                    Some(before) => so_far.ends[before].as_ref(),
                    None => self.last_turned.as_ref(),
                };
                self.turned_nodes(map, so_far, &so_far.end_of_move(*index), turned, begin)
            })
            .collect();
        for ((index, _), way) in found.iter().zip(ways) {
            block.ways[*index] = match way {
                Ok(nodes) if nodes.len() == 1 => Way::Whole,
                Ok(nodes) => added(&mut block.pieces[index / MOVES_PER_TASK], &nodes),
                Err(error) => Way::Refused(error),
            };
        }
        if let Some(end) = block.ends.last() {
            self.last_turned = *end;
        }
    }

    /// The nodes of a move for the directions of its stretches: those that it had, and more where these ask for them.
    fn turned_nodes(
        &self,
        map: &impl PathMap,
        block: &Block,
        end: &EndOfMove<'_>,
        turned: &Turned,
        begin: Option<&Solved>,
    ) -> Result<Vec<Node>, SplitError> {
        let nodes = block.nodes_of(end)?;
        let Some(solved) = end.solved else { return Err(SplitError::NotSolved(f64::NAN)) };
        // As of any move, there is no path to keep from a place that no corrected move has reached.
        let Some(begin) = begin.filter(|_| !end.target.is_first) else { return Ok(vec![solved.node]) };
        let course = &block.courses[end.index];
        let closeness = self.closeness_of(end.target, Some(course));
        let (mut again, mut crossings) = (Vec::new(), Vec::new());
        let mut from = Node { share: 0.0, ..begin.node };
        for node in nodes.iter().filter(|node| node.share > 0.0) {
            let piece = turned.stretch(course, from.share, node.share, map.windups());
            let command_mm = if node.share == 1.0 {
                solved.node.command_mm
            } else {
                map.command_for(&node.ideal_mm, &piece.at(1.0), self.newton_mm)
                    .map_err(SplitError::NotSolved)?
            };
            let to = Node { command_mm, ..*node };
            // Shares of a piece are those of its own course.
            let ends = [Node { share: 0.0, ..from }, Node { share: 1.0, ..to }];
            let found = split(map, &piece, &ends[0], &ends[1], &closeness, &mut crossings)?;
            let inner = found.as_deref().unwrap_or_default().split_last().map_or(&[][..], |(_, inner)| inner);
            let share_of = |share: f64| from.share + share * (to.share - from.share);
            again.extend(inner.iter().map(|inner| Node { share: share_of(inner.share), ..*inner }));
            again.push(to);
            from = to;
        }
        Ok(again)
    }

    /// How closely a move is followed: where an axis may be turned, play is left a part of that.
    fn closeness_of(&self, target: &Target, course: Option<&Course>) -> Closeness {
        let mut closeness = self.closeness[usize::from(target.is_inch)];
        if let Some(course) = course {
            closeness.limit_mm *= self.turns.share_of_path(course);
        }
        closeness
    }

    /// The end of a move; else the distance that the best command leaves.
    fn end(&self, map: &impl PathMap, target: &Target, course: Option<&Course>) -> Result<Solved, f64> {
        let by_grid = self.grid.as_ref().and_then(|grid| grid.solved(map, &target.end_mm));
        by_grid.map_or_else(|| self.end_by_newton(map, target, course), Ok)
    }

    fn end_by_newton(
        &self,
        map: &impl PathMap,
        target: &Target,
        course: Option<&Course>,
    ) -> Result<Solved, f64> {
        let ideal_mm = target.end_mm;
        if map.is_nominal() {
            return Ok(Solved::by_newton(Node { share: 1.0, ideal_mm, command_mm: ideal_mm }));
        }
        let approach = course.map_or_else(Default::default, |course| course.at(1.0));
        let command_mm = map.command_for(&ideal_mm, &approach, self.newton_mm)?;
        Ok(Solved::by_newton(Node { share: 1.0, ideal_mm, command_mm }))
    }

    /// The way to the end of a move; None where it is whole.
    #[inline(always)]
    fn other_way<'a>(
        &'a self,
        map: &impl PathMap,
        target: &Target,
        course: Option<&Course>,
        begin: Option<&Solved>,
        end: &Solved,
        memory: &mut Memory<'a, '_>,
    ) -> Option<Way> {
        // A move from a place that no corrected move has reached has no straight path to keep.
        let begin = begin.filter(|_| !target.is_first)?;
        let closeness = &self.closeness[usize::from(target.is_inch)];
        if let Some(grid) = &self.grid {
            if grid.is_straight(begin, end, &memory.near, closeness) {
                return None;
            }
            if let Some(found) = grid.walk(map, begin, end, closeness, &mut memory.near, &mut memory.walk) {
                return (found.len() > 1).then(|| added(memory.pieces, found));
            }
        }
        let begin = Node { share: 0.0, ..begin.node };
        let closeness = self.closeness_of(target, course);
        let map = Gridded { map, grid: self.grid.as_ref() };
        let course = course.copied().unwrap_or_default();
        match split(&map, &course, &begin, &end.node, &closeness, &mut memory.crossings) {
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
