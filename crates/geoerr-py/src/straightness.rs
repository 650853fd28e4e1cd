//! Binds `geoerr_core::straightness`.

use geoerr_core::straightness::{Rule, integrate_straightness_into, remove_line_into};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{numbers, unfilled};
use crate::core_door::enter_core;

fn rule_of(name: &str) -> PyResult<Rule> {
    match name {
        "trapezoid" => Ok(Rule::Trapezoid),
        "simpson" => Ok(Rule::Simpson),
        _ => Err(PyValueError::new_err(format!("unknown rule {name:?}: trapezoid or simpson"))),
    }
}

/// Integrals of functions laid one after another in `values`, their lines removed.
#[pyfunction]
#[pyo3(name = "integrate_straightness")]
fn py_integrate_straightness<'py>(
    py: Python<'py>,
    position_mm: PyReadonlyArray1<'py, f64>,
    values: PyReadonlyArray1<'py, f64>,
    rule: &str,
    threads: usize,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (position_mm, values) = (numbers(&position_mm, "position_mm")?, numbers(&values, "values")?);
    let rule = rule_of(rule)?;
    let results: Bound<'py, PyArray1<f64>> = unfilled(py, (values.len(),))?;
    {
        let mut own = results.readwrite();
        let own = own.as_slice_mut()?;
        enter_core(py, threads, || integrate_straightness_into(position_mm, values, rule, own))?;
    }
    Ok(results)
}

/// Functions laid one after another in `values`, their lines removed.
#[pyfunction]
#[pyo3(name = "remove_line")]
fn py_remove_line<'py>(
    py: Python<'py>,
    position_mm: PyReadonlyArray1<'py, f64>,
    values: PyReadonlyArray1<'py, f64>,
    threads: usize,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (position_mm, values) = (numbers(&position_mm, "position_mm")?, numbers(&values, "values")?);
    let results: Bound<'py, PyArray1<f64>> = unfilled(py, (values.len(),))?;
    {
        let mut own = results.readwrite();
        let own = own.as_slice_mut()?;
        enter_core(py, threads, || remove_line_into(position_mm, values, own))?;
    }
    Ok(results)
}

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(py_integrate_straightness, module)?)?;
    module.add_function(wrap_pyfunction!(py_remove_line, module)?)
}
