//! The first-order design at a state, and how its rows are visited.

use std::ops::Range;

use rayon::prelude::*;

use super::problem::BLOCK_ROWS;
use super::shared_bases::AtRows;
use super::term::{Part, Shape};
use super::{Frame, Problem, Sightings, State};
use crate::kinematics::{Channel, ChannelColumns};

/// Everything about the design that does not change from block to block.
#[derive(Debug)]
pub struct Block<'a> {
    pub(super) problem: &'a Problem,
    pub(super) state: &'a State,
    /// Formula columns of all rows: for each part that is a formula, its coefficients' columns one after the other.
    pub(super) formulas: Vec<Vec<f64>>,
    /// Derivatives by its inner parameters likewise.
    pub(super) inner: Vec<Vec<f64>>,
}

/// What one part of the model has at rows: neighbouring functions of a basis, or one column of a formula.
pub(super) enum Runs<'a> {
    Basis { functions: &'a AtRows<'a>, basis: usize, first: usize },
    Column { values: &'a [f64], column: usize },
}

impl Runs<'_> {
    /// Visits the place of each row, the first of its columns, and the values from there on.
    #[inline]
    pub(super) fn each(&self, rows: &[usize], mut visit: impl FnMut(usize, usize, &[f64])) {
        for (at, &row) in rows.iter().enumerate() {
            match *self {
                Self::Basis { functions, basis, first } => {
                    let (begin, values) = functions.of(basis, row, at);
                    visit(at, first + begin, values);
                }
                Self::Column { values, column } => visit(at, column, &values[row..=row]),
            }
        }
    }
}

impl Block<'_> {
    /// Number of unknowns.
    pub fn n_columns(&self) -> usize {
        self.problem.n_columns
    }

    /// Sightings in an order in which those that see the same splines and the same frame stand together: a number of
    /// that, and their place among `rows`.
    pub(super) fn by_cell(&self, rows: &[usize]) -> Vec<(u64, usize)> {
        let Sightings { rows: known, session, .. } = &self.problem.sightings;
        // Some rows at a time: of very many their functions are not kept.
        let of_some = |(step, rows): (usize, &[usize])| {
            let functions = self.problem.bases.at_rows(rows, &known.q_mm);
            let cell = |(at, &row)| (functions.cell(row, at, session[row]), step * BLOCK_ROWS + at);
            rows.iter().enumerate().map(cell).collect::<Vec<_>>()
        };
        let mut cells: Vec<(u64, usize)> =
            rows.par_chunks(BLOCK_ROWS).enumerate().flat_map_iter(of_some).collect();
        cells.par_sort_unstable();
        cells
    }

    /// Visits the entries of the design by runs of neighbouring columns: the first of them, place among the rows, three
    /// whitened numbers, and what these are multiplied with in each column of the run. An entry may come in several parts.
    pub(super) fn each_run(
        &self,
        rows: &[usize],
        row_scale: &[f64],
        visit: impl FnMut(usize, usize, &[f64; 3], &[f64]),
    ) {
        self.each_run_where(rows, row_scale, |_| true, visit);
    }

    /// The same, of parts of the model of whose columns some are wanted.
    pub(super) fn each_run_where(
        &self,
        rows: &[usize],
        row_scale: &[f64],
        is_wanted: impl Fn(Range<usize>) -> bool,
        mut visit: impl FnMut(usize, usize, &[f64; 3], &[f64]),
    ) {
        let sights = self.sights(rows, row_scale);
        self.each_part(rows, &is_wanted, |part, runs| {
            let place = Place::of(part.channel);
            let directions: Vec<[f64; 3]> =
                sights.iter().map(|sight| sight.direction(place, part.factor)).collect();
            runs.each(rows, |at, first, values| visit(first, at, &directions[at], values));
        });
        let first_frame = self.problem.first_frame_column.first();
        let first_other = first_frame.copied().unwrap_or(self.problem.first_shared_column);
        if is_wanted(first_other..self.n_columns()) {
            self.each_entry_of_frames(rows, &sights, |column, at, numbers| {
                visit(column, at, numbers, &[1.0])
            });
        }
    }

    /// What turns displacements at rows into their whitened numbers.
    pub(super) fn sights(&self, rows: &[usize], row_scale: &[f64]) -> Vec<Sight> {
        rows.iter().map(|&row| self.sight(row, row_scale[row])).collect()
    }

    fn sight(&self, row: usize, scale: f64) -> Sight {
        let Sightings { rows, whitening, session, .. } = &self.problem.sightings;
        let model = &self.problem.model;
        let (carrier, q_mm, offset_mm) = (rows.carriers[row], &rows.q_mm[row], &rows.offset_mm[row]);
        let nominal_mm = model.chain().nominal(carrier, q_mm, offset_mm, model.tool_offset_mm());
        let columns = model.chain().channel_columns(carrier, q_mm, offset_mm, model.tool_offset_mm());
        let whitening = whitening[row].map(|w| w.map(|value| value * scale));
        match &self.state.frames[session[row]] {
            Frame::Positions { pose, .. } => {
                let turned = whitening.map(|w| {
                    let m = &pose.camera_from_base;
                    std::array::from_fn(|c| w[0] * m[0][c] + w[1] * m[1][c] + w[2] * m[2][c])
                });
                Sight {
                    from_camera: whitening,
                    from_base: turned,
                    nominal_mm,
                    columns,
                    rig: pose.rig_columns(&nominal_mm),
                }
            }
            Frame::Circle { centre_mm, .. } => {
                let radius = distance(&nominal_mm, centre_mm);
                let outward: [f64; 3] = std::array::from_fn(|c| (nominal_mm[c] - centre_mm[c]) / radius);
                Sight::along_one(&outward, whitening, nominal_mm, columns)
            }
            Frame::Lengths => {
                let along = self.problem.end(row).map_or([0.0; 3], |end| end.along);
                Sight::along_one(&along, whitening, nominal_mm, columns)
            }
        }
    }

    /// Visits the parts of the model of whose columns some are wanted, with what they have at rows.
    pub(super) fn each_part(
        &self,
        rows: &[usize],
        is_wanted: impl Fn(Range<usize>) -> bool,
        mut visit: impl FnMut(&Part, &Runs<'_>),
    ) {
        let Problem { model, bases, sightings, free_inner, .. } = self.problem;
        let n_rows = sightings.rows.len().max(1);
        let functions = bases.at_rows(rows, &sightings.rows.q_mm);
        for (number, (term, part)) in model.parts().enumerate() {
            let first = model.first_coefficient(term);
            let mut column_of = |column: usize, values: &[f64]| {
                if is_wanted(column..column + 1) {
                    visit(part, &Runs::Column { values, column });
                }
            };
            match &part.shape {
                Shape::Basis { basis, .. } => {
                    if is_wanted(first..first + basis.len()) {
                        let basis = bases.of_part(number);
                        visit(part, &Runs::Basis { functions: &functions, basis, first });
                    }
                }
                Shape::Expression { coefficients, inner, .. } => {
                    for (values, &place) in self.formulas[number].chunks_exact(n_rows).zip(coefficients) {
                        column_of(first + place, values);
                    }
                    for (values, &place) in self.inner[number].chunks_exact(n_rows).zip(inner) {
                        let wanted = model.first_inner(term) + place;
                        if let Some(free) = free_inner.iter().position(|&p| p == wanted) {
                            column_of(model.n_coefficients() + free, values);
                        }
                    }
                }
            }
        }
    }

    /// Visits what frames and shared unknowns have at rows: column, place among the rows, three whitened numbers.
    pub(super) fn each_entry_of_frames(
        &self,
        rows: &[usize],
        sights: &[Sight],
        mut visit: impl FnMut(usize, usize, &[f64; 3]),
    ) {
        for (at, (&row, sight)) in rows.iter().zip(sights).enumerate() {
            self.each_entry_of_frame(row, sight, |column, numbers| visit(column, at, numbers));
        }
    }

    fn each_entry_of_frame(&self, row: usize, sight: &Sight, mut visit: impl FnMut(usize, &[f64; 3])) {
        let Sightings { session, shared, n_shared, .. } = &self.problem.sightings;
        let first = self.problem.first_frame_column[session[row]];
        match &self.state.frames[session[row]] {
            Frame::Positions { pivot_mm, turns, .. } => {
                for axis in 0..3 {
                    visit(first + axis, &std::array::from_fn(|c| sight.from_base[c][axis]));
                }
                if *turns {
                    let arm: [f64; 3] = std::array::from_fn(|c| sight.nominal_mm[c] - pivot_mm[c]);
                    let turned = [[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]];
                    for (axis, by) in turned.iter().enumerate() {
                        visit(first + 3 + axis, &apply(&sight.from_base, by));
                    }
                }
            }
            Frame::Circle { .. } => {
                for axis in 0..3 {
                    visit(first + axis, &[-sight.from_base[0][axis], 0.0, 0.0]);
                }
                visit(first + 3, &[sight.from_camera[0][0], 0.0, 0.0]);
            }
            Frame::Lengths => {}
        }
        for unknown in 0..*n_shared {
            let by: [f64; 3] = std::array::from_fn(|c| shared[(row * 3 + c) * n_shared + unknown]);
            visit(self.problem.first_shared_column + unknown, &apply(&sight.from_camera, &by));
        }
    }
}

/// What a row's device makes of displacements of its point.
pub(super) struct Sight {
    /// Whitened numbers from a vector of the measuring frame.
    from_camera: [[f64; 3]; 3],
    /// Whitened numbers from a vector of the base frame.
    from_base: [[f64; 3]; 3],
    nominal_mm: [f64; 3],
    columns: ChannelColumns,
    rig: [[f64; 3]; Channel::RIG_COLUMN_COUNT],
}

impl Sight {
    /// Of a device that measures one number along a direction, and no point.
    fn along_one(
        direction: &[f64; 3],
        whitening: [[f64; 3]; 3],
        nominal_mm: [f64; 3],
        columns: ChannelColumns,
    ) -> Self {
        Self {
            from_base: [direction.map(|u| u * whitening[0][0]), [0.0; 3], [0.0; 3]],
            from_camera: whitening,
            nominal_mm,
            columns,
            rig: [[0.0; 3]; Channel::RIG_COLUMN_COUNT],
        }
    }

    /// Whitened numbers from one unit on a channel.
    fn direction(&self, place: Place, factor: f64) -> [f64; 3] {
        let seen = match place {
            Place::Base(column) => apply(&self.from_base, &self.columns[column]),
            Place::Camera(column) => apply(&self.from_camera, &self.rig[column]),
            Place::Nowhere => [0.0; 3],
        };
        seen.map(|value| value * factor)
    }

    /// What a unit on a channel moves, as seen by numbers of the row.
    #[inline]
    pub(super) fn along(&self, seen: &Seen, place: Place) -> f64 {
        match place {
            Place::Base(column) => dot(&seen.in_base, &self.columns[column]),
            Place::Camera(column) => dot(&seen.in_camera, &self.rig[column]),
            Place::Nowhere => 0.0,
        }
    }

    /// Adds so much on a channel to what displaces the row's point.
    #[inline]
    pub(super) fn add(&self, moved: &mut Seen, place: Place, amount: f64) {
        let (sum, column) = match place {
            Place::Base(column) => (&mut moved.in_base, &self.columns[column]),
            Place::Camera(column) => (&mut moved.in_camera, &self.rig[column]),
            Place::Nowhere => return,
        };
        sum.iter_mut().zip(column).for_each(|(sum, by)| *sum += amount * by);
    }

    /// What a vector of each frame has to be multiplied with to give the sum of its whitened numbers times these.
    pub(super) fn seen_by(&self, numbers: &[f64; 3]) -> Seen {
        let of = |matrix: &[[f64; 3]; 3]| {
            std::array::from_fn(|c| (0..3).map(|row| matrix[row][c] * numbers[row]).sum())
        };
        Seen { in_base: of(&self.from_base), in_camera: of(&self.from_camera) }
    }

    /// Whitened numbers of displacements.
    pub(super) fn numbers_of(&self, moved: &Seen) -> [f64; 3] {
        let (of_base, of_camera) =
            (apply(&self.from_base, &moved.in_base), apply(&self.from_camera, &moved.in_camera));
        std::array::from_fn(|c| of_base[c] + of_camera[c])
    }
}

/// Where a channel displaces points: its column of those of the base frame, or of the measuring one.
#[derive(Clone, Copy)]
pub(super) enum Place {
    Base(usize),
    Camera(usize),
    Nowhere,
}

impl Place {
    pub(super) fn of(channel: Channel) -> Self {
        match (channel.base_column(), channel.rig_column()) {
            (Some(column), _) => Self::Base(column),
            (None, Some(column)) => Self::Camera(column),
            (None, None) => Self::Nowhere,
        }
    }
}

/// Vectors of the base frame and of the measuring frame.
#[derive(Clone, Copy, Default)]
pub(super) struct Seen {
    in_base: [f64; 3],
    in_camera: [f64; 3],
}

#[inline]
fn apply(matrix: &[[f64; 3]; 3], v: &[f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

#[inline]
pub(super) fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}
