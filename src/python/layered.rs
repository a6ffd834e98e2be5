//! Layered shadow maps as arrays; documented in `softshadow/light_maps.py`.

use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::set_camera;
use super::objects::{LayeredParameters, PyLight, PyScene, choice};
use super::run;
use crate::geometry::Frame;
use crate::methods::layered::Kind;
use crate::methods::layered::map::LayerMap;
use crate::methods::wedges::contour::Casters;

#[pyfunction]
#[pyo3(signature = (scene, light, parameters, name, progress=None))]
pub(super) fn layered_maps<'py>(
    py: Python<'py>,
    scene: &PyScene,
    light: &PyLight,
    parameters: LayeredParameters,
    name: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let kinds = [Kind::Single, Kind::Multi, Kind::Transparent].map(|k| (k.name(), k));
    let kind = choice("layered_maps", "method", name, &kinds)?;
    let method = parameters.parse(kind)?;
    let world = light.0;
    let scene = scene.shared();
    let (frame, found) = run(py, progress.as_ref(), move |control| {
        let geometry = scene.geometry()?;
        let frame = geometry.frame;
        let light = world.to_local(&frame);
        let casters = Casters::new(kind.name(), geometry, method.takes_transparent())?;
        Ok((frame, method.maps(&casters, &light, control)?))
    })?;
    let maps = found.iter().flatten();
    maps.map(|map| arrays_of(py, map, &frame)).collect()
}

fn arrays_of<'py>(py: Python<'py>, map: &LayerMap, frame: &Frame) -> PyResult<Bound<'py, PyDict>> {
    let camera = &map.view.camera;
    let (h, w, k) = (camera.height as usize, camera.width as usize, map.layers);
    let out = PyDict::new(py);
    set_camera(&out, camera, frame)?;
    // No layer has an inverse depth of 0: it is infinitely far.
    let depth = |inverse: f32| (frame.unit / f64::from(inverse)) as f32;
    let texels = || (0..h * w).map(|i| (i % w, i / w));
    let mut depths = vec![f32::INFINITY; h * w * k];
    for ((x, y), layers) in texels().zip(depths.chunks_exact_mut(k)) {
        for (to, piece) in layers.iter_mut().zip(map.texel(x, y)) {
            *to = depth(piece.inverse_depth);
        }
    }
    let shape = [h, w, k];
    let floats = |flat: Vec<f32>| PyArray1::from_vec(py, flat).reshape(shape);
    out.set_item("depths", floats(depths)?)?;
    if map.is_transparent() {
        let mut first = vec![f32::INFINITY; h * w * k];
        let mut visibility = vec![1.0f32; h * w * k];
        let mut counts = vec![0i32; h * w * k];
        for (i, (x, y)) in texels().enumerate() {
            for (j, medium) in map.texel_media(x, y).enumerate() {
                first[i * k + j] = depth(medium.first);
                visibility[i * k + j] = medium.visibility;
                counts[i * k + j] = i32::try_from(medium.count).unwrap_or(i32::MAX);
            }
        }
        out.set_item("first_depths", floats(first)?)?;
        out.set_item("visibility", floats(visibility)?)?;
        out.set_item("counts", PyArray1::from_vec(py, counts).reshape(shape)?)?;
    }
    Ok(out)
}
