//! The scene object.

use std::sync::{Arc, Mutex, PoisonError};

use glam::DAffine3;
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arrays;
use super::pool::{self, Origin};
use super::run::step;
use crate::error::{Error, Result};
use crate::geometry::entry::Material;
use crate::light::Light;
use crate::scene::snapshot::Snapshot;
use crate::scene::{Instances, Scene};

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

    /// The snapshot in the frame that `lights` want, for a method that takes instances or does not.
    pub(super) fn snapshot_for_method(
        &self,
        lights: &[Light],
        method: &'static str,
        takes_instances: bool,
    ) -> Result<Arc<Snapshot>> {
        self.with(|scene| scene.snapshot_for_method(lights, method, takes_instances))
    }

    /// The snapshot of the entries ([`SharedScene::snapshot`]) in the frame that `lights` want.
    pub(super) fn snapshot_for(&self, lights: &[Light]) -> Result<Arc<Snapshot>> {
        self.with(|scene| scene.snapshot_for(lights))
    }
}

#[pymethods]
impl PyScene {
    #[new]
    #[pyo3(signature = (instances="auto"))]
    fn new(instances: &str) -> Result<Self> {
        let instances = match instances {
            "auto" => Instances::Auto,
            "always" => Instances::Always,
            "never" => Instances::Never,
            other => {
                let reason = format!("expected \"auto\", \"always\" or \"never\", got {other:?}");
                return Err(Error::parameter("instances", reason));
            }
        };
        let scene = Arc::new(Mutex::new(Scene::new(instances)));
        Ok(PyScene(SharedScene(scene, Origin::here())))
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

    #[pyo3(signature = (name, shared, albedo, opacity, casts, receives))]
    fn add_instance(
        &self,
        name: &str,
        shared: &str,
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
        self.with(|scene| scene.add_instance(name, shared, material))
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
