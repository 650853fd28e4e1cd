//! What whitens.

use geoerr_core::noise_likelihood::Direction;
use nalgebra::DMatrix;
use proptest::prelude::*;

use super::scene::{parameters, scenes};

fn largest(matrix: &DMatrix<f64>) -> f64 {
    matrix.iter().fold(0.0, |most, value| value.abs().max(most))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whitening_is_the_inverse_root_of_the_covariance(scene in scenes(), logs in parameters()) {
        let (whitening, n) = (scene.blocks().whitening(&scene.weights, &logs).unwrap(), scene.of_row.len());
        // The identity, in all three components.
        let mut ones = vec![0.0; 3 * n * n];
        for row in 0..n {
            for c in 0..3 {
                ones[(3 * row + c) * n + row] = 1.0;
            }
        }
        let roots = [Direction::Forward, Direction::Transposed, Direction::Back].map(|direction| {
            let found = whitening.apply(&ones, n, direction).unwrap();
            [0, 1, 2].map(|c| DMatrix::from_fn(n, n, |row, column| found[(3 * row + c) * n + column]))
        });
        for c in 0..3 {
            let identity = &roots[0][c] * scene.covariance(c, logs[c]) * roots[0][c].transpose();
            prop_assert!(largest(&(identity - DMatrix::identity(n, n))) < 1e-9);
            prop_assert!(largest(&(&roots[1][c] - roots[0][c].transpose())) < 1e-11);
            prop_assert!(largest(&(&roots[2][c] * &roots[0][c] - DMatrix::identity(n, n))) < 1e-9);
        }
    }

    #[test]
    fn the_whitened_basis_is_orthonormal_and_spans_the_whitened_columns(scene in scenes(), logs in parameters()) {
        let whitening = scene.blocks().whitening(&scene.weights, &logs).unwrap();
        let (rows, r) = (3 * scene.of_row.len(), scene.n_basis);
        let whitened = whitening.apply(&scene.basis, r, Direction::Forward).unwrap();
        let whitened = DMatrix::from_row_slice(rows, r, &whitened);
        let found = scene.likelihood().whitened_basis(&scene.weights, &scene.basis, &logs).unwrap();
        let Some(found) = found else { return Ok(()) };
        let found = DMatrix::from_row_slice(rows, r, &found);
        prop_assert!(largest(&(found.transpose() * &found - DMatrix::identity(r, r))) < 1e-11);
        let inside = &found * (found.transpose() * &whitened);
        prop_assert!(largest(&(inside - &whitened)) < 1e-11 * largest(&whitened));
    }
}
