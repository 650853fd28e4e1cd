//! From the base frame to what a camera pair reports: its pose, and what it adds.

use serde::{Deserialize, Serialize};

use super::channel::{Channel, RigError};
use super::rotation::Rotation;
use super::vec3::{Vec3, add, cross, dot, scale};

/// A vector for each rig channel, in the camera's frame, at its [`Channel::rig_column`].
pub type RigColumns = [[f64; 3]; Channel::RIG_COLUMN_COUNT];

/// One number for each rig channel, in the order of [`RigError::ALL`].
pub type RigNumbers = [f64; Channel::RIG_COLUMN_COUNT];

/// Where a camera stands: `p_c = R p + t`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// R, by rows.
    pub camera_from_base: [[f64; 3]; 3],
    /// t, mm.
    pub t_mm: [f64; 3],
}

impl Default for Pose {
    /// A measuring frame that is the base frame.
    fn default() -> Self {
        Self { camera_from_base: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], t_mm: [0.0; 3] }
    }
}

impl Pose {
    /// A vector of the base frame in the camera's.
    #[inline]
    pub fn turn(&self, vector: &[f64; 3]) -> [f64; 3] {
        self.camera_from_base.map(|row| dot(&row, vector))
    }

    /// A point of the base frame in the camera's, mm.
    #[inline]
    pub fn to_camera(&self, base_mm: &[f64; 3]) -> [f64; 3] {
        add(&self.turn(base_mm), &self.t_mm)
    }

    /// The pose after a further turn by `rotation_rad` about the camera and a further shift, both exact:
    /// `p_c ↦ R(r) p_c + t`.
    pub fn moved(&self, translation_mm: &[f64; 3], rotation_rad: &[f64; 3]) -> Self {
        let rotation = Rotation::new(rotation_rad);
        let columns: [Vec3; 3] =
            std::array::from_fn(|c| rotation.apply(&std::array::from_fn(|r| self.camera_from_base[r][c])));
        Self {
            camera_from_base: std::array::from_fn(|r| std::array::from_fn(|c| columns[c][r])),
            t_mm: add(&rotation.apply(&self.t_mm), translation_mm),
        }
    }

    /// What the rig makes of a point of the base frame: it moved, then mismeasures.
    ///
    /// ```math
    /// \mathbf p_m = (1 + k)\,\mathbf p + z\,(k_1 \hat{\mathbf z} + k_2\,\mathbf p + r_x \hat{\mathbf x} + r_y \hat{\mathbf y}),
    /// \qquad \mathbf p = R(\mathbf r)\,(R\,\mathbf p_{base} + \mathbf t) + \mathbf t_{rig}
    /// ```
    ///
    /// | symbol | code | meaning | unit |
    /// |---|---|---|---|
    /// | `$\mathbf t_{rig}, \mathbf r$` | `rig[0..6]` | motion of the camera's frame | mm, rad |
    /// | `$k, k_1, k_2$` | `rig[6..9]` | scale, depth, disparity | -, -, 1/mm |
    /// | `$r_x, r_y$` | `rig[9..11]` | shift of every ray | - |
    #[inline]
    pub fn measured_from_base(&self, rig: &RigNumbers, base_mm: &[f64; 3]) -> [f64; 3] {
        let camera_mm = self.to_camera(base_mm);
        add(&camera_mm, &rig_displacement(rig, &camera_mm))
    }

    /// Derivative of [`measured_from_base`](Self::measured_from_base) by each rig number where all are 0.
    #[inline]
    pub fn rig_columns(&self, base_mm: &[f64; 3]) -> RigColumns {
        rig_columns_at(&self.to_camera(base_mm))
    }
}

/// Measured minus true position of a point of the camera's frame, mm; exactly 0 for a rig without errors.
pub fn rig_displacement(rig: &RigNumbers, camera_mm: &[f64; 3]) -> [f64; 3] {
    let &[tx, ty, tz, rx, ry, rz, k, depth, disparity, ray_x, ray_y] = rig;
    let moved = add(&Rotation::new(&[rx, ry, rz]).displacement(camera_mm), &[tx, ty, tz]);
    let point = add(camera_mm, &moved);
    let along = scale(k + disparity * point[2], &point);
    add(&add(&moved, &along), &scale(point[2], &[ray_x, ray_y, depth]))
}

#[inline]
fn rig_columns_at(camera_mm: &[f64; 3]) -> RigColumns {
    let z = camera_mm[2];
    RigError::ALL.map(|error| match error {
        RigError::TranslationX => [1.0, 0.0, 0.0],
        RigError::TranslationY => [0.0, 1.0, 0.0],
        RigError::TranslationZ => [0.0, 0.0, 1.0],
        RigError::RotationX => cross(&[1.0, 0.0, 0.0], camera_mm),
        RigError::RotationY => cross(&[0.0, 1.0, 0.0], camera_mm),
        RigError::RotationZ => cross(&[0.0, 0.0, 1.0], camera_mm),
        RigError::Scale => *camera_mm,
        RigError::Depth => [0.0, 0.0, z],
        RigError::Disparity => scale(z, camera_mm),
        RigError::RayX => [z, 0.0, 0.0],
        RigError::RayY => [0.0, z, 0.0],
    })
}
