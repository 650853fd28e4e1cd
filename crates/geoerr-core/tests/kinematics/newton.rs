//! The inverse: compensate∘map is the identity, on machines made to be hard to invert too.

use geoerr_core::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Table};
use geoerr_core::newton::{NewtonError, Solution, command_for};
use proptest::prelude::*;

use super::machines::{add, all_chains, drawn_machine, norm, sub};
use crate::draws::Draws;

const NANOMETRE_MM: f64 = 1e-6;

/// Finds the command for the place where `q` puts the tool; it must be `q` again.
fn assert_round_trip(machine: &MachineModel, q: [f64; 3]) -> u32 {
    let target = add(q, machine.error(&q, &[0.0; 3]));
    let solution = command_for(machine, &target, 1e-9);
    let Ok(Solution { command_mm, remaining_mm, steps }) = solution else {
        panic!("{:?} at {q:?}: {solution:?}", machine.chain())
    };
    assert!(norm(sub(command_mm, q)) < NANOMETRE_MM, "{q:?}: {command_mm:?} after {steps} steps");
    let left = norm(sub(add(command_mm, machine.error(&command_mm, &[0.0; 3])), target));
    // Positions of 400 mm carry 6e-14 mm.
    assert!(remaining_mm <= 1e-9 && (left - remaining_mm).abs() < 1e-12);
    steps
}

#[test]
fn drawn_machines_of_all_chains() {
    let mut draws = Draws::new(41);
    for (seed, code) in all_chains().iter().enumerate() {
        let machine = drawn_machine(code, seed as u64, 1.0);
        for _ in 0..100 {
            // Quadratic within a cell, one more step for each kink that is crossed.
            assert!(assert_round_trip(&machine, draws.three(350.0)) <= 4);
        }
        for axis in Axis::ALL {
            for &knot in machine.knots(axis) {
                let mut q = draws.three(250.0);
                q[axis.index()] = knot;
                assert_round_trip(&machine, q);
            }
        }
    }
}

/// A lead screw's period of 2 mm with 20 µm amplitude (slope 0.063), beside the 5 mrad that make one plain step
/// of 2 mm necessary: a whole period away.
#[test]
fn periodic_error_of_two_millimetres() {
    let knots: Vec<f64> = (0..=8000).map(|k| f64::from(k) * 0.05).collect();
    let screw = |phase: f64| {
        let values = knots.iter().map(|q| 0.02 * (std::f64::consts::PI * q + phase).sin()).collect();
        Table::new(knots.clone(), values).unwrap()
    };
    let mut errors = ErrorTables::default();
    let squareness =
        geoerr_core::kinematics::Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 5e-3, s_yz_rad: 5e-3 };
    errors.set_squareness(squareness).unwrap();
    errors.set(Axis::X, Component::X, screw(0.0));
    errors.set(Axis::Y, Component::Y, screw(1.0));
    errors.set(Axis::Z, Component::Z, screw(2.0));
    for code in all_chains() {
        let machine = MachineModel::new(Chain::parse(&code).unwrap(), errors.clone(), [0.0; 3]);
        let mut draws = Draws::new(42);
        let mut most_steps = 0;
        for _ in 0..300 {
            let q = draws.three(200.0).map(|c| c + 200.0);
            most_steps = most_steps.max(assert_round_trip(&machine, q));
        }
        assert!(most_steps > 1, "one step of the paper would do: the case is too easy");
        assert!(most_steps <= 8, "{most_steps}");
    }
}

/// Cells of very different width whose slopes are up to 0.05 either way: a Newton step from one cell is wrong in the next.
fn jagged(origin_mm: f64) -> impl Strategy<Value = Table> {
    let cell =
        (prop_oneof![1e-7..1e-5, 1e-3..0.1, 0.5..20.0], prop_oneof![-0.05..0.05, Just(-0.05), Just(0.05)]);
    (proptest::collection::vec(cell, 1..40), -0.5..0.5).prop_map(move |(cells, start)| {
        let (mut positions, mut values) = (vec![origin_mm], vec![start]);
        for (place, (width, slope)) in cells.iter().enumerate() {
            positions.push(positions[place] + width);
            values.push(values[place] + slope * width);
        }
        Table::new(positions, values).unwrap()
    })
}

fn scaled(factor: f64, table: &Table) -> Table {
    let values = table.knots().iter().map(|&knot| factor * table.value(knot)).collect();
    Table::new(table.knots().to_vec(), values).unwrap()
}

fn jagged_machine() -> impl Strategy<Value = MachineModel> {
    let tables = proptest::collection::vec(jagged(-60.0), 18);
    (0..24_usize, tables).prop_map(move |(chain, tables)| {
        let mut errors = ErrorTables::default();
        for (place, table) in tables.iter().enumerate() {
            let (axis, component) = (Axis::ALL[place / 6], Component::ALL[place % 6]);
            // Along its own axis at the full slope. The eight others that act on the same component share
            // another 0.1 between them (angles at a lever of up to 300 mm).
            let factor = match component.index() {
                c if c == axis.index() => 1.0,
                0..=2 => 0.2,
                _ => 0.2 / 300.0,
            };
            errors.set(axis, component, scaled(factor, table));
        }
        MachineModel::new(Chain::parse(&all_chains()[chain]).unwrap(), errors, [0.0, 0.0, 40.0])
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn jagged_tables(machine in jagged_machine(), q in [-80.0..250.0, -80.0..250.0, -80.0..250.0_f64]) {
        assert_round_trip(&machine, q);
    }

    /// Roots exactly on a knot of all three axes, where the slope jumps.
    #[test]
    fn roots_on_knots(machine in jagged_machine(), places in [0..1000_usize, 0..1000_usize, 0..1000_usize]) {
        let q = Axis::ALL.map(|axis| {
            let knots = machine.knots(axis);
            knots[places[axis.index()] % knots.len()]
        });
        assert_round_trip(&machine, q);
    }

    /// Nine times as steep as any machine, where full Newton steps run in circles between two cells.
    #[test]
    fn steep_tables(
        tables in proptest::collection::vec(jagged(-60.0), 3),
        q in [-65.0..0.0, -65.0..0.0, -65.0..0.0_f64],
    ) {
        let mut errors = ErrorTables::default();
        for (axis, table) in Axis::ALL.into_iter().zip(&tables) {
            errors.set(axis, Component::ALL[axis.index()], scaled(9.0, table));
        }
        let machine = MachineModel::new(Chain::parse("wZbXYt").unwrap(), errors, [0.0; 3]);
        assert_round_trip(&machine, q);
    }

    /// Whatever the tables and the target: an answer or a refusal that says what is left, never a panic.
    #[test]
    fn anything_else_is_a_result(
        steepness in prop_oneof![Just(1.0), Just(20.0), Just(1e3), Just(1e9), Just(1e200)],
        tables in proptest::collection::vec(jagged(-60.0), 18),
        chain in 0..24_usize,
        x in proptest::num::f64::ANY,
        (y, z) in (-100.0..300.0, -100.0..300.0_f64),
        tolerance in prop_oneof![Just(1e-300), Just(1e-9), Just(1.0)],
    ) {
        let mut errors = ErrorTables::default();
        for (place, table) in tables.iter().enumerate() {
            let values = table.knots().iter().map(|&knot| steepness * table.value(knot)).collect();
            if let Ok(table) = Table::new(table.knots().to_vec(), values) {
                errors.set(Axis::ALL[place / 6], Component::ALL[place % 6], table);
            }
        }
        let machine = MachineModel::new(Chain::parse(&all_chains()[chain]).unwrap(), errors, [0.0; 3]);
        match command_for(&machine, &[x, y, z], tolerance) {
            Ok(solution) => {
                prop_assert!(solution.remaining_mm <= tolerance);
                prop_assert!(solution.command_mm.iter().all(|c| c.is_finite()));
            }
            Err(NewtonError::NotConverged { command_mm, remaining_mm, .. }) => {
                prop_assert!(remaining_mm > tolerance && remaining_mm.is_finite());
                prop_assert!(command_mm.iter().all(|c| c.is_finite()));
            }
            Err(NewtonError::NonFinite) => {}
            Err(other) => prop_assert!(false, "{other}"),
        }
    }
}

/// The smallest error that a double can express at 400 mm is far above this tolerance: it says so.
#[test]
fn an_unreachable_tolerance_is_a_result() {
    let machine = drawn_machine("wZbXYt", 44, 1.0);
    let mut refused = 0;
    for k in 0..50 {
        let target = [f64::from(k) * 7.3, 250.1, 100.7];
        match command_for(&machine, &target, 1e-30) {
            Ok(solution) => assert_eq!(solution.remaining_mm, 0.0),
            Err(NewtonError::NotConverged { remaining_mm, .. }) => {
                assert!(remaining_mm < 1e-12);
                refused += 1;
            }
            Err(other) => panic!("{other}"),
        }
    }
    assert!(refused > 0);
}

/// The error takes back all that the axis moves: over a kilometre the tool stands still at 0 and J is singular.
#[test]
fn a_tool_that_stands_still() {
    let mut errors = ErrorTables::default();
    errors.set(Axis::X, Component::X, Table::new(vec![0.0, 1e6], vec![0.0, -1e6]).unwrap());
    let machine = MachineModel::new(Chain::parse("wbXYZt").unwrap(), errors, [0.0; 3]);
    match command_for(&machine, &[10.0, 20.0, 30.0], 1e-6) {
        Err(NewtonError::NotConverged { remaining_mm, .. }) => assert_eq!(remaining_mm, 10.0),
        other => panic!("{other:?}"),
    }
}

/// Two entries almost at one place, as unmerged repeats give them: 10 µm within 10 nm, and the root in between.
#[test]
fn a_jump() {
    let mut errors = ErrorTables::default();
    for axis in Axis::ALL {
        let positions = vec![0.0, 100.0, 100.00001, 200.0];
        errors.set(
            axis,
            Component::ALL[axis.index()],
            Table::new(positions, vec![0.0, 0.0, 0.01, 0.02]).unwrap(),
        );
    }
    let machine = MachineModel::new(Chain::parse("wZbXYt").unwrap(), errors, [0.0; 3]);
    for share in [0.0, 0.001, 0.3, 0.5, 0.999, 1.0] {
        let inside = 100.0 + share * 0.00001;
        for q in [[inside, 30.0, 50.0], [30.0, inside, inside], [inside; 3]] {
            assert_round_trip(&machine, q);
        }
    }
}

#[test]
fn refusals() {
    let machine = drawn_machine("wZbXYt", 45, 1.0);
    for tolerance_mm in [0.0, -1.0, f64::INFINITY] {
        let refused = Err(NewtonError::Tolerance { tolerance_mm });
        assert_eq!(command_for(&machine, &[0.0; 3], tolerance_mm), refused);
    }
    assert!(matches!(command_for(&machine, &[0.0; 3], f64::NAN), Err(NewtonError::Tolerance { .. })));
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(command_for(&machine, &[1.0, bad, 2.0], 1e-6), Err(NewtonError::NonFinite));
    }
}

/// The target is counted in axis positions: a tool offset shifts the tool point and not the program.
#[test]
fn tool_offset_only_acts_through_angles() {
    let long_tool = drawn_machine("wZbXYt", 46, 1.0);
    let target = [120.0, -40.0, 90.0];
    let solution = command_for(&long_tool, &target, 1e-9).unwrap();
    let tool_point = long_tool.tool_from_work(&solution.command_mm, &[0.0; 3]);
    assert!(norm(sub(tool_point, add(target, *long_tool.tool_offset_mm()))) < 2e-9);
}
