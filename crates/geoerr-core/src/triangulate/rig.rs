//! Two projection matrices, checked once and brought to one scale.

use super::pair::Pair;
use super::{Side, TriangulateError};

/// Smallest `|det M| / (‖m₁‖‖m₂‖‖m₃‖)` of a camera at a finite place: an affine camera has 0, a lens of
/// 10⁶ px focal length still 10⁻³ or more.
const MIN_RELATIVE_DETERMINANT: f64 = 1e-12;

/// Smallest baseline relative to the size of the centres' coordinates: below it the centres differ by rounding only.
const MIN_RELATIVE_BASELINE: f64 = 1e-12;

/// One camera: its matrix scaled so that the third row gives the depth in mm, and its rays.
#[derive(Clone, Copy, Debug)]
pub(super) struct Camera {
    /// Rows of the 3×4 matrix; `‖m₃‖ = 1` and `det M > 0`, so that `m₃·p + m₃₄` is the depth, positive in front.
    pub rows: [[f64; 4]; 3],
    /// `M⁻¹` times `det M`: turns `(u, v, 1)` into the direction of its ray, of any positive length.
    pub ray_from_pixel: [[f64; 3]; 3],
    /// Projection centre `−M⁻¹ m₄`.
    pub centre_mm: [f64; 3],
}

/// A checked pair of projection matrices.
///
/// A projection matrix stands for the same camera at any scale and sign; here each is scaled to a third row of
/// unit length and a positive determinant (Hartley & Zisserman 2004, Eq. 6.15), so that results do not depend on it.
#[derive(Clone, Copy, Debug)]
pub struct Rig {
    pub(super) left: Camera,
    pub(super) right: Camera,
    pub(super) pair: Pair,
}

impl Rig {
    /// Checks two 3×4 matrices (row-major, mm to px) that see the same world frame.
    ///
    /// # Errors
    /// [`TriangulateError::ProjectionNotFinite`], [`TriangulateError::ProjectionSingular`] (no finite projection
    /// centre) and [`TriangulateError::CentresCoincide`].
    pub fn new(
        projection_left: &[[f64; 4]; 3],
        projection_right: &[[f64; 4]; 3],
    ) -> Result<Self, TriangulateError> {
        let left = Camera::new(projection_left, Side::Left)?;
        let right = Camera::new(projection_right, Side::Right)?;
        let rig = Self { left, right, pair: Pair::new(&left, &right) };
        let baseline_mm = rig.baseline_mm();
        if baseline_mm <= MIN_RELATIVE_BASELINE * (norm(&left.centre_mm) + norm(&right.centre_mm)) {
            return Err(TriangulateError::CentresCoincide { baseline_mm });
        }
        Ok(rig)
    }

    /// Distance of the two projection centres.
    pub fn baseline_mm(&self) -> f64 {
        norm(&std::array::from_fn(|i| self.right.centre_mm[i] - self.left.centre_mm[i]))
    }
}

impl Camera {
    fn new(projection: &[[f64; 4]; 3], side: Side) -> Result<Self, TriangulateError> {
        if !projection.iter().flatten().all(|value| value.is_finite()) {
            return Err(TriangulateError::ProjectionNotFinite { side });
        }
        let m: [[f64; 3]; 3] = projection.map(|[a, b, c, _]| [a, b, c]);
        let determinant = dot(&m[0], &cross(&m[1], &m[2]));
        let size = norm(&m[0]) * norm(&m[1]) * norm(&m[2]);
        let relative_determinant = if size > 0.0 { determinant.abs() / size } else { 0.0 };
        if relative_determinant <= MIN_RELATIVE_DETERMINANT {
            return Err(TriangulateError::ProjectionSingular { side, relative_determinant });
        }
        let scale = determinant.signum() / norm(&m[2]);
        let rows = projection.map(|row| row.map(|value| value * scale));
        let m: [[f64; 3]; 3] = rows.map(|[a, b, c, _]| [a, b, c]);
        // The columns of the adjugate are the cross products of the rows.
        let columns = [cross(&m[1], &m[2]), cross(&m[2], &m[0]), cross(&m[0], &m[1])];
        let ray_from_pixel = std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]));
        let determinant = dot(&m[0], &columns[0]);
        let fourth = [rows[0][3], rows[1][3], rows[2][3]];
        let centre_mm = ray_from_pixel.map(|row| -dot(&row, &fourth) / determinant);
        Ok(Self { rows, ray_from_pixel, centre_mm })
    }
}

fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn norm(a: &[f64; 3]) -> f64 {
    dot(a, a).sqrt()
}
