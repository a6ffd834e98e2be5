//! Depth complexity over the light, counted from silhouettes.

use pyo3::prelude::*;

use super::{Made, made};
use crate::error::Result;
use crate::methods::counted::Counted;
use crate::python::parse::whole;

/// The parameters of counting as Python has them: attributes of `softshadow.Counted`.
#[derive(FromPyObject)]
pub(super) struct CountedParameters {
    samples: i64,
    rays: i64,
    seed: u64,
    error: Option<f64>,
}

impl CountedParameters {
    /// Checks them.
    pub(super) fn parse(&self) -> Result<Counted> {
        Counted {
            samples: whole(self.samples),
            rays: whole(self.rays),
            seed: self.seed,
            error: self.error,
        }
        .checked()
    }
}

/// The method, from its Python object.
pub(super) fn make(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<CountedParameters>()?.parse())
}
