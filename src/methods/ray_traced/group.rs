//! The silhouette edges that matter to a group of receivers.
//!
//! The hierarchy gives the edges in the shaft from the group to the light that can be silhouettes;
//! `project` finds what each receiver sees of them.

use glam::Vec3;

use super::grid::Cells;
use super::project::{Images, Viewers};
use super::{EDGES_A_SAMPLE, MOST_EDGES};
use crate::bvh::TriangleBvh;
use crate::bvh::outline::{EdgePlanes, Shaft};
use crate::geometry::Geometry;
use crate::sampling::shaft::{GroupShaft, Middle};
use crate::sampling::{GRID, LightProjection, Sampler};
use crate::scene::snapshot::Snapshot;

/// What became of a search for edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum SearchResult {
    /// All edges that matter are known.
    All,
    /// There are too many; halving the receivers here may help.
    Split(Middle),
    /// There are too many, and halving the receivers would not help.
    TooMany,
    /// Culling does not apply here.
    NotHere,
}

/// A group is halved only while it is wider than this part of the light: below, its shaft is mostly the
/// light's own width.
const WIDE: f32 = 0.1;

/// For how many groups at most [`Pause`] lasts: so many that searching costs little where all groups have
/// too many edges, and that all of them are one row of an image.
const LONGEST_PAUSE: u32 = 16;

/// When not to search for edges: a while after groups that had too many, whose neighbours have so, too.
/// It doubles with each of them.
#[derive(Debug, Default)]
pub(super) struct Pause {
    left: u32,
    length: u32,
}

impl Pause {
    /// Whether it is over; the group that asks is one of those that it lasts for.
    pub(super) fn is_over(&mut self) -> bool {
        let over = self.left == 0;
        self.left = self.left.saturating_sub(1);
        over
    }

    /// Takes what became of a search.
    pub(super) fn searched(&mut self, too_many: bool) {
        self.length = if too_many {
            (2 * self.length).clamp(1, LONGEST_PAUSE)
        } else {
            0
        };
        self.left = self.length;
    }
}

/// What a receiver sees of the edges before the light.
pub(super) enum EdgeCells<'a> {
    /// The light cannot be seen as a grid, or an edge comes too close.
    Unclear,
    /// There are none.
    NoEdge,
    /// They touch these cells of the grid.
    Edges(&'a [Cells; GRID]),
}

/// What a thread knows of the group that it works on.
#[derive(Default)]
pub(super) struct Group {
    stack: Vec<u32>,
    edges: Vec<EdgePlanes>,
    views: Vec<Option<LightProjection>>,
    viewers: Box<Viewers>,
    images: Box<Images>,
}

impl Group {
    /// Finds the edges for receivers whose rays start at `origins`.
    pub(super) fn collect(
        &mut self,
        geometry: &Snapshot,
        sampler: &Sampler,
        origins: &[Vec3],
    ) -> SearchResult {
        self.edges.clear();
        let Some(group) = GroupShaft::new(sampler, origins, &mut self.views) else {
            return SearchResult::NotHere;
        };
        let shaft = &group.shaft;
        let occluders = geometry.occluders();
        let spheres = occluders.spheres.as_ref();
        if spheres.is_some_and(|s| s.tree.any_leaf(|node| shaft.meets(node))) {
            return SearchResult::NotHere;
        }
        let most = (EDGES_A_SAMPLE * sampler.len()).min(MOST_EDGES);
        let transparent = occluders.transparent.as_ref().map(|(bvh, _)| bvh);
        let found = [Some(&occluders.opaque), transparent]
            .into_iter()
            .flatten()
            .all(|bvh| self.collect_from(geometry, bvh, shaft, most));
        if found {
            self.viewers.set(&self.views, origins);
            self.viewers.project(&self.edges, &mut self.images);
            return SearchResult::All;
        }
        group
            .middle(WIDE)
            .map_or(SearchResult::TooMany, SearchResult::Split)
    }

    /// Adds the edges of one hierarchy; false where there would be more than `most` in all.
    fn collect_from(
        &mut self,
        geometry: &Geometry,
        bvh: &TriangleBvh,
        shaft: &Shaft,
        most: usize,
    ) -> bool {
        let outline = bvh.outline(geometry);
        let nodes = &bvh.tree.nodes;
        let edges = &mut self.edges;
        let most = most - edges.len();
        let mut take = |edge: &EdgePlanes, _| {
            edges.push(*edge);
            1
        };
        outline.candidates(nodes, shaft, most, &mut self.stack, &mut take)
    }

    /// What edges cover of the light that receiver `k` sees.
    pub(super) fn seen_by(&self, k: usize) -> EdgeCells<'_> {
        if self.views[k].is_none() || self.images.unclear >> k & 1 == 1 {
            EdgeCells::Unclear
        } else if self.images.touched >> k & 1 == 0 {
            EdgeCells::NoEdge
        } else {
            EdgeCells::Edges(&self.images.marked[k])
        }
    }
}
