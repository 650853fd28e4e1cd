//! Blocks of rows left out of a bordered system, at a cost that grows with their rows.
//!
//! A row has of `W = A F` the few columns q of its own group, and the border's z. Of a block b that is left out,
//!
//! ```math
//! I - W^\mathsf{T}W = \begin{bmatrix} I - D_1 & & -E_1 \\ & \ddots & \vdots \\ & & I - M \end{bmatrix},\quad
//! D_s = q_s^\mathsf{T}q_s,\quad E_s = q_s^\mathsf{T}z_s,\quad M = z^\mathsf{T}z,\qquad
//! K = I - M - \sum_s E_s^\mathsf{T} T_s E_s,\quad T_s = (I - D_s)^{-1}
//! ```
//!
//! with D_s as small as the unknowns of the group. Where a group lies wholly in the block D_s = I, and E_s = 0 because
//! columns of W are orthogonal: its unknowns are its own and are left at their best, as in
//! [`leave_out`](super::leave_out). How many eigenvalues of `WᵀW` reach a limit is told by how many of limit · I − D_s and
//! of its K are negative (Sylvester's law of inertia).
//!
//! # Source
//! As [`leave_out`](super::leave_out); Golub & Van Loan, *Matrix Computations*, 4th ed., 8.1.5 (inertia).
//!
//! # Verified
//! `tests/least_squares/bordered.rs`: against [`leave_blocks_out_of_residuals`](super::leave_blocks_out_of_residuals).

use std::ops::Range;

use rayon::prelude::*;

use super::blocks::{Blocks, Design, check_finite};
use super::bordered::chunks;
use super::bordered_root::{BorderedRoot, GroupRoot};
use super::definite::Definite;
use super::dense;
use super::error::LeastSquaresError;
use super::leave_out::LeftOut;
use super::matrix::Matrix;

/// Parts of a block that are summed by themselves, at most: each sum is a matrix.
const SUMS: usize = 16;

/// What blocks of a bordered system are left out with; the design's right-hand side holds the residuals.
pub(super) struct Bordered<'a, D: ?Sized> {
    pub design: &'a D,
    pub root: &'a BorderedRoot,
    /// Group of each row; those of a group stand together in every block.
    pub group: &'a [usize],
    /// Eigenvalue from which on the rest determines nothing.
    pub limit: f64,
    /// Of all rows, as in [`leave_blocks_out_of_residuals`](super::leave_blocks_out_of_residuals).
    pub weights: Option<&'a [f64]>,
}

/// Rows of one group in a block, and their products: D (r, r), E (r, m), the same with weights, and `qᵀ r`.
struct Part<'a> {
    root: &'a GroupRoot,
    plain: Products,
    weighted: Option<Products>,
    right: Matrix,
}

#[derive(Clone)]
struct Products {
    d: Matrix,
    e: Matrix,
}

/// M (m, m), the same with weights, and `zᵀ r`.
struct OfBorder {
    plain: Matrix,
    weighted: Option<Matrix>,
    right: Matrix,
}

/// The parts of some rows, and what they have of the border.
type OfLot<'a> = (Vec<Part<'a>>, OfBorder);

impl<D: Design + ?Sized> Bordered<'_, D> {
    /// Leaves every block out; `own` as in [`leave_blocks_out_of_residuals`](super::leave_blocks_out_of_residuals).
    pub fn left_out(&self, blocks: &Blocks, own: &[usize]) -> Result<LeftOut, D::Error> {
        let of_block = |block: usize| self.of_block(blocks.rows(block), own[block]);
        let parts: Vec<Result<LeftOut, D::Error>> = (0..blocks.len()).into_par_iter().map(of_block).collect();
        let mut result = LeftOut::default();
        for part in parts {
            result.append(part?);
        }
        Ok(result)
    }

    fn of_block(&self, rows: Range<usize>, own: usize) -> Result<LeftOut, D::Error> {
        let residual = self.residuals(&rows)?;
        // One weight of all rows is a factor of their sum.
        let weights = self.weights.map(|weights| &weights[rows.clone()]);
        let differ = weights.filter(|weights| weights.windows(2).any(|two| two[0] != two[1]));
        let factor = if differ.is_some() { None } else { weights.and_then(<[f64]>::first).copied() };
        let (parts, border) = self.products(&rows, &residual, differ)?;
        let Some((correction, variance)) = self.by_the_rest(&parts, &border, own)? else {
            return Ok(LeftOut::not_determined(residual));
        };
        let more = self.times(&rows, &correction)?;
        let held_out = residual.iter().zip(&more).map(|(r, more)| r + more).collect();
        Ok(LeftOut {
            residual,
            held_out,
            is_determined: vec![true],
            prediction_variance: vec![factor.unwrap_or(1.0) * variance],
        })
    }

    /// Rows of one group each.
    fn runs(&self, rows: &Range<usize>) -> Vec<Range<usize>> {
        let mut start = rows.start;
        self.group[rows.clone()]
            .chunk_by(|one, next| one == next)
            .map(|run| {
                let own = start..start + run.len();
                start = own.end;
                own
            })
            .collect()
    }

    fn residuals(&self, rows: &Range<usize>) -> Result<Vec<f64>, D::Error> {
        let mut residual = Matrix::zeros(rows.len(), 1);
        self.design.fill_columns(rows.clone(), &[self.design.n_columns()], &mut residual)?;
        check_finite(&residual, rows.start)?;
        Ok(residual.into_values())
    }

    fn products(
        &self,
        rows: &Range<usize>,
        residual: &[f64],
        weights: Option<&[f64]>,
    ) -> Result<OfLot<'_>, D::Error> {
        let runs = self.runs(rows);
        let none = || OfBorder::none(self.root.of_border.n_columns(), weights.is_some());
        let lots: Vec<Result<OfLot<'_>, D::Error>> = runs
            .par_chunks(runs.len().div_ceil(SUMS).max(1))
            .map(|runs| {
                let mut border = none();
                let parts = runs
                    .iter()
                    .map(|run| {
                        let own = run.start - rows.start..run.end - rows.start;
                        let weights = weights.map(|weights| &weights[own.clone()]);
                        self.part(run, &residual[own], weights, &mut border)
                    })
                    .collect::<Result<_, _>>()?;
                Ok((parts, border))
            })
            .collect();
        let (mut parts, mut border) = (Vec::new(), none());
        for lot in lots {
            let (more, of_lot) = lot?;
            parts.extend(more);
            add(&mut border.plain, &of_lot.plain);
            if let (Some(sum), Some(part)) = (&mut border.weighted, &of_lot.weighted) {
                add(sum, part);
            }
            add(&mut border.right, &of_lot.right);
        }
        Ok((parts, border))
    }

    fn part(
        &self,
        rows: &Range<usize>,
        residual: &[f64],
        weights: Option<&[f64]>,
        border: &mut OfBorder,
    ) -> Result<Part<'_>, D::Error> {
        let root = &self.root.groups[self.group[rows.start]];
        let (k, r, m) = (root.columns.len(), root.own.n_columns(), self.root.of_border.n_columns());
        let columns: Vec<usize> = root.columns.iter().chain(&self.root.border).copied().collect();
        let nothing = Products { d: Matrix::zeros(r, r), e: Matrix::zeros(r, m) };
        let weighted = weights.map(|_| nothing.clone());
        let mut part = Part { root, plain: nothing, weighted, right: Matrix::zeros(r, 1) };
        for chunk in chunks(rows, self.design.n_together()) {
            let mut made = Matrix::zeros(chunk.len(), columns.len());
            self.design.fill_columns(chunk.clone(), &columns, &mut made)?;
            check_finite(&made, chunk.start)?;
            let of_group = made.with_columns(0..k);
            let mut q = dense::product(&of_group, &root.own);
            let mut z = dense::product(&made.with_columns(k..columns.len()), &self.root.of_border);
            add(&mut z, &dense::product(&of_group, &root.along));
            let own = chunk.start - rows.start..chunk.end - rows.start;
            let right = Matrix::from_column(residual[own.clone()].to_vec());
            add(&mut part.right, &dense::transposed_product(&q, &right));
            add(&mut border.right, &dense::transposed_product(&z, &right));
            add_products(&q, &z, &mut part.plain, &mut border.plain);
            if let (Some(weights), Some(of_part), Some(of_border)) =
                (weights, &mut part.weighted, &mut border.weighted)
            {
                times_roots(&mut q, &weights[own.clone()]);
                times_roots(&mut z, &weights[own]);
                add_products(&q, &z, of_part, of_border);
            }
        }
        Ok(part)
    }

    /// What is to be added to the unknowns (n) where the rest alone decides, and the weighted variance of the prediction.
    fn by_the_rest(
        &self,
        parts: &[Part<'_>],
        border: &OfBorder,
        own: usize,
    ) -> Result<Option<(Vec<f64>, f64)>, LeastSquaresError> {
        let m = self.root.of_border.n_columns();
        let height = parts.iter().map(|part| part.right.n_rows()).sum();
        // E, T E, the same at the limit, and E with weights, of one part below the other.
        let [mut e, mut te, mut te_at_limit, mut e_weighted, mut dte] =
            [(); 5].map(|()| Matrix::zeros(height, m));
        let (mut n_open, mut variance, mut at) = (0, 0.0, 0);
        let mut own_parts = Vec::with_capacity(parts.len());
        for part in parts {
            let (values, vectors) = dense::symmetric_eigen(&part.plain.d)?;
            n_open += values.iter().filter(|&&value| value >= self.limit).count();
            let inverse = |most: f64| {
                let is_told = |j: usize| values[j] < self.limit;
                let gain = |j: usize| if is_told(j) { (most - values[j]).recip().sqrt() } else { 0.0 };
                let root = Matrix::from_fn(values.len(), values.len(), |i, j| vectors[(i, j)] * gain(j));
                dense::product(&root, &root.transposed())
            };
            let t = inverse(1.0);
            let weighted = part.weighted.as_ref().unwrap_or(&part.plain);
            variance += sum_of_products(&t, &weighted.d);
            let te_of_part = dense::product(&t, &part.plain.e);
            put(&mut e, at, &part.plain.e);
            put(&mut te_at_limit, at, &dense::product(&inverse(self.limit), &part.plain.e));
            put(&mut e_weighted, at, &weighted.e);
            put(&mut dte, at, &dense::product(&weighted.d, &te_of_part));
            put(&mut te, at, &te_of_part);
            at += values.len();
            own_parts.push((t, te_of_part));
        }
        let plus = |sum: &Matrix, left: &Matrix, right: &Matrix| {
            let mut whole = sum.clone();
            add(&mut whole, &dense::transposed_product(left, right));
            whole
        };
        let complement = |most: f64, sum: &Matrix| {
            Matrix::from_fn(m, m, |i, j| f64::from(u8::from(i == j)) * most - sum[(i, j)])
        };
        let at_limit = complement(self.limit, &plus(&border.plain, &e, &te_at_limit));
        let is_told = n_open <= own && Definite::of(at_limit.clone()).is_some();
        let left = Definite::of(complement(1.0, &plus(&border.plain, &e, &te)));
        let Some(left) = left.filter(|_| is_told) else {
            let (values, _) = dense::symmetric_eigen(&at_limit)?;
            n_open += values.iter().filter(|&&value| value <= 0.0).count();
            return if n_open > own { Ok(None) } else { self.by_directions(parts, border, own) };
        };
        let mut k = Matrix::identity(m);
        left.solve(&mut k);
        let rights: Vec<f64> = parts.iter().flat_map(|part| part.right.as_slice()).copied().collect();
        let of_border = dense::product(&k, &plus(&border.right, &te, &Matrix::from_column(rights)));
        let mut correction = self.of_border(&of_border);
        for (part, (t, te)) in parts.iter().zip(&own_parts) {
            let mut own = dense::product(t, &part.right);
            add(&mut own, &dense::product(te, &of_border));
            part.root.add_times(&own, &of_border, &mut correction);
        }
        // The variance of a row is qᵀ T q + uᵀ K⁻¹ u with u = z + Eᵀ T q: their sums are made of those of q and z.
        let across = dense::transposed_product(&te, &e_weighted);
        let mut sum = plus(border.weighted.as_ref().unwrap_or(&border.plain), &te, &dte);
        add(&mut sum, &across);
        add(&mut sum, &across.transposed());
        Ok(Some((correction, variance + sum_of_products(&k, &sum))))
    }

    /// The same by the directions of the block as a whole, at the cube of its unknowns: where one of the border is its own.
    fn by_directions(
        &self,
        parts: &[Part<'_>],
        border: &OfBorder,
        own: usize,
    ) -> Result<Option<(Vec<f64>, f64)>, LeastSquaresError> {
        let m = self.root.of_border.n_columns();
        let n = m + parts.iter().map(|part| part.right.n_rows()).sum::<usize>();
        let whole = |of_border: &Matrix, of_part: &dyn Fn(&Part<'_>) -> Products| {
            let mut whole = Matrix::zeros(n, n);
            (0..m).for_each(|j| whole.column_mut(j)[..m].copy_from_slice(of_border.column(j)));
            let mut first = m;
            for part in parts {
                let Products { d, e } = of_part(part);
                for (i, j) in (0..d.n_rows()).flat_map(|i| (0..m).map(move |j| (i, j))) {
                    whole[(first + i, j)] = e[(i, j)];
                    whole[(j, first + i)] = e[(i, j)];
                }
                for j in 0..d.n_columns() {
                    whole.column_mut(first + j)[first..first + d.n_rows()].copy_from_slice(d.column(j));
                }
                first += d.n_rows();
            }
            whole
        };
        let (values, vectors) = dense::symmetric_eigen(&whole(&border.plain, &|part| part.plain.clone()))?;
        if values.iter().filter(|&&value| value >= self.limit).count() > own {
            return Ok(None);
        }
        let gain = |j: usize| if values[j] < self.limit { (1.0 - values[j]).recip().sqrt() } else { 0.0 };
        let root = Matrix::from_fn(n, n, |i, j| vectors[(i, j)] * gain(j));
        let inverse = dense::product(&root, &root.transposed());
        let rights = [&border.right].into_iter().chain(parts.iter().map(|part| &part.right));
        let rights: Vec<f64> = rights.flat_map(|right| right.as_slice()).copied().collect();
        let along = dense::product(&inverse, &Matrix::from_column(rights)).into_values();
        let of_border = Matrix::from_column(along[..m].to_vec());
        let mut correction = self.of_border(&of_border);
        let mut first = m;
        for part in parts {
            let own = Matrix::from_column(along[first..first + part.right.n_rows()].to_vec());
            part.root.add_times(&own, &of_border, &mut correction);
            first += part.right.n_rows();
        }
        let weighted = whole(border.weighted.as_ref().unwrap_or(&border.plain), &|part| {
            part.weighted.as_ref().unwrap_or(&part.plain).clone()
        });
        Ok(Some((correction, sum_of_products(&inverse, &weighted))))
    }

    /// Unknowns (n) of the border alone, by its columns of W.
    fn of_border(&self, y: &Matrix) -> Vec<f64> {
        let mut x = vec![0.0; self.design.n_columns()];
        let moved = dense::product(&self.root.of_border, y);
        self.root.border.iter().zip(moved.as_slice()).for_each(|(&to, &value)| x[to] = value);
        x
    }

    /// What a correction of the unknowns moves in some rows.
    fn times(&self, rows: &Range<usize>, x: &[f64]) -> Result<Vec<f64>, D::Error> {
        if let Some(moved) = self.design.times_of(rows.clone(), x) {
            return Ok(moved);
        }
        let mut moved = Vec::with_capacity(rows.len());
        for run in self.runs(rows) {
            let root = &self.root.groups[self.group[run.start]];
            let columns: Vec<usize> = root.columns.iter().chain(&self.root.border).copied().collect();
            let own = Matrix::from_column(columns.iter().map(|&column| x[column]).collect());
            for chunk in chunks(&run, self.design.n_together()) {
                let mut made = Matrix::zeros(chunk.len(), columns.len());
                self.design.fill_columns(chunk, &columns, &mut made)?;
                moved.extend_from_slice(dense::product(&made, &own).as_slice());
            }
        }
        Ok(moved)
    }
}

impl OfBorder {
    fn none(m: usize, has_weights: bool) -> Self {
        let weighted = has_weights.then(|| Matrix::zeros(m, m));
        Self { plain: Matrix::zeros(m, m), weighted, right: Matrix::zeros(m, 1) }
    }
}

fn add_products(q: &Matrix, z: &Matrix, own: &mut Products, border: &mut Matrix) {
    add(&mut own.d, &dense::gram(q));
    add(&mut own.e, &dense::transposed_product(q, z));
    add(border, &dense::gram(z));
}

fn add(sum: &mut Matrix, part: &Matrix) {
    sum.as_mut_slice().iter_mut().zip(part.as_slice()).for_each(|(sum, part)| *sum += part);
}

/// Puts rows into a matrix, from a place on.
fn put(stack: &mut Matrix, first: usize, rows: &Matrix) {
    for column in 0..rows.n_columns() {
        stack.column_mut(column)[first..first + rows.n_rows()].copy_from_slice(rows.column(column));
    }
}

/// Rows times the roots of their weights.
fn times_roots(rows: &mut Matrix, weights: &[f64]) {
    for column in 0..rows.n_columns() {
        rows.column_mut(column).iter_mut().zip(weights).for_each(|(value, weight)| *value *= weight.sqrt());
    }
}

/// Sum of the products of the entries of two matrices.
fn sum_of_products(one: &Matrix, other: &Matrix) -> f64 {
    one.as_slice().iter().zip(other.as_slice()).map(|(one, other)| one * other).sum()
}
