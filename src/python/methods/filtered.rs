//! The rivals of ray-traced layered maps.

use pyo3::prelude::*;

use super::{Made, made};
use crate::error::Result;
use crate::methods::filtered::deep::DeepShadow;
use crate::methods::filtered::pcf::Pcf;
use crate::methods::filtered::{Estimate, FilterSettings};
use crate::python::parse::{choice, parse_opaque, whole};

/// Attributes of `softshadow.Pcf`.
#[derive(FromPyObject)]
pub(super) struct PcfParameters {
    resolution: i64,
    layers: i64,
    samples: i64,
    seed: u64,
    estimate: String,
    bias: Option<f64>,
    opacity: Option<String>,
}

impl PcfParameters {
    /// Checks them.
    pub(super) fn parse(&self) -> Result<Pcf> {
        let method = "Pcf";
        Pcf {
            settings: FilterSettings {
                resolution: whole(self.resolution),
                layers: whole(self.layers),
                samples: whole(self.samples),
                seed: self.seed,
                estimate: parse_estimate(method, &self.estimate)?,
                bias: self.bias,
            },
            opaque: parse_opaque(method, self.opacity.as_deref())?,
        }
        .checked()
    }
}

/// Attributes of `softshadow.DeepShadow`.
#[derive(FromPyObject)]
pub(super) struct DeepParameters {
    resolution: i64,
    layers: i64,
    samples: i64,
    seed: u64,
    error: f64,
    estimate: String,
    bias: Option<f64>,
}

impl DeepParameters {
    /// Checks them.
    pub(super) fn parse(&self) -> Result<DeepShadow> {
        DeepShadow {
            settings: FilterSettings {
                resolution: whole(self.resolution),
                layers: whole(self.layers),
                samples: whole(self.samples),
                seed: self.seed,
                estimate: parse_estimate("DeepShadow", &self.estimate)?,
                bias: self.bias,
            },
            error: self.error,
        }
        .checked()
    }
}

fn parse_estimate(method: &str, name: &str) -> Result<Estimate> {
    let values = [("nearest", Estimate::Nearest), ("mean", Estimate::Mean)];
    choice(method, "estimate", name, &values)
}

/// The method, from its Python object.
pub(super) fn pcf(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<PcfParameters>()?.parse())
}

/// The method, from its Python object.
pub(super) fn deep(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<DeepParameters>()?.parse())
}
