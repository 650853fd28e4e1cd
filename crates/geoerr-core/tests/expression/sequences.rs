//! Lags and wind-up along sequences of rows.

use geoerr_core::expression::Expression;

use super::common::{assert_near, definitions, evaluate, noise, parse, symbols};

fn lagged(u: &[f64], t: Option<&[f64]>, tau: f64) -> Vec<f64> {
    evaluate(&parse("lag(u, tau)", &symbols("u", "", "tau")), &[u], &[], t, &[], &[tau])
}

fn held(u: &[f64], t: Option<&[f64]>, tau: f64) -> Vec<f64> {
    evaluate(&parse("lag(mean_v_x, tau)", &symbols("mean_v_x", "", "tau")), &[u], &[], t, &[], &[tau])
}

#[test]
fn a_ramp_is_followed_as_the_equation_says() {
    // u = 3 + 0.4 t: y = u − 0.4 τ (1 − e^(−t/τ)), exactly, on any times.
    let t: Vec<f64> = noise(60, 5)
        .iter()
        .scan(0.0, |t, step| {
            *t += step + 0.55;
            Some(*t - 0.55)
        })
        .collect();
    let u: Vec<f64> = t.iter().map(|t| 3.0 + 0.4 * t).collect();
    for tau in [1e-6, 0.02, 1.0, 30.0, 1e6] {
        let found = lagged(&u, Some(&t), tau);
        for (row, &y) in found.iter().enumerate() {
            let expected = u[row] + 0.4 * tau * (-(t[row] - t[0]) / tau).exp_m1();
            assert_near(y, expected, 1e-13, &format!("τ {tau} row {row}"));
        }
    }
}

#[test]
fn a_step_is_followed_as_the_equation_says() {
    // The input jumps to 1 between the first two rows and is constant over every step.
    let t = [0.0, 0.5, 0.7, 3.0, 3.1];
    let found = held(&[0.0, 1.0, 1.0, 1.0, 1.0], Some(&t), 0.8);
    for (&t, y) in t.iter().zip(found) {
        assert_near(y, 1.0 - (-t / 0.8_f64).exp(), 1e-14, "step");
    }
}

#[test]
fn finer_steps_of_the_same_input_change_nothing() {
    let t: Vec<f64> = (0..20).map(|k| f64::from(k * k) * 0.1).collect();
    let u = noise(20, 3);
    let fine_t: Vec<f64> =
        t.windows(2).flat_map(|p| [p[0], 0.25 * p[0] + 0.75 * p[1]]).chain([t[19]]).collect();
    let fine_u: Vec<f64> =
        u.windows(2).flat_map(|p| [p[0], 0.25 * p[0] + 0.75 * p[1]]).chain([u[19]]).collect();
    let (coarse, fine) = (lagged(&u, Some(&t), 0.6), lagged(&fine_u, Some(&fine_t), 0.6));
    for (row, &y) in coarse.iter().enumerate() {
        assert_near(fine[2 * row], y, 1e-13, "straight");
    }
    // A mean holds over the step before its row, so the rows on the way have the value of the row that they lead to.
    let fine_u: Vec<f64> = u.windows(2).flat_map(|p| [p[0], p[1]]).chain([u[19]]).collect();
    let (coarse, fine) = (held(&u, Some(&t), 0.6), held(&fine_u, Some(&fine_t), 0.6));
    for (row, &y) in coarse.iter().enumerate() {
        assert_near(fine[2 * row], y, 1e-13, "held");
    }
}

#[test]
fn without_times_rows_are_counted() {
    let u = noise(30, 9);
    let t: Vec<f64> = (0..30).map(f64::from).collect();
    assert_eq!(lagged(&u, None, 2.5), lagged(&u, Some(&t), 2.5));
}

#[test]
fn limits_of_the_time_constant() {
    let u = noise(10, 2);
    assert_eq!(lagged(&u, None, 0.0), u);
    for (y, u) in lagged(&u, None, 1e-9).iter().zip(&u) {
        assert_near(*y, *u, 1e-8, "τ towards 0");
    }
    assert_eq!(lagged(&u, None, f64::INFINITY), vec![u[0]; 10]);
    assert!(lagged(&u, None, -1.0).iter().all(|y| y.is_nan()));
}

#[test]
fn rows_that_cannot_be_used_leave_no_trace() {
    let (mut u, mut t) = (noise(12, 4), (0..12).map(f64::from).collect::<Vec<_>>());
    let keep = [1, 2, 3, 5, 8, 9, 10, 11];
    u[0] = f64::NAN;
    u[4] = f64::NAN;
    t[6] = f64::NAN;
    t[7] = 2.0;
    let found = lagged(&u, Some(&t), 1.5);
    let good = |values: &[f64]| keep.map(|row| values[row]);
    assert_eq!(good(&found).to_vec(), lagged(&good(&u), Some(&good(&t)), 1.5));
    assert!([0, 4, 6, 7].iter().all(|&row| found[row].is_nan()));
}

#[test]
fn one_moment_seen_twice_is_one_moment() {
    let u = [1.0, 3.0, 3.0, 3.0, 2.0];
    let t = [0.0, 1.0, 1.0, 1.0, 2.0];
    let found = lagged(&u, Some(&t), 0.7);
    let once = lagged(&[1.0, 3.0, 2.0], Some(&[0.0, 1.0, 2.0]), 0.7);
    assert_eq!(found, [once[0], once[1], once[1], once[1], once[2]]);
}

#[test]
fn inside_a_lag_a_speed_is_the_mean_since_the_previous_row() {
    let symbols = symbols("v_x mean_v_x T", "k", "tau");
    let pairs = definitions(&[("v", "v_x"), ("heat", "abs(v)*2")]);
    let expression = Expression::parse("k*lag(heat, tau) + k*heat", &symbols, &pairs).unwrap();
    let (v, mean) = ([9.0, 9.0, 9.0], [0.0, -4.0, 2.0]);
    let columns: [&[f64]; 3] = [&v, &mean, &[]];
    let found = evaluate(&expression, &columns, &[], None, &[1.0], &[1.3]);
    let a = (-1.0 / 1.3_f64).exp();
    let second = 8.0 * (1.0 - a);
    let expected = [0.0, second, second * a + 4.0 * (1.0 - a)].map(|y| y + 18.0);
    for (found, expected) in found.iter().zip(expected) {
        assert_near(*found, expected, 1e-14, "heat");
    }
}

#[test]
fn a_lag_in_a_lag_follows_a_value_and_not_a_mean() {
    let symbols = symbols("mean_v_x y", "", "");
    let nested = parse("lag(lag(mean_v_x, 2), 3)", &symbols);
    let outer = parse("lag(y, 3)", &symbols);
    let mean = noise(20, 8);
    let inner = held(&mean, None, 2.0);
    let zero = vec![0.0; 20];
    assert_eq!(
        evaluate(&nested, &[&mean, &zero], &[], None, &[], &[]),
        evaluate(&outer, &[&mean, &inner], &[], None, &[], &[])
    );
}

fn wound(d: &[f64], s: &[f64], starts: &[usize], lambda: f64) -> Vec<f64> {
    let expression = parse("b*windup(lambda)", &symbols("d s", "b", "lambda"));
    evaluate(&expression, &[d, s], starts, None, &[2.0], &[lambda])
}

#[test]
fn wind_up_after_long_strokes_has_its_closed_form() {
    // b = 2: −(b/2) d (1 − 2 e^(−s/λ)).
    let s = [0.0, 1.0, 3.0, 1e4, 0.5, 2.0, 1e4, 0.0];
    let d = [1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0];
    for (row, w) in wound(&d, &s, &[], 1.5).into_iter().enumerate() {
        let expected = -d[row] * (1.0 - 2.0 * (-s[row] / 1.5_f64).exp());
        assert_near(w, expected, 1e-15, &format!("row {row}"));
    }
}

#[test]
fn wind_up_is_midway_where_nobody_knows_from_where_the_axis_came() {
    // Rows before the first direction leave no trace: the others are as without them.
    let (d, s) = ([0.0, 0.0, 1.0, 1.0, -1.0], [1e9, 1e9, 0.5, 1.0, 0.4]);
    let found = wound(&d, &s, &[], 1.5);
    assert_eq!(found[..2], [0.0, 0.0]);
    assert_eq!(found[2..], wound(&d[2..], &s[2..], &[], 1.5));
    // Between known rows too.
    let found = wound(&[1.0, 0.0, 1.0, -1.0], &[1.0, 1.0, 2.0, 0.4], &[], 1.5);
    let without = wound(&[1.0, 1.0, -1.0], &[1.0, 2.0, 0.4], &[], 1.5);
    assert_eq!(found, [without[0], 0.0, without[1], without[2]]);
    assert!(wound(&[0.0], &[1.0], &[], -1.0)[0].is_nan());
}

#[test]
fn wind_up_after_a_short_stroke_starts_where_it_was() {
    let (b, lambda) = (2.0, 1.5_f64);
    let d = [1.0, 1.0, -1.0, -1.0, 1.0];
    let s = [1.0, 2.0, 0.4, 0.9, 0.7];
    let found = wound(&d, &s, &[], lambda);
    let after = |e_rev: f64, d: f64, s: f64| -b * d / 2.0 + (e_rev + b * d / 2.0) * (-s / lambda).exp();
    let first = [after(b / 2.0, 1.0, 1.0), after(b / 2.0, 1.0, 2.0)];
    let second = [after(first[1], -1.0, 0.4), after(first[1], -1.0, 0.9)];
    let third = after(second[1], 1.0, 0.7);
    for (found, expected) in found.iter().zip([first[0], first[1], second[0], second[1], third]) {
        assert_near(*found, expected, 1e-15, "short stroke");
    }
}

#[test]
fn wind_up_is_continuous_and_bounded() {
    // Small steps there and back by strokes of all lengths: no step is larger than b/λ allows, none leaves ±b/2.
    let (mut d, mut s) = (Vec::new(), Vec::new());
    for stroke in 0..40 {
        let steps = 3 + (stroke * 37) % 50;
        for step in 0..=steps {
            d.push(if stroke % 2 == 0 { 1.0 } else { -1.0 });
            s.push(f64::from(step) * 0.02);
        }
    }
    let found = wound(&d, &s, &[], 0.3);
    for pair in found.windows(2) {
        // |dw/ds| ≤ b/λ with b = 2.
        assert!((pair[1] - pair[0]).abs() <= 2.0 / 0.3 * 0.02 + 1e-12);
    }
    assert!(found.iter().all(|w| w.abs() <= 1.0 + 1e-12));
}

#[test]
fn wind_up_limits() {
    // λ = 0 is backlash; no travel is the value before the reversal.
    assert_eq!(wound(&[1.0, -1.0], &[1.0, 3.0], &[], 0.0), [-1.0, 1.0]);
    assert_eq!(wound(&[1.0, -1.0], &[0.0, 0.0], &[], 2.0), [1.0, 1.0]);
    assert!(wound(&[1.0], &[1.0], &[], -1.0)[0].is_nan());
    // Unknown directions and travels leave no trace, nor does a direction of 0: midway.
    let nan = f64::NAN;
    let found = wound(&[1.0, nan, 0.0, -1.0, -1.0], &[1.0, 5.0, 5.0, nan, 0.5], &[], 2.0);
    let without = wound(&[1.0, -1.0], &[1.0, 0.5], &[], 2.0);
    assert!(found[1].is_nan() && found[2] == 0.0 && found[3].is_nan());
    assert_eq!([found[0], found[4]], [without[0], without[1]]);
    // Away and back between two rows: after a long stroke again.
    let found = wound(&[1.0, 1.0, 1.0], &[5.0, 6.0, 0.5], &[], 2.0);
    assert_near(found[2], -(1.0 - 2.0 * (-0.25_f64).exp()), 1e-15, "away and back");
}

#[test]
fn wind_up_begins_settled_where_nothing_has_shown_a_reversal() {
    let (nan, lambda) = (f64::NAN, 2.0_f64);
    // b = 2. At rest, then on in the same direction: −(b/2) d throughout; then back, after a long stroke.
    let found = wound(&[1.0, 1.0, 1.0, 1.0, -1.0], &[nan, nan, 0.5, 3.0, 0.7], &[], lambda);
    assert_eq!(found[..4], [-1.0; 4]);
    assert_near(found[4], 1.0 - 2.0 * (-0.7 / lambda).exp(), 1e-15, "back");
    // Each sequence begins so, in its own direction.
    assert_eq!(wound(&[1.0, -1.0, -1.0], &[nan, nan, 4.0], &[0, 1], lambda), [-1.0, 1.0, 1.0]);
    // Back at once; without knowing how far, it is not known until travel is shown again.
    let found = wound(&[1.0, -1.0, -1.0], &[nan, nan, 0.4], &[], lambda);
    assert!(found[1].is_nan());
    assert_near(found[2], 1.0 - 2.0 * (-0.4 / lambda).exp(), 1e-15, "shown again");
    // Lost later on: not known.
    assert!(wound(&[1.0, 1.0], &[3.0, nan], &[], lambda)[1].is_nan());
    assert!(wound(&[nan], &[nan], &[], lambda)[0].is_nan());
    // Where it is settled, λ does not matter.
    let expression = parse("b*windup(lambda)", &symbols("d s", "b", "lambda"));
    let columns: [&[f64]; 2] = [&[1.0, 1.0, -1.0], &[nan, 0.5, 0.7]];
    let rows = geoerr_core::expression::Rows { variables: &columns, n_rows: 3, starts: &[], t: None };
    let mut slopes = vec![nan; 3];
    expression.inner_derivatives(&rows, 0..3, &[2.0], &[lambda], &mut slopes).unwrap();
    assert_eq!(slopes[..2], [0.0; 2]);
    assert_near(slopes[2], -2.0 * 0.7 / lambda.powi(2) * (-0.7 / lambda).exp(), 1e-15, "slope");
}

#[test]
fn a_sequence_begins_anew_and_parts_cost_nothing_but_time() {
    let symbols = symbols("x d s", "k b", "tau lambda");
    let expression = parse("k*lag(x, tau) + b*windup(lambda)", &symbols);
    let n = 9000;
    let (x, turns) = (noise(n, 1), noise(n, 2));
    let d: Vec<f64> = turns.iter().map(|turn| if turn.abs() < 0.25 { 1.0 } else { -1.0 }).collect();
    let s: Vec<f64> = x.iter().map(|x| x.abs()).collect();
    let starts: Vec<usize> = [0, 1, 2, 255, 256, 257, 700, 5000, 8999].to_vec();
    let columns: [&[f64]; 3] = [&x, &d, &s];
    let whole = evaluate(&expression, &columns, &starts, None, &[1.0, 2.0], &[3.0, 0.2]);
    for (index, &start) in starts.iter().enumerate() {
        let end = starts.get(index + 1).copied().unwrap_or(n);
        let part: Vec<&[f64]> = columns.iter().map(|column| &column[start..end]).collect();
        assert_eq!(evaluate(&expression, &part, &[], None, &[1.0, 2.0], &[3.0, 0.2]), whole[start..end]);
    }
    // A range that begins within a sequence knows what came before it.
    let rows = geoerr_core::expression::Rows { variables: &columns, n_rows: n, starts: &starts, t: None };
    for range in [0..n, 3..9, 300..300, 300..301, 699..702, 1500..8000, 8999..9000] {
        let mut out = vec![f64::NAN; range.len()];
        expression.evaluate(&rows, range.clone(), &[1.0, 2.0], &[3.0, 0.2], &mut out).unwrap();
        assert_eq!(out, whole[range.clone()], "{range:?}");
    }
}

#[test]
fn at_one_position_history_is_settled() {
    let symbols = symbols("x T d s", "k b", "tau lambda");
    let expression = parse("k*x*lag(T, tau) + b*windup(lambda)", &symbols);
    let (value, gradient) =
        expression.evaluate_at(&[50.0, 8.0, -1.0, 0.6], &[3.0, 2.0], &[100.0, 0.5]).unwrap();
    assert_near(value, 3.0 * 50.0 * 8.0 + (1.0 - 2.0 * (-0.6_f64 / 0.5).exp()), 1e-15, "settled");
    assert_eq!(gradient, [24.0, 0.0, 0.0]);
}
