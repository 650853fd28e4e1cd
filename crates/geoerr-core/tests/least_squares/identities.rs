//! What holds for every system, whatever its shape and rank.

use geoerr_core::least_squares::{Matrix, Options, StoredDesign, Triangle, solve};
use proptest::prelude::*;

use super::common::{difference, largest, product, to_nalgebra, triangle_of};
use crate::draws::Draws;

/// Any small system: some columns zero, some repeated, some rows zero.
fn systems() -> impl Strategy<Value = (Matrix, Matrix)> {
    (1_usize..40, 1_usize..12, any::<u64>()).prop_map(|(m, n, seed)| {
        let mut draws = Draws::new(seed);
        let mut a = draws.matrix(m, n);
        for column in 0..n {
            let kind = draws.symmetric();
            let other = (column * 7 + 3) % n;
            if kind > 0.8 {
                a.column_mut(column).fill(0.0);
            } else if kind > 0.6 && other < column {
                let copy = a.column(other).to_vec();
                a.column_mut(column).copy_from_slice(&copy);
            } else {
                // Powers of two: columns of any size without changing a digit.
                let size = (2.0_f64).powi((40.0 * draws.symmetric()) as i32);
                a.column_mut(column).iter_mut().for_each(|value| *value *= size);
            }
        }
        (a, draws.matrix(m, 1))
    })
}

fn norms(a: &Matrix) -> Vec<f64> {
    let norm = |j: usize| to_nalgebra(a).column(j).norm();
    (0..a.n_columns()).map(|j| if norm(j) > 0.0 { norm(j) } else { 1.0 }).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn residuals_are_orthogonal_to_the_columns((a, b) in systems()) {
        let solution = solve(&triangle_of(&a, &b), &Options::default()).unwrap();
        let residual = to_nalgebra(&b) - to_nalgebra(&a) * to_nalgebra(&solution.x);
        let along = to_nalgebra(&a).transpose() * &residual;
        let scaled = along.iter().zip(norms(&a)).map(|(along, norm)| along / norm);
        // Backward stable: mnε of ‖b‖ + ‖x‖, whose scaled size is at most ‖b‖ times the condition.
        prop_assert!(largest(scaled) < 1e-13 * solution.condition.max(10.0));
        let sum = residual.norm_squared();
        prop_assert!((solution.residual_ss[0] - sum).abs() < 1e-12 * (1.0 + sum) * solution.condition);
    }

    #[test]
    fn rank_and_null_space_are_complete((a, b) in systems()) {
        let solution = solve(&triangle_of(&a, &b), &Options::default()).unwrap();
        let n = a.n_columns();
        prop_assert_eq!(solution.rank.rank + solution.null_space.n_columns(), n);
        prop_assert!(solution.rank.rank <= a.n_rows().min(n));
        let unseen = product(&a, &solution.null_space);
        let sizes = norms(&a);
        for (j, column) in (0..solution.null_space.n_columns()).map(|j| (j, solution.null_space.column(j))) {
            let size = largest(column.iter().zip(&sizes).map(|(x, size)| x * size));
            prop_assert!(largest(unseen.column(j).iter().copied()) < 1e-9 * size);
            prop_assert!((largest(column.iter().copied()) - 1.0).abs() < 1e-8);
        }
        // An unknown is determined exactly where no null vector moves it.
        for row in 0..n {
            let moves = (0..solution.null_space.n_columns()).any(|j| solution.null_space[(row, j)] != 0.0);
            prop_assert_eq!(solution.is_determined[row], !moves);
        }
    }

    #[test]
    fn a_repeated_row_is_a_row_of_twice_the_weight((a, b) in systems()) {
        let twice = |matrix: &Matrix| Matrix::from_fn(2 * matrix.n_rows(), matrix.n_columns(), |i, j| {
            matrix[(i / 2, j)]
        });
        let once = solve(&triangle_of(&a, &b), &Options::default()).unwrap();
        let both = solve(&triangle_of(&twice(&a), &twice(&b)), &Options::default()).unwrap();
        prop_assert_eq!(once.rank.rank, both.rank.rank);
        prop_assert_eq!(&once.is_determined, &both.is_determined);
        let errors = once.standard_errors().into_iter().zip(both.standard_errors());
        for (once_error, both_error) in errors.filter(|(error, _)| !error.is_nan() && *error > 0.0) {
            prop_assert!((once_error / both_error - 2.0_f64.sqrt()).abs() < 1e-12 * once.condition.max(10.0));
        }
    }

    #[test]
    fn the_order_of_columns_is_the_callers((a, b) in systems()) {
        let n = a.n_columns();
        let turned = a.with_columns((0..n).rev());
        let forward = solve(&triangle_of(&a, &b), &Options::default()).unwrap();
        let backward = solve(&triangle_of(&turned, &b), &Options::default()).unwrap();
        prop_assert_eq!(forward.rank.rank, backward.rank.rank);
        let sizes = norms(&a);
        let scaled = |j: usize| forward.x[(j, 0)] * sizes[j];
        let other: Vec<f64> = (0..n).map(|j| backward.x[(n - 1 - j, 0)] * sizes[j]).collect();
        let first: Vec<f64> = (0..n).map(scaled).collect();
        let kappa = forward.condition.max(10.0);
        prop_assert!(difference(&first, &other) < 1e-13 * kappa * kappa);
    }

    #[test]
    fn no_bits_make_it_panic(bits in prop::collection::vec(any::<u64>(), 24), m in 1_usize..8) {
        let n = 24 / m;
        let a = Matrix::from_fn(m, n, |i, j| f64::from_bits(bits[i * n + j]));
        let b = Matrix::from_fn(m, 1, |i, _| i as f64);
        // Finite entries of any size give a solution or a refusal, never NaN in a determined unknown.
        let Ok(triangle) = Triangle::of(&StoredDesign::new(&a, &b).unwrap()) else { return Ok(()) };
        if let Ok(solution) = solve(&triangle, &Options::default()) {
            prop_assert_eq!(solution.x.n_rows(), n);
        }
    }
}
