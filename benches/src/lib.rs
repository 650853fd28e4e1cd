//! Bench harness: `cargo bench -p geoerr-bench`. Rivals and fixtures live here, never in the library.

pub mod gcode;
pub mod kinematics;
pub mod least_squares;
pub mod lines;
pub mod straightness;
pub mod triangulation;
