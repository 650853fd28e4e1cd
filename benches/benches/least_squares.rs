//! Tall systems a second: QR, normal equations, solution, blocks left out; nalgebra's QR for comparison.
//!
//! `cargo bench -p geoerr-bench --bench least_squares`

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use geoerr_bench::least_squares::{random, sparse};
use geoerr_core::least_squares::{
    Blocks, LeastSquaresError, Method, Options, StoredDesign, Triangle, fit, leave_blocks_out, solve,
};
use nalgebra::DMatrix;
use rayon::ThreadPoolBuilder;

fn systems(criterion: &mut Criterion) -> Result<(), LeastSquaresError> {
    for (m, n) in [(3_000, 100), (30_000, 300), (300_000, 300)] {
        for (kind, a) in [("dense", random(m, n)), ("sparse", sparse(m, n))] {
            if kind == "sparse" && m == 300_000 {
                continue;
            }
            let b = random(m, 1);
            let design = StoredDesign::new(&a, &b)?;
            for threads in [1, 2] {
                let Ok(pool) = ThreadPoolBuilder::new().num_threads(threads).build() else { return Ok(()) };
                let mut group = criterion.benchmark_group(format!("{kind} {m} x {n}/{threads} threads"));
                // Operations of a Householder QR: elements a second are FLOP/s of QR, whatever the path.
                group
                    .throughput(Throughput::Elements((2 * m * n * n - 2 * n * n * n / 3) as u64))
                    .sample_size(10);
                group.bench_function(BenchmarkId::from_parameter("triangle"), |bencher| {
                    pool.install(|| bencher.iter(|| Triangle::of(black_box(&design))));
                });
                for (name, method) in [("qr", Method::Qr), ("fastest", Method::Fastest)] {
                    group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
                        pool.install(|| {
                            bencher.iter(|| fit(black_box(&design), &Options::default(), method))
                        });
                    });
                }
                if m == 30_000 {
                    let triangle = Triangle::of(&design)?;
                    let solution = solve(&triangle, &Options::default())?;
                    let spectrum = Options { wants_singular_values: true, ..Options::default() };
                    for (name, options) in [("solve", &Options::default()), ("solve by svd", &spectrum)] {
                        group.bench_function(BenchmarkId::from_parameter(name), |bencher| {
                            pool.install(|| bencher.iter(|| solve(black_box(&triangle), options)));
                        });
                    }
                    let starts: Vec<usize> = (0..m / 3).map(|block| 3 * block).collect();
                    let blocks = Blocks::starting_at(&starts, m)?;
                    group.bench_function(BenchmarkId::from_parameter("leave 10,000 blocks out"), |bencher| {
                        pool.install(|| {
                            bencher.iter(|| leave_blocks_out(black_box(&design), &solution, &blocks, 0))
                        });
                    });
                }
                if (m, threads, kind) == (3_000, 1, "dense") {
                    let peer = DMatrix::from_column_slice(m, n, a.as_slice());
                    group.bench_function(BenchmarkId::from_parameter("nalgebra QR, R only"), |bencher| {
                        bencher.iter(|| black_box(&peer).clone().qr().r());
                    });
                }
            }
        }
    }
    Ok(())
}

fn bench(criterion: &mut Criterion) {
    if let Err(error) = systems(criterion) {
        unreachable!("{error}");
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
