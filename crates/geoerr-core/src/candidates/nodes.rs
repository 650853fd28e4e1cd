//! Functions of one variable, at few nodes instead of all rows.
//!
//! Waves along an axis and jumps in time are most of what is tried, and each is a function of one column. Its values at
//! the rows are combinations of its values at nodes, `f = C F`, with the same sparse C for all such functions; so
//! `fᵀ X = Fᵀ (Cᵀ X)`, and Cᵀ X is made once. Where the variable has few values, or all functions are constant between
//! some places, C picks one node a row and is exact. Else it interpolates by splines of degree 5 between evenly spaced
//! nodes, so many that a function is met within [`ACCURACY`] of its largest value at places between them. Long waves
//! need few nodes and short ones many: one variable has several levels, where they save more than they cost.
//!
//! Source: Unser, Aldroubi & Eden, B-spline signal processing, IEEE Trans. Signal Processing 41 (1993), for the filter
//! that turns values at nodes into coefficients.

use rayon::prelude::*;

use super::error::CandidateError;
use super::sources::{Formula, Sources, number};
use crate::expression::Rows;
use crate::least_squares::Real;

/// Nodes of one row, where splines interpolate.
pub(super) const TAPS: usize = 6;
/// Error that interpolation may have: the digits that a ranking needs.
const ACCURACY: f64 = 1e-4;
/// Fewest formulas of a variable for which nodes are worth their making.
const WORTHWHILE: usize = 16;
/// Nodes are at most this share of the rows: with fewer rows each, sums over rows are no more work.
const ROWS_PER_NODE: usize = 2;
/// A level of nodes is worth its making if it saves as many values at nodes as this many times the rows.
const ROWS_OF_LEVEL: usize = 6;
/// Fewest intervals that are tried; then twice as many, and so on.
const FEWEST: usize = 64;
/// Nodes beyond either end: the filter forgets its ends by a factor of 0.43 a node.
const MARGIN: usize = 14;
/// Formulas that are evaluated at once to see where they change: smooth ones change everywhere, and a few tell.
const TOGETHER: usize = 16;
/// Places where interpolation is tried.
const TRIED: usize = 16;
/// And where it is tried first.
const FIRST_TRIED: usize = 2;
/// Poles of the filter for degree 5.
const POLES: [f64; 2] = [-0.430_575_347_099_973_8, -0.043_096_288_203_264_65];

/// Values at evenly spaced nodes, and the formulas for which these nodes are enough.
type Level = (Vec<f64>, Vec<usize>);

/// Nodes of one variable, and how rows are made of them.
pub(super) struct Lattice {
    /// Value of the variable at each node.
    pub nodes: Vec<f64>,
    /// Whether values at nodes are turned into coefficients of splines.
    is_spline: bool,
    /// Rows in the order of the variable.
    pub order: Vec<usize>,
    /// First node of each row of `order`.
    pub first: Vec<usize>,
    /// Weights of the nodes from the first of each row of `order`, [`Lattice::n_taps`] of them.
    weights: Vec<f64>,
}

impl Lattice {
    /// Nodes of one row.
    pub(super) fn n_taps(&self) -> usize {
        if self.is_spline { TAPS } else { 1 }
    }

    /// Rows that are made of the nodes in the same way, with the first node and the weights, for all that have a value.
    pub(super) fn places(&self) -> impl Iterator<Item = (&[usize], usize, &[f64])> {
        let n_taps = self.n_taps();
        let taps = move |at: usize| (self.first[at], &self.weights[at * n_taps..(at + 1) * n_taps]);
        let mut start = 0;
        std::iter::from_fn(move || {
            let (first, weights) = (start < self.order.len()).then(|| taps(start))?;
            let n = (start..self.order.len()).take_while(|&at| taps(at) == (first, weights)).count();
            start += n;
            Some((&self.order[start - n..start], first, weights))
        })
    }

    /// Row, first node and weights of every row that has a value.
    pub(super) fn taps(&self) -> impl Iterator<Item = (usize, usize, &[f64])> {
        self.places().flat_map(|(rows, first, weights)| rows.iter().map(move |&row| (row, first, weights)))
    }

    /// Appends a function's coefficients at the nodes for each of some of a formula's slots.
    pub(super) fn extend<T: Real>(
        &self,
        target: &mut Vec<T>,
        formula: &Formula,
        slots: &[usize],
    ) -> Result<(), CandidateError> {
        let n = self.nodes.len();
        let mut values = evaluated(formula, &self.nodes)?;
        for &slot in slots {
            let own = &mut values[slot * n..(slot + 1) * n];
            if self.is_spline {
                filter(own);
            }
            target.extend(own.iter().map(|&value| number::<T>(value)));
        }
        Ok(())
    }
}

/// Makes nodes for the variables that many formulas are functions of alone; the lattice of each formula that has one.
///
/// Only formulas that are wanted here take part.
pub(super) fn lattices(
    sources: &Sources<'_>,
    is_wanted: impl Fn(usize) -> bool,
) -> Result<(Vec<Lattice>, Vec<Option<usize>>), CandidateError> {
    let n_variables = sources.rows.variables.len();
    let mut by_variable: Vec<Vec<usize>> = vec![Vec::new(); n_variables];
    for (number, formula) in sources.formulas.iter().enumerate() {
        if let &[variable] = formula.expression.variable_indices()
            && formula.series.is_none()
            && !formula.expression.needs_order()
            && is_wanted(number)
        {
            by_variable[variable].push(number);
        }
    }
    let found: Vec<Vec<(Lattice, Vec<usize>)>> = (by_variable.into_par_iter().enumerate())
        .filter(|(_, formulas)| formulas.len() >= WORTHWHILE)
        .map(|(variable, formulas)| lattices_of(sources.rows.variables[variable], sources.formulas, formulas))
        .collect::<Result<_, _>>()?;
    let mut lattices = Vec::new();
    let mut lattice_of = vec![None; sources.formulas.len()];
    for (lattice, met) in found.into_iter().flatten() {
        for formula in met {
            lattice_of[formula] = Some(lattices.len());
        }
        lattices.push(lattice);
    }
    Ok((lattices, lattice_of))
}

/// Nodes for some functions of one column, each with the functions that it serves.
fn lattices_of(
    column: &[f64],
    all: &[Formula],
    formulas: Vec<usize>,
) -> Result<Vec<(Lattice, Vec<usize>)>, CandidateError> {
    let mut order: Vec<usize> = (0..column.len()).filter(|&row| column[row].is_finite()).collect();
    order.sort_by(|&a, &b| column[a].total_cmp(&column[b]));
    let mut values: Vec<f64> = order.iter().map(|&row| column[row]).collect();
    values.dedup();
    let most = column.len() / ROWS_PER_NODE;
    if values.len() < 2 || most < 2 {
        return Ok(Vec::new());
    }
    let cells =
        if values.len() <= most { Some(values.clone()) } else { cells(&values, most, all, &formulas)? };
    if let Some(starts) = cells {
        let first: Vec<usize> =
            order.iter().map(|&row| starts.partition_point(|&start| start <= column[row]) - 1).collect();
        let weights = vec![1.0; order.len()];
        return Ok(vec![(Lattice { nodes: starts, is_spline: false, order, first, weights }, formulas)]);
    }
    let ends = (values[0], values[values.len() - 1]);
    let mut of_levels = levels(ends, most, all, formulas)?;
    join_levels(&mut of_levels, ROWS_OF_LEVEL * column.len());
    Ok((of_levels.into_iter())
        .filter(|(_, met)| met.len() >= WORTHWHILE)
        .map(|(nodes, met)| (splines(column, order.clone(), nodes), met))
        .collect())
}

/// Evenly spaced nodes, twice as many each time, with the functions for which they are the first that are enough.
fn levels(
    (low, high): (f64, f64),
    most: usize,
    all: &[Formula],
    formulas: Vec<usize>,
) -> Result<Vec<Level>, CandidateError> {
    let mut found = Vec::new();
    let mut waiting = formulas;
    let mut n_intervals = FEWEST;
    while n_intervals + 2 * MARGIN <= most && !waiting.is_empty() {
        let nodes = spread(low, high, n_intervals);
        let is_met: Vec<bool> =
            waiting.par_iter().map(|&formula| is_met(&all[formula], &nodes)).collect::<Result<_, _>>()?;
        let (mut met, mut later) = (Vec::new(), Vec::new());
        for (formula, is_met) in waiting.into_iter().zip(is_met) {
            if is_met { met.push(formula) } else { later.push(formula) }
        }
        found.push((nodes, met));
        waiting = later;
        n_intervals *= 2;
    }
    Ok(found)
}

/// Joins levels to the next finer one that serve few functions or do not save so many values at nodes.
fn join_levels(levels: &mut Vec<Level>, least_saved: usize) {
    while levels.last().is_some_and(|(_, met)| met.is_empty()) {
        levels.pop();
    }
    for finer in (1..levels.len()).rev() {
        let n_served: usize = levels[..finer].iter().map(|(_, met)| met.len()).sum();
        let n_coarser = levels[finer - 1].0.len();
        let is_small = levels[finer - 1].1.len() < WORTHWHILE;
        if is_small || n_served * (levels[finer].0.len() - n_coarser) < least_saved {
            let (_, met) = levels.remove(finer - 1);
            levels[finer - 1].1.extend(met);
        }
    }
}

/// Splines between evenly spaced nodes.
fn splines(column: &[f64], order: Vec<usize>, nodes: Vec<f64>) -> Lattice {
    let per_interval = 1.0 / (nodes[1] - nodes[0]);
    let mut first = Vec::with_capacity(order.len());
    let mut weights = Vec::with_capacity(TAPS * order.len());
    for &row in &order {
        let (node, own) = spline((column[row] - nodes[0]) * per_interval);
        first.push(node);
        weights.extend(own);
    }
    Lattice { nodes, is_spline: true, order, first, weights }
}

/// First values of the cells within which all functions are constant; `None` for too many cells.
fn cells(
    values: &[f64],
    most: usize,
    all: &[Formula],
    formulas: &[usize],
) -> Result<Option<Vec<f64>>, CandidateError> {
    let n = values.len();
    let mut starts = vec![false; n];
    starts[0] = true;
    for some in formulas.chunks(TOGETHER) {
        let changes: Vec<Vec<usize>> = (some.par_iter())
            .map(|&formula| {
                let columns = evaluated(&all[formula], values)?;
                let changes = |column: &[f64]| {
                    (1..n).filter(|&at| column[at].to_bits() != column[at - 1].to_bits()).collect::<Vec<_>>()
                };
                Ok(columns.chunks_exact(n).flat_map(changes).collect())
            })
            .collect::<Result<_, CandidateError>>()?;
        changes.into_iter().flatten().for_each(|at| starts[at] = true);
        if starts.iter().filter(|&&start| start).count() > most {
            return Ok(None);
        }
    }
    Ok(Some(values.iter().zip(starts).filter(|&(_, start)| start).map(|(&value, _)| value).collect()))
}

/// Evenly spaced nodes, and some beyond either end.
fn spread(low: f64, high: f64, n_intervals: usize) -> Vec<f64> {
    let step = (high - low) / n_intervals as f64;
    (0..n_intervals + 1 + 2 * MARGIN).map(|node| low + (node as f64 - MARGIN as f64) * step).collect()
}

/// Whether splines through a function's values at the nodes meet it between them.
///
/// The function is smooth, and the filter forgets what is far: some nodes around each place are enough. Most of what
/// is not met is missed at the first places.
fn is_met(formula: &Formula, nodes: &[f64]) -> Result<bool, CandidateError> {
    if !formula.expression.is_smooth() {
        return Ok(false);
    }
    // Shares of the golden section repeat nothing that nodes or waves repeat.
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let n_inner = (nodes.len() - 1 - 2 * MARGIN) as f64;
    let tried: Vec<f64> =
        (1..=TRIED).map(|place| MARGIN as f64 + n_inner * (place as f64 * golden).fract()).collect();
    Ok(is_met_at(formula, nodes, &tried[..FIRST_TRIED])? && is_met_at(formula, nodes, &tried)?)
}

/// Whether it is met at some places, in intervals from the first node.
fn is_met_at(formula: &Formula, nodes: &[f64], tried: &[f64]) -> Result<bool, CandidateError> {
    const AROUND: usize = 2 * MARGIN + TAPS;
    let step = nodes[1] - nodes[0];
    let mut at: Vec<f64> = tried.iter().map(|place| nodes[0] + place * step).collect();
    for place in tried {
        let first = spline(*place).0 - (MARGIN - 2);
        at.extend_from_slice(&nodes[first..(first + AROUND).min(nodes.len())]);
    }
    for column in evaluated(formula, &at)?.chunks_exact(at.len()) {
        if column.iter().any(|value| !value.is_finite()) {
            return Ok(false);
        }
        let largest = column.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        let (expected, mut rest) = column.split_at(tried.len());
        for (&place, &expected) in tried.iter().zip(expected) {
            let (node, weights) = spline(place);
            let first = node - (MARGIN - 2);
            let (own, later) = rest.split_at((nodes.len() - first).min(AROUND));
            rest = later;
            let mut own = own.to_vec();
            filter(&mut own);
            let found: f64 =
                weights.iter().zip(&own[node - first..]).map(|(weight, value)| weight * value).sum();
            if (found - expected).abs() > ACCURACY * largest {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

/// All columns of a formula of one variable at some of its values.
pub(super) fn evaluated(formula: &Formula, values: &[f64]) -> Result<Vec<f64>, CandidateError> {
    let Formula { expression, inner, .. } = formula;
    let variables = vec![values; expression.symbols().variables.len()];
    let rows = Rows { variables: &variables, n_rows: values.len(), starts: &[], t: None };
    let mut columns = vec![0.0; expression.coefficients().len() * values.len()];
    expression.coefficient_columns(&rows, 0..values.len(), inner, &mut columns)?;
    Ok(columns)
}

/// Turns values at evenly spaced nodes into coefficients of splines of degree 5, in place.
fn filter(values: &mut [f64]) {
    let n = values.len();
    let gain: f64 = POLES.iter().map(|z| (1.0 - z) * (1.0 - 1.0 / z)).product();
    for value in values.iter_mut() {
        *value *= gain;
    }
    for z in POLES {
        // As if mirrored at the ends, over as many nodes as are felt.
        let mut power = 1.0;
        let mut start = 0.0;
        for value in values.iter().take(4 * MARGIN) {
            start += power * value;
            power *= z;
        }
        values[0] = start;
        for at in 1..n {
            values[at] += z * values[at - 1];
        }
        values[n - 1] = z / (z * z - 1.0) * (values[n - 1] + z * values[n - 2]);
        for at in (0..n - 1).rev() {
            values[at] = z * (values[at + 1] - values[at]);
        }
    }
}

/// First node and weights of the splines of degree 5 at a place, in intervals from the first node.
fn spline(place: f64) -> (usize, [f64; TAPS]) {
    let floor = place.floor();
    let share = place - floor;
    let mut weights = [0.0; TAPS];
    weights[0] = 1.0;
    for degree in 1..TAPS {
        for at in (0..=degree).rev() {
            let from_left = if at > 0 { (share + (degree - at) as f64) * weights[at - 1] } else { 0.0 };
            let from_right = if at < degree { (at as f64 + 1.0 - share) * weights[at] } else { 0.0 };
            weights[at] = (from_left + from_right) / degree as f64;
        }
    }
    (floor as usize - 2, weights)
}
