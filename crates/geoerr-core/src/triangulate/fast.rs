//! The fast kernels: the same least squares with the left view's two residuals taken out, for healthy points.
//!
//! A row of the left view is its own unknown: `y₁ = u y₃ − r₁`, `y₂ = v y₃ − r₂`. Put into the right view's rows,
//!
//! ```math
//! \boldsymbol\rho = d\,\mathbf a - \mathbf b - C\mathbf r,\qquad
//! \mathbf a = \mathbf x' (H\mathbf x)_3 - (H\mathbf x)_{12},\quad \mathbf b = \mathbf e_{12} - \mathbf x' e_3,\quad
//! C_{ij} = x'_i H_{3j} - H_{ij}
//! ```
//!
//! and least squares over `r` (covariance Σ) and `ρ` (Σ') leaves one unknown, the depth `d`, weighted by
//! `W = Σ' + C Σ Cᵀ`. With `g = adj(W) a`:
//!
//! ```math
//! d = \frac{\mathbf g\cdot\mathbf b}{\mathbf g\cdot\mathbf a},\qquad
//! \mathbf r = \frac{a_1 b_2 - a_2 b_1}{\mathbf g\cdot\mathbf a}\ \Sigma\, C^\top (a_2, -a_1)^\top
//! ```
//!
//! One division, no determinant of a matrix whose condition is squared: the depth is as good as the parallax `a`.
//! A Gauss–Newton step on the pixel residuals is the same elimination about the pixels reprojected so far, and gives the
//! same point as one in space, which [`super::point`] does.
//!
//! A kernel says of every row whether its result is to be trusted: pixels and covariances finite and proper, rays well
//! apart, the point in front of both cameras. The others are left to the careful path, which also names what is wrong.

use super::pair::Pair;
use crate::arithmetic::{Arithmetic, all_three, both, two};

/// `row · (x, y, 1)`.
#[inline(always)]
fn affine<A: Arithmetic>(row: &[f64; 3], x: &[f64; 2]) -> f64 {
    A::mul_add(row[0], x[0], A::mul_add(row[1], x[1], row[2]))
}

/// The point with equal noise in all four pixels, as printed by Li, and whether it is to be trusted.
#[inline(always)]
pub(super) fn point<A: Arithmetic>(pair: &Pair, left_px: &[f64; 2], right_px: &[f64; 2]) -> ([f64; 3], bool) {
    let x = [left_px[0] - pair.left_origin_px[0], left_px[1] - pair.left_origin_px[1]];
    let x_right = [right_px[0] - pair.right_origin_px[0], right_px[1] - pair.right_origin_px[1]];
    let a = parallax::<A>(pair, &x, &x_right);
    let b = offset::<A>(pair, &x_right);
    let c = coupling::<A>(pair, &x_right);
    let [w00, w11] = both(|i| A::mul_add(c[i][0], c[i][0], A::mul_add(c[i][1], c[i][1], 1.0)));
    let w01 = two::<A>(c[0][0], c[1][0], c[0][1], c[1][1]);
    let g = adjugate_times::<A>(&[w00, w01, w11], &a);
    let inverse = 1.0 / two::<A>(g[0], a[0], g[1], a[1]);
    let depth_mm = two::<A>(g[0], b[0], g[1], b[1]) * inverse;
    let turn = two::<A>(a[0], b[1], -a[1], b[0]) * inverse;
    let r = both(|j| turn * two::<A>(c[0][j], a[1], -c[1][j], a[0]));
    let y = [A::mul_add(depth_mm, x[0], -r[0]), A::mul_add(depth_mm, x[1], -r[1]), depth_mm];
    let h3 = &pair.right_from_left[2];
    let depth_right_mm =
        A::mul_add(h3[0], y[0], A::mul_add(h3[1], y[1], A::mul_add(h3[2], y[2], pair.epipole[2])));
    let point_mm = all_three(|i| {
        let n = &pair.world_from_left[i];
        A::mul_add(n[0], y[0], A::mul_add(n[1], y[1], A::mul_add(n[2], y[2], pair.centre_mm[i])))
    });
    let is_good = are_apart::<A>(pair, &x, &x_right, &a)
        & (depth_mm > 0.0)
        & (depth_right_mm > 0.0)
        & is_point(&point_mm);
    (point_mm, is_good)
}

/// Noise of one pixel: what multiplies with it, so that equal noise costs nothing.
pub(super) trait Noise: Copy {
    /// `C Σ`.
    fn spread<A: Arithmetic>(&self, c: &[[f64; 2]; 2]) -> [[f64; 2]; 2];

    /// c00, c01, c11.
    fn covariance(&self) -> [f64; 3];
}

/// 1 px² in u and v.
#[derive(Clone, Copy)]
pub(super) struct Unit;

impl Noise for Unit {
    #[inline(always)]
    fn spread<A: Arithmetic>(&self, c: &[[f64; 2]; 2]) -> [[f64; 2]; 2] {
        *c
    }

    #[inline(always)]
    fn covariance(&self) -> [f64; 3] {
        [1.0, 0.0, 1.0]
    }
}

/// A pixel's own covariance.
#[derive(Clone, Copy)]
pub(super) struct Own(pub [f64; 3]);

impl Noise for Own {
    #[inline(always)]
    fn spread<A: Arithmetic>(&self, c: &[[f64; 2]; 2]) -> [[f64; 2]; 2] {
        let s = &self.0;
        both(|i| [two::<A>(c[i][0], s[0], c[i][1], s[1]), two::<A>(c[i][0], s[1], c[i][1], s[2])])
    }

    #[inline(always)]
    fn covariance(&self) -> [f64; 3] {
        self.0
    }
}

/// One view of a point: its pixel from the camera's origin and the pixel's noise.
#[derive(Clone, Copy)]
pub(super) struct Seen<N> {
    pub x: [f64; 2],
    pub noise: N,
}

/// A point as the left camera has it: its depth, and what the measured left pixel is off its image.
#[derive(Clone, Copy)]
pub(super) struct State {
    pub depth_mm: f64,
    pub residual_px: [f64; 2],
}

/// Everything of a point.
pub(super) struct Found {
    pub point_mm: [f64; 3],
    /// xx, xy, xz, yy, yz, zz.
    pub covariance_mm2: [f64; 6],
    pub reprojection_px: f64,
    pub is_good: bool,
}

/// Li's rows weighted by the pixels' covariances, and whether the rays are well apart.
#[inline(always)]
pub(super) fn start<A: Arithmetic, N: Noise>(pair: &Pair, left: &Seen<N>, right: &Seen<N>) -> (State, bool) {
    let a = parallax::<A>(pair, &left.x, &right.x);
    let b = offset::<A>(pair, &right.x);
    let c = coupling::<A>(pair, &right.x);
    let cs = left.noise.spread::<A>(&c);
    let w = weight::<A>(&c, &cs, 1.0, &right.noise.covariance());
    let g = adjugate_times::<A>(&w, &a);
    let along = two::<A>(g[0], b[0], g[1], b[1]);
    let depth_mm = along / two::<A>(g[0], a[0], g[1], a[1]);
    let turn = two::<A>(a[0], b[1], -a[1], b[0]) / along;
    let residual_px = both(|j| turn * two::<A>(cs[0][j], a[1], -cs[1][j], a[0]));
    (State { depth_mm, residual_px }, are_apart::<A>(pair, &left.x, &right.x, &a))
}

/// The right view at a state: `ρ ≈ r' + (a δd + d C (r − r_new))/d'`.
struct Linear {
    image: [f64; 2],
    residual_right_px: [f64; 2],
    depth_right_mm: f64,
    a: [f64; 2],
    c: [[f64; 2]; 2],
    /// `d / d'`.
    ratio: f64,
    /// `C Σ`.
    cs: [[f64; 2]; 2],
    /// `Σ' + (d/d')² C Σ Cᵀ` as 00, 01, 11.
    w: [f64; 3],
    /// `adj(W) a`.
    g: [f64; 2],
}

#[inline(always)]
fn linearise<A: Arithmetic, N: Noise>(pair: &Pair, left: &Seen<N>, right: &Seen<N>, state: &State) -> Linear {
    let image = [left.x[0] - state.residual_px[0], left.x[1] - state.residual_px[1]];
    let measured = parallax::<A>(pair, &image, &right.x);
    let third = 1.0 + affine::<A>(&pair.rest[2], &image);
    let depth_right_mm = A::mul_add(state.depth_mm, third, pair.epipole[2]);
    let inverse = 1.0 / depth_right_mm;
    let b = offset::<A>(pair, &right.x);
    let residual_right_px = both(|i| A::mul_add(state.depth_mm, measured[i], -b[i]) * inverse);
    let a = both(|i| A::mul_add(-residual_right_px[i], third, measured[i]));
    let c = coupling::<A>(pair, &[right.x[0] - residual_right_px[0], right.x[1] - residual_right_px[1]]);
    let ratio = state.depth_mm * inverse;
    let cs = left.noise.spread::<A>(&c);
    let w = weight::<A>(&c, &cs, ratio * ratio, &right.noise.covariance());
    let g = adjugate_times::<A>(&w, &a);
    Linear { image, residual_right_px, depth_right_mm, a, c, ratio, cs, w, g }
}

/// One Gauss–Newton step of the pixel residuals.
#[inline(always)]
pub(super) fn step<A: Arithmetic, N: Noise>(
    pair: &Pair,
    left: &Seen<N>,
    right: &Seen<N>,
    state: &State,
) -> State {
    let Linear { residual_right_px, depth_right_mm, a, c, ratio, cs, g, .. } =
        linearise::<A, N>(pair, left, right, state);
    let r = &state.residual_px;
    let b = both(|i| A::mul_add(ratio, two::<A>(c[i][0], r[0], c[i][1], r[1]), residual_right_px[i]));
    let inverse = 1.0 / two::<A>(g[0], a[0], g[1], a[1]);
    let depth_mm = A::mul_add(-depth_right_mm * inverse, two::<A>(g[0], b[0], g[1], b[1]), state.depth_mm);
    let turn = ratio * inverse * two::<A>(b[0], a[1], -b[1], a[0]);
    // What is linear is the homogeneous pixel; its image moves by the old depth's share of the new one.
    let share = state.depth_mm / depth_mm;
    let residual_px = both(|j| {
        let new = turn * two::<A>(cs[0][j], a[1], -cs[1][j], a[0]);
        A::mul_add(share, new - r[j], r[j])
    });
    State { depth_mm, residual_px }
}

/// Point, covariance and reprojection error of a state.
///
/// With `τ = −(d/d'²) Σ Cᵀ W⁻¹ a` what the left image moves by per depth, and `P` its covariance at a given depth, the
/// homogeneous pixel `(d x, d)` has the covariance `d'²/(aᵀ W⁻¹ a) · w wᵀ + d² P` with `w = (x + d τ, 1)`.
#[inline(always)]
pub(super) fn finish<A: Arithmetic, N: Noise>(
    pair: &Pair,
    left: &Seen<N>,
    right: &Seen<N>,
    state: &State,
) -> Found {
    let Linear { image, residual_right_px, depth_right_mm, a, c, ratio, cs, w, g } =
        linearise::<A, N>(pair, left, right, state);
    let n = &pair.world_from_left;
    let depth_mm = state.depth_mm;
    let y = [depth_mm * image[0], depth_mm * image[1]];
    let point_mm = all_three(|i| {
        A::mul_add(n[i][0], y[0], A::mul_add(n[i][1], y[1], A::mul_add(n[i][2], depth_mm, pair.centre_mm[i])))
    });

    let determinant = two::<A>(w[0], w[2], -w[1], w[1]);
    let inverse = 1.0 / determinant;
    let variance_of_depth = depth_right_mm * depth_right_mm * determinant / two::<A>(g[0], a[0], g[1], a[1]);
    let lean = ratio * ratio * inverse;
    let moved = both(|j| A::mul_add(-lean, two::<A>(cs[0][j], g[0], cs[1][j], g[1]), image[j]));
    let ray = all_three(|i| A::mul_add(n[i][0], moved[0], A::mul_add(n[i][1], moved[1], n[i][2])));
    let p = left_covariance::<A, N>(&c, ratio * ratio, &left.noise, &right.noise);
    let scale = depth_mm * depth_mm * inverse;
    let np = all_three(|i| {
        [two::<A>(n[i][0], p[0], n[i][1], p[1]) * scale, two::<A>(n[i][0], p[1], n[i][1], p[2]) * scale]
    });
    let scaled_ray = all_three(|i| ray[i] * variance_of_depth);
    let entry = |i: usize, j: usize| {
        A::mul_add(scaled_ray[i], ray[j], two::<A>(np[i][0], n[j][0], np[i][1], n[j][1]))
    };
    let covariance_mm2 = [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)];

    let [r, r_right] = [&state.residual_px, &residual_right_px];
    let square_sum =
        two::<A>(r[0], r[0], r[1], r[1]) + two::<A>(r_right[0], r_right[0], r_right[1], r_right[1]);
    let is_good = (depth_mm > 0.0)
        & (depth_right_mm > 0.0)
        & is_proper(&left.noise.covariance())
        & is_proper(&right.noise.covariance())
        & is_proper(&w)
        & is_point(&point_mm)
        & ((covariance_mm2[0] + covariance_mm2[3] + covariance_mm2[5]) < f64::INFINITY);
    Found { point_mm, covariance_mm2, reprojection_px: (0.5 * square_sum).sqrt(), is_good }
}

/// `det(W)` times the left image's covariance at a given depth, as 00, 01, 11: a sum of positive matrices.
#[inline(always)]
fn left_covariance<A: Arithmetic, N: Noise>(
    c: &[[f64; 2]; 2],
    ratio_squared: f64,
    left: &N,
    right: &N,
) -> [f64; 3] {
    let adjugate = [[c[1][1], -c[0][1]], [-c[1][0], c[0][0]]];
    let spread = right.spread::<A>(&adjugate);
    let [left, right] = [left.covariance(), right.covariance()];
    let determinant = |c: &[f64; 3]| A::mul_add(c[0], c[2], -(c[1] * c[1]));
    let (gain, from_right) = (ratio_squared * determinant(&left), determinant(&right));
    let entry = |i: usize, j: usize, own: f64| {
        let spread = two::<A>(spread[i][0], adjugate[j][0], spread[i][1], adjugate[j][1]);
        A::mul_add(gain, spread, own * from_right)
    };
    [entry(0, 0, left[0]), entry(0, 1, left[1]), entry(1, 1, left[2])]
}

/// A symmetric 2×2 matrix that is positive definite by a margin: a condition under some 10⁹.
#[inline(always)]
fn is_proper(c: &[f64; 3]) -> bool {
    (c[0] > 0.0) & (c[2] > 0.0) & (c[0] * c[2] - c[1] * c[1] > 1e-9 * (c[0] * c[2]))
}

/// `Σ' + factor · (C Σ) Cᵀ` as 00, 01, 11.
#[inline(always)]
fn weight<A: Arithmetic>(c: &[[f64; 2]; 2], cs: &[[f64; 2]; 2], factor: f64, right: &[f64; 3]) -> [f64; 3] {
    let entry = |i: usize, j: usize, own: f64| {
        A::mul_add(factor, two::<A>(cs[i][0], c[j][0], cs[i][1], c[j][1]), own)
    };
    [entry(0, 0, right[0]), entry(0, 1, right[1]), entry(1, 1, right[2])]
}

#[inline(always)]
fn adjugate_times<A: Arithmetic>(w: &[f64; 3], a: &[f64; 2]) -> [f64; 2] {
    [two::<A>(w[2], a[0], -w[1], a[1]), two::<A>(w[0], a[1], -w[1], a[0])]
}

/// `e₁₂ − x' e₃`.
#[inline(always)]
fn offset<A: Arithmetic>(pair: &Pair, x_right: &[f64; 2]) -> [f64; 2] {
    both(|i| A::mul_add(-x_right[i], pair.epipole[2], pair.epipole[i]))
}

/// `x' (H x)₃ − (H x)₁₂`, the large numbers subtracted first.
#[inline(always)]
fn parallax<A: Arithmetic>(pair: &Pair, x: &[f64; 2], x_right: &[f64; 2]) -> [f64; 2] {
    let third = affine::<A>(&pair.rest[2], x);
    both(|i| {
        let apart = A::mul_add(-pair.stretch[i], x[i], x_right[i]);
        A::mul_add(x_right[i], third, apart - affine::<A>(&pair.rest[i], x))
    })
}

/// `C`: how the left view's residuals show in the right view's rows.
#[inline(always)]
fn coupling<A: Arithmetic>(pair: &Pair, x_right: &[f64; 2]) -> [[f64; 2]; 2] {
    let h = &pair.right_from_left;
    both(|i| both(|j| A::mul_add(x_right[i], h[2][j], -h[i][j])))
}

/// Whether the rays surely meet at [`super::pair`]'s angle or more; false for anything not finite.
#[inline(always)]
fn are_apart<A: Arithmetic>(pair: &Pair, x: &[f64; 2], x_right: &[f64; 2], parallax: &[f64; 2]) -> bool {
    let length = |x: &[f64; 2], focal_px2| A::mul_add(x[0], x[0], A::mul_add(x[1], x[1], focal_px2));
    let [left_px2, right_px2] =
        [length(x, pair.least_focal_px2[0]), length(x_right, pair.least_focal_px2[1])];
    length(parallax, 0.0) * pair.parallax_gain > left_px2 * right_px2
}

#[inline(always)]
fn is_point(point_mm: &[f64; 3]) -> bool {
    (point_mm[0] + point_mm[1] + point_mm[2]).abs() < f64::INFINITY
}
