//! A scan: groups cut into tiles, tiles in parallel, results by group.

use std::collections::HashSet;

use geoerr_fourier::Transformed;
use rayon::prelude::*;

use super::by_nodes::NodeOperands;
use super::by_rows;
use super::by_series;
use super::by_waves::WaveOperands;
use super::error::CandidateError;
use super::group::Group;
use super::judge::Judged;
use super::moments::{AtMoments, Moments};
use super::nodes::lattices;
use super::scene::Scene;
use super::series::SeriesBlocks;
use super::sources::{Numbering, Source, Sources};
use super::tile::{Piece, Tile};
use super::waves::{Wave, families};
use crate::least_squares::Real;

/// Functions on channels of one tile: so many that groups which share them seldom sum the same again (a bow about some
/// centre is tried with every temperature and every difference of two), and few enough for every thread to have tiles to
/// the end.
const PAIRS: usize = 512;
/// Parts that sums over rows should have, of all tiles together: a single candidate is one tile. The same for any number
/// of threads, for the sake of the same bytes.
const PARTS: usize = 8;
/// Coarser numbers than these only rank, and need no more digits than nodes give.
const RANKING: f64 = 1e-10;

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
/// In single precision, what is to be ranked, waves of one variable are summed at all frequencies together (see `waves`),
/// other functions of one variable are taken at few nodes (see `nodes`), and multiples of series are combinations of few
/// (see `series`). The bytes do not depend on the number of
/// threads: tiles are cut by the groups alone.
///
/// # Errors
/// [`CandidateError`] for groups that name what is not there, and for rows that do not fit.
pub fn scan<T: Real + Transformed>(
    scene: &Scene<T>,
    sources: &Sources<'_>,
    groups: &[Group],
) -> Result<Vec<Scanned>, CandidateError> {
    let numbering = Numbering::of(sources)?;
    for (number, group) in groups.iter().enumerate() {
        group.check(number, numbering.n_functions(), scene.directions.len())?;
    }
    let groups = &alike_once(groups, &numbering)[..];
    let is_ranking = T::EPSILON > RANKING;
    let n_formulas = sources.formulas.len();
    let (families, wave_of) =
        if is_ranking { families(sources)? } else { (Vec::new(), vec![None; n_formulas]) };
    let (lattices, lattice_of) = if is_ranking {
        lattices(sources, |formula| wave_of[formula].is_none())?
    } else {
        (Vec::new(), vec![None; n_formulas])
    };
    let rows = Moments::of_rows(&scene.runs);
    let at_moments = AtMoments::new(sources, &scene.runs, groups, &numbering);
    let series: Option<SeriesBlocks<T>> = if is_ranking { SeriesBlocks::new(sources) } else { None };
    let tiles = tiles_of(groups, |functions| {
        let is_of_series = |&function: &usize| numbering.is_multiple_of_series(function, sources);
        if series.is_some() && functions.iter().all(is_of_series) {
            return Place::Series;
        }
        let is_one_wave = of_one_frequency(functions, &numbering, &wave_of);
        let place = |formula: usize| match (&wave_of[formula], lattice_of[formula]) {
            (Some(wave), _) if is_one_wave => Place::Waves(wave.family),
            (None, Some(lattice)) => Place::Nodes(lattice),
            _ => Place::Rows,
        };
        place_of(functions, &numbering, place, at_moments.as_ref())
    });
    let (at_nodes, of_waves): (Vec<NodeOperands<'_, T>>, Vec<WaveOperands<T>>) = rayon::join(
        || {
            let operands = |(number, lattice)| {
                NodeOperands::new(scene, lattice, groups, &pieces_on(&tiles, Place::Nodes(number)))
            };
            lattices.par_iter().enumerate().map(operands).collect()
        },
        || {
            let operands = |(number, family)| {
                let pieces = pieces_on(&tiles, Place::Waves(number));
                WaveOperands::new(scene, family, harmonics_of(number, &wave_of), groups, &pieces)
            };
            families.par_iter().enumerate().map(operands).collect()
        },
    );
    let over_rows = tiles
        .iter()
        .filter(|(place, _)| matches!(place, Place::Rows | Place::Series | Place::Moments))
        .count();
    let parts = PARTS / over_rows.max(1);
    // From one queue: halves of a list, as threads share it otherwise, are not equally long.
    let mut found: Vec<(usize, Vec<Judged>)> = (tiles.iter().enumerate().par_bridge())
        .map(|(number, (place, pieces))| {
            let mut tile = Tile::laid_out(scene, groups, pieces);
            match place {
                Place::Waves(family) => of_waves[*family].sum(&mut tile, &numbering, &wave_of),
                Place::Nodes(lattice) => at_nodes[*lattice].sum(&mut tile, sources, &numbering)?,
                Place::Moments => at_moments.as_ref().map_or(Ok(()), |at| {
                    at.with_sources(|own| by_rows::sum(&mut tile, own, &numbering, &at.moments, parts))
                })?,
                Place::Series => series
                    .as_ref()
                    .map_or(Ok(()), |series| by_series::sum(&mut tile, sources, &numbering, series, parts))?,
                Place::Rows => by_rows::sum(&mut tile, sources, &numbering, &rows, parts)?,
            }
            Ok((number, tile.judged(groups, pieces)))
        })
        .collect::<Result<_, CandidateError>>()?;
    found.sort_unstable_by_key(|one| one.0);
    let mut scanned: Vec<Scanned> = (groups.iter())
        .map(|group| Scanned {
            gain: vec![0.0; group.n_trials()],
            rank: vec![0; group.n_trials()],
            share: vec![0.0; group.n_trials()],
            largest: vec![Vec::new(); group.n_coefficients + 1],
        })
        .collect();
    for ((_, pieces), (_, judged)) in tiles.iter().zip(found) {
        let places = pieces.iter().flat_map(|piece| piece.trials.iter().map(|&trial| (piece.group, trial)));
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

/// Where a trial is summed.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    /// Over all rows: what takes longest comes first, so that no thread waits for it in the end.
    Rows,
    /// Over all rows, as multiples of few columns.
    Series,
    /// Over moments.
    Moments,
    /// At the nodes of a lattice.
    Nodes(usize),
    /// In the spectra of a family of waves.
    Waves(usize),
}

fn pieces_on(tiles: &[(Place, Vec<Piece>)], here: Place) -> Vec<&Piece> {
    tiles.iter().filter(|(place, _)| *place == here).flat_map(|(_, pieces)| pieces).collect()
}

/// Harmonics of a family's waves, rising.
fn harmonics_of(family: usize, wave_of: &[Option<Wave>]) -> Vec<usize> {
    let own = wave_of.iter().flatten().filter(|wave| wave.family == family);
    let mut harmonics: Vec<usize> = own.map(|wave| wave.harmonic).collect();
    harmonics.sort_unstable();
    harmonics.dedup();
    harmonics
}

/// The groups with one number for each function.
fn alike_once(groups: &[Group], numbering: &Numbering) -> Vec<Group> {
    let alike = |group: &Group| group.functions.iter().map(|&one| numbering.first_alike(one)).collect();
    groups.iter().map(|group| Group { functions: alike(group), ..group.clone() }).collect()
}

/// Cuts the groups into tiles; those that share a place and channels lie together, in the order of the groups: forms
/// of one candidate share functions.
fn tiles_of(groups: &[Group], place_of: impl Fn(&[usize]) -> Place) -> Vec<(Place, Vec<Piece>)> {
    let mut order: Vec<(Place, Vec<usize>, usize, Vec<usize>)> = Vec::new();
    for (number, group) in groups.iter().enumerate() {
        let mut channels: Vec<usize> = group.columns.iter().map(|column| column.channel).collect();
        channels.sort_unstable();
        channels.dedup();
        let mut by_place: Vec<(Place, Vec<usize>)> = Vec::new();
        for trial in 0..group.n_trials() {
            let place = place_of(group.trial(trial));
            match by_place.iter_mut().find(|one| one.0 == place) {
                Some(one) => one.1.push(trial),
                None => by_place.push((place, vec![trial])),
            }
        }
        for (place, trials) in by_place {
            order.push((place, channels.clone(), number, trials));
        }
    }
    order.sort();
    let mut tiles: Vec<(Place, Vec<Piece>)> = Vec::new();
    let mut pairs: HashSet<(usize, usize)> = HashSet::new();
    for (place, _, number, trials) in order {
        let group = &groups[number];
        for trial in trials {
            let own =
                || group.columns.iter().map(|column| column.channel).zip(group.trial(trial).iter().copied());
            let n_new = own().filter(|pair| !pairs.contains(pair)).count();
            let is_full = !pairs.is_empty() && pairs.len() + n_new > PAIRS;
            if is_full || tiles.last().is_none_or(|tile| tile.0 != place) {
                tiles.push((place, Vec::new()));
                pairs.clear();
            }
            pairs.extend(own());
            let Some((_, pieces)) = tiles.last_mut() else { continue };
            match pieces.last_mut() {
                Some(piece) if piece.group == number => piece.trials.push(trial),
                _ => pieces.push(Piece { group: number, trials: vec![trial] }),
            }
        }
    }
    tiles
}

/// Whether the waves of a trial have one frequency: products of two are known for such only.
fn of_one_frequency(functions: &[usize], numbering: &Numbering, wave_of: &[Option<Wave>]) -> bool {
    let mut harmonics = functions.iter().filter_map(|&function| match numbering.source(function) {
        Source::Formula(formula, _) => wave_of[formula].as_ref().map(|wave| wave.harmonic),
        _ => None,
    });
    harmonics.next().is_none_or(|first| harmonics.all(|harmonic| harmonic == first))
}

/// Where all functions of a trial can be summed together.
fn place_of(
    functions: &[usize],
    numbering: &Numbering,
    place_of_formula: impl Fn(usize) -> Place,
    at_moments: Option<&AtMoments<'_>>,
) -> Place {
    let mut places = functions.iter().map(|&function| match numbering.source(function) {
        Source::Formula(formula, _) => place_of_formula(formula),
        _ => Place::Rows,
    });
    match places.next() {
        Some(first) if first != Place::Rows && places.all(|place| place == first) => first,
        _ if at_moments.is_some_and(|at| functions.iter().all(|&one| at.has(one, numbering))) => {
            Place::Moments
        }
        _ => Place::Rows,
    }
}
