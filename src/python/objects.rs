//! Scene, camera, light and method objects that the Python classes hold.

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DAffine3, DMat3, DVec3};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::filtered::{DeepParameters, MvsmParameters, PcfParameters};
use super::pool::{self, Origin};
use super::{arrays, step};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::geometry::Geometry;
use crate::light::Light;
use crate::methods::Method;
use crate::methods::accumulation::atlas::Layout;
use crate::methods::accumulation::{Accumulation, Content};
use crate::methods::convolution::Convolution;
use crate::methods::hard::Hard;
use crate::methods::layered::{Kind, Layered, Settings};
use crate::methods::ray_traced::RayTraced;
use crate::methods::single_sample::{Overlap as ObjectOverlap, SingleSample};
use crate::methods::ssoc::Ssoc;
use crate::methods::ssoc::falloff::Falloff as SsocFalloff;
use crate::methods::wedges::planes::Construction;
use crate::methods::wedges::volume::Counting;
use crate::methods::wedges::{Falloff, Overlap, ShadowVolume, Wedges, interpolate};
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

/// A method with its parameters.
#[pyclass(name = "Method", module = "softshadow._core", frozen)]
pub(super) struct PyMethod(pub(super) Arc<dyn Method>);

#[pymethods]
impl PyMethod {
    #[staticmethod]
    fn accumulation(parameters: AccumulationParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse()?)))
    }

    #[staticmethod]
    fn convolution(parameters: ConvolutionParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse()?)))
    }

    #[staticmethod]
    fn hard() -> Self {
        PyMethod(Arc::new(Hard))
    }

    #[staticmethod]
    fn ray_traced(samples: i64, seed: u64, pattern: &str, cull: bool) -> Result<Self> {
        let fixed = match pattern {
            "per_receiver" => false,
            "fixed" => true,
            other => {
                let reason =
                    format!("pattern must be \"per_receiver\" or \"fixed\", got {other:?}");
                return Err(Error::parameter("RayTraced", reason));
            }
        };
        Ok(PyMethod(Arc::new(RayTraced::new(
            samples, seed, fixed, cull,
        )?)))
    }

    #[staticmethod]
    fn shadow_volume(counting: &str, opacity: Option<&str>, cull: bool) -> Result<Self> {
        let method = "ShadowVolume";
        Ok(PyMethod(Arc::new(ShadowVolume {
            counting: parse_counting(method, counting)?,
            opaque: parse_opaque(method, opacity)?,
            cull,
        })))
    }

    #[staticmethod]
    fn single_sample(parameters: SingleSampleParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse()?)))
    }

    #[staticmethod]
    fn pcf(parameters: PcfParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse()?)))
    }

    #[staticmethod]
    fn mvsm(parameters: MvsmParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse()?)))
    }

    #[staticmethod]
    fn deep(parameters: DeepParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse()?)))
    }

    #[staticmethod]
    fn ssoc(parameters: SsocParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse()?)))
    }

    #[staticmethod]
    fn slsm(parameters: LayeredParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse(Kind::Single)?)))
    }

    #[staticmethod]
    fn mlsm(parameters: LayeredParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse(Kind::Multi)?)))
    }

    #[staticmethod]
    fn mtsm(parameters: LayeredParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse(Kind::Transparent)?)))
    }

    #[staticmethod]
    fn wedges(parameters: WedgeParameters) -> Result<Self> {
        Ok(PyMethod(Arc::new(parameters.parse()?)))
    }
}

/// The parameters of averaged hard shadows as Python has them: attributes of `softshadow.Accumulation`.
#[derive(FromPyObject)]
pub(super) struct AccumulationParameters {
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
    pub(super) fn parse(&self) -> Result<Accumulation> {
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

/// The parameters of convolution as Python has them: attributes of `softshadow.Convolution`.
#[derive(FromPyObject)]
pub(super) struct ConvolutionParameters {
    error: f64,
    texel: Option<f64>,
    max_size: i64,
    interpolation: String,
    memory_limit: f64,
    opacity: Option<String>,
}

impl ConvolutionParameters {
    /// Checks them.
    fn parse(&self) -> Result<Convolution> {
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

/// The parameters of single sample soft shadows as Python has them: attributes of `softshadow.SingleSample`.
#[derive(FromPyObject)]
pub(super) struct SingleSampleParameters {
    falloff: String,
    overlap: String,
    parts: String,
    opacity: Option<String>,
}

impl SingleSampleParameters {
    /// Checks them.
    pub(super) fn parse(&self) -> Result<SingleSample> {
        let method = "SingleSample";
        let overlaps = [
            ("minimum", ObjectOverlap::Minimum),
            ("multiply", ObjectOverlap::Multiply),
            ("add", ObjectOverlap::Add),
        ];
        let parts = [("objects", false), ("triangles", true)];
        Ok(SingleSample {
            falloff: parse_falloff(method, &self.falloff)?,
            overlap: choice(method, "overlap", &self.overlap, &overlaps)?,
            triangles: choice(method, "parts", &self.parts, &parts)?,
            opaque: parse_opaque(method, self.opacity.as_deref())?,
        })
    }
}

/// The falloffs that do without planes.
pub(super) fn parse_falloff(method: &str, name: &str) -> Result<SsocFalloff> {
    let falloffs = [
        ("light", SsocFalloff::Light),
        ("linear", SsocFalloff::Linear),
        ("smooth", SsocFalloff::Smooth),
    ];
    choice(method, "falloff", name, &falloffs)
}

/// The parameters of the soft shadow occlusion camera as Python has them: attributes of `softshadow.Ssoc`.
#[derive(FromPyObject)]
pub(super) struct SsocParameters {
    resolution: i64,
    steps: i64,
    falloff: String,
    interpolate: bool,
    thin: bool,
    distorted: bool,
    opacity: Option<String>,
}

impl SsocParameters {
    /// Checks them.
    pub(super) fn parse(&self) -> Result<Ssoc> {
        let method = "Ssoc";
        let falloff = parse_falloff(method, &self.falloff)?;
        let opaque = parse_opaque(method, self.opacity.as_deref())?;
        Ssoc::new(
            self.resolution,
            self.steps,
            falloff,
            self.interpolate,
            self.thin,
            self.distorted,
            opaque,
        )
    }
}

/// The parameters of layered shadow maps as Python has them: attributes of `softshadow.Slsm`, `Mlsm` and `Mtsm`.
#[derive(FromPyObject)]
pub(super) struct LayeredParameters {
    resolution: Option<i64>,
    layers: Option<i64>,
    samples: i64,
    seed: u64,
    z_threshold: Option<f64>,
    bias: f64,
    detail: f64,
    error: f64,
    threshold: f64,
    resets: i64,
    crossing: String,
    opacity: Option<String>,
}

impl LayeredParameters {
    /// Checks them.
    pub(super) fn parse(&self, kind: Kind) -> Result<Layered> {
        let method = kind.class();
        let crossings = [("multiply", false), ("subtract", true)];
        let settings = Settings {
            resolution: self.resolution,
            layers: self.layers,
            samples: self.samples,
            seed: self.seed,
            z_threshold: self.z_threshold,
            bias: self.bias,
            detail: self.detail,
            error: self.error,
            threshold: self.threshold,
            resets: self.resets,
            subtract: choice(method, "crossing", &self.crossing, &crossings)?,
            opaque: parse_opaque(method, self.opacity.as_deref())?,
        };
        Layered::new(kind, settings)
    }
}

/// The parameters of penumbra wedges as Python has them: attributes of `softshadow.Wedges`.
#[derive(FromPyObject)]
pub(super) struct WedgeParameters {
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
    pub(super) fn parse(&self) -> Result<Wedges> {
        let method = "Wedges";
        let falloffs = [
            ("light", Falloff::Light),
            ("line", Falloff::Planes(interpolate::Falloff::Line)),
            ("linear", Falloff::Planes(interpolate::Falloff::Linear)),
            ("smooth", Falloff::Planes(interpolate::Falloff::Smooth)),
        ];
        let falloff = choice(method, "falloff", &self.falloff, &falloffs)?;
        let falloff = match self.quads {
            None => falloff,
            Some(n @ 1..=256) => Falloff::Fan(n as usize),
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

/// How wedges are built.
pub(super) fn parse_construction(vertex_angle: f64, planes: &str) -> Result<Construction> {
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

/// The value that a name stands for.
pub(super) fn choice<T: Copy>(
    method: &str,
    parameter: &str,
    name: &str,
    values: &[(&str, T)],
) -> Result<T> {
    let found = values.iter().find(|v| v.0 == name);
    found.map(|v| v.1).ok_or_else(|| {
        let names: Vec<String> = values.iter().map(|v| format!("{:?}", v.0)).collect();
        let reason = format!(
            "{parameter} must be one of {}, got {name:?}",
            names.join(", ")
        );
        Error::parameter(method, reason)
    })
}

/// How pictures read textures.
const INTERPOLATIONS: [(&str, bool); 2] = [("linear", true), ("nearest", false)];

fn parse_memory(method: &str, bytes: f64) -> Result<usize> {
    if bytes.is_nan() || bytes <= 0.0 {
        let reason = format!("memory_limit must be positive, got {bytes}");
        return Err(Error::parameter(method, reason));
    }
    Ok(bytes as usize)
}

fn parse_counting(method: &str, name: &str) -> Result<Counting> {
    let values = [("zpass", Counting::ZPass), ("zfail", Counting::ZFail)];
    choice(method, "counting", name, &values)
}

pub(super) fn parse_opaque(method: &str, name: Option<&str>) -> Result<bool> {
    name.map_or(Ok(false), |name| {
        choice(method, "opacity", name, &[("opaque", true)])
    })
}
