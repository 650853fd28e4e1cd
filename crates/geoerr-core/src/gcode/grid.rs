//! A machine everywhere in its range by polynomials in boxes, made where a program first comes.
//!
//! Newton's method asks a machine three times for its errors with all derivatives; a program of short moves asks it a
//! million times in the same few boxes. A box's polynomials ([`Patch`]) answer from 27 coefficients, and say besides
//! how much a line through it can bend, so that most moves need not be looked at for splitting either.
//!
//! What a box's polynomials are, and whether it has any, depends on the machine alone: the same target has the same
//! command in every program, on any number of threads, whatever was forgotten in between.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::patch::Patch;
use super::path::{Closeness, Node, PathMap, distance};
use crate::volumetric::{Approach, MotionNeeds};

/// Widest box.
const WIDEST_MM: f64 = 10.0;

/// More boxes than this are too many to list.
const MOST_BOXES: usize = 1 << 20;

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
    boxes: Vec<OnceLock<Option<Box<Patch>>>>,
    n_made: AtomicUsize,
    tolerance_mm: f64,
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
        let mut axes = Vec::new();
        let mut n_boxes = 1_usize;
        for (axis, &range) in range_mm.iter().enumerate() {
            let edges = Edges::new(range, map.knots(axis))?;
            n_boxes = n_boxes.checked_mul(edges.n_cells()).filter(|&n| n <= MOST_BOXES)?;
            axes.push(edges);
        }
        let boxes = std::iter::repeat_with(OnceLock::new).take(n_boxes).collect();
        let tolerance_mm = SHARE_OF_TOLERANCE * newton_mm;
        Some(Self { axes: axes.try_into().ok()?, boxes, n_made: AtomicUsize::new(0), tolerance_mm })
    }

    /// Forgets polynomials where there are too many.
    pub fn tidy(&mut self) {
        if *self.n_made.get_mut() > MOST_MADE {
            self.boxes.fill_with(OnceLock::new);
            *self.n_made.get_mut() = 0;
        }
    }

    /// Where a command puts the tool, where a polynomial has it.
    #[inline]
    fn actual(&self, map: &impl PathMap, command_mm: &[f64; 3]) -> Option<[f64; 3]> {
        Some(self.patch(map, self.cells_of(command_mm)?)?.actual(command_mm))
    }

    /// The command for a place, where a polynomial has it.
    #[inline]
    pub fn solve(&self, map: &impl PathMap, ideal_mm: &[f64; 3]) -> Option<Solved> {
        let mut at_mm = *ideal_mm;
        for _ in 0..MOST_HOPS {
            let cells = self.cells_of(&at_mm)?;
            let place = self.place_of(cells);
            let patch = self.patch(map, cells)?;
            let command_mm = patch.command_for(ideal_mm);
            if patch.holds(&command_mm) {
                let node = Node { share: 1.0, ideal_mm: *ideal_mm, command_mm };
                return Some(Solved { node, home: Some(place as u32) });
            }
            at_mm = command_mm;
        }
        None
    }

    /// Whether a straight move between two solved places is known to stay straight enough whole.
    ///
    /// Between commands that are right at its ends the command of a move is off by at most `M L²/8` where the second
    /// derivative of the correction is at most M, and by `V L/4` where its first derivative changes by at most V on
    /// the way. Where the way leaves the boxes by as much as it is off, that is a fifth more, as corrections change by
    /// less than a tenth; for the same reason the tool is off by at most an eighth more than the command; and the bound
    /// that [`split`](super::path::split) goes by is at most a quarter above that: together less than twice as much.
    #[inline]
    pub fn is_straight(&self, begin: &Solved, end: &Solved, closeness: &Closeness) -> bool {
        let (Some(from), Some(to)) = (begin.home, end.home) else { return false };
        let (Some(patch), length_mm) = (self.made(to), distance(&begin.node.ideal_mm, &end.node.ideal_mm))
        else {
            return false;
        };
        let off_mm = if from == to {
            0.125 * patch.bend_per_mm * length_mm * length_mm
        } else {
            let Some(other) = self.made(from).filter(|_| self.are_neighbours(from, to)) else { return false };
            let jump = norm_of_difference(&patch.slopes, &other.slopes);
            let bends = (patch.bend_per_mm + other.bend_per_mm) * (patch.radius_mm + other.radius_mm);
            0.25 * (jump + bends) * length_mm
        };
        2.0 * (off_mm + 2.0 * closeness.newton_mm) <= closeness.limit_mm
    }

    #[inline]
    fn cells_of(&self, at_mm: &[f64; 3]) -> Option<[usize; 3]> {
        Some([self.axes[0].cell(at_mm[0])?, self.axes[1].cell(at_mm[1])?, self.axes[2].cell(at_mm[2])?])
    }

    #[inline]
    fn place_of(&self, cells: [usize; 3]) -> usize {
        (cells[2] * self.axes[1].n_cells() + cells[1]) * self.axes[0].n_cells() + cells[0]
    }

    #[inline]
    fn made(&self, place: u32) -> Option<&Patch> {
        self.boxes.get(place as usize)?.get()?.as_deref()
    }

    #[inline]
    fn patch(&self, map: &impl PathMap, cells: [usize; 3]) -> Option<&Patch> {
        self.boxes.get(self.place_of(cells))?.get_or_init(|| self.make(map, cells)).as_deref()
    }

    #[cold]
    fn make(&self, map: &impl PathMap, cells: [usize; 3]) -> Option<Box<Patch>> {
        self.n_made.fetch_add(1, Ordering::Relaxed);
        let edge = |axis: usize, further: usize| self.axes[axis].edges_mm[cells[axis] + further];
        let low_mm = std::array::from_fn(|axis| edge(axis, 0));
        let high_mm = std::array::from_fn(|axis| edge(axis, 1));
        Patch::new(map, low_mm, high_mm, self.tolerance_mm).map(Box::new)
    }

    /// Whether two boxes share a face: a line from one to the other then lies in these two.
    #[inline]
    fn are_neighbours(&self, one: u32, other: u32) -> bool {
        let (nx, ny) = (self.axes[0].n_cells() as u32, self.axes[1].n_cells() as u32);
        let cells = |place: u32| [place % nx, place / nx % ny, place / nx / ny];
        let (one, other) = (cells(one), cells(other));
        (0..3).map(|axis| one[axis].abs_diff(other[axis])).sum::<u32>() == 1
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

impl<M: PathMap> PathMap for Gridded<'_, M> {
    fn command_for(
        &self,
        ideal_mm: &[f64; 3],
        approach: &Approach,
        tolerance_mm: f64,
    ) -> Result<[f64; 3], f64> {
        match self.grid.and_then(|grid| grid.solve(self.map, ideal_mm)) {
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
}

impl Solved {
    /// A place that Newton's method has solved.
    pub fn by_newton(node: Node) -> Self {
        Self { node, home: None }
    }
}

#[inline]
fn norm_of_difference(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> f64 {
    let squares = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>().sqrt()
}

/// Edges of the boxes along one axis, with a way to find the cell of a position without searching.
#[derive(Debug)]
struct Edges {
    edges_mm: Vec<f64>,
    low_mm: f64,
    buckets_per_mm: f64,
    /// The cell in which each bucket begins.
    first: Vec<u32>,
}

impl Edges {
    fn new(range_mm: (f64, f64), knots_mm: &[f64]) -> Option<Self> {
        let (low_mm, high_mm) = range_mm;
        let length_mm = high_mm - low_mm;
        if !(length_mm > 0.0 && length_mm.is_finite()) {
            return None;
        }
        let inner = knots_mm.iter().copied().filter(|&knot| low_mm < knot && knot < high_mm);
        let kinks_mm: Vec<f64> = std::iter::once(low_mm).chain(inner).chain([high_mm]).collect();
        let wanted: f64 = kinks_mm.windows(2).map(|pair| ((pair[1] - pair[0]) / WIDEST_MM).ceil()).sum();
        if wanted > MOST_BOXES as f64 {
            return None;
        }
        let mut edges_mm = Vec::new();
        for pair in kinks_mm.windows(2) {
            let n_cells = ((pair[1] - pair[0]) / WIDEST_MM).ceil().max(1.0);
            let inside =
                (0..n_cells as u32).map(|cell| pair[0] + f64::from(cell) / n_cells * (pair[1] - pair[0]));
            edges_mm.extend(inside);
        }
        edges_mm.push(high_mm);
        let n_buckets = 4 * (edges_mm.len() - 1);
        let buckets_per_mm = n_buckets as f64 / length_mm;
        let begin_mm = |bucket: usize| low_mm + bucket as f64 / buckets_per_mm;
        // A bucket too early is put right by the search for the cell; one too late would not be.
        let cell_of = |at_mm: f64| edges_mm.partition_point(|&edge| edge <= at_mm).saturating_sub(1);
        let first =
            (0..n_buckets).map(|bucket| cell_of(begin_mm(bucket) - 1e-9 * length_mm) as u32).collect();
        Some(Self { low_mm, buckets_per_mm, first, edges_mm })
    }

    #[inline]
    fn n_cells(&self) -> usize {
        self.edges_mm.len() - 1
    }

    /// The cell from its lower edge to below its upper one; None outside.
    #[inline]
    fn cell(&self, at_mm: f64) -> Option<usize> {
        let bucket = (at_mm - self.low_mm) * self.buckets_per_mm;
        // Not a number is outside.
        if !(bucket >= 0.0) {
            return None;
        }
        let mut cell = *self.first.get(bucket as i64 as usize)? as usize;
        while *self.edges_mm.get(cell + 1)? <= at_mm {
            cell += 1;
        }
        Some(cell)
    }
}
