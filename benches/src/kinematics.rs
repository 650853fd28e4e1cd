//! A machine and places that kinematics is measured with.

use geoerr_core::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Squareness, Table};

/// Li's printer: 400 mm, a table entry each 20 mm, his squareness; 0.2 mm and 1 mrad otherwise.
pub fn machine() -> MachineModel {
    let mut errors = ErrorTables::default();
    for axis in Axis::ALL {
        for component in Component::ALL {
            let size = if component.index() < 3 { 0.2 } else { 1e-3 };
            let knots: Vec<f64> = (0..=20).map(|k| 20.0 * f64::from(k)).collect();
            let phase = (axis.index() * 6 + component.index()) as f64;
            let values = knots.iter().map(|q| size * (q / 70.0 + phase).sin()).collect();
            if let Ok(table) = Table::new(knots, values) {
                errors.set(axis, component, table);
            }
        }
    }
    let li = Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 };
    assert!(errors.set_squareness(li).is_ok());
    let chain = Chain::parse("wZbXYt");
    chain
        .map(|chain| MachineModel::new(chain, errors, [0.0; 3]))
        .unwrap_or_else(|error| unreachable!("{error}"))
}

/// Places all over the machine, each far from the one before.
pub fn rows(n_rows: usize) -> Vec<[f64; 3]> {
    let golden = [0.618_033_988_749_895, 0.754_877_666_246_693, 0.819_172_513_396_164];
    (0..n_rows).map(|k| golden.map(|step| 400.0 * (k as f64 * step).fract())).collect()
}
