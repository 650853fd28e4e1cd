//! A machine without errors changes nothing, bit for bit.

use geoerr_core::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Table};
use geoerr_core::newton::{Solution, command_for};
use proptest::prelude::*;

use super::machines::all_chains;

fn finite() -> impl Strategy<Value = f64> {
    prop_oneof![
        -1e3..1e3_f64,
        proptest::num::f64::NORMAL.prop_filter("no overflow", |x| x.abs() < 1e300),
        Just(-0.0)
    ]
}

fn bits(p: [f64; 3]) -> [u64; 3] {
    p.map(f64::to_bits)
}

/// No tables at all, or tables full of zeros.
fn nominal(code: &str, with_tables: bool, tool_offset_mm: [f64; 3]) -> MachineModel {
    let mut errors = ErrorTables::default();
    if with_tables {
        for (axis, component) in Axis::ALL.into_iter().flat_map(|a| Component::ALL.map(|c| (a, c))) {
            errors.set(axis, component, Table::new(vec![-50.0, 0.0, 80.0], vec![0.0, -0.0, 0.0]).unwrap());
        }
    }
    MachineModel::new(Chain::parse(code).unwrap(), errors, tool_offset_mm)
}

proptest! {
    #[test]
    fn positions_are_q_plus_l(
        chain in 0..24_usize,
        with_tables: bool,
        q in [finite(), finite(), finite()],
        tool_offset in [finite(), finite(), finite()],
        offset in [finite(), finite(), finite()],
    ) {
        let machine = nominal(&all_chains()[chain], with_tables, tool_offset);
        prop_assert!(machine.is_nominal());
        let l: [f64; 3] = std::array::from_fn(|c| tool_offset[c] + offset[c]);
        let expected: [f64; 3] = std::array::from_fn(|c| q[c] + l[c]);
        // Adding the error of +0.0 turns -0.0 into +0.0, as it compares equal.
        prop_assert_eq!(bits(machine.tool_from_work(&q, &offset)), bits(expected.map(|c| c + 0.0)));
        prop_assert_eq!(machine.error(&q, &offset), [0.0; 3]);
        prop_assert_eq!(machine.jacobian(&q, &offset), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        let mut tool = l;
        let mut work = offset;
        machine.chain().tool_axes().iter().for_each(|axis| tool[axis.index()] += q[axis.index()]);
        machine.chain().work_axes().iter().for_each(|axis| work[axis.index()] -= q[axis.index()]);
        prop_assert_eq!(bits(machine.tool_from_base(&q, &offset)), bits(tool.map(|c| c + 0.0)));
        prop_assert_eq!(bits(machine.work_from_base(&q, &offset)), bits(work.map(|c| c + 0.0)));
    }

    #[test]
    fn command_is_the_target(
        chain in 0..24_usize,
        with_tables: bool,
        target in [finite(), finite(), finite()],
        tool_offset in [finite(), finite(), finite()],
    ) {
        let machine = nominal(&all_chains()[chain], with_tables, tool_offset);
        let Solution { command_mm, remaining_mm, steps } = command_for(&machine, &target, 1e-9).unwrap();
        prop_assert_eq!(bits(command_mm), bits(target));
        prop_assert_eq!((remaining_mm, steps), (0.0, 0));
    }
}

#[test]
fn one_error_is_not_nominal() {
    let mut errors = ErrorTables::default();
    errors.set(Axis::Z, Component::B, Table::new(vec![0.0, 1.0], vec![0.0, 1e-12]).unwrap());
    assert!(!MachineModel::new(Chain::parse("wbXYZt").unwrap(), errors, [0.0; 3]).is_nominal());
}
