//! The silhouette edges that matter to a group of receivers.
//!
//! The hierarchy gives the edges in the shaft from the group to the light that can be silhouettes. For
//! each, sixteen receivers at a time, it is then decided for which receivers the edge may be a silhouette
//! (its two triangles are not certainly on different hands) and may cross the light.

use glam::Vec3;

use super::grid::SeenEdge;
use super::{MOST_EDGES, relative};
use crate::bvh::TriangleBvh;
use crate::bvh::outline::{EdgePlanes, Shaft};
use crate::geometry::Geometry;
use crate::receivers::GROUP;
use crate::sampling::{Sampler, View};
use crate::simd::{LANES, Lanes, Row, detect, dispatch};

const ROWS: usize = GROUP / LANES;

/// Rounding of a dot product of three terms, of its factors, and of the difference that one of them is:
/// fewer than 8 rounding errors (2⁻²⁴) of the product of their sizes.
const DOT_ERROR: f32 = 8.0 / (1 << 24) as f32;

/// A group is halved only while it is wider than this part of the light: below, its shaft is mostly the
/// light's own width.
const WIDE: f32 = 0.1;

/// A group of so few receivers is not halved any more.
const FEWEST: usize = 4;

/// What became of a search for edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Found {
    /// All edges that matter are known.
    All,
    /// There are too many; halving the receivers at this coordinate of this axis may help.
    Split(usize, f64),
    /// Culling does not pay or apply here.
    NotHere,
}

/// What a thread knows of the group that it works on.
#[derive(Default)]
pub(super) struct Group {
    stack: Vec<u32>,
    edges: Vec<EdgePlanes>,
    /// For every edge the receivers that must heed it, a bit each.
    heed: Vec<u64>,
    views: Vec<Option<View>>,
    origins: Vec<Vec3>,
    lanes: Box<Receiver>,
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
    /// Finds the edges for receivers whose rays start at `origins`.
    pub(super) fn collect(
        &mut self,
        geometry: &Geometry,
        sampler: &Sampler,
        origins: &[Vec3],
    ) -> Found {
        self.edges.clear();
        self.views.clear();
        self.views
            .extend(origins.iter().map(|o| sampler.view(o.as_dvec3())));
        self.origins.clear();
        self.origins.extend_from_slice(origins);
        // Receivers that the light does not face have no say in the shaft.
        let facing = || {
            self.views
                .iter()
                .zip(origins)
                .filter(|(v, _)| v.is_some())
                .map(|(_, o)| *o)
        };
        let low = facing().fold(Vec3::INFINITY, Vec3::min);
        let high = facing().fold(Vec3::NEG_INFINITY, Vec3::max);
        if low.x > high.x {
            return Found::NotHere;
        }
        let light = sampler.light().bounds();
        let shaft = Shaft::new((low, high), (light.0.as_vec3(), light.1.as_vec3()));
        let occluders = geometry.occluders();
        let spheres = occluders.spheres.as_ref();
        if spheres.is_some_and(|s| s.tree.nodes.iter().any(|n| n.count > 0 && shaft.meets(n))) {
            return Found::NotHere;
        }
        let transparent = occluders.transparent.as_ref().map(|(bvh, _)| bvh);
        let found = [Some(&occluders.opaque), transparent]
            .into_iter()
            .flatten()
            .all(|bvh| self.collect_from(geometry, bvh, &shaft));
        if found {
            self.find_heeded();
            return Found::All;
        }
        // Halving the receivers narrows the shaft only where they are spread wide next to the light,
        // as over the step from an outline to what lies behind it.
        let spread = high - low;
        let axis = spread.max_position();
        let wide = spread[axis] > WIDE * (light.1 - light.0).max_element() as f32;
        if wide && origins.len() > FEWEST {
            let middle = 0.5 * (low[axis] + high[axis]);
            return Found::Split(axis, f64::from(middle));
        }
        Found::NotHere
    }

    fn collect_from(&mut self, geometry: &Geometry, bvh: &TriangleBvh, shaft: &Shaft) -> bool {
        let outline = bvh.outline(geometry);
        let nodes = &bvh.tree.nodes;
        outline.candidates(
            geometry,
            nodes,
            shaft,
            MOST_EDGES,
            &mut self.stack,
            &mut self.edges,
        )
    }

    /// Whether receiver `k` sees the light in a way that a grid can be laid over.
    pub(super) fn has_view(&self, k: usize) -> bool {
        self.views[k].is_some()
    }

    /// The edges that receiver `k` must heed.
    pub(super) fn edges(&self, k: usize) -> impl Iterator<Item = SeenEdge> {
        let origin = self.origins[k];
        let view = self.views[k].unwrap_or_default();
        self.heed
            .iter()
            .zip(&self.edges)
            .filter(move |(heed, _)| *heed >> k & 1 == 1)
            .map(move |(_, edge)| SeenEdge {
                view,
                ends: edge.ends.map(|p| relative(p, origin)),
            })
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

#[inline(always)]
unsafe fn load<S: Lanes>(vectors: &[[Row; ROWS]; 3], row: usize) -> [S; 3] {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        [
            S::load(&vectors[0][row]),
            S::load(&vectors[1][row]),
            S::load(&vectors[2][row]),
        ]
    }
}

#[inline(always)]
unsafe fn splat<S: Lanes>(p: Vec3) -> [S; 3] {
    // SAFETY: the caller enabled the features of `S`.
    unsafe { [S::splat(p.x), S::splat(p.y), S::splat(p.z)] }
}

#[inline(always)]
unsafe fn from<S: Lanes>(p: Vec3, origin: &[S; 3]) -> [S; 3] {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let [x, y, z] = splat::<S>(p);
        [x.sub(origin[0]), y.sub(origin[1]), z.sub(origin[2])]
    }
}

#[inline(always)]
unsafe fn dot<S: Lanes>(a: &[S; 3], b: &[S; 3]) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe { a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2])) }
}

/// Sum of absolute values.
#[inline(always)]
unsafe fn size<S: Lanes>(p: &[S; 3]) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe { p[0].abs().add(p[1].abs()).add(p[2].abs()) }
}

/// Sets, for every edge, the bits of the receivers that must heed it.
#[inline(always)]
unsafe fn heeded<S: Lanes>(edges: &[EdgePlanes], receivers: &Receiver, heed: &mut [u64]) {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let zero = S::splat(0.0);
        for row in 0..ROWS {
            if receivers.valid[row] == 0 {
                continue;
            }
            let origin = load::<S>(&receivers.origin, row);
            let u = load::<S>(&receivers.u, row);
            let v = load::<S>(&receivers.v, row);
            let w = load::<S>(&receivers.w, row);
            let steepness = S::load(&receivers.steepness[row]);
            for (edge, heed) in edges.iter().zip(heed.iter_mut()) {
                let a = from(edge.ends[0], &origin);
                let b = from(edge.ends[1], &origin);
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
                let doubt = size_a
                    .max(size_b)
                    .mul(steepness)
                    .mul(S::splat(2.0 * DOT_ERROR));
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
