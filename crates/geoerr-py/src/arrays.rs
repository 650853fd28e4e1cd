//! NumPy arrays as the plain slices that the core takes, and back, without copies.

use numpy::ndarray::Dimension;
use numpy::{
    Element, IntoPyArray, PyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray,
    PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::errors::CoreError;

/// The numbers of an array in C's order; `as_slice` alone would take Fortran's too, and mix up rows and columns.
pub fn contiguous<'a, T: Element, D: Dimension>(
    array: &'a PyReadonlyArray<'_, T, D>,
    refused: impl FnOnce() -> CoreError,
) -> Result<&'a [T], CoreError> {
    array.as_slice().ok().filter(|_| array.is_c_contiguous()).ok_or_else(refused)
}

/// The rows of a contiguous (n, K) array.
pub fn rows<'a, const K: usize>(
    array: &'a PyReadonlyArray2<'_, f64>,
    name: &str,
) -> Result<&'a [[f64; K]], CoreError> {
    rows_of(array, name)
}

/// As [`rows`], of either precision.
pub fn rows_of<'a, T: numpy::Element, const K: usize>(
    array: &'a PyReadonlyArray2<'_, T>,
    name: &str,
) -> Result<&'a [[T; K]], CoreError> {
    let refused = || {
        CoreError::shape(format!(
            "{name} must be a C-contiguous (n, {K}) array of float{}",
            8 * size_of::<T>()
        ))
    };
    if array.shape()[1] != K {
        return Err(refused());
    }
    Ok(contiguous(array, refused)?.as_chunks::<K>().0)
}

/// The matrices of a contiguous (n, K, K) array.
pub fn matrices<'a, const K: usize>(
    array: &'a PyReadonlyArray3<'_, f64>,
    name: &str,
) -> Result<&'a [[[f64; K]; K]], CoreError> {
    let refused =
        || CoreError::shape(format!("{name} must be a C-contiguous (n, {K}, {K}) array of float64"));
    if array.shape()[1..] != [K, K] {
        return Err(refused());
    }
    Ok(contiguous(array, refused)?.as_chunks::<K>().0.as_chunks::<K>().0)
}

/// The numbers of a contiguous (n,) array.
pub fn numbers<'a>(array: &'a PyReadonlyArray1<'_, f64>, name: &str) -> Result<&'a [f64], CoreError> {
    array
        .as_slice()
        .map_err(|_| CoreError::shape(format!("{name} must be a C-contiguous (n,) array of float64")))
}

/// Rows as an (n, K) array; the memory changes hands.
pub fn from_rows<'py, const K: usize>(
    py: Python<'py>,
    rows: Vec<[f64; K]>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let n = rows.len();
    rows.into_flattened().into_pyarray(py).reshape([n, K])
}

/// 3 × 3 matrices as an (n, 3, 3) array; the memory changes hands.
pub fn from_matrices<'py>(
    py: Python<'py>,
    matrices: Vec<[[f64; 3]; 3]>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let n = matrices.len();
    matrices.into_flattened().into_flattened().into_pyarray(py).reshape([n, 3, 3])
}

/// Numbers as an (n,) array; the memory changes hands.
pub fn from_numbers<'py, T: numpy::Element>(py: Python<'py>, numbers: Vec<T>) -> Bound<'py, PyArray1<T>> {
    numbers.into_pyarray(py)
}

/// NumPy's `empty`: an array for whoever writes all of it. To clear it before costs a seventh of the points that fill it.
pub fn unfilled<'py, D: Dimension>(
    py: Python<'py>,
    shape: impl IntoPyObject<'py>,
) -> PyResult<Bound<'py, PyArray<f64, D>>> {
    static EMPTY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    Ok(EMPTY.import(py, "numpy", "empty")?.call1((shape,))?.cast_into()?)
}
