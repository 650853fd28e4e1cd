//! Waves along one variable whose frequencies are multiples of one: sines and cosines, recognised by their values.
//!
//! Of the periods of a screw there are thousands, half of all ways that are tried. Their sums over rows need no values
//! at nodes: those at all frequencies come from one transform (see `spectrum`).

use rayon::prelude::*;

use super::error::CandidateError;
use super::nodes::evaluated;
use super::sources::{Formula, Sources};

/// Fewest waves of a variable for which a transform is worth its making.
const WORTHWHILE: usize = 64;
/// A transform has the frequencies between those that are asked for, too: at most so many for each of them.
const MOST_BETWEEN: f64 = 16.0;
/// Places, in periods, where a wave is recognised, and how closely.
const TRIED: [f64; 4] = [0.087_1, 0.213_7, 0.631_3, 3.271_9];
const ACCURACY: f64 = 1e-9;
/// How closely a frequency has to be a multiple of the first one, in cycles over the range of the variable.
const OFF_GRID: f64 = 1e-4;

/// Sine or cosine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Sine,
    Cosine,
}

/// A formula that is a wave.
#[derive(Clone, Debug)]
pub(super) struct Wave {
    /// Its family.
    pub family: usize,
    /// Its frequency, as a multiple of the family's.
    pub harmonic: usize,
    /// What each of its coefficients is on.
    pub kinds: Vec<Kind>,
}

/// Waves along one variable.
#[derive(Clone, Debug)]
pub(super) struct Family {
    /// Place of each row in turns of the lowest frequency; not finite where the variable has no value.
    pub turns: Vec<f64>,
    /// The highest multiple.
    pub highest: usize,
}

/// Finds the families of waves among all formulas, and of each formula its wave.
pub(super) fn families(sources: &Sources<'_>) -> Result<(Vec<Family>, Vec<Option<Wave>>), CandidateError> {
    let mut by_variable: Vec<Vec<(usize, f64, Vec<Kind>)>> = vec![Vec::new(); sources.rows.variables.len()];
    let found: Vec<_> = sources.formulas.par_iter().map(recognised).collect::<Result<_, _>>()?;
    for (number, (formula, found)) in sources.formulas.iter().zip(found).enumerate() {
        if let Some((variable, kinds)) = found {
            by_variable[variable].push((number, 1.0 / formula.inner[0], kinds));
        }
    }
    let mut families = Vec::new();
    let mut wave_of = vec![None; sources.formulas.len()];
    for (column, waves) in sources.rows.variables.iter().zip(by_variable) {
        if waves.len() < WORTHWHILE {
            continue;
        }
        let frequencies: Vec<f64> = waves.iter().map(|wave| wave.1).collect();
        let Some((step, harmonics)) = multiples(&frequencies, range(column)) else { continue };
        for ((number, _, kinds), &harmonic) in waves.into_iter().zip(&harmonics) {
            wave_of[number] = Some(Wave { family: families.len(), harmonic, kinds });
        }
        families.push(Family {
            turns: column.iter().map(|value| value * step).collect(),
            highest: harmonics.iter().copied().max().unwrap_or(0),
        });
    }
    Ok((families, wave_of))
}

/// The variable and the kinds of a formula `A sin(2πv/P) + B cos(2πv/P)`, in whatever words, with P its inner parameter.
fn recognised(formula: &Formula) -> Result<Option<(usize, Vec<Kind>)>, CandidateError> {
    let Formula { expression, inner, series, .. } = formula;
    let (&[variable], &[period]) = (expression.variable_indices(), &inner[..]) else { return Ok(None) };
    let may_be_wave = series.is_none() && !expression.needs_order() && expression.is_smooth() && period > 0.0;
    if !may_be_wave {
        return Ok(None);
    }
    let values = evaluated(formula, &TRIED.map(|place| place * period))?;
    let kinds = values.chunks_exact(TRIED.len()).map(|own| {
        let is = |of: fn(f64) -> f64| {
            own.iter().zip(TRIED).all(|(value, place)| {
                (value - of(std::f64::consts::TAU * place)).abs() < ACCURACY * (1.0 + place)
            })
        };
        if is(f64::sin) {
            Some(Kind::Sine)
        } else if is(f64::cos) {
            Some(Kind::Cosine)
        } else {
            None
        }
    });
    Ok(kinds.collect::<Option<Vec<Kind>>>().map(|kinds| (variable, kinds)))
}

/// The frequency that all are multiples of, and the multiples.
fn multiples(frequencies: &[f64], range: f64) -> Option<(f64, Vec<usize>)> {
    let mut sorted = frequencies.to_vec();
    sorted.sort_by(f64::total_cmp);
    let least = OFF_GRID / range.max(f64::MIN_POSITIVE);
    let step = (sorted.windows(2).map(|two| two[1] - two[0]))
        .chain([sorted[0]])
        .filter(|&apart| apart > least)
        .fold(f64::INFINITY, f64::min);
    // A difference of two frequencies has fewer digits than they have: the highest frequency, as a whole number of
    // steps, says more exactly what the step is.
    let step = sorted[sorted.len() - 1] / (sorted[sorted.len() - 1] / step).round();
    let harmonics: Vec<f64> = frequencies.iter().map(|frequency| (frequency / step).round()).collect();
    let most = MOST_BETWEEN * frequencies.len() as f64;
    let is_on_grid = frequencies
        .iter()
        .zip(&harmonics)
        .all(|(f, k)| (f - k * step).abs() < least && (1.0..=most).contains(k));
    is_on_grid.then(|| (step, harmonics.into_iter().map(|harmonic| harmonic as usize).collect()))
}

fn range(column: &[f64]) -> f64 {
    let finite = || column.iter().copied().filter(|value| value.is_finite());
    finite().fold(f64::NEG_INFINITY, f64::max) - finite().fold(f64::INFINITY, f64::min)
}
