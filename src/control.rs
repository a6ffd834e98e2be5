//! Progress and cancellation, shared between a running kernel and whoever waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::error::{Error, Result};
use crate::memory;

/// Counts finished work items and carries the wish to stop.
///
/// Kernels call [`Control::step`] once a tile, a few hundred times a second, so the atomics cost
/// nothing next to the work.
#[derive(Debug, Default)]
pub struct Control {
    done: AtomicUsize,
    total: AtomicUsize,
    cancelled: Arc<AtomicBool>,
}

impl Control {
    /// A control for a part of the job that reports no progress: it stops when this one is cancelled.
    pub fn silent(&self) -> Self {
        Control {
            cancelled: self.cancelled.clone(),
            ..Control::default()
        }
    }

    /// Announces `items` more work items.
    pub fn expect(&self, items: usize) {
        self.total.fetch_add(items, Ordering::Relaxed);
    }

    /// Marks `items` work items as finished, such as those that turned out not to be needed.
    pub fn advance(&self, items: usize) {
        self.done.fetch_add(items, Ordering::Relaxed);
    }

    /// Marks one work item as finished.
    ///
    /// # Errors
    /// [`Error::Cancelled`] once [`Control::cancel`] was called.
    pub fn step(&self) -> Result<()> {
        self.advance(1);
        self.check()
    }

    /// Returns [`Error::Cancelled`] once [`Control::cancel`] was called.
    ///
    /// # Errors
    /// As said, and [`Error::Exhausted`] once memory has run out.
    pub fn check(&self) -> Result<()> {
        if self.cancelled.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        if memory::exhausted() {
            return Err(Error::Exhausted("the reserve was needed".into()));
        }
        Ok(())
    }

    /// Asks the kernel to stop at its next step.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Finished fraction, 0 to 1.
    pub fn fraction(&self) -> f64 {
        let total = self.total.load(Ordering::Relaxed).max(1);
        (self.done.load(Ordering::Relaxed) as f64 / total as f64).min(1.0)
    }
}
