//! Error functions a second: curves against tables, six at once against six apart, rows of a design matrix.
//!
//! `cargo bench -p geoerr-bench --bench bases`

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use geoerr_core::bases::{Basis, Curve, CurveSet, Order};
use geoerr_core::kinematics::Table;

const N_POSITIONS: usize = 10_000;
const N_NODES: usize = 21;

/// All over the range, so that the next one is nowhere near.
fn positions() -> Vec<f64> {
    (0..N_POSITIONS).map(|i| 400.0 * (i as f64 * 0.618_033_988_749_895).fract()).collect()
}

fn nodes() -> Vec<f64> {
    (0..N_NODES).map(|k| 20.0 * k as f64).collect()
}

/// Coefficients of one function of a size that machines have.
fn coefficients(n: usize, phase: usize) -> Vec<f64> {
    (0..n).map(|k| 0.01 * ((k * k + 7 * phase) as f64).sin()).collect()
}

fn curve_of(basis: &Basis, phase: usize) -> Curve {
    let curve = basis.curve(&coefficients(basis.len(), phase));
    curve.unwrap_or_else(|error| unreachable!("{error}"))
}

fn checked(basis: Result<Basis, geoerr_core::bases::BasisError>) -> Basis {
    basis.unwrap_or_else(|error| unreachable!("{error}"))
}

fn bench(criterion: &mut Criterion) {
    let positions = positions();
    let linear = checked(Basis::linear_elements(nodes()));
    let cubic = checked(Basis::bspline(nodes(), 3));
    let straightness = checked(Basis::tangent_integral(cubic.clone()));

    let mut one = criterion.benchmark_group("value and slope of one function of 21 nodes");
    one.throughput(Throughput::Elements(N_POSITIONS as u64)).sample_size(30);
    let table = Table::new(nodes(), coefficients(N_NODES, 0));
    let table = table.unwrap_or_else(|error| unreachable!("{error}"));
    // A table's value is one search, its slope another; curves give both by one.
    one.bench_function("table, value alone", |bencher| {
        bencher.iter(|| positions.iter().map(|&q| table.value(black_box(q))).sum::<f64>());
    });
    for (name, basis) in
        [("linear elements", &linear), ("cubic spline", &cubic), ("tangent integral", &straightness)]
    {
        let curve = curve_of(basis, 0);
        one.bench_function(name, |bencher| {
            bencher.iter(|| {
                let both = positions.iter().map(|&q| curve.value_and_slope(black_box(q)));
                both.map(|(value, slope)| value + slope).sum::<f64>()
            });
        });
    }
    one.finish();

    let mut six = criterion.benchmark_group("values and slopes of six functions");
    six.throughput(Throughput::Elements(N_POSITIONS as u64)).sample_size(30);
    for (name, basis) in [("linear elements", &linear), ("cubic splines", &cubic)] {
        let curves: [Curve; 6] = std::array::from_fn(|phase| curve_of(basis, phase));
        let set = CurveSet::new(curves.each_ref());
        six.bench_function(format!("{name}, one search"), |bencher| {
            bencher.iter(|| {
                let all = positions.iter().map(|&q| set.values_and_slopes(black_box(q)));
                all.map(|(values, slopes)| values[5] + slopes[2]).sum::<f64>()
            });
        });
        six.bench_function(format!("{name}, six searches"), |bencher| {
            bencher.iter(|| {
                let all = positions
                    .iter()
                    .map(|&q| curves.each_ref().map(|curve| curve.value_and_slope(black_box(q))));
                all.map(|both| both[5].0 + both[2].1).sum::<f64>()
            });
        });
    }
    six.finish();

    let mut rows = criterion.benchmark_group("rows of a design matrix");
    rows.throughput(Throughput::Elements(N_POSITIONS as u64)).sample_size(20);
    for (name, basis) in [("cubic spline", &cubic), ("tangent integral", &straightness)] {
        let mut values = vec![0.0; basis.most_support()];
        rows.bench_function(format!("{name}, support"), |bencher| {
            bencher.iter(|| {
                let first = positions.iter().map(|&q| basis.support(black_box(q), &mut values).0);
                first.sum::<usize>()
            });
        });
        rows.bench_function(format!("{name}, whole rows"), |bencher| {
            bencher.iter(|| basis.rows(Order::Value, black_box(&positions)));
        });
    }
    rows.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
