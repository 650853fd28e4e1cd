//! Binds `geoerr_core::volumetric`: a machine with terms, and the problem of fitting them.

use geoerr_core::bases::Basis;
use geoerr_core::expression::Expression;
use geoerr_core::kinematics::{Axis, Carrier, Chain, Channel, Pose};
use geoerr_core::least_squares::{
    Matrix, Options, Restriction, Solution, Triangle, leave_blocks_out_of_residuals, solve,
};
use geoerr_core::volumetric::{
    Frame, KeptSums, Part, Problem, Rows, Shape, Sightings, State, Term, VolumetricModel, WhitenedDesign,
    channel_values, displacements,
};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::arrays::{from_numbers, from_rows, matrices, numbers, rows};
use crate::bases::PyBasis;
use crate::core_door::enter_core;
use crate::errors::CoreError;
use crate::expression::PyExpression;
use crate::pickled::{Reduced, parts_of, reduced};

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
struct PyRows<'a, 'py> {
    carriers: &'a PyReadonlyArray1<'py, u8>,
    q_mm: &'a PyReadonlyArray2<'py, f64>,
    offset_mm: &'a PyReadonlyArray2<'py, f64>,
    variables: &'a PyReadonlyArray2<'py, f64>,
    starts: &'a PyReadonlyArray1<'py, i64>,
    t_s: Option<&'a PyReadonlyArray1<'py, f64>>,
}

impl PyRows<'_, '_> {
    fn to_core(&self) -> Result<Rows, CoreError> {
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

fn places(array: &PyReadonlyArray1<'_, i64>, name: &str) -> Result<Vec<usize>, CoreError> {
    let refused = || CoreError::shape(format!("{name} must be (n,) places from 0"));
    array.as_array().iter().map(|&place| usize::try_from(place).map_err(|_| refused())).collect()
}

/// Places (n,) from 0; none where a number is below.
fn places_if_any(array: &PyReadonlyArray1<'_, i64>) -> Vec<Option<usize>> {
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

#[pymethods]
impl PyVolumetricModel {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced::<Self>(py, &self.model)
    }

    #[staticmethod]
    fn _from_bytes(bytes: &[u8]) -> PyResult<Self> {
        Ok(Self { model: parts_of(bytes)? })
    }

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

/// All unknowns of a problem. Immutable.
#[pyclass(frozen, name = "FitState", module = "geoerr._core")]
pub struct PyFitState {
    state: State,
}

#[pymethods]
impl PyFitState {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced::<Self>(py, &self.state)
    }

    #[staticmethod]
    fn _from_bytes(bytes: &[u8]) -> PyResult<Self> {
        Ok(Self { state: parts_of(bytes)? })
    }

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
            Frame::Circle { .. } => Pose::default().camera_from_base,
        });
        crate::arrays::from_matrices(py, all.collect())
    }

    /// Of the base origin in each session's measuring frame, or the centre of a circle, mm (s, 3).
    #[getter]
    fn translations_mm<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let all = self.state.frames.iter().map(|frame| match frame {
            Frame::Positions { pose, .. } => pose.t_mm,
            Frame::Circle { centre_mm, .. } => *centre_mm,
        });
        from_rows(py, all.collect())
    }

    /// What a circular device adds to every radius, mm (s,); 0 for others.
    #[getter]
    fn excess_mm<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let all = self.state.frames.iter().map(|frame| match frame {
            Frame::Positions { .. } => 0.0,
            Frame::Circle { excess_mm, .. } => *excess_mm,
        });
        from_numbers(py, all.collect())
    }
}

/// A model and what was measured of it.
#[pyclass(frozen, name = "FitProblem", module = "geoerr._core")]
pub struct PyFitProblem {
    problem: Problem,
    start: State,
}

/// How each session's device stands: kinds (0 free, 1 parallel, 2 circle), measured_from_base, translation or centre,
/// excess radius, pivot.
type FrameArrays<'py> = (
    PyReadonlyArray1<'py, u8>,
    PyReadonlyArray3<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray2<'py, f64>,
);

fn frames_of(arrays: &FrameArrays<'_>) -> Result<Vec<Frame>, CoreError> {
    let (kinds, rotations, translations, excess, pivots) = arrays;
    let rotations = matrices(rotations, "rotations")?;
    let (translations, pivots) = (rows(translations, "translations_mm")?, rows(pivots, "pivots_mm")?);
    let excess = numbers(excess, "excess_mm")?;
    let kinds = kinds.as_array();
    let lengths = [rotations.len(), translations.len(), pivots.len(), excess.len()];
    if lengths.iter().any(|&length| length != kinds.len()) {
        return Err(CoreError::shape("the arrays of frames differ in length"));
    }
    kinds
        .iter()
        .enumerate()
        .map(|(session, &kind)| match kind {
            0 | 1 => Ok(Frame::Positions {
                pose: Pose { camera_from_base: rotations[session], t_mm: translations[session] },
                pivot_mm: pivots[session],
                turns: kind == 0,
            }),
            2 => Ok(Frame::Circle { centre_mm: translations[session], excess_mm: excess[session] }),
            _ => Err(CoreError::shape("the kind of a frame must be 0, 1 or 2")),
        })
        .collect()
}

#[pymethods]
impl PyFitProblem {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        let problem = &self.problem;
        reduced::<Self>(py, &(problem.model(), problem.sightings(), problem.free_inner(), &self.start))
    }

    #[staticmethod]
    fn _from_bytes(bytes: &[u8]) -> PyResult<Self> {
        let (model, sightings, free_inner, start): (_, _, _, State) = parts_of(bytes)?;
        let problem = Problem::new(model, sightings, &start.frames, free_inner).map_err(CoreError::from)?;
        Ok(Self { problem, start })
    }

    /// `shared` is the derivative (n, 3, p) of measured points by unknowns that all rows share; `beside` is another
    /// problem, whose functions along axes are taken where they are the same.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "the Python side passes each of them by position")]
    #[pyo3(signature = (model, carriers, q_mm, offset_mm, variables, starts, t_s, measured_mm, whitening, session,
        frames, coefficients, inner, free_inner, shared, beside=None))]
    fn new(
        model: &PyVolumetricModel,
        carriers: PyReadonlyArray1<'_, u8>,
        q_mm: PyReadonlyArray2<'_, f64>,
        offset_mm: PyReadonlyArray2<'_, f64>,
        variables: PyReadonlyArray2<'_, f64>,
        starts: PyReadonlyArray1<'_, i64>,
        t_s: Option<PyReadonlyArray1<'_, f64>>,
        measured_mm: PyReadonlyArray2<'_, f64>,
        whitening: PyReadonlyArray3<'_, f64>,
        session: PyReadonlyArray1<'_, i64>,
        frames: FrameArrays<'_>,
        coefficients: PyReadonlyArray1<'_, f64>,
        inner: PyReadonlyArray1<'_, f64>,
        free_inner: Vec<usize>,
        shared: Option<PyReadonlyArray3<'_, f64>>,
        beside: Option<PyRef<'_, PyFitProblem>>,
    ) -> PyResult<Self> {
        let t_s = t_s.as_ref();
        let (carriers, q_mm, offset_mm) = (&carriers, &q_mm, &offset_mm);
        let (variables, starts) = (&variables, &starts);
        let rows_of_core = PyRows { carriers, q_mm, offset_mm, variables, starts, t_s }.to_core()?;
        let (n_shared, shared) = match &shared {
            None => (0, Vec::new()),
            Some(shared) => (shared.shape()[2], shared.as_array().iter().copied().collect()),
        };
        let sightings = Sightings {
            rows: rows_of_core,
            measured_mm: rows(&measured_mm, "measured_mm")?.to_vec(),
            whitening: matrices(&whitening, "whitening")?.to_vec(),
            session: places(&session, "session")?,
            shared,
            n_shared,
        };
        let frames = frames_of(&frames)?;
        let start = State {
            coefficients: numbers(&coefficients, "coefficients")?.to_vec(),
            inner: numbers(&inner, "inner")?.to_vec(),
            frames,
            shared: vec![0.0; n_shared],
        };
        let problem = Problem::new(model.core().clone(), sightings, &start.frames, free_inner)
            .map_err(CoreError::from)?;
        let problem = match beside {
            Some(other) => problem.beside(&other.problem),
            None => problem,
        };
        Ok(Self { problem, start })
    }

    #[getter]
    fn n_columns(&self) -> usize {
        self.problem.n_columns()
    }

    #[getter]
    fn first_shared_column(&self) -> usize {
        self.problem.first_shared_column()
    }

    /// The unknowns that the problem was made with.
    #[getter]
    fn start(&self) -> PyFitState {
        PyFitState { state: self.start.clone() }
    }

    /// Measured minus predicted in the measuring frame, mm (n, 3).
    fn residuals<'py>(
        &self,
        py: Python<'py>,
        state: &PyFitState,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (problem, state) = (&self.problem, &state.state);
        from_rows(py, enter_core(py, threads, || problem.residuals(state))?)
    }

    /// W r (n, 3).
    fn whitened<'py>(
        &self,
        py: Python<'py>,
        residuals_mm: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_rows(py, self.problem.whitened(rows(&residuals_mm, "residuals_mm")?))
    }

    /// Vectors of the measuring frames in base axes (n, 3).
    fn in_base_axes<'py>(
        &self,
        py: Python<'py>,
        state: &PyFitState,
        vectors_mm: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_rows(py, self.problem.in_base_axes(&state.state, rows(&vectors_mm, "vectors_mm")?))
    }

    /// The unknowns after a correction of all of them.
    fn corrected(&self, state: &PyFitState, correction: PyReadonlyArray1<'_, f64>) -> PyResult<PyFitState> {
        let correction = numbers(&correction, "correction")?;
        let state = self.problem.corrected(&state.state, correction).map_err(CoreError::from)?;
        Ok(PyFitState { state })
    }

    /// The triangle of the whitened design at a state, for solutions x with `C x = 0`: C (k, n) the `constraints`.
    /// `prior` (p, n) are further rows that hold unknowns near 0. `known` is where to begin: a triangle with the same
    /// rows and `row_scale`, and for each column (n,) where the same one is in it; -1 for one that is not.
    #[expect(clippy::too_many_arguments, reason = "the Python side passes each of them by position")]
    #[pyo3(signature = (state, row_scale, constraints, prior, threads, known=None))]
    fn triangle<'py>(
        &self,
        py: Python<'py>,
        state: &PyFitState,
        row_scale: PyReadonlyArray1<'py, f64>,
        constraints: PyReadonlyArray2<'py, f64>,
        prior: Option<PyReadonlyArray2<'py, f64>>,
        threads: usize,
        known: Option<(PyRef<'py, PyFitTriangle>, PyReadonlyArray1<'py, i64>)>,
    ) -> PyResult<PyFitTriangle> {
        let (problem, state) = (&self.problem, &state.state);
        let row_scale = numbers(&row_scale, "row_scale")?;
        let constraints = matrix_of(&constraints);
        let prior = prior.map(|prior| matrix_of(&prior));
        let known = known.as_ref().map(|(triangle, places)| (&triangle.gram, places_if_any(places)));
        let (triangle, gram) = enter_core(py, threads, || {
            let design = WhitenedDesign::without_residuals(problem, state, row_scale)?;
            let gram = match known {
                Some((gram, places)) => design.gram_from(gram, &places)?,
                None => design.own_gram(),
            };
            let design = design.with_gram(gram.clone());
            let mut triangle = Triangle::for_rank_within(&design, PRACTICAL_RANK, &constraints)?;
            if let Some(prior) = &prior {
                triangle.append(prior)?;
            }
            Ok::<_, geoerr_core::volumetric::VolumetricError>((triangle, gram))
        })?;
        Ok(PyFitTriangle { triangle, constraints, gram })
    }

    /// `Aᵀ r` (n_columns,) of the whitened design at a state.
    fn gradient<'py>(
        &self,
        py: Python<'py>,
        state: &PyFitState,
        residuals_mm: PyReadonlyArray2<'py, f64>,
        row_scale: PyReadonlyArray1<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (problem, state) = (&self.problem, &state.state);
        let residuals_mm = rows(&residuals_mm, "residuals_mm")?;
        let row_scale = numbers(&row_scale, "row_scale")?;
        let gradient = enter_core(py, threads, || {
            Ok::<_, geoerr_core::volumetric::VolumetricError>(
                problem.blocks(state)?.gradient(&problem.whitened(residuals_mm), row_scale),
            )
        })?;
        Ok(from_numbers(py, gradient))
    }

    /// The largest entry of some columns (d) of the whitened design at a state, without its sign; or, where there is an entry
    /// that is not finite, the first row and column of one.
    fn largest_entries<'py>(
        &self,
        py: Python<'py>,
        state: &PyFitState,
        columns: PyReadonlyArray1<'py, i64>,
        threads: usize,
    ) -> PyResult<LargestEntries<'py>> {
        let (problem, state) = (&self.problem, &state.state);
        let columns = places(&columns, "columns")?;
        if columns.iter().any(|&column| column >= problem.n_columns()) {
            return Err(CoreError::shape("a column is one of the unknowns").into());
        }
        let found = enter_core(py, threads, || {
            Ok::<_, geoerr_core::volumetric::VolumetricError>(
                problem.blocks(state)?.largest_entries(&columns),
            )
        })?;
        Ok(match found {
            Ok(largest) => (Some(from_numbers(py, largest)), None),
            Err(place) => (None, Some(place)),
        })
    }

    /// `A F` (n, 3, r) of the whitened design at a state for a matrix F (n_columns, r).
    fn times<'py>(
        &self,
        py: Python<'py>,
        state: &PyFitState,
        matrix: PyReadonlyArray2<'py, f64>,
        row_scale: PyReadonlyArray1<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (problem, state) = (&self.problem, &state.state);
        let (matrix, row_scale) = (matrix_of(&matrix), numbers(&row_scale, "row_scale")?);
        if matrix.n_rows() != problem.n_columns() || row_scale.len() != problem.n_rows() {
            return Err(CoreError::shape("a design is multiplied by a row for each of its columns").into());
        }
        let products = enter_core(py, threads, || {
            Ok::<_, geoerr_core::volumetric::VolumetricError>(
                problem.blocks(state)?.times(&matrix, row_scale),
            )
        })?;
        products.into_pyarray(py).reshape([problem.n_rows(), 3, matrix.n_columns()])
    }

    /// How a correction of all unknowns moves the measured points, to first order, mm (n, 3).
    fn first_order_mm<'py>(
        &self,
        py: Python<'py>,
        state: &PyFitState,
        correction: PyReadonlyArray1<'py, f64>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let correction = numbers(&correction, "correction")?;
        if correction.len() != self.problem.n_columns() {
            return Err(CoreError::shape("a correction has one number for each unknown").into());
        }
        let (problem, state) = (&self.problem, &state.state);
        from_rows(py, enter_core(py, threads, || problem.first_order_mm(state, correction))?)
    }

    /// Leaves blocks of rows out in turn. `order` are the rows block by block, `starts` where blocks begin in it, `own`
    /// how many unknowns belong to each block alone, `weights` (n, 3) what the variances of its prediction are multiplied
    /// with, in the order of rows. Rows of the answer are in that of `order`, variances are summed by block. `known` is
    /// where to begin: sums of a design with the same rows and weights, and for each column (n,) where the same one is in
    /// it, -1 of one that is not; they are not asked where they are of other blocks.
    #[expect(clippy::too_many_arguments, reason = "the Python side passes each of them by position")]
    #[pyo3(signature = (state, solution, residuals_mm, order, starts, own, weights, threads, known=None))]
    fn leave_out<'py>(
        &self,
        py: Python<'py>,
        state: &PyFitState,
        solution: &PyFitSolution,
        residuals_mm: PyReadonlyArray2<'py, f64>,
        order: PyReadonlyArray1<'py, i64>,
        starts: PyReadonlyArray1<'py, i64>,
        own: PyReadonlyArray1<'py, i64>,
        weights: PyReadonlyArray2<'py, f64>,
        threads: usize,
        known: Option<(PyRef<'py, PyFitSums>, PyReadonlyArray1<'py, i64>)>,
    ) -> PyResult<LeftOutArrays<'py>> {
        let (problem, state, solution) = (&self.problem, &state.state, &solution.solution);
        let residuals_mm = rows(&residuals_mm, "residuals_mm")?;
        let (order, starts) = (places(&order, "order")?, places(&starts, "starts")?);
        let own = places(&own, "own")?;
        let weights: &[[f64; 3]] = rows(&weights, "weights")?;
        if weights.len() != problem.n_rows() {
            return Err(CoreError::shape("every sighting has three weights").into());
        }
        let known = known.as_ref().filter(|(sums, _)| sums.order == order && sums.starts == starts);
        let known = known.map(|(sums, places)| (&sums.sums, places_if_any(places)));
        let is_little = 2 * starts.len() * problem.n_columns().pow(2) <= MOST_KEPT;
        let (left, sums) = enter_core(py, threads, || {
            let row_scale = vec![1.0; problem.n_rows()];
            let in_order: Vec<f64> =
                order.iter().filter_map(|&row| weights.get(row)).copied().flatten().collect();
            let mut design =
                WhitenedDesign::in_order(problem, state, residuals_mm, &row_scale, order.clone())?;
            if let Some((sums, places)) = &known {
                design = design.beginning_at(sums, places)?;
            }
            if is_little {
                design = design.keeping_sums();
            }
            let blocks = design.blocks_at(&starts)?;
            let left = leave_blocks_out_of_residuals(&design, solution, &blocks, &own, Some(&in_order))?;
            Ok::<_, geoerr_core::volumetric::VolumetricError>((left, design.into_kept_sums()))
        })?;
        let n = left.held_out.len() / 3;
        let held_out = left.held_out.into_pyarray(py).reshape([n, 3])?;
        let sums = sums.map(|sums| PyFitSums { sums, order, starts });
        Ok((held_out, from_numbers(py, left.prediction_variance), left.is_determined, sums))
    }

    /// The whitened design of rows `first` to `last` (3 (last − first), n_columns), in NumPy's order.
    fn design<'py>(
        &self,
        py: Python<'py>,
        state: &PyFitState,
        row_scale: PyReadonlyArray1<'py, f64>,
        first: usize,
        last: usize,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (problem, state) = (&self.problem, &state.state);
        let row_scale = numbers(&row_scale, "row_scale")?;
        if first > last || last > problem.n_rows() || row_scale.len() != problem.n_rows() {
            return Err(CoreError::shape("the rows of a design must lie within those of the problem").into());
        }
        let (height, n_columns) = (3 * (last - first), problem.n_columns());
        let design = enter_core(py, threads, || {
            let mut design = vec![0.0; height * n_columns];
            let rows: Vec<usize> = (first..last).collect();
            problem.blocks(state)?.fill(&rows, row_scale, &mut design);
            Ok::<_, geoerr_core::volumetric::VolumetricError>(design)
        })?;
        // Column by column is what the transpose of NumPy's order is.
        design.into_pyarray(py).reshape([n_columns, height])?.transpose()
    }
}

/// Largest entries, or the place of one that is not finite.
type LargestEntries<'py> = (Option<Bound<'py, PyArray1<f64>>>, Option<(usize, usize)>);

/// Residuals against the other blocks, whitened (n, 3); of each block the weighted variances of its prediction, and whether
/// it is determined by the others; what blocks sum up to, where that is kept.
type LeftOutArrays<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>, Vec<bool>, Option<PyFitSums>);

/// Numbers of sums that are kept: 64 MB of them.
const MOST_KEPT: usize = 1 << 23;

/// What blocks of rows of a design sum up to, and which blocks these were.
#[pyclass(frozen, name = "FitSums", module = "geoerr._core")]
pub struct PyFitSums {
    sums: KeptSums,
    order: Vec<usize>,
    starts: Vec<usize>,
}

#[pymethods]
impl PyFitSums {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced::<Self>(py, &(&self.sums, &self.order, &self.starts))
    }

    #[staticmethod]
    fn _from_bytes(bytes: &[u8]) -> PyResult<Self> {
        let (sums, order, starts) = parts_of(bytes)?;
        Ok(Self { sums, order, starts })
    }
}

/// Columns of norm 1 that cancel to this are not told apart by measurements: noise in that direction is 100,000 times
/// that of a single number, and what came out would be no estimate of anything.
const PRACTICAL_RANK: f64 = 1e-5;

/// What a whitened design leaves behind.
#[pyclass(frozen, name = "FitTriangle", module = "geoerr._core")]
pub struct PyFitTriangle {
    triangle: Triangle,
    /// Those that every solution keeps (k, n).
    constraints: Matrix,
    /// `AᵀA` of the whitened design.
    gram: Matrix,
}

fn matrix_of(array: &PyReadonlyArray2<'_, f64>) -> Matrix {
    let array = array.as_array();
    Matrix::from_fn(array.nrows(), array.ncols(), |row, column| array[[row, column]])
}

#[pymethods]
impl PyFitTriangle {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced::<Self>(py, &(&self.triangle, &self.constraints, &self.gram))
    }

    #[staticmethod]
    fn _from_bytes(bytes: &[u8]) -> PyResult<Self> {
        let (triangle, constraints, gram) = parts_of(bytes)?;
        Ok(Self { triangle, constraints, gram })
    }

    /// Solves with the constraints that the triangle was made for, and `further` ones (k, n): `C x = 0` holds exactly.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        further: Option<PyReadonlyArray2<'py, f64>>,
        threads: usize,
    ) -> PyResult<PyFitSolution> {
        let own = &self.constraints;
        let further = further.map_or_else(|| Matrix::zeros(0, own.n_columns()), |rows| matrix_of(&rows));
        if further.n_columns() != own.n_columns() {
            return Err(CoreError::shape("a constraint has one number for each unknown").into());
        }
        let rows = Matrix::from_fn(own.n_rows() + further.n_rows(), own.n_columns(), |row, column| match row
            .checked_sub(own.n_rows())
        {
            None => own[(row, column)],
            Some(row) => further[(row, column)],
        });
        let restriction = if rows.n_rows() == 0 { Restriction::None } else { Restriction::Constraints(rows) };
        let options = Options { restriction, rank_tolerance: Some(PRACTICAL_RANK), ..Options::default() };
        let solution = enter_core(py, threads, || solve(&self.triangle, &options))?;
        Ok(PyFitSolution { solution })
    }
}

/// A solution, and what of it the data determine.
#[pyclass(frozen, name = "FitSolution", module = "geoerr._core")]
pub struct PyFitSolution {
    solution: Solution,
}

fn from_matrix<'py>(py: Python<'py>, matrix: &Matrix) -> PyResult<Bound<'py, PyArray2<f64>>> {
    matrix.transposed().into_values().into_pyarray(py).reshape([matrix.n_rows(), matrix.n_columns()])
}

#[pymethods]
impl PyFitSolution {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced::<Self>(py, &self.solution)
    }

    #[staticmethod]
    fn _from_bytes(bytes: &[u8]) -> PyResult<Self> {
        Ok(Self { solution: parts_of(bytes)? })
    }

    /// How many unknowns the data determine.
    #[getter]
    fn rank(&self) -> usize {
        self.solution.rank.rank
    }

    /// Last singular value kept over the first one dropped.
    #[getter]
    fn rank_gap(&self) -> f64 {
        self.solution.rank.gap
    }

    /// Of the scaled columns.
    #[getter]
    fn condition(&self) -> f64 {
        self.solution.condition
    }

    /// Which unknowns the data and the constraints determine (n,).
    #[getter]
    fn is_determined(&self) -> Vec<bool> {
        self.solution.is_determined.clone()
    }

    /// Directions that the data do not determine (n, d), each with largest entry 1.
    #[getter]
    fn null_space<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_matrix(py, &self.solution.null_space)
    }

    /// F (n, rank) with F Fᵀ the covariance for residuals of variance 1.
    #[getter]
    fn covariance_root<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_matrix(py, self.solution.covariance_root())
    }

    /// `(AᵀA)⁺ g` for `g = Aᵀ r`: a Gauss-Newton step.
    fn step<'py>(
        &self,
        py: Python<'py>,
        gradient: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let gradient = numbers(&gradient, "gradient")?;
        Ok(from_numbers(py, self.solution.solve_normal(gradient).map_err(CoreError::from)?))
    }
}

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyVolumetricModel>()?;
    module.add_class::<PyFitState>()?;
    module.add_class::<PyFitTriangle>()?;
    module.add_class::<PyFitSolution>()?;
    module.add_class::<PyFitSums>()?;
    module.add_class::<PyFitProblem>()
}
