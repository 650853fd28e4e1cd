//! A plane seen by a camera without distortion: eight numbers, row by row, the ninth is 1.

use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, SVector};

pub(super) type Homography = [f64; 8];
type Points = [[f64; 2]; 4];
/// Sine of an angle below which three points are in one line.
const FLAT: f64 = 1e-6;

/// The homography that takes four points to four points; `None` where three are in one line.
pub(super) fn between(source: &Points, target: &Points) -> Option<Homography> {
    if (0..4).any(|left_out| is_in_line(source, left_out)) {
        return None;
    }
    let mut rows = SMatrix::<f64, 8, 8>::zeros();
    let mut right = SVector::<f64, 8>::zeros();
    for (number, ([x, y], goal)) in source.iter().zip(target).enumerate() {
        for (c, &value) in goal.iter().enumerate() {
            let row = 2 * number + c;
            let own = [*x, *y, 1.0];
            for (column, entry) in own.into_iter().enumerate() {
                rows[(row, 3 * c + column)] = entry;
            }
            rows[(row, 6)] = -x * value;
            rows[(row, 7)] = -y * value;
            right[row] = value;
        }
    }
    let found = rows.lu().solve(&right)?;
    found.iter().all(|value| value.is_finite()).then(|| found.into())
}

/// Whether three of four points, all but one, are in one line.
fn is_in_line(points: &Points, left_out: usize) -> bool {
    let [a, b, c] = [1, 2, 3].map(|off| points[(left_out + off) % 4]);
    let (one, other) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let area = one[0] * other[1] - one[1] * other[0];
    area.abs() <= FLAT * one[0].hypot(one[1]) * other[0].hypot(other[1])
}

/// What a homography makes of a point, and the third of its homogeneous coordinates.
pub(super) fn apply(h: &Homography, [x, y]: [f64; 2]) -> ([f64; 2], f64) {
    let w = h[6] * x + h[7] * y + 1.0;
    ([(h[0] * x + h[1] * y + h[2]) / w, (h[3] * x + h[4] * y + h[5]) / w], w)
}

/// The points that a homography takes to these; not finite where it has no inverse.
pub(super) fn back(h: &Homography, points: &Points) -> Points {
    // Adjugate: the inverse but for a factor, which homogeneous coordinates do not see.
    let [a, b, c, d, e, f, g, k] = *h;
    let adjugate = [
        [e - f * k, c * k - b, b * f - c * e],
        [f * g - d, a - c * g, c * d - a * f],
        [d * k - e * g, b * g - a * k, a * e - b * d],
    ];
    points.map(|[s, t]| {
        let [x, y, w] = adjugate.map(|row| row[0] * s + row[1] * t + row[2]);
        [x / w, y / w]
    })
}

/// The derivative (8 × 8) of points by the homography that takes them to places that stay: x₀, y₀, x₁, ...
pub(super) fn points_by_homography(h: &Homography, points: &Points) -> Option<SMatrix<f64, 8, 8>> {
    let mut result = SMatrix::<f64, 8, 8>::zeros();
    for (number, &[x, y]) in points.iter().enumerate() {
        let ([s, t], w) = apply(h, [x, y]);
        let by_h = SMatrix::<f64, 2, 8>::from_row_slice(&[
            x,
            y,
            1.0,
            0.0,
            0.0,
            0.0,
            -s * x,
            -s * y, //
            0.0,
            0.0,
            0.0,
            x,
            y,
            1.0,
            -t * x,
            -t * y,
        ]) / w;
        let by_point = Matrix2::new(h[0] - s * h[6], h[1] - s * h[7], h[3] - t * h[6], h[4] - t * h[7]) / w;
        let moved = by_point.lu().solve(&by_h)?;
        result.fixed_view_mut::<2, 8>(2 * number, 0).copy_from(&(-moved));
    }
    Some(result)
}

/// Solves a linear system (n × n, row by row, symmetric); `None` where it is singular.
pub(super) fn solved(matrix: &[f64], right: &[f64]) -> Option<Vec<f64>> {
    let n = right.len();
    let solution = DMatrix::from_row_slice(n, n, matrix).lu().solve(&DVector::from_column_slice(right))?;
    Some(solution.as_slice().to_vec())
}
