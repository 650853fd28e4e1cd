//! Sums of a tile at the nodes of a lattice, which are few.

use rayon::prelude::*;

use super::error::CandidateError;
use super::group::Group;
use super::lanes;
use super::moments::Moments;
use super::nodes::{Lattice, TAPS};
use super::scene::Scene;
use super::sources::{Numbering, Source, Sources};
use super::tile::{Pair, Piece, Tile, used_channels};
use crate::least_squares::{Real, add_product_of_rows};

/// Nodes whose operands are summed together, of all channels: rows are read once, and every thread has something to do.
const NODES: usize = 128;

/// What functions at the nodes of a lattice are multiplied with.
pub(super) struct NodeOperands<'a, T> {
    lattice: &'a Lattice,
    /// Channels that are used, rising, with their operands.
    channels: Vec<(usize, OfChannel<T>)>,
    /// Two channels that are used together, rising, with the diagonals of `Cᵀ (Σ_c d e / σ_c²) C`, the main one first.
    together: Vec<([usize; 2], Vec<Vec<T>>)>,
}

struct OfChannel<T> {
    /// `Cᵀ D` times basis, residual and draws, row after row.
    operand: Vec<T>,
    /// By component, `Uᵀ D C / σ`: node and weight of every block's entries; no blocks where the channel does nothing.
    units: [Vec<Vec<(usize, T)>>; 3],
}

impl<'a, T: Real> NodeOperands<'a, T> {
    /// Sums rows into nodes, for all channels that the pieces use.
    pub(super) fn new(scene: &Scene<T>, lattice: &'a Lattice, groups: &[Group], pieces: &[&Piece]) -> Self {
        let (channels, together) = used_channels(groups, pieces);
        let rows = Moments::of_rows(&scene.runs);
        let operands = operands(scene, lattice, &channels);
        let channels = (channels.into_par_iter().zip(operands))
            .map(|(channel, operand)| {
                (channel, OfChannel { operand, units: units(scene, lattice, channel, &rows) })
            })
            .collect();
        let together = (together.into_par_iter())
            .filter_map(|[one, two]| Some(([one, two], diagonals(scene, lattice, [one, two], &rows)?)))
            .collect();
        Self { lattice, channels, together }
    }

    /// Sums everything that a tile needs.
    pub(super) fn sum(
        &self,
        tile: &mut Tile<'_, T>,
        sources: &Sources<'_>,
        numbering: &Numbering,
    ) -> Result<(), CandidateError> {
        tile.lay_out_levels();
        let n = self.lattice.nodes.len();
        let (width, n_blocks) = (tile.scene.width(), tile.scene.noise.n_blocks());
        let mut columns: Vec<T> = Vec::with_capacity(tile.functions.len() * n);
        let formulas: Vec<(usize, usize)> = (tile.functions.iter())
            .filter_map(|&function| match numbering.source(function) {
                Source::Formula(formula, slot) => Some((formula, slot)),
                _ => None,
            })
            .collect();
        for own in formulas.chunk_by(|a, b| a.0 == b.0) {
            let slots: Vec<usize> = own.iter().map(|&(_, slot)| slot).collect();
            self.lattice.extend(&mut columns, &sources.formulas[own[0].0], &slots)?;
        }
        let column = |pair: Pair| &columns[pair.function * n..(pair.function + 1) * n];
        let (mut left, mut across, mut sums) = (Vec::new(), Vec::new(), Vec::new());
        for (channel, first, m) in tile.channels() {
            left.clear();
            for &pair in &tile.pairs[first..first + m] {
                left.extend_from_slice(column(pair));
            }
            let place = self.channels.partition_point(|one| one.0 < channel);
            let OfChannel { operand, units } = &self.channels[place].1;
            add_product_of_rows(
                &mut tile.totals.products[first * width..(first + m) * width],
                &left,
                operand,
                n,
            );
            lanes::transpose(&mut across, &left, n);
            for (level, unit) in tile.totals.level.iter_mut().zip(units).filter(|(_, unit)| !unit.is_empty())
            {
                sums.clear();
                sums.resize(n_blocks * m, T::default());
                for (sum, entries) in sums.chunks_exact_mut(m).zip(unit) {
                    for &(node, weight) in entries {
                        lanes::add_scaled(sum, weight, &across[node * m..(node + 1) * m]);
                    }
                }
                lanes::transpose(&mut left, &sums, m);
                level[first * n_blocks..(first + m) * n_blocks].copy_from_slice(&left);
            }
        }
        for (&wanted, sum) in tile.wanted.iter().zip(&mut tile.totals.information) {
            let [f, g] = wanted.map(|pair| tile.pairs[pair]);
            let channels = [f.channel, g.channel];
            let place = self.together.partition_point(|one| one.0 < channels);
            if let Some((own, diagonals)) = self.together.get(place)
                && *own == channels
            {
                *sum = lanes::banded(column(f), column(g), diagonals);
            }
        }
        Ok(())
    }
}

/// By channel: `Cᵀ D` times basis, residual and draws.
fn operands<T: Real>(scene: &Scene<T>, lattice: &Lattice, channels: &[usize]) -> Vec<Vec<T>> {
    let width = scene.width();
    let mut operands: Vec<Vec<T>> = vec![vec![T::default(); lattice.nodes.len() * width]; channels.len()];
    let mut steps: Vec<Vec<&mut [T]>> = Vec::new();
    steps.resize_with(lattice.nodes.len().div_ceil(NODES), Vec::new);
    for operand in &mut operands {
        for (step, part) in steps.iter_mut().zip(operand.chunks_mut(NODES * width)) {
            step.push(part);
        }
    }
    let places: Vec<_> = lattice.places().collect();
    let terms: Vec<_> = channels.iter().map(|&channel| scene.terms(channel)).collect();
    steps.into_par_iter().enumerate().for_each(|(step, mut parts)| {
        let (start, end) = (step * NODES, (step + 1) * NODES);
        let mut of_place = vec![T::default(); width];
        let from = places.partition_point(|place| place.1 + lattice.n_taps() <= start);
        for &(rows, first, weights) in places[from..].iter().take_while(|place| place.1 < end) {
            // Taps that lie among the nodes of this step.
            let own = start.max(first) - first..(end - first).min(weights.len());
            let at = (first + own.start - start) * width;
            for (part, terms) in parts.iter_mut().zip(&terms) {
                let rows = std::iter::once(rows.iter().copied());
                lanes::set_sums_of_rows(&mut of_place, width, width, rows, terms);
                for (target, &weight) in part[at..].chunks_exact_mut(width).zip(&weights[own.clone()]) {
                    lanes::add_scaled(target, T::nearest(weight), &of_place);
                }
            }
        }
    });
    operands
}

/// By component: what a channel's nodes add to every block of the noise.
fn units<T: Real>(
    scene: &Scene<T>,
    lattice: &Lattice,
    channel: usize,
    rows: &Moments,
) -> [Vec<Vec<(usize, T)>>; 3] {
    let n_blocks = scene.noise.n_blocks();
    let mut units: [Vec<Vec<(usize, T)>>; 3] = Default::default();
    for c in scene.components(channel) {
        let unit = scene.unit(channel, c, rows, 0..rows.len());
        let mut blocks: Vec<Vec<(usize, T)>> = vec![Vec::new(); n_blocks];
        // Rows come in the order of their nodes: of one block's entries, the same node is among the last few.
        for (row, first, weights) in lattice.taps() {
            let block = &mut blocks[scene.noise.block(row)];
            for (node, &weight) in (first..).zip(weights) {
                let value = T::nearest(weight) * unit[row];
                let recent = block.len().saturating_sub(TAPS);
                match block[recent..].iter_mut().find(|entry| entry.0 == node) {
                    Some(entry) => entry.1 += value,
                    None => block.push((node, value)),
                }
            }
        }
        units[c] = blocks;
    }
    units
}

/// The diagonals of two channels' weights at the nodes; nothing where they share no component.
fn diagonals<T: Real>(
    scene: &Scene<T>,
    lattice: &Lattice,
    [one, two]: [usize; 2],
    rows: &Moments,
) -> Option<Vec<Vec<T>>> {
    let of_rows = scene.weights(one, two, rows, 0..rows.len())?;
    let n_taps = lattice.n_taps();
    let mut sums = vec![vec![0.0; lattice.nodes.len()]; n_taps];
    for (row, first, weights) in lattice.taps() {
        for a in 0..n_taps {
            for b in a..n_taps {
                sums[b - a][first + a] += of_rows[row].double() * weights[a] * weights[b];
            }
        }
    }
    Some(sums.into_iter().map(|diagonal| diagonal.into_iter().map(T::nearest).collect()).collect())
}
