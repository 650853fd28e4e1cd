//! Sums over rows of carriers times series, and times two of them.

use std::ops::Range;

use super::by_series::{Carrier, Wanted};
use super::error::CandidateError;
use super::lanes;
use super::scene::{Run, runs_within};
use super::series::Block;
use crate::least_squares::{Real, add_product_of_columns, add_product_of_rows};

/// Sums of functions in the order of their carriers.
pub(super) struct SeriesSums<T> {
    /// With basis, residual and draws.
    pub products: Vec<T>,
    /// By component, by block of the noise; nothing where no carrier acts.
    pub level: [Vec<T>; 3],
    /// What is white of the information: by two carriers, then two series.
    pub white: Vec<f64>,
}

/// Room to sum a block of rows in.
#[derive(Default)]
struct Scratch<T> {
    of_formula: Vec<f64>,
    /// Multiple after multiple.
    multiples: Vec<T>,
    /// Function after function: what its series has of each column.
    shares: Vec<T>,
    /// A carrier along a component, and the columns of the block times each.
    along: Vec<T>,
    left: Vec<T>,
    /// Products of those on one component, and carrier after carrier on all.
    of_component: Vec<T>,
    of_columns: Vec<T>,
    /// What a row gives to its block of the noise; sums by run of a carrier's columns, and of its functions.
    unit: Vec<T>,
    of_runs: Vec<T>,
    of_functions: Vec<T>,
    /// Two series each, two carriers each with the weights of rows, and the products of both.
    two_series: Vec<T>,
    two_carriers: Vec<T>,
    weights: Vec<T>,
    white: Vec<T>,
}

impl<T: Real> SeriesSums<T> {
    /// Sums over some blocks of rows.
    pub(super) fn over(wanted: &Wanted<'_, T>, blocks: &[Block<T>]) -> Result<Self, CandidateError> {
        let scene = wanted.scene;
        let n: usize = wanted.carriers.iter().map(|carrier| carrier.series.len()).sum();
        let level = [0, 1, 2].map(|c| {
            let acts = wanted.carriers.iter().any(|carrier| acts(wanted, carrier, c));
            vec![T::default(); if acts { n * scene.noise.n_blocks() } else { 0 }]
        });
        let mut sums = Self {
            products: vec![T::default(); n * scene.width()],
            level,
            white: vec![0.0; wanted.of_carriers.len() * wanted.of_series.len()],
        };
        let mut scratch = Scratch::default();
        for block in blocks.iter().filter(|block| block.n_columns > 0) {
            let Scratch { of_formula, multiples, shares, .. } = &mut scratch;
            wanted.multiples.set(multiples, of_formula, wanted.sources, block.rows.clone())?;
            shares.clear();
            for &place in wanted.carriers.iter().flat_map(|carrier| &carrier.series) {
                shares.extend_from_slice(block.shares(place));
            }
            sums.add_products(wanted, &mut scratch, block);
            sums.add_white(wanted, &mut scratch, &block.rows);
        }
        Ok(sums)
    }

    /// Adds products, and sums by block of the noise.
    fn add_products(&mut self, wanted: &Wanted<'_, T>, scratch: &mut Scratch<T>, block: &Block<T>) {
        let (scene, here, r) = (wanted.scene, block.rows.clone(), block.n_columns);
        let (n, width, n_blocks) = (here.len(), scene.width(), scene.noise.n_blocks());
        let runs = runs_within(&scene.runs, &here);
        scratch.of_columns.clear();
        scratch.of_columns.resize(wanted.carriers.len() * r * width, T::default());
        for c in 0..3 {
            let acting =
                || wanted.carriers.iter().enumerate().filter(|(_, carrier)| acts(wanted, carrier, c));
            let n_left = acting().count() * r;
            if n_left == 0 {
                continue;
            }
            let Scratch { multiples, along, left, of_component, of_columns, unit, .. } = &mut *scratch;
            left.resize(n_left * n, T::default());
            along.resize(n, T::default());
            for ((_, carrier), left) in acting().zip(left.chunks_exact_mut(r * n)) {
                let direction = &scene.directions[carrier.channel][c][here.clone()];
                lanes::set_products(along, &multiples[carrier.multiple * n..][..n], direction);
                for (left, column) in left.chunks_exact_mut(n).zip(block.columns.chunks_exact(n)) {
                    lanes::set_products(left, column, along);
                }
            }
            of_component.clear();
            of_component.resize(n_left * width, T::default());
            add_product_of_rows(of_component, left, &scene.back[c][here.start * width..here.end * width], n);
            for ((number, _), own) in acting().zip(of_component.chunks_exact(r * width)) {
                lanes::add_scaled(&mut of_columns[number * r * width..][..r * width], T::nearest(1.0), own);
            }
            scene.set_unit_of_rows(unit, c, here.clone());
            for (place, (_, carrier)) in acting().enumerate() {
                let level = &mut self.level[c][carrier.first * n_blocks..][..carrier.series.len() * n_blocks];
                add_levels(level, scratch, carrier, place * r..(place + 1) * r, &runs);
            }
        }
        for (carrier, own) in wanted.carriers.iter().zip(scratch.of_columns.chunks_exact(r * width)) {
            let m = carrier.series.len();
            let shares = &scratch.shares[carrier.first * r..][..m * r];
            add_product_of_rows(&mut self.products[carrier.first * width..][..m * width], shares, own, r);
        }
    }

    /// Adds what is white of the information.
    fn add_white(&mut self, wanted: &Wanted<'_, T>, scratch: &mut Scratch<T>, here: &Range<usize>) {
        let n = here.len();
        let Scratch { multiples, two_series, two_carriers, weights, white, .. } = scratch;
        two_series.resize(wanted.of_series.len() * n, T::default());
        for (target, two) in two_series.chunks_exact_mut(n).zip(&wanted.of_series) {
            let [one, two] = two.map(|series| &wanted.sources.series[series][here.clone()]);
            lanes::set_products_of_numbers(target, one, two);
        }
        two_carriers.resize(wanted.of_carriers.len() * n, T::default());
        let mut known = None;
        for (target, two) in two_carriers.chunks_exact_mut(n).zip(&wanted.of_carriers) {
            let two = two.map(|carrier| &wanted.carriers[carrier]);
            let channels = two.map(|carrier| carrier.channel);
            if known.replace(channels) != Some(channels) {
                wanted.scene.set_weights_of_rows(weights, channels, here.clone());
            }
            let [one, two] = two.map(|carrier| &multiples[carrier.multiple * n..][..n]);
            lanes::set_products(target, one, two);
            lanes::multiply(target, weights);
        }
        white.clear();
        white.resize(self.white.len(), T::default());
        add_product_of_columns(white, two_carriers, two_series, n);
        lanes::add_as_double(&mut self.white, 1.0, white);
    }
}

fn acts<T: Real>(wanted: &Wanted<'_, T>, carrier: &Carrier, c: usize) -> bool {
    !wanted.scene.directions[carrier.channel][c].is_empty()
}

/// Adds to a carrier's sums by block of the noise, from its columns on one component.
fn add_levels<T: Real>(
    level: &mut [T],
    scratch: &mut Scratch<T>,
    carrier: &Carrier,
    columns: Range<usize>,
    runs: &[Run],
) {
    let Scratch { shares, left, unit, of_runs, of_functions, .. } = scratch;
    let (n, r, m) = (unit.len(), columns.len(), carrier.series.len());
    of_runs.clear();
    of_runs.resize(r * runs.len(), T::default());
    let left = left[columns.start * n..columns.end * n].chunks_exact(n);
    for (column, sums) in left.zip(of_runs.chunks_exact_mut(runs.len())) {
        lanes::set_by_run(sums, column, unit, runs);
    }
    of_functions.clear();
    of_functions.resize(m * runs.len(), T::default());
    add_product_of_rows(of_functions, &shares[carrier.first * r..][..m * r], of_runs, r);
    let n_blocks = level.len() / m.max(1);
    for (level, own) in level.chunks_exact_mut(n_blocks).zip(of_functions.chunks_exact(runs.len())) {
        for (run, &sum) in runs.iter().zip(own) {
            level[run.block] += sum;
        }
    }
}
