//! Least squares against nalgebra, against what is known in closed form, and against itself.

mod common;
mod triangle;
