//! Binds `geoerr_core::least_squares`: a solved system as an immutable handle.

use geoerr_core::least_squares::{
    Blocks, Design, Fit, Matrix, Method, Options, Restriction, RowDesign, Solution, StridedRows, fit,
    leave_blocks_out, orthonormal,
};
use numpy::npyffi::types::NPY_ORDER;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{contiguous, from_numbers, numbers};
use crate::core_door::enter_core;
use crate::errors::CoreError;

type Array1<'py> = Bound<'py, PyArray1<f64>>;
type Array2<'py> = Bound<'py, PyArray2<f64>>;

/// A NumPy matrix and its shape.
fn rows_of<'a>(
    array: &'a PyReadonlyArray2<'_, f64>,
    name: &str,
) -> Result<(&'a [f64], usize, usize), CoreError> {
    let refused = || CoreError::shape(format!("{name} must be a C-contiguous matrix of float64"));
    if !array.is_c_contiguous() {
        return Err(refused());
    }
    let values = array.as_slice().map_err(|_| refused())?;
    Ok((values, array.shape()[0], array.shape()[1]))
}

fn design_of<'a>(
    a: &'a PyReadonlyArray2<'_, f64>,
    b: &'a PyReadonlyArray2<'_, f64>,
) -> Result<RowDesign<'a>, CoreError> {
    let ((a, n_rows, n_columns), (b, _, n_rhs)) = (rows_of(a, "a")?, rows_of(b, "b")?);
    Ok(RowDesign::new((a, n_columns), (b, n_rhs), n_rows)?)
}

fn matrix_of(array: &PyReadonlyArray2<'_, f64>, name: &str) -> Result<Matrix, CoreError> {
    let (values, n_rows, n_columns) = rows_of(array, name)?;
    Ok(Matrix::from_fn(n_rows, n_columns, |row, column| values[row * n_columns + column]))
}

/// A matrix as an array of the same shape; the memory changes hands.
fn from_matrix(py: Python<'_>, matrix: Matrix) -> PyResult<Array2<'_>> {
    let shape = [matrix.n_rows(), matrix.n_columns()];
    matrix.into_values().into_pyarray(py).reshape_with_order(shape, NPY_ORDER::NPY_FORTRANORDER)
}

/// A solved system. Immutable, so that any number of threads may ask it.
#[pyclass(frozen, name = "LeastSquares", module = "geoerr._core")]
pub struct PyLeastSquares {
    solution: Solution,
    is_from_normal_equations: bool,
}

#[pymethods]
impl PyLeastSquares {
    #[getter]
    fn x<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        from_matrix(py, self.solution.x.clone())
    }

    #[getter]
    fn residual_ss<'py>(&self, py: Python<'py>) -> Array1<'py> {
        from_numbers(py, self.solution.residual_ss.clone())
    }

    #[getter]
    fn degrees_of_freedom(&self) -> usize {
        self.solution.degrees_of_freedom
    }

    #[getter]
    fn n_free(&self) -> usize {
        self.solution.n_free
    }

    #[getter]
    fn rank(&self) -> usize {
        self.solution.rank.rank
    }

    #[getter]
    fn rank_tolerance(&self) -> f64 {
        self.solution.rank.tolerance
    }

    #[getter]
    fn rank_gap(&self) -> f64 {
        self.solution.rank.gap
    }

    #[getter]
    fn condition(&self) -> f64 {
        self.solution.condition
    }

    #[getter]
    fn singular_values<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        self.solution.singular_values.clone().map(|values| from_numbers(py, values))
    }

    #[getter]
    fn is_determined<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        from_numbers(py, self.solution.is_determined.clone())
    }

    #[getter]
    fn null_space<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        from_matrix(py, self.solution.null_space.clone())
    }

    #[getter]
    fn is_from_normal_equations(&self) -> bool {
        self.is_from_normal_equations
    }

    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        from_matrix(py, self.solution.covariance())
    }

    fn standard_errors<'py>(&self, py: Python<'py>) -> Array1<'py> {
        from_numbers(py, self.solution.standard_errors())
    }

    fn is_estimable(&self, c: PyReadonlyArray1<'_, f64>) -> PyResult<bool> {
        Ok(self.solution.is_estimable(numbers(&c, "c")?).map_err(CoreError::from)?)
    }

    fn functional(&self, c: PyReadonlyArray1<'_, f64>, rhs: usize) -> PyResult<Option<(f64, f64)>> {
        let functional = self.solution.functional(numbers(&c, "c")?, rhs).map_err(CoreError::from)?;
        Ok(functional.map(|functional| (functional.value, functional.variance)))
    }

    fn growth_without(&self, functionals: PyReadonlyArray2<'_, f64>, rhs: usize) -> PyResult<Option<f64>> {
        let functionals = matrix_of(&functionals, "functionals")?;
        Ok(self.solution.growth_without(&functionals, rhs).map_err(CoreError::from)?)
    }

    fn solve_normal<'py>(&self, py: Python<'py>, atr: PyReadonlyArray1<'py, f64>) -> PyResult<Array1<'py>> {
        let x = self.solution.solve_normal(numbers(&atr, "atr")?).map_err(CoreError::from)?;
        Ok(from_numbers(py, x))
    }

    /// Residuals, held-out residuals by row; whether determined, by block.
    fn leave_blocks_out<'py>(
        &self,
        py: Python<'py>,
        a: PyReadonlyArray2<'py, f64>,
        b: PyReadonlyArray2<'py, f64>,
        starts: Vec<usize>,
        rhs: usize,
        threads: usize,
    ) -> PyResult<(Array1<'py>, Array1<'py>, Bound<'py, PyArray1<bool>>)> {
        let design = design_of(&a, &b)?;
        let blocks = Blocks::starting_at(&starts, design.n_rows()).map_err(CoreError::from)?;
        let solution = &self.solution;
        let left = enter_core(py, threads, || leave_blocks_out(&design, solution, &blocks, rhs))?;
        Ok((
            from_numbers(py, left.residual),
            from_numbers(py, left.held_out),
            from_numbers(py, left.is_determined),
        ))
    }
}

/// Solves `min ‖A x − B‖`, restricted to `C x = 0` or to the columns of a basis.
#[pyfunction]
#[pyo3(name = "solve_least_squares")]
#[pyo3(signature = (a, b, *, constraints, basis, rank_tolerance, wants_singular_values, method, threads))]
#[expect(clippy::too_many_arguments, reason = "named in Python")]
fn py_solve_least_squares<'py>(
    py: Python<'py>,
    a: PyReadonlyArray2<'py, f64>,
    b: PyReadonlyArray2<'py, f64>,
    constraints: Option<PyReadonlyArray2<'py, f64>>,
    basis: Option<PyReadonlyArray2<'py, f64>>,
    rank_tolerance: Option<f64>,
    wants_singular_values: bool,
    method: &str,
    threads: usize,
) -> PyResult<PyLeastSquares> {
    let design = design_of(&a, &b)?;
    let restriction = match (constraints, basis) {
        (None, None) => Restriction::None,
        (Some(constraints), None) => Restriction::Constraints(matrix_of(&constraints, "constraints")?),
        (None, Some(basis)) => Restriction::Basis(matrix_of(&basis, "basis")?),
        (Some(_), Some(_)) => {
            return Err(PyValueError::new_err("constraints and a basis exclude one another"));
        }
    };
    let method = match method {
        "fastest" => Method::Fastest,
        "qr" => Method::Qr,
        _ => return Err(PyValueError::new_err(format!("unknown method {method:?}: fastest or qr"))),
    };
    let options = Options { rank_tolerance, restriction, wants_singular_values };
    let Fit { solution, is_from_normal_equations } =
        enter_core(py, threads, || fit(&design, &options, method))?;
    Ok(PyLeastSquares { solution, is_from_normal_equations })
}

/// An orthonormal basis of the columns of `a`: (n, k), k the number of columns that are not inside the others.
#[pyfunction]
#[pyo3(name = "orthonormal_columns")]
fn py_orthonormal_columns<'py>(
    py: Python<'py>,
    a: PyReadonlyArray2<'py, f64>,
    threads: usize,
) -> PyResult<Array2<'py>> {
    let refused = || CoreError::shape("a must be a C-contiguous (n, k) array of float64");
    let rows = contiguous(&a, refused)?;
    let [n_rows, n_columns] = [a.shape()[0], a.shape()[1]];
    let (found, count) = enter_core(py, threads, || orthonormal(rows, n_columns))?;
    found.into_pyarray(py).reshape([n_rows, count])
}

/// `aᵀ b` of rows `a` (n, r) and `b` (n, k), as (k, r).
#[pyfunction]
#[pyo3(name = "products_of_columns")]
fn py_products_of_columns<'py>(
    py: Python<'py>,
    a: PyReadonlyArray2<'py, f64>,
    b: PyReadonlyArray2<'py, f64>,
    threads: usize,
) -> PyResult<Array2<'py>> {
    let refused = || CoreError::shape("a and b must be C-contiguous (n, r) and (n, k) arrays of float64");
    let n_rows = a.shape()[0];
    if b.shape()[0] != n_rows {
        return Err(refused().into());
    }
    let [width, n_columns] = [a.shape()[1], b.shape()[1]];
    let (a, b) = (contiguous(&a, refused)?, contiguous(&b, refused)?);
    let a = StridedRows::new(a, 0, width, width, n_rows);
    let b = StridedRows::new(b, 0, n_columns, n_columns, n_rows);
    let products = enter_core(py, threads, || Ok::<_, CoreError>(a.transposed_product(&b)))?;
    products.as_slice().to_vec().into_pyarray(py).reshape([n_columns, width])
}

/// Adds this file's class and functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyLeastSquares>()?;
    module.add_function(wrap_pyfunction!(py_solve_least_squares, module)?)?;
    module.add_function(wrap_pyfunction!(py_orthonormal_columns, module)?)?;
    module.add_function(wrap_pyfunction!(py_products_of_columns, module)?)
}
