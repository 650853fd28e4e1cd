//! Binds `geoerr_core::noise_likelihood`: blocks of rows and a likelihood as immutable handles.

use geoerr_core::noise_likelihood::{Blocks, Direction, Likelihood, Logs, Whitening};
use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyReadwriteArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::arrays::{contiguous, from_numbers, numbers, rows};
use crate::core_door::enter_core;
use crate::errors::CoreError;
use crate::expression::places;
use crate::pickled::pickled;

/// Blocks of rows. Immutable, so that any number of threads may ask it.
#[pyclass(frozen, name = "NoiseBlocks", module = "geoerr._core")]
pub struct PyNoiseBlocks {
    blocks: Blocks,
}

/// What whitens noise. Immutable.
#[pyclass(frozen, name = "NoiseWhitening", module = "geoerr._core")]
pub struct PyNoiseWhitening {
    whitening: Whitening,
}

/// The likelihood of the noise of residuals. Immutable.
#[pyclass(frozen, name = "NoiseLikelihood", module = "geoerr._core")]
pub struct PyNoiseLikelihood {
    likelihood: Likelihood,
}

type Array2<'py> = Bound<'py, PyArray2<f64>>;
type Array3<'py> = Bound<'py, PyArray3<f64>>;

/// The numbers of a (n, 3, m) array, and m.
fn three_wide<'a>(array: &'a PyReadonlyArray3<'_, f64>, name: &str) -> Result<(&'a [f64], usize), CoreError> {
    let refused = || CoreError::shape(format!("{name} must be a C-contiguous (n, 3, m) array of float64"));
    if array.shape()[1] != 3 {
        return Err(refused());
    }
    Ok((contiguous(array, refused)?, array.shape()[2]))
}

fn logs_of(array: &PyReadonlyArray2<'_, f64>) -> Result<[Logs; 3], CoreError> {
    let all = rows::<4>(array, "logs")?;
    <[Logs; 3]>::try_from(all).map_err(|_| CoreError::shape("logs must be (3, 4)"))
}

fn from_logs<'py>(py: Python<'py>, logs: [Logs; 3]) -> PyResult<Array2<'py>> {
    from_numbers(py, logs.concat()).reshape([3, 4])
}

pickled!(PyNoiseBlocks: blocks);

#[pymethods]
impl PyNoiseBlocks {
    #[new]
    fn new(
        block: PyReadonlyArray1<'_, i64>,
        session_starts: PyReadonlyArray1<'_, i64>,
        pass_number: PyReadonlyArray1<'_, i64>,
        time: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let passes =
            pass_number.as_slice().map_err(|_| CoreError::shape("pass_number must be contiguous"))?;
        let (of_row, starts) = (places(&block)?, places(&session_starts)?);
        let blocks = Blocks::new(of_row, &starts, passes.to_vec(), numbers(&time, "time")?.to_vec());
        Ok(Self { blocks: blocks.map_err(CoreError::from)? })
    }

    fn likelihood(
        &self,
        py: Python<'_>,
        weights: PyReadonlyArray2<'_, f64>,
        residual: PyReadonlyArray2<'_, f64>,
        basis: PyReadonlyArray3<'_, f64>,
        threads: usize,
    ) -> PyResult<PyNoiseLikelihood> {
        let (weights, residual) = (rows::<3>(&weights, "weights")?, rows::<3>(&residual, "residual")?);
        let (basis, n_basis) = three_wide(&basis, "basis")?;
        let blocks = self.blocks.clone();
        let likelihood =
            enter_core(py, threads, || Likelihood::new(blocks, weights, residual, basis, n_basis))?;
        Ok(PyNoiseLikelihood { likelihood })
    }

    /// What whitens noise of these logarithms.
    fn whitening(
        &self,
        py: Python<'_>,
        weights: PyReadonlyArray2<'_, f64>,
        logs: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<PyNoiseWhitening> {
        let (weights, logs) = (rows::<3>(&weights, "weights")?, logs_of(&logs)?);
        let whitening = enter_core(py, 1, || self.blocks.whitening(weights, &logs))?;
        Ok(PyNoiseWhitening { whitening })
    }

    /// Takes off whitened draws (n, 3, n_draws), in place, a basis (n, 3, r) and what a fit of their noise would.
    #[expect(clippy::too_many_arguments, reason = "the draws, and all that a fit of their noise depends on")]
    fn take_off(
        &self,
        py: Python<'_>,
        mut drawn: PyReadwriteArray3<'_, f32>,
        basis: PyReadonlyArray3<'_, f64>,
        weights: PyReadonlyArray2<'_, f64>,
        logs: PyReadonlyArray2<'_, f64>,
        shortest_memory: f64,
        size: f64,
        threads: usize,
    ) -> PyResult<()> {
        let (weights, logs) = (rows::<3>(&weights, "weights")?, logs_of(&logs)?);
        let (basis, _) = three_wide(&basis, "basis")?;
        let n_draws = drawn.shape()[2];
        let drawn = drawn
            .as_slice_mut()
            .map_err(|_| CoreError::shape("draws must be a C-contiguous (n, 3, n_draws) array of float32"))?;
        enter_core(py, threads, || {
            self.blocks.take_off(drawn, n_draws, basis, weights, &logs, shortest_memory, size)
        })
    }
}

pickled!(PyNoiseWhitening: whitening);

#[pymethods]
impl PyNoiseWhitening {
    /// V^(-1/2) times values (n, 3, m).
    fn whiten<'py>(
        &self,
        py: Python<'py>,
        values: PyReadonlyArray3<'py, f64>,
        threads: usize,
    ) -> PyResult<Array3<'py>> {
        self.apply(py, &values, Direction::Forward, threads)
    }

    /// V^(-T/2) times values (n, 3, m).
    fn whiten_transposed<'py>(
        &self,
        py: Python<'py>,
        values: PyReadonlyArray3<'py, f64>,
        threads: usize,
    ) -> PyResult<Array3<'py>> {
        self.apply(py, &values, Direction::Transposed, threads)
    }

    /// V^(1/2) times values (n, 3, m).
    fn unwhiten<'py>(
        &self,
        py: Python<'py>,
        values: PyReadonlyArray3<'py, f64>,
        threads: usize,
    ) -> PyResult<Array3<'py>> {
        self.apply(py, &values, Direction::Back, threads)
    }
}

impl PyNoiseWhitening {
    pub fn core(&self) -> &Whitening {
        &self.whitening
    }

    fn apply<'py>(
        &self,
        py: Python<'py>,
        values: &PyReadonlyArray3<'py, f64>,
        direction: Direction,
        threads: usize,
    ) -> PyResult<Array3<'py>> {
        let (numbers, width) = three_wide(values, "values")?;
        let result = enter_core(py, threads, || self.whitening.apply(numbers, width, direction))?;
        result.into_pyarray(py).reshape([values.shape()[0], 3, width])
    }
}

#[pymethods]
impl PyNoiseLikelihood {
    /// −2 ln L, but for a constant, and its gradient by `logs`.
    fn minus_twice_ln<'py>(
        &self,
        py: Python<'py>,
        logs: PyReadonlyArray2<'py, f64>,
        restricted: bool,
        threads: usize,
    ) -> PyResult<(f64, Array2<'py>)> {
        let logs = logs_of(&logs)?;
        let (value, gradient) =
            enter_core(py, threads, || self.likelihood.minus_twice_ln(&logs, restricted))?;
        Ok((value, from_logs(py, gradient)?))
    }

    /// Logarithms of the parameters, −2 ln L, and how many evaluations it took.
    fn fit<'py>(
        &self,
        py: Python<'py>,
        start: Option<PyReadonlyArray2<'py, f64>>,
        shortest_memory: f64,
        restricted: bool,
        threads: usize,
    ) -> PyResult<(Array2<'py>, f64, usize)> {
        let start = start.as_ref().map(logs_of).transpose()?;
        let fitted = enter_core(py, threads, || self.likelihood.fit(start, shortest_memory, restricted))?;
        Ok((from_logs(py, fitted.logs)?, fitted.minus_twice_ln_likelihood, fitted.n_evaluations))
    }

    /// With more columns.
    fn with_columns(
        &self,
        py: Python<'_>,
        weights: PyReadonlyArray2<'_, f64>,
        residual: PyReadonlyArray2<'_, f64>,
        basis: PyReadonlyArray3<'_, f64>,
        columns: PyReadonlyArray3<'_, f64>,
        threads: usize,
    ) -> PyResult<Self> {
        let (weights, residual) = (rows::<3>(&weights, "weights")?, rows::<3>(&residual, "residual")?);
        let (basis, _) = three_wide(&basis, "basis")?;
        let (columns, count) = three_wide(&columns, "columns")?;
        let likelihood = enter_core(py, threads, || {
            self.likelihood.with_columns(weights, residual, basis, columns, count)
        })?;
        Ok(Self { likelihood })
    }

    /// The basis, whitened and made orthonormal; None where its columns are too much alike for that in one product.
    fn whitened_basis<'py>(
        &self,
        py: Python<'py>,
        weights: PyReadonlyArray2<'py, f64>,
        basis: PyReadonlyArray3<'py, f64>,
        logs: PyReadonlyArray2<'py, f64>,
        threads: usize,
    ) -> PyResult<Option<Bound<'py, PyArray3<f64>>>> {
        let (weights, logs) = (rows::<3>(&weights, "weights")?, logs_of(&logs)?);
        let (values, width) = three_wide(&basis, "basis")?;
        let found = enter_core(py, threads, || self.likelihood.whitened_basis(weights, values, &logs))?;
        found.map(|found| found.into_pyarray(py).reshape([basis.shape()[0], 3, width])).transpose()
    }

    /// Whether anything was measured of each component.
    #[getter]
    fn is_used(&self) -> Vec<bool> {
        self.likelihood.is_used()
    }
}

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyNoiseBlocks>()?;
    module.add_class::<PyNoiseWhitening>()?;
    module.add_class::<PyNoiseLikelihood>()
}
