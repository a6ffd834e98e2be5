//! The one error type of the core.
//!
//! Every message names the thing, where it is and what is allowed. The Python bridge maps each
//! variant to an exception class ([`Error::kind`]); kernels return `Result` and never panic on input.

use std::fmt::Display;
use std::ops::RangeInclusive;

use thiserror::Error;

/// What can be wrong with what a caller passes in.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum Error {
    /// A mesh without faces.
    #[error("mesh {mesh:?}: it has no faces ({vertices} vertices)")]
    EmptyMesh {
        /// Name of the mesh.
        mesh: String,
        /// Its vertices.
        vertices: usize,
    },
    /// A mesh whose faces all lie in one point.
    #[error("mesh {mesh:?}: it has no extent, all {faces} faces lie in the point {point:?}")]
    NoExtent {
        /// Name of the mesh.
        mesh: String,
        /// Its faces.
        faces: usize,
        /// Their common place.
        point: [f64; 3],
    },
    /// A NaN or infinite coordinate.
    #[error("{what}: {item} {index} is not finite: {value:?}")]
    NotFinite {
        /// What holds it, for example `mesh "bunny"`.
        what: String,
        /// What it is: a vertex, a point, a normal.
        item: &'static str,
        /// Which one.
        index: usize,
        /// Its coordinates.
        value: [f64; 3],
    },
    /// A face that refers to a vertex that does not exist.
    #[error(
        "mesh {mesh:?}: face {face} refers to vertex {index}, allowed are 0 to {last} ({count} vertices)",
        last = count.saturating_sub(1)
    )]
    FaceIndex {
        /// Name of the mesh.
        mesh: String,
        /// The face.
        face: usize,
        /// The index it holds.
        index: i64,
        /// How many vertices there are.
        count: usize,
    },
    /// An array, scene or map larger than its index type or memory.
    #[error("{what}: {count} {items} are more than the {limit} that fit")]
    TooLarge {
        /// What is too large.
        what: String,
        /// How many there are.
        count: usize,
        /// What is counted, such as `"points"`.
        items: &'static str,
        /// How many fit.
        limit: usize,
    },
    /// Anything else that is wrong with a scene or one of its entries.
    #[error("{what}: {reason}")]
    Scene {
        /// What it concerns, for example `mesh "bunny"`.
        what: String,
        /// What is wrong and what is allowed.
        reason: String,
    },
    /// A light, camera or method parameter out of its range.
    #[error("{what}: {reason}")]
    Parameter {
        /// What it concerns, for example `RectLight`.
        what: String,
        /// What is wrong and what is allowed.
        reason: String,
    },
    /// Something that a method cannot do.
    #[error("method {method:?}: {reason}")]
    Unsupported {
        /// Name of the method.
        method: &'static str,
        /// What it cannot do, and what to do instead.
        reason: String,
    },
    /// More memory than there is.
    #[error("{what} takes {gigabytes:.1} GB, more than there is", gigabytes = *bytes as f64 / 1e9)]
    Memory {
        /// What takes it.
        what: String,
        /// Bytes that it takes at the same time.
        bytes: usize,
    },
    /// Memory ran out in the middle of a step, or threads could not be started for the want of it.
    #[error("there is no memory left: {0}")]
    Exhausted(String),
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
}

/// Which exception an error becomes in Python.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// `softshadow.SceneError`
    Scene,
    /// `softshadow.ParameterError`
    Parameter,
    /// `softshadow.UnsupportedError`
    Unsupported,
    /// `softshadow.OutOfMemoryError`
    Memory,
    /// `KeyboardInterrupt`, or what the progress callback raised
    Cancelled,
}

/// Checks that parameter `name` of `method` is in its range; a range up to [`f64::MAX`] has no end.
///
/// # Errors
/// [`Error::Parameter`].
pub fn in_range<T: PartialOrd + Display + Into<f64> + Copy>(
    method: &str,
    name: &str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<()> {
    if range.contains(&value) {
        return Ok(());
    }
    let (low, high) = (range.start(), range.end());
    let allowed = if (*high).into() == f64::MAX {
        format!("a finite number of at least {low}")
    } else {
        format!("{low} to {high}")
    };
    let reason = format!("{name} must be {allowed}, got {value}");
    Err(Error::parameter(method, reason))
}

impl Error {
    /// Returns the class of exception that this error becomes.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Error::Parameter { .. } => ErrorKind::Parameter,
            Error::Unsupported { .. } => ErrorKind::Unsupported,
            Error::Memory { .. } | Error::Exhausted(_) => ErrorKind::Memory,
            Error::Cancelled => ErrorKind::Cancelled,
            _ => ErrorKind::Scene,
        }
    }

    /// Shorthand for [`Error::Parameter`].
    pub fn parameter(what: impl Into<String>, reason: impl Into<String>) -> Self {
        Error::Parameter {
            what: what.into(),
            reason: reason.into(),
        }
    }

    /// Shorthand for [`Error::Scene`].
    pub fn scene(what: impl Into<String>, reason: impl Into<String>) -> Self {
        Error::Scene {
            what: what.into(),
            reason: reason.into(),
        }
    }
}

/// Result of a fallible core function.
pub type Result<T> = std::result::Result<T, Error>;
