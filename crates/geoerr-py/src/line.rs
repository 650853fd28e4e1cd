//! Binds `geoerr_core::line`.

use geoerr_core::line::{Asked, FittedLines, PointNoise, fit_lines_for};
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::arrays::{from_matrices, from_numbers, from_rows, matrices, rows};
use crate::core_door::enter_core;
use crate::errors::CoreError;

/// Centroids (m, 3), directions (m, 3), rms (m,), direction covariances (m, 3, 3) or (0, 3, 3), distances along (n,) or (0,), status (m,).
type LineArrays<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<u8>>,
);

/// Total-least-squares lines through consecutive runs of points.
#[pyfunction]
#[pyo3(name = "fit_lines")]
fn py_fit_lines<'py>(
    py: Python<'py>,
    points_mm: PyReadonlyArray2<'py, f64>,
    starts: PyReadonlyArray1<'py, i64>,
    covariance_mm2: Option<PyReadonlyArray3<'py, f64>>,
    along: bool,
    direction_covariance: bool,
    threads: usize,
) -> PyResult<LineArrays<'py>> {
    let points_mm = rows(&points_mm, "points_mm")?;
    let starts = indices(&starts)?;
    let noise = match &covariance_mm2 {
        Some(array) => PointNoise::Covariances(matrices(array, "covariance_mm2")?),
        None => PointNoise::FromResiduals,
    };
    let asked = Asked { along, direction_covariance };
    let FittedLines { centroid_mm, direction, rms_mm, direction_covariance, along_mm, status } =
        enter_core(py, threads, || fit_lines_for(asked, points_mm, &starts, noise))?;
    let status = status.into_iter().map(|status| status as u8).collect();
    Ok((
        from_rows(py, centroid_mm)?,
        from_rows(py, direction)?,
        from_numbers(py, rms_mm),
        from_matrices(py, direction_covariance)?,
        from_numbers(py, along_mm),
        from_numbers(py, status),
    ))
}

fn indices(starts: &PyReadonlyArray1<'_, i64>) -> Result<Vec<usize>, CoreError> {
    let starts = starts
        .as_slice()
        .map_err(|_| CoreError::shape("starts must be a C-contiguous (m,) array of int64"))?;
    let index = |(i, &start): (usize, &i64)| {
        usize::try_from(start)
            .map_err(|_| CoreError::shape(format!("start {i} is {start}: starts cannot be negative")))
    };
    starts.iter().enumerate().map(index).collect()
}

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(py_fit_lines, module)?)
}
