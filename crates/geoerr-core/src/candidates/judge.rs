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
    fn zeros(n_rows: usize, width: usize) -> Self {
        Self { values: vec![0.0; n_rows * width], width }
    }

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

/// Judges one trial.
pub(super) fn judge(sums: &Sums) -> Judged {
    let k = sums.score.len();
    let n_draws = sums.draws.width;
    let size: Vec<f64> = (0..k)
        .map(|i| {
            let square = sums.information.row(i)[i];
            if square > 0.0 { square.sqrt() } else { 1.0 }
        })
        .collect();
    let mut cosines: Vec<f64> =
        (0..k * k).map(|at| sums.information.values[at] / (size[at / k] * size[at % k])).collect();
    let (values, vectors) = symmetric_eigen(&mut cosines, k);
    // Columns that make the candidate's own information the unit.
    let unit: Vec<Vec<f64>> = (values.iter().zip(&vectors))
        .filter(|&(&value, _)| value > DEPENDENT.max(sums.least) * k as f64)
        .map(|(&value, vector)| (0..k).map(|i| vector[i] / (size[i] * value.sqrt())).collect())
        .collect();
    let m = unit.len();
    let mut inside = Rows::zeros(m, sums.inside.width);
    for (i, direction) in unit.iter().enumerate() {
        sums.inside.set_combined(inside.row_mut(i), direction);
    }
    let mut beyond = vec![0.0; m * m];
    for i in 0..m {
        for j in 0..=i {
            let owned = lanes::dot(inside.row(i), inside.row(j));
            let value = if i == j { 1.0 - owned } else { -owned };
            beyond[i * m + j] = value;
            beyond[j * m + i] = value;
        }
    }
    let (shares, turns) = symmetric_eigen(&mut beyond, m);
    let mut judged = Judged { gain: 0.0, rank: 0, share: 0.0, of_draws: vec![0.0; n_draws] };
    let mut scores = vec![0.0; n_draws];
    for (&share, turn) in shares.iter().zip(&turns) {
        if share <= OWNED.max(sums.least) {
            continue;
        }
        let direction: Vec<f64> = (0..k)
            .map(|i| unit.iter().zip(turn).map(|(column, &t)| column[i] * t).sum::<f64>() / share.sqrt())
            .collect();
        let score: f64 = direction.iter().zip(&sums.score).map(|(a, b)| a * b).sum();
        judged.gain += score * score;
        judged.rank += 1;
        judged.share = judged.share.max(share);
        sums.draws.set_combined(&mut scores, &direction);
        lanes::add_products(&mut judged.of_draws, &scores, &scores);
    }
    judged
}

/// Eigenvalues and unit eigenvectors of a symmetric matrix (k × k), which is used up.
///
/// Few columns by Jacobi's rotations, which keep small eigenvalues to their own precision; of more they would be most of
/// a ranking's time.
fn symmetric_eigen(matrix: &mut [f64], k: usize) -> (Vec<f64>, Vec<Vec<f64>>) {
    if k > MOST_ROTATED {
        let whole = Matrix::from_fn(k, k, |row, column| matrix[row * k + column]);
        if let Ok((values, vectors)) = least_squares::symmetric_eigen(&whole) {
            return (values, (0..k).map(|i| vectors.column(i).to_vec()).collect());
        }
    }
    by_rotations(matrix, k)
}

/// Jacobi's method: the matrix is overwritten.
fn by_rotations(matrix: &mut [f64], k: usize) -> (Vec<f64>, Vec<Vec<f64>>) {
    let mut vectors: Vec<Vec<f64>> =
        (0..k).map(|i| (0..k).map(|j| if i == j { 1.0 } else { 0.0 }).collect()).collect();
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
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
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
                }
                let (before, from) = vectors.split_at_mut(q);
                for (a, b) in before[p].iter_mut().zip(&mut from[0]) {
                    (*a, *b) = (c * *a - s * *b, s * *a + c * *b);
                }
            }
        }
        if is_done {
            break;
        }
    }
    ((0..k).map(|i| matrix[i * k + i]).collect(), vectors)
}
