//! Groups of columns: one candidate in one form, at all trials of its inner parameters.

use super::error::CandidateError;

/// One column of a group: a function of the rows on a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// Number of the channel.
    pub channel: usize,
    /// What the channel's displacement is multiplied by.
    pub factor: f64,
    /// Which of the group's coefficients it belongs to.
    pub coefficient: usize,
}

/// Columns that are added together, with trial values.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Number of coefficients.
    pub n_coefficients: usize,
    /// The columns, the same at each trial but for their functions.
    pub columns: Vec<Column>,
    /// Number of the function (of [`super::Sources`]) of each column, trial after trial.
    pub functions: Vec<usize>,
}

impl Group {
    /// Number of trials.
    pub fn n_trials(&self) -> usize {
        self.functions.len() / self.columns.len().max(1)
    }

    /// Functions of one trial's columns.
    pub(super) fn trial(&self, trial: usize) -> &[usize] {
        let n = self.columns.len();
        &self.functions[trial * n..(trial + 1) * n]
    }

    /// Checks that what it names is there.
    pub(super) fn check(
        &self,
        group: usize,
        n_functions: usize,
        n_channels: usize,
    ) -> Result<(), CandidateError> {
        let needed = self.n_trials() * self.columns.len();
        if self.functions.len() != needed {
            return Err(CandidateError::Length {
                what: "a group's functions",
                found: self.functions.len(),
                needed,
            });
        }
        let within = |what, found, count| {
            if found < count { Ok(()) } else { Err(CandidateError::Missing { group, what, found, count }) }
        };
        for column in &self.columns {
            within("channel", column.channel, n_channels)?;
            within("coefficient", column.coefficient, self.n_coefficients)?;
        }
        self.functions.iter().try_for_each(|&function| within("function", function, n_functions))
    }
}
