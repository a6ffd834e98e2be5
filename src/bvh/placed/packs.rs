//! Triangles of leaves in the scene's coordinates, made when a segment meets them.

use fearless_simd::{Simd, f64x8, prelude::*};

use super::super::kept::KeptPacks;
use super::super::wide::{Child, Pack, WIDTH};
use super::Instance;

/// The triangles of an instance's leaf, from those that are kept if they are there.
#[inline(always)]
pub(super) fn kept<'a, S: Simd>(
    simd: S,
    packs: &'a mut KeptPacks,
    instance: &Instance,
    leaf: Child,
) -> &'a Pack {
    // No other instance has the number of its first triangle.
    let (kept, known) = packs.find(instance.first_face, leaf.place());
    if !known {
        *kept = pack(simd, instance, leaf);
    }
    kept
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
