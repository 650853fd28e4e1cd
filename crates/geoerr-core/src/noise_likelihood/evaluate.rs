//! The value of the likelihood, and what its derivatives can use of the way there.

use rayon::prelude::*;

use super::dual::Dual;
use super::error::NoiseError;
use super::filter::Filter;
use super::lanes::{add_scaled, dot};
use super::sums::{Likelihood, Logs};
use crate::least_squares::{Definite, Matrix, add_lower_product};

/// Added to H, relative to its mean eigenvalue: columns that repeat others are nothing worse than that.
const RIDGE: f64 = 1e-12;

/// The likelihood at one set of parameters.
pub(super) struct Evaluated<'a> {
    pub likelihood: &'a Likelihood,
    pub logs: &'a [Logs],
    pub is_restricted: bool,
    /// −2 ln L, but for a constant.
    pub value: f64,
    /// Of each component that is used.
    pub parts: Vec<Part>,
    /// H.
    pub h: Definite,
    /// Coefficients of the basis by generalised least squares.
    pub shift: Vec<f64>,
}

/// One component.
pub(super) struct Part {
    /// Its number.
    pub component: usize,
    /// `I + K` by session.
    pub filters: Vec<Filter<Dual>>,
    /// `Aᵀ U (I + K)⁻¹`, (r, n_blocks).
    pub w: Matrix,
    /// `(I + K)⁻¹ Uᵀ y`.
    pub q: Vec<f64>,
    /// `σ² Aᵀ V⁻¹ A`, the lower triangle.
    pub inside: Matrix,
    /// `σ² Aᵀ V⁻¹ y`.
    pub along: Vec<f64>,
    /// `σ² yᵀ V⁻¹ y`.
    pub square: f64,
}

impl Likelihood {
    /// Evaluates at the parameters of all three components; those of components without a number are not looked at.
    pub(super) fn evaluate<'a>(
        &'a self,
        logs: &'a [Logs],
        is_restricted: bool,
    ) -> Result<Evaluated<'a>, NoiseError> {
        let parts = self.parts(logs)?;
        let mut h = self.h(&parts, logs);
        let mut pull = vec![0.0; self.n_basis];
        let mut value = 0.0;
        for part in &parts {
            let ln_variance = logs[part.component][0];
            let per_variance = (-ln_variance).exp();
            add_scaled(&mut pull, per_variance, &part.along);
            value += self.components[part.component].n_numbers as f64 * ln_variance;
            value += part.filters.iter().map(|filter| filter.ln_determinant.value).sum::<f64>();
            value += part.square * per_variance;
        }
        let trace: f64 = (0..self.n_basis).map(|j| h[(j, j)]).sum();
        for j in 0..self.n_basis {
            h[(j, j)] += RIDGE * trace / self.n_basis as f64;
        }
        let h = Definite::of(h).ok_or(NoiseError::NotDefinite { component: 3 })?;
        let mut shift = Matrix::from_column(pull.clone());
        h.solve(&mut shift);
        let shift = shift.into_values();
        value -= dot(&pull, &shift);
        if is_restricted {
            value += h.ln_determinant();
        }
        if !value.is_finite() {
            return Err(NoiseError::NotDefinite { component: 3 });
        }
        Ok(Evaluated { likelihood: self, logs, is_restricted, value, parts, h, shift })
    }

    /// What each component that is used contributes.
    pub(super) fn parts(&self, logs: &[Logs]) -> Result<Vec<Part>, NoiseError> {
        let used: Vec<usize> = (0..3).filter(|&c| self.components[c].is_used()).collect();
        used.par_iter().map(|&c| self.part(c, logs[c])).collect()
    }

    /// H, the lower triangle.
    pub(super) fn h(&self, parts: &[Part], logs: &[Logs]) -> Matrix {
        let mut h = Matrix::zeros(self.n_basis, self.n_basis);
        for part in parts {
            add_scaled(h.as_mut_slice(), (-logs[part.component][0]).exp(), part.inside.as_slice());
        }
        h
    }

    fn part(&self, c: usize, logs: Logs) -> Result<Part, NoiseError> {
        let component = &self.components[c];
        let (mut w, mut q) = (component.basis_sums.clone(), component.sums.clone());
        let tasks: Vec<_> = (self.by_session(w.as_mut_slice(), self.n_basis).into_iter())
            .zip(self.by_session(&mut q, 1))
            .enumerate()
            .collect();
        let filters = (tasks.into_par_iter())
            .map(|(session, (w, q))| {
                let filter = self.blocks.filter(session, &component.reach, logs)?;
                filter.solve(w, self.n_basis);
                filter.solve(q, 1);
                Some(filter)
            })
            .collect::<Option<Vec<_>>>()
            .ok_or(NoiseError::NotDefinite { component: c })?;
        let (mut inside, mut along) = (component.inside.clone(), component.pull.clone());
        add_lower_product(&mut inside, &w, &component.basis_sums);
        for (block, &sum) in component.sums.iter().enumerate() {
            add_scaled(&mut along, sum, w.column(block));
        }
        let square = component.square + dot(&q, &component.sums);
        Ok(Part { component: c, filters, w, q, inside, along, square })
    }

    /// Numbers of blocks, `width` of each, cut into sessions.
    pub(super) fn by_session<'v>(&self, mut values: &'v mut [f64], width: usize) -> Vec<&'v mut [f64]> {
        let mut pieces = Vec::new();
        for session in self.blocks.sessions() {
            let (own, rest) = values.split_at_mut(width * session.len());
            pieces.push(own);
            values = rest;
        }
        pieces
    }
}
