//! Noise with offsets of passes and a drift, as whitening by blocks of rows.

use std::ops::Range;

use super::error::CandidateError;

/// The noise of whitened residuals, component by component: `V = σ² (I + U K Uᵀ)`.
#[derive(Clone, Debug)]
pub struct Noise {
    /// Scatter from row to row, of each component.
    pub sigma: [f64; 3],
    /// Block of each row.
    pub block: Vec<usize>,
    /// Number of blocks.
    pub n_blocks: usize,
    /// Entry of `U` of each row, of each component.
    pub unit: [Vec<f64>; 3],
    /// Blocks of each session.
    pub sessions: Vec<Range<usize>>,
    /// `T − I` of each component and session, column after column.
    pub less_one: [Vec<Vec<f64>>; 3],
}

impl Noise {
    /// Checks lengths.
    pub(super) fn check(&self, n_rows: usize) -> Result<(), CandidateError> {
        length("blocks", self.block.len(), n_rows)?;
        for unit in &self.unit {
            length("the entries of U", unit.len(), n_rows)?;
        }
        for (row, &block) in self.block.iter().enumerate() {
            if block >= self.n_blocks {
                return Err(CandidateError::BadBlock { row, block, count: self.n_blocks });
            }
        }
        let mut end = 0;
        for session in &self.sessions {
            length("blocks before a session", session.start, end)?;
            end = session.end;
        }
        length("blocks of all sessions", end, self.n_blocks)?;
        for of_component in &self.less_one {
            length("the transforms of sessions", of_component.len(), self.sessions.len())?;
            for (matrix, session) in of_component.iter().zip(&self.sessions) {
                length("a session's transform", matrix.len(), session.len().pow(2))?;
            }
        }
        Ok(())
    }
}

/// Refuses a length that is not the needed one.
pub(super) fn length(what: &'static str, found: usize, needed: usize) -> Result<(), CandidateError> {
    if found == needed { Ok(()) } else { Err(CandidateError::Length { what, found, needed }) }
}
