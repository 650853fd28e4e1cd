//! Tests of the core's public side, one binary: what they share is compiled and linked once.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::expect_used,
    reason = "what a test did not expect must end it"
)]

mod bases;
mod candidates;
mod draws;
mod expression;
mod gcode;
mod history;
mod kinematics;
mod least_squares;
mod line;
mod noise_likelihood;
mod straightness;
mod term_machine;
mod triangulate;
mod volumetric;
