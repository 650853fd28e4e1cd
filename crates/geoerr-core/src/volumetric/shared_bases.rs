//! Bases that several parts have in common: evaluated once for all of them.
//!
//! Error functions of one axis often have the same basis, whatever they move: of eighteen there are three to eight kinds.

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use super::problem::BLOCK_ROWS;
use super::term::{Part, Shape};
use crate::bases::Basis;
use crate::kinematics::Axis;

/// Numbers of functions that are kept for all rows: 128 MB of them. Of more rows they are made again each time.
const MOST_KEPT: usize = 1 << 24;

/// The different bases of a model's parts, with their axes.
#[derive(Debug, Clone, Default)]
pub(super) struct SharedBases {
    bases: Vec<(Axis, Basis)>,
    /// Place among the bases by part; a formula's is of no meaning.
    of_part: Vec<usize>,
    /// Of all rows, once they were asked for: positions stay where they are, and a fit asks for them a dozen times.
    of_rows: Arc<OnceLock<Vec<Supports>>>,
}

impl SharedBases {
    /// Those of some parts, in their order.
    pub(super) fn of<'a>(parts: impl Iterator<Item = &'a Part>) -> Self {
        let mut shared = Self::default();
        for part in parts {
            let place = match &part.shape {
                Shape::Basis { axis, basis } => shared.place_of(*axis, basis),
                Shape::Expression { .. } => 0,
            };
            shared.of_part.push(place);
        }
        shared
    }

    fn place_of(&mut self, axis: Axis, basis: &Basis) -> usize {
        let known = self.bases.iter().position(|(own_axis, own)| *own_axis == axis && own == basis);
        known.unwrap_or_else(|| {
            self.bases.push((axis, basis.clone()));
            self.bases.len() - 1
        })
    }

    /// The place of a part's basis among all.
    pub(super) fn of_part(&self, part: usize) -> usize {
        self.of_part[part]
    }

    /// Keeps the functions at all rows, unless they are too many.
    ///
    /// Two threads that ask for them at once both make them: none waits for another.
    pub(super) fn keep(&self, positions_mm: &[[f64; 3]]) {
        let width: usize = self.bases.iter().map(|(_, basis)| basis.most_support()).sum();
        if self.of_rows.get().is_none() && width * positions_mm.len() <= MOST_KEPT {
            // Those of the other thread are the same.
            let _ = self.of_rows.set(self.supports(positions_mm));
        }
    }

    /// Keeps what others keep of the same positions, where they are the same bases.
    pub(super) fn keep_those_of(&mut self, other: &Self) {
        if self.bases == other.bases {
            self.of_rows = Arc::clone(&other.of_rows);
        }
    }

    /// The functions of every basis at some rows: of those that are kept, or made of these alone.
    ///
    /// `positions_mm` are those of all rows, always the same.
    pub(super) fn at_rows<'a>(&'a self, rows: &[usize], positions_mm: &[[f64; 3]]) -> AtRows<'a> {
        let known = self.of_rows.get().map(Vec::as_slice);
        let made = known.map_or_else(
            || self.supports(&rows.iter().map(|&row| positions_mm[row]).collect::<Vec<_>>()),
            |_| Vec::new(),
        );
        AtRows { known, made }
    }

    fn supports(&self, positions_mm: &[[f64; 3]]) -> Vec<Supports> {
        self.bases.iter().map(|(axis, basis)| Supports::of(*axis, basis, positions_mm)).collect()
    }
}

/// The functions of every basis at some rows.
pub(super) struct AtRows<'a> {
    /// Of all rows.
    known: Option<&'a [Supports]>,
    /// Of these rows.
    made: Vec<Supports>,
}

impl AtRows<'_> {
    /// The first function of a basis and the values from there on, at a row, whose place is `at`.
    #[inline]
    pub(super) fn of(&self, basis: usize, row: usize, at: usize) -> (usize, &[f64]) {
        let (supports, place) = self.supports(row, at);
        supports[basis].at(place)
    }

    /// A number that rows of one session have in common where every basis has the same functions there; others rarely.
    pub(super) fn cell(&self, row: usize, at: usize, session: usize) -> u64 {
        let (supports, place) = self.supports(row, at);
        supports.iter().fold(session as u64, |cell, own| {
            // Neighbours in the order of numbers share the functions of the first bases.
            cell.wrapping_mul(own.n_functions as u64).wrapping_add(own.at(place).0 as u64)
        })
    }

    /// The functions of every basis, and a row's place in them.
    #[inline]
    fn supports(&self, row: usize, at: usize) -> (&[Supports], usize) {
        self.known.map_or((&self.made, at), |known| (known, row))
    }
}

/// Functions of one basis that may be other than 0 at some positions.
#[derive(Debug)]
pub(super) struct Supports {
    n_functions: usize,
    /// Numbers that each position has room for.
    width: usize,
    values: Vec<f64>,
    /// The first function at each position, and how many there are.
    begins: Vec<(u32, u32)>,
}

impl Supports {
    fn of(axis: Axis, basis: &Basis, positions_mm: &[[f64; 3]]) -> Self {
        let width = basis.most_support();
        let mut values = vec![0.0; width * positions_mm.len()];
        let begins = (positions_mm.par_iter().zip(values.par_chunks_exact_mut(width)))
            .with_min_len(BLOCK_ROWS)
            .map(|(q_mm, functions)| {
                let (begin, count) = basis.support(q_mm[axis.index()], functions);
                (begin as u32, count as u32)
            })
            .collect();
        Self { n_functions: basis.len(), width, values, begins }
    }

    /// The first function's number at a position, and the values from there on.
    #[inline]
    fn at(&self, position: usize) -> (usize, &[f64]) {
        let (begin, count) = self.begins[position];
        (begin as usize, &self.values[self.width * position..][..count as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_that_are_kept_are_those_that_are_made() {
        let basis = Basis::bspline(vec![0.0, 40.0, 100.0], 3).unwrap();
        let other = Basis::polynomial(0.0, 100.0, 2).unwrap();
        let bases = vec![(Axis::X, basis), (Axis::Z, other)];
        let shared = SharedBases { bases, ..SharedBases::default() };
        let positions_mm: Vec<[f64; 3]> =
            (0..30).map(|i| [f64::from(i * 37 % 101), 0.0, 3.0 * f64::from(i)]).collect();
        let rows = [7, 0, 29, 7];
        let made = shared.at_rows(&rows, &positions_mm);
        assert!(made.known.is_none());
        shared.keep(&positions_mm);
        let known = shared.at_rows(&rows, &positions_mm);
        assert!(known.known.is_some() && known.made.is_empty());
        for (at, &row) in rows.iter().enumerate() {
            for basis in 0..2 {
                assert_eq!(known.of(basis, row, at), made.of(basis, row, at));
            }
            assert_eq!(known.cell(row, at, 1), made.cell(row, at, 1));
        }
    }
}
