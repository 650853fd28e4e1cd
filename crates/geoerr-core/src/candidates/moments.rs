//! Neighbouring rows of one value: points of a plate that were seen at one moment.
//!
//! Few functions tell one point of a plate from another. Where all rows of a moment have the same value `f`,
//! `fᵀ X` is a sum over moments of `f` times what its rows of X are together: as exact, and of fewer terms.

use std::ops::Range;

use super::group::Group;
use super::scene::Run;
use super::sources::{Formula, Numbering, Source, Sources};
use crate::expression::Rows;

/// Moments save less than they cost if there are more of them than this share of the rows.
const WORTHWHILE: f64 = 0.8;

/// Neighbouring rows that belong together, all of one block of the noise.
pub(super) struct Moments {
    /// First row of each, and the number of all rows.
    starts: Vec<usize>,
    /// Moments of one block, as the scene has rows of one.
    pub(super) runs: Vec<Run>,
}

impl Moments {
    /// Every row is a moment of its own.
    pub(super) fn of_rows(runs: &[Run]) -> Self {
        let n_rows = runs.last().map_or(0, |run| run.end);
        Self { starts: (0..=n_rows).collect(), runs: runs.to_vec() }
    }

    /// Neighbouring rows of one block that have the same value in a column.
    pub(super) fn of_column(column: &[f64], runs: &[Run]) -> Self {
        let (mut starts, mut own_runs) = (Vec::new(), Vec::with_capacity(runs.len()));
        for run in runs {
            let first = starts.len();
            starts.push(run.start);
            starts.extend(
                (run.start + 1..run.end).filter(|&row| column[row].to_bits() != column[row - 1].to_bits()),
            );
            own_runs.push(Run { start: first, end: starts.len(), block: run.block });
        }
        starts.push(column.len());
        Self { starts, runs: own_runs }
    }

    pub(super) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// First row of each.
    pub(super) fn first_rows(&self) -> &[usize] {
        &self.starts[..self.len()]
    }

    /// The rows of one.
    pub(super) fn rows(&self, moment: usize) -> Range<usize> {
        self.starts[moment]..self.starts[moment + 1]
    }

    /// Whether no moment has rows of different values; rows without one are alike.
    fn has_one_value(&self, column: &[f64]) -> bool {
        let value =
            |row: usize| if column[row].is_finite() { column[row].to_bits() } else { f64::NAN.to_bits() };
        (0..self.len()).all(|moment| self.rows(moment).skip(1).all(|row| value(row) == value(row - 1)))
    }
}

/// The functions that do not tell rows of one moment apart, at one row of each.
pub(super) struct AtMoments<'a> {
    pub(super) moments: Moments,
    variables: Columns,
    series: Columns,
    given: Columns,
    formulas: &'a [Formula],
    products: &'a [[usize; 2]],
}

/// Columns at one row of each moment.
struct Columns {
    values: Vec<Vec<f64>>,
    /// Whether all rows of each moment have that value.
    is_of_moments: Vec<bool>,
}

impl Columns {
    /// Nothing of a column that is not wanted.
    fn of(columns: &[&[f64]], is_wanted: &[bool], moments: &Moments) -> Self {
        let (values, is_of_moments) = (columns.iter().zip(is_wanted))
            .map(|(column, &is_wanted)| {
                let at = |moments: &Moments| moments.first_rows().iter().map(|&row| column[row]).collect();
                let values = if is_wanted { at(moments) } else { Vec::new() };
                (values, is_wanted && moments.has_one_value(column))
            })
            .unzip();
        Self { values, is_of_moments }
    }
}

impl<'a> AtMoments<'a> {
    /// Takes the rows of one time together, for what some groups ask for; `None` where that saves little.
    pub(super) fn new(
        sources: &'a Sources<'_>,
        runs: &[Run],
        groups: &[Group],
        numbering: &Numbering,
    ) -> Option<Self> {
        let moments = Moments::of_column(sources.rows.t?, runs);
        if moments.len() as f64 > WORTHWHILE * sources.rows.n_rows as f64 {
            return None;
        }
        let (mut series, mut given) = (vec![false; sources.series.len()], vec![false; sources.given.len()]);
        for &function in groups.iter().flat_map(|group| &group.functions) {
            match numbering.source(function) {
                Source::Formula(formula, _) => {
                    if let Some([_, followed]) = sources.formulas[formula].series {
                        series[followed] = true;
                    }
                }
                Source::Given(one) => given[one] = true,
                Source::Product(product) => {
                    sources.products[product].iter().for_each(|&one| given[one] = true)
                }
            }
        }
        let variables =
            Columns::of(sources.rows.variables, &vec![true; sources.rows.variables.len()], &moments);
        let series = Columns::of(sources.series, &series, &moments);
        let given = Columns::of(sources.given, &given, &moments);
        let (formulas, products) = (sources.formulas, sources.products);
        Some(Self { moments, variables, series, given, formulas, products })
    }

    /// Whether a function has one value at all rows of each moment.
    pub(super) fn has(&self, function: usize, numbering: &Numbering) -> bool {
        match numbering.source(function) {
            Source::Formula(formula, _) => {
                let Formula { expression, series, .. } = &self.formulas[formula];
                let is_followed = |variable: usize| series.is_some_and(|[followed, _]| followed == variable);
                !expression.needs_order()
                    && series.is_none_or(|[_, series]| self.series.is_of_moments[series])
                    && (expression.variable_indices().iter())
                        .all(|&variable| is_followed(variable) || self.variables.is_of_moments[variable])
            }
            Source::Given(given) => self.given.is_of_moments[given],
            Source::Product(product) => {
                self.products[product].iter().all(|&given| self.given.is_of_moments[given])
            }
        }
    }

    /// Calls with the functions at the moments, as if those were the rows.
    pub(super) fn with_sources<R>(&self, call: impl FnOnce(&Sources<'_>) -> R) -> R {
        let [variables, series, given] = [&self.variables, &self.series, &self.given]
            .map(|columns| columns.values.iter().map(Vec::as_slice).collect::<Vec<&[f64]>>());
        call(&Sources {
            rows: Rows { variables: &variables, n_rows: self.moments.len(), starts: &[], t: None },
            formulas: self.formulas,
            series: &series,
            given: &given,
            products: self.products,
        })
    }
}
