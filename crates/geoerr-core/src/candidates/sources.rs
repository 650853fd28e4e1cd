//! The functions of the rows that columns are made of.

use super::error::CandidateError;
use super::noise::length;
use crate::expression::{Expression, Rows};
use crate::least_squares::Real;

/// A formula at one trial of its inner parameters: one function for each of its coefficients.
#[derive(Clone, Debug)]
pub struct Formula {
    /// The formula.
    pub expression: Expression,
    /// Values of its inner parameters.
    pub inner: Vec<f64>,
}

/// All functions, numbered: those of the formulas, one after the other, then those given, then products of two given.
#[derive(Clone, Debug)]
pub struct Sources<'a> {
    /// Where formulas are evaluated.
    pub rows: Rows<'a>,
    /// Formulas at trial values.
    pub formulas: &'a [Formula],
    /// Functions as numbers, row by row.
    pub given: &'a [&'a [f64]],
    /// Products of two of those given.
    pub products: &'a [[usize; 2]],
}

/// Where the functions of one scan lie.
pub(super) struct Numbering {
    first_of_formula: Vec<usize>,
    n_given: usize,
    n_products: usize,
}

impl Numbering {
    pub(super) fn of(sources: &Sources<'_>) -> Result<Self, CandidateError> {
        let mut first_of_formula = Vec::with_capacity(sources.formulas.len() + 1);
        let mut next = 0;
        for formula in sources.formulas {
            first_of_formula.push(next);
            next += formula.expression.coefficients().len();
        }
        first_of_formula.push(next);
        for given in sources.given {
            length("a given function", given.len(), sources.rows.n_rows)?;
        }
        for &one in sources.products.iter().flatten() {
            if one >= sources.given.len() {
                let count = sources.given.len();
                return Err(CandidateError::Missing { group: 0, what: "given function", found: one, count });
            }
        }
        Ok(Self { first_of_formula, n_given: sources.given.len(), n_products: sources.products.len() })
    }

    pub(super) fn n_functions(&self) -> usize {
        self.n_of_formulas() + self.n_given + self.n_products
    }

    fn n_of_formulas(&self) -> usize {
        self.first_of_formula.last().copied().unwrap_or(0)
    }
}

/// Evaluates functions (numbers rising) over all rows, column after column. What has no value is 0.
pub(super) fn evaluated<T: Real>(
    sources: &Sources<'_>,
    numbering: &Numbering,
    functions: &[usize],
) -> Result<Vec<T>, CandidateError> {
    let n_rows = sources.rows.n_rows;
    let mut values = Vec::with_capacity(functions.len() * n_rows);
    let (of_formulas, mut of_formula, mut known) = (numbering.n_of_formulas(), Vec::new(), usize::MAX);
    for &function in functions {
        if function < of_formulas {
            let formula = numbering.first_of_formula.partition_point(|&first| first <= function) - 1;
            if formula != known {
                let Formula { expression, inner } = &sources.formulas[formula];
                of_formula.resize(expression.coefficients().len() * n_rows, 0.0);
                expression.coefficient_columns(&sources.rows, 0..n_rows, inner, &mut of_formula)?;
                known = formula;
            }
            let slot = function - numbering.first_of_formula[formula];
            let own = &of_formula[slot * n_rows..(slot + 1) * n_rows];
            values.extend(own.iter().map(|&value| number::<T>(value)));
            continue;
        }
        let given = function - of_formulas;
        if given < numbering.n_given {
            values.extend(sources.given[given].iter().map(|&value| number::<T>(value)));
        } else {
            let [one, two] = sources.products[given - numbering.n_given].map(|place| sources.given[place]);
            values.extend(one.iter().zip(two).map(|(&a, &b)| number::<T>(a * b)));
        }
    }
    Ok(values)
}

fn number<T: Real>(value: f64) -> T {
    T::nearest(if value.is_finite() { value } else { 0.0 })
}
