//! The triangle: `RᵀR = AᵀA` whatever the blocks, the threads and the holes.

use geoerr_core::least_squares::{Blocks, Design, LeastSquaresError, Matrix, Options, Triangle, solve};
use rayon::ThreadPoolBuilder;
use std::ops::Range;

use super::common::{by_svd, difference, largest, product, solved, to_nalgebra, triangle_of};
use crate::draws::Draws;

/// A stored system with cuts of its own.
struct Cut<'a>(&'a Matrix, &'a Matrix, Blocks);

impl Design for Cut<'_> {
    type Error = LeastSquaresError;
    fn n_rows(&self) -> usize {
        self.0.n_rows()
    }
    fn n_columns(&self) -> usize {
        self.0.n_columns()
    }
    fn n_rhs(&self) -> usize {
        self.1.n_columns()
    }
    fn fill(&self, rows: Range<usize>, block: &mut Matrix) -> Result<(), LeastSquaresError> {
        let n = self.0.n_columns();
        for column in 0..n + self.1.n_columns() {
            let source = if column < n { self.0.column(column) } else { self.1.column(column - n) };
            block.column_mut(column).copy_from_slice(&source[rows.clone()]);
        }
        Ok(())
    }
    fn blocks(&self) -> Blocks {
        self.2.clone()
    }
}

/// `‖RᵀR − AᵀA‖` relative to the columns' norms, in units of rounding: Higham 19.4 bounds it by m·n·ε, and rounding
/// seldom reaches the square root of that.
fn gram_error(triangle: &Triangle, a: &Matrix) -> f64 {
    let (r, a) = (to_nalgebra(&triangle.r()), to_nalgebra(a));
    let (rr, aa) = (r.transpose() * &r, a.transpose() * &a);
    let norm = |j: usize| if a.column(j).norm() > 0.0 { a.column(j).norm() } else { 1.0 };
    let n = a.ncols();
    let each = (0..n * n).map(|k| (rr[k] - aa[k]) / (norm(k / n) * norm(k % n)));
    largest(each) / f64::EPSILON
}

#[test]
fn r_is_that_of_the_whole_matrix() {
    let mut draws = Draws::new(1);
    for (m, n, k) in [(1, 1, 1), (3, 5, 1), (40, 7, 3), (2_000, 33, 1), (6_000, 70, 2), (1_200, 97, 1)] {
        let (a, b) = (draws.matrix(m, n), draws.matrix(m, k));
        let triangle = triangle_of(&a, &b);
        let bound = 4.0 * ((m * n) as f64).sqrt() + 8.0;
        assert!(gram_error(&triangle, &a) < bound, "{m} {n}: {}", gram_error(&triangle, &a));
        let r = triangle.r();
        assert!((0..n).all(|j| (j + 1..n).all(|i| r[(i, j)] == 0.0)));
        // With b as further columns the whole triangle is one of [A | b]: QᵀQ = I carries over to R ᵀQᵀb = Aᵀb.
        let atb = to_nalgebra(&a).transpose() * to_nalgebra(&b);
        let rtq = to_nalgebra(&r).transpose() * to_nalgebra(&triangle.qtb());
        assert!((atb - rtq).amax() < bound * f64::EPSILON * m as f64);
    }
}

#[test]
fn threads_do_not_change_a_byte() {
    let mut draws = Draws::new(2);
    let (a, b) = (draws.matrix(9_000, 60), draws.matrix(9_000, 2));
    let results: Vec<_> = [1, 2, 3, 8]
        .into_iter()
        .map(|n| {
            let pool = ThreadPoolBuilder::new().num_threads(n).build().unwrap();
            pool.install(|| {
                let triangle = triangle_of(&a, &b);
                let solution = solve(&triangle, &Options::default()).unwrap();
                (triangle, solution.x.clone(), solution.covariance())
            })
        })
        .collect();
    assert!(results.iter().all(|result| *result == results[0]));
}

#[test]
fn cuts_and_row_order_change_rounding_only() {
    let mut draws = Draws::new(3);
    let (m, n) = (1_500, 40);
    let (a, b) = (draws.matrix(m, n), draws.matrix(m, 1));
    let x = solved(&a, &b).x;
    for starts in [vec![0], vec![0, 1, 2, 700, 700, 1_499], vec![0, 10, 20, 30, 1_500, 1_500]] {
        let cut = Cut(&a, &b, Blocks::starting_at(&starts, m).unwrap());
        let other = solve(&Triangle::of(&cut).unwrap(), &Options::default()).unwrap();
        assert!(difference(x.as_slice(), other.x.as_slice()) < 1e-13, "{starts:?}");
    }
    let turned =
        |matrix: &Matrix| Matrix::from_fn(m, matrix.n_columns(), |i, j| matrix[((i * 7 + 3) % m, j)]);
    let other = solved(&turned(&a), &turned(&b)).x;
    assert!(difference(x.as_slice(), other.as_slice()) < 1e-13);
}

#[test]
fn columns_that_are_zero_in_a_block_change_nothing() {
    // As B-splines on lines: every block sees a few columns only, and some nobody sees.
    let mut draws = Draws::new(4);
    let (m, n) = (5_000, 90);
    let a = Matrix::from_fn(m, n, |i, j| {
        let seen = (i / 500) * 9;
        if (seen..seen + 12).contains(&j) && j != 50 { draws.symmetric() } else { 0.0 }
    });
    let b = draws.matrix(m, 1);
    let starts: Vec<usize> = (0..10).map(|block| block * 500).collect();
    let cut = Triangle::of(&Cut(&a, &b, Blocks::starting_at(&starts, m).unwrap())).unwrap();
    assert!(gram_error(&cut, &a) < 4.0 * ((m * n) as f64).sqrt());
    let solution = solve(&cut, &Options::default()).unwrap();
    assert_eq!(solution.rank.rank, n - 1);
    assert_eq!(
        solution.null_space.as_slice(),
        Matrix::from_fn(n, 1, |i, _| if i == 50 { 1.0 } else { 0.0 }).as_slice()
    );
    let reference = by_svd(&a, &b, 1e-12);
    assert!(difference(solution.x.as_slice(), reference.as_slice()) < 1e-13);
}

#[test]
fn appended_and_merged_rows_are_rows() {
    let mut draws = Draws::new(5);
    let (a, b) = (draws.matrix(300, 20), draws.matrix(300, 2));
    let part = |matrix: &Matrix, rows: Range<usize>| {
        Matrix::from_fn(rows.len(), matrix.n_columns(), |i, j| matrix[(rows.start + i, j)])
    };
    let whole = solved(&a, &b);
    let mut appended = triangle_of(&part(&a, 0..200), &part(&b, 0..200));
    let rest = triangle_of(&part(&a, 200..300), &part(&b, 200..300));
    let merged = appended.clone().merged(rest).unwrap();
    let rows = Matrix::from_fn(100, 22, |i, j| if j < 20 { a[(200 + i, j)] } else { b[(200 + i, j - 20)] });
    appended.append(&rows).unwrap();
    for triangle in [appended, merged] {
        assert_eq!(triangle.n_rows(), 300);
        let solution = solve(&triangle, &Options::default()).unwrap();
        assert!(difference(whole.x.as_slice(), solution.x.as_slice()) < 1e-14);
        assert!(difference(&whole.residual_ss, &solution.residual_ss) < 1e-12);
    }
}

#[test]
fn residuals_sum_as_written_and_meet_no_column() {
    let mut draws = Draws::new(6);
    let (a, b) = (draws.matrix(700, 30), draws.matrix(700, 3));
    let solution = solved(&a, &b);
    let fitted = product(&a, &solution.x);
    let residual = to_nalgebra(&b) - to_nalgebra(&fitted);
    for rhs in 0..3 {
        let sum = residual.column(rhs).norm_squared();
        assert!((solution.residual_ss[rhs] / sum - 1.0).abs() < 1e-13);
    }
    assert!((to_nalgebra(&a).transpose() * residual).amax() < 1e-12);
    assert_eq!(solution.degrees_of_freedom, 670);
}

#[test]
fn what_is_not_finite_is_named() {
    let mut draws = Draws::new(7);
    let (mut a, b) = (draws.matrix(2_000, 5), draws.matrix(2_000, 1));
    a[(1_777, 3)] = f64::NAN;
    a[(1_999, 0)] = f64::INFINITY;
    let refused = Triangle::of(&geoerr_core::least_squares::StoredDesign::new(&a, &b).unwrap());
    assert_eq!(refused, Err(LeastSquaresError::NonFinite { row: 1_777, column: 3 }));
}
