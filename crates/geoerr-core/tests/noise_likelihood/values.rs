//! Value and gradient.

use geoerr_core::noise_likelihood::{Blocks, Likelihood, NoiseError};
use proptest::prelude::*;

use super::scene::{Scene, parameters, scenes};
use crate::draws::Draws;

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_value_is_that_of_dense_matrices(scene in scenes(), logs in parameters(), is_restricted in any::<bool>()) {
        let (value, _) = scene.likelihood().minus_twice_ln(&logs, is_restricted).unwrap();
        let expected = scene.dense(&logs, is_restricted);
        prop_assert!((value - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{value} and {expected}");
    }

    #[test]
    fn the_gradient_is_that_of_differences(scene in scenes(), logs in parameters(), is_restricted in any::<bool>()) {
        let likelihood = scene.likelihood();
        let (_, gradient) = likelihood.minus_twice_ln(&logs, is_restricted).unwrap();
        for c in 0..3 {
            for i in 0..4 {
                let at = |step: f64| {
                    let mut moved = logs;
                    moved[c][i] += step;
                    likelihood.minus_twice_ln(&moved, is_restricted).unwrap().0
                };
                // Fourth order: the step's error is 1e-9 of the fifth derivative, rounding 1e-10 of the value.
                let h = 4e-3;
                let slope = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
                prop_assert!((gradient[c][i] - slope).abs() < 1e-6 * (1.0 + slope.abs()), "{gradient:?} and {slope}");
            }
        }
    }

    #[test]
    fn columns_added_are_columns_from_the_start(scene in scenes(), logs in parameters(), seed in any::<u64>()) {
        let mut draws = Draws::new(seed);
        let (n, r, more) = (scene.of_row.len(), scene.n_basis, 3);
        let columns: Vec<f64> = (0..3 * n * more).map(|_| draws.symmetric()).collect();
        let joined: Vec<f64> = (scene.basis.chunks_exact(r).zip(columns.chunks_exact(more)))
            .flat_map(|(old, new)| [old, new].concat())
            .collect();
        let added = (scene.likelihood())
            .with_columns(&scene.weights, &scene.residual, &scene.basis, &columns, more)
            .unwrap();
        let whole =
            Likelihood::new(scene.blocks(), &scene.weights, &scene.residual, &joined, r + more).unwrap();
        let ((value, gradient), (expected, slope)) =
            (added.minus_twice_ln(&logs, true).unwrap(), whole.minus_twice_ln(&logs, true).unwrap());
        prop_assert!((value - expected).abs() < 1e-9 * (1.0 + expected.abs()));
        let off = gradient.iter().flatten().zip(slope.iter().flatten()).map(|(a, b)| (a - b).abs());
        prop_assert!(off.fold(0.0, f64::max) < 1e-8 * (1.0 + expected.abs()));
    }
}

#[test]
fn a_component_without_numbers_has_no_part() {
    let mut scene = Scene::new(3, 90, &[5, 4], 3);
    for row in 0..scene.of_row.len() {
        scene.weights[row][1] = 0.0;
        scene.residual[row][1] = 0.0;
        scene.basis[(3 * row + 1) * 3..(3 * row + 2) * 3].fill(0.0);
    }
    let likelihood = scene.likelihood();
    assert_eq!(likelihood.is_used(), [true, false, true]);
    let logs = [[0.1, -1.0, -2.0, -0.5]; 3];
    let mut other = logs;
    other[1] = [f64::NAN; 4];
    let (value, gradient) = likelihood.minus_twice_ln(&logs, true).unwrap();
    assert_eq!((value, gradient), likelihood.minus_twice_ln(&other, true).unwrap());
    assert_eq!(gradient[1], [0.0; 4]);
    assert!((value - scene.dense(&logs, true)).abs() < 1e-9 * value.abs());
    assert_eq!(likelihood.fit(None, 0.1, true).unwrap().logs[1], [0.0; 4]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let bad_block = Blocks::new(vec![0, 2], &[0], vec![0, 0], vec![0.0, 1.0]).unwrap_err();
    assert_eq!(bad_block, NoiseError::BadBlock { row: 1, block: 2, count: 2 });
    for time in [vec![1.0, 0.0], vec![0.0, f64::NAN]] {
        let not_in_order = Blocks::new(vec![0, 1], &[0], vec![0, 0], time).unwrap_err();
        assert_eq!(not_in_order, NoiseError::NotInOrder { block: 1 });
    }
    assert!(Blocks::new(vec![0, 1], &[1], vec![0, 0], vec![0.0, 1.0]).is_err());
    assert!(Blocks::new(vec![0, 1], &[0, 3], vec![0, 0], vec![0.0, 1.0]).is_err());
    let scene = Scene::new(1, 20, &[3], 2);
    let short = Likelihood::new(scene.blocks(), &scene.weights[1..], &scene.residual, &scene.basis, 2);
    assert_eq!(short.unwrap_err(), NoiseError::Length { what: "weights", found: 19, needed: 20 });
}
