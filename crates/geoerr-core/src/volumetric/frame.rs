//! How a session's measuring device stands to the machine.

use serde::{Deserialize, Serialize};

use crate::kinematics::Pose;

/// What a session measures its points in.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Frame {
    /// Positions: `p_measured = R p_base + t`.
    Positions {
        /// Where the device stands.
        pose: Pose,
        /// About this point of the base corrections turn: near the session's points, so that they mix little with
        /// translations.
        pivot_mm: [f64; 3],
        /// Whether the rotation is unknown; a device that measures single components stands parallel to the base.
        turns: bool,
    },
    /// Radii about a centre: `r = |p − c| + excess`.
    Circle {
        /// The centre, in the frame of the points.
        centre_mm: [f64; 3],
        /// What the device adds to every radius.
        excess_mm: f64,
    },
    /// Lengths: ends that lie on no common frame, for nobody asks where a part lay ([`Sightings::length`]).
    ///
    /// [`Sightings::length`]: super::Sightings::length
    Lengths,
}

impl Frame {
    /// Number of unknowns: translation and rotation, translation alone, centre and excess, or none.
    pub fn n_columns(&self) -> usize {
        match self {
            Self::Positions { turns: true, .. } => 6,
            Self::Positions { turns: false, .. } => 3,
            Self::Circle { .. } => 4,
            Self::Lengths => 0,
        }
    }

    /// The frame after a correction of its unknowns: translation (mm) in the base frame, rotation vector (rad) about
    /// the pivot; or centre and excess (mm).
    ///
    /// `R' = R exp(ω)` and `t' = t + R (c + τ) − R' c`: a point at the pivot moves by τ, seen from the device.
    #[must_use]
    pub fn corrected(&self, correction: &[f64]) -> Self {
        let at = |place: usize| correction.get(place).copied().unwrap_or(0.0);
        match *self {
            Self::Positions { pose, pivot_mm, turns } => {
                let mut turned = pose;
                if turns {
                    turned.camera_from_base =
                        product(&pose.camera_from_base, &rotation_by(&[at(3), at(4), at(5)]));
                }
                let moved = [pivot_mm[0] + at(0), pivot_mm[1] + at(1), pivot_mm[2] + at(2)];
                let (before, after) = (pose.turn(&moved), turned.turn(&pivot_mm));
                turned.t_mm = std::array::from_fn(|c| pose.t_mm[c] + before[c] - after[c]);
                Self::Positions { pose: turned, pivot_mm, turns }
            }
            Self::Circle { centre_mm, excess_mm } => Self::Circle {
                centre_mm: std::array::from_fn(|c| centre_mm[c] + at(c)),
                excess_mm: excess_mm + at(3),
            },
            Self::Lengths => Self::Lengths,
        }
    }
}

/// `A B`.
#[inline]
fn product(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    a.map(|row| std::array::from_fn(|c| row[0] * b[0][c] + row[1] * b[1][c] + row[2] * b[2][c]))
}

/// Rotation by a vector, from its unit quaternion, so that it stays orthogonal to rounding.
fn rotation_by(vector: &[f64; 3]) -> [[f64; 3]; 3] {
    let angle = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
    let w = (0.5 * angle).cos();
    let factor = if angle > 0.0 { (0.5 * angle).sin() / angle } else { 0.5 };
    let [x, y, z] = vector.map(|v| v * factor);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_correction_moves_the_pivot_by_its_translation() {
        let pose = Pose { camera_from_base: rotation_by(&[0.3, -1.1, 0.4]), t_mm: [10.0, -20.0, 700.0] };
        let pivot_mm = [200.0, 150.0, 80.0];
        let frame = Frame::Positions { pose, pivot_mm, turns: true };
        let Frame::Positions { pose: turned, .. } = frame.corrected(&[0.1, 0.2, -0.3, 0.02, -0.01, 0.03])
        else {
            panic!("positions stay positions")
        };
        let (seen, expected) = (turned.to_camera(&pivot_mm), pose.to_camera(&[200.1, 150.2, 79.7]));
        for c in 0..3 {
            assert!((seen[c] - expected[c]).abs() < 1e-12);
        }
        let rows = turned.camera_from_base;
        for (r, row) in rows.iter().enumerate() {
            for (c, other) in rows.iter().enumerate() {
                let dot: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                assert!((dot - f64::from(u8::from(r == c))).abs() < 1e-15);
            }
        }
    }
}
