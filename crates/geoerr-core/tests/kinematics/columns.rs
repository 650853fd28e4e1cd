//! First-order columns against differences of the exact transforms: every channel, carrier and chain.

use geoerr_core::kinematics::{Axis, Carrier, Chain, Channel, Component, Displacements, Pose};

use super::displacements::drawn_pose;
use super::machines::{add, all_chains, cross, norm, sub};
use crate::draws::Draws;

const TOOL_OFFSET: [f64; 3] = [3.0, -20.0, 55.0];

/// Step of the central differences: their own error is `h² f'''/6`, 1.7e-6 mm for a lever of a metre.
const STEP: f64 = 1e-4;

fn one(channel: usize, number: f64) -> Displacements {
    let mut numbers = [0.0; Channel::MACHINE_COUNT];
    numbers[channel] = number;
    Displacements::from_channels(&numbers)
}

#[test]
fn every_channel_of_every_chain_and_carrier() {
    let mut draws = Draws::new(51);
    let mut n_felt = [0; Channel::MACHINE_COUNT];
    for code in all_chains() {
        let chain = Chain::parse(&code).unwrap();
        for carrier in Carrier::ALL {
            for _ in 0..5 {
                let (q, offset) = (draws.three(350.0), draws.three(200.0));
                let columns = chain.channel_columns(carrier, &q, &offset, &TOOL_OFFSET);
                for channel in Channel::ALL.into_iter().take(Channel::MACHINE_COUNT) {
                    let k = channel.index();
                    let at = |d| chain.displacement(carrier, &q, &offset, &TOOL_OFFSET, &one(k, d));
                    let difference = sub(at(STEP), at(-STEP)).map(|c| c / (2.0 * STEP));
                    let column = columns[channel.base_column().unwrap()];
                    let what = format!("{} of {code} on {}: {column:?}", channel.name(), carrier.name());
                    assert!(norm(sub(difference, column)) < 2e-6, "{what}, differences {difference:?}");
                    n_felt[k] += usize::from(norm(column) > 0.0);
                }
            }
        }
    }
    assert!(n_felt.iter().all(|&n| n > 0), "a channel that nothing feels: {n_felt:?}");
}

#[test]
fn motion_is_the_derivative_of_the_nominal_position() {
    let mut draws = Draws::new(52);
    for code in all_chains() {
        let chain = Chain::parse(&code).unwrap();
        let (q, offset) = (draws.three(350.0), draws.three(200.0));
        for carrier in Carrier::ALL {
            let columns = chain.channel_columns(carrier, &q, &offset, &TOOL_OFFSET);
            for axis in Axis::ALL {
                let mut further = q;
                further[axis.index()] += 1.0;
                let at = |q| chain.nominal(carrier, q, &offset, &TOOL_OFFSET);
                let difference = sub(at(&further), at(&q));
                let column = columns[Channel::Motion(axis).base_column().unwrap()];
                assert!(norm(sub(difference, column)) < 1e-12, "{code} {} {axis:?}", carrier.name());
            }
        }
    }
}

#[test]
fn the_rig_by_differences() {
    let mut draws = Draws::new(53);
    for _ in 0..50 {
        let (pose, base) = (drawn_pose(&mut draws), draws.three(400.0));
        let columns = pose.rig_columns(&base);
        for channel in Channel::ALL {
            let Some(place) = channel.rig_column() else { continue };
            // The disparity's column is z p, a million mm²: a smaller number moves the point as far.
            let step = if channel.name() == "rig-disparity" { 1e-7 } else { 1e-4 };
            let at = |number| {
                let mut rig = [0.0; Channel::RIG_COLUMN_COUNT];
                rig[place] = number;
                pose.measured_from_base(&rig, &base)
            };
            let difference = sub(at(step), at(-step)).map(|c| c / (2.0 * step));
            // As above for levers below two metres; rounding of 1e-13 mm over the smaller step is less.
            let tolerance = 5e-6;
            assert!(norm(sub(difference, columns[place])) < tolerance, "{}", channel.name());
        }
    }
    assert_eq!(Pose::default().rig_columns(&[1.0, 2.0, 3.0])[6], [1.0, 2.0, 3.0]);
}

/// Li Eqs. 9 to 16: errors referred to a place `t` of the carriages, δ + ε × t, act on the lever less t.
#[test]
fn abbe_transfer_of_the_columns() {
    let mut draws = Draws::new(54);
    for code in all_chains() {
        let chain = Chain::parse(&code).unwrap();
        for carrier in [Carrier::Tool, Carrier::Work, Carrier::Relative] {
            let (q, offset, t) = (draws.three(350.0), draws.three(200.0), draws.three(100.0));
            let at = |offset| chain.channel_columns(carrier, &q, &offset, &TOOL_OFFSET);
            let (here, there) = (at(offset), at(sub(offset, t)));
            for axis in Axis::ALL {
                let column = |columns: &[[f64; 3]; 33], c: Component| columns[6 * axis.index() + c.index()];
                for (angle, unit) in [Component::A, Component::B, Component::C].into_iter().zip(UNIT) {
                    // ε × l = (ε × t, as a translation) + ε × (l − t)
                    let lever = cross(unit, t);
                    let translations = [Component::X, Component::Y, Component::Z];
                    let moved = translations.into_iter().zip(lever).fold([0.0; 3], |sum, (c, lever)| {
                        add(sum, column(&here, c).map(|column| lever * column))
                    });
                    let expected = add(column(&there, angle), moved);
                    assert!(norm(sub(column(&here, angle), expected)) < 1e-12, "{code} {axis:?} {angle:?}");
                }
            }
        }
    }
}

const UNIT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// The same without small angles, for the axis that carries the point directly: R(ε) l + δ exactly.
#[test]
fn abbe_transfer_exactly() {
    let mut draws = Draws::new(55);
    for code in all_chains() {
        let chain = Chain::parse(&code).unwrap();
        let Some(&outermost) = chain.tool_axes().last() else { continue };
        let (q, offset) = (draws.three(350.0), draws.three(200.0));
        let epsilon = draws.three(0.02);
        let mut d = Displacements::default();
        d.joints[outermost.index()][3..].copy_from_slice(&epsilon);
        let at = |offset| chain.position(Carrier::Tool, &q, &offset, &TOOL_OFFSET, &d);
        let lever: [f64; 3] =
            (nalgebra::Rotation3::from_scaled_axis(epsilon.into()) * nalgebra::Vector3::from(offset)).into();
        assert!(norm(sub(sub(at(offset), at([0.0; 3])), lever)) < 1e-12, "{code}");
    }
}

/// Li's Eq. 8 as derived for his printer, `wZbXYt`, literally; squareness as in every chain.
#[test]
fn li_equation_8() {
    let chain = Chain::parse("wZbXYt").unwrap();
    let mut draws = Draws::new(56);
    for _ in 0..20 {
        let ([x, y, z], [l_x, l_y, l_z]) = (draws.three(320.0), draws.three(200.0));
        let numbers: [f64; Channel::MACHINE_COUNT] =
            std::array::from_fn(|k| if k < 21 { draws.symmetric() } else { 0.0 });
        let [
            d_xx,
            d_yx,
            d_zx,
            e_xx,
            e_yx,
            e_zx,
            d_xy,
            d_yy,
            d_zy,
            e_xy,
            e_yy,
            e_zy,
            d_xz,
            d_yz,
            d_zz,
            e_xz,
            e_yz,
            e_zz,
            s_xy,
            s_xz,
            s_yz,
            ..,
        ] = numbers;
        let expected = [
            d_xx + d_xy + d_xz - y * (e_zx + e_zz) + z * e_yz + l_z * (e_yx + e_yy + e_yz)
                - l_y * (e_zx + e_zy + e_zz)
                - (s_xy * y + s_xz * z),
            d_yx + d_yy + d_yz + x * e_zz - z * e_xz + l_x * (e_zx + e_zy + e_zz)
                - l_z * (e_xx + e_xy + e_xz)
                - s_yz * z,
            d_zx + d_zy + d_zz - x * e_yz + y * (e_xx + e_xz) - l_x * (e_yx + e_yy + e_yz)
                + l_y * (e_xx + e_xy + e_xz),
        ];
        let columns = chain.channel_columns(Carrier::Relative, &[x, y, z], &[l_x, l_y, l_z], &[0.0; 3]);
        let found = columns.iter().zip(numbers).fold([0.0; 3], |sum, (c, f)| add(sum, c.map(|c| c * f)));
        // Thirty products of some 500 mm with numbers below 1.
        assert!(norm(sub(found, expected)) < 1e-11, "{found:?} {expected:?}");
    }
}
