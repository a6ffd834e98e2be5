//! Silhouette edges of what casts.

use glam::DVec3;

/// A silhouette edge.
///
/// It runs so that, seen from the light's centre, what it occludes is on its left; where it bounds more
/// than one layer, or front and back layers differently, the numbers say so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Local positions of its ends.
    pub ends: [DVec3; 2],
    /// Indices of its ends in [`crate::geometry::Geometry::positions`].
    pub vertices: [u32; 2],
    /// Layers facing the light on its left less those on its right.
    pub front: i32,
    /// Layers facing away on its left less those on its right.
    pub back: i32,
    /// The connected object that it belongs to; edges are in the order of their objects.
    pub object: u32,
}

/// Orders edges so that, within an object, those that bound the same layers follow each other end to start
/// where they can.
pub fn in_chains(edges: &[Edge]) -> Vec<Edge> {
    let start = |e: u32| edges[e as usize].vertices[0];
    let kind = |e: u32| {
        let edge = &edges[e as usize];
        (edge.object, edge.front, edge.back)
    };
    let mut leaving: Vec<u32> = (0..edges.len() as u32).collect();
    leaving.sort_by_key(|&e| start(e));
    let mut used = vec![false; edges.len()];
    let mut out = Vec::with_capacity(edges.len());
    for first in 0..edges.len() as u32 {
        let mut next = Some(first).filter(|&e| !used[e as usize]);
        while let Some(edge) = next {
            used[edge as usize] = true;
            out.push(edges[edge as usize]);
            let end = edges[edge as usize].vertices[1];
            let from = leaving.partition_point(|&e| start(e) < end);
            let ahead = leaving[from..].iter().copied();
            next = ahead
                .take_while(|&e| start(e) == end)
                .find(|&e| !used[e as usize] && kind(e) == kind(edge));
        }
    }
    out
}
