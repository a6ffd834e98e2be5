//! NumPy arrays to vectors of points, and back.

use glam::{DMat4, DVec3};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::memory;

/// The rows of an (N, 3) array, whatever its strides.
pub(super) fn points(array: &PyReadonlyArray2<'_, f64>, what: &str) -> Result<Vec<DVec3>> {
    check_columns(array.shape(), 3, what)?;
    check_memory(array.shape(), what)?;
    let view = array.as_array();
    Ok(view
        .rows()
        .into_iter()
        .map(|r| DVec3::new(r[0], r[1], r[2]))
        .collect())
}

/// The rows of an (N, 3) array of vertex indices.
pub(super) fn faces(array: &PyReadonlyArray2<'_, i64>, what: &str) -> Result<Vec<[i64; 3]>> {
    check_columns(array.shape(), 3, what)?;
    check_memory(array.shape(), what)?;
    let view = array.as_array();
    Ok(view
        .rows()
        .into_iter()
        .map(|r| [r[0], r[1], r[2]])
        .collect())
}

/// The values of a one-dimensional array.
pub(super) fn values(array: &PyReadonlyArray1<'_, f64>) -> Vec<f64> {
    array.as_array().to_vec()
}

/// A 4×4 matrix, stored in rows as NumPy does.
pub(super) fn matrix(array: &PyReadonlyArray2<'_, f64>, what: &str) -> Result<DMat4> {
    if array.shape() != [4, 4] {
        let reason = format!("expected shape (4, 4), got {:?}", array.shape());
        return Err(Error::parameter(what, reason));
    }
    let view = array.as_array();
    let flat: [f64; 16] = std::array::from_fn(|i| view[[i / 4, i % 4]]);
    Ok(DMat4::from_cols_array(&flat).transpose())
}

/// Whether there is memory for a copy of an array of three columns; large inputs all come through here.
fn check_memory(shape: &[usize], what: &str) -> Result<()> {
    super::allocator::take_reserve();
    memory::check(|| format!("{what}: its array"), 24 * shape[0])
}

fn check_columns(shape: &[usize], columns: usize, what: &str) -> Result<()> {
    if shape.len() == 2 && shape[1] == columns {
        return Ok(());
    }
    Err(Error::parameter(
        what,
        format!("expected shape (N, {columns}), got {shape:?}"),
    ))
}

/// An (N, columns) array of a flat vector.
pub(super) fn rows<'py, T: numpy::Element>(
    py: Python<'py>,
    flat: Vec<T>,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let n = flat.len() / columns.max(1);
    PyArray1::from_vec(py, flat).reshape([n, columns])
}

/// Puts a local camera into a dictionary, in world coordinates, as `softshadow.Camera.from_matrix` takes it.
pub(super) fn set_camera(out: &Bound<'_, PyDict>, camera: &Camera, frame: &Frame) -> PyResult<()> {
    let py = out.py();
    let intrinsics = camera.intrinsics.transpose().to_cols_array().to_vec();
    out.set_item("K", rows(py, intrinsics, 3)?)?;
    let eye = frame.to_world(camera.eye);
    let columns = camera.rotation.to_cols_array_2d();
    let mut pose = Vec::with_capacity(16);
    for (row, e) in columns.iter().zip(eye.to_array()) {
        pose.extend_from_slice(row);
        pose.push(e);
    }
    pose.extend([0.0, 0.0, 0.0, 1.0]);
    out.set_item("camera_to_world", rows(py, pose, 4)?)
}
