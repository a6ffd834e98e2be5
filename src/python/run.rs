//! Running kernels: without the interpreter lock, with answers to Ctrl-C and reports of progress.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, mpsc};
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use super::{allocator, pool};
use crate::control::Control;
use crate::error::{Error, Result};
use crate::memory;

/// How often a running kernel's caller looks for Ctrl-C and reports progress: two chances within the
/// 0.2 s in which an interrupt must be answered.
const POLL: Duration = Duration::from_millis(50);

/// Keeps panics for the want of memory from being told on standard error: telling takes memory, and whoever runs out of
/// it while the stack is being told waits for ever.
pub(super) fn quiet_when_exhausted() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !memory::exhausted() {
            usual(info);
        }
    }));
}

/// Runs a kernel on another thread without the interpreter lock.
///
/// Meanwhile this thread looks for signals and tells `progress` the finished fraction; an interrupt, or
/// an exception from `progress`, stops the kernel and is what the caller gets. A kernel that is inside a
/// step without an end of its own (the building of a large hierarchy) is left to finish on its thread,
/// its result dropped.
pub(super) fn run<T: Send + 'static>(
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

fn no_threads(error: std::io::Error) -> PyErr {
    Error::Exhausted(format!("a thread cannot be started ({error})")).into()
}

/// Runs a short step of a call, one that uses several threads, without the interpreter lock.
pub(super) fn step<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<T> {
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
