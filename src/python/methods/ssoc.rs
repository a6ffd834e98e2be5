//! The soft shadow occlusion camera.

use pyo3::prelude::*;

use super::{Made, made};
use crate::error::Result;
use crate::methods::ssoc::Ssoc;
use crate::methods::ssoc::lookup::Rules;
use crate::python::parse::{parse_falloff, parse_opaque, whole};

/// The parameters of the soft shadow occlusion camera as Python has them: attributes of `softshadow.Ssoc`.
#[derive(FromPyObject)]
pub(in crate::python) struct SsocParameters {
    resolution: i64,
    steps: i64,
    falloff: String,
    interpolate: bool,
    thin: bool,
    distorted: bool,
    opacity: Option<String>,
}

impl SsocParameters {
    /// Checks them.
    pub(in crate::python) fn parse(&self) -> Result<Ssoc> {
        let method = "Ssoc";
        let falloff = parse_falloff(method, &self.falloff)?;
        let opaque = parse_opaque(method, self.opacity.as_deref())?;
        let rules = Rules {
            steps: whole(self.steps) as usize,
            falloff,
            interpolate: self.interpolate,
            thin: self.thin,
        };
        Ssoc {
            resolution: whole(self.resolution),
            rules,
            distorted: self.distorted,
            opaque,
        }
        .checked()
    }
}

/// The method, from its Python object.
pub(super) fn make(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<SsocParameters>()?.parse())
}
