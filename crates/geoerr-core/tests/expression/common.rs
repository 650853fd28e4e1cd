//! Shorthand for formulas and rows.

use geoerr_core::expression::{Definitions, Expression, ExpressionError, Rows, Symbols};

use crate::draws::Draws;

pub fn names(names: &str) -> Vec<String> {
    names.split_whitespace().map(str::to_owned).collect()
}

pub fn symbols(variables: &str, coefficients: &str, inner: &str) -> Symbols {
    Symbols { variables: names(variables), coefficients: names(coefficients), inner: names(inner) }
}

pub fn definitions(pairs: &[(&str, &str)]) -> Definitions {
    pairs.iter().copied().collect()
}

pub fn parse(text: &str, symbols: &Symbols) -> Expression {
    match Expression::parse(text, symbols, &Definitions::default()) {
        Ok(expression) => expression,
        Err(error) => panic!("{error}"),
    }
}

pub fn refused(text: &str, symbols: &Symbols, pairs: &[(&str, &str)]) -> ExpressionError {
    match Expression::parse(text, symbols, &definitions(pairs)) {
        Ok(_) => panic!("{text} was accepted"),
        Err(error) => error,
    }
}

/// Value of a formula of numbers and variables at one row.
pub fn value_at(text: &str, variables: &[(&str, f64)]) -> f64 {
    let all = variables.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(" ");
    let columns: Vec<[f64; 1]> = variables.iter().map(|(_, value)| [*value]).collect();
    let columns: Vec<&[f64]> = columns.iter().map(|column| &column[..]).collect();
    evaluate(&parse(text, &symbols(&all, "", "")), &columns, &[], None, &[], &[])[0]
}

pub fn evaluate(
    expression: &Expression,
    columns: &[&[f64]],
    starts: &[usize],
    t: Option<&[f64]>,
    coefficients: &[f64],
    inner: &[f64],
) -> Vec<f64> {
    let n_rows = columns.iter().map(|column| column.len()).max().unwrap_or(1);
    let mut out = vec![f64::NAN; n_rows];
    let rows = Rows { variables: columns, n_rows, starts, t };
    expression.evaluate(&rows, 0..n_rows, coefficients, inner, &mut out).unwrap();
    out
}

pub fn by_inner(
    expression: &Expression,
    columns: &[&[f64]],
    starts: &[usize],
    t: Option<&[f64]>,
    coefficients: &[f64],
    inner: &[f64],
) -> Vec<f64> {
    let n_rows = columns[0].len();
    let mut out = vec![f64::NAN; n_rows * inner.len()];
    let rows = Rows { variables: columns, n_rows, starts, t };
    expression.inner_derivatives(&rows, 0..n_rows, coefficients, inner, &mut out).unwrap();
    out
}

/// Numbers that are near in the way of floating point, or both unknown, or the same infinity.
pub fn assert_near(found: f64, expected: f64, tolerance: f64, what: &str) {
    let is_same = found == expected || found.is_nan() && expected.is_nan();
    let scale = expected.abs().max(1.0);
    assert!(is_same || (found - expected).abs() <= tolerance * scale, "{what}: {found} is not {expected}");
}

/// Numbers between −1/2 and 1/2 without a pattern.
pub fn noise(n: usize, seed: u64) -> Vec<f64> {
    let mut draws = Draws::new(seed);
    (0..n).map(|_| 0.5 * draws.symmetric()).collect()
}
