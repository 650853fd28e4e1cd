//! Formulas: values, derivatives, sequences, refusals, and texts from untrusted places.

#![allow(clippy::unwrap_used, clippy::panic, reason = "that is how a test fails")]

mod common;
mod derivatives;
mod hostile;
mod refusals;
mod rows;
mod sequences;
mod values;
