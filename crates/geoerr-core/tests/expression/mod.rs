//! Formulas: values, derivatives, sequences, refusals, and texts from untrusted places.

mod common;
mod derivatives;
mod hostile;
mod refusals;
mod rows;
mod sequences;
mod values;
