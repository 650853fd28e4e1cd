//! Points a second by total-least-squares line fits, against nalgebra's SVD.
//!
//! `cargo bench -p geoerr-bench --bench line`

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use geoerr_bench::lines::{POINTS_OF_A_LINE, points};
use geoerr_core::line::{PointNoise, fit_lines};
use nalgebra::MatrixXx3;
use rayon::ThreadPoolBuilder;

fn bench(criterion: &mut Criterion) {
    for threads in [1, 2] {
        let Ok(pool) = ThreadPoolBuilder::new().num_threads(threads).build() else { return };
        for n_lines in [9, 300, 10_000] {
            let points = points(n_lines);
            let starts: Vec<usize> = (0..n_lines).map(|line| line * POINTS_OF_A_LINE).collect();
            let mut group = criterion.benchmark_group(format!("lines of 50 points/{threads} threads"));
            group.throughput(Throughput::Elements(points.len() as u64)).sample_size(20);
            group.bench_function(BenchmarkId::new("fit_lines", n_lines), |bencher| {
                pool.install(|| {
                    bencher.iter(|| fit_lines(black_box(&points), &starts, PointNoise::FromResiduals))
                });
            });
            if threads == 1 {
                group.bench_function(BenchmarkId::new("nalgebra SVD, direction only", n_lines), |bencher| {
                    bencher.iter(|| -> f64 {
                        let lines = black_box(&points).chunks_exact(POINTS_OF_A_LINE);
                        lines.map(|line| direction_by_svd(line)[0]).sum()
                    });
                });
            }
        }
    }
}

fn direction_by_svd(line: &[[f64; 3]]) -> [f64; 3] {
    let mean = [0, 1, 2].map(|j| line.iter().map(|p| p[j]).sum::<f64>() / line.len() as f64);
    let centred = MatrixXx3::from_fn(line.len(), |i, j| line[i][j] - mean[j]);
    let svd = centred.svd(false, true);
    svd.v_t.map_or([f64::NAN; 3], |v_t| [0, 1, 2].map(|j| v_t[(0, j)]))
}

criterion_group!(benches, bench);
criterion_main!(benches);
