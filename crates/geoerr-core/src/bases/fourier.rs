//! A constant and waves over a range.

use super::order::Depth;

/// `1, cos kωq, sin kωq` for k = 1 ... order, `ω = 2π/period`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fourier {
    pub(super) low_mm: f64,
    pub(super) high_mm: f64,
    pub(super) period_mm: f64,
    pub(super) order: usize,
}

impl Fourier {
    /// All functions at `q_mm` (within the range).
    ///
    /// With `d = q − low` and `φ = kω·low`: `cos kωq = cos φ cos kωd − sin φ sin kωd`, `sin` likewise, and the
    /// integrals of `cos kωd` and `sin kωd` from 0 in forms that do not cancel for small d.
    pub(super) fn fill(&self, depth: Depth, q_mm: f64, out: &mut [f64]) {
        let into_mm = q_mm - self.low_mm;
        out[0] = match depth {
            Depth::Derivative => 0.0,
            Depth::Value => 1.0,
            Depth::Integral => into_mm,
            Depth::DoubleIntegral => 0.5 * into_mm * into_mm,
        };
        for (pair, harmonic) in out[1..].chunks_exact_mut(2).zip(1..) {
            let wave = self.wave_per_mm(harmonic);
            let (sin_phase, cos_phase) = (wave * self.low_mm).sin_cos();
            let angle = wave * into_mm;
            let (sin, cos) = angle.sin_cos();
            let one_minus_cos = 2.0 * (0.5 * angle).sin().powi(2);
            let (of_cos, of_sin) = match depth {
                Depth::Derivative => (-wave * sin, wave * cos),
                Depth::Value => (cos, sin),
                Depth::Integral => (sin / wave, one_minus_cos / wave),
                Depth::DoubleIntegral => (one_minus_cos / (wave * wave), (angle - sin) / (wave * wave)),
            };
            pair[0] = cos_phase * of_cos - sin_phase * of_sin;
            pair[1] = sin_phase * of_cos + cos_phase * of_sin;
        }
    }

    /// `∫ (q − middle)^p B_j` over the range for p = 0, 1, 2.
    ///
    /// Over a symmetric range only even moments of the cosine and odd ones of the sine are not 0.
    pub(super) fn moments(&self) -> [Vec<f64>; 3] {
        let half_mm = 0.5 * (self.high_mm - self.low_mm);
        let middle_mm = self.low_mm + half_mm;
        let mut moments = [vec![2.0 * half_mm], vec![0.0], vec![2.0 / 3.0 * half_mm.powi(3)]];
        for harmonic in (1..).take(self.order) {
            let wave = self.wave_per_mm(harmonic);
            let (sin, cos) = (wave * half_mm).sin_cos();
            let (sin_middle, cos_middle) = (wave * middle_mm).sin_cos();
            let even = 2.0 * sin / wave;
            let odd = 2.0 * (sin / wave - half_mm * cos) / wave;
            let even_square =
                2.0 * (half_mm * half_mm * sin + 2.0 * (half_mm * cos - sin / wave) / wave) / wave;
            moments[0].extend([cos_middle * even, sin_middle * even]);
            moments[1].extend([-sin_middle * odd, cos_middle * odd]);
            moments[2].extend([cos_middle * even_square, sin_middle * even_square]);
        }
        moments
    }

    /// The sum of the waves times `weights` (without the constant) as amplitudes of `cos kωd` and `sin kωd`.
    pub(super) fn combination(&self, weights: &[f64]) -> Vec<[f64; 2]> {
        let pairs = weights[1..].chunks_exact(2).zip(1..);
        pairs
            .map(|(pair, harmonic)| {
                let (sin, cos) = (self.wave_per_mm(harmonic) * self.low_mm).sin_cos();
                [pair[0] * cos + pair[1] * sin, pair[1] * cos - pair[0] * sin]
            })
            .collect()
    }

    /// `kω`, rad/mm.
    pub(super) fn wave_per_mm(&self, harmonic: u32) -> f64 {
        2.0 * std::f64::consts::PI * f64::from(harmonic) / self.period_mm
    }
}
