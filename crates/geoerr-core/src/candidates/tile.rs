//! The sums over rows of some groups: one product of matrices a channel, and what the noise needs by blocks.

use super::error::CandidateError;
use super::group::Group;
use super::judge::{Judged, Sums, judge};
use super::lanes;
use super::scene::Scene;
use super::sources::{Numbering, Sources, evaluated};
use crate::least_squares::{Real, add_transposed_product, set_product};

/// Rows of one step: a block of each operand stays in the cache.
pub(super) const ROWS: usize = 512;

/// A function on a channel.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Pair {
    channel: usize,
    /// Place among the tile's functions.
    function: usize,
}

/// Some trials of a group.
pub(super) struct Piece {
    pub group: usize,
    pub trials: std::ops::Range<usize>,
}

/// All that is summed over rows for one tile.
struct Tile<'a, T> {
    scene: &'a Scene<T>,
    functions: Vec<usize>,
    values: Vec<T>,
    pairs: Vec<Pair>,
    /// By pair: products with basis, residual and draws.
    products: Vec<T>,
    /// By component and pair: sums by block before the noise's transform, and after.
    level: [Vec<T>; 3],
    after: [Vec<T>; 3],
}

/// Judges every trial of the pieces, in their order.
pub(super) fn judged<T: Real>(
    scene: &Scene<T>,
    sources: &Sources<'_>,
    numbering: &Numbering,
    groups: &[Group],
    pieces: &[Piece],
) -> Result<Vec<Judged>, CandidateError> {
    let tile = Tile::summed(scene, sources, numbering, groups, pieces)?;
    let mut found = Vec::new();
    for piece in pieces {
        let group = &groups[piece.group];
        found.extend(piece.trials.clone().map(|trial| tile.judged(group, group.trial(trial))));
    }
    Ok(found)
}

impl<'a, T: Real> Tile<'a, T> {
    fn summed(
        scene: &'a Scene<T>,
        sources: &Sources<'_>,
        numbering: &Numbering,
        groups: &[Group],
        pieces: &[Piece],
    ) -> Result<Self, CandidateError> {
        let mut functions = Vec::new();
        let mut named = Vec::new();
        for piece in pieces {
            let group = &groups[piece.group];
            for trial in piece.trials.clone() {
                for (column, &function) in group.columns.iter().zip(group.trial(trial)) {
                    functions.push(function);
                    named.push((column.channel, function));
                }
            }
        }
        functions.sort_unstable();
        functions.dedup();
        named.sort_unstable();
        named.dedup();
        let values = evaluated(sources, numbering, &functions)?;
        let pairs = (named.into_iter())
            .map(|(channel, function)| Pair {
                channel,
                function: functions.partition_point(|&one| one < function),
            })
            .collect();
        let mut tile = Self {
            scene,
            functions,
            values,
            pairs,
            products: Vec::new(),
            level: Default::default(),
            after: Default::default(),
        };
        tile.multiply();
        tile.sum_by_block();
        Ok(tile)
    }

    fn column(&self, function: usize) -> &[T] {
        &self.values[function * self.scene.n_rows..(function + 1) * self.scene.n_rows]
    }

    /// Products of every pair with basis, residual and draws.
    fn multiply(&mut self) {
        let (scene, width) = (self.scene, self.scene.width());
        self.products = vec![T::default(); self.pairs.len() * width];
        let (mut left, mut right, mut sum) = (Vec::new(), Vec::new(), Vec::new());
        let mut first = 0;
        for of_channel in self.pairs.chunk_by(|a, b| a.channel == b.channel) {
            let (m, direction) = (of_channel.len(), &scene.directions[of_channel[0].channel]);
            sum.clear();
            sum.resize(m * width, T::default());
            for start in (0..scene.n_rows).step_by(ROWS) {
                let end = (start + ROWS).min(scene.n_rows);
                left.clear();
                for pair in of_channel {
                    left.extend_from_slice(&self.column(pair.function)[start..end]);
                }
                right.clear();
                right.resize((end - start) * width, T::default());
                for (along, back) in direction.iter().zip(&scene.back) {
                    if !along.is_empty() {
                        lanes::add_scaled_columns(&mut right, &along[start..end], back, scene.n_rows, start);
                    }
                }
                add_transposed_product(&mut sum, &left, &right, end - start);
            }
            for (i, target) in self.products[first * width..].chunks_exact_mut(width).take(m).enumerate() {
                for (j, value) in target.iter_mut().enumerate() {
                    *value = sum[j * m + i];
                }
            }
            first += m;
        }
    }

    /// Sums of every pair by block of the noise, before its transform and after.
    fn sum_by_block(&mut self) {
        let (scene, n_blocks) = (self.scene, self.scene.noise.n_blocks);
        for c in 0..3 {
            let mut level = vec![T::default(); self.pairs.len() * n_blocks];
            let mut weights: Vec<T> = Vec::new();
            let mut of = usize::MAX;
            for (pair, sums) in self.pairs.iter().zip(level.chunks_exact_mut(n_blocks)) {
                let along = &scene.directions[pair.channel][c];
                if along.is_empty() {
                    continue;
                }
                if of != pair.channel {
                    of = pair.channel;
                    let unit = &scene.noise.unit[c];
                    let per_sigma = 1.0 / scene.noise.sigma[c];
                    weights.clear();
                    weights.extend(along.iter().zip(unit).map(|(&a, &u)| a * T::nearest(u * per_sigma)));
                }
                let column = self.column(pair.function);
                lanes::add_by_run(sums, column, &weights, &scene.runs);
            }
            self.after[c] = self.transformed(c, &level);
            self.level[c] = level;
        }
    }

    /// The noise's transform of sums by block.
    fn transformed(&self, c: usize, level: &[T]) -> Vec<T> {
        let noise = &self.scene.noise;
        let mut after = level.to_vec();
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

    fn place(&self, channel: usize, function: usize) -> usize {
        let function = self.functions.partition_point(|&one| one < function);
        self.pairs.partition_point(|&pair| pair < Pair { channel, function })
    }

    /// `b_aᵀ V⁻¹ b_b` of two pairs.
    fn information(&self, a: usize, b: usize) -> f64 {
        let (scene, n_blocks) = (self.scene, self.scene.noise.n_blocks);
        let (one, two) = (self.pairs[a], self.pairs[b]);
        let (f, g) = (self.column(one.function), self.column(two.function));
        let mut sum = 0.0;
        for c in 0..3 {
            let (d, e) = (&scene.directions[one.channel][c], &scene.directions[two.channel][c]);
            if d.is_empty() || e.is_empty() {
                continue;
            }
            sum += lanes::product_of_four(f, d, g, e) / scene.noise.sigma[c].powi(2);
            let [a, b] = [a, b].map(|pair| pair * n_blocks..(pair + 1) * n_blocks);
            sum += lanes::dot(&self.after[c][a.clone()], &self.after[c][b.clone()]).double()
                - lanes::dot(&self.level[c][a], &self.level[c][b]).double();
        }
        sum
    }

    fn judged(&self, group: &Group, functions: &[usize]) -> Judged {
        let (k, width) = (group.n_coefficients, self.scene.width());
        let (n_basis, n_draws) = (self.scene.n_basis, self.scene.n_draws);
        let places: Vec<usize> = (group.columns.iter().zip(functions))
            .map(|(column, &function)| self.place(column.channel, function))
            .collect();
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
