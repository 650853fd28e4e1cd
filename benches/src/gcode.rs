//! Machines and programs that G-code is measured with.

use geoerr_core::kinematics::{Axis, Chain, Component, ErrorTables, MachineModel, Squareness, Table};

/// Range of every axis.
pub const RANGE_MM: (f64, f64) = (-20.0, 420.0);

/// A printer: `none` has no errors, `square` Li's squareness, everything else also 18 bows with an entry each 10 mm.
pub fn bent(kind: &str) -> MachineModel {
    let mut errors = ErrorTables::default();
    let knots: Vec<f64> = (0..=44).map(|k| RANGE_MM.0 + 10.0 * f64::from(k)).collect();
    for axis in Axis::ALL {
        for component in Component::ALL {
            let size = if component.index() < 3 { 0.2 } else { 1e-3 };
            let phase = (axis.index() * 6 + component.index()) as f64;
            let values = knots.iter().map(|q| size * ((q / 70.0 + phase).sin() - phase.sin())).collect();
            if let (false, Ok(table)) = (matches!(kind, "none" | "square"), Table::new(knots.clone(), values))
            {
                errors.set(axis, component, table);
            }
        }
    }
    let li = Squareness { s_xy_rad: -5.05e-3, s_xz_rad: 1.24e-3, s_yz_rad: 3.84e-3 };
    assert!(kind == "none" || errors.set_squareness(li).is_ok());
    Chain::parse("wZbXYt")
        .map(|chain| MachineModel::new(chain, errors, [0.0; 3]))
        .unwrap_or_else(|error| unreachable!("{error}"))
}
