//! The rivals of ray-traced layered maps.

use pyo3::prelude::*;

use crate::error::Result;
use crate::methods::filtered::deep::DeepShadow;
use crate::methods::filtered::pcf::Pcf;
use crate::methods::filtered::{Estimate, Settings};
use crate::methods::mvsm::Mvsm;
use crate::python::parse::{choice, parse_opaque};

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
        let sizes = [self.resolution, self.layers, self.samples];
        let estimate = parse_estimate(method, &self.estimate)?;
        Ok(Pcf {
            settings: Settings::new(method, sizes, self.seed, estimate, self.bias)?,
            opaque: parse_opaque(method, self.opacity.as_deref())?,
        })
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
        let method = "DeepShadow";
        let sizes = [self.resolution, self.layers, self.samples];
        let estimate = parse_estimate(method, &self.estimate)?;
        let settings = Settings::new(method, sizes, self.seed, estimate, self.bias)?;
        DeepShadow::new(settings, self.error)
    }
}

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
        let sizes = [self.resolution, self.views, self.samples];
        let opaque = parse_opaque("Mvsm", self.opacity.as_deref())?;
        Mvsm::new(sizes, self.seed, self.gap, self.bias, opaque)
    }
}

fn parse_estimate(method: &str, name: &str) -> Result<Estimate> {
    let values = [("nearest", Estimate::Nearest), ("mean", Estimate::Mean)];
    choice(method, "estimate", name, &values)
}
