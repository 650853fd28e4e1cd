//! Programs corrected, in bytes of input a second.
//!
//! `cargo bench -p geoerr-bench --bench gcode`

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use geoerr_bench::gcode::{bent, closeness, rewrite, walls};

fn programs(criterion: &mut Criterion) {
    let cases = [
        ("no errors, 1 mm moves", bent("none"), 1.0),
        ("squareness, 1 mm moves", bent("square"), 1.0),
        ("21 errors, 0.4 mm moves", bent("tables"), 0.4),
        ("21 errors, 1 mm moves", bent("tables"), 1.0),
        ("21 errors, 50 mm moves", bent("tables"), 50.0),
    ];
    for (name, machine, step_mm) in &cases {
        let text = walls(20_000, *step_mm);
        let out = String::from_utf8_lossy(&rewrite(machine, &text)).into_owned();
        let closeness = closeness(machine, &text, &out);
        println!("{name}: ends within {:.3} µm, path within {:.3} µm", closeness.ends_um, closeness.path_um);
        assert!(closeness.ends_um < 0.2 && closeness.path_um < 5.0, "{name}");
    }
    for threads in [1, rayon::current_num_threads()] {
        let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else { return };
        let mut group = criterion.benchmark_group(format!("gcode, {threads} threads"));
        for (name, machine, step_mm) in &cases {
            let text = walls(50_000, *step_mm);
            group.throughput(Throughput::Bytes(text.len() as u64)).sample_size(10);
            group.bench_function(*name, |bencher| {
                bencher.iter(|| pool.install(|| rewrite(black_box(machine), black_box(&text))));
            });
        }
        group.finish();
    }
}

criterion_group!(benches, programs);
criterion_main!(benches);
