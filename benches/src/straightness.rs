//! Functions that integration is measured with.

const N_POSITIONS: usize = 50;

/// Uneven positions along an axis.
pub fn positions_mm() -> Vec<f64> {
    (0..N_POSITIONS).map(|i| 8.0 * i as f64 + 3.0 * (i as f64 * 0.618).fract()).collect()
}

/// Slopes at those positions, one function after the other.
pub fn slopes_rad(n_functions: usize) -> Vec<f64> {
    (0..n_functions * N_POSITIONS).map(|i| 1e-5 * ((i as f64 * 0.7548).fract() - 0.5)).collect()
}
