//! The fast path: as accurate as QR where it is taken, and not taken elsewhere.

use geoerr_core::least_squares::{
    CONDITION_LIMIT, Fit, LeastSquaresError, Matrix, Method, Options, Restriction, StoredDesign, design_fn,
    fit, residual_products,
};
use nalgebra::DMatrix;
use rayon::ThreadPoolBuilder;

use super::common::{difference, largest, product, to_nalgebra};
use crate::draws::Draws;

fn fitted(a: &Matrix, b: &Matrix, options: &Options, method: Method) -> Fit {
    fit(&StoredDesign::new(a, b).unwrap(), options, method).unwrap()
}

/// Columns whose condition is `condition`: singular values falling evenly in their logarithms.
fn of_condition(draws: &mut Draws, m: usize, n: usize, condition: f64) -> Matrix {
    let orthonormal = |matrix: &Matrix| to_nalgebra(matrix).qr().q();
    let (u, v) = (orthonormal(&draws.matrix(m, n)), orthonormal(&draws.matrix(n, n)));
    let values =
        DMatrix::from_fn(
            n,
            n,
            |i, j| {
                if i == j { condition.powf(-(i as f64) / (n - 1) as f64) } else { 0.0 }
            },
        );
    let a = u * values * v;
    Matrix::from_columns(m, n, a.as_slice().to_vec()).unwrap()
}

#[test]
fn as_good_as_qr_wherever_it_is_taken() {
    let mut draws = Draws::new(1);
    let mut conditions_taken: f64 = 0.0;
    for decade in 0..13 {
        for noise in [0.0, 1.0] {
            let a = of_condition(&mut draws, 800, 12, 10.0_f64.powi(decade));
            let truth = draws.matrix(12, 1);
            let clean = product(&a, &truth);
            let b = Matrix::from_fn(800, 1, |i, _| clean[(i, 0)] + noise * draws.symmetric());
            let fast = fitted(&a, &b, &Options::default(), Method::Fastest);
            let qr = fitted(&a, &b, &Options::default(), Method::Qr).solution;
            assert!(qr.condition < CONDITION_LIMIT || !fast.is_from_normal_equations);
            // 1/√12 of the limit at least is used: the limit is on Frobenius norms.
            assert!(
                qr.condition > CONDITION_LIMIT / 200.0 || fast.is_from_normal_equations,
                "{:e}",
                qr.condition
            );
            if !fast.is_from_normal_equations {
                assert_eq!(fast.solution.x, qr.x);
                continue;
            }
            conditions_taken = conditions_taken.max(qr.condition);
            // Wedin: both are wrong by κε of x and by κ²ε of the residual; they may differ by twice that.
            let sizes: Vec<f64> = (0..12).map(|j| to_nalgebra(&a).column(j).norm()).collect();
            let scaled =
                |x: &Matrix| -> Vec<f64> { x.as_slice().iter().zip(&sizes).map(|(x, s)| x * s).collect() };
            let x_size = largest(scaled(&qr.x));
            let residual = qr.residual_ss[0].sqrt();
            let kappa = qr.condition;
            let bound = 12.0 * f64::EPSILON * (kappa * x_size + kappa * kappa * residual + kappa * residual);
            let error = difference(&scaled(&fast.solution.x), &scaled(&qr.x));
            assert!(error < bound, "condition {kappa:.0e}, noise {noise}: {error:.1e} against {bound:.1e}");
            let ratios = fast.solution.standard_errors().into_iter().zip(qr.standard_errors());
            // κ²ε at the limit is 2e-7.
            assert!(largest(ratios.map(|(fast, qr)| fast / qr - 1.0)) < 2e-7);
            if noise > 0.0 {
                assert!((fast.solution.residual_ss[0] / qr.residual_ss[0] - 1.0).abs() < 1e-12);
            }
        }
    }
    assert!(conditions_taken > 1e3);
}

#[test]
fn what_is_singular_goes_to_qr() {
    let mut draws = Draws::new(2);
    let base = draws.matrix(300, 5);
    let a = Matrix::from_fn(300, 6, |i, j| base[(i, j % 5)]);
    let b = draws.matrix(300, 1);
    let result = fitted(&a, &b, &Options::default(), Method::Fastest);
    assert!(!result.is_from_normal_equations);
    assert_eq!(result.solution.rank.rank, 5);
    // A gauge makes it regular, and fast again.
    let gauge = Matrix::from_fn(1, 6, |_, j| {
        if j == 0 {
            1.0
        } else if j == 5 {
            -1.0
        } else {
            0.0
        }
    });
    let options = Options { restriction: Restriction::Constraints(gauge), ..Options::default() };
    let fast = fitted(&a, &b, &options, Method::Fastest);
    assert!(fast.is_from_normal_equations);
    let qr = fitted(&a, &b, &options, Method::Qr).solution;
    assert!(difference(fast.solution.x.as_slice(), qr.x.as_slice()) < 1e-14);
    assert_eq!((fast.solution.n_free, fast.solution.rank.rank), (5, 5));
    assert!((fast.solution.x[(0, 0)] - fast.solution.x[(5, 0)]).abs() < 1e-15);
}

#[test]
fn huge_and_tiny_columns_are_not_hard() {
    let mut draws = Draws::new(3);
    let a = Matrix::from_fn(600, 8, |_, j| draws.symmetric() * 10.0_f64.powi(12 * (j as i32 - 4)));
    let b = draws.matrix(600, 2);
    let fast = fitted(&a, &b, &Options::default(), Method::Fastest);
    let qr = fitted(&a, &b, &Options::default(), Method::Qr);
    assert!(fast.is_from_normal_equations);
    let ratios = fast.solution.x.as_slice().iter().zip(qr.solution.x.as_slice());
    assert!(largest(ratios.map(|(fast, qr)| fast / qr - 1.0)) < 1e-12);
    // Squares beyond the range of double precision: QR scales, normal equations cannot.
    let a = Matrix::from_fn(600, 3, |_, j| draws.symmetric() * [1e200, 1.0, 1e-200][j]);
    let b = draws.matrix(600, 1);
    let result = fitted(&a, &b, &Options::default(), Method::Fastest);
    assert!(!result.is_from_normal_equations);
    assert_eq!(result.solution.rank.rank, 3);
}

#[test]
fn zero_right_hand_sides_and_exact_fits() {
    let mut draws = Draws::new(4);
    let a = draws.matrix(500, 7);
    let truth = draws.matrix(7, 1);
    let exact = product(&a, &truth);
    let b = Matrix::from_fn(500, 2, |i, rhs| if rhs == 0 { 0.0 } else { exact[(i, 0)] });
    let result = fitted(&a, &b, &Options::default(), Method::Fastest);
    assert!(result.is_from_normal_equations);
    assert_eq!(result.solution.x.column(0), [0.0; 7]);
    assert!(difference(result.solution.x.column(1), truth.as_slice()) < 1e-14);
    assert!(result.solution.residual_ss[1] < 1e-26);
}

#[test]
fn threads_do_not_change_a_byte() {
    let mut draws = Draws::new(5);
    let (a, b) = (draws.matrix(9_000, 50), draws.matrix(9_000, 1));
    let results = [1, 2, 5].map(|n| {
        let pool = ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        let fit = pool.install(|| fitted(&a, &b, &Options::default(), Method::Fastest));
        (fit.solution.x.clone(), fit.solution.covariance(), fit.solution.residual_ss)
    });
    assert!(results.iter().all(|result| *result == results[0]));
}

#[test]
fn products_with_residuals_are_a_pass_over_the_rows() {
    let mut draws = Draws::new(6);
    let (a, b, x) = (draws.matrix(3_000, 6), draws.matrix(3_000, 2), draws.matrix(6, 2));
    let found = residual_products(&StoredDesign::new(&a, &b).unwrap(), &x).unwrap();
    let residual = to_nalgebra(&b) - to_nalgebra(&a) * to_nalgebra(&x);
    let gradient = to_nalgebra(&a).transpose() * &residual;
    for rhs in 0..2 {
        assert!(difference(&found.column(rhs)[..6], gradient.column(rhs).as_slice()) < 1e-11);
        assert!((found[(6, rhs)] / residual.column(rhs).norm_squared() - 1.0).abs() < 1e-13);
    }
}

#[test]
fn a_design_may_refuse() {
    #[derive(Debug, PartialEq)]
    enum Refusal {
        Row(usize),
        Core(LeastSquaresError),
    }
    impl From<LeastSquaresError> for Refusal {
        fn from(error: LeastSquaresError) -> Self {
            Self::Core(error)
        }
    }
    let refusing = design_fn(5_000, 2, |rows, block: &mut Matrix| {
        block.column_mut(0).fill(1.0);
        // Several blocks refuse: the first one is heard, whichever thread was faster.
        if rows.end > 1_000 { Err(Refusal::Row(rows.start)) } else { Ok(()) }
    });
    for method in [Method::Fastest, Method::Qr] {
        let refused = fit(&refusing, &Options::default(), method).map(|_| ());
        assert_eq!(refused, Err(Refusal::Row(512)));
    }
    let none = design_fn(10, 0, |_, _: &mut Matrix| Ok::<(), LeastSquaresError>(()));
    let refused = fit(&none, &Options::default(), Method::Fastest).map(|_| ());
    assert_eq!(refused, Err(LeastSquaresError::NoColumns));
}
