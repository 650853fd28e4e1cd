//! A triangle from the Gram matrix: what it tells is what QR tells, and it is not used where it could not.

use geoerr_core::least_squares::{
    LeastSquaresError, Matrix, Options, Restriction, Solution, StoredDesign, Triangle, design_fn, solve,
};
use nalgebra::DMatrix;
use rayon::ThreadPoolBuilder;

use super::common::{difference, largest, product, to_nalgebra};
use crate::draws::Draws;

const TOLERANCE: f64 = 1e-5;

fn by_rank(a: &Matrix, tolerance: f64) -> Result<Triangle, LeastSquaresError> {
    Triangle::for_rank(&StoredDesign::new(a, &Matrix::zeros(a.n_rows(), 0))?, tolerance)
}

fn by_qr(a: &Matrix) -> Result<Triangle, LeastSquaresError> {
    Triangle::of(&StoredDesign::new(a, &Matrix::zeros(a.n_rows(), 0))?)
}

fn both(a: &Matrix) -> [Solution; 2] {
    let options = Options { rank_tolerance: Some(TOLERANCE), ..Options::default() };
    let quick = by_rank(a, TOLERANCE).unwrap();
    let qr = by_qr(a).unwrap();
    [quick, qr].map(|triangle| solve(&triangle, &options).unwrap())
}

fn is_quick(a: &Matrix) -> bool {
    by_rank(a, TOLERANCE).unwrap() != by_qr(a).unwrap()
}

/// Columns with these singular values, turned at random.
fn with_singular_values(draws: &mut Draws, m: usize, values: &[f64]) -> Matrix {
    let n = values.len();
    let orthonormal = |matrix: &Matrix| to_nalgebra(matrix).qr().q();
    let (u, v) = (orthonormal(&draws.matrix(m, n)), orthonormal(&draws.matrix(n, n)));
    let a = u * DMatrix::from_fn(n, n, |i, j| if i == j { values[i] } else { 0.0 }) * v;
    Matrix::from_columns(m, n, a.as_slice().to_vec()).unwrap()
}

/// The projector on what is not determined, in units in which columns have length 1.
fn not_determined(a: &Matrix, solution: &Solution) -> DMatrix<f64> {
    let lengths: Vec<f64> = (0..a.n_columns()).map(|j| to_nalgebra(a).column(j).norm()).collect();
    let mut null = to_nalgebra(&solution.null_space);
    for (mut row, length) in null.row_iter_mut().zip(&lengths) {
        row *= *length;
    }
    let basis = null.qr().q();
    &basis * basis.transpose()
}

#[test]
fn rank_covariance_steps_and_null_space_are_those_of_qr() {
    let mut draws = Draws::new(11);
    // κ²ε at the limit of 3·10⁴ is 2·10⁻⁷, a null vector turned by it once more is right to rounding.
    for (smallest, lost) in [(1.0, 0.0), (1e-2, 0.0), (1e-2, 1e-9), (3e-4, 0.0), (3e-4, 3e-7), (3e-4, 0.0)] {
        let values = [1.0, 0.8, 0.3, 0.1, 0.1, smallest, lost, lost];
        let a = with_singular_values(&mut draws, 2500, &values);
        assert!(is_quick(&a), "{smallest:e} {lost:e}");
        let [quick, qr] = both(&a);
        assert_eq!((quick.rank.rank, qr.rank.rank), (6, 6));
        assert_eq!(quick.is_determined, qr.is_determined);
        let covariances = [&quick, &qr].map(|one| {
            let root = to_nalgebra(&one.covariance_root());
            &root * root.transpose()
        });
        let relative = (&covariances[0] - &covariances[1]).norm() / covariances[1].norm();
        assert!(
            relative < 1e-6 * (1e-4 / smallest).powi(2).max(1e-3),
            "{smallest:e} {lost:e}: {relative:.1e}"
        );
        let gradient = product(&a.transposed(), &draws.matrix(2500, 1));
        let steps = [&quick, &qr].map(|one| one.solve_normal(gradient.as_slice()).unwrap());
        let size = largest(steps[1].iter().copied());
        assert!(difference(&steps[0], &steps[1]) < 1e-6 * size, "{smallest:e} {lost:e}");
        let null = [&quick, &qr].map(|one| not_determined(&a, one));
        let turned = (&null[0] - &null[1]).norm();
        assert!(turned < 1e-9, "{smallest:e} {lost:e}: {turned:.1e}");
        // Where something is lost, its size is known as well as to QR.
        if lost > 0.0 {
            assert!((quick.rank.gap / qr.rank.gap - 1.0).abs() < 1e-3, "{} {}", quick.rank.gap, qr.rank.gap);
        }
    }
}

#[test]
fn what_is_neither_seen_nor_lost_goes_to_qr() {
    let mut draws = Draws::new(12);
    for between in [2e-6, 1e-5, 2e-5] {
        let a = with_singular_values(&mut draws, 900, &[1.0, 0.5, 0.2, between]);
        assert!(!is_quick(&a), "{between:e}");
    }
    // A tolerance below what a Gram matrix tells, and columns whose squares are no numbers.
    let a = with_singular_values(&mut draws, 900, &[1.0, 0.5, 0.0]);
    assert_eq!(by_rank(&a, 1e-8).unwrap(), by_qr(&a).unwrap());
    let sizes = [1e200, 1.0, 1e-200];
    let a = Matrix::from_fn(600, 3, |_, j| draws.symmetric() * sizes[j]);
    assert!(!is_quick(&a));
    let nothing = Matrix::from_fn(600, 3, |_, j| if j == 1 { 0.0 } else { draws.symmetric() });
    let [quick, _] = both(&nothing);
    assert_eq!((quick.rank.rank, quick.is_determined), (2, vec![true, false, true]));
}

/// Solutions in a restriction that fixes all that is free, and more: with rows that hold it, and by QR without.
#[test]
fn what_constraints_fix_needs_no_eigenvectors() {
    let mut draws = Draws::new(16);
    let a = with_singular_values(&mut draws, 2500, &[1.0, 0.8, 0.3, 0.1, 1e-2, 0.0, 0.0]);
    let nothing = Matrix::zeros(a.n_rows(), 0);
    let design = StoredDesign::new(&a, &nothing).unwrap();
    // Further ones restrict what is seen; of a single one something stays free, and it is found as without.
    for (n_constraints, rank) in [(2, 5), (4, 3), (1, 5)] {
        let constraints = draws.matrix(n_constraints, 7);
        let options = Options {
            rank_tolerance: Some(TOLERANCE),
            restriction: Restriction::Constraints(constraints.clone()),
            ..Options::default()
        };
        let within = Triangle::for_rank_within(&design, TOLERANCE, &constraints).unwrap();
        let is_definite = n_constraints > 1;
        assert_eq!(within != by_rank(&a, TOLERANCE).unwrap(), is_definite);
        let prior = draws.matrix(2, 7);
        for appended in [false, true] {
            let [quick, qr] = [within.clone(), by_qr(&a).unwrap()].map(|mut triangle| {
                if appended {
                    triangle.append(&prior).unwrap();
                }
                solve(&triangle, &options).unwrap()
            });
            assert_eq!(quick.rank.rank, qr.rank.rank);
            assert!(appended || quick.rank.rank == rank);
            // Estimates by a few steps each, from elsewhere.
            assert!(
                (quick.condition / qr.condition - 1.0).abs() < 0.1,
                "{} {}",
                quick.condition,
                qr.condition
            );
            let gradient = product(&a.transposed(), &draws.matrix(2500, 1));
            let steps = [&quick, &qr].map(|one| one.solve_normal(gradient.as_slice()).unwrap());
            assert!(difference(&steps[0], &steps[1]) < 1e-9 * largest(steps[1].iter().copied()));
            let covariances = [&quick, &qr].map(|one| {
                let root = to_nalgebra(&one.covariance_root());
                &root * root.transpose()
            });
            assert!((&covariances[0] - &covariances[1]).norm() < 1e-9 * covariances[1].norm());
        }
    }
    let refused = Triangle::for_rank_within(&design, TOLERANCE, &Matrix::zeros(1, 6));
    assert_eq!(refused, Err(LeastSquaresError::ColumnsDiffer { expected: 7, found: 6 }));
}

#[test]
fn rows_may_be_appended() {
    let mut draws = Draws::new(13);
    let a = with_singular_values(&mut draws, 800, &[1.0, 0.5, 0.2, 0.0]);
    let prior = draws.matrix(3, 4);
    let options = Options { rank_tolerance: Some(TOLERANCE), ..Options::default() };
    let roots = [by_rank(&a, TOLERANCE), by_qr(&a)].map(|triangle| {
        let mut triangle = triangle.unwrap();
        triangle.append(&prior).unwrap();
        let solution = solve(&triangle, &options).unwrap();
        assert_eq!(solution.rank.rank, 4);
        solution.covariance()
    });
    let size = largest(roots[1].as_slice().iter().copied());
    assert!(difference(roots[0].as_slice(), roots[1].as_slice()) < 1e-10 * size);
}

#[test]
fn a_bad_entry_is_named() {
    let mut a = Draws::new(14).matrix(2000, 3);
    a[(1234, 1)] = f64::NAN;
    let error = by_rank(&a, TOLERANCE).unwrap_err();
    assert_eq!(error, LeastSquaresError::NonFinite { row: 1234, column: 1 });
    let with_rhs = design_fn(50, 2, |rows, block| {
        for (at, row) in rows.enumerate() {
            (block[(at, 0)], block[(at, 1)], block[(at, 2)]) = (1.0, row as f64, 2.0);
        }
        Ok::<(), LeastSquaresError>(())
    });
    assert_eq!(Triangle::for_rank(&with_rhs, TOLERANCE).unwrap(), Triangle::of(&with_rhs).unwrap());
}

#[test]
fn threads_change_no_byte() {
    let mut draws = Draws::new(15);
    let a = with_singular_values(&mut draws, 9000, &[1.0, 0.9, 0.5, 0.1, 0.0, 0.0]);
    let of = |threads: usize| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| by_rank(&a, TOLERANCE).unwrap())
    };
    assert_eq!(of(1), of(4));
}
