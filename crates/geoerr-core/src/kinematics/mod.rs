//! Exact kinematics of a machine with three linear axes in any order, with its 21 geometric errors.
//!
//! ```math
//! \mathbf p = T_{work}^{-1}\, T_{tool}\, \mathbf l, \qquad
//! T_a = \begin{cases}
//!   [R(\boldsymbol\varepsilon_a),\; q_a \hat{\mathbf a}' + \boldsymbol\delta_a] & \text{tool side} \\
//!   [R(-\boldsymbol\varepsilon_a),\; -q_a \hat{\mathbf a}' - \boldsymbol\delta_a] & \text{work side}
//! \end{cases}
//! ```
//!
//! Each `T` is the product over its side's axes from the base outwards (Li et al. 2023, Eqs. 6 and 7, with
//! full rotations for the first-order matrix of Eq. 6). Errors are actual minus nominal of the tool as seen
//! from the work, whichever side carries the axis.
//!
//! Two ways in: [`MachineModel`] has its errors as tables, [`Chain::position`] takes them as explicit numbers, one for
//! each [`Channel`] that moves a point. Both walk the same chain. [`Chain::channel_columns`] and [`Pose::rig_columns`] are
//! the first order of the channels.

mod batch;
mod chain;
mod channel;
mod columns;
mod directions;
mod displacements;
mod error_tables;
mod machine;
mod rig;
mod rotation;
mod table;
mod vec3;
mod walk;

pub use batch::{BLOCK_ROWS, Points, View, jacobians, measured_from_base, positions, rig_columns};
pub use chain::{Axis, Chain};
pub use channel::{AxisPair, Carrier, Channel, RigError};
pub use columns::ChannelColumns;
pub use displacements::Displacements;
pub use error_tables::{Component, ErrorTables, Squareness};
pub use machine::MachineModel;
pub use rig::{Pose, RigColumns, RigNumbers, rig_displacement};
pub use table::Table;

pub(crate) use directions::{deviation_rates, deviations};
pub(crate) use rotation::Rotation;
pub(crate) use vec3::{Vec3, add, scale};
pub(crate) use walk::{Carriage, Motion, Moving, Placed, Rate};

/// What cannot be turned into a machine model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum KinematicsError {
    /// A text that is no structural code.
    #[error("{code:?} is not a structural code: work to tool, each of X, Y, Z and b once, such as wZbXYt")]
    Chain {
        /// The text.
        code: String,
    },
    /// Positions and values that do not pair.
    #[error("a table has {n_positions} positions and {n_values} values")]
    TableLengths {
        /// Number of positions.
        n_positions: usize,
        /// Number of values.
        n_values: usize,
    },
    /// A table without an entry.
    #[error("a table needs at least one position")]
    EmptyTable,
    /// A table entry that is NaN or infinite.
    #[error("entry {index} of a table is not finite")]
    NonFiniteEntry {
        /// Its place, from 0.
        index: usize,
    },
    /// Positions that do not grow.
    #[error("positions of a table must grow: entry {index} is {position_mm} mm after {previous_mm} mm")]
    PositionsNotIncreasing {
        /// Place of the position that does not grow, from 0.
        index: usize,
        /// That position.
        position_mm: f64,
        /// The one before it.
        previous_mm: f64,
    },
    /// Neighbouring entries whose slope exceeds every number.
    #[error("entries {index} and its predecessor are too close together for their values")]
    SlopeOverflow {
        /// Place of the later entry, from 0.
        index: usize,
    },
    /// Squarenesses that no three axes can have.
    #[error(
        "no three axes have the squarenesses S_xy {s_xy_rad} rad, S_xz {s_xz_rad} rad, S_yz {s_yz_rad} rad"
    )]
    Squareness {
        /// Included angle of +X and +Y, less 90°.
        s_xy_rad: f64,
        /// Included angle of +X and +Z, less 90°.
        s_xz_rad: f64,
        /// Included angle of +Y and +Z, less 90°.
        s_yz_rad: f64,
    },
    /// A name that is none of the 18 error functions.
    #[error("{name:?} is not an error function: E, direction X Y Z A B C, axis X Y Z, such as ECX")]
    UnknownErrorFunction {
        /// The name.
        name: String,
    },
    /// A name that is none of the channels.
    #[error(
        "{name:?} is not a channel: a joint error such as ECX, S_xy S_xz S_yz, tool-x, work-x, target-x, \
         rig-scale, motion-x or one of their kin"
    )]
    UnknownChannel {
        /// The name.
        name: String,
    },
    /// A number that stands for no carrier.
    #[error("{code} is not a carrier: 0 is the tool, 1 the work, 2 the base, 3 the tool seen from the work")]
    UnknownCarrier {
        /// The number.
        code: u8,
    },
    /// Target offsets that do not pair with positions.
    #[error("{n_offsets} offsets for {n_positions} positions: give one, or one for each")]
    OffsetCount {
        /// Number of offsets.
        n_offsets: usize,
        /// Number of positions.
        n_positions: usize,
    },
    /// Rows that do not pair with positions.
    #[error("{n_found} {what} for {n_positions} positions: give one for each")]
    RowCount {
        /// What does not pair.
        what: &'static str,
        /// How many of it there are.
        n_found: usize,
        /// Number of positions.
        n_positions: usize,
    },
}
