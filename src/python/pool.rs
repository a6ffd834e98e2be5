//! The threads that kernels run on.
//!
//! Rayon's own pool does not survive a fork: a child has the pool but none of its threads, and waits for them for
//! ever. So no kernel uses it. Every kernel runs inside a pool of [`Process`], which belongs to one process: a
//! child, which finds another process's, makes one of its own and leaves the old where it is (to drop it would be
//! to wait for its threads). Kernels that run at the same time have a pool each: a thread of a shared one that
//! waits for a step may take up another kernel as a whole, and that one wait for what the first has begun.

use std::sync::atomic::{AtomicPtr, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};

/// The pools of one process.
struct Process {
    id: u32,
    /// Pools that no kernel is using.
    idle: Mutex<Vec<ThreadPool>>,
    /// Kernels that are running; of a process that forked, those that ran at that time.
    running: AtomicUsize,
    /// Whether kernels ran in the parent when this process was forked.
    forked_busy: bool,
}

/// The pools of this process, or of the one that it was forked from. Never freed: kernels and children may use it.
static CURRENT: AtomicPtr<Process> = AtomicPtr::new(std::ptr::null_mut());

/// Threads a kernel, 0 where rayon chooses.
static THREADS: AtomicUsize = AtomicUsize::new(0);

/// Most threads that may be asked for.
const MOST_THREADS: usize = 1024;

impl Process {
    /// This process's pools. No lock is taken, since a fork may have left any of them locked.
    fn current() -> &'static Process {
        let id = std::process::id();
        loop {
            let found = CURRENT.load(Ordering::Acquire);
            // SAFETY: it is null or was leaked below.
            let known = unsafe { found.as_ref() };
            if let Some(known) = known.filter(|p| p.id == id) {
                return known;
            }
            let made = Box::into_raw(Box::new(Process {
                id,
                idle: Mutex::default(),
                running: AtomicUsize::new(0),
                forked_busy: known.is_some_and(Process::is_busy),
            }));
            let order = (Ordering::AcqRel, Ordering::Acquire);
            if CURRENT
                .compare_exchange(found, made, order.0, order.1)
                .is_err()
            {
                // SAFETY: it was made above, and nobody else has seen it.
                drop(unsafe { Box::from_raw(made) });
            }
        }
    }

    fn is_busy(&self) -> bool {
        self.forked_busy || self.running.load(Ordering::Acquire) > 0
    }

    /// A pool of as many threads as are wanted now.
    fn take(&self) -> Result<ThreadPool> {
        let threads = threads();
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        // Others are of a number of threads that is not wanted any more; dropping them ends their threads.
        idle.retain(|pool| pool.current_num_threads() == threads);
        if let Some(pool) = idle.pop() {
            return Ok(pool);
        }
        drop(idle);
        let named = |i| format!("softshadow {i}");
        let built = ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(named);
        built.build().map_err(|error| {
            Error::Exhausted(format!(
                "{threads} threads cannot be started ({error}); see softshadow.set_threads"
            ))
        })
    }
}

/// Threads that a kernel has.
fn threads() -> usize {
    match THREADS.load(Ordering::Relaxed) {
        0 => chosen(),
        set => set,
    }
}

/// As many threads as rayon would take: `RAYON_NUM_THREADS`, or what the machine gives this process.
fn chosen() -> usize {
    let set = std::env::var("RAYON_NUM_THREADS").ok();
    let set = set
        .and_then(|text| text.trim().parse().ok())
        .filter(|&n| n > 0);
    let machine = || std::thread::available_parallelism().map_or(1, usize::from);
    set.unwrap_or_else(machine).min(MOST_THREADS)
}

/// A kernel's use of a pool; gives it back, also after a panic.
struct Held {
    process: &'static Process,
    pool: Option<ThreadPool>,
}

impl Drop for Held {
    fn drop(&mut self) {
        let idle = &self.process.idle;
        if let Some(pool) = self.pool.take() {
            idle.lock()
                .unwrap_or_else(PoisonError::into_inner)
                .push(pool);
        }
        self.process.running.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Runs a kernel within a pool, where its parallel steps start without being handed over.
///
/// # Errors
/// The kernel's own, or threads that cannot be started.
pub(super) fn run<T: Send>(work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    let process = Process::current();
    process.running.fetch_add(1, Ordering::AcqRel);
    let mut held = Held {
        process,
        pool: None,
    };
    let pool = held.pool.insert(process.take()?);
    pool.install(work)
}

/// When something was made that kernels may be building further.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Origin(u32);

impl Origin {
    /// Made now, in this process.
    pub(super) fn here() -> Self {
        Origin(std::process::id())
    }

    /// Whether it may be half built for ever: it is a parent's, and kernels were running there at the fork.
    pub(super) fn is_torn(self) -> bool {
        self != Origin::here() && Process::current().forked_busy
    }
}

/// What to say of it.
pub(super) fn torn(what: &str) -> Error {
    let reason = "this process was forked while another thread of its parent was using softshadow; make it anew \
                  here, or start processes by \"spawn\" or \"forkserver\"";
    Error::scene(what, reason)
}

/// Sets how many threads each kernel has, 0: `RAYON_NUM_THREADS`, or as many as the machine has.
#[pyfunction]
pub(super) fn set_threads(count: usize) -> Result<usize> {
    if count > MOST_THREADS {
        let reason = format!("expected 1 to {MOST_THREADS}, got {count}");
        return Err(Error::parameter("threads", reason));
    }
    Ok(THREADS.swap(count, Ordering::Relaxed))
}

/// How many threads each kernel has.
#[pyfunction]
pub(super) fn thread_count() -> usize {
    threads()
}
