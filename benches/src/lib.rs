//! Bench harness: `cargo bench -p geoerr-bench`. Rivals and fixtures live here, never in the library.

pub mod gcode;
