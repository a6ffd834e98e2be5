//! Scene, camera and light objects that the Python classes hold.

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DAffine3, DMat3, DVec3};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::pool::{self, Origin};
use super::{arrays, step};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::geometry::Geometry;
use crate::light::Light;
use crate::scene::{Material, Scene};

/// A scene behind a lock, so that Python threads can share it.
#[pyclass(name = "Scene", module = "softshadow._core", frozen)]
pub(super) struct PyScene(SharedScene);

impl PyScene {
    /// A handle on the scene, for kernels that outlive the call.
    pub(super) fn shared(&self) -> SharedScene {
        self.0.clone()
    }

    /// Does something short with the scene.
    fn with<T>(&self, f: impl FnOnce(&mut Scene) -> Result<T>) -> Result<T> {
        self.0.with(f)
    }
}

/// A scene that Python and kernels share, and where it was made.
#[derive(Clone)]
pub(super) struct SharedScene(Arc<Mutex<Scene>>, Origin);

impl SharedScene {
    fn with<T>(&self, f: impl FnOnce(&mut Scene) -> Result<T>) -> Result<T> {
        // Its lock, and what is built inside, may be held by a thread that is not in this process.
        if self.1.is_torn() {
            return Err(pool::torn("scene"));
        }
        // A lock poisoned by a panic is taken over: every change to a scene is made at its end.
        f(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// The snapshot of the scene as it is now.
    pub(super) fn geometry(&self) -> Result<Arc<Geometry>> {
        self.with(Scene::geometry)
    }

    /// As [`SharedScene::geometry`], in the frame that `lights` want.
    pub(super) fn geometry_for(&self, lights: &[Light]) -> Result<Arc<Geometry>> {
        self.with(|scene| scene.geometry_for(lights))
    }
}

#[pymethods]
impl PyScene {
    #[new]
    fn new() -> Self {
        PyScene(SharedScene(Arc::default(), Origin::here()))
    }

    #[pyo3(signature = (name, vertices, faces, albedo, opacity, casts, receives))]
    #[allow(clippy::too_many_arguments, reason = "mirrors the Python signature")]
    fn add_mesh(
        &self,
        py: Python<'_>,
        name: &str,
        vertices: PyReadonlyArray2<'_, f64>,
        faces: PyReadonlyArray2<'_, i64>,
        albedo: [f32; 3],
        opacity: f32,
        casts: bool,
        receives: bool,
    ) -> PyResult<()> {
        let what = format!("mesh {name:?}");
        let vertices = arrays::points(&vertices, &what)?;
        let faces = arrays::faces(&faces, &what)?;
        let material = Material {
            albedo,
            opacity,
            casts,
            receives,
        };
        step(py, || {
            self.with(|scene| scene.add_mesh(name, vertices, &faces, material))
        })
    }

    #[pyo3(signature = (name, centers, radii, albedo, opacity, casts, receives))]
    #[allow(clippy::too_many_arguments, reason = "mirrors the Python signature")]
    fn add_spheres(
        &self,
        py: Python<'_>,
        name: &str,
        centers: PyReadonlyArray2<'_, f64>,
        radii: PyReadonlyArray1<'_, f64>,
        albedo: [f32; 3],
        opacity: f32,
        casts: bool,
        receives: bool,
    ) -> PyResult<()> {
        let centers = arrays::points(&centers, &format!("spheres {name:?}"))?;
        let material = Material {
            albedo,
            opacity,
            casts,
            receives,
        };
        let radii = arrays::values(&radii);
        step(py, || {
            self.with(|scene| scene.add_spheres(name, &centers, &radii, material))
        })
    }

    fn set_spheres(
        &self,
        py: Python<'_>,
        name: &str,
        centers: PyReadonlyArray2<'_, f64>,
        radii: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<()> {
        let centers = arrays::points(&centers, &format!("spheres {name:?}"))?;
        let radii = arrays::values(&radii);
        step(py, || {
            self.with(|scene| scene.set_spheres(name, &centers, &radii))
        })
    }

    fn set_look(
        &self,
        name: &str,
        albedo: [f32; 3],
        opacity: f32,
        casts: bool,
        receives: bool,
    ) -> Result<()> {
        let material = Material {
            albedo,
            opacity,
            casts,
            receives,
        };
        self.with(|scene| scene.set_material(name, material))
    }

    fn remove(&self, name: &str) -> Result<()> {
        self.with(|scene| scene.remove(name))
    }

    fn set_transform(&self, name: &str, matrix: PyReadonlyArray2<'_, f64>) -> Result<()> {
        let what = format!("mesh {name:?}: transform");
        let m = arrays::matrix(&matrix, &what)?;
        if m.row(3).to_array() != [0.0, 0.0, 0.0, 1.0] {
            return Err(Error::scene(
                what,
                format!("expected a last row 0 0 0 1, got {}", m.row(3)),
            ));
        }
        self.with(|scene| scene.set_transform(name, DAffine3::from_mat4(m)))
    }

    fn set_vertices(
        &self,
        py: Python<'_>,
        name: &str,
        vertices: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<()> {
        let vertices = arrays::points(&vertices, &format!("mesh {name:?}"))?;
        step(py, || self.with(|scene| scene.set_vertices(name, vertices)))
    }
}

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

/// A camera in world coordinates.
#[pyclass(name = "Camera", module = "softshadow._core", frozen)]
pub(super) struct PyCamera(pub(super) Camera);

#[pymethods]
impl PyCamera {
    #[new]
    #[pyo3(signature = (K, camera_to_world, width, height))]
    #[allow(non_snake_case, reason = "the field's name for it")]
    fn new(
        K: PyReadonlyArray2<'_, f64>,
        camera_to_world: PyReadonlyArray2<'_, f64>,
        width: i64,
        height: i64,
    ) -> Result<Self> {
        if K.shape() != [3, 3] {
            let reason = format!("K: expected shape (3, 3), got {:?}", K.shape());
            return Err(Error::parameter("Camera", reason));
        }
        let view = K.as_array();
        let flat: [f64; 9] = std::array::from_fn(|i| view[[i / 3, i % 3]]);
        let intrinsics = DMat3::from_cols_array(&flat).transpose();
        let pose = arrays::matrix(&camera_to_world, "Camera: camera_to_world")?;
        if pose.row(3).to_array() != [0.0, 0.0, 0.0, 1.0] {
            let reason = "camera_to_world must have a last row 0 0 0 1";
            return Err(Error::parameter("Camera", reason));
        }
        let eye: DVec3 = pose.w_axis.truncate();
        Camera::new(intrinsics, DMat3::from_mat4(pose), eye, width, height).map(PyCamera)
    }
}
