//! Eight-node elements.

use geoerr_core::bases::{BasisError, Hexahedra};
use proptest::prelude::*;

fn grid() -> Hexahedra {
    Hexahedra::new([vec![0.0, 100.0, 400.0], vec![-50.0, 50.0], vec![0.0, 20.0, 70.0, 300.0]]).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    /// Products of lines are held exactly, whatever the grid; outside, those of the nearest point.
    #[test]
    fn trilinear_functions_are_held(
        q in prop::array::uniform3(-100.0..500.0_f64), c in prop::array::uniform8(-1.0..1.0_f64),
    ) {
        let grid = grid();
        let function = |[x, y, z]: [f64; 3]| {
            let [x, y, z] = [x / 400.0, y / 50.0, z / 300.0];
            c[0] + c[1] * x + c[2] * y + c[3] * z + c[4] * x * y + c[5] * y * z + c[6] * x * z + c[7] * x * y * z
        };
        let nodes: Vec<f64> = [0.0, 100.0, 400.0]
            .iter()
            .flat_map(|&x| [-50.0, 50.0].iter().flat_map(move |&y| [0.0, 20.0, 70.0, 300.0].map(|z| [x, y, z])))
            .map(function)
            .collect();
        let row = grid.rows(&[q]);
        let value: f64 = row.iter().zip(&nodes).map(|(a, b)| a * b).sum();
        let held = [q[0].clamp(0.0, 400.0), q[1].clamp(-50.0, 50.0), q[2].clamp(0.0, 300.0)];
        prop_assert!((value - function(held)).abs() < 1e-14);
        prop_assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        prop_assert!(row.iter().filter(|&&value| value != 0.0).count() <= 8);
    }
}

#[test]
fn grids_are_checked() {
    let line = || vec![0.0, 1.0];
    assert_eq!(
        Hexahedra::new([line(), vec![3.0], line()]),
        Err(BasisError::TooFew { what: "grid lines", found: 1, needed: 2 })
    );
    assert!(matches!(
        Hexahedra::new([line(), line(), vec![0.0, 2.0, 1.0]]),
        Err(BasisError::NotRising { index: 2, .. })
    ));
    let many = || (0..17).map(f64::from).collect::<Vec<_>>();
    assert!(matches!(
        Hexahedra::new([many(), many(), many()]),
        Err(BasisError::TooManyFunctions { found: 4913, .. })
    ));
    assert_eq!(grid().n_nodes(), 24);
    assert!(grid().shape(&[f64::NAN, 0.0, 0.0]).1.iter().any(|value| value.is_nan()));
}
