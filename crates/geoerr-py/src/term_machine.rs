//! Binds `geoerr_core::volumetric::TermMachine`: a machine of terms under given conditions.

use std::collections::BTreeMap;
use std::sync::Arc;

use geoerr_core::kinematics::{Axis, View};
use geoerr_core::newton::Commands;
use geoerr_core::volumetric::{Approach, MAX_WINDUPS, TermMachine};
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{contiguous, from_matrices, from_numbers, from_rows, numbers, rows};
use crate::core_door::enter_core;
use crate::errors::CoreError;
use crate::volumetric::PyVolumetricModel;

/// Direction, travel and velocity of three axes, and the feed.
const MOTION_COLUMNS: usize = 10;

/// A machine of terms with parameters and conditions put in; methods as those of `MachineModel`. Immutable.
///
/// `motion` is (n, 10) or (1, 10): direction, travel (mm) and velocity (mm/s) of each axis, then the feed (mm/min). It may
/// go on with what the stroke before left unwound of each of `windups`, a share of the lost motion.
#[pyclass(frozen, name = "TermMachine", module = "geoerr._core")]
pub struct PyTermMachine {
    machine: Arc<TermMachine>,
}

/// Commands (n, 3), remaining errors (n,), status (n,).
type CommandArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<u8>>);

impl PyTermMachine {
    /// The core's machine, for the other bindings.
    pub fn core(&self) -> &TermMachine {
        &self.machine
    }

    fn seen<'py>(
        &self,
        py: Python<'py>,
        view: View,
        q_mm: &PyReadonlyArray2<'py, f64>,
        offset_mm: &PyReadonlyArray2<'py, f64>,
        threads: usize,
        motion: Option<&PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (q_mm, offset_mm) = (rows(q_mm, "q_mm")?, rows(offset_mm, "offset_mm")?);
        let approaches = approaches(motion, self.core().windups().len())?;
        let machine = self.core();
        let seen = enter_core(py, threads, || machine.positions(view, q_mm, offset_mm, &approaches))?;
        from_rows(py, seen)
    }
}

fn approaches(
    motion: Option<&PyReadonlyArray2<'_, f64>>,
    n_windups: usize,
) -> Result<Vec<Approach>, CoreError> {
    let Some(motion) = motion else { return Ok(vec![Approach::default()]) };
    let of_row = |row: &[f64]| {
        let (told, left) = row.split_at(MOTION_COLUMNS);
        let three = |first: usize| [told[first], told[first + 1], told[first + 2]];
        let mut left_unwound = [0.0; MAX_WINDUPS];
        left_unwound.iter_mut().zip(left).for_each(|(into, &left)| *into = left);
        Approach {
            direction: three(0),
            travel_mm: three(3),
            velocity_mm_s: three(6),
            feed_mm_min: told[9],
            left_unwound,
        }
    };
    let n_columns = motion.shape()[1];
    let columns = [MOTION_COLUMNS, MOTION_COLUMNS + n_windups];
    if !columns.contains(&n_columns) {
        let [few, all] = columns;
        return Err(CoreError::shape(format!("motion must have {few} or {all} columns, not {n_columns}")));
    }
    let refused = || CoreError::shape("motion must be a C-contiguous (n, columns) array of float64");
    Ok(contiguous(motion, refused)?.chunks_exact(n_columns).map(of_row).collect())
}

#[pymethods]
impl PyTermMachine {
    /// `variables` names those of the model's formulas, in their order; `conditions` gives their values by name.
    #[new]
    fn new(
        model: &PyVolumetricModel,
        coefficients: PyReadonlyArray1<'_, f64>,
        inner: PyReadonlyArray1<'_, f64>,
        variables: Vec<String>,
        conditions: BTreeMap<String, f64>,
    ) -> PyResult<Self> {
        let (coefficients, inner) = (numbers(&coefficients, "coefficients")?, numbers(&inner, "inner")?);
        let machine = TermMachine::new(model.core(), coefficients, inner, &variables, &conditions);
        Ok(Self { machine: Arc::new(machine.map_err(CoreError::from)?) })
    }

    /// Whether the machine has no errors at all.
    #[getter]
    fn is_nominal(&self) -> bool {
        self.machine.is_nominal()
    }

    /// Names of the variables that `motion` gives.
    #[getter]
    fn motion_names(&self) -> Vec<String> {
        self.machine.motion_names().to_vec()
    }

    /// Wind-ups that depend on the strokes before: index of the axis, and over what length (mm) each fills.
    #[getter]
    fn windups(&self) -> Vec<(usize, f64)> {
        self.machine.windups().iter().map(|windup| (windup.axis, windup.length_mm)).collect()
    }

    /// Numbers of the terms of which some wind-up is as behind a long stroke, whatever came before.
    #[getter]
    fn long_stroke_terms(&self) -> Vec<usize> {
        self.machine.long_stroke_terms().to_vec()
    }

    /// Numbers of the terms that act on the rig: left out.
    #[getter]
    fn rig_terms(&self) -> Vec<usize> {
        self.machine.rig_terms().to_vec()
    }

    /// Kinks of the curves of axis 0, 1 or 2, increasing.
    fn knots_mm<'py>(&self, py: Python<'py>, axis: usize) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let axis = Axis::ALL.get(axis).ok_or_else(|| CoreError::shape("axis must be 0, 1 or 2"))?;
        Ok(from_numbers(py, self.machine.knots(*axis).to_vec()))
    }

    /// The point at an offset from the tool point, seen from the work.
    #[pyo3(signature = (q_mm, offset_mm, threads, motion = None))]
    fn tool_from_work<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        threads: usize,
        motion: Option<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.seen(py, View::ToolFromWork, &q_mm, &offset_mm, threads, motion.as_ref())
    }

    /// Actual minus nominal of the same.
    #[pyo3(signature = (q_mm, offset_mm, threads, motion = None))]
    fn error_mm<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        threads: usize,
        motion: Option<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.seen(py, View::ToolError, &q_mm, &offset_mm, threads, motion.as_ref())
    }

    /// The point at an offset from the tool point, seen from the floor.
    #[pyo3(signature = (q_mm, offset_mm, threads, motion = None))]
    fn tool_from_base<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        threads: usize,
        motion: Option<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.seen(py, View::ToolFromBase, &q_mm, &offset_mm, threads, motion.as_ref())
    }

    /// A point of the work, seen from the floor.
    #[pyo3(signature = (q_mm, offset_mm, threads, motion = None))]
    fn work_from_base<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        threads: usize,
        motion: Option<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.seen(py, View::WorkFromBase, &q_mm, &offset_mm, threads, motion.as_ref())
    }

    /// d tool_from_work / d q, direction and history held.
    #[pyo3(signature = (q_mm, offset_mm, threads, motion = None))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        threads: usize,
        motion: Option<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (q_mm, offset_mm) = (rows(&q_mm, "q_mm")?, rows(&offset_mm, "offset_mm")?);
        let approaches = approaches(motion.as_ref(), self.core().windups().len())?;
        let machine = self.core();
        let matrices = enter_core(py, threads, || machine.jacobians(q_mm, offset_mm, &approaches))?;
        from_matrices(py, matrices)
    }

    /// Commands, remaining errors and status (0 converged, 1 not, 2 not finite) for each target.
    #[pyo3(signature = (target_mm, tolerance_mm, threads, motion = None))]
    fn commands_for<'py>(
        &self,
        py: Python<'py>,
        target_mm: PyReadonlyArray2<'py, f64>,
        tolerance_mm: f64,
        threads: usize,
        motion: Option<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<CommandArrays<'py>> {
        let target_mm = rows(&target_mm, "target_mm")?;
        let approaches = approaches(motion.as_ref(), self.core().windups().len())?;
        let machine = self.core();
        let Commands { command_mm, remaining_mm, status } =
            enter_core(py, threads, || machine.commands_for(target_mm, &approaches, tolerance_mm))?;
        let status = status.into_iter().map(|status| status as u8).collect();
        Ok((from_rows(py, command_mm)?, from_numbers(py, remaining_mm), from_numbers(py, status)))
    }
}

/// Adds this file's class to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyTermMachine>()
}
