//! Abbe's principle: two points of one body differ by the angle times their distance (Li Eqs. 9 to 16).

use geoerr_core::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Table};

use super::machines::{add, all_chains, assert_second_order, cross, delta_and_epsilon, drawn_errors, sub};
use crate::draws::Draws;

const OFFSET: [f64; 3] = [35.0, -80.0, 150.0];

/// Li Eqs. 9 and 10: along X, a point at y errs by tan γ · y against the axis, one at z by tan β · z.
#[test]
fn yaw_and_pitch_of_a_worktable() {
    let gamma = 2e-3;
    for (component, offset, sign) in
        [(Component::C, [0.0, 90.0, 0.0], -1.0), (Component::B, [0.0, 0.0, 90.0], 1.0)]
    {
        let mut errors = ErrorTables::default();
        errors.set(Axis::X, component, Table::new(vec![0.0], vec![gamma]).unwrap());
        let machine = MachineModel::new(Chain::parse("wbXYZt").unwrap(), errors, [0.0; 3]);
        let found = machine.tool_from_base(&[100.0, 0.0, 0.0], &offset)[0] - 100.0;
        // The body turns: exactly the sine. The paper's tangent is half a cube away.
        assert!((found - sign * gamma.sin() * 90.0).abs() < 2e-14);
        assert!((found - sign * gamma.tan() * 90.0).abs() < 0.51 * gamma.powi(3) * 90.0);
    }
}

/// Li Eqs. 11 to 16: errors measured at two points of the same carriage.
#[test]
fn errors_at_two_points_of_one_body() {
    assert_second_order("Li's Eq. 16", |scale| {
        let errors = drawn_errors(21, scale);
        let machine = MachineModel::new(Chain::parse("wYZbXt").unwrap(), errors.clone(), [0.0; 3]);
        (-6..=6)
            .map(|step| {
                let q = [50.0 * f64::from(step), 0.0, 0.0];
                let measured_at = |point| sub(machine.tool_from_base(&q, &point), add(q, point));
                let ([d_x, d_y, d_z], [x_1, y_1, z_1]) = (measured_at(OFFSET), OFFSET);
                let (_, [e_x, e_y, e_z]) = delta_and_epsilon(&errors, Axis::X, q);
                let back =
                    [d_x - e_y * z_1 + e_z * y_1, d_y - e_z * x_1 + e_x * z_1, d_z - e_x * y_1 + e_y * x_1];
                sub(back, measured_at([0.0; 3]))
            })
            .collect()
    });
}

/// Eq. 15 without the small angles: the difference of two points is the turned lever, to the last digit.
#[test]
fn two_points_exactly() {
    let errors = drawn_errors(22, 1.0);
    let machine = MachineModel::new(Chain::parse("wYZbXt").unwrap(), errors.clone(), [0.0; 3]);
    let mut draws = Draws::new(23);
    for _ in 0..50 {
        let q = draws.three(300.0);
        let (_, epsilon) = delta_and_epsilon(&errors, Axis::X, q);
        let rotation = nalgebra::Rotation3::from_scaled_axis(epsilon.into());
        let lever: [f64; 3] = (rotation * nalgebra::Vector3::from(OFFSET)).into();
        let found = sub(machine.tool_from_base(&q, &OFFSET), machine.tool_from_base(&q, &[0.0; 3]));
        assert!(sub(found, lever).iter().all(|d| d.abs() < 3e-13));
    }
}

/// Tables referred to another place of the carriages, δ + ε × t with the offset l − t, are the same machine.
#[test]
fn transfer_of_all_tables_on_all_chains() {
    for (seed, code) in all_chains().iter().enumerate() {
        assert_second_order(&format!("transfer on {code}"), |scale| {
            let errors = drawn_errors(seed as u64, scale);
            let mut transferred = errors.clone();
            for axis in Axis::ALL {
                for component in [Component::X, Component::Y, Component::Z] {
                    // On the union of all knots the sum of two tables is a table.
                    let mut knots: Vec<f64> =
                        errors.of_axis(axis).iter().flat_map(Table::knots).copied().collect();
                    knots.sort_by(f64::total_cmp);
                    let values = knots.iter().map(|&knot| {
                        let (delta, epsilon) = delta_and_epsilon(&errors, axis, [knot; 3]);
                        add(delta, cross(epsilon, OFFSET))[component.index()]
                    });
                    let values = values.collect();
                    transferred.set(axis, component, Table::new(knots, values).unwrap());
                }
            }
            let chain = Chain::parse(code).unwrap();
            let at_origin = MachineModel::new(chain, errors, [0.0; 3]);
            let at_offset = MachineModel::new(chain, transferred, [0.0; 3]);
            let mut draws = Draws::new(24);
            (0..10)
                .map(|_| {
                    let (q, l) = (draws.three(300.0), draws.three(100.0));
                    sub(at_origin.error(&q, &l), at_offset.error(&q, &sub(l, OFFSET)))
                })
                .collect()
        });
    }
}
