//! Where the machine was asked to be, and under which conditions.

use serde::{Deserialize, Serialize};

use super::VolumetricError;
use crate::expression;
use crate::kinematics::Carrier;

/// Rows of observations, or of questions: positions, target offsets, and the variables of expressions.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Rows {
    /// What the target is fixed to.
    pub carriers: Vec<Carrier>,
    /// Commanded axis positions.
    pub q_mm: Vec<[f64; 3]>,
    /// Target offsets.
    pub offset_mm: Vec<[f64; 3]>,
    /// Variables of the model's expressions, in the order of their symbols; each as long as the rows.
    pub variables: Vec<Vec<f64>>,
    /// First row of each sequence that is ordered in time.
    pub starts: Vec<usize>,
    /// Time, for lags; without it the row's number.
    pub t_s: Option<Vec<f64>>,
}

impl Rows {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.q_mm.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.q_mm.is_empty()
    }

    /// Whether all arrays have the same length.
    ///
    /// # Errors
    /// [`VolumetricError::Length`].
    pub fn check(&self) -> Result<(), VolumetricError> {
        let needed = self.len();
        let same = |what, found| {
            if found == needed { Ok(()) } else { Err(VolumetricError::Length { what, found, needed }) }
        };
        same("carriers", self.carriers.len())?;
        same("offset_mm", self.offset_mm.len())?;
        same("t_s", self.t_s.as_ref().map_or(needed, Vec::len))?;
        self.variables.iter().try_for_each(|column| same("variables", column.len()))
    }

    /// The variables as the expressions take them; `columns` holds the views.
    pub(super) fn variable_views(&self) -> Vec<&[f64]> {
        self.variables.iter().map(Vec::as_slice).collect()
    }

    pub(super) fn expression_rows<'a>(&'a self, columns: &'a [&'a [f64]]) -> expression::Rows<'a> {
        expression::Rows {
            variables: columns,
            n_rows: self.len(),
            starts: &self.starts,
            t: self.t_s.as_deref(),
        }
    }
}
