//! What a marker looks like, pixel by pixel, and how that changes with everything that is adjusted.

use std::ops::Mul;

use super::homography::Homography;
use super::lanes::Lanes;

pub(super) const N_LIGHT: usize = 6;
pub(super) const N_LEVELS: usize = 2 * N_LIGHT;
pub(super) const FIRST_BLUR: usize = 8;
pub(super) const FIRST_LEVEL: usize = 11;
/// Everything that is adjusted: homography, blur, levels.
pub(super) const N_UNKNOWNS: usize = FIRST_LEVEL + N_LEVELS;
pub(super) const SATURATED_GREY: f32 = 255.0;
const LEAST_CONTRAST_GREY: f64 = 5.0;

/// What is being adjusted.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    pub homography: Homography,
    /// uu, uv, vv.
    pub blur_px2: [f64; 3],
    /// Of black, then of white: six coefficients each, of 1, u, v, u², uv, v².
    pub levels: [f64; N_LEVELS],
}

impl State {
    /// White minus black at the marker's centre.
    pub(super) fn contrast(&self) -> f64 {
        self.levels[N_LIGHT] - self.levels[0]
    }

    /// Whether that is enough to tell black from white.
    pub(super) fn has_contrast(&self) -> bool {
        self.contrast() > LEAST_CONTRAST_GREY
    }

    /// Standard deviations along the long and the short axis.
    pub(super) fn blur_axes(&self) -> [f64; 2] {
        let [uu, uv, vv] = self.blur_px2;
        let (mean, half) = (0.5 * (uu + vv), (0.5 * (uu - vv)).hypot(uv));
        [(mean + half).max(0.0).sqrt(), (mean - half).max(0.0).sqrt()]
    }
}

/// What light may be made of at a place from the centre.
#[inline(always)]
pub(super) fn light_at<T: Copy + Mul<Output = T>>(one: T, [u, v]: [T; 2]) -> [T; N_LIGHT] {
    [one, u, v, u * u, u * v, v * v]
}

/// A state in the precision of pixels.
#[derive(Clone, Copy)]
pub(super) struct View {
    h: [f32; 8],
    ray_from_pixel: [[f32; 2]; 2],
    blur: [f32; 3],
    black: [f32; N_LIGHT],
    contrast: [f32; N_LIGHT],
}

impl View {
    pub(super) fn new(state: &State, ray_from_pixel: [[f64; 2]; 2]) -> Self {
        let (black, white) = state.levels.split_at(N_LIGHT);
        Self {
            h: state.homography.map(|value| value as f32),
            ray_from_pixel: ray_from_pixel.map(|row| row.map(|value| value as f32)),
            blur: state.blur_px2.map(|value| value as f32),
            black: std::array::from_fn(|i| black[i] as f32),
            contrast: std::array::from_fn(|i| (white[i] - black[i]) as f32),
        }
    }

    /// Black there, and by how much white is lighter.
    #[inline(always)]
    pub(super) fn levels(&self, light: &[Lanes; N_LIGHT]) -> (Lanes, Lanes) {
        let mut sums = (Lanes::ZERO, Lanes::ZERO);
        for (light, (&black, &contrast)) in light.iter().zip(self.black.iter().zip(&self.contrast)) {
            sums.0 += *light * black;
            sums.1 += *light * contrast;
        }
        sums
    }
}

/// Where pixels lie on the marker, and how the blur looks from there.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub s: Lanes,
    pub t: Lanes,
    inverse_w: Lanes,
    s_u: Lanes,
    s_v: Lanes,
    t_u: Lanes,
    t_v: Lanes,
    /// 1/σ.
    pub per_s: Lanes,
    pub per_t: Lanes,
    rho: Lanes,
}

impl Place {
    #[inline(always)]
    pub(super) fn of(view: &View, x: Lanes, y: Lanes) -> Self {
        let h = &view.h;
        let inverse_w = Lanes::splat(1.0) / (x * h[6] + y * h[7] + 1.0);
        let s = (x * h[0] + y * h[1] + h[2]) * inverse_w;
        let t = (x * h[3] + y * h[4] + h[5]) * inverse_w;
        // d(s, t)/d(u, v), with the camera's part taken as constant over the marker: it is for the blur only.
        let (s_x, s_y) = ((s * -h[6] + h[0]) * inverse_w, (s * -h[7] + h[1]) * inverse_w);
        let (t_x, t_y) = ((t * -h[6] + h[3]) * inverse_w, (t * -h[7] + h[4]) * inverse_w);
        let [[x_u, x_v], [y_u, y_v]] = view.ray_from_pixel;
        let (s_u, s_v) = (s_x * x_u + s_y * y_u, s_x * x_v + s_y * y_v);
        let (t_u, t_v) = (t_x * x_u + t_y * y_u, t_x * x_v + t_y * y_v);
        let [uu, uv, vv] = view.blur;
        let (per_s, per_t) = (per_blur(view, s_u, s_v), per_blur(view, t_u, t_v));
        let rho = (s_u * t_u * uu + (s_u * t_v + s_v * t_u) * uv + s_v * t_v * vv) * per_s * per_t;
        Self { s, t, inverse_w, s_u, s_v, t_u, t_v, per_s, per_t, rho }
    }
}

/// 1/σ of the blur along a coordinate, of which these are the derivatives.
#[inline(always)]
fn per_blur(view: &View, by_u: Lanes, by_v: Lanes) -> Lanes {
    let [uu, uv, vv] = view.blur;
    Lanes::splat(1.0) / (by_u * by_u * uu + by_u * by_v * (2.0 * uv) + by_v * by_v * vv).sqrt()
}

/// Pixels near edges, tied to their nearest `L` grid lines each way, with what stays the same from step to step.
///
/// The cell left of and above all lines is `base`; crossing line i in s adds `step_s[i]`, line j in t adds `step_t[j]`,
/// both `vertex[i][j]` besides.
#[derive(Clone, Copy)]
pub(super) struct Block<const L: usize> {
    pub light: [Lanes; N_LIGHT],
    pub x: Lanes,
    pub y: Lanes,
    pub grey: Lanes,
    pub line_s: [Lanes; L],
    pub line_t: [Lanes; L],
    pub base: Lanes,
    pub step_s: [Lanes; L],
    pub step_t: [Lanes; L],
    pub vertex: [[Lanes; L]; L],
    /// 1 for pixels that count, else 0.
    pub kept: Lanes,
}

impl<const L: usize> Block<L> {
    pub(super) const EMPTY: Self = Self {
        light: [Lanes::ZERO; N_LIGHT],
        x: Lanes::ZERO,
        y: Lanes::ZERO,
        grey: Lanes::ZERO,
        line_s: [Lanes::ZERO; L],
        line_t: [Lanes::ZERO; L],
        base: Lanes::ZERO,
        step_s: [Lanes::ZERO; L],
        step_t: [Lanes::ZERO; L],
        vertex: [[Lanes::ZERO; L]; L],
        kept: Lanes::ZERO,
    };
}

/// Of each pixel of a block.
pub(super) struct Evaluated {
    /// Measured minus model.
    pub residual: Lanes,
    /// The model's derivatives by homography, blur and levels.
    pub columns: [Lanes; N_UNKNOWNS],
}

/// Evaluates a block; `kept` are the weights of its pixels.
#[inline(always)]
pub(super) fn evaluate<const L: usize>(view: &View, block: &Block<L>, kept: Lanes) -> Evaluated {
    let at = Place::of(view, block.x, block.y);
    let mut s = [(Lanes::ZERO, Lanes::ZERO, Lanes::ZERO); L];
    let mut t = s;
    for i in 0..L {
        s[i] = distribution((at.s - block.line_s[i]) * at.per_s);
        t[i] = distribution((at.t - block.line_t[i]) * at.per_t);
    }
    let (mut p, mut mixed, mut curved) = (block.base, Lanes::ZERO, Lanes::ZERO);
    let (mut p_s, mut p_t, mut p_ss, mut p_tt) = (Lanes::ZERO, Lanes::ZERO, Lanes::ZERO, Lanes::ZERO);
    let (mut mixed_s, mut mixed_t) = (Lanes::ZERO, Lanes::ZERO);
    for i in 0..L {
        let (cdf_s, pdf_s, slope_s) = s[i];
        let (cdf_t, pdf_t, slope_t) = t[i];
        let (mut across, mut along) = (block.step_s[i], block.step_t[i]);
        for j in 0..L {
            let d = block.vertex[i][j];
            across += d * t[j].0;
            along += block.vertex[j][i] * s[j].0;
            mixed += d * pdf_s * t[j].1;
            curved += d * slope_s * t[j].2;
            mixed_s += d * slope_s * t[j].1;
            mixed_t += d * pdf_s * t[j].2;
        }
        p += block.step_t[i] * cdf_t + across * cdf_s;
        p_s += across * pdf_s;
        p_t += along * pdf_t;
        p_ss += across * slope_s;
        p_tt += along * slope_t;
    }
    let rho = at.rho;
    p += rho * (mixed + rho * curved * 0.5);
    let p_s = (p_s + rho * mixed_s) * at.per_s;
    let p_t = (p_t + rho * mixed_t) * at.per_t;

    let (black, contrast) = view.levels(&block.light);
    let model = black + contrast * p;
    // A saturated pixel says only that there was at least so much light.
    let weight = Lanes::from_fn(|i| {
        // Not `&&`: lanes have no branches.
        let says_nothing = (block.grey.0[i] >= SATURATED_GREY) & (model.0[i] >= SATURATED_GREY);
        if says_nothing { 0.0 } else { kept.0[i] }
    });
    let residual = (block.grey - model) * weight;

    let mut columns = [Lanes::ZERO; N_UNKNOWNS];
    let scaled = contrast * weight;
    let (by_s, by_t) = (scaled * p_s * at.inverse_w, scaled * p_t * at.inverse_w);
    let by_w = Lanes::ZERO - (by_s * at.s + by_t * at.t);
    for (first, by) in [(0, by_s), (3, by_t)] {
        columns[first] = by * block.x;
        columns[first + 1] = by * block.y;
        columns[first + 2] = by;
    }
    columns[6] = by_w * block.x;
    columns[7] = by_w * block.y;
    let half_ss = scaled * p_ss * at.per_s * at.per_s * 0.5;
    let half_tt = scaled * p_tt * at.per_t * at.per_t * 0.5;
    let cross = scaled * mixed * at.per_s * at.per_t;
    columns[8] = half_ss * at.s_u * at.s_u + half_tt * at.t_u * at.t_u + cross * at.s_u * at.t_u;
    columns[9] = (half_ss * at.s_u * at.s_v + half_tt * at.t_u * at.t_v) * 2.0
        + cross * (at.s_u * at.t_v + at.s_v * at.t_u);
    columns[10] = half_ss * at.s_v * at.s_v + half_tt * at.t_v * at.t_v + cross * at.s_v * at.t_v;
    let white = weight * p;
    for (i, &light) in block.light.iter().enumerate() {
        columns[FIRST_LEVEL + i] = light * (weight - white);
        columns[FIRST_LEVEL + N_LIGHT + i] = light * white;
    }
    Evaluated { residual, columns }
}

/// Φ, φ and φ′.
#[inline(always)]
fn distribution(z: Lanes) -> (Lanes, Lanes, Lanes) {
    let (cdf, pdf) = z.normal_distribution();
    (cdf, pdf, Lanes::ZERO - z * pdf)
}
