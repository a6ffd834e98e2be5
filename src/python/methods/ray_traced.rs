//! Light samples against the hierarchy, the reference.

use pyo3::prelude::*;

use super::{Made, made};
use crate::error::Result;
use crate::methods::ray_traced::RayTraced;
use crate::python::parse::{choice, whole};

/// The parameters of the reference as Python has them: attributes of `softshadow.RayTraced`.
#[derive(FromPyObject)]
pub(super) struct RayTracedParameters {
    samples: i64,
    seed: u64,
    pattern: String,
    cull: bool,
    error: Option<f64>,
}

impl RayTracedParameters {
    /// Checks them.
    pub(super) fn parse(&self) -> Result<RayTraced> {
        let patterns = [("per_receiver", false), ("fixed", true)];
        let fixed = choice("RayTraced", "pattern", &self.pattern, &patterns)?;
        RayTraced {
            samples: whole(self.samples),
            seed: self.seed,
            fixed,
            cull: self.cull,
            error: self.error,
        }
        .checked()
    }
}

/// The method, from its Python object.
pub(super) fn make(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<RayTracedParameters>()?.parse())
}
