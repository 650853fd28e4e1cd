//! Binds `geoerr_core::candidates`: what a fit leaves as an immutable handle, and the scan of candidates against it.

use geoerr_core::candidates::{Column, Directions, Formula, Group, Scanned, Scene, Sources, Whitened, scan};
use geoerr_core::expression::Rows;
use numpy::ndarray::Dimension;
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray, PyReadonlyArray1,
    PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::arrays::{contiguous, from_numbers, numbers};
use crate::core_door::enter_core;
use crate::errors::CoreError;
use crate::expression::{PyExpression, places};
use crate::noise_likelihood::PyNoiseWhitening;

enum Precision {
    Single(Scene<f32>),
    Double(Scene<f64>),
}

/// What a fit leaves. Immutable, so that any number of threads may ask it.
#[pyclass(frozen, name = "CandidateScene", module = "geoerr._core")]
pub struct PyCandidateScene {
    scene: Precision,
    n_rows: usize,
}

/// Columns of a group, as Python has them: functions (n_trials, k), channels, factors and coefficients (k,).
type GroupArrays<'py> = (
    PyReadonlyArray2<'py, i64>,
    PyReadonlyArray1<'py, i64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, i64>,
    usize,
);
/// Formulas at trial values, one after the other: number of the expression (n,), of the series that it follows, −1 for
/// none (n,), where its values of inner parameters begin (n + 1,), and all of those.
type FormulaArrays<'py> = (
    PyReadonlyArray1<'py, i64>,
    PyReadonlyArray1<'py, i64>,
    PyReadonlyArray1<'py, i64>,
    PyReadonlyArray1<'py, f64>,
);
/// Gain, rank and share (n_trials,), and by rank the largest gain of every draw (n_ranks, n_draws), −1 for none.
type GroupResult<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
);

fn named<'a, T: Element, D: Dimension>(
    array: &'a PyReadonlyArray<'_, T, D>,
    name: &str,
) -> Result<&'a [T], CoreError> {
    contiguous(array, || CoreError::shape(format!("{name} must be a C-contiguous array")))
}

#[pymethods]
impl PyCandidateScene {
    #[new]
    fn new(
        py: Python<'_>,
        basis: PyReadonlyArray3<'_, f64>,
        residual: PyReadonlyArray2<'_, f64>,
        draws: Option<PyReadonlyArray3<'_, f32>>,
        directions: PyReadonlyArray3<'_, f64>,
        noise: &PyNoiseWhitening,
        threads: usize,
    ) -> PyResult<Self> {
        let all = named(&directions, "directions")?;
        let [n_channels, components, n_rows] =
            [directions.shape()[0], directions.shape()[1], directions.shape()[2]];
        if components != 3 {
            return Err(CoreError::shape("directions must be (n_channels, 3, n)").into());
        }
        let column = |at: usize| &all[at * n_rows..(at + 1) * n_rows];
        let directions: Vec<Directions<'_>> =
            (0..n_channels).map(|channel| [0, 1, 2].map(|c| column(3 * channel + c))).collect();
        let noise = noise.core().clone();
        let (basis, residual) = (named(&basis, "basis")?, named(&residual, "residual")?);
        let draws = draws.as_ref().map(|draws| named(draws, "draws")).transpose()?;
        let scene = enter_core(py, threads, || match draws {
            Some(draws) => {
                Scene::new(&directions, Whitened { basis, residual, draws }, noise).map(Precision::Single)
            }
            None => {
                let whitened = Whitened { basis, residual, draws: &[] };
                Scene::new(&directions, whitened, noise).map(Precision::Double)
            }
        })?;
        Ok(Self { scene, n_rows })
    }

    /// Judges groups of columns at all their trials.
    #[expect(clippy::too_many_arguments, reason = "one argument for each array of the call")]
    fn scan<'py>(
        &self,
        py: Python<'py>,
        variables: PyReadonlyArray2<'py, f64>,
        starts: PyReadonlyArray1<'py, i64>,
        t: Option<PyReadonlyArray1<'py, f64>>,
        expressions: Vec<(Bound<'py, PyExpression>, bool)>,
        formulas: FormulaArrays<'py>,
        series: PyReadonlyArray2<'py, f64>,
        given: PyReadonlyArray2<'py, f64>,
        products: Vec<[usize; 2]>,
        groups: Vec<GroupArrays<'py>>,
        threads: usize,
    ) -> PyResult<Vec<GroupResult<'py>>> {
        let variables = rows_of(&variables, "variables")?;
        let series = rows_of(&series, "series")?;
        let given = rows_of(&given, "given functions")?;
        let starts = places(&starts)?;
        let t = t.as_ref().map(|t| numbers(t, "t")).transpose()?;
        let rows = Rows { variables: &variables, n_rows: self.n_rows, starts: &starts, t };
        let formulas = formulas_of(&expressions, &formulas, variables.len())?;
        let groups: Vec<Group> = groups.iter().map(group_of).collect::<Result<_, _>>()?;
        let sources =
            Sources { rows, formulas: &formulas, series: &series, given: &given, products: &products };
        let scanned = enter_core(py, threads, || match &self.scene {
            Precision::Single(scene) => scan(scene, &sources, &groups),
            Precision::Double(scene) => scan(scene, &sources, &groups),
        })?;
        scanned.into_iter().map(|one| result_of(py, one)).collect()
    }
}

/// The formulas; what follows a series has it for its last variable.
fn formulas_of(
    expressions: &[(Bound<'_, PyExpression>, bool)],
    (numbers_of, series, starts, inner): &FormulaArrays<'_>,
    n_variables: usize,
) -> Result<Vec<Formula>, CoreError> {
    let (numbers_of, starts) = (places(numbers_of)?, places(starts)?);
    let (series, inner) = (named(series, "series of formulas")?, numbers(inner, "inner values")?);
    if series.len() != numbers_of.len() || starts.len() != numbers_of.len() + 1 {
        return Err(CoreError::shape(
            "every formula needs an expression, a series and the place of its values",
        ));
    }
    (numbers_of.iter().zip(series).zip(starts.windows(2)))
        .map(|((&number, &series), own)| {
            let (expression, is_proportional) = (expressions.get(number))
                .ok_or_else(|| CoreError::shape(format!("there is no expression {number}")))?;
            let inner = (inner.get(own[0]..own[1]))
                .ok_or_else(|| CoreError::shape("values of inner parameters are missing"))?;
            Ok(Formula {
                expression: expression.get().core().clone(),
                inner: inner.to_vec(),
                series: usize::try_from(series).ok().map(|series| [n_variables.saturating_sub(1), series]),
                is_proportional: *is_proportional,
            })
        })
        .collect()
}

fn rows_of<'a>(array: &'a PyReadonlyArray2<'_, f64>, name: &str) -> Result<Vec<&'a [f64]>, CoreError> {
    let all = named(array, name)?;
    let n = array.shape()[1];
    Ok((0..array.shape()[0]).map(|row| &all[row * n..(row + 1) * n]).collect())
}

fn group_of(arrays: &GroupArrays<'_>) -> Result<Group, CoreError> {
    let (functions, channels, factors, coefficients, n_coefficients) = arrays;
    let all = named(functions, "functions")?;
    let place = |&value: &i64| {
        usize::try_from(value).map_err(|_| CoreError::shape(format!("function {value} is negative")))
    };
    let (channels, coefficients) = (places(channels)?, places(coefficients)?);
    let factors = numbers(factors, "factors")?;
    if channels.len() != functions.shape()[1] || coefficients.len() != channels.len() {
        return Err(CoreError::shape("a group needs one channel, factor and coefficient a column"));
    }
    let columns = (channels.into_iter().zip(factors).zip(coefficients))
        .map(|((channel, &factor), coefficient)| Column { channel, factor, coefficient })
        .collect();
    let functions = all.iter().map(place).collect::<Result<_, _>>()?;
    Ok(Group { n_coefficients: *n_coefficients, columns, functions })
}

fn result_of<'py>(py: Python<'py>, one: Scanned) -> PyResult<GroupResult<'py>> {
    let n_draws = one.largest.iter().map(Vec::len).max().unwrap_or(0);
    let n_ranks = one.largest.len();
    let largest: Vec<f64> = (one.largest.iter())
        .flat_map(|of_rank| if of_rank.is_empty() { vec![-1.0; n_draws] } else { of_rank.clone() })
        .collect();
    let rank: Vec<i64> = one.rank.iter().map(|&rank| rank as i64).collect();
    Ok((
        from_numbers(py, one.gain),
        from_numbers(py, rank),
        from_numbers(py, one.share),
        largest.into_pyarray(py).reshape([n_ranks, n_draws])?,
    ))
}

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyCandidateScene>()
}
