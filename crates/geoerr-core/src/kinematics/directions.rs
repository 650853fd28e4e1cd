//! Directions of the three axes from their squareness.

use std::f64::consts::FRAC_PI_2;

use super::KinematicsError;
use super::error_tables::Squareness;
use super::vec3::Vec3;

/// Direction of each axis minus its nominal one: `[x̂' − x̂, ŷ' − ŷ, ẑ' − ẑ]`.
///
/// ```math
/// \hat x' = (1,0,0), \quad \hat y' = (-\sin S_{xy}, \cos S_{xy}, 0), \quad
/// \hat z' = \Bigl(-\sin S_{xz},\; -\tfrac{\sin S_{yz} + \sin S_{xy}\sin S_{xz}}{\cos S_{xy}},\; \sqrt{1 - z_x^2 - z_y^2}\Bigr)
/// ```
///
/// X is the datum and Y lies in the XY plane; all are unit vectors and every included angle is exactly
/// 90° + S. Differences from the nominal directions, because those are what the errors are made of and
/// `1 − cos` would lose their digits.
///
/// # Errors
/// [`KinematicsError::Squareness`] where a number is not finite or no such directions exist.
pub(crate) fn deviations(squareness: &Squareness) -> Result<[Vec3; 3], KinematicsError> {
    let &Squareness { s_xy_rad, s_xz_rad, s_yz_rad } = squareness;
    let refused = KinematicsError::Squareness { s_xy_rad, s_xz_rad, s_yz_rad };
    let is_angle = |s: f64| s.abs() < FRAC_PI_2;
    if !(is_angle(s_xy_rad) && is_angle(s_xz_rad) && is_angle(s_yz_rad)) {
        return Err(refused);
    }
    let half = (0.5 * s_xy_rad).sin();
    let y = [-s_xy_rad.sin(), -2.0 * half * half, 0.0];
    let z_x = -s_xz_rad.sin();
    let z_y = (-s_yz_rad.sin() + s_xy_rad.sin() * z_x) / s_xy_rad.cos();
    let across = z_x * z_x + z_y * z_y;
    if across >= 1.0 {
        return Err(refused);
    }
    let z_z = -across / (1.0 + (1.0 - across).sqrt());
    // -0.0 would be harmless but ugly in a nominal machine.
    Ok([[0.0; 3], y.map(|c| c + 0.0), [z_x, z_y, z_z].map(|c| c + 0.0)])
}

/// Derivatives of [`deviations`] by S_xy, S_xz and S_yz: `[axis][squareness]`.
///
/// Of angles that [`deviations`] accepts.
pub(crate) fn deviation_rates(squareness: &Squareness) -> [[Vec3; 3]; 3] {
    let &Squareness { s_xy_rad, s_xz_rad, s_yz_rad } = squareness;
    let (sin_xy, cos_xy) = s_xy_rad.sin_cos();
    let z_x = -s_xz_rad.sin();
    let z_y = (-s_yz_rad.sin() + sin_xy * z_x) / cos_xy;
    let height = (1.0 - z_x * z_x - z_y * z_y).sqrt();
    let z = |x_rate: f64, y_rate: f64| [x_rate, y_rate, -(z_x * x_rate + z_y * y_rate) / height];
    let x_by_xz = -s_xz_rad.cos();
    [
        [[0.0; 3]; 3],
        [[-cos_xy, -sin_xy, 0.0], [0.0; 3], [0.0; 3]],
        [
            z(0.0, z_x + z_y * sin_xy / cos_xy),
            z(x_by_xz, sin_xy * x_by_xz / cos_xy),
            z(0.0, -s_yz_rad.cos() / cos_xy),
        ],
    ]
}

#[cfg(test)]
mod tests {
    use super::super::vec3::{add, dot};
    use super::*;

    #[test]
    fn unit_directions_at_the_given_angles() {
        let s = Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 0.31 };
        let d = deviations(&s).unwrap();
        let axes = [add(&d[0], &[1., 0., 0.]), add(&d[1], &[0., 1., 0.]), add(&d[2], &[0., 0., 1.])];
        for axis in &axes {
            assert!((dot(axis, axis) - 1.0).abs() < 4e-16);
        }
        for (a, b, angle) in [(0, 1, s.s_xy_rad), (0, 2, s.s_xz_rad), (1, 2, s.s_yz_rad)] {
            let included = dot(&axes[a], &axes[b]).acos() - FRAC_PI_2;
            assert!((included - angle).abs() < 4e-16, "{included} {angle}");
        }
    }

    #[test]
    fn none_for_a_square_machine() {
        assert_eq!(deviations(&Squareness::default()), Ok([[0.0; 3]; 3]));
    }

    #[test]
    fn rates_are_differences_of_deviations() {
        let at = [-5.05e-2, 0.124, 0.31];
        let of =
            |s: [f64; 3]| deviations(&Squareness { s_xy_rad: s[0], s_xz_rad: s[1], s_yz_rad: s[2] }).unwrap();
        let rates = deviation_rates(&Squareness { s_xy_rad: at[0], s_xz_rad: at[1], s_yz_rad: at[2] });
        for (axis, rates) in rates.iter().enumerate() {
            for (pair, rate) in rates.iter().enumerate() {
                let moved =
                    |step: f64| of(std::array::from_fn(|k| at[k] + if k == pair { step } else { 0.0 }));
                let (plus, minus) = (moved(1e-5)[axis], moved(-1e-5)[axis]);
                for (c, by) in rate.iter().enumerate() {
                    let difference = (plus[c] - minus[c]) / 2e-5;
                    assert!((difference - by).abs() < 1e-9, "{axis} {pair} {c}");
                }
            }
        }
    }
}
