//! A tall system `[A | b]` that nobody holds as a whole: its rows come block by block.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::join;

use super::LeastSquaresError;
use super::matrix::Matrix;

/// A tall least-squares system, generated row block by row block.
///
/// Weights belong in the rows: divide each by its standard deviation, or multiply a group by the inverse root of its
/// covariance. Rows 10⁶ times heavier than others cost the others digits: what must hold exactly is a
/// [`Restriction`](super::Restriction), not a heavy row.
pub trait Design: Sync {
    /// What generating a block may fail with.
    type Error: From<LeastSquaresError> + Send;

    /// Rows of the whole system.
    fn n_rows(&self) -> usize;

    /// Unknowns: columns of A.
    fn n_columns(&self) -> usize;

    /// Right-hand sides: columns after those of A.
    fn n_rhs(&self) -> usize {
        1
    }

    /// Rows that are made together: where they are cut, they are cut at multiples of it.
    fn n_together(&self) -> usize {
        1
    }

    /// Writes rows `rows` of `[A | b]` into `block`, which has `rows.len()` rows and holds zeros.
    ///
    /// Called for several blocks at once, in any order, and for every pass over the system again.
    ///
    /// # Errors
    /// The design's own; of several blocks' errors the first block's is reported.
    fn fill(&self, rows: Range<usize>, block: &mut Matrix) -> Result<(), Self::Error>;

    /// Writes some columns of rows `rows` of `[A | b]`, those of b after those of A, into `block`, which holds zeros.
    ///
    /// # Errors
    /// The design's own.
    fn fill_columns(
        &self,
        rows: Range<usize>,
        columns: &[usize],
        block: &mut Matrix,
    ) -> Result<(), Self::Error> {
        let mut whole = Matrix::zeros(rows.len(), self.n_columns() + self.n_rhs());
        self.fill(rows, &mut whole)?;
        *block = whole.with_columns(columns.iter().copied());
        Ok(())
    }

    /// The norms that columns of A count with where these are not their own, as of a part of what the rows tell.
    fn norms(&self) -> Option<&[f64]> {
        None
    }

    /// `[A | b]ᵀ [A | b]`, both triangles, where the design knows a shorter way to it than through its rows; not finite
    /// where an entry is not.
    fn gram(&self) -> Option<Matrix> {
        None
    }

    /// The lower triangle of `[A | b]ᵀ [A | b]` of some rows, where the design knows a shorter way to it than by columns; not
    /// finite where an entry is not.
    fn lower_gram_of(&self, _rows: Range<usize>) -> Option<Matrix> {
        None
    }

    /// `[Aᵀr, rᵀr]` (n + 1, k) of some rows, with `r = b − A x`, where the design knows such a way to it; not finite where an
    /// entry is not.
    fn residual_products_of(&self, _rows: Range<usize>, _x: &Matrix) -> Option<Matrix> {
        None
    }

    /// `AᵀA x` (n, d) and `xᵀAᵀA x` (d, d) for directions x (n, d), where the design knows such a way to them too.
    fn along(&self, _directions: &Matrix) -> Option<(Matrix, Matrix)> {
        None
    }

    /// What some rows sum up to, where the design knows such a way to it; not finite where an entry is not. `weights` (rows)
    /// are those of [`Sums::weighted`].
    fn sums_of(&self, _rows: Range<usize>, _weights: Option<&[f64]>) -> Option<Sums> {
        None
    }

    /// `aᵀx` of each of some rows for a direction x (n), where the design knows such a way to it.
    fn times_of(&self, _rows: Range<usize>, _direction: &[f64]) -> Option<Vec<f64>> {
        None
    }

    /// Where one block ends and the next begins.
    fn blocks(&self) -> Blocks {
        Blocks::uniform(self.n_rows(), self.n_columns() + self.n_rhs())
    }
}

/// What rows `[A | b]` sum up to.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums {
    /// `AᵀA`, both triangles.
    pub gram: Matrix,
    /// The same with every row's products times its weight, where there are weights.
    pub weighted: Option<Matrix>,
    /// `Aᵀb` (n, k).
    pub products: Matrix,
    /// b (rows, k).
    pub rhs: Matrix,
}

/// Where the rows of a system are cut.
///
/// The cuts decide the rounding of every sum, so they depend on the system alone, never on the number of threads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Blocks {
    cuts: Vec<usize>,
}

impl Blocks {
    /// Blocks of equal height, four times their width: merging two triangles then costs a tenth of making them.
    #[must_use]
    pub fn uniform(n_rows: usize, width: usize) -> Self {
        let height = (4 * width).max(512);
        let cuts = (0..n_rows).step_by(height).chain([n_rows]).collect();
        Self { cuts }
    }

    /// Blocks that begin at the given rows, the first of them 0; the last ends at `n_rows`.
    ///
    /// # Errors
    /// [`LeastSquaresError::Cuts`] unless the starts begin with 0 and do not fall.
    pub fn starting_at(starts: &[usize], n_rows: usize) -> Result<Self, LeastSquaresError> {
        let cuts: Vec<usize> = starts.iter().copied().chain([n_rows]).collect();
        let begins = n_rows == 0 || cuts[0] == 0;
        match cuts.windows(2).position(|pair| pair[1] < pair[0]) {
            None if begins => Ok(Self { cuts }),
            fall => Err(LeastSquaresError::Cuts { index: fall.unwrap_or(0) }),
        }
    }

    /// Number of blocks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cuts.len() - 1
    }

    /// No block at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Rows of all blocks.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.cuts.last().copied().unwrap_or(0)
    }

    /// Rows of one block.
    #[must_use]
    pub fn rows(&self, block: usize) -> Range<usize> {
        self.cuts[block]..self.cuts[block + 1]
    }
}

/// A system given by a function; see [`design_fn`].
pub struct FnDesign<F> {
    n_rows: usize,
    n_columns: usize,
    fill: F,
}

/// A system with one right-hand side, `fill(rows, block)` as in [`Design::fill`].
pub fn design_fn<E, F>(n_rows: usize, n_columns: usize, fill: F) -> FnDesign<F>
where
    E: From<LeastSquaresError> + Send,
    F: Fn(Range<usize>, &mut Matrix) -> Result<(), E> + Sync,
{
    FnDesign { n_rows, n_columns, fill }
}

impl<E, F> Design for FnDesign<F>
where
    E: From<LeastSquaresError> + Send,
    F: Fn(Range<usize>, &mut Matrix) -> Result<(), E> + Sync,
{
    type Error = E;

    fn n_rows(&self) -> usize {
        self.n_rows
    }

    fn n_columns(&self) -> usize {
        self.n_columns
    }

    fn fill(&self, rows: Range<usize>, block: &mut Matrix) -> Result<(), E> {
        (self.fill)(rows, block)
    }
}

/// A system that is held in memory.
pub struct StoredDesign<'a> {
    a: &'a Matrix,
    b: &'a Matrix,
}

impl<'a> StoredDesign<'a> {
    /// `b` has one column for every right-hand side.
    ///
    /// # Errors
    /// [`LeastSquaresError::RowsDiffer`] for another number of rows in `b`.
    pub fn new(a: &'a Matrix, b: &'a Matrix) -> Result<Self, LeastSquaresError> {
        if a.n_rows() != b.n_rows() {
            return Err(LeastSquaresError::RowsDiffer { expected: a.n_rows(), found: b.n_rows() });
        }
        Ok(Self { a, b })
    }
}

impl Design for StoredDesign<'_> {
    type Error = LeastSquaresError;

    fn n_rows(&self) -> usize {
        self.a.n_rows()
    }

    fn n_columns(&self) -> usize {
        self.a.n_columns()
    }

    fn n_rhs(&self) -> usize {
        self.b.n_columns()
    }

    fn fill(&self, rows: Range<usize>, block: &mut Matrix) -> Result<(), LeastSquaresError> {
        for column in 0..self.a.n_columns() {
            block.column_mut(column).copy_from_slice(&self.a.column(column)[rows.clone()]);
        }
        for column in 0..self.b.n_columns() {
            let target = block.column_mut(self.a.n_columns() + column);
            target.copy_from_slice(&self.b.column(column)[rows.clone()]);
        }
        Ok(())
    }
}

/// Memory of blocks that are done, for the next ones: a fresh block costs as much as a pass over it in page faults.
#[derive(Default)]
pub(super) struct Spares(Mutex<Vec<Vec<f64>>>);

impl Spares {
    /// Fills a block of a design and hands it to `work`.
    pub fn with_block<D: Design + ?Sized, T>(
        &self,
        design: &D,
        rows: Range<usize>,
        work: impl FnOnce(&mut Matrix) -> Result<T, D::Error>,
    ) -> Result<T, D::Error> {
        let width = design.n_columns() + design.n_rhs();
        let mut values = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        if values.capacity() < rows.len() * width {
            values = vec![0.0; rows.len() * width];
        } else {
            values.clear();
            values.resize(rows.len() * width, 0.0);
        }
        let mut block = Matrix::of_values(rows.len(), width, values);
        design.fill(rows, &mut block)?;
        let result = work(&mut block);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(block.into_values());
        result
    }
}

/// Refuses a block with an entry that is not finite, by its row in the whole system.
pub(super) fn check_finite(block: &Matrix, first_row: usize) -> Result<(), LeastSquaresError> {
    match block.first_non_finite() {
        Some((row, column)) => Err(LeastSquaresError::NonFinite { row: first_row + row, column }),
        None => Ok(()),
    }
}

/// Makes a value of every block and merges them pairwise, always in the same tree; `None` without blocks.
pub(super) fn tree<T, E>(
    blocks: Range<usize>,
    make: &(impl Fn(usize) -> Result<T, E> + Sync),
    merge: &(impl Fn(T, T) -> T + Sync),
) -> Result<Option<T>, E>
where
    T: Send,
    E: Send,
{
    if blocks.len() < 2 {
        return blocks.map(make).next().transpose();
    }
    let middle = blocks.start + blocks.len() / 2;
    let (left, right) =
        join(|| tree(blocks.start..middle, make, merge), || tree(middle..blocks.end, make, merge));
    Ok(match (left?, right?) {
        (Some(left), Some(right)) => Some(merge(left, right)),
        (left, right) => left.or(right),
    })
}
