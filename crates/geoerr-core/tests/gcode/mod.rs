//! The rewriting of programs, from bytes to bytes.

#![allow(clippy::unwrap_used, clippy::panic, reason = "that is how a test fails")]

mod common;
mod fuzz;
mod lines;
mod refusals;
mod round_trip;
mod state;
mod stream;
