//! Programs corrected, in bytes of input a second.
//!
//! `cargo bench -p geoerr-bench --bench gcode`

use std::fmt::Write as _;
use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use geoerr_core::gcode::{Options, Rewriter};
use geoerr_core::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Squareness, Table};

const RANGE_MM: (f64, f64) = (-10.0, 400.0);

/// Li's squareness and, where `with_tables`, 18 bows with an entry each 10 mm.
fn machine(with_tables: bool) -> MachineModel {
    let mut errors = ErrorTables::default();
    let knots: Vec<f64> = (0..=41).map(|k| RANGE_MM.0 + 10.0 * f64::from(k)).collect();
    for axis in Axis::ALL {
        for component in Component::ALL {
            let size = if component.index() < 3 { 0.2 } else { 1e-3 };
            let phase = (axis.index() * 6 + component.index()) as f64;
            let values = knots.iter().map(|q| size * ((q / 70.0 + phase).sin() - phase.sin())).collect();
            if let (true, Ok(table)) = (with_tables, Table::new(knots.clone(), values)) {
                errors.set(axis, component, table);
            }
        }
    }
    let li = Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 };
    assert!(errors.set_squareness(li).is_ok());
    Chain::parse("wZbXYt")
        .map(|chain| MachineModel::new(chain, errors, [0.0; 3]))
        .unwrap_or_else(|error| unreachable!("{error}"))
}

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

fn rewrite(machine: &MachineModel, program: &str) -> usize {
    let Ok(mut rewriter) = Rewriter::new(machine.clone(), Options::for_range([RANGE_MM; 3])) else {
        return 0;
    };
    let mut n_bytes = 0;
    let mut out = Vec::new();
    for chunk in program.as_bytes().chunks(1 << 20).chain([b"".as_slice()]) {
        rewriter.push(chunk, chunk.is_empty());
        while rewriter.pull(&mut out).unwrap_or_else(|error| unreachable!("{error}")) {
            n_bytes += out.len();
            out.clear();
        }
    }
    n_bytes
}

fn programs(criterion: &mut Criterion) {
    let cases = [
        (
            "no errors, 1 mm moves",
            MachineModel::new(*machine(false).chain(), ErrorTables::default(), [0.0; 3]),
            1.0,
        ),
        ("squareness, 1 mm moves", machine(false), 1.0),
        ("21 errors, 1 mm moves", machine(true), 1.0),
        ("21 errors, 50 mm moves", machine(true), 50.0),
    ];
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
