//! All unknowns of a fit.

use geoerr_core::kinematics::Pose;
use geoerr_core::volumetric::{Frame, State};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;

use crate::arrays::{from_numbers, from_rows};
use crate::pickled::pickled;

/// All unknowns of a problem. Immutable.
#[pyclass(frozen, name = "FitState", module = "geoerr._core")]
pub struct PyFitState {
    pub(super) state: State,
}

pickled!(PyFitState: state);

#[pymethods]
impl PyFitState {
    /// Linear coefficients of all terms.
    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        from_numbers(py, self.state.coefficients.clone())
    }

    /// Inner parameters of all terms.
    #[getter]
    fn inner<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        from_numbers(py, self.state.inner.clone())
    }

    /// The shared unknowns.
    #[getter]
    fn shared<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        from_numbers(py, self.state.shared.clone())
    }

    /// The same coefficients, inner parameters and shared unknowns in the frames of another state.
    fn in_frames_of(&self, other: &Self) -> Self {
        Self { state: State { frames: other.state.frames.clone(), ..self.state.clone() } }
    }

    /// measured_from_base of every session (s, 3, 3); the identity for circles.
    #[getter]
    fn rotations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let all = self.state.frames.iter().map(|frame| match frame {
            Frame::Positions { pose, .. } => pose.camera_from_base,
            Frame::Circle { .. } | Frame::Lengths => Pose::default().camera_from_base,
        });
        crate::arrays::from_matrices(py, all.collect())
    }

    /// Of the base origin in each session's measuring frame, or the centre of a circle, mm (s, 3).
    #[getter]
    fn translations_mm<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let all = self.state.frames.iter().map(|frame| match frame {
            Frame::Positions { pose, .. } => pose.t_mm,
            Frame::Circle { centre_mm, .. } => *centre_mm,
            Frame::Lengths => [0.0; 3],
        });
        from_rows(py, all.collect())
    }

    /// What a circular device adds to every radius, mm (s,); 0 for others.
    #[getter]
    fn excess_mm<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let all = self.state.frames.iter().map(|frame| match frame {
            Frame::Positions { .. } | Frame::Lengths => 0.0,
            Frame::Circle { excess_mm, .. } => *excess_mm,
        });
        from_numbers(py, all.collect())
    }
}
