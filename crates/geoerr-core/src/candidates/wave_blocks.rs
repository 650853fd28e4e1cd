//! What is not white in the information of waves: from their sums by block of the noise, for all harmonics at once.

use std::ops::Range;

use rayon::prelude::*;

use super::lanes;
use super::moments::Moments;
use super::scene::Scene;
use super::waves::{Family, LANES, set_waves};
use crate::arithmetic::in_wide_registers;
use crate::least_squares::Real;

/// Harmonics of one step: their sums over all blocks stay in the cache.
const HARMONICS: usize = 16 * LANES;

/// Cosine and cosine, cosine and sine, sine and cosine, sine and sine of two channels at one harmonic.
pub(super) type OfKinds = [f64; 4];

/// What one component of a channel adds to the sums of blocks, moment by moment.
struct Unit<T> {
    channel: usize,
    c: usize,
    weights: Vec<T>,
}

/// Gives, for two channels that are used together each, what is not white at every harmonic of a range.
pub(super) fn beyond_white<T: Real>(
    scene: &Scene<T>,
    family: &Family,
    channels: &[usize],
    together: &[[usize; 2]],
    harmonics: Range<usize>,
) -> Vec<Vec<OfKinds>> {
    let moments = Moments::of_column(&family.turns, &scene.runs);
    let units: Vec<Unit<T>> = (channels.iter())
        .flat_map(|&channel| scene.components(channel).map(move |c| (channel, c)))
        .map(|(channel, c)| {
            let weights = scene.unit(channel, c, &moments, 0..moments.len());
            Unit { channel, c, weights }
        })
        .collect();
    let firsts: Vec<usize> = harmonics.clone().step_by(HARMONICS).collect();
    let steps: Vec<Vec<Vec<OfKinds>>> = (firsts.par_iter())
        .map(|&first| {
            let n = (harmonics.end - first).min(HARMONICS).next_multiple_of(LANES);
            let sums = sums_by_block(scene, family, &moments, &units, first, 2 * n);
            of_step(scene, &units, &sums, together, n)
        })
        .collect();
    (0..together.len())
        .map(|place| {
            let all = steps.iter().flat_map(|of_step| &of_step[place]).copied();
            all.take(harmonics.len()).collect()
        })
        .collect()
}

/// By unit: block after block, cosines of so many harmonics and then sines.
fn sums_by_block<T: Real>(
    scene: &Scene<T>,
    family: &Family,
    moments: &Moments,
    units: &[Unit<T>],
    first: usize,
    n: usize,
) -> Vec<Vec<T>> {
    let mut sums: Vec<Vec<T>> = units.iter().map(|_| vec![T::default(); scene.noise.n_blocks * n]).collect();
    let mut values = vec![T::default(); n];
    in_wide_registers(
        #[inline(always)]
        || {
            for (moment, &row) in moments.first_rows().iter().enumerate() {
                let turn = family.turns[row];
                if !turn.is_finite() {
                    continue;
                }
                set_waves(&mut values, turn, first);
                for (unit, sums) in units.iter().zip(&mut sums) {
                    let sum = &mut sums[scene.noise.block[row] * n..][..n];
                    lanes::add_scaled_here(sum, unit.weights[moment], &values);
                }
            }
        },
    );
    sums
}

/// Multiplies sums by block with each other, for n harmonics.
fn of_step<T: Real>(
    scene: &Scene<T>,
    units: &[Unit<T>],
    sums: &[Vec<T>],
    together: &[[usize; 2]],
    n: usize,
) -> Vec<Vec<OfKinds>> {
    let mut products = vec![vec![T::default(); 4 * n]; together.len()];
    for (unit, own) in units.iter().zip(sums) {
        let beyond = scene.beyond_white(unit.c, own, 2 * n);
        for (other, sums) in units.iter().zip(sums).filter(|(other, _)| other.c == unit.c) {
            let Ok(place) = together.binary_search(&[other.channel, unit.channel]) else { continue };
            for (one, two) in sums.chunks_exact(2 * n).zip(beyond.chunks_exact(2 * n)) {
                for (kinds, target) in products[place].chunks_exact_mut(n).enumerate() {
                    lanes::add_products(target, &one[kinds / 2 * n..][..n], &two[kinds % 2 * n..][..n]);
                }
            }
        }
    }
    (products.iter())
        .map(|own| (0..n).map(|at| [0, 1, 2, 3].map(|kinds| own[kinds * n + at].double())).collect())
        .collect()
}
