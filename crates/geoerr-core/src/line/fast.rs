//! Many lines at once, for points that look like a line.
//!
//! The chord from a line's first point to its last is all but the line itself, so the points are counted from it: with `x`
//! the coordinate in which the chord is longest and `g` the chord for `x = 1`, a point is `x g` and a small rest `s` in the other
//! two coordinates. One pass sums moments of `x` and `s`; those of `s` are small numbers that were never large, so that nothing
//! is lost to cancellation where a matrix of plain coordinates would lose the residuals. A few lines side by side are
//! solved from their moments, and one more pass over the points gives the distances along.
//!
//! | symbol | code | meaning | unit |
//! |---|---|---|---|
//! | `$\mathbf g = (1, \mathbf p)$` | `slope` | the chord; `|p₁|, |p₂| ≤ 1` | - |
//! | `$\mathbf s$` | `s1`, `s2` | `$(y, z) - x\,\mathbf p$`, from the first point | mm |
//! | `$X, \mathbf a, B$` | `xx`, `xs`, `ss` | `$\sum x^2$`, `$\sum x\,\mathbf s$`, `$\sum\mathbf s\mathbf s^\top$` about the centroid | mm² |
//! | `$\mathbf v = (1, \mathbf q)$` | `q` | the line for `x = 1` | - |
//! | `$\mathbf t = \mathbf q - \mathbf p$` | `tilt` | of the line against the chord | - |
//! | `$\lambda$` | `along` | largest eigenvalue of the scatter matrix | mm² |
//! | `$R$` | `rest` | `$\sum \mathbf r\mathbf r^\top$` of `$\mathbf r = \mathbf s - x\,\mathbf t$` | mm² |
//!
//! The scatter matrix is `$X\mathbf g\mathbf g^\top + \mathbf g\mathbf a^\top + \mathbf a\mathbf g^\top + B$`, and its
//! eigenvector's equations are
//!
//! ```math
//! \lambda\,\mathbf t = (\mathbf g\cdot\mathbf v)\,\mathbf a + B\mathbf q,\qquad
//! \lambda = (\mathbf g\cdot\mathbf v)\,X + \mathbf a\cdot\mathbf q
//! ```
//!
//! which is iterated: each turn leaves `$\operatorname{tr} B / X$` of the error, and begins with as much. A residual is what
//! of `r` is across the line. Lines that are fatter than [`MOST_ASIDE`], whose chord is far from the line, that lie near one
//! point beside their coordinates, or that hold anything not finite are left to the careful path.

use pulp::{Arch, Simd, WithSimd};

use crate::arithmetic::{Arithmetic, Fused, Separate, two};

/// Lines that are solved side by side.
pub(super) const GROUP: usize = 8;

/// Points that are laid out by coordinate at once.
const CHUNK: usize = 64;

/// No register holds more numbers.
const MOST_LANES: usize = 8;

/// One coordinate of a chunk, with room behind it to fill up the last register.
type Column = [f64; CHUNK + MOST_LANES];

/// Turns of the iteration: with the start, an error of [`MOST_ASIDE`] to the fourth power.
const TURNS: usize = 3;

/// Largest `tr B / X`.
const MOST_ASIDE: f64 = 3e-5;

/// Largest sum about the first point, and largest share of the chord's tilt in `B`, over what counts: two digits at most are lost.
const MOST_LOST: f64 = 100.0;

/// `tr B / X` under which the points are on the chord to a few roundings, whatever was lost of them.
const STRAIGHT: f64 = 1e3 * f64::EPSILON * f64::EPSILON;

/// Least spread over the largest coordinate: far above where points coincide.
const LEAST_SPREAD: f64 = 1e-6;

/// A number of each line.
type Each = [f64; GROUP];

const ZEROS: Each = [0.0; GROUP];

/// Output rows of a group's lines, in their order.
pub(super) struct Rows<'a> {
    pub centroid_mm: &'a mut [[f64; 3]],
    pub direction: &'a mut [[f64; 3]],
    pub rms_mm: &'a mut [f64],
    /// Empty where covariances are not asked for.
    pub direction_covariance: &'a mut [[[f64; 3]; 3]],
    /// For every point, one line after another; empty where distances are not asked for.
    pub along_mm: &'a mut [f64],
}

/// Points of a group's lines by coordinate, from each line's first one: room that is made once for many groups.
pub(super) struct Clouds([Cloud; GROUP]);

/// Up to [`CHUNK`] points of a line.
type Cloud = [Column; 3];

impl Clouds {
    pub(super) fn new() -> Self {
        Self([[[0.0; CHUNK + MOST_LANES]; 3]; GROUP])
    }
}

/// Fits up to [`GROUP`] lines, and says which: of the others, which the careful path has to answer, no row is written.
pub(super) fn fit_group(lines: &[&[[f64; 3]]], clouds: &mut Clouds, rows: &mut Rows<'_>) -> [bool; GROUP] {
    if rows.direction_covariance.is_empty() {
        Arch::new().dispatch(Group::<false> { lines, clouds, rows })
    } else {
        Arch::new().dispatch(Group::<true> { lines, clouds, rows })
    }
}

struct Group<'a, 'r, const WITH_COVARIANCE: bool> {
    lines: &'a [&'a [[f64; 3]]],
    clouds: &'a mut Clouds,
    rows: &'a mut Rows<'r>,
}

impl<const WITH_COVARIANCE: bool> WithSimd for Group<'_, '_, WITH_COVARIANCE> {
    type Output = [bool; GROUP];
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        if S::IS_SCALAR { self.run::<Separate, S>(simd) } else { self.run::<Fused, S>(simd) }
    }
}

impl<const WITH_COVARIANCE: bool> Group<'_, '_, WITH_COVARIANCE> {
    #[inline(always)]
    fn run<A: Arithmetic, S: Simd>(self, simd: S) -> [bool; GROUP] {
        let mut moments = Moments::new();
        let mut chords = [Chord::NONE; GROUP];
        // One after another as they lie in memory, which is waited for nowhere else: a chord's last point has come by then.
        for (line, cloud) in self.lines.iter().zip(&mut self.clouds.0) {
            if let [first, ..] = line {
                lay_out(&line[..line.len().min(CHUNK)], first, cloud);
            }
        }
        for (chord, line) in chords.iter_mut().zip(self.lines) {
            if let [first, .., last] = line {
                *chord = Chord::new(first, last);
            }
        }
        for (k, (line, cloud)) in self.lines.iter().zip(&mut self.clouds.0).enumerate() {
            if line.len() > 1 {
                moments.take(simd, k, line, &chords[k], cloud);
            }
        }
        let solved = solve::<A, WITH_COVARIANCE>(&moments);
        // Without room for distances there are none to measure.
        let mut rest = &mut *self.rows.along_mm;
        for (k, (line, cloud)) in self.lines.iter().zip(&self.clouds.0).enumerate() {
            let (along_mm, after) = rest.split_at_mut(line.len().min(rest.len()));
            rest = after;
            if let [first, ..] = line
                && solved.is_good[k]
            {
                let order = &chords[k].order;
                for (i, &row) in order.iter().enumerate() {
                    self.rows.centroid_mm[k][row] = first[row] + solved.mean_mm[i][k];
                    self.rows.direction[k][row] = solved.direction[i][k];
                }
                self.rows.rms_mm[k] = solved.rms_mm[k];
                if WITH_COVARIANCE {
                    solved.put_covariance(k, order, &mut self.rows.direction_covariance[k]);
                }
                measure_along::<A>(line, &self.rows.direction[k], cloud, along_mm);
            }
        }
        solved.is_good
    }
}

/// From a line's first point to its last.
#[derive(Clone, Copy)]
struct Chord {
    /// The coordinate in which it is longest, and the two after it.
    order: [usize; 3],
    slope: [f64; 2],
    /// In the first of the three coordinates.
    length_mm: f64,
}

impl Chord {
    const NONE: Self = Self { order: [0, 1, 2], slope: [0.0; 2], length_mm: 0.0 };

    #[inline(always)]
    fn new(first: &[f64; 3], last: &[f64; 3]) -> Self {
        let chord_mm = [0, 1, 2].map(|i| last[i] - first[i]);
        let size_mm = chord_mm.map(f64::abs);
        // No branch: directions of neighbouring lines tell nothing of each other.
        let longer = usize::from(size_mm[1] > size_mm[0]);
        let order = [[0, 1, 2], [1, 2, 0], [2, 0, 1]][if size_mm[2] > size_mm[longer] { 2 } else { longer }];
        let length_mm = chord_mm[order[0]];
        Self { order, slope: [chord_mm[order[1]] / length_mm, chord_mm[order[2]] / length_mm], length_mm }
    }
}

/// Sums over the points of each line, from its first point, in the order of its chord's coordinates.
struct Moments {
    n_points: Each,
    chord_mm: Each,
    slope: [Each; 2],
    /// Square of the first point's distance from the origin.
    place_mm2: Each,
    /// x, s₁, s₂.
    sum: [Each; 3],
    /// xx, xs₁, xs₂, s₁s₁, s₁s₂, s₂s₂.
    square: [Each; 6],
}

impl Moments {
    #[inline(always)]
    fn new() -> Self {
        Self {
            n_points: [1.0; GROUP],
            chord_mm: ZEROS,
            slope: [ZEROS; 2],
            place_mm2: ZEROS,
            sum: [ZEROS; 3],
            square: [ZEROS; 6],
        }
    }

    #[inline(always)]
    fn take<S: Simd>(&mut self, simd: S, k: usize, line: &[[f64; 3]], chord: &Chord, cloud: &mut Cloud) {
        let first = &line[0];
        let zero = simd.splat_f64s(0.0);
        let (mut sum, mut square) = ([zero; 3], [zero; 6]);
        let less = chord.slope.map(|slope| simd.splat_f64s(-slope));
        for (index, points_mm) in line.chunks(CHUNK).enumerate() {
            let n_filled = points_mm.len().next_multiple_of(S::F64_LANES);
            if index > 0 {
                lay_out(points_mm, first, cloud);
            }
            let [x, y, z] = chord.order.map(|i| S::as_simd_f64s(&cloud[i][..n_filled]).0);
            for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
                let s1 = simd.mul_add_e_f64s(less[0], x, y);
                let s2 = simd.mul_add_e_f64s(less[1], x, z);
                sum = [simd.add_f64s(sum[0], x), simd.add_f64s(sum[1], s1), simd.add_f64s(sum[2], s2)];
                square = [
                    simd.mul_add_e_f64s(x, x, square[0]),
                    simd.mul_add_e_f64s(x, s1, square[1]),
                    simd.mul_add_e_f64s(x, s2, square[2]),
                    simd.mul_add_e_f64s(s1, s1, square[3]),
                    simd.mul_add_e_f64s(s1, s2, square[4]),
                    simd.mul_add_e_f64s(s2, s2, square[5]),
                ];
            }
        }
        self.n_points[k] = line.len() as f64;
        self.chord_mm[k] = chord.length_mm;
        self.place_mm2[k] = first.iter().map(|value| value * value).sum();
        for i in 0..2 {
            self.slope[i][k] = chord.slope[i];
        }
        for (of_lines, sum) in self.sum.iter_mut().zip(sum) {
            of_lines[k] = simd.reduce_sum_f64s(sum);
        }
        for (of_lines, square) in self.square.iter_mut().zip(square) {
            of_lines[k] = simd.reduce_sum_f64s(square);
        }
    }
}

/// Points by coordinate, from the line's first one; filled up with the first one, which counts nothing.
#[inline(always)]
fn lay_out(points_mm: &[[f64; 3]], first: &[f64; 3], cloud: &mut Cloud) {
    let [x, y, z] = cloud;
    for (((p, x), y), z) in points_mm.iter().zip(x.iter_mut()).zip(y.iter_mut()).zip(z.iter_mut()) {
        *x = p[0] - first[0];
        *y = p[1] - first[1];
        *z = p[2] - first[2];
    }
    for column in cloud {
        column[points_mm.len()..][..MOST_LANES].copy_from_slice(&[0.0; MOST_LANES]);
    }
}

/// Distances along a line from its first point; the cloud holds the points where they are no more than a chunk.
#[inline(always)]
fn measure_along<A: Arithmetic>(
    line: &[[f64; 3]],
    direction: &[f64; 3],
    cloud: &Cloud,
    along_mm: &mut [f64],
) {
    let along = |x, y, z| A::mul_add(direction[0], x, two::<A>(direction[1], y, direction[2], z));
    if line.len() <= CHUNK {
        let [x, y, z] = cloud;
        for (((along_mm, x), y), z) in along_mm.iter_mut().zip(x).zip(y).zip(z) {
            *along_mm = along(*x, *y, *z);
        }
    } else {
        let first = line[0];
        for (along_mm, p) in along_mm.iter_mut().zip(line) {
            *along_mm = along(p[0] - first[0], p[1] - first[1], p[2] - first[2]);
        }
    }
}

/// Lines of a group, in the order of their chords' coordinates.
struct Solved {
    /// From the first point.
    mean_mm: [Each; 3],
    direction: [Each; 3],
    rms_mm: Each,
    /// xx, xy, xz, yy, yz, zz.
    covariance: [Each; 6],
    is_good: [bool; GROUP],
}

impl Solved {
    #[inline(always)]
    fn put_covariance(&self, k: usize, order: &[usize; 3], covariance: &mut [[f64; 3]; 3]) {
        let [xx, xy, xz, yy, yz, zz] = [0, 1, 2, 3, 4, 5].map(|i| self.covariance[i][k]);
        for (&row, of_row) in order.iter().zip([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) {
            for (&column, value) in order.iter().zip(of_row) {
                covariance[row][column] = value;
            }
        }
    }
}

#[inline(always)]
fn solve<A: Arithmetic, const WITH_COVARIANCE: bool>(moments: &Moments) -> Solved {
    let mut solved = Solved {
        mean_mm: [ZEROS; 3],
        direction: [ZEROS; 3],
        rms_mm: ZEROS,
        covariance: [ZEROS; 6],
        is_good: [false; GROUP],
    };
    let mut good = ZEROS;
    for (k, good) in good.iter_mut().enumerate() {
        let n_points = moments.n_points[k];
        let p = [moments.slope[0][k], moments.slope[1][k]];
        let sum = [0, 1, 2].map(|i| moments.sum[i][k]);
        let mean = sum.map(|sum| sum / n_points);
        let about =
            |i: usize, row: usize, column: usize| A::mul_add(-mean[row], sum[column], moments.square[i][k]);
        let xx = about(0, 0, 0);
        let xs = [about(1, 0, 1), about(2, 0, 2)];
        let ss = [about(3, 1, 1), about(4, 1, 2), about(5, 2, 2)];

        let mut tilt = [xs[0] / xx, xs[1] / xx];
        let mut along = xx;
        for _ in 0..TURNS {
            let q = [p[0] + tilt[0], p[1] + tilt[1]];
            let gv = A::mul_add(p[0], q[0], A::mul_add(p[1], q[1], 1.0));
            along = A::mul_add(gv, xx, two::<A>(xs[0], q[0], xs[1], q[1]));
            let inverse = 1.0 / along;
            tilt = [
                A::mul_add(gv, xs[0], two::<A>(ss[0], q[0], ss[1], q[1])) * inverse,
                A::mul_add(gv, xs[1], two::<A>(ss[1], q[0], ss[2], q[1])) * inverse,
            ];
        }

        let q = [p[0] + tilt[0], p[1] + tilt[1]];
        let rest = [(0, 0, 0), (1, 0, 1), (2, 1, 1)].map(|(i, row, column)| {
            let half = A::mul_add(0.5 * tilt[column], xx, -xs[column]);
            let other = A::mul_add(0.5 * tilt[row], xx, -xs[row]);
            ss[i] + two::<A>(tilt[row], half, tilt[column], other)
        });
        let inverse_square = 1.0 / A::mul_add(q[0], q[0], A::mul_add(q[1], q[1], 1.0));
        let length = inverse_square.sqrt() * if moments.chord_mm[k] < 0.0 { -1.0 } else { 1.0 };
        let v = [length, q[0] * length, q[1] * length];

        let u = [two::<A>(rest[0], v[1], rest[1], v[2]), two::<A>(rest[1], v[1], rest[2], v[2])];
        let uv = two::<A>(u[0], v[1], u[1], v[2]);
        let trace = (rest[0] + rest[2] - uv).max(0.0);
        if WITH_COVARIANCE {
            // On the plane across the line the residuals' matrix M has trace τ and determinant δ, and there M² = τ M − δ P, so
            // that (λP − M)⁻¹ (λP + M) (λP − M)⁻¹ is a sum of the projector P and M.
            let delta = two::<A>(rest[0], rest[2], -rest[1], rest[1]) * (v[0] * v[0]);
            let determinant = A::mul_add(along, along - trace, delta);
            let b0 = A::mul_add(along - trace, along - trace, -delta);
            let b1 = 2.0 * along - trace;
            let variance = trace / (A::mul_add(2.0, n_points, -4.0) * determinant * determinant);
            let plain = variance * A::mul_add(b0, along, -b1 * delta);
            let with = variance * A::mul_add(b1, along + trace, b0);
            let u = [0.0, u[0], u[1]];
            let of_rest = [0.0, 0.0, 0.0, rest[0], rest[1], rest[2]];
            let places = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
            for (i, (row, column)) in places.into_iter().enumerate() {
                let both = two::<A>(v[row], u[column], u[row], v[column]);
                let across = A::mul_add(uv * v[row], v[column], of_rest[i] - both);
                let unit = if row == column { 1.0 } else { 0.0 };
                let projector = A::mul_add(-v[row], v[column], unit);
                solved.covariance[i][k] = A::mul_add(plain, projector, with * across);
            }
        }
        solved.rms_mm[k] = (trace / n_points).sqrt();
        for i in 0..2 {
            solved.mean_mm[i + 1][k] = A::mul_add(p[i], mean[0], mean[i + 1]);
        }
        solved.mean_mm[0][k] = mean[0];
        for (of_lines, v) in solved.direction.iter_mut().zip(v) {
            of_lines[k] = v;
        }

        let aside = ss[0] + ss[2];
        let shifted = two::<A>(mean[1], sum[1], mean[2], sum[2]);
        let is_good = (n_points >= 3.0)
            & (aside <= MOST_ASIDE * xx)
            & (mean[0] * sum[0] <= MOST_LOST * xx)
            & (shifted.max(aside) <= A::mul_add(MOST_LOST, rest[0] + rest[2], STRAIGHT * xx))
            & (xx >= LEAST_SPREAD * LEAST_SPREAD * n_points * moments.place_mm2[k])
            & (xx > 1e-100)
            & (xx < 1e100);
        *good = if is_good { 1.0 } else { 0.0 };
    }
    solved.is_good = good.map(|good| good == 1.0);
    solved
}
