//! Functions, derivatives and integrals at positions.

use geoerr_core::bases::{Basis, BasisKind, Order};
use proptest::prelude::*;

use super::common::{
    any_basis, any_bspline, any_elements, any_nodes, any_plain, differ, finest_mm, largest, length,
    quadrature, size,
};

/// A position within the range, not within `margin` of a kink.
fn away_from_kinks(basis: &Basis, share: f64, margin: f64) -> Option<f64> {
    let (low, high) = basis.range();
    let q = low + share * (high - low);
    basis.kinks().iter().all(|kink| (kink - q).abs() > margin).then_some(q)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn splines_and_elements_add_up_to_one(
        basis in prop_oneof![any_bspline(), any_elements()], share in -0.2..1.2_f64,
    ) {
        let q = basis.range().0 + share * length(&basis);
        let ones: f64 = basis.value_row(q).iter().sum();
        // A parabola whose middle node lies 60 to 0.5 beside its middle rises to 30.
        prop_assert!((ones - 1.0).abs() < 1e-13, "{ones}");
        let slopes: f64 = basis.rows(Order::Derivative, &[q]).iter().sum();
        prop_assert!(slopes.abs() * finest_mm(&basis) < 1e-12, "{slopes}");
    }

    #[test]
    fn splines_are_never_negative(basis in any_bspline(), share in 0.0..1.0_f64) {
        let values = basis.value_row(basis.range().0 + share * length(&basis));
        prop_assert!(values.iter().all(|&value| (-1e-15..=1.0 + 1e-15).contains(&value)));
    }

    #[test]
    fn nodes_keep_their_values(nodes in any_nodes(13)) {
        let linear = Basis::linear_elements(nodes.clone()).unwrap();
        let odd = &nodes[..nodes.len() - (nodes.len() + 1) % 2];
        let quadratic = (odd.len() > 2).then(|| Basis::quadratic_elements(odd.to_vec()).unwrap());
        for basis in std::iter::once(linear).chain(quadratic) {
            for (index, &node) in nodes[..basis.len()].iter().enumerate() {
                let mut unit = vec![0.0; basis.len()];
                unit[index] = 1.0;
                prop_assert!(differ(&basis.value_row(node), &unit) < 1e-13);
            }
        }
    }

    #[test]
    fn support_holds_all_that_is_not_zero(basis in any_basis(), share in -0.2..1.2_f64) {
        let q = basis.range().0 + share * length(&basis);
        let mut values = vec![f64::NAN; basis.most_support()];
        let (first, count) = basis.support(q, &mut values);
        let mut all = vec![0.0; basis.len()];
        all[first..first + count].copy_from_slice(&values[..count]);
        prop_assert_eq!(all, basis.value_row(q));
    }

    #[test]
    fn derivatives_by_differences(basis in any_basis(), share in 0.0..1.0_f64) {
        let step = 1e-4 * finest_mm(&basis);
        let Some(q) = away_from_kinks(&basis, share, 3.0 * step) else { return Ok(()) };
        let [b, a, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|n| basis.value_row(q + n * step));
        let differences: Vec<f64> = (0..basis.len())
            .map(|j| (8.0 * (c[j] - a[j]) - (d[j] - b[j])) / (12.0 * step))
            .collect();
        let found = basis.rows(Order::Derivative, &[q]);
        // Round-off of the positions (half an ulp of 500 mm, times a wave's slope 2 pi / finest) and of the values, times
        // the 18/12 of the stencil, over the step: 5e-9 / finest^2; a parabola's values and slopes are up to a hundred
        // times those of a line.
        let bound = 6e-9 * size(&basis) / finest_mm(&basis) * (1.0 + 1.0 / finest_mm(&basis));
        prop_assert!(differ(&found, &differences) < bound, "{:e} {bound:e}", differ(&found, &differences));
    }

    #[test]
    fn integrals_by_quadrature(basis in any_basis(), share in -0.2..1.2_f64) {
        let (low, high) = basis.range();
        let q = low + share * length(&basis);
        let expected = quadrature(&basis, q.clamp(low, high), |_| 1.0);
        let found = basis.rows(Order::Integral, &[q]);
        let bound = 1e-12 * size(&basis) * length(&basis);
        prop_assert!(differ(&found, &expected) < bound, "{:e}", differ(&found, &expected));
    }

    #[test]
    fn tangent_integrals_are_integrals_less_a_line(basis in any_plain(), share in 0.0..1.0_f64) {
        let straightness = Basis::tangent_integral(basis.clone()).unwrap();
        let (low, high) = basis.range();
        let q = low + share * (high - low);
        let at = |position: f64| -> Vec<f64> {
            let (whole, less) = (basis.rows(Order::Integral, &[position]), straightness.value_row(position));
            whole.iter().zip(&less).map(|(a, b)| a - b).collect()
        };
        let (start, here, end) = (at(low), at(q), at(high));
        prop_assert_eq!(largest(straightness.value_row(low)), 0.0);
        for j in 0..basis.len() {
            let line = start[j] + (end[j] - start[j]) * (q - low) / (high - low);
            prop_assert!((here[j] - line).abs() < 1e-13 * length(&basis));
        }
        // And no line is left.
        let middle = 0.5 * (low + high);
        let first = quadrature(&straightness, high, |q| q - middle);
        prop_assert!(largest(first) < 1e-12 * length(&basis).powi(3));
    }

    #[test]
    fn end_values_are_held(basis in any_basis(), beyond in prop_oneof![1e-6..1e4_f64, Just(f64::INFINITY)]) {
        let (low, high) = basis.range();
        for (q, end) in [(low - beyond, low), (high + beyond, high)] {
            prop_assert_eq!(basis.value_row(q), basis.value_row(end));
            prop_assert_eq!(basis.rows(Order::Integral, &[q]), basis.rows(Order::Integral, &[end]));
            prop_assert_eq!(largest(basis.rows(Order::Derivative, &[q])), 0.0);
        }
        prop_assert!(basis.value_row(f64::NAN).iter().all(|value| value.is_nan()));
        prop_assert_eq!(largest(basis.rows(Order::Integral, &[low])), 0.0);
    }

    /// Value and slope agree on both sides of every inner knot that is no kink, and some differ at every kink.
    #[test]
    fn kinks_are_where_a_value_or_slope_breaks(basis in prop_oneof![any_bspline(), any_elements()]) {
        use BasisKind as K;
        let mut knots = match basis.kind() {
            K::BSpline { knots_mm, .. } => knots_mm.clone(),
            K::LinearElements { nodes_mm } | K::QuadraticElements { nodes_mm } => nodes_mm.clone(),
            _ => unreachable!(),
        };
        knots.dedup();
        for basis in [basis.clone(), Basis::tangent_integral(basis).unwrap()] {
            let kinks = basis.kinks();
            prop_assert!(kinks.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert_eq!((kinks[0], kinks[kinks.len() - 1]), basis.range());
            let scale = size(&basis);
            let side = 1e-9;
            for knot in &knots[1..knots.len() - 1] {
                let jump = differ(&basis.value_row(knot - side), &basis.value_row(knot + side)) / scale;
                let slopes = |q| basis.rows(Order::Derivative, &[q]);
                let bend = differ(&slopes(knot - side), &slopes(knot + side)) / scale;
                // Slopes are at most some hundreds a mm, curvatures as many a mm² (steps from 0.5 mm).
                let is_kink = jump > 1e-4 || bend > 1e-4;
                prop_assert_eq!(kinks.contains(knot), is_kink, "at {}: {} {}", knot, jump, bend);
            }
        }
    }
}

#[test]
fn a_parabola_and_a_line_are_held_exactly() {
    let nodes = vec![-30.0, 10.0, 50.0, 55.0, 200.0];
    let parabola = |q: f64| 3.0 - 0.25 * q + 0.01 * q * q;
    let values: Vec<f64> = nodes.iter().map(|&q| parabola(q)).collect();
    let basis = Basis::quadratic_elements(nodes).unwrap();
    for q in [-30.0, -7.0, 33.3, 52.0, 111.0, 200.0] {
        let sum: f64 = basis.value_row(q).iter().zip(&values).map(|(b, value)| b * value).sum();
        assert!((sum - parabola(q)).abs() < 1e-12);
    }
}

/// The three-node element's shape functions as textbooks print them, on a natural coordinate from −1 to 1.
#[test]
fn shape_functions_of_the_textbook() {
    let basis = Basis::quadratic_elements(vec![100.0, 150.0, 200.0]).unwrap();
    for step in 0..=20 {
        let xi = -1.0 + 0.1 * f64::from(step);
        let expected = [-0.5 * xi * (1.0 - xi), 1.0 - xi * xi, 0.5 * xi * (1.0 + xi)];
        assert!(differ(&basis.value_row(150.0 + 50.0 * xi), &expected) < 1e-15);
    }
}

/// de Boor's cardinal cubic: 1/6, 2/3, 1/6 at a knot.
#[test]
fn the_cardinal_cubic() {
    let basis = Basis::bspline((0..12).map(f64::from).collect(), 3).unwrap();
    let row = basis.value_row(5.0);
    assert!(differ(&row[5..8], &[1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0]) < 1e-15);
    assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-15);
}

#[test]
fn derivatives_at_the_ends_are_those_from_inside() {
    let basis = Basis::linear_elements(vec![0.0, 10.0]).unwrap();
    for q in [0.0, 10.0] {
        assert_eq!(basis.rows(Order::Derivative, &[q]), [-0.1, 0.1]);
    }
}
