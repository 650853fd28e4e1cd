//! The one way from Python into the core: interpreter released, threads bounded, errors mapped.

use geoerr_core::least_squares::clear_wide_registers;
use pyo3::marker::Ungil;
use pyo3::prelude::*;

use crate::errors::CoreError;

/// Runs `work` with the interpreter released, on at most `threads` threads (0 = all cores).
///
/// Results never depend on `threads`: the core splits work into fixed blocks and joins them in order.
pub fn enter_core<T, E, F>(py: Python<'_>, threads: usize, work: F) -> PyResult<T>
where
    F: FnOnce() -> Result<T, E> + Send + Ungil,
    T: Send + Ungil,
    E: Into<CoreError> + Send + Ungil,
{
    // NumPy may have multiplied matrices on this thread.
    clear_wide_registers();
    let outcome = py.detach(|| -> Result<Result<T, E>, CoreError> {
        if threads == 0 {
            return Ok(work());
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|source| CoreError::thread_pool(&source))?;
        Ok(pool.install(work))
    });
    outcome.map_err(PyErr::from)?.map_err(|error| PyErr::from(error.into()))
}
