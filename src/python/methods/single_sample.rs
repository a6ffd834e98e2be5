//! Single sample soft shadows.

use pyo3::prelude::*;

use super::{Made, made};
use crate::error::Result;
use crate::method::Overlap;
use crate::methods::single_sample::SingleSample;
use crate::python::parse::{choice, parse_falloff, parse_opaque};

/// The parameters of single sample soft shadows as Python has them: attributes of `softshadow.SingleSample`.
#[derive(FromPyObject)]
pub(in crate::python) struct SingleSampleParameters {
    falloff: String,
    overlap: String,
    parts: String,
    opacity: Option<String>,
}

impl SingleSampleParameters {
    /// Checks them.
    pub(in crate::python) fn parse(&self) -> Result<SingleSample> {
        let method = "SingleSample";
        let overlaps = [
            ("minimum", Overlap::Minimum),
            ("multiply", Overlap::Multiply),
            ("add", Overlap::Add),
        ];
        let parts = [("objects", false), ("triangles", true)];
        Ok(SingleSample {
            falloff: parse_falloff(method, &self.falloff)?,
            overlap: choice(method, "overlap", &self.overlap, &overlaps)?,
            triangles: choice(method, "parts", &self.parts, &parts)?,
            opaque: parse_opaque(method, self.opacity.as_deref())?,
        })
    }
}

/// The method, from its Python object.
pub(super) fn make(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<SingleSampleParameters>()?.parse())
}
