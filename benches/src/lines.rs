//! Lines that fits are measured with.

/// Of every line.
pub const POINTS_OF_A_LINE: usize = 50;

/// Points of lines, one line after the other, mm.
pub fn points(n_lines: usize) -> Vec<[f64; 3]> {
    let fraction = |i: usize, step: f64| (i as f64 * step).fract() - 0.5;
    (0..n_lines * POINTS_OF_A_LINE)
        .map(|i| {
            let along = 8.0 * (i % POINTS_OF_A_LINE) as f64;
            let noise = [0.31, 0.77, 0.55].map(|step| 0.02 * fraction(i, step));
            [0.6 * along + noise[0], 0.8 * along + noise[1], 600.0 + noise[2]]
        })
        .collect()
}
