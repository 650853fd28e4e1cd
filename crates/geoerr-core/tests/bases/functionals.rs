//! Means and least-squares lines over the range.

use geoerr_core::bases::Basis;
use proptest::prelude::*;

use super::common::{any_basis, differ, length, quadrature, size};

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn means_and_slopes_by_quadrature(basis in any_basis()) {
        let (low, high) = basis.range();
        let (length, middle) = (length(&basis), 0.5 * (low + high));
        let mean: Vec<f64> = quadrature(&basis, high, |_| 1.0).iter().map(|sum| sum / length).collect();
        let slope: Vec<f64> =
            quadrature(&basis, high, |q| q - middle).iter().map(|sum| 12.0 * sum / length.powi(3)).collect();
        prop_assert!(differ(&basis.mean_row(), &mean) < 1e-12 * size(&basis));
        prop_assert!(differ(&basis.slope_row(), &slope) < 1e-11 * size(&basis) / length);
    }

    /// The line that the rows give leaves a smaller mean square than its neighbours: the definition.
    #[test]
    fn the_line_is_the_best_one(basis in any_basis(), seeds in prop::collection::vec(-1.0..1.0_f64, 64)) {
        let coefficients = &seeds[..basis.len()];
        let dot = |row: &[f64]| -> f64 { row.iter().zip(coefficients).map(|(a, b)| a * b).sum() };
        let (mean, slope) = (dot(&basis.mean_row()), dot(&basis.slope_row()));
        let (low, high) = basis.range();
        let middle = 0.5 * (low + high);
        let curve = basis.curve(coefficients).unwrap();
        let n = 4001;
        let mean_square = |mean: f64, slope: f64| -> f64 {
            let squares = (0..n).map(|i| {
                let q = low + (high - low) * (f64::from(i) + 0.5) / f64::from(n);
                (curve.value(q) - mean - slope * (q - middle)).powi(2)
            });
            squares.sum()
        };
        let best = mean_square(mean, slope);
        let change = 0.02 * size(&basis);
        for (d_mean, d_slope) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 4.0), (0.0, -4.0)] {
            prop_assert!(mean_square(mean + d_mean * change, slope + d_slope * change / length(&basis)) > best);
        }
    }
}

#[test]
fn rows_by_hand() {
    let basis = Basis::linear_elements(vec![0.0, 100.0, 400.0]).unwrap();
    // Areas 50, 200, 150 over 400.
    assert!(differ(&basis.mean_row(), &[0.125, 0.5, 0.375]) < 1e-15);
    // The function q has slope 1 and mean 200.
    let slope: f64 = basis.slope_row().iter().zip([0.0, 100.0, 400.0]).map(|(a, b)| a * b).sum();
    assert!((slope - 1.0).abs() < 1e-14);
    // A constant angle has no straightness.
    let straightness = Basis::tangent_integral(basis).unwrap();
    for q in [0.0, 50.0, 133.0, 400.0] {
        assert!(straightness.value_row(q).iter().sum::<f64>().abs() < 1e-13);
    }
}
