//! Preparing a method for a scene, rendering images and answering at points.

use crate::scene::snapshot::Snapshot;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use super::arrays;
use super::camera::PyCamera;
use super::light::PyLight;
use super::methods::PyMethod;
use super::pool;
use super::pool::Origin;
use super::run::run;
use super::scene::PyScene;
use crate::camera::Camera;
use crate::control::Control;
use crate::error::{Error, Result};
use crate::far;
use crate::light::Light;
use crate::memory;
use crate::memory::{fill, unwritten, written};
use crate::method::{Prepared, Shading};
use crate::raster::tile_count;
use crate::receivers::visible::{Surface, from_camera, most_groups};
use crate::receivers::{BLOCK, Receivers};
use crate::render::{irradiance, unshadow};

/// A method, prepared for a scene and its lights.
#[pyclass(name = "Prepared", module = "softshadow._core", frozen)]
pub(super) struct PyPrepared(Arc<Ready>);

/// What kernels share with the Python object.
struct Ready {
    geometry: Arc<Snapshot>,
    lights: Vec<Light>,
    method: Box<dyn Prepared>,
    seconds: Vec<(&'static str, f64)>,
    origin: Origin,
}

impl Ready {
    /// Nothing of it may be half built by a thread that is not in this process.
    fn check_origin(&self) -> Result<()> {
        if self.origin.is_torn() {
            return Err(pool::torn("Prepared"));
        }
        Ok(())
    }
}

/// Prepares a method for a scene and its lights.
#[pyfunction]
#[pyo3(signature = (scene, lights, method, progress))]
pub(super) fn prepare(
    py: Python<'_>,
    scene: &PyScene,
    lights: Vec<PyRef<'_, PyLight>>,
    method: &PyMethod,
    progress: Option<Py<PyAny>>,
) -> PyResult<PyPrepared> {
    let lights: Vec<Light> = lights.iter().map(|l| l.0.clone()).collect();
    let method = method.0.clone();
    let scene = scene.shared();
    run(py, progress.as_ref(), move |control| {
        let start = Instant::now();
        let geometry =
            scene.snapshot_for_method(&lights, method.name(), method.takes_instances())?;
        let geometry_seconds = start.elapsed().as_secs_f64();
        let local = |light: &Light| light.to_local(&geometry.frame);
        let lights: Vec<Light> = lights.iter().map(local).collect();
        let prepared = far::prepare(&*method, geometry.clone(), &lights, control)?;
        let total = start.elapsed().as_secs_f64();
        let mut seconds = vec![
            ("prepare", total),
            ("geometry", geometry_seconds),
            ("structures", total - geometry_seconds),
        ];
        seconds.extend(prepared.seconds());
        Ok(PyPrepared(Arc::new(Ready {
            geometry,
            lights,
            method: prepared,
            seconds,
            origin: Origin::here(),
        })))
    })
}

/// One frame, pixel by pixel.
struct FrameArrays {
    visibility: Vec<f32>,
    radiance: Vec<f32>,
    mask: Vec<bool>,
    position: Vec<f64>,
    normal: Vec<f32>,
    depth: Vec<f32>,
    mesh_id: Vec<i32>,
    triangle_id: Vec<i32>,
    seconds: Vec<(&'static str, f64)>,
    by_rays: f64,
}

/// Values that one task looks at.
const CHECKED: usize = 1 << 14;

/// Why a visibility may not be a number.
const TOO_FAR: &str = "it is too far away or too large for single precision";

impl FrameArrays {
    /// Nothing that is not a number leaves: sums and products of what users give may overflow.
    fn check_finite(&self, width: usize) -> Result<()> {
        // In parts, of which the loop is one over registers.
        let wrong = |values: &[f32]| {
            let part = values
                .par_chunks(CHECKED)
                .position_first(|part| !part.iter().fold(true, |good, v| good & v.is_finite()))?;
            let start = part * CHECKED;
            let inside = values[start..].iter().position(|v| !v.is_finite())?;
            Some(start + inside)
        };
        if let Some(i) = wrong(&self.visibility) {
            let pixels = self.mask.len();
            let (light, pixel) = (i / pixels, i % pixels);
            let at = (pixel % width, pixel / width);
            let reason = format!("at pixel {at:?} light {light} has none; {TOO_FAR}");
            return Err(Error::parameter("visibility", reason));
        }
        if let Some(i) = wrong(&self.radiance) {
            let at = (i / 3 % width, i / 3 / width);
            let reason = format!(
                "at pixel {at:?} albedo times light overflows single precision, {:.3e}; lower the \
                 lights' radiance or the albedo",
                f32::MAX
            );
            return Err(Error::parameter("radiance", reason));
        }
        Ok(())
    }
}

#[pymethods]
impl PyPrepared {
    #[getter]
    fn seconds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        dictionary(py, &self.0.seconds)
    }

    #[pyo3(signature = (camera, progress))]
    fn render<'py>(
        &self,
        py: Python<'py>,
        camera: &PyCamera,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let world = camera.0;
        let ready = self.0.clone();
        ready.check_origin()?;
        let frame = run(py, progress.as_ref(), move |control| {
            ready.frame(&world, control)
        })?;
        let (h, w) = (world.height as usize, world.width as usize);
        let out = PyDict::new(py);
        let lights = self.0.lights.len();
        out.set_item(
            "visibility",
            PyArray1::from_vec(py, frame.visibility).reshape([lights, h, w])?,
        )?;
        out.set_item(
            "radiance",
            PyArray1::from_vec(py, frame.radiance).reshape([h, w, 3])?,
        )?;
        out.set_item("mask", PyArray1::from_vec(py, frame.mask).reshape([h, w])?)?;
        out.set_item(
            "position",
            PyArray1::from_vec(py, frame.position).reshape([h, w, 3])?,
        )?;
        out.set_item(
            "normal",
            PyArray1::from_vec(py, frame.normal).reshape([h, w, 3])?,
        )?;
        out.set_item(
            "depth",
            PyArray1::from_vec(py, frame.depth).reshape([h, w])?,
        )?;
        out.set_item(
            "mesh_id",
            PyArray1::from_vec(py, frame.mesh_id).reshape([h, w])?,
        )?;
        out.set_item(
            "triangle_id",
            PyArray1::from_vec(py, frame.triangle_id).reshape([h, w])?,
        )?;
        let all: Vec<_> = self
            .0
            .seconds
            .iter()
            .chain(&frame.seconds)
            .copied()
            .collect();
        out.set_item("seconds", dictionary(py, &all)?)?;
        out.set_item("bytes", self.0.method.bytes())?;
        out.set_item("by_rays", frame.by_rays)?;
        Ok(out)
    }

    #[pyo3(signature = (points, normals, progress))]
    fn visibility<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        normals: Option<PyReadonlyArray2<'py, f64>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let points = arrays::points(&points, "points")?;
        let normals = normals.map(|n| arrays::points(&n, "normals")).transpose()?;
        if normals.as_ref().is_some_and(|n| n.len() != points.len()) {
            let reason = format!("expected {} as the points", points.len());
            return Err(Error::parameter("normals", reason).into());
        }
        let n = points.len();
        let ready = self.0.clone();
        ready.check_origin()?;
        let flat = run(py, progress.as_ref(), move |control| {
            let receivers =
                Receivers::from_points(&ready.geometry.frame, &points, normals.as_deref())?;
            control.expect(ready.lights.len() * receivers.group_count());
            let mut out = vec![0.0; n * ready.lights.len()];
            for (light, out) in out.chunks_mut(n.max(1)).enumerate() {
                let shading = ready.method.shade(&receivers, light, control)?;
                scatter(&receivers, &shading.visibility, out);
                if let Some(i) = out.iter().position(|v| !v.is_finite()) {
                    let reason = format!("at point {i} light {light} has none; {TOO_FAR}");
                    return Err(Error::parameter("visibility", reason));
                }
            }
            Ok(out)
        })?;
        PyArray1::from_vec(py, flat).reshape([self.0.lights.len(), n])
    }
}

/// Rows of blocks of a camera's pixels, in which groups of receivers lie one after the other.
struct Rows<'a> {
    /// Pixels in each.
    pixels: usize,
    index: &'a [u32],
}

impl<'a> Rows<'a> {
    fn new(receivers: &'a Receivers, camera: &Camera) -> Self {
        Rows {
            pixels: (camera.width * BLOCK) as usize,
            index: &receivers.index,
        }
    }

    /// The receivers of a row.
    fn receivers(&self, row: usize) -> Range<usize> {
        let before = |pixel: usize| self.index.partition_point(|&p| (p as usize) < pixel);
        before(row * self.pixels)..before((row + 1) * self.pixels)
    }
}

impl Ready {
    fn frame(&self, world: &Camera, control: &Control) -> Result<FrameArrays> {
        let geometry = &*self.geometry;
        let start = Instant::now();
        let camera = world.to_local(&geometry.frame);
        let lights = self.lights.len();
        check_memory(&camera, lights)?;
        // Announced before anything is known of the picture, so that the finished fraction only grows.
        let most = most_groups(&camera);
        control.expect(tile_count(&camera) + most * (1 + lights));
        // What is not in one list of triangles is seen by the hierarchies alone.
        let occluders = if geometry.placed {
            Some(geometry.occluders())
        } else {
            geometry.built_occluders()
        };
        let (surface, receivers) = from_camera(geometry, occluders, &camera, control)?;
        let receivers_seconds = start.elapsed().as_secs_f64();
        control.advance(lights * (most - receivers.group_count()));
        let mut shadings = Vec::with_capacity(lights);
        let mut shade_seconds = 0.0;
        for (number, light) in self.lights.iter().enumerate() {
            let shade_start = Instant::now();
            let mut shading = self.method.shade(&receivers, number, control)?;
            shade_seconds += shade_start.elapsed().as_secs_f64();
            unshadow(&mut shading, geometry, &surface, &receivers, light);
            shadings.push(shading);
        }
        let mut frame = self.pixel_arrays(&camera, &surface, &receivers, &shadings);
        frame.check_finite(camera.width as usize)?;
        let answered: usize = shadings.iter().map(|s| s.by_rays).sum();
        frame.by_rays = answered as f64 / (lights * receivers.len()).max(1) as f64;
        frame.seconds = vec![
            ("frame", start.elapsed().as_secs_f64()),
            ("receivers", receivers_seconds),
            ("shade", shade_seconds),
        ];
        frame.seconds.extend(self.method.built_seconds());
        Ok(frame)
    }

    /// All arrays, rows of blocks in parallel.
    fn pixel_arrays(
        &self,
        camera: &Camera,
        surface: &Surface,
        receivers: &Receivers,
        shadings: &[Shading],
    ) -> FrameArrays {
        let geometry = &*self.geometry;
        let pixels = camera.pixels();
        let (mut radiance, mut position) = (unwritten(3 * pixels), unwritten(3 * pixels));
        let (mut normal, mut depth) = (unwritten(3 * pixels), unwritten(pixels));
        let (mut mask, mut mesh_id) = (unwritten(pixels), unwritten(pixels));
        let mut triangle_id = unwritten(pixels);
        let mut visibility = unwritten(pixels * shadings.len());
        let in_rows = Rows::new(receivers, camera);
        let rows = in_rows.pixels;
        // A row's parts of all lights' images.
        let mut seen: Vec<Vec<_>> = Vec::new();
        seen.resize_with(pixels.div_ceil(rows), Vec::new);
        for image in visibility.chunks_mut(pixels) {
            for (row, part) in image.chunks_mut(rows).enumerate() {
                seen[row].push(part);
            }
        }
        radiance
            .par_chunks_mut(3 * rows)
            .zip(position.par_chunks_mut(3 * rows))
            .zip(normal.par_chunks_mut(3 * rows))
            .zip(depth.par_chunks_mut(rows))
            .zip(mask.par_chunks_mut(rows))
            .zip(mesh_id.par_chunks_mut(rows))
            .zip(triangle_id.par_chunks_mut(rows))
            .zip(seen)
            .enumerate()
            .for_each_init(Vec::new, |irradiances, (row, chunk)| {
                let (chunk, seen) = chunk;
                let (chunk, triangle_id) = chunk;
                let (chunk, mesh_id) = chunk;
                let (chunk, mask) = chunk;
                let (chunk, depth) = chunk;
                let (chunk, normal) = chunk;
                let (radiance, position) = chunk;
                let (radiance, position) = (fill(radiance, 0.0), fill(position, 0.0));
                let (normal, depth) = (fill(normal, 0.0), fill(depth, f32::INFINITY));
                let (mask, mesh_id) = (fill(mask, false), fill(mesh_id, -1));
                let triangle_id = fill(triangle_id, -1);
                let range = in_rows.receivers(row);
                let mut last = None;
                for i in range.clone() {
                    let pixel = receivers.index[i] as usize;
                    let Some((entry, part)) = surface.hit[pixel].entry(geometry, &mut last) else {
                        continue;
                    };
                    let x = pixel - row * rows;
                    mask[x] = true;
                    (mesh_id[x], triangle_id[x]) = (entry as i32, part as i32);
                    depth[x] = (surface.depth[pixel] * geometry.frame.unit) as f32;
                    let p = geometry.frame.to_world(receivers.positions[i]);
                    position[3 * x..3 * x + 3].copy_from_slice(&p.to_array());
                    let n: DVec3 = receivers.normals[i];
                    normal[3 * x..3 * x + 3].copy_from_slice(&n.as_vec3().to_array());
                }
                for ((light, shading), seen) in self.lights.iter().zip(shadings).zip(seen) {
                    let seen = fill(seen, 1.0);
                    let found = irradiance(shading, receivers, range.clone(), light, irradiances);
                    for (i, irradiance) in range.clone().zip(found) {
                        let x = receivers.index[i] as usize - row * rows;
                        seen[x] = shading.visibility[i];
                        let albedo = geometry.material(mesh_id[x] as u32).albedo;
                        let e = irradiance * std::f32::consts::FRAC_1_PI;
                        for channel in 0..3 {
                            radiance[3 * x + channel] +=
                                albedo[channel] * light.radiance[channel] * e;
                        }
                    }
                }
            });
        // SAFETY: `fill` wrote all rows of all arrays.
        unsafe {
            FrameArrays {
                visibility: written(visibility),
                radiance: written(radiance),
                mask: written(mask),
                position: written(position),
                normal: written(normal),
                depth: written(depth),
                mesh_id: written(mesh_id),
                triangle_id: written(triangle_id),
                seconds: Vec::new(),
                by_rays: 0.0,
            }
        }
    }
}

/// Bytes that a pixel takes at the same time: 16 of the surface, 60 of its receiver, 66 of the arrays, and
/// as much again while they are filled.
const PIXEL_BYTES: usize = 256;

/// Bytes that a light adds to a pixel: visibility and irradiance, while they are found and kept.
const LIGHT_BYTES: usize = 24;

/// Asks for all of an image's memory at once, so that what cannot be had is an error and not the end of the
/// process.
fn check_memory(camera: &Camera, lights: usize) -> Result<()> {
    let bytes = (PIXEL_BYTES + LIGHT_BYTES * lights).saturating_mul(camera.pixels());
    let (width, height) = (camera.width, camera.height);
    memory::check(|| format!("Camera: an image of {width} x {height}"), bytes)
}

/// Writes values in the receivers' order to the user's order.
pub(super) fn scatter(receivers: &Receivers, values: &[f32], out: &mut [f32]) {
    for (&i, &v) in receivers.index.iter().zip(values) {
        out[i as usize] = v;
    }
}

fn dictionary<'py>(py: Python<'py>, items: &[(&'static str, f64)]) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    for (name, value) in items {
        out.set_item(name, value)?;
    }
    Ok(out)
}
