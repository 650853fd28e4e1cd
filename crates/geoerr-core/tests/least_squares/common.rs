//! Systems to solve, and second opinions on them.

use geoerr_core::least_squares::{Matrix, Options, Solution, StoredDesign, Triangle, solve};
use nalgebra::DMatrix;

pub fn to_nalgebra(matrix: &Matrix) -> DMatrix<f64> {
    DMatrix::from_column_slice(matrix.n_rows(), matrix.n_columns(), matrix.as_slice())
}

pub fn triangle_of(a: &Matrix, b: &Matrix) -> Triangle {
    Triangle::of(&StoredDesign::new(a, b).unwrap()).unwrap()
}

pub fn solved(a: &Matrix, b: &Matrix) -> Solution {
    solve(&triangle_of(a, b), &Options::default()).unwrap()
}

/// Minimum-norm solution by nalgebra's SVD, columns brought to norm 1 as the crate does.
pub fn by_svd(a: &Matrix, b: &Matrix, tolerance: f64) -> DMatrix<f64> {
    let mut scaled = to_nalgebra(a);
    let norms: Vec<f64> = scaled.column_iter().map(|c| if c.norm() > 0.0 { c.norm() } else { 1.0 }).collect();
    for (mut column, norm) in scaled.column_iter_mut().zip(&norms) {
        column /= *norm;
    }
    let svd = scaled.svd(true, true);
    let largest = svd.singular_values.max();
    let mut x = svd.solve(&to_nalgebra(b), tolerance * largest).unwrap();
    for (mut row, norm) in x.row_iter_mut().zip(&norms) {
        row /= *norm;
    }
    x
}

pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let product = to_nalgebra(a) * to_nalgebra(b);
    Matrix::from_columns(a.n_rows(), b.n_columns(), product.as_slice().to_vec()).unwrap()
}

pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(
        0.0,
        |largest, value| if value.abs() > largest || value.is_nan() { value.abs() } else { largest },
    )
}

pub fn difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    largest(a.iter().zip(b).map(|(a, b)| a - b))
}
