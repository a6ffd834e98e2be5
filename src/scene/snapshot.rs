//! A scene's geometry with its hierarchies.

use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use glam::DVec3;

use crate::bvh::Occluders;
use crate::error::Result;
use crate::frame::Frame;
use crate::geometry::Geometry;
use crate::geometry::entry::Entry;

/// What methods work on: geometry that does not change, and hierarchies that are built when first asked for.
#[derive(Debug)]
pub struct Snapshot {
    geometry: Geometry,
    occluders: OnceLock<Occluders>,
    /// Hierarchies of the same entries at other positions, to be refitted.
    inherited: Option<Occluders>,
}

impl Snapshot {
    /// Takes `entries` as they are, in a given frame or in one that fits them. `previous`, if given, has the same
    /// entries at other positions.
    ///
    /// # Errors
    /// The errors of [`Geometry::new`].
    pub fn new(
        entries: &[Entry],
        previous: Option<&Snapshot>,
        frame: Option<Frame>,
    ) -> Result<Self> {
        let known = previous.and_then(|p| p.occluders.get().or(p.inherited.as_ref()));
        Ok(Snapshot {
            geometry: Geometry::new(entries, frame)?,
            occluders: OnceLock::new(),
            inherited: known.cloned(),
        })
    }

    /// As [`Snapshot::new`], with meshes left where they are stored and placed as instances. `previous` may have any
    /// entries: what it knows of the same meshes is kept.
    ///
    /// # Errors
    /// The errors of [`Geometry::with_placed_meshes`].
    pub fn placed(
        entries: &[Entry],
        previous: Option<&Snapshot>,
        frame: Option<Frame>,
    ) -> Result<Self> {
        let known = previous.and_then(|p| p.occluders.get().or(p.inherited.as_ref()));
        Ok(Snapshot {
            geometry: Geometry::with_placed_meshes(entries, previous.map(|p| &p.geometry), frame)?,
            occluders: OnceLock::new(),
            inherited: known.cloned(),
        })
    }

    /// A snapshot with all triangles moved by `f` ([`Geometry::mapped`]).
    pub fn mapped(&self, f: impl Fn(DVec3) -> DVec3 + Sync) -> Arc<Self> {
        Arc::new(Snapshot {
            geometry: self.geometry.mapped(f),
            occluders: OnceLock::new(),
            inherited: None,
        })
    }

    /// The hierarchies, if something has asked for them.
    pub fn built_occluders(&self) -> Option<&Occluders> {
        self.occluders.get()
    }

    /// The hierarchies over everything that casts; built (or refitted) at the first call.
    pub fn occluders(&self) -> &Occluders {
        self.occluders.get_or_init(|| match &self.inherited {
            known if self.placed => Occluders::placed(self, known.as_ref()),
            Some(known) => known.refitted(self),
            None => Occluders::new(self),
        })
    }
}

impl Deref for Snapshot {
    type Target = Geometry;

    fn deref(&self) -> &Geometry {
        &self.geometry
    }
}
