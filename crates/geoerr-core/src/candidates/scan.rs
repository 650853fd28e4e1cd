//! A scan: groups cut into tiles, tiles in parallel, results by group.

use rayon::prelude::*;

use super::error::CandidateError;
use super::group::Group;
use super::judge::Judged;
use super::scene::Scene;
use super::sources::{Numbering, Sources};
use super::tile::{Piece, judged};
use crate::least_squares::Real;

/// Functions on channels of one tile: enough for a product to be worth its operands, few enough to stay in the cache.
const PAIRS: usize = 192;

/// What one group gains.
#[derive(Clone, Debug, PartialEq)]
pub struct Scanned {
    /// Fall of the sum of squares at each trial.
    pub gain: Vec<f64>,
    /// Directions that the model does not own, at each trial.
    pub rank: Vec<usize>,
    /// What the model leaves of the group's best direction, at each trial.
    pub share: Vec<f64>,
    /// By rank, then draw: the largest gain of all trials of that rank; −1 where there is none.
    pub largest: Vec<Vec<f64>>,
}

/// Judges all groups at all their trials.
///
/// The bytes do not depend on the number of threads: tiles are cut by the groups alone.
///
/// # Errors
/// [`CandidateError`] for groups that name what is not there, and for rows that do not fit.
pub fn scan<T: Real>(
    scene: &Scene<T>,
    sources: &Sources<'_>,
    groups: &[Group],
) -> Result<Vec<Scanned>, CandidateError> {
    let numbering = Numbering::of(sources)?;
    for (number, group) in groups.iter().enumerate() {
        group.check(number, numbering.n_functions(), scene.directions.len())?;
    }
    let tiles = tiles_of(groups);
    let found: Vec<Vec<Judged>> = tiles
        .par_iter()
        .map(|pieces| judged(scene, sources, &numbering, groups, pieces))
        .collect::<Result<_, _>>()?;
    let mut scanned: Vec<Scanned> = (groups.iter())
        .map(|group| Scanned {
            gain: vec![0.0; group.n_trials()],
            rank: vec![0; group.n_trials()],
            share: vec![0.0; group.n_trials()],
            largest: vec![Vec::new(); group.n_coefficients + 1],
        })
        .collect();
    for (pieces, judged) in tiles.iter().zip(found) {
        let places =
            pieces.iter().flat_map(|piece| piece.trials.clone().map(move |trial| (piece.group, trial)));
        for ((group, trial), one) in places.zip(judged) {
            let scanned = &mut scanned[group];
            scanned.gain[trial] = one.gain;
            scanned.rank[trial] = one.rank;
            scanned.share[trial] = one.share;
            let largest = &mut scanned.largest[one.rank];
            if largest.is_empty() {
                *largest = one.of_draws;
            } else {
                for (most, value) in largest.iter_mut().zip(one.of_draws) {
                    *most = most.max(value);
                }
            }
        }
    }
    Ok(scanned)
}

/// Cuts the groups into tiles; those that share a channel lie together.
fn tiles_of(groups: &[Group]) -> Vec<Vec<Piece>> {
    let mut order: Vec<usize> = (0..groups.len()).collect();
    order.sort_by_key(|&group| {
        (groups[group].columns.iter().map(|column| column.channel).collect::<Vec<_>>(), group)
    });
    let mut tiles = Vec::new();
    let mut tile: Vec<Piece> = Vec::new();
    let mut n_pairs = 0;
    for group in order {
        let (n_trials, n_columns) = (groups[group].n_trials(), groups[group].columns.len().max(1));
        let mut first = 0;
        while first < n_trials {
            let room = PAIRS.saturating_sub(n_pairs) / n_columns;
            if room == 0 && n_pairs > 0 {
                tiles.push(std::mem::take(&mut tile));
                n_pairs = 0;
                continue;
            }
            let count = room.clamp(1, n_trials - first);
            tile.push(Piece { group, trials: first..first + count });
            first += count;
            n_pairs += count * n_columns;
        }
    }
    if !tile.is_empty() {
        tiles.push(tile);
    }
    tiles
}
