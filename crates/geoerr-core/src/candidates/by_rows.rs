//! Sums of a tile over all rows, or over moments, a block of them at a time.

use std::ops::Range;

use rayon::prelude::*;

use super::error::CandidateError;
use super::lanes;
use super::moments::Moments;
use super::scene::{Run, runs_within};
use super::sources::{Evaluator, Numbering, Scratch, Sources};
use super::tile::{Pair, Tile, Totals};
use crate::least_squares::{Real, add_product_of_rows};

/// Fewer moments than these are no part.
const LEAST_OF_PART: usize = 2048;
/// Moments of one step: a block of each operand stays in the cache.
const MOMENTS: usize = 256;
/// Runs of moments of one step up to which their sums are one product, of which most factors are 0.
const MOST_RUNS: usize = 32;
/// Pieces of columns of so many pairs on average are multiplied piece by piece; shorter ones cost more than a copy.
const PAIRS_OF_PIECE: usize = 32;

/// Sums everything that a tile needs over moments, each of which is a row of the sources: in parts, each by whichever
/// thread is free, where there are many moments.
pub(super) fn sum<T: Real>(
    tile: &mut Tile<'_, T>,
    sources: &Sources<'_>,
    numbering: &Numbering,
    moments: &Moments,
    most_parts: usize,
) -> Result<(), CandidateError> {
    tile.lay_out_levels();
    let evaluator = Evaluator::new(sources, numbering, &tile.functions)?;
    let wanted = Wanted { tile, evaluator, asked: Asked::of(tile), channels: tile.channels(), moments };
    let parts: Vec<Totals<T>> = (parts_of(moments.len(), most_parts).into_par_iter())
        .map(|part| wanted.summed_over(part))
        .collect::<Result<_, _>>()?;
    for part in parts {
        tile.totals.add(&part);
    }
    Ok(())
}

/// Parts of so many moments, of whole steps but for the last.
fn parts_of(n: usize, most: usize) -> Vec<Range<usize>> {
    let parts = (n / LEAST_OF_PART).clamp(1, most.max(1));
    let size = n.div_ceil(parts).max(1).next_multiple_of(MOMENTS);
    (0..n).step_by(size).map(|start| start..(start + size).min(n)).collect()
}

/// What a tile needs of moments.
struct Wanted<'a, T> {
    tile: &'a Tile<'a, T>,
    evaluator: Evaluator<'a, T>,
    asked: Asked,
    /// As `Tile::channels` gives them.
    channels: Vec<(usize, usize, usize)>,
    moments: &'a Moments,
}

impl<T: Real> Wanted<'_, T> {
    /// The sums over some moments.
    fn summed_over(&self, part: Range<usize>) -> Result<Totals<T>, CandidateError> {
        let Self { tile, evaluator, asked, channels, moments } = self;
        let scene = tile.scene;
        let (width, n_blocks) = (scene.width(), scene.noise.n_blocks());
        let mut totals = tile.totals.zeros_like();
        let mut scratch = Scratch::default();
        let (mut columns, mut copied, mut right, mut weights) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let (mut spread, mut of_runs) = (Vec::new(), Vec::new());
        for start in part.clone().step_by(MOMENTS) {
            let here = start..(start + MOMENTS).min(part.end);
            let n = here.len();
            evaluator.set(&mut columns, &mut scratch, here.clone())?;
            let runs = runs_within(&moments.runs, &here);
            for &(channel, first, m) in channels {
                let own = &tile.pairs[first..first + m];
                scene.set_operand(&mut right, channel, moments, here.clone());
                let units: Vec<(usize, Vec<T>)> = (scene.components(channel))
                    .map(|c| (c, scene.unit(channel, c, moments, here.clone())))
                    .collect();
                for (place, left) in side_by_side(own, &columns, n, &mut copied) {
                    let (at, m) = (first + place, left.len() / n);
                    add_product_of_rows(&mut totals.products[at * width..(at + m) * width], left, &right, n);
                    for (c, unit) in &units {
                        let sums =
                            totals.level[*c][at * n_blocks..(at + m) * n_blocks].chunks_exact_mut(n_blocks);
                        if runs.len() > MOST_RUNS {
                            for (column, sums) in left.chunks_exact(n).zip(sums) {
                                lanes::add_by_run(sums, column, unit, &runs);
                            }
                            continue;
                        }
                        set_spread(&mut spread, unit, &runs);
                        of_runs.clear();
                        of_runs.resize(m * runs.len(), T::default());
                        add_product_of_rows(&mut of_runs, left, &spread, n);
                        for (sums, of_runs) in sums.zip(of_runs.chunks_exact(runs.len())) {
                            for (run, &sum) in runs.iter().zip(of_runs) {
                                sums[run.block] += sum;
                            }
                        }
                    }
                }
            }
            weights.clear();
            for &[one, two] in &asked.channels {
                match scene.weights(one, two, moments, here.clone()) {
                    Some(own) => weights.extend(own),
                    None => weights.resize(weights.len() + n, T::default()),
                }
            }
            lanes::add_weighted(&mut totals.information, &asked.columns, &columns, &weights, n);
        }
        Ok(totals)
    }
}

/// The columns of pairs of one channel as they lie one after the other, with the place of the first; copied where that
/// would be in many pieces.
fn side_by_side<'a, T: Copy>(
    own: &[Pair],
    columns: &'a [T],
    n: usize,
    copied: &'a mut Vec<T>,
) -> Vec<(usize, &'a [T])> {
    let mut place = 0;
    let pieces: Vec<(usize, &[T])> = (own.chunk_by(|a, b| a.function + 1 == b.function))
        .map(|piece| {
            place += piece.len();
            (place - piece.len(), &columns[piece[0].function * n..][..piece.len() * n])
        })
        .collect();
    if pieces.len() * PAIRS_OF_PIECE <= own.len() {
        return pieces;
    }
    copied.clear();
    pieces.iter().for_each(|(_, piece)| copied.extend_from_slice(piece));
    vec![(0, copied)]
}

/// What is asked for in `wanted`.
struct Asked {
    /// Two channels each.
    channels: Vec<[usize; 2]>,
    /// By wanted: two functions, and the place of their channels.
    columns: Vec<[usize; 3]>,
}

impl Asked {
    fn of<T: Real>(tile: &Tile<'_, T>) -> Self {
        let of = |&[a, b]: &[usize; 2]| [tile.pairs[a].channel, tile.pairs[b].channel];
        let mut channels: Vec<[usize; 2]> = tile.wanted.iter().map(of).collect();
        channels.sort_unstable();
        channels.dedup();
        let columns = (tile.wanted.iter())
            .map(|wanted| {
                let of_channels = of(wanted);
                let [f, g] = wanted.map(|pair| tile.pairs[pair].function);
                [f, g, channels.partition_point(|&one| one < of_channels)]
            })
            .collect();
        Self { channels, columns }
    }
}

/// Moment after moment: what it gives to its run, and 0 for the others.
fn set_spread<T: Real>(spread: &mut Vec<T>, unit: &[T], runs: &[Run]) {
    spread.clear();
    spread.resize(unit.len() * runs.len(), T::default());
    for (number, run) in runs.iter().enumerate() {
        for at in run.start..run.end {
            spread[at * runs.len() + number] = unit[at];
        }
    }
}
