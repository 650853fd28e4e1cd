//! Legendre polynomials over a range: the well-conditioned way to write polynomials.

use super::order::Depth;

/// `P₀ ... P_degree` of `t = (2q − low − high)/(high − low)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Legendre {
    pub(super) low_mm: f64,
    pub(super) high_mm: f64,
    pub(super) degree: usize,
}

impl Legendre {
    /// All polynomials at `q_mm` (within the range).
    ///
    /// `∫P_n = (P_{n+1} − P_{n−1})/(2n + 1)`, with `P_{−1} = −1` so that it is 0 at the low end for n = 0 too, and
    /// for n > 0 because neighbours but one agree there; `P'_{n+1} = P'_{n−1} + (2n + 1) P_n`.
    pub(super) fn fill(&self, depth: Depth, q_mm: f64, out: &mut [f64]) {
        let half_mm = 0.5 * (self.high_mm - self.low_mm);
        let t = ((q_mm - self.low_mm) - (self.high_mm - q_mm)) / (2.0 * half_mm);
        match depth {
            Depth::Value => polynomials(t, out),
            Depth::Derivative => {
                let mut values = vec![0.0; out.len()];
                polynomials(t, &mut values);
                for n in 0..out.len() {
                    out[n] = match n {
                        0 => 0.0,
                        1 => 1.0,
                        _ => out[n - 2] + (2 * n - 1) as f64 * values[n - 1],
                    };
                }
                out.iter_mut().for_each(|value| *value /= half_mm);
            }
            Depth::Integral => {
                let mut values = vec![0.0; out.len() + 1];
                polynomials(t, &mut values);
                for (n, value) in out.iter_mut().enumerate() {
                    *value = half_mm * integral(&values, n);
                }
            }
            Depth::DoubleIntegral => {
                let mut values = vec![0.0; out.len() + 2];
                polynomials(t, &mut values);
                let integrals: Vec<f64> = (0..=out.len()).map(|n| integral(&values, n)).collect();
                for (n, value) in out.iter_mut().enumerate() {
                    // The integral of ∫P₀ = t + 1 = P₁ + P₀; others are sums of neighbours already.
                    let doubled = match n {
                        0 => integrals[1] + integrals[0],
                        _ => (integrals[n + 1] - integrals[n - 1]) / (2 * n + 1) as f64,
                    };
                    *value = half_mm * half_mm * doubled;
                }
            }
        }
    }

    /// `∫ (q − middle)^p P_n` over the range for p = 0, 1, 2, by orthogonality: `t² = (2 P₂ + P₀)/3`.
    pub(super) fn moments(&self) -> [Vec<f64>; 3] {
        let half_mm = 0.5 * (self.high_mm - self.low_mm);
        let mut moments = [(); 3].map(|()| vec![0.0; self.degree + 1]);
        for (power, degree, value) in [(0, 0, 2.0), (1, 1, 2.0 / 3.0), (2, 0, 2.0 / 3.0), (2, 2, 4.0 / 15.0)]
        {
            if degree <= self.degree {
                moments[power][degree] = value * half_mm.powi(power as i32 + 1);
            }
        }
        moments
    }

    /// `Σ weight_n P_n` as coefficients of 1, t, t², ...
    pub(super) fn combination(weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; weights.len()];
        let (mut previous, mut current) = (vec![0.0; weights.len()], vec![0.0; weights.len()]);
        current[0] = 1.0;
        for (n, weight) in weights.iter().enumerate() {
            for (sum, c) in sum.iter_mut().zip(&current) {
                *sum += weight * c;
            }
            let mut next: Vec<f64> = previous.iter().map(|c| -(n as f64) * c / (n + 1) as f64).collect();
            for (power, c) in current[..weights.len() - 1].iter().enumerate() {
                next[power + 1] += (2 * n + 1) as f64 * c / (n + 1) as f64;
            }
            (previous, current) = (current, next);
        }
        sum
    }
}

fn polynomials(t: f64, out: &mut [f64]) {
    for n in 0..out.len() {
        out[n] = match n {
            0 => 1.0,
            1 => t,
            _ => ((2 * n - 1) as f64 * t * out[n - 1] - (n - 1) as f64 * out[n - 2]) / n as f64,
        };
    }
}

/// `∫_{−1}^t P_n` from the values of the polynomials.
fn integral(values: &[f64], n: usize) -> f64 {
    let below = if n == 0 { -1.0 } else { values[n - 1] };
    (values[n + 1] - below) / (2 * n + 1) as f64
}
