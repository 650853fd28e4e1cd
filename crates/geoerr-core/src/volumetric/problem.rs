//! The least-squares problem: exact residuals, and the first-order design in blocks of rows.

use rayon::prelude::*;

use super::shared_bases::SharedBases;
use super::term::{Shape, VolumetricModel};
use super::values::{channel_values_of_bases, check_parameters};
use super::{ChannelValues, Frame, Rows, VolumetricError};
use crate::kinematics::{Channel, ChannelColumns, Displacements, rig_displacement};
use crate::least_squares::Matrix;

/// Observed rows of a block of the design: large against the columns of a usual model, so that the triangles of blocks
/// cost little to merge.
pub const BLOCK_ROWS: usize = 512;

/// Numbers that a row contributes: three components, whitened.
pub const NUMBERS_OF_A_ROW: usize = 3;

/// What was measured.
#[derive(Debug, Clone, Default)]
pub struct Sightings {
    /// Where and when.
    pub rows: Rows,
    /// In the measuring frame, mm; 0 where not measured. A radius stands in the first component.
    pub measured_mm: Vec<[f64; 3]>,
    /// W of each row, W C Wᵀ = 1; zero in rows and columns of components that were not measured, 1/mm.
    pub whitening: Vec<[[f64; 3]; 3]>,
    /// Session of each row.
    pub session: Vec<usize>,
    /// Derivative of each measured point by further shared unknowns (a rig's calibration), `[row][component][unknown]`
    /// without gaps.
    pub shared: Vec<f64>,
    /// How many such unknowns.
    pub n_shared: usize,
}

/// All unknowns at one iteration.
#[derive(Debug, Clone, Default)]
pub struct State {
    /// Linear coefficients of all terms.
    pub coefficients: Vec<f64>,
    /// Inner parameters of all terms.
    pub inner: Vec<f64>,
    /// How each session's device stands.
    pub frames: Vec<Frame>,
    /// The further shared unknowns.
    pub shared: Vec<f64>,
}

/// A model, what was measured of it, and which inner parameters are free.
///
/// Columns: coefficients, free inner parameters, the frames' unknowns session by session, shared unknowns.
#[derive(Debug, Clone)]
pub struct Problem {
    model: VolumetricModel,
    bases: SharedBases,
    sightings: Sightings,
    /// Places of the free inner parameters.
    free_inner: Vec<usize>,
    first_frame_column: Vec<usize>,
    first_shared_column: usize,
    n_columns: usize,
}

/// Everything about the design that does not change from block to block.
#[derive(Debug)]
pub struct Block<'a> {
    problem: &'a Problem,
    state: &'a State,
    /// Formula columns of all rows: for each part that is a formula, its coefficients' columns one after the other.
    formulas: Vec<Vec<f64>>,
    /// Derivatives by its inner parameters likewise.
    inner: Vec<Vec<f64>>,
}

impl Problem {
    /// Poses the problem.
    ///
    /// # Errors
    /// [`VolumetricError::Length`], [`VolumetricError::Session`].
    pub fn new(
        model: VolumetricModel,
        sightings: Sightings,
        frames: &[Frame],
        free_inner: Vec<usize>,
    ) -> Result<Self, VolumetricError> {
        sightings.rows.check()?;
        let n_rows = sightings.rows.len();
        let same = |what, found, needed| {
            if found == needed { Ok(()) } else { Err(VolumetricError::Length { what, found, needed }) }
        };
        same("measured_mm", sightings.measured_mm.len(), n_rows)?;
        same("whitening", sightings.whitening.len(), n_rows)?;
        same("session", sightings.session.len(), n_rows)?;
        same("shared", sightings.shared.len(), n_rows * 3 * sightings.n_shared)?;
        let n_sessions = frames.len();
        if let Some(row) = sightings.session.iter().position(|&session| session >= n_sessions) {
            let session = sightings.session[row];
            return Err(VolumetricError::Session { row, session, n_sessions });
        }
        let n_inner = model.n_inner();
        if free_inner.iter().any(|&place| place >= n_inner) {
            return Err(VolumetricError::Length {
                what: "free_inner",
                found: free_inner.len(),
                needed: n_inner,
            });
        }
        let mut next = model.n_coefficients() + free_inner.len();
        let first_frame_column = frames
            .iter()
            .map(|frame| {
                let first = next;
                next += frame.n_columns();
                first
            })
            .collect();
        let n_columns = next + sightings.n_shared;
        let bases = SharedBases::of(model.parts().map(|(_, part)| part));
        let first_shared_column = next;
        Ok(Self { model, bases, sightings, free_inner, first_frame_column, first_shared_column, n_columns })
    }

    /// The model.
    pub fn model(&self) -> &VolumetricModel {
        &self.model
    }

    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.sightings.rows.len()
    }

    /// Number of unknowns.
    pub fn n_columns(&self) -> usize {
        self.n_columns
    }

    /// Column of a session's first unknown.
    pub fn first_frame_column(&self, session: usize) -> usize {
        self.first_frame_column[session]
    }

    /// Column of the first shared unknown.
    pub fn first_shared_column(&self) -> usize {
        self.first_shared_column
    }

    /// Session of each row.
    pub fn session(&self) -> &[usize] {
        &self.sightings.session
    }

    /// Measured minus predicted, in the measuring frame, mm (a radius in the first component), by the exact chain and
    /// rig; 0 in components that were not measured.
    ///
    /// # Errors
    /// [`VolumetricError::Length`].
    pub fn residuals(&self, state: &State) -> Result<Vec<[f64; 3]>, VolumetricError> {
        self.check(state)?;
        let rows = &self.sightings.rows;
        self.bases.keep(&rows.q_mm);
        let State { coefficients, inner, .. } = state;
        let values = channel_values_of_bases(&self.model, &self.bases, rows, coefficients, inner)?;
        Ok((0..rows.len())
            .into_par_iter()
            .with_min_len(BLOCK_ROWS)
            .map(|row| self.residual(state, &values, row))
            .collect())
    }

    fn residual(&self, state: &State, values: &ChannelValues, row: usize) -> [f64; 3] {
        let Sightings { rows, measured_mm, whitening, session, shared, n_shared } = &self.sightings;
        let (chain, tool) = (self.model.chain(), self.model.tool_offset_mm());
        let (carrier, q_mm, offset_mm) = (rows.carriers[row], &rows.q_mm[row], &rows.offset_mm[row]);
        let numbers = values.at(row);
        let mut machine = [0.0; Channel::MACHINE_COUNT];
        machine.copy_from_slice(&numbers[..Channel::MACHINE_COUNT]);
        let displacements = Displacements::from_channels(&machine);
        let nominal = chain.nominal(carrier, q_mm, offset_mm, tool);
        let mut moved = chain.displacement(carrier, q_mm, offset_mm, tool, &displacements);
        let motion = &numbers[Channel::MACHINE_COUNT + Channel::RIG_COLUMN_COUNT..];
        if motion.iter().any(|&value| value != 0.0) {
            let columns = chain.channel_columns(carrier, q_mm, offset_mm, tool);
            for (axis, value) in motion.iter().enumerate() {
                for c in 0..3 {
                    moved[c] += value * columns[Channel::MACHINE_COUNT + axis][c];
                }
            }
        }
        let base: [f64; 3] = std::array::from_fn(|c| nominal[c] + moved[c]);
        let measured = &measured_mm[row];
        let mut residual = match &state.frames[session[row]] {
            Frame::Positions { pose, .. } => {
                let mut rig = [0.0; Channel::RIG_COLUMN_COUNT];
                rig.copy_from_slice(&numbers[Channel::MACHINE_COUNT..][..Channel::RIG_COLUMN_COUNT]);
                let camera = pose.to_camera(&base);
                let added = rig_displacement(&rig, &camera);
                std::array::from_fn(|c| measured[c] - (camera[c] + added[c]))
            }
            Frame::Circle { centre_mm, excess_mm } => {
                let radius = distance(&base, centre_mm);
                [measured[0] - (radius + excess_mm), 0.0, 0.0]
            }
        };
        for (c, value) in residual.iter_mut().enumerate() {
            if whitening[row][c][c] == 0.0 {
                // Not measured.
                *value = 0.0;
                continue;
            }
            let own = &shared[(row * 3 + c) * n_shared..][..*n_shared];
            *value -= own.iter().zip(&state.shared).map(|(by, unknown)| by * unknown).sum::<f64>();
        }
        residual
    }

    /// How a correction of all unknowns moves the measured points, to first order, mm; 0 where not measured.
    ///
    /// # Errors
    /// As [`Problem::blocks`].
    pub fn first_order_mm(
        &self,
        state: &State,
        correction: &[f64],
    ) -> Result<Vec<[f64; 3]>, VolumetricError> {
        // The design of a problem that is whitened by ones.
        let mut plain = self.clone();
        for whitening in &mut plain.sightings.whitening {
            *whitening = std::array::from_fn(|r| {
                std::array::from_fn(|c| f64::from(u8::from(r == c && whitening[r][r] != 0.0)))
            });
        }
        let rows: Vec<usize> = (0..self.n_rows()).collect();
        Ok(plain.blocks(state)?.first_order(&rows, &vec![1.0; rows.len()], correction))
    }

    /// `W r` of each row, without unit.
    pub fn whitened(&self, residuals_mm: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let rows = self.sightings.whitening.par_iter().zip(residuals_mm).with_min_len(BLOCK_ROWS);
        rows.map(|(whitening, r)| whitening.map(|w| w[0] * r[0] + w[1] * r[1] + w[2] * r[2])).collect()
    }

    /// A residual or displacement of the measuring frame in base axes; a radius stays where it is.
    pub fn in_base_axes(&self, state: &State, vectors_mm: &[[f64; 3]]) -> Vec<[f64; 3]> {
        vectors_mm
            .iter()
            .zip(&self.sightings.session)
            .map(|(v, &session)| match &state.frames[session] {
                Frame::Positions { pose, .. } => {
                    let m = &pose.camera_from_base;
                    std::array::from_fn(|c| m[0][c] * v[0] + m[1][c] * v[1] + m[2][c] * v[2])
                }
                Frame::Circle { .. } => *v,
            })
            .collect()
    }

    /// The state after a correction of all its unknowns.
    ///
    /// # Errors
    /// [`VolumetricError::Length`] where the correction has another length.
    pub fn corrected(&self, state: &State, correction: &[f64]) -> Result<State, VolumetricError> {
        if correction.len() != self.n_columns {
            return Err(VolumetricError::Length {
                what: "correction",
                found: correction.len(),
                needed: self.n_columns,
            });
        }
        let mut corrected = state.clone();
        for (value, change) in corrected.coefficients.iter_mut().zip(correction) {
            *value += change;
        }
        let first_inner = self.model.n_coefficients();
        for (number, &place) in self.free_inner.iter().enumerate() {
            corrected.inner[place] += correction[first_inner + number];
        }
        for (frame, &first) in corrected.frames.iter_mut().zip(&self.first_frame_column) {
            *frame = frame.corrected(&correction[first..first + frame.n_columns()]);
        }
        for (value, change) in corrected.shared.iter_mut().zip(&correction[self.first_shared_column..]) {
            *value += change;
        }
        Ok(corrected)
    }

    /// Prepares the design at a state; blocks of it can then be made in any order, by any thread.
    ///
    /// # Errors
    /// [`VolumetricError::Length`], [`VolumetricError::Expression`].
    pub fn blocks<'a>(&'a self, state: &'a State) -> Result<Block<'a>, VolumetricError> {
        self.check(state)?;
        let rows = &self.sightings.rows;
        self.bases.keep(&rows.q_mm);
        let views = rows.variable_views();
        let expression_rows = rows.expression_rows(&views);
        let parts: Vec<_> = self.model.parts().collect();
        let both = parts
            .par_iter()
            .map(|(term, part)| {
                let Shape::Expression { expression, coefficients, inner } = &part.shape else {
                    return Ok((Vec::new(), Vec::new()));
                };
                let (first, first_inner) =
                    (self.model.first_coefficient(*term), self.model.first_inner(*term));
                let theta: Vec<f64> = coefficients.iter().map(|&p| state.coefficients[first + p]).collect();
                let phi: Vec<f64> = inner.iter().map(|&p| state.inner[first_inner + p]).collect();
                let mut by_coefficient = vec![0.0; rows.len() * coefficients.len()];
                expression.coefficient_columns(&expression_rows, 0..rows.len(), &phi, &mut by_coefficient)?;
                let mut by_inner = Vec::new();
                if inner.iter().any(|p| self.free_inner.contains(&(first_inner + p))) {
                    by_inner = vec![0.0; rows.len() * inner.len()];
                    expression.inner_derivatives(
                        &expression_rows,
                        0..rows.len(),
                        &theta,
                        &phi,
                        &mut by_inner,
                    )?;
                }
                Ok((by_coefficient, by_inner))
            })
            .collect::<Result<Vec<_>, VolumetricError>>()?;
        let (formulas, inner) = both.into_iter().unzip();
        Ok(Block { problem: self, state, formulas, inner })
    }

    fn check(&self, state: &State) -> Result<(), VolumetricError> {
        check_parameters(&self.model, &state.coefficients, &state.inner)?;
        let same = |what, found, needed| {
            if found == needed { Ok(()) } else { Err(VolumetricError::Length { what, found, needed }) }
        };
        same("frames", state.frames.len(), self.first_frame_column.len())?;
        same("shared", state.shared.len(), self.sightings.n_shared)
    }
}

impl Block<'_> {
    /// Number of unknowns.
    pub fn n_columns(&self) -> usize {
        self.problem.n_columns
    }

    /// Writes the whitened design of some rows, column by column: three numbers a row, `3 · rows` in a column.
    /// `out` must be 0 and hold `3 · rows · n_columns` numbers. Each row is multiplied by its `row_scale`.
    pub fn fill(&self, rows: &[usize], row_scale: &[f64], out: &mut [f64]) {
        let height = NUMBERS_OF_A_ROW * rows.len();
        self.each_entry(rows, row_scale, |column, at, numbers| {
            let place = column * height + NUMBERS_OF_A_ROW * at;
            for (out, number) in out[place..place + NUMBERS_OF_A_ROW].iter_mut().zip(numbers) {
                *out += number;
            }
        });
    }

    /// `Aᵀ r` of the whitened design with whitened residuals, both multiplied by `row_scale`.
    pub fn gradient(&self, whitened: &[[f64; 3]], row_scale: &[f64]) -> Vec<f64> {
        let rows: Vec<usize> = (0..whitened.len()).collect();
        self.summed_over_rows(&rows, self.n_columns(), |rows, sum| {
            self.each_run(rows, row_scale, |first, at, direction, values| {
                let row = rows[at];
                let along: f64 = direction.iter().zip(&whitened[row]).map(|(a, r)| a * r).sum();
                let along = row_scale[row] * along;
                for (sum, value) in sum[first..].iter_mut().zip(values) {
                    *sum += along * value;
                }
            });
        })
    }

    /// Columns (n, d) of `AᵀA` of the whitened design, each row multiplied by its `row_scale`: those of some unknowns.
    pub fn gram_columns(&self, columns: &[usize], row_scale: &[f64]) -> Matrix {
        let (n, d) = (self.n_columns(), columns.len());
        let rows: Vec<usize> = (0..row_scale.len()).collect();
        let total = self.summed_over_rows(&rows, n * d, |rows, sum| {
            let own = self.entries_of(columns, rows, row_scale);
            self.each_run(rows, row_scale, |first, at, direction, values| {
                for (sum, own) in sum.chunks_exact_mut(n).zip(&own[at * d..]) {
                    let along: f64 = direction.iter().zip(own).map(|(a, b)| a * b).sum();
                    sum[first..].iter_mut().zip(values).for_each(|(sum, value)| *sum += along * value);
                }
            });
        });
        Matrix::from_columns(n, d, total).unwrap_or_default()
    }

    /// The largest entry of some columns (d) of the whitened design in any row, without its sign; or the first row and column
    /// whose entry is not finite.
    pub fn largest_entries(&self, columns: &[usize]) -> Result<Vec<f64>, (usize, usize)> {
        let d = columns.len();
        let rows: Vec<usize> = (0..self.problem.n_rows()).collect();
        let row_scale = vec![1.0; rows.len()];
        let of_some = |rows: &[usize]| {
            let mut largest = vec![0.0_f64; d];
            for (number, entry) in self.entries_of(columns, rows, &row_scale).iter().enumerate() {
                let (at, k) = (number / d, number % d);
                if entry.iter().any(|value| !value.is_finite()) {
                    return Err((rows[at], columns[k]));
                }
                largest[k] = entry.iter().fold(largest[k], |most, value| most.max(value.abs()));
            }
            Ok(largest)
        };
        let parts: Vec<Result<Vec<f64>, (usize, usize)>> = rows.par_chunks(BLOCK_ROWS).map(of_some).collect();
        let mut total = vec![0.0_f64; d];
        for part in parts {
            total.iter_mut().zip(part?).for_each(|(total, own)| *total = total.max(own));
        }
        Ok(total)
    }

    /// Entries of some columns (d) in some rows: three whitened numbers each, row after row.
    fn entries_of(
        &self,
        columns: &[usize],
        rows: &[usize],
        row_scale: &[f64],
    ) -> Vec<[f64; NUMBERS_OF_A_ROW]> {
        let d = columns.len();
        let mut place = vec![None; self.n_columns()];
        columns.iter().enumerate().for_each(|(k, &column)| place[column] = Some(k));
        let mut entries = vec![[0.0; NUMBERS_OF_A_ROW]; rows.len() * d];
        self.each_entry(rows, row_scale, |column, at, numbers| {
            if let Some(k) = place[column] {
                entries[at * d + k].iter_mut().zip(numbers).for_each(|(entry, number)| *entry += number);
            }
        });
        entries
    }

    /// Sums of so many numbers, to which `add` adds what some rows have: chunk by chunk, whatever thread made them.
    fn summed_over_rows(
        &self,
        rows: &[usize],
        size: usize,
        add: impl Fn(&[usize], &mut [f64]) + Sync,
    ) -> Vec<f64> {
        let sums: Vec<Vec<f64>> = rows
            .par_chunks(BLOCK_ROWS)
            .map(|rows| {
                let mut sum = vec![0.0; size];
                add(rows, &mut sum);
                sum
            })
            .collect();
        let mut total = vec![0.0; size];
        for sum in &sums {
            total.iter_mut().zip(sum).for_each(|(total, part)| *total += part);
        }
        total
    }

    /// How a correction of all unknowns moves the whitened numbers of some rows, to first order, each multiplied by its
    /// `row_scale`.
    pub fn first_order(&self, rows: &[usize], row_scale: &[f64], correction: &[f64]) -> Vec<[f64; 3]> {
        let parts: Vec<Vec<[f64; 3]>> = rows
            .par_chunks(BLOCK_ROWS)
            .map(|rows| {
                let mut moved = vec![[0.0; 3]; rows.len()];
                self.each_run(rows, row_scale, |first, at, direction, values| {
                    let along: f64 =
                        values.iter().zip(&correction[first..]).map(|(value, x)| value * x).sum();
                    moved[at].iter_mut().zip(direction).for_each(|(sum, number)| *sum += number * along);
                });
                moved
            })
            .collect();
        parts.concat()
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

    /// Visits the entries of the design that are not 0: column, place among the rows, three whitened numbers. An entry
    /// may come in several parts.
    fn each_entry(&self, rows: &[usize], row_scale: &[f64], mut visit: impl FnMut(usize, usize, &[f64; 3])) {
        self.each_run(rows, row_scale, |first, at, direction, values| {
            for (k, value) in values.iter().enumerate() {
                visit(first + k, at, &direction.map(|along| along * value));
            }
        });
    }

    /// Visits the same by runs of neighbouring columns: the first of them, place among the rows, three whitened numbers,
    /// and what these are multiplied with in each column of the run.
    pub(super) fn each_run(
        &self,
        rows: &[usize],
        row_scale: &[f64],
        mut visit: impl FnMut(usize, usize, &[f64; 3], &[f64]),
    ) {
        let sights: Vec<Sight> = rows.iter().map(|&row| self.sight(row, row_scale[row])).collect();
        self.each_run_of_terms(rows, &sights, &mut visit);
        for (at, (&row, sight)) in rows.iter().zip(&sights).enumerate() {
            self.each_entry_of_frame(row, sight, |column, numbers| visit(column, at, numbers, &[1.0]));
        }
    }

    /// What turns a displacement at a row into its whitened numbers.
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
                let along = outward.map(|u| u * whitening[0][0]);
                Sight {
                    from_camera: whitening,
                    from_base: [along, [0.0; 3], [0.0; 3]],
                    nominal_mm,
                    columns,
                    rig: [[0.0; 3]; Channel::RIG_COLUMN_COUNT],
                }
            }
        }
    }

    fn each_run_of_terms(
        &self,
        places: &[usize],
        sights: &[Sight],
        visit: &mut impl FnMut(usize, usize, &[f64; 3], &[f64]),
    ) {
        let model = &self.problem.model;
        let rows = &self.problem.sightings.rows;
        let n_rows = rows.len();
        let functions = self.problem.bases.at_rows(places, &rows.q_mm);
        for (number, (term, part)) in model.parts().enumerate() {
            let directions: Vec<[f64; 3]> =
                sights.iter().map(|sight| sight.direction(part.channel, part.factor)).collect();
            let first = model.first_coefficient(term);
            let mut column_of = |column: usize, values: &[f64]| {
                for (at, (direction, &row)) in directions.iter().zip(places).enumerate() {
                    visit(column, at, direction, &values[row..=row]);
                }
            };
            match &part.shape {
                Shape::Basis { .. } => {
                    let basis = self.problem.bases.of_part(number);
                    for (at, (direction, &row)) in directions.iter().zip(places).enumerate() {
                        let (begin, values) = functions.of(basis, row, at);
                        visit(first + begin, at, direction, values);
                    }
                }
                Shape::Expression { coefficients, inner, .. } => {
                    for (values, &place) in
                        self.formulas[number].chunks_exact(n_rows.max(1)).zip(coefficients)
                    {
                        column_of(first + place, values);
                    }
                    for (values, &place) in self.inner[number].chunks_exact(n_rows.max(1)).zip(inner) {
                        let wanted = model.first_inner(term) + place;
                        if let Some(free) = self.problem.free_inner.iter().position(|&p| p == wanted) {
                            column_of(model.n_coefficients() + free, values);
                        }
                    }
                }
            }
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
        }
        for unknown in 0..*n_shared {
            let by: [f64; 3] = std::array::from_fn(|c| shared[(row * 3 + c) * n_shared + unknown]);
            visit(self.problem.first_shared_column + unknown, &apply(&sight.from_camera, &by));
        }
    }
}

/// What a row's device makes of displacements of its point.
struct Sight {
    /// Whitened numbers from a vector of the measuring frame.
    from_camera: [[f64; 3]; 3],
    /// Whitened numbers from a vector of the base frame.
    from_base: [[f64; 3]; 3],
    nominal_mm: [f64; 3],
    columns: ChannelColumns,
    rig: [[f64; 3]; Channel::RIG_COLUMN_COUNT],
}

impl Sight {
    /// Whitened numbers from one unit on a channel.
    fn direction(&self, channel: Channel, factor: f64) -> [f64; 3] {
        let seen = match (channel.base_column(), channel.rig_column()) {
            (Some(column), _) => apply(&self.from_base, &self.columns[column]),
            (None, Some(column)) => apply(&self.from_camera, &self.rig[column]),
            (None, None) => [0.0; 3],
        };
        seen.map(|value| value * factor)
    }
}

#[inline]
fn apply(matrix: &[[f64; 3]; 3], v: &[f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}
