//! Receiver polygons' textures as arrays; documented in `softshadow/bake.py` and `softshadow/kernels.py`.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use crate::control::Control;
use crate::error::{Error, Result};
use crate::light::Light;
use crate::mesh::{TriMesh, check_finite};
use crate::methods::accumulation::{Accumulation, Content};
use crate::methods::convolution;
use crate::methods::convolution::MOST_SCALE;
use crate::python::arrays;
use crate::python::light::PyLight;
use crate::python::methods::accumulation::AccumulationParameters;
use crate::python::pool;
use crate::python::pool::Origin;
use crate::python::run::{run, step};
use crate::python::scene::PyScene;
use crate::textures::atlas::{Atlas, Key, MOST_TEXELS};
use crate::textures::lookup::TexelMask;
use crate::textures::occluders::{Gatherer, PatchOccluders, Side};
use crate::textures::patches::Parallelogram;
use crate::textures::texture;
use crate::textures::texture::Texture;
use crate::textures::transform;

/// The textures of some entries' polygons: laid out at first, then drawn.
#[pyclass(name = "Textures", module = "softshadow._core", frozen)]
pub(in crate::python) struct PyTextures(Arc<Shared>);

struct Shared {
    atlas: Atlas,
    method: Accumulation,
    /// A patch, its side, and its entry.
    polygons: Vec<(u32, bool, u32)>,
    bytes: usize,
    drawn: Mutex<Vec<(Key, Texture)>>,
    origin: Origin,
}

impl Shared {
    fn drawn(&self) -> Result<std::sync::MutexGuard<'_, Vec<(Key, Texture)>>> {
        // It may be held by a thread that is not in this process.
        if self.origin.is_torn() {
            return Err(pool::torn("Textures"));
        }
        Ok(self.drawn.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Lays out the textures of scene entries; nothing is drawn yet.
#[pyfunction]
#[pyo3(signature = (scene, lights, parameters, entries, side, progress))]
pub(in crate::python) fn textures(
    py: Python<'_>,
    scene: &PyScene,
    lights: Vec<PyRef<'_, PyLight>>,
    parameters: AccumulationParameters,
    entries: Vec<u32>,
    side: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<PyTextures> {
    let method = parameters.parse()?;
    let lights: Vec<Light> = lights.iter().map(|l| l.0.clone()).collect();
    let scene = scene.shared();
    let toward_light = match side {
        "front" => None,
        "back" => Some(false),
        _ => Some(true),
    };
    run(py, progress.as_ref(), move |control| {
        let geometry = scene.snapshot_for(&lights)?;
        let local: Vec<Light> = lights.iter().map(|l| l.to_local(&geometry.frame)).collect();
        let atlas = Atlas::new(geometry, &local, method.layout, control)?;
        let mut polygons = Vec::new();
        for (id, patch) in atlas.patches.list.iter().enumerate() {
            let entry = atlas.geometry.mesh_of(patch.faces[0]).entry;
            if !entries.contains(&entry) {
                continue;
            }
            let height = |l: &Light| patch.normal.dot(l.center() - patch.bounds.corner);
            let front = match toward_light {
                None => true,
                Some(false) => false,
                // The side that more of the lights' centres are on.
                Some(true) => {
                    let over = atlas.lights.iter().filter(|l| height(l) >= 0.0).count();
                    2 * over >= atlas.lights.len()
                }
            };
            polygons.push((id as u32, front, entry));
        }
        let shared = Shared {
            atlas,
            method,
            polygons,
            bytes: 0,
            drawn: Mutex::default(),
            origin: Origin::here(),
        };
        let bytes = shared.atlas.check_memory(&shared.keys(), 0)?;
        Ok(PyTextures(Arc::new(Shared { bytes, ..shared })))
    })
}

impl Shared {
    /// Every polygon's textures, one a light.
    fn keys(&self) -> Vec<Key> {
        let lights = self.atlas.lights.len() as u32;
        let of = |&(patch, front, _): &(u32, bool, u32)| {
            (0..lights).map(move |light| Key {
                patch,
                front,
                light,
            })
        };
        self.polygons.iter().flat_map(of).collect()
    }

    fn refine(&self, samples: usize, control: &Control) -> Result<f64> {
        let start = Instant::now();
        let mut drawn = self.drawn()?;
        if drawn.is_empty() {
            let empty = |key| (key, self.atlas.texture(key));
            *drawn = self.keys().into_iter().map(empty).collect();
        }
        // The largest first, so that none is left over at the end; they go back to their places.
        let mut order: Vec<usize> = (0..drawn.len()).collect();
        order.sort_by_key(|&i| (std::cmp::Reverse(drawn[i].1.bytes()), i));
        let mut sorted: Vec<_> = order
            .iter()
            .map(|&i| std::mem::replace(&mut drawn[i], (KEY, Texture::default())))
            .collect();
        control.expect(sorted.iter().map(|(_, t)| texels(t.size)).sum());
        let paint = |key: Key, texture: &mut Texture, gatherer: &mut Gatherer| {
            self.method
                .refine(&self.atlas, key, texture, samples, gatherer, control)
        };
        let done = |texels| control.advance(texels);
        let result = self.atlas.paint(&mut sorted, paint, control, done);
        for (i, texture) in order.into_iter().zip(sorted) {
            drawn[i] = texture;
        }
        result.map(|_| start.elapsed().as_secs_f64())
    }
}

/// Stands for a texture that is being drawn.
const KEY: Key = Key {
    patch: 0,
    front: true,
    light: 0,
};

fn texels(size: [u32; 2]) -> usize {
    size[0] as usize * size[1] as usize
}

#[pymethods]
impl PyTextures {
    /// Bytes of all textures.
    #[getter]
    fn bytes(&self) -> usize {
        self.0.bytes
    }

    fn __len__(&self) -> usize {
        self.0.polygons.len()
    }

    /// Draws up to so many light points; returns the seconds that it took.
    #[pyo3(signature = (samples, progress))]
    fn refine(&self, py: Python<'_>, samples: usize, progress: Option<Py<PyAny>>) -> PyResult<f64> {
        let shared = self.0.clone();
        run(py, progress.as_ref(), move |control| {
            shared.refine(samples, control)
        })
    }

    /// Where polygon `i` is.
    fn polygon<'py>(&self, py: Python<'py>, i: usize) -> PyResult<Bound<'py, PyDict>> {
        let atlas = &self.0.atlas;
        let (geometry, frame) = (&atlas.geometry, &atlas.geometry.frame);
        let (id, front, entry) = self.0.polygons[i];
        let patch = &atlas.patches.list[id as usize];
        let bounds = &patch.bounds;
        let first = geometry.mesh_of(patch.faces[0]).first_face;
        let faces = patch.faces.iter().map(|f| (f - first) as i32);
        let dual = bounds.dual();
        let uv = patch.faces.iter().flat_map(|&f| geometry.corners(f));
        let uv: Vec<f32> = uv
            .flat_map(|p| {
                let d = p.as_dvec3() - bounds.corner;
                [dual[0].dot(d) as f32, dual[1].dot(d) as f32]
            })
            .collect();
        let out = PyDict::new(py);
        out.set_item("entry", entry)?;
        out.set_item("faces", PyArray1::from_iter(py, faces))?;
        let uv = PyArray1::from_vec(py, uv).reshape([patch.faces.len(), 3, 2])?;
        out.set_item("uv", uv)?;
        out.set_item("corner", frame.to_world(bounds.corner).to_array())?;
        let edges = bounds.edges.map(|e| (e * frame.unit).to_array());
        out.set_item("edges", edges)?;
        let normal = if front { patch.normal } else { -patch.normal };
        out.set_item("normal", normal.to_array())?;
        out.set_item("size", atlas.size(id))?;
        Ok(out)
    }

    /// Whether each texel's centre is on the polygon, row 0 on top.
    fn mask<'py>(&self, py: Python<'py>, i: usize) -> PyResult<Bound<'py, PyArray2<bool>>> {
        let id = self.0.polygons[i].0;
        let mask = TexelMask::new(&self.0.atlas, id);
        let [w, h] = self.0.atlas.size(id);
        let bits = (0..h).rev().flat_map(|y| (0..w).map(move |x| (x, y)));
        let bits = bits.map(|(x, y)| mask.holds(x, y)).collect();
        arrays::rows(py, bits, w as usize)
    }

    /// Visibility, irradiance at radiance 1 and eight-bit levels of polygon `i` under each light.
    fn arrays<'py>(&self, py: Python<'py>, i: usize) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let atlas = &self.0.atlas;
        let lights = atlas.lights.len();
        let drawn = self.0.drawn()?;
        let Some(textures) = drawn.get(i * lights..(i + 1) * lights) else {
            return Err(Error::parameter("Textures", "nothing is drawn yet").into());
        };
        let one = |(key, texture): &(Key, Texture)| {
            let [w, h] = texture.size.map(|s| s as usize);
            let light = &atlas.lights[key.light as usize];
            let side = atlas.side(*key);
            let each = |f: &(dyn Fn(usize, usize) -> f32 + Sync)| {
                let all = || {
                    let rows = (0..h).into_par_iter().rev();
                    let row = |y: usize| (0..w).map(|x| f(x, y)).collect::<Vec<f32>>();
                    Ok(rows.flat_map_iter(row).collect::<Vec<f32>>())
                };
                step(py, all)
            };
            let visibility = each(&|x, y| texture.visibility(x, y))?;
            let out = PyDict::new(py);
            if self.0.method.content == Content::EightBit {
                let samples = texture.samples;
                let levels = visibility
                    .iter()
                    .map(|&v| self.0.method.eight_bits(v, samples));
                out.set_item("levels", arrays::rows(py, levels.collect(), w)?)?;
            }
            if self.0.method.content == Content::Radiance {
                let irradiance =
                    each(&|x, y| texture.irradiance(x, y, light, &side).unwrap_or(0.0))?;
                out.set_item("irradiance", arrays::rows(py, irradiance, w)?)?;
            }
            out.set_item("visibility", arrays::rows(py, visibility, w)?)?;
            Ok(out)
        };
        textures.iter().map(one).collect()
    }
}

fn parallelogram(corner: [f64; 3], edge_u: [f64; 3], edge_v: [f64; 3]) -> Result<Parallelogram> {
    let bounds = Parallelogram {
        corner: corner.into(),
        edges: [edge_u.into(), edge_v.into()],
    };
    let [u, v] = bounds.edges;
    if !(bounds.corner.is_finite() && u.is_finite() && v.is_finite()) {
        return Err(Error::parameter(
            "corner and edges",
            "expected finite numbers",
        ));
    }
    if bounds.cross().length() <= 1e-12 * u.length() * v.length() {
        let reason = format!("edge_u {u} and edge_v {v} span no area");
        return Err(Error::parameter("edges", reason));
    }
    Ok(bounds)
}

/// The 4×4 matrix from the pyramid of a light point and a parallelogram to the unit box.
#[pyfunction]
pub(in crate::python) fn receiver_transform<'py>(
    py: Python<'py>,
    light_point: [f64; 3],
    corner: [f64; 3],
    edge_u: [f64; 3],
    edge_v: [f64; 3],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let bounds = parallelogram(corner, edge_u, edge_v)?;
    let light_point = DVec3::from(light_point);
    let matrix = light_point
        .is_finite()
        .then(|| transform::matrix(light_point, &bounds))
        .flatten();
    let Some(matrix) = matrix else {
        let reason = format!("{light_point} lies in the parallelogram's plane");
        return Err(Error::parameter("light_point", reason).into());
    };
    arrays::rows(py, matrix.transpose().to_cols_array().to_vec(), 4)
}

/// Hard shadows of a mesh from points, weighted and added up.
#[pyfunction]
#[pyo3(signature = (vertices, faces, light_points, colours, corner, edges, size, progress))]
#[allow(clippy::too_many_arguments, reason = "mirrors the Python signature")]
pub(in crate::python) fn accumulate<'py>(
    py: Python<'py>,
    vertices: PyReadonlyArray2<'py, f64>,
    faces: PyReadonlyArray2<'py, i64>,
    light_points: PyReadonlyArray2<'py, f64>,
    colours: PyReadonlyArray2<'py, f64>,
    corner: [f64; 3],
    edges: [[f64; 3]; 2],
    size: [u32; 2],
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let bounds = parallelogram(corner, edges[0], edges[1])?;
    let most = MOST_TEXELS;
    if size.iter().any(|s| !(1..=most).contains(s)) {
        let reason = format!("must be 1 to {most} texels a side, got {size:?}");
        return Err(Error::parameter("size", reason).into());
    }
    let vertices = arrays::points(&vertices, "vertices")?;
    let faces = arrays::faces(&faces, "faces")?;
    let points = arrays::points(&light_points, "light_points")?;
    let colours = arrays::points(&colours, "colours")?;
    let flat = run(py, progress.as_ref(), move |control| {
        let mesh = TriMesh::new("kernel", vertices, &faces)?;
        check_finite("light_points", "point", &points)?;
        check_finite("colours", "colour", &colours)?;
        control.expect(points.len());
        let up = bounds.cross().normalize();
        let over = points.iter().filter(|p| up.dot(**p - bounds.corner) > 0.0);
        // The side that most of the light points are on.
        let normal = if 2 * over.count() >= points.len() {
            up
        } else {
            -up
        };
        let side = Side { bounds, normal };
        let occluders = PatchOccluders::of_mesh(mesh.vertices(), mesh.faces(), &side);
        let texels = texels(size);
        let mut sum = vec![0.0f32; 3 * texels];
        for (points, colours) in points.chunks(64).zip(colours.chunks(64)) {
            let shadows: Vec<_> = points
                .par_iter()
                .map(|p| {
                    control.step()?;
                    Ok(texture::hard_shadow(&occluders, &side, *p, size))
                })
                .collect::<Result<_>>()?;
            sum.par_chunks_mut(3 * size[0] as usize)
                .rev()
                .enumerate()
                .for_each(|(y, row)| {
                    for (shadow, colour) in shadows.iter().zip(colours) {
                        for (x, texel) in row.chunks_exact_mut(3).enumerate() {
                            if !shadow.get(x as u32, y as u32) {
                                for (t, c) in texel.iter_mut().zip(colour.to_array()) {
                                    *t += c as f32;
                                }
                            }
                        }
                    }
                });
        }
        Ok(sum)
    })?;
    arrays::rows(py, flat, 3)
}

/// A hidden picture of a parallelogram convolved with a light's image.
#[pyfunction]
#[pyo3(signature = (hidden, light, corner, edges, scale, progress))]
pub(in crate::python) fn convolve_shadow<'py>(
    py: Python<'py>,
    hidden: PyReadonlyArray2<'py, f32>,
    light: &PyLight,
    corner: [f64; 3],
    edges: [[f64; 3]; 2],
    scale: f64,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let bounds = parallelogram(corner, edges[0], edges[1])?;
    let hidden = hidden.as_array();
    let size = [hidden.ncols(), hidden.nrows()];
    if size.iter().any(|s| !(1..=MOST_TEXELS as usize).contains(s)) {
        let reason = format!("must have 1 to {MOST_TEXELS} texels a side, got {size:?}");
        return Err(Error::parameter("visibility", reason).into());
    }
    if !(0.0..=MOST_SCALE).contains(&scale) {
        let reason = format!("must be 0 to {MOST_SCALE}, got {scale}");
        return Err(Error::parameter("scale", reason).into());
    }
    let picture: Vec<f32> = hidden.iter().copied().collect();
    let light = light.placed("convolve_shadow")?;
    let size = size.map(|s| s as u32);
    let flat = run(py, progress.as_ref(), move |control| {
        convolution::convolve(&picture, size, &light, &bounds, scale, control)
    })?;
    arrays::rows(py, flat, size[0] as usize)
}
