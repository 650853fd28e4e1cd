//! Binds `geoerr_core::marker`.

use geoerr_core::marker::{Lens, MarkerFit, Picture, fit_marker};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{contiguous, from_numbers, from_rows, numbers, rows};
use crate::core_door::enter_core;
use crate::errors::CoreError;

/// Corners (4, 2), their covariance (8, 8), noise, contrast, blur (2,), misfit, unevenness.
type FitArrays<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, f64, f64, Bound<'py, PyArray1<f64>>, f64, f64);

/// Fits the whole picture of one marker.
#[pyfunction]
#[pyo3(name = "fit_marker")]
fn py_fit_marker<'py>(
    py: Python<'py>,
    picture: PyReadonlyArray2<'py, u8>,
    focal_px: [f64; 2],
    principal_point_px: [f64; 2],
    distortion: PyReadonlyArray1<'py, f64>,
    pattern: PyReadonlyArray2<'py, bool>,
    corners_px: PyReadonlyArray2<'py, f64>,
) -> PyResult<FitArrays<'py>> {
    let width = picture.shape()[1];
    let grey = contiguous(&picture, || {
        CoreError::shape("the picture must be a C-contiguous (h, w) array of uint8")
    })?;
    let refused = || CoreError::shape("the pattern must be a C-contiguous (n, n) array of bool");
    if pattern.shape()[0] != pattern.shape()[1] {
        return Err(refused().into());
    }
    let pattern = contiguous(&pattern, refused)?;
    let given = numbers(&distortion, "distortion")?;
    let mut coefficients = [0.0; 12];
    if given.len() > coefficients.len() {
        return Err(CoreError::shape(format!("{} distortion coefficients: 12 are known", given.len())).into());
    }
    coefficients[..given.len()].copy_from_slice(given);
    let lens = Lens { focal_px, principal_point_px, distortion: coefficients };
    let corners_px: [[f64; 2]; 4] = (rows::<2>(&corners_px, "corners_px")?.try_into())
        .map_err(|_| CoreError::shape("corners_px must be (4, 2)"))?;
    let MarkerFit { corners_px, covariance_px2, noise_grey, contrast_grey, blur_px, misfit, unevenness } =
        enter_core(py, 0, || fit_marker(Picture { grey, width }, &lens, pattern, corners_px))?;
    Ok((
        from_rows(py, corners_px.to_vec())?,
        from_rows(py, covariance_px2.to_vec())?,
        noise_grey,
        contrast_grey,
        from_numbers(py, blur_px.to_vec()),
        misfit,
        unevenness,
    ))
}

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(py_fit_marker, module)?)
}
