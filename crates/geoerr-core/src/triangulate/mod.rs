//! Two-view least-squares triangulation of batches of points, with covariance and reprojection error.
//!
//! Each view of a point gives two rows of `A (4×3) · p = B (4)`:
//!
//! ```math
//! (u\,\mathbf m_3 - \mathbf m_1)\cdot\mathbf p = m_{14} - u\,m_{34},\qquad
//! (v\,\mathbf m_3 - \mathbf m_2)\cdot\mathbf p = m_{24} - v\,m_{34}
//! ```
//!
//! with `m₁ m₂ m₃` the rows of the view's projection matrix and the fourth column written `m_{i4}`. Their least squares
//! minimises an algebraic error, a pixel times a depth. Each *reweighting* divides the rows by the depth found before
//! and takes them at the reprojected pixel instead of the measured one; that is a Gauss–Newton step on the
//! Mahalanobis norm of the pixel residuals, so the fixed point is the maximum-likelihood point, not merely a better
//! weighted algebraic one.
//!
//! # Accuracy
//! The normal equations square the condition number of `A`. Every reweighting solves only for the *correction*,
//! from residuals of the rows themselves, so the squared condition multiplies a correction and not the point; with
//! no reweighting one such refinement is made with the rows unchanged. That is as good as QR and half its work:
//! the numbers are in `tests/triangulate.rs` (`error_is_that_of_qr`) against 50-digit references.
//!
//! # Source
//! Li et al. 2023, Eqs. 3–5; Eq. 3 prints `m²₂₂` in row 2 where `m¹₂₂` must stand, and Eq. 2 `M₁` for `M₂`.
//! Covariance: Gauss–Markov, `(Σ Jᵀ Σ_px⁻¹ J)⁻¹`, which is the Cramér–Rao bound for normal pixel noise.
//!
//! # Verified
//! `tests/triangulate.rs`: 50-digit references in quantiles beside nalgebra's QR and SVD, identities by property tests,
//! bitwise equality over thread counts. `tests/geometry/test_triangulate.py`: Monte-Carlo covariance, OpenCV.

mod batch;
mod double_double;
mod fast;
mod lanes;
mod pair;
mod point;
mod rig;

use rayon::prelude::*;

pub use self::rig::Rig;

use self::batch::{CHUNK, Workspace, solve_points};
use self::lanes::{Lanes, WIDTH};
use self::point::{Sight, Solution, solve};

/// Rays that meet at a smaller angle give no point: 10⁻⁶ rad is 0.002 px of an 8 mm lens, less than any detector
/// resolves, and at 10⁻⁸ the normal equations would have no correct digit left.
pub const MIN_RAY_ANGLE_RAD: f64 = 1e-6;

/// Points of one unit of parallel work; fixed, so that the result does not depend on the number of threads.
const BLOCK: usize = 2048;

/// Up to this many points the calling thread works alone: they take it a millisecond at most, and a second thread was
/// not seen to start its share within 0.4 ms on a machine with other work.
const PARALLEL_ABOVE: usize = 4 * BLOCK;

/// The same for points alone, which take a tenth of the time.
const POINTS_BLOCK: usize = 16_384;

/// As [`PARALLEL_ABOVE`]: 10⁵ points take less than a millisecond.
const POINTS_PARALLEL_ABOVE: usize = 8 * POINTS_BLOCK;

/// One of the two cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The first projection matrix.
    Left,
    /// The second projection matrix.
    Right,
}

impl std::fmt::Display for Side {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(match self {
            Self::Left => "left",
            Self::Right => "right",
        })
    }
}

/// Why a rig or a whole batch is refused. A bad row is not an error: it has a [`Status`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TriangulateError {
    /// A projection matrix holds NaN or infinity.
    #[error("the {side} projection matrix holds a number that is not finite")]
    ProjectionNotFinite {
        /// Which matrix.
        side: Side,
    },
    /// A projection matrix without a finite projection centre.
    #[error(
        "the {side} projection matrix has no finite projection centre: the relative determinant of its left 3x3 part is {relative_determinant:.1e}"
    )]
    ProjectionSingular {
        /// Which matrix.
        side: Side,
        /// `|det M| / (‖m₁‖‖m₂‖‖m₃‖)`.
        relative_determinant: f64,
    },
    /// Two cameras at one place see no depth.
    #[error("both projection matrices have the same projection centre (baseline {baseline_mm:.1e} mm)")]
    CentresCoincide {
        /// Distance of the centres.
        baseline_mm: f64,
    },
    /// Arrays whose lengths differ.
    #[error("{what} has {found} rows where the left pixels have {expected}")]
    LengthsDiffer {
        /// Which argument.
        what: &'static str,
        /// Its rows.
        found: usize,
        /// Rows of the left pixels.
        expected: usize,
    },
    /// A standard deviation that is not positive and finite.
    #[error("the pixel standard deviation {sigma_px} is not a positive number")]
    SigmaNotPositive {
        /// What was given.
        sigma_px: f64,
    },
}

/// Whether a row has a point, and if not, why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Status {
    /// A point.
    Ok = 0,
    /// A pixel or covariance that is not finite, or so large that the arithmetic overflows.
    NotFinite = 1,
    /// The rays meet at less than [`MIN_RAY_ANGLE_RAD`].
    RaysParallel = 2,
    /// The best point lies behind a camera (or in its plane).
    BehindCamera = 3,
    /// A pixel covariance that is not positive definite.
    BadCovariance = 4,
}

/// Noise of a view's pixels.
#[derive(Clone, Copy, Debug)]
pub enum PixelNoise<'a> {
    /// The same standard deviation for u and v of every point, px.
    Sigma(f64),
    /// A symmetric 2×2 covariance for each point, px².
    Covariances(&'a [[[f64; 2]; 2]]),
}

/// What one camera saw.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    /// Undistorted pixel coordinates.
    pub uv_px: &'a [[f64; 2]],
    /// Their noise.
    pub noise: PixelNoise<'a>,
}

/// Memory for points with their uncertainty, one row for each pair of pixels; see [`Triangulated`].
#[derive(Debug)]
pub struct Rows<'a> {
    /// Points in the frame of the projection matrices.
    pub points_mm: &'a mut [[f64; 3]],
    /// Covariance of each point.
    pub covariance_mm2: &'a mut [[[f64; 3]; 3]],
    /// Root mean square over the two views of the distance from measured to reprojected pixel.
    pub reprojection_px: &'a mut [f64],
    /// Why a row has no point.
    pub status: &'a mut [Status],
}

/// Points with their uncertainty; a row without a point is NaN and its `status` says why.
#[derive(Clone, Debug)]
pub struct Triangulated {
    /// Points in the frame of the projection matrices.
    pub points_mm: Vec<[f64; 3]>,
    /// Covariance of each point.
    pub covariance_mm2: Vec<[[f64; 3]; 3]>,
    /// Root mean square over the two views of the distance from measured to reprojected pixel.
    pub reprojection_px: Vec<f64>,
    /// Why a row has no point.
    pub status: Vec<Status>,
}

/// Triangulates a batch of points seen by two cameras.
///
/// `reweightings` = 0 solves Li's rows as they stand (pixel covariance applied); 1 or 2 minimise pixels.
/// The covariance is the one of the pixel minimum at the resulting point, with the noise as given.
///
/// No allocation per point; blocks of a fixed size run in parallel and are joined in order, so the result is bitwise
/// the same for any number of threads.
///
/// # Errors
/// [`TriangulateError::LengthsDiffer`] and [`TriangulateError::SigmaNotPositive`]; a bad row has a [`Status`] instead.
///
/// # Examples
/// ```
/// use geoerr_core::triangulate::{PixelNoise, Pixels, Rig, triangulate};
/// let left = [[2000.0, 0.0, 1000.0, 0.0], [0.0, 2000.0, 1000.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
/// let mut right = left;
/// right[0][3] = -2000.0 * 200.0; // 200 mm to the right
/// let rig = Rig::new(&left, &right)?;
/// let noise = PixelNoise::Sigma(0.05);
/// let seen_left = Pixels { uv_px: &[[1100.0, 1000.0]], noise };
/// let seen_right = Pixels { uv_px: &[[600.0, 1000.0]], noise };
/// let found = triangulate(&rig, &seen_left, &seen_right, 2)?;
/// assert!((found.points_mm[0][0] - 40.0).abs() < 1e-10 && (found.points_mm[0][2] - 800.0).abs() < 1e-10);
/// # Ok::<(), geoerr_core::triangulate::TriangulateError>(())
/// ```
pub fn triangulate(
    rig: &Rig,
    left: &Pixels<'_>,
    right: &Pixels<'_>,
    reweightings: u32,
) -> Result<Triangulated, TriangulateError> {
    let n_points = left.uv_px.len();
    let mut result = Triangulated {
        points_mm: vec![[0.0; 3]; n_points],
        covariance_mm2: vec![[[0.0; 3]; 3]; n_points],
        reprojection_px: vec![0.0; n_points],
        status: vec![Status::Ok; n_points],
    };
    let rows = Rows {
        points_mm: &mut result.points_mm,
        covariance_mm2: &mut result.covariance_mm2,
        reprojection_px: &mut result.reprojection_px,
        status: &mut result.status,
    };
    triangulate_into(rig, left, right, reweightings, rows)?;
    Ok(result)
}

/// As [`triangulate`], into memory that the caller has.
///
/// # Errors
/// As [`triangulate`].
pub fn triangulate_into(
    rig: &Rig,
    left: &Pixels<'_>,
    right: &Pixels<'_>,
    reweightings: u32,
    rows: Rows<'_>,
) -> Result<(), TriangulateError> {
    let n_points = left.uv_px.len();
    check_length("the right pixels", right.uv_px.len(), n_points)?;
    check_noise("the left covariances", &left.noise, n_points)?;
    check_noise("the right covariances", &right.noise, n_points)?;
    check_length("the array of points", rows.points_mm.len(), n_points)?;
    check_length("the array of covariances", rows.covariance_mm2.len(), n_points)?;
    check_length("the array of reprojection errors", rows.reprojection_px.len(), n_points)?;
    check_length("the array of statuses", rows.status.len(), n_points)?;
    let blocks = rows
        .points_mm
        .par_chunks_mut(BLOCK)
        .zip(rows.covariance_mm2.par_chunks_mut(BLOCK))
        .zip(rows.reprojection_px.par_chunks_mut(BLOCK))
        .zip(rows.status.par_chunks_mut(BLOCK))
        .map(|(((points_mm, covariance_mm2), reprojection_px), status)| Rows {
            points_mm,
            covariance_mm2,
            reprojection_px,
            status,
        })
        .enumerate();
    let blocks =
        if n_points <= PARALLEL_ABOVE { blocks.with_min_len(PARALLEL_ABOVE) } else { blocks.with_min_len(1) };
    blocks.for_each_init(Workspace::new, |workspace, (index, mut block)| {
        block.fill(rig, left, right, index * BLOCK, reweightings, workspace);
    });
    Ok(())
}

/// Points alone, with equal noise in all pixels: Li's rows as they stand, as [`triangulate`] solves them with no
/// reweighting, without covariance and reprojection error and many times as fast.
///
/// Fills `points_mm` and `status`, one row for each pair of pixels. Pixels may be `f32`: the arithmetic is that of `f64`.
///
/// # Errors
/// [`TriangulateError::LengthsDiffer`]; a bad row is NaN and has a [`Status`].
///
/// # Examples
/// ```
/// use geoerr_core::triangulate::{Rig, Status, triangulate_points};
/// let left = [[2000.0, 0.0, 1000.0, 0.0], [0.0, 2000.0, 1000.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
/// let mut right = left;
/// right[0][3] = -2000.0 * 200.0; // 200 mm to the right
/// let rig = Rig::new(&left, &right)?;
/// let (mut points_mm, mut status) = ([[0.0; 3]; 1], [Status::Ok; 1]);
/// triangulate_points(&rig, &[[1100.0, 1000.0]], &[[600.0, 1000.0]], &mut points_mm, &mut status)?;
/// assert!((points_mm[0][0] - 40.0).abs() < 1e-10 && (points_mm[0][2] - 800.0).abs() < 1e-10);
/// # Ok::<(), geoerr_core::triangulate::TriangulateError>(())
/// ```
pub fn triangulate_points<P: Precision>(
    rig: &Rig,
    left_px: &[[P; 2]],
    right_px: &[[P; 2]],
    points_mm: &mut [[f64; 3]],
    status: &mut [Status],
) -> Result<(), TriangulateError> {
    let n_points = left_px.len();
    check_length("the right pixels", right_px.len(), n_points)?;
    check_length("the array of points", points_mm.len(), n_points)?;
    check_length("the array of statuses", status.len(), n_points)?;
    let fill = |(((left_px, right_px), points_mm), status): (((&[_], &[_]), &mut [_]), &mut [_])| {
        P::fill_points(rig, left_px, right_px, points_mm, status);
    };
    if n_points <= POINTS_PARALLEL_ABOVE {
        fill((((left_px, right_px), points_mm), status));
    } else {
        left_px
            .par_chunks(POINTS_BLOCK)
            .zip(right_px.par_chunks(POINTS_BLOCK))
            .zip(points_mm.par_chunks_mut(POINTS_BLOCK))
            .zip(status.par_chunks_mut(POINTS_BLOCK))
            .for_each(fill);
    }
    Ok(())
}

/// What pixels are given in: `f32` or `f64`.
pub trait Precision: Copy + Sync + Into<f64> + sealed::Fill {}

impl Precision for f32 {}
impl Precision for f64 {}

/// The kernel of each precision, made in this crate: where it was made in the crate of whoever called it, that crate's way
/// of being compiled decided whether it was four times as slow.
mod sealed {
    use super::{Rig, Status, fill_points};

    pub trait Fill: Sized {
        fn fill_points(
            rig: &Rig,
            left_px: &[[Self; 2]],
            right_px: &[[Self; 2]],
            points_mm: &mut [[f64; 3]],
            status: &mut [Status],
        );
    }

    macro_rules! fill {
        ($($precision:ty),*) => {$(
            impl Fill for $precision {
                #[inline(never)]
                fn fill_points(
                    rig: &Rig,
                    left_px: &[[Self; 2]],
                    right_px: &[[Self; 2]],
                    points_mm: &mut [[f64; 3]],
                    status: &mut [Status],
                ) {
                    fill_points(rig, left_px, right_px, points_mm, status);
                }
            }
        )*};
    }

    fill!(f32, f64);
}

fn fill_points<P: Copy + Into<f64>>(
    rig: &Rig,
    left_px: &[[P; 2]],
    right_px: &[[P; 2]],
    points_mm: &mut [[f64; 3]],
    status: &mut [Status],
) {
    status.fill(Status::Ok);
    let (chunks, rest) = points_mm.as_chunks_mut::<CHUNK>();
    let (lefts, rest_left) = left_px.as_chunks::<CHUNK>();
    let (rights, rest_right) = right_px.as_chunks::<CHUNK>();
    let statuses = status.chunks_mut(CHUNK);
    let whole = chunks.iter_mut().zip(lefts).zip(rights).zip(statuses);
    for (((points_mm, left_px), right_px), status) in whole {
        let is_good = solve_points(&rig.pair, left_px, right_px, points_mm);
        if is_good.contains(&0) {
            fill_points_carefully(rig, left_px, right_px, &is_good, points_mm, status);
        }
    }
    if let ([.., last_left], [.., last_right]) = (rest_left, rest_right) {
        let (mut padded_left, mut padded_right) = ([*last_left; CHUNK], [*last_right; CHUNK]);
        let n_rest = rest.len();
        padded_left[..n_rest].copy_from_slice(rest_left);
        padded_right[..n_rest].copy_from_slice(rest_right);
        let mut padded = [[0.0; 3]; CHUNK];
        let is_good = solve_points(&rig.pair, &padded_left, &padded_right, &mut padded);
        rest.copy_from_slice(&padded[..n_rest]);
        if is_good.contains(&0) {
            let status = &mut status[left_px.len() - n_rest..];
            fill_points_carefully(rig, rest_left, rest_right, &is_good[..n_rest], rest, status);
        }
    }
}

/// Fills the rows of a chunk for which the fast kernel does not answer.
fn fill_points_carefully<P: Copy + Into<f64>>(
    rig: &Rig,
    left_px: &[[P; 2]],
    right_px: &[[P; 2]],
    is_good: &[u64],
    points_mm: &mut [[f64; 3]],
    status: &mut [Status],
) {
    let [left_px, right_px] =
        [left_px, right_px].map(|rows| rows.iter().map(|uv_px| uv_px.map(P::into)).collect::<Vec<_>>());
    let [left, right] = [&left_px, &right_px].map(|uv_px| Pixels { uv_px, noise: PixelNoise::Sigma(1.0) });
    let open: Vec<usize> = (0..is_good.len()).filter(|&row| is_good[row] == 0).collect();
    for rows in open.chunks(WIDTH) {
        solve_carefully(rig, &left, &right, rows, 0, |row, found, solution, lane| {
            status[row] = found;
            points_mm[row] =
                solution.point_mm.map(|value| if found == Status::Ok { value.0[lane] } else { f64::NAN });
        });
    }
}

fn check_length(what: &'static str, found: usize, expected: usize) -> Result<(), TriangulateError> {
    if found == expected { Ok(()) } else { Err(TriangulateError::LengthsDiffer { what, found, expected }) }
}

fn check_noise(what: &'static str, noise: &PixelNoise<'_>, n_points: usize) -> Result<(), TriangulateError> {
    match *noise {
        PixelNoise::Covariances(covariances) => check_length(what, covariances.len(), n_points),
        PixelNoise::Sigma(sigma_px) if sigma_px > 0.0 && sigma_px.is_finite() => Ok(()),
        PixelNoise::Sigma(sigma_px) => Err(TriangulateError::SigmaNotPositive { sigma_px }),
    }
}

impl Rows<'_> {
    /// Fills the block whose first row is row `first` of the batch.
    fn fill(
        &mut self,
        rig: &Rig,
        left: &Pixels<'_>,
        right: &Pixels<'_>,
        first: usize,
        reweightings: u32,
        workspace: &mut Workspace,
    ) {
        self.status.fill(Status::Ok);
        let n_rows = self.points_mm.len();
        for offset in (0..n_rows).step_by(CHUNK) {
            let chunk = offset..n_rows.min(offset + CHUNK);
            let [left_chunk, right_chunk] =
                [left, right].map(|seen| seen.part(first + chunk.start..first + chunk.end));
            let mut rows = Rows {
                points_mm: &mut self.points_mm[chunk.clone()],
                covariance_mm2: &mut self.covariance_mm2[chunk.clone()],
                reprojection_px: &mut self.reprojection_px[chunk.clone()],
                status: &mut self.status[chunk],
            };
            let is_good = workspace.solve(&rig.pair, &left_chunk, &right_chunk, reweightings, &mut rows);
            if is_good.contains(&0) {
                rows.fill_carefully(rig, &left_chunk, &right_chunk, is_good, reweightings);
            }
        }
    }

    /// Fills the rows of a chunk for which the fast kernels do not answer.
    fn fill_carefully(
        &mut self,
        rig: &Rig,
        left: &Pixels<'_>,
        right: &Pixels<'_>,
        is_good: &[u64],
        reweightings: u32,
    ) {
        let open: Vec<usize> = (0..is_good.len()).filter(|&row| is_good[row] == 0).collect();
        for rows in open.chunks(WIDTH) {
            solve_carefully(rig, left, right, rows, reweightings, |row, status, solution, lane| {
                let is_ok = status == Status::Ok;
                let or_nan = |value: Lanes| if is_ok { value.0[lane] } else { f64::NAN };
                self.status[row] = status;
                self.points_mm[row] = solution.point_mm.map(or_nan);
                let [xx, xy, xz, yy, yz, zz] = solution.covariance_mm2.map(or_nan);
                self.covariance_mm2[row] = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
                self.reprojection_px[row] = or_nan(solution.reprojection_px);
            });
        }
    }
}

/// The careful path for up to [`WIDTH`] rows; each is given to `store`.
fn solve_carefully(
    rig: &Rig,
    left: &Pixels<'_>,
    right: &Pixels<'_>,
    rows: &[usize],
    reweightings: u32,
    mut store: impl FnMut(usize, Status, &Solution, usize),
) {
    // Lanes beyond the end repeat the last row and are not stored.
    let lanes: [usize; WIDTH] = std::array::from_fn(|lane| rows[lane.min(rows.len() - 1)]);
    let (seen_left, seen_right) = (left.sight(&lanes), right.sight(&lanes));
    let solution = solve(rig, &seen_left, &seen_right, reweightings);
    for (lane, &row) in rows.iter().enumerate() {
        store(row, solution.status(&seen_left, &seen_right, lane), &solution, lane);
    }
}

impl Pixels<'_> {
    /// The pixels of consecutive rows.
    fn part(&self, rows: std::ops::Range<usize>) -> Self {
        let noise = match self.noise {
            PixelNoise::Sigma(sigma_px) => PixelNoise::Sigma(sigma_px),
            PixelNoise::Covariances(all) => PixelNoise::Covariances(&all[rows.clone()]),
        };
        Self { uv_px: &self.uv_px[rows], noise }
    }

    /// Pixels and covariances of the given rows.
    #[inline(always)]
    fn sight(&self, rows: &[usize; WIDTH]) -> Sight {
        let [u_px, v_px] = [0, 1].map(|axis| Lanes::from_fn(|lane| self.uv_px[rows[lane]][axis]));
        let [c00_px2, c01_px2, c11_px2] = match self.noise {
            PixelNoise::Sigma(sigma_px) => {
                let variance = Lanes::splat(sigma_px * sigma_px);
                [variance, Lanes::splat(0.0), variance]
            }
            PixelNoise::Covariances(c) => [
                Lanes::from_fn(|lane| c[rows[lane]][0][0]),
                Lanes::from_fn(|lane| 0.5 * (c[rows[lane]][0][1] + c[rows[lane]][1][0])),
                Lanes::from_fn(|lane| c[rows[lane]][1][1]),
            ],
        };
        Sight { u_px, v_px, c00_px2, c01_px2, c11_px2 }
    }
}

impl Sight {
    fn is_finite(&self, lane: usize) -> bool {
        [self.u_px, self.v_px, self.c00_px2, self.c01_px2, self.c11_px2]
            .iter()
            .all(|value| value.0[lane].is_finite())
    }

    fn has_positive_covariance(&self, lane: usize) -> bool {
        let [c00, c01, c11] = [self.c00_px2, self.c01_px2, self.c11_px2].map(|value| value.0[lane]);
        c00 > 0.0 && c11 - c01 / c00 * c01 > 0.0
    }
}

impl Solution {
    fn status(&self, left: &Sight, right: &Sight, lane: usize) -> Status {
        let sine_squared = self.sine_squared.0[lane];
        let depths_mm = [self.depth_left_mm.0[lane], self.depth_right_mm.0[lane]];
        if !left.is_finite(lane) || !right.is_finite(lane) || !sine_squared.is_finite() {
            Status::NotFinite
        } else if !left.has_positive_covariance(lane) || !right.has_positive_covariance(lane) {
            Status::BadCovariance
        } else if sine_squared < MIN_RAY_ANGLE_RAD * MIN_RAY_ANGLE_RAD {
            Status::RaysParallel
        } else if depths_mm.iter().any(|depth_mm| !depth_mm.is_finite() || *depth_mm <= 0.0) {
            Status::BehindCamera
        } else {
            Status::Ok
        }
    }
}
