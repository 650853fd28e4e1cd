//! The analytic Jacobian against differences.

use geoerr_core::kinematics::{Axis, MachineModel};

use super::machines::{all_chains, drawn_machine};
use crate::draws::Draws;

fn moved(q: [f64; 3], axis: Axis, by: f64) -> [f64; 3] {
    let mut q = q;
    q[axis.index()] += by;
    q
}

/// Differences of the error alone: the nominal part of the derivative is 1 and would cost digits.
fn central(machine: &MachineModel, q: [f64; 3], l: [f64; 3], axis: Axis, h: f64) -> [f64; 3] {
    let (plus, minus) = (machine.error(&moved(q, axis, h), &l), machine.error(&moved(q, axis, -h), &l));
    std::array::from_fn(|c| (plus[c] - minus[c]) / (2.0 * h))
}

fn forward(machine: &MachineModel, q: [f64; 3], l: [f64; 3], axis: Axis, h: f64) -> [f64; 3] {
    let (at, plus) = (machine.error(&q, &l), machine.error(&moved(q, axis, h), &l));
    std::array::from_fn(|c| (plus[c] - at[c]) / h)
}

fn assert_matches(
    machine: &MachineModel,
    q: [f64; 3],
    l: [f64; 3],
    axis: Axis,
    difference: [f64; 3],
    bound: f64,
) {
    let jacobian = machine.jacobian(&q, &l);
    for c in 0..3 {
        let nominal = f64::from(u8::from(c == axis.index()));
        let analytic = jacobian[c][axis.index()] - nominal;
        assert!(
            (difference[c] - analytic).abs() < bound,
            "{:?}, component {c} by {axis:?} at {q:?}: {analytic} against {}",
            machine.chain(),
            difference[c]
        );
    }
}

#[test]
fn inside_cells_all_chains() {
    let mut draws = Draws::new(11);
    let mut compared = 0;
    for (seed, code) in all_chains().iter().enumerate() {
        let machine = drawn_machine(code, seed as u64, 1.0);
        for _ in 0..30 {
            let (q, l) = (draws.three(350.0), draws.three(200.0));
            let h = 0.25;
            for axis in Axis::ALL {
                let at = q[axis.index()];
                if machine.knots(axis).iter().any(|knot| (knot - at).abs() <= h) {
                    continue;
                }
                let (wide, narrow) =
                    (central(&machine, q, l, axis, h), central(&machine, q, l, axis, h / 2.0));
                // Richardson: the h² terms cancel. What is left is h⁴ (slopes of 1e-5 rad/mm: below 1e-20)
                // and rounding: errors of 1 mm carry 2e-16 mm each, over h.
                let difference = std::array::from_fn(|c| (4.0 * narrow[c] - wide[c]) / 3.0);
                assert_matches(&machine, q, l, axis, difference, 2e-14);
                compared += 1;
            }
        }
    }
    assert!(compared > 2000, "only {compared} derivatives were away from knots");
}

#[test]
fn right_hand_derivative_at_knots() {
    for (seed, code) in all_chains().iter().enumerate() {
        let machine = drawn_machine(code, seed as u64, 1.0);
        let l = [20.0, -40.0, 60.0];
        for axis in Axis::ALL {
            for &knot in machine.knots(axis) {
                let mut q = [12.5, -71.0, 33.0];
                q[axis.index()] = knot;
                let h = 1e-3;
                let (wide, narrow) =
                    (forward(&machine, q, l, axis, h), forward(&machine, q, l, axis, h / 2.0));
                let difference = std::array::from_fn(|c| 2.0 * narrow[c] - wide[c]);
                // A left-hand slope would differ by 1e-6 and more; rounding over h is 1e-12.
                assert_matches(&machine, q, l, axis, difference, 4e-12);
            }
        }
    }
}

#[test]
fn error_and_jacobian_are_error_and_jacobian() {
    let mut draws = Draws::new(12);
    for code in all_chains() {
        let machine = drawn_machine(&code, 5, 1.0);
        let (q, l) = (draws.three(350.0), draws.three(200.0));
        assert_eq!(machine.error_and_jacobian(&q, &l), (machine.error(&q, &l), machine.jacobian(&q, &l)));
    }
}
