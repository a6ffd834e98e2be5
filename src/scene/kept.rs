//! Snapshots of one kind that a scene keeps.

use std::collections::HashSet;
use std::sync::Arc;

use super::around_lights::for_lights;
use super::bytes_to_build;
use super::snapshot::Snapshot;
use crate::error::Result;
use crate::frame::Frame;
use crate::geometry::entry::{Body, Entry};
use crate::light::Light;
use crate::memory;

/// The snapshots of a scene that it keeps until something changes.
#[derive(Debug)]
pub(super) struct Kept {
    /// Whether meshes are placed.
    placed: bool,
    current: Option<Arc<Snapshot>>,
    /// A snapshot that knows what can be used again: of flat ones, one with the same entries, but for positions.
    previous: Option<Arc<Snapshot>>,
    /// The last snapshot in the frame of lights.
    around_lights: Option<Arc<Snapshot>>,
}

/// Bytes that an instance takes.
const INSTANCE: usize = 1024;

impl Kept {
    pub(super) fn new(placed: bool) -> Self {
        Kept {
            placed,
            current: None,
            previous: None,
            around_lights: None,
        }
    }

    /// The snapshot of the entries.
    pub(super) fn snapshot(&mut self, entries: &[Entry]) -> Result<Arc<Snapshot>> {
        if let Some(current) = &self.current {
            return Ok(current.clone());
        }
        memory::check(|| "scene: what is built for it".into(), self.bytes(entries))?;
        let built = Arc::new(self.build(entries, self.previous.as_deref(), None)?);
        self.previous = None;
        self.current = Some(built.clone());
        Ok(built)
    }

    /// The snapshot of the entries in the frame that `lights` want.
    pub(super) fn snapshot_for(
        &mut self,
        entries: &[Entry],
        lights: &[Light],
    ) -> Result<Arc<Snapshot>> {
        let geometry = self.snapshot(entries)?;
        let Some(frame) = for_lights(&geometry, lights)? else {
            return Ok(geometry);
        };
        let is_in =
            |g: &&Arc<Snapshot>| g.frame.origin == frame.origin && g.frame.unit == frame.unit;
        if let Some(known) = self.around_lights.as_ref().filter(is_in) {
            return Ok(known.clone());
        }
        let built = Arc::new(self.build(entries, Some(&geometry), Some(frame))?);
        // It may want a smaller frame still, but not one that is held.
        for_lights(&built, lights)?;
        self.around_lights = Some(built.clone());
        Ok(built)
    }

    /// Notes that entries have other positions; of placed meshes, that they are others.
    pub(super) fn moved(&mut self) {
        self.around_lights = None;
        if let Some(current) = self.current.take() {
            self.previous = Some(current);
        }
    }

    fn build(
        &self,
        entries: &[Entry],
        previous: Option<&Snapshot>,
        frame: Option<Frame>,
    ) -> Result<Snapshot> {
        if self.placed {
            Snapshot::placed(entries, previous, frame)
        } else {
            Snapshot::new(entries, previous, frame)
        }
    }

    /// Bytes that building takes.
    fn bytes(&self, entries: &[Entry]) -> usize {
        let meshes = entries.iter().filter_map(|e| match &e.shape {
            Body::Mesh(mesh, _) => Some(mesh),
            Body::Spheres(_) => None,
        });
        if !self.placed {
            return bytes_to_build(meshes);
        }
        let mut known = HashSet::new();
        let distinct = meshes.filter(|mesh| known.insert(Arc::as_ptr(mesh)));
        bytes_to_build(distinct) + INSTANCE * entries.len()
    }
}
