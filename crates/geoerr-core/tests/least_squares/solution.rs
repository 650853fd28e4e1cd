//! Rank, null space, covariance and restrictions, where they are known in advance.

use geoerr_core::least_squares::{LeastSquaresError, Matrix, Options, Restriction, solve};

use super::common::{by_svd, difference, largest, product, solved, to_nalgebra, triangle_of};
use crate::draws::Draws;

fn with_singular_values() -> Options {
    Options { wants_singular_values: true, ..Options::default() }
}

/// Chebyshev-like, Hilbert-like, Vandermonde: columns of every size, conditions from 10 to 10¹⁰ after scaling.
fn hard_systems() -> Vec<(&'static str, Matrix)> {
    let at = |i: usize, m: usize| i as f64 / (m - 1) as f64;
    vec![
        ("hilbert", Matrix::from_fn(60, 7, |i, j| 1.0 / (i + j + 1) as f64)),
        ("vandermonde", Matrix::from_fn(300, 9, |i, j| (400.0 * at(i, 300)).powi(j as i32))),
        ("sizes", {
            let mut draws = Draws::new(11);
            Matrix::from_fn(200, 12, |_, j| draws.symmetric() * 10.0_f64.powi(7 * (j as i32 - 6)))
        }),
        ("near copies", {
            let mut draws = Draws::new(12);
            let base = draws.matrix(400, 5);
            Matrix::from_fn(400, 10, |i, j| {
                base[(i, j % 5)] + if j < 5 { 0.0 } else { 1e-7 * draws.symmetric() }
            })
        }),
    ]
}

#[test]
fn hard_systems_are_as_good_as_their_condition() {
    for (name, a) in hard_systems() {
        let mut draws = Draws::new(21);
        let n = a.n_columns();
        // Unknowns of the size of their scaled columns: then scaled and unscaled relative errors agree.
        let truth = Matrix::from_fn(n, 1, |j, _| draws.symmetric() / to_nalgebra(&a).column(j).norm());
        let b = product(&a, &truth);
        let solution = solve(&triangle_of(&a, &b), &with_singular_values()).unwrap();
        assert_eq!(solution.rank.rank, n, "{name}: {:?}", solution.singular_values);
        let scaled = |x: &Matrix| -> Vec<f64> {
            (0..n).map(|j| x[(j, 0)] * to_nalgebra(&a).column(j).norm()).collect()
        };
        let error = difference(&scaled(&solution.x), &scaled(&truth));
        // Higham 20.3 for consistent systems: n·κ·ε times a small constant; b itself is rounded.
        let bound = 4.0 * n as f64 * solution.condition * f64::EPSILON;
        assert!(error < bound, "{name}: {error:.1e} against {bound:.1e}");
        let reference = to_nalgebra(&a);
        let mut reference_scaled = reference.clone();
        for mut column in reference_scaled.column_iter_mut() {
            let norm = column.norm();
            column /= norm;
        }
        let mut values: Vec<f64> = reference_scaled.singular_values().iter().copied().collect();
        values.sort_by(|a, b| b.total_cmp(a));
        let found = solution.singular_values.unwrap();
        assert!(difference(&values, &found) < 1e-13 * values[0], "{name}");
    }
}

#[test]
fn the_fast_path_and_the_singular_values_agree() {
    let mut draws = Draws::new(31);
    for n in [1, 5, 40] {
        let (a, b) = (draws.matrix(200, n), draws.matrix(200, 2));
        let triangle = triangle_of(&a, &b);
        let fast = solve(&triangle, &Options::default()).unwrap();
        let slow = solve(&triangle, &with_singular_values()).unwrap();
        assert!(fast.singular_values.is_none() && slow.singular_values.is_some());
        assert!(difference(fast.x.as_slice(), slow.x.as_slice()) < 1e-14);
        assert!(difference(fast.covariance().as_slice(), slow.covariance().as_slice()) < 1e-15);
        assert_eq!(fast.rank.rank, slow.rank.rank);
        assert!((0.8..1.0 + 1e-12).contains(&(fast.condition / slow.condition)), "{n}");
        assert_eq!(fast.null_space.n_columns(), 0);
    }
}

#[test]
fn covariance_is_that_of_many_draws() {
    // Two unknowns that mix, two that do not: x over 4000 noisy b; the sample covariance of 4000 draws is certain to
    // √(2/4000) = 2.2 %, its entries relative to the standard errors within 5 of that.
    let mut draws = Draws::new(41);
    let (m, n, n_draws) = (50, 6, 4_000);
    let base = draws.matrix(m, n);
    let a = Matrix::from_fn(m, n, |i, j| if j == 5 { base[(i, 4)] } else { base[(i, j)] });
    let truth = draws.matrix(n, 1);
    let clean = product(&a, &truth);
    let b = Matrix::from_fn(m, n_draws, |i, _| clean[(i, 0)] + draws.normal());
    let solution = solved(&a, &b);
    assert_eq!(solution.is_determined, [true, true, true, true, false, false]);
    let covariance = solution.covariance();
    assert!(covariance[(5, 0)].is_nan() && covariance[(2, 4)].is_nan());
    let (errors, x) = (solution.standard_errors(), to_nalgebra(&solution.x));
    assert!(errors[4].is_nan() && errors[5].is_nan());
    for i in 0..4 {
        for j in 0..4 {
            let (mean_i, mean_j) = (truth[(i, 0)], truth[(j, 0)]);
            let sample: f64 = (0..n_draws).map(|k| (x[(i, k)] - mean_i) * (x[(j, k)] - mean_j)).sum::<f64>()
                / n_draws as f64;
            assert!((sample - covariance[(i, j)]).abs() < 5.0 * 0.022 * errors[i] * errors[j], "{i} {j}");
        }
        assert!((errors[i] * errors[i] / covariance[(i, i)] - 1.0).abs() < 1e-14);
    }
    // The sum of the two that mix is determined; with its variance.
    let together = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0];
    let functional = solution.functional(&together, 0).unwrap().unwrap();
    let sums: Vec<f64> =
        (0..n_draws).map(|k| x[(4, k)] + x[(5, k)] - truth[(4, 0)] - truth[(5, 0)]).collect();
    let sample = sums.iter().map(|s| s * s).sum::<f64>() / n_draws as f64;
    assert!((sample / functional.variance - 1.0).abs() < 5.0 * 0.022);
    assert!(solution.functional(&[0.0, 0.0, 0.0, 0.0, 1.0, 0.5], 0).unwrap().is_none());
    // Residual variance: 50 − 5 degrees of freedom, each sum certain to √(2/45), all together to √(2/(45·4000)).
    let mean = solution.residual_ss.iter().sum::<f64>() / n_draws as f64 / solution.degrees_of_freedom as f64;
    assert!((mean - 1.0).abs() < 5.0 * (2.0 / (45.0 * n_draws as f64)).sqrt());
}

#[test]
fn a_null_space_can_be_read() {
    // Four independent confusions in mixed units: x1 = −3 x7 (mm and rad); x2 + x4 against x5; x8 unseen; x0 with x9 alike.
    let mut draws = Draws::new(51);
    let (m, n) = (400, 12);
    let mut a = draws.matrix(m, n);
    for i in 0..m {
        a[(i, 7)] = 3.0 * a[(i, 1)];
        a[(i, 5)] = a[(i, 2)] + a[(i, 4)];
        a[(i, 8)] = 0.0;
        a[(i, 9)] = 1e6 * a[(i, 0)];
    }
    let solution = solved(&a, &draws.matrix(m, 1));
    assert_eq!(solution.rank.rank, 8);
    assert!(solution.rank.gap > 1e10);
    let expected = [
        vec![(0, 1.0), (9, -1e-6)],
        vec![(1, 1.0), (7, -1.0 / 3.0)],
        vec![(2, 1.0), (4, 1.0), (5, -1.0)],
        vec![(8, 1.0)],
    ];
    assert_eq!(solution.null_space.n_columns(), 4);
    for (column, entries) in expected.iter().enumerate() {
        for row in 0..n {
            let wanted = entries.iter().find(|entry| entry.0 == row).map_or(0.0, |entry| entry.1);
            let found = solution.null_space[(row, column)];
            assert!((found - wanted).abs() <= 1e-12 * wanted.abs(), "{row} {column}: {found} for {wanted}");
        }
    }
    let determined: Vec<usize> = (0..n).filter(|&j| solution.is_determined[j]).collect();
    assert_eq!(determined, [3, 6, 10, 11]);
    let fitted = product(&a, &solution.null_space);
    assert!(largest(fitted.as_slice().iter().copied()) < 1e-12);
}

#[test]
fn of_all_minimisers_the_smallest() {
    let mut draws = Draws::new(61);
    for (m, n, rank) in [(60, 10, 6), (5, 9, 5), (700, 40, 25)] {
        let a = product(&draws.matrix(m, rank), &draws.matrix(rank, n));
        let b = draws.matrix(m, 2);
        let solution = solved(&a, &b);
        assert_eq!(solution.rank.rank, rank);
        let reference = by_svd(&a, &b, 1e-11);
        assert!(difference(solution.x.as_slice(), reference.as_slice()) < 1e-11);
        assert_eq!(solution.degrees_of_freedom, m.saturating_sub(rank));
    }
}

#[test]
fn nothing_seen_is_nothing_known() {
    let a = Matrix::zeros(10, 3);
    let b = Matrix::from_fn(10, 1, |_, _| 2.0);
    let solution = solved(&a, &b);
    assert_eq!((solution.rank.rank, solution.degrees_of_freedom), (0, 10));
    assert_eq!(solution.x.as_slice(), [0.0; 3]);
    assert_eq!(solution.null_space, Matrix::identity(3));
    assert_eq!(solution.is_determined, [false; 3]);
    assert!((solution.residual_ss[0] - 40.0).abs() < 1e-13);
}

#[test]
fn constraints_hold_and_restore_what_was_not_determined() {
    let mut draws = Draws::new(71);
    let (m, n) = (300, 9);
    let mut a = draws.matrix(m, n);
    for i in 0..m {
        a[(i, 6)] = 1e-4 * (a[(i, 0)] - a[(i, 3)]);
    }
    let b = draws.matrix(m, 1);
    assert_eq!(solved(&a, &b).rank.rank, 8);
    // The middle of 0, 3 and 6 is the gauge; stated twice, in other units.
    let row = |i: usize, j: usize| if j.is_multiple_of(3) { [1.0, -250.0][i] } else { 0.0 };
    let restriction = Restriction::Constraints(Matrix::from_fn(2, n, row));
    let options = Options { restriction, ..Options::default() };
    let solution = solve(&triangle_of(&a, &b), &options).unwrap();
    assert_eq!((solution.n_free, solution.rank.rank), (8, 8));
    assert!(solution.is_determined.iter().all(|&is_determined| is_determined));
    assert!((solution.x[(0, 0)] + solution.x[(3, 0)] + solution.x[(6, 0)]).abs() < 1e-11);
    let covariance = solution.covariance();
    for j in 0..n {
        assert!((covariance[(0, j)] + covariance[(3, j)] + covariance[(6, j)]).abs() < 1e-9);
    }
    assert!((solution.residual_ss[0] / solved(&a, &b).residual_ss[0] - 1.0).abs() < 1e-13);
    // Elimination by hand: x6 = −x0 − x3.
    let eliminated = Matrix::from_fn(m, 8, |i, j| {
        let from = [0, 1, 2, 3, 4, 5, 7, 8][j];
        a[(i, from)] - if from == 0 || from == 3 { a[(i, 6)] } else { 0.0 }
    });
    let by_hand = solved(&eliminated, &b);
    for (j, from) in [0, 1, 2, 3, 4, 5, 7, 8].into_iter().enumerate() {
        let error = (by_hand.x[(j, 0)] - solution.x[(from, 0)]).abs();
        assert!(error < 1e-12 * by_hand.condition * by_hand.x[(j, 0)].abs().max(1.0), "{from}");
        let ratio = by_hand.standard_errors()[j] / solution.standard_errors()[from];
        assert!((ratio - 1.0).abs() < 1e-9);
    }
}

#[test]
fn a_basis_is_elimination() {
    let mut draws = Draws::new(81);
    let (a, b) = (draws.matrix(100, 6), draws.matrix(100, 2));
    let basis = draws.matrix(6, 3);
    let options = Options { restriction: Restriction::Basis(basis.clone()), ..Options::default() };
    let solution = solve(&triangle_of(&a, &b), &options).unwrap();
    let reduced = solved(&product(&a, &basis), &b);
    assert!(difference(solution.x.as_slice(), product(&basis, &reduced.x).as_slice()) < 1e-13);
    assert!(difference(&solution.residual_ss, &reduced.residual_ss) < 1e-12);
    let (n, inner) = (to_nalgebra(&basis), to_nalgebra(&reduced.covariance()));
    let outer = &n * inner * n.transpose();
    assert!(difference(solution.covariance().as_slice(), outer.as_slice()) < 1e-14);
}

#[test]
fn the_sum_that_a_hypothesis_costs_is_that_of_a_second_fit() {
    let mut draws = Draws::new(91);
    let (a, b) = (draws.matrix(120, 8), draws.matrix(120, 1));
    let whole = solved(&a, &b);
    let without = solved(&a.with_columns([0, 1, 3, 4, 6, 7]), &b);
    let functionals = Matrix::from_fn(8, 2, |i, j| if i == [2, 5][j] { 1.0 } else { 0.0 });
    let growth = whole.growth_without(&functionals, 0).unwrap().unwrap();
    let refit = without.residual_ss[0] - whole.residual_ss[0];
    assert!((growth / refit - 1.0).abs() < 1e-11);
    let twice = Matrix::from_fn(8, 2, |i, _| if i == 2 { 1.0 } else { 0.0 });
    assert_eq!(whole.growth_without(&twice, 0).unwrap(), None);
}

#[test]
fn a_new_right_hand_side_needs_no_new_factors() {
    let mut draws = Draws::new(101);
    let (a, b, other) = (draws.matrix(500, 20), draws.matrix(500, 1), draws.matrix(500, 1));
    let solution = solved(&a, &b);
    let atb = product(&a.transposed(), &other);
    let x = solution.solve_normal(atb.as_slice()).unwrap();
    assert!(difference(&x, solved(&a, &other).x.as_slice()) < 1e-14);
}

#[test]
fn refusals() {
    let mut draws = Draws::new(111);
    let triangle = triangle_of(&draws.matrix(20, 4), &draws.matrix(20, 1));
    let with = |options: Options| solve(&triangle, &options).map(|_| ());
    for tolerance in [-1e-3, 1.0, f64::NAN] {
        let options = Options { rank_tolerance: Some(tolerance), ..Options::default() };
        assert!(matches!(with(options), Err(LeastSquaresError::Tolerance { .. })));
    }
    let restricted = |restriction| with(Options { restriction, ..Options::default() });
    assert_eq!(
        restricted(Restriction::Constraints(Matrix::zeros(1, 3))),
        Err(LeastSquaresError::ColumnsDiffer { expected: 4, found: 3 })
    );
    assert_eq!(
        restricted(Restriction::Basis(Matrix::zeros(5, 2))),
        Err(LeastSquaresError::RowsDiffer { expected: 4, found: 5 })
    );
    let mut bad = Matrix::zeros(2, 4);
    bad[(1, 2)] = f64::NAN;
    assert_eq!(
        restricted(Restriction::Constraints(bad)),
        Err(LeastSquaresError::NonFinite { row: 1, column: 2 })
    );
    let solution = solve(&triangle, &Options::default()).unwrap();
    assert!(solution.is_estimable(&[1.0; 3]).is_err());
    assert_eq!(
        solution.functional(&[1.0; 4], 1),
        Err(LeastSquaresError::NoSuchRightHandSide { index: 1, n_rhs: 1 })
    );
}
