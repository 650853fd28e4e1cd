//! Binds `geoerr_core::gcode`: a stream that takes a program's bytes and gives the corrected ones.

use std::sync::{Mutex, MutexGuard};

use geoerr_core::gcode::{
    Firmware, GcodeError, OnUnsupported, Options, PathMap, Rewriter, TermPath, Unsupported,
};
use geoerr_core::kinematics::MachineModel;
use geoerr_core::volumetric::{Approach, MotionNeeds, Windup};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::core_door::enter_core;
use crate::errors::CoreError;
use crate::kinematics::PyMachineModel;
use crate::term_machine::PyTermMachine;

/// A machine on its way in: of tables, or of terms.
#[derive(FromPyObject)]
enum AnyMachine<'py> {
    Tables(PyRef<'py, PyMachineModel>),
    Terms(PyRef<'py, PyTermMachine>),
}

/// What a rewriter corrects for.
#[derive(Debug)]
enum Map {
    Tables(Box<MachineModel>),
    Terms(Box<TermPath>),
}

impl PathMap for Map {
    fn command_for(
        &self,
        ideal_mm: &[f64; 3],
        approach: &Approach,
        tolerance_mm: f64,
    ) -> Result<[f64; 3], f64> {
        match self {
            Self::Tables(machine) => PathMap::command_for(machine.as_ref(), ideal_mm, approach, tolerance_mm),
            Self::Terms(machine) => machine.command_for(ideal_mm, approach, tolerance_mm),
        }
    }

    fn actual(&self, command_mm: &[f64; 3], approach: &Approach) -> [f64; 3] {
        match self {
            Self::Tables(machine) => machine.actual(command_mm, approach),
            Self::Terms(machine) => machine.actual(command_mm, approach),
        }
    }

    fn knots(&self, axis: usize) -> &[f64] {
        match self {
            Self::Tables(machine) => PathMap::knots(machine.as_ref(), axis),
            Self::Terms(machine) => machine.knots(axis),
        }
    }

    fn is_nominal(&self) -> bool {
        match self {
            Self::Tables(machine) => machine.is_nominal(),
            Self::Terms(machine) => machine.is_nominal(),
        }
    }

    fn most_crossings(&self) -> usize {
        match self {
            Self::Tables(machine) => machine.most_crossings(),
            Self::Terms(machine) => machine.most_crossings(),
        }
    }

    fn needs(&self) -> MotionNeeds {
        match self {
            Self::Tables(machine) => machine.needs(),
            Self::Terms(machine) => machine.needs(),
        }
    }

    fn windups(&self) -> &[Windup] {
        match self {
            Self::Tables(machine) => machine.windups(),
            Self::Terms(machine) => machine.windups(),
        }
    }
}

/// A program on its way through the core.
#[pyclass(frozen, name = "GcodeRewriter", module = "geoerr._core")]
pub struct PyGcodeRewriter {
    /// Boxed: Python gives its objects 16-byte boundaries, and the rewriter holds vector registers that need 32.
    rewriter: Box<Mutex<Rewriter<Map>>>,
}

impl PyGcodeRewriter {
    /// Waiting here, with the interpreter held, for a thread that waits for the interpreter would never end.
    fn lock(&self) -> PyResult<MutexGuard<'_, Rewriter<Map>>> {
        self.rewriter.try_lock().map_err(|_| PyRuntimeError::new_err("another thread uses this stream"))
    }
}

/// Kind, first line, its text, how often, what it means.
type WarningRow = (&'static str, u64, String, u64, String);

#[pymethods]
impl PyGcodeRewriter {
    #[new]
    #[pyo3(signature = (
        model, *, work_offset_mm, tolerance_mm, digits, home_mm, firmware, passes_unsupported,
        holds_outside_measured, firmware_corrections_named, still, range_mm, measured_mm, model_name
    ))]
    #[expect(clippy::too_many_arguments, reason = "keywords on the Python side")]
    fn new(
        py: Python<'_>,
        model: AnyMachine<'_>,
        work_offset_mm: Option<[f64; 3]>,
        tolerance_mm: f64,
        digits: u8,
        home_mm: Option<[f64; 3]>,
        firmware: Option<&str>,
        passes_unsupported: bool,
        holds_outside_measured: bool,
        firmware_corrections_named: bool,
        still: Vec<String>,
        range_mm: [(f64, f64); 3],
        measured_mm: [(f64, f64); 3],
        model_name: String,
    ) -> PyResult<Self> {
        let firmware = match firmware {
            None => None,
            Some("marlin") => Some(Firmware::Marlin),
            Some("klipper") => Some(Firmware::Klipper),
            Some("reprapfirmware") => Some(Firmware::RepRapFirmware),
            Some(other) => return Err(PyValueError::new_err(format!("unknown firmware {other:?}"))),
        };
        let on_unsupported = if passes_unsupported { OnUnsupported::Pass } else { OnUnsupported::Refuse };
        let options = Options {
            work_offset_mm,
            tolerance_mm,
            digits,
            home_mm,
            firmware,
            on_unsupported,
            holds_outside_measured,
            firmware_corrections_named,
            still: still.into_iter().map(|name| name.to_ascii_uppercase().into_bytes()).collect(),
            range_mm,
            measured_mm,
            model_name,
        };
        let map = match model {
            AnyMachine::Tables(model) => Map::Tables(Box::new(model.core().clone())),
            AnyMachine::Terms(model) => {
                let machine = model.core().clone();
                Map::Terms(Box::new(py.detach(|| TermPath::new(machine, &range_mm))))
            }
        };
        let rewriter = Rewriter::new(map, options).map_err(CoreError::from)?;
        Ok(Self { rewriter: Box::new(Mutex::new(rewriter)) })
    }

    /// Takes more of the program; `is_last` with its end.
    fn push(&self, program: &[u8], is_last: bool) -> PyResult<()> {
        self.lock()?.push(program, is_last);
        Ok(())
    }

    /// The next corrected block; None where nothing is left to do until the next push.
    fn pull<'py>(&self, py: Python<'py>, threads: usize) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let mut rewriter = self.lock()?;
        let rewriter = &mut *rewriter;
        let block = enter_core(py, threads, || -> Result<Option<Vec<u8>>, GcodeError> {
            let mut out = Vec::new();
            Ok(rewriter.pull(&mut out)?.then_some(out))
        })?;
        Ok(block.map(|bytes| PyBytes::new(py, &bytes)))
    }

    /// Counts so far, and the largest correction.
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let summary = self.lock()?.summary();
        let dict = PyDict::new(py);
        dict.set_item("lines", summary.lines)?;
        dict.set_item("moves_in", summary.moves_in)?;
        dict.set_item("moves_out", summary.moves_out)?;
        dict.set_item("moves_corrected", summary.moves_corrected)?;
        dict.set_item("untouched_position_unknown", summary.untouched_position_unknown)?;
        dict.set_item("untouched_unsupported", summary.untouched_unsupported)?;
        dict.set_item("lines_not_followed", summary.lines_not_followed)?;
        dict.set_item("largest_correction_mm", summary.largest_correction_mm)?;
        dict.set_item("largest_correction_line", summary.largest_correction_line)?;
        dict.set_item("box_mm", summary.box_mm)?;
        dict.set_item("extrusion_in", summary.extrusion_in)?;
        dict.set_item("extrusion_out", summary.extrusion_out)?;
        Ok(dict)
    }

    /// Least travel of each axis between two reversals, mm, infinite where there are none; and largest speed, mm/s.
    fn extremes(&self) -> PyResult<([f64; 3], [f64; 3])> {
        let extremes = self.lock()?.extremes();
        Ok((extremes.shortest_stroke_mm, extremes.fastest_mm_s))
    }

    /// Commands that may move the machine, each with on how many lines it was met, and on how many lines others were.
    fn movers(&self) -> PyResult<(Vec<(String, u64)>, u64)> {
        let rewriter = self.lock()?;
        Ok((rewriter.movers().names().to_vec(), rewriter.movers().others()))
    }

    /// Warnings so far, in the order of their first lines.
    fn warnings(&self) -> PyResult<Vec<WarningRow>> {
        let warnings = self.lock()?.warnings();
        let rows = warnings.into_iter().map(|warning| {
            (warning.kind.name(), warning.line, warning.text, warning.count, warning.kind.explanation())
        });
        Ok(rows.collect())
    }
}

/// Gives what is said of a split move of which firmwares differ on what it extrudes, or of which nobody has said where its E
/// begins; and the remedy.
#[pyfunction]
#[pyo3(signature = (*, is_lost))]
fn unclear_extrusion(is_lost: bool) -> (String, &'static str) {
    let what = if is_lost { Unsupported::ExtruderLost } else { Unsupported::ExtruderMode };
    (what.to_string(), what.remedy())
}

/// Adds the class and the function to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyGcodeRewriter>()?;
    module.add_function(wrap_pyfunction!(unclear_extrusion, module)?)
}
