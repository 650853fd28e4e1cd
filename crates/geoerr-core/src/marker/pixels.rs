//! Which pixels take part: those near an edge, and some in the flat.

use super::flat::{Flat, FlatPixels};
use super::grid::Vertex;
use super::lanes::{Lanes, WIDTH};
use super::model::{Block, Evaluated, Place, SATURATED_GREY, State, View, evaluate, light_at};
use super::scene::{QUIET_MODULES, Scene};
use crate::arithmetic::in_512_bits;

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
        in_512_bits(
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

    /// Whether it is near enough to an edge to say where it is.
    #[inline(always)]
    fn is_near(&self, vertex: &Vertex, n_lines: usize) -> bool {
        let [across_s, across_t, around] = vertex.changes;
        if n_lines > 1 {
            return around;
        }
        let close = |place: f32, line: f32, per: f32| (place - line).abs() * per < REACH_SIGMAS;
        (across_s && close(self.s, self.line_s, self.per_s))
            || (across_t && close(self.t, self.line_t, self.per_t))
    }

    #[inline(always)]
    fn is_white(&self, vertex: &Vertex) -> bool {
        vertex.is_white[usize::from(self.t >= self.line_t)][usize::from(self.s >= self.line_s)]
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
        let vertices = self.vertices();
        let mut edge: Vec<Tied> = Vec::new();
        let mut flat = [FlatPixels::default(), FlatPixels::default()];
        self.each_inside(
            state,
            stride,
            #[inline(always)]
            |one| {
                let vertex = vertices.at(one.line_t, one.line_s);
                if one.is_near(vertex, n_lines) {
                    edge.push(one.tied());
                    return;
                }
                let grey = self.row(one.row)[one.column];
                if f32::from(grey) < SATURATED_GREY {
                    flat[usize::from(one.is_white(vertex))].push(self.off_centre(one.row, one.column), grey);
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
        in_512_bits(
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

    fn blocks<const L: usize>(&self, pixels: &[Tied]) -> Vec<Block<L>> {
        let of_vertices = self.steps::<L>();
        (pixels.chunks(WIDTH))
            .map(|own| {
                let mut block = Block::EMPTY;
                for (lane, one) in own.iter().enumerate() {
                    let (row, column) = (one.row as usize, one.column as usize);
                    let place = row * self.width + column;
                    let steps = of_vertices.at(one.line_t, one.line_s);
                    let offset = |i: usize| i as f32 - (L / 2) as f32;
                    for (target, value) in
                        block.light.iter_mut().zip(light_at(1.0, self.off_centre(row, column)))
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
