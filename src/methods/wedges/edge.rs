//! Silhouette edges as the `light` falloff's kernel wants them.

use glam::DVec3;
use rayon::prelude::*;

use super::volume::VolumeQuad;
use crate::casters::edges::Edge;
use crate::light::Light;
use crate::simd::Row;

/// A position in two parts: differences to receivers in contact are then as exact as with `f64`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Split {
    pub(super) high: [f32; 3],
    pub(super) low: [f32; 3],
}

impl Split {
    /// Splits a local position into two `f32` parts.
    pub(super) fn new(p: [f64; 3]) -> Self {
        let high = p.map(|x| x as f32);
        Split {
            high,
            low: std::array::from_fn(|i| (p[i] - f64::from(high[i])) as f32),
        }
    }

    /// Puts it into a lane.
    pub(super) fn store(&self, lane: usize, rows: &mut [[Row; 2]; 3]) {
        for (axis, [high, low]) in rows.iter_mut().enumerate() {
            high.0[lane] = self.high[axis];
            low.0[lane] = self.low[axis];
        }
    }
}

/// An edge as the kernel wants it.
#[derive(Debug, Clone, Copy)]
pub struct AreaEdge {
    pub(super) ends: [Split; 2],
    /// The vector from the first end to the second.
    pub(super) vector: [f32; 3],
    pub(super) normal: [f64; 3],
    pub(super) offset: f64,
    /// Front and back layers that it counts.
    pub(super) weights: [f32; 2],
    /// Whether it starts where the edge before it ends, and bounds the same layers.
    pub(super) follows: bool,
}

/// The part of an edge in front of a flat light; `None` if there is none.
fn in_front(light: &Light, ends: [DVec3; 2]) -> Option<[DVec3; 2]> {
    let Some(n) = light.normal() else {
        return Some(ends);
    };
    let [a, b] = ends;
    let (za, zb) = (n.dot(a - light.center()), n.dot(b - light.center()));
    let cut = || a + (b - a) * (za / (za - zb));
    match (za > 0.0, zb > 0.0) {
        (true, true) => Some(ends),
        (true, false) => Some([a, cut()]),
        (false, true) => Some([cut(), b]),
        (false, false) => None,
    }
}

/// Prepares edges with their planes; those behind a flat light do not count.
pub fn area_edges(edges: &[Edge], planes: &[VolumeQuad], light: &Light) -> Vec<AreaEdge> {
    let parts: Vec<_> = (edges.par_iter().map(|e| in_front(light, e.ends))).collect();
    let one = |i: usize| {
        let (edge, plane) = (&edges[i], &planes[i]);
        let weight = |layers: i32| parts[i].map_or(0.0, |_| layers as f32);
        let ends = parts[i].unwrap_or(edge.ends);
        let follows = i.checked_sub(1).is_some_and(|before| {
            let e = &edges[before];
            (e.object, e.front, e.back) == (edge.object, edge.front, edge.back)
                && parts[before].is_some_and(|[_, end]| end == ends[0])
        });
        AreaEdge {
            ends: ends.map(|v| Split::new(v.to_array())),
            vector: (ends[1] - ends[0]).as_vec3().to_array(),
            normal: plane.normal.to_array(),
            offset: plane.offset,
            weights: [edge.front, edge.back].map(weight),
            follows,
        }
    };
    (0..edges.len()).into_par_iter().map(one).collect()
}
