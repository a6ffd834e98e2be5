//! The pieces of single sample soft shadows; documented in `softshadow/kernels.py`.

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::error::Error;
use crate::methods::single_sample::SingleSample;
use crate::python::arrays;
use crate::python::light::PyLight;
use crate::python::methods::single_sample::SingleSampleParameters;
use crate::python::parse::parse_falloff;
use crate::python::run::run;
use crate::python::scene::PyScene;
use crate::receivers::Receivers;

#[pyfunction]
#[pyo3(signature = (scene, points, normals, light, parameters, progress=None))]
pub(in crate::python) fn outer_distances<'py>(
    py: Python<'py>,
    scene: &PyScene,
    points: PyReadonlyArray2<'py, f64>,
    normals: Option<PyReadonlyArray2<'py, f64>>,
    light: &PyLight,
    parameters: SingleSampleParameters,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray1<f32>>> {
    let method = parameters.parse()?;
    let points = arrays::points(&points, "points")?;
    let normals = normals.map(|n| arrays::points(&n, "normals")).transpose()?;
    let (scene, light) = (scene.shared(), light.0.clone());
    let out = run(py, progress.as_ref(), move |control| {
        let geometry = scene.snapshot_for(std::slice::from_ref(&light))?;
        let receivers = Receivers::from_points(&geometry.frame, &points, normals.as_deref())?;
        control.expect(receivers.group_count());
        let light = light.to_local(&geometry.frame);
        let ready = method.ready(geometry, &[light], control)?;
        let found = ready.distances(&receivers, 0, control)?;
        let mut out = vec![0.0; found.len()];
        for (&i, tau) in receivers.index.iter().zip(found) {
            out[i as usize] = tau;
        }
        Ok(out)
    })?;
    Ok(PyArray1::from_vec(py, out))
}

#[pyfunction]
pub(in crate::python) fn attenuation<'py>(
    py: Python<'py>,
    tau: PyReadonlyArray1<'py, f64>,
    falloff: &str,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let falloff = parse_falloff("attenuation", falloff)?;
    let tau = arrays::values(&tau);
    if let Some(i) = tau.iter().position(|t| t.is_nan()) {
        return Err(Error::parameter("tau", format!("value {i} is not a number")).into());
    }
    let seen = tau
        .into_iter()
        .map(|t| SingleSample::visible(falloff, t))
        .collect();
    Ok(PyArray1::from_vec(py, seen))
}
