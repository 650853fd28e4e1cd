//! Bases, curves and elements: identities, derivatives by differences, integrals by quadrature, refusals.

mod common;
mod curves;
mod functionals;
mod functions;
mod hexahedra;
mod refusals;
