//! Many positions at once, each row by itself: the same bytes from any number of threads.

use rayon::prelude::*;

use super::{
    Carrier, Chain, Channel, ChannelColumns, Displacements, KinematicsError, MachineModel, Pose, RigColumns,
    RigNumbers,
};

/// A thread takes at least so many rows: at some 100 ns a row, handing over fewer costs more than doing them.
pub const BLOCK_ROWS: usize = 2048;

/// From where a point is seen, and what it is fixed to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// [`MachineModel::tool_from_work`].
    ToolFromWork,
    /// [`MachineModel::error`]: actual minus nominal of the same.
    ToolError,
    /// [`MachineModel::tool_from_base`].
    ToolFromBase,
    /// [`MachineModel::work_from_base`].
    WorkFromBase,
}

/// Positions of one point for each row of `q_mm`, mm; `offsets_mm` holds one offset for all rows or one a row.
///
/// # Errors
/// [`KinematicsError::OffsetCount`].
pub fn positions(
    model: &MachineModel,
    view: View,
    q_mm: &[[f64; 3]],
    offsets_mm: &[[f64; 3]],
) -> Result<Vec<[f64; 3]>, KinematicsError> {
    match view {
        View::ToolFromWork => for_each_row(q_mm, offsets_mm, |q, l| model.tool_from_work(q, l)),
        View::ToolError => for_each_row(q_mm, offsets_mm, |q, l| model.error(q, l)),
        View::ToolFromBase => for_each_row(q_mm, offsets_mm, |q, l| model.tool_from_base(q, l)),
        View::WorkFromBase => for_each_row(q_mm, offsets_mm, |q, l| model.work_from_base(q, l)),
    }
}

/// [`MachineModel::jacobian`] for each row of `q_mm`; `offsets_mm` holds one offset for all rows or one a row.
///
/// # Errors
/// [`KinematicsError::OffsetCount`].
pub fn jacobians(
    model: &MachineModel,
    q_mm: &[[f64; 3]],
    offsets_mm: &[[f64; 3]],
) -> Result<Vec<[[f64; 3]; 3]>, KinematicsError> {
    for_each_row(q_mm, offsets_mm, |q, l| model.jacobian(q, l))
}

/// Points that a chain carries: one a row, wherever it is fixed.
#[derive(Debug, Clone, Copy)]
pub struct Points<'a> {
    /// The chain.
    pub chain: &'a Chain,
    /// From the carriage origin to the tool point, mm.
    pub tool_offset_mm: [f64; 3],
    /// What the point of each row is fixed to.
    pub carriers: &'a [Carrier],
    /// Commanded axis positions, one a row, mm.
    pub q_mm: &'a [[f64; 3]],
    /// See [`Chain::nominal`]; one a row, mm.
    pub offsets_mm: &'a [[f64; 3]],
}

impl Points<'_> {
    /// [`Chain::channel_columns`] of each row.
    ///
    /// # Errors
    /// [`KinematicsError::RowCount`].
    pub fn channel_columns(&self) -> Result<Vec<ChannelColumns>, KinematicsError> {
        self.for_each_row(|row| {
            let (carrier, q, offset) = self.row(row);
            self.chain.channel_columns(carrier, q, offset, &self.tool_offset_mm)
        })
    }

    /// [`Chain::nominal`] of each row, mm.
    ///
    /// # Errors
    /// [`KinematicsError::RowCount`].
    pub fn nominal(&self) -> Result<Vec<[f64; 3]>, KinematicsError> {
        self.for_each_row(|row| {
            let (carrier, q, offset) = self.row(row);
            self.chain.nominal(carrier, q, offset, &self.tool_offset_mm)
        })
    }

    /// [`Chain::displacement`] of each row, mm; `channels` holds the numbers of [`Displacements::from_channels`].
    ///
    /// # Errors
    /// [`KinematicsError::RowCount`].
    pub fn displacement(
        &self,
        channels: &[[f64; Channel::MACHINE_COUNT]],
    ) -> Result<Vec<[f64; 3]>, KinematicsError> {
        same_rows("channels", channels.len(), self.q_mm.len())?;
        self.for_each_row(|row| {
            let (carrier, q, offset) = self.row(row);
            let displacements = Displacements::from_channels(&channels[row]);
            self.chain.displacement(carrier, q, offset, &self.tool_offset_mm, &displacements)
        })
    }

    /// [`Chain::position`] of each row, mm; `channels` holds the numbers of [`Displacements::from_channels`].
    ///
    /// # Errors
    /// [`KinematicsError::RowCount`].
    pub fn position(
        &self,
        channels: &[[f64; Channel::MACHINE_COUNT]],
    ) -> Result<Vec<[f64; 3]>, KinematicsError> {
        same_rows("channels", channels.len(), self.q_mm.len())?;
        self.for_each_row(|row| {
            let (carrier, q, offset) = self.row(row);
            let displacements = Displacements::from_channels(&channels[row]);
            self.chain.position(carrier, q, offset, &self.tool_offset_mm, &displacements)
        })
    }

    #[inline]
    fn row(&self, row: usize) -> (Carrier, &[f64; 3], &[f64; 3]) {
        (self.carriers[row], &self.q_mm[row], &self.offsets_mm[row])
    }

    fn for_each_row<T: Send>(
        &self,
        evaluate: impl Fn(usize) -> T + Sync + Send,
    ) -> Result<Vec<T>, KinematicsError> {
        same_rows("carriers", self.carriers.len(), self.q_mm.len())?;
        same_rows("offsets", self.offsets_mm.len(), self.q_mm.len())?;
        Ok((0..self.q_mm.len()).into_par_iter().with_min_len(BLOCK_ROWS).map(evaluate).collect())
    }
}

/// [`Pose::rig_columns`] of each point of the base frame.
pub fn rig_columns(pose: &Pose, base_mm: &[[f64; 3]]) -> Vec<RigColumns> {
    base_mm.par_iter().with_min_len(BLOCK_ROWS).map(|point| pose.rig_columns(point)).collect()
}

/// [`Pose::measured_from_base`] of each point of the base frame with the rig numbers of its row, mm.
///
/// # Errors
/// [`KinematicsError::RowCount`].
pub fn measured_from_base(
    pose: &Pose,
    rig: &[RigNumbers],
    base_mm: &[[f64; 3]],
) -> Result<Vec<[f64; 3]>, KinematicsError> {
    same_rows("rig numbers", rig.len(), base_mm.len())?;
    let rows = rig.par_iter().zip(base_mm).with_min_len(BLOCK_ROWS);
    Ok(rows.map(|(rig, point)| pose.measured_from_base(rig, point)).collect())
}

fn same_rows(what: &'static str, n_found: usize, n_positions: usize) -> Result<(), KinematicsError> {
    if n_found == n_positions {
        return Ok(());
    }
    Err(KinematicsError::RowCount { what, n_found, n_positions })
}

fn for_each_row<T: Send>(
    q_mm: &[[f64; 3]],
    offsets_mm: &[[f64; 3]],
    evaluate: impl Fn(&[f64; 3], &[f64; 3]) -> T + Sync,
) -> Result<Vec<T>, KinematicsError> {
    match offsets_mm {
        [offset_mm] => {
            let rows = q_mm.par_iter().with_min_len(BLOCK_ROWS);
            Ok(rows.map(|q| evaluate(q, offset_mm)).collect())
        }
        _ if offsets_mm.len() == q_mm.len() => {
            let rows = q_mm.par_iter().zip(offsets_mm).with_min_len(BLOCK_ROWS);
            Ok(rows.map(|(q, offset_mm)| evaluate(q, offset_mm)).collect())
        }
        _ => Err(KinematicsError::OffsetCount { n_offsets: offsets_mm.len(), n_positions: q_mm.len() }),
    }
}
