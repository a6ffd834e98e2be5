//! Layered shadow maps as arrays; documented in `softshadow/light_maps.py`.

use std::collections::BTreeMap;

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::casters::Casters;
use crate::error::Result;
use crate::frame::Frame;
use crate::maps::layers::map::LayerMap;
use crate::method::Prepared;
use crate::methods::layered::given::{Clear, Given, frame_around, frame_of};
use crate::methods::layered::{LayerKind, Layered};
use crate::python::arrays::{points as read_points, set_camera};
use crate::python::camera::PyCamera;
use crate::python::light::PyLight;
use crate::python::methods::layered::LayeredParameters;
use crate::python::parse::choice;
use crate::python::render::scatter;
use crate::python::run::run;
use crate::python::scene::PyScene;
use crate::receivers::Receivers;

/// The method that `softshadow.Slsm`, `Mlsm` or `Mtsm` stands for.
fn parse(what: &str, parameters: &LayeredParameters, name: &str) -> Result<(LayerKind, Layered)> {
    let kinds =
        [LayerKind::Single, LayerKind::Multi, LayerKind::Transparent].map(|k| (k.name(), k));
    let kind = choice(what, "method", name, &kinds)?;
    Ok((kind, parameters.parse(kind)?))
}

#[pyfunction]
#[pyo3(signature = (scene, light, parameters, name, progress=None))]
pub(in crate::python) fn layered_maps<'py>(
    py: Python<'py>,
    scene: &PyScene,
    light: &PyLight,
    parameters: LayeredParameters,
    name: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let (kind, method) = parse("layered_maps", &parameters, name)?;
    let world = light.placed("layered_maps")?;
    let scene = scene.shared();
    let (frame, found) = run(py, progress.as_ref(), move |control| {
        let geometry = scene.snapshot_for(std::slice::from_ref(&world))?;
        let frame = geometry.frame;
        let light = world.to_local(&frame);
        let casters = Casters::new(kind.name(), geometry, method.takes_transparent())?;
        Ok((frame, method.maps(&casters, &light, control)?))
    })?;
    let mut out = Vec::new();
    for (group, maps) in found.iter().enumerate() {
        for map in maps {
            let arrays = arrays_of(py, map, &frame)?;
            arrays.set_item("group", group)?;
            out.push(arrays);
        }
    }
    Ok(out)
}

fn arrays_of<'py>(py: Python<'py>, map: &LayerMap, frame: &Frame) -> PyResult<Bound<'py, PyDict>> {
    let camera = &map.view.camera;
    let (h, w, k) = (camera.height as usize, camera.width as usize, map.layers);
    let out = PyDict::new(py);
    set_camera(&out, camera, frame)?;
    out.set_item("origin", frame.origin.to_array())?;
    out.set_item("unit", frame.unit)?;
    // No layer has an inverse depth of 0: it is infinitely far.
    let depth = |inverse: f32| frame.unit / f64::from(inverse);
    let texels = || (0..h * w).map(|i| (i % w, i / w));
    let mut depths = vec![f64::INFINITY; h * w * k];
    let mut slopes = vec![0.0f32; 2 * h * w * k];
    for (i, (x, y)) in texels().enumerate() {
        for (j, piece) in map.texel(x, y).enumerate() {
            let at = i * k + j;
            depths[at] = depth(piece.inverse_depth);
            let slope = piece.slope().map(|s| (f64::from(s) / frame.unit) as f32);
            slopes[2 * at..2 * at + 2].copy_from_slice(&slope);
        }
    }
    let shape = [h, w, k];
    let doubles = |flat: Vec<f64>| PyArray1::from_vec(py, flat).reshape(shape);
    let floats = |flat: Vec<f32>| PyArray1::from_vec(py, flat).reshape(shape);
    out.set_item("depths", doubles(depths)?)?;
    out.set_item(
        "slopes",
        PyArray1::from_vec(py, slopes).reshape([h, w, k, 2])?,
    )?;
    if map.is_transparent() {
        let mut first = vec![f64::INFINITY; h * w * k];
        let mut visibility = vec![1.0f32; h * w * k];
        let mut transmittance = vec![1.0f32; h * w * k];
        let mut counts = vec![0i32; h * w * k];
        for (i, (x, y)) in texels().enumerate() {
            for (j, medium) in map.texel_media(x, y).enumerate() {
                first[i * k + j] = depth(medium.first);
                visibility[i * k + j] = medium.visibility;
                transmittance[i * k + j] = medium.through;
                counts[i * k + j] = i32::try_from(medium.count).unwrap_or(i32::MAX);
            }
        }
        out.set_item("first_depths", doubles(first)?)?;
        out.set_item("visibility", floats(visibility)?)?;
        out.set_item("transmittance", floats(transmittance)?)?;
        out.set_item("counts", PyArray1::from_vec(py, counts).reshape(shape)?)?;
    }
    Ok(out)
}

/// A `softshadow.LayeredMap`, its arrays flat and of the right length.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(super) struct GivenArrays<'py> {
    name: String,
    camera: PyRef<'py, PyCamera>,
    group: i64,
    layers: usize,
    depths: PyReadonlyArray1<'py, f64>,
    slopes: Option<PyReadonlyArray1<'py, f64>>,
    visibility: Option<PyReadonlyArray1<'py, f32>>,
    first_depths: Option<PyReadonlyArray1<'py, f64>>,
    counts: Option<PyReadonlyArray1<'py, i64>>,
    transmittance: Option<PyReadonlyArray1<'py, f32>>,
}

impl GivenArrays<'_> {
    fn given(&self) -> Given {
        fn copy<T: numpy::Element + Copy>(array: &PyReadonlyArray1<'_, T>) -> Vec<T> {
            array.as_array().to_vec()
        }
        Given {
            name: self.name.clone(),
            camera: self.camera.0,
            layers: self.layers,
            depths: copy(&self.depths),
            slopes: self.slopes.as_ref().map(copy),
            clear: self.visibility.as_ref().map(|visibility| Clear {
                visibility: copy(visibility),
                first_depths: self.first_depths.as_ref().map(copy),
                counts: self.counts.as_ref().map(copy),
                transmittance: self.transmittance.as_ref().map(copy),
            }),
        }
    }
}

#[pyfunction]
#[pyo3(signature = (maps, light, points, normals, parameters, name, frame, progress=None))]
#[allow(clippy::too_many_arguments, reason = "mirrors the Python signature")]
pub(in crate::python) fn trace_layered_maps<'py>(
    py: Python<'py>,
    maps: Vec<GivenArrays<'py>>,
    light: &PyLight,
    points: PyReadonlyArray2<'py, f64>,
    normals: Option<PyReadonlyArray2<'py, f64>>,
    parameters: LayeredParameters,
    name: &str,
    frame: Option<([f64; 3], f64)>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray1<f32>>> {
    let (_, method) = parse("trace_layered_maps", &parameters, name)?;
    let points = read_points(&points, "points")?;
    let normals = normals.map(|n| read_points(&n, "normals")).transpose()?;
    let mut groups: BTreeMap<i64, Vec<Given>> = BTreeMap::new();
    for map in &maps {
        groups.entry(map.group).or_default().push(map.given());
    }
    let groups: Vec<Vec<Given>> = groups.into_values().collect();
    let world = light.placed("trace_layered_maps")?;
    let out = run(py, progress.as_ref(), move |control| {
        let frame = match frame {
            Some((origin, unit)) => frame_of(origin, unit)?,
            None => frame_around(&world, groups.iter().flatten()),
        };
        let ready = method.through(world.to_local(&frame), &groups, &frame, control)?;
        let receivers = Receivers::from_points(&frame, &points, normals.as_deref())?;
        control.expect(receivers.group_count());
        let shading = ready.shade(&receivers, 0, control)?;
        let mut out = vec![0.0; points.len()];
        scatter(&receivers, &shading.visibility, &mut out);
        Ok(out)
    })?;
    Ok(PyArray1::from_vec(py, out))
}
