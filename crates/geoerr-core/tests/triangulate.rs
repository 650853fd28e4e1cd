//! Triangulation against 50-digit references, against QR and SVD, and by its identities.

use std::sync::LazyLock;

use geoerr_core::triangulate::{
    PixelNoise, Pixels, Rig, Side, Status, TriangulateError, Triangulated, triangulate, triangulate_points,
};
use nalgebra::{Matrix3, Matrix4x3, Rotation3, SMatrix, Vector2, Vector3, Vector4};
use proptest::prelude::*;

type Projection = [[f64; 4]; 3];
type Covariance2 = [[f64; 2]; 2];

/// One row of `points.csv`; coordinates of `plain` and `two` as a sum of high and low part.
struct Case {
    rig: &'static str,
    noise_px: f64,
    uv: [[f64; 2]; 2],
    covariance: [Covariance2; 2],
    plain: [[f64; 2]; 3],
    two: [[f64; 2]; 3],
    minimum: [f64; 3],
    point_covariance: [f64; 6],
    reprojection_px: f64,
}

static RIGS: LazyLock<Vec<(&str, Projection, Projection)>> = LazyLock::new(|| {
    include_str!("../../../tests/reference/triangulate/rigs.csv")
        .lines()
        .skip(1)
        .map(|line| {
            let (name, numbers) = line.split_once(',').unwrap();
            let n = parse(numbers);
            let matrix =
                |start: usize| std::array::from_fn(|i| std::array::from_fn(|j| n[start + 4 * i + j]));
            (name, matrix(0), matrix(12))
        })
        .collect()
});

static CASES: LazyLock<Vec<Case>> = LazyLock::new(|| {
    include_str!("../../../tests/reference/triangulate/points.csv")
        .lines()
        .skip(1)
        .map(|line| {
            let (rig, numbers) = line.split_once(',').unwrap();
            let n = parse(numbers);
            let covariance = |k: usize| [[n[k], n[k + 1]], [n[k + 1], n[k + 2]]];
            let high_low = |k: usize| std::array::from_fn(|i| [n[k + 2 * i], n[k + 2 * i + 1]]);
            Case {
                rig,
                noise_px: n[0],
                uv: [[n[1], n[2]], [n[3], n[4]]],
                covariance: [covariance(5), covariance(8)],
                plain: high_low(11),
                two: high_low(17),
                minimum: [n[23], n[24], n[25]],
                point_covariance: std::array::from_fn(|i| n[26 + i]),
                reprojection_px: n[32],
            }
        })
        .collect()
});

fn parse(numbers: &str) -> Vec<f64> {
    numbers.split(',').map(|text| text.parse().unwrap()).collect()
}

fn projections(name: &str) -> [Projection; 2] {
    let (_, left, right) = RIGS.iter().find(|rig| rig.0 == name).unwrap();
    [*left, *right]
}

fn rig(name: &str) -> Rig {
    let [left, right] = projections(name);
    Rig::new(&left, &right).unwrap()
}

fn cases_of(name: &str, noise_px: f64) -> Vec<&'static Case> {
    CASES.iter().filter(|case| case.rig == name && case.noise_px == noise_px).collect()
}

fn solve_cases(cases: &[&Case], reweightings: u32) -> Triangulated {
    let uv = [0, 1].map(|side| cases.iter().map(|case| case.uv[side]).collect::<Vec<_>>());
    let covariance = [0, 1].map(|side| cases.iter().map(|case| case.covariance[side]).collect::<Vec<_>>());
    let seen =
        [0, 1].map(|side| Pixels { uv_px: &uv[side], noise: PixelNoise::Covariances(&covariance[side]) });
    triangulate(&rig(cases[0].rig), &seen[0], &seen[1], reweightings).unwrap()
}

fn distance(found: &[f64; 3], reference: &[[f64; 2]; 3]) -> f64 {
    let square: f64 = found.iter().zip(reference).map(|(x, [high, low])| ((x - high) - low).powi(2)).sum();
    square.sqrt()
}

fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * q).round() as usize]
}

/// Camera matrix scaled so that its last row gives the depth.
fn camera(p: &Projection) -> SMatrix<f64, 3, 4> {
    let m = Matrix3::from_fn(|i, j| p[i][j]);
    let scale = m.determinant().signum() / m.row(2).norm();
    SMatrix::<f64, 3, 4>::from_fn(|i, j| p[i][j] * scale)
}

/// The same method, written with matrices, every least squares solved by `solve`.
fn second_opinion(
    case: &Case,
    reweightings: u32,
    solve: impl Fn(Matrix4x3<f64>, Vector4<f64>) -> Vector3<f64>,
) -> [f64; 3] {
    let cameras = projections(case.rig).map(|p| camera(&p));
    let whiteners = case.covariance.map(|c| {
        let l00 = c[0][0].sqrt();
        let l10 = c[1][0] / l00;
        let l11 = (c[1][1] - l10 * l10).sqrt();
        SMatrix::<f64, 2, 2>::new(1.0 / l00, 0.0, -l10 / (l00 * l11), 1.0 / l11)
    });
    let mut a = Matrix4x3::zeros();
    let mut b = Vector4::zeros();
    for (view, camera) in cameras.iter().enumerate() {
        let rows = SMatrix::<f64, 2, 4>::from_fn(|i, j| case.uv[view][i] * camera[(2, j)] - camera[(i, j)]);
        let white = whiteners[view] * rows;
        a.fixed_view_mut::<2, 3>(2 * view, 0).copy_from(&white.fixed_columns::<3>(0));
        b.fixed_rows_mut::<2>(2 * view).copy_from(&-white.column(3));
    }
    let mut p = solve(a, b);
    for _ in 0..reweightings {
        for (view, camera) in cameras.iter().enumerate() {
            let h = camera * p.push(1.0);
            let predicted = Vector2::new(h.x / h.z, h.y / h.z);
            let jacobian =
                SMatrix::<f64, 2, 3>::from_fn(|i, j| (camera[(i, j)] - predicted[i] * camera[(2, j)]) / h.z);
            let residual = Vector2::from(case.uv[view]) - predicted;
            a.fixed_view_mut::<2, 3>(2 * view, 0).copy_from(&(whiteners[view] * jacobian));
            b.fixed_rows_mut::<2>(2 * view).copy_from(&(whiteners[view] * residual));
        }
        p += solve(a, b);
    }
    p.into()
}

fn by_qr(a: Matrix4x3<f64>, b: Vector4<f64>) -> Vector3<f64> {
    let qr = a.qr();
    qr.r().solve_upper_triangular(&(qr.q().transpose() * b)).unwrap()
}

fn by_svd(a: Matrix4x3<f64>, b: Vector4<f64>) -> Vector3<f64> {
    a.svd(true, true).solve(&b, 0.0).unwrap()
}

fn by_normal_equations(a: Matrix4x3<f64>, b: Vector4<f64>) -> Vector3<f64> {
    (a.transpose() * a).cholesky().unwrap().solve(&(a.transpose() * b))
}

/// The contract: never worse than ten times QR, in quantiles, on ordinary and ill-conditioned rigs.
#[test]
fn error_is_that_of_qr() {
    for (name, _, _) in RIGS.iter() {
        for noise_px in [0.0, 0.1] {
            let cases = cases_of(name, noise_px);
            assert_eq!(cases.len(), 40);
            for reweightings in [0, 2] {
                let reference = |case: &Case| if reweightings == 0 { case.plain } else { case.two };
                let found = solve_cases(&cases, reweightings);
                let ours: Vec<f64> = cases
                    .iter()
                    .zip(&found.points_mm)
                    .map(|(case, p)| distance(p, &reference(case)))
                    .collect();
                let error_of = |solve: fn(Matrix4x3<f64>, Vector4<f64>) -> Vector3<f64>| -> Vec<f64> {
                    cases
                        .iter()
                        .map(|case| distance(&second_opinion(case, reweightings, solve), &reference(case)))
                        .collect()
                };
                let others = [by_qr, by_svd, by_normal_equations].map(error_of);
                for q in [0.5, 0.9, 1.0] {
                    let our_error = quantile(&ours, q);
                    let [qr, svd, normal] = [0, 1, 2].map(|i| quantile(&others[i], q));
                    println!(
                        "{name} noise {noise_px} reweightings {reweightings} q{q}: \
                         ours {our_error:.1e} mm, QR {qr:.1e}, SVD {svd:.1e}, normal equations {normal:.1e}"
                    );
                    assert!(our_error <= 10.0 * qr, "{name} q{q}: {our_error} mm, QR {qr} mm");
                }
            }
        }
    }
}

fn points_alone(rig: &Rig, left: &[[f64; 2]], right: &[[f64; 2]]) -> (Vec<[f64; 3]>, Vec<Status>) {
    let (mut points_mm, mut status) = (vec![[0.0; 3]; left.len()], vec![Status::Ok; left.len()]);
    triangulate_points(rig, left, right, &mut points_mm, &mut status).unwrap();
    (points_mm, status)
}

/// Points without covariance, which have a kernel of their own, are those with it to ten times what QR loses.
#[test]
fn points_alone_are_the_points_with_covariances() {
    for (name, _, _) in RIGS.iter() {
        for noise_px in [0.0, 0.1] {
            let cases = cases_of(name, noise_px);
            let uv = [0, 1].map(|side| cases.iter().map(|case| case.uv[side]).collect::<Vec<_>>());
            let (points_mm, status) = points_alone(&rig(name), &uv[0], &uv[1]);
            assert!(status.iter().all(|&status| status == Status::Ok));
            // With the same noise in all pixels; the references weigh each by its own.
            let noise = PixelNoise::Sigma(1.0);
            let seen = [0, 1].map(|side| Pixels { uv_px: &uv[side], noise });
            let whole = triangulate(&rig(name), &seen[0], &seen[1], 0).unwrap();
            let ours: Vec<f64> = (points_mm.iter().zip(&whole.points_mm))
                .map(|(p, q)| distance(p, &q.map(|x| [x, 0.0])))
                .collect();
            let qr: Vec<f64> =
                (cases.iter()).map(|case| distance(&second_opinion(case, 0, by_qr), &case.plain)).collect();
            for q in [0.5, 0.9, 1.0] {
                let (ours, qr) = (quantile(&ours, q), quantile(&qr, q));
                println!("{name} noise {noise_px} q{q}: points alone {ours:.1e} mm, QR {qr:.1e}");
                assert!(ours <= 10.0 * qr, "{name} q{q}: {ours} mm, QR {qr} mm");
            }
        }
    }
}

/// Pixels in single precision are what they are as doubles: nothing is lost but their own rounding.
#[test]
fn single_precision_costs_its_own_rounding_only() {
    let rig = rig("narrow_2");
    let [left, right] = noisy_batch("narrow_2", 1001);
    let [singles_left, singles_right] =
        [&left, &right].map(|uv| uv.iter().map(|uv_px| uv_px.map(|x| x as f32)).collect::<Vec<_>>());
    let [doubles_left, doubles_right] = [&singles_left, &singles_right]
        .map(|uv| uv.iter().map(|uv_px| uv_px.map(f64::from)).collect::<Vec<_>>());
    let (mut points_mm, mut status) = (vec![[0.0; 3]; 1001], vec![Status::Ok; 1001]);
    triangulate_points(&rig, &singles_left, &singles_right, &mut points_mm, &mut status).unwrap();
    let expected = points_alone(&rig, &doubles_left, &doubles_right);
    let bits = |points: &[[f64; 3]]| points.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!((bits(&points_mm), status), (bits(&expected.0), expected.1));
}

/// Equal noise in all pixels has arithmetic of its own; covariances that say the same have not.
#[test]
fn a_sigma_is_the_covariances_it_stands_for() {
    let [left, right] = noisy_batch("converging_200", 777);
    let rig = rig("converging_200");
    let sigma_px = 0.3;
    let covariances = vec![[[sigma_px * sigma_px, 0.0], [0.0, sigma_px * sigma_px]]; 777];
    for reweightings in 0..3 {
        let [short, long] =
            [PixelNoise::Sigma(sigma_px), PixelNoise::Covariances(&covariances)].map(|noise| {
                let [left, right] = [&left, &right].map(|uv_px| Pixels { uv_px, noise });
                triangulate(&rig, &left, &right, reweightings).unwrap()
            });
        assert_eq!(short.status, long.status);
        for row in 0..777 {
            assert!(distance(&short.points_mm[row], &long.points_mm[row].map(|x| [x, 0.0])) < 1e-10);
            assert!((short.reprojection_px[row] - long.reprojection_px[row]).abs() < ROUNDING_PX);
            let [a, b] = [&short, &long].map(|found| matrix(&found.covariance_mm2[row]));
            assert!((a - b).norm() < 1e-11 * b.norm());
        }
    }
}

#[test]
fn points_alone_do_not_depend_on_their_neighbours_or_on_threads() {
    let rig = rig("converging_200");
    let [left, mut right] = noisy_batch("converging_200", 50_001);
    right[17][0] = f64::NAN;
    let bits = |points: &[[f64; 3]]| points.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| points_alone(&rig, &left, &right))
    };
    let one = with_threads(1);
    for threads in [2, 8] {
        let other = with_threads(threads);
        assert_eq!((bits(&one.0), &one.1), (bits(&other.0), &other.1));
    }
    assert_eq!(one.1[17], Status::NotFinite);
    for row in [0, 16, 17, 4095, 50_000] {
        let alone = points_alone(&rig, &left[row..=row], &right[row..=row]);
        assert_eq!((bits(&alone.0), alone.1[0]), (bits(&one.0[row..=row]), one.1[row]));
    }
}

/// Two Gauss–Newton steps leave nothing of the way to the pixel minimum that the noise would not hide: the bound is a
/// thousandth of the point's own standard deviation (Mahalanobis distance).
#[test]
fn two_reweightings_reach_the_pixel_minimum() {
    for (name, _, _) in RIGS.iter() {
        let cases = cases_of(name, 0.1);
        let [plain, one, two] = [0, 1, 2].map(|reweightings| {
            let found = solve_cases(&cases, reweightings);
            let distances: Vec<f64> = cases
                .iter()
                .zip(&found.points_mm)
                .map(|(case, p)| {
                    let c = full(&case.point_covariance);
                    let d = Vector3::from(*p) - Vector3::from(case.minimum);
                    d.dot(&(c.try_inverse().unwrap() * d)).sqrt()
                })
                .collect();
            quantile(&distances, 1.0)
        });
        println!("{name}: standard deviations from the pixel minimum: {plain:.1e}, {one:.1e}, {two:.1e}");
        assert!(two < 1e-3, "{name}: {two}");
        assert!(two < plain, "{name}: {two} after, {plain} before");
    }
}

fn full(c: &[f64; 6]) -> Matrix3<f64> {
    Matrix3::new(c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5])
}

/// Inverting the normal matrix costs its condition, cond²(A): 4·10⁵ on the 2 mm rig, so 10⁻⁹ relative at most.
#[test]
fn covariance_and_reprojection_match_fifty_digits() {
    for (name, _, _) in RIGS.iter() {
        for noise_px in [0.0, 0.1] {
            let cases = cases_of(name, noise_px);
            let found = solve_cases(&cases, 2);
            let mut worst = 0.0_f64;
            for (row, case) in cases.iter().enumerate() {
                let expected = full(&case.point_covariance);
                let c = &found.covariance_mm2[row];
                let difference = Matrix3::from_fn(|i, j| c[i][j]) - expected;
                worst = worst.max(difference.norm() / expected.norm());
                assert!((found.reprojection_px[row] - case.reprojection_px).abs() < ROUNDING_PX);
            }
            println!("{name} noise {noise_px}: covariance {worst:.1e} relative");
            assert!(worst < 1e-9, "{name}: {worst}");
        }
    }
}

/// A matrix of Li's lens: rotation vector and translation of `camera_from_world`.
fn li_camera(turn: [f64; 3], translation_mm: [f64; 3]) -> SMatrix<f64, 3, 4> {
    let focal_px = 8.0 / 0.003_45;
    let k = Matrix3::new(focal_px, 0.0, 1223.5, 0.0, focal_px, 1023.5, 0.0, 0.0, 1.0);
    let mut pose = SMatrix::<f64, 3, 4>::zeros();
    pose.fixed_columns_mut::<3>(0).copy_from(Rotation3::from_scaled_axis(Vector3::from(turn)).matrix());
    pose.set_column(3, &Vector3::from(translation_mm));
    k * pose
}

fn rows_of(m: &SMatrix<f64, 3, 4>) -> Projection {
    std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]))
}

fn project(m: &SMatrix<f64, 3, 4>, p: &Vector3<f64>) -> [f64; 2] {
    let h = m * p.push(1.0);
    [h.x / h.z, h.y / h.z]
}

fn triangulate_pairs(rig: &Rig, left: &[[f64; 2]], right: &[[f64; 2]]) -> Triangulated {
    let noise = PixelNoise::Sigma(1.0);
    triangulate(rig, &Pixels { uv_px: left, noise }, &Pixels { uv_px: right, noise }, 2).unwrap()
}

/// A projection sums four terms of up to 10⁶ px·mm and divides by 400 mm or more, so with every rounding the same way
/// it is 5·10⁻¹² px wrong; the test projects and the code does so again, in two views.
const ROUNDING_PX: f64 = 2e-11;

/// What that much in the pixels moves the point by, from its covariance at 1 px.
fn rounding_mm(covariance_at_1_px: &[[f64; 3]; 3]) -> f64 {
    ROUNDING_PX * (0..3).map(|i| covariance_at_1_px[i][i]).sum::<f64>().sqrt()
}

/// A rig like Li's in an arbitrary world frame: baseline, convergence, small misalignments.
fn any_rig() -> impl Strategy<Value = [SMatrix<f64, 3, 4>; 2]> {
    (2.0..500.0_f64, prop::array::uniform3(-0.05..0.05_f64)).prop_map(|(baseline_mm, tilt)| {
        let toe_in = -(baseline_mm / 700.0).atan();
        let turn = [tilt[0], toe_in + tilt[1], tilt[2]];
        let shift = -(Rotation3::from_scaled_axis(Vector3::from(turn)) * Vector3::new(baseline_mm, 0.0, 0.0));
        [li_camera([0.0; 3], [0.0; 3]), li_camera(turn, shift.into())]
    })
}

fn any_point() -> impl Strategy<Value = Vector3<f64>> {
    (-140.0..140.0_f64, -110.0..110.0_f64, 550.0..850.0_f64).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn project_then_triangulate_is_identity(cameras in any_rig(), point in any_point()) {
        let rig = Rig::new(&rows_of(&cameras[0]), &rows_of(&cameras[1])).unwrap();
        let found = triangulate_pairs(&rig, &[project(&cameras[0], &point)], &[project(&cameras[1], &point)]);
        prop_assert_eq!(found.status[0], Status::Ok);
        let error = (Vector3::from(found.points_mm[0]) - point).norm();
        prop_assert!(error < rounding_mm(&found.covariance_mm2[0]), "{} mm", error);
        prop_assert!(found.reprojection_px[0] < ROUNDING_PX);
    }

    #[test]
    fn point_and_covariance_follow_the_world_frame(
        cameras in any_rig(),
        point in any_point(),
        noise_px in prop::array::uniform4(-0.3..0.3_f64),
        turn in prop::array::uniform3(-3.0..3.0_f64),
        shift in prop::array::uniform3(-500.0..500.0_f64),
    ) {
        let rotation = Rotation3::from_scaled_axis(Vector3::from(turn));
        let shift = Vector3::from(shift);
        let mut old_from_new = SMatrix::<f64, 4, 4>::identity();
        old_from_new.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
        old_from_new.fixed_view_mut::<3, 1>(0, 3).copy_from(&shift);
        let [left, right] = [0, 1].map(|side| {
            let [u, v] = project(&cameras[side], &point);
            [[u + noise_px[2 * side], v + noise_px[2 * side + 1]]]
        });
        let [old, new] = [SMatrix::identity(), old_from_new].map(|change| {
            let rig = Rig::new(&rows_of(&(cameras[0] * change)), &rows_of(&(cameras[1] * change))).unwrap();
            triangulate_pairs(&rig, &left, &right)
        });
        prop_assume!(old.status[0] == Status::Ok);
        prop_assert_eq!(new.status[0], Status::Ok);
        let carried = rotation * Vector3::from(new.points_mm[0]) + shift;
        let error = (carried - Vector3::from(old.points_mm[0])).norm();
        // Of the matrices in either frame, and of the products that make the new ones.
        prop_assert!(error < 3.0 * rounding_mm(&old.covariance_mm2[0]), "{} mm", error);
        let turned = rotation.matrix() * matrix(&new.covariance_mm2[0]) * rotation.matrix().transpose();
        let expected = matrix(&old.covariance_mm2[0]);
        prop_assert!((turned - expected).norm() < 1e-8 * expected.norm());
    }

    #[test]
    fn scale_and_sign_of_a_projection_matrix_mean_nothing(
        cameras in any_rig(),
        point in any_point(),
        powers in prop::array::uniform2(-20..20_i32),
    ) {
        let pixels = [0, 1].map(|side| [project(&cameras[side], &point)]);
        let plain = Rig::new(&rows_of(&cameras[0]), &rows_of(&cameras[1])).unwrap();
        // Powers of two scale without rounding, so the answer is the same to the last bit.
        let scaled = [0, 1].map(|side| rows_of(&(cameras[side] * -2.0_f64.powi(powers[side]))));
        let scaled = Rig::new(&scaled[0], &scaled[1]).unwrap();
        let [a, b] = [plain, scaled].map(|rig| triangulate_pairs(&rig, &pixels[0], &pixels[1]));
        prop_assert_eq!(bits(&a), bits(&b));
    }
}

fn matrix(c: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| c[i][j])
}

/// Everything in a result, bit by bit (NaN equals NaN).
fn bits(found: &Triangulated) -> Vec<u64> {
    let numbers = found.points_mm.iter().flatten();
    let numbers = numbers.chain(found.covariance_mm2.iter().flatten().flatten());
    let numbers = numbers.chain(&found.reprojection_px).map(|value| value.to_bits());
    numbers.chain(found.status.iter().map(|&status| status as u64)).collect()
}

/// Pixels of `n_points` points spread over the volume, moved by up to half a pixel.
fn noisy_batch(name: &str, n_points: usize) -> [Vec<[f64; 2]>; 2] {
    let cameras = projections(name).map(|p| camera(&p));
    let fraction = |i: usize, step: f64| (i as f64 * step).fract() - 0.5;
    [0, 1].map(|side| {
        (0..n_points)
            .map(|i| {
                let point = Vector3::new(
                    240.0 * fraction(i, 0.819_172_5),
                    200.0 * fraction(i, 0.671_043_6),
                    700.0 + 200.0 * fraction(i, 0.549_700_5),
                );
                let [u, v] = project(&cameras[side], &point);
                [u + fraction(i, 0.31 + side as f64), v + fraction(i, 0.77 + side as f64)]
            })
            .collect()
    })
}

#[test]
fn the_same_bits_for_any_number_of_threads_and_any_batch() {
    let rig = rig("converging_200");
    let [left, mut right] = noisy_batch("converging_200", 50_001);
    right[17][0] = f64::NAN;
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| triangulate_pairs(&rig, &left, &right))
    };
    let one = with_threads(1);
    for threads in [2, 8] {
        assert_eq!(bits(&one), bits(&with_threads(threads)));
    }
    for row in [0, 16, 17, 4095, 50_000] {
        let alone = triangulate_pairs(&rig, &left[row..=row], &right[row..=row]);
        assert_eq!(alone.points_mm[0].map(f64::to_bits), one.points_mm[row].map(f64::to_bits));
        assert_eq!(alone.status[0], one.status[row]);
    }
}

#[test]
fn an_empty_batch_is_empty() {
    let found = triangulate_pairs(&rig("parallel_20"), &[], &[]);
    assert!(found.points_mm.is_empty() && found.status.is_empty());
}

#[test]
fn bad_rows_are_named_and_leave_the_others_alone() {
    let rig = rig("parallel_20");
    let good = ([1300.0, 1000.0], [1230.0, 1000.0]);
    let rows = [
        good,
        ([f64::NAN, 1000.0], [1230.0, 1000.0]),
        ([1300.0, 1000.0], [1230.0, f64::INFINITY]),
        ([1300.0, 1e300], [1230.0, 1000.0]),
        ([1300.0, 1000.0], [1300.0, 1000.0]),
        // 0.001 px of disparity: 4·10⁻⁷ rad.
        ([1300.0, 1000.0], [1299.999, 1000.0]),
        ([1230.0, 1000.0], [1300.0, 1000.0]),
        good,
    ];
    let expected = [
        Status::Ok,
        Status::NotFinite,
        Status::NotFinite,
        Status::NotFinite,
        Status::RaysParallel,
        Status::RaysParallel,
        Status::BehindCamera,
        Status::Ok,
    ];
    let (left, right): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
    let found = triangulate_pairs(&rig, &left, &right);
    assert_eq!(found.status, expected);
    for (row, status) in expected.into_iter().enumerate() {
        let mut numbers =
            found.points_mm[row].into_iter().chain(found.covariance_mm2[row].into_iter().flatten());
        if status == Status::Ok {
            assert!(numbers.all(f64::is_finite) && found.reprojection_px[row].is_finite());
        } else {
            assert!(numbers.all(f64::is_nan) && found.reprojection_px[row].is_nan());
        }
    }
    assert_eq!(found.points_mm[0], found.points_mm[7]);
    let (points_mm, status) = points_alone(&rig, &left, &right);
    assert_eq!(status, expected);
    for (point, status) in points_mm.iter().zip(status) {
        assert!(point.iter().all(|x| x.is_finite() == (status == Status::Ok)));
    }
}

#[test]
fn a_covariance_that_is_not_positive_definite_spoils_its_row_only() {
    let pixels = ([[1300.0, 1000.0]; 5], [[1230.0, 1000.0]; 5]);
    let covariances = [
        [[1.0, 0.0], [0.0, 1.0]],
        [[0.0, 0.0], [0.0, 1.0]],
        [[1.0, 2.0], [2.0, 1.0]],
        [[1.0, f64::NAN], [f64::NAN, 1.0]],
        [[-1.0, 0.0], [0.0, -1.0]],
    ];
    let noise = PixelNoise::Sigma(1.0);
    let left = Pixels { uv_px: &pixels.0, noise };
    let right = Pixels { uv_px: &pixels.1, noise: PixelNoise::Covariances(&covariances) };
    let found = triangulate(&rig("parallel_20"), &left, &right, 2).unwrap();
    use Status::{BadCovariance, NotFinite, Ok};
    assert_eq!(found.status, [Ok, BadCovariance, BadCovariance, NotFinite, BadCovariance]);
}

#[test]
fn rigs_without_depth_are_refused() {
    let [good, _] = projections("parallel_20");
    let mut nan = good;
    nan[1][2] = f64::NAN;
    assert_eq!(
        Rig::new(&good, &nan).unwrap_err(),
        TriangulateError::ProjectionNotFinite { side: Side::Right }
    );
    let affine = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    assert!(matches!(
        Rig::new(&affine, &good).unwrap_err(),
        TriangulateError::ProjectionSingular { side: Side::Left, .. }
    ));
    assert!(matches!(Rig::new(&good, &good).unwrap_err(), TriangulateError::CentresCoincide { .. }));
    let [left, right] = projections("narrow_2");
    assert!((Rig::new(&left, &right).unwrap().baseline_mm() - 2.0).abs() < 1e-9);
}

#[test]
fn batches_that_do_not_fit_are_refused() {
    let rig = rig("parallel_20");
    let noise = PixelNoise::Sigma(1.0);
    let two = Pixels { uv_px: &[[0.0; 2]; 2], noise };
    let three = Pixels { uv_px: &[[0.0; 2]; 3], noise };
    let error = triangulate(&rig, &two, &three, 2).unwrap_err();
    assert_eq!(error, TriangulateError::LengthsDiffer { what: "the right pixels", found: 3, expected: 2 });
    let short = Pixels { noise: PixelNoise::Covariances(&[[[1.0, 0.0], [0.0, 1.0]]; 1]), ..two };
    assert!(matches!(
        triangulate(&rig, &short, &two, 2).unwrap_err(),
        TriangulateError::LengthsDiffer { found: 1, expected: 2, .. }
    ));
    for sigma_px in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let bad = Pixels { noise: PixelNoise::Sigma(sigma_px), ..two };
        assert!(matches!(
            triangulate(&rig, &two, &bad, 2).unwrap_err(),
            TriangulateError::SigmaNotPositive { .. }
        ));
    }
}
