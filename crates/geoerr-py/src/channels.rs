//! Binds the channels of `geoerr_core::kinematics`: exact positions from explicit displacements, and first-order columns.

use geoerr_core::kinematics::{
    Carrier, Chain, Channel, KinematicsError, Points, Pose, measured_from_base, rig_columns,
};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::arrays::{from_rows, rows};
use crate::core_door::enter_core;
use crate::errors::CoreError;

fn carriers_of(codes: &PyReadonlyArray1<'_, u8>) -> Result<Vec<Carrier>, CoreError> {
    codes.as_array().iter().map(|&code| Carrier::from_code(code).map_err(CoreError::from)).collect()
}

fn pose_of(camera_from_base: &PyReadonlyArray2<'_, f64>, t_mm: [f64; 3]) -> Result<Pose, CoreError> {
    let found: &[[f64; 3]] = rows(camera_from_base, "camera_from_base")?;
    let camera_from_base = found
        .try_into()
        .map_err(|_| CoreError::shape("camera_from_base must be a (3, 3) array of float64"))?;
    Ok(Pose { camera_from_base, t_mm })
}

fn from_columns<'py, const N: usize>(
    py: Python<'py>,
    columns: Vec<[[f64; 3]; N]>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let n = columns.len();
    columns.into_flattened().into_flattened().into_pyarray(py).reshape([n, N, 3])
}

/// First-order columns (n, 33, 3): `BASE_COLUMNS` in the base frame, for `relative` in the work's.
#[pyfunction]
fn channel_columns<'py>(
    py: Python<'py>,
    chain: &str,
    carriers: PyReadonlyArray1<'py, u8>,
    q_mm: PyReadonlyArray2<'py, f64>,
    offset_mm: PyReadonlyArray2<'py, f64>,
    tool_offset_mm: [f64; 3],
    threads: usize,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let chain = Chain::parse(chain).map_err(CoreError::from)?;
    let carriers = carriers_of(&carriers)?;
    let (q_mm, offsets_mm) = (rows(&q_mm, "q_mm")?, rows(&offset_mm, "offset_mm")?);
    let points = Points { chain: &chain, tool_offset_mm, carriers: &carriers, q_mm, offsets_mm };
    let columns = enter_core(py, threads, || points.channel_columns())?;
    from_columns(py, columns)
}

/// Exact positions (n, 3) from one number for each of the first 30 channels: `what` is `position`, `displacement`
/// (actual minus nominal) or `nominal`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the Python side passes each of them by position")]
fn chain_positions<'py>(
    py: Python<'py>,
    chain: &str,
    what: &str,
    carriers: PyReadonlyArray1<'py, u8>,
    q_mm: PyReadonlyArray2<'py, f64>,
    offset_mm: PyReadonlyArray2<'py, f64>,
    tool_offset_mm: [f64; 3],
    channels: PyReadonlyArray2<'py, f64>,
    threads: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let chain = Chain::parse(chain).map_err(CoreError::from)?;
    let carriers = carriers_of(&carriers)?;
    let (q_mm, offsets_mm) = (rows(&q_mm, "q_mm")?, rows(&offset_mm, "offset_mm")?);
    let channels = rows(&channels, "channels")?;
    let points = Points { chain: &chain, tool_offset_mm, carriers: &carriers, q_mm, offsets_mm };
    let seen = match what {
        "position" => enter_core(py, threads, || points.position(channels)),
        "displacement" => enter_core(py, threads, || points.displacement(channels)),
        "nominal" => enter_core(py, threads, || points.nominal()),
        _ => Err(CoreError::shape("what must be position, displacement or nominal").into()),
    };
    from_rows(py, seen?)
}

/// First-order columns of the rig's channels (n, 11, 3), in the camera's frame.
#[pyfunction(name = "rig_columns")]
fn rig_columns_of<'py>(
    py: Python<'py>,
    camera_from_base: PyReadonlyArray2<'py, f64>,
    t_mm: [f64; 3],
    base_mm: PyReadonlyArray2<'py, f64>,
    threads: usize,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let pose = pose_of(&camera_from_base, t_mm)?;
    let base_mm = rows(&base_mm, "base_mm")?;
    let columns = enter_core(py, threads, || Ok::<_, KinematicsError>(rig_columns(&pose, base_mm)))?;
    from_columns(py, columns)
}

/// What a rig with the errors of each row (n, 11) makes of points of the base frame.
#[pyfunction(name = "measured_from_base")]
fn measured_from_base_of<'py>(
    py: Python<'py>,
    camera_from_base: PyReadonlyArray2<'py, f64>,
    t_mm: [f64; 3],
    rig: PyReadonlyArray2<'py, f64>,
    base_mm: PyReadonlyArray2<'py, f64>,
    threads: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let pose = pose_of(&camera_from_base, t_mm)?;
    let (rig, base_mm) = (rows(&rig, "rig")?, rows(&base_mm, "base_mm")?);
    let measured = enter_core(py, threads, || measured_from_base(&pose, rig, base_mm))?;
    from_rows(py, measured)
}

/// Adds this file's functions and the channels' names to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    let names = |wanted: fn(&Channel) -> bool| {
        let wanted: Vec<Channel> = Channel::ALL.into_iter().filter(wanted).collect();
        PyTuple::new(py, wanted.into_iter().map(Channel::name))
    };
    module.add("CHANNELS", names(|_| true)?)?;
    module.add("BASE_COLUMNS", names(|channel| channel.base_column().is_some())?)?;
    module.add("RIG_COLUMNS", names(|channel| channel.rig_column().is_some())?)?;
    module.add("CARRIERS", PyTuple::new(py, Carrier::ALL.map(Carrier::name))?)?;
    module.add_function(wrap_pyfunction!(channel_columns, module)?)?;
    module.add_function(wrap_pyfunction!(chain_positions, module)?)?;
    module.add_function(wrap_pyfunction!(rig_columns_of, module)?)?;
    module.add_function(wrap_pyfunction!(measured_from_base_of, module)?)
}
