//! Kinematics and its inverse against first-order sums (docs/theory/equations.md), a matrix implementation and differences.

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
