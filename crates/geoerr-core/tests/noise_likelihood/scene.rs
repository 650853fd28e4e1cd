//! Rows, blocks and columns to try, and the covariance written out.

use geoerr_core::noise_likelihood::{Blocks, Likelihood, Logs};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

use crate::draws::Draws;

/// Rows of a few sessions; passes whose blocks lie between those of other passes, blocks at the same time, numbers that
/// were not measured.
#[derive(Clone, Debug)]
pub struct Scene {
    pub of_row: Vec<usize>,
    pub session_starts: Vec<usize>,
    pub pass_number: Vec<i64>,
    pub time: Vec<f64>,
    pub weights: Vec<[f64; 3]>,
    pub residual: Vec<[f64; 3]>,
    pub basis: Vec<f64>,
    pub n_basis: usize,
}

impl Scene {
    pub fn new(seed: u64, n_rows: usize, sessions: &[usize], n_basis: usize) -> Self {
        let mut draws = Draws::new(seed);
        let n_blocks: usize = sessions.iter().sum();
        let session_starts: Vec<usize> =
            sessions.iter().scan(0, |sum, n| Some(std::mem::replace(sum, *sum + n))).collect();
        let (mut pass_number, mut time) = (Vec::new(), Vec::new());
        for (session, &count) in sessions.iter().enumerate() {
            let mut own: Vec<f64> = (0..count).map(|_| (16.0 * draws.fraction()).round() / 16.0).collect();
            own.sort_by(f64::total_cmp);
            time.extend(own);
            pass_number.extend((0..count).map(|_| (10 * session + draws.below(1 + count / 2)) as i64));
        }
        let of_row = (0..n_rows).map(|_| draws.below(n_blocks)).collect();
        let weights: Vec<[f64; 3]> = (0..n_rows)
            .map(|_| {
                [0, 1, 2].map(|_| if draws.symmetric() > 0.7 { 0.0 } else { 1.0 + 0.3 * draws.symmetric() })
            })
            .collect();
        let counted = |value: f64, weight: f64| if weight > 0.0 { value } else { 0.0 };
        let residual = weights
            .iter()
            .map(|weight| weight.map(|weight| counted(1.5 * draws.symmetric(), weight)))
            .collect();
        let basis = (weights.iter().flatten())
            .flat_map(|&weight| (0..n_basis).map(|_| counted(draws.symmetric(), weight)).collect::<Vec<_>>())
            .collect();
        Self { of_row, session_starts, pass_number, time, weights, residual, basis, n_basis }
    }

    pub fn blocks(&self) -> Blocks {
        let (passes, time) = (self.pass_number.clone(), self.time.clone());
        Blocks::new(self.of_row.clone(), &self.session_starts, passes, time).unwrap()
    }

    pub fn likelihood(&self) -> Likelihood {
        Likelihood::new(self.blocks(), &self.weights, &self.residual, &self.basis, self.n_basis).unwrap()
    }

    fn session(&self, block: usize) -> usize {
        self.session_starts.partition_point(|&start| start <= block)
    }

    /// V of a component, written out; rows that were not measured have variance σ² and nothing in common.
    pub fn covariance(&self, c: usize, logs: Logs) -> DMatrix<f64> {
        let [variance, offset2, drift2, memory] = logs.map(f64::exp);
        let n = self.of_row.len();
        DMatrix::from_fn(n, n, |i, j| {
            let (a, b) = (self.of_row[i], self.of_row[j]);
            let offset = if self.pass_number[a] == self.pass_number[b] { offset2 } else { 0.0 };
            let together = self.session(a) == self.session(b);
            let drift = drift2 * (-(self.time[a] - self.time[b]).abs() / memory).exp();
            let shared = offset + if together { drift } else { 0.0 };
            let own = if i == j { 1.0 } else { 0.0 };
            variance * (own + self.weights[i][c] * self.weights[j][c] * shared)
        })
    }

    /// Columns of the basis of a component.
    pub fn columns(&self, c: usize) -> DMatrix<f64> {
        DMatrix::from_fn(self.of_row.len(), self.n_basis, |row, j| {
            self.basis[(3 * row + c) * self.n_basis + j]
        })
    }

    /// −2 ln L by dense matrices, constants left out as the core leaves them out.
    pub fn dense(&self, logs: &[Logs; 3], is_restricted: bool) -> f64 {
        let r = self.n_basis;
        let (mut h, mut pull, mut value) = (DMatrix::zeros(r, r), DVector::zeros(r), 0.0);
        for (c, &logs) in logs.iter().enumerate() {
            let counts: Vec<usize> =
                (0..self.of_row.len()).filter(|&row| self.weights[row][c] > 0.0).collect();
            let v = self.covariance(c, logs).select_rows(&counts).select_columns(&counts);
            let a = self.columns(c).select_rows(&counts);
            let y = DVector::from_iterator(counts.len(), counts.iter().map(|&row| self.residual[row][c]));
            let root = v.cholesky().unwrap();
            value += 2.0 * root.l().diagonal().map(f64::ln).sum();
            h += a.transpose() * root.solve(&a);
            pull += a.transpose() * root.solve(&y);
            value += y.dot(&root.solve(&y));
        }
        let root = h.cholesky().unwrap();
        value -= pull.dot(&root.solve(&pull));
        value + if is_restricted { 2.0 * root.l().diagonal().map(f64::ln).sum() } else { 0.0 }
    }
}

pub fn scenes() -> impl Strategy<Value = Scene> {
    (any::<u64>(), 60_usize..140, prop::collection::vec(1_usize..9, 1..4), 1_usize..7)
        .prop_map(|(seed, n_rows, sessions, n_basis)| Scene::new(seed, n_rows, &sessions, n_basis))
}

pub fn parameters() -> impl Strategy<Value = [Logs; 3]> {
    let one =
        (-1.5_f64..1.5, -6.0_f64..3.0, -6.0_f64..3.0, -2.5_f64..0.7).prop_map(|(s, a, b, t)| [s, a, b, t]);
    [one.clone(), one.clone(), one]
}
