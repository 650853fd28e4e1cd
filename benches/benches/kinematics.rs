//! Positions, Jacobians and commands a second, against a chain of nalgebra isometries.
//!
//! `cargo bench -p geoerr-bench --bench kinematics`

use std::hint::black_box;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use geoerr_bench::kinematics::{machine, rows};
use geoerr_core::kinematics::{
    Axis, Carrier, Channel, Component, Displacements, MachineModel, Points, View, jacobians, positions,
};
use geoerr_core::newton::{command_for, commands_for};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

const N_ROWS: usize = 100_000;
const ORIGIN: [f64; 3] = [0.0; 3];

/// The theory's product, written down as it stands: one search a table, one isometry an axis.
fn with_isometries(machine: &MachineModel, directions: &[Vector3<f64>; 3], q: &[f64; 3]) -> Point3<f64> {
    let side = |axes: &[Axis], sign: f64| {
        axes.iter().fold(Isometry3::identity(), |product, &axis| {
            let at = |component| machine.errors().table(axis, component).value(q[axis.index()]);
            let delta = Vector3::new(at(Component::X), at(Component::Y), at(Component::Z));
            let epsilon = Vector3::new(at(Component::A), at(Component::B), at(Component::C));
            let translation = sign * (q[axis.index()] * directions[axis.index()] + delta);
            let rotation = UnitQuaternion::from_scaled_axis(sign * epsilon);
            product * Isometry3::from_parts(Translation3::from(translation), rotation)
        })
    };
    let (tool, work) = (side(machine.chain().tool_axes(), 1.0), side(machine.chain().work_axes(), -1.0));
    work.inverse() * tool * Point3::origin()
}

/// One number a channel: 0.2 mm, 1 mrad.
fn channels() -> Vec<[f64; Channel::MACHINE_COUNT]> {
    let number = |row: usize, k: usize| {
        let is_angle = k < 18 && k % 6 >= 3 || (18..21).contains(&k);
        ((row * 31 + k * 7) as f64).sin() * if is_angle { 1e-3 } else { 0.2 }
    };
    (0..N_ROWS).map(|row| std::array::from_fn(|k| number(row, k))).collect()
}

fn one_thread(criterion: &mut Criterion) {
    let (machine, rows) = (machine(), rows(N_ROWS));
    let directions = [Vector3::x(), Vector3::new(5.05e-3, 1.0, 0.0), Vector3::new(-1.24e-3, -3.84e-3, 1.0)];
    let mut group = criterion.benchmark_group("kinematics, 100000 rows, one thread");
    group.throughput(Throughput::Elements(N_ROWS as u64));
    group.sample_size(20);
    group.bench_function("position", |b| {
        b.iter(|| rows.iter().for_each(|q| _ = black_box(machine.tool_from_work(q, &ORIGIN))));
    });
    group.bench_function("position, isometries of nalgebra", |b| {
        b.iter(|| rows.iter().for_each(|q| _ = black_box(with_isometries(&machine, &directions, q))));
    });
    group.bench_function("jacobian", |b| {
        b.iter(|| rows.iter().for_each(|q| _ = black_box(machine.jacobian(q, &ORIGIN))));
    });
    let channels = channels();
    group.bench_function("displacement from explicit numbers", |b| {
        b.iter(|| {
            for (q, numbers) in rows.iter().zip(&channels) {
                let numbers = Displacements::from_channels(numbers);
                black_box(machine.chain().displacement(Carrier::Relative, q, &ORIGIN, &ORIGIN, &numbers));
            }
        });
    });
    group.bench_function("channel columns", |b| {
        b.iter(|| {
            for q in &rows {
                black_box(machine.chain().channel_columns(Carrier::Relative, q, &ORIGIN, &ORIGIN));
            }
        });
    });
    for tolerance_mm in [1e-3, 1e-6, 1e-9] {
        group.bench_function(format!("command to {tolerance_mm:e} mm"), |b| {
            b.iter(|| rows.iter().for_each(|q| _ = black_box(command_for(&machine, q, tolerance_mm))));
        });
    }
    group.finish();
}

fn batches(criterion: &mut Criterion) {
    let (machine, rows) = (machine(), rows(N_ROWS));
    let mut group = criterion.benchmark_group("kinematics, 100000 rows, all threads");
    group.throughput(Throughput::Elements(N_ROWS as u64));
    group.sample_size(20);
    group.bench_function("positions", |b| {
        b.iter_batched(
            || (),
            |()| positions(&machine, View::ToolFromWork, &rows, &[ORIGIN]),
            BatchSize::LargeInput,
        );
    });
    group.bench_function("jacobians", |b| {
        b.iter_batched(|| (), |()| jacobians(&machine, &rows, &[ORIGIN]), BatchSize::LargeInput);
    });
    let (carriers, offsets, channels) = (vec![Carrier::Relative; N_ROWS], vec![ORIGIN; N_ROWS], channels());
    let points = Points {
        chain: machine.chain(),
        tool_offset_mm: ORIGIN,
        carriers: &carriers,
        q_mm: &rows,
        offsets_mm: &offsets,
    };
    group.bench_function("displacements from explicit numbers", |b| {
        b.iter_batched(|| (), |()| points.displacement(&channels), BatchSize::LargeInput);
    });
    group.bench_function("channel columns", |b| {
        b.iter_batched(|| (), |()| points.channel_columns(), BatchSize::LargeInput);
    });
    group.bench_function("commands to 1e-6 mm", |b| {
        b.iter_batched(|| (), |()| commands_for(&machine, &rows, 1e-6), BatchSize::LargeInput);
    });
    group.finish();
}

criterion_group!(benches, one_thread, batches);
criterion_main!(benches);
