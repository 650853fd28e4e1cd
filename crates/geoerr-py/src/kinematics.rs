//! Binds `geoerr_core::kinematics` and `geoerr_core::newton`: a machine as a handle, batches of positions.

use geoerr_core::kinematics::{
    Axis, Chain, ErrorTables, MachineModel, Squareness, Table, View, jacobians, positions,
};
use geoerr_core::newton::{Commands, commands_for};
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::arrays::{from_matrices, from_numbers, from_rows, numbers, rows};
use crate::core_door::enter_core;
use crate::errors::CoreError;

/// A machine with its 21 errors. Immutable, so that any number of threads may ask it.
#[pyclass(frozen, name = "MachineModel", module = "geoerr._core")]
pub struct PyMachineModel {
    model: MachineModel,
}

impl PyMachineModel {
    /// The core's machine, for the other bindings.
    pub fn core(&self) -> &MachineModel {
        &self.model
    }

    fn seen<'py>(
        &self,
        py: Python<'py>,
        view: View,
        q_mm: &PyReadonlyArray2<'py, f64>,
        offset_mm: &PyReadonlyArray2<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (q_mm, offset_mm) = (rows(q_mm, "q_mm")?, rows(offset_mm, "offset_mm")?);
        let model = self.core();
        let seen = enter_core(py, threads, || positions(model, view, q_mm, offset_mm))?;
        from_rows(py, seen)
    }
}

/// One error function on its way in: ISO name, positions, values.
type NamedTable<'py> = (String, PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>);

/// Commands (n, 3), remaining errors (n,), status (n,).
type CommandArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<u8>>);

#[pymethods]
impl PyMachineModel {
    /// `tables` are (ISO name, positions in mm, values in mm or rad); what is not named is 0.
    #[new]
    fn new(
        chain: &str,
        tool_offset_mm: [f64; 3],
        squareness_rad: [f64; 3],
        tables: Vec<NamedTable<'_>>,
    ) -> PyResult<Self> {
        let chain = Chain::parse(chain).map_err(CoreError::from)?;
        let mut errors = ErrorTables::default();
        let [s_xy_rad, s_xz_rad, s_yz_rad] = squareness_rad;
        errors.set_squareness(Squareness { s_xy_rad, s_xz_rad, s_yz_rad }).map_err(CoreError::from)?;
        for (name, positions, values) in &tables {
            let (axis, component) = ErrorTables::parse_name(name).map_err(CoreError::from)?;
            let (positions, values) = (numbers(positions, name)?, numbers(values, name)?);
            let table = Table::new(positions.to_vec(), values.to_vec()).map_err(CoreError::from)?;
            errors.set(axis, component, table);
        }
        Ok(Self { model: MachineModel::new(chain, errors, tool_offset_mm) })
    }

    /// Whether the machine has no errors at all.
    #[getter]
    fn is_nominal(&self) -> bool {
        self.model.is_nominal()
    }

    /// Union of the knots of the error functions of axis 0, 1 or 2, increasing.
    fn knots_mm<'py>(&self, py: Python<'py>, axis: usize) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let axis = Axis::ALL.get(axis).ok_or_else(|| CoreError::shape("axis must be 0, 1 or 2"))?;
        Ok(from_numbers(py, self.model.knots(*axis).to_vec()))
    }

    /// The point at an offset from the tool point, seen from the work.
    fn tool_from_work<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.seen(py, View::ToolFromWork, &q_mm, &offset_mm, threads)
    }

    /// Actual minus nominal of the same.
    fn error_mm<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.seen(py, View::ToolError, &q_mm, &offset_mm, threads)
    }

    /// The point at an offset from the tool point, seen from the floor.
    fn tool_from_base<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.seen(py, View::ToolFromBase, &q_mm, &offset_mm, threads)
    }

    /// A point of the work, seen from the floor.
    fn work_from_base<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.seen(py, View::WorkFromBase, &q_mm, &offset_mm, threads)
    }

    /// d tool_from_work / d q.
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (q_mm, offset_mm) = (rows(&q_mm, "q_mm")?, rows(&offset_mm, "offset_mm")?);
        let model = self.core();
        let matrices = enter_core(py, threads, || jacobians(model, q_mm, offset_mm))?;
        from_matrices(py, matrices)
    }

    /// Commands, remaining errors and status (0 converged, 1 not, 2 not finite) for each target.
    fn commands_for<'py>(
        &self,
        py: Python<'py>,
        target_mm: PyReadonlyArray2<'py, f64>,
        tolerance_mm: f64,
        threads: usize,
    ) -> PyResult<CommandArrays<'py>> {
        let target_mm = rows(&target_mm, "target_mm")?;
        let model = self.core();
        let Commands { command_mm, remaining_mm, status } =
            enter_core(py, threads, || commands_for(model, target_mm, tolerance_mm))?;
        let status = status.into_iter().map(|status| status as u8).collect();
        Ok((from_rows(py, command_mm)?, from_numbers(py, remaining_mm), from_numbers(py, status)))
    }
}

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyMachineModel>()
}
