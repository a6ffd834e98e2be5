//! Averaged hard-shadow textures.

use pyo3::prelude::*;

use super::{Made, made};
use crate::error::Result;
use crate::methods::accumulation::{Accumulation, Content};
use crate::python::parse::{INTERPOLATIONS, choice, parse_memory, parse_opaque};
use crate::textures::atlas::Layout;

/// The parameters of averaged hard shadows as Python has them: attributes of `softshadow.Accumulation`.
#[derive(FromPyObject)]
pub(in crate::python) struct AccumulationParameters {
    samples: i64,
    seed: u64,
    texture: String,
    ambient: f64,
    texel: Option<f64>,
    max_size: i64,
    interpolation: String,
    memory_limit: f64,
    opacity: Option<String>,
}

impl AccumulationParameters {
    /// Checks them.
    pub(in crate::python) fn parse(&self) -> Result<Accumulation> {
        let method = "Accumulation";
        let contents = [
            ("radiance", Content::Radiance),
            ("modulation", Content::Modulation),
            ("eight_bit", Content::EightBit),
        ];
        let layout = Layout {
            names: ["accumulation", method],
            texel: self.texel,
            most_texels: u32::try_from(self.max_size).unwrap_or(0),
            interpolate: choice(
                method,
                "interpolation",
                &self.interpolation,
                &INTERPOLATIONS,
            )?,
            memory: parse_memory(method, self.memory_limit)?,
            radiance: self.texture == "radiance",
            opaque: parse_opaque(method, self.opacity.as_deref())?,
        };
        Accumulation {
            // What is out of range stays so.
            samples: usize::try_from(self.samples).unwrap_or(0),
            seed: self.seed,
            content: choice(method, "texture", &self.texture, &contents)?,
            ambient: self.ambient,
            layout,
        }
        .checked()
    }
}

/// The method, from its Python object.
pub(super) fn make(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<AccumulationParameters>()?.parse())
}
