//! What is refused, where, and in which words.

use geoerr_core::expression::{Definitions, Expression, MAX_TEXT_BYTES, Problem, Symbols};

use super::common::{refused, symbols};

fn known() -> Symbols {
    symbols("x y temp_bed d s v_x", "alpha b", "q_fixed tau")
}

/// Formula, the text at the marked place, and a part of the message.
const CASES: [(&str, &str, &str); 55] = [
    ("", "", "empty"),
    ("   ", "   ", "empty"),
    (
        "alpha*tempbed",
        "tempbed",
        "unknown name `tempbed` (did you mean `temp_bed`?); known are alpha, b, d, pi, q_fixed, s,",
    ),
    ("alpha*(X)", "X", "did you mean `x`?"),
    ("alpha*zzzzzz", "zzzzzz", "unknown name `zzzzzz`; known"),
    ("alpha*sinus(x)", "sinus", "unknown function `sinus`"),
    ("alpha*Sin(x)", "Sin", "did you mean `sin`?"),
    ("alpha*exp", "exp", "`exp` is a function: write `exp(...)`"),
    ("alpha*x(3)", "x", "unknown function `x`"),
    ("alpha*sin()", "sin()", "`sin` takes one argument, not 0"),
    ("alpha*sin(x, y)", "sin(x, y)", "`sin` takes one argument, not 2"),
    ("alpha*atan2(x)", "atan2(x)", "two arguments (y, x), not 1"),
    ("alpha*max(x)", "max(x)", "two or more arguments, not 1"),
    ("alpha*where(x, y)", "where(x, y)", "three arguments"),
    ("alpha*lag(x)", "lag(x)", "`lag` takes two arguments"),
    ("alpha*windup(x, y)", "windup(x, y)", "`windup` takes one argument"),
    ("alpha*(x + y", "(", "not closed"),
    ("alpha*sin(x", "(", "not closed"),
    ("alpha*x)", ")", "closes nothing"),
    ("alpha*(x, y)", ",", "an operator or `)`"),
    ("alpha*", "", "ends where a value is needed"),
    ("alpha**2", "**", "a power is written `^`"),
    ("alpha*(x = 2)", "=", "`==` compares"),
    ("alpha*(x > 1 && y > 1)", "&&", "multiply the comparisons"),
    ("alpha*(x || y)", "||", "max"),
    ("alpha*x y", "y", "an operator is missing"),
    ("2alpha", "alpha", "an operator is missing"),
    ("alpha (x)", "alpha", "unknown function"),
    ("alpha*2 (x)", "(", "an operator is missing"),
    ("alpha*1e", "e", "an operator is missing"),
    ("alpha*1e999", "1e999", "too large"),
    ("alpha*π", "π", "write `pi`"),
    ("alpha·x", "·", "multiply with `*`"),
    ("alpha*x²", "²", "`^`"),
    ("alpha*[x]", "[", "brackets are `(` and `)`"),
    ("alpha*x; b", ";", "separated by `,`"),
    ("alpha*x ? 1", "?", "no meaning"),
    ("alpha*!x", "!", "no meaning"),
    ("alpha*/x", "/", "a value is needed here"),
    ("alpha*(1 < x < 2)", "<", "(a < b)*(b < c)"),
    ("alpha*x*b", "alpha*x*b", "a product of coefficients"),
    ("x/alpha", "alpha", "a division by a coefficient"),
    ("sin(alpha)", "alpha", "a function of a coefficient"),
    ("x*(alpha - b)^2", "(alpha - b)", "a power of a coefficient"),
    ("2^alpha", "alpha", "a power of a coefficient"),
    ("(alpha > 0)*b", "alpha", "a comparison of a coefficient"),
    ("where(b, alpha, 0)", "b", "a condition on a coefficient"),
    ("min(alpha, 0)", "alpha", "a function of a coefficient"),
    ("lag(alpha*x, b)", "b", "a time constant with a coefficient"),
    ("windup(b)*x", "b", "a length with a coefficient"),
    ("alpha*x + y", "y", "this part has no coefficient"),
    ("1 - alpha*x", "1", "this part has no coefficient"),
    ("alpha*x*(b + x*y)", "x*y", "this part has no coefficient"),
    ("where(x, alpha, 3)", "3", "this part has no coefficient"),
    ("x*y", "x*y", "none of the coefficients alpha, b is used"),
];

#[test]
fn the_place_is_marked() {
    for (text, place, words) in CASES {
        let error = refused(text, &known(), &[]);
        assert_eq!(&error.text[error.span.clone()], place, "{text}");
        let message = error.to_string();
        assert!(message.contains(words), "{text}: {message}");
        assert_eq!(error.definition, None);
    }
}

#[test]
fn the_message_shows_the_line_and_carets() {
    let error = refused("alpha*x\n\t+ b*tempbed*2", &known(), &[]);
    let lines: Vec<String> = error.to_string().lines().map(str::to_owned).collect();
    assert_eq!(lines[1..], ["   + b*tempbed*2", "       ^^^^^^^"]);
    // Where something is missing the caret stands behind the text.
    let error = refused("alpha*", &known(), &[]);
    assert!(error.to_string().ends_with("\n  alpha*\n        ^"), "{error}");
    // Far into a long line only the surroundings are shown, characters count and not bytes, nothing reaches a terminal.
    let long = format!("alpha*({}\u{1b}[31m)", "x + ".repeat(200));
    let message = refused(&long, &known(), &[]).to_string();
    assert!(message.lines().all(|line| line.chars().count() < 120), "{message}");
    assert!(!message.contains('\u{1b}'));
}

#[test]
fn a_problem_in_a_definition_marks_the_definition() {
    let error = refused("alpha*T*x", &known(), &[("T", "tempbed - 20")]);
    assert_eq!((error.definition.as_deref(), &error.text[error.span.clone()]), (Some("T"), "tempbed"));
    assert!(error.to_string().starts_with("in the definition of `T`: unknown name `tempbed`"), "{error}");
    let error = refused(
        "alpha*windup(2)",
        &symbols("x d_x s_x", "alpha", ""),
        &[("d", "d_x"), ("s", "s_x + nought")],
    );
    assert_eq!((error.definition.as_deref(), &error.text[error.span.clone()]), (Some("s"), "nought"));
}

#[test]
fn definitions_cannot_need_themselves() {
    let pairs = [("p", "2*q1"), ("q1", "r + 1"), ("r", "p*3")];
    let error = refused("alpha*p", &known(), &pairs);
    let Problem::Recursive { chain } = *error.problem else { panic!("{error}") };
    assert_eq!(chain, ["p", "q1", "r", "p"]);
    let error = refused("alpha*u", &known(), &[("u", "u + 1")]);
    assert!(matches!(*error.problem, Problem::Recursive { .. }), "{error}");
}

#[test]
fn windup_needs_a_direction_and_a_travel() {
    let error = refused("b*windup(2)", &symbols("x s", "b", ""), &[]);
    assert!(error.to_string().contains("unknown name `d`"), "{error}");
    assert_eq!(&error.text[error.span.clone()], "windup(2)");
}

#[test]
fn a_speed_in_a_lag_needs_its_mean() {
    let error = refused("b*lag(abs(v_x), 2)", &known(), &[]);
    assert!(error.to_string().contains("unknown name `mean_v_x`"), "{error}");
    assert_eq!(&error.text[error.span.clone()], "v_x");
}

#[test]
fn names_that_cannot_be_told_apart_are_refused() {
    let error = refused("k*T", &symbols("temp k", "k", ""), &[("T", "temp - k")]);
    assert!(matches!(*error.problem, Problem::Ambiguous { .. }), "{error}");
    for (coefficients, inner, pairs) in
        [("k k", "", vec![]), ("k", "k", vec![]), ("q", "", vec![("q", "x")]), ("a", "q", vec![("q", "x")])]
    {
        let error = refused("x", &symbols("x", coefficients, inner), &pairs);
        assert!(matches!(*error.problem, Problem::ParameterTaken { .. }), "{error}");
    }
    for name in ["sin", "pi", "2k", "k-1", "ä", ""] {
        let symbols = Symbols { coefficients: vec![name.to_owned()], ..symbols("x", "", "") };
        let error = refused("x", &symbols, &[]);
        assert!(matches!(*error.problem, Problem::ParameterName { .. }), "{error}");
    }
}

#[test]
fn zero_needs_no_coefficient() {
    let zero = Expression::parse("0", &known(), &Definitions::default()).unwrap();
    assert!(zero.coefficients_used().is_empty());
    assert!(Expression::parse("alpha*x + 0", &known(), &Definitions::default()).is_ok());
}

#[test]
fn limits_are_held() {
    let nested = |depth: usize| format!("alpha*{}x{}", "(".repeat(depth), ")".repeat(depth));
    assert!(Expression::parse(&nested(62), &known(), &Definitions::default()).is_ok());
    assert!(matches!(*refused(&nested(64), &known(), &[]).problem, Problem::TooDeep));
    assert!(matches!(
        *refused(&format!("alpha*{}x", "-".repeat(2000)), &known(), &[]).problem,
        Problem::TooDeep
    ));
    assert!(matches!(
        *refused(&format!("alpha*{}x", "x^".repeat(900)), &known(), &[]).problem,
        Problem::TooDeep
    ));
    let long = format!("alpha*x{}", " ".repeat(MAX_TEXT_BYTES));
    assert!(matches!(*refused(&long, &known(), &[]).problem, Problem::TooLong { .. }));
    // A long chain from the left is not deep.
    let chain = format!("alpha*(x{})", "+x".repeat(2000));
    assert!(Expression::parse(&chain, &known(), &Definitions::default()).is_ok());
}
