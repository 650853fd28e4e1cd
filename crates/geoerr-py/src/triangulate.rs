//! Binds `geoerr_core::triangulate`.

use geoerr_core::triangulate::{
    PixelNoise, Pixels, Precision, Rig, Rows, Status, triangulate_into, triangulate_points,
};
use numpy::{Element, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::arrays::{from_numbers, matrices, rows, rows_of, unfilled};
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
    let rig = rig(&projection_left, &projection_right)?;
    let left = Pixels {
        uv_px: rows(&uv_left_px, "uv_left_px")?,
        noise: noise(cov_left_px2.as_ref(), "cov_left_px2", sigma_px)?,
    };
    let right = Pixels {
        uv_px: rows(&uv_right_px, "uv_right_px")?,
        noise: noise(cov_right_px2.as_ref(), "cov_right_px2", sigma_px)?,
    };
    let n_points = left.uv_px.len();
    // NumPy asks for large pages, and a fresh page costs more than the points that fill it.
    let points_mm: Bound<'py, PyArray2<f64>> = unfilled(py, (n_points, 3))?;
    let covariance_mm2: Bound<'py, PyArray3<f64>> = unfilled(py, (n_points, 3, 3))?;
    let reprojection_px: Bound<'py, PyArray1<f64>> = unfilled(py, (n_points,))?;
    let mut status = vec![Status::Ok; n_points];
    {
        let (mut points, mut covariances) = (points_mm.readwrite(), covariance_mm2.readwrite());
        let mut reprojections = reprojection_px.readwrite();
        let rows = Rows {
            points_mm: points.as_slice_mut()?.as_chunks_mut::<3>().0,
            covariance_mm2: covariances.as_slice_mut()?.as_chunks_mut::<3>().0.as_chunks_mut::<3>().0,
            reprojection_px: reprojections.as_slice_mut()?,
            status: &mut status,
        };
        enter_core(py, threads, || triangulate_into(&rig, &left, &right, reweightings, rows))?;
    }
    Ok((points_mm, covariance_mm2, reprojection_px, from_statuses(py, status)))
}

/// Points (n, 3), status (n,).
type PlainPointArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<u8>>);

/// Two-view least squares of Li's rows as they stand, without covariance and reprojection error; pixels of either precision.
#[pyfunction]
#[pyo3(name = "triangulate_points")]
fn py_triangulate_points<'py>(
    py: Python<'py>,
    projection_left: PyReadonlyArray2<'py, f64>,
    projection_right: PyReadonlyArray2<'py, f64>,
    uv_left_px: &Bound<'py, PyAny>,
    uv_right_px: &Bound<'py, PyAny>,
    threads: usize,
) -> PyResult<PlainPointArrays<'py>> {
    let rig = rig(&projection_left, &projection_right)?;
    if let (Ok(left), Ok(right)) = (uv_left_px.cast::<PyArray2<f32>>(), uv_right_px.cast::<PyArray2<f32>>()) {
        return plain_points(py, &rig, &left.readonly(), &right.readonly(), threads);
    }
    let (left, right) = (uv_left_px.extract()?, uv_right_px.extract()?);
    plain_points::<f64>(py, &rig, &left, &right, threads)
}

fn plain_points<'py, P: Element + Precision>(
    py: Python<'py>,
    rig: &Rig,
    left: &PyReadonlyArray2<'py, P>,
    right: &PyReadonlyArray2<'py, P>,
    threads: usize,
) -> PyResult<PlainPointArrays<'py>> {
    let (left, right) = (rows_of(left, "uv_left_px")?, rows_of(right, "uv_right_px")?);
    let points_mm: Bound<'py, PyArray2<f64>> = unfilled(py, (left.len(), 3))?;
    let mut status = vec![Status::Ok; left.len()];
    {
        let mut points = points_mm.readwrite();
        let points = points.as_slice_mut()?.as_chunks_mut::<3>().0;
        enter_core(py, threads, || triangulate_points(rig, left, right, points, &mut status))?;
    }
    Ok((points_mm, from_statuses(py, status)))
}

fn rig(
    projection_left: &PyReadonlyArray2<'_, f64>,
    projection_right: &PyReadonlyArray2<'_, f64>,
) -> Result<Rig, CoreError> {
    Ok(Rig::new(
        &projection(projection_left, "projection_left")?,
        &projection(projection_right, "projection_right")?,
    )?)
}

fn from_statuses(py: Python<'_>, status: Vec<Status>) -> Bound<'_, PyArray1<u8>> {
    from_numbers(py, status.into_iter().map(|status| status as u8).collect())
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
    module.add_function(wrap_pyfunction!(py_triangulate, module)?)?;
    module.add_function(wrap_pyfunction!(py_triangulate_points, module)?)
}
