//! The problem of fitting: residuals, derivatives, what is left out by turns.

use geoerr_core::kinematics::Pose;
use geoerr_core::least_squares::{
    BorderedTriangle, LeftOut, Matrix, Solution, Triangle, leave_blocks_out_of_residuals,
    leave_bordered_blocks_out,
};
use geoerr_core::volumetric::{
    BySession, Frame, KeptSums, Problem, Sightings, State, VolumetricError, WhitenedDesign,
};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use super::solution::{Left, PRACTICAL_RANK, PyFitSolution, PyFitTriangle, matrix_of};
use super::state::PyFitState;
use crate::arrays::{from_numbers, from_rows, matrices, numbers, rows};
use crate::core_door::enter_core;
use crate::errors::CoreError;
use crate::pickled::{Reduced, parts_of, pickled, reduced};
use crate::volumetric::{PyRows, PyVolumetricModel, places, places_if_any};

/// A model and what was measured of it.
#[pyclass(frozen, name = "FitProblem", module = "geoerr._core")]
pub struct PyFitProblem {
    problem: Problem,
    start: State,
}

/// How each session's device stands: kinds (0 free, 1 parallel, 2 circle, 3 lengths), measured_from_base, translation
/// or centre, excess radius, pivot.
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
            3 => Ok(Frame::Lengths),
            _ => Err(CoreError::shape("the kind of a frame must be 0, 1, 2 or 3")),
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
    /// problem, whose functions along axes are taken where they are the same; `length` is the number of the length that
    /// each row (n,) is an end of, -1 of others.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "the Python side passes each of them by position")]
    #[pyo3(signature = (model, carriers, q_mm, offset_mm, variables, starts, t_s, measured_mm, whitening, session,
        frames, coefficients, inner, free_inner, shared, beside=None, length=None))]
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
        length: Option<PyReadonlyArray1<'_, i64>>,
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
            length: length.as_ref().map(places_if_any).unwrap_or_default(),
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
    /// rows and `row_scale`, and for each column (n,) where the same one is in it; -1 for one that is not; it is not asked
    /// where most unknowns are those of sessions.
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
        let known = known.as_ref().and_then(|(triangle, places)| match &triangle.left {
            Left::Whole { gram, .. } => Some((gram, places_if_any(places))),
            Left::Bordered(_) => None,
        });
        let left = enter_core(py, threads, || {
            let design = WhitenedDesign::without_residuals(problem, state, row_scale)?;
            if let Some(by_session) = problem.by_session(&constraints, prior.as_ref())? {
                return bordered(design, by_session, &constraints, prior.as_ref());
            }
            let gram = match known {
                Some((gram, places)) => design.gram_from(gram, &places)?,
                None => design.own_gram(),
            };
            let design = design.with_gram(gram.clone());
            let mut triangle = Triangle::for_rank_within(&design, PRACTICAL_RANK, &constraints)?;
            if let Some(prior) = &prior {
                triangle.append(prior)?;
            }
            Ok::<_, VolumetricError>(Left::Whole { triangle, gram })
        })?;
        Ok(PyFitTriangle { left, constraints })
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
            Ok::<_, VolumetricError>(
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
            Ok::<_, VolumetricError>(problem.blocks(state)?.largest_entries(&columns))
        })?;
        Ok(match found {
            Ok(largest) => (Some(from_numbers(py, largest)), None),
            Err(place) => (None, Some(place)),
        })
    }

    /// `A F` (k, 3, r) of the whitened design of some rows, or all, at a state for a matrix F (n_columns, r).
    #[pyo3(signature = (state, matrix, row_scale, threads, rows=None))]
    fn times<'py>(
        &self,
        py: Python<'py>,
        state: &PyFitState,
        matrix: PyReadonlyArray2<'py, f64>,
        row_scale: PyReadonlyArray1<'py, f64>,
        threads: usize,
        rows: Option<PyReadonlyArray1<'py, i64>>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (problem, state) = (&self.problem, &state.state);
        let (matrix, row_scale) = (matrix_of(&matrix), numbers(&row_scale, "row_scale")?);
        if matrix.n_rows() != problem.n_columns() || row_scale.len() != problem.n_rows() {
            return Err(CoreError::shape("a design is multiplied by a row for each of its columns").into());
        }
        let rows = match &rows {
            Some(rows) => places(rows, "rows")?,
            None => (0..problem.n_rows()).collect(),
        };
        if rows.iter().any(|&row| row >= problem.n_rows()) {
            return Err(CoreError::shape("the rows of a design must lie within those of the problem").into());
        }
        let products = enter_core(py, threads, || {
            Ok::<_, VolumetricError>(problem.blocks(state)?.times(&matrix, &rows, row_scale))
        })?;
        products.into_pyarray(py).reshape([rows.len(), 3, matrix.n_columns()])
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
        if solution.is_bordered() {
            let by = LeaveOut { order: &order, starts: &starts, own: &own, weights };
            let left = enter_core(py, threads, || by.sessions(problem, state, solution, residuals_mm))?;
            let held_out = left.held_out.into_pyarray(py).reshape([order.len(), 3])?;
            return Ok((held_out, from_numbers(py, left.prediction_variance), left.is_determined, None));
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
            Ok::<_, VolumetricError>((left, design.into_kept_sums()))
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
            Ok::<_, VolumetricError>(design)
        })?;
        // Column by column is what the transpose of NumPy's order is.
        design.into_pyarray(py).reshape([n_columns, height])?.transpose()
    }
}

/// The triangle of a design of which most unknowns are those of sessions.
fn bordered(
    design: WhitenedDesign<'_>,
    by_session: BySession,
    constraints: &Matrix,
    prior: Option<&Matrix>,
) -> Result<Left, VolumetricError> {
    let BySession { order, border } = by_session;
    let design = design.ordered(order)?;
    let mut triangle = BorderedTriangle::for_rank_within(&design, border, PRACTICAL_RANK, constraints)?;
    if let Some(prior) = prior {
        triangle.append(prior)?;
    }
    Ok(Left::Bordered(triangle))
}

/// Blocks of sightings to leave out, as [`PyFitProblem::leave_out`] is given them.
struct LeaveOut<'a> {
    order: &'a [usize],
    starts: &'a [usize],
    own: &'a [usize],
    weights: &'a [[f64; 3]],
}

impl LeaveOut<'_> {
    /// Leaves them out of a solution of which most unknowns are those of sessions.
    fn sessions(
        &self,
        problem: &Problem,
        state: &State,
        solution: &Solution,
        residuals_mm: &[[f64; 3]],
    ) -> Result<LeftOut, VolumetricError> {
        let session = |place: usize| problem.session().get(self.order[place]).copied();
        // Places in the order, sessions one after the other within each block.
        let mut places: Vec<usize> = (0..self.order.len()).collect();
        let ends = self.starts.iter().copied().skip(1).chain([self.order.len()]);
        for (&start, end) in self.starts.iter().zip(ends) {
            if let Some(block) = places.get_mut(start..end) {
                block.sort_by_key(|&place| session(place));
            }
        }
        let order: Vec<usize> = places.iter().map(|&place| self.order[place]).collect();
        let group: Vec<usize> =
            places.iter().filter_map(|&place| session(place)).flat_map(|one| [one; 3]).collect();
        let weights: Vec<f64> =
            order.iter().filter_map(|&row| self.weights.get(row)).copied().flatten().collect();
        let row_scale = vec![1.0; problem.n_rows()];
        let design = WhitenedDesign::in_order(problem, state, residuals_mm, &row_scale, order)?;
        let blocks = design.blocks_at(self.starts)?;
        let left = leave_bordered_blocks_out(&design, solution, &group, &blocks, self.own, Some(&weights))?;
        let mut held_out = vec![0.0; left.held_out.len()];
        for (numbers, place) in left.held_out.chunks_exact(3).zip(places) {
            held_out[3 * place..][..3].copy_from_slice(numbers);
        }
        Ok(LeftOut { held_out, ..left })
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

pickled!(PyFitSums: sums, order, starts);
