//! Every derivative against differences of values.

use geoerr_core::expression::{Definitions, Expression, Rows};
use proptest::prelude::*;

use super::common::{assert_near, by_inner, evaluate, noise, parse, symbols};

/// Step of the five-point difference. Its error is h⁴ f⁽⁵⁾/30, about 1e-14 for functions of order 1, and rounding is
/// 1.5 ε f/h, about 3e-13: derivatives of functions of order 1 agree to 1e-10 with room for f⁽⁵⁾ of order 1000; the
/// tests allow 100 times that for functions with f⁽⁵⁾ of up to 1e5.
const H: f64 = 1e-3;
const TOLERANCE: f64 = 1e-10;

fn difference(f: impl Fn(f64) -> f64) -> f64 {
    (8.0 * (f(H) - f(-H)) - (f(2.0 * H) - f(-2.0 * H))) / (12.0 * H)
}

/// Formulas smooth at p = 0.3, x = 0.6, y = −0.8, z = 1.7, every function among them, as functions of p and x alike.
const FORMULAS: [&str; 42] = [
    "x + p",
    "x - p*y",
    "x*p*z",
    "x/(p + 1) - p/x",
    "(x + 2)^3*p^2",
    "(x + p)^-2",
    "(x*p + 2)^1.7",
    "x^0.5*p^0.5",
    "2^(x*p)",
    "(1 + x)^(p*z)",
    "(x*p)^(x + p)",
    "-sin(x*p)",
    "cos(x - p)",
    "tan(x*p)",
    "asin(x*p)",
    "acos(x*p - 0.2)",
    "atan(x/p)",
    "atan2(x, p)",
    "atan2(-x, y*p)",
    "exp(-x/p)",
    "log(x + p)",
    "sqrt(x + p^2)",
    "sinh(x*p)",
    "cosh(x*p)",
    "tanh(x*p)",
    "abs(x*y*p)",
    "abs(y - p)*x",
    "sign(y)*x*p",
    "step(x - p)*x*p",
    "min(x*p, p + 7)",
    "min(p + 7, x*p)",
    "max(x*p, p + 7, x*p + p)",
    "where(x > p, x*p^2, -x)",
    "where(x < p, x*p^2, -x*p)",
    "(x > p)*x*p + (x <= p)*7",
    "(x == p) + x + (x != p)*p",
    "pi*x^2*p^8 - x^-8*p",
    "lag(x*p, 2 + p)",
    "lag(x, p)*p",
    "windup(p)*x",
    "windup(x + p)",
    "(1 - exp(-z/(p + 1)))*sin(2*pi*x/(p + 1)) + cos(2*pi*x/(p + 1))",
];

const POINT: [f64; 5] = [0.6, -0.8, 1.7, -1.0, 0.4];

fn parsed(text: &str, coefficients: &str) -> Expression {
    parse(text, &symbols("x y z d s", coefficients, "p other"))
}

#[test]
fn by_an_inner_parameter() {
    for text in FORMULAS {
        let expression = parsed(text, "");
        let columns: Vec<[f64; 1]> = POINT.map(|value| [value]).to_vec();
        let columns: Vec<&[f64]> = columns.iter().map(|column| &column[..]).collect();
        let value = |h: f64| evaluate(&expression, &columns, &[], None, &[], &[0.3 + h, 5.0])[0];
        let found = by_inner(&expression, &columns, &[], None, &[], &[0.3, 5.0]);
        assert_near(found[0], difference(value), TOLERANCE * 100.0_f64.max(value(0.0).abs()), text);
        assert_eq!(found[1], 0.0, "{text} by a parameter that it does not have");
    }
}

#[test]
fn by_the_position() {
    for text in FORMULAS {
        let expression = parsed(text, "");
        let columns: Vec<[f64; 1]> = POINT.map(|value| [value]).to_vec();
        let columns: Vec<&[f64]> = columns.iter().map(|column| &column[..]).collect();
        let rows = Rows { variables: &columns, n_rows: 1, starts: &[], t: None };
        let mut found = [f64::NAN; 3];
        expression.variable_derivatives(&rows, 0..1, &[], &[0.3, 5.0], &mut found).unwrap();
        let (value, gradient) = expression.evaluate_at(&POINT, &[], &[0.3, 5.0]).unwrap();
        for axis in 0..3 {
            let moved = |h: f64| {
                let mut point = POINT;
                point[axis] += h;
                expression.evaluate_at(&point, &[], &[0.3, 5.0]).unwrap().0
            };
            let expected = difference(moved);
            assert_near(gradient[axis], expected, TOLERANCE * 100.0_f64.max(value.abs()), text);
            // A first row is settled: both ways agree.
            assert_near(found[axis], gradient[axis], 1e-13, text);
        }
    }
}

#[test]
fn corners_take_one_side_and_jumps_have_none() {
    let gradient =
        |text: &str, x: f64| parse(text, &symbols("x", "", "")).evaluate_at(&[x], &[], &[]).unwrap().1[0];
    assert_eq!(gradient("abs(x)", 0.0), 0.0);
    assert!([-1.0, 1.0].contains(&gradient("min(x, -x)", 0.0)));
    for text in ["step(x)", "sign(x)", "(x >= 0)", "where(x < 0, 1, 2)"] {
        assert_eq!(gradient(text, 0.0), 0.0, "{text}");
    }
    assert_eq!(gradient("x^2", 0.0), 0.0);
    assert_eq!(gradient("x*abs(x)", -3.0), 6.0);
    // 0^p stays 0 while p grows.
    let power = parse("x^p", &symbols("x", "", "p"));
    assert_eq!(by_inner(&power, &[&[0.0]], &[], None, &[], &[2.5]), [0.0]);
}

#[test]
fn coefficients_weigh_the_derivatives() {
    let expression = parsed("A*sin(x/p) + B*p*x", "A B");
    let (a, b, p, x) = (2.0, -3.0, 0.3_f64, 0.6_f64);
    let columns: [&[f64]; 5] = [&[x], &[0.0], &[0.0], &[1.0], &[1.0]];
    let found = by_inner(&expression, &columns, &[], None, &[a, b], &[p, 0.0]);
    assert_near(found[0], -a * (x / p).cos() * x / (p * p) + b * x, 1e-14, "by p");
    let mut point = [0.0; 5];
    point[0] = x;
    let (value, gradient) = expression.evaluate_at(&point, &[a, b], &[p, 0.0]).unwrap();
    assert_near(value, a * (x / p).sin() + b * p * x, 1e-14, "value");
    assert_near(gradient[0], a * (x / p).cos() / p + b * p, 1e-14, "by x");
}

/// A sequence of 40 rows with uneven times: d, s of strokes of uneven length, and three restarts of time.
struct Sequence {
    x: Vec<f64>,
    d: Vec<f64>,
    s: Vec<f64>,
    t: Vec<f64>,
    starts: Vec<usize>,
}

fn sequence(seed: u64) -> Sequence {
    let n = 40;
    let (x, steps, turns) = (noise(n, seed), noise(n, seed + 1), noise(n, seed + 2));
    let starts = vec![0, 13, 14];
    let (mut d, mut s, mut t) = (vec![1.0], vec![0.5], vec![0.0]);
    for row in 1..n {
        let is_start = starts.contains(&row);
        let before = if is_start { 0.0 } else { t[row - 1] };
        t.push(before + steps[row] + 0.5);
        let turned = turns[row] > 0.2;
        d.push(if turned { -d[row - 1] } else { d[row - 1] });
        s.push(if turned { 0.0 } else { s[row - 1] } + steps[row].abs());
    }
    Sequence { x, d, s, t, starts }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    /// Along a sequence: by parameters with all that earlier rows leave behind, by the position with it held.
    #[test]
    fn along_a_sequence(
        seed in 0u64..1000,
        which in prop::sample::select(vec![
            "k*lag(x*p, tau)", "k*lag(sin(x/p) + m, tau*p)", "k*lag(abs(v_x) + p*x, tau)", "k*windup(tau) + k*p*x",
            "k*windup(tau*p)*lag(d*x, p)", "k*lag(lag(x, tau), p)", "k*lag(windup(p), tau + exp(x))",
        ]),
        tau in 0.05..5.0f64,
    ) {
        let Sequence { x, d, s, t, starts } = sequence(seed);
        let m = noise(x.len(), seed + 3);
        let expression = Expression::parse(
            which,
            &symbols("x y z d s m v_x mean_v_x", "k", "tau p"),
            &Definitions::default(),
        ).unwrap();
        let zero = vec![0.0; x.len()];
        let columns: [&[f64]; 8] = [&x, &zero, &zero, &d, &s, &m, &zero, &m];
        let inner = [tau, 0.7];
        let found = by_inner(&expression, &columns, &starts, Some(&t), &[2.0], &inner);
        for parameter in 0..2 {
            let at = |h: f64| {
                let mut inner = inner;
                inner[parameter] += h * inner[parameter];
                evaluate(&expression, &columns, &starts, Some(&t), &[2.0], &inner)
            };
            let (a, b, c, e) = (at(H), at(-H), at(2.0 * H), at(-2.0 * H));
            for row in 0..x.len() {
                let by = (8.0 * (a[row] - b[row]) - (c[row] - e[row])) / (12.0 * H * inner[parameter]);
                // By τ = 0.05 the rounding of values is multiplied by 20.
                assert_near(found[parameter * x.len() + row], by, 1e-8, &format!("{which} row {row} by {parameter}"));
            }
        }
        let rows = Rows { variables: &columns, n_rows: x.len(), starts: &starts, t: Some(&t) };
        let mut by_position = vec![f64::NAN; 3 * x.len()];
        expression.variable_derivatives(&rows, 0..x.len(), &[2.0], &inner, &mut by_position).unwrap();
        for row in [0, 1, 7, 13, 14, 15, 39] {
            let moved = |h: f64| {
                let mut x = x.clone();
                x[row] += h;
                let mut columns = columns;
                columns[0] = &x;
                evaluate(&expression, &columns, &starts, Some(&t), &[2.0], &inner)[row]
            };
            assert_near(by_position[row], difference(moved), 1e-8, &format!("{which} row {row} by x"));
        }
    }
}
