//! Total-least-squares lines through batches of points in space.
//!
//! ```math
//! \min_{\mathbf c,\mathbf v}\ \sum_i \bigl\|(I-\mathbf v\mathbf v^\top)(\mathbf p_i-\mathbf c)\bigr\|^2
//! ```
//!
//! The solution is the centroid `c` and the eigenvector `v` of the scatter matrix's largest eigenvalue.
//!
//! | symbol | code | meaning | unit |
//! |---|---|---|---|
//! | `$\mathbf d_i$` | `d` | `$\mathbf p_i - \mathbf c$` | mm |
//! | `$S$` | `scatter` | `$\sum_i\mathbf d_i\mathbf d_i^\top$` | mm² |
//! | `$t_i$` | `t` | `$\mathbf d_i\cdot\mathbf v$` | mm |
//! | `$\mathbf s_i$` | `s` | the two components of `$\mathbf d_i$` across the line, in a basis `$E=(\mathbf e_1,\mathbf e_2)$` | mm |
//! | `$\lambda$`, `$M$` | `along`, `across` | `$\sum t_i^2$`, `$\sum\mathbf s_i\mathbf s_i^\top$` | mm² |
//!
//! # Accuracy
//! Points are centred first. The scatter matrix squares the condition number, which harms small singular values but not
//! the largest one's vector: its error is `ε·λ₁/(λ₁−λ₂)`, as for an SVD. Two things are then done from the points and not
//! from the matrix: the eigenvector is corrected by `Σ t d⊥ / λ` (a power step, whose ratio `λ₂/λ₁` is 10⁻⁶ or less for
//! anything that looks like a line), and the residuals are summed as vectors, because `trace S − λ₁` would cancel.
//!
//! Lines of three points and more that look like a line are fitted in groups, from moments about their chords (`fast`): a
//! tenth of the time, and no less accurate, because what is small there was never large.
//!
//! # Uncertainty
//! With `δp_i` the errors of the points, first order and exact in the shape of the cloud:
//! `δv = E (λ I − M)⁻¹ Σ_i (t_i Eᵀ + s_i vᵀ) δp_i`; the centroid's error drops out.
//!
//! # Source
//! Li et al. 2023, §4.3 (lines 1–9 are fitted by total least squares); Golub & Van Loan 2013, §6.3 and Eq. 8.1.7.
//!
//! # Verified
//! `tests/line.rs`: 50-digit references beside nalgebra's SVD, invariances by property tests, many lines at once against
//! lines one by one, bitwise equality over thread counts, finite differences of the covariance. `tests/geometry/test_line.py`: SVD by NumPy, Monte-Carlo covariance.

mod fast;

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};
use rayon::prelude::*;

use self::fast::{Clouds, GROUP, Rows, fit_group};

/// Points below which the calling thread does all lines itself.
const PARALLEL_ABOVE: usize = 16_384;

/// Points closer together than this many roundings of their largest coordinate are one point.
const COINCIDENT_ROUNDINGS: f64 = 8.0;

/// Smallest `(λ₁ − λ₂)/λ₁`: below it, rounding alone turns the direction by more than 10⁻⁴ rad.
const MIN_RELATIVE_GAP: f64 = 1e-12;

/// Jacobi sweeps: three reach the rounding level for any 3×3 matrix, the rest is reserve.
const JACOBI_SWEEPS: usize = 8;

/// Why a whole batch is refused. A bad line is not an error: it has a [`Status`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// The starts do not cut the points into consecutive lines.
    #[error(
        "start {index} is {found}: starts begin with 0, do not fall, and stay within the {n_points} points"
    )]
    BadStart {
        /// Index into the starts.
        index: usize,
        /// Its value.
        found: usize,
        /// Number of points.
        n_points: usize,
    },
    /// Points before the first start, or points without any line.
    #[error("{n_points} points belong to no line: no start is given")]
    NoStarts {
        /// Number of points.
        n_points: usize,
    },
    /// Covariances that are not one for each point.
    #[error("{found} covariances for {expected} points")]
    LengthsDiffer {
        /// Number of covariances.
        found: usize,
        /// Number of points.
        expected: usize,
    },
}

/// Whether a line could be fitted, and if not, why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Status {
    /// A line.
    Ok = 0,
    /// A coordinate or covariance that is not finite, or so large that the arithmetic overflows.
    NotFinite = 1,
    /// Fewer than two points.
    TooFewPoints = 2,
    /// All points are one point.
    Coincident = 3,
    /// The points spread equally in two directions: no line fits best.
    NoDirection = 4,
}

/// Lines; one that could not be fitted is NaN and its `status` says why.
#[derive(Clone, Debug)]
pub struct FittedLines {
    /// A point on each line: the centroid of its points.
    pub centroid_mm: Vec<[f64; 3]>,
    /// Unit direction, from the first point towards the last.
    pub direction: Vec<[f64; 3]>,
    /// Root mean square distance of the points from the line.
    pub rms_mm: Vec<f64>,
    /// Covariance of the direction (rank 2, across it); empty where it was not asked for.
    pub direction_covariance: Vec<[[f64; 3]; 3]>,
    /// For every point, its distance along its line from the line's first point; empty where they were not asked for.
    pub along_mm: Vec<f64>,
    /// Why a line could not be fitted.
    pub status: Vec<Status>,
}

/// Where the uncertainty of the directions comes from.
#[derive(Clone, Copy, Debug)]
pub enum PointNoise<'a> {
    /// From each line's own residuals, equal in all directions: variance `Σ|d⊥|²/(2n − 4)`; NaN for two points.
    FromResiduals,
    /// A 3×3 covariance for each point.
    Covariances(&'a [[[f64; 3]; 3]]),
}

/// What is asked for beside the lines themselves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asked {
    /// Distances along: a fifth of the time, and eight bytes a point.
    pub along: bool,
    /// Covariances of the directions: a sixth of the time, and 72 bytes a line.
    pub direction_covariance: bool,
}

impl Asked {
    /// Everything.
    pub const ALL: Self = Self { along: true, direction_covariance: true };
}

/// One fitted line.
struct Line {
    centroid_mm: Vector3<f64>,
    direction: Vector3<f64>,
    rms_mm: f64,
    direction_covariance: Matrix3<f64>,
}

/// Fits a line to each run of points: line `i` has `points_mm[starts[i] .. starts[i + 1]]`, the last one the rest.
///
/// The direction points from the first point of a line to its last (for a path that ends where it began: its
/// largest component is positive).
///
/// # Errors
/// [`LineError`] for starts or covariances that do not fit the points; a bad line has a [`Status`] instead.
///
/// # Examples
/// ```
/// use geoerr_core::line::{PointNoise, fit_lines};
/// let points = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [2.0, 0.0, 1.0]];
/// let fitted = fit_lines(&points, &[0], PointNoise::FromResiduals)?;
/// assert_eq!(fitted.direction[0], [1.0, 0.0, 0.0]);
/// assert_eq!(fitted.along_mm, [0.0, 1.0, 2.0]);
/// # Ok::<(), geoerr_core::line::LineError>(())
/// ```
pub fn fit_lines(
    points_mm: &[[f64; 3]],
    starts: &[usize],
    noise: PointNoise<'_>,
) -> Result<FittedLines, LineError> {
    fit_lines_for(Asked::ALL, points_mm, starts, noise)
}

/// Fits the same lines, with no more beside them than is asked for.
///
/// # Errors
/// As [`fit_lines`].
pub fn fit_lines_for(
    asked: Asked,
    points_mm: &[[f64; 3]],
    starts: &[usize],
    noise: PointNoise<'_>,
) -> Result<FittedLines, LineError> {
    check(points_mm.len(), starts, &noise)?;
    let n_lines = starts.len();
    let mut fitted = FittedLines {
        centroid_mm: vec![[0.0; 3]; n_lines],
        direction: vec![[0.0; 3]; n_lines],
        rms_mm: vec![0.0; n_lines],
        direction_covariance: vec![[[0.0; 3]; 3]; if asked.direction_covariance { n_lines } else { 0 }],
        along_mm: vec![0.0; if asked.along { points_mm.len() } else { 0 }],
        status: vec![Status::Ok; n_lines],
    };
    let first_starts: Vec<usize> = starts.iter().step_by(GROUP).copied().collect();
    let covariances = groups_of_covariances(&mut fitted.direction_covariance, first_starts.len());
    let groups = cut(&mut fitted.along_mm, &first_starts, points_mm.len())
        .into_par_iter()
        .zip(starts.par_chunks(GROUP))
        .zip(fitted.centroid_mm.par_chunks_mut(GROUP))
        .zip(fitted.direction.par_chunks_mut(GROUP))
        .zip(fitted.rms_mm.par_chunks_mut(GROUP))
        .zip(covariances)
        .zip(fitted.status.par_chunks_mut(GROUP))
        .map(|((((((along, starts), centroid_mm), direction), rms_mm), direction_covariance), status)| {
            let rows = Rows { centroid_mm, direction, rms_mm, direction_covariance, along_mm: along.1 };
            Group { end: along.0, starts, rows, status }
        });
    let least_groups = if points_mm.len() <= PARALLEL_ABOVE { n_lines.max(1) } else { 1 };
    groups
        .with_min_len(least_groups)
        .for_each_init(Clouds::new, |clouds, mut group| group.fill(points_mm, noise, clouds));
    Ok(fitted)
}

/// Some neighbouring lines and their output.
struct Group<'a> {
    /// Behind the last line's points.
    end: usize,
    starts: &'a [usize],
    rows: Rows<'a>,
    status: &'a mut [Status],
}

impl Group<'_> {
    fn range(&self, line: usize) -> std::ops::Range<usize> {
        self.starts[line]..self.starts.get(line + 1).copied().unwrap_or(self.end)
    }

    /// Fits the lines together, and one by one those for which that does not answer.
    fn fill(&mut self, points_mm: &[[f64; 3]], noise: PointNoise<'_>, clouds: &mut Clouds) {
        let mut is_answered = [false; GROUP];
        if let PointNoise::FromResiduals = noise {
            let mut lines: [&[[f64; 3]]; GROUP] = [&[]; GROUP];
            for (line, points) in lines.iter_mut().enumerate().take(self.starts.len()) {
                *points = &points_mm[self.range(line)];
            }
            is_answered = fit_group(&lines[..self.starts.len()], clouds, &mut self.rows);
        }
        for line in (0..self.starts.len()).filter(|&line| !is_answered[line]) {
            self.fill_carefully(line, points_mm, noise);
        }
    }

    fn fill_carefully(&mut self, line: usize, points_mm: &[[f64; 3]], noise: PointNoise<'_>) {
        let range = self.range(line);
        let covariances = match noise {
            PointNoise::Covariances(all) => Some(&all[range.clone()]),
            PointNoise::FromResiduals => None,
        };
        let offset = self.starts[0];
        let place = range.start - offset..range.end - offset;
        let along_mm = self.rows.along_mm.get_mut(place).unwrap_or_default();
        let fitted = fit_line(&points_mm[range], covariances, along_mm);
        if fitted.is_err() {
            along_mm.fill(f64::NAN);
        }
        self.status[line] = fitted.as_ref().err().copied().unwrap_or(Status::Ok);
        let fitted = fitted.ok();
        let fitted = fitted.as_ref();
        self.rows.centroid_mm[line] = fitted.map_or([f64::NAN; 3], |line| line.centroid_mm.into());
        self.rows.direction[line] = fitted.map_or([f64::NAN; 3], |line| line.direction.into());
        self.rows.rms_mm[line] = fitted.map_or(f64::NAN, |line| line.rms_mm);
        if let Some(covariance) = self.rows.direction_covariance.get_mut(line) {
            *covariance = fitted.map_or([[f64::NAN; 3]; 3], |line| line.direction_covariance.into());
        }
    }
}

fn check(n_points: usize, starts: &[usize], noise: &PointNoise<'_>) -> Result<(), LineError> {
    if let PointNoise::Covariances(covariances) = noise
        && covariances.len() != n_points
    {
        return Err(LineError::LengthsDiffer { found: covariances.len(), expected: n_points });
    }
    if starts.is_empty() && n_points > 0 {
        return Err(LineError::NoStarts { n_points });
    }
    let mut previous = 0;
    for (index, &found) in starts.iter().enumerate() {
        if found < previous || found > n_points || (index == 0 && found != 0) {
            return Err(LineError::BadStart { index, found, n_points });
        }
        previous = found;
    }
    Ok(())
}

/// Room for the covariances of each group, or none for any.
fn groups_of_covariances(all: &mut [[[f64; 3]; 3]], n_groups: usize) -> Vec<&mut [[[f64; 3]; 3]]> {
    let mut groups: Vec<_> = all.chunks_mut(GROUP).collect();
    groups.resize_with(n_groups, Default::default);
    groups
}

/// Cuts a row of a number for each point at the starts, or one of none; each piece comes with where it ends.
fn cut<'a>(mut rest: &'a mut [f64], starts: &[usize], n_points: usize) -> Vec<(usize, &'a mut [f64])> {
    let mut pieces = Vec::with_capacity(starts.len());
    for (index, &start) in starts.iter().enumerate() {
        let end = starts.get(index + 1).copied().unwrap_or(n_points);
        let (piece, after) = rest.split_at_mut((end - start).min(rest.len()));
        pieces.push((end, piece));
        rest = after;
    }
    pieces
}

fn fit_line(
    points_mm: &[[f64; 3]],
    covariances: Option<&[[[f64; 3]; 3]]>,
    along_mm: &mut [f64],
) -> Result<Line, Status> {
    let [first, .., last] = points_mm else {
        return Err(Status::TooFewPoints);
    };
    let n_points = points_mm.len() as f64;
    let finite = points_mm.iter().flatten().all(|value| value.is_finite())
        && covariances.is_none_or(|all| all.iter().flatten().flatten().all(|value| value.is_finite()));
    if !finite {
        return Err(Status::NotFinite);
    }
    if are_coincident(points_mm) {
        return Err(Status::Coincident);
    }
    let centroid = centroid(points_mm);
    let centred = || points_mm.iter().map(|p| Vector3::from(*p) - centroid);
    let scatter: Matrix3<f64> = centred().map(|d| d * d.transpose()).sum();
    if !scatter.iter().all(|value| value.is_finite()) {
        return Err(Status::NotFinite);
    }
    let [(largest, mut v), (second, _), _] = eigen(&scatter);
    if largest - second <= MIN_RELATIVE_GAP * largest {
        return Err(Status::NoDirection);
    }
    let correction: Vector3<f64> = centred().map(|d| (d - v * d.dot(&v)) * d.dot(&v)).sum();
    v = (v + correction / largest).normalize();
    let (first, last) = (Vector3::from(*first), Vector3::from(*last));
    let travel = (last - first).dot(&v);
    if travel < 0.0 || (travel == 0.0 && v[v.iamax()] < 0.0) {
        v = -v;
    }

    let square_sum: f64 = centred().map(|d| (d - v * d.dot(&v)).norm_squared()).sum();
    for (along, p) in along_mm.iter_mut().zip(points_mm) {
        *along = (Vector3::from(*p) - first).dot(&v);
    }
    let noise = match covariances {
        Some(all) => Noise::Given(all),
        None if points_mm.len() == 2 => Noise::Variance(f64::NAN),
        None => Noise::Variance(square_sum / (2.0 * n_points - 4.0)),
    };
    Ok(Line {
        centroid_mm: centroid,
        direction: v,
        rms_mm: (square_sum / n_points).sqrt(),
        direction_covariance: direction_covariance(centred(), &v, noise),
    })
}

/// Noise of one line's points.
enum Noise<'a> {
    Variance(f64),
    Given(&'a [[[f64; 3]; 3]]),
}

/// Covariance of the direction; see the head of this file.
fn direction_covariance(
    centred: impl Iterator<Item = Vector3<f64>> + Clone,
    v: &Vector3<f64>,
    noise: Noise<'_>,
) -> Matrix3<f64> {
    let basis = basis_across(v);
    let mut along = 0.0;
    let mut across = Matrix2::zeros();
    for d in centred.clone() {
        let s = basis.transpose() * d;
        along += d.dot(v).powi(2);
        across += s * s.transpose();
    }
    let sum = match noise {
        // The products of the two terms vanish: Eᵀ v = 0.
        Noise::Variance(variance) => (Matrix2::identity() * along + across) * variance,
        Noise::Given(covariances) => centred
            .zip(covariances)
            .map(|(d, c)| {
                let s: Vector2<f64> = basis.transpose() * d;
                let j = basis.transpose() * d.dot(v) + s * v.transpose();
                j * Matrix3::from_fn(|row, column| 0.5 * (c[row][column] + c[column][row])) * j.transpose()
            })
            .sum(),
    };
    // The gap between the eigenvalues was checked, so the matrix has an inverse.
    let gain = (Matrix2::identity() * along - across).try_inverse().unwrap_or(Matrix2::repeat(f64::NAN));
    let from_across = basis * gain;
    from_across * sum * from_across.transpose()
}

/// Mean of the points, then corrected by the mean of what is left: exact to a rounding of its own size.
fn centroid(points_mm: &[[f64; 3]]) -> Vector3<f64> {
    let n_points = points_mm.len() as f64;
    let origin = Vector3::from(points_mm[0]);
    let mean_from = |origin: Vector3<f64>| -> Vector3<f64> {
        points_mm.iter().map(|p| Vector3::from(*p) - origin).sum::<Vector3<f64>>() / n_points
    };
    let mean = origin + mean_from(origin);
    mean + mean_from(mean)
}

fn are_coincident(points_mm: &[[f64; 3]]) -> bool {
    let first = points_mm[0];
    let size = points_mm.iter().flatten().fold(0.0, |size: f64, value| size.max(value.abs()));
    let limit_mm = COINCIDENT_ROUNDINGS * f64::EPSILON * size;
    points_mm.iter().all(|p| (0..3).all(|i| (p[i] - first[i]).abs() <= limit_mm))
}

/// Two unit vectors across `v` and across each other.
fn basis_across(v: &Vector3<f64>) -> Matrix3x2<f64> {
    let mut helper = Vector3::zeros();
    helper[v.iamin()] = 1.0;
    let e1 = v.cross(&helper).normalize();
    Matrix3x2::from_columns(&[e1, v.cross(&e1)])
}

/// Eigenvalues, largest first, with unit eigenvectors, by cyclic Jacobi rotations (Golub & Van Loan 2013, §8.5).
fn eigen(symmetric: &Matrix3<f64>) -> [(f64, Vector3<f64>); 3] {
    let mut a = *symmetric;
    let mut vectors = Matrix3::identity();
    let negligible = 1e-3 * f64::EPSILON * symmetric.trace();
    for _ in 0..JACOBI_SWEEPS {
        let mut turned = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[(p, q)].abs() <= negligible {
                continue;
            }
            turned = true;
            let half_cotangent = (a[(q, q)] - a[(p, p)]) / (2.0 * a[(p, q)]);
            let tangent = half_cotangent.signum() / (half_cotangent.abs() + half_cotangent.hypot(1.0));
            let cosine = 1.0 / tangent.hypot(1.0);
            let mut rotation = Matrix3::identity();
            rotation[(p, p)] = cosine;
            rotation[(q, q)] = cosine;
            rotation[(p, q)] = tangent * cosine;
            rotation[(q, p)] = -tangent * cosine;
            a = rotation.transpose() * a * rotation;
            vectors *= rotation;
        }
        if !turned {
            break;
        }
    }
    let mut pairs = [0, 1, 2].map(|i| (a[(i, i)], vectors.column(i).into_owned()));
    pairs.sort_by(|x, y| y.0.total_cmp(&x.0));
    pairs
}
