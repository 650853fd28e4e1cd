//! Orthonormal bases of columns that are nearly so, that are alike, that repeat one another.

use geoerr_core::least_squares::orthonormal;
use nalgebra::DMatrix;
use proptest::prelude::*;

use crate::draws::Draws;

fn largest(matrix: &DMatrix<f64>) -> f64 {
    matrix.iter().fold(0.0, |most, value| value.abs().max(most))
}

/// Columns of all sizes; `alike` is what every second one has that the one before it has not.
fn columns(seed: u64, n_rows: usize, n_columns: usize, alike: f64) -> DMatrix<f64> {
    let mut draws = Draws::new(seed);
    let mut columns = DMatrix::from_fn(n_rows, n_columns, |_, _| draws.symmetric());
    for j in (1..n_columns).step_by(2) {
        let near = columns.column(j - 1) + alike * columns.column(j);
        columns.set_column(j, &near);
    }
    for mut column in columns.column_iter_mut() {
        column *= 10.0_f64.powf(6.0 * draws.symmetric());
    }
    columns
}

fn orthonormal_of(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let (found, count) = orthonormal(columns.transpose().as_slice(), columns.ncols()).unwrap();
    DMatrix::from_row_slice(columns.nrows(), count, &found)
}

/// The largest part of a column, of length 1, that is not in the span.
fn outside(columns: &DMatrix<f64>, basis: &DMatrix<f64>) -> f64 {
    let rest = columns - basis * (basis.transpose() * columns);
    rest.column_iter()
        .zip(columns.column_iter())
        .map(|(rest, own)| rest.norm() / own.norm())
        .fold(0.0, f64::max)
}

proptest! {
    #[test]
    fn is_orthonormal_and_spans_the_columns(seed in any::<u64>(), n_columns in 1_usize..30, digits in 0.0_f64..4.0) {
        let columns = columns(seed, 400, n_columns, 10.0_f64.powf(-digits));
        let basis = orthonormal_of(&columns);
        prop_assert_eq!(basis.ncols(), n_columns);
        let identity = DMatrix::identity(n_columns, n_columns);
        prop_assert!(largest(&(basis.transpose() * &basis - identity)) < 1e-12);
        // Rounding of the Gram matrix, 1e-16, against the root of its least eigenvalue, 1e-5.
        prop_assert!(outside(&columns, &basis) < 1e-10);
    }

    #[test]
    fn columns_inside_the_others_are_left_out(seed in any::<u64>(), n_columns in 1_usize..12) {
        let own = columns(seed, 300, n_columns, 1.0);
        let mut draws = Draws::new(seed ^ 1);
        let mixed = &own * DMatrix::from_fn(n_columns, 5, |_, _| draws.symmetric());
        let mut all = DMatrix::zeros(300, 2 * n_columns + 6);
        all.columns_mut(0, n_columns).copy_from(&own);
        all.columns_mut(n_columns, 5).copy_from(&mixed);
        all.columns_mut(n_columns + 6, n_columns).copy_from(&own);
        let basis = orthonormal_of(&all);
        prop_assert_eq!(basis.ncols(), n_columns);
        prop_assert!(largest(&(basis.transpose() * &basis - DMatrix::identity(n_columns, n_columns))) < 1e-12);
        prop_assert!(outside(&own, &basis) < 1e-6);
    }
}

#[test]
fn nothing_has_no_basis() {
    assert_eq!(orthonormal(&[], 0).unwrap(), (vec![], 0));
    assert_eq!(orthonormal(&[0.0; 12], 3).unwrap(), (vec![], 0));
    assert!(orthonormal(&[1.0, f64::NAN], 2).is_err());
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    for alike in [1.0, 1e-4] {
        let rows = columns(5, 5000, 37, alike).transpose();
        let by = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| orthonormal(rows.as_slice(), 37).unwrap())
        };
        assert_eq!(by(1), by(2));
        assert_eq!(by(1), by(7));
    }
}
