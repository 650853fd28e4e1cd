//! Corners of a printed square marker at the noise limit, by fitting its whole picture.
//!
//! A corner detector looks at a few pixels round each corner and is pulled inwards where a dark corner meets a light
//! background (0.16 px for a marker 130 px wide). Here every pixel near an edge takes part: the known pattern is mapped by
//! a homography, blurred by the camera, lit unevenly, and all of that is adjusted by Gauss–Newton until the differences are
//! noise. The scatter of what is left gives the covariance, and where it has a sign in common over whole parts of the plate
//! (a shadow's edge) also how far the corners move without each part (`uneven`).
//!
//! With (u, v) a pixel, (x, y) the straight ray that it sees, and (s, t) the place on the marker in modules:
//!
//! ```text
//! (s, t)  = H (x, y, 1)                                       plane seen without distortion: exact
//! picture = B(u, v) + [W(u, v) − B(u, v)] · P(s, t)           B, W: quadratic, for light that falls unevenly
//! P       = 1 + Σ_ij Δ_ij Φ₂((s − i)/σ_s, (t − j)/σ_t; ρ)     blurred pattern, 0 black, 1 white
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | `Δ_ij` | mixed second difference of the pattern at grid vertex (i, j) | – |
//! | Φ₂(a, b; ρ) | bivariate normal distribution, ΦΦ + ρφφ + ½ρ²abφφ + … (tetrachoric series) | – |
//! | `σ_s, σ_t, ρ` | the blur's 2×2 covariance (px²), carried to the marker through d(s, t)/d(u, v) | module |
//!
//! The blur is Gaussian with three free parameters, so defocus, a lens that draws differently along and across, and a
//! marker in slow motion are all in it; the pixel's own square is covered by its variance. A derivative by a blur parameter
//! is a second derivative by place (the heat equation). Saturated pixels only say "at least 255".
//!
//! Only pixels within half a module of the marker are used: a printed quiet zone of one module is enough. Pixels are in
//! single precision, whose rounding is 10⁻⁵ of a grey level and of a pixel; sums over many of them in double.
//!
//! Verified in the Python package against supersampled renderings: mean error over sub-pixel phases below 0.005 px, and
//! scatter over noise draws as the covariance says; derivatives against differences here.

mod adjust;
mod error;
mod flat;
mod grid;
mod homography;
mod lanes;
mod lens;
mod model;
mod pixels;
mod products;
mod result;
mod scene;
mod uneven;

#[cfg(test)]
mod tests;

pub use error::MarkerError;
pub use lens::Lens;
pub use result::MarkerFit;
pub use scene::Picture;

use adjust::{Adjusted, Steps, adjust, without_outliers};
use scene::Scene;

/// With more pixels than this, pixels are thinned: the time stays bounded, the corner is known well enough.
const MOST_EDGE_PIXELS: usize = 20_000;
const MOST_COARSE_PIXELS: usize = 2_500;
/// Of a marker that is wider, only every so many-th pixel is looked at first.
const COARSE_HALF_PX: f64 = 40.0;
const COARSE: Steps = Steps { most: 8, converged_px: 0.05 };
const COARSE_WITH_BLUR: Steps = Steps { most: 4, converged_px: 0.05 };
/// Steps shrink at least tenfold each time near the end: what is left after one of this size is nothing.
const FINE: Steps = Steps { most: 25, converged_px: 2e-4 };
const OUTLIER_ROUNDS: usize = 4;

/// Fits the whole picture of one marker.
///
/// `pattern` (n × n, row by row) is the whole marker, black border included, true for white. `corners_px` are distorted
/// pixels, within about a fifth of a module; clockwise from the marker's own top left.
///
/// # Errors
/// [`MarkerError`] where the fit does not converge, or to something that is not this marker.
pub fn fit_marker(
    picture: Picture<'_>,
    lens: &Lens,
    pattern: &[bool],
    corners_px: [[f64; 2]; 4],
) -> Result<MarkerFit, MarkerError> {
    let scene = Scene::new(picture, *lens, pattern, corners_px)?;
    let state = scene.starting_state()?;
    // First few pixels and a blur that is held wide, which pulls from further away; then everything free.
    let stride = 1 + (scene.half_px / COARSE_HALF_PX) as usize;
    let coarse = scene.select(&state, MOST_COARSE_PIXELS, stride);
    let state = adjust(&scene, &coarse, state, false, COARSE)?.state;
    scene.check(&state)?;
    let mut state = adjust(&scene, &coarse, state, true, COARSE_WITH_BLUR)?.state;
    scene.check(&state)?;
    let mut fine = scene.select(&state, MOST_EDGE_PIXELS, 1);
    let mut rounds = 0;
    loop {
        let Adjusted { state: found, converged } = adjust(&scene, &fine, state, true, FINE)?;
        rounds += 1;
        let is_clean = without_outliers(&scene, &mut fine, &found)?;
        if is_clean || rounds == OUTLIER_ROUNDS {
            if !converged {
                return Err(MarkerError::NotConverged);
            }
            scene.check(&found)?;
            return result::result(&scene, &fine, &found);
        }
        state = found;
    }
}
