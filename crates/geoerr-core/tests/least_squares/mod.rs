//! Least squares against nalgebra, against what is known in closed form, and against itself.

mod bordered;
mod common;
mod identities;
mod leave_out;
mod nist;
mod normal_equations;
mod orthonormal;
mod quick_triangle;
mod row_design;
mod solution;
mod triangle;
