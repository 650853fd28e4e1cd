//! Sums of a tile of waves along one variable: products from a spectrum, the rest row by row.

use rayon::prelude::*;
use rustfft::FftNum;

use super::group::Group;
use super::lanes;
use super::moments::Moments;
use super::scene::Scene;
use super::sources::{Numbering, Source};
use super::spectrum::Spectrum;
use super::tile::{Pair, Piece, Tile, used_channels};
use super::waves::{Family, Kind, LANES, Wave, set_waves};
use crate::arithmetic::in_wide_registers;
use crate::least_squares::Real;

/// A wave of which the rows see a smaller share than this, squared, is not measured: its sums are differences of larger
/// ones, which are rounded.
const LEAST_SEEN: f64 = 1e-3;

/// What waves of one family are multiplied with, summed at all their harmonics.
pub(super) struct WaveOperands<'a, T> {
    family: &'a Family,
    /// Rows of one place.
    moments: Moments,
    /// Harmonics that are used, rising.
    harmonics: Vec<usize>,
    /// Channels that are used, rising; by harmonic: cosine's and sine's products with basis, residual and draws.
    channels: Vec<(usize, Vec<T>)>,
    /// Two channels that are used together, rising; by harmonic: cosine's and sine's sums of the weights at twice the
    /// frequency, and at the end those of the weights themselves.
    together: Vec<([usize; 2], Vec<f64>)>,
}

impl<'a, T: Real + FftNum> WaveOperands<'a, T> {
    /// Transforms what the pieces' channels are multiplied with.
    pub(super) fn new(
        scene: &Scene<T>,
        family: &'a Family,
        harmonics: Vec<usize>,
        groups: &[Group],
        pieces: &[&Piece],
    ) -> Self {
        let (channels, together) = used_channels(groups, pieces);
        let rows = Moments::of_rows(&scene.runs);
        let spectrum = Spectrum::new(&family.turns, family.highest);
        let doubled = Spectrum::new(&family.turns, 2 * family.highest);
        let twice: Vec<usize> = harmonics.iter().map(|harmonic| 2 * harmonic).collect();
        let channels = (channels.into_par_iter())
            .map(|channel| {
                let products =
                    spectrum.sums(scene.width(), &harmonics, |own, row| scene.add_operand(own, channel, row));
                (channel, products)
            })
            .collect();
        let together = (together.into_par_iter())
            .filter_map(|[one, two]| {
                let weights = scene.weights(one, two, &rows, 0..rows.len())?;
                let mut sums: Vec<f64> = (doubled.sums(1, &twice, |own, row| own[0] += weights[row]).iter())
                    .map(|sum: &T| sum.double())
                    .collect();
                let known = weights.iter().zip(&family.turns).filter(|(_, turn)| turn.is_finite());
                sums.push(known.map(|(weight, _)| weight.double()).sum());
                Some(([one, two], sums))
            })
            .collect();
        let moments = Moments::of_column(&family.turns, &scene.runs);
        Self { family, moments, harmonics, channels, together }
    }

    /// Sums everything that a tile needs.
    pub(super) fn sum(&self, tile: &mut Tile<'_, T>, numbering: &Numbering, wave_of: &[Option<Wave>]) {
        let width = tile.scene.width();
        // By function: place among the harmonics, and 0 for a cosine, 1 for a sine.
        let places: Vec<(usize, usize)> = (tile.functions.iter())
            .filter_map(|&function| match numbering.source(function) {
                Source::Formula(formula, slot) => wave_of[formula].as_ref().map(|wave| {
                    let place = self.harmonics.partition_point(|&one| one < wave.harmonic);
                    (place, usize::from(wave.kinds[slot] == Kind::Sine))
                }),
                _ => None,
            })
            .collect();
        let is_seen: Vec<bool> = (tile.pairs.iter())
            .map(|pair| self.share_seen(pair.channel, places[pair.function]) > LEAST_SEEN)
            .collect();
        for pair in (0..tile.pairs.len()).filter(|&pair| is_seen[pair]) {
            let Pair { channel, function } = tile.pairs[pair];
            let (harmonic, kind) = places[function];
            let channel = self.channels.partition_point(|one| one.0 < channel);
            let products = &self.channels[channel].1[(2 * harmonic + kind) * width..][..width];
            tile.products[pair * width..][..width].copy_from_slice(products);
        }
        for (&wanted, sum) in tile.wanted.iter().zip(&mut tile.white) {
            if !wanted.iter().all(|&pair| is_seen[pair]) {
                continue;
            }
            let [f, g] = wanted.map(|pair| tile.pairs[pair]);
            let together = self.together.partition_point(|one| one.0 < [f.channel, g.channel]);
            if let Some((own, sums)) = self.together.get(together)
                && *own == [f.channel, g.channel]
            {
                let [(harmonic, one), (_, two)] = [f, g].map(|pair| places[pair.function]);
                let (cosine, sine) = (sums[2 * harmonic], sums[2 * harmonic + 1]);
                let all = sums[sums.len() - 1];
                *sum = match one + two {
                    0 => 0.5 * (all + cosine),
                    1 => 0.5 * sine,
                    _ => 0.5 * (all - cosine),
                };
            }
        }
        self.sum_blocks(tile, &places, &is_seen);
    }

    /// The mean square of a wave over the rows, by their weights on a channel.
    fn share_seen(&self, channel: usize, (harmonic, kind): (usize, usize)) -> f64 {
        let place = self.together.partition_point(|one| one.0 < [channel; 2]);
        let Some((_, sums)) = self.together.get(place).filter(|one| one.0 == [channel; 2]) else {
            return 0.0;
        };
        let relative = sums[2 * harmonic] / sums[sums.len() - 1].max(f64::MIN_POSITIVE);
        if kind == 0 { 0.5 * (1.0 + relative) } else { 0.5 * (1.0 - relative) }
    }

    /// Sums by block of the noise, for all functions at once.
    fn sum_blocks(&self, tile: &mut Tile<'_, T>, places: &[(usize, usize)], is_seen: &[bool]) {
        let scene = tile.scene;
        let n_blocks = scene.noise.n_blocks;
        let mut own: Vec<usize> = places.iter().map(|place| place.0).collect();
        own.sort_unstable();
        own.dedup();
        let mut harmonics: Vec<f64> = own.iter().map(|&place| self.harmonics[place] as f64).collect();
        harmonics.resize(harmonics.len().next_multiple_of(LANES), 0.0);
        let n = 2 * harmonics.len();
        // Place of each function among the values of a row.
        let at: Vec<usize> = (places.iter())
            .map(|&(place, kind)| kind * harmonics.len() + own.partition_point(|&one| one < place))
            .collect();
        let channels = tile.channels();
        let units: Vec<(usize, usize, Vec<T>)> = (channels.iter().enumerate())
            .flat_map(|(number, &(channel, _, _))| {
                let moments = &self.moments;
                (scene.components(channel))
                    .map(move |c| (number, c, scene.unit(channel, c, moments, 0..moments.len())))
            })
            .collect();
        let mut sums = vec![T::default(); units.len() * n_blocks * n];
        let mut values = vec![T::default(); n];
        in_wide_registers(
            #[inline(always)]
            || {
                for (moment, &row) in self.moments.first_rows().iter().enumerate() {
                    let turn = self.family.turns[row];
                    if !turn.is_finite() {
                        continue;
                    }
                    set_waves(&mut values, turn, &harmonics);
                    for (number, (_, _, unit)) in units.iter().enumerate() {
                        let sum = &mut sums[(number * n_blocks + scene.noise.block[row]) * n..][..n];
                        lanes::add_scaled_here(sum, unit[moment], &values);
                    }
                }
            },
        );
        let mut across = Vec::new();
        for ((number, c, _), sums) in units.iter().zip(sums.chunks_exact(n_blocks * n)) {
            let (_, first, m) = channels[*number];
            lanes::transpose(&mut across, sums, n);
            for pair in (first..first + m).filter(|&pair| is_seen[pair]) {
                let own = &across[at[tile.pairs[pair].function] * n_blocks..][..n_blocks];
                tile.level[*c][pair * n_blocks..][..n_blocks].copy_from_slice(own);
            }
        }
    }
}
