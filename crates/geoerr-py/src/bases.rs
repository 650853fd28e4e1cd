//! Binds `geoerr_core::bases`: bases, curves and grids of elements as immutable handles.

use geoerr_core::bases::{Basis, Curve, Hexahedra, Order};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::arrays::{from_numbers, numbers, rows};
use crate::errors::CoreError;
use crate::pickled::pickled;

/// Functions of one axis position.
#[pyclass(frozen, name = "Basis", module = "geoerr._core")]
pub struct PyBasis {
    basis: Basis,
}

impl PyBasis {
    /// The core's basis, for the other bindings.
    pub fn core(&self) -> &Basis {
        &self.basis
    }

    fn rows<'py>(
        &self,
        py: Python<'py>,
        order: Order,
        q_mm: &PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let q_mm = numbers(q_mm, "q_mm")?;
        let basis = &self.basis;
        let rows = py.detach(|| basis.rows(order, q_mm));
        rows.into_pyarray(py).reshape([q_mm.len(), basis.len()])
    }
}

pickled!(PyBasis: basis);

#[pymethods]
impl PyBasis {
    /// Clamped B-splines.
    #[staticmethod]
    fn bspline(knots_mm: PyReadonlyArray1<'_, f64>, degree: usize) -> PyResult<Self> {
        let knots_mm = numbers(&knots_mm, "knots_mm")?.to_vec();
        Ok(Self { basis: Basis::bspline(knots_mm, degree).map_err(CoreError::from)? })
    }

    /// Legendre polynomials.
    #[staticmethod]
    fn polynomial(low_mm: f64, high_mm: f64, degree: usize) -> PyResult<Self> {
        Ok(Self { basis: Basis::polynomial(low_mm, high_mm, degree).map_err(CoreError::from)? })
    }

    /// A constant and waves.
    #[staticmethod]
    fn fourier(low_mm: f64, high_mm: f64, period_mm: f64, order: usize) -> PyResult<Self> {
        Ok(Self { basis: Basis::fourier(low_mm, high_mm, period_mm, order).map_err(CoreError::from)? })
    }

    /// Two-node elements.
    #[staticmethod]
    fn linear_elements(nodes_mm: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        let nodes_mm = numbers(&nodes_mm, "nodes_mm")?.to_vec();
        Ok(Self { basis: Basis::linear_elements(nodes_mm).map_err(CoreError::from)? })
    }

    /// Three-node elements.
    #[staticmethod]
    fn quadratic_elements(nodes_mm: PyReadonlyArray1<'_, f64>) -> PyResult<Self> {
        let nodes_mm = numbers(&nodes_mm, "nodes_mm")?.to_vec();
        Ok(Self { basis: Basis::quadratic_elements(nodes_mm).map_err(CoreError::from)? })
    }

    /// Straightness from the basis of an angle.
    #[staticmethod]
    fn tangent_integral(of: &Self) -> PyResult<Self> {
        Ok(Self { basis: Basis::tangent_integral(of.basis.clone()).map_err(CoreError::from)? })
    }

    /// Number of functions.
    fn __len__(&self) -> usize {
        self.basis.len()
    }

    /// Low and high end.
    #[getter]
    fn range(&self) -> (f64, f64) {
        self.basis.range()
    }

    /// Positions where some function's value or slope is not continuous.
    fn kinks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        from_numbers(py, self.basis.kinks())
    }

    /// All functions at each position.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, Order::Value, &q_mm)
    }

    /// All derivatives at each position.
    fn derivative<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, Order::Derivative, &q_mm)
    }

    /// All integrals from the low end to each position.
    fn integral<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, Order::Integral, &q_mm)
    }

    /// The coefficients' weights in the sum's value.
    fn value_row<'py>(&self, py: Python<'py>, q_mm: f64) -> Bound<'py, PyArray1<f64>> {
        from_numbers(py, self.basis.value_row(q_mm))
    }

    /// The coefficients' weights in the sum's mean.
    fn mean_row<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        from_numbers(py, self.basis.mean_row())
    }

    /// The coefficients' weights in the slope of the sum's least-squares line.
    fn slope_row<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        from_numbers(py, self.basis.slope_row())
    }

    /// The sum of the functions times coefficients.
    fn curve(&self, coefficients: PyReadonlyArray1<'_, f64>) -> PyResult<PyCurve> {
        let coefficients = numbers(&coefficients, "coefficients")?;
        Ok(PyCurve { curve: self.basis.curve(coefficients).map_err(CoreError::from)? })
    }
}

/// A function of one axis position.
#[pyclass(frozen, name = "Curve", module = "geoerr._core")]
pub struct PyCurve {
    curve: Curve,
}

#[pymethods]
impl PyCurve {
    /// The same value everywhere.
    #[staticmethod]
    fn constant(value: f64) -> Self {
        Self { curve: Curve::constant(value) }
    }

    /// The sum of two functions.
    fn plus(&self, other: &Self) -> Self {
        Self { curve: self.curve.plus(&other.curve) }
    }

    /// Values at positions.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(self.each(py, &q_mm, |curve, q_mm| curve.value_and_slope(q_mm).0)?)
    }

    /// Slopes at positions, to the right at kinks.
    fn derivative<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(self.each(py, &q_mm, |curve, q_mm| curve.value_and_slope(q_mm).1)?)
    }

    /// Positions where value or slope may not be continuous.
    fn kinks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        from_numbers(py, self.curve.kinks().to_vec())
    }
}

impl PyCurve {
    fn each<'py>(
        &self,
        py: Python<'py>,
        q_mm: &PyReadonlyArray1<'py, f64>,
        of: impl Fn(&Curve, f64) -> f64 + Sync,
    ) -> Result<Bound<'py, PyArray1<f64>>, CoreError> {
        let q_mm = numbers(q_mm, "q_mm")?;
        let curve = &self.curve;
        let values = py.detach(|| q_mm.iter().map(|&q_mm| of(curve, q_mm)).collect::<Vec<f64>>());
        Ok(from_numbers(py, values))
    }
}

/// Eight-node elements on a grid.
#[pyclass(frozen, name = "Hexahedra", module = "geoerr._core")]
pub struct PyHexahedra {
    hexahedra: Hexahedra,
}

#[pymethods]
impl PyHexahedra {
    #[new]
    fn new(
        x_mm: PyReadonlyArray1<'_, f64>,
        y_mm: PyReadonlyArray1<'_, f64>,
        z_mm: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let nodes_mm = [
            numbers(&x_mm, "x_mm")?.to_vec(),
            numbers(&y_mm, "y_mm")?.to_vec(),
            numbers(&z_mm, "z_mm")?.to_vec(),
        ];
        Ok(Self { hexahedra: Hexahedra::new(nodes_mm).map_err(CoreError::from)? })
    }

    /// Number of nodes.
    fn __len__(&self) -> usize {
        self.hexahedra.n_nodes()
    }

    /// All nodes' shape functions at each point.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        q_mm: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let q_mm = rows(&q_mm, "q_mm")?;
        let hexahedra = &self.hexahedra;
        let values = py.detach(|| hexahedra.rows(q_mm));
        values.into_pyarray(py).reshape([q_mm.len(), hexahedra.n_nodes()])
    }
}

/// Adds this file's classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyBasis>()?;
    module.add_class::<PyCurve>()?;
    module.add_class::<PyHexahedra>()
}
