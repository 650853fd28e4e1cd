//! Rows: lengths, blocks, threads.

use geoerr_core::expression::{Rows, RowsError};

use super::common::{noise, parse, symbols};

#[test]
fn every_row_is_computed_alike_wherever_it_stands() {
    let expression = parse(
        "A*sin(2*pi*x/P)*T^3 + B*where(x > 0, exp(x), sqrt(-x))/(1 + T^2) + A*min(x, T)",
        &symbols("x T", "A B", "P"),
    );
    let n = 10_000;
    let (x, t) = (noise(n, 1), noise(n, 2));
    let columns: [&[f64]; 2] = [&x, &t];
    let rows = Rows { variables: &columns, n_rows: n, starts: &[], t: None };
    let mut whole = vec![0.0; n];
    expression.evaluate(&rows, 0..n, &[2.0, 3.0], &[0.4], &mut whole).unwrap();
    let mut column = vec![0.0; 2 * n];
    expression.coefficient_columns(&rows, 0..n, &[0.4], &mut column).unwrap();
    for row in [0, 1, 255, 256, 4095, 4096, 9999] {
        let mut one = [0.0];
        expression.evaluate(&rows, row..row + 1, &[2.0, 3.0], &[0.4], &mut one).unwrap();
        assert_eq!(one[0], whole[row]);
        assert_eq!(2.0 * column[row] + 3.0 * column[n + row], whole[row]);
        let (single, _) = expression.evaluate_at(&[x[row], t[row]], &[2.0, 3.0], &[0.4]).unwrap();
        assert_eq!(single, whole[row]);
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let expression = parse("A*lag(sin(x/P), 3*P) + B*x^2*windup(P)", &symbols("x y z d s", "A B", "P"));
    let n = 20_000;
    let (x, turns) = (noise(n, 1), noise(n, 2));
    let d: Vec<f64> = turns.iter().map(|turn| turn.signum()).collect();
    let columns: [&[f64]; 5] = [&x, &x, &x, &d, &turns.iter().map(|turn| turn.abs()).collect::<Vec<_>>()];
    let starts: Vec<usize> = (0..n).step_by(333).collect();
    let rows = Rows { variables: &columns, n_rows: n, starts: &starts, t: None };
    let results: Vec<Vec<u64>> = [1, 2, 5]
        .into_iter()
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut out = vec![0.0; 6 * n];
            pool.install(|| {
                expression.evaluate(&rows, 0..n, &[2.0, 3.0], &[0.4], &mut out[..n]).unwrap();
                expression.inner_derivatives(&rows, 0..n, &[2.0, 3.0], &[0.4], &mut out[n..2 * n]).unwrap();
                expression
                    .variable_derivatives(&rows, 0..n, &[2.0, 3.0], &[0.4], &mut out[2 * n..5 * n])
                    .unwrap();
            });
            out.iter().map(|value| value.to_bits()).collect()
        })
        .collect();
    assert_eq!(results[0], results[1]);
    assert_eq!(results[0], results[2]);
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let expression = parse("k*T/P", &symbols("x T", "k", "P"));
    let (x, t, short) = ([1.0, 2.0], [3.0, 4.0], [5.0]);
    let columns: [&[f64]; 2] = [&x, &t];
    let good = Rows { variables: &columns, n_rows: 2, starts: &[0], t: None };
    let run = |rows: &Rows<'_>, coefficients: &[f64], inner: &[f64], n: usize| {
        expression.evaluate(rows, 0..2, coefficients, inner, &mut vec![0.0; n])
    };
    assert_eq!(run(&good, &[1.0], &[1.0], 2), Ok(()));
    let one: [&[f64]; 1] = [&x];
    let few = Rows { variables: &one, ..good };
    assert_eq!(run(&few, &[1.0], &[1.0], 2), Err(RowsError::VariableCount { needed: 2, found: 1 }));
    let uneven: [&[f64]; 2] = [&x, &short];
    let uneven = Rows { variables: &uneven, ..good };
    let name = "T".to_owned();
    assert_eq!(run(&uneven, &[1.0], &[1.0], 2), Err(RowsError::ColumnLength { name, n_rows: 2, found: 1 }));
    // A column that the formula does not use may be absent.
    let unused: [&[f64]; 2] = [&[], &t];
    assert_eq!(run(&Rows { variables: &unused, ..good }, &[1.0], &[1.0], 2), Ok(()));
    assert_eq!(run(&good, &[], &[1.0], 2), Err(RowsError::CoefficientCount { needed: 1, found: 0 }));
    assert_eq!(run(&good, &[1.0], &[1.0, 2.0], 2), Err(RowsError::InnerCount { needed: 1, found: 2 }));
    assert_eq!(run(&good, &[1.0], &[1.0], 3), Err(RowsError::OutputLength { needed: 2, found: 3 }));
    assert_eq!(
        run(&Rows { t: Some(&short), ..good }, &[1.0], &[1.0], 2),
        Err(RowsError::TimeLength { n_rows: 2, found: 1 })
    );
    for starts in [&[1][..], &[0, 0], &[0, 2]] {
        let refused = run(&Rows { starts, ..good }, &[1.0], &[1.0], 2);
        assert!(matches!(refused, Err(RowsError::BadStart { .. })), "{starts:?}");
    }
    let refused = expression.evaluate(&good, 1..3, &[1.0], &[1.0], &mut [0.0; 2]);
    assert_eq!(refused, Err(RowsError::BadRange { start: 1, end: 3, n_rows: 2 }));
    assert!(expression.evaluate_at(&[1.0], &[1.0], &[1.0]).is_err());
    assert_eq!(expression.evaluate(&good, 1..1, &[1.0], &[1.0], &mut []), Ok(()));
}

#[test]
fn a_plain_number_fills_its_rows() {
    let expression = parse("2*P", &symbols("", "", "P"));
    let rows = Rows { variables: &[], n_rows: 3, starts: &[], t: None };
    let mut out = [0.0; 3];
    expression.evaluate(&rows, 0..3, &[], &[4.0], &mut out).unwrap();
    assert_eq!(out, [8.0; 3]);
    expression.inner_derivatives(&rows, 0..3, &[], &[4.0], &mut out).unwrap();
    assert_eq!(out, [2.0; 3]);
}
