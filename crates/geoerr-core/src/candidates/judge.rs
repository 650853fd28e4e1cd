//! What a group of columns gains beyond the model: small dense algebra, in double precision.

use super::lanes;
use crate::least_squares::{self, Matrix};

/// Directions of which the model leaves a smaller share are the model's own: nothing can be said of them.
const OWNED: f64 = 0.002;
/// Directions of a group's columns below this share of the largest are no directions of their own.
const DEPENDENT: f64 = 1e-8;
/// Sweeps of Jacobi's method; ten leave nothing at any size that occurs.
const MOST_SWEEPS: usize = 30;
/// Columns up to which Jacobi's rotations are quicker than reduction to a tridiagonal matrix.
const MOST_ROTATED: usize = 6;

/// Numbers row after row, used again for one group after the other.
#[derive(Default)]
pub(super) struct Rows {
    values: Vec<f64>,
    width: usize,
}

impl Rows {
    fn reset(&mut self, n_rows: usize, width: usize) {
        self.width = width;
        self.values.clear();
        self.values.resize(n_rows * width, 0.0);
    }

    fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.width..(row + 1) * self.width]
    }

    pub(super) fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.values[row * self.width..(row + 1) * self.width]
    }

    /// Rows times weights, (n_rows,), added up.
    fn set_combined(&self, sum: &mut [f64], weights: &[f64]) {
        sum.fill(0.0);
        for (row, &weight) in weights.iter().enumerate() {
            lanes::add_scaled(sum, weight, self.row(row));
        }
    }
}

/// The sums of one group at one trial, k columns.
#[derive(Default)]
pub(super) struct Sums {
    /// `BᵀV⁻¹B`, k × k.
    pub information: Rows,
    /// `QᵀV^(-1/2)B`, k rows of n_basis.
    pub inside: Rows,
    /// Scores of the residual, k.
    pub score: Vec<f64>,
    /// Scores of the draws, k rows of n_draws.
    pub draws: Rows,
    /// Smallest share of a column that is more than rounding.
    pub least: f64,
}

impl Sums {
    /// Begins anew, with k columns.
    pub(super) fn reset(&mut self, k: usize, n_basis: usize, n_draws: usize, least: f64) {
        self.information.reset(k, k);
        self.inside.reset(k, n_basis);
        self.draws.reset(k, n_draws);
        self.score.clear();
        self.score.resize(k, 0.0);
        self.least = least;
    }
}

/// What a group gains at one trial.
pub(super) struct Judged {
    pub gain: f64,
    pub rank: usize,
    pub share: f64,
    /// The gain of each draw.
    pub of_draws: Vec<f64>,
}

/// Judges one trial after the other; keeps the memory of its small matrices.
#[derive(Default)]
pub(super) struct Judge {
    size: Vec<f64>,
    matrix: Vec<f64>,
    eigen: Eigen,
    /// Rows of k: combinations of columns that make the candidate's own information the unit.
    unit: Rows,
    /// `(QᵀV^(-1/2)B)ᵀ(QᵀV^(-1/2)B)`, k × k, and that times a row of `unit`.
    owned: Rows,
    owned_of_unit: Rows,
    direction: Vec<f64>,
    scores: Vec<f64>,
}

impl Judge {
    /// Judges one trial.
    pub(super) fn judge(&mut self, sums: &Sums) -> Judged {
        let m = self.set_unit(sums);
        self.set_beyond(sums, m);
        self.eigen.set(&mut self.matrix, m);
        let n_draws = sums.draws.width;
        let mut judged = Judged { gain: 0.0, rank: 0, share: 0.0, of_draws: vec![0.0; n_draws] };
        self.scores.resize(n_draws, 0.0);
        for (i, &share) in self.eigen.values.iter().enumerate() {
            if share <= OWNED.max(sums.least) {
                continue;
            }
            self.direction.clear();
            self.direction.resize(sums.score.len(), 0.0);
            for (column, &turn) in self.eigen.vector(i).iter().enumerate() {
                for (sum, &part) in self.direction.iter_mut().zip(self.unit.row(column)) {
                    *sum += turn / share.sqrt() * part;
                }
            }
            let score: f64 = self.direction.iter().zip(&sums.score).map(|(a, b)| a * b).sum();
            judged.gain += score * score;
            judged.rank += 1;
            judged.share = judged.share.max(share);
            sums.draws.set_combined(&mut self.scores, &self.direction);
            lanes::add_products(&mut judged.of_draws, &self.scores, &self.scores);
        }
        judged
    }

    /// Sets the combinations of columns that make the candidate's own information the unit; gives their number.
    fn set_unit(&mut self, sums: &Sums) -> usize {
        let k = sums.score.len();
        let of_column = |i: usize| {
            let square = sums.information.row(i)[i];
            if square > 0.0 { square.sqrt() } else { 1.0 }
        };
        self.size.clear();
        self.size.extend((0..k).map(of_column));
        self.matrix.clear();
        for i in 0..k {
            let row = sums.information.row(i).iter().zip(&self.size);
            self.matrix.extend(row.map(|(value, size)| value / (self.size[i] * size)));
        }
        self.eigen.set(&mut self.matrix, k);
        let least = DEPENDENT.max(sums.least) * k as f64;
        self.unit.reset(k, k);
        let mut m = 0;
        for (i, &value) in self.eigen.values.iter().enumerate().filter(|(_, value)| **value > least) {
            let parts = self.unit.row_mut(m).iter_mut().zip(self.eigen.vector(i)).zip(&self.size);
            for ((unit, part), size) in parts {
                *unit = part / (size * value.sqrt());
            }
            m += 1;
        }
        m
    }

    /// Sets the matrix to what the model leaves of them, m × m.
    fn set_beyond(&mut self, sums: &Sums, m: usize) {
        let k = sums.score.len();
        self.owned.reset(k, k);
        for i in 0..k {
            for j in 0..=i {
                let value = lanes::dot(sums.inside.row(i), sums.inside.row(j));
                self.owned.row_mut(i)[j] = value;
                self.owned.row_mut(j)[i] = value;
            }
        }
        self.owned_of_unit.reset(m, k);
        for i in 0..m {
            let sums = self.owned_of_unit.row_mut(i);
            for (row, &part) in self.unit.row(i).iter().enumerate() {
                sums.iter_mut().zip(self.owned.row(row)).for_each(|(sum, value)| *sum += part * value);
            }
        }
        self.matrix.clear();
        self.matrix.resize(m * m, 0.0);
        for i in 0..m {
            for j in 0..=i {
                let products = self.owned_of_unit.row(i).iter().zip(self.unit.row(j));
                let owned: f64 = products.map(|(a, b)| a * b).sum();
                let value = if i == j { 1.0 - owned } else { -owned };
                self.matrix[i * m + j] = value;
                self.matrix[j * m + i] = value;
            }
        }
    }
}

/// Eigenvalues of a symmetric matrix, and its unit eigenvectors one after the other.
#[derive(Default)]
struct Eigen {
    values: Vec<f64>,
    vectors: Vec<f64>,
}

impl Eigen {
    fn vector(&self, number: usize) -> &[f64] {
        let k = self.values.len();
        &self.vectors[number * k..(number + 1) * k]
    }

    /// Of a matrix (k × k), which is used up.
    ///
    /// Few columns by Jacobi's rotations, which keep small eigenvalues to their own precision; of more they would be most
    /// of a ranking's time.
    fn set(&mut self, matrix: &mut [f64], k: usize) {
        if k > MOST_ROTATED {
            let whole = Matrix::from_fn(k, k, |row, column| matrix[row * k + column]);
            if let Ok((values, vectors)) = least_squares::symmetric_eigen(&whole) {
                self.values = values;
                self.vectors.clear();
                (0..k).for_each(|i| self.vectors.extend_from_slice(vectors.column(i)));
                return;
            }
        }
        self.set_by_rotations(matrix, k);
    }

    /// Jacobi's method: the matrix is overwritten.
    fn set_by_rotations(&mut self, matrix: &mut [f64], k: usize) {
        self.vectors.clear();
        self.vectors.resize(k * k, 0.0);
        (0..k).for_each(|i| self.vectors[i * k + i] = 1.0);
        for _ in 0..MOST_SWEEPS {
            let mut is_done = true;
            for p in 0..k {
                for q in p + 1..k {
                    let (app, aqq, apq) = (matrix[p * k + p], matrix[q * k + q], matrix[p * k + q]);
                    if apq.abs() <= f64::EPSILON * (app.abs() * aqq.abs()).sqrt().max(f64::MIN_POSITIVE) {
                        continue;
                    }
                    is_done = false;
                    let theta = (aqq - app) / (2.0 * apq);
                    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                    let c = 1.0 / (t * t + 1.0).sqrt();
                    let s = t * c;
                    for i in 0..k {
                        let (a, b) = (matrix[i * k + p], matrix[i * k + q]);
                        matrix[i * k + p] = c * a - s * b;
                        matrix[i * k + q] = s * a + c * b;
                    }
                    for i in 0..k {
                        let (a, b) = (matrix[p * k + i], matrix[q * k + i]);
                        matrix[p * k + i] = c * a - s * b;
                        matrix[q * k + i] = s * a + c * b;
                        let (a, b) = (self.vectors[p * k + i], self.vectors[q * k + i]);
                        self.vectors[p * k + i] = c * a - s * b;
                        self.vectors[q * k + i] = s * a + c * b;
                    }
                }
            }
            if is_done {
                break;
            }
        }
        self.values.clear();
        self.values.extend((0..k).map(|i| matrix[i * k + i]));
    }
}
