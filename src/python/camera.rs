//! The camera object.

use glam::{DMat3, DVec3};
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::arrays;
use crate::camera::Camera;
use crate::error::{Error, Result};

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
