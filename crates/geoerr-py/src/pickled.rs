//! The core's objects as bytes, for `pickle` and `copy`: results of a fit go to other processes and to files.
//!
//! Bytes are for the version that wrote them, as pickles are, and no less to be trusted than a pickle is.

use pyo3::PyTypeInfo;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Lets `pickle` and `copy` make an object of these fields again, all of which are the core's.
macro_rules! pickled {
    ($class:ident: $($field:ident),+) => {
        #[pymethods]
        impl $class {
            fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<$crate::pickled::Reduced<'py>> {
                $crate::pickled::reduced::<Self>(py, &($(&self.$field,)+))
            }

            #[staticmethod]
            fn _from_bytes(bytes: &[u8]) -> PyResult<Self> {
                let ($($field,)+) = $crate::pickled::parts_of(bytes)?;
                Ok(Self { $($field),+ })
            }
        }
    };
}
pub(crate) use pickled;

/// What `__reduce__` gives: the class's `_from_bytes`, and its argument.
pub type Reduced<'py> = (Bound<'py, PyAny>, (Bound<'py, PyBytes>,));

/// How an object of a class with a static method `_from_bytes` is made again.
pub fn reduced<'py, T: PyTypeInfo>(py: Python<'py>, parts: &impl Serialize) -> PyResult<Reduced<'py>> {
    let bytes = postcard::to_stdvec(parts).map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok((py.get_type::<T>().getattr("_from_bytes")?, (PyBytes::new(py, &bytes),)))
}

/// The parts that [`reduced`] was given.
pub fn parts_of<P: DeserializeOwned>(bytes: &[u8]) -> PyResult<P> {
    postcard::from_bytes(bytes).map_err(|error| {
        PyValueError::new_err(format!(
            "this is no object of this version of geoerr, or a damaged one: {error}"
        ))
    })
}
