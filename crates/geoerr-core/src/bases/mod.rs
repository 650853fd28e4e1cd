//! Bases for error functions: functions of one axis position that are combined with fitted coefficients.
//!
//! A [`Basis`] is a few functions over a range of positions; a [`Curve`] is their sum with coefficients, ready for fast
//! evaluation; a [`CurveSet`] is several curves that share one search. [`Hexahedra`] are three-dimensional elements, for
//! comparison only.
//!
//! Outside its range every function keeps its end value and has derivative 0. All numbers are exact to rounding: integrals
//! and least-squares lines are those of the functions, not of samples.
//!
//! # Source
//! B-splines: de Boor, *A Practical Guide to Splines*, ch. IX. Elements: Dobariya et al., §4, with the usual shape
//! functions of finite elements. The tangent integral and the gauge: Li et al. 2023, Eq. 19.
//!
//! # Verified
//! `tests/bases/`: derivatives by differences, integrals by Gauss quadrature, partition of unity, lines by their
//! definition, curves against bases. `tests/bases/` of the Python package: SciPy's `BSpline`, NumPy's Legendre series.

mod basis;
mod cells;
mod curve;
mod error;
mod fourier;
mod hexahedra;
mod legendre;
mod local;
mod order;
mod pieces;

pub use basis::{Basis, BasisKind};
pub use curve::{Curve, CurveSet};
pub use error::BasisError;
pub use hexahedra::Hexahedra;
pub use order::Order;
