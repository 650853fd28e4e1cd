//! Which unknowns belong to one session alone: its pose, and places of targets that no other session saw.

use super::Problem;
use super::problem::NUMBERS_OF_A_ROW;
use crate::least_squares::{Border, Group, LeastSquaresError, Matrix};

/// With fewer unknowns of sessions than this the whole is solved as quickly.
const LEAST_OWN: usize = 200;

/// Rows session by session, and whose unknowns are whose.
#[derive(Debug)]
pub struct BySession {
    /// Sightings, session by session.
    pub order: Vec<usize>,
    /// Sessions are its groups.
    pub border: Border,
}

impl Problem {
    /// The rows by sessions, where their own unknowns are most of all: the cost of the whole grows with the cube of these.
    ///
    /// An unknown that a row of `prior` (p, n) holds, or a row of `constraints` (k, n) together with others than those of
    /// its session, is one of the border.
    ///
    /// # Errors
    /// [`LeastSquaresError`] never, but by a mistake in here.
    pub fn by_session(
        &self,
        constraints: &Matrix,
        prior: Option<&Matrix>,
    ) -> Result<Option<BySession>, LeastSquaresError> {
        let mut owner = self.owners();
        if owner.iter().flatten().count() <= LEAST_OWN {
            return Ok(None);
        }
        for row in prior.into_iter().flat_map(entries) {
            row.iter().for_each(|&column| owner[column] = None);
        }
        let rows = entries(constraints);
        let is_across = |row: &Vec<usize>, owner: &[Option<usize>]| {
            row.iter().any(|&column| owner[column] != owner[row[0]])
        };
        while let Some(row) = rows.iter().find(|row| is_across(row, &owner)) {
            row.iter().for_each(|&column| owner[column] = None);
        }
        let mut groups = self.groups();
        for (column, session) in owner.iter().enumerate() {
            if let Some(session) = *session {
                groups[session].columns.push(column);
            }
        }
        let n_own: usize = groups.iter().map(|group| group.columns.len()).sum();
        let most = groups.iter().map(|group| group.columns.len()).max().unwrap_or(0);
        // Of one session alone its unknowns are no smaller a system than the whole.
        if n_own - most <= LEAST_OWN.max(self.n_columns() - n_own) {
            return Ok(None);
        }
        let mut order: Vec<usize> = (0..self.n_rows()).collect();
        order.sort_by_key(|&row| self.session()[row]);
        Ok(Some(BySession { order, border: Border::new(self.n_columns(), groups)? }))
    }

    /// The session that alone has a column, of each; nothing where several have it, or none.
    fn owners(&self) -> Vec<Option<usize>> {
        let mut owner = vec![None; self.n_columns()];
        let n_sessions = self.n_sessions();
        for session in 0..n_sessions {
            let first = self.first_frame_column(session);
            let last = if session + 1 < n_sessions {
                self.first_frame_column(session + 1)
            } else {
                self.first_shared_column()
            };
            owner[first..last].fill(Some(session));
        }
        let (shared, n_shared) = (&self.sightings().shared, self.sightings().n_shared);
        let owner_of_shared = &mut owner[self.first_shared_column()..];
        let mut is_several = vec![false; n_shared];
        for (row, entries) in shared.chunks_exact((NUMBERS_OF_A_ROW * n_shared).max(1)).enumerate() {
            let session = self.session()[row];
            for (place, _) in entries.iter().enumerate().filter(|(_, entry)| **entry != 0.0) {
                let unknown = place % n_shared;
                is_several[unknown] |= *owner_of_shared[unknown].get_or_insert(session) != session;
            }
        }
        let of_shared = owner_of_shared.iter_mut().zip(is_several);
        of_shared.filter(|(_, is_several)| *is_several).for_each(|(owner, _)| *owner = None);
        owner
    }

    /// Sessions as groups of rows without columns, one behind the other.
    fn groups(&self) -> Vec<Group> {
        let mut heights = vec![0; self.n_sessions()];
        self.session().iter().for_each(|&session| heights[session] += NUMBERS_OF_A_ROW);
        let mut next = 0;
        heights
            .into_iter()
            .map(|height| {
                let rows = next..next + height;
                next = rows.end;
                Group { rows, columns: Vec::new() }
            })
            .collect()
    }
}

/// Where each row of a matrix has entries.
fn entries(matrix: &Matrix) -> Vec<Vec<usize>> {
    let mut rows = vec![Vec::new(); matrix.n_rows()];
    for column in 0..matrix.n_columns() {
        for (row, _) in matrix.column(column).iter().enumerate().filter(|(_, value)| **value != 0.0) {
            rows[row].push(column);
        }
    }
    rows
}
