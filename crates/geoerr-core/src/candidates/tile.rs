//! The sums over rows of some groups: what is multiplied with what, and what becomes of it.

use super::group::Group;
use super::judge::{Judge, Judged, Sums};
use super::lanes;
use super::scene::Scene;
use crate::least_squares::Real;

/// A function on a channel.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Pair {
    pub channel: usize,
    /// Place among the tile's functions.
    pub function: usize,
}

/// Some trials of a group.
pub(super) struct Piece {
    pub group: usize,
    pub trials: Vec<usize>,
}

/// Channels that some pieces use, rising, and those that they use together.
pub(super) fn used_channels(groups: &[Group], pieces: &[&Piece]) -> (Vec<usize>, Vec<[usize; 2]>) {
    let mut channels: Vec<usize> = Vec::new();
    let mut together: Vec<[usize; 2]> = Vec::new();
    for piece in pieces {
        let columns = &groups[piece.group].columns;
        channels.extend(columns.iter().map(|column| column.channel));
        for one in columns {
            together.extend(
                columns.iter().map(|two| [one.channel.min(two.channel), one.channel.max(two.channel)]),
            );
        }
    }
    channels.sort_unstable();
    channels.dedup();
    together.sort_unstable();
    together.dedup();
    (channels, together)
}

/// All that is summed over rows for one tile.
pub(super) struct Tile<'a, T> {
    pub scene: &'a Scene<T>,
    /// Numbers of the functions, rising.
    pub functions: Vec<usize>,
    /// Sorted by channel.
    pub pairs: Vec<Pair>,
    /// Places of two pairs, the first not behind the second, whose information is asked for; sorted.
    pub wanted: Vec<[usize; 2]>,
    pub totals: Totals<T>,
    /// Trial after trial of the pieces, by column: its pair.
    places: Vec<usize>,
}

/// What is summed over rows.
pub(super) struct Totals<T> {
    /// By wanted: `fᵀ V⁻¹ g`, of which `level` gives what is not white.
    pub information: Vec<f64>,
    /// By pair: products with basis, residual and draws.
    pub products: Vec<T>,
    /// By component and pair: sums by block of the noise. Nothing until it is laid out, and where no channel acts.
    pub level: [Vec<T>; 3],
}

impl<T: Real> Totals<T> {
    /// As many sums, all 0.
    pub(super) fn zeros_like(&self) -> Self {
        Self {
            information: vec![0.0; self.information.len()],
            products: vec![T::default(); self.products.len()],
            level: self.level.each_ref().map(|level| vec![T::default(); level.len()]),
        }
    }

    /// Adds the sums over other rows.
    pub(super) fn add(&mut self, other: &Self) {
        self.information.iter_mut().zip(&other.information).for_each(|(sum, part)| *sum += part);
        self.products.iter_mut().zip(&other.products).for_each(|(sum, part)| *sum += *part);
        for (level, other) in self.level.iter_mut().zip(&other.level) {
            level.iter_mut().zip(other).for_each(|(sum, part)| *sum += *part);
        }
    }
}

impl<'a, T: Real> Tile<'a, T> {
    /// Lays out what the pieces need, all sums 0.
    pub(super) fn laid_out(scene: &'a Scene<T>, groups: &[Group], pieces: &[Piece]) -> Self {
        let columns = || {
            pieces.iter().flat_map(|piece| {
                let group = &groups[piece.group];
                (piece.trials.iter())
                    .flat_map(|&trial| group.columns.iter().zip(group.trial(trial)))
                    .map(|(column, &function)| (column.channel, function))
            })
        };
        let mut functions: Vec<usize> = columns().map(|(_, function)| function).collect();
        functions.sort_unstable();
        functions.dedup();
        let mut pairs: Vec<Pair> = columns()
            .map(|(channel, function)| Pair {
                channel,
                function: functions.partition_point(|&one| one < function),
            })
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let n = pairs.len();
        let mut tile = Self {
            scene,
            functions,
            pairs,
            wanted: Vec::new(),
            totals: Totals {
                information: Vec::new(),
                products: vec![T::default(); n * scene.width()],
                level: Default::default(),
            },
            places: Vec::new(),
        };
        for piece in pieces {
            let group = &groups[piece.group];
            for &trial in &piece.trials {
                let first = tile.places.len();
                tile.add_places(group, trial);
                let own = &tile.places[first..];
                for (a, &one) in own.iter().enumerate() {
                    tile.wanted.extend(own[a..].iter().map(|&two| [one.min(two), one.max(two)]));
                }
            }
        }
        tile.wanted.sort_unstable();
        tile.wanted.dedup();
        tile.totals.information = vec![0.0; tile.wanted.len()];
        tile
    }

    /// Runs of pairs of one channel: channel, first pair, number of pairs.
    pub(super) fn channels(&self) -> Vec<(usize, usize, usize)> {
        let mut first = 0;
        (self.pairs.chunk_by(|a, b| a.channel == b.channel))
            .map(|own| {
                first += own.len();
                (own[0].channel, first - own.len(), own.len())
            })
            .collect()
    }

    /// Lays out sums by block, all 0.
    pub(super) fn lay_out_levels(&mut self) {
        let size = self.pairs.len() * self.scene.noise.n_blocks();
        for (channel, _, _) in self.channels() {
            for c in self.scene.components(channel) {
                self.totals.level[c].resize(size, T::default());
            }
        }
    }

    /// Judges every trial of the pieces, in their order, once all is summed.
    pub(super) fn judged(mut self, groups: &[Group], pieces: &[Piece]) -> Vec<Judged> {
        self.add_levels();
        let (mut sums, mut judge) = (Sums::default(), Judge::default());
        let mut found = Vec::new();
        let mut places = &self.places[..];
        for piece in pieces {
            let group = &groups[piece.group];
            for _ in &piece.trials {
                let (own, behind) = places.split_at(group.columns.len());
                places = behind;
                self.set_sums(&mut sums, group, own);
                found.push(judge.judge(&sums));
            }
        }
        found
    }

    /// Adds to the information what is not white.
    fn add_levels(&mut self) {
        let n_blocks = self.scene.noise.n_blocks();
        let Totals { information, level, .. } = &mut self.totals;
        for (c, level) in level.iter().enumerate().filter(|(_, level)| !level.is_empty()) {
            let beyond = self.scene.beyond_white_of_columns(c, level);
            for (&[a, b], sum) in self.wanted.iter().zip(&mut *information) {
                let [a, b] = [a, b].map(|pair| pair * n_blocks..(pair + 1) * n_blocks);
                *sum += lanes::dot(&level[a], &beyond[b]).double();
            }
        }
    }

    /// Adds the places of the pairs of a trial's columns.
    fn add_places(&mut self, group: &Group, trial: usize) {
        let Self { functions, pairs, places, .. } = self;
        places.extend((group.columns.iter().zip(group.trial(trial))).map(|(column, &function)| {
            let function = functions.partition_point(|&one| one < function);
            pairs.partition_point(|&pair| pair < Pair { channel: column.channel, function })
        }));
    }

    /// The sums of one trial, from those of its columns at these places.
    fn set_sums(&self, sums: &mut Sums, group: &Group, places: &[usize]) {
        let width = self.scene.width();
        let (n_basis, n_draws) = (self.scene.n_basis, self.scene.n_draws);
        // Sums of n products, each rounded, whose errors go to and fro.
        sums.reset(
            group.n_coefficients,
            n_basis,
            n_draws,
            8.0 * T::EPSILON * (self.scene.n_rows as f64).sqrt(),
        );
        for (a, (column, &place)) in group.columns.iter().zip(places).enumerate() {
            let (i, factor) = (column.coefficient, column.factor);
            let products = &self.totals.products[place * width..(place + 1) * width];
            lanes::add_as_double(sums.inside.row_mut(i), factor, &products[..n_basis]);
            sums.score[i] += factor * products[n_basis].double();
            lanes::add_as_double(sums.draws.row_mut(i), factor, &products[n_basis + 1..]);
            for (b, (other, &there)) in group.columns.iter().zip(places).enumerate().skip(a) {
                let wanted = [place.min(there), place.max(there)];
                let at = self.wanted.partition_point(|&one| one < wanted);
                let value = factor * other.factor * self.totals.information[at];
                sums.information.row_mut(i)[other.coefficient] += value;
                if b > a {
                    sums.information.row_mut(other.coefficient)[i] += value;
                }
            }
        }
    }
}
