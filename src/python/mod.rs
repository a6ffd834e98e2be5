//! The bindings, the only folder that knows PyO3 and NumPy.
//!
//! - this file: the module, the exceptions, and [`run`], which releases the interpreter lock, answers
//!   Ctrl-C and reports progress;
//! - [`arrays`]: NumPy arrays to vectors of points and back;
//! - [`objects`]: scene, camera, light and method objects;
//! - [`render`]: preparing and rendering;
//! - [`kernels`]: the pieces, as functions from arrays to arrays.

mod arrays;
mod kernels;
mod objects;
mod render;

use std::sync::mpsc;
use std::time::Duration;

use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::control::Control;
use crate::error::{Error, Kind, Result};

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

/// How often a running kernel's caller looks for Ctrl-C and reports progress: two chances within the
/// 0.2 s in which an interrupt must be answered.
const POLL: Duration = Duration::from_millis(50);

impl From<Error> for PyErr {
    fn from(error: Error) -> PyErr {
        let message = error.to_string();
        match error.kind() {
            Kind::Scene => SceneError::new_err(message),
            Kind::Parameter => ParameterError::new_err(message),
            Kind::Unsupported => UnsupportedError::new_err(message),
            Kind::Cancelled => PyKeyboardInterrupt::new_err(message),
        }
    }
}

/// Runs a kernel on another thread without the interpreter lock.
///
/// Meanwhile this thread looks for signals and tells `progress` the finished fraction; an interrupt, or
/// an exception from `progress`, stops the kernel and is what the caller gets.
fn run<T: Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Control) -> Result<T> + Send,
) -> PyResult<T> {
    let control = Control::default();
    let mut interrupted: Option<PyErr> = None;
    let result = py.detach(|| {
        std::thread::scope(|scope| {
            let (finished, wait) = mpsc::channel::<()>();
            let control = &control;
            let worker = scope.spawn(move || {
                let result = work(control);
                drop(finished);
                result
            });
            while let Err(mpsc::RecvTimeoutError::Timeout) = wait.recv_timeout(POLL) {
                if interrupted.is_some() {
                    continue;
                }
                let seen = Python::attach(|py| {
                    py.check_signals()?;
                    if let Some(progress) = progress {
                        progress.call1(py, (control.fraction(),))?;
                    }
                    Ok(())
                });
                if let Err(error) = seen {
                    interrupted = Some(error);
                    control.cancel();
                }
            }
            worker.join()
        })
    });
    if let Some(error) = interrupted {
        return Err(error);
    }
    match result {
        Ok(value) => Ok(value?),
        Err(panic) => {
            let text = panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or(panic.downcast_ref::<&str>().copied())
                .unwrap_or("no message");
            Err(PyRuntimeError::new_err(format!(
                "internal error, please report it: {text}"
            )))
        }
    }
}

#[pymodule]
mod _core {
    #[pymodule_export]
    use super::objects::{PyCamera, PyLight, PyMethod, PyScene};
    #[pymodule_export]
    use super::render::{PyPrepared, prepare};
    #[pymodule_export]
    use super::{ParameterError, SceneError, UnsupportedError};

    #[pymodule_export]
    use super::kernels::kernels;

    #[pymodule_export]
    #[allow(non_upper_case_globals, reason = "the name that Python expects")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
