//! Geometry whose meshes stay in object space, each stored once however many entries show it.
//!
//! Numbers of triangles, the frame and, once they are asked for, local corners are those of [`Geometry::new`] to the
//! bit: a corner is moved to world coordinates and then to local ones in `f64`, and rounded once. So whatever is asked of
//! single triangles has the same answer as where all of them are kept in one list.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec3};
use rayon::prelude::*;

use super::{Geometry, MeshRange, check_bounds, local_spheres, union};
use crate::error::{Error, Result};
use crate::frame::{self, Frame, Solid};
use crate::geometry::entry::{Body, Entry};
use crate::mesh::TriMesh;

/// Most triangles that 32-bit numbers tell apart, with one left over for what is none.
const MOST_TRIANGLES: usize = u32::MAX as usize - 1;

/// From object space to local coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Placement {
    /// Object to world.
    pub transform: DAffine3,
    /// World position of the local origin.
    pub origin: DVec3,
    /// Local units in a world unit, a power of two.
    pub scale: f64,
}

impl Placement {
    /// The local position of a vertex.
    #[inline(always)]
    pub fn local(&self, v: DVec3) -> Vec3 {
        self.exact(v).as_vec3()
    }

    /// The local position of a vertex before it is rounded to single precision.
    #[inline(always)]
    pub fn exact(&self, v: DVec3) -> DVec3 {
        (self.transform.transform_point3(v) - self.origin) * self.scale
    }

    /// The linear part, object to local.
    pub fn matrix(&self) -> DMat3 {
        self.transform.matrix3 * self.scale
    }
}

impl Geometry {
    /// As [`Geometry::new`], with meshes left in object space; of those that stand in `known` as they do here, bounds are
    /// known.
    ///
    /// # Errors
    /// As [`Geometry::new`]; a scene so small that its inverse size overflows.
    pub fn with_placed_meshes(
        entries: &[Entry],
        known: Option<&Geometry>,
        frame: Option<Frame>,
    ) -> Result<Self> {
        if entries.is_empty() {
            return Err(Error::scene("scene", "it has no meshes or spheres"));
        }
        let mut meshes: Vec<MeshRange> = Vec::new();
        let mut solids = Vec::new();
        let mut count = 0usize;
        let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (entry, e) in entries.iter().enumerate() {
            match &e.shape {
                Body::Mesh(mesh, transform) => {
                    let first_face = count as u32;
                    count += mesh.faces().len();
                    if count > MOST_TRIANGLES {
                        return Err(Error::TooLarge {
                            what: "scene".into(),
                            count,
                            items: "triangles",
                            limit: MOST_TRIANGLES,
                        });
                    }
                    let same = known.and_then(|k| k.meshes.get(meshes.len()));
                    let same =
                        same.filter(|m| Arc::ptr_eq(&m.mesh, mesh) && m.transform == *transform);
                    let own = same.map_or_else(|| world_bounds(mesh, transform), |m| m.bounds);
                    if !(own.0.is_finite() && own.1.is_finite() && (own.1 - own.0).is_finite()) {
                        let what = format!("mesh {:?}", e.name);
                        return Err(Error::scene(what, "its world coordinates overflow"));
                    }
                    bounds = union(bounds, own);
                    meshes.push(MeshRange {
                        entry: entry as u32,
                        first_face,
                        faces: mesh.faces().len() as u32,
                        first_vertex: 0,
                        mesh: mesh.clone(),
                        transform: *transform,
                        bounds: own,
                    });
                    let (vertices, faces) = (mesh.vertices(), mesh.faces());
                    solids.push(Solid::Placed(vertices, faces, *transform, own));
                }
                Body::Spheres(spheres) => {
                    for &(c, r) in spheres.iter() {
                        bounds = union(bounds, (c - r, c + r));
                    }
                    solids.push(Solid::Spheres(spheres));
                }
            }
        }
        check_bounds(bounds)?;
        let mut frame = match frame {
            Some(frame) => frame,
            None => frame::choose(bounds.0, bounds.1, &solids)?,
        };
        frame::check(&mut frame, &solids, |entry| {
            format!("mesh {:?}", entries[entry].name)
        })?;
        if !(1.0 / frame.unit).is_finite() {
            let reason = format!(
                "its size, {:.1e}, has no inverse in f64; such scenes take Scene(instances=\"never\")",
                frame.unit
            );
            return Err(Error::scene("scene", reason));
        }
        Ok(Geometry {
            frame,
            positions: Vec::new(),
            faces: Vec::new(),
            meshes,
            spheres: local_spheres(entries, &frame),
            materials: entries.iter().map(|e| e.material).collect(),
            placed: true,
        })
    }

    /// How a mesh is placed in local coordinates.
    pub fn placement(&self, mesh: &MeshRange) -> Placement {
        Placement {
            transform: mesh.transform,
            origin: self.frame.origin,
            scale: 1.0 / self.frame.unit,
        }
    }

    /// Corners of a triangle, wherever they are kept; `last` is the mesh of the one before.
    pub fn any_corners<'a>(&'a self, last: &mut Option<&'a MeshRange>, face: u32) -> [Vec3; 3] {
        if !self.placed {
            return self.corners(face);
        }
        let range = self.mesh_after(last, face);
        let placement = self.placement(range);
        let corners = range.mesh.faces()[(face - range.first_face) as usize];
        corners.map(|v| placement.local(range.mesh.vertices()[v as usize]))
    }

    /// Local bounds of a mesh, before rounding.
    pub fn local_bounds(&self, mesh: &MeshRange) -> (DVec3, DVec3) {
        let (low, high) = mesh.bounds;
        (self.frame.to_local(low), self.frame.to_local(high))
    }
}

/// World bounds of a mesh's triangles.
fn world_bounds(mesh: &TriMesh, transform: &DAffine3) -> (DVec3, DVec3) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let vertices = mesh.vertices();
    let moved = |v: &DVec3| {
        let p = transform.transform_point3(*v);
        (p, p)
    };
    // Where every vertex is a corner, or where one is, fewer points have the same bounds.
    if mesh.uses_all_vertices() {
        return vertices.par_iter().map(moved).reduce(|| none, union);
    }
    let of = |f: &[u32; 3]| {
        let [a, b, c] = f.map(|v| moved(&vertices[v as usize]));
        union(union(a, b), c)
    };
    mesh.faces().par_iter().map(of).reduce(|| none, union)
}
