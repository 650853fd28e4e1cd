//! Squareness is the angle between the lines that the tool draws on the work.

use std::f64::consts::FRAC_PI_2;

use geoerr_core::kinematics::{Chain, ErrorTables, MachineModel, Squareness};

use super::machines::{add, all_chains, norm, sub};

fn included_angle(a: [f64; 3], b: [f64; 3]) -> f64 {
    let dot: f64 = (0..3).map(|c| a[c] * b[c]).sum();
    (dot / (norm(a) * norm(b))).acos()
}

#[test]
fn lines_stand_at_90_degrees_plus_s_on_every_chain() {
    // Li's Table 3, and angles at which a shear would be wrong in the third digit.
    let li = Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 };
    let large = Squareness { s_xy_rad: 0.12, s_xz_rad: -0.07, s_yz_rad: 0.2 };
    for squareness in [li, large] {
        for code in all_chains() {
            let mut errors = ErrorTables::default();
            errors.set_squareness(squareness).unwrap();
            let machine = MachineModel::new(Chain::parse(&code).unwrap(), errors, [10.0, 20.0, -30.0]);
            let start = [50.0, -20.0, 80.0];
            let line = |axis: usize| {
                let mut end = start;
                end[axis] += 400.0;
                sub(machine.tool_from_work(&end, &[0.0; 3]), machine.tool_from_work(&start, &[0.0; 3]))
            };
            let (x, y, z) = (line(0), line(1), line(2));
            for axis in [x, y, z] {
                assert!((norm(axis) - 400.0).abs() < 3e-13, "{code}: travel is not sheared longer");
            }
            for (a, b, s) in
                [(x, y, squareness.s_xy_rad), (x, z, squareness.s_xz_rad), (y, z, squareness.s_yz_rad)]
            {
                let found = included_angle(a, b) - FRAC_PI_2;
                assert!((found - s).abs() < 3e-15, "{code}: {found} for {s}");
            }
            assert!(x[1] == 0.0 && x[2] == 0.0 && y[2].abs() < 1e-13, "{code}: X is the datum, Y in XY");
        }
    }
}

/// From the floor a bed target's travel runs backwards: reversed, the angle is the same.
#[test]
fn from_the_base_a_bed_line_is_reversed() {
    let squareness = Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 };
    let mut errors = ErrorTables::default();
    errors.set_squareness(squareness).unwrap();
    let machine = MachineModel::new(Chain::parse("wZbXYt").unwrap(), errors, [0.0; 3]);
    let on_tool = |q: [f64; 3]| machine.tool_from_base(&q, &[0.0; 3]);
    let on_bed = |q: [f64; 3]| machine.work_from_base(&q, &[5.0, 6.0, 7.0]);
    let x = sub(on_tool([400.0, 0.0, 0.0]), on_tool([0.0; 3]));
    let z_seen = sub(on_bed([0.0, 0.0, 300.0]), on_bed([0.0; 3]));
    assert!((included_angle(x, z_seen.map(|c| -c)) - FRAC_PI_2 - squareness.s_xz_rad).abs() < 3e-15);
    assert!((included_angle(x, z_seen) - FRAC_PI_2 + squareness.s_xz_rad).abs() < 3e-15);
    // The tool does not move with Z, nor the bed with X or Y.
    assert_eq!(on_tool([0.0, 0.0, 300.0]), on_tool([0.0; 3]));
    assert_eq!(on_bed([10.0, 20.0, 0.0]), add([5.0, 6.0, 7.0], [0.0; 3]));
}
