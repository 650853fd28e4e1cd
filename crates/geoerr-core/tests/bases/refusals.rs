//! What is refused, and with what data.

use geoerr_core::bases::{Basis, BasisError};

fn refused(basis: Result<Basis, BasisError>) -> BasisError {
    basis.unwrap_err()
}

#[test]
fn positions_that_do_not_rise() {
    let error = refused(Basis::linear_elements(vec![0.0, 2.0, 1.0]));
    assert!(matches!(
        error,
        BasisError::NotRising { what: "node", index: 2, previous_mm: 2.0, position_mm: 1.0, .. }
    ));
    assert!(matches!(
        refused(Basis::linear_elements(vec![0.0, 1e-7])),
        BasisError::NotRising { index: 1, .. }
    ));
    assert!(matches!(refused(Basis::polynomial(3.0, 3.0, 2)), BasisError::NotRising { .. }));
    assert!(matches!(
        refused(Basis::bspline(vec![0.0, 2.0, 1.0], 3)),
        BasisError::NotRising { what: "knot", .. }
    ));
    for bad in [f64::NAN, f64::INFINITY, -1e10] {
        assert!(matches!(
            refused(Basis::bspline(vec![0.0, bad, 1.0], 3)),
            BasisError::Position { index: 1, .. }
        ));
        assert!(matches!(
            refused(Basis::quadratic_elements(vec![bad, 1.0, 2.0])),
            BasisError::Position { .. }
        ));
        assert!(matches!(refused(Basis::fourier(0.0, bad, 2.0, 1)), BasisError::Position { index: 1, .. }));
    }
}

#[test]
fn numbers_that_do_not_fit() {
    assert_eq!(
        refused(Basis::linear_elements(vec![1.0])),
        BasisError::TooFew { what: "nodes", found: 1, needed: 2 }
    );
    assert!(matches!(refused(Basis::bspline(vec![], 2)), BasisError::TooFew { found: 0, .. }));
    assert!(matches!(refused(Basis::bspline(vec![1.0, 1.0], 2)), BasisError::TooFew { found: 1, .. }));
    assert_eq!(
        refused(Basis::quadratic_elements(vec![0.0, 1.0, 2.0, 3.0])),
        BasisError::EvenNodes { found: 4 }
    );
    assert_eq!(
        refused(Basis::bspline(vec![0.0, 1.0], 5)),
        BasisError::TooHigh { what: "degree", found: 5, most: 4 }
    );
    assert!(matches!(refused(Basis::polynomial(0.0, 1.0, usize::MAX)), BasisError::TooHigh { most: 12, .. }));
    assert!(matches!(refused(Basis::fourier(0.0, 1.0, 1.0, 65)), BasisError::TooHigh { most: 64, .. }));
    let many: Vec<f64> = (0..5000).map(f64::from).collect();
    assert!(matches!(
        refused(Basis::linear_elements(many)),
        BasisError::TooManyFunctions { found: 5000, most: 4096 }
    ));
    let repeated: Vec<f64> = (0..2000)
        .map(f64::from)
        .flat_map(|knot| std::iter::repeat_n(knot, if knot % 1999.0 == 0.0 { 1 } else { 3 }))
        .collect();
    assert!(matches!(refused(Basis::bspline(repeated, 3)), BasisError::TooManyFunctions { .. }));
}

#[test]
fn knots_repeated_until_the_spline_would_jump() {
    assert!(Basis::bspline(vec![0.0, 5.0, 5.0, 5.0, 9.0], 3).is_ok());
    assert_eq!(
        refused(Basis::bspline(vec![0.0, 5.0, 5.0, 5.0, 5.0, 9.0], 3)),
        BasisError::KnotRepeated { position_mm: 5.0, found: 4, most: 3 }
    );
    assert_eq!(
        refused(Basis::bspline(vec![0.0, 0.0, 5.0], 3)),
        BasisError::KnotRepeated { position_mm: 0.0, found: 2, most: 1 }
    );
}

#[test]
fn periods() {
    for period in [0.0, -2.0, f64::NAN, f64::INFINITY, 1e-7, 40_001.0] {
        assert!(
            matches!(refused(Basis::fourier(0.0, 400.0, period, 1)), BasisError::Period { .. }),
            "{period}"
        );
    }
    assert!(Basis::fourier(0.0, 400.0, 40_000.0, 1).is_ok());
}

#[test]
fn integrals_of_integrals() {
    let angle = Basis::polynomial(0.0, 1.0, 2).unwrap();
    let straightness = Basis::tangent_integral(angle).unwrap();
    assert_eq!(refused(Basis::tangent_integral(straightness)), BasisError::NestedTangentIntegral);
}

#[test]
fn coefficients() {
    let basis = Basis::polynomial(0.0, 1.0, 2).unwrap();
    assert_eq!(basis.curve(&[1.0]), Err(BasisError::Count { what: "coefficients", found: 1, needed: 3 }));
    assert!(matches!(
        basis.curve(&[1.0, f64::NAN, 0.0]),
        Err(BasisError::NotFinite { what: "coefficient", index: 1, .. })
    ));
}
