//! Maps every error of the core to one exception of `geoerr.errors`, exhaustively and in one place.

use pyo3::exceptions::PyRuntimeError;
use pyo3::{PyErr, import_exception};

import_exception!(geoerr.errors, ShapeError);

/// A core error on its way to Python.
pub struct CoreError(PyErr);

impl CoreError {
    /// An array argument whose shape or memory layout does not fit.
    pub fn shape(message: impl Into<String>) -> Self {
        Self(ShapeError::new_err(message.into()))
    }

    /// A thread pool that the operating system refused.
    pub fn thread_pool(source: &rayon::ThreadPoolBuildError) -> Self {
        Self(PyRuntimeError::new_err(format!("no worker threads could be started: {source}")))
    }
}

impl From<CoreError> for PyErr {
    fn from(error: CoreError) -> Self {
        error.0
    }
}
