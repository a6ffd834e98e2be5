//! Ray-traced multi-view shadow maps.

use pyo3::prelude::*;

use super::{Made, made};
use crate::error::Result;
use crate::methods::mvsm::Mvsm;
use crate::python::parse::{parse_opaque, whole};

/// Attributes of `softshadow.Mvsm`.
#[derive(FromPyObject)]
pub(super) struct MvsmParameters {
    resolution: i64,
    views: i64,
    samples: i64,
    seed: u64,
    gap: Option<f64>,
    bias: Option<f64>,
    opacity: Option<String>,
}

impl MvsmParameters {
    /// Checks them.
    pub(super) fn parse(&self) -> Result<Mvsm> {
        Mvsm {
            resolution: whole(self.resolution),
            views: whole(self.views),
            samples: whole(self.samples),
            seed: self.seed,
            gap: self.gap,
            bias: self.bias,
            opaque: parse_opaque("Mvsm", self.opacity.as_deref())?,
        }
        .checked()
    }
}

/// The method, from its Python object.
pub(super) fn make(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<MvsmParameters>()?.parse())
}
