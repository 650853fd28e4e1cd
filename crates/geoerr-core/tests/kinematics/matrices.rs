//! A second implementation: 4×4 matrices multiplied as the theory writes them, by nalgebra.

use geoerr_core::kinematics::{Axis, MachineModel};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::machines::{add, all_chains, delta_and_epsilon, drawn_machine, norm, sub};
use crate::draws::Draws;

/// Unit directions at 90° + S by Gram–Schmidt on the cosines, X the datum, Y in the XY plane.
fn directions(machine: &MachineModel) -> [Vector3<f64>; 3] {
    let s = machine.errors().squareness();
    let cosine = |s: f64| (std::f64::consts::FRAC_PI_2 + s).cos();
    let y_x = cosine(s.s_xy_rad);
    let y = Vector3::new(y_x, (1.0 - y_x * y_x).sqrt(), 0.0);
    let z_x = cosine(s.s_xz_rad);
    let z_y = (cosine(s.s_yz_rad) - y.x * z_x) / y.y;
    [Vector3::x(), y, Vector3::new(z_x, z_y, (1.0 - z_x * z_x - z_y * z_y).sqrt())]
}

fn side(machine: &MachineModel, axes: &[Axis], sign: f64, q: [f64; 3]) -> Isometry3<f64> {
    let directions = directions(machine);
    axes.iter().fold(Isometry3::identity(), |product, &axis| {
        let (delta, epsilon) = delta_and_epsilon(machine.errors(), axis, q);
        let translation = sign * (q[axis.index()] * directions[axis.index()] + Vector3::from(delta));
        let rotation = UnitQuaternion::from_scaled_axis(sign * Vector3::from(epsilon));
        product * Isometry3::from_parts(Translation3::from(translation), rotation)
    })
}

#[test]
fn all_three_views_of_all_chains() {
    let mut draws = Draws::new(3);
    for (seed, code) in all_chains().iter().enumerate() {
        // Twenty times the errors of a poor machine: 20 mrad, 6 mm, 0.1 rad squareness.
        let machine = drawn_machine(code, seed as u64, 20.0);
        for _ in 0..50 {
            let (q, offset) = (draws.three(350.0), draws.three(200.0));
            let tool = side(&machine, machine.chain().tool_axes(), 1.0, q);
            let work = side(&machine, machine.chain().work_axes(), -1.0, q);
            let l = Point3::from(add(*machine.tool_offset_mm(), offset));
            let pairs = [
                (machine.tool_from_work(&q, &offset), work.inverse() * tool * l),
                (machine.tool_from_base(&q, &offset), tool * l),
                (machine.work_from_base(&q, &offset), work * Point3::from(offset)),
            ];
            for (got, expected) in pairs {
                // Coordinates of several 100 mm in double precision: a dozen roundings of 6e-14 mm each.
                let difference = norm(sub(got, expected.into()));
                assert!(difference < 1e-12, "{code}: {difference:.1e} mm");
            }
        }
    }
}

/// A point of the work that coincides with the tool point is at the tool's place in the base frame.
#[test]
fn views_agree_with_each_other() {
    let mut draws = Draws::new(4);
    for (seed, code) in all_chains().iter().enumerate() {
        let machine = drawn_machine(code, seed as u64, 1.0);
        for _ in 0..20 {
            let (q, offset) = (draws.three(350.0), draws.three(200.0));
            let on_work = machine.tool_from_work(&q, &offset);
            let difference =
                norm(sub(machine.work_from_base(&q, &on_work), machine.tool_from_base(&q, &offset)));
            assert!(difference < 1e-12, "{code}: {difference:.1e} mm");
        }
    }
}
