//! Sums of weights times waves over the places of one block of the noise, for many harmonics.

use crate::arithmetic::in_wide_registers;
use crate::least_squares::Real;

/// Harmonics whose waves are turned on beside each other.
pub(super) const LANES: usize = 2 * HALF;
/// Of them those that are summed in registers.
const HALF: usize = 8;
/// Columns of weights that are summed in registers.
const COLUMNS: usize = 3;

/// A cosine and a sine.
type OfTurn = (f64, f64);

/// A place as harmonics turn it on; of a place that is no number all waves are 0.
#[derive(Clone, Copy)]
pub(super) struct Turning {
    turns: f64,
    /// What takes a wave on by 1, 2, 4, … harmonics, the last by [`LANES`].
    steps: [OfTurn; LANES.ilog2() as usize + 1],
}

impl Turning {
    /// A place in turns of the lowest frequency.
    pub(super) fn new(turns: f64) -> Self {
        let mut steps = [at(turns, 1); LANES.ilog2() as usize + 1];
        for doubled in 1..steps.len() {
            steps[doubled] = times(steps[doubled - 1], steps[doubled - 1]);
        }
        Self { turns, steps }
    }

    /// The waves of [`LANES`] harmonics from one on.
    fn waves<T: Real>(&self, first: usize) -> Waves<T> {
        let mut waves = Waves::default();
        if !self.turns.is_finite() {
            return waves;
        }
        let mut lanes = [at(self.turns, first); LANES];
        // The first 1, 2, 4, 8 turned on by as many steps are the next ones.
        for (doubled, &step) in self.steps[..self.steps.len() - 1].iter().enumerate() {
            let known = 1 << doubled;
            for lane in 0..known {
                lanes[known + lane] = times(lanes[lane], step);
            }
        }
        let (cosine, sine) = self.steps[self.steps.len() - 1];
        waves.step = [T::nearest(cosine), T::nearest(sine)];
        for (lane, &(cosine, sine)) in lanes.iter().enumerate() {
            waves.cosines[lane / HALF][lane % HALF] = T::nearest(cosine);
            waves.sines[lane / HALF][lane % HALF] = T::nearest(sine);
        }
        waves
    }
}

fn at(turns: f64, harmonic: usize) -> OfTurn {
    let turn = turns * harmonic as f64;
    let (sine, cosine) = (std::f64::consts::TAU * (turn - turn.round_ties_even())).sin_cos();
    (cosine, sine)
}

fn times(a: OfTurn, b: OfTurn) -> OfTurn {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// The waves of one place at [`LANES`] harmonics, and what turns them on to the next ones.
#[derive(Clone, Copy, Default)]
pub(super) struct Waves<T> {
    cosines: [[T; HALF]; 2],
    sines: [[T; HALF]; 2],
    step: [T; 2],
}

/// Sets, for each column of weights (a weight for each place), sums with the cosines of harmonics one after the other,
/// then those with the sines: as many [`LANES`] of each as there is room for.
///
/// Waves are turned on from those [`LANES`] before them, which is wrong by a rounding more. `waves` is room to work in.
pub(super) fn set_sums_of_waves<T: Real>(
    sums: &mut [T],
    weights: &[T],
    places: &[Turning],
    first: usize,
    waves: &mut Vec<Waves<T>>,
) {
    let n_places = places.len().max(1);
    let size = sums.len() / (weights.len() / n_places).max(1);
    let groups = sums.chunks_mut(COLUMNS * size.max(1)).zip(weights.chunks(COLUMNS * n_places));
    for (sums, weights) in groups {
        waves.clear();
        waves.extend(places.iter().map(|place| place.waves(first)));
        match weights.len() / n_places {
            3 => sum_of_columns::<T, 3>(sums, weights, waves),
            2 => sum_of_columns::<T, 2>(sums, weights, waves),
            _ => sum_of_columns::<T, 1>(sums, weights, waves),
        }
    }
}

fn sum_of_columns<T: Real, const K: usize>(sums: &mut [T], weights: &[T], waves: &mut [Waves<T>]) {
    in_wide_registers(
        #[inline(always)]
        || {
            let n = sums.len() / (2 * K);
            for at in (0..n).step_by(LANES) {
                for half in 0..2 {
                    let of_half = sum_of_half::<T, K>(weights, waves, half);
                    for (k, of_kinds) in of_half.iter().enumerate() {
                        for (kind, own) in of_kinds.iter().enumerate() {
                            sums[(2 * k + kind) * n + at + half * HALF..][..HALF].copy_from_slice(own);
                        }
                    }
                }
            }
        },
    );
}

/// Sums over places in registers, and turns the waves on.
#[inline(always)]
fn sum_of_half<T: Real, const K: usize>(
    weights: &[T],
    waves: &mut [Waves<T>],
    half: usize,
) -> [[[T; HALF]; 2]; K] {
    let mut sums = [[[T::default(); HALF]; 2]; K];
    let n_places = waves.len();
    for (place, own) in waves.iter_mut().enumerate() {
        let (cosines, sines) = (own.cosines[half], own.sines[half]);
        for (k, [with_cosine, with_sine]) in sums.iter_mut().enumerate() {
            let weight = weights[k * n_places + place];
            for lane in 0..HALF {
                with_cosine[lane] += weight * cosines[lane];
                with_sine[lane] += weight * sines[lane];
            }
        }
        let [cosine, sine] = own.step;
        for lane in 0..HALF {
            own.cosines[half][lane] = cosines[lane] * cosine - sines[lane] * sine;
            own.sines[half][lane] = sines[lane] * cosine + cosines[lane] * sine;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_waves_written_out() {
        let turns = [0.013, -0.72, 0.4999, f64::NAN, 3.25];
        let places = turns.map(Turning::new);
        for n_columns in 1..=5 {
            let weights: Vec<f64> = (0..n_columns * turns.len()).map(|i| 0.3 + (i % 7) as f64).collect();
            let (first, n) = (5, 3 * LANES);
            let mut sums = vec![0.0; n_columns * 2 * n];
            set_sums_of_waves(&mut sums, &weights, &places, first, &mut Vec::new());
            for (column, weights) in weights.chunks_exact(turns.len()).enumerate() {
                for harmonic in 0..n {
                    let angle = |turn: f64| std::f64::consts::TAU * turn * (first + harmonic) as f64;
                    let sum = |of: fn(f64) -> f64| -> f64 {
                        let known = turns.iter().zip(weights).filter(|(turn, _)| turn.is_finite());
                        known.map(|(&turn, weight)| weight * of(angle(turn))).sum()
                    };
                    let own = &sums[column * 2 * n..];
                    assert!((own[harmonic] - sum(f64::cos)).abs() < 1e-11);
                    assert!((own[n + harmonic] - sum(f64::sin)).abs() < 1e-11);
                }
            }
        }
    }
}
