//! The sums over rows of some groups: what is multiplied with what, and what becomes of it.

use super::group::Group;
use super::judge::{Judged, Sums, judge};
use super::lanes;
use super::scene::Scene;
use crate::least_squares::{Real, set_product};

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
    /// By wanted: `Σ_c fᵀ (d e / σ_c²) g`.
    pub white: Vec<f64>,
    /// By pair: products with basis, residual and draws.
    pub products: Vec<T>,
    /// By component and pair: sums by block before the noise's transform.
    pub level: [Vec<T>; 3],
    /// And after.
    after: [Vec<T>; 3],
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
            white: Vec::new(),
            products: vec![T::default(); n * scene.width()],
            level: [(); 3].map(|()| vec![T::default(); n * scene.noise.n_blocks]),
            after: Default::default(),
        };
        for piece in pieces {
            let group = &groups[piece.group];
            for &trial in &piece.trials {
                let places = tile.places(group, trial);
                for (a, &one) in places.iter().enumerate() {
                    tile.wanted.extend(places[a..].iter().map(|&two| [one.min(two), one.max(two)]));
                }
            }
        }
        tile.wanted.sort_unstable();
        tile.wanted.dedup();
        tile.white = vec![0.0; tile.wanted.len()];
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

    /// Judges every trial of the pieces, in their order, once all is summed.
    pub(super) fn judged(mut self, groups: &[Group], pieces: &[Piece]) -> Vec<Judged> {
        self.after = [0, 1, 2].map(|c| self.transformed(c));
        let mut found = Vec::new();
        for piece in pieces {
            let group = &groups[piece.group];
            found.extend(piece.trials.iter().map(|&trial| self.judged_trial(group, trial)));
        }
        found
    }

    /// The noise's transform of sums by block.
    fn transformed(&self, c: usize) -> Vec<T> {
        let (noise, level) = (&self.scene.noise, &self.level[c]);
        let mut after = level.clone();
        let (mut own, mut more) = (Vec::new(), Vec::new());
        for (session, less_one) in noise.sessions.iter().zip(&noise.less_one[c]) {
            let matrix: Vec<T> = less_one.iter().map(|&value| T::nearest(value)).collect();
            own.clear();
            for sums in level.chunks_exact(noise.n_blocks) {
                own.extend_from_slice(&sums[session.clone()]);
            }
            more.clear();
            more.resize(own.len(), T::default());
            set_product(&mut more, &matrix, &own, session.len());
            for (sums, add) in after.chunks_exact_mut(noise.n_blocks).zip(more.chunks_exact(session.len())) {
                for (value, &add) in sums[session.clone()].iter_mut().zip(add) {
                    *value += add;
                }
            }
        }
        after
    }

    /// Places of the pairs of a trial's columns.
    fn places(&self, group: &Group, trial: usize) -> Vec<usize> {
        (group.columns.iter().zip(group.trial(trial)))
            .map(|(column, &function)| {
                let function = self.functions.partition_point(|&one| one < function);
                self.pairs.partition_point(|&pair| pair < Pair { channel: column.channel, function })
            })
            .collect()
    }

    /// `b_aᵀ V⁻¹ b_b` of two pairs.
    fn information(&self, a: usize, b: usize) -> f64 {
        let n_blocks = self.scene.noise.n_blocks;
        let wanted = [a.min(b), a.max(b)];
        let mut sum = self.white[self.wanted.partition_point(|&one| one < wanted)];
        for c in self.scene.components(self.pairs[a].channel) {
            if self.scene.directions[self.pairs[b].channel][c].is_empty() {
                continue;
            }
            let [a, b] = [a, b].map(|pair| pair * n_blocks..(pair + 1) * n_blocks);
            sum += lanes::dot(&self.after[c][a.clone()], &self.after[c][b.clone()]).double()
                - lanes::dot(&self.level[c][a], &self.level[c][b]).double();
        }
        sum
    }

    fn judged_trial(&self, group: &Group, trial: usize) -> Judged {
        let (k, width) = (group.n_coefficients, self.scene.width());
        let (n_basis, n_draws) = (self.scene.n_basis, self.scene.n_draws);
        let places = self.places(group, trial);
        let mut information = vec![0.0; k * k];
        let mut inside = vec![0.0; k * n_basis];
        let mut score = vec![0.0; k];
        let mut draws = vec![0.0; k * n_draws];
        for (a, (column, &place)) in group.columns.iter().zip(&places).enumerate() {
            let (i, factor) = (column.coefficient, column.factor);
            let products = &self.products[place * width..(place + 1) * width];
            add(&mut inside[i * n_basis..(i + 1) * n_basis], factor, &products[..n_basis]);
            score[i] += factor * products[n_basis].double();
            add(&mut draws[i * n_draws..(i + 1) * n_draws], factor, &products[n_basis + 1..]);
            for (b, (other, &there)) in group.columns.iter().zip(&places).enumerate().skip(a) {
                let value = factor * other.factor * self.information(place, there);
                information[i * k + other.coefficient] += value;
                if b > a {
                    information[other.coefficient * k + i] += value;
                }
            }
        }
        // Sums of n products, each rounded, whose errors go to and fro.
        let least = 8.0 * T::EPSILON * (self.scene.n_rows as f64).sqrt();
        judge(&Sums { information: &information, inside: &inside, score: &score, draws: &draws, least })
    }
}

fn add<T: Real>(sum: &mut [f64], factor: f64, values: &[T]) {
    for (total, &value) in sum.iter_mut().zip(values) {
        *total += factor * value.double();
    }
}
