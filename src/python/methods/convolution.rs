//! Hard-shadow textures convolved with the light's image.

use pyo3::prelude::*;

use super::{Made, made};
use crate::error::Result;
use crate::methods::convolution::Convolution;
use crate::python::parse::{INTERPOLATIONS, choice, parse_memory, parse_opaque};
use crate::textures::atlas::Layout;

/// The parameters of convolution as Python has them: attributes of `softshadow.Convolution`.
#[derive(FromPyObject)]
pub(in crate::python) struct ConvolutionParameters {
    error: f64,
    texel: Option<f64>,
    max_size: i64,
    interpolation: String,
    memory_limit: f64,
    opacity: Option<String>,
}

impl ConvolutionParameters {
    /// Checks them.
    pub(in crate::python) fn parse(&self) -> Result<Convolution> {
        let method = "Convolution";
        let layout = Layout {
            names: ["convolution", method],
            texel: self.texel,
            most_texels: u32::try_from(self.max_size).unwrap_or(0),
            interpolate: choice(
                method,
                "interpolation",
                &self.interpolation,
                &INTERPOLATIONS,
            )?,
            memory: parse_memory(method, self.memory_limit)?,
            radiance: false,
            opaque: parse_opaque(method, self.opacity.as_deref())?,
        };
        Convolution {
            error: self.error,
            layout,
        }
        .checked()
    }
}

/// The method, from its Python object.
pub(super) fn make(fields: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(fields.extract::<ConvolutionParameters>()?.parse())
}
