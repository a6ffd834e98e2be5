//! The bindings, the only folder that knows PyO3 and NumPy.
//!
//! - this file: the module and the exceptions;
//! - [`run`]: running kernels without the interpreter lock, with answers to Ctrl-C and reports of progress;
//! - [`pool`]: the threads that kernels run on, also in a process that was forked;
//! - [`allocator`]: memory that is refused instead of ending the process;
//! - [`arrays`]: NumPy arrays to vectors of points and back; [`parse`]: names and numbers that users write;
//! - [`scene`], [`light`], [`camera`]: the objects that the Python classes hold;
//! - [`methods`]: the methods' parameters, and the table of methods;
//! - [`render`]: preparing and rendering;
//! - [`kernels`]: the pieces, as functions from arrays to arrays.

mod allocator;
mod arrays;
mod camera;
mod kernels;
mod light;
mod methods;
mod parse;
mod pool;
mod render;
mod run;
mod scene;

use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyMemoryError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyType};

use crate::error::{Error, ErrorKind};
use crate::simd;

#[global_allocator]
static ALLOCATOR: allocator::Allocator = allocator::Allocator;

create_exception!(
    _core,
    SceneError,
    PyValueError,
    "Something is wrong with a scene or a mesh."
);
create_exception!(
    _core,
    ParameterError,
    PyValueError,
    "A parameter is out of its range."
);
create_exception!(
    _core,
    UnsupportedError,
    PyValueError,
    "A method cannot do what is asked of it."
);

/// `OutOfMemoryError`: what asks for too much is a parameter out of its range, and what there is no memory for.
fn out_of_memory(py: Python<'_>) -> PyResult<Bound<'_, PyType>> {
    static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    let class = CLASS.get_or_try_init(py, || {
        let bases = (
            py.get_type::<ParameterError>(),
            py.get_type::<PyMemoryError>(),
        );
        let body = PyDict::new(py);
        body.set_item("__module__", "softshadow._core")?;
        body.set_item("__doc__", "Something takes more memory than there is.")?;
        let class = py
            .get_type::<PyType>()
            .call1(("OutOfMemoryError", bases, body))?;
        Ok::<_, PyErr>(class.cast_into::<PyType>()?.unbind())
    })?;
    Ok(class.bind(py).clone())
}

impl From<Error> for PyErr {
    fn from(error: Error) -> PyErr {
        let message = error.to_string();
        match error.kind() {
            ErrorKind::Scene => SceneError::new_err(message),
            ErrorKind::Parameter => ParameterError::new_err(message),
            ErrorKind::Unsupported => UnsupportedError::new_err(message),
            ErrorKind::Memory => Python::attach(|py| match out_of_memory(py) {
                Ok(class) => PyErr::from_type(class, message),
                Err(error) => error,
            }),
            ErrorKind::Cancelled => PyKeyboardInterrupt::new_err(message),
        }
    }
}

/// The name of the SIMD level that kernels run at.
#[pyfunction]
fn simd_level() -> &'static str {
    simd::chosen().map_or("", |(name, _)| name)
}

#[pymodule]
mod _core {
    use pyo3::exceptions::PyImportError;
    use pyo3::prelude::*;

    use crate::simd;

    #[pymodule_export]
    use super::camera::PyCamera;
    #[pymodule_export]
    use super::kernels::textures::{PyTextures, textures};
    #[pymodule_export]
    use super::light::PyLight;
    #[pymodule_export]
    use super::methods::PyMethod;
    #[pymodule_export]
    use super::render::{PyPrepared, prepare};
    #[pymodule_export]
    use super::scene::PyScene;
    #[pymodule_export]
    use super::{ParameterError, SceneError, UnsupportedError, simd_level};

    #[pymodule_export]
    use super::pool::{set_threads, thread_count};

    #[pymodule_export]
    use super::kernels::kernels;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        super::run::quiet_when_exhausted();
        simd::chosen().map_err(PyImportError::new_err)?;
        module.add("OutOfMemoryError", super::out_of_memory(module.py())?)
    }

    #[pymodule_export]
    #[allow(non_upper_case_globals, reason = "the name that Python expects")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
