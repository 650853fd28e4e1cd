//! The least-squares problem: what was measured, exact residuals, and the unknowns.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::block::{Block, distance};
use super::ends::{End, ends_of};
use super::shared_bases::SharedBases;
use super::term::{Shape, VolumetricModel};
use super::values::{channel_values_of_bases, check_parameters};
use super::{ChannelValues, Frame, Rows, VolumetricError};
use crate::kinematics::{Channel, Displacements, rig_displacement};

/// Observed rows of a block of the design: large against the columns of a usual model, so that the triangles of blocks
/// cost little to merge.
pub const BLOCK_ROWS: usize = 512;

/// Numbers that a row contributes: three components, whitened.
pub const NUMBERS_OF_A_ROW: usize = 3;

/// What was measured.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Sightings {
    /// Where and when.
    pub rows: Rows,
    /// In the measuring frame, mm; 0 where not measured. A radius stands in the first component, and a length in that of
    /// both its ends.
    pub measured_mm: Vec<[f64; 3]>,
    /// W of each row, W C Wᵀ = 1; zero in rows and columns of components that were not measured, 1/mm.
    pub whitening: Vec<[[f64; 3]; 3]>,
    /// Session of each row.
    pub session: Vec<usize>,
    /// Number of the length that a row is an end of, two rows each; none of them, or an entry for each row.
    pub length: Vec<Option<usize>>,
    /// Derivative of each measured point by further shared unknowns (a rig's calibration), `[row][component][unknown]`
    /// without gaps.
    pub shared: Vec<f64>,
    /// How many such unknowns.
    pub n_shared: usize,
}

/// All unknowns at one iteration.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
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
    pub(super) model: VolumetricModel,
    pub(super) bases: SharedBases,
    pub(super) sightings: Sightings,
    /// Of the rows that are ends of lengths; empty where none is.
    pub(super) ends: Vec<Option<End>>,
    /// Places of the free inner parameters.
    pub(super) free_inner: Vec<usize>,
    pub(super) first_frame_column: Vec<usize>,
    pub(super) first_shared_column: usize,
    pub(super) n_columns: usize,
}

impl Problem {
    /// Poses the problem.
    ///
    /// # Errors
    /// [`VolumetricError::Length`], [`VolumetricError::Session`], [`VolumetricError::Ends`],
    /// [`VolumetricError::NoExtent`].
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
        if !sightings.length.is_empty() {
            same("length", sightings.length.len(), n_rows)?;
        }
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
        let ends = ends_of(&model, &sightings)?;
        Ok(Self {
            model,
            bases,
            sightings,
            ends,
            free_inner,
            first_frame_column,
            first_shared_column,
            n_columns,
        })
    }

    /// The same, with the functions that another problem keeps of the same rows, where both have the same bases.
    #[must_use]
    pub fn beside(mut self, other: &Self) -> Self {
        if self.sightings.rows.q_mm == other.sightings.rows.q_mm {
            self.bases.keep_those_of(&other.bases);
        }
        self
    }

    /// The model.
    pub fn model(&self) -> &VolumetricModel {
        &self.model
    }

    /// What was measured.
    pub fn sightings(&self) -> &Sightings {
        &self.sightings
    }

    /// Places of the free inner parameters.
    pub fn free_inner(&self) -> &[usize] {
        &self.free_inner
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

    /// Number of sessions.
    pub fn n_sessions(&self) -> usize {
        self.first_frame_column.len()
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

    /// The end of a length that a row is, if it is one.
    pub(super) fn end(&self, row: usize) -> Option<&End> {
        self.ends.get(row).and_then(Option::as_ref)
    }

    /// Where a row's point is, in the base frame.
    fn place(&self, numbers: &[f64], row: usize) -> [f64; 3] {
        let rows = &self.sightings.rows;
        let (chain, tool) = (self.model.chain(), self.model.tool_offset_mm());
        let (carrier, q_mm, offset_mm) = (rows.carriers[row], &rows.q_mm[row], &rows.offset_mm[row]);
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
        std::array::from_fn(|c| nominal[c] + moved[c])
    }

    fn residual(&self, state: &State, values: &ChannelValues, row: usize) -> [f64; 3] {
        let Sightings { measured_mm, whitening, session, shared, n_shared, .. } = &self.sightings;
        let numbers = values.at(row);
        let base = self.place(&numbers, row);
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
            Frame::Lengths => match self.end(row) {
                Some(end) => {
                    let there = self.place(&values.at(end.other), end.other);
                    [end.residual(measured[0], &base, &there), 0.0, 0.0]
                }
                None => [0.0; 3],
            },
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

    /// A residual or displacement of the measuring frame in base axes; one of radii or lengths stays where it is.
    pub fn in_base_axes(&self, state: &State, vectors_mm: &[[f64; 3]]) -> Vec<[f64; 3]> {
        vectors_mm
            .iter()
            .zip(&self.sightings.session)
            .map(|(v, &session)| match &state.frames[session] {
                Frame::Positions { pose, .. } => {
                    let m = &pose.camera_from_base;
                    std::array::from_fn(|c| m[0][c] * v[0] + m[1][c] * v[1] + m[2][c] * v[2])
                }
                Frame::Circle { .. } | Frame::Lengths => *v,
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
