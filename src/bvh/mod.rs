//! Bounding volume hierarchies over what casts, and the queries that the methods ask of them.
//!
//! - [`tree`]: building and refitting, the only file that knows obvhs;
//! - [`packet`]: sixteen segments, and whether one passes through a triangle;
//! - [`any_hit`]: which of sixteen segments are blocked by opaque triangles, by a tree with eight children a node (`wide`);
//! - `grown`: the same tree with boxes that grow along the segments, for what lies around them;
//! - [`crossing`]: how many times one segment crosses each surface, exactly, and which first; `through`: sixteen segments'
//!   transmittance by the same crossings, most of which single precision tells;
//! - `pyramid`: the triangles in a convex region next to a point;
//! - [`placed`]: hierarchies of two levels, for scenes that show the same mesh many times;
//! - [`seen`]: what a camera sees;
//! - [`outline`]: which edges can be silhouette edges for a group of receivers; [`edge_faces`]: the triangles at them.
//!
//! A segment from a receiver to a light point is blocked where it passes through a triangle and its
//! ends lie strictly on different sides of the triangle's plane. Passing through is decided as by
//! Woop, Benthin and Wald 2013 (no gap along shared edges or at shared vertices), sides by a filtered
//! exact predicate. So there is no epsilon along a segment: a receiver or light point that was moved
//! off its surface by a few ulps is on the right side of it, however large the triangle.

pub mod any_hit;
mod crossed;
pub mod crossing;
pub mod edge_faces;
pub(crate) mod grown;
mod kept;
pub mod outline;
pub mod packet;
pub mod placed;
pub(crate) mod pyramid;
pub mod seen;
mod through;
pub mod tree;
mod wide;

use std::sync::OnceLock;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::geometry::{Geometry, Sphere};
use outline::Outline;
use packet::{Packet, Stack};
use placed::Placed;
use tree::Tree;
use wide::Wide;

/// A hierarchy over triangles.
#[derive(Debug, Clone)]
pub struct TriangleBvh {
    /// The nodes; `tree.order` holds indices into `faces`.
    pub tree: Tree,
    /// Corners in the order of the leaves.
    pub corners: Vec<[Vec3; 3]>,
    /// Indices into [`Geometry::faces`] in the order of the leaves.
    pub faces: Vec<u32>,
    wide: Wide,
    outline: OnceLock<Outline>,
}

impl TriangleBvh {
    fn new(geometry: &Geometry, faces: &[u32]) -> Self {
        let bounds = face_bounds(geometry, faces);
        let tree = Tree::new(&bounds);
        let faces: Vec<u32> = tree.order.iter().map(|&i| faces[i as usize]).collect();
        TriangleBvh::of(geometry, tree, faces)
    }

    /// With `faces` in the order of the tree's leaves.
    fn of(geometry: &Geometry, tree: Tree, faces: Vec<u32>) -> Self {
        let corners: Vec<_> = faces.par_iter().map(|&f| geometry.corners(f)).collect();
        TriangleBvh {
            wide: Wide::new(&tree, &corners),
            tree,
            corners,
            faces,
            outline: OnceLock::new(),
        }
    }

    /// A hierarchy of the same topology over moved triangles, or a new one where the old has become a bad fit.
    fn refitted(&self, geometry: &Geometry) -> Self {
        let bounds = face_bounds(geometry, &self.faces);
        match self.tree.refitted(&bounds) {
            Some(tree) => TriangleBvh::of(geometry, tree, self.faces.clone()),
            None => TriangleBvh::new(geometry, &self.faces),
        }
    }

    /// The edges of these triangles, for finding silhouettes; built at the first call.
    pub fn outline(&self, geometry: &Geometry) -> &Outline {
        self.outline.get_or_init(|| Outline::new(geometry, self))
    }

    /// Bytes of the hierarchy.
    pub fn bytes(&self) -> usize {
        let outline = self.outline.get().map_or(0, Outline::bytes);
        self.tree.bytes()
            + self.wide.bytes()
            + self.corners.len() * (size_of::<[Vec3; 3]>() + 4)
            + outline
    }
}

fn face_bounds(geometry: &Geometry, faces: &[u32]) -> Vec<(Vec3, Vec3)> {
    let bounds = |&f: &u32| {
        let [a, b, c] = geometry.corners(f);
        (a.min(b).min(c), a.max(b).max(c))
    };
    faces.par_iter().map(bounds).collect()
}

/// A hierarchy over spheres that cast.
#[derive(Debug, Clone)]
pub struct SphereBvh {
    /// The nodes.
    pub tree: Tree,
    /// Spheres in the order of the leaves.
    pub spheres: Vec<Sphere>,
    /// `1 - opacity` of each.
    pub transmittance: Vec<f32>,
}

/// Everything that casts: opaque and transparent triangles apart, and spheres.
#[derive(Debug, Clone)]
pub struct Occluders {
    /// Triangles of opacity 1.
    pub opaque: TriangleBvh,
    /// Triangles of opacity below 1, and `1 - opacity` of each in the order of the leaves.
    pub transparent: Option<(TriangleBvh, Vec<f32>)>,
    /// Triangles that cast nothing, and are seen all the same.
    pub others: Option<TriangleBvh>,
    /// Spheres of any opacity.
    pub spheres: Option<SphereBvh>,
    /// All triangles, where the geometry's meshes are placed; there are none in the other hierarchies then.
    pub placed: Option<Placed>,
}

impl Occluders {
    /// Builds the hierarchies.
    pub fn new(geometry: &Geometry) -> Self {
        let (mut opaque, mut transparent, mut others) = (Vec::new(), Vec::new(), Vec::new());
        for mesh in &geometry.meshes {
            let material = geometry.material(mesh.entry);
            let range = mesh.first_face..mesh.first_face + mesh.faces;
            match (material.casts, material.opacity) {
                (false, _) | (_, 0.0) => others.extend(range),
                (true, 1.0) => opaque.extend(range),
                _ => transparent.extend(range),
            }
        }
        let transparent = (!transparent.is_empty()).then(|| {
            let bvh = TriangleBvh::new(geometry, &transparent);
            let through = face_transmittance(geometry, &bvh.faces);
            (bvh, through)
        });
        Occluders {
            opaque: TriangleBvh::new(geometry, &opaque),
            transparent,
            others: (!others.is_empty()).then(|| TriangleBvh::new(geometry, &others)),
            spheres: sphere_bvh(geometry),
            placed: None,
        }
    }

    /// Hierarchies of two levels, with the trees of meshes that `known` has.
    pub fn placed(geometry: &Geometry, known: Option<&Occluders>) -> Self {
        let known = known.and_then(|k| k.placed.as_ref());
        Occluders {
            opaque: TriangleBvh::new(geometry, &[]),
            transparent: None,
            others: None,
            spheres: sphere_bvh(geometry),
            placed: Some(Placed::new(geometry, known)),
        }
    }

    /// The hierarchies over the same entries at other positions.
    pub fn refitted(&self, geometry: &Geometry) -> Self {
        Occluders {
            opaque: self.opaque.refitted(geometry),
            transparent: self.transparent.as_ref().map(|(bvh, _)| {
                let bvh = bvh.refitted(geometry);
                let through = face_transmittance(geometry, &bvh.faces);
                (bvh, through)
            }),
            others: self.others.as_ref().map(|bvh| bvh.refitted(geometry)),
            spheres: sphere_bvh(geometry),
            placed: None,
        }
    }

    /// Whether a segment passes all or nothing.
    pub fn is_binary(&self) -> bool {
        let placed = self.placed.as_ref();
        self.transparent.is_none() && self.spheres.is_none() && placed.is_none_or(Placed::is_opaque)
    }

    /// The hierarchies over triangles; together they hold all of a scene whose meshes are not placed.
    pub fn triangles(&self) -> impl Iterator<Item = &TriangleBvh> {
        let transparent = self.transparent.as_ref().map(|(bvh, _)| bvh);
        std::iter::once(&self.opaque)
            .chain(transparent)
            .chain(&self.others)
    }

    /// Transmittance of up to sixteen segments: `out[i]` for every bit `i` of `active`.
    pub fn transmittance(
        &self,
        packet: &Packet,
        active: u16,
        stack: &mut Stack,
        out: &mut [f32; crate::simd::LANES],
    ) {
        let mut open = active & !any_hit::blocked(&self.opaque, packet, active, stack);
        if let Some(placed) = &self.placed {
            open &= !placed.blocked(packet, open, stack);
        }
        for (lane, out) in out.iter_mut().enumerate() {
            *out = f32::from(open >> lane & 1);
        }
        if let Some((bvh, through)) = &self.transparent {
            through::triangles(bvh, through, packet, open, stack, out);
        }
        if let Some(placed) = &self.placed {
            placed.pass(packet, open, stack, out);
        }
        if let Some(spheres) = &self.spheres {
            for (lane, out) in out.iter_mut().enumerate().filter(|(_, out)| **out > 0.0) {
                let (from, to) = (packet.origin(lane), packet.target(lane));
                *out *= crossing::through_spheres(spheres, from, to, stack);
            }
        }
    }

    /// The first triangle of any opacity above 0 that a segment crosses, of [`Geometry::faces`], and the part of the
    /// segment before it.
    pub fn first_triangle(&self, from: Vec3, to: Vec3, stack: &mut Stack) -> Option<(f64, u32)> {
        let first = crossing::first_triangle(&self.opaque, from, to, stack);
        let other = self.transparent.as_ref();
        let other = other.and_then(|(bvh, _)| crossing::first_triangle(bvh, from, to, stack));
        first
            .into_iter()
            .chain(other)
            .min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Bytes of the hierarchies.
    pub fn bytes(&self) -> usize {
        let transparent = self.transparent.as_ref();
        let spheres = self.spheres.as_ref();
        self.opaque.bytes()
            + transparent.map_or(0, |(bvh, through)| bvh.bytes() + 4 * through.len())
            + self.others.as_ref().map_or(0, TriangleBvh::bytes)
            + self.placed.as_ref().map_or(0, Placed::bytes)
            + spheres.map_or(0, |s| {
                s.tree.bytes() + s.spheres.len() * (size_of::<Sphere>() + 4)
            })
    }
}

fn face_transmittance(geometry: &Geometry, faces: &[u32]) -> Vec<f32> {
    let through = |&f: &u32| 1.0 - geometry.material(geometry.mesh_of(f).entry).opacity;
    faces.par_iter().map(through).collect()
}

fn sphere_bvh(geometry: &Geometry) -> Option<SphereBvh> {
    let casts = |s: &&Sphere| {
        let material = geometry.material(s.entry);
        material.casts && material.opacity > 0.0
    };
    let spheres: Vec<Sphere> = geometry.spheres.iter().filter(casts).copied().collect();
    if spheres.is_empty() {
        return None;
    }
    let bounds: Vec<_> = spheres
        .iter()
        .map(|s| {
            // One ulp outwards covers the rounding to f32.
            let down = |p: DVec3| p.as_vec3().map(f32::next_down);
            let up = |p: DVec3| p.as_vec3().map(f32::next_up);
            (down(s.center - s.radius), up(s.center + s.radius))
        })
        .collect();
    let tree = Tree::new(&bounds);
    let spheres: Vec<Sphere> = tree.order.iter().map(|&i| spheres[i as usize]).collect();
    let transmittance = spheres
        .iter()
        .map(|s| 1.0 - geometry.material(s.entry).opacity)
        .collect();
    Some(SphereBvh {
        tree,
        spheres,
        transmittance,
    })
}
