//! Many positions at once, each row by itself: the same bytes from any number of threads.

use rayon::prelude::*;

use super::{KinematicsError, MachineModel};

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
