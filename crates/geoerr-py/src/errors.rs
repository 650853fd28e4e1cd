//! Maps every error of the core to one exception of `geoerr.errors`, exhaustively and in one place.

use geoerr_core::bases::BasisError;
use geoerr_core::candidates::CandidateError;
use geoerr_core::expression::{ExpressionError as FormulaError, RowsError};
use geoerr_core::gcode;
use geoerr_core::history::HistoryError;
use geoerr_core::kinematics::KinematicsError;
use geoerr_core::least_squares::LeastSquaresError;
use geoerr_core::line::LineError;
use geoerr_core::marker::MarkerError;
use geoerr_core::newton::NewtonError;
use geoerr_core::noise_likelihood::NoiseError;
use geoerr_core::straightness::StraightnessError;
use geoerr_core::triangulate::TriangulateError;
use geoerr_core::volumetric::{MachineError, MachineInverseError, VolumetricError};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::IntoPyDict;
use pyo3::{PyErr, PyTypeInfo, import_exception};

import_exception!(geoerr.errors, ExpressionError);
import_exception!(geoerr.errors, GcodeError);
import_exception!(geoerr.errors, GeoerrError);
import_exception!(geoerr.errors, GeometryError);
import_exception!(geoerr.errors, MarkerFitError);
import_exception!(geoerr.errors, NotConvergedError);
import_exception!(geoerr.errors, NotThisMarkerError);
import_exception!(geoerr.errors, ShapeError);

/// A core error on its way to Python.
pub struct CoreError(PyErr);

impl CoreError {
    /// An array argument whose shape or memory layout does not fit.
    pub fn shape(message: impl Into<String>) -> Self {
        Self(ShapeError::new_err(message.into()))
    }

    /// A thread pool that the operating system refused.
    pub fn thread_pool(source: &rayon::ThreadPoolBuildError) -> Self {
        Self(PyRuntimeError::new_err(format!("no worker threads could be started: {source}")))
    }
}

impl From<CoreError> for PyErr {
    fn from(error: CoreError) -> Self {
        error.0
    }
}

impl From<KinematicsError> for CoreError {
    fn from(error: KinematicsError) -> Self {
        use KinematicsError as E;
        let message = error.to_string();
        Self(match error {
            E::TableLengths { .. } | E::EmptyTable | E::OffsetCount { .. } | E::RowCount { .. } => {
                ShapeError::new_err(message)
            }
            E::Chain { .. }
            | E::NonFiniteEntry { .. }
            | E::PositionsNotIncreasing { .. }
            | E::SlopeOverflow { .. }
            | E::Squareness { .. }
            | E::UnknownErrorFunction { .. }
            | E::UnknownChannel { .. }
            | E::UnknownCarrier { .. } => GeometryError::new_err(message),
        })
    }
}

impl From<BasisError> for CoreError {
    fn from(error: BasisError) -> Self {
        use BasisError as E;
        let message = error.to_string();
        Self(match error {
            E::Count { .. } | E::EvenNodes { .. } | E::TooFew { .. } | E::TooManyFunctions { .. } => {
                ShapeError::new_err(message)
            }
            E::KnotRepeated { .. }
            | E::NestedTangentIntegral
            | E::NotFinite { .. }
            | E::NotRising { .. }
            | E::Period { .. }
            | E::Position { .. }
            | E::TooHigh { .. } => GeometryError::new_err(message),
        })
    }
}

/// The place is given in characters, as Python counts them.
impl From<FormulaError> for CoreError {
    fn from(error: FormulaError) -> Self {
        let message = error.to_string();
        let characters = |byte: usize| error.text.get(..byte).map_or(0, |before| before.chars().count());
        let (start, end) = (characters(error.span.start), characters(error.span.end));
        Self(ExpressionError::new_err((message, error.text.clone(), start, end)))
    }
}

impl From<CandidateError> for CoreError {
    fn from(error: CandidateError) -> Self {
        match error {
            CandidateError::Rows(error) => error.into(),
            CandidateError::Length { .. } | CandidateError::Missing { .. } => Self::shape(error.to_string()),
        }
    }
}

impl From<RowsError> for CoreError {
    fn from(error: RowsError) -> Self {
        Self(ShapeError::new_err(error.to_string()))
    }
}

impl From<HistoryError> for CoreError {
    fn from(error: HistoryError) -> Self {
        Self(ShapeError::new_err(error.to_string()))
    }
}

impl From<NewtonError> for CoreError {
    fn from(error: NewtonError) -> Self {
        let message = error.to_string();
        Self(match error {
            NewtonError::Tolerance { .. } | NewtonError::NonFinite => GeometryError::new_err(message),
            NewtonError::NotConverged { .. } => NotConvergedError::new_err(message),
        })
    }
}

impl From<NoiseError> for CoreError {
    fn from(error: NoiseError) -> Self {
        let message = error.to_string();
        match error {
            NoiseError::Length { .. } | NoiseError::BadBlock { .. } | NoiseError::NotInOrder { .. } => {
                Self(ShapeError::new_err(message))
            }
            NoiseError::NotDefinite { .. } => Self(GeometryError::new_err(message)),
        }
    }
}

impl From<TriangulateError> for CoreError {
    fn from(error: TriangulateError) -> Self {
        use TriangulateError as E;
        let message = error.to_string();
        Self(match error {
            E::LengthsDiffer { .. } => ShapeError::new_err(message),
            E::ProjectionNotFinite { .. }
            | E::ProjectionSingular { .. }
            | E::CentresCoincide { .. }
            | E::SigmaNotPositive { .. } => GeometryError::new_err(message),
        })
    }
}

impl From<MarkerError> for CoreError {
    fn from(error: MarkerError) -> Self {
        let message = error.to_string();
        Self(match error {
            MarkerError::Length { .. } => ShapeError::new_err(message),
            _ if error.is_another() => NotThisMarkerError::new_err(message),
            _ => MarkerFitError::new_err(message),
        })
    }
}

impl From<LeastSquaresError> for CoreError {
    fn from(error: LeastSquaresError) -> Self {
        use LeastSquaresError as E;
        let message = error.to_string();
        Self(match error {
            E::NoColumns
            | E::RowsDiffer { .. }
            | E::ColumnsDiffer { .. }
            | E::Cuts { .. }
            | E::NotOwn { .. }
            | E::NoSuchRightHandSide { .. } => ShapeError::new_err(message),
            E::NonFinite { .. } | E::Overflow { .. } | E::Tolerance { .. } | E::NotDecomposed { .. } => {
                GeometryError::new_err(message)
            }
        })
    }
}

impl From<LineError> for CoreError {
    fn from(error: LineError) -> Self {
        let message = error.to_string();
        Self(match error {
            LineError::BadStart { .. } | LineError::NoStarts { .. } | LineError::LengthsDiffer { .. } => {
                ShapeError::new_err(message)
            }
        })
    }
}

impl From<StraightnessError> for CoreError {
    fn from(error: StraightnessError) -> Self {
        use StraightnessError as E;
        let message = error.to_string();
        Self(match error {
            E::TooFewPositions { .. } | E::NotWholeFunctions { .. } | E::OtherNumberOfResults { .. } => {
                ShapeError::new_err(message)
            }
            E::PositionNotFinite { .. } | E::PositionsNotRising { .. } => GeometryError::new_err(message),
        })
    }
}

impl From<VolumetricError> for CoreError {
    fn from(error: VolumetricError) -> Self {
        use VolumetricError as E;
        let message = error.to_string();
        match error {
            E::PartCoefficients { .. }
            | E::Length { .. }
            | E::Session { .. }
            | E::Ends { .. }
            | E::NoExtent { .. } => Self(ShapeError::new_err(message)),
            E::Expression(error) => error.into(),
            E::Kinematics(error) => error.into(),
            E::LeastSquares(error) => error.into(),
        }
    }
}

impl From<MachineError> for CoreError {
    fn from(error: MachineError) -> Self {
        use MachineError as E;
        let message = error.to_string();
        match error {
            E::MissingConditions { .. } | E::NoValue { .. } => Self(GeoerrError::new_err(message)),
            E::VariableCount { .. } => Self(ShapeError::new_err(message)),
            E::Kinematics(error) => error.into(),
            E::Basis(error) => error.into(),
            E::Volumetric(error) => error.into(),
        }
    }
}

impl From<MachineInverseError> for CoreError {
    fn from(error: MachineInverseError) -> Self {
        match error {
            MachineInverseError::Rows(error) => error.into(),
            MachineInverseError::Newton(error) => error.into(),
        }
    }
}

/// The name of the file is the caller's: `geoerr.compensate` puts it in the place of `program`.
impl From<gcode::GcodeError> for CoreError {
    fn from(error: gcode::GcodeError) -> Self {
        use gcode::GcodeError as E;
        let message = error.to_string();
        let at_line = |line: u64, remedy: &str| {
            Python::attach(|py| {
                let remedy = [("remedy", remedy)].into_py_dict(py)?;
                let error =
                    GcodeError::type_object(py).call(("program", line, message.as_str()), Some(&remedy))?;
                Ok(PyErr::from_value(error))
            })
            .unwrap_or_else(|failure: PyErr| failure)
        };
        Self(match error {
            E::Option { .. } => GeoerrError::new_err(message),
            E::Binary
            | E::NulByte { .. }
            | E::LineTooLong { .. }
            | E::AlreadyCorrected { .. }
            | E::Unsupported { .. }
            | E::OutsideRange { .. }
            | E::CommandOutsideRange { .. }
            | E::OutsideMeasured { .. }
            | E::NotSolved { .. }
            | E::NotHeld { .. }
            | E::TooFewDigits { .. } => at_line(error.line(), error.remedy()),
        })
    }
}
