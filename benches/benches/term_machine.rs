//! A machine of terms beside the machine of tables, and a built-in effect beside the same one as a user writes it.
//!
//! `cargo bench -p geoerr-bench --bench term_machine`

use std::collections::BTreeMap;
use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use geoerr_core::bases::Basis;
use geoerr_core::expression::{Definitions, Expression, Symbols};
use geoerr_core::kinematics::{
    Axis, Chain, Channel, Component, ErrorTables, MachineModel, Squareness, Table,
};
use geoerr_core::newton::{ErrorMap, command_for};
use geoerr_core::volumetric::{Approach, Part, Shape, Term, TermMachine, VolumetricModel};

const N_ROWS: usize = 20_000;
const ORIGIN: [f64; 3] = [0.0; 3];
const VARIABLES: [&str; 3] = ["x", "d_x", "temp_bed"];

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(ToString::to_string).collect()
}

fn formula(
    channel: &str,
    text: &str,
    coefficients: &[&str],
    inner: &[&str],
    definitions: &[(&str, &str)],
) -> Term {
    let symbols =
        Symbols { variables: names(&VARIABLES), coefficients: names(coefficients), inner: names(inner) };
    let definitions = Definitions::from_iter(definitions.iter().copied());
    let expression = Expression::parse(text, &symbols, &definitions);
    let expression = expression.unwrap_or_else(|error| unreachable!("{error}"));
    let channel = Channel::parse(channel).unwrap_or_else(|error| unreachable!("{error}"));
    let shape = Shape::Expression {
        expression,
        coefficients: (0..coefficients.len()).collect(),
        inner: (0..inner.len()).collect(),
    };
    Term {
        parts: vec![Part { channel, factor: 1.0, shape }],
        n_coefficients: coefficients.len(),
        n_inner: inner.len(),
    }
}

fn machine(terms: Vec<Term>, coefficients: &[f64], inner: &[f64]) -> TermMachine {
    let made = || {
        let model = VolumetricModel::new(Chain::parse("wZbXYt").ok()?, ORIGIN, terms).ok()?;
        let conditions = BTreeMap::from([("temp_bed".to_owned(), 90.0)]);
        TermMachine::new(&model, coefficients, inner, &names(&VARIABLES), &conditions).ok()
    };
    made().unwrap_or_else(|| unreachable!("terms that fit"))
}

/// Li's printer: a table entry each 20 mm, his squareness; as tables and as terms, and with cubic splines.
fn machines() -> (MachineModel, TermMachine, TermMachine) {
    let mut errors = ErrorTables::default();
    let (mut polygons, mut splines) = (Vec::new(), Vec::new());
    let (mut values_of_polygons, mut values_of_splines) = (Vec::new(), Vec::new());
    let knots: Vec<f64> = (0..=20).map(|k| 20.0 * f64::from(k)).collect();
    for axis in Axis::ALL {
        for component in Component::ALL {
            let size = if component.index() < 3 { 0.2 } else { 1e-3 };
            let phase = (axis.index() * 6 + component.index()) as f64;
            let values: Vec<f64> = knots.iter().map(|q| size * (q / 70.0 + phase).sin()).collect();
            let part = |basis| Part {
                channel: Channel::Joint(axis, component),
                factor: 1.0,
                shape: Shape::Basis { axis, basis },
            };
            if let (Ok(table), Ok(lines), Ok(cubics)) = (
                Table::new(knots.clone(), values.clone()),
                Basis::linear_elements(knots.clone()),
                Basis::bspline(knots[..=18].to_vec(), 3),
            ) {
                errors.set(axis, component, table);
                values_of_splines.extend(&values[..cubics.len()]);
                values_of_polygons.extend(&values);
                for (terms, basis) in [(&mut polygons, lines), (&mut splines, cubics)] {
                    let n_coefficients = basis.len();
                    terms.push(Term { parts: vec![part(basis)], n_coefficients, n_inner: 0 });
                }
            }
        }
    }
    let li = Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 };
    assert!(errors.set_squareness(li).is_ok());
    for (channel, value) in [("S_xy", li.s_xy_rad), ("S_xz", li.s_xz_rad), ("S_yz", li.s_yz_rad)] {
        for (terms, values) in
            [(&mut polygons, &mut values_of_polygons), (&mut splines, &mut values_of_splines)]
        {
            terms.push(formula(channel, "S", &["S"], &[], &[]));
            values.push(value);
        }
    }
    let tables = Chain::parse("wZbXYt").map(|chain| MachineModel::new(chain, errors, ORIGIN));
    let tables = tables.unwrap_or_else(|error| unreachable!("{error}"));
    (tables, machine(polygons, &values_of_polygons, &[]), machine(splines, &values_of_splines, &[]))
}

fn rows() -> Vec<[f64; 3]> {
    let golden = [0.618_033_988_749_895, 0.754_877_666_246_693, 0.819_172_513_396_164];
    (0..N_ROWS).map(|k| golden.map(|step| 360.0 * (k as f64 * step).fract())).collect()
}

fn inverse(
    group: &mut criterion::BenchmarkGroup<'_, criterion::measurement::WallTime>,
    name: &str,
    map: &impl ErrorMap,
) {
    let rows = rows();
    group.bench_function(format!("{name}: error and jacobian"), |b| {
        b.iter(|| rows.iter().for_each(|q| _ = black_box(map.error_and_jacobian(q))));
    });
    group.bench_function(format!("{name}: command to 1e-6 mm"), |b| {
        b.iter(|| rows.iter().for_each(|q| _ = black_box(command_for(map, q, 1e-6))));
    });
}

fn one_thread(criterion: &mut Criterion) {
    let (tables, polygons, splines) = machines();
    let mut group = criterion.benchmark_group("term machine, 20000 rows, one thread");
    group.throughput(Throughput::Elements(N_ROWS as u64)).sample_size(20);
    let rest = Approach::default();
    inverse(&mut group, "tables", &tables);
    inverse(&mut group, "the same as terms", &polygons.at(rest));
    inverse(&mut group, "cubic splines", &splines.at(rest));
    let built_in = [
        formula("EXX", "-(b/2)*d", &["b"], &[], &[("d", "d_x")]),
        formula(
            "EXX",
            "alpha*T*(q - q_fixed)",
            &["alpha"],
            &["q_fixed"],
            &[("T", "temp_bed - 20"), ("q", "x")],
        ),
    ];
    let own = [
        formula("EXX", "-0.5*play*d_x", &["play"], &[], &[]),
        formula("EXX", "growth*(temp_bed - 20)*(x - zero)", &["growth"], &["zero"], &[]),
    ];
    let forward = Approach { direction: [1.0; 3], ..rest };
    for (name, terms) in [("effects of the catalogue", built_in), ("a user's own", own)] {
        inverse(&mut group, name, &machine(terms.to_vec(), &[0.05, 1.2e-5], &[200.0]).at(forward));
    }
    group.finish();
}

criterion_group!(benches, one_thread);
criterion_main!(benches);
