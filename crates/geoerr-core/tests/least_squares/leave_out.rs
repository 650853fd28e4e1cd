//! Blocks left out, against refits that never saw them.

use std::ops::Range;

use geoerr_core::least_squares::{
    Blocks, LeastSquaresError, Matrix, Options, Restriction, StoredDesign, leave_blocks_out,
    leave_blocks_out_of_residuals, solve,
};
use rayon::ThreadPoolBuilder;

use super::common::{solved, triangle_of};
use crate::draws::Draws;

fn without(matrix: &Matrix, rows: Range<usize>) -> Matrix {
    let kept = |i: usize| if i < rows.start { i } else { i + rows.len() };
    Matrix::from_fn(matrix.n_rows() - rows.len(), matrix.n_columns(), |i, j| matrix[(kept(i), j)])
}

fn residual(a: &Matrix, b: &Matrix, x: &Matrix, row: usize) -> f64 {
    b[(row, 0)] - (0..a.n_columns()).map(|j| a[(row, j)] * x[(j, 0)]).sum::<f64>()
}

/// What is held out of rows that alone see unknown 4 is what a refit predicts, across the direction of that unknown.
fn assert_across_own(a: &Matrix, rows: Range<usize>, held_out: &[f64], predicted: &[f64]) {
    let own: Vec<f64> = rows.clone().map(|row| a[(row, 4)]).collect();
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let best = dot(&own, predicted) / dot(&own, &own);
    for (at, row) in rows.enumerate() {
        assert!((held_out[row] - (predicted[at] - best * own[at])).abs() < 1e-12, "{row}");
    }
}

#[test]
fn as_a_refit_without_the_block() {
    let mut draws = Draws::new(1);
    // Blocks lower and higher than the rank, an empty one, and more rows than are made at once.
    let (a, b) = (draws.matrix(1_300, 12), draws.matrix(1_300, 1));
    let starts = [0, 1, 4, 7, 7, 40, 60, 700];
    let blocks = Blocks::starting_at(&starts, 1_300).unwrap();
    let design = StoredDesign::new(&a, &b).unwrap();
    let left = leave_blocks_out(&design, &solved(&a, &b), &blocks, 0).unwrap();
    assert!(left.is_determined.iter().all(|&is_determined| is_determined));
    assert_eq!((left.is_determined.len(), left.held_out.len()), (8, 1_300));
    for block in 0..blocks.len() {
        let rows = blocks.rows(block);
        let refit = solved(&without(&a, rows.clone()), &without(&b, rows.clone())).x;
        for row in rows {
            assert!((left.held_out[row] - residual(&a, &b, &refit, row)).abs() < 1e-12, "{row}");
        }
    }
}

#[test]
fn a_block_that_alone_sees_an_unknown_is_said_to() {
    let mut draws = Draws::new(2);
    let mut a = draws.matrix(90, 6);
    for i in 0..90 {
        // Only rows 30..33 see unknown 4; unknown 5 repeats unknown 0.
        a[(i, 4)] = if (30..33).contains(&i) { a[(i, 4)] } else { 0.0 };
        a[(i, 5)] = -2.0 * a[(i, 0)];
    }
    let b = draws.matrix(90, 1);
    let starts: Vec<usize> = (0..30).map(|block| 3 * block).collect();
    let blocks = Blocks::starting_at(&starts, 90).unwrap();
    let design = StoredDesign::new(&a, &b).unwrap();
    let left = leave_blocks_out(&design, &solved(&a, &b), &blocks, 0).unwrap();
    for block in 0..30 {
        assert_eq!(left.is_determined[block], block != 10);
        assert_eq!(left.held_out[3 * block].is_nan(), block == 10);
    }
    let refit = solved(&without(&a, 0..3), &without(&b, 0..3)).x;
    assert!((left.held_out[1] - residual(&a, &b, &refit, 1)).abs() < 1e-12);
}

#[test]
fn a_prediction_is_as_uncertain_as_the_rest_leaves_it() {
    let mut draws = Draws::new(6);
    let (a, b) = (draws.matrix(80, 7), draws.matrix(80, 1));
    let blocks = Blocks::starting_at(&[0, 3, 30], 80).unwrap();
    let left = leave_blocks_out(&StoredDesign::new(&a, &b).unwrap(), &solved(&a, &b), &blocks, 0).unwrap();
    for block in 0..3 {
        let variance = summed_variance(&a, &b, blocks.rows(block), |_| 1.0);
        assert!((left.prediction_variance[block] / variance - 1.0).abs() < 1e-11, "{block}");
    }
}

/// Variances of what a fit without some rows predicts of them, each times its weight.
fn summed_variance(a: &Matrix, b: &Matrix, rows: Range<usize>, weight: impl Fn(usize) -> f64) -> f64 {
    let refit = solved(&without(a, rows.clone()), &without(b, rows.clone()));
    rows.map(|row| {
        let c: Vec<f64> = (0..a.n_columns()).map(|j| a[(row, j)]).collect();
        weight(row) * refit.functional(&c, 0).unwrap().unwrap().variance
    })
    .sum()
}

#[test]
fn a_blocks_own_unknown_stays_at_its_best() {
    // Rows 30..42 have an unknown of their own: left out, they are predicted across the direction in which it moves them.
    let mut draws = Draws::new(7);
    let mut a = draws.matrix(90, 6);
    for i in (0..90).filter(|i| !(30..42).contains(i)) {
        a[(i, 4)] = 0.0;
    }
    let b = draws.matrix(90, 1);
    let solution = solved(&a, &b);
    let residuals = Matrix::from_fn(90, 1, |i, _| residual(&a, &b, &solution.x, i));
    let design = StoredDesign::new(&a, &residuals).unwrap();
    let blocks = Blocks::starting_at(&[0, 30, 42], 90).unwrap();
    let left = leave_blocks_out_of_residuals(&design, &solution, &blocks, &[0, 1, 0], None).unwrap();
    assert_eq!(left.is_determined, [true; 3]);
    let refit = solved(&without(&a, 30..42), &without(&b, 30..42)).x;
    let predicted: Vec<f64> = (30..42).map(|row| residual(&a, &b, &refit, row)).collect();
    assert_across_own(&a, 30..42, &left.held_out, &predicted);
    let strict = leave_blocks_out_of_residuals(&design, &solution, &blocks, &[0; 3], None).unwrap();
    assert_eq!(strict.is_determined, [true, false, true]);
    let refused = leave_blocks_out_of_residuals(&design, &solution, &blocks, &[0; 2], None);
    assert_eq!(refused, Err(LeastSquaresError::RowsDiffer { expected: 3, found: 2 }));
}

/// Blocks that are summed up a chunk at a time: unknown 4 is the second block's own, unknown 5 is not seen in the first.
#[test]
fn tall_blocks_are_left_out_as_low_ones() {
    let mut draws = Draws::new(8);
    let mut a = draws.matrix(1_900, 6);
    for i in 0..1_900 {
        a[(i, 4)] = if (600..1_250).contains(&i) { a[(i, 4)] } else { 0.0 };
        a[(i, 5)] = if i < 600 { 0.0 } else { 1e5 * a[(i, 5)] };
    }
    let b = draws.matrix(1_900, 1);
    let solution = solved(&a, &b);
    let residuals = Matrix::from_fn(1_900, 1, |i, _| residual(&a, &b, &solution.x, i));
    let blocks = Blocks::starting_at(&[0, 600, 1_250], 1_900).unwrap();
    let design = StoredDesign::new(&a, &residuals).unwrap();
    let strict = leave_blocks_out_of_residuals(&design, &solution, &blocks, &[0; 3], None).unwrap();
    assert_eq!(strict.is_determined, [true, false, true]);
    assert!((600..1_250).all(|row| strict.held_out[row].is_nan()));
    assert!(strict.prediction_variance[1].is_nan());
    let weight = |row: usize| 1.0 + (row % 5) as f64;
    let weights: Vec<f64> = (0..1_900).map(weight).collect();
    let left =
        leave_blocks_out_of_residuals(&design, &solution, &blocks, &[0, 1, 0], Some(&weights)).unwrap();
    assert_eq!(left.is_determined, [true; 3]);
    for block in [0, 2] {
        let rows = blocks.rows(block);
        let refit = solved(&without(&a, rows.clone()), &without(&b, rows.clone()));
        for row in rows {
            assert!((left.held_out[row] - residual(&a, &b, &refit.x, row)).abs() < 1e-12, "{row}");
        }
        let variance = summed_variance(&a, &b, blocks.rows(block), weight);
        assert!((left.prediction_variance[block] / variance - 1.0).abs() < 1e-11, "{block}");
    }
    let refit = solved(&without(&a, 600..1_250), &without(&b, 600..1_250)).x;
    let predicted: Vec<f64> = (600..1_250).map(|row| residual(&a, &b, &refit, row)).collect();
    assert_across_own(&a, 600..1_250, &left.held_out, &predicted);
}

#[test]
fn restrictions_are_kept() {
    let mut draws = Draws::new(3);
    let (a, b) = (draws.matrix(60, 5), draws.matrix(60, 1));
    let restriction = Restriction::Constraints(draws.matrix(2, 5));
    let options = Options { restriction, ..Options::default() };
    let solution = solve(&triangle_of(&a, &b), &options).unwrap();
    let blocks = Blocks::starting_at(&[0, 20], 60).unwrap();
    let left = leave_blocks_out(&StoredDesign::new(&a, &b).unwrap(), &solution, &blocks, 0).unwrap();
    let refit = solve(&triangle_of(&without(&a, 0..20), &without(&b, 0..20)), &options).unwrap();
    for row in 0..20 {
        assert!((left.held_out[row] - residual(&a, &b, &refit.x, row)).abs() < 1e-13);
    }
}

#[test]
fn threads_do_not_change_a_byte() {
    let mut draws = Draws::new(4);
    let (a, b) = (draws.matrix(3_000, 20), draws.matrix(3_000, 1));
    let solution = solved(&a, &b);
    let starts: Vec<usize> = (0..1_000).map(|block| 3 * block).collect();
    let blocks = Blocks::starting_at(&starts, 3_000).unwrap();
    let design = StoredDesign::new(&a, &b).unwrap();
    let results = [1, 2, 7].map(|n| {
        let pool = ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| leave_blocks_out(&design, &solution, &blocks, 0).unwrap())
    });
    assert!(results.iter().all(|result| *result == results[0]));
}

#[test]
fn refusals() {
    let mut draws = Draws::new(5);
    let (a, b) = (draws.matrix(30, 4), draws.matrix(30, 1));
    let (design, solution) = (StoredDesign::new(&a, &b).unwrap(), solved(&a, &b));
    let blocks = Blocks::starting_at(&[0], 29).unwrap();
    let refused = leave_blocks_out(&design, &solution, &blocks, 0);
    assert_eq!(refused, Err(LeastSquaresError::RowsDiffer { expected: 30, found: 29 }));
    let blocks = Blocks::starting_at(&[0], 30).unwrap();
    let refused = leave_blocks_out(&design, &solution, &blocks, 1);
    assert_eq!(refused, Err(LeastSquaresError::NoSuchRightHandSide { index: 1, n_rhs: 1 }));
    assert_eq!(Blocks::starting_at(&[1], 30), Err(LeastSquaresError::Cuts { index: 0 }));
    assert_eq!(Blocks::starting_at(&[0, 5, 4], 30), Err(LeastSquaresError::Cuts { index: 1 }));
    assert_eq!(Blocks::starting_at(&[0, 31], 30), Err(LeastSquaresError::Cuts { index: 1 }));
}
