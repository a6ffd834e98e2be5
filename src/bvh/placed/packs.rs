//! Triangles of leaves in the scene's coordinates, made when a segment meets them, and the last ones kept.

use fearless_simd::{Simd, f64x8, prelude::*};

use super::super::wide::{Child, Pack, WIDTH};
use super::Instance;

/// Packs that a thread keeps, a power of two: a part of the second cache.
const KEPT: usize = 1024;

/// No leaf.
const NONE: u64 = u64::MAX;

/// The packs that a thread has met last, each at a place that its leaf's number tells. What is kept saves work and
/// changes no answer.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct Packs {
    /// The scene that they are of.
    of: u64,
    leaves: Vec<u64>,
    packs: Vec<Pack>,
    /// Instance and leaf that blocked a segment last, where one did.
    pub(super) blocker: Option<(u32, u32)>,
}

impl Packs {
    /// Begins with a scene.
    #[inline]
    pub(super) fn enter(&mut self, scene: u64) {
        if self.of != scene {
            self.of = scene;
            self.blocker = None;
            self.leaves.clear();
            self.leaves.resize(KEPT, NONE);
            self.packs.resize(KEPT, Pack::new(&[]));
        }
    }

    /// The triangles of an instance's leaf.
    #[inline(always)]
    pub(super) fn get<S: Simd>(&mut self, simd: S, instance: &Instance, leaf: Child) -> &Pack {
        // No other instance has it.
        let number = u64::from(instance.first_face);
        let key = number << 32 | leaf.place() as u64;
        // Neighbours among leaves and among instances have different places.
        let place = (key ^ (number.wrapping_mul(0x9e37_79b9) >> 8)) as usize % KEPT;
        if self.leaves[place] != key {
            self.leaves[place] = key;
            self.packs[place] = pack(simd, instance, leaf);
        }
        &self.packs[place]
    }
}

/// Corners of a leaf's triangles in local coordinates: the operations of
/// [`crate::geometry::placed::Placement::local`], eight triangles at a time.
#[inline(always)]
pub(in super::super) fn pack<S: Simd>(simd: S, instance: &Instance, leaf: Child) -> Pack {
    let tree = &instance.tree;
    let (vertices, all) = (tree.mesh.vertices(), tree.mesh.faces());
    let faces = tree.faces(leaf);
    let mut from = [[[f64::NAN; WIDTH]; 3]; 3];
    for (k, &face) in faces.iter().enumerate() {
        for (corner, &v) in from.iter_mut().zip(&all[face as usize]) {
            let v = vertices[v as usize];
            (corner[0][k], corner[1][k], corner[2][k]) = (v.x, v.y, v.z);
        }
    }
    let placement = &instance.placement;
    let (matrix, translation) = (placement.transform.matrix3, placement.transform.translation);
    let mut out = Pack::new(&[]);
    for (from, to) in from.iter().zip(&mut out.corners) {
        let [x, y, z] = from;
        let x = f64x8::load_array_ref(simd, x);
        let y = f64x8::load_array_ref(simd, y);
        let z = f64x8::load_array_ref(simd, z);
        for (axis, to) in to.iter_mut().enumerate() {
            let turned =
                x * matrix.x_axis[axis] + y * matrix.y_axis[axis] + z * matrix.z_axis[axis];
            let world = turned + translation[axis];
            let local = (world - placement.origin[axis]) * placement.scale;
            let mut rounded = [0.0; WIDTH];
            local.store_array(&mut rounded);
            for (to, x) in to.iter_mut().zip(rounded) {
                *to = x as f32;
            }
        }
    }
    out
}
