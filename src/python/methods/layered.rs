//! Ray-traced multilayer shadow maps: three methods of one kind.

use pyo3::prelude::*;

use super::{Made, made};
use crate::error::Result;
use crate::methods::layered::{LayerKind, Layered, LayeredSettings};
use crate::python::parse::{choice, parse_opaque, whole};

/// The parameters of layered shadow maps as Python has them: attributes of `softshadow.Slsm`, `Mlsm` and `Mtsm`.
#[derive(FromPyObject)]
pub(in crate::python) struct LayeredParameters {
    resolution: Option<i64>,
    layers: Option<i64>,
    samples: i64,
    seed: u64,
    z_threshold: Option<f64>,
    bias: f64,
    detail: f64,
    near: f64,
    error: f64,
    threshold: f64,
    resets: i64,
    crossing: String,
    opacity: Option<String>,
}

impl LayeredParameters {
    /// Checks them.
    pub(in crate::python) fn parse(&self, kind: LayerKind) -> Result<Layered> {
        let method = kind.class();
        let crossings = [("multiply", false), ("subtract", true)];
        let settings = LayeredSettings {
            resolution: self.resolution.map(whole),
            layers: self.layers.map(whole),
            samples: whole(self.samples),
            seed: self.seed,
            z_threshold: self.z_threshold,
            bias: self.bias,
            detail: self.detail,
            near: self.near,
            error: self.error,
            threshold: self.threshold,
            resets: whole(self.resets),
            subtract: choice(method, "crossing", &self.crossing, &crossings)?,
            opaque: parse_opaque(method, self.opacity.as_deref())?,
        };
        Layered::new(kind, settings)
    }
}

/// The method, from its Python object.
pub(super) fn slsm(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(
        fields
            .extract::<LayeredParameters>()?
            .parse(LayerKind::Single),
    )
}

/// The method, from its Python object.
pub(super) fn mlsm(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(
        fields
            .extract::<LayeredParameters>()?
            .parse(LayerKind::Multi),
    )
}

/// The method, from its Python object.
pub(super) fn mtsm(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(
        fields
            .extract::<LayeredParameters>()?
            .parse(LayerKind::Transparent),
    )
}
