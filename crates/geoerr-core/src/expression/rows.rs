//! The rows that an expression is evaluated for.

use std::ops::Range;

use super::error::RowsError;

/// Columns of numbers, row by row in the order of measurement.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// One column for each variable of the symbols, in their order. Columns that the expression does not use may be empty.
    pub variables: &'a [&'a [f64]],
    /// Number of rows.
    pub n_rows: usize,
    /// First row of each sequence (session); empty = one sequence.
    pub starts: &'a [usize],
    /// Time in s, for `lag`; `None` = the number of the row. Within a sequence it does not fall.
    pub t: Option<&'a [f64]>,
}

impl Rows<'_> {
    /// Checks lengths and starts; `used` are the variables that the expression needs.
    pub(super) fn check(
        &self,
        names: &[String],
        used: &[usize],
        range: &Range<usize>,
    ) -> Result<(), RowsError> {
        let n_rows = self.n_rows;
        if self.variables.len() != names.len() {
            return Err(RowsError::VariableCount { needed: names.len(), found: self.variables.len() });
        }
        for &index in used {
            let found = self.variables[index].len();
            if found != n_rows {
                return Err(RowsError::ColumnLength { name: names[index].clone(), n_rows, found });
            }
        }
        if let Some(t) = self.t
            && t.len() != n_rows
        {
            return Err(RowsError::TimeLength { n_rows, found: t.len() });
        }
        for (index, &row) in self.starts.iter().enumerate() {
            let is_in_order = if index == 0 { row == 0 } else { row > self.starts[index - 1] };
            if !is_in_order || row >= n_rows {
                return Err(RowsError::BadStart { index, row, n_rows });
            }
        }
        if range.start > range.end || range.end > n_rows {
            return Err(RowsError::BadRange { start: range.start, end: range.end, n_rows });
        }
        Ok(())
    }

    /// First row of the sequence that holds `row`.
    pub(super) fn sequence_start(&self, row: usize) -> usize {
        match self.starts.partition_point(|&start| start <= row) {
            0 => 0,
            after => self.starts[after - 1],
        }
    }

    /// First row of the next sequence after that of `row`; the number of rows where there is none.
    pub(super) fn sequence_end(&self, row: usize) -> usize {
        self.starts.get(self.starts.partition_point(|&start| start <= row)).copied().unwrap_or(self.n_rows)
    }

    pub(super) fn time(&self, row: usize) -> f64 {
        self.t.map_or(row as f64, |t| t[row])
    }
}
