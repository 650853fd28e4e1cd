//! Binds what `geoerr_core::volumetric` fits: the problem, its unknowns, and what a solution leaves.

mod problem;
mod solution;
mod state;

use pyo3::prelude::*;

/// Adds this folder's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<state::PyFitState>()?;
    module.add_class::<solution::PyFitTriangle>()?;
    module.add_class::<solution::PyFitSolution>()?;
    module.add_class::<problem::PyFitSums>()?;
    module.add_class::<problem::PyFitProblem>()
}
