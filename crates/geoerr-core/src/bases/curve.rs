//! A basis with its coefficients, ready for fast evaluation; several of them with one search.

use super::BasisError;
use super::pieces::{Pieces, Waves};

/// A function of one axis position: polynomials between positions, and waves; its end values are held outside.
///
/// Evaluation searches in nearly constant time and allocates nothing. At a kink the slope is that to the right, as it is for
/// tables: so it is 0 at the high end already.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    pieces: Pieces<1>,
    waves: Vec<Waves>,
    kinks_mm: Vec<f64>,
}

impl Curve {
    pub(super) fn new(pieces: Pieces<1>, mut waves: Vec<Waves>, kinks_mm: Vec<f64>) -> Self {
        waves.retain(|waves| waves.amplitudes.iter().flatten().any(|&amplitude| amplitude != 0.0));
        Self { pieces, waves, kinks_mm }
    }

    /// The function that has one value everywhere.
    pub fn constant(value: f64) -> Self {
        Self { pieces: Pieces::constant(value), waves: Vec::new(), kinks_mm: Vec::new() }
    }

    /// Value at `q_mm`; NaN for NaN.
    #[inline]
    pub fn value(&self, q_mm: f64) -> f64 {
        self.value_and_slope(q_mm).0
    }

    /// Value and slope (per mm) at `q_mm`; NaN for NaN.
    #[inline]
    pub fn value_and_slope(&self, q_mm: f64) -> (f64, f64) {
        let ([mut value], [mut slope]) = self.pieces.values_and_slopes(q_mm);
        for waves in &self.waves {
            let (wave_value, wave_slope) = waves.value_and_slope(q_mm);
            value += wave_value;
            slope += wave_slope;
        }
        (value, slope)
    }

    /// Rising positions where value or slope is not continuous, or may not be.
    pub fn kinks(&self) -> &[f64] {
        &self.kinks_mm
    }

    /// The sum of two functions.
    pub fn plus(&self, other: &Self) -> Self {
        let pieces = Pieces::sums(&[vec![&self.pieces, &other.pieces]]);
        let waves = self.waves.iter().chain(&other.waves).cloned().collect();
        Self { pieces, waves, kinks_mm: union(&[self, other]) }
    }
}

/// N functions of the same axis position: one search gives all values and slopes.
#[derive(Debug, Clone, PartialEq)]
pub struct CurveSet<const N: usize> {
    pieces: Pieces<N>,
    /// With the place of the function that each belongs to.
    waves: Vec<(usize, Waves)>,
    kinks_mm: Vec<f64>,
}

impl<const N: usize> CurveSet<N> {
    /// The functions on the union of their positions.
    pub fn new(curves: [&Curve; N]) -> Self {
        let waves = curves.iter().enumerate().flat_map(|(n, curve)| {
            let waves = curve.waves.iter().cloned();
            waves.map(move |waves| (n, waves))
        });
        Self {
            pieces: Pieces::sums(&curves.map(|curve| vec![&curve.pieces])),
            waves: waves.collect(),
            kinks_mm: union(&curves),
        }
    }

    /// Values and slopes (per mm) at `q_mm`, in the order of the functions; NaN for NaN.
    #[inline]
    pub fn values_and_slopes(&self, q_mm: f64) -> ([f64; N], [f64; N]) {
        let (mut values, mut slopes) = self.pieces.values_and_slopes(q_mm);
        for (n, waves) in &self.waves {
            let (value, slope) = waves.value_and_slope(q_mm);
            values[*n] += value;
            slopes[*n] += slope;
        }
        (values, slopes)
    }

    /// Rising positions where some function's value or slope is not continuous, or may not be.
    pub fn kinks(&self) -> &[f64] {
        &self.kinks_mm
    }
}

fn union(curves: &[&Curve]) -> Vec<f64> {
    let mut kinks_mm: Vec<f64> = curves.iter().flat_map(|curve| curve.kinks()).copied().collect();
    kinks_mm.sort_by(f64::total_cmp);
    kinks_mm.dedup();
    kinks_mm
}

/// Refuses values that are not one for each of `needed`, or not finite; `what` and `whats` name them.
pub(super) fn check_values(
    what: &'static str,
    whats: &'static str,
    values: &[f64],
    needed: usize,
) -> Result<(), BasisError> {
    if values.len() != needed {
        return Err(BasisError::Count { what: whats, found: values.len(), needed });
    }
    match values.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        Some((index, &value)) => Err(BasisError::NotFinite { what, index, value }),
        None => Ok(()),
    }
}
