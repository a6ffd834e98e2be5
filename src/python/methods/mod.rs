//! The methods' parameters as Python has them: a file a method, and the table of their names.

pub(super) mod accumulation;
mod convolution;
mod counted;
mod filtered;
mod hard;
pub(super) mod layered;
mod mvsm;
mod ray_traced;
pub(super) mod single_sample;
pub(super) mod ssoc;
pub(super) mod wedges;

use std::sync::Arc;

use pyo3::prelude::*;

use crate::error::{Error, Result};
use crate::method::Method;

/// A method whose parameters are right.
type Made = Arc<dyn Method>;

/// Makes a method from its Python object, whose attributes are the parameters.
type Make = fn(&Bound<'_, PyAny>) -> PyResult<Made>;

/// Every method by its name.
const METHODS: &[(&str, Make)] = &[
    ("accumulation", accumulation::make),
    ("convolution", convolution::make),
    ("counted", counted::make),
    ("deep", filtered::deep),
    ("hard", hard::make),
    ("mlsm", layered::mlsm),
    ("mtsm", layered::mtsm),
    ("mvsm", mvsm::make),
    ("pcf", filtered::pcf),
    ("ray_traced", ray_traced::make),
    ("shadow_volume", wedges::shadow_volume),
    ("single_sample", single_sample::make),
    ("slsm", layered::slsm),
    ("ssoc", ssoc::make),
    ("wedges", wedges::wedges),
];

fn made(method: Result<impl Method + 'static>) -> PyResult<Made> {
    Ok(Arc::new(method?))
}

/// A method with its parameters.
#[pyclass(name = "Method", module = "softshadow._core", frozen)]
pub(super) struct PyMethod(pub(super) Arc<dyn Method>);

#[pymethods]
impl PyMethod {
    #[new]
    fn new(name: &str, parameters: &Bound<'_, PyAny>) -> PyResult<Self> {
        let Some((_, make)) = METHODS.iter().find(|m| m.0 == name) else {
            let names: Vec<_> = METHODS.iter().map(|m| m.0).collect();
            let reason = format!("unknown name {name:?}, known are {}", names.join(", "));
            return Err(Error::parameter("method", reason).into());
        };
        make(parameters).map(PyMethod)
    }
}
