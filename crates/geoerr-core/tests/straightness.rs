//! Integration and the removed line: polynomials to each rule's order, the gauge, linearity.

use geoerr_core::straightness::{
    Rule, StraightnessError, integrate_straightness, integrate_straightness_into, remove_line,
    remove_line_into,
};
use proptest::prelude::*;

/// Rising positions with steps from 0.5 to 60 mm, from anywhere on a machine.
fn any_positions() -> impl Strategy<Value = Vec<f64>> {
    (-500.0..500.0_f64, prop::collection::vec(0.5..60.0_f64, 1..40)).prop_map(|(start, steps)| {
        let mut positions = vec![start];
        positions.extend(steps.iter().scan(start, |x, step| {
            *x += step;
            Some(*x)
        }));
        positions
    })
}

/// Positions and one value at each.
fn any_function() -> impl Strategy<Value = (Vec<f64>, Vec<f64>)> {
    any_positions().prop_flat_map(|positions| {
        let n_positions = positions.len();
        (Just(positions), prop::collection::vec(-1.0..1.0_f64, n_positions))
    })
}

fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |largest, value| largest.max(value.abs()))
}

fn differ(a: &[f64], b: &[f64]) -> f64 {
    largest(a.iter().zip(b).map(|(x, y)| x - y))
}

/// Slope of the least-squares line of the interpolant over a fine uniform grid: the gauge, done the long way.
fn slope_on_a_grid(positions: &[f64], values: &[f64], n_grid: usize) -> f64 {
    let (first, last) = (positions[0], positions[positions.len() - 1]);
    let middle = 0.5 * (first + last);
    let mut interval = 0;
    let (mut xx, mut xf) = (0.0, 0.0);
    for i in 0..n_grid {
        let x = first + (last - first) * (i as f64 + 0.5) / n_grid as f64;
        while x > positions[interval + 1] {
            interval += 1;
        }
        let t = (x - positions[interval]) / (positions[interval + 1] - positions[interval]);
        xf += (x - middle) * (values[interval] * (1.0 - t) + values[interval + 1] * t);
        xx += (x - middle).powi(2);
    }
    xf / xx
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_slope_is_left_over_a_uniform_grid((positions, values) in any_function()) {
        let n_grid = 20_000;
        let removed = remove_line(&positions, &values).unwrap();
        prop_assert_eq!(removed[0], 0.0);
        let length = positions[positions.len() - 1] - positions[0];
        // The midpoint grid's own error: of first order in its step at the table's kinks.
        let grid_error = 40.0 * largest(values.iter().copied()) / n_grid as f64;
        prop_assert!(slope_on_a_grid(&positions, &removed, n_grid).abs() * length < grid_error);
        // Nothing but a line was taken off.
        let slopes = |f: &[f64]| -> Vec<f64> {
            f.windows(2).zip(positions.windows(2)).map(|(f, x)| (f[1] - f[0]) / (x[1] - x[0])).collect()
        };
        let (before, after) = (slopes(&values), slopes(&removed));
        for (b, a) in before.iter().zip(&after) {
            prop_assert!(((b - a) - (before[0] - after[0])).abs() < 1e-12);
        }
    }

    #[test]
    fn a_line_makes_no_difference(
        (positions, values) in any_function(), constant in -10.0..10.0_f64, slope in -0.1..0.1_f64,
    ) {
        let with_line: Vec<f64> =
            positions.iter().zip(&values).map(|(x, value)| value + constant + slope * x).collect();
        let (a, b) = (remove_line(&positions, &values).unwrap(), remove_line(&positions, &with_line).unwrap());
        // The sum is up to 200, and rounded before the line is known.
        prop_assert!(differ(&a, &b) < 200.0 * 8.0 * f64::EPSILON);
    }

    #[test]
    fn a_sample_on_the_interpolant_makes_no_difference(
        (positions, values) in any_function(), where_to in 0.0..1.0_f64, t in 0.1..0.9_f64,
    ) {
        let k = ((positions.len() - 1) as f64 * where_to) as usize;
        let (mut finer, mut denser) = (positions.clone(), values.clone());
        finer.insert(k + 1, positions[k] * (1.0 - t) + positions[k + 1] * t);
        denser.insert(k + 1, values[k] * (1.0 - t) + values[k + 1] * t);
        let coarse = remove_line(&positions, &values).unwrap();
        let mut fine = remove_line(&finer, &denser).unwrap();
        fine.remove(k + 1);
        // A position near 1000 mm is rounded by 10⁻¹³ mm, where the table's slope may be 4/mm.
        prop_assert!(differ(&coarse, &fine) < 1e-11);
    }

    #[test]
    fn integration_is_linear((positions, values) in any_function(), other in prop::collection::vec(-1.0..1.0_f64, 40),
        factor in -3.0..3.0_f64) {
        let n_positions = positions.len();
        let other = &other[..n_positions];
        let mixed: Vec<f64> = values.iter().zip(other).map(|(a, b)| a + factor * b).collect();
        let mut batch = values.clone();
        batch.extend(other);
        batch.extend(&mixed);
        for rule in [Rule::Trapezoid, Rule::Simpson] {
            let result = integrate_straightness(&positions, &batch, rule).unwrap();
            let (a, rest) = result.split_at(n_positions);
            let (b, c) = rest.split_at(n_positions);
            let sum: Vec<f64> = a.iter().zip(b).map(|(a, b)| a + factor * b).collect();
            // Steps of very different length make Simpson weights of up to 60³/(6·0.5·60) mm.
            prop_assert!(differ(&sum, c) < 1e-9);
        }
    }

    #[test]
    fn an_identity_matrix_gives_the_operator((positions, values) in any_function()) {
        let n_positions = positions.len();
        let identity: Vec<f64> =
            (0..n_positions * n_positions).map(|i| f64::from(i % (n_positions + 1) == 0)).collect();
        let operator = integrate_straightness(&positions, &identity, Rule::Trapezoid).unwrap();
        let direct = integrate_straightness(&positions, &values, Rule::Trapezoid).unwrap();
        let through: Vec<f64> = (0..n_positions)
            .map(|i| (0..n_positions).map(|k| values[k] * operator[k * n_positions + i]).sum())
            .collect();
        prop_assert!(differ(&through, &direct) < 1e-10);
    }

    /// Eight are added up side by side, the last of them one by one; one without a number is alone in that.
    #[test]
    fn a_function_is_integrated_among_others_as_alone(
        positions in any_positions(), n_functions in 1..20_usize, without in 0..20_usize,
        all in prop::collection::vec(-1.0..1.0_f64, 20 * 40),
    ) {
        let n_positions = positions.len();
        let mut values = all[..n_functions * n_positions].to_vec();
        let without = without % n_functions;
        values[without * n_positions + n_positions / 2] = f64::INFINITY;
        for rule in [Rule::Trapezoid, Rule::Simpson] {
            let together = integrate_straightness(&positions, &values, rule).unwrap();
            for (number, (own, among)) in
                values.chunks(n_positions).zip(together.chunks(n_positions)).enumerate()
            {
                if number == without {
                    prop_assert!(among.iter().all(|value| value.is_nan()));
                    continue;
                }
                let alone = integrate_straightness(&positions, own, rule).unwrap();
                prop_assert_eq!(&alone[..], among);
            }
        }
    }

    /// Simpson integrates a parabola exactly on any spacing, the trapezoid a line.
    #[test]
    fn polynomials_are_exact_to_the_order_of_the_rule(
        positions in any_positions(), c in prop::array::uniform3(-1.0..1.0_f64),
    ) {
        let middle = 0.5 * (positions[0] + positions[positions.len() - 1]);
        for (rule, least_points, quadratic) in [(Rule::Trapezoid, 2, 0.0), (Rule::Simpson, 3, c[2])] {
            prop_assume!(positions.len() >= least_points);
            let unit = |x: f64| (x - middle) / 500.0;
            let angle: Vec<f64> =
                positions.iter().map(|&x| c[0] + c[1] * unit(x) + quadratic * unit(x).powi(2)).collect();
            let integral: Vec<f64> = positions
                .iter()
                .map(|&x| {
                    let t = unit(x);
                    500.0 * (c[0] * t + c[1] * t.powi(2) / 2.0 + quadratic * t.powi(3) / 3.0)
                })
                .collect();
            let found = integrate_straightness(&positions, &angle, rule).unwrap();
            let expected = remove_line(&positions, &integral).unwrap();
            // Integrals up to 1000, Simpson weights up to 1200 mm, forty terms.
            prop_assert!(differ(&found, &expected) < 1e-10, "{:?}", rule);
        }
    }
}

#[test]
fn another_number_of_results_is_refused_and_left_alone() {
    let (positions, values) = ([0.0, 10.0, 20.0], [1.0, 2.0, 4.0]);
    let expected = Err(StraightnessError::OtherNumberOfResults { found: 2, needed: 3 });
    let mut results = [7.0; 2];
    assert_eq!(integrate_straightness_into(&positions, &values, Rule::Trapezoid, &mut results), expected);
    assert_eq!(remove_line_into(&positions, &values, &mut results), expected);
    assert_eq!(results, [7.0; 2]);
}

#[test]
fn simpson_beats_the_trapezoid_on_a_smooth_angle() {
    let positions: Vec<f64> = (0..41).map(|i| 10.0 * f64::from(i)).collect();
    let wave = 2.0 * std::f64::consts::PI / 250.0;
    let angle: Vec<f64> = positions.iter().map(|x| (wave * x).sin()).collect();
    let integral: Vec<f64> = positions.iter().map(|x| -(wave * x).cos() / wave).collect();
    let exact = remove_line(&positions, &integral).unwrap();
    let error = |rule| {
        differ(&integrate_straightness(&positions, &angle, rule).unwrap(), &exact)
            / largest(exact.iter().copied())
    };
    // h²k²/12 and h³k³/24 of the amplitude, up to twice that from end to end.
    let step = 10.0 * wave;
    assert!(error(Rule::Trapezoid) < step.powi(2) / 6.0);
    assert!(error(Rule::Simpson) < step.powi(3) / 12.0);
    assert!(error(Rule::Simpson) < error(Rule::Trapezoid) / 5.0);
}

#[test]
fn a_bad_function_leaves_the_others_alone() {
    let positions = [0.0, 10.0, 30.0];
    let good = [1.0, 4.0, -2.0];
    let mut batch = good.to_vec();
    batch.extend([1.0, f64::NAN, 2.0]);
    batch.extend([1.0, f64::INFINITY, 2.0]);
    batch.extend(good);
    for rule in [Rule::Trapezoid, Rule::Simpson] {
        let found = integrate_straightness(&positions, &batch, rule).unwrap();
        assert!(found[3..9].iter().all(|value| value.is_nan()));
        assert_eq!(found[..3], found[9..]);
        assert!(found[..3].iter().all(|value| value.is_finite()));
    }
    assert!(remove_line(&positions, &batch).unwrap()[3..9].iter().all(|value| value.is_nan()));
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let positions: Vec<f64> = (0..101).map(|i| f64::from(i) * 3.7).collect();
    let values: Vec<f64> = (0..101 * 2000).map(|i| (f64::from(i) * 0.618).fract()).collect();
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| integrate_straightness(&positions, &values, Rule::Simpson).unwrap())
    };
    let one = with_threads(1);
    for threads in [2, 8] {
        let other = with_threads(threads);
        assert!(one.iter().zip(&other).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
    let alone = integrate_straightness(&positions, &values[101..202], Rule::Simpson).unwrap();
    assert_eq!(alone, one[101..202]);
}

#[test]
fn two_positions_hold_a_line_and_nothing_else() {
    for rule in [Rule::Trapezoid, Rule::Simpson] {
        assert_eq!(integrate_straightness(&[1.0, 3.0], &[5.0, 7.0], rule).unwrap(), [0.0, 0.0]);
    }
}

#[test]
fn positions_and_values_that_do_not_fit_are_refused() {
    let refuse = |positions: &[f64], values: &[f64]| {
        let error = remove_line(positions, values).unwrap_err();
        assert_eq!(integrate_straightness(positions, values, Rule::Trapezoid).unwrap_err(), error);
        error
    };
    assert_eq!(refuse(&[1.0], &[1.0]), StraightnessError::TooFewPositions { found: 1 });
    assert_eq!(
        refuse(&[0.0, 2.0, 1.0], &[0.0; 3]),
        StraightnessError::PositionsNotRising { index: 2, previous_mm: 2.0, position_mm: 1.0 }
    );
    assert_eq!(
        refuse(&[0.0, 2.0, 2.0], &[0.0; 3]),
        StraightnessError::PositionsNotRising { index: 2, previous_mm: 2.0, position_mm: 2.0 }
    );
    assert!(matches!(
        refuse(&[0.0, f64::INFINITY, 2.0], &[0.0; 3]),
        StraightnessError::PositionNotFinite { index: 1, .. }
    ));
    assert_eq!(
        refuse(&[0.0, 1.0, 2.0], &[0.0; 4]),
        StraightnessError::NotWholeFunctions { found: 4, n_positions: 3 }
    );
    assert!(remove_line(&[0.0, 1.0], &[]).unwrap().is_empty());
}
