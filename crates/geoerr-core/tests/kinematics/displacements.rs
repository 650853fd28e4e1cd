//! The exact chain from explicit numbers: against nalgebra's isometries and against the machine from tables.

use geoerr_core::kinematics::{
    Axis, Carrier, Chain, Channel, Displacements, Pose, RigNumbers, rig_displacement,
};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::machines::{add, all_chains, delta_and_epsilon, drawn_machine, norm, sub};
use crate::draws::Draws;

const TOOL_OFFSET: [f64; 3] = [3.0, -20.0, 55.0];

/// One number a channel: 6 mm and 20 mrad, twenty times a poor machine's errors.
pub fn drawn_channels(draws: &mut Draws, scale: f64) -> [f64; Channel::MACHINE_COUNT] {
    std::array::from_fn(|k| {
        let is_angle = k < 18 && k % 6 >= 3 || (18..21).contains(&k);
        scale * draws.symmetric() * if is_angle { 0.02 } else { 6.0 }
    })
}

/// Unit directions at 90° + S by Gram–Schmidt on the cosines, X the datum, Y in the XY plane.
fn directions(s: [f64; 3]) -> [Vector3<f64>; 3] {
    let [y_x, z_x, zy] = s.map(|s| (std::f64::consts::FRAC_PI_2 + s).cos());
    let y = Vector3::new(y_x, (1.0 - y_x * y_x).sqrt(), 0.0);
    let z_y = (zy - y.x * z_x) / y.y;
    [Vector3::x(), y, Vector3::new(z_x, z_y, (1.0 - z_x * z_x - z_y * z_y).sqrt())]
}

fn isometries(axes: &[Axis], sign: f64, q: [f64; 3], d: &Displacements) -> Isometry3<f64> {
    let directions = directions(d.squareness);
    axes.iter().fold(Isometry3::identity(), |product, axis| {
        let a = axis.index();
        let [dx, dy, dz, ex, ey, ez] = d.joints[a];
        let translation = sign * (q[a] * directions[a] + Vector3::new(dx, dy, dz));
        let rotation = UnitQuaternion::from_scaled_axis(sign * Vector3::new(ex, ey, ez));
        product * Isometry3::from_parts(Translation3::from(translation), rotation)
    })
}

fn by_isometries(
    chain: &Chain,
    carrier: Carrier,
    q: [f64; 3],
    offset: [f64; 3],
    d: &Displacements,
) -> [f64; 3] {
    let tool = Translation3::from(d.tool) * isometries(chain.tool_axes(), 1.0, q, d);
    let work = Translation3::from(d.work) * isometries(chain.work_axes(), -1.0, q, d);
    let on_tool = Point3::from(add(add(TOOL_OFFSET, offset), d.target));
    let on_work = Point3::from(add(offset, d.target));
    let seen = match carrier {
        Carrier::Tool => tool * on_tool,
        Carrier::Work => work * on_work,
        Carrier::Base => Point3::from(offset),
        Carrier::Relative => work.inverse() * tool * on_tool,
    };
    seen.coords.into()
}

#[test]
fn all_chains_and_carriers_against_isometries() {
    let mut draws = Draws::new(41);
    for code in all_chains() {
        let chain = Chain::parse(&code).unwrap();
        for carrier in Carrier::ALL {
            for _ in 0..20 {
                let (q, offset) = (draws.three(350.0), draws.three(200.0));
                let d = Displacements::from_channels(&drawn_channels(&mut draws, 1.0));
                let found = chain.position(carrier, &q, &offset, &TOOL_OFFSET, &d);
                let expected = by_isometries(&chain, carrier, q, offset, &d);
                // Twenty rounded operations on 700 mm: a few 1e-13.
                assert!(norm(sub(found, expected)) < 2e-12, "{code} {}", carrier.name());
            }
        }
    }
}

#[test]
fn tables_walk_the_same_chain() {
    for (seed, code) in all_chains().iter().enumerate() {
        let machine = drawn_machine(code, seed as u64, 1.0);
        let chain = machine.chain();
        let mut draws = Draws::new(42);
        for _ in 0..20 {
            let (q, offset) = (draws.three(350.0), draws.three(200.0));
            let s = machine.errors().squareness();
            let d = Displacements {
                joints: Axis::ALL.map(|axis| {
                    let (delta, epsilon) = delta_and_epsilon(machine.errors(), axis, q);
                    std::array::from_fn(|c| if c < 3 { delta[c] } else { epsilon[c - 3] })
                }),
                squareness: [s.s_xy_rad, s.s_xz_rad, s.s_yz_rad],
                ..Displacements::default()
            };
            let pairs = [
                (Carrier::Tool, machine.tool_from_base(&q, &offset)),
                (Carrier::Work, machine.work_from_base(&q, &offset)),
                (Carrier::Relative, machine.tool_from_work(&q, &offset)),
            ];
            for (carrier, expected) in pairs {
                let found = chain.position(carrier, &q, &offset, &TOOL_OFFSET, &d);
                // A table is evaluated at its own knot there and at the union of the axis's knots here.
                assert!(norm(sub(found, expected)) < 1e-12, "{code} {}", carrier.name());
            }
        }
    }
}

#[test]
fn nothing_displaces_exactly_nothing() {
    let mut draws = Draws::new(43);
    for code in all_chains() {
        let chain = Chain::parse(&code).unwrap();
        let (q, offset) = (draws.three(350.0), draws.three(200.0));
        for carrier in Carrier::ALL {
            let none = Displacements::default();
            assert_eq!(chain.displacement(carrier, &q, &offset, &TOOL_OFFSET, &none), [0.0; 3]);
            let nominal = chain.nominal(carrier, &q, &offset, &TOOL_OFFSET);
            assert_eq!(chain.position(carrier, &q, &offset, &TOOL_OFFSET, &none), nominal);
        }
        let relative = chain.nominal(Carrier::Relative, &q, &offset, &TOOL_OFFSET);
        assert!(norm(sub(relative, add(add(q, TOOL_OFFSET), offset))) < 1e-12);
    }
}

/// A displacement of a picometre a kilometre from the origin keeps its digits.
#[test]
fn small_displacements_keep_their_digits() {
    let chain = Chain::parse("wZbXYt").unwrap();
    let mut d = Displacements::default();
    d.joints[0][0] = 1e-9;
    for carrier in [Carrier::Tool, Carrier::Relative] {
        let found = chain.displacement(carrier, &[1e6, 2e6, 3e6], &[0.1, 0.2, 0.3], &TOOL_OFFSET, &d);
        assert_eq!(found, [1e-9, 0.0, 0.0]);
    }
}

#[test]
fn impossible_squareness_is_that_rows_trouble() {
    let chain = Chain::parse("wZbXYt").unwrap();
    for s in [f64::NAN, 2.0, f64::INFINITY] {
        let d = Displacements { squareness: [s, 0.0, 0.0], ..Displacements::default() };
        let found = chain.displacement(Carrier::Tool, &[1.0, 2.0, 3.0], &[0.0; 3], &TOOL_OFFSET, &d);
        assert!(found.iter().any(|c| c.is_nan()));
        let fixed = chain.displacement(Carrier::Base, &[1.0, 2.0, 3.0], &[0.0; 3], &TOOL_OFFSET, &d);
        assert_eq!(fixed, [0.0; 3]);
    }
}

/// What stands on the base is nothing of the machine: no channel moves it, the target's own least of all.
#[test]
fn static_markers_stay() {
    let mut draws = Draws::new(45);
    for code in all_chains() {
        let chain = Chain::parse(&code).unwrap();
        let (q, offset) = (draws.three(350.0), draws.three(200.0));
        let d = Displacements::from_channels(&drawn_channels(&mut draws, 1.0));
        assert_eq!(chain.displacement(Carrier::Base, &q, &offset, &TOOL_OFFSET, &d), [0.0; 3]);
        assert_eq!(chain.position(Carrier::Base, &q, &offset, &TOOL_OFFSET, &d), offset);
        let columns = chain.channel_columns(Carrier::Base, &q, &offset, &TOOL_OFFSET);
        assert!(columns.iter().all(|column| *column == [0.0; 3]), "{code}");
    }
}

pub fn drawn_pose(draws: &mut Draws) -> Pose {
    let rotation = Rotation3::from_scaled_axis(draws.three(3.0).into());
    let by_rows = |m: &Matrix3<f64>| std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]));
    Pose { camera_from_base: by_rows(rotation.matrix()), t_mm: draws.three(900.0) }
}

#[test]
fn the_rig_by_nalgebra() {
    let mut draws = Draws::new(44);
    for _ in 0..200 {
        let pose = drawn_pose(&mut draws);
        let base = draws.three(400.0);
        let sizes = [2.0, 2.0, 2.0, 0.01, 0.01, 0.01, 1e-3, 1e-3, 1e-6, 1e-3, 1e-3];
        let rig: RigNumbers = sizes.map(|size| size * draws.symmetric());
        let [tx, ty, tz, rx, ry, rz, k, k1, k2, ray_x, ray_y] = rig;
        let matrix = Matrix3::from_fn(|r, c| pose.camera_from_base[r][c]);
        let camera = matrix * Vector3::from(base) + Vector3::from(pose.t_mm);
        let p = Rotation3::from_scaled_axis(Vector3::new(rx, ry, rz)) * camera + Vector3::new(tx, ty, tz);
        let expected = p * (1.0 + k) + p.z * (k2 * p + Vector3::new(ray_x, ray_y, k1));
        let found = pose.measured_from_base(&rig, &base);
        assert!(norm(sub(found, expected.into())) < 1e-12 * camera.norm());

        // A rig that only moved is a pose that moved.
        let moved = pose.moved(&[tx, ty, tz], &[rx, ry, rz]);
        let only_moved: RigNumbers = std::array::from_fn(|c| if c < 6 { rig[c] } else { 0.0 });
        assert!(norm(sub(moved.to_camera(&base), pose.measured_from_base(&only_moved, &base))) < 2e-12);
        assert_eq!(rig_displacement(&[0.0; 11], &camera.into()), [0.0; 3]);
    }
}

#[test]
fn errors_of_a_lattice_are_those_of_its_places() {
    for (seed, code) in (0..).zip(all_chains()) {
        let machine = drawn_machine(&code, seed, 3.0);
        let q_mm = [[-310.0, -20.0, 7.5], [0.0, 33.0, 400.0], [-1.0, 120.0, 121.0]];
        let errors_mm = machine.errors_of_lattice(&q_mm);
        assert_eq!(errors_mm.len(), 27);
        for (place, error_mm) in errors_mm.iter().enumerate() {
            let at_mm = [q_mm[0][place % 3], q_mm[1][place / 3 % 3], q_mm[2][place / 9]];
            assert_eq!(*error_mm, machine.error(&at_mm, &[0.0; 3]), "{code} {at_mm:?}");
        }
    }
}
