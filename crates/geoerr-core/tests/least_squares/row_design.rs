//! Rows as they lie give what columns give.

use geoerr_core::least_squares::{
    Design, LeastSquaresError, Matrix, Method, Options, RowDesign, StoredDesign, fit, residual_products,
};

use super::common::{difference, largest, to_nalgebra};
use crate::draws::Draws;

fn by_rows(matrix: &Matrix) -> Vec<f64> {
    let rows = (0..matrix.n_rows()).flat_map(|row| (0..matrix.n_columns()).map(move |column| (row, column)));
    rows.map(|place| matrix[place]).collect()
}

/// Three blocks, of columns with an entry in every row or in a third of them.
fn systems() -> Vec<(Matrix, Matrix)> {
    let mut draws = Draws::new(7);
    let mut make = |is_dense: bool| {
        let a = Matrix::from_fn(1_300, 9, |row, column| {
            if is_dense || row * 3 / 1_300 == column % 3 { draws.symmetric() } else { 0.0 }
        });
        (a, draws.matrix(1_300, 2))
    };
    vec![make(true), make(false)]
}

#[test]
fn sums_are_those_of_columns() {
    for (a, b) in systems() {
        let (a_rows, b_rows) = (by_rows(&a), by_rows(&b));
        let rows = RowDesign::new((&a_rows, 9), (&b_rows, 2), 1_300).unwrap();
        let columns = StoredDesign::new(&a, &b).unwrap();
        let mut whole = to_nalgebra(&a).insert_columns(9, 2, 0.0);
        whole.columns_mut(9, 2).copy_from(&to_nalgebra(&b));
        if let Some(gram) = rows.lower_gram_of(100..900) {
            let part = whole.rows(100, 800);
            let expected = (part.transpose() * part).lower_triangle();
            assert!(difference(gram.as_slice(), expected.as_slice()) < 1e-12 * 800.0);
        } else {
            assert!((0..9).any(|column| (100..116).all(|row| a[(row, column)] == 0.0)));
        }
        for method in [Method::Fastest, Method::Qr] {
            let [own, other] = [&rows as &dyn Design<Error = LeastSquaresError>, &columns]
                .map(|design| fit(design, &Options::default(), method).unwrap());
            assert_eq!(own.is_from_normal_equations, method == Method::Fastest);
            assert!(difference(own.solution.x.as_slice(), other.solution.x.as_slice()) < 1e-14);
            let squares = own.solution.residual_ss.iter().zip(&other.solution.residual_ss);
            assert!(largest(squares.map(|(own, other)| own / other - 1.0)) < 1e-13);
        }
        let x = Draws::new(3).matrix(9, 2);
        let [own, other] = [&rows as &dyn Design<Error = LeastSquaresError>, &columns]
            .map(|design| residual_products(design, &x).unwrap());
        assert!(difference(own.as_slice(), other.as_slice()) < 1e-12 * largest(other.as_slice().to_vec()));
    }
}

#[test]
fn an_entry_that_is_no_number_is_named() {
    for (place, value) in [((0, 4), f64::NAN), ((1_250, 8), f64::INFINITY), ((700, 10), f64::NAN)] {
        let (mut a, mut b) = systems().remove(0);
        let (row, column) = place;
        if column < 9 {
            a[place] = value
        } else {
            b[(row, column - 9)] = value
        }
        let (a_rows, b_rows) = (by_rows(&a), by_rows(&b));
        let design = RowDesign::new((&a_rows, 9), (&b_rows, 2), 1_300).unwrap();
        let expected = LeastSquaresError::NonFinite { row, column };
        assert_eq!(fit(&design, &Options::default(), Method::Fastest).unwrap_err(), expected);
        assert_eq!(residual_products(&design, &Matrix::zeros(9, 2)).unwrap_err(), expected);
    }
}

#[test]
fn other_lengths_are_refused() {
    let (a, b) = (vec![0.0; 12], vec![0.0; 3]);
    let found = RowDesign::new((&a, 3), (&b, 1), 4).unwrap_err();
    assert_eq!(found, LeastSquaresError::RowsDiffer { expected: 4, found: 3 });
}
