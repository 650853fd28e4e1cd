//! Least squares against nalgebra, against what is known in closed form, and against itself.

#![allow(clippy::unwrap_used, clippy::panic, reason = "that is how a test fails")]

mod common;
mod identities;
mod leave_out;
mod nist;
mod normal_equations;
mod orthonormal;
mod solution;
mod triangle;
