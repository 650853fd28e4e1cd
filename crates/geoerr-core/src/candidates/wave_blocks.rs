//! What is not white in the information of waves: from their sums by block of the noise, for all harmonics at once.

use std::ops::Range;

use rayon::prelude::*;

use super::lanes;
use super::moments::Moments;
use super::scene::Scene;
use super::wave_sums::{LANES, Turning, set_sums_of_waves};
use super::waves::Family;
use crate::least_squares::Real;

/// Harmonics of one step: their sums over all blocks stay in the cache.
const HARMONICS: usize = 32 * LANES;

/// Cosine and cosine, cosine and sine, sine and cosine, sine and sine of two channels at one harmonic.
pub(super) type OfKinds = [f64; 4];

/// What channels add to the sums of blocks on one component.
struct OfComponent<T> {
    c: usize,
    channels: Vec<usize>,
    /// By channel, then moment.
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
    let components: Vec<OfComponent<T>> =
        (0..3).map(|c| OfComponent::new(scene, &moments, channels, c)).collect();
    let places: Vec<Turning> =
        moments.first_rows().iter().map(|&row| Turning::new(family.turns[row])).collect();
    let firsts: Vec<usize> = harmonics.clone().step_by(HARMONICS).collect();
    let steps: Vec<Vec<Vec<OfKinds>>> = (firsts.par_iter())
        .map(|&first| {
            let n = (harmonics.end - first).min(HARMONICS).next_multiple_of(LANES);
            let sums = sums_by_block(scene, &places, &moments, &components, first, 2 * n);
            let mut products = vec![vec![T::default(); 4 * n]; together.len()];
            for (own, sums) in components.iter().zip(&sums) {
                own.add_products(&mut products, scene, sums, together, n);
            }
            let of_kinds = |own: &Vec<T>, at: usize| [0, 1, 2, 3].map(|kinds| own[kinds * n + at].double());
            products.iter().map(|own| (0..n).map(|at| of_kinds(own, at)).collect()).collect()
        })
        .collect();
    (0..together.len())
        .map(|place| {
            let all = steps.iter().flat_map(|of_step| &of_step[place]).copied();
            all.take(harmonics.len()).collect()
        })
        .collect()
}

/// By component: block after block, channel after channel, cosines of so many harmonics and then sines.
fn sums_by_block<T: Real>(
    scene: &Scene<T>,
    places: &[Turning],
    moments: &Moments,
    components: &[OfComponent<T>],
    first: usize,
    n: usize,
) -> Vec<Vec<T>> {
    let mut sums: Vec<Vec<T>> = (components.iter())
        .map(|own| vec![T::default(); scene.noise.n_blocks() * own.channels.len() * n])
        .collect();
    let n_columns: usize = components.iter().map(|own| own.channels.len()).sum();
    let mut of_run = vec![T::default(); n_columns * n];
    let (mut waves, mut weights) = (Vec::new(), Vec::new());
    for run in &moments.runs {
        weights.clear();
        for of_channel in components.iter().flat_map(|own| own.weights.chunks_exact(moments.len())) {
            weights.extend_from_slice(&of_channel[run.start..run.end]);
        }
        set_sums_of_waves(&mut of_run, &weights, &places[run.start..run.end], first, &mut waves);
        let mut rest = &of_run[..];
        for (own, sums) in components.iter().zip(&mut sums) {
            let (of_component, later) = rest.split_at(own.channels.len() * n);
            let sums = &mut sums[run.block * of_component.len()..][..of_component.len()];
            sums.iter_mut().zip(of_component).for_each(|(sum, &value)| *sum += value);
            rest = later;
        }
    }
    sums
}

impl<T: Real> OfComponent<T> {
    fn new(scene: &Scene<T>, moments: &Moments, channels: &[usize], c: usize) -> Self {
        let acts = |&channel: &usize| scene.components(channel).any(|one| one == c);
        let channels: Vec<usize> = channels.iter().copied().filter(acts).collect();
        let of_channel = |&channel: &usize| scene.unit(channel, c, moments, 0..moments.len());
        let weights = channels.iter().flat_map(of_channel).collect();
        Self { c, channels, weights }
    }

    /// Multiplies sums by block with each other, for n harmonics.
    fn add_products(
        &self,
        products: &mut [Vec<T>],
        scene: &Scene<T>,
        sums: &[T],
        together: &[[usize; 2]],
        n: usize,
    ) {
        let size = 2 * n * self.channels.len();
        if size == 0 {
            return;
        }
        let beyond = scene.noise.inverse_less_one(self.c, sums, size);
        for (&two_channels, products) in together.iter().zip(products) {
            let [Ok(one), Ok(two)] = two_channels.map(|channel| self.channels.binary_search(&channel)) else {
                continue;
            };
            for (sums, beyond) in sums.chunks_exact(size).zip(beyond.chunks_exact(size)) {
                let (sums, beyond) = (&sums[one * 2 * n..], &beyond[two * 2 * n..]);
                for (kinds, target) in products.chunks_exact_mut(n).enumerate() {
                    lanes::add_products(target, &sums[kinds / 2 * n..][..n], &beyond[kinds % 2 * n..][..n]);
                }
            }
        }
    }
}
