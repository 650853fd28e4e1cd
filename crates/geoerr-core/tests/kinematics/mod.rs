//! Kinematics and its inverse against THEORY's first-order sums, a matrix implementation and differences.

mod abbe;
mod batch;
mod columns;
mod displacements;
mod first_order;
mod jacobian;
pub mod machines;
mod matrices;
mod newton;
mod nominal;
mod squareness;
