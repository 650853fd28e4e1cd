//! Samples a second by integration with the line removed.
//!
//! `cargo bench -p geoerr-bench --bench straightness`

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use geoerr_bench::straightness::{positions_mm, slopes_rad};
use geoerr_core::straightness::{Rule, integrate_straightness, remove_line};
use rayon::ThreadPoolBuilder;

fn bench(criterion: &mut Criterion) {
    let positions = positions_mm();
    for threads in [1, 2] {
        let Ok(pool) = ThreadPoolBuilder::new().num_threads(threads).build() else { return };
        for n_functions in [1, 1_000, 10_000] {
            let values = slopes_rad(n_functions);
            let mut group = criterion.benchmark_group(format!("functions of 50 positions/{threads} threads"));
            group.throughput(Throughput::Elements(values.len() as u64)).sample_size(20);
            for (name, rule) in [("trapezoid", Rule::Trapezoid), ("simpson", Rule::Simpson)] {
                group.bench_function(BenchmarkId::new(name, n_functions), |bencher| {
                    pool.install(|| {
                        bencher
                            .iter(|| integrate_straightness(black_box(&positions), black_box(&values), rule))
                    });
                });
            }
            group.bench_function(BenchmarkId::new("remove_line", n_functions), |bencher| {
                pool.install(|| bencher.iter(|| remove_line(black_box(&positions), black_box(&values))));
            });
        }
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
