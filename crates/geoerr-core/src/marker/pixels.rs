//! Which pixels take part: those near an edge, and some in the flat.

use super::flat::{Flat, FlatPixels};
use super::lanes::{Lanes, WIDTH};
use super::model::{Block, Evaluated, Place, SATURATED_GREY, State, View, evaluate, light_at};
use super::scene::{PAD, QUIET_MODULES, Scene};
use crate::arithmetic::in_wide_registers;

/// Pixels further than this many blurs from every edge carry no place, only brightness.
const REACH_SIGMAS: f32 = 3.0;
/// Grid lines that are nearer than so many blurs to a pixel's nearest one matter to it, too.
const ALONE_SIGMAS: f32 = 5.0;
/// How near lines are to each other is looked at in every so many-th pixel each way.
const SPARSE: usize = 4;
const MOST_FLAT_PIXELS: usize = 40_000;

/// Pixels near edges: each with its nearest grid line each way, or in a small or blurred marker with its nearest three.
pub(super) enum Edge {
    One(Vec<Block<1>>),
    Three(Vec<Block<3>>),
}

/// Pixels that take part.
pub(super) struct Pixels {
    pub edge: Edge,
    /// Number of pixels near edges: the last block may have room for more.
    pub n_edge: usize,
    pub flat: Flat,
}

impl Pixels {
    /// Calls `visit` with every block's weights and what it evaluates to; `all` counts also pixels that do not.
    ///
    /// Compiled for wide registers: `visit` has to be `#[inline(always)]`.
    #[inline(always)]
    pub(super) fn each(
        &self,
        state: &State,
        scene: &Scene<'_>,
        all: bool,
        mut visit: impl FnMut(Lanes, &Evaluated),
    ) {
        let view = View::new(state, scene.ray_from_pixel);
        let n_edge = self.n_edge;
        in_wide_registers(
            #[inline(always)]
            || match &self.edge {
                Edge::One(blocks) => each_of(&view, blocks, n_edge, all, &mut visit),
                Edge::Three(blocks) => each_of(&view, blocks, n_edge, all, &mut visit),
            },
        );
    }

    /// Weights of the pixels near edges, in their order.
    pub(super) fn kept(&self) -> Vec<bool> {
        let mut kept: Vec<bool> = match &self.edge {
            Edge::One(blocks) => {
                blocks.iter().flat_map(|block| block.kept.0).map(|value| value > 0.0).collect()
            }
            Edge::Three(blocks) => {
                blocks.iter().flat_map(|block| block.kept.0).map(|value| value > 0.0).collect()
            }
        };
        kept.truncate(self.n_edge);
        kept
    }

    /// Sets them.
    pub(super) fn keep(&mut self, kept: &[bool]) {
        let blocks: Box<dyn Iterator<Item = &mut Lanes>> = match &mut self.edge {
            Edge::One(blocks) => Box::new(blocks.iter_mut().map(|block| &mut block.kept)),
            Edge::Three(blocks) => Box::new(blocks.iter_mut().map(|block| &mut block.kept)),
        };
        for (lanes, kept) in blocks.zip(kept.chunks(WIDTH)) {
            for (lane, &kept) in lanes.0.iter_mut().zip(kept) {
                *lane = f32::from(u8::from(kept));
            }
        }
    }
}

#[inline(always)]
fn each_of<const L: usize>(
    view: &View,
    blocks: &[Block<L>],
    n_edge: usize,
    all: bool,
    visit: &mut impl FnMut(Lanes, &Evaluated),
) {
    for (number, block) in blocks.iter().enumerate() {
        let left = n_edge - number * WIDTH;
        let kept = if all { Lanes::from_fn(|lane| if lane < left { 1.0 } else { 0.0 }) } else { block.kept };
        visit(kept, &evaluate(view, block, kept));
    }
}

/// A pixel inside the marker and its quiet zone.
struct Inside {
    row: usize,
    column: usize,
    s: f32,
    t: f32,
    /// The nearest grid lines.
    line_s: f32,
    line_t: f32,
    per_s: f32,
    per_t: f32,
}

/// A pixel near an edge and its nearest grid lines.
#[derive(Clone, Copy)]
struct Tied {
    row: u32,
    column: u32,
    line_s: f32,
    line_t: f32,
}

impl Inside {
    fn tied(&self) -> Tied {
        Tied { row: self.row as u32, column: self.column as u32, line_s: self.line_s, line_t: self.line_t }
    }

    /// The cell it lies in: row and column.
    fn cell(&self) -> [i32; 2] {
        let of = |place: f32, line: f32| line as i32 - i32::from(place < line);
        [of(self.t, self.line_t), of(self.s, self.line_s)]
    }
}

/// What changes at the vertices of the grid: across lines of s and of t, at the vertex itself or anywhere around it.
struct Changes {
    /// Vertices from one module before the marker to one behind it, row by row.
    of_vertex: Vec<[bool; 3]>,
    width: usize,
}

impl Changes {
    fn new(scene: &Scene<'_>) -> Self {
        let width = scene.n_modules + 3;
        let of_vertex = (0..width * width)
            .map(|place| {
                let line = [place / width, place % width].map(|line| line as i32 - 1);
                let (near, around) = (scene.steps::<1>(line), scene.steps::<3>(line));
                let changes = |steps: [f32; 1]| steps[0] != 0.0 || near.vertex[0][0] != 0.0;
                let all = around.step_s.iter().chain(&around.step_t).chain(around.vertex.iter().flatten());
                [changes(near.step_s), changes(near.step_t), all.copied().any(|step| step != 0.0)]
            })
            .collect();
        Self { of_vertex, width }
    }

    /// Whether a pixel is near enough to an edge to say where it is.
    fn is_near(&self, one: &Inside, n_lines: usize) -> bool {
        let place = |line: f32| (line as i32 + 1).clamp(0, self.width as i32 - 1) as usize;
        let [in_s, in_t, around] = self.of_vertex[place(one.line_t) * self.width + place(one.line_s)];
        if n_lines > 1 {
            return around;
        }
        let close = |place: f32, line: f32, per: f32| (place - line).abs() * per < REACH_SIGMAS;
        (in_s && close(one.s, one.line_s, one.per_s)) || (in_t && close(one.t, one.line_t, one.per_t))
    }
}

impl Scene<'_> {
    /// Chooses pixels, and ties those near edges to their nearest grid lines.
    pub(super) fn select(&self, state: &State, most: usize, stride: usize) -> Pixels {
        let mut least = 99.0_f32;
        self.each_inside(
            state,
            SPARSE * stride,
            #[inline(always)]
            |one| least = least.min(one.per_s).min(one.per_t),
        );
        let n_lines = if 0.5 * least > ALONE_SIGMAS { 1 } else { 3 };
        let changes = Changes::new(self);
        let mut edge: Vec<Tied> = Vec::new();
        let mut flat = [FlatPixels::default(), FlatPixels::default()];
        self.each_inside(
            state,
            stride,
            #[inline(always)]
            |one| {
                if changes.is_near(one, n_lines) {
                    edge.push(one.tied());
                    return;
                }
                let grey = self.row(one.row)[one.column];
                if f32::from(grey) < SATURATED_GREY {
                    let [row, column] = one.cell();
                    let is_white = self.cell(row, column) > 0.0;
                    flat[usize::from(is_white)].push(self.off_centre(one.row, one.column), grey);
                }
            },
        );
        let edge: Vec<Tied> = edge.iter().step_by(1 + edge.len() / most).copied().collect();
        let thinned = 1 + flat.iter().map(FlatPixels::len).sum::<usize>() / MOST_FLAT_PIXELS;
        Pixels {
            n_edge: edge.len(),
            flat: Flat::new(flat.map(|own| own.every(thinned))),
            edge: if n_lines == 1 { Edge::One(self.blocks(&edge)) } else { Edge::Three(self.blocks(&edge)) },
        }
    }

    /// Calls `visit`, which has to be `#[inline(always)]`, with every pixel inside the marker and its quiet zone.
    #[inline(always)]
    fn each_inside(&self, state: &State, stride: usize, mut visit: impl FnMut(&Inside)) {
        let view = View::new(state, self.ray_from_pixel);
        let (low, high) = (-QUIET_MODULES as f32, (self.n_modules as f64 + QUIET_MODULES) as f32);
        in_wide_registers(
            #[inline(always)]
            || {
                for row in (0..self.height).step_by(stride) {
                    let rays = row * self.width..(row + 1) * self.width;
                    let (x, y) = (&self.x[rays.clone()], &self.y[rays]);
                    for first in (0..self.width).step_by(WIDTH * stride) {
                        let at = |lane: usize| first + lane * stride;
                        let ray = |all: &[f32]| match all[first..].first_chunk() {
                            Some(own) if stride == 1 => Lanes(*own),
                            // Behind the end of a row nothing is inside.
                            _ => Lanes::from_fn(|lane| all.get(at(lane)).copied().unwrap_or(f32::NAN)),
                        };
                        let place = Place::of(&view, ray(x), ray(y));
                        let (line_s, line_t) = (place.s.rounded(), place.t.rounded());
                        for lane in 0..WIDTH {
                            let (s, t) = (place.s.0[lane], place.t.0[lane]);
                            if s > low && s < high && t > low && t < high {
                                visit(&Inside {
                                    row,
                                    column: at(lane),
                                    s,
                                    t,
                                    line_s: line_s.0[lane],
                                    line_t: line_t.0[lane],
                                    per_s: place.per_s.0[lane],
                                    per_t: place.per_t.0[lane],
                                });
                            }
                        }
                    }
                }
            },
        );
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

    /// The pattern around a vertex, its lines of t and of s, as a base value and steps over the nearest grid lines.
    fn steps<const L: usize>(&self, [line_t, line_s]: [i32; 2]) -> Steps<L> {
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

    /// From the marker's centre, in halves of its side.
    fn off_centre(&self, row: usize, column: usize) -> [f32; 2] {
        let of = |pixel: usize, c: usize| ((pixel as f64 - self.centre_px[c]) * self.per_half_px) as f32;
        [of(column + self.left, 0), of(row + self.top, 1)]
    }

    fn blocks<const L: usize>(&self, pixels: &[Tied]) -> Vec<Block<L>> {
        (pixels.chunks(WIDTH))
            .map(|own| {
                let mut block = Block::EMPTY;
                for (lane, one) in own.iter().enumerate() {
                    let (row, column) = (one.row as usize, one.column as usize);
                    let place = row * self.width + column;
                    let steps = self.steps::<L>([one.line_t as i32, one.line_s as i32]);
                    let offset = |i: usize| i as f32 - (L / 2) as f32;
                    for (target, value) in block.light.iter_mut().zip(light_at(self.off_centre(row, column)))
                    {
                        target.0[lane] = value;
                    }
                    block.x.0[lane] = self.x[place];
                    block.y.0[lane] = self.y[place];
                    block.grey.0[lane] = f32::from(self.row(row)[column]);
                    block.base.0[lane] = steps.base;
                    block.kept.0[lane] = 1.0;
                    for i in 0..L {
                        block.line_s[i].0[lane] = one.line_s + offset(i);
                        block.line_t[i].0[lane] = one.line_t + offset(i);
                        block.step_s[i].0[lane] = steps.step_s[i];
                        block.step_t[i].0[lane] = steps.step_t[i];
                        for j in 0..L {
                            block.vertex[i][j].0[lane] = steps.vertex[i][j];
                        }
                    }
                }
                block
            })
            .collect()
    }
}

/// As in [`Block`], of one pixel.
struct Steps<const L: usize> {
    base: f32,
    step_s: [f32; L],
    step_t: [f32; L],
    vertex: [[f32; L]; L],
}
