//! What can be wrong with a scan.

use thiserror::Error;

use crate::expression::RowsError;

/// Why candidates cannot be judged.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CandidateError {
    /// A column or matrix has another length than the rows ask for.
    #[error("{what} has {found} numbers, and {needed} are needed")]
    Length {
        /// Which.
        what: &'static str,
        /// What it has.
        found: usize,
        /// What it should have.
        needed: usize,
    },
    /// A group points at something that is not there.
    #[error("group {group} names {what} {found}, and there are {count}")]
    Missing {
        /// Number of the group.
        group: usize,
        /// What it names.
        what: &'static str,
        /// The number that it names.
        found: usize,
        /// How many there are.
        count: usize,
    },
    /// A formula's rows do not fit.
    #[error(transparent)]
    Rows(#[from] RowsError),
}

/// Refuses a length that is not the needed one.
pub(super) fn length(what: &'static str, found: usize, needed: usize) -> Result<(), CandidateError> {
    if found == needed { Ok(()) } else { Err(CandidateError::Length { what, found, needed }) }
}
