//! Hard shadows.

use pyo3::prelude::*;

use super::{Made, made};
use crate::methods::hard::Hard;

/// The method, which has no parameters.
pub(super) fn make(_: &Bound<'_, PyAny>) -> PyResult<Made> {
    made(Ok(Hard))
}
