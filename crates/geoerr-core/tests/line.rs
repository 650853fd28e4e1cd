//! Total-least-squares lines against 50-digit references, against SVD, and by their invariances.

use geoerr_core::line::{Asked, FittedLines, LineError, PointNoise, Status, fit_lines, fit_lines_for};
use nalgebra::{Matrix3, MatrixXx3, Rotation3, Vector3};
use proptest::prelude::*;

struct Reference {
    kind: &'static str,
    points_mm: Vec<[f64; 3]>,
    centroid: [[f64; 2]; 3],
    direction: [[f64; 2]; 3],
    rms_mm: f64,
    relative_gap: f64,
}

fn references() -> Vec<Reference> {
    let mut points_of = Vec::<Vec<[f64; 3]>>::new();
    for line in include_str!("../../../tests/reference/line/points.csv").lines().skip(1) {
        let (index, numbers) = line.split_once(',').unwrap();
        if index.parse::<usize>().unwrap() == points_of.len() {
            points_of.push(Vec::new());
        }
        points_of.last_mut().unwrap().push(parse(numbers).try_into().unwrap());
    }
    let lines = include_str!("../../../tests/reference/line/lines.csv").lines().skip(1);
    lines
        .zip(points_of)
        .map(|(line, points_mm)| {
            let (kind, numbers) = line.split_once(',').unwrap();
            let n = parse(numbers);
            let high_low = |k: usize| std::array::from_fn(|i| [n[k + 2 * i], n[k + 2 * i + 1]]);
            Reference {
                kind,
                points_mm,
                centroid: high_low(0),
                direction: high_low(6),
                rms_mm: n[12],
                relative_gap: n[13],
            }
        })
        .collect()
}

fn parse(numbers: &str) -> Vec<f64> {
    numbers.split(',').map(|text| text.parse().unwrap()).collect()
}

fn distance(found: &[f64; 3], reference: &[[f64; 2]; 3]) -> f64 {
    let square: f64 = found.iter().zip(reference).map(|(x, [high, low])| ((x - high) - low).powi(2)).sum();
    square.sqrt()
}

fn fit_one(points_mm: &[[f64; 3]]) -> FittedLines {
    fit_lines(points_mm, &[0], PointNoise::FromResiduals).unwrap()
}

/// The direction by nalgebra's SVD of the centred points.
fn direction_by_svd(points_mm: &[[f64; 3]], towards: &[f64; 3]) -> [f64; 3] {
    let mean = points_mm.iter().map(|p| Vector3::from(*p)).sum::<Vector3<f64>>() / points_mm.len() as f64;
    let centred = MatrixXx3::from_fn(points_mm.len(), |i, j| points_mm[i][j] - mean[j]);
    let svd = centred.svd(false, true);
    let v: Vector3<f64> = svd.v_t.unwrap().row(svd.singular_values.imax()).transpose();
    (v * v.dot(&Vector3::from(*towards)).signum()).into()
}

/// A unit vector is rounded to `ε`, and the eigenvector's own condition is `1/gap`; ten such roundings may add up.
#[test]
fn direction_centroid_and_rms_match_fifty_digits() {
    let references = references();
    assert_eq!(references.len(), 60);
    for kind in ["measured", "far", "straight", "pair", "fat"] {
        let [mut ours_worst, mut svd_worst, mut rms_worst] = [0.0_f64; 3];
        for reference in references.iter().filter(|reference| reference.kind == kind) {
            let fitted = fit_one(&reference.points_mm);
            assert_eq!(fitted.status[0], Status::Ok);
            let size = reference.points_mm.iter().flatten().fold(0.0_f64, |size, x| size.max(x.abs()));
            let direction_error = distance(&fitted.direction[0], &reference.direction);
            let centroid_error = distance(&fitted.centroid_mm[0], &reference.centroid);
            let rms_error = (fitted.rms_mm[0] - reference.rms_mm).abs();
            ours_worst = ours_worst.max(direction_error);
            // nalgebra 0.35 turns the direction of two points by up to 0.07: tests/geometry has NumPy's SVD for those.
            if kind != "pair" {
                let svd_error = distance(
                    &direction_by_svd(&reference.points_mm, &fitted.direction[0]),
                    &reference.direction,
                );
                svd_worst = svd_worst.max(svd_error);
                assert!(direction_error <= 10.0 * svd_error.max(f64::EPSILON));
            }
            rms_worst = rms_worst.max(rms_error);
            assert!(
                direction_error <= 10.0 * f64::EPSILON / reference.relative_gap,
                "{kind}: {direction_error}"
            );
            assert!(centroid_error <= 2.0 * f64::EPSILON * size, "{kind}: {centroid_error} mm");
            // Each centred coordinate is rounded to half a spacing of the points' size.
            assert!(rms_error <= 4.0 * f64::EPSILON * size, "{kind}: rms wrong by {rms_error} mm");
        }
        println!(
            "{kind}: direction {ours_worst:.1e} (nalgebra's SVD {svd_worst:.1e}), rms {rms_worst:.1e} mm"
        );
    }
}

fn any_line() -> impl Strategy<Value = Vec<[f64; 3]>> {
    let noise = prop::collection::vec(prop::array::uniform3(-0.05..0.05_f64), 3..30);
    (prop::array::uniform3(-1.0..1.0_f64), prop::array::uniform3(-300.0..300.0_f64), noise)
        .prop_filter("a direction", |(direction, _, _)| Vector3::from(*direction).norm() > 0.1)
        .prop_map(|(direction, start, noise)| {
            let step = Vector3::from(direction).normalize() * 20.0;
            noise
                .iter()
                .enumerate()
                .map(|(i, noise)| (Vector3::from(start) + step * i as f64 + Vector3::from(*noise)).into())
                .collect()
        })
}

/// A coordinate up to 10³ mm and its centring over a length of 20 mm or more: some `10³ ε / 20`.
const TURN: f64 = 5e-14;

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_rigid_move_moves_the_line(
        points in any_line(),
        turn in prop::array::uniform3(-3.0..3.0_f64),
        shift in prop::array::uniform3(-300.0..300.0_f64),
    ) {
        let rotation = Rotation3::from_scaled_axis(Vector3::from(turn));
        let carry = |p: &[f64; 3]| -> [f64; 3] { (rotation * Vector3::from(*p) + Vector3::from(shift)).into() };
        let moved: Vec<[f64; 3]> = points.iter().map(carry).collect();
        let (a, b) = (fit_one(&points), fit_one(&moved));
        let direction = rotation * Vector3::from(a.direction[0]);
        prop_assert!((direction - Vector3::from(b.direction[0])).norm() < TURN);
        prop_assert!((Vector3::from(carry(&a.centroid_mm[0])) - Vector3::from(b.centroid_mm[0])).norm() < 1e-12);
        prop_assert!((a.rms_mm[0] - b.rms_mm[0]).abs() < 1e-12);
        for (x, y) in a.along_mm.iter().zip(&b.along_mm) {
            prop_assert!((x - y).abs() < 2e-12);
        }
    }

    #[test]
    fn the_line_is_the_best_one(points in any_line(), tilt in prop::array::uniform3(-1e-4..1e-4_f64)) {
        let fitted = fit_one(&points);
        let square_sum = |centroid: Vector3<f64>, v: Vector3<f64>| -> f64 {
            points.iter().map(|p| (Vector3::from(*p) - centroid).cross(&v.normalize()).norm_squared()).sum()
        };
        let (c, v) = (Vector3::from(fitted.centroid_mm[0]), Vector3::from(fitted.direction[0]));
        let best = square_sum(c, v);
        prop_assert!((best - fitted.rms_mm[0].powi(2) * points.len() as f64).abs() < 1e-10 * best);
        prop_assert!(best <= square_sum(c, v + Vector3::from(tilt)) * (1.0 + 1e-12));
        prop_assert!(best <= square_sum(c + Vector3::from(tilt), v) * (1.0 + 1e-12));
    }

    #[test]
    fn turned_round_the_direction_turns(points in any_line()) {
        let reversed: Vec<[f64; 3]> = points.iter().rev().copied().collect();
        let (a, b) = (fit_one(&points), fit_one(&reversed));
        prop_assert!((Vector3::from(a.direction[0]) + Vector3::from(b.direction[0])).norm() < TURN);
        prop_assert_eq!(a.along_mm[0], 0.0);
        prop_assert!(*a.along_mm.last().unwrap() > 0.0);
        prop_assert!(*b.along_mm.last().unwrap() > 0.0);
    }

    #[test]
    fn covariance_matches_finite_differences(points in any_line(), seed in 0.0..1.0_f64) {
        let covariances: Vec<[[f64; 3]; 3]> = (0..points.len())
            .map(|i| {
                let factor = Matrix3::from_fn(|r, c| {
                    ((i * 9 + r * 3 + c) as f64 * 0.618_034 + seed).fract() - 0.5
                });
                (factor * factor.transpose() * 1e-4).into()
            })
            .collect();
        let fitted = fit_lines(&points, &[0], PointNoise::Covariances(&covariances)).unwrap();
        let step_mm = 1e-4;
        let mut expected = Matrix3::zeros();
        for (i, covariance) in covariances.iter().enumerate() {
            let columns = [0, 1, 2].map(|axis| {
                let [low, high] = [-step_mm, step_mm].map(|step| {
                    let mut moved = points.clone();
                    moved[i][axis] += step;
                    Vector3::from(fit_one(&moved).direction[0])
                });
                (high - low) / (2.0 * step_mm)
            });
            let jacobian = Matrix3::from_columns(&columns);
            expected += jacobian * Matrix3::from(*covariance) * jacobian.transpose();
        }
        let found = Matrix3::from(fitted.direction_covariance[0]);
        // Rounding of the difference quotient: 10⁻¹⁵ over 2·10⁻⁴, against derivatives of 10⁻³ or more.
        prop_assert!((found - expected).norm() < 1e-6 * expected.norm());
    }
}

/// A line of `n_points` points with noise of a part of its length: along an axis or anywhere, near or far from the origin,
/// in even steps or all but two of them at one end, its first point far aside or not.
fn a_line_of_any_kind() -> impl Strategy<Value = Vec<[f64; 3]>> {
    let direction = prop_oneof![
        Just([1.0, 0.0, 0.0]),
        Just([0.0, -1.0, 0.0]),
        Just([1.0, 1.0, -1.0]),
        prop::array::uniform3(-1.0..1.0_f64),
    ];
    let sizes = (-1.0..3.0_f64, -13.0..-1.0_f64, 0.0..5.0_f64);
    (direction, sizes, 3..200_usize, 0..4_u8, 0.0..1.0_f64)
        .prop_filter("a direction", |(direction, ..)| Vector3::from(*direction).norm() > 0.1)
        .prop_map(|(direction, (length, noise, place), n_points, kind, seed)| {
            let (length_mm, place_mm) = (10.0_f64.powf(length), 10.0_f64.powf(place));
            let noise_mm = length_mm * 10.0_f64.powf(noise);
            let unit = Vector3::from(direction).normalize();
            (0..n_points)
                .map(|i| {
                    let even = i as f64 / (n_points - 1) as f64;
                    let share = if kind == 1 && i + 2 < n_points { 1e-3 * even } else { even };
                    let noise = [0.618_034, 0.754_878, 0.569_840]
                        .map(|step| noise_mm * ((i as f64 * step + seed).fract() - 0.5));
                    let aside = if kind == 2 && i == 0 { 30.0 } else { 1.0 };
                    let start = Vector3::new(place_mm, -0.3 * place_mm, 0.7 * place_mm);
                    (start + unit * (share * length_mm) + aside * Vector3::from(noise)).into()
                })
                .collect()
        })
}

/// All numbers of lines but the distances along, NaN for NaN.
fn bits(fitted: &FittedLines) -> Vec<u64> {
    let rows = fitted.centroid_mm.iter().chain(&fitted.direction).flatten();
    let all = rows.chain(&fitted.rms_mm).chain(fitted.direction_covariance.iter().flatten().flatten());
    all.map(|value| if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() }).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Given covariances, every line is fitted by itself, from its eigenvectors and vectors of residuals; without, many at once.
    #[test]
    fn many_lines_at_once_are_the_lines_one_by_one(lines in prop::collection::vec(a_line_of_any_kind(), 1..12)) {
        let starts: Vec<usize> =
            lines.iter().scan(0, |start, line| Some(std::mem::replace(start, *start + line.len()))).collect();
        let points = lines.concat();
        let unit = vec![Matrix3::identity().into(); points.len()];
        let many = fit_lines(&points, &starts, PointNoise::FromResiduals).unwrap();
        let each = fit_lines(&points, &starts, PointNoise::Covariances(&unit)).unwrap();
        prop_assert_eq!(&many.status, &each.status);
        prop_assert_eq!(many.along_mm.len(), points.len());
        for (noise, whole) in [(PointNoise::FromResiduals, &many), (PointNoise::Covariances(&unit), &each)] {
            for (along, direction_covariance) in [(false, true), (true, false), (false, false)] {
                let asked = Asked { along, direction_covariance };
                let mut part = fit_lines_for(asked, &points, &starts, noise).unwrap();
                prop_assert_eq!(part.along_mm.len(), if along { points.len() } else { 0 });
                prop_assert_eq!(part.direction_covariance.len(), if direction_covariance { starts.len() } else { 0 });
                if !direction_covariance {
                    part.direction_covariance.clone_from(&whole.direction_covariance);
                }
                prop_assert_eq!(&part.status, &whole.status);
                prop_assert_eq!(bits(&part), bits(whole));
            }
        }
        for (i, line) in lines.iter().enumerate().filter(|(i, _)| many.status[*i] == Status::Ok) {
            let alone = fit_one(line);
            prop_assert_eq!(alone.direction[0], many.direction[i]);
            prop_assert_eq!(alone.rms_mm[0].to_bits(), many.rms_mm[i].to_bits());
            let size_mm = line.iter().flatten().fold(0.0_f64, |size, x| size.max(x.abs()));
            let length_mm = each.along_mm[starts[i]..][..line.len()].iter().fold(0.0_f64, |a, x| a.max(x.abs()));
            let away = |a: &[[f64; 3]], b: &[[f64; 3]]| (Vector3::from(a[i]) - Vector3::from(b[i])).norm();
            // The gap between the eigenvalues is nearly the largest of them: the noise is a tenth of the length at most.
            prop_assert!(away(&many.direction, &each.direction) < 20.0 * f64::EPSILON);
            prop_assert!(away(&many.centroid_mm, &each.centroid_mm) < 4.0 * f64::EPSILON * size_mm);
            prop_assert!((many.rms_mm[i] - each.rms_mm[i]).abs() < 4.0 * f64::EPSILON * size_mm);
            for k in starts[i]..starts[i] + line.len() {
                prop_assert!((many.along_mm[k] - each.along_mm[k]).abs() < 20.0 * f64::EPSILON * length_mm);
            }
            let n_points = line.len() as f64;
            let variance = many.rms_mm[i].powi(2) * n_points / (2.0 * n_points - 4.0);
            let expected = Matrix3::from(each.direction_covariance[i]) * variance;
            let found = Matrix3::from(many.direction_covariance[i]);
            prop_assert!((found - expected).norm() <= 1e-12 * expected.norm());
        }
    }
}

#[test]
fn covariance_from_residuals_is_that_of_equal_noise() {
    let points: Vec<[f64; 3]> = references().swap_remove(0).points_mm;
    let from_residuals = fit_one(&points);
    let variance = from_residuals.rms_mm[0].powi(2) * points.len() as f64 / (2.0 * points.len() as f64 - 4.0);
    let equal = vec![(Matrix3::identity() * variance).into(); points.len()];
    let given = fit_lines(&points, &[0], PointNoise::Covariances(&equal)).unwrap();
    let [a, b] = [&from_residuals, &given].map(|fitted| Matrix3::from(fitted.direction_covariance[0]));
    assert!((a - b).norm() < 1e-12 * b.norm());
    assert!(a.trace() > 0.0);
}

#[test]
fn bad_lines_are_named_and_leave_the_others_alone() {
    let good = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [2.0, 0.0, 0.0]];
    let square = [[1.0, 0.0, 5.0], [0.0, 1.0, 5.0], [-1.0, 0.0, 5.0], [0.0, -1.0, 5.0]];
    let mut points = good.to_vec();
    points.push([7.0, 7.0, 7.0]);
    points.extend([[0.1, 0.2, 0.3]; 3]);
    points.extend([[0.0, 0.0, 0.0], [f64::NAN, 0.0, 0.0]]);
    points.extend([[0.0, 0.0, 0.0], [1e200, 0.0, 0.0]]);
    points.extend(square);
    points.extend(good);
    let starts = [0, 3, 4, 4, 7, 9, 11, 15];
    let fitted = fit_lines(&points, &starts, PointNoise::FromResiduals).unwrap();
    use Status::{Coincident, NoDirection, NotFinite, Ok, TooFewPoints};
    let expected = [Ok, TooFewPoints, TooFewPoints, Coincident, NotFinite, NotFinite, NoDirection, Ok];
    assert_eq!(fitted.status, expected);
    for (line, status) in expected.into_iter().enumerate() {
        let end = starts.get(line + 1).copied().unwrap_or(points.len());
        let along = &fitted.along_mm[starts[line]..end];
        let is_ok = status == Ok;
        assert_eq!(fitted.rms_mm[line].is_finite(), is_ok);
        assert!(fitted.direction[line].iter().all(|x| x.is_nan() != is_ok));
        assert!(along.iter().all(|x| x.is_nan() != is_ok));
    }
    assert_eq!(fitted.direction[0], fitted.direction[7]);
}

#[test]
fn two_points_have_a_line_without_uncertainty_of_its_own() {
    let fitted = fit_one(&[[1.0, 2.0, 3.0], [1.0, 2.0, 1.0]]);
    assert_eq!(fitted.direction[0], [0.0, 0.0, -1.0]);
    assert_eq!(fitted.rms_mm[0], 0.0);
    assert_eq!(fitted.along_mm, [0.0, 2.0]);
    assert!(fitted.direction_covariance[0].iter().flatten().all(|x| x.is_nan()));
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let points: Vec<[f64; 3]> = (0..60_000)
        .map(|i| [i as f64 % 50.0, (i as f64 * 0.618).fract() * 0.1, (i as f64 * 0.414).fract() * 0.1])
        .collect();
    let starts: Vec<usize> = (0..1200).map(|line| line * 50 + line % 3).collect();
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fit_lines(&points, &starts, PointNoise::FromResiduals).unwrap())
    };
    let bits = |fitted: &FittedLines| -> Vec<u64> {
        let vectors = fitted.centroid_mm.iter().chain(&fitted.direction).flatten();
        let matrices = fitted.direction_covariance.iter().flatten().flatten();
        let rest = fitted.rms_mm.iter().chain(&fitted.along_mm);
        vectors.chain(matrices).chain(rest).map(|x| x.to_bits()).collect()
    };
    let one = with_threads(1);
    assert!(one.status.iter().all(|&status| status == Status::Ok));
    for threads in [2, 8] {
        assert_eq!(bits(&one), bits(&with_threads(threads)));
    }
}

#[test]
fn starts_that_do_not_cut_the_points_are_refused() {
    let points = [[0.0; 3]; 4];
    let fit = |starts: &[usize]| fit_lines(&points, starts, PointNoise::FromResiduals).unwrap_err();
    assert_eq!(fit(&[]), LineError::NoStarts { n_points: 4 });
    assert_eq!(fit(&[1, 2]), LineError::BadStart { index: 0, found: 1, n_points: 4 });
    assert_eq!(fit(&[0, 3, 2]), LineError::BadStart { index: 2, found: 2, n_points: 4 });
    assert_eq!(fit(&[0, 5]), LineError::BadStart { index: 1, found: 5, n_points: 4 });
    let one = [[[0.0; 3]; 3]];
    assert_eq!(
        fit_lines(&points, &[0], PointNoise::Covariances(&one)).unwrap_err(),
        LineError::LengthsDiffer { found: 1, expected: 4 }
    );
    assert!(fit_lines(&[], &[], PointNoise::FromResiduals).unwrap().status.is_empty());
}
