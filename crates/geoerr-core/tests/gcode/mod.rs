//! The rewriting of programs, from bytes to bytes.

mod common;
mod fuzz;
mod lines;
mod refusals;
mod round_trip;
mod state;
mod stream;
