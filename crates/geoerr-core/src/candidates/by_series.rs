//! Sums of a tile of functions that are multiples of series, over all rows.
//!
//! Such a function is `f = s g`: a series, and what carries it. In a block of rows all series are combinations of few
//! columns (see `series`), so `fᵀ X` is a combination of the sums of those few, times the carrier, with X. Carriers of
//! all channels meet the same X, that of a component, in one product. What two functions have in common in white noise
//! is `Σ (s s′)(g g′ w)`, one product of pairs of series with pairs of carriers.

use rayon::prelude::*;

use super::error::CandidateError;
use super::scene::Scene;
use super::series::SeriesBlocks;
use super::series_sums::SeriesSums;
use super::sources::{Multiples, Numbering, Sources};
use super::tile::Tile;
use crate::least_squares::Real;

/// What series are multiplied with: a formula's coefficient on a channel.
pub(super) struct Carrier {
    pub channel: usize,
    /// Place among the tile's multiples.
    pub multiple: usize,
    /// The first of its functions, in the order of carriers.
    pub first: usize,
    /// Place of the series of each of its functions.
    pub series: Vec<usize>,
}

/// What a tile needs.
pub(super) struct Wanted<'a, T> {
    pub scene: &'a Scene<T>,
    pub sources: &'a Sources<'a>,
    pub multiples: Multiples,
    pub carriers: Vec<Carrier>,
    /// Two carriers each, whose functions are asked for together; rising.
    pub of_carriers: Vec<[usize; 2]>,
    /// Two series each, by their numbers; rising.
    pub of_series: Vec<[usize; 2]>,
    /// By pair of the tile: its place in the order of carriers.
    places: Vec<usize>,
    /// By wanted of the tile: places among the carriers and series that are asked for together.
    asked: Vec<[usize; 2]>,
}

/// Sums everything that a tile needs: in parts, each by whichever thread is free.
pub(super) fn sum<T: Real>(
    tile: &mut Tile<'_, T>,
    sources: &Sources<'_>,
    numbering: &Numbering,
    series: &SeriesBlocks<T>,
    most_parts: usize,
) -> Result<(), CandidateError> {
    tile.lay_out_levels();
    let wanted = Wanted::of(tile, sources, numbering, series);
    let size = series.blocks().len().div_ceil(most_parts.max(1)).max(1);
    let parts: Vec<SeriesSums<T>> = (series.blocks().par_chunks(size))
        .map(|blocks| SeriesSums::over(&wanted, blocks))
        .collect::<Result<_, _>>()?;
    for part in parts {
        wanted.add_to(tile, &part);
    }
    Ok(())
}

impl<'a, T: Real> Wanted<'a, T> {
    fn of(
        tile: &Tile<'a, T>,
        sources: &'a Sources<'a>,
        numbering: &Numbering,
        series: &SeriesBlocks<T>,
    ) -> Self {
        let multiples = Multiples::of(sources, numbering, &tile.functions);
        // By channel, then multiple.
        let mut order: Vec<(usize, usize, usize, usize)> = (tile.pairs.iter().enumerate())
            .filter_map(|(pair, own)| {
                let (multiple, number) = multiples.of_function[own.function]?;
                Some((own.channel, multiple, number, pair))
            })
            .collect();
        order.sort_unstable();
        let mut carriers: Vec<Carrier> = Vec::new();
        let (mut places, mut carried) = (vec![0; tile.pairs.len()], vec![(0, 0); tile.pairs.len()]);
        for (first, &(channel, multiple, number, pair)) in order.iter().enumerate() {
            if carriers.last().is_none_or(|last| (last.channel, last.multiple) != (channel, multiple)) {
                carriers.push(Carrier { channel, multiple, first, series: Vec::new() });
            }
            places[pair] = first;
            carried[pair] = (carriers.len() - 1, number);
            if let (Some(last), Some(place)) = (carriers.last_mut(), series.place(number)) {
                last.series.push(place);
            }
        }
        // Whose series is whose does not matter: all four are multiplied.
        let two = |&[p, q]: &[usize; 2]| {
            let [(a, s), (b, t)] = [carried[p], carried[q]];
            ([a.min(b), a.max(b)], [s.min(t), s.max(t)])
        };
        let (mut of_carriers, mut of_series): (Vec<_>, Vec<_>) = tile.wanted.iter().map(two).unzip();
        for list in [&mut of_carriers, &mut of_series] {
            list.sort_unstable();
            list.dedup();
        }
        let place = |list: &[[usize; 2]], own: [usize; 2]| list.partition_point(|&one| one < own);
        let asked = (tile.wanted.iter().map(two))
            .map(|(carriers, series)| [place(&of_carriers, carriers), place(&of_series, series)])
            .collect();
        Self { scene: tile.scene, sources, multiples, carriers, of_carriers, of_series, places, asked }
    }

    /// Adds sums, in the order of carriers, to those of the tile.
    fn add_to(&self, tile: &mut Tile<'_, T>, sums: &SeriesSums<T>) {
        let (width, n_blocks) = (self.scene.width(), self.scene.noise.n_blocks());
        let totals = &mut tile.totals;
        let by_pair = |target: &mut [T], from: &[T], size: usize| {
            for (target, &place) in target.chunks_exact_mut(size.max(1)).zip(&self.places) {
                let from = from[place * size..][..size].iter();
                target.iter_mut().zip(from).for_each(|(sum, value)| *sum += *value);
            }
        };
        by_pair(&mut totals.products, &sums.products, width);
        for (level, own) in totals.level.iter_mut().zip(&sums.level).filter(|(level, _)| !level.is_empty()) {
            by_pair(level, own, n_blocks);
        }
        for (sum, &[carriers, series]) in totals.information.iter_mut().zip(&self.asked) {
            *sum += sums.white[carriers * self.of_series.len() + series];
        }
    }
}
