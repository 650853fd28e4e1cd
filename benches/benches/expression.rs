//! Formulas over 10,000 rows on one thread: the core's engine, two crates that parse and evaluate formulas, and the
//! same written out in Rust.
//!
//! `cargo bench -p geoerr-bench --bench expression`

use std::error::Error;
use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use exmex::{Differentiate, Express};
use geoerr_core::expression::{Definitions, Expression, Rows, Symbols};
use rayon::ThreadPoolBuilder;

const N_ROWS: usize = 10_000;
/// The variables of all formulas, and their values in one row.
const VARIABLES: [&str; 4] = ["T", "d", "q", "s"];
type Row = [f64; 4];

struct Formula {
    name: &'static str,
    text: &'static str,
    /// As fasteval writes it: it has no `exp`, and its pi is a function.
    fasteval: &'static str,
    coefficients: &'static [(&'static str, f64)],
    inner: (&'static str, f64),
    by_hand: fn(&Row) -> f64,
    inner_by_hand: fn(&Row) -> f64,
}

const FORMULAS: [Formula; 3] = [
    Formula {
        name: "expansion",
        text: "alpha*T*(q - q_fixed)",
        fasteval: "alpha*T*(q - q_fixed)",
        coefficients: &[("alpha", 1.15e-5)],
        inner: ("q_fixed", 30.0),
        by_hand: |&[t, _, q, _]| 1.15e-5 * t * (q - 30.0),
        inner_by_hand: |&[t, ..]| -1.15e-5 * t,
    },
    Formula {
        name: "periodic",
        text: "A*sin(2*3.141592653589793*q/P) + B*cos(2*3.141592653589793*q/P)",
        fasteval: "A*sin(2*pi()*q/P) + B*cos(2*pi()*q/P)",
        coefficients: &[("A", 0.02), ("B", -0.01)],
        inner: ("P", 4.0),
        by_hand: |&[_, _, q, _]| {
            let phase = 2.0 * std::f64::consts::PI * q / 4.0;
            0.02 * phase.sin() - 0.01 * phase.cos()
        },
        inner_by_hand: |&[_, _, q, _]| {
            let phase = 2.0 * std::f64::consts::PI * q / 4.0;
            (0.02 * phase.cos() + 0.01 * phase.sin()) * (-phase / 4.0)
        },
    },
    Formula {
        name: "reversal",
        text: "-(b/2)*d*(1 - 2*exp(-s/lambda))",
        fasteval: "-(b/2)*d*(1 - 2*e()^(-s/lambda))",
        coefficients: &[("b", 0.03)],
        inner: ("lambda", 2.5),
        by_hand: |&[_, d, _, s]| -(0.03 / 2.0) * d * (1.0 - 2.0 * (-s / 2.5).exp()),
        inner_by_hand: |&[_, d, _, s]| 0.03 * d * (-s / 2.5).exp() * s / (2.5 * 2.5),
    },
];

fn rows() -> Vec<Row> {
    let fraction = |i: usize, step: f64| (i as f64 * step).fract();
    (0..N_ROWS)
        .map(|i| {
            let d = if fraction(i, 0.77) > 0.5 { 1.0 } else { -1.0 };
            [40.0 * fraction(i, 0.31), d, 400.0 * fraction(i, 0.618), 20.0 * fraction(i, 0.41)]
        })
        .collect()
}

/// What every rival needs of a formula: its value at a row, and that of its derivative by the inner parameter.
fn with_exmex(formula: &Formula) -> Result<[impl Fn(&Row) -> f64 + use<>; 2], Box<dyn Error>> {
    let value = exmex::parse::<f64>(formula.text)?;
    let place =
        value.var_names().iter().position(|name| name == formula.inner.0).ok_or("no inner parameter")?;
    let slope = value.clone().partial(place)?;
    let (coefficients, inner) = (formula.coefficients, formula.inner);
    Ok([value, slope].map(|expression| {
        let names: Vec<String> = expression.var_names().to_vec();
        // On the stack, so that the rival does not pay for its harness.
        let mut values = [0.0; 8];
        let mut from_row = Vec::new();
        for (place, name) in names.iter().enumerate() {
            match VARIABLES.iter().position(|variable| variable == name) {
                Some(column) => from_row.push((place, column)),
                None => {
                    let parameter = coefficients.iter().chain([&inner]).find(|(known, _)| known == name);
                    values[place] = parameter.map_or(f64::NAN, |(_, value)| *value);
                }
            }
        }
        move |row: &Row| {
            let mut values = values;
            for &(place, column) in &from_row {
                values[place] = row[column];
            }
            expression.eval(&values[..names.len()]).unwrap_or(f64::NAN)
        }
    }))
}

fn with_fasteval(formula: &Formula) -> Result<impl Fn(&Row) -> f64 + use<>, Box<dyn Error>> {
    use fasteval::{Compiler, Evaler};
    let mut slab = fasteval::Slab::new();
    let parsed = fasteval::Parser::new().parse(formula.fasteval, &mut slab.ps)?.from(&slab.ps);
    let compiled = parsed.compile(&slab.ps, &mut slab.cs);
    let (coefficients, inner) = (formula.coefficients, formula.inner);
    Ok(move |row: &Row| {
        let mut value_of = |name: &str, _: Vec<f64>| match name {
            "T" => Some(row[0]),
            "d" => Some(row[1]),
            "q" => Some(row[2]),
            "s" => Some(row[3]),
            _ => {
                coefficients.iter().chain([&inner]).find(|(known, _)| *known == name).map(|(_, value)| *value)
            }
        };
        compiled.eval(&slab, &mut value_of).unwrap_or(f64::NAN)
    })
}

/// Rivals must compute the same before their speed means anything.
fn check(formula: &Formula, what: &str, found: &[f64], expected: impl Fn(&Row) -> f64, rows: &[Row]) {
    for (found, row) in found.iter().zip(rows) {
        let expected = expected(row);
        let scale = expected.abs().max(1e-3);
        assert!((found - expected).abs() < 1e-10 * scale, "{what} of {}: {found}, {expected}", formula.name);
    }
}

fn bench_formula(criterion: &mut Criterion, formula: &Formula) -> Result<(), Box<dyn Error>> {
    let table = rows();
    let columns: Vec<Vec<f64>> = (0..4).map(|k| table.iter().map(|row| row[k]).collect()).collect();
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let rows = Rows { variables: &columns, n_rows: N_ROWS, starts: &[], t: None };
    let symbols = Symbols {
        variables: VARIABLES.map(str::to_owned).to_vec(),
        coefficients: formula.coefficients.iter().map(|(name, _)| (*name).to_owned()).collect(),
        inner: vec![formula.inner.0.to_owned()],
    };
    let coefficients: Vec<f64> = formula.coefficients.iter().map(|(_, value)| *value).collect();
    let inner = [formula.inner.1];
    let ours = Expression::parse(formula.text, &symbols, &Definitions::default())?;
    let [exmex, exmex_slope] = with_exmex(formula)?;
    let fasteval = with_fasteval(formula)?;
    let mut out = vec![0.0; N_ROWS];

    ours.evaluate(&rows, 0..N_ROWS, &coefficients, &inner, &mut out)?;
    check(formula, "value", &out, formula.by_hand, &table);
    check(formula, "exmex", &table.iter().map(&exmex).collect::<Vec<_>>(), formula.by_hand, &table);
    check(formula, "fasteval", &table.iter().map(&fasteval).collect::<Vec<_>>(), formula.by_hand, &table);
    ours.inner_derivatives(&rows, 0..N_ROWS, &coefficients, &inner, &mut out)?;
    check(formula, "derivative", &out, formula.inner_by_hand, &table);
    let slopes: Vec<f64> = table.iter().map(&exmex_slope).collect();
    check(formula, "exmex's derivative", &slopes, formula.inner_by_hand, &table);

    let each_row = |out: &mut [f64], f: &dyn Fn(&Row) -> f64| {
        for (value, row) in out.iter_mut().zip(black_box(&table)) {
            *value = f(row);
        }
    };
    let mut group = criterion.benchmark_group(format!("10,000 rows/{}", formula.name));
    group.throughput(Throughput::Elements(N_ROWS as u64)).sample_size(20);
    group.bench_function("value/geoerr", |b| {
        b.iter(|| ours.evaluate(black_box(&rows), 0..N_ROWS, &coefficients, &inner, &mut out));
    });
    group.bench_function("value/by hand", |b| {
        b.iter(|| {
            for (value, row) in out.iter_mut().zip(black_box(&table)) {
                *value = (formula.by_hand)(row);
            }
        });
    });
    group.bench_function("value/exmex", |b| b.iter(|| each_row(&mut out, &exmex)));
    group.bench_function("value/fasteval", |b| b.iter(|| each_row(&mut out, &fasteval)));
    group.bench_function("by the inner parameter/geoerr", |b| {
        b.iter(|| ours.inner_derivatives(black_box(&rows), 0..N_ROWS, &coefficients, &inner, &mut out));
    });
    group.bench_function("by the inner parameter/exmex", |b| b.iter(|| each_row(&mut out, &exmex_slope)));
    let mut wide = vec![0.0; N_ROWS * coefficients.len()];
    group.bench_function("columns/geoerr", |b| {
        b.iter(|| ours.coefficient_columns(black_box(&rows), 0..N_ROWS, &inner, &mut wide));
    });
    group.bench_function("one by one with gradient/geoerr", |b| {
        b.iter(|| -> f64 {
            let value =
                |row: &Row| ours.evaluate_at(row, &coefficients, &inner).map_or(0.0, |(value, _)| value);
            black_box(&table).iter().map(value).sum()
        });
    });
    group.finish();
    criterion.bench_function(&format!("parse/{}/geoerr", formula.name), |b| {
        b.iter(|| Expression::parse(black_box(formula.text), &symbols, &Definitions::default()).is_ok());
    });
    criterion.bench_function(&format!("parse/{}/exmex", formula.name), |b| {
        b.iter(|| exmex::parse::<f64>(black_box(formula.text)).is_ok());
    });
    Ok(())
}

fn bench(criterion: &mut Criterion) {
    // One thread for everybody: the rivals know no more.
    assert!(ThreadPoolBuilder::new().num_threads(1).build_global().is_ok());
    for formula in &FORMULAS {
        let outcome = bench_formula(criterion, formula).map_err(|error| error.to_string());
        assert_eq!(outcome, Ok(()), "{}", formula.name);
    }
}

criterion_group!(benches, bench);
criterion_main!(benches);
