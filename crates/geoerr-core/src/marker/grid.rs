//! The pattern around each vertex of its grid.

use super::scene::{PAD, Scene};

/// Vertices from one module before the marker to one behind it.
const BEYOND: usize = 1;

/// What changes at a vertex of the grid, and the cells around it.
#[derive(Clone, Copy)]
pub(super) struct Vertex {
    /// Whether something changes across its line of s, across its line of t, anywhere around it.
    pub changes: [bool; 3],
    /// Whether a cell is white: above and below its line of t, left and right of its line of s.
    pub is_white: [[bool; 2]; 2],
}

/// One thing for each vertex, row by row.
pub(super) struct OfVertices<T> {
    all: Vec<T>,
    width: usize,
}

impl<T> OfVertices<T> {
    fn new(scene: &Scene<'_>, of: impl Fn([i32; 2]) -> T) -> Self {
        let width = scene.n_modules + 1 + 2 * BEYOND;
        let line = |place: usize| place as i32 - BEYOND as i32;
        let all = (0..width * width).map(|place| of([line(place / width), line(place % width)])).collect();
        Self { all, width }
    }

    /// Of the vertex where a line of t and one of s meet.
    #[inline(always)]
    pub(super) fn at(&self, line_t: f32, line_s: f32) -> &T {
        let place = |line: f32| ((line as i32 + BEYOND as i32).max(0) as usize).min(self.width - 1);
        &self.all[place(line_t) * self.width + place(line_s)]
    }
}

/// The pattern around a vertex: a base value and steps over the nearest `L` grid lines each way.
///
/// As in [`super::model::Block`], of one pixel.
#[derive(Clone, Copy)]
pub(super) struct Steps<const L: usize> {
    pub base: f32,
    pub step_s: [f32; L],
    pub step_t: [f32; L],
    pub vertex: [[f32; L]; L],
}

impl Scene<'_> {
    /// What is around each vertex.
    pub(super) fn vertices(&self) -> OfVertices<Vertex> {
        OfVertices::new(self, |line| {
            let (near, around) = (self.steps_at::<1>(line), self.steps_at::<3>(line));
            let changes = |steps: [f32; 1]| steps[0] != 0.0 || near.vertex[0][0] != 0.0;
            let all = around.step_s.iter().chain(&around.step_t).chain(around.vertex.iter().flatten());
            let is_white = |down: i32, right: i32| self.cell(line[0] - 1 + down, line[1] - 1 + right) > 0.0;
            Vertex {
                changes: [changes(near.step_s), changes(near.step_t), all.copied().any(|step| step != 0.0)],
                is_white: [[is_white(0, 0), is_white(0, 1)], [is_white(1, 0), is_white(1, 1)]],
            }
        })
    }

    /// The steps around each vertex.
    pub(super) fn steps<const L: usize>(&self) -> OfVertices<Steps<L>> {
        OfVertices::new(self, |line| self.steps_at(line))
    }

    fn steps_at<const L: usize>(&self, [line_t, line_s]: [i32; 2]) -> Steps<L> {
        // The cell left of and above the first line.
        let (left, top) = (line_s - 1 - (L / 2) as i32, line_t - 1 - (L / 2) as i32);
        let cell = |down: usize, right: usize| self.cell(top + down as i32, left + right as i32);
        Steps {
            base: cell(0, 0),
            step_s: std::array::from_fn(|i| cell(0, i + 1) - cell(0, i)),
            step_t: std::array::from_fn(|j| cell(j + 1, 0) - cell(j, 0)),
            vertex: std::array::from_fn(|i| {
                std::array::from_fn(|j| (cell(j + 1, i + 1) - cell(j + 1, i)) - (cell(j, i + 1) - cell(j, i)))
            }),
        }
    }

    /// The pattern's cell, white outside.
    fn cell(&self, row: i32, column: i32) -> f32 {
        let width = self.n_modules + 2 * PAD;
        let place = |index: i32| usize::try_from(index + PAD as i32).ok().filter(|&place| place < width);
        match (place(row), place(column)) {
            (Some(row), Some(column)) => self.pattern[row * width + column],
            _ => 1.0,
        }
    }
}
