//! What can be wrong with blocks, and with a covariance.

use thiserror::Error;

/// Why there is no likelihood.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum NoiseError {
    /// An array has another length than the rows or blocks ask for.
    #[error("{what} has {found} numbers, and {needed} are needed")]
    Length {
        /// Which.
        what: &'static str,
        /// What it has.
        found: usize,
        /// What it should have.
        needed: usize,
    },
    /// A row lies in no block.
    #[error("row {row} is in block {block}, and there are {count}")]
    BadBlock {
        /// Number of the row.
        row: usize,
        /// Its block.
        block: usize,
        /// How many there are.
        count: usize,
    },
    /// Blocks of a session are not in the order of time.
    #[error("block {block} is not in the order of time")]
    NotInOrder {
        /// The first block that is earlier than the one before.
        block: usize,
    },
    /// A covariance is not positive definite to working precision.
    #[error("the covariance of component {component} is not positive definite at these parameters")]
    NotDefinite {
        /// Number of the component; 3 for what all have in common.
        component: usize,
    },
}

/// Refuses a length that is not the needed one.
pub(super) fn length(what: &'static str, found: usize, needed: usize) -> Result<(), NoiseError> {
    if found == needed { Ok(()) } else { Err(NoiseError::Length { what, found, needed }) }
}
