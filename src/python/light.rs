//! The light objects.

use glam::DVec3;
use pyo3::prelude::*;

use crate::error::{Error, Result};
use crate::light::{Light, Shape};

/// A light in world coordinates.
#[pyclass(name = "Light", module = "softshadow._core", frozen)]
pub(super) struct PyLight(pub(super) Light);

impl PyLight {
    /// The light, for a kernel that needs its place.
    ///
    /// # Errors
    /// A light at infinity.
    pub(super) fn placed(&self, kernel: &str) -> Result<Light> {
        if self.0.as_distant().is_none() {
            return Ok(self.0.clone());
        }
        let reason = "needs a light with a place, got a DistantLight; methods take it, and a SphereLight \
                      far away looks like it";
        Err(Error::parameter(kernel, reason))
    }
}

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
    fn distant(direction: [f64; 3], angle: f64, irradiance: [f32; 3]) -> Result<Self> {
        Light::distant(direction.into(), angle, irradiance).map(PyLight)
    }

    #[staticmethod]
    fn sphere(center: [f64; 3], radius: f64, radiance: [f32; 3]) -> Result<Self> {
        Light::sphere(center.into(), radius, radiance).map(PyLight)
    }

    #[staticmethod]
    fn polygon(vertices: Vec<[f64; 3]>, radiance: [f32; 3]) -> Result<Self> {
        let corners: Vec<DVec3> = vertices.into_iter().map(DVec3::from).collect();
        Light::polygon(&corners, radiance).map(PyLight)
    }

    /// The light's middle; a polygon's centroid.
    #[getter]
    fn center(&self) -> [f64; 3] {
        self.0.center().into()
    }

    /// Corners of triangles that make up a polygon; none of another shape.
    fn triangles(&self) -> Vec<[u32; 3]> {
        match &self.0.shape {
            Shape::Polygon(polygon) => polygon.triangles(),
            Shape::Rect(_) | Shape::Disk(_) | Shape::Sphere(_) | Shape::Distant(_) => Vec::new(),
        }
    }
}
