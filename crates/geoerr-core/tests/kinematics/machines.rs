//! Machines to test with: all 24 chains, drawn errors.

use geoerr_core::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Squareness, Table};

use crate::draws::Draws;

/// The 24 structural codes: 6 orders of the axes, 4 places of the base.
pub fn all_chains() -> Vec<String> {
    let mut codes = Vec::new();
    for order in ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"] {
        for base in 0..=3 {
            codes.push(format!("w{}b{}t", &order[..base], &order[base..]));
        }
    }
    codes
}

/// Errors of size `scale` × (0.3 mm, 1 mrad, 5 mrad squareness), each table with knots of its own.
pub fn drawn_errors(seed: u64, scale: f64) -> ErrorTables {
    let mut draws = Draws::new(seed);
    let mut errors = ErrorTables::default();
    for axis in Axis::ALL {
        for component in Component::ALL {
            let size = if component.index() < 3 { 0.3 } else { 1e-3 };
            let n = 2 + component.index();
            let step = 600.0 / (n as f64 - 1.0);
            let knots = (0..n).map(|k| -300.0 + step * k as f64 + 0.2 * step * draws.symmetric()).collect();
            let values = (0..n).map(|_| scale * size * draws.symmetric()).collect();
            errors.set(axis, component, Table::new(knots, values).unwrap());
        }
    }
    let mut angle = || scale * 5e-3 * draws.symmetric();
    let squareness = Squareness { s_xy_rad: angle(), s_xz_rad: angle(), s_yz_rad: angle() };
    errors.set_squareness(squareness).unwrap();
    errors
}

pub fn drawn_machine(code: &str, seed: u64, scale: f64) -> MachineModel {
    MachineModel::new(Chain::parse(code).unwrap(), drawn_errors(seed, scale), [3.0, -20.0, 55.0])
}

pub fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|c| a[c] + b[c])
}

pub fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|c| a[c] - b[c])
}

pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub fn norm(a: [f64; 3]) -> f64 {
    a[0].hypot(a[1]).hypot(a[2])
}

/// δ and ε of one axis at its position.
pub fn delta_and_epsilon(errors: &ErrorTables, axis: Axis, q_mm: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let at = |component| errors.table(axis, component).value(q_mm[axis.index()]);
    use Component::{A, B, C, X, Y, Z};
    ([at(X), at(Y), at(Z)], [at(A), at(B), at(C)])
}

/// Asserts that `difference(scale)` is of second order: a hundredth when the errors shrink to a tenth.
///
/// The third order that is left is the size of the errors themselves, 0.1 to 1 %; 3 % leaves room for it.
pub fn assert_second_order(what: &str, difference: impl Fn(f64) -> Vec<[f64; 3]>) {
    let (large, small) = (difference(1.0), difference(0.1));
    let total: f64 = large.iter().map(|d| norm(*d)).sum();
    let left: f64 = large.iter().zip(&small).map(|(l, s)| norm(sub(*l, s.map(|c| 100.0 * c)))).sum();
    assert!(total > 1e-6, "{what}: no second order at all ({total:.1e} mm): the test tests nothing");
    assert!(left < 0.03 * total, "{what}: {total:.3e} mm, of which {left:.3e} mm are not of second order");
}
