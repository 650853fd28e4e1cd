//! The functions of the rows that columns are made of.

use std::collections::HashMap;
use std::ops::Range;

use super::error::CandidateError;
use super::error::length;
use crate::expression::{Expression, Rows};
use crate::least_squares::Real;

/// A formula at one trial of its inner parameters: one function for each of its coefficients.
#[derive(Clone, Debug)]
pub struct Formula {
    /// The formula.
    pub expression: Expression,
    /// Values of its inner parameters.
    pub inner: Vec<f64>,
    /// One of its variables that is a series instead: number of the variable, and of the series.
    pub series: Option<[usize; 2]>,
    /// Whether it is proportional to its series.
    pub is_proportional: bool,
}

impl Formula {
    /// Whether its functions are multiples of a series.
    pub(super) fn is_multiple_of_series(&self) -> bool {
        self.series.is_some() && self.is_proportional && !self.expression.needs_order()
    }
}

/// All functions, numbered: those of the formulas, one after the other, then those given, then products of two given.
#[derive(Clone, Debug)]
pub struct Sources<'a> {
    /// Where formulas are evaluated.
    pub rows: Rows<'a>,
    /// Formulas at trial values.
    pub formulas: &'a [Formula],
    /// Columns that stand in for a variable of some formulas: a temperature with a lag, once for all that follow it.
    pub series: &'a [&'a [f64]],
    /// Functions as numbers, row by row.
    pub given: &'a [&'a [f64]],
    /// Products of two of those given.
    pub products: &'a [[usize; 2]],
}

/// Where the functions of one scan lie.
pub(super) struct Numbering {
    first_of_formula: Vec<usize>,
    n_given: usize,
    /// By product: the first of the same two functions, so that each is summed once.
    first_alike: Vec<usize>,
}

/// What a function's number says.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// A formula, and which of its coefficients.
    Formula(usize, usize),
    Given(usize),
    Product(usize),
}

impl Numbering {
    pub(super) fn of(sources: &Sources<'_>) -> Result<Self, CandidateError> {
        let mut first_of_formula = Vec::with_capacity(sources.formulas.len() + 1);
        let mut next = 0;
        for formula in sources.formulas {
            first_of_formula.push(next);
            next += formula.expression.coefficients().len();
            let within = |what, found, count| {
                if found < count {
                    Ok(())
                } else {
                    Err(CandidateError::Missing { group: 0, what, found, count })
                }
            };
            if let Some([variable, series]) = formula.series {
                within("variable", variable, sources.rows.variables.len())?;
                within("series", series, sources.series.len())?;
            }
        }
        first_of_formula.push(next);
        for column in sources.rows.variables.iter().chain(&sources.rows.t) {
            length("a variable or the times", column.len(), sources.rows.n_rows)?;
        }
        for given in sources.given.iter().chain(sources.series) {
            length("a given function or series", given.len(), sources.rows.n_rows)?;
        }
        for &one in sources.products.iter().flatten() {
            if one >= sources.given.len() {
                let count = sources.given.len();
                return Err(CandidateError::Missing { group: 0, what: "given function", found: one, count });
            }
        }
        let mut known: HashMap<[usize; 2], usize> = HashMap::new();
        let first_alike = (sources.products.iter().enumerate())
            .map(|(number, &[one, two])| *known.entry([one.min(two), one.max(two)]).or_insert(number))
            .collect();
        Ok(Self { first_of_formula, n_given: sources.given.len(), first_alike })
    }

    pub(super) fn n_functions(&self) -> usize {
        self.n_of_formulas() + self.n_given + self.first_alike.len()
    }

    /// The lowest number of the same function.
    pub(super) fn first_alike(&self, function: usize) -> usize {
        match self.source(function) {
            Source::Product(product) => self.n_of_formulas() + self.n_given + self.first_alike[product],
            _ => function,
        }
    }

    pub(super) fn source(&self, function: usize) -> Source {
        if let Some(given) = function.checked_sub(self.n_of_formulas()) {
            return given.checked_sub(self.n_given).map_or(Source::Given(given), Source::Product);
        }
        let formula = self.first_of_formula.partition_point(|&first| first <= function) - 1;
        Source::Formula(formula, function - self.first_of_formula[formula])
    }

    pub(super) fn is_multiple_of_series(&self, function: usize, sources: &Sources<'_>) -> bool {
        match self.source(function) {
            Source::Formula(formula, _) => sources.formulas[formula].is_multiple_of_series(),
            _ => false,
        }
    }

    fn n_of_formulas(&self) -> usize {
        self.first_of_formula.last().copied().unwrap_or(0)
    }
}

/// Some functions, evaluated a block of rows at a time. What has no value is 0.
pub(super) struct Evaluator<'a, T> {
    sources: &'a Sources<'a>,
    functions: Vec<Source>,
    /// Of functions that depend on the rows before: all rows. Empty for the others.
    whole: Vec<Vec<T>>,
    /// Formulas whose columns for a series of ones do for all that are proportional to some series.
    alike: Vec<usize>,
    /// By function: its place among those, if it is proportional.
    place_of: Vec<Option<usize>>,
    ones: Vec<f64>,
}

/// Room to evaluate a block in.
#[derive(Default)]
pub(super) struct Scratch {
    /// All columns of one formula.
    of_formula: Vec<f64>,
    /// Columns of the formulas that others are multiples of.
    of_ones: Vec<Vec<f64>>,
}

impl<'a, T: Real> Evaluator<'a, T> {
    pub(super) fn new(
        sources: &'a Sources<'a>,
        numbering: &Numbering,
        functions: &[usize],
    ) -> Result<Self, CandidateError> {
        let functions: Vec<Source> = functions.iter().map(|&function| numbering.source(function)).collect();
        let n_rows = sources.rows.n_rows;
        let (alike, place_of) = alike(sources, &functions);
        let ones = vec![1.0; if alike.is_empty() { 0 } else { n_rows }];
        let mut whole = Vec::with_capacity(functions.len());
        let (mut known, mut of_formula) = (usize::MAX, Vec::new());
        for &source in &functions {
            match source {
                Source::Formula(formula, slot) if sources.formulas[formula].expression.needs_order() => {
                    if formula != known {
                        evaluate(sources, formula, 0..n_rows, &mut of_formula)?;
                        known = formula;
                    }
                    let own = &of_formula[slot * n_rows..(slot + 1) * n_rows];
                    whole.push(own.iter().map(|&value| number(value)).collect());
                }
                _ => whole.push(Vec::new()),
            }
        }
        Ok(Self { sources, functions, whole, alike, place_of, ones })
    }

    /// Sets `target` to the functions over some rows, column after column.
    pub(super) fn set(
        &self,
        target: &mut Vec<T>,
        scratch: &mut Scratch,
        rows: Range<usize>,
    ) -> Result<(), CandidateError> {
        let Scratch { of_formula, of_ones } = scratch;
        let n = rows.len();
        target.clear();
        of_ones.resize(self.alike.len(), Vec::new());
        for (&formula, columns) in self.alike.iter().zip(&mut *of_ones) {
            evaluate_with(self.sources, formula, &self.ones, rows.clone(), columns)?;
        }
        let mut known = usize::MAX;
        for ((&source, whole), &place) in self.functions.iter().zip(&self.whole).zip(&self.place_of) {
            if let (Source::Formula(formula, slot), Some(place)) = (source, place)
                && let Some([_, series]) = self.sources.formulas[formula].series
            {
                let of_one = of_ones[place][slot * n..(slot + 1) * n].iter();
                let series = &self.sources.series[series][rows.clone()];
                target.extend(of_one.zip(series).map(|(&of_one, &value)| number::<T>(of_one * value)));
                continue;
            }
            match source {
                _ if !whole.is_empty() => target.extend_from_slice(&whole[rows.clone()]),
                Source::Formula(formula, slot) => {
                    if formula != known {
                        evaluate(self.sources, formula, rows.clone(), of_formula)?;
                        known = formula;
                    }
                    let own = &of_formula[slot * n..(slot + 1) * n];
                    target.extend(own.iter().map(|&value| number::<T>(value)));
                }
                Source::Given(given) => {
                    let own = &self.sources.given[given][rows.clone()];
                    target.extend(own.iter().map(|&value| number::<T>(value)));
                }
                Source::Product(product) => {
                    let [one, two] =
                        self.sources.products[product].map(|given| &self.sources.given[given][rows.clone()]);
                    target.extend(one.iter().zip(two).map(|(&a, &b)| number::<T>(a * b)));
                }
            }
        }
        Ok(())
    }
}

/// Functions that are multiples of series: what the series are multiplied with, once for all that are alike.
pub(super) struct Multiples {
    /// Formulas whose columns for a series of ones these are.
    alike: Vec<usize>,
    /// Place of the formula among those, and which of its coefficients; rising.
    columns: Vec<(usize, usize)>,
    ones: Vec<f64>,
    /// By function: place of what its series is multiplied with, and the number of the series.
    pub(super) of_function: Vec<Option<(usize, usize)>>,
}

impl Multiples {
    pub(super) fn of(sources: &Sources<'_>, numbering: &Numbering, functions: &[usize]) -> Self {
        let functions: Vec<Source> = functions.iter().map(|&function| numbering.source(function)).collect();
        let (alike, place_of) = alike(sources, &functions);
        let own: Vec<Option<((usize, usize), usize)>> = (functions.iter().zip(place_of))
            .map(|(&source, place)| match source {
                Source::Formula(formula, slot) => {
                    Some(((place?, slot), sources.formulas[formula].series?[1]))
                }
                _ => None,
            })
            .collect();
        let mut columns: Vec<(usize, usize)> = own.iter().flatten().map(|one| one.0).collect();
        columns.sort_unstable();
        columns.dedup();
        let place = |column: (usize, usize)| columns.partition_point(|&one| one < column);
        let of_function = own.iter().map(|own| own.map(|(column, series)| (place(column), series))).collect();
        Self { alike, columns, ones: vec![1.0; sources.rows.n_rows], of_function }
    }

    /// Sets `target` to what series are multiplied with over some rows, column after column; `of_formula` is room.
    pub(super) fn set<T: Real>(
        &self,
        target: &mut Vec<T>,
        of_formula: &mut Vec<f64>,
        sources: &Sources<'_>,
        rows: Range<usize>,
    ) -> Result<(), CandidateError> {
        let n = rows.len();
        target.clear();
        for own in self.columns.chunk_by(|one, other| one.0 == other.0) {
            evaluate_with(sources, self.alike[own[0].0], &self.ones, rows.clone(), of_formula)?;
            for &(_, slot) in own {
                target.extend(of_formula[slot * n..(slot + 1) * n].iter().map(|&value| number::<T>(value)));
            }
        }
        Ok(())
    }
}

/// The formulas that all which are proportional to a series are multiples of, and of each function the place of its own.
fn alike(sources: &Sources<'_>, functions: &[Source]) -> (Vec<usize>, Vec<Option<usize>>) {
    let mut found: Vec<usize> = Vec::new();
    let place_of = (functions.iter())
        .map(|&source| {
            let Source::Formula(number, _) = source else { return None };
            let own = &sources.formulas[number];
            if !own.is_multiple_of_series() {
                return None;
            }
            let is_alike = |&other: &usize| {
                let other = &sources.formulas[other];
                other.expression.is_same(&own.expression)
                    && other.series.map(|one| one[0]) == own.series.map(|one| one[0])
                    && other.inner == own.inner
            };
            Some(found.iter().position(is_alike).unwrap_or_else(|| {
                found.push(number);
                found.len() - 1
            }))
        })
        .collect();
    (found, place_of)
}

fn evaluate(
    sources: &Sources<'_>,
    formula: usize,
    rows: Range<usize>,
    values: &mut Vec<f64>,
) -> Result<(), CandidateError> {
    let series = sources.formulas[formula].series.map_or(&[] as &[f64], |[_, series]| sources.series[series]);
    evaluate_with(sources, formula, series, rows, values)
}

/// With these numbers for its series, if it has one.
fn evaluate_with(
    sources: &Sources<'_>,
    formula: usize,
    followed: &[f64],
    rows: Range<usize>,
    values: &mut Vec<f64>,
) -> Result<(), CandidateError> {
    let Formula { expression, inner, series, .. } = &sources.formulas[formula];
    values.resize(expression.coefficients().len() * rows.len(), 0.0);
    if let Some([variable, _]) = *series {
        let mut variables = sources.rows.variables.to_vec();
        variables[variable] = followed;
        let own = Rows { variables: &variables, ..sources.rows };
        expression.coefficient_columns(&own, rows, inner, values)?;
    } else {
        expression.coefficient_columns(&sources.rows, rows, inner, values)?;
    }
    Ok(())
}

pub(super) fn number<T: Real>(value: f64) -> T {
    T::nearest(if value.is_finite() { value } else { 0.0 })
}
