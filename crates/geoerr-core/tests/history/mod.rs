//! What follows from the order of rows.

use std::f64::consts::{FRAC_PI_2, TAU};

use geoerr_core::history::{History, HistoryError, HistoryRows, Moment, Past, history};
use proptest::prelude::*;

const NAN3: [f64; 3] = [f64::NAN; 3];

fn rows<'a>(q_mm: &'a [[f64; 3]], t_s: Option<&'a [f64]>) -> HistoryRows<'a> {
    HistoryRows { q_mm, t_s, moving: None, feed_mm_min: None, direction: None, curve: None, starts: &[] }
}

fn along_x(x: &[f64]) -> Vec<[f64; 3]> {
    x.iter().map(|&x| [x, 5.0, 0.0]).collect()
}

fn assert_all(found: impl IntoIterator<Item = f64>, expected: &[f64], what: &str) {
    let found: Vec<f64> = found.into_iter().collect();
    assert_eq!(found.len(), expected.len(), "{what}");
    for (row, (found, expected)) in found.iter().zip(expected).enumerate() {
        let is_same = found.is_nan() && expected.is_nan() || (found - expected).abs() < 1e-12;
        assert!(is_same, "{what} of row {row}: {found} is not {expected}");
    }
}

#[test]
fn there_and_back_by_hand() {
    let q = along_x(&[0.0, 10.0, 30.0, 30.0, 25.0, 0.0, 5.0]);
    let t = [0.0, 2.0, 4.0, 5.0, 7.0, 12.0, 13.0];
    let past = history(&rows(&q, Some(&t))).unwrap();
    let nan = f64::NAN;
    assert_all(past.iter().map(|p| p.d[0]), &[nan, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0], "d");
    assert_all(past.iter().map(|p| p.s_mm[0]), &[nan, 10.0, 30.0, 30.0, 5.0, 30.0, 5.0], "s");
    assert_all(past.iter().map(|p| p.t_rev_s[0]), &[nan, 2.0, 4.0, 5.0, 2.0, 7.0, 1.0], "t_rev");
    assert_all(past.iter().map(|p| p.mean_v_mm_s[0]), &[0.0, 5.0, 10.0, 0.0, -2.5, -5.0, 5.0], "mean_v");
    assert_all(past.iter().map(|p| p.v_mm_s[0]), &[0.0; 7], "v at rest");
    assert_all(past.iter().map(|p| p.a_mm_s2[0]), &[0.0; 7], "a at rest");
    for p in &past {
        assert!(p.d[1].is_nan() && p.s_mm[1].is_nan(), "y never moves");
    }
}

#[test]
fn without_times_rows_are_counted() {
    let q = along_x(&[0.0, 10.0, 5.0]);
    let past = history(&rows(&q, None)).unwrap();
    assert_all(past.iter().map(|p| p.t_rev_s[0]), &[f64::NAN, 1.0, 1.0], "t_rev");
    assert_all(past.iter().map(|p| p.mean_v_mm_s[0]), &[0.0, 10.0, -5.0], "mean_v");
}

#[test]
fn a_given_direction_tells_what_rows_do_not_show() {
    // To 20, beyond it and back to 20 from above, on down; then below 10 and up to 10 again.
    let q = along_x(&[0.0, 20.0, 20.0, 15.0, 10.0, 10.0, 12.0, 8.0]);
    let direction: Vec<[f64; 3]> =
        [0.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0].map(|d| [d, f64::NAN, 0.0]).to_vec();
    let t: Vec<f64> = (0..8).map(f64::from).collect();
    let past = history(&HistoryRows { direction: Some(&direction), ..rows(&q, Some(&t)) }).unwrap();
    let nan = f64::NAN;
    assert_all(past.iter().map(|p| p.d[0]), &[nan, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0], "d");
    // The last row lies below the one before although it was approached upwards: two reversals in between.
    assert_all(past.iter().map(|p| p.s_mm[0]), &[nan, 20.0, nan, 5.0, 10.0, nan, 2.0, nan], "s");
    assert_all(past.iter().map(|p| p.t_rev_s[0]), &[nan, 1.0, 1.0, 2.0, 3.0, 1.0, 2.0, 1.0], "t_rev");
}

#[test]
fn the_first_row_may_know_its_direction() {
    let q = along_x(&[0.0, 20.0]);
    let direction = [[1.0, 0.0, 0.0]; 2];
    let past = history(&HistoryRows { direction: Some(&direction), ..rows(&q, None) }).unwrap();
    assert_all(past.iter().map(|p| p.d[0]), &[1.0, 1.0], "d");
    assert_all(past.iter().map(|p| p.s_mm[0]), &[f64::NAN, 20.0], "s");
    assert_all(past.iter().map(|p| p.t_rev_s[0]), &[f64::NAN, 1.0], "t_rev");
}

#[test]
fn a_moving_machine_has_its_feed_along_the_last_move() {
    let q = [[0.0; 3], [3.0, 4.0, 0.0], [6.0, 8.0, 0.0], [6.0, 8.0, 0.0], [6.0, 0.0, 0.0], [6.0, -5.0, 0.0]];
    let t = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
    let feed = [600.0, 600.0, 1200.0, 600.0, 600.0, f64::NAN];
    let moving = [1.0, 1.0, 1.0, 0.0, 1.0, 1.0];
    let given = HistoryRows { moving: Some(&moving), feed_mm_min: Some(&feed), ..rows(&q, Some(&t)) };
    let past = history(&given).unwrap();
    let nan = f64::NAN;
    assert_all(past.iter().map(|p| p.v_mm_s[0]), &[nan, 6.0, 12.0, 0.0, 0.0, 0.0], "v of x");
    assert_all(past.iter().map(|p| p.v_mm_s[1]), &[nan, 8.0, 16.0, 0.0, -10.0, -5.0], "v of y");
    assert_all(past.iter().map(|p| p.a_mm_s2[1]), &[nan, nan, 8.0, 0.0, nan, 5.0], "a of y");
}

#[test]
fn one_moment_seen_twice_has_one_history() {
    let q = along_x(&[0.0, 10.0, 10.0, 10.0, 4.0]);
    let t = [0.0, 2.0, 2.0, 2.0, 5.0];
    let past = history(&rows(&q, Some(&t))).unwrap();
    assert_eq!(format!("{:?}", past[1]), format!("{:?}", past[2]));
    assert_eq!(format!("{:?}", past[1]), format!("{:?}", past[3]));
    assert_eq!(past[1].mean_v_mm_s[0], 5.0);
    assert_eq!(past[4].mean_v_mm_s[0], -2.0);
}

#[test]
fn an_unknown_time_harms_its_own_row_only() {
    let q = along_x(&[0.0, 10.0, 20.0, 30.0, 40.0]);
    for bad in [f64::NAN, -7.0] {
        let t = [0.0, 1.0, bad, 3.0, 4.0];
        let past = history(&rows(&q, Some(&t))).unwrap();
        let nan = f64::NAN;
        assert_all(past.iter().map(|p| p.t_rev_s[0]), &[nan, 1.0, nan, 3.0, 4.0], "t_rev");
        assert_all(past.iter().map(|p| p.mean_v_mm_s[0]), &[0.0, 10.0, nan, nan, 10.0], "mean_v");
        assert_all(past.iter().map(|p| p.s_mm[0]), &[nan, 10.0, 20.0, 30.0, 40.0], "s");
    }
}

#[test]
fn sequences_know_nothing_of_each_other() {
    let q = along_x(&[0.0, 10.0, 0.0, 10.0, 5.0, 7.0]);
    let t = [0.0, 1.0, 2.0, 0.0, 1.0, 2.0];
    let together = history(&HistoryRows { starts: &[0, 3], ..rows(&q, Some(&t)) }).unwrap();
    let first = history(&rows(&q[..3], Some(&t[..3]))).unwrap();
    let second = history(&rows(&q[3..], Some(&t[3..]))).unwrap();
    let apart: Vec<Past> = first.into_iter().chain(second).collect();
    assert_eq!(format!("{together:?}"), format!("{apart:?}"));
}

/// Angles of a circle in uneven steps.
fn uneven_angles(n: usize, from: f64, turns: f64) -> Vec<f64> {
    (0..n).map(|k| from + turns * TAU * (k as f64 + 0.3 * (k as f64 * 1.7).sin()) / n as f64).collect()
}

#[test]
fn a_circle_has_the_velocity_and_acceleration_of_a_circle() {
    for (sense, from) in [(1.0, 0.1), (-1.0, 2.5)] {
        let angles = uneven_angles(300, from, 1.2 * sense);
        let (radius, feed) = (100.0, 3000.0);
        let q: Vec<[f64; 3]> =
            angles.iter().map(|a| [212.0 + radius * a.cos(), 270.0 + radius * a.sin(), 9.0]).collect();
        let (feeds, curve) = (vec![feed; q.len()], vec![1.0; q.len()]);
        let given = HistoryRows { feed_mm_min: Some(&feeds), curve: Some(&curve), ..rows(&q, None) };
        let past = history(&given).unwrap();
        let speed = feed / 60.0;
        let quiet = speed / radius;
        for (row, (a, p)) in angles.iter().zip(&past).enumerate() {
            let v = [-sense * speed * a.sin(), sense * speed * a.cos(), 0.0];
            let acceleration = [-speed * quiet * a.cos(), -speed * quiet * a.sin(), 0.0];
            for axis in 0..3 {
                // Rounding of differences of 2 mm between positions of 370: 1e-13 relative, and its square root nowhere.
                assert!((p.v_mm_s[axis] - v[axis]).abs() < 1e-9, "v of row {row}");
                assert!((p.a_mm_s2[axis] - acceleration[axis]).abs() < 1e-7, "a of row {row}");
            }
            assert_eq!(p.d[0], v[0].signum());
            // Time and travel since the last extreme of x, where the sine is 0.
            let turned = if sense > 0.0 {
                a - (a / (0.5 * TAU)).floor() * 0.5 * TAU
            } else {
                (a / (0.5 * TAU)).ceil() * 0.5 * TAU - a
            };
            let has_reversed = (a - angles[0]).abs() > turned;
            if has_reversed {
                let (t_rev, s) = (turned / quiet, radius * (1.0 - turned.cos()));
                // The sine is taken as straight over one step: its cube's part, of 1/40 rad at most.
                let step: f64 = 1.35 * 1.2 * TAU / 300.0;
                assert!(
                    (p.t_rev_s[0] - t_rev).abs() < step.powi(3) / quiet,
                    "t_rev of row {row}: {} {t_rev}",
                    p.t_rev_s[0]
                );
                assert!((p.s_mm[0] - s).abs() < radius * step.powi(3), "s of row {row}: {} {s}", p.s_mm[0]);
            }
        }
    }
}

#[test]
fn a_circle_without_a_feed_takes_its_speed_from_time() {
    let angles = uneven_angles(200, 0.0, 1.0);
    let q: Vec<[f64; 3]> = angles.iter().map(|a| [50.0 * a.cos(), 0.0, 50.0 * a.sin()]).collect();
    let t: Vec<f64> = angles.iter().map(|a| 3.0 + 2.0 * a).collect();
    let curve = vec![1.0; q.len()];
    let past = history(&HistoryRows { curve: Some(&curve), ..rows(&q, Some(&t)) }).unwrap();
    for (a, p) in angles.iter().zip(&past) {
        assert!((p.v_mm_s[0] + 25.0 * a.sin()).abs() < 1e-9);
        assert!((p.a_mm_s2[2] + 12.5 * a.sin()).abs() < 1e-7);
    }
}

#[test]
fn a_quadrant_that_is_hit_belongs_to_the_motion_before_it() {
    let q: Vec<[f64; 3]> = (0..9)
        .map(|k| f64::from(k) * FRAC_PI_2 / 2.0)
        .map(|a| [10.0 * a.cos(), 10.0 * a.sin(), 0.0])
        .collect();
    let (feed, curve) = ([60.0; 9], [1.0; 9]);
    let past =
        history(&HistoryRows { feed_mm_min: Some(&feed), curve: Some(&curve), ..rows(&q, None) }).unwrap();
    assert_all(past.iter().map(|p| p.d[1]), &[1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0, 1.0, 1.0], "d of y");
}

#[test]
fn wrong_lengths_and_starts_are_refused() {
    let q = along_x(&[0.0, 1.0]);
    let short = [0.0];
    let refused = history(&HistoryRows { feed_mm_min: Some(&short), ..rows(&q, None) }).unwrap_err();
    assert_eq!(refused, HistoryError::Length { column: "feed", n_rows: 2, found: 1 });
    for starts in [&[1][..], &[0, 0], &[0, 2]] {
        let refused = history(&HistoryRows { starts, ..rows(&q, None) }).unwrap_err();
        assert!(matches!(refused, HistoryError::BadStart { .. }), "{starts:?}");
    }
    assert!(history(&rows(&[], None)).unwrap().is_empty());
}

fn positions() -> impl Strategy<Value = Vec<[f64; 3]>> {
    prop::collection::vec(prop::array::uniform3((-4..4).prop_map(f64::from)), 1..40)
}

proptest! {
    /// Mirrored axes have mirrored directions and speeds and the same travel; one axis knows nothing of the others.
    #[test]
    fn a_mirror_turns_directions_only(q in positions()) {
        let mirrored: Vec<[f64; 3]> = q.iter().map(|&[x, y, z]| [-x, z, y]).collect();
        let (one, other) = (history(&rows(&q, None)).unwrap(), history(&rows(&mirrored, None)).unwrap());
        for (one, other) in one.iter().zip(&other) {
            assert_all([-one.d[0], one.d[2]], &[other.d[0], other.d[1]], "d");
            assert_all([one.s_mm[0], one.s_mm[1]], &[other.s_mm[0], other.s_mm[2]], "s");
            assert_all([-one.mean_v_mm_s[0]], &[other.mean_v_mm_s[0]], "mean_v");
        }
    }

    /// More rows on the way change nothing but the mean speed.
    #[test]
    fn rows_on_the_way_change_nothing(q in positions()) {
        let doubled: Vec<[f64; 3]> = q.windows(2)
            .flat_map(|pair| [pair[0], [0, 1, 2].map(|k| 0.5 * (pair[0][k] + pair[1][k]))])
            .chain(q.last().copied())
            .collect();
        let times: Vec<f64> = (0..doubled.len()).map(|row| 0.5 * row as f64).collect();
        let (few, many) = (history(&rows(&q, None)).unwrap(), history(&rows(&doubled, Some(&times))).unwrap());
        for (few, many) in few.iter().zip(many.iter().step_by(2)) {
            for axis in 0..3 {
                assert_all([few.d[axis], few.s_mm[axis]], &[many.d[axis], many.s_mm[axis]], "d, s");
                // A standstill between two rows and a reversal after it: the reversal is later than rows show.
                let is_later = many.t_rev_s[axis] > few.t_rev_s[axis] + 1e-12;
                prop_assert!(!is_later);
            }
        }
    }

    #[test]
    fn nothing_makes_it_panic(
        numbers in prop::collection::vec(prop::array::uniform8(prop::num::f64::ANY), 0..20),
        flags in prop::collection::vec(prop::bool::ANY, 20),
    ) {
        let column = |k: usize| numbers.iter().map(|row| row[k]).collect::<Vec<f64>>();
        let three = |k: usize| numbers.iter().map(|row| [row[k], row[k + 1], row[k + 2]]).collect::<Vec<_>>();
        let on: Vec<f64> = flags.iter().take(numbers.len()).map(|&on| f64::from(u8::from(on))).collect();
        let (q, t, direction, feed) = (three(0), column(3), three(4), column(7));
        let given = HistoryRows {
            q_mm: &q, t_s: Some(&t), moving: Some(&on), feed_mm_min: Some(&feed), direction: Some(&direction),
            curve: Some(&on), starts: &[],
        };
        prop_assert_eq!(history(&given).unwrap().len(), numbers.len());
    }
}

#[test]
fn moments_can_come_one_by_one() {
    let q = along_x(&[0.0, 3.0, 1.0]);
    let whole = history(&rows(&q, None)).unwrap();
    let mut history = History::new();
    for (row, (&q_mm, expected)) in q.iter().zip(&whole).enumerate() {
        let moment = Moment {
            q_mm,
            t_s: row as f64,
            is_moving: false,
            feed_mm_min: f64::NAN,
            direction: NAN3,
            motion: None,
        };
        assert_eq!(format!("{:?}", history.step(&moment)), format!("{expected:?}"));
    }
}
