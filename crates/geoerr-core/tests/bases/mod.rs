//! Bases, curves and elements: identities, derivatives by differences, integrals by quadrature, refusals.

#![allow(clippy::unwrap_used, clippy::panic, reason = "what a test did not expect must end it")]

mod common;
mod curves;
mod functionals;
mod functions;
mod hexahedra;
mod refusals;
