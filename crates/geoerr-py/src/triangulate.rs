//! Binds `geoerr_core::triangulate`.

use geoerr_core::triangulate::{PixelNoise, Pixels, Rig, Triangulated, triangulate};
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::arrays::{from_matrices, from_numbers, from_rows, matrices, rows};
use crate::core_door::enter_core;
use crate::errors::CoreError;

/// Points (n, 3), covariances (n, 3, 3), reprojection errors (n,), status (n,).
type PointArrays<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<u8>>,
);

/// The 3 × 4 matrix of a contiguous (3, 4) array.
fn projection(array: &PyReadonlyArray2<'_, f64>, name: &str) -> Result<[[f64; 4]; 3], CoreError> {
    let rows = rows::<4>(array, name)?;
    rows.try_into().map_err(|_| CoreError::shape(format!("{name} must be a (3, 4) array of float64")))
}

/// Two-view least squares with covariance; a view without covariances has `sigma_px` in u and v.
#[pyfunction]
#[pyo3(name = "triangulate")]
#[expect(clippy::too_many_arguments, reason = "one array each; the public face groups and names them")]
fn py_triangulate<'py>(
    py: Python<'py>,
    projection_left: PyReadonlyArray2<'py, f64>,
    projection_right: PyReadonlyArray2<'py, f64>,
    uv_left_px: PyReadonlyArray2<'py, f64>,
    uv_right_px: PyReadonlyArray2<'py, f64>,
    cov_left_px2: Option<PyReadonlyArray3<'py, f64>>,
    cov_right_px2: Option<PyReadonlyArray3<'py, f64>>,
    sigma_px: f64,
    reweightings: u32,
    threads: usize,
) -> PyResult<PointArrays<'py>> {
    let rig = Rig::new(
        &projection(&projection_left, "projection_left")?,
        &projection(&projection_right, "projection_right")?,
    )
    .map_err(CoreError::from)?;
    let left = Pixels {
        uv_px: rows(&uv_left_px, "uv_left_px")?,
        noise: noise(cov_left_px2.as_ref(), "cov_left_px2", sigma_px)?,
    };
    let right = Pixels {
        uv_px: rows(&uv_right_px, "uv_right_px")?,
        noise: noise(cov_right_px2.as_ref(), "cov_right_px2", sigma_px)?,
    };
    let Triangulated { points_mm, covariance_mm2, reprojection_px, status } =
        enter_core(py, threads, || triangulate(&rig, &left, &right, reweightings))?;
    let status = status.into_iter().map(|status| status as u8).collect();
    Ok((
        from_rows(py, points_mm)?,
        from_matrices(py, covariance_mm2)?,
        from_numbers(py, reprojection_px),
        from_numbers(py, status),
    ))
}

fn noise<'a>(
    covariances: Option<&'a PyReadonlyArray3<'_, f64>>,
    name: &str,
    sigma_px: f64,
) -> Result<PixelNoise<'a>, CoreError> {
    match covariances {
        Some(array) => Ok(PixelNoise::Covariances(matrices(array, name)?)),
        None => Ok(PixelNoise::Sigma(sigma_px)),
    }
}

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(py_triangulate, module)?)
}
