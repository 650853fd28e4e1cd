//! The problem as a tall system for least squares: whitened design and residuals, block by block.

use std::ops::Range;

use super::block::Block;
use super::kept_sums::{Begun, KeptSums, begun};
use super::problem::NUMBERS_OF_A_ROW;
use super::{Problem, State, VolumetricError};
use crate::least_squares::{Blocks, Design, Matrix, Sums};

/// A block has at least so many rows for each of its columns: merging triangles then costs a fifth of making them.
const BLOCK_WIDTHS: usize = 4;

/// A block has at least so many rows: fewer do not pay for handing them to a thread.
const LEAST_BLOCK: usize = 768;

/// Whitened design of a problem at a state, with the whitened residuals as its right-hand side or without.
///
/// Rows of the system are three numbers for each sighting.
#[derive(Debug)]
pub struct WhitenedDesign<'a> {
    block: Block<'a>,
    whitened: Option<Vec<[f64; 3]>>,
    row_scale: &'a [f64],
    /// Order of the sightings in the system.
    order: Vec<usize>,
    /// `AᵀA`, where it is known.
    gram: Option<Matrix>,
    /// Sums of blocks of another design to begin at.
    begun: Option<Begun<'a>>,
    /// Those of this one, where they are kept.
    kept: Option<KeptSums>,
}

impl<'a> WhitenedDesign<'a> {
    /// The design at `state`, without a right-hand side; each sighting counts with its `row_scale` (0 leaves it out).
    ///
    /// # Errors
    /// [`VolumetricError::Length`], [`VolumetricError::Expression`].
    pub fn without_residuals(
        problem: &'a Problem,
        state: &'a State,
        row_scale: &'a [f64],
    ) -> Result<Self, VolumetricError> {
        let (found, needed) = (row_scale.len(), problem.n_rows());
        if found != needed {
            return Err(VolumetricError::Length { what: "row_scale", found, needed });
        }
        Ok(Self {
            block: problem.blocks(state)?,
            whitened: None,
            row_scale,
            order: (0..needed).collect(),
            gram: None,
            begun: None,
            kept: None,
        })
    }

    /// The system of some sightings in another order, for leaving blocks of them out.
    ///
    /// # Errors
    /// As [`WhitenedDesign::without_residuals`], and where the order names sightings that there are not.
    pub fn in_order(
        problem: &'a Problem,
        state: &'a State,
        residuals_mm: &[[f64; 3]],
        row_scale: &'a [f64],
        order: Vec<usize>,
    ) -> Result<Self, VolumetricError> {
        let needed = problem.n_rows();
        for (what, found) in [("row_scale", row_scale.len()), ("residuals_mm", residuals_mm.len())] {
            if found != needed {
                return Err(VolumetricError::Length { what, found, needed });
            }
        }
        if let Some(&found) = order.iter().find(|&&row| row >= needed) {
            return Err(VolumetricError::Length { what: "order", found, needed });
        }
        let mut whitened = problem.whitened(residuals_mm);
        for (row, scale) in whitened.iter_mut().zip(row_scale) {
            *row = row.map(|value| value * scale);
        }
        let block = problem.blocks(state)?;
        let whitened = Some(whitened);
        Ok(Self { block, whitened, row_scale, order, gram: None, begun: None, kept: None })
    }

    /// The same design with its sightings in another order.
    ///
    /// # Errors
    /// [`VolumetricError::Length`] where the order names sightings that there are not.
    pub fn ordered(self, order: Vec<usize>) -> Result<Self, VolumetricError> {
        let needed = self.row_scale.len();
        match order.iter().find(|&&row| row >= needed) {
            Some(&found) => Err(VolumetricError::Length { what: "order", found, needed }),
            None => Ok(Self { order, ..self }),
        }
    }

    /// `AᵀA`, from the entries that are not 0; of a system in its own order.
    #[must_use]
    pub fn own_gram(&self) -> Matrix {
        self.block.gram(self.row_scale)
    }

    /// `AᵀA` from that of another design of the same rows: for each column of A, where the same one is in that design.
    ///
    /// # Errors
    /// [`VolumetricError::Length`] for another number of places than of columns, or a place that there is not.
    pub fn gram_from(&self, known: &Matrix, places: &[Option<usize>]) -> Result<Matrix, VolumetricError> {
        let columns = self.columns_beside(known.n_columns(), places)?;
        let made = self.block.gram_columns(&columns, self.row_scale);
        Ok(begun(known, places, &columns, made.as_slice()))
    }

    /// Columns that have no place in another design.
    fn columns_beside(
        &self,
        n_known: usize,
        places: &[Option<usize>],
    ) -> Result<Vec<usize>, VolumetricError> {
        let needed = self.block.n_columns();
        if places.len() != needed {
            return Err(VolumetricError::Length { what: "places", found: places.len(), needed });
        }
        if let Some(&place) = places.iter().flatten().find(|&&place| place >= n_known) {
            return Err(VolumetricError::Length { what: "gram", found: n_known, needed: place + 1 });
        }
        Ok((0..needed).filter(|&column| places[column].is_none()).collect())
    }

    /// The same system, whose sums over blocks begin at those of another design of the same sightings in the same order, with
    /// the same weights: for each column, where the same one is in that design.
    ///
    /// # Errors
    /// As [`WhitenedDesign::gram_from`].
    pub fn beginning_at(
        self,
        known: &'a KeptSums,
        places: &'a [Option<usize>],
    ) -> Result<Self, VolumetricError> {
        let columns = self.columns_beside(known.n_columns().unwrap_or(usize::MAX), places)?;
        Ok(Self { begun: Some(Begun { known, places, columns }), ..self })
    }

    /// The same system, which keeps what its blocks sum up to.
    #[must_use]
    pub fn keeping_sums(self) -> Self {
        Self { kept: Some(KeptSums::default()), ..self }
    }

    /// What was kept.
    #[must_use]
    pub fn into_kept_sums(self) -> Option<KeptSums> {
        self.kept
    }

    /// The same system, of which `AᵀA` is known.
    #[must_use]
    pub fn with_gram(self, gram: Matrix) -> Self {
        Self { gram: Some(gram), ..self }
    }

    /// Cuts of the system after so many sightings each.
    ///
    /// # Errors
    /// [`VolumetricError::LeastSquares`] where the starts do not rise.
    pub fn blocks_at(&self, first_sightings: &[usize]) -> Result<Blocks, VolumetricError> {
        let starts: Vec<usize> = first_sightings.iter().map(|row| row * NUMBERS_OF_A_ROW).collect();
        Ok(Blocks::starting_at(&starts, self.n_rows())?)
    }

    /// The sightings that rows of the system are of.
    fn sightings(&self, rows: Range<usize>) -> &[usize] {
        &self.order[rows.start / NUMBERS_OF_A_ROW..rows.end / NUMBERS_OF_A_ROW]
    }
}

impl Design for WhitenedDesign<'_> {
    type Error = VolumetricError;

    fn n_rows(&self) -> usize {
        NUMBERS_OF_A_ROW * self.order.len()
    }

    fn n_columns(&self) -> usize {
        self.block.n_columns()
    }

    fn n_rhs(&self) -> usize {
        usize::from(self.whitened.is_some())
    }

    fn n_together(&self) -> usize {
        NUMBERS_OF_A_ROW
    }

    fn fill(&self, rows: Range<usize>, block: &mut Matrix) -> Result<(), VolumetricError> {
        let height = rows.len();
        let (columns, rhs) = block.as_mut_slice().split_at_mut(height * self.n_columns());
        let sightings = self.sightings(rows);
        self.block.fill(sightings, self.row_scale, columns);
        if let Some(whitened) = &self.whitened {
            for (out, value) in rhs.iter_mut().zip(sightings.iter().flat_map(|&row| whitened[row])) {
                *out = value;
            }
        }
        Ok(())
    }

    fn fill_columns(
        &self,
        rows: Range<usize>,
        columns: &[usize],
        block: &mut Matrix,
    ) -> Result<(), VolumetricError> {
        let (sightings, n) = (self.sightings(rows), self.n_columns());
        let of_residuals = columns.iter().position(|&column| column == n);
        let own = &columns[..of_residuals.unwrap_or(columns.len())];
        if !own.is_empty() {
            self.block.fill_columns(sightings, own, self.row_scale, block.as_mut_slice());
        }
        if let (Some(at), Some(whitened)) = (of_residuals, &self.whitened) {
            let numbers = sightings.iter().flat_map(|&row| whitened[row]);
            block.column_mut(at).iter_mut().zip(numbers).for_each(|(out, value)| *out = value);
        }
        Ok(())
    }

    /// Of a system in its own order without residuals.
    fn gram(&self) -> Option<Matrix> {
        self.whitened.is_none().then(|| self.gram.clone().unwrap_or_else(|| self.own_gram()))
    }

    fn along(&self, directions: &Matrix) -> Option<(Matrix, Matrix)> {
        self.whitened.is_none().then(|| self.block.along(directions, self.row_scale))
    }

    fn sums_of(&self, rows: Range<usize>, weights: Option<&[f64]>) -> Option<Sums> {
        let sightings = self.sightings(rows.clone());
        let whitened = self.whitened.as_ref()?;
        let own: Vec<[f64; 3]> = sightings.iter().map(|&row| whitened[row]).collect();
        let begun = self
            .begun
            .as_ref()
            .and_then(|begun| begun.sums_of(&self.block, &rows, sightings, &own, weights, self.row_scale));
        let (gram, weighted, products) =
            begun.unwrap_or_else(|| self.block.sums_of(sightings, &own, weights, self.row_scale));
        if let Some(kept) = &self.kept {
            kept.keep(&rows, &gram, weighted.as_ref());
        }
        let rhs = Matrix::from_column(own.into_iter().flatten().collect());
        Some(Sums { gram, weighted, products: Matrix::from_column(products), rhs })
    }

    fn times_of(&self, rows: Range<usize>, direction: &[f64]) -> Option<Vec<f64>> {
        let times = self.block.first_order(self.sightings(rows), self.row_scale, direction);
        Some(times.into_iter().flatten().collect())
    }

    /// Whole sightings in every block, and each block large against its width.
    fn blocks(&self) -> Blocks {
        let n_rows = self.n_rows();
        let height =
            (BLOCK_WIDTHS * (self.n_columns() + 1)).max(LEAST_BLOCK).next_multiple_of(NUMBERS_OF_A_ROW);
        let starts: Vec<usize> = (0..n_rows).step_by(height).collect();
        Blocks::starting_at(&starts, n_rows).unwrap_or_else(|_| Blocks::uniform(n_rows, self.n_columns() + 1))
    }
}
