//! The only place where Rust meets Python.
//!
//! Each file binds one module of `geoerr-core`: it takes array views, releases the interpreter,
//! runs the core, and maps the core's errors to the family in `geoerr.errors`.

mod arrays;
mod bases;
mod candidates;
mod channels;
mod core_door;
mod errors;
mod expression;
mod fit;
mod gcode;
mod history;
mod kinematics;
mod least_squares;
mod line;
mod marker;
mod noise_likelihood;
mod pickled;
mod straightness;
mod term_machine;
mod triangulate;
mod volumetric;

use pyo3::prelude::*;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    bases::register(module)?;
    candidates::register(module)?;
    channels::register(module)?;
    expression::register(module)?;
    fit::register(module)?;
    gcode::register(module)?;
    history::register(module)?;
    kinematics::register(module)?;
    least_squares::register(module)?;
    line::register(module)?;
    marker::register(module)?;
    noise_likelihood::register(module)?;
    straightness::register(module)?;
    term_machine::register(module)?;
    triangulate::register(module)?;
    volumetric::register(module)?;
    Ok(())
}
