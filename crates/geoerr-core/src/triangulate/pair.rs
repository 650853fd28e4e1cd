//! Both cameras as the left one's pixels see them: what the fast kernels need of a rig, worked out once.
//!
//! Pixels are counted from a whole pixel near each camera's principal point (the difference is exact), so that small
//! numbers are multiplied. With `y` the homogeneous left pixel of a point (`y₃` its depth, mm),
//!
//! ```math
//! \mathbf p = N\mathbf y + \mathbf c,\qquad \mathbf y' = H\mathbf y + \mathbf e
//! ```
//!
//! | symbol | code | meaning | unit |
//! |---|---|---|---|
//! | `$N$`, `$\mathbf c$` | `world_from_left`, `centre_mm` | `$M^{-1}$` of the left matrix, its projection centre | mm/(px·mm), mm |
//! | `$H$` | `right_from_left` | `$M'M^{-1}$`: where the right camera sees what the left one sees at infinity | - |
//! | `$\mathbf e$` | `epipole` | the left centre's homogeneous right pixel | px·mm, px·mm, mm |
//! | `$D$` | `rest` | `$H - \mathrm{diag}(s_1, s_2, 1)$` | - |
//! | `$s_1, s_2$` | `stretch` | `$H_{11}, H_{22}$` to 24 digits: a pixel times one of them less a pixel rounds once | - |
//!
//! What points differ by is the *parallax* `u'·(H x)₃ − (H x)₁`: of two nearly parallel cameras a small difference of large
//! numbers, which the split `H = diag(s₁, s₂, 1) + D` takes before anything is rounded.

use super::double_double::Double;
use super::rig::Camera;

/// Rays that meet at a smaller angle are left to the careful path.
///
/// The parallax is wrong by some twenty roundings of a pixel coordinate counted from the principal point, so that a
/// point's relative error is `20 ε / angle` at most: 4·10⁻¹¹ here, and as for QR the rows' condition times `ε`.
const FAST_RAY_ANGLE_RAD: f64 = 1e-4;

/// See the head of this file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub left_origin_px: [f64; 2],
    pub right_origin_px: [f64; 2],
    pub world_from_left: [[f64; 3]; 3],
    pub centre_mm: [f64; 3],
    pub right_from_left: [[f64; 3]; 3],
    pub epipole: [f64; 3],
    pub stretch: [f64; 2],
    pub rest: [[f64; 3]; 3],
    /// Least squared focal length of each camera, px².
    pub least_focal_px2: [f64; 2],
    /// The rays' angle is large enough where the parallax squared times this is above the product of both views'
    /// `least_focal_px2` plus the squared distance from the principal point.
    pub parallax_gain: f64,
}

type Doubles = [[Double; 4]; 3];

impl Pair {
    pub(super) fn new(left: &Camera, right: &Camera) -> Self {
        let [(left_origin_px, m), (right_origin_px, m_right)] = [left, right].map(from_origin);
        let inverse = inverse(&m);
        let centre = inverse.map(|row| -dot(&row, &m.map(|row| row[3])));
        let right_from_left: [[Double; 3]; 3] = m_right
            .map(|row| std::array::from_fn(|j| dot(&[row[0], row[1], row[2]], &inverse.map(|row| row[j]))));
        let epipole = m_right.map(|row| dot(&[row[0], row[1], row[2]], &centre) + row[3]);
        let stretch = [0, 1].map(|i| f64::from(right_from_left[i][i].rounded() as f32));
        let diagonal = [stretch[0], stretch[1], 1.0];
        let rest = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let taken = Double::from(if i == j { diagonal[i] } else { 0.0 });
                (right_from_left[i][j] - taken).rounded()
            })
        });
        let [focal_left_px2, focal_right_px2] = [left, right].map(squared_focal_lengths);
        // For K upper triangular and the directions' cross product c, the first two components of det(K⁻¹) Kᵀ c are at
        // least the parallax over the greatest focal length; a ray (K⁻¹ x, 1) is at most √(1 + |x|²/least²) long.
        let parallax_gain = focal_left_px2[0] * focal_right_px2[0]
            / (FAST_RAY_ANGLE_RAD * FAST_RAY_ANGLE_RAD * focal_right_px2[1]);
        Self {
            left_origin_px,
            right_origin_px,
            world_from_left: inverse.map(|row| row.map(Double::rounded)),
            centre_mm: centre.map(Double::rounded),
            right_from_left: right_from_left.map(|row| row.map(Double::rounded)),
            epipole: epipole.map(Double::rounded),
            stretch,
            rest,
            least_focal_px2: [focal_left_px2[0], focal_right_px2[0]],
            parallax_gain,
        }
    }
}

/// A whole pixel near the principal point, and the matrix for pixels counted from there.
fn from_origin(camera: &Camera) -> ([f64; 2], Doubles) {
    let [m1, m2, m3] = &camera.rows;
    let origin_px = [m1, m2].map(|m| (m[0] * m3[0] + m[1] * m3[1] + m[2] * m3[2]).round());
    let shifted = |m: &[f64; 4], origin: f64| -> [Double; 4] {
        std::array::from_fn(|j| Double::from(m[j]) - Double::from(origin) * Double::from(m3[j]))
    };
    (origin_px, [shifted(m1, origin_px[0]), shifted(m2, origin_px[1]), m3.map(Double::from)])
}

/// Least and greatest eigenvalue of `K Kᵀ` of the camera's upper left 2×2 part: focal lengths, with any skew.
fn squared_focal_lengths(camera: &Camera) -> [f64; 2] {
    let [m1, m2, m3] = camera.rows.map(|[a, b, c, _]| [a, b, c]);
    let inner = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let across = |a, b| inner(a, b) - inner(a, &m3) * inner(b, &m3);
    let (uu, uv, vv) = (across(&m1, &m1), across(&m1, &m2), across(&m2, &m2));
    let (mean, spread) = (0.5 * (uu + vv), (0.5 * (uu - vv)).hypot(uv));
    [(uu * vv - uv * uv) / (mean + spread), mean + spread]
}

fn inverse(m: &Doubles) -> [[Double; 3]; 3] {
    let minor = |i: usize, j: usize, k: usize, l: usize| m[i][k] * m[j][l] - m[i][l] * m[j][k];
    let cofactor = |i: usize, j: usize| {
        let (next, after) = ((i + 1) % 3, (i + 2) % 3);
        minor(next, after, (j + 1) % 3, (j + 2) % 3)
    };
    let determinant = dot(&[m[0][0], m[0][1], m[0][2]], &std::array::from_fn(|j| cofactor(0, j)));
    std::array::from_fn(|i| std::array::from_fn(|j| cofactor(j, i) / determinant))
}

fn dot(a: &[Double; 3], b: &[Double; 3]) -> Double {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
