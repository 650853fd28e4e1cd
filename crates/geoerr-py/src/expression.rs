//! Binds `geoerr_core::expression`: a parsed formula as an immutable handle.

use std::collections::BTreeMap;

use geoerr_core::expression::{Definitions, Expression, Rows, RowsError, Symbols};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::arrays::{from_numbers, numbers};
use crate::core_door::enter_core;
use crate::errors::CoreError;
use crate::pickled::pickled;

/// A formula. Immutable, so that any number of threads may ask it.
#[pyclass(frozen, name = "Expression", module = "geoerr._core")]
pub struct PyExpression {
    expression: Expression,
}

/// The rows of a call as NumPy has them.
struct Arrays<'a, 'py> {
    columns: &'a PyReadonlyArray2<'py, f64>,
    starts: &'a PyReadonlyArray1<'py, i64>,
    t: Option<&'a PyReadonlyArray1<'py, f64>>,
}

impl PyExpression {
    /// The core's formula, for the other bindings.
    pub fn core(&self) -> &Expression {
        &self.expression
    }

    /// Runs `work` over all rows into `n_columns` columns, and gives them as an (n, n_columns) array.
    fn columns<'py, F>(
        &self,
        py: Python<'py>,
        arrays: &Arrays<'_, 'py>,
        n_columns: usize,
        threads: usize,
        work: F,
    ) -> PyResult<Bound<'py, PyArray2<f64>>>
    where
        F: FnOnce(&Expression, &Rows<'_>, &mut [f64]) -> Result<(), RowsError> + Send + Sync,
    {
        let n_rows = arrays.columns.shape()[1];
        let variables = variable_columns(arrays.columns)?;
        let starts = places(arrays.starts)?;
        let t = arrays.t.map(|t| numbers(t, "t")).transpose()?;
        let rows = Rows { variables: &variables, n_rows, starts: &starts, t };
        let expression = &self.expression;
        let values = enter_core(py, threads, || {
            let mut values = vec![0.0; n_columns * n_rows];
            work(expression, &rows, &mut values).map(|()| values)
        })?;
        values.into_pyarray(py).reshape([n_columns, n_rows])?.transpose()
    }
}

/// The rows of a contiguous (k, n) array.
fn variable_columns<'a>(columns: &'a PyReadonlyArray2<'_, f64>) -> Result<Vec<&'a [f64]>, CoreError> {
    let refused = || CoreError::shape("columns must be a C-contiguous (k, n) array of float64");
    if !columns.is_c_contiguous() {
        return Err(refused());
    }
    let all = columns.as_slice().map_err(|_| refused())?;
    let [n_columns, n_rows] = [columns.shape()[0], columns.shape()[1]];
    Ok((0..n_columns).map(|column| &all[column * n_rows..(column + 1) * n_rows]).collect())
}

/// First rows of sequences.
pub fn places(starts: &PyReadonlyArray1<'_, i64>) -> Result<Vec<usize>, CoreError> {
    let starts = starts
        .as_slice()
        .map_err(|_| CoreError::shape("starts must be a C-contiguous (m,) array of int64"))?;
    let place = |&start: &i64| {
        usize::try_from(start).map_err(|_| CoreError::shape(format!("start {start} is negative")))
    };
    starts.iter().map(place).collect()
}

pickled!(PyExpression: expression);

#[pymethods]
impl PyExpression {
    #[new]
    fn new(
        text: &str,
        variables: Vec<String>,
        coefficients: Vec<String>,
        inner: Vec<String>,
        definitions: BTreeMap<String, String>,
    ) -> PyResult<Self> {
        let symbols = Symbols { variables, coefficients, inner };
        let definitions: Definitions = definitions.into_iter().collect();
        let expression = Expression::parse(text, &symbols, &definitions).map_err(CoreError::from)?;
        Ok(Self { expression })
    }

    /// The formula as it was written.
    #[getter]
    fn text(&self) -> &str {
        self.expression.text()
    }

    /// Names of the variables that the formula needs.
    #[getter]
    fn variables_used(&self) -> Vec<&str> {
        self.expression.variables_used().collect()
    }

    /// Names of the coefficients that the formula uses.
    #[getter]
    fn coefficients_used(&self) -> Vec<&str> {
        let names = self.expression.coefficients();
        self.expression.coefficients_used().iter().map(|&index| names[index].as_str()).collect()
    }

    /// Whether a row's value depends on the rows before it.
    #[getter]
    fn needs_order(&self) -> bool {
        self.expression.needs_order()
    }

    /// The value of every row, (n,).
    #[pyo3(signature = (columns, coefficients, inner, starts, t, threads))]
    #[expect(clippy::too_many_arguments, reason = "one argument for each array of the call")]
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        columns: PyReadonlyArray2<'py, f64>,
        coefficients: PyReadonlyArray1<'py, f64>,
        inner: PyReadonlyArray1<'py, f64>,
        starts: PyReadonlyArray1<'py, i64>,
        t: Option<PyReadonlyArray1<'py, f64>>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let arrays = Arrays { columns: &columns, starts: &starts, t: t.as_ref() };
        let (coefficients, inner) = (numbers(&coefficients, "coefficients")?, numbers(&inner, "inner")?);
        let n_rows = columns.shape()[1];
        self.columns(py, &arrays, 1, threads, |expression, rows, out| {
            expression.evaluate(rows, 0..n_rows, coefficients, inner, out)
        })?
        .reshape([n_rows])
    }

    /// Derivatives by the coefficients, (n, n_coefficients).
    fn coefficient_columns<'py>(
        &self,
        py: Python<'py>,
        columns: PyReadonlyArray2<'py, f64>,
        inner: PyReadonlyArray1<'py, f64>,
        starts: PyReadonlyArray1<'py, i64>,
        t: Option<PyReadonlyArray1<'py, f64>>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let arrays = Arrays { columns: &columns, starts: &starts, t: t.as_ref() };
        let inner = numbers(&inner, "inner")?;
        let n_columns = self.expression.coefficients().len();
        let n_rows = columns.shape()[1];
        self.columns(py, &arrays, n_columns, threads, |expression, rows, out| {
            expression.coefficient_columns(rows, 0..n_rows, inner, out)
        })
    }

    /// Derivatives by the inner parameters, (n, n_inner).
    #[expect(clippy::too_many_arguments, reason = "one argument for each array of the call")]
    fn inner_derivatives<'py>(
        &self,
        py: Python<'py>,
        columns: PyReadonlyArray2<'py, f64>,
        coefficients: PyReadonlyArray1<'py, f64>,
        inner: PyReadonlyArray1<'py, f64>,
        starts: PyReadonlyArray1<'py, i64>,
        t: Option<PyReadonlyArray1<'py, f64>>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let arrays = Arrays { columns: &columns, starts: &starts, t: t.as_ref() };
        let (coefficients, inner) = (numbers(&coefficients, "coefficients")?, numbers(&inner, "inner")?);
        let n_columns = self.expression.inner().len();
        let n_rows = columns.shape()[1];
        self.columns(py, &arrays, n_columns, threads, |expression, rows, out| {
            expression.inner_derivatives(rows, 0..n_rows, coefficients, inner, out)
        })
    }

    /// Derivatives by the row's own x, y, z, (n, 3).
    #[expect(clippy::too_many_arguments, reason = "one argument for each array of the call")]
    fn position_derivatives<'py>(
        &self,
        py: Python<'py>,
        columns: PyReadonlyArray2<'py, f64>,
        coefficients: PyReadonlyArray1<'py, f64>,
        inner: PyReadonlyArray1<'py, f64>,
        starts: PyReadonlyArray1<'py, i64>,
        t: Option<PyReadonlyArray1<'py, f64>>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let arrays = Arrays { columns: &columns, starts: &starts, t: t.as_ref() };
        let (coefficients, inner) = (numbers(&coefficients, "coefficients")?, numbers(&inner, "inner")?);
        let n_rows = columns.shape()[1];
        self.columns(py, &arrays, 3, threads, |expression, rows, out| {
            expression.variable_derivatives(rows, 0..n_rows, coefficients, inner, out)
        })
    }

    /// Value and gradient by x, y, z at one point, history settled.
    fn evaluate_at<'py>(
        &self,
        py: Python<'py>,
        point: PyReadonlyArray1<'py, f64>,
        coefficients: PyReadonlyArray1<'py, f64>,
        inner: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(f64, Bound<'py, PyArray1<f64>>)> {
        let (coefficients, inner) = (numbers(&coefficients, "coefficients")?, numbers(&inner, "inner")?);
        let at = self.expression.evaluate_at(numbers(&point, "point")?, coefficients, inner);
        let (value, gradient) = at.map_err(CoreError::from)?;
        Ok((value, from_numbers(py, gradient.to_vec())))
    }
}

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyExpression>()
}
