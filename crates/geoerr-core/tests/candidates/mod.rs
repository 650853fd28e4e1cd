//! Candidates judged at once, against least squares written out for one after the other.

mod scene;

use geoerr_core::candidates::{CandidateError, Column, Formula, Group, Scanned, Sources, scan};
use geoerr_core::expression::{Definitions, Expression, Rows, Symbols};
use proptest::prelude::*;
use scene::Drawn;

use crate::draws::Draws;

fn formula(text: &str, coefficients: &[&str]) -> Expression {
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    let symbols = Symbols {
        variables: names(&["x", "clock", "followed"]),
        coefficients: names(coefficients),
        inner: names(&["p"]),
    };
    Expression::parse(text, &symbols, &Definitions::default()).unwrap()
}

fn group(columns: &[(usize, f64, usize)], functions: Vec<usize>) -> Group {
    let n_coefficients = columns.iter().map(|column| column.2 + 1).max().unwrap_or(0);
    let columns = (columns.iter())
        .map(|&(channel, factor, coefficient)| Column { channel, factor, coefficient })
        .collect();
    Group { n_coefficients, columns, functions }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn gains_are_those_of_least_squares(
        seed in any::<u64>(),
        n_rows in 12_usize..40,
        rows_of_a_moment in 1_usize..4,
    ) {
        let drawn = Drawn::new(seed, n_rows, 4, 3, 4);
        let mut draws = Draws::new(seed ^ 1);
        // Points of one moment differ in the second of those given alone.
        let mut of_moments = |rows_of_a_moment: usize| -> Vec<f64> {
            let column = draws.column(n_rows);
            (0..n_rows).map(|row| column[row - row % rows_of_a_moment]).collect()
        };
        let given: Vec<Vec<f64>> =
            [rows_of_a_moment, 1, rows_of_a_moment].into_iter().map(&mut of_moments).collect();
        let given: Vec<&[f64]> = given.iter().map(Vec::as_slice).collect();
        let (x, followed) = (of_moments(rows_of_a_moment), of_moments(rows_of_a_moment));
        let t: Vec<f64> = (0..n_rows).map(|row| (row / rows_of_a_moment) as f64).collect();
        let wave = formula("a*sin(x/p) + b*cos(x/p)", &["a", "b"]);
        let follows = formula("a*followed*x*p", &["a"]);
        let formulas = [
            Formula { expression: wave.clone(), inner: vec![0.2], series: None, is_proportional: false },
            Formula { expression: wave, inner: vec![0.1], series: None, is_proportional: false },
            Formula { expression: follows, inner: vec![2.0], series: Some([2, 0]), is_proportional: false },
        ];
        let empty = vec![0.0; n_rows];
        let rows = Rows { variables: &[&x, &empty, &empty], n_rows, starts: &[], t: Some(&t) };
        let sources = Sources { rows, formulas: &formulas, series: &[&followed], given: &given, products: &[[0, 2]] };
        // Functions: 0–3 the two waves, 4 what follows, 5–7 given, 8 their product.
        let waves = |p: f64| [x.iter().map(|x| (x / p).sin()).collect(), x.iter().map(|x| (x / p).cos()).collect()];
        let [w0, w1] = waves(0.2);
        let [w2, w3] = waves(0.1);
        let f4: Vec<f64> = followed.iter().zip(&x).map(|(a, b)| 2.0 * a * b).collect();
        let f8: Vec<f64> = given[0].iter().zip(given[2]).map(|(a, b)| a * b).collect();
        let wave_parts = [(1, 1.0, 0), (1, 1.0, 1)];
        let other_parts = [(0, 1.0, 0), (3, -0.5, 0), (2, 1.0, 1)];
        let groups = [
            group(&wave_parts, vec![0, 1, 2, 3]),
            group(&other_parts, vec![4, 8, 5]),
            group(&other_parts, vec![4, 8, 6]),
        ];
        let expected = [
            drawn.judged(&drawn.columns(&wave_parts, &[w0, w1], 2)),
            drawn.judged(&drawn.columns(&wave_parts, &[w2, w3], 2)),
            drawn.judged(&drawn.columns(&other_parts, &[f4.clone(), f8.clone(), given[0].to_vec()], 2)),
            drawn.judged(&drawn.columns(&other_parts, &[f4, f8, given[1].to_vec()], 2)),
        ];
        let found = scan(&drawn.scene::<f64>(), &sources, &groups).unwrap();
        let coarse = scan(&drawn.scene::<f32>(), &sources, &groups).unwrap();
        for ((group, trial), (gain, of_draws, rank)) in [(0, 0), (0, 1), (1, 0), (2, 0)].into_iter().zip(expected) {
            prop_assert_eq!(found[group].rank[trial], rank);
            prop_assert!((found[group].gain[trial] - gain).abs() < 1e-9 * (1.0 + gain));
            prop_assert!((coarse[group].gain[trial] - gain).abs() < 1e-3 * (1.0 + gain));
            if group > 0 {
                for (one, other) in found[group].largest[rank].iter().zip(of_draws) {
                    prop_assert!((one - other).abs() < 1e-9 * (1.0 + other));
                }
            }
        }
    }
}

/// Waves along x at as many periods, jumps in time, and both in single and double precision.
fn waves_and_jumps(x: &[f64], drawn: &Drawn, n_trials: usize) -> [Vec<Scanned>; 2] {
    let wave = formula("a*sin(x/p) + b*cos(x/p)", &["a", "b"]);
    coarse_and_exact(x, drawn, &wave, (0..n_trials).map(|trial| 0.02 * 1.15_f64.powf(trial as f64)).collect())
}

/// Waves of multiples of one frequency, which are summed all at once, and jumps.
fn harmonics_and_jumps(x: &[f64], drawn: &Drawn, step: f64, harmonics: impl Iterator<Item = u32>) {
    let wave = formula("b*cos(2*pi*x/p) + a*sin(2*pi*x/p)", &["a", "b"]);
    let periods = harmonics.map(|harmonic| 1.0 / (f64::from(harmonic) * step)).collect();
    assert_alike(coarse_and_exact(x, drawn, &wave, periods));
}

fn coarse_and_exact(x: &[f64], drawn: &Drawn, wave: &Expression, periods: Vec<f64>) -> [Vec<Scanned>; 2] {
    let (n_rows, n_trials) = (drawn.n_rows, periods.len());
    let clock: Vec<f64> = (0..n_rows).map(|row| row as f64).collect();
    let jump = formula("a*step(clock - p)", &["a"]);
    let mut formulas = Vec::new();
    for period in periods {
        formulas.push(Formula {
            expression: wave.clone(),
            inner: vec![period],
            series: None,
            is_proportional: false,
        });
    }
    for trial in 0..n_trials {
        let moment = (trial + 1) as f64 / (n_trials + 1) as f64 * n_rows as f64;
        formulas.push(Formula {
            expression: jump.clone(),
            inner: vec![moment],
            series: None,
            is_proportional: false,
        });
    }
    let empty = vec![0.0; n_rows];
    let rows = Rows { variables: &[x, &clock, &empty], n_rows, starts: &[], t: None };
    let sources = Sources { rows, formulas: &formulas, series: &[], given: &[], products: &[] };
    let groups = [
        group(
            &[(0, 1.0, 0), (0, 1.0, 1), (1, 1.0, 2), (1, 1.0, 3)],
            (0..n_trials).flat_map(|trial| [2 * trial, 2 * trial + 1, 2 * trial, 2 * trial + 1]).collect(),
        ),
        group(&[(2, 1.0, 0)], (2 * n_trials..3 * n_trials).collect()),
        // Waves of two frequencies, whose products with each other no transform has.
        group(
            &[(0, 1.0, 0), (1, 1.0, 1)],
            (1..n_trials).flat_map(|trial| [2 * trial, 2 * (trial - 1) + 1]).collect(),
        ),
    ];
    [
        scan(&drawn.scene::<f32>(), &sources, &groups).unwrap(),
        scan(&drawn.scene::<f64>(), &sources, &groups).unwrap(),
    ]
}

fn assert_alike([coarse, exact]: [Vec<Scanned>; 2]) {
    for (coarse, exact) in coarse.iter().zip(&exact) {
        assert_eq!(coarse.rank, exact.rank);
        for (a, b) in coarse.gain.iter().zip(&exact.gain) {
            assert!((a - b).abs() < 2e-3 * (1.0 + b), "{a} is not {b}");
        }
        for (a, b) in coarse.largest.iter().flatten().zip(exact.largest.iter().flatten()) {
            assert!((a - b).abs() < 2e-3 * (1.0 + b.abs()), "{a} is not {b}");
        }
    }
}

#[test]
fn splines_between_nodes_are_the_waves_themselves() {
    let drawn = Drawn::new(5, 600, 5, 4, 3);
    let x = Draws::new(6).column(600);
    assert_alike(waves_and_jumps(&x, &drawn, 24));
}

#[test]
fn few_places_are_nodes_of_their_own() {
    let drawn = Drawn::new(7, 600, 5, 4, 3);
    let x: Vec<f64> = Draws::new(8).column(600).iter().map(|x| (20.0 * x).round() / 20.0).collect();
    assert_alike(waves_and_jumps(&x, &drawn, 24));
}

#[test]
fn a_row_without_a_place_has_no_wave() {
    let drawn = Drawn::new(9, 600, 5, 4, 3);
    let mut x = Draws::new(10).column(600);
    x.iter_mut().step_by(7).for_each(|x| *x = f64::NAN);
    assert_alike(waves_and_jumps(&x, &drawn, 24));
}

#[test]
fn harmonics_are_summed_at_all_frequencies_at_once() {
    let drawn = Drawn::new(11, 600, 5, 4, 3);
    let x: Vec<f64> = Draws::new(12).column(600).iter().map(|x| 30.0 * x - 7.0).collect();
    harmonics_and_jumps(&x, &drawn, 0.013, 1..150);
    // Not all of them, and shortest periods first, as a grid over periods has them.
    harmonics_and_jumps(&x, &drawn, 0.013, (20..400).rev().step_by(3));
    // One so far from the others that the frequencies between them would be most of the work.
    harmonics_and_jumps(&x, &drawn, 0.013, (1..70).chain([1_000_003]));
}

#[test]
fn a_row_without_a_place_has_no_harmonic() {
    let drawn = Drawn::new(13, 600, 5, 4, 3);
    let mut x = Draws::new(14).column(600);
    x.iter_mut().step_by(7).for_each(|x| *x = f64::NAN);
    harmonics_and_jumps(&x, &drawn, 0.4, 1..90);
}

#[test]
fn a_harmonic_that_is_0_at_all_places_is_not_measured() {
    // Even steps of 0.5: the sine of period 0.5 is nothing but rounding there, and nothing is said of it.
    let drawn = Drawn::new(15, 600, 5, 4, 3);
    let x: Vec<f64> = (0..600).map(|row| 0.5 * f64::from(row % 40) + 1e-7 * f64::from(row % 7)).collect();
    let wave = formula("a*sin(2*pi*x/p)", &["a"]);
    let clock: Vec<f64> = (0..600).map(f64::from).collect();
    let formulas: Vec<Formula> = (1..=100)
        .map(|k| Formula {
            expression: wave.clone(),
            inner: vec![20.0 / f64::from(k)],
            series: None,
            is_proportional: false,
        })
        .collect();
    let empty = vec![0.0; 600];
    let rows = Rows { variables: &[&x, &clock, &empty], n_rows: 600, starts: &[], t: None };
    let sources = Sources { rows, formulas: &formulas, series: &[], given: &[], products: &[] };
    let found = scan(&drawn.scene::<f32>(), &sources, &[group(&[(1, 1.0, 0)], (0..100).collect())]).unwrap();
    assert!([39, 79].iter().all(|&trial| found[0].rank[trial] == 0 && found[0].gain[trial] == 0.0));
    assert_eq!(found[0].rank[38], 1);
}

/// What follows a series that warms and cools at every session, at lags of all lengths, times a place and alone.
#[test]
fn multiples_of_many_series_are_sums_of_few_columns() {
    // More rows than a block of the series has, and a last block that is not full.
    let drawn = Drawn::new(11, 700, 5, 4, 4);
    let n_rows = drawn.n_rows;
    let x = Draws::new(12).column(n_rows);
    let noise = Draws::new(13).column(n_rows);
    let lagged = |lag: f64| -> Vec<f64> {
        let mut behind = 20.0;
        let follow = |row: usize| {
            let own = if (row / 250).is_multiple_of(2) { 45.0 } else { 22.0 } + 0.2 * noise[row];
            behind += (own - behind) / (1.0 + lag);
            // Not all rows have a temperature.
            if row % 97 == 5 { f64::NAN } else { behind - 20.0 }
        };
        (0..n_rows).map(follow).collect()
    };
    let n_series = 14;
    let series: Vec<Vec<f64>> = (0..n_series).map(|trial| lagged(1.6_f64.powi(trial) - 1.0)).collect();
    let followed: Vec<&[f64]> = series.iter().map(Vec::as_slice).collect();
    let follows = formula("a*followed + b*followed*x", &["a", "b"]);
    let formulas: Vec<Formula> = (0..series.len())
        .map(|series| Formula {
            expression: follows.clone(),
            inner: vec![0.0],
            series: Some([2, series]),
            is_proportional: true,
        })
        .collect();
    let empty = vec![0.0; n_rows];
    let rows = Rows { variables: &[&x, &empty, &empty], n_rows, starts: &[], t: None };
    let sources = Sources { rows, formulas: &formulas, series: &followed, given: &[], products: &[] };
    let all = 0..series.len();
    let groups = [
        group(&[(0, 1.0, 0), (0, 1.0, 1)], (0..2 * series.len()).collect()),
        group(&[(3, 1.0, 0), (2, -0.5, 0)], (0..2 * series.len()).collect()),
        // A difference of two series, on two channels.
        group(
            &[(0, 1.0, 0), (0, -1.0, 0), (1, 1.0, 1), (1, -1.0, 1)],
            all.flat_map(|trial| {
                let other = (trial + 3) % series.len();
                [2 * trial, 2 * other, 2 * trial + 1, 2 * other + 1]
            })
            .collect(),
        ),
    ];
    let coarse = scan(&drawn.scene::<f32>(), &sources, &groups).unwrap();
    let exact = scan(&drawn.scene::<f64>(), &sources, &groups).unwrap();
    assert!(exact[2].gain.iter().all(|&gain| gain > 0.0));
    assert_alike([coarse, exact]);
}

#[test]
fn what_is_not_there_is_refused() {
    let drawn = Drawn::new(1, 20, 2, 1, 2);
    let empty = vec![0.0; 20];
    let rows = Rows { variables: &[&empty, &empty, &empty], n_rows: 20, starts: &[], t: None };
    let follows = |series| {
        [Formula {
            expression: formula("a*followed", &["a"]),
            inner: vec![0.0],
            series: Some(series),
            is_proportional: false,
        }]
    };
    let refused = |formulas: &[Formula], groups: &[Group]| {
        let sources = Sources { rows, formulas, series: &[&empty], given: &[], products: &[] };
        scan(&drawn.scene::<f64>(), &sources, groups).unwrap_err().to_string()
    };
    assert!(refused(&follows([2, 1]), &[]).contains("series 1"));
    assert!(refused(&follows([3, 0]), &[]).contains("variable 3"));
    assert!(refused(&follows([2, 0]), &[group(&[(2, 1.0, 0)], vec![0])]).contains("channel 2"));
    assert!(refused(&follows([2, 0]), &[group(&[(1, 1.0, 0)], vec![1])]).contains("function 1"));
    let sources = Sources { rows, formulas: &[], series: &[&empty[..19]], given: &[], products: &[] };
    let short = scan(&drawn.scene::<f64>(), &sources, &[]).unwrap_err();
    assert!(matches!(short, CandidateError::Length { found: 19, needed: 20, .. }));
}
