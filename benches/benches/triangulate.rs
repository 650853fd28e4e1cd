//! Points a second by two-view triangulation, against the same least squares by nalgebra's QR.
//!
//! `cargo bench -p geoerr-bench --bench triangulate`

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use geoerr_bench::triangulation::{Projection, pixels, projections};
use geoerr_core::triangulate::{PixelNoise, Pixels, Rig, Status, triangulate, triangulate_points};
use nalgebra::{Matrix4x3, Vector3, Vector4};
use rayon::ThreadPoolBuilder;

/// One point by QR of its four rows, without covariance or status.
fn by_qr(projections: &[Projection; 2], uv: [&[f64; 2]; 2]) -> Option<Vector3<f64>> {
    let row = |i: usize, j: usize| {
        let (m, uv) = (&projections[i / 2], uv[i / 2]);
        uv[i % 2] * m[2][j] - m[i % 2][j]
    };
    let qr = Matrix4x3::from_fn(row).qr();
    let b = Vector4::from_fn(|i, _| -row(i, 3));
    qr.r().solve_upper_triangular(&(qr.q().transpose() * b))
}

fn bench(criterion: &mut Criterion) {
    let projections = projections();
    let Ok(rig) = Rig::new(&projections[0], &projections[1]) else { return };
    for threads in [1, 2] {
        let Ok(pool) = ThreadPoolBuilder::new().num_threads(threads).build() else { return };
        for n_points in [1_000, 8_000, 16_000, 100_000] {
            let mut group = criterion.benchmark_group(format!("triangulate/{threads} threads"));
            group.throughput(Throughput::Elements(n_points as u64)).sample_size(20);
            let [left, right] = [0, 1].map(|side| pixels(&projections[side], n_points));
            let covariances = vec![[[0.01, 0.002], [0.002, 0.02]]; n_points];
            let sigma = PixelNoise::Sigma(0.1);
            for (name, noise, reweightings) in [
                ("as printed", sigma, 0),
                ("1 reweighting", sigma, 1),
                ("2 reweightings", sigma, 2),
                ("2 reweightings, covariances", PixelNoise::Covariances(&covariances), 2),
            ] {
                let seen = [&left, &right].map(|uv_px| Pixels { uv_px, noise });
                group.bench_function(BenchmarkId::new(name, n_points), |bencher| {
                    pool.install(|| {
                        bencher.iter(|| {
                            triangulate(&rig, black_box(&seen[0]), black_box(&seen[1]), reweightings)
                        })
                    });
                });
            }
            let (mut points_mm, mut status) = (vec![[0.0; 3]; n_points], vec![Status::Ok; n_points]);
            group.bench_function(BenchmarkId::new("points alone", n_points), |bencher| {
                pool.install(|| {
                    bencher.iter(|| {
                        let seen = (black_box(&left), black_box(&right));
                        triangulate_points(&rig, seen.0, seen.1, &mut points_mm, &mut status)
                    })
                });
            });
            if threads == 1 {
                group.bench_function(BenchmarkId::new("nalgebra QR, points only", n_points), |bencher| {
                    bencher.iter(|| -> Vec<_> {
                        left.iter().zip(&right).map(|(l, r)| by_qr(black_box(&projections), [l, r])).collect()
                    });
                });
            }
        }
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
