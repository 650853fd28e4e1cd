//! Binds `geoerr_core::volumetric`: a machine with terms.

use geoerr_core::bases::Basis;
use geoerr_core::expression::Expression;
use geoerr_core::kinematics::{Axis, Carrier, Chain, Channel, Pose};
use geoerr_core::volumetric::{
    Frame, Part, Problem, Rows, Shape, Sightings, State, Term, VolumetricModel, channel_values, displacements,
};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::arrays::{from_rows, numbers, rows};
use crate::bases::PyBasis;
use crate::core_door::enter_core;
use crate::errors::CoreError;
use crate::expression::PyExpression;
use crate::pickled::pickled;

/// A basis or a formula on its way in.
#[derive(FromPyObject)]
enum AnyShape<'py> {
    Basis(PyRef<'py, PyBasis>),
    Expression(PyRef<'py, PyExpression>),
}

/// Channel, factor, axis of a basis, shape, places of its coefficients, places of its inner parameters.
type PartTuple<'py> = (String, f64, i64, AnyShape<'py>, Vec<usize>, Vec<usize>);

/// Number of coefficients, number of inner parameters, parts.
type TermTuple<'py> = (usize, usize, Vec<PartTuple<'py>>);

/// A machine whose errors are a sum of terms. Immutable.
#[pyclass(frozen, name = "VolumetricModel", module = "geoerr._core")]
pub struct PyVolumetricModel {
    model: VolumetricModel,
}

impl PyVolumetricModel {
    /// The core's model, for the other bindings.
    pub fn core(&self) -> &VolumetricModel {
        &self.model
    }
}

/// Rows as they come in: carriers (n,), positions (n, 3), offsets (n, 3), variables (k, n), starts, times.
pub struct PyRows<'a, 'py> {
    pub carriers: &'a PyReadonlyArray1<'py, u8>,
    pub q_mm: &'a PyReadonlyArray2<'py, f64>,
    pub offset_mm: &'a PyReadonlyArray2<'py, f64>,
    pub variables: &'a PyReadonlyArray2<'py, f64>,
    pub starts: &'a PyReadonlyArray1<'py, i64>,
    pub t_s: Option<&'a PyReadonlyArray1<'py, f64>>,
}

impl PyRows<'_, '_> {
    pub fn to_core(&self) -> Result<Rows, CoreError> {
        let carriers = self.carriers.as_array();
        let carriers: Result<Vec<Carrier>, _> =
            carriers.iter().map(|&code| Carrier::from_code(code)).collect();
        let variables = self.variables.as_array();
        Ok(Rows {
            carriers: carriers.map_err(CoreError::from)?,
            q_mm: rows(self.q_mm, "q_mm")?.to_vec(),
            offset_mm: rows(self.offset_mm, "offset_mm")?.to_vec(),
            variables: variables.rows().into_iter().map(|row| row.to_vec()).collect(),
            starts: places(self.starts, "starts")?,
            t_s: self.t_s.map(|t| numbers(t, "t").map(<[f64]>::to_vec)).transpose()?,
        })
    }
}

pub fn places(array: &PyReadonlyArray1<'_, i64>, name: &str) -> Result<Vec<usize>, CoreError> {
    let refused = || CoreError::shape(format!("{name} must be (n,) places from 0"));
    array.as_array().iter().map(|&place| usize::try_from(place).map_err(|_| refused())).collect()
}

/// Places (n,) from 0; none where a number is below.
pub fn places_if_any(array: &PyReadonlyArray1<'_, i64>) -> Vec<Option<usize>> {
    array.as_array().iter().map(|&place| usize::try_from(place).ok()).collect()
}

fn part_of(part: &PartTuple<'_>) -> Result<Part, CoreError> {
    let (channel, factor, axis, shape, coefficients, inner) = part;
    let shape = match shape {
        AnyShape::Basis(basis) => {
            let place = usize::try_from(*axis).ok().and_then(|place| Axis::ALL.get(place));
            let axis = *place.ok_or_else(|| CoreError::shape("the axis of a basis must be 0, 1 or 2"))?;
            let basis: Basis = basis.core().clone();
            Shape::Basis { axis, basis }
        }
        AnyShape::Expression(expression) => {
            let expression: Expression = expression.core().clone();
            Shape::Expression { expression, coefficients: coefficients.clone(), inner: inner.clone() }
        }
    };
    Ok(Part { channel: Channel::parse(channel).map_err(CoreError::from)?, factor: *factor, shape })
}

pickled!(PyVolumetricModel: model);

#[pymethods]
impl PyVolumetricModel {
    #[new]
    fn new(chain: &str, tool_offset_mm: [f64; 3], terms: Vec<TermTuple<'_>>) -> PyResult<Self> {
        let chain = Chain::parse(chain).map_err(CoreError::from)?;
        let terms = terms
            .iter()
            .map(|(n_coefficients, n_inner, parts)| {
                let parts = parts.iter().map(part_of).collect::<Result<Vec<_>, CoreError>>()?;
                Ok(Term { parts, n_coefficients: *n_coefficients, n_inner: *n_inner })
            })
            .collect::<Result<Vec<_>, CoreError>>()?;
        let model = VolumetricModel::new(chain, tool_offset_mm, terms).map_err(CoreError::from)?;
        Ok(Self { model })
    }

    #[getter]
    fn n_coefficients(&self) -> usize {
        self.model.n_coefficients()
    }

    #[getter]
    fn n_inner(&self) -> usize {
        self.model.n_inner()
    }

    /// Actual minus nominal position of every row's point (n, 3), exact, without the rig.
    #[expect(clippy::too_many_arguments, reason = "the Python side passes each of them by position")]
    fn displacements<'py>(
        &self,
        py: Python<'py>,
        carriers: PyReadonlyArray1<'py, u8>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        variables: PyReadonlyArray2<'py, f64>,
        starts: PyReadonlyArray1<'py, i64>,
        t_s: Option<PyReadonlyArray1<'py, f64>>,
        coefficients: PyReadonlyArray1<'py, f64>,
        inner: PyReadonlyArray1<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (carriers, q_mm, offset_mm) = (&carriers, &q_mm, &offset_mm);
        let (variables, starts, t_s) = (&variables, &starts, t_s.as_ref());
        let rows = PyRows { carriers, q_mm, offset_mm, variables, starts, t_s }.to_core()?;
        let (theta, phi) = (numbers(&coefficients, "coefficients")?, numbers(&inner, "inner")?);
        let model = &self.model;
        from_rows(py, enter_core(py, threads, || displacements(model, &rows, theta, phi))?)
    }

    /// What every channel gets at every row, (n, 44).
    #[expect(clippy::too_many_arguments, reason = "the Python side passes each of them by position")]
    fn channel_values<'py>(
        &self,
        py: Python<'py>,
        carriers: PyReadonlyArray1<'py, u8>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        variables: PyReadonlyArray2<'py, f64>,
        starts: PyReadonlyArray1<'py, i64>,
        t_s: Option<PyReadonlyArray1<'py, f64>>,
        coefficients: PyReadonlyArray1<'py, f64>,
        inner: PyReadonlyArray1<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (carriers, q_mm, offset_mm) = (&carriers, &q_mm, &offset_mm);
        let (variables, starts, t_s) = (&variables, &starts, t_s.as_ref());
        let rows = PyRows { carriers, q_mm, offset_mm, variables, starts, t_s }.to_core()?;
        let (theta, phi) = (numbers(&coefficients, "coefficients")?, numbers(&inner, "inner")?);
        let model = &self.model;
        let values = enter_core(py, threads, || channel_values(model, &rows, theta, phi))?;
        let all: Vec<f64> = (0..rows.len()).flat_map(|row| values.at(row)).collect();
        all.into_pyarray(py).reshape([rows.len(), Channel::COUNT])
    }

    /// Derivative of every row's displacement by all coefficients, then all inner parameters, first order, without
    /// the rig: (n, 3, n_coefficients + n_inner).
    #[expect(clippy::too_many_arguments, reason = "the Python side passes each of them by position")]
    fn columns<'py>(
        &self,
        py: Python<'py>,
        carriers: PyReadonlyArray1<'py, u8>,
        q_mm: PyReadonlyArray2<'py, f64>,
        offset_mm: PyReadonlyArray2<'py, f64>,
        variables: PyReadonlyArray2<'py, f64>,
        starts: PyReadonlyArray1<'py, i64>,
        t_s: Option<PyReadonlyArray1<'py, f64>>,
        coefficients: PyReadonlyArray1<'py, f64>,
        inner: PyReadonlyArray1<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (carriers, q_mm, offset_mm) = (&carriers, &q_mm, &offset_mm);
        let (variables, starts, t_s) = (&variables, &starts, t_s.as_ref());
        let rows = PyRows { carriers, q_mm, offset_mm, variables, starts, t_s }.to_core()?;
        let (theta, phi) = (numbers(&coefficients, "coefficients")?, numbers(&inner, "inner")?);
        let (n_rows, n_columns) = (rows.len(), theta.len() + phi.len());
        let model = self.model.without_rig();
        let columns = enter_core(py, threads, || {
            // Seen by a device that stands at the base: the whitened numbers are the displacement itself.
            let frame = Frame::Positions { pose: Pose::default(), pivot_mm: [0.0; 3], turns: false };
            let sightings = Sightings {
                measured_mm: vec![[0.0; 3]; n_rows],
                whitening: vec![Pose::default().camera_from_base; n_rows],
                session: vec![0; n_rows],
                rows,
                ..Sightings::default()
            };
            let problem = Problem::new(model, sightings, &[frame], (0..phi.len()).collect())?;
            let state = State {
                coefficients: theta.to_vec(),
                inner: phi.to_vec(),
                frames: vec![frame],
                shared: Vec::new(),
            };
            let block = problem.blocks(&state)?;
            let height = 3 * n_rows;
            let mut design = vec![0.0; height * block.n_columns()];
            block.fill(&(0..n_rows).collect::<Vec<_>>(), &vec![1.0; n_rows], &mut design);
            let mut by_row = vec![0.0; height * n_columns];
            for (column, values) in design.chunks_exact(height.max(1)).take(n_columns).enumerate() {
                for (place, value) in values.iter().enumerate() {
                    by_row[place * n_columns + column] = *value;
                }
            }
            Ok::<_, geoerr_core::volumetric::VolumetricError>(by_row)
        })?;
        columns.into_pyarray(py).reshape([n_rows, 3, n_columns])
    }
}

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyVolumetricModel>()
}
