//! One marker in one picture: the pixels around it and their rays, scaled to about ±1.

use std::f64::consts::PI;

use super::error::MarkerError;
use super::homography::{self, Homography};
use super::lens::Lens;
use super::model::{N_LEVELS, State};
use crate::arithmetic::in_wide_registers;

/// How far beyond the marker pixels are used, modules.
pub(super) const QUIET_MODULES: f64 = 0.5;
/// White all round, modules: every look-up near the border has its neighbours.
pub(super) const PAD: usize = 4;
/// Of a whole number: 1/√12.
pub(super) const ROUNDING_GREY: f64 = 0.289;
const SMALLEST_MODULE_PX: f64 = 3.0;
/// A side of so many times the picture's width and height is no marker of this picture.
const MOST_PICTURES: f64 = 4.0;
const COARSE_BLUR_PX: f64 = 1.5;
/// Median of differences of two normal numbers to their standard deviation.
pub(super) const PER_MEDIAN: f64 = 1.4826;
/// Rays are exact at so many Chebyshev nodes each way, and interpolated between (to 10⁻⁸ px).
const NODES: usize = 8;

/// A grey picture, row by row.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// Its pixels.
    pub grey: &'a [u8],
    /// Pixels of a row.
    pub width: usize,
}

pub(super) struct Scene<'a> {
    picture: Picture<'a>,
    pub lens: Lens,
    pub n_modules: usize,
    pub module_px: f64,
    /// 0 black, 1 white, [`PAD`] modules of white all round.
    pub pattern: Vec<f32>,
    pub left: usize,
    pub top: usize,
    pub width: usize,
    pub height: usize,
    /// Standard deviation of the noise, from neighbours: most differ by noise alone, whatever the picture shows.
    pub noise_grey: f64,
    /// Scaled rays of the window's pixels, row by row.
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    ray_centre: [f64; 2],
    pub ray_scale: f64,
    pub half_px: f64,
    /// How far columns, then rows of the window are from the marker's centre, in halves of its side.
    off_centre: [Vec<f32>; 2],
    /// How far from the centre pixels are used, in halves of the marker's side.
    pub reach: f64,
    /// d(scaled ray)/d(u, v) at the centre: for the blur only, which needs no better.
    pub ray_from_pixel: [[f64; 2]; 2],
    pub marker_corners: [[f64; 2]; 4],
    first_rays: [[f64; 2]; 4],
}

impl<'a> Scene<'a> {
    pub(super) fn new(
        picture: Picture<'a>,
        lens: Lens,
        pattern: &[bool],
        corners_px: [[f64; 2]; 4],
    ) -> Result<Self, MarkerError> {
        let n_modules = pattern.len().isqrt();
        if n_modules * n_modules != pattern.len() || n_modules == 0 {
            return Err(MarkerError::Length {
                what: "the pattern",
                found: pattern.len(),
                expected: (n_modules + 1).pow(2),
            });
        }
        let height = picture.grey.len() / picture.width.max(1);
        if picture.width == 0 || height * picture.width != picture.grey.len() {
            let expected = (height + 1) * picture.width;
            return Err(MarkerError::Length { what: "the picture", found: picture.grey.len(), expected });
        }
        let module_px = mean_side(&corners_px) / n_modules as f64;
        if !(module_px >= SMALLEST_MODULE_PX && module_px.is_finite()) {
            return Err(MarkerError::TooSmall { module_px });
        }
        if module_px * n_modules as f64 > MOST_PICTURES * (picture.width + height) as f64 {
            return Err(MarkerError::Outside);
        }
        let margin = QUIET_MODULES * module_px * 1.5 + 2.0;
        let [across, down] = [(0, picture.width), (1, height)].map(|(c, size)| {
            let all = corners_px.map(|corner| corner[c]);
            let low = (all.iter().copied().fold(f64::INFINITY, f64::min) - margin).floor().max(0.0);
            let high = (all.iter().copied().fold(f64::NEG_INFINITY, f64::max) + margin).ceil() + 1.0;
            low as usize..(high.max(0.0) as usize).min(size)
        });
        if across.len() < 2 || down.is_empty() {
            return Err(MarkerError::Outside);
        }
        let mut rays = [[0.0; 2]; 4];
        for (ray, &corner) in rays.iter_mut().zip(&corners_px) {
            *ray = lens.ray(corner).ok_or(MarkerError::NoInverse)?;
        }
        let mean =
            |points: &[[f64; 2]; 4]| [0, 1].map(|c| points.iter().map(|point| point[c]).sum::<f64>() / 4.0);
        let (ray_centre, centre_px) = (mean(&rays), mean(&corners_px));
        let off = rays.map(|ray| [ray[0] - ray_centre[0], ray[1] - ray_centre[1]]);
        let ray_scale = off.iter().flatten().fold(0.0, |most: f64, value| most.max(value.abs()));
        let (_, by_ray) = lens.bent(ray_centre);
        let n = n_modules as f64;
        let mut scene = Self {
            picture,
            lens,
            n_modules,
            module_px,
            pattern: padded(pattern, n_modules),
            left: across.start,
            top: down.start,
            width: across.len(),
            height: down.len(),
            noise_grey: 0.0,
            x: Vec::new(),
            y: Vec::new(),
            ray_centre,
            ray_scale,
            half_px: 0.5 * module_px * n,
            off_centre: [(across, centre_px[0]), (down, centre_px[1])].map(|(pixels, centre)| {
                pixels.map(|pixel| ((pixel as f64 - centre) * 2.0 / (module_px * n)) as f32).collect()
            }),
            reach: reach(&corners_px, centre_px) * (1.0 + 2.0 * QUIET_MODULES / n) * 2.0 / (module_px * n),
            ray_from_pixel: inverse_2x2(
                [0, 1].map(|r| by_ray[r].map(|value| value * lens.focal_px[r] * ray_scale)),
            ),
            marker_corners: [[0.0, 0.0], [n, 0.0], [n, n], [0.0, n]],
            first_rays: off.map(|ray| ray.map(|value| value / ray_scale)),
        };
        scene.noise_grey = scene.noise_of_neighbours();
        scene.set_rays()?;
        Ok(scene)
    }

    /// A row of the window.
    pub(super) fn row(&self, row: usize) -> &[u8] {
        let first = (self.top + row) * self.picture.width + self.left;
        &self.picture.grey[first..first + self.width]
    }

    /// Where a pixel of the window is from the marker's centre, in halves of its side.
    #[inline(always)]
    pub(super) fn off_centre(&self, row: usize, column: usize) -> [f32; 2] {
        [self.off_centre[0][column], self.off_centre[1][row]]
    }

    /// The median of the differences of neighbours in a row, as a standard deviation.
    fn noise_of_neighbours(&self) -> f64 {
        let mut count = [0_usize; 256];
        for row in 0..self.height {
            for two in self.row(row).windows(2) {
                count[usize::from(two[0].abs_diff(two[1]))] += 1;
            }
        }
        let total: usize = count.iter().sum();
        let at = |rank: usize| {
            let mut before = 0;
            count.iter().position(|&own| {
                before += own;
                before > rank
            })
        };
        let [low, high] = [total.saturating_sub(1) / 2, total / 2].map(|rank| at(rank).unwrap_or(0) as f64);
        (PER_MEDIAN * 0.5 * (low + high) / 2.0_f64.sqrt()).max(ROUNDING_GREY)
    }

    fn set_rays(&mut self) -> Result<(), MarkerError> {
        let nodes: [f64; NODES] =
            std::array::from_fn(|i| ((2.0 * i as f64 + 1.0) * PI / (2.0 * NODES as f64)).cos());
        let [half_width, half_height] = [self.width, self.height].map(|size| 0.5 * (size.max(2) - 1) as f64);
        let mut at_nodes = [[[0.0; NODES]; NODES]; 2];
        for (row, &down) in nodes.iter().enumerate() {
            for (column, &across) in nodes.iter().enumerate() {
                let u = self.left as f64 + half_width * (1.0 + across);
                let v = self.top as f64 + half_height * (1.0 + down);
                let ray = self.lens.ray([u, v]).ok_or(MarkerError::NoInverse)?;
                for c in 0..2 {
                    at_nodes[c][row][column] = (ray[c] - self.ray_centre[c]) / self.ray_scale;
                }
            }
        }
        let (width, height) = (self.width, self.height);
        // By node, then column.
        let mut along = vec![0.0; NODES * width];
        for column in 0..width {
            for (node, weight) in lagrange(&nodes, column as f64 / half_width - 1.0).into_iter().enumerate() {
                along[node * width + column] = weight;
            }
        }
        let mut result = [(); 2].map(|()| vec![0.0_f32; width * height]);
        let mut sums = vec![0.0; width];
        in_wide_registers(
            #[inline(always)]
            || {
                for row in 0..height {
                    let down = lagrange(&nodes, row as f64 / half_height - 1.0);
                    for (values, of_nodes) in result.iter_mut().zip(&at_nodes) {
                        sums.fill(0.0);
                        for (node, along) in along.chunks_exact(width).enumerate() {
                            let across: f64 =
                                down.iter().zip(of_nodes).map(|(weight, own)| weight * own[node]).sum();
                            for (sum, weight) in sums.iter_mut().zip(along) {
                                *sum += across * weight;
                            }
                        }
                        for (value, &sum) in values[row * width..].iter_mut().zip(&sums) {
                            *value = sum as f32;
                        }
                    }
                }
            },
        );
        [self.x, self.y] = result;
        Ok(())
    }

    pub(super) fn starting_state(&self) -> Result<State, MarkerError> {
        let homography =
            homography::between(&self.first_rays, &self.marker_corners).ok_or(MarkerError::InOneLine)?;
        let variance = COARSE_BLUR_PX * COARSE_BLUR_PX;
        Ok(State { homography, blur_px2: [variance, 0.0, variance], levels: [0.0; N_LEVELS] })
    }

    /// Undistorted pixels of rays.
    fn pixels_of(&self, rays: [[f64; 2]; 4]) -> [[f64; 2]; 4] {
        rays.map(|ray| {
            self.lens.undistorted_pixel([0, 1].map(|c| ray[c] * self.ray_scale + self.ray_centre[c]))
        })
    }

    /// Undistorted pixels of the marker's corners.
    pub(super) fn corners_px(&self, h: &Homography) -> [[f64; 2]; 4] {
        self.pixels_of(homography::back(h, &self.marker_corners))
    }

    /// Refuses an answer that is not this marker.
    pub(super) fn check(&self, state: &State) -> Result<(), MarkerError> {
        if !state.homography.iter().all(|value| value.is_finite()) {
            return Err(MarkerError::Diverged);
        }
        let most = (0.5 * self.module_px).max(2.0);
        let px = largest_step(&self.corners_px(&state.homography), &self.pixels_of(self.first_rays));
        if !is_below(px, most) {
            return Err(MarkerError::Moved { px });
        }
        let [long_px, short_px] = state.blur_axes();
        if !is_below(long_px, most) {
            return Err(MarkerError::Blurred { long_px, short_px });
        }
        if !state.has_contrast() {
            return Err(MarkerError::NoContrast);
        }
        Ok(())
    }
}

/// Whether a number is below another; what is no number is not.
pub(super) fn is_below(value: f64, limit: f64) -> bool {
    value < limit
}

/// The largest difference of a coordinate; not a number where one is none.
pub(super) fn largest_step(one: &[[f64; 2]; 4], other: &[[f64; 2]; 4]) -> f64 {
    let apart = one.iter().flatten().zip(other.iter().flatten()).map(|(a, b)| (a - b).abs());
    apart.fold(0.0, |most: f64, value| if value.is_nan() || value > most { value } else { most })
}

/// How far corners are from a place, across or down.
fn reach(corners: &[[f64; 2]; 4], [u, v]: [f64; 2]) -> f64 {
    corners.iter().fold(0.0, |most: f64, corner| most.max((corner[0] - u).abs()).max((corner[1] - v).abs()))
}

fn mean_side(corners: &[[f64; 2]; 4]) -> f64 {
    (0..4)
        .map(|i| {
            let (one, other) = (corners[i], corners[(i + 3) % 4]);
            (one[0] - other[0]).hypot(one[1] - other[1])
        })
        .sum::<f64>()
        / 4.0
}

fn padded(pattern: &[bool], n: usize) -> Vec<f32> {
    let width = n + 2 * PAD;
    let mut result = vec![1.0; width * width];
    for (row, cells) in pattern.chunks_exact(n).enumerate() {
        for (column, &is_white) in cells.iter().enumerate() {
            result[(row + PAD) * width + column + PAD] = if is_white { 1.0 } else { 0.0 };
        }
    }
    result
}

fn inverse_2x2([[a, b], [c, d]]: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let determinant = a * d - b * c;
    [[d / determinant, -b / determinant], [-c / determinant, a / determinant]]
}

/// Weights of values at the nodes for one at another place.
fn lagrange(nodes: &[f64; NODES], at: f64) -> [f64; NODES] {
    std::array::from_fn(|i| {
        (0..NODES).filter(|&j| j != i).map(|j| (at - nodes[j]) / (nodes[i] - nodes[j])).product()
    })
}
