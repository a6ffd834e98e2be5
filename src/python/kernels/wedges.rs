//! Penumbra wedges as arrays; documented in `softshadow/kernels.py`.

use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::casters::Casters;
use crate::frame::Frame;
use crate::methods::wedges::planes;
use crate::methods::wedges::planes::Plane;
use crate::python::arrays;
use crate::python::camera::PyCamera;
use crate::python::light::PyLight;
use crate::python::methods::wedges::{WedgeParameters, parse_construction};
use crate::python::run::run;
use crate::python::scene::PyScene;
use crate::raster::tile_count;
use crate::receivers::visible::{from_camera, most_groups};

type Floats<'py> = Bound<'py, PyArray3<f32>>;

#[pyfunction]
#[pyo3(signature = (scene, light, vertex_angle, kind))]
pub(in crate::python) fn wedges<'py>(
    py: Python<'py>,
    scene: &PyScene,
    light: &PyLight,
    vertex_angle: f64,
    kind: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let construction = parse_construction(vertex_angle, kind)?;
    let world = light.placed("wedges")?;
    let scene = scene.shared();
    let (frame, found) = run(py, None, move |_| {
        let geometry = scene.snapshot_for(std::slice::from_ref(&world))?;
        let frame = geometry.frame;
        let light = world.to_local(&frame);
        let casters = Casters::new("wedges", geometry, true)?;
        let edges = casters.silhouettes(light.center(), true);
        Ok((frame, planes::wedges(&edges, &light, construction)))
    })?;
    let out = PyDict::new(py);
    let n = found.len();
    let points =
        |f: &dyn Fn(&planes::Wedge) -> Vec<f64>| -> Vec<f64> { found.iter().flat_map(f).collect() };
    let pairs =
        |values: Vec<f64>, columns: usize| PyArray1::from_vec(py, values).reshape([n, 2, columns]);
    let ends = points(&|w| {
        w.ends
            .iter()
            .flat_map(|p| frame.to_world(*p).to_array())
            .collect()
    });
    out.set_item("edges", pairs(ends, 3)?)?;
    for (name, plane) in [
        ("front", (|w| &w.front) as fn(&planes::Wedge) -> &Plane),
        ("back", |w| &w.back),
    ] {
        let flat = points(&|w| to_world(plane(w), &frame).to_vec());
        out.set_item(name, arrays::rows(py, flat, 4)?)?;
    }
    let sides = points(&|w| w.sides.iter().flat_map(|p| to_world(p, &frame)).collect());
    out.set_item("sides", pairs(sides, 4)?)?;
    let across = points(&|w| w.across.iter().flat_map(DVec3::to_array).collect());
    out.set_item("directions", pairs(across, 3)?)?;
    let layers: Vec<i32> = found.iter().flat_map(|w| w.layers).collect();
    let layers: Bound<'py, PyArray2<i32>> = arrays::rows(py, layers, 2)?;
    out.set_item("layers", layers)?;
    let objects = found.iter().map(|w| w.object as i32).collect();
    out.set_item("objects", PyArray1::from_vec(py, objects))?;
    Ok(out)
}

/// A plane `[a, b, c, d]` with `a x + b y + c z = d` in world coordinates.
fn to_world(plane: &Plane, frame: &Frame) -> [f64; 4] {
    let [a, b, c] = plane.normal.to_array();
    let offset = plane.offset * frame.unit + plane.normal.dot(frame.origin);
    [a, b, c, offset]
}

#[pyfunction]
#[pyo3(signature = (scene, camera, light, parameters, progress=None))]
pub(in crate::python) fn light_intensity<'py>(
    py: Python<'py>,
    scene: &PyScene,
    camera: &PyCamera,
    light: &PyLight,
    parameters: WedgeParameters,
    progress: Option<Py<PyAny>>,
) -> PyResult<Floats<'py>> {
    let method = parameters.parse()?;
    let (world, light) = (camera.0, light.placed("light_intensity")?);
    let scene = scene.shared();
    let flat = run(py, progress.as_ref(), move |control| {
        let geometry = scene.snapshot_for(std::slice::from_ref(&light))?;
        let camera = world.to_local(&geometry.frame);
        control.expect(tile_count(&camera) + 2 * most_groups(&camera));
        let (_, receivers) = from_camera(&geometry, None, &camera, control)?;
        let light = light.to_local(&geometry.frame);
        let cover = method.cover(geometry, &light, &receivers, control)?;
        let mut out = vec![1.0; 2 * camera.pixels()];
        for (&pixel, cover) in receivers.index.iter().zip(&cover) {
            let place = 2 * pixel as usize;
            (out[place], out[place + 1]) = (1.0 - cover[0], 1.0 - cover[1]);
        }
        Ok(out)
    })?;
    PyArray1::from_vec(py, flat).reshape([world.height as usize, world.width as usize, 2])
}
