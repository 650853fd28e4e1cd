//! The mathematics of geoerr, free of Python, OpenCV, clocks and the network.
//!
//! Lengths are millimetres and angles radians throughout; names carry the unit.
//! Errors are actual minus nominal, of the tool as seen from the work.

mod arithmetic;
pub mod bases;
pub mod candidates;
pub mod expression;
pub mod gcode;
pub mod history;
pub mod kinematics;
pub mod least_squares;
pub mod line;
pub mod marker;
pub mod newton;
pub mod noise_likelihood;
pub mod straightness;
pub mod triangulate;
pub mod volumetric;
