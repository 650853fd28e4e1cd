//! Gradient and average information of the likelihood.
//!
//! ```math
//! \partial_i(-2\ln L) = \operatorname{tr}(P\,\partial_i V) - y^\mathsf{T} P\,\partial_i V\,P y,\qquad
//! J_{ij} = y^\mathsf{T} P\,\partial_i V\,P\,\partial_j V\,P y,\qquad P = V^{-1} - V^{-1}A H^{-1}A^\mathsf{T}V^{-1}
//! ```
//!
//! without the part of H in the trace where the likelihood is not restricted. J is half the sum of the second
//! derivatives and their expectation, where V is linear in the parameters, and never indefinite.

use rayon::prelude::*;

use super::evaluate::{Evaluated, Part};
use super::lanes::{add_scaled, dot, lower_inner, times_lower_symmetric};
use crate::least_squares::{Matrix, add_lower_outer, set_rows_times_upper};

/// Parameters of one component.
pub(super) const PARAMETERS: usize = 4;

/// By the logarithms of the parameters of the components that are used, one component after another.
pub(super) struct Slopes {
    /// First derivatives of −2 ln L.
    pub gradient: Vec<f64>,
    /// J.
    pub information: Matrix,
}

/// What one component contributes but for ln σ².
struct OfPart {
    /// By ln a², ln b², ln τ.
    gradient: [f64; 3],
    /// `(∂V P y)ᵀ V⁻¹ (∂V P y)` of two of the same three, times σ².
    information: [[f64; 3]; 3],
    /// `(P y)ᵀ ∂V P y`, times σ².
    along_residual: [f64; 3],
    /// `Aᵀ V⁻¹ ∂V P y`, (r, 3), times σ².
    along_basis: Vec<f64>,
}

/// The same of one session.
struct OfSession {
    gradient: [f64; 3],
    information: [[f64; 3]; 3],
    along_residual: [f64; 3],
    /// `∂K (I + K)⁻¹ Uᵀ e`.
    moved: [Vec<f64>; 3],
}

impl Evaluated<'_> {
    /// Gradient and average information.
    pub(super) fn slopes(&self) -> Slopes {
        let h_root_inverse = self.h.root_inverse();
        let of_parts: Vec<OfPart> =
            self.parts.par_iter().map(|part| self.of_part(part, &h_root_inverse)).collect();
        let count = PARAMETERS * self.parts.len();
        let n_basis = self.likelihood.n_basis;
        let mut gradient = vec![0.0; count];
        let mut information = Matrix::zeros(count, count);
        let mut along_basis = Matrix::zeros(n_basis, count);
        let h_inverse = self.is_restricted.then(|| {
            let mut inverse = Matrix::zeros(n_basis, n_basis);
            add_lower_outer(&mut inverse, 1.0, &h_root_inverse);
            inverse
        });
        for (place, (part, rest)) in self.parts.iter().zip(of_parts).enumerate() {
            let first = PARAMETERS * place;
            let per_variance = (-self.logs[part.component][0]).exp();
            let inside_shift = times_lower_symmetric(part.inside.as_slice(), &self.shift);
            let quadratic =
                part.square - 2.0 * dot(&part.along, &self.shift) + dot(&self.shift, &inside_shift);
            let n_numbers = self.likelihood.components[part.component].n_numbers as f64;
            gradient[first] = n_numbers - quadratic * per_variance;
            if let Some(inverse) = &h_inverse {
                let charge = lower_inner(inverse.as_slice(), part.inside.as_slice(), n_basis);
                gradient[first] -= per_variance * charge;
            }
            gradient[first + 1..first + PARAMETERS].copy_from_slice(&rest.gradient);
            information[(first, first)] = quadratic * per_variance;
            for i in 0..3 {
                let with_variance = rest.along_residual[i] * per_variance;
                information[(first, first + 1 + i)] = with_variance;
                information[(first + 1 + i, first)] = with_variance;
                for j in 0..3 {
                    information[(first + 1 + i, first + 1 + j)] = rest.information[i][j] * per_variance;
                }
                let own = &rest.along_basis[i * n_basis..(i + 1) * n_basis];
                add_scaled(along_basis.column_mut(first + 1 + i), per_variance, own);
            }
            add_scaled(along_basis.column_mut(first), per_variance, &part.along);
            add_scaled(along_basis.column_mut(first), -per_variance, &inside_shift);
        }
        self.h.whiten(&mut along_basis);
        for i in 0..count {
            for j in 0..count {
                information[(i, j)] -= dot(along_basis.column(i), along_basis.column(j));
            }
        }
        Slopes { gradient, information }
    }

    fn of_part(&self, part: &Part, h_root_inverse: &Matrix) -> OfPart {
        let n_basis = self.likelihood.n_basis;
        let charged = (self.is_restricted && n_basis > 0).then(|| {
            let mut charged = vec![0.0; part.w.as_slice().len()];
            set_rows_times_upper(&mut charged, part.w.as_slice(), h_root_inverse);
            charged
        });
        let sessions = self.likelihood.blocks.sessions();
        let found: Vec<OfSession> = (0..sessions.len())
            .into_par_iter()
            .map(|session| {
                let own = sessions[session].start * n_basis..sessions[session].end * n_basis;
                self.of_session(part, session, charged.as_ref().map(|charged| &charged[own]))
            })
            .collect();
        let mut whole = OfPart {
            gradient: [0.0; 3],
            information: [[0.0; 3]; 3],
            along_residual: [0.0; 3],
            along_basis: vec![0.0; 3 * n_basis],
        };
        for (one, session) in found.iter().zip(sessions) {
            for i in 0..3 {
                whole.gradient[i] += one.gradient[i];
                whole.along_residual[i] += one.along_residual[i];
                for j in 0..3 {
                    whole.information[i][j] += one.information[i][j];
                }
                let target = &mut whole.along_basis[i * n_basis..(i + 1) * n_basis];
                for (block, &moved) in session.clone().zip(&one.moved[i]) {
                    add_scaled(target, moved, part.w.column(block));
                }
            }
        }
        whole
    }

    fn of_session(&self, part: &Part, session: usize, charged: Option<&[f64]>) -> OfSession {
        let own = self.likelihood.blocks.sessions()[session].clone();
        let per_variance = (-self.logs[part.component][0]).exp();
        let filter = &part.filters[session];
        // (I + K)⁻¹ Uᵀ (y − A shift), and what the derivatives of K make of it.
        let q: Vec<f64> = own.map(|block| part.q[block] - dot(part.w.column(block), &self.shift)).collect();
        let moved = filter.slopes_times(&q);
        let mut solved: Vec<f64> =
            (0..q.len()).flat_map(|block| moved.each_ref().map(|one| one[block])).collect();
        filter.solve(&mut solved, 3);
        let charge =
            charged.map_or([0.0; 3], |charged| filter.slope_traces(charged, self.likelihood.n_basis));
        let along_residual = moved.each_ref().map(|moved| dot(&q, moved));
        let information = [0, 1, 2].map(|i| {
            let of =
                |j: usize| moved[i].iter().zip(solved.iter().skip(j).step_by(3)).map(|(a, b)| a * b).sum();
            [0, 1, 2].map(of)
        });
        let gradient = [0, 1, 2]
            .map(|i| filter.ln_determinant.slopes[i] - per_variance * (charge[i] + along_residual[i]));
        OfSession { gradient, information, along_residual, moved }
    }
}
