//! A scene that is drawn: rows, channels, noise with blocks, and what a model is free to do.

use geoerr_core::candidates::{Directions, Scene, Whitened};
use geoerr_core::least_squares::Real;
use geoerr_core::noise_likelihood::{Blocks, Whitening};
use nalgebra::{DMatrix, DVector};

use crate::draws::Draws;

pub struct Drawn {
    pub n_rows: usize,
    pub directions: Vec<[Vec<f64>; 3]>,
    /// Orthonormal, (3 n × r), the components of a row one after the other.
    pub basis: DMatrix<f64>,
    pub residual: DVector<f64>,
    pub draws: DMatrix<f64>,
    pub noise: Whitening,
    /// `V^(-1/2)`, (3 n × 3 n), written out.
    pub whitening: DMatrix<f64>,
}

impl Drawn {
    pub fn new(seed: u64, n_rows: usize, n_basis: usize, n_draws: usize, n_channels: usize) -> Self {
        let mut draws = Draws::new(seed);
        // Two sessions, the second with a pass of two blocks and another around one of them.
        let (n_blocks, n_first) = (6, 2);
        let block: Vec<usize> = (0..n_rows).map(|row| row * n_blocks / n_rows).collect();
        let passes = vec![0, 1, 2, 3, 3, 2];
        let time = vec![0.0, 0.7, 0.0, 0.2, 0.5, 0.9];
        let blocks = Blocks::new(block.clone(), &[0, n_first], passes.clone(), time.clone()).unwrap();
        let weights: Vec<[f64; 3]> =
            (0..n_rows).map(|_| [0, 1, 2].map(|_| 1.0 + 0.5 * draws.symmetric())).collect();
        let logs = [0.8_f64, 1.0, 1.3].map(|sigma| {
            [2.0 * sigma.ln(), -1.0 + draws.symmetric(), -1.0 + draws.symmetric(), -0.5 + draws.symmetric()]
        });
        let noise = blocks.whitening(&weights, &logs).unwrap();
        let directions = (0..n_channels)
            .map(|channel| {
                [0, 1, 2].map(|c| {
                    if channel % 3 == c || channel % 2 == 0 {
                        draws.column(n_rows)
                    } else {
                        vec![0.0; n_rows]
                    }
                })
            })
            .collect();
        let mut matrix = |columns: usize| DMatrix::from_fn(3 * n_rows, columns, |_, _| draws.symmetric());
        let basis = matrix(n_basis).qr().q();
        let mut others = matrix(1 + n_draws);
        others -= &basis * (basis.transpose() * &others);
        // By component, in the order of rows and blocks: `σ⁻¹ (I + U (T − I) Uᵀ)`, T the inverse Cholesky factor of I + K.
        let mut whitening = DMatrix::zeros(3 * n_rows, 3 * n_rows);
        for c in 0..3 {
            let [variance, offset2, drift2, memory] = logs[c].map(f64::exp);
            let mut unit = DMatrix::zeros(n_rows, n_blocks);
            block.iter().enumerate().for_each(|(row, &b)| unit[(row, b)] = weights[row][c]);
            let reach: Vec<f64> = unit.column_iter().map(|column| column.norm()).collect();
            unit.column_iter_mut().zip(&reach).for_each(|(mut column, reach)| column /= *reach);
            let k = DMatrix::from_fn(n_blocks, n_blocks, |a, b| {
                let offset = if passes[a] == passes[b] { offset2 } else { 0.0 };
                let together = (a < n_first) == (b < n_first);
                let drift = if together { drift2 * (-(time[a] - time[b]).abs() / memory).exp() } else { 0.0 };
                reach[a] * reach[b] * (offset + drift)
            });
            let ones = DMatrix::identity(n_blocks, n_blocks);
            let t = (&ones + k).cholesky().unwrap().l().try_inverse().unwrap();
            let own =
                (DMatrix::identity(n_rows, n_rows) + &unit * (t - ones) * unit.transpose()) / variance.sqrt();
            for i in 0..n_rows {
                for j in 0..n_rows {
                    whitening[(3 * i + c, 3 * j + c)] = own[(i, j)];
                }
            }
        }
        Self {
            n_rows,
            directions,
            basis,
            residual: others.column(0).into(),
            draws: others.columns(1, n_draws).into(),
            noise,
            whitening,
        }
    }

    pub fn scene<T: Real>(&self) -> Scene<T> {
        // The transpose, column after column, has the numbers of a row one after the other.
        let basis = self.basis.transpose();
        let draws: Vec<T> = self.draws.transpose().iter().map(|&value| T::nearest(value)).collect();
        let whitened =
            Whitened { basis: basis.as_slice(), residual: self.residual.as_slice(), draws: &draws };
        let directions: Vec<Directions<'_>> =
            self.directions.iter().map(|own| own.each_ref().map(Vec::as_slice)).collect();
        Scene::new(&directions, whitened, self.noise.clone()).unwrap()
    }

    /// Fall of the sum of squares of the residual and of every draw, by least squares written out, and the rank.
    pub fn judged(&self, columns: &DMatrix<f64>) -> (f64, Vec<f64>, usize) {
        let whitened = &self.whitening * columns;
        let beyond = &whitened - &self.basis * (self.basis.transpose() * &whitened);
        let svd = beyond.svd(true, false);
        let largest = svd.singular_values.max();
        let u = svd.u.unwrap();
        let kept: Vec<usize> = (0..u.ncols()).filter(|&k| svd.singular_values[k] > 1e-6 * largest).collect();
        let u = u.select_columns(&kept);
        let gain = (u.transpose() * &self.residual).norm_squared();
        let of_draws =
            (u.transpose() * &self.draws).column_iter().map(|column| column.norm_squared()).collect();
        (gain, of_draws, kept.len())
    }

    /// Columns `Σ factor · d ∘ f`, (3 n × k), of (channel, factor, coefficient) and functions.
    pub fn columns(&self, parts: &[(usize, f64, usize)], functions: &[Vec<f64>], k: usize) -> DMatrix<f64> {
        let mut columns = DMatrix::zeros(3 * self.n_rows, k);
        for (&(channel, factor, coefficient), function) in parts.iter().zip(functions) {
            for (i, &value) in function.iter().enumerate() {
                for c in 0..3 {
                    columns[(3 * i + c, coefficient)] += factor * self.directions[channel][c][i] * value;
                }
            }
        }
        columns
    }
}
