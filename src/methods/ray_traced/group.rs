//! The silhouette edges that matter to a group of receivers.
//!
//! The hierarchy gives the edges in the shaft from the group to the light that can be silhouettes. For
//! each, sixteen receivers at a time, it is then decided for which receivers the edge may be a silhouette
//! (its two triangles are not certainly on different hands) and may cross the light.

use glam::Vec3;

use super::grid::SeenEdge;
use super::{MOST_EDGES, relative};
use crate::bvh::TriangleBvh;
use crate::bvh::outline::{ALWAYS, Edge, Shaft, normal};
use crate::geometry::Geometry;
use crate::receivers::GROUP;
use crate::sampling::{Sampler, View};
use crate::simd::{LANES, Lanes, Row, detect, dispatch};

const ROWS: usize = GROUP / LANES;

/// Rounding of a dot product of three terms, of its factors, and of the difference that one of them is:
/// fewer than 8 rounding errors (2⁻²⁴) of the product of their sizes.
const DOT_ERROR: f32 = 8.0 / (1 << 24) as f32;

/// What a thread knows of the group that it works on.
#[derive(Default)]
pub(super) struct Group {
    candidates: Vec<u32>,
    stack: Vec<u32>,
    edges: Vec<EdgePlanes>,
    /// For every edge the receivers that must heed it, a bit each.
    heed: Vec<u64>,
    views: Vec<Option<View>>,
    origins: Vec<Vec3>,
    lanes: Box<Receiver>,
}

/// An edge with the normals of its two triangles, both as seen from the same side.
#[derive(Debug, Clone, Copy)]
struct EdgePlanes {
    ends: [Vec3; 2],
    normals: [Vec3; 2],
}

/// Receivers and their views of the light, lane by lane.
#[derive(Debug, Clone, Default)]
struct Receiver {
    origin: [[Row; ROWS]; 3],
    u: [[Row; ROWS]; 3],
    v: [[Row; ROWS]; 3],
    w: [[Row; ROWS]; 3],
    steepness: [Row; ROWS],
    valid: [u16; ROWS],
}

impl Group {
    /// Finds the edges for receivers whose rays start at `origins`. False: culling does not pay or
    /// apply here.
    pub(super) fn collect(
        &mut self,
        geometry: &Geometry,
        sampler: &Sampler,
        origins: &[Vec3],
    ) -> bool {
        self.edges.clear();
        self.views.clear();
        self.views.extend(origins.iter().map(|o| sampler.view(o.as_dvec3())));
        self.origins.clear();
        self.origins.extend_from_slice(origins);
        // Receivers that the light does not face have no say in the shaft.
        let facing = || self.views.iter().zip(origins).filter(|(v, _)| v.is_some()).map(|(_, o)| *o);
        let low = facing().fold(Vec3::INFINITY, Vec3::min);
        let high = facing().fold(Vec3::NEG_INFINITY, Vec3::max);
        if low.x > high.x {
            return false;
        }
        let light = sampler.light().bounds();
        let shaft = Shaft::new((low, high), (light.0.as_vec3(), light.1.as_vec3()));
        let occluders = geometry.occluders();
        if let Some(spheres) = &occluders.spheres {
            if spheres.tree.nodes.iter().any(|n| n.count > 0 && shaft.meets(n)) {
                return false;
            }
        }
        let transparent = occluders.transparent.as_ref().map(|(bvh, _)| bvh);
        let found = [Some(&occluders.opaque), transparent]
            .into_iter()
            .flatten()
            .all(|bvh| self.collect_from(geometry, bvh, &shaft));
        if found {
            self.find_heeded();
        }
        found
    }

    fn collect_from(&mut self, geometry: &Geometry, bvh: &TriangleBvh, shaft: &Shaft) -> bool {
        let outline = bvh.outline(geometry);
        self.candidates.clear();
        let limit = MOST_EDGES - self.edges.len().min(MOST_EDGES);
        let nodes = &bvh.tree.nodes;
        if !outline.candidates(nodes, shaft, limit, &mut self.stack, &mut self.candidates) {
            return false;
        }
        let planes = self.candidates.iter().map(|&e| planes(geometry, outline.edge(e)));
        self.edges.extend(planes);
        true
    }

    /// Whether receiver `k` sees the light in a way that a grid can be laid over.
    pub(super) fn has_view(&self, k: usize) -> bool {
        self.views[k].is_some()
    }

    /// The edges that receiver `k` must heed.
    pub(super) fn edges(&self, k: usize) -> impl Iterator<Item = SeenEdge> {
        let origin = self.origins[k];
        let view = self.views[k].unwrap_or_default();
        self.heed.iter().zip(&self.edges).filter(move |(heed, _)| *heed >> k & 1 == 1).map(
            move |(_, edge)| SeenEdge { view, ends: edge.ends.map(|p| relative(p, origin)) },
        )
    }

    fn find_heeded(&mut self) {
        let lanes = &mut *self.lanes;
        lanes.valid = [0; ROWS];
        for (k, (view, origin)) in self.views.iter().zip(&self.origins).enumerate() {
            let (row, lane) = (k / LANES, k % LANES);
            let view = view.unwrap_or_default();
            for axis in 0..3 {
                lanes.origin[axis][row].0[lane] = origin[axis];
                lanes.u[axis][row].0[lane] = view.u[axis];
                lanes.v[axis][row].0[lane] = view.v[axis];
                lanes.w[axis][row].0[lane] = view.w[axis];
            }
            let l1 = |x: Vec3| x.abs().element_sum();
            lanes.steepness[row].0[lane] = l1(view.u).max(l1(view.v)).max(l1(view.w));
            lanes.valid[row] |= u16::from(self.views[k].is_some()) << lane;
        }
        self.heed.clear();
        self.heed.resize(self.edges.len(), 0);
        let (edges, heed, receivers) = (&self.edges[..], &mut self.heed[..], &*self.lanes);
        dispatch!(detect() => heeded(
            edges: &[EdgePlanes], receivers: &Receiver, heed: &mut [u64]));
    }
}

fn planes(geometry: &Geometry, edge: &Edge) -> EdgePlanes {
    let at = |v: u32| geometry.positions[v as usize];
    let [a, b] = edge.ends.map(at);
    // A zero normal puts every receiver within doubt of the plane.
    let normals = if edge.opposite[0] == ALWAYS {
        [Vec3::ZERO; 2]
    } else {
        // Each triangle runs through the edge in its own direction, so that a flat pair has equal
        // normals whatever its winding.
        [normal([a, b, at(edge.opposite[0])]), normal([b, a, at(edge.opposite[1])])]
    };
    EdgePlanes { ends: [a, b], normals }
}

#[inline(always)]
unsafe fn heeded<S: Lanes>(edges: &[EdgePlanes], receivers: &Receiver, heed: &mut [u64]) {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let zero = S::splat(0.0);
        for row in 0..ROWS {
            if receivers.valid[row] == 0 {
                continue;
            }
            let load = |v: &[[Row; ROWS]; 3]| [0, 1, 2].map(|k| S::load(&v[k][row]));
            let (origin, u, v, w) =
                (load(&receivers.origin), load(&receivers.u), load(&receivers.v), load(&receivers.w));
            let steepness = S::load(&receivers.steepness[row]);
            let dot = |a: &[S; 3], b: &[S; 3]| {
                a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
            };
            let splat = |p: Vec3| [S::splat(p.x), S::splat(p.y), S::splat(p.z)];
            let from = |p: Vec3| {
                [0, 1, 2].map(|k| S::splat(p[k]).sub(origin[k]))
            };
            let size = |p: &[S; 3]| p[0].abs().add(p[1].abs()).add(p[2].abs());
            for (edge, heed) in edges.iter().zip(heed.iter_mut()) {
                let (a, b) = (from(edge.ends[0]), from(edge.ends[1]));
                let (size_a, size_b) = (size(&a), size(&b));
                // Certainly in front of both triangles, or behind both.
                let doubt = size_a.mul(S::splat(DOT_ERROR));
                let negative = zero.sub(doubt);
                let one = dot(&a, &splat(edge.normals[0]));
                let two = dot(&a, &splat(edge.normals[1]));
                let goes_on = doubt.lt(one.min(two)) | one.max(two).lt(negative);
                let open = receivers.valid[row] & !goes_on;
                if open == 0 {
                    continue;
                }
                // Certainly to one side of the light, or beyond it.
                let doubt = size_a.max(size_b).mul(steepness).mul(S::splat(2.0 * DOT_ERROR));
                let negative = zero.sub(doubt);
                let (ua, va, wa) = (dot(&a, &u), dot(&a, &v), dot(&a, &w));
                let (ub, vb, wb) = (dot(&b, &u), dot(&b, &v), dot(&b, &w));
                let one = S::splat(1.0);
                let outside = ua.max(ub).lt(negative)
                    | va.max(vb).lt(negative)
                    | wa.sub(ua).max(wb.sub(ub)).lt(negative)
                    | wa.sub(va).max(wb.sub(vb)).lt(negative)
                    | one.add(doubt).lt(wa.min(wb));
                *heed |= u64::from(open & !outside) << (row * LANES);
            }
        }
    }
}
