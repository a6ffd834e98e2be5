//! Penumbra wedges, and shadow volumes.

use pyo3::prelude::*;

use super::{Made, made};
use crate::error::{Error, Result};
use crate::method::Overlap;
use crate::methods::wedges::planes::Construction;
use crate::methods::wedges::volume::Counting;
use crate::methods::wedges::{ShadowVolume, WedgeFalloff, Wedges, interpolate};
use crate::python::parse::{choice, parse_opaque};

/// The parameters of penumbra wedges as Python has them: attributes of `softshadow.Wedges`.
#[derive(FromPyObject)]
pub(in crate::python) struct WedgeParameters {
    falloff: String,
    quads: Option<i64>,
    overlap: String,
    buffer: String,
    counting: String,
    vertex_angle: f64,
    planes: String,
    opacity: Option<String>,
    cull: bool,
}

impl WedgeParameters {
    /// Checks them.
    pub(in crate::python) fn parse(&self) -> Result<Wedges> {
        let method = "Wedges";
        let falloffs = [
            ("light", WedgeFalloff::Light),
            (
                "line",
                WedgeFalloff::Planes(interpolate::PlaneFalloff::Line),
            ),
            (
                "linear",
                WedgeFalloff::Planes(interpolate::PlaneFalloff::Linear),
            ),
            (
                "smooth",
                WedgeFalloff::Planes(interpolate::PlaneFalloff::Smooth),
            ),
        ];
        let falloff = choice(method, "falloff", &self.falloff, &falloffs)?;
        let falloff = match self.quads {
            None => falloff,
            Some(n @ 1..=256) => WedgeFalloff::Fan(n as usize),
            Some(n) => {
                let reason = format!("quads must be 1 to 256 or None, got {n}");
                return Err(Error::parameter(method, reason));
            }
        };
        let overlaps = [
            ("add", Overlap::Add),
            ("multiply", Overlap::Multiply),
            ("minimum", Overlap::Minimum),
        ];
        let buffers = [("float", false), ("integer", true)];
        Ok(Wedges {
            falloff,
            overlap: choice(method, "overlap", &self.overlap, &overlaps)?,
            integer: choice(method, "buffer", &self.buffer, &buffers)?,
            counting: parse_counting(method, &self.counting)?,
            construction: parse_construction(self.vertex_angle, &self.planes)?,
            opaque: parse_opaque(method, self.opacity.as_deref())?,
            cull: self.cull,
        })
    }
}

/// The parameters of shadow volumes as Python has them: attributes of `softshadow.ShadowVolume`.
#[derive(FromPyObject)]
pub(super) struct VolumeParameters {
    counting: String,
    opacity: Option<String>,
    cull: bool,
}

impl VolumeParameters {
    /// Checks them.
    pub(super) fn parse(&self) -> Result<ShadowVolume> {
        let method = "ShadowVolume";
        Ok(ShadowVolume {
            counting: parse_counting(method, &self.counting)?,
            opaque: parse_opaque(method, self.opacity.as_deref())?,
            cull: self.cull,
        })
    }
}

/// How wedges are built.
pub(in crate::python) fn parse_construction(
    vertex_angle: f64,
    planes: &str,
) -> Result<Construction> {
    let method = "Wedges";
    if !(1.0..=180.0).contains(&vertex_angle) {
        let reason = format!("vertex_angle must be 1 to 180 degrees, got {vertex_angle}");
        return Err(Error::parameter(method, reason));
    }
    let kinds = [("tangent", false), ("paper", true)];
    Ok(Construction {
        vertex_angle: vertex_angle.to_radians(),
        paper_planes: choice(method, "planes", planes, &kinds)?,
    })
}

fn parse_counting(method: &str, name: &str) -> Result<Counting> {
    let values = [("zpass", Counting::ZPass), ("zfail", Counting::ZFail)];
    choice(method, "counting", name, &values)
}

/// The method, from its Python object.
pub(super) fn wedges(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<WedgeParameters>()?.parse())
}

/// The method, from its Python object.
pub(super) fn shadow_volume(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<VolumeParameters>()?.parse())
}
