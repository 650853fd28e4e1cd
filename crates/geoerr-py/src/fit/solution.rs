//! What a whitened design leaves behind, and its solution.

use geoerr_core::least_squares::{
    BorderedTriangle, LeastSquaresError, Matrix, Options, Restriction, Solution, Triangle, solve,
};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};

use crate::arrays::{from_numbers, numbers};
use crate::core_door::enter_core;
use crate::errors::CoreError;
use crate::pickled::pickled;

/// Columns of norm 1 that cancel to this are not told apart by measurements: noise in that direction is 100,000 times
/// that of a single number, and what came out would be no estimate of anything.
pub(super) const PRACTICAL_RANK: f64 = 1e-5;

/// What a whitened design leaves behind.
#[pyclass(frozen, name = "FitTriangle", module = "geoerr._core")]
pub struct PyFitTriangle {
    pub(super) left: Left,
    /// Those that every solution keeps (k, n).
    pub(super) constraints: Matrix,
}

/// What is left of all unknowns, with `AᵀA`; or of those that are no session's own, and of these.
#[derive(Serialize, Deserialize)]
pub(super) enum Left {
    Whole { triangle: Triangle, gram: Matrix },
    Bordered(BorderedTriangle),
}

impl Left {
    fn solve(&self, constraints: Matrix) -> Result<Solution, LeastSquaresError> {
        let triangle = match self {
            Self::Whole { triangle, .. } => triangle,
            Self::Bordered(triangle) => return triangle.solve(&constraints, PRACTICAL_RANK),
        };
        let restriction = match constraints.n_rows() {
            0 => Restriction::None,
            _ => Restriction::Constraints(constraints),
        };
        let options = Options { restriction, rank_tolerance: Some(PRACTICAL_RANK), ..Options::default() };
        solve(triangle, &options)
    }
}

pub(super) fn matrix_of(array: &PyReadonlyArray2<'_, f64>) -> Matrix {
    let array = array.as_array();
    Matrix::from_fn(array.nrows(), array.ncols(), |row, column| array[[row, column]])
}

pickled!(PyFitTriangle: left, constraints);

#[pymethods]
impl PyFitTriangle {
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
        let solution = enter_core(py, threads, || self.left.solve(rows))?;
        Ok(PyFitSolution { solution })
    }
}

/// A solution, and what of it the data determine.
#[pyclass(frozen, name = "FitSolution", module = "geoerr._core")]
pub struct PyFitSolution {
    pub(super) solution: Solution,
}

fn from_matrix<'py>(py: Python<'py>, matrix: &Matrix) -> PyResult<Bound<'py, PyArray2<f64>>> {
    matrix.transposed().into_values().into_pyarray(py).reshape([matrix.n_rows(), matrix.n_columns()])
}

pickled!(PyFitSolution: solution);

#[pymethods]
impl PyFitSolution {
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
        from_matrix(py, &self.solution.covariance_root())
    }

    /// Its rows of the first `count` unknowns (count, rank).
    fn covariance_root_of_first<'py>(
        &self,
        py: Python<'py>,
        count: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_matrix(py, &self.solution.covariance_root_of_first(count).map_err(CoreError::from)?)
    }

    /// Standard errors of all unknowns (n,) for residuals of variance 1.
    #[getter]
    fn spread<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        from_numbers(py, self.solution.spread())
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
