//! Texts from untrusted places: nothing panics, nothing grows beyond its limits, nothing takes long.

use std::time::{Duration, Instant};

use geoerr_core::expression::{Definitions, Expression, Problem, Rows};
use proptest::prelude::*;

use super::common::{definitions, refused, symbols};

#[test]
fn doubling_definitions_stay_small() {
    // Written out, the last is a sum of 2^60 terms.
    let names: Vec<String> = (0..=60).map(|k| format!("n{k}")).collect();
    let texts: Vec<String> =
        (0..60).map(|k| format!("n{} + n{}*x", k + 1, k + 1)).chain(["x".to_owned()]).collect();
    let definitions: Definitions = names.iter().zip(&texts).map(|(n, t)| (n.as_str(), t.as_str())).collect();
    let begun = Instant::now();
    let expression = Expression::parse("k*n0", &symbols("x", "k", ""), &definitions).unwrap();
    assert!(begun.elapsed() < Duration::from_secs(1));
    let (value, gradient) = expression.evaluate_at(&[0.5], &[1.0], &[]).unwrap();
    // x (1 + x)^60
    let expected = 0.5 * 1.5_f64.powi(60);
    assert!((value / expected - 1.0).abs() < 1e-13);
    assert!((gradient[0] / (1.5_f64.powi(60) + 30.0 * 1.5_f64.powi(59)) - 1.0).abs() < 1e-12);
}

#[test]
fn chains_of_definitions_are_bounded() {
    let names: Vec<String> = (0..=500).map(|k| format!("n{k}")).collect();
    let texts: Vec<String> = (1..=500).map(|k| format!("n{k}")).chain(["x".to_owned()]).collect();
    let pairs: Vec<(&str, &str)> = names.iter().zip(&texts).map(|(n, t)| (n.as_str(), t.as_str())).collect();
    let error = refused("k*n0", &symbols("x", "k", ""), &pairs);
    assert!(matches!(*error.problem, Problem::DefinitionsTooDeep), "{error}");
}

#[test]
fn a_small_stack_is_enough() {
    // The deepest brackets, signs, powers and calls that are read, in each of the longest chain of definitions.
    let worst = ["(", "-", "2^", "exp(", "lag(x, "].map(|opening| {
        let closing = if opening.contains('(') { ")" } else { "" };
        format!("{}x{}", opening.repeat(62), closing.repeat(62))
    });
    let pairs: Vec<(String, String)> =
        (0..63).map(|k| (format!("n{k}"), format!("n{} + {}", k + 1, worst[k % 5]))).collect();
    let definitions: Definitions = pairs.into_iter().chain([("n63".to_owned(), "x".to_owned())]).collect();
    let parse = move || Expression::parse("k*n0", &symbols("x", "k", ""), &definitions).map(|_| ());
    let thread = std::thread::Builder::new().stack_size(256 * 1024).spawn(parse).unwrap();
    assert_eq!(thread.join().unwrap(), Ok(()));
}

#[test]
fn many_operations_are_bounded() {
    // Every definition scales all coefficients anew: 60 · 8 · 200 distinct operations.
    let coefficients: Vec<String> = (0..200).map(|k| format!("c{k}")).collect();
    let all =
        coefficients.iter().enumerate().map(|(k, c)| format!("{c}*(x+{k})")).collect::<Vec<_>>().join("+");
    let scaled: Vec<(String, String)> = (0..60)
        .map(|k| (format!("n{k}"), (0..8).map(|j| format!("all*{k}.{j}1*x")).collect::<Vec<_>>().join("+")))
        .collect();
    let sum: Vec<&str> = scaled.iter().map(|(name, _)| name.as_str()).collect();
    let pairs: Vec<(&str, &str)> =
        scaled.iter().map(|(n, t)| (n.as_str(), t.as_str())).chain([("all", all.as_str())]).collect();
    let begun = Instant::now();
    let error = refused(&sum.join("+"), &symbols("x", &coefficients.join(" "), ""), &pairs);
    assert!(matches!(*error.problem, Problem::TooComplex), "{error}");
    assert!(begun.elapsed() < Duration::from_secs(5));
}

#[test]
fn derivatives_count_too() {
    // 600 inner parameters in one product: 600 derivatives of up to 600 factors each.
    let inner: Vec<String> = (0..600).map(|k| format!("p{k}")).collect();
    let error = refused(&inner.join("*"), &symbols("x", "", &inner.join(" ")), &[]);
    assert!(matches!(*error.problem, Problem::TooComplex), "{error}");
}

/// Parses, and evaluates what was accepted.
fn try_all(text: &str) {
    let symbols = symbols("x y z d s v_x mean_v_x T", "a b", "tau p");
    let pairs = definitions(&[("q", "x"), ("v", "v_x"), ("half", "q/2 + lag(v, tau)")]);
    match Expression::parse(text, &symbols, &pairs) {
        Ok(expression) => {
            let columns: Vec<Vec<f64>> =
                (0..8).map(|k| vec![0.0, -1.5, f64::from(k), f64::NAN, f64::INFINITY, 1e300]).collect();
            let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
            let rows = Rows { variables: &columns, n_rows: 6, starts: &[0, 2], t: None };
            let mut out = [0.0; 18];
            expression.evaluate(&rows, 0..6, &[1.0, 2.0], &[0.5, 3.0], &mut out[..6]).unwrap();
            expression.coefficient_columns(&rows, 1..6, &[0.5, 3.0], &mut out[..10]).unwrap();
            expression.inner_derivatives(&rows, 0..6, &[1.0, 2.0], &[0.5, 3.0], &mut out[..12]).unwrap();
            expression.variable_derivatives(&rows, 0..6, &[1.0, 2.0], &[0.5, 3.0], &mut out).unwrap();
            expression.evaluate_at(&[1.0; 8], &[1.0, 2.0], &[0.5, 3.0]).unwrap();
        }
        Err(error) => {
            assert!(error.span.start <= error.span.end && error.span.end <= error.text.len());
            assert!(
                error.text.get(error.span.clone()).is_some(),
                "{text:?}: {:?} cuts a character",
                error.span
            );
            assert!(!error.to_string().is_empty());
        }
    }
}

const TOKENS: [&str; 48] = [
    "x", "q", "T", "a", "b", "tau", "p", "half", "v", "d", "pi", "nought", "1", "2", "0", "0.5", "1e3", "1e",
    ".", "+", "-", "*", "/", "^", "<", "<=", ">", ">=", "==", "!=", "(", ")", "(", ")", ",", "sin(", "exp(",
    "abs(", "min(", "where(", "lag(", "windup(", "atan2(", "sqrt(", " ", "\n", "=", "é",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 6000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_text(text in "\\PC{0,60}") {
        try_all(&text);
    }

    #[test]
    fn random_bytes(bytes in prop::collection::vec(prop::num::u8::ANY, 0..60)) {
        try_all(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn random_tokens(tokens in prop::collection::vec(prop::sample::select(TOKENS.to_vec()), 0..40)) {
        try_all(&tokens.concat());
    }

    /// Token soup is almost never accepted; formulas with a token removed, doubled or replaced often are.
    #[test]
    fn nearly_formulas(
        which in prop::sample::select(vec![
            "a * T * ( q - p ) + b * lag( T , tau ) * sin( 2 * pi * q / p )",
            "- a / 2 * d * ( 1 - 2 * exp( - s / p ) ) + b * windup( p ) ^ 2",
            "a * where( q > p , q ^ 2 , - q ) + b * max( q , half , 3 ) * step( q - p )",
        ]),
        at in 0usize..40,
        how in 0..3,
        with in prop::sample::select(TOKENS.to_vec()),
    ) {
        let mut tokens: Vec<&str> = which.split(' ').collect();
        let at = at % tokens.len();
        match how {
            0 => { tokens.remove(at); }
            1 => tokens.insert(at, with),
            _ => tokens[at] = with,
        }
        try_all(&tokens.concat());
    }
}
