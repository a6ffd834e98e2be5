//! A mesh's tree in its own coordinates, and where an instance has it in the scene.

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::super::any_hit::Slabs;
use super::super::packet::{Packet, box_slack};
use super::super::tree::{LEAF_SIZE, Tree};
use super::super::wide::{Child, WIDTH, Wide};
use crate::geometry::placed::Placement;
use crate::mesh::TriMesh;
use crate::simd::LANES;
use fearless_simd::Simd;

/// An `f32` rounding error.
const ULP: f32 = 1.0 / (1 << 24) as f32;

/// What the triangle test may be off by in the scene, over the largest coordinate of segments' origins and of the
/// instance: 15 rounding errors by the test itself (7.4, twice the distance: [`super::super::packet`]), half of one of the
/// corners, and as much again to spare.
const IN_SCENE: f32 = 32.0 * ULP;

/// What a segment may be off by in the mesh's coordinates, over its origin's largest coordinate and 1: within the
/// mesh's bounds, which are within 1, the rounding of its ends moves it by 2 errors of the origin and 1 of the bounds, and
/// moving the origin by the slack adds 1.
const IN_MESH: f32 = 8.0 * ULP;

/// Where boxes are widened by so much, in units of half a mesh's size, they tell nothing along an axis.
const BLIND: f64 = 4.0;

/// A mesh with a tree over its triangles. Its own coordinates have their origin in the middle of the mesh, and half of its
/// size as their unit.
#[derive(Debug)]
pub(in super::super) struct MeshTree {
    pub(in super::super) mesh: Arc<TriMesh>,
    pub(in super::super) wide: Wide,
    /// Faces of the mesh in the order of the leaves.
    pub(in super::super) order: Vec<u32>,
    middle: DVec3,
    half: f64,
}

impl MeshTree {
    pub(super) fn new(mesh: Arc<TriMesh>) -> Self {
        let (vertices, faces) = (mesh.vertices(), mesh.faces());
        let of = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|v| vertices[v as usize]);
            (a.min(b).min(c), a.max(b).max(c))
        };
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let union = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        let (low, high) = faces.par_iter().map(of).reduce(|| none, union);
        let middle = 0.5 * low + 0.5 * high;
        let half = (0.5 * high - 0.5 * low)
            .max_element()
            .max(f64::MIN_POSITIVE);
        let own = |p: DVec3| ((p - middle) / half).as_vec3();
        // One ulp outwards covers the rounding.
        let bounds = |f: &[u32; 3]| {
            let (low, high) = of(f);
            (own(low).map(f32::next_down), own(high).map(f32::next_up))
        };
        let bounds: Vec<(Vec3, Vec3)> = faces.par_iter().map(bounds).collect();
        let tree = Tree::with_leaves(&bounds, LEAF_SIZE);
        MeshTree {
            wide: Wide::of_boxes(&tree, WIDTH),
            order: tree.order,
            mesh,
            middle,
            half,
        }
    }

    /// Faces of the mesh in a leaf.
    #[inline(always)]
    pub(in super::super) fn faces(&self, leaf: Child) -> &[u32] {
        let first = self.wide.firsts[leaf.place()] as usize;
        &self.order[first..first + leaf.triangles()]
    }

    /// Bytes of the tree.
    pub(super) fn bytes(&self) -> usize {
        self.wide.bytes() + size_of_val(&self.order[..])
    }
}

/// A mesh at one place of the scene.
#[derive(Debug, Clone)]
pub(in super::super) struct Instance {
    pub(in super::super) tree: Arc<MeshTree>,
    pub(in super::super) placement: Placement,
    /// Number of its first triangle in the scene.
    pub(in super::super) first_face: u32,
    /// What passes a crossing.
    pub(super) through: f32,
    /// Its largest local coordinate, at least 1.
    pub(in super::super) largest: f64,
    /// From local coordinates to the mesh's own: a row and a summand each.
    rows: [[f64; 4]; 3],
    /// How far a unit of error in the scene reaches along the mesh's axes.
    reach: [f32; 3],
    /// What the rows themselves are wrong by, within the mesh's bounds.
    blur: [f32; 3],
}

impl Instance {
    pub(super) fn new(
        tree: Arc<MeshTree>,
        placement: Placement,
        largest: f64,
        first_face: u32,
        through: f32,
    ) -> Self {
        let largest = largest.max(1.0);
        let mut instance = Instance {
            tree,
            placement,
            first_face,
            through,
            largest,
            rows: [[0.0; 4]; 3],
            reach: [0.0; 3],
            blur: [BLIND as f32; 3],
        };
        let (to_scene, middle) = instance.to_scene();
        let inverse = to_scene.inverse_or_zero();
        // A point of the mesh goes to the scene and back to where it was, but for this.
        let error = inverse * to_scene - DMat3::IDENTITY;
        let rounding = inverse.abs() * to_scene.abs();
        for k in 0..3 {
            let row = inverse.row(k);
            let reach = row.abs().element_sum();
            let blur = 2.0 * error.row(k).abs().element_sum()
                + rounding.row(k).element_sum() * (0.5f64).powi(48);
            let slack = reach * largest * f64::from(IN_SCENE) + blur;
            // Where that is no number, or too large for one, all boxes are entered as well.
            if slack < BLIND {
                instance.rows[k] = [row.x, row.y, row.z, -row.dot(middle)];
                (instance.reach[k], instance.blur[k]) = (reach as f32, blur as f32);
            }
        }
        instance
    }

    /// From the mesh's own coordinates to local ones.
    pub(in super::super) fn to_scene(&self) -> (DMat3, DVec3) {
        let matrix = self.placement.matrix() * self.tree.half;
        (matrix, self.placement.exact(self.tree.middle))
    }

    /// Segments in the mesh's own coordinates, for its boxes; `own` is the room for them.
    #[inline(always)]
    pub(super) fn slabs<S: Simd>(
        &self,
        simd: S,
        packet: &Packet,
        active: u16,
        own: &mut Packet,
    ) -> Slabs {
        for (k, row) in self.rows.iter().enumerate() {
            turn(row, packet.origins(), &mut own.origin[k].0);
            turn(row, packet.targets(), &mut own.target[k].0);
        }
        let in_scene = (2.0 * box_slack(packet, active)).max(IN_SCENE * self.largest as f32);
        let mut farthest = 1.0f32;
        for row in own.origins() {
            for (lane, x) in row.0.iter().enumerate() {
                let x = if active >> lane & 1 == 1 {
                    x.abs()
                } else {
                    0.0
                };
                farthest = farthest.max(x);
            }
        }
        let in_mesh = IN_MESH * (farthest + 1.0);
        let mut slack = [0.0; 3];
        for (k, slack) in slack.iter_mut().enumerate() {
            *slack = self.reach[k] * in_scene + self.blur[k] + in_mesh;
        }
        Slabs::new(simd, own, slack)
    }
}

/// One coordinate of all points, in `f64` and rounded once.
#[inline(always)]
fn turn(row: &[f64; 4], points: &[crate::simd::Row; 3], out: &mut [f32; LANES]) {
    let [x, y, z] = points;
    for (lane, out) in out.iter_mut().enumerate() {
        let (x, y, z) = (
            f64::from(x.0[lane]),
            f64::from(y.0[lane]),
            f64::from(z.0[lane]),
        );
        *out = (row[0] * x + row[1] * y + row[2] * z + row[3]) as f32;
    }
}
