//! Curves against the bases they come from, sets against curves.

use geoerr_core::bases::{Basis, Curve, CurveSet, Order};
use geoerr_core::kinematics::Table;
use proptest::prelude::*;

use super::common::{any_basis, any_nodes, finest_mm, length, size};

fn any_curve() -> impl Strategy<Value = (Basis, Vec<f64>)> {
    any_basis().prop_flat_map(|basis| {
        let n_functions = basis.len();
        (Just(basis), prop::collection::vec(-1.0..1.0_f64, n_functions))
    })
}

fn sum(row: &[f64], coefficients: &[f64]) -> f64 {
    row.iter().zip(coefficients).map(|(a, b)| a * b).sum()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_curve_is_the_sum_of_its_functions((basis, coefficients) in any_curve(), share in -0.2..1.2_f64) {
        let (low, high) = basis.range();
        let curve = basis.curve(&coefficients).unwrap();
        prop_assert_eq!(curve.kinks(), basis.kinks());
        let inside = low + share * length(&basis);
        for q in [inside, low, high, f64::NEG_INFINITY, f64::INFINITY] {
            let (value, slope) = curve.value_and_slope(q);
            // Powers of a polynomial of degree 12 are 5000 times larger than its values.
            let bound = 1e-11 * size(&basis);
            prop_assert!((value - sum(&basis.value_row(q), &coefficients)).abs() < bound, "at {}", q);
            let expected = if q == high { 0.0 } else { sum(&basis.rows(Order::Derivative, &[q]), &coefficients) };
            prop_assert!((slope - expected).abs() < 10.0 * bound / finest_mm(&basis), "slope at {}", q);
        }
        let (value, _) = curve.value_and_slope(f64::NAN);
        prop_assert!(value.is_nan());
    }

    #[test]
    fn linear_elements_are_tables(nodes in any_nodes(20), seeds in prop::collection::vec(-1.0..1.0_f64, 20)) {
        let values = seeds[..nodes.len()].to_vec();
        let table = Table::new(nodes.clone(), values.clone()).unwrap();
        let curve = Basis::linear_elements(nodes.clone()).unwrap().curve(&values).unwrap();
        for (node, value) in nodes.iter().zip(&values) {
            prop_assert_eq!(curve.value(*node), *value);
        }
        for step in -3..40 {
            let q = nodes[0] + (nodes[nodes.len() - 1] - nodes[0]) * f64::from(step) / 37.0;
            let (value, slope) = curve.value_and_slope(q);
            prop_assert!((value - table.value(q)).abs() < 1e-14);
            prop_assert!((slope - table.slope(q)).abs() < 1e-14);
        }
    }

    #[test]
    fn a_set_is_its_curves(
        a in any_curve(), b in any_curve(), c in any_curve(), places in prop::collection::vec(-700.0..1300.0_f64, 12),
    ) {
        let bases = [&a.0, &b.0, &c.0];
        let curves = [&a, &b, &c].map(|(basis, coefficients)| basis.curve(coefficients).unwrap());
        let set = CurveSet::new([&curves[0], &curves[1], &curves[2]]);
        let all = curves[0].plus(&curves[1]).plus(&curves[2]);
        let largest = bases.map(size).into_iter().fold(1.0, f64::max);
        let kinks = set.kinks().to_vec();
        prop_assert!(kinks.windows(2).all(|pair| pair[0] < pair[1]));
        prop_assert_eq!(all.kinks(), &kinks[..]);
        for q in places.into_iter().chain(kinks) {
            let (values, slopes) = set.values_and_slopes(q);
            let (value, slope) = all.value_and_slope(q);
            let (mut value_sum, mut slope_sum) = (0.0, 0.0);
            for n in 0..3 {
                let (value, slope) = curves[n].value_and_slope(q);
                let bound = 1e-11 * size(bases[n]);
                prop_assert!((values[n] - value).abs() < bound);
                prop_assert!((slopes[n] - slope).abs() < 10.0 * bound / finest_mm(bases[n]));
                value_sum += value;
                slope_sum += slope;
            }
            prop_assert!((value - value_sum).abs() < 1e-11 * largest);
            let steepest = bases.map(finest_mm).into_iter().fold(f64::INFINITY, f64::min);
            prop_assert!((slope - slope_sum).abs() < 1e-10 * largest / steepest);
        }
    }
}

#[test]
fn constants_have_no_kinks() {
    let constant = Curve::constant(0.25);
    for q in [-1e9, 0.0, 7.0, f64::INFINITY] {
        assert_eq!(constant.value_and_slope(q), (0.25, 0.0));
    }
    assert!(constant.value(f64::NAN).is_nan());
    assert!(constant.kinks().is_empty());
    let set = CurveSet::new([&constant, &Curve::constant(-1.0)]);
    assert_eq!(set.values_and_slopes(3.0), ([0.25, -1.0], [0.0, 0.0]));
    let line = Basis::linear_elements(vec![0.0, 10.0]).unwrap().curve(&[1.0, 3.0]).unwrap();
    assert_eq!(line.plus(&constant).value_and_slope(5.0), (2.25, 0.2));
}

/// Continuity to the right, as tables have it.
#[test]
fn steps_and_slopes_are_those_to_the_right() {
    let steps = Basis::bspline(vec![0.0, 10.0, 20.0], 0).unwrap().curve(&[1.0, 2.0]).unwrap();
    let at = |q: f64| steps.value(q);
    assert_eq!([-1.0, 0.0, 9.9, 10.0, 20.0, 30.0].map(at), [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
    assert_eq!(steps.kinks(), [0.0, 10.0, 20.0]);
}
