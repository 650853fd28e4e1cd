//! Bases that several parts have in common: evaluated once for all of them.
//!
//! Error functions of one axis often have the same basis, whatever they move: of eighteen there are three to eight kinds.

use super::term::{Part, Shape};
use crate::bases::Basis;
use crate::kinematics::Axis;

/// The different bases of a model's parts, with their axes.
#[derive(Debug, Clone, Default)]
pub(super) struct SharedBases {
    bases: Vec<(Axis, Basis)>,
    /// Place among the bases by part; a formula's is of no meaning.
    of_part: Vec<usize>,
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

    /// A number that positions have in common where every basis has the same functions there, of one session; others
    /// rarely.
    pub(super) fn cell_of(&self, q_mm: &[f64; 3], session: usize) -> u64 {
        let mut functions = Vec::new();
        self.bases.iter().fold(session as u64, |cell, (axis, basis)| {
            functions.resize(basis.most_support().max(functions.len()), 0.0);
            let (begin, _) = basis.support(q_mm[axis.index()], &mut functions);
            // Neighbours in the order of numbers share the functions of the first bases.
            cell.wrapping_mul(basis.len() as u64).wrapping_add(begin as u64)
        })
    }

    /// The functions of every basis at some positions of the machine.
    pub(super) fn supports<'a>(
        &self,
        positions_mm: impl ExactSizeIterator<Item = &'a [f64; 3]> + Clone,
    ) -> Vec<Supports> {
        self.bases.iter().map(|(axis, basis)| Supports::of(*axis, basis, positions_mm.clone())).collect()
    }
}

/// Functions of one basis that may be other than 0 at some positions.
pub(super) struct Supports {
    /// Numbers that each position has room for.
    width: usize,
    values: Vec<f64>,
    /// The first function at each position, and how many there are.
    begins: Vec<(usize, usize)>,
}

impl Supports {
    fn of<'a>(axis: Axis, basis: &Basis, positions_mm: impl ExactSizeIterator<Item = &'a [f64; 3]>) -> Self {
        let width = basis.most_support();
        let mut values = vec![0.0; width * positions_mm.len()];
        let begins = positions_mm
            .zip(values.chunks_exact_mut(width))
            .map(|(q_mm, functions)| basis.support(q_mm[axis.index()], functions))
            .collect();
        Self { width, values, begins }
    }

    /// The first function's number at a position, and the values from there on.
    pub(super) fn at(&self, position: usize) -> (usize, &[f64]) {
        let (begin, count) = self.begins[position];
        (begin, &self.values[self.width * position..][..count])
    }
}
