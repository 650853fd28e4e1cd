//! Blocks left out that have more rows than there are unknowns: by what their rows sum up to.
//!
//! The eigenvalues of `H_bb` that are not 0 are those of `Fᵀ G F` with `G = A_bᵀ A_b`, and with its eigenvectors V
//!
//! ```math
//! e_b = r_b + A_b\,P\,A_b^\mathsf{T} r_b,\qquad P = F V (I - \Lambda)^{-1} V^\mathsf{T} F^\mathsf{T}
//! ```
//!
//! so that rows are made twice, a chunk at a time, and only multiplied over the columns that a chunk has; a design that
//! knows of every row the few columns that it has is asked for the sums themselves. Mostly I − Λ is clearly positive, and
//! no eigenvector is needed. Sums of products square the condition number, as in
//! [`gram`](super::gram): the caller sees to it that κ²ε is small.

use std::ops::Range;

use super::blocks::{Design, Spares, Sums, check_finite};
use super::definite::Definite;
use super::dense;
use super::error::LeastSquaresError;
use super::leave_out::{LeftOut, ROWS_AT_ONCE, residuals, weighted_sum};
use super::matrix::Matrix;
use super::triangle::columns_in_use;

/// What every tall block of a design is left out with.
pub(super) struct Tall<'a, D: ?Sized> {
    pub design: &'a D,
    pub spares: &'a Spares,
    pub root: &'a Matrix,
    /// The right-hand side, and the unknowns that are taken off it; nothing where it holds the residuals.
    pub rhs: usize,
    pub x: Option<&'a Matrix>,
    /// Eigenvalue from which on the rest determines nothing.
    pub limit: f64,
    /// Of all rows, as in [`leave_blocks_out_of_residuals`](super::leave_blocks_out_of_residuals).
    pub weights: Option<&'a [f64]>,
}

impl<D: Design + ?Sized> Tall<'_, D> {
    /// Leaves one block out; `own` as in [`leave_blocks_out_of_residuals`](super::leave_blocks_out_of_residuals).
    pub fn left_out(&self, rows: Range<usize>, own: usize) -> Result<LeftOut, D::Error> {
        match self.sums_of(rows.clone()) {
            Some(sums) => self.left_out_by_sums(rows, &sums, own),
            None => self.left_out_by_chunks(rows, own),
        }
    }

    /// What the design itself knows of the rows, if they hold the residuals and everything is finite.
    fn sums_of(&self, rows: Range<usize>) -> Option<Sums> {
        // One weight of all rows is a factor of their sum.
        let weights = self.weights_of(&rows).filter(|weights| weights.windows(2).any(|two| two[0] != two[1]));
        let sums = self.x.is_none().then(|| self.design.sums_of(rows, weights)).flatten()?;
        let all = [Some(&sums.gram), Some(&sums.products), sums.weighted.as_ref()];
        let is_finite = all.into_iter().flatten().all(|sum| sum.first_non_finite().is_none());
        is_finite.then_some(sums)
    }

    fn left_out_by_sums(&self, rows: Range<usize>, sums: &Sums, own: usize) -> Result<LeftOut, D::Error> {
        let residual = sums.rhs.column(self.rhs).to_vec();
        let inside = dense::transposed_product(self.root, &dense::product(&sums.gram, self.root));
        let Some(without) = self.covariance_without(&inside, own)? else {
            return Ok(LeftOut::not_determined(residual));
        };
        let products = Matrix::from_column(sums.products.column(self.rhs).to_vec());
        let correction = dense::product(&without, &products);
        let Some(more) = self.design.times_of(rows.clone(), correction.as_slice()) else {
            return self.left_out_by_chunks(rows, own);
        };
        let held_out = residual.iter().zip(&more).map(|(r, more)| r + more).collect();
        // Σ w aᵀ P a is the sum of products of the entries of P and of Σ w a aᵀ.
        let (sum, factor) = match (&sums.weighted, self.weights_of(&rows)) {
            (Some(weighted), _) => (weighted, 1.0),
            (None, weights) => (&sums.gram, weights.and_then(<[f64]>::first).copied().unwrap_or(1.0)),
        };
        let variance: f64 = without.as_slice().iter().zip(sum.as_slice()).map(|(p, g)| p * g).sum();
        Ok(LeftOut {
            residual,
            held_out,
            is_determined: vec![true],
            prediction_variance: vec![factor * variance],
        })
    }

    fn weights_of(&self, rows: &Range<usize>) -> Option<&[f64]> {
        self.weights.map(|weights| &weights[rows.clone()])
    }

    fn left_out_by_chunks(&self, rows: Range<usize>, own: usize) -> Result<LeftOut, D::Error> {
        let n = self.design.n_columns();
        let (mut gram, mut products) = (Matrix::zeros(n, n), Matrix::zeros(n, 1));
        self.each_chunk(rows.clone(), |in_use, part, residual| {
            let (own_gram, own_products) =
                (dense::lower_gram(part), dense::transposed_product(part, residual));
            for (from, &to) in in_use.iter().enumerate() {
                for (&value, &row) in own_gram.column(from).iter().zip(in_use) {
                    gram[(row, to)] += value;
                }
                products[(to, 0)] += own_products[(from, 0)];
            }
        })?;
        dense::mirror_lower(&mut gram);
        let inside = dense::transposed_product(self.root, &dense::product(&gram, self.root));
        let without = self.covariance_without(&inside, own)?;
        let correction = without.as_ref().map(|without| dense::product(without, &products));
        let mut left = LeftOut { is_determined: vec![without.is_some()], ..LeftOut::default() };
        let mut variances = Vec::new();
        self.each_chunk(rows.clone(), |in_use, part, residual| {
            left.residual.extend_from_slice(residual.as_slice());
            if let (Some(without), Some(correction)) = (&without, &correction) {
                let n = in_use.len();
                let along = Matrix::from_fn(n, 1, |i, _| correction[(in_use[i], 0)]);
                let own = Matrix::from_fn(n, n, |i, j| without[(in_use[i], in_use[j])]);
                let more = dense::product(part, &along);
                left.held_out
                    .extend(residual.as_slice().iter().zip(more.as_slice()).map(|(r, more)| r + more));
                variances.extend(quadratic_forms(part, &own));
            }
        })?;
        if without.is_none() {
            return Ok(LeftOut::not_determined(left.residual));
        }
        left.prediction_variance.push(weighted_sum(&variances, self.weights_of(&rows)));
        Ok(left)
    }

    /// P, the covariance of the unknowns by the other rows, of `Fᵀ G F`; `None` where they do not determine the block.
    fn covariance_without(&self, inside: &Matrix, own: usize) -> Result<Option<Matrix>, LeastSquaresError> {
        let rank = inside.n_columns();
        if let Some(left) = Definite::complement(inside, self.limit) {
            let mut spread = self.root.transposed();
            left.whiten(&mut spread);
            return Ok(Some(dense::gram(&spread)));
        }
        let (values, vectors) = dense::symmetric_eigen(inside)?;
        if values.iter().filter(|&&value| value >= self.limit).count() > own {
            return Ok(None);
        }
        let gain = |j: usize| if values[j] < self.limit { (1.0 - values[j]).recip().sqrt() } else { 0.0 };
        let scaled = Matrix::from_fn(rank, rank, |i, j| vectors[(i, j)] * gain(j));
        Ok(Some(dense::gram(&dense::product(self.root, &scaled).transposed())))
    }

    /// Calls with the columns that a chunk of rows has, the chunk over those, and its residuals.
    fn each_chunk(
        &self,
        rows: Range<usize>,
        mut call: impl FnMut(&[usize], &Matrix, &Matrix),
    ) -> Result<(), D::Error> {
        let n = self.design.n_columns();
        let step = ROWS_AT_ONCE.next_multiple_of(self.design.n_together());
        for start in rows.clone().step_by(step) {
            let chunk = start..(start + step).min(rows.end);
            self.spares.with_block(self.design, chunk, |made| {
                check_finite(made, start)?;
                let mut in_use = columns_in_use(made);
                in_use.retain(|&column| column < n);
                let part = made.with_columns(in_use.iter().copied());
                let residual = residuals(made, n + self.rhs, self.x);
                call(&in_use, &part, &Matrix::from_column(residual));
                Ok(())
            })?;
        }
        Ok(())
    }
}

/// `aᵀ M a` for every row a.
fn quadratic_forms(rows: &Matrix, matrix: &Matrix) -> Vec<f64> {
    let product = dense::product(rows, matrix);
    let mut sums = vec![0.0; rows.n_rows()];
    for column in 0..rows.n_columns() {
        for ((sum, a), b) in sums.iter_mut().zip(rows.column(column)).zip(product.column(column)) {
            *sum += a * b;
        }
    }
    sums
}
