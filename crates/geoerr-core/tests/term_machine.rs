//! The machine of terms against the model it is made of, against tables, and against differences; its inverse.

use std::collections::BTreeMap;

use geoerr_core::bases::Basis;
use geoerr_core::expression::{Definitions, Expression, Symbols};
use geoerr_core::kinematics::{
    Axis, Carrier, Chain, Channel, Component, ErrorTables, MachineModel, Squareness, Table, View,
};
use geoerr_core::newton::command_for;
use geoerr_core::volumetric::{
    Approach, MAX_WINDUPS, MachineError, Part, Rows, Shape, Term, TermMachine, VolumetricModel, displacements,
};

use crate::draws::Draws;
use crate::kinematics::machines::all_chains;

const VARIABLES: [&str; 12] =
    ["x", "y", "z", "tx", "bed_x", "d_x", "d_z", "s_x", "v_y", "temp_bed", "feed", "a_x"];
const RANGE_MM: [(f64, f64); 3] = [(0.0, 400.0), (0.0, 300.0), (-20.0, 380.0)];

fn inside(draws: &mut Draws) -> [f64; 3] {
    RANGE_MM.map(|(low, high)| low + draws.fraction() * (high - low))
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(ToString::to_string).collect()
}

/// A formula of one term; on every channel that is named, with its factor.
fn effect(channels: &[(&str, f64)], text: &str, coefficients: &[&str], inner: &[&str]) -> Term {
    let symbols =
        Symbols { variables: names(&VARIABLES), coefficients: names(coefficients), inner: names(inner) };
    let definitions = Definitions::from_iter([("T", "temp_bed - 20"), ("d", "d_x"), ("s", "s_x")]);
    let expression = Expression::parse(text, &symbols, &definitions).unwrap();
    let part = |&(channel, factor): &(&str, f64)| Part {
        channel: Channel::parse(channel).unwrap(),
        factor,
        shape: Shape::Expression {
            expression: expression.clone(),
            coefficients: (0..coefficients.len()).collect(),
            inner: (0..inner.len()).collect(),
        },
    };
    Term {
        parts: channels.iter().map(part).collect(),
        n_coefficients: coefficients.len(),
        n_inner: inner.len(),
    }
}

fn spline(channel: &str, axis: Axis, knots_mm: &[f64]) -> Term {
    let basis = Basis::bspline(knots_mm.to_vec(), 3).unwrap();
    let n_coefficients = basis.len();
    let shape = Shape::Basis { axis, basis };
    let part = Part { channel: Channel::parse(channel).unwrap(), factor: -1.5, shape };
    Term { parts: vec![part], n_coefficients, n_inner: 0 }
}

/// Terms of every kind with drawn coefficients: splines on all joints, effects on joints, bodies, squareness, rig.
fn drawn(chain: &str, draws: &mut Draws) -> (VolumetricModel, Vec<f64>, Vec<f64>) {
    let mut terms = Vec::new();
    let mut coefficients = Vec::new();
    for axis in Axis::ALL {
        let (low, high) = RANGE_MM[axis.index()];
        for component in Component::ALL {
            let channel = Channel::Joint(axis, component).name();
            let term = spline(channel, axis, &[low, 0.5 * (low + high), high]);
            let size = if component.index() < 3 { 0.3 } else { 2e-3 };
            coefficients.extend((0..term.n_coefficients).map(|_| size * draws.symmetric()));
            terms.push(term);
        }
    }
    // On a channel that is no joint error of its axis.
    let odd = spline("work-z", Axis::Y, &[0.0, 100.0, 300.0]);
    coefficients.extend((0..odd.n_coefficients).map(|_| 0.1 * draws.symmetric()));
    terms.push(odd);
    let mut inner = Vec::new();
    let mut add = |term: Term, values: &[f64], of_inner: &[f64]| {
        assert_eq!((term.n_coefficients, term.n_inner), (values.len(), of_inner.len()));
        terms.push(term);
        coefficients.extend(values);
        inner.extend(of_inner);
    };
    for (channel, size) in [("S_xy", 5e-3), ("S_xz", -3e-3), ("S_yz", 4e-3), ("tool-x", 0.2), ("EAY", 1e-3)] {
        add(effect(&[(channel, 1.0)], "c", &["c"], &[]), &[size * draws.symmetric()], &[]);
    }
    add(effect(&[("EXX", 1.0)], "alpha*T*(x - q_fixed)", &["alpha"], &["q_fixed"]), &[1.2e-5], &[150.0]);
    add(effect(&[("EXX", 1.0)], "-(b/2)*d_x", &["b"], &[]), &[0.04], &[]);
    add(effect(&[("EZZ", 1.0)], "-(b0 + b1*z)*d_z/2", &["b0", "b1"], &[]), &[0.02, 1e-4], &[]);
    add(effect(&[("EYX", 1.0), ("ECX", 3e-3)], "A*sin(2*pi*x/P)", &["A"], &["P"]), &[0.02], &[37.0]);
    add(effect(&[("EXX", 1.0)], "k*(1 - exp(-s_x/l))", &["k"], &["l"]), &[0.01], &[4.0]);
    add(effect(&[("EYY", 1.0)], "-tau*v_y", &["tau"], &[]), &[1e-3], &[]);
    // Off the joint's own axis: a rigid body cannot do it.
    add(effect(&[("EZX", 1.0), ("EBX", 1e-2)], "c*x*y^2*1e-6", &["c"], &[]), &[0.01], &[]);
    add(effect(&[("work-z", 1.0)], "a*T*(bed_x - 200)^2", &["a"], &[]), &[1e-7], &[]);
    add(effect(&[("tool-z", 1.0)], "k*T + g*y*z", &["k", "g"], &[]), &[-2e-3, 1e-6], &[]);
    add(effect(&[("target-x", 1.0)], "a*T*tx + c*z", &["a", "c"], &[]), &[2e-5, 1e-5], &[]);
    add(effect(&[("S_yz", 1.0), ("S_xy", 0.4)], "k*T + k*x/10", &["k"], &[]), &[1e-5], &[]);
    add(effect(&[("rig-scale", 1.0), ("rig-tx", 0.5)], "k*T", &["k"], &[]), &[1e-3], &[]);
    let model = VolumetricModel::new(Chain::parse(chain).unwrap(), [12.0, -7.0, -35.0], terms).unwrap();
    (model, coefficients, inner)
}

fn conditions() -> BTreeMap<String, f64> {
    BTreeMap::from([("temp_bed".to_owned(), 90.0)])
}

fn machine(model: &VolumetricModel, coefficients: &[f64], inner: &[f64]) -> TermMachine {
    TermMachine::new(model, coefficients, inner, &names(&VARIABLES), &conditions()).unwrap()
}

fn approach(draws: &mut Draws) -> Approach {
    Approach {
        direction: draws.three(1.0).map(f64::signum),
        travel_mm: draws.three(20.0).map(f64::abs),
        velocity_mm_s: draws.three(100.0),
        feed_mm_min: 3000.0,
        ..Approach::default()
    }
}

/// The same question as a row of the model.
fn row(carrier: Carrier, q_mm: [f64; 3], offset_mm: [f64; 3], approach: &Approach) -> Rows {
    let place = if carrier == Carrier::Work { offset_mm[0] } else { q_mm[0] + offset_mm[0] };
    let Approach { direction: d, travel_mm: s, velocity_mm_s: v, feed_mm_min, .. } = approach;
    let values =
        [q_mm[0], q_mm[1], q_mm[2], offset_mm[0], place, d[0], d[2], s[0], v[1], 90.0, *feed_mm_min, 0.0];
    Rows {
        carriers: vec![carrier],
        q_mm: vec![q_mm],
        offset_mm: vec![offset_mm],
        variables: values.iter().map(|&value| vec![value]).collect(),
        starts: vec![0],
        t_s: None,
    }
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|c| (a[c] - b[c]) * (a[c] - b[c])).sum::<f64>().sqrt()
}

#[test]
fn on_all_chains_it_is_the_model() {
    let mut draws = Draws::new(3);
    for chain in all_chains() {
        let (model, coefficients, inner) = drawn(&chain, &mut draws);
        let machine = machine(&model, &coefficients, &inner);
        assert_eq!(machine.rig_terms(), [model.terms().len() - 1]);
        for _ in 0..20 {
            let (q_mm, offset_mm, approach) = (inside(&mut draws), draws.three(100.0), approach(&mut draws));
            for carrier in [Carrier::Tool, Carrier::Work, Carrier::Relative] {
                let question = row(carrier, q_mm, offset_mm, &approach);
                let error = displacements(&model, &question, &coefficients, &inner).unwrap()[0];
                let nominal = model.chain().nominal(carrier, &q_mm, &offset_mm, model.tool_offset_mm());
                let expected: [f64; 3] = std::array::from_fn(|c| nominal[c] + error[c]);
                let found = match carrier {
                    Carrier::Tool => machine.tool_from_base(&q_mm, &offset_mm, &approach),
                    Carrier::Work => machine.work_from_base(&q_mm, &offset_mm, &approach),
                    _ => machine.tool_from_work(&q_mm, &offset_mm, &approach),
                };
                // Both sum the same thirty numbers, in another order, at a metre.
                assert!(distance(&found, &expected) < 1e-12, "{chain} {carrier:?}");
                if carrier == Carrier::Relative {
                    let own = machine.error(&q_mm, &offset_mm, &approach);
                    // Curves count from the middle of their cells, bases from knots: rounding of 0.3 mm, and of angles at 0.7 m.
                    assert!(distance(&own, &error) < 1e-14, "{chain}: {}", distance(&own, &error));
                }
            }
        }
    }
}

#[test]
fn the_jacobian_is_the_derivative_with_cross_terms() {
    let mut draws = Draws::new(5);
    for chain in all_chains() {
        let (model, coefficients, inner) = drawn(&chain, &mut draws);
        let machine = machine(&model, &coefficients, &inner);
        for _ in 0..10 {
            let (q_mm, offset_mm, approach) = (inside(&mut draws), draws.three(100.0), approach(&mut draws));
            let (error, jacobian) = machine.error_and_jacobian(&q_mm, &offset_mm, &approach);
            assert!(distance(&error, &machine.error(&q_mm, &offset_mm, &approach)) < 1e-14);
            for by in 0..3 {
                let at = |step: f64| {
                    let moved = std::array::from_fn(|c| q_mm[c] + if c == by { step } else { 0.0 });
                    machine.error(&moved, &offset_mm, &approach)
                };
                // Third derivatives of a wave of 37 mm and 20 µm: 1e-4 per mm²; 1e-3² / 6 of it, and rounding 1e-16 / 1e-3.
                let (plus, minus) = (at(1e-3), at(-1e-3));
                for (c, row) in jacobian.iter().enumerate() {
                    let difference = (plus[c] - minus[c]) / 2e-3 + f64::from(u8::from(c == by));
                    let off = (difference - row[by]).abs();
                    assert!(off < 2e-10, "{chain} d{c}/d{by}: {off}");
                }
            }
        }
    }
}

#[test]
fn wind_up_behind_short_strokes_is_that_of_rows() {
    // Two lengths, one of them in two terms; strokes of a fraction of a length to several.
    let terms = vec![
        effect(&[("EXX", 1.0)], "b*windup(l)", &["b"], &["l"]),
        effect(&[("EYX", 1.0), ("ECX", 2e-3)], "b*windup(l)*x/100 + c*windup(2*l)", &["b", "c"], &["l"]),
    ];
    let model = VolumetricModel::new(Chain::parse("wbXYZt").unwrap(), [0.0; 3], terms).unwrap();
    let (coefficients, inner) = ([0.06, 0.04, -0.03], [4.0, 4.0]);
    let machine = machine(&model, &coefficients, &inner);
    let lengths: Vec<f64> = machine.windups().iter().map(|windup| windup.length_mm).collect();
    assert_eq!(lengths, [4.0, 8.0]);
    assert!(machine.long_stroke_terms().is_empty());

    let mut draws = Draws::new(11);
    // A sequence whose first row has a travel begins behind a long stroke.
    let (mut x, mut d, mut s) = (200.0, 0.0, f64::INFINITY);
    let mut rows = Rows { starts: vec![0], variables: vec![Vec::new(); VARIABLES.len()], ..Rows::default() };
    let mut expected = Vec::new();
    let mut left_unwound = [0.0; MAX_WINDUPS];
    for _ in 0..200 {
        let step = 6.0 * draws.symmetric();
        if step.signum() != d {
            for (windup, left) in machine.windups().iter().zip(&mut left_unwound) {
                *left = windup.left_by(s, *left);
            }
            (d, s) = (step.signum(), 0.0);
        }
        x += step;
        s += step.abs();
        let approach = Approach {
            direction: [d, 0.0, 0.0],
            travel_mm: [s, 0.0, 0.0],
            left_unwound,
            ..Approach::default()
        };
        let one = row(Carrier::Relative, [x, 20.0, 30.0], [0.0; 3], &approach);
        rows.carriers.extend(one.carriers);
        rows.q_mm.extend(one.q_mm);
        rows.offset_mm.extend(one.offset_mm);
        rows.variables.iter_mut().zip(one.variables).for_each(|(all, own)| all.extend(own));
        expected.push(machine.error(&[x, 20.0, 30.0], &[0.0; 3], &approach));
    }
    let of_rows = displacements(&model, &rows, &coefficients, &inner).unwrap();
    for (number, (found, expected)) in of_rows.iter().zip(&expected).enumerate() {
        assert!(distance(found, expected) < 1e-14, "row {number}: {found:?}, {expected:?}");
    }
}

#[test]
fn wind_ups_that_cannot_be_followed_are_told() {
    let terms_of = |texts: &[&str]| -> (VolumetricModel, Vec<f64>) {
        let terms = texts.iter().map(|text| effect(&[("EXX", 1.0)], text, &["b"], &[])).collect();
        (
            VolumetricModel::new(Chain::parse("wbXYZt").unwrap(), [0.0; 3], terms).unwrap(),
            vec![0.01; texts.len()],
        )
    };
    let (model, b) = terms_of(&["b*windup(3)", "b*windup(3 + x/100)", "b*x"]);
    let some = machine(&model, &b, &[]);
    assert_eq!((some.windups().len(), some.long_stroke_terms()), (1, &[1][..]));

    let texts: Vec<String> = (0..MAX_WINDUPS + 2).map(|k| format!("b*windup({})", k + 1)).collect();
    let (model, b) = terms_of(&texts.iter().map(String::as_str).collect::<Vec<_>>());
    let many = machine(&model, &b, &[]);
    assert_eq!(
        (many.windups().len(), many.long_stroke_terms()),
        (MAX_WINDUPS, &[MAX_WINDUPS, MAX_WINDUPS + 1][..])
    );

    // Whoever states direction and travel has no strokes.
    let mut stated = conditions();
    stated.extend([("d_x".to_owned(), 1.0), ("s_x".to_owned(), 5.0)]);
    let still = TermMachine::new(&model, &b, &[], &names(&VARIABLES), &stated).unwrap();
    assert!(still.windups().is_empty() && still.long_stroke_terms().is_empty());
}

/// Polygons as tables and as terms.
fn tables_and_terms(chain: &str) -> (MachineModel, TermMachine) {
    let (mut errors, mut terms, mut coefficients) = (ErrorTables::default(), Vec::new(), Vec::new());
    for axis in Axis::ALL {
        let (low, high) = RANGE_MM[axis.index()];
        let knots: Vec<f64> = (0..=20).map(|k| low + f64::from(k) * (high - low) / 20.0).collect();
        for component in Component::ALL {
            let size = if component.index() < 3 { 0.2 } else { 1e-3 };
            let phase = (axis.index() * 6 + component.index()) as f64;
            let values: Vec<f64> = knots.iter().map(|q| size * (q / 70.0 + phase).sin()).collect();
            errors.set(axis, component, Table::new(knots.clone(), values.clone()).unwrap());
            let basis = Basis::linear_elements(knots.clone()).unwrap();
            let channel = Channel::Joint(axis, component);
            let part = Part { channel, factor: 1.0, shape: Shape::Basis { axis, basis } };
            terms.push(Term { parts: vec![part], n_coefficients: values.len(), n_inner: 0 });
            coefficients.extend(values);
        }
    }
    let s = Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 };
    errors.set_squareness(s).unwrap();
    for (channel, value) in [("S_xy", s.s_xy_rad), ("S_xz", s.s_xz_rad), ("S_yz", s.s_yz_rad)] {
        terms.push(effect(&[(channel, 1.0)], "c", &["c"], &[]));
        coefficients.push(value);
    }
    let (chain, tool) = (Chain::parse(chain).unwrap(), [1.0, 2.0, -3.0]);
    let model = VolumetricModel::new(chain, tool, terms).unwrap();
    (MachineModel::new(chain, errors, tool), machine(&model, &coefficients, &[]))
}

#[test]
fn of_tables_it_is_the_machine_of_tables() {
    let mut draws = Draws::new(7);
    for chain in all_chains() {
        let (tables, terms) = tables_and_terms(&chain);
        for axis in Axis::ALL {
            assert_eq!(terms.knots(axis), tables.knots(axis), "a polygon needs no further cuts");
        }
        assert!(!terms.needs().any());
        let rest = Approach::default();
        for _ in 0..20 {
            let (q, l) = (inside(&mut draws), draws.three(50.0));
            assert!(distance(&terms.error(&q, &l, &rest), &tables.error(&q, &l)) < 1e-15);
            let work = terms.work_from_base(&q, &l, &rest);
            assert!(distance(&work, &tables.work_from_base(&q, &l)) < 2e-13);
            let (own, expected) = (terms.jacobian(&q, &l, &rest), tables.jacobian(&q, &l));
            assert!((0..3).all(|row| distance(&own[row], &expected[row]) < 1e-15));
        }
    }
}

#[test]
fn compensate_then_map_is_the_identity() {
    let mut draws = Draws::new(11);
    for chain in all_chains() {
        let (model, coefficients, inner) = drawn(&chain, &mut draws);
        let machine = machine(&model, &coefficients, &inner);
        for _ in 0..20 {
            let (target, approach) = (inside(&mut draws), approach(&mut draws));
            let solution = command_for(&machine.at(approach), &target, 1e-9).unwrap();
            let error = machine.error(&solution.command_mm, &[0.0; 3], &approach);
            let actual = std::array::from_fn(|c| solution.command_mm[c] + error[c]);
            assert!(distance(&actual, &target) < 2e-9);
        }
    }
}

#[test]
fn a_belt_tooth_is_inverted_by_iteration() {
    // 20 µm with a period of 2 mm: the slope is 0.063, and a correction of 2 mm is a whole period.
    let terms = vec![
        effect(&[("EXX", 1.0)], "A*sin(2*pi*x/2)", &["A"], &[]),
        effect(&[("S_xy", 1.0)], "c", &["c"], &[]),
    ];
    let model = VolumetricModel::new(Chain::parse("wbXYZt").unwrap(), [0.0; 3], terms).unwrap();
    let machine = machine(&model, &[0.02, 5e-3], &[]);
    let mut draws = Draws::new(13);
    for _ in 0..200 {
        let target = inside(&mut draws);
        let solution = command_for(&machine.at(Approach::default()), &target, 1e-9).unwrap();
        let actual = machine.tool_from_work(&solution.command_mm, &[0.0; 3], &Approach::default());
        assert!(distance(&actual, &target) < 2e-9);
    }
}

#[test]
fn batches_are_their_rows_for_any_number_of_threads() {
    let mut draws = Draws::new(17);
    let (model, coefficients, inner) = drawn("wXYbZt", &mut draws);
    let machine = machine(&model, &coefficients, &inner);
    let q_mm: Vec<[f64; 3]> = (0..5000).map(|_| inside(&mut draws)).collect();
    let approaches: Vec<Approach> = q_mm.iter().map(|_| approach(&mut draws)).collect();
    let all = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let positions = machine.positions(View::ToolError, &q_mm, &[[0.0; 3]], &approaches).unwrap();
            let jacobians = machine.jacobians(&q_mm, &[[0.0; 3]], &approaches[..1]).unwrap();
            let commands = machine.commands_for(&q_mm, &approaches, 1e-6).unwrap();
            (positions, jacobians, commands)
        })
    };
    let one = all(1);
    assert!(all(3) == one);
    assert_eq!(one.0[4000], machine.error(&q_mm[4000], &[0.0; 3], &approaches[4000]));
    assert_eq!(one.1[4000], machine.jacobian(&q_mm[4000], &[0.0; 3], &approaches[0]));
    assert!(machine.positions(View::ToolError, &q_mm, &[[0.0; 3]; 2], &approaches).is_err());
}

#[test]
fn what_is_needed_and_not_given_is_named() {
    let terms = vec![
        effect(&[("EXX", 1.0)], "alpha*T*x - c*a_x", &["alpha", "c"], &[]),
        effect(&[("EYY", 1.0)], "-tau*v_y + b*d_x + k*feed", &["tau", "b", "k"], &[]),
        effect(&[("rig-tx", 1.0)], "k*s_x", &["k"], &[]),
    ];
    let model = VolumetricModel::new(Chain::parse("wbXYZt").unwrap(), [0.0; 3], terms).unwrap();
    let with = |coefficients: &[f64], given: &[(&str, f64)]| {
        let given = given.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        TermMachine::new(&model, coefficients, &[], &names(&VARIABLES), &given)
    };
    let values = [1e-5, 1e-3, 1e-3, 0.1, 1e-6, 1.0];
    let missing = MachineError::MissingConditions { names: names(&["a_x", "temp_bed"]) };
    assert_eq!(with(&values, &[]).unwrap_err(), missing);
    let machine = with(&values, &[("temp_bed", 20.0), ("a_x", 0.0)]).unwrap();
    assert_eq!(machine.motion_names(), ["d_x", "v_y", "feed"]);
    assert!(machine.needs().speed && machine.needs().direction == [true, false, false]);
    // What is given counts, whatever the move says.
    let still = with(&values, &[("temp_bed", 20.0), ("a_x", 0.0), ("v_y", 0.0), ("d_x", 1.0)]).unwrap();
    assert_eq!(still.motion_names(), ["feed"]);
    // What is switched off needs nothing.
    let off = with(&[0.0, 0.0, 0.0, 0.0, 0.0, 1.0], &[]).unwrap();
    assert!(off.is_nominal() && off.rig_terms() == [2]);
    assert_eq!(with(&[f64::NAN; 6], &[]).unwrap_err(), MachineError::NoValue { term: 0 });
}
