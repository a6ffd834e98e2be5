//! The bindings, the only folder that knows PyO3 and NumPy.
//!
//! - this file: the module, the exceptions, and [`run`], which releases the interpreter lock, answers
//!   Ctrl-C and reports progress;
//! - [`pool`]: the threads that kernels run on, also in a process that was forked;
//! - [`arrays`]: NumPy arrays to vectors of points and back;
//! - [`filtered`]: the parameters of the rivals of ray-traced layered maps;
//! - [`layered`]: ray-traced layered maps;
//! - [`objects`]: scene, camera, light and method objects;
//! - [`render`]: preparing and rendering;
//! - [`kernels`]: the pieces, as functions from arrays to arrays;
//! - [`accumulation`]: receiver polygons' textures;
//! - [`single_sample`]: those of single sample soft shadows;
//! - [`ssoc`]: those of the soft shadow occlusion camera;
//! - [`wedges`]: those of penumbra wedges.

mod accumulation;
mod allocator;
mod arrays;
mod filtered;
mod kernels;
mod layered;
mod objects;
mod pool;
mod render;
mod single_sample;
mod ssoc;
mod wedges;

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, mpsc};
use std::time::Duration;

use pyo3::create_exception;
use pyo3::exceptions::{PyKeyboardInterrupt, PyMemoryError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyType};

use crate::control::Control;
use crate::error::{Error, Kind, Result};
use crate::memory;
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
            Kind::Memory => Python::attach(|py| match out_of_memory(py) {
                Ok(class) => PyErr::from_type(class, message),
                Err(error) => error,
            }),
            Kind::Cancelled => PyKeyboardInterrupt::new_err(message),
        }
    }
}

/// Runs a kernel on another thread without the interpreter lock.
///
/// Meanwhile this thread looks for signals and tells `progress` the finished fraction; an interrupt, or
/// an exception from `progress`, stops the kernel and is what the caller gets. A kernel that is inside a
/// step without an end of its own (the building of a large hierarchy) is left to finish on its thread,
/// its result dropped.
fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Control) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    // What has to be there before anything that takes memory.
    allocator::take_reserve();
    let control = Arc::new(Control::default());
    let (finished, mut wait) = mpsc::channel();
    let shared = control.clone();
    std::thread::Builder::new()
        .name("softshadow".into())
        .spawn(move || {
            let result = catch_unwind(AssertUnwindSafe(|| pool::run(|| work(&shared))));
            // Nobody listens any more when the caller was interrupted.
            let _ = finished.send(result);
        })
        .map_err(no_threads)?;
    loop {
        // Exclusive, since a receiver may only be used by one thread at a time.
        let exclusive = &mut wait;
        match py.detach(move || exclusive.recv_timeout(POLL)) {
            Ok(Ok(result)) => return Ok(result?),
            // What libraries do not expect to be refused.
            Ok(Err(_)) if memory::exhausted() => {
                return Err(Error::Exhausted("a step needed more than was left".into()).into());
            }
            Ok(Err(panic)) => return Err(internal_error(panic.as_ref())),
            Err(mpsc::RecvTimeoutError::Disconnected) => return Err(internal_error(&"no result")),
            Err(mpsc::RecvTimeoutError::Timeout) => {}
        }
        let told = progress.map_or(Ok(()), |p| p.call1(py, (control.fraction(),)).map(drop));
        if let Err(error) = py.check_signals().and(told) {
            control.cancel();
            // Most kernels stop within a step; then nothing of theirs runs on behind the caller's back.
            let exclusive = &mut wait;
            let _ = py.detach(move || exclusive.recv_timeout(2 * POLL));
            return Err(error);
        }
    }
}

/// Keeps panics for the want of memory from being told on standard error: telling takes memory, and whoever runs out of
/// it while the stack is being told waits for ever.
fn quiet_when_exhausted() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !memory::exhausted() {
            usual(info);
        }
    }));
}

fn no_threads(error: std::io::Error) -> PyErr {
    Error::Exhausted(format!("a thread cannot be started ({error})")).into()
}

/// Runs a short step of a call, one that uses several threads, without the interpreter lock.
fn step<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    allocator::take_reserve();
    let caught = || catch_unwind(AssertUnwindSafe(|| pool::run(work)));
    match py.detach(caught) {
        Ok(result) => Ok(result?),
        Err(_) if memory::exhausted() => {
            Err(Error::Exhausted("a step needed more than was left".into()).into())
        }
        Err(panic) => Err(internal_error(panic.as_ref())),
    }
}

/// What a panic becomes: it is a defect here, never the caller's.
fn internal_error(panic: &(dyn Any + Send)) -> PyErr {
    let text = panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or(panic.downcast_ref::<&str>().copied())
        .unwrap_or("no message");
    PyRuntimeError::new_err(format!("internal error, please report it: {text}"))
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
    use super::accumulation::{PyTextures, textures};
    #[pymodule_export]
    use super::objects::{PyCamera, PyLight, PyMethod, PyScene};
    #[pymodule_export]
    use super::render::{PyPrepared, prepare};
    #[pymodule_export]
    use super::{ParameterError, SceneError, UnsupportedError, simd_level};

    #[pymodule_export]
    use super::pool::{set_threads, thread_count};

    #[pymodule_export]
    use super::kernels::kernels;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        super::quiet_when_exhausted();
        simd::chosen().map_err(PyImportError::new_err)?;
        module.add("OutOfMemoryError", super::out_of_memory(module.py())?)
    }

    #[pymodule_export]
    #[allow(non_upper_case_globals, reason = "the name that Python expects")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
