//! Formulas: values, derivatives, sequences, refusals, and texts from untrusted places.

mod common;
mod values;
