//! The best step within bounds, where the function is taken for a quadratic one.

use crate::least_squares::{Definite, Matrix};

/// A multiplier below this is none: gradients are in units of what the curvature gives.
const NO_PULL: f64 = 1e-9;

/// Minimises `gᵀs + sᵀHs/2` for `low ≤ s ≤ high`, where 0 is within; `None` where H is not positive definite.
///
/// Active sets: the free coordinates go to their minimum or to the first bound on the way, which then holds; one that
/// would rather come back is freed. Every step lowers the value, so that it ends; the number of steps is limited
/// nevertheless, and any of them is a step worth taking.
pub(super) fn box_step(gradient: &[f64], curvature: &Matrix, low: &[f64], high: &[f64]) -> Option<Vec<f64>> {
    let n = gradient.len();
    let mut step = vec![0.0; n];
    let mut is_free: Vec<bool> = (0..n)
        .map(|i| !(low[i] >= 0.0 && gradient[i] >= 0.0 || high[i] <= 0.0 && gradient[i] <= 0.0))
        .collect();
    for _ in 0..8 * n + 8 {
        let slope = slope_at(gradient, curvature, &step);
        let free: Vec<usize> = (0..n).filter(|&i| is_free[i]).collect();
        let way = newton(&slope, curvature, &free)?;
        let mut share = 1.0;
        let mut met = None;
        for (&i, &way) in free.iter().zip(&way) {
            let end = if way > 0.0 { high[i] } else { low[i] };
            if way != 0.0 && (end - step[i]) / way < share {
                share = (end - step[i]) / way;
                met = Some((i, end));
            }
        }
        for (&i, &way) in free.iter().zip(&way) {
            step[i] += share * way;
        }
        if let Some((i, end)) = met {
            step[i] = end;
            is_free[i] = false;
            continue;
        }
        let slope = slope_at(gradient, curvature, &step);
        let pull = |i: usize| {
            let inwards = if step[i] <= low[i] { -slope[i] } else { slope[i] };
            inwards / curvature[(i, i)].sqrt()
        };
        let freed = (0..n)
            .filter(|&i| !is_free[i] && low[i] < high[i])
            .max_by(|&a, &b| pull(a).total_cmp(&pull(b)))
            .filter(|&i| pull(i) > NO_PULL);
        match freed {
            Some(i) => is_free[i] = true,
            None => break,
        }
    }
    Some(step)
}

/// `gᵀs + sᵀHs/2`.
pub(super) fn quadratic(gradient: &[f64], curvature: &Matrix, step: &[f64]) -> f64 {
    let slope = slope_at(gradient, curvature, step);
    step.iter().zip(gradient.iter().zip(slope)).map(|(s, (g, slope))| 0.5 * s * (g + slope)).sum()
}

/// `g + H s`.
fn slope_at(gradient: &[f64], curvature: &Matrix, step: &[f64]) -> Vec<f64> {
    (0..gradient.len())
        .map(|i| gradient[i] + curvature.column(i).iter().zip(step).map(|(h, s)| h * s).sum::<f64>())
        .collect()
}

/// Way of the free coordinates to their minimum.
fn newton(slope: &[f64], curvature: &Matrix, free: &[usize]) -> Option<Vec<f64>> {
    let part = Matrix::from_fn(free.len(), free.len(), |i, j| curvature[(free[i], free[j])]);
    let mut way = Matrix::from_column(free.iter().map(|&i| -slope[i]).collect());
    Definite::of(part)?.solve(&mut way);
    Some(way.into_values())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_step_is_the_best_within_its_bounds(
            numbers in prop::collection::vec(-1.0_f64..1.0, 5 * 5 + 5),
            bounds in prop::collection::vec((-0.5_f64..=0.0, 0.0_f64..=0.5), 5),
        ) {
            let root = Matrix::from_fn(5, 5, |i, j| numbers[5 * i + j]);
            let h = Matrix::from_fn(5, 5, |i, j| {
                (0..5).map(|k| root[(k, i)] * root[(k, j)]).sum::<f64>() + if i == j { 0.05 } else { 0.0 }
            });
            let g = &numbers[25..];
            let (low, high): (Vec<f64>, Vec<f64>) = bounds.into_iter().unzip();
            let step = box_step(g, &h, &low, &high).unwrap();
            let slope = slope_at(g, &h, &step);
            for i in 0..5 {
                prop_assert!(low[i] <= step[i] && step[i] <= high[i]);
                // Inside the slope is 0; at a bound it points out.
                let within = (step[i] - low[i]) * (high[i] - step[i]) > 0.0;
                prop_assert!(!within || slope[i].abs() < 1e-8);
                prop_assert!(within || low[i] == high[i]
                    || (step[i] == low[i] && slope[i] > -1e-8) || (step[i] == high[i] && slope[i] < 1e-8));
            }
        }
    }
}
