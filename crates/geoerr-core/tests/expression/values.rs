//! Values against an independent tree walk, and by hand.

use geoerr_core::expression::{Definitions, Expression};
use proptest::prelude::*;

use super::common::{assert_near, definitions, evaluate, parse, symbols, value_at};

#[test]
fn operators_bind_as_written() {
    let cases = [
        ("-2^2", -4.0),
        ("(-2)^2", 4.0),
        ("2^3^2", 512.0),
        ("2^-1", 0.5),
        ("2^-2^2", 0.0625),
        ("2*-3", -6.0),
        ("-2*3", -6.0),
        ("1 - 2 - 3", -4.0),
        ("12/3/2", 2.0),
        ("2 + 3*4", 14.0),
        ("--3", 3.0),
        ("-+3", -3.0),
        ("1 + 2 < 2*2", 1.0),
        ("1 < 2 + (3 > 4)", 1.0),
        ("(1 < 2)*5", 5.0),
        ("2 <= 2", 1.0),
        ("2 >= 3", 0.0),
        ("2 == 2", 1.0),
        ("2 != 2", 0.0),
        ("1e3 + 1.5E-1 + .5 + 2.", 1002.65),
        ("min(3, 1, 2)", 1.0),
        ("max(3, 1, 2)", 3.0),
        ("atan2(1, -1)", 2.356_194_490_192_345),
        ("where(0, 1, 2) + where(-3, 10, 20)", 12.0),
        ("step(0)", 1.0),
        ("step(-1e-300)", 0.0),
        ("sign(0) + sign(-3) + sign(0.1)", 0.0),
        ("cos(pi)", -1.0),
        ("log(exp(2))", 2.0),
        ("9^0.5 + 2^3 + 2^-3 + 2^9", 523.125),
    ];
    for (text, expected) in cases {
        assert_near(value_at(text, &[]), expected, 1e-15, text);
        // The same where nothing can be folded: the constant 1 replaced by a variable.
        let unfolded = text.replace("2", "(2*one)");
        if !unfolded.contains('e') && !unfolded.contains('.') {
            assert_near(value_at(&unfolded, &[("one", 1.0)]), expected, 1e-15, &unfolded);
        }
    }
}

#[test]
fn unknown_values_stay_unknown() {
    let unknown = [
        "u",
        "0*u",
        "u^0",
        "1^u",
        "u < 1",
        "u == u",
        "u != u",
        "step(u)",
        "sign(u)",
        "min(u, 1)",
        "max(1, u)",
        "min(1, u)",
        "abs(u)",
        "where(u, 1, 2)",
        "where(1, u, 2)",
        "atan2(u, 1)",
        "u - u",
        "lag(u, 1)",
        "lag(1, u)",
    ];
    for text in unknown {
        assert!(value_at(text, &[("u", f64::NAN)]).is_nan(), "{text}");
    }
    assert_eq!(value_at("where(1, 2, u)", &[("u", f64::NAN)]), 2.0);
}

#[test]
fn where_chooses_as_comparisons_do() {
    for q in [-5.0, 99.9, 100.0, 100.1] {
        let by_products = value_at("(q > 100)*q + (q <= 100)*3", &[("q", q)]);
        let by_choice = value_at("where(q > 100, q, 3)", &[("q", q)]);
        assert_eq!(by_products, by_choice);
    }
}

#[test]
fn a_name_may_stand_in_brackets() {
    assert_eq!(value_at("((u))*(3 - (u))", &[("u", 2.0)]), 2.0);
}

#[test]
fn definitions_are_inlined_with_their_brackets() {
    let definitions =
        definitions(&[("T", "temp - 20"), ("L", "400"), ("q", "x"), ("x", "x + 1"), ("half", "T/2")]);
    let symbols = symbols("x temp", "k", "");
    let expression = Expression::parse("k*2*T*q^2 + k*half", &symbols, &definitions).unwrap();
    let columns: [&[f64]; 2] = [&[3.0], &[25.0]];
    // In its own definition `x` is the variable; in that of `q` too.
    assert_eq!(evaluate(&expression, &columns, &[], None, &[1.0], &[]), [2.0 * 5.0 * 9.0 + 2.5]);
    let shifted = Expression::parse("k*x", &symbols, &definitions).unwrap();
    assert_eq!(evaluate(&shifted, &columns, &[], None, &[1.0], &[]), [4.0]);
    assert_eq!(expression.variables_used().collect::<Vec<_>>(), ["x", "temp"]);
}

#[test]
fn parameters_hide_columns_of_the_same_name() {
    let symbols = symbols("k x k tau", "k", "tau");
    let expression = parse("k*x*tau", &symbols);
    let columns: [&[f64]; 4] = [&[100.0], &[2.0], &[100.0], &[100.0]];
    assert_eq!(evaluate(&expression, &columns, &[], None, &[3.0], &[5.0]), [30.0]);
    assert_eq!(expression.variables_used().collect::<Vec<_>>(), ["x"]);
}

#[test]
fn what_is_used_is_named() {
    let symbols = symbols("x y temp v_x mean_v_x d_x s_x", "a b c", "tau lambda");
    let growth = Expression::parse("c*temp + a*y", &symbols, &Definitions::default()).unwrap();
    assert_eq!(growth.variables_used().collect::<Vec<_>>(), ["y", "temp"]);
    assert_eq!(growth.coefficients_used(), [0, 2]);
    assert!(!growth.needs_order());
    // Inside lag() a speed is the mean since the previous row.
    let pairs = definitions(&[("v", "v_x"), ("d", "d_x"), ("s", "s_x")]);
    let heating = Expression::parse("a*lag(abs(v), tau) + b*v", &symbols, &pairs).unwrap();
    assert_eq!(heating.variables_used().collect::<Vec<_>>(), ["v_x", "mean_v_x"]);
    assert!(heating.needs_order());
    let windup = Expression::parse("b*windup(lambda)", &symbols, &pairs).unwrap();
    assert_eq!(windup.variables_used().collect::<Vec<_>>(), ["d_x", "s_x"]);
    assert!(windup.needs_order());
}

#[test]
fn columns_are_what_each_coefficient_multiplies() {
    let symbols = symbols("x T", "a b c", "P");
    let expression = parse("-(a*sin(x/P) - 2*b*T + a)/4 + lag(b*T, 0) + where(T > 30, b, 0)*T", &symbols);
    let (x, t) = ([1.0, 2.0], [25.0, 35.0]);
    let columns: [&[f64]; 2] = [&x, &t];
    let rows = geoerr_core::expression::Rows { variables: &columns, n_rows: 2, starts: &[], t: None };
    let mut found = [0.0; 6];
    expression.coefficient_columns(&rows, 0..2, &[0.7], &mut found).unwrap();
    for row in 0..2 {
        let is_hot = f64::from(u8::from(t[row] > 30.0));
        assert_near(found[row], -((x[row] / 0.7_f64).sin() + 1.0) / 4.0, 1e-15, "a");
        assert_near(found[2 + row], 0.5 * t[row] + t[row] + is_hot * t[row], 1e-15, "b");
        assert_eq!(found[4 + row], 0.0, "c is not used");
    }
    let values = evaluate(&expression, &columns, &[], None, &[0.3, -2.0, 9.0], &[0.7]);
    for row in 0..2 {
        assert_near(values[row], 0.3 * found[row] - 2.0 * found[2 + row], 1e-15, "sum");
    }
}

/// A formula as a tree of its own, which prints itself and is evaluated by walking it.
#[derive(Debug, Clone)]
enum Tree {
    Number(f64),
    Variable(usize),
    Negate(Box<Tree>),
    Brackets(Box<Tree>),
    Infix(&'static str, Box<Tree>, Box<Tree>),
    Call(&'static str, Vec<Tree>),
}

const VARIABLES: [&str; 3] = ["x", "temp_bed", "d_"];

impl Tree {
    /// How strongly the outermost operation binds.
    fn strength(&self) -> u8 {
        match self {
            Self::Infix("<" | "<=" | ">" | ">=" | "==" | "!=", ..) => 1,
            Self::Infix("+" | "-", ..) => 2,
            Self::Infix("*" | "/", ..) => 3,
            Self::Negate(_) => 4,
            Self::Infix(..) => 5,
            Self::Number(_) | Self::Variable(_) | Self::Brackets(_) | Self::Call(..) => 6,
        }
    }

    /// Prints with no more brackets than are needed.
    fn print(&self) -> String {
        let within = |tree: &Tree, least: u8| {
            if tree.strength() < least { format!("({})", tree.print()) } else { tree.print() }
        };
        match self {
            Self::Number(value) => format!("{value:?}"),
            Self::Variable(index) => VARIABLES[*index].to_owned(),
            Self::Brackets(a) => format!("( {} )", a.print()),
            Self::Negate(a) => format!("-{}", within(a, 4)),
            Self::Infix("^", a, b) => format!("{}^{}", within(a, 6), within(b, 4)),
            Self::Infix(operator, a, b) => {
                let own = self.strength();
                // Comparisons do not chain; the others bind from the left.
                let left = if own == 1 { 2 } else { own };
                format!("{} {operator} {}", within(a, left), within(b, own + 1))
            }
            Self::Call(name, arguments) => {
                format!("{name}({})", arguments.iter().map(Self::print).collect::<Vec<_>>().join(", "))
            }
        }
    }

    fn walk(&self, variables: &[f64; 3]) -> f64 {
        let truth = |holds: bool| if holds { 1.0 } else { 0.0 };
        match self {
            Self::Number(value) => *value,
            Self::Variable(index) => variables[*index],
            Self::Negate(a) => -a.walk(variables),
            Self::Brackets(a) => a.walk(variables),
            Self::Infix(operator, a, b) => {
                let (a, b) = (a.walk(variables), b.walk(variables));
                if a.is_nan() || b.is_nan() {
                    return f64::NAN;
                }
                match *operator {
                    "+" => a + b,
                    "-" => a - b,
                    "*" => a * b,
                    "/" => a / b,
                    "^" => a.powf(b),
                    "<" => truth(a < b),
                    "<=" => truth(a <= b),
                    ">" => truth(a > b),
                    ">=" => truth(a >= b),
                    "==" => truth(a == b),
                    "!=" => truth(a != b),
                    _ => unreachable!(),
                }
            }
            Self::Call(name, arguments) => {
                let values: Vec<f64> = arguments.iter().map(|argument| argument.walk(variables)).collect();
                let a = values[0];
                if *name == "where" {
                    return if a.is_nan() { a } else { values[if a == 0.0 { 2 } else { 1 }] };
                }
                if values.iter().any(|value| value.is_nan()) {
                    return f64::NAN;
                }
                match *name {
                    "sin" => a.sin(),
                    "cos" => a.cos(),
                    "tan" => a.tan(),
                    "asin" => a.asin(),
                    "acos" => a.acos(),
                    "atan" => a.atan(),
                    "exp" => a.exp(),
                    "log" => a.ln(),
                    "sqrt" => a.sqrt(),
                    "sinh" => a.sinh(),
                    "cosh" => a.cosh(),
                    "tanh" => a.tanh(),
                    "abs" => a.abs(),
                    "sign" => truth(a > 0.0) - truth(a < 0.0),
                    "step" => truth(a >= 0.0),
                    "atan2" => a.atan2(values[1]),
                    "min" => values.iter().copied().fold(f64::INFINITY, f64::min),
                    "max" => values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                    _ => unreachable!(),
                }
            }
        }
    }
}

fn tree() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![
        prop::sample::select(vec![0.0, 1.0, 2.0, 3.0, 0.5, 7.25, 1e-3, 20.0]).prop_map(Tree::Number),
        (0.0..100.0).prop_map(Tree::Number),
        (0..3usize).prop_map(Tree::Variable),
        (0..3usize).prop_map(Tree::Variable),
    ];
    leaf.prop_recursive(6, 40, 3, |inner| {
        let operator = prop::sample::select(vec!["+", "-", "*", "/", "^", "<", "<=", ">", ">=", "==", "!="]);
        let function = prop::sample::select(vec![
            "sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "sqrt", "sinh", "cosh", "tanh", "abs",
            "sign", "step",
        ]);
        prop_oneof![
            inner.clone().prop_map(|a| Tree::Negate(Box::new(a))),
            inner.clone().prop_map(|a| Tree::Brackets(Box::new(a))),
            (operator, inner.clone(), inner.clone()).prop_map(|(o, a, b)| Tree::Infix(
                o,
                Box::new(a),
                Box::new(b)
            )),
            (function, inner.clone()).prop_map(|(f, a)| Tree::Call(f, vec![a])),
            (inner.clone(), inner.clone()).prop_map(|(a, b)| Tree::Call("atan2", vec![a, b])),
            (prop::bool::ANY, prop::collection::vec(inner.clone(), 2..4))
                .prop_map(|(is_min, all)| Tree::Call(if is_min { "min" } else { "max" }, all)),
            (inner.clone(), inner.clone(), inner).prop_map(|(a, b, c)| Tree::Call("where", vec![a, b, c])),
        ]
    })
}

/// Equal but for the rounding of what the engine computes otherwise (small powers as products), or both beyond reason:
/// a formula may multiply that rounding (tan near its pole, exp of much), so such trees are compared loosely.
fn agrees(found: f64, expected: f64, is_exact: bool) -> bool {
    found == expected
        || found.is_nan() && expected.is_nan()
        || !is_exact && (found - expected).abs() <= 1e-6 * expected.abs()
        || !is_exact && !expected.is_finite()
        || !is_exact && expected.abs() < 1e-6 && found.abs() < 1e-6
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_printed_tree_has_the_value_of_its_walk(
        tree in tree(),
        rows in prop::collection::vec((-3.0..3.0, 15.0..40.0, 0..3usize), 1..5),
    ) {
        let text = tree.print();
        prop_assume!(text.len() <= 4000);
        let expression = parse(&text, &symbols(&VARIABLES.join(" "), "", ""));
        let rows: Vec<[f64; 3]> = rows.iter().map(|&(x, temp, d)| [x, temp, [-1.0, 1.0, f64::NAN][d]]).collect();
        let columns: Vec<Vec<f64>> = (0..3).map(|k| rows.iter().map(|row| row[k]).collect()).collect();
        let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let found = evaluate(&expression, &columns, &[], None, &[], &[]);
        let is_exact = !text.contains('^');
        for (row, &found) in rows.iter().zip(&found) {
            let expected = tree.walk(row);
            // A discontinuity may fall either way under another rounding of a power; that is not an error.
            let jumps = ["<", ">", "==", "!=", "sign", "step", "where"].iter().any(|jump| text.contains(jump));
            prop_assert!(agrees(found, expected, is_exact) || !is_exact && jumps, "{text} at {row:?}: {found}, {expected}");
            let (single, _) = expression.evaluate_at(row, &[], &[]).unwrap();
            prop_assert!(single == found || single.is_nan() && found.is_nan(), "{text}: single {single}, {found}");
        }
    }
}
