//! Gauss–Newton over everything that is adjusted.

use super::error::MarkerError;
use super::flat::Flat;
use super::homography::solved;
use super::lanes::{Lanes, WIDTH};
use super::model::{FIRST_BLUR, FIRST_LEVEL, N_LEVELS, N_UNKNOWNS, State};
use super::pixels::Pixels;
use super::products::Products;
use super::scene::{PER_MEDIAN, Scene, is_below, largest_step};

const LEAST_BLUR_PX2: f64 = 0.04;
/// A pixel that is this far off shows dirt, a scratch or a reflection, not the marker.
const OUTLIER_SIGMAS: f64 = 6.0;
const OUTLIER_CONTRAST: f64 = 0.08;
/// More pixels than this that are wrong by so much of the contrast: it is something else.
const WRONG_CONTRAST: f64 = 0.3;
const MOST_WRONG: f64 = 0.1;
/// Everything that is adjusted, and the residual.
const N_ALL: usize = N_UNKNOWNS + 1;

/// How many steps at most, and the movement of corners that ends them.
#[derive(Clone, Copy)]
pub(super) struct Steps {
    pub most: usize,
    pub converged_px: f64,
}

pub(super) struct Adjusted {
    pub state: State,
    pub converged: bool,
}

/// Adjusts until no corner moves by more than a tolerance.
pub(super) fn adjust(
    scene: &Scene<'_>,
    pixels: &Pixels,
    state: State,
    free_blur: bool,
    steps: Steps,
) -> Result<Adjusted, MarkerError> {
    let mut state = if state.levels.iter().all(|&level| level == 0.0) {
        with_levels(scene, pixels, state)?
    } else {
        state
    };
    let free: Vec<usize> =
        (0..N_UNKNOWNS).filter(|i| free_blur || !(FIRST_BLUR..FIRST_LEVEL).contains(i)).collect();
    let mut corners = scene.corners_px(&state.homography);
    for _ in 0..steps.most {
        let Normal { gram, right } = Normal::of(scene, pixels, &state);
        let of_free: Vec<f64> = free.iter().flat_map(|&i| free.iter().map(move |&j| gram[i][j])).collect();
        let right: Vec<f64> = free.iter().map(|&i| right[i]).collect();
        let step = solved(&of_free, &right).ok_or(MarkerError::Undetermined)?;
        let mut whole = [0.0; N_UNKNOWNS];
        free.iter().zip(step).for_each(|(&i, value)| whole[i] = value);
        state = stepped(&state, &whole);
        let moved = scene.corners_px(&state.homography);
        let movement = largest_step(&moved, &corners);
        corners = moved;
        if !is_below(movement, scene.module_px * scene.n_modules as f64) {
            return Err(MarkerError::Diverged);
        }
        if movement < steps.converged_px {
            return Ok(Adjusted { state, converged: true });
        }
    }
    Ok(Adjusted { state, converged: false })
}

fn stepped(state: &State, step: &[f64; N_UNKNOWNS]) -> State {
    let mut next = *state;
    next.homography.iter_mut().zip(step).for_each(|(value, step)| *value += step);
    // Not more than halved or doubled at once, never below half of a pixel's own square, always a covariance.
    for i in [0, 2] {
        let (own, step) = (state.blur_px2[i], step[FIRST_BLUR + i]);
        next.blur_px2[i] = (own + step).max(0.5 * own).max(LEAST_BLUR_PX2).min(2.0 * own);
    }
    let limit = 0.8 * (next.blur_px2[0] * next.blur_px2[2]).sqrt();
    next.blur_px2[1] = (state.blur_px2[1] + step[FIRST_BLUR + 1]).max(-limit).min(limit);
    next.levels.iter_mut().zip(&step[FIRST_LEVEL..]).for_each(|(value, step)| *value += step);
    next
}

/// Levels by linear least squares for the homography as it stands.
fn with_levels(scene: &Scene<'_>, pixels: &Pixels, state: State) -> Result<State, MarkerError> {
    // Where all levels are 0 what is left is the picture itself, but nothing changes with the corners.
    let Normal { gram, right } = Normal::of(scene, pixels, &state);
    let of_levels: Vec<f64> =
        gram[FIRST_LEVEL..].iter().flat_map(|row| row[FIRST_LEVEL..].to_vec()).collect();
    let levels = solved(&of_levels, &right[FIRST_LEVEL..]).ok_or(MarkerError::NoBlackAndWhite)?;
    let mut state = state;
    state.levels.copy_from_slice(&levels);
    if state.has_contrast() { Ok(state) } else { Err(MarkerError::NoContrast) }
}

/// Normal equations of a step.
struct Normal {
    gram: [[f64; N_UNKNOWNS]; N_UNKNOWNS],
    right: [f64; N_UNKNOWNS],
}

impl Normal {
    fn of(scene: &Scene<'_>, pixels: &Pixels, state: &State) -> Self {
        let mut products = Products::new();
        pixels.each(
            state,
            scene,
            false,
            #[inline(always)]
            |_, own| {
                let mut all = [Lanes::ZERO; N_ALL];
                all[..N_UNKNOWNS].copy_from_slice(&own.columns);
                all[N_UNKNOWNS] = own.residual;
                products.add(&all);
            },
        );
        let sums = products.finished();
        let mut normal = Self {
            gram: std::array::from_fn(|i| std::array::from_fn(|j| sums[i][j])),
            right: std::array::from_fn(|i| sums[i][N_UNKNOWNS]),
        };
        normal.add_flat(&pixels.flat, &state.levels);
        normal
    }

    fn add_flat(&mut self, flat: &Flat, levels: &[f64; N_LEVELS]) {
        for (i, own) in flat.gram.iter().enumerate() {
            self.right[FIRST_LEVEL + i] +=
                flat.right[i] - own.iter().zip(levels).map(|(a, b)| a * b).sum::<f64>();
            for (sum, value) in self.gram[FIRST_LEVEL + i][FIRST_LEVEL..].iter_mut().zip(own) {
                *sum += value;
            }
        }
    }
}

/// What the model leaves of every pixel near an edge, whether it counts or not.
pub(super) fn residuals_of_all(scene: &Scene<'_>, pixels: &Pixels, state: &State) -> Vec<f32> {
    let mut residuals = Vec::with_capacity(pixels.n_edge + WIDTH);
    pixels.each(
        state,
        scene,
        true,
        #[inline(always)]
        |_, own| residuals.extend_from_slice(&own.residual.0),
    );
    residuals.truncate(pixels.n_edge);
    residuals
}

/// Takes pixels out that show something else than the marker, and tells whether there are no others than before.
pub(super) fn without_outliers(
    scene: &Scene<'_>,
    pixels: &mut Pixels,
    state: &State,
) -> Result<bool, MarkerError> {
    let contrast = state.contrast();
    let residual: Vec<f64> =
        residuals_of_all(scene, pixels, state).into_iter().map(|value| f64::from(value).abs()).collect();
    let of_flat = pixels.flat.residuals(&state.levels);
    let off_flat = || of_flat.iter().flatten().map(|&value| f64::from(value).abs());
    let n_wrong =
        residual.iter().copied().chain(off_flat()).filter(|&off| off > WRONG_CONTRAST * contrast).count();
    let wrong = n_wrong as f64 / (residual.len() + off_flat().count()).max(1) as f64;
    if wrong > MOST_WRONG {
        return Err(MarkerError::NotThisMarker { per_cent: 100.0 * wrong });
    }
    // A camera that sharpens its pictures is off near every edge, alike on both sides: that is not dirt.
    let usual = PER_MEDIAN * median(residual.clone());
    let limit = (OUTLIER_SIGMAS * scene.noise_grey.max(usual)).max(OUTLIER_CONTRAST * contrast);
    let kept: Vec<bool> = residual.iter().map(|&off| off < limit).collect();
    let is_flat_clean = off_flat().all(|off| off < limit);
    if is_flat_clean && kept == pixels.kept() {
        return Ok(true);
    }
    pixels.keep(&kept);
    if !is_flat_clean {
        let is_kept = |&value: &f32| f64::from(value).abs() < limit;
        pixels.flat = pixels.flat.kept(&of_flat.map(|own| own.iter().map(is_kept).collect()));
    }
    Ok(false)
}

/// The median; 0 of nothing.
fn median(mut values: Vec<f64>) -> f64 {
    let n = values.len();
    if n == 0 {
        return 0.0;
    }
    let (below, &mut upper, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    if n % 2 == 1 { upper } else { 0.5 * (upper + below.iter().copied().fold(f64::NEG_INFINITY, f64::max)) }
}
