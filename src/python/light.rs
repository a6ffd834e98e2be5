//! The light objects.

use pyo3::prelude::*;

use crate::error::Result;
use crate::light::Light;

/// A light in world coordinates.
#[pyclass(name = "Light", module = "softshadow._core", frozen)]
pub(super) struct PyLight(pub(super) Light);

#[pymethods]
impl PyLight {
    #[staticmethod]
    fn rect(
        center: [f64; 3],
        edge_u: [f64; 3],
        edge_v: [f64; 3],
        radiance: [f32; 3],
    ) -> Result<Self> {
        Light::rect(center.into(), edge_u.into(), edge_v.into(), radiance).map(PyLight)
    }

    #[staticmethod]
    fn disk(center: [f64; 3], normal: [f64; 3], radius: f64, radiance: [f32; 3]) -> Result<Self> {
        Light::disk(center.into(), normal.into(), radius, radiance).map(PyLight)
    }

    #[staticmethod]
    fn sphere(center: [f64; 3], radius: f64, radiance: [f32; 3]) -> Result<Self> {
        Light::sphere(center.into(), radius, radiance).map(PyLight)
    }
}
