//! The maps of the soft shadow occlusion camera as arrays; documented in `softshadow/light_maps.py`.

use glam::DVec2;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::casters::Casters;
use crate::frame::Frame;
use crate::methods::ssoc::maps::Maps;
use crate::python::arrays::set_camera;
use crate::python::light::PyLight;
use crate::python::methods::ssoc::SsocParameters;
use crate::python::run::run;
use crate::python::scene::PyScene;
use crate::raster::nearest::NONE;

#[pyfunction]
#[pyo3(signature = (scene, light, parameters, progress=None))]
pub(in crate::python) fn ssoc_maps<'py>(
    py: Python<'py>,
    scene: &PyScene,
    light: &PyLight,
    parameters: SsocParameters,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let method = parameters.parse()?;
    let world = light.placed("ssoc_maps")?;
    let scene = scene.shared();
    let (frame, found) = run(py, progress.as_ref(), move |control| {
        let geometry = scene.snapshot_for(std::slice::from_ref(&world))?;
        let frame = geometry.frame;
        let light = world.to_local(&frame);
        let casters = Casters::new("ssoc", geometry, true)?;
        let light = casters.off_ceilings(&light);
        let edges = casters.silhouettes(light.center(), false);
        let (maps, _) = method.maps(&casters, &edges, &light, control)?;
        Ok((frame, maps))
    })?;
    found.iter().map(|m| arrays_of(py, m, &frame)).collect()
}

fn arrays_of<'py>(py: Python<'py>, maps: &Maps, frame: &Frame) -> PyResult<Bound<'py, PyDict>> {
    let camera = &maps.view.camera;
    let shape = [camera.height as usize, camera.width as usize];
    let out = PyDict::new(py);
    set_camera(&out, camera, frame)?;
    let depth = |inverse: f64| (frame.unit / inverse) as f32;
    let depths = maps.inverse_depth.iter().map(|&i| depth(i)).collect();
    out.set_item("depth", PyArray1::from_vec(py, depths).reshape(shape)?)?;
    for (name, map) in [("inside", &maps.inside), ("outside", &maps.outside)] {
        let mut flat = vec![0.0f32; 6 * camera.pixels()];
        for (texel, (&line, out)) in map.iter().zip(flat.chunks_exact_mut(6)).enumerate() {
            if line == NONE {
                continue;
            }
            let line = &maps.lines[line as usize];
            let (x, y) = (texel % shape[1], texel / shape[1]);
            let foot = line.foot(DVec2::new(x as f64, y as f64) + 0.5);
            let [px, py] = foot.point.as_vec2().to_array();
            let [nx, ny] = foot.normal.as_vec2().to_array();
            let z = [depth(foot.inverse_near), depth(line.inverse_far)];
            out.copy_from_slice(&[px, py, nx, ny, z[0], z[1]]);
        }
        let [h, w] = shape;
        out.set_item(name, PyArray1::from_vec(py, flat).reshape([h, w, 6])?)?;
    }
    Ok(out)
}
