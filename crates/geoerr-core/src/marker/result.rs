//! Corners, and their covariance from the scatter of what is left.

use nalgebra::{DMatrix, SMatrix};

use super::error::MarkerError;
use super::homography::{back, points_by_homography};
use super::lanes::WIDTH;
use super::model::{FIRST_LEVEL, N_LEVELS, N_UNKNOWNS, State};
use super::pixels::Pixels;
use super::products::Products;
use super::scene::{ROUNDING_GREY, Scene, is_below};
use super::uneven::{Gram, Parts, place_of};

/// A pixel at which the model changes with the corners by more than this share of the most is at an edge.
const STEEP: f32 = 0.05;
/// So many pixels for each unknown, or there is no covariance.
const LEAST_PIXELS: usize = 10;
/// Where uneven light may move a corner by more than this, one that is looked for by itself is no worse.
const MOST_MOVED_PX: f64 = 0.3;

/// Four corners of one marker in one picture.
#[derive(Clone, Debug)]
pub struct MarkerFit {
    /// Undistorted pixels, clockwise from the marker's own top left corner.
    pub corners_px: [[f64; 2]; 4],
    /// Covariance of u₀, v₀, u₁, ..., row by row, px².
    pub covariance_px2: [[f64; 8]; 8],
    /// Standard deviation of what the model leaves.
    pub noise_grey: f64,
    /// White minus black at the marker's centre.
    pub contrast_grey: f64,
    /// Standard deviations of the blur along its long and short axis, the pixel's own square included.
    pub blur_px: [f64; 2],
    /// Residual near edges over residual in flat areas: 1 where the model is right.
    pub misfit: f64,
    /// By how much uneven light enlarges the standard deviations: 1 where nothing speaks of any.
    pub unevenness: f64,
}

pub(super) fn result(scene: &Scene<'_>, pixels: &Pixels, state: &State) -> Result<MarkerFit, MarkerError> {
    let used = pixels.kept().iter().filter(|&&kept| kept).count();
    if used < LEAST_PIXELS * N_UNKNOWNS {
        return Err(MarkerError::TooFew);
    }
    let last = LastLook::new(scene, pixels, state);
    let covariance = covariance(&last, pixels, used).ok_or(MarkerError::Undetermined)?;
    let rays = back(&state.homography, &scene.marker_corners);
    let mut by_homography =
        points_by_homography(&state.homography, &rays).ok_or(MarkerError::Undetermined)?;
    for row in 0..8 {
        by_homography.row_mut(row).scale_mut(scene.ray_scale * scene.lens.focal_px[row % 2]);
    }
    let of_homography = SMatrix::<f64, 8, 8>::from_fn(|i, j| covariance[(i, j)]);
    let of_pixels = by_homography * of_homography * by_homography.transpose();
    let of_corners = if last.parts.are_uneven() {
        let moves = last.parts.moves(scene, pixels, state, &last.information, &last.flat);
        let of_light = by_homography * moves.ok_or(MarkerError::Undetermined)? * by_homography.transpose();
        let px = of_light.diagonal().max().sqrt();
        if !is_below(px, MOST_MOVED_PX) {
            return Err(MarkerError::Uneven { px });
        }
        of_pixels + of_light
    } else {
        of_pixels
    };
    let scatter = Scatter::of(&last);
    Ok(MarkerFit {
        corners_px: scene.corners_px(&state.homography),
        covariance_px2: std::array::from_fn(|i| std::array::from_fn(|j| of_corners[(i, j)])),
        noise_grey: scatter.all,
        contrast_grey: state.contrast(),
        blur_px: state.blur_axes(),
        misfit: scatter.steep / scatter.level.max(ROUNDING_GREY),
        unevenness: (of_corners.trace() / of_pixels.trace()).sqrt(),
    })
}

/// Everything at the state that was found.
struct LastLook {
    /// `Σ c cᵀ`.
    information: Gram,
    /// The same of pixels near edges, each with its squared residual as its weight.
    by_residual: Gram,
    /// How steep the picture is (squared), and what is left, of pixels near edges that count.
    edge: Vec<(f32, f32)>,
    /// What is left of black pixels and of white ones.
    flat: [Vec<f32>; 2],
    parts: Parts,
}

impl LastLook {
    fn new(scene: &Scene<'_>, pixels: &Pixels, state: &State) -> Self {
        let (mut information, mut by_residual) = (Products::new(), Products::new());
        let mut edge: Vec<(f32, f32)> = Vec::with_capacity(pixels.n_edge);
        let mut parts = Parts::new(scene);
        pixels.each(
            state,
            scene,
            false,
            #[inline(always)]
            |kept, own| {
                information.add(&own.columns);
                by_residual.add(&own.columns.map(|column| column * own.residual));
                let slope = own.columns[2] * own.columns[2] + own.columns[5] * own.columns[5];
                for lane in 0..WIDTH {
                    if kept.0[lane] > 0.0 {
                        edge.push((slope.0[lane], own.residual.0[lane]));
                        parts.add(place_of(own, lane), own.residual.0[lane]);
                    }
                }
            },
        );
        let flat = pixels.flat.residuals(&state.levels);
        parts.add_flat(&pixels.flat, &flat);
        let mut information = information.finished();
        for (row, of_flat) in information[FIRST_LEVEL..].iter_mut().zip(&pixels.flat.gram) {
            row[FIRST_LEVEL..].iter_mut().zip(of_flat).for_each(|(sum, value)| *sum += value);
        }
        Self { information, by_residual: by_residual.finished(), edge, flat, parts }
    }
}

/// Each pixel with its own squared residual (White's covariance): bright pixels are noisier than dark ones.
fn covariance(last: &LastLook, pixels: &Pixels, used: usize) -> Option<DMatrix<f64>> {
    let mut middle = last.by_residual;
    let of_flat = pixels.flat.weighted_gram(&last.flat);
    for i in 0..N_LEVELS {
        for j in 0..N_LEVELS {
            middle[FIRST_LEVEL + i][FIRST_LEVEL + j] += of_flat[i][j];
        }
    }
    let whole =
        |of: &[[f64; N_UNKNOWNS]; N_UNKNOWNS]| DMatrix::from_fn(N_UNKNOWNS, N_UNKNOWNS, |i, j| of[i][j]);
    let inverse = whole(&last.information).try_inverse()?;
    let share = used as f64 / (used - N_UNKNOWNS) as f64;
    Some(&inverse * whole(&middle) * &inverse * share)
}

/// Root mean squares of what is left.
struct Scatter {
    all: f64,
    /// At edges.
    steep: f64,
    /// Elsewhere.
    level: f64,
}

impl Scatter {
    fn of(last: &LastLook) -> Self {
        let steep = STEEP * STEEP * last.edge.iter().fold(0.0_f32, |most, one| most.max(one.0));
        let [mut at_edges, mut elsewhere] = [Squares::default(); 2];
        for &(slope, left) in &last.edge {
            if slope > steep { at_edges.add(left) } else { elsewhere.add(left) }
        }
        last.flat.iter().flatten().for_each(|&left| elsewhere.add(left));
        let all = Squares { sum: at_edges.sum + elsewhere.sum, count: at_edges.count + elsewhere.count };
        Self { all: all.rms(), steep: at_edges.rms(), level: elsewhere.rms() }
    }
}

#[derive(Clone, Copy, Default)]
struct Squares {
    sum: f64,
    count: usize,
}

impl Squares {
    fn add(&mut self, value: f32) {
        self.sum += f64::from(value).powi(2);
        self.count += 1;
    }

    /// Root mean square; 0 of nothing.
    fn rms(&self) -> f64 {
        (self.sum / self.count.max(1) as f64).sqrt()
    }
}
