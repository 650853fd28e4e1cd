//! Programs corrected, in bytes of input a second.
//!
//! `cargo bench -p geoerr-bench --bench gcode`

use std::fmt::Write as _;
use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use geoerr_bench::gcode::{RANGE_MM, bent, closeness};
use geoerr_core::gcode::{Options, Rewriter};
use geoerr_core::kinematics::MachineModel;

/// Walls of a sliced part: moves of `step_mm`, extrusion, now and then a comment.
fn program(n_moves: u32, step_mm: f64) -> String {
    let mut text = String::from("G21\nG90\nM83\nG28\nG1 X200 Y200 Z.2 F7800\n");
    let radius_mm = 100.0;
    for i in 0..n_moves {
        let turn = f64::from(i) * step_mm / radius_mm;
        let (x, y) = (200.0 + radius_mm * turn.cos(), 200.0 + radius_mm * turn.sin());
        if i % 500 == 0 {
            let _ = write!(text, ";LAYER:{}\nG1 Z{:.2}\n", i / 500, 0.2 + 0.01 * f64::from(i / 500));
        }
        let _ = writeln!(text, "G1 X{x:.3} Y{y:.3} E.06669");
    }
    text
}

fn rewrite(machine: &MachineModel, program: &str) -> Vec<u8> {
    let mut out = Vec::new();
    let Ok(mut rewriter) = Rewriter::new(machine.clone(), Options::for_range([RANGE_MM; 3])) else {
        return out;
    };
    for chunk in program.as_bytes().chunks(1 << 20).chain([b"".as_slice()]) {
        rewriter.push(chunk, chunk.is_empty());
        while rewriter.pull(&mut out).unwrap_or_else(|error| unreachable!("{error}")) {}
    }
    out
}

fn programs(criterion: &mut Criterion) {
    let cases = [
        ("no errors, 1 mm moves", bent("none"), 1.0),
        ("squareness, 1 mm moves", bent("square"), 1.0),
        ("21 errors, 0.4 mm moves", bent("tables"), 0.4),
        ("21 errors, 1 mm moves", bent("tables"), 1.0),
        ("21 errors, 50 mm moves", bent("tables"), 50.0),
    ];
    for (name, machine, step_mm) in &cases {
        let text = program(20_000, *step_mm);
        let out = String::from_utf8_lossy(&rewrite(machine, &text)).into_owned();
        let closeness = closeness(machine, &text, &out);
        println!("{name}: ends within {:.3} µm, path within {:.3} µm", closeness.ends_um, closeness.path_um);
        assert!(closeness.ends_um < 0.2 && closeness.path_um < 5.0, "{name}");
    }
    for threads in [1, rayon::current_num_threads()] {
        let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(threads).build() else { return };
        let mut group = criterion.benchmark_group(format!("gcode, {threads} threads"));
        for (name, machine, step_mm) in &cases {
            let text = program(50_000, *step_mm);
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
