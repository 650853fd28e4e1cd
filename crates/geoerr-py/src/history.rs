//! Binds `geoerr_core::history`: what follows from the order of rows, as named columns.

use geoerr_core::history::{HistoryRows, Past, history};
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{from_numbers, numbers, rows};
use crate::core_door::enter_core;
use crate::expression::places;

/// One kind of column: what it is of one moment, by axis.
type Column = fn(&Past) -> &[f64; 3];

/// The columns by name.
const COLUMNS: [(&str, Column); 6] = [
    ("d", |past| &past.d),
    ("s", |past| &past.s_mm),
    ("t_rev", |past| &past.t_rev_s),
    ("v", |past| &past.v_mm_s),
    ("a", |past| &past.a_mm_s2),
    ("mean_v", |past| &past.mean_v_mm_s),
];

/// `d_x d_y d_z s_x ... mean_v_z`, each (n,).
#[pyfunction]
#[pyo3(name = "history", signature = (q_mm, t_s, moving, feed_mm_min, direction, starts, curve = None))]
#[expect(clippy::too_many_arguments, reason = "one argument for each column")]
fn py_history<'py>(
    py: Python<'py>,
    q_mm: PyReadonlyArray2<'py, f64>,
    t_s: Option<PyReadonlyArray1<'py, f64>>,
    moving: Option<PyReadonlyArray1<'py, f64>>,
    feed_mm_min: Option<PyReadonlyArray1<'py, f64>>,
    direction: Option<PyReadonlyArray2<'py, f64>>,
    starts: PyReadonlyArray1<'py, i64>,
    curve: Option<PyReadonlyArray1<'py, f64>>,
) -> PyResult<Bound<'py, PyDict>> {
    let starts = places(&starts)?;
    let given = HistoryRows {
        q_mm: rows(&q_mm, "q_mm")?,
        t_s: t_s.as_ref().map(|t_s| numbers(t_s, "t")).transpose()?,
        moving: moving.as_ref().map(|moving| numbers(moving, "moving")).transpose()?,
        feed_mm_min: feed_mm_min.as_ref().map(|feed| numbers(feed, "feed")).transpose()?,
        direction: direction.as_ref().map(|direction| rows(direction, "direction")).transpose()?,
        curve: curve.as_ref().map(|curve| numbers(curve, "curve")).transpose()?,
        starts: &starts,
    };
    let all = enter_core(py, 0, || history(&given))?;
    let columns = PyDict::new(py);
    for (name, column) in COLUMNS {
        for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
            let values: Vec<f64> = all.iter().map(|past| column(past)[axis]).collect();
            columns.set_item(format!("{name}_{letter}"), from_numbers(py, values))?;
        }
    }
    Ok(columns)
}

/// Adds this file's functions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(py_history, module)?)
}
