//! The edges that may be silhouettes for a group of receivers, sixteen to a block.

use glam::{DVec3, Vec3};

use crate::bvh::TriangleBvh;
use crate::bvh::edge_faces::EdgeFace;
use crate::bvh::outline::{EdgePlanes, Shaft};
use crate::light::Light;
use crate::sampling::shaft::{GroupShaft, Middle};
use crate::sampling::{LightProjection, Sampler};
use crate::scene::snapshot::Snapshot;
use crate::simd::{LANES, Row};

/// Most candidate edges of a group, by what they cost. Beyond, the group is halved or its receivers are answered by rays:
/// a quarter as many take 1.5 times as long on a scan under a light as large as itself. From one light point to another
/// each edge changes a count by 2 at most, and counts have 16 bits.
const MOST_EDGES: usize = 16000;

/// What an edge of one triangle costs, over one of two: it is a silhouette for every receiver, those on a scan are for
/// few. Foliage and hair are full of them, and rays are cheaper there from a thousand on.
const LONE: usize = 16;

/// A group is halved only while it is wider than this part of the light. A third of it takes 1.6 times as long on a
/// scan of 1.6 million triangles: halves of what is next to the light's own width have as many edges as both had.
const WIDE: f32 = 0.3;

/// Sixteen edges, lane by lane.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub(super) ends: [[Row; 3]; 2],
    pub(super) normals: [[Row; 3]; 2],
    pub(super) faces: [[EdgeFace; 2]; LANES],
    /// Lanes that hold an edge, and those in which it has either triangle.
    pub(super) used: u16,
    pub(super) has: [u16; 2],
}

impl Default for Block {
    fn default() -> Self {
        Block {
            ends: [[Row::default(); 3]; 2],
            normals: [[Row::default(); 3]; 2],
            faces: [[EdgeFace::NONE; 2]; LANES],
            used: 0,
            has: [0; 2],
        }
    }
}

/// What became of a search for edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Found {
    /// All edges that matter are known.
    All,
    /// There are too many; halving the receivers here may help.
    Split(Middle),
    /// Rays must answer.
    ByRays,
}

/// Edges of a group of receivers.
#[derive(Debug, Default)]
pub(super) struct Edges {
    stack: Vec<u32>,
    blocks: Vec<Block>,
    count: usize,
    views: Vec<Option<LightProjection>>,
}

impl Edges {
    /// How receiver `k` sees the light.
    pub(super) fn view(&self, k: usize) -> Option<LightProjection> {
        self.views[k]
    }

    /// The edges that were found.
    pub(super) fn blocks(&self) -> &[Block] {
        &self.blocks[..self.count.div_ceil(LANES)]
    }

    /// Finds the edges for receivers whose rays start at `origins`.
    pub(super) fn collect(
        &mut self,
        geometry: &Snapshot,
        sampler: &Sampler,
        origins: &[Vec3],
    ) -> Found {
        self.count = 0;
        let Some(group) = GroupShaft::new(sampler, origins, &mut self.views) else {
            return Found::ByRays;
        };
        let shaft = &group.shaft;
        let occluders = geometry.occluders();
        let transparent = occluders.transparent.as_ref().map(|(bvh, _)| &bvh.tree);
        let spheres = occluders.spheres.as_ref().map(|s| &s.tree);
        let others = [transparent, spheres].into_iter().flatten();
        if others
            .into_iter()
            .any(|tree| tree.any_leaf(|node| shaft.meets(node)))
        {
            return Found::ByRays;
        }
        if self.collect_from(&occluders.opaque, geometry, shaft, sampler.light()) {
            return Found::All;
        }
        group.middle(WIDE).map_or(Found::ByRays, Found::Split)
    }

    fn collect_from(
        &mut self,
        bvh: &TriangleBvh,
        geometry: &Snapshot,
        shaft: &Shaft,
        light: &Light,
    ) -> bool {
        let behind = Behind::new(light);
        let Edges {
            stack,
            blocks,
            count,
            ..
        } = self;
        let mut take = |edge: &EdgePlanes, faces: [EdgeFace; 2]| {
            let Some(ends) = behind.clip(edge.ends) else {
                return 0;
            };
            let (at, lane) = (*count / LANES, *count % LANES);
            *count += 1;
            if at == blocks.len() {
                blocks.push(Block::default());
            }
            let block = &mut blocks[at];
            if lane == 0 {
                (block.used, block.has) = (0, [0; 2]);
            }
            block.used |= 1 << lane;
            block.faces[lane] = faces;
            for side in 0..2 {
                block.has[side] |= u16::from(faces[side] != EdgeFace::NONE) << lane;
                let coordinates = ends[side].to_array().into_iter();
                let normal = edge.normals[side].to_array();
                for (axis, (end, normal)) in coordinates.zip(normal).enumerate() {
                    block.ends[side][axis].0[lane] = end;
                    block.normals[side][axis].0[lane] = normal;
                }
            }
            if faces.contains(&EdgeFace::NONE) {
                LONE
            } else {
                1
            }
        };
        let outline = bvh.outline(geometry);
        outline.candidates(&bvh.tree.nodes, shaft, MOST_EDGES, stack, &mut take)
    }
}

/// What of an edge lies behind a flat light and hides none of it.
struct Behind {
    /// Emitting normal, and the height along it from which on something is before the light: half of what light
    /// points are moved off it. Over the light there is nothing within eight times as much, or no edges are looked
    /// for ([`crate::bvh::outline::touches_light`]).
    plane: Option<(DVec3, f64)>,
}

impl Behind {
    fn new(light: &Light) -> Self {
        let plane = light
            .normal()
            .map(|n| (n, n.dot(light.center() + 0.5 * light.lift())));
        Behind { plane }
    }

    /// The part of an edge that lies before the light, if any. Where it passes through the light's plane it is not
    /// over the light, and so is the end that it gets there.
    fn clip(&self, ends: [Vec3; 2]) -> Option<[Vec3; 2]> {
        let Some((normal, plane)) = self.plane else {
            return Some(ends);
        };
        let [a, b] = ends.map(|end| normal.dot(end.as_dvec3()) - plane);
        match (a > 0.0, b > 0.0) {
            (true, true) => Some(ends),
            (false, false) => None,
            (front, _) => {
                let cut = ends[0].as_dvec3().lerp(ends[1].as_dvec3(), a / (a - b));
                let cut = cut.as_vec3();
                Some(if front {
                    [ends[0], cut]
                } else {
                    [cut, ends[1]]
                })
            }
        }
    }
}
