//! Sums of a tile of waves along one variable: looked up among those at all harmonics, made at once.

use geoerr_fourier::Transformed;
use rayon::prelude::*;

use super::group::Group;
use super::moments::Moments;
use super::scene::Scene;
use super::sources::{Numbering, Source};
use super::spectrum::Spectrum;
use super::tile::{Pair, Piece, Tile, used_channels};
use super::wave_blocks::{OfKinds, beyond_white};
use super::waves::{Family, Kind, Wave};
use crate::least_squares::Real;

/// A wave of which the rows see a smaller share than this, squared, is not measured: its sums are differences of larger
/// ones, which are rounded.
const LEAST_SEEN: f64 = 1e-3;

/// What waves of one family sum up to, at all their harmonics.
pub(super) struct WaveOperands<T> {
    /// Harmonics that are used, rising.
    harmonics: Vec<usize>,
    /// Channels that are used, rising.
    channels: Vec<(usize, OfChannel<T>)>,
    /// Two channels that are used together, rising; by harmonic their information.
    together: Vec<([usize; 2], Vec<OfKinds>)>,
}

/// Sums on one channel.
struct OfChannel<T> {
    /// By harmonic: cosine's and sine's products with basis, residual and draws.
    products: Vec<T>,
    /// By harmonic: whether the rows see a cosine and a sine.
    is_seen: Vec<[bool; 2]>,
}

impl<T: Real + Transformed> WaveOperands<T> {
    /// Transforms what the pieces' channels are multiplied with.
    pub(super) fn new(
        scene: &Scene<T>,
        family: &Family,
        harmonics: Vec<usize>,
        groups: &[Group],
        pieces: &[&Piece],
    ) -> Self {
        let (channels, pairs) = used_channels(groups, pieces);
        let spectrum = Spectrum::new(&family.turns, family.highest);
        let white = white(scene, family, &harmonics, &pairs);
        let of_channels = (channels.par_iter())
            .map(|&channel| {
                let products = spectrum.sums(scene.width(), &harmonics, &scene.terms(channel));
                let own = white.iter().find(|one| one.0 == [channel; 2]);
                let is_seen = own.map_or(Vec::new(), |(_, squares)| squares.iter().map(seen).collect());
                (channel, OfChannel { products, is_seen })
            })
            .collect();
        let together = with_blocks(scene, family, &harmonics, &channels, white);
        Self { harmonics, channels: of_channels, together }
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
        let mut is_seen = vec![false; tile.pairs.len()];
        for (pair, is_seen) in is_seen.iter_mut().enumerate() {
            let Pair { channel, function } = tile.pairs[pair];
            let (harmonic, kind) = places[function];
            let (_, own) = &self.channels[self.channels.partition_point(|one| one.0 < channel)];
            *is_seen = own.is_seen.get(harmonic).is_some_and(|kinds| kinds[kind]);
            if *is_seen {
                let products = &own.products[(2 * harmonic + kind) * width..][..width];
                tile.totals.products[pair * width..][..width].copy_from_slice(products);
            }
        }
        for (&wanted, sum) in tile.wanted.iter().zip(&mut tile.totals.information) {
            if !wanted.iter().all(|&pair| is_seen[pair]) {
                continue;
            }
            let [f, g] = wanted.map(|pair| tile.pairs[pair]);
            let channels = [f.channel, g.channel];
            let place = self.together.partition_point(|one| one.0 < channels);
            if let Some((own, information)) = self.together.get(place)
                && *own == channels
            {
                let [(harmonic, one), (_, two)] = [f, g].map(|pair| places[pair.function]);
                *sum = information[harmonic][2 * one + two];
            }
        }
    }
}

/// Whether the rows see a cosine and a sine, by their squares in white noise.
fn seen(squares: &OfKinds) -> [bool; 2] {
    let all = (squares[0] + squares[3]).max(f64::MIN_POSITIVE);
    [squares[0], squares[3]].map(|square| square / all > LEAST_SEEN)
}

/// The information of waves of two channels each in white noise, `Σ f g Σ_c d e / σ_c²`, from the sums of the weights at
/// twice the frequency; nothing of channels that share no component.
fn white<T: Real + Transformed>(
    scene: &Scene<T>,
    family: &Family,
    harmonics: &[usize],
    pairs: &[[usize; 2]],
) -> Vec<([usize; 2], Vec<OfKinds>)> {
    let rows = Moments::of_rows(&scene.runs);
    let doubled = Spectrum::new(&family.turns, 2 * family.highest);
    let twice: Vec<usize> = harmonics.iter().map(|harmonic| 2 * harmonic).collect();
    let weighted: Vec<([usize; 2], Vec<T>)> = (pairs.iter())
        .filter_map(|&[one, two]| Some(([one, two], scene.weights(one, two, &rows, 0..rows.len())?)))
        .collect();
    let by_row: Vec<T> =
        (0..rows.len()).flat_map(|row| weighted.iter().map(move |(_, weights)| weights[row])).collect();
    let ones = vec![T::nearest(1.0); rows.len()];
    let sums = doubled.sums(weighted.len(), &twice, &[(&ones, &by_row)]);
    (weighted.iter().enumerate())
        .map(|(place, (pair, weights))| {
            let known = weights.iter().zip(&family.turns).filter(|(_, turn)| turn.is_finite());
            let all: f64 = known.map(|(weight, _)| weight.double()).sum();
            let of_kinds = |of_harmonic: &[T]| {
                let (cosine, sine) = (of_harmonic[place], of_harmonic[weighted.len() + place]);
                let (cosine, sine) = (cosine.double(), sine.double());
                [0.5 * (all + cosine), 0.5 * sine, 0.5 * sine, 0.5 * (all - cosine)]
            };
            (*pair, sums.chunks_exact(2 * weighted.len()).map(of_kinds).collect())
        })
        .collect()
}

/// The same in the noise as it is.
fn with_blocks<T: Real>(
    scene: &Scene<T>,
    family: &Family,
    harmonics: &[usize],
    channels: &[usize],
    mut white: Vec<([usize; 2], Vec<OfKinds>)>,
) -> Vec<([usize; 2], Vec<OfKinds>)> {
    let (Some(&first), Some(&last)) = (harmonics.first(), harmonics.last()) else { return white };
    let together: Vec<[usize; 2]> = white.iter().map(|one| one.0).collect();
    let beyond = beyond_white(scene, family, channels, &together, first..last + 1);
    for ((_, information), beyond) in white.iter_mut().zip(beyond) {
        for (&harmonic, information) in harmonics.iter().zip(information) {
            for (sum, more) in information.iter_mut().zip(beyond[harmonic - first]) {
                *sum += more;
            }
        }
    }
    white
}
