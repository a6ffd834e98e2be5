//! Hierarchies of two levels, for scenes in which many entries show the same mesh.
//!
//! - this file: [`Placed`], all instances of a scene by what they do to light, and one tree a mesh;
//! - `instance`: a mesh's tree in its own coordinates, and where an instance has it in the scene;
//! - `packs`: triangles of leaves in the scene's coordinates;
//! - `traverse`: sixteen segments through both levels.
//!
//! Only boxes are met in a mesh's own coordinates: segments are taken there, and boxes widened by more than all rounding on
//! the way. Triangles are met in the scene's coordinates, with their corners rounded as where all of them are kept in one
//! list ([`crate::geometry::placed`]), by the same tests. So every answer is that of one tree over all triangles, to the
//! last bit: mirrored, sheared and very small or large instances need no tolerance of their own, and no light leaks between
//! neighbours.

mod instance;
mod packs;
mod traverse;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::packet::{Packet, Stack};
use super::tree::Tree;
use super::wide::Wide;
use crate::geometry::{Geometry, MeshRange};
use crate::mesh::TriMesh;
use crate::simd::{LANES, detect};
pub(super) use instance::Instance;
use instance::MeshTree;
pub(super) use packs::pack;

/// Instances that treat light alike, and the tree over their bounds.
#[derive(Debug, Clone, Default)]
pub(super) struct Set {
    pub(super) tree: Wide,
    /// In the order of the tree's leaves.
    pub(super) instances: Vec<Instance>,
}

/// All instances of a scene.
#[derive(Debug, Clone)]
pub struct Placed {
    /// Tells kept triangles of this scene from those of others.
    id: u64,
    meshes: Vec<Arc<MeshTree>>,
    opaque: Set,
    transparent: Set,
    /// They cast nothing, and are seen all the same.
    others: Set,
}

impl Placed {
    /// Builds the upper level, and the trees of meshes that `known` does not have.
    pub(super) fn new(geometry: &Geometry, known: Option<&Placed>) -> Self {
        let known = known.map_or(&[][..], |k| &k.meshes);
        let mut meshes: Vec<Arc<MeshTree>> = Vec::new();
        let mut sets: [Vec<(Instance, (Vec3, Vec3))>; 3] = Default::default();
        let trees: Vec<usize> = {
            let mut places = std::collections::HashMap::new();
            let mut place = |mesh: &Arc<TriMesh>| {
                *places.entry(Arc::as_ptr(mesh)).or_insert_with(|| {
                    let has = |tree: &&Arc<MeshTree>| Arc::ptr_eq(&tree.mesh, mesh);
                    let tree = known.iter().find(has).cloned();
                    meshes.push(tree.unwrap_or_else(|| Arc::new(MeshTree::new(mesh.clone()))));
                    meshes.len() - 1
                })
            };
            geometry.meshes.iter().map(|m| place(&m.mesh)).collect()
        };
        let made: Vec<_> = geometry
            .meshes
            .par_iter()
            .zip(&trees)
            .map(|(range, &tree)| instance(geometry, range, &meshes[tree]))
            .collect();
        for (range, made) in geometry.meshes.iter().zip(made) {
            let material = geometry.material(range.entry);
            let set = match (material.casts, material.opacity) {
                (false, _) | (_, 0.0) => 2,
                (true, 1.0) => 0,
                _ => 1,
            };
            sets[set].push(made);
        }
        let [opaque, transparent, others] = sets.map(Set::new);
        static LAST: AtomicU64 = AtomicU64::new(0);
        Placed {
            id: LAST.fetch_add(1, Ordering::Relaxed) + 1,
            meshes,
            opaque,
            transparent,
            others,
        }
    }

    /// Whether all that casts is opaque.
    pub(super) fn is_opaque(&self) -> bool {
        self.transparent.instances.is_empty()
    }

    /// All sets; together they hold all of a scene's triangles.
    pub(super) fn sets(&self) -> [&Set; 3] {
        [&self.opaque, &self.transparent, &self.others]
    }

    /// Which of the segments in `active` an opaque triangle blocks.
    pub(super) fn blocked(&self, packet: &Packet, active: u16, stack: &mut Stack) -> u16 {
        if active == 0 {
            return 0;
        }
        stack.packs.enter(self.id);
        traverse::blocked(detect(), &self.opaque, packet, active, stack)
    }

    /// Multiplies `out` by the transmittance of each segment of `active` through transparent triangles.
    pub(super) fn pass(
        &self,
        packet: &Packet,
        active: u16,
        stack: &mut Stack,
        out: &mut [f32; LANES],
    ) {
        if active == 0 || self.is_opaque() {
            return;
        }
        stack.packs.enter(self.id);
        stack
            .crossed
            .iter_mut()
            .for_each(super::crossed::Crossed::clear);
        traverse::pass(detect(), &self.transparent, packet, active, stack);
        for (lane, out) in out.iter_mut().enumerate() {
            if active >> lane & 1 == 1 {
                *out *= stack.crossed[lane].product();
            }
        }
    }

    /// Bytes of both levels, without the meshes themselves.
    pub(super) fn bytes(&self) -> usize {
        let meshes = self.meshes.iter().map(|m| m.bytes());
        let sets = self
            .sets()
            .into_iter()
            .map(|set| set.tree.bytes() + size_of_val(&set.instances[..]));
        meshes.chain(sets).sum()
    }
}

/// An instance and its local bounds.
fn instance(
    geometry: &Geometry,
    range: &MeshRange,
    tree: &Arc<MeshTree>,
) -> (Instance, (Vec3, Vec3)) {
    let (low, high) = geometry.local_bounds(range);
    // One ulp outwards covers the rounding of corners to f32.
    let down = |p: DVec3| p.as_vec3().map(f32::next_down);
    let up = |p: DVec3| p.as_vec3().map(f32::next_up);
    let bounds = (down(low), up(high));
    let placement = geometry.placement(range);
    let largest = low.abs().max(high.abs()).max_element();
    let through = 1.0 - geometry.material(range.entry).opacity;
    let (tree, first) = (tree.clone(), range.first_face);
    let instance = Instance::new(tree, placement, largest, first, through);
    (instance, bounds)
}

impl Set {
    fn new(all: Vec<(Instance, (Vec3, Vec3))>) -> Self {
        let bounds: Vec<_> = all.iter().map(|(_, bounds)| *bounds).collect();
        let tree = Tree::with_leaves(&bounds, 1);
        let instances = tree.order.iter().map(|&i| all[i as usize].0.clone());
        Set {
            instances: instances.collect(),
            tree: Wide::of_boxes(&tree, 1),
        }
    }
}

#[cfg(test)]
mod tests;
