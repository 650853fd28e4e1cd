//! The arithmetic of one point (of [`WIDTH`] points at once): rows, normal equations, Gauss–Newton steps.
//!
//! | symbol | code | meaning | unit |
//! |---|---|---|---|
//! | `$\mathbf a_i, b_i$` | `row.a`, `row.b` | a row of Li's `A p = B`: `$\mathbf a = u\,\mathbf m_3 - \mathbf m_1$`, `$b = m_{14} - u\,m_{34}$` | px, px·mm |
//! | `$w_i$` | `row.weight` | inverse variance of the row's pixel | px⁻² |
//! | `$d$` | `depth` | `$\mathbf m_3\!\cdot\!\mathbf p + m_{34}$` | mm |
//! | `$r_i$` | `residual` | measured minus reprojected pixel, `$(\mathbf a_i\!\cdot\!\mathbf p - b_i)/d$` | px |
//! | `$\mathbf j_i$` | `j` | `$\partial r_i/\partial\mathbf p = (\mathbf a_i - r_i\,\mathbf m_3)/d$` | px/mm |
//! | `$N, \mathbf g$` | `normal` | `$\sum w\,\mathbf j\mathbf j^\top$`, `$\sum w\,\mathbf j\,r$` | px⁻² weighted |

use super::lanes::Lanes;
use super::rig::{Camera, Rig};

/// A vector of three lanes.
type Vector = [Lanes; 3];

/// Pixel and covariance `[[c00, c01], [c01, c11]]` of one view.
#[derive(Clone, Copy)]
pub(super) struct Sight {
    pub u_px: Lanes,
    pub v_px: Lanes,
    pub c00_px2: Lanes,
    pub c01_px2: Lanes,
    pub c11_px2: Lanes,
}

/// What the kernel finds; the caller turns it into rows and status codes.
pub(super) struct Solution {
    pub point_mm: Vector,
    /// xx, xy, xz, yy, yz, zz.
    pub covariance_mm2: [Lanes; 6],
    pub reprojection_px: Lanes,
    pub depth_left_mm: Lanes,
    pub depth_right_mm: Lanes,
    /// Squared sine of the angle between the two rays.
    pub sine_squared: Lanes,
}

/// One row of `A p = B`.
#[derive(Clone, Copy)]
struct Row {
    a: Vector,
    b: Lanes,
    weight: Lanes,
}

/// The two rows of one view, made independent of each other: the second is `v − slope·u`.
#[derive(Clone, Copy)]
struct View<'a> {
    camera: &'a Camera,
    rows: [Row; 2],
    slope: Lanes,
}

/// Sums of the normal equations; the matrix as xx, xy, xz, yy, yz, zz.
struct Normal {
    matrix: [Lanes; 6],
    vector: Vector,
}

/// Triangulates the points of all lanes; see [`crate::triangulate`] for the method.
#[inline(always)]
pub(super) fn solve(rig: &Rig, left: &Sight, right: &Sight, reweightings: u32) -> Solution {
    let views = [View::new(&rig.left, left), View::new(&rig.right, right)];
    let mut p = solve_algebraic(&views);
    if reweightings == 0 {
        p = refine_algebraic(&views, p);
    }
    for _ in 0..reweightings {
        let normal = linearise(&views, &p).0;
        let step = multiply(&inverse(&normal.matrix), &normal.vector);
        p = std::array::from_fn(|i| p[i] - step[i]);
    }
    let (normal, square_sum, depths) = linearise(&views, &p);
    Solution {
        point_mm: p,
        covariance_mm2: inverse(&normal.matrix),
        reprojection_px: (square_sum * 0.5).sqrt(),
        depth_left_mm: depths[0],
        depth_right_mm: depths[1],
        sine_squared: sine_squared(&ray(&rig.left, left), &ray(&rig.right, right)),
    }
}

impl<'a> View<'a> {
    #[inline(always)]
    fn new(camera: &'a Camera, sight: &Sight) -> Self {
        let [m1, m2, m3] = &camera.rows;
        let slope = sight.c01_px2 / sight.c00_px2;
        let a_u: Vector = std::array::from_fn(|i| sight.u_px * m3[i] - Lanes::splat(m1[i]));
        let a_v: Vector = std::array::from_fn(|i| sight.v_px * m3[i] - Lanes::splat(m2[i]));
        let b_u = Lanes::splat(m1[3]) - sight.u_px * m3[3];
        let b_v = Lanes::splat(m2[3]) - sight.v_px * m3[3];
        let one = Lanes::splat(1.0);
        Self {
            camera,
            rows: [
                Row { a: a_u, b: b_u, weight: one / sight.c00_px2 },
                Row {
                    a: std::array::from_fn(|i| a_v[i] - slope * a_u[i]),
                    b: b_v - slope * b_u,
                    weight: one / (sight.c11_px2 - slope * sight.c01_px2),
                },
            ],
            slope,
        }
    }

    #[inline(always)]
    fn depth(&self, p: &Vector) -> Lanes {
        let m3 = &self.camera.rows[2];
        p[0] * m3[0] + p[1] * m3[1] + p[2] * m3[2] + m3[3]
    }
}

impl Normal {
    #[inline(always)]
    fn zero() -> Self {
        Self { matrix: [Lanes::splat(0.0); 6], vector: [Lanes::splat(0.0); 3] }
    }

    #[inline(always)]
    fn add(&mut self, a: &Vector, b: Lanes, weight: Lanes) {
        let wa: Vector = a.map(|value| value * weight);
        self.matrix[0] += wa[0] * a[0];
        self.matrix[1] += wa[0] * a[1];
        self.matrix[2] += wa[0] * a[2];
        self.matrix[3] += wa[1] * a[1];
        self.matrix[4] += wa[1] * a[2];
        self.matrix[5] += wa[2] * a[2];
        for (sum, value) in self.vector.iter_mut().zip(wa) {
            *sum += value * b;
        }
    }
}

/// Least squares of `A p = B` by its normal equations: fast, with an error of `cond²(A)` roundings.
#[inline(always)]
fn solve_algebraic(views: &[View<'_>; 2]) -> Vector {
    let mut normal = Normal::zero();
    for row in views.iter().flat_map(|view| &view.rows) {
        normal.add(&row.a, row.b, row.weight);
    }
    multiply(&inverse(&normal.matrix), &normal.vector)
}

/// Corrects `p` by the least squares of what the rows leave over, which takes the squared condition away.
#[inline(always)]
fn refine_algebraic(views: &[View<'_>; 2], p: Vector) -> Vector {
    let mut normal = Normal::zero();
    for row in views.iter().flat_map(|view| &view.rows) {
        normal.add(&row.a, row.b - dot(&row.a, &p), row.weight);
    }
    let step = multiply(&inverse(&normal.matrix), &normal.vector);
    std::array::from_fn(|i| p[i] + step[i])
}

/// Normal equations of the pixel residuals at `p`, their plain sum of squares (px²) and the two depths.
#[inline(always)]
fn linearise(views: &[View<'_>; 2], p: &Vector) -> (Normal, Lanes, [Lanes; 2]) {
    let mut normal = Normal::zero();
    let mut square_sum = Lanes::splat(0.0);
    let depths = views.map(|view| view.depth(p));
    for (view, depth) in views.iter().zip(depths) {
        let inverse_depth = Lanes::splat(1.0) / depth;
        let m3 = &view.camera.rows[2];
        let residuals = view.rows.map(|row| (dot(&row.a, p) - row.b) * inverse_depth);
        for (row, residual) in view.rows.iter().zip(residuals) {
            let j: Vector = std::array::from_fn(|i| (row.a[i] - residual * m3[i]) * inverse_depth);
            normal.add(&j, residual, row.weight);
        }
        let v_residual = residuals[1] + view.slope * residuals[0];
        square_sum += residuals[0] * residuals[0] + v_residual * v_residual;
    }
    (normal, square_sum, depths)
}

/// Inverse of a symmetric 3×3 matrix by cofactors: one division.
#[inline(always)]
fn inverse(m: &[Lanes; 6]) -> [Lanes; 6] {
    let [xx, xy, xz, yy, yz, zz] = *m;
    let c_xx = yy * zz - yz * yz;
    let c_xy = xz * yz - xy * zz;
    let c_xz = xy * yz - xz * yy;
    let scale = Lanes::splat(1.0) / (xx * c_xx + xy * c_xy + xz * c_xz);
    [
        c_xx * scale,
        c_xy * scale,
        c_xz * scale,
        (xx * zz - xz * xz) * scale,
        (xy * xz - xx * yz) * scale,
        (xx * yy - xy * xy) * scale,
    ]
}

#[inline(always)]
fn multiply(m: &[Lanes; 6], v: &Vector) -> Vector {
    let [xx, xy, xz, yy, yz, zz] = *m;
    [xx * v[0] + xy * v[1] + xz * v[2], xy * v[0] + yy * v[1] + yz * v[2], xz * v[0] + yz * v[1] + zz * v[2]]
}

#[inline(always)]
fn dot(a: &Vector, b: &Vector) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn ray(camera: &Camera, sight: &Sight) -> Vector {
    camera.ray_from_pixel.map(|row| sight.u_px * row[0] + sight.v_px * row[1] + row[2])
}

#[inline(always)]
fn sine_squared(a: &Vector, b: &Vector) -> Lanes {
    let c = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    dot(&c, &c) / (dot(a, a) * dot(b, b))
}
