//! Points that triangulation is measured with.

/// A camera's projection, px from mm.
pub type Projection = [[f64; 4]; 3];

/// Li's lens twice, 200 mm apart, both looking at 700 mm.
pub fn projections() -> [Projection; 2] {
    let focal_px = 8.0 / 0.003_45;
    let (sine, cosine) = (200.0_f64 / 700.0).atan().sin_cos();
    let left = [[focal_px, 0.0, 1223.5, 0.0], [0.0, focal_px, 1023.5, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let pose =
        [[cosine, 0.0, sine, -200.0 * cosine], [0.0, 1.0, 0.0, 0.0], [-sine, 0.0, cosine, 200.0 * sine]];
    let right =
        left.map(|row| std::array::from_fn(|column| (0..3).map(|k| row[k] * pose[k][column]).sum::<f64>()));
    [left, right]
}

/// What a camera sees of points all over the volume, with a tenth of a pixel of noise.
pub fn pixels(projection: &Projection, n_points: usize) -> Vec<[f64; 2]> {
    let fraction = |i: usize, step: f64| (i as f64 * step).fract() - 0.5;
    (0..n_points)
        .map(|i| {
            let p = [
                240.0 * fraction(i, 0.8192),
                200.0 * fraction(i, 0.6710),
                700.0 + 200.0 * fraction(i, 0.5497),
            ];
            let [x, y, w] = projection.map(|m| m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3]);
            [x / w + 0.1 * fraction(i, 0.31), y / w + 0.1 * fraction(i, 0.77)]
        })
        .collect()
}
