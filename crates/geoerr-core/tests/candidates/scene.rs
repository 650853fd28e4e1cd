//! A scene that is drawn: rows, channels, noise with blocks, and what a model is free to do.

use geoerr_core::candidates::{Directions, Noise, Scene, Whitened};
use geoerr_core::least_squares::Real;
use nalgebra::{DMatrix, DVector};

use crate::draws::Draws;

pub struct Drawn {
    pub n_rows: usize,
    pub directions: Vec<[Vec<f64>; 3]>,
    /// Orthonormal, (3 n × r), the components of a row one after the other.
    pub basis: DMatrix<f64>,
    pub residual: DVector<f64>,
    pub draws: DMatrix<f64>,
    pub noise: Noise,
    /// `V^(-1/2)`, (3 n × 3 n).
    pub whitening: DMatrix<f64>,
}

impl Drawn {
    pub fn new(seed: u64, n_rows: usize, n_basis: usize, n_draws: usize, n_channels: usize) -> Self {
        let mut draws = Draws::new(seed);
        let n_blocks = 6;
        let block: Vec<usize> = (0..n_rows).map(|row| row * n_blocks / n_rows).collect();
        let unit = [0, 1, 2].map(|_| {
            let mut own = draws.column(n_rows);
            for b in 0..n_blocks {
                let length =
                    (0..n_rows).filter(|&i| block[i] == b).map(|i| own[i].powi(2)).sum::<f64>().sqrt();
                (0..n_rows).filter(|&i| block[i] == b).for_each(|i| own[i] /= length);
            }
            own
        });
        let sessions = vec![0..2, 2..6];
        let less_one = [0, 1, 2].map(|_| {
            (sessions.iter())
                .map(|session: &std::ops::Range<usize>| {
                    // Column after column of a lower triangle.
                    let n = session.len();
                    (0..n * n)
                        .map(|at| if at % n >= at / n { 0.4 * draws.symmetric() } else { 0.0 })
                        .collect()
                })
                .collect::<Vec<Vec<f64>>>()
        });
        let noise = Noise { sigma: [0.8, 1.0, 1.3], block, n_blocks, unit, sessions, less_one };
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
        let whitening = whitening(&noise, n_rows);
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
        Scene::new(self.n_rows, &directions, whitened, self.noise.clone()).unwrap()
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

fn whitening(noise: &Noise, n_rows: usize) -> DMatrix<f64> {
    let mut whole = DMatrix::zeros(3 * n_rows, 3 * n_rows);
    for c in 0..3 {
        let mut unit = DMatrix::zeros(n_rows, noise.n_blocks);
        for (i, &b) in noise.block.iter().enumerate() {
            unit[(i, b)] = noise.unit[c][i];
        }
        let mut less_one = DMatrix::zeros(noise.n_blocks, noise.n_blocks);
        for (session, values) in noise.sessions.iter().zip(&noise.less_one[c]) {
            let n = session.len();
            let own = DMatrix::from_column_slice(n, n, values);
            less_one.view_mut((session.start, session.start), (n, n)).copy_from(&own);
        }
        let own = (DMatrix::identity(n_rows, n_rows) + &unit * less_one * unit.transpose()) / noise.sigma[c];
        for i in 0..n_rows {
            for j in 0..n_rows {
                whole[(3 * i + c, 3 * j + c)] = own[(i, j)];
            }
        }
    }
    whole
}
