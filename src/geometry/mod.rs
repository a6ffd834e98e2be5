//! What the methods work on: all triangles and spheres of a scene in one local frame.
//!
//! Local coordinates have their origin in the middle of the scene's bounds and a power of two as
//! their unit, chosen so that every coordinate lies in [-1, 1]. They are `f32`, which costs a vertex
//! at most half an ulp of the scene's size whatever the scene's offset and scale, and a scene scaled
//! by a power of two has the same local coordinates to the bit. Where a scene is far larger than most of what
//! is in it, origin and unit are those of what is small ([`crate::frame`]), and the rest has coordinates of up to
//! 2³⁰. Everything in this crate that says *local* means this frame; lengths that depend on the scene's size are
//! constants in it.

pub mod entry;
pub mod placed;

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::frame::{self, Frame, Solid};
use crate::geometry::entry::{Body, Entry, Material};
use crate::mesh::TriMesh;

/// The triangles of one entry.
#[derive(Debug, Clone)]
pub struct MeshRange {
    /// Index of the entry in the scene.
    pub entry: u32,
    /// Its first triangle in [`Geometry::faces`], and their number.
    pub first_face: u32,
    /// Number of triangles.
    pub faces: u32,
    /// What is added to the mesh's own vertex indices.
    pub first_vertex: u32,
    /// The mesh, for its adjacency.
    pub mesh: Arc<TriMesh>,
    /// Where it is placed: object to world.
    pub transform: DAffine3,
    /// World bounds of its triangles.
    pub bounds: (DVec3, DVec3),
}

/// A sphere in local coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Sphere {
    /// Local centre.
    pub center: DVec3,
    /// Local radius.
    pub radius: f64,
    /// Index of the entry in the scene.
    pub entry: u32,
    /// Index among the entry's spheres.
    pub index: u32,
}

/// All triangles and spheres of a scene, in local coordinates.
#[derive(Debug)]
pub struct Geometry {
    /// The map to world coordinates.
    pub frame: Frame,
    /// Local vertices, those of all meshes one after the other.
    pub positions: Vec<Vec3>,
    /// Triangles of all meshes; joined vertices have one index.
    pub faces: Vec<[u32; 3]>,
    /// Which triangles belong to which entry, in order.
    pub meshes: Vec<MeshRange>,
    /// Spheres of all entries.
    pub spheres: Vec<Sphere>,
    /// Looks of the scene's entries.
    pub materials: Vec<Material>,
    /// Whether `positions` and `faces` are empty, and meshes stay in object space ([`placed`]). Triangles have the
    /// same numbers as otherwise.
    pub placed: bool,
}

impl Geometry {
    /// All that `entries` are made of, in a given frame or in one that fits them.
    ///
    /// # Errors
    /// No entries, or more triangles than 32-bit corner ids can count.
    pub fn new(entries: &[Entry], frame: Option<Frame>) -> Result<Self> {
        if entries.is_empty() {
            return Err(Error::scene("scene", "it has no meshes or spheres"));
        }
        let mut world: Vec<Vec<DVec3>> = Vec::new();
        let mut meshes = Vec::new();
        let mut faces: Vec<[u32; 3]> = Vec::new();
        let mut first_vertex = 0usize;
        let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (entry, e) in entries.iter().enumerate() {
            match &e.shape {
                Body::Mesh(mesh, transform) => {
                    let count = faces.len() + mesh.faces().len();
                    let limit = u32::MAX as usize / 4;
                    if count > limit || first_vertex + mesh.vertices().len() > limit {
                        let what = "scene".to_string();
                        return Err(Error::TooLarge {
                            what,
                            count,
                            items: "triangles",
                            limit,
                        });
                    }
                    let moved: Vec<DVec3> = mesh
                        .vertices()
                        .par_iter()
                        .map(|&v| transform.transform_point3(v))
                        .collect();
                    let (low, high) = mesh
                        .faces()
                        .par_iter()
                        .map(|f| {
                            let [a, b, c] = f.map(|v| moved[v as usize]);
                            (a.min(b).min(c), a.max(b).max(c))
                        })
                        .reduce(|| (DVec3::INFINITY, DVec3::NEG_INFINITY), union);
                    if !(low.is_finite() && high.is_finite() && (high - low).is_finite()) {
                        let what = format!("mesh {:?}", e.name);
                        return Err(Error::scene(what, "its world coordinates overflow"));
                    }
                    bounds = union(bounds, (low, high));
                    meshes.push(MeshRange {
                        entry: entry as u32,
                        first_face: faces.len() as u32,
                        faces: mesh.faces().len() as u32,
                        first_vertex: first_vertex as u32,
                        mesh: mesh.clone(),
                        transform: *transform,
                        bounds: (low, high),
                    });
                    let base = first_vertex as u32;
                    faces.extend(mesh.faces().iter().map(|f| f.map(|v| v + base)));
                    first_vertex += moved.len();
                    world.push(moved);
                }
                Body::Spheres(spheres) => {
                    for &(c, r) in spheres.iter() {
                        bounds = union(bounds, (c - r, c + r));
                    }
                }
            }
        }
        check_bounds(bounds)?;
        let mut vertices = world.iter();
        let solids: Vec<Solid> = entries
            .iter()
            .map(|e| match &e.shape {
                Body::Mesh(mesh, _) => {
                    Solid::Mesh(vertices.next().map_or(&[], Vec::as_slice), mesh.faces())
                }
                Body::Spheres(spheres) => Solid::Spheres(spheres),
            })
            .collect();
        let mut frame = match frame {
            Some(frame) => frame,
            None => frame::choose(bounds.0, bounds.1, &solids)?,
        };
        frame::check(&mut frame, &solids, |entry| {
            format!("mesh {:?}", entries[entry].name)
        })?;
        let mut positions = Vec::with_capacity(first_vertex);
        // In local units, of what the bounds are of.
        let far = (frame.to_local(bounds.0).abs()).max(frame.to_local(bounds.1).abs());
        let most = 2.0 * far.max_element().max(1.0);
        for vertices in &world {
            // A vertex that no face uses may lie anywhere; clamped, it stays finite in f32.
            let local = |v: &DVec3| {
                frame
                    .to_local(*v)
                    .clamp(DVec3::splat(-most), DVec3::splat(most))
            };
            positions.par_extend(vertices.par_iter().map(|v| local(v).as_vec3()));
        }
        Ok(Geometry {
            frame,
            positions,
            faces,
            meshes,
            spheres: local_spheres(entries, &frame),
            materials: entries.iter().map(|e| e.material).collect(),
            placed: false,
        })
    }

    /// A geometry with the same triangles and looks and all positions moved by `f`; spheres, which would be none, stay
    /// where they are.
    pub fn mapped(&self, f: impl Fn(DVec3) -> DVec3 + Sync) -> Geometry {
        let moved = |p: &Vec3| f(p.as_dvec3()).as_vec3();
        Geometry {
            frame: self.frame,
            positions: self.positions.par_iter().map(moved).collect(),
            faces: self.faces.clone(),
            meshes: self.meshes.clone(),
            spheres: self.spheres.clone(),
            materials: self.materials.clone(),
            placed: self.placed,
        }
    }

    /// Bytes of its arrays, without the hierarchies.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.positions[..]) + size_of_val(&self.faces[..])
    }

    /// Corners of a triangle.
    #[inline(always)]
    pub fn corners(&self, face: u32) -> [Vec3; 3] {
        // `map` is a call in some callers, and this is in their inner loops.
        let [a, b, c] = self.faces[face as usize];
        let positions = &self.positions;
        [
            positions[a as usize],
            positions[b as usize],
            positions[c as usize],
        ]
    }

    /// The mesh that a triangle belongs to.
    pub fn mesh_of(&self, face: u32) -> &MeshRange {
        &self.meshes[self.meshes.partition_point(|m| m.first_face <= face) - 1]
    }

    /// The mesh as [`Geometry::mesh_of`] finds it, for triangles that mostly belong to the mesh of the one before.
    pub fn mesh_after<'a>(&'a self, last: &mut Option<&'a MeshRange>, face: u32) -> &'a MeshRange {
        match *last {
            Some(mesh) if face.wrapping_sub(mesh.first_face) < mesh.faces => mesh,
            _ => last.insert(self.mesh_of(face)),
        }
    }

    /// The material of an entry.
    pub fn material(&self, entry: u32) -> &Material {
        &self.materials[entry as usize]
    }
}

/// Checks a scene's world bounds.
fn check_bounds(bounds: (DVec3, DVec3)) -> Result<()> {
    if !(bounds.1 - bounds.0).is_finite() {
        return Err(Error::scene("scene", "its world coordinates overflow"));
    }
    if bounds.0 == bounds.1 {
        let reason = format!("in f64 all of it lies in the one world point {}", bounds.0);
        return Err(Error::scene("scene", reason));
    }
    Ok(())
}

/// Spheres of all entries.
fn local_spheres(entries: &[Entry], frame: &Frame) -> Vec<Sphere> {
    let mut spheres = Vec::new();
    for (entry, e) in entries.iter().enumerate() {
        let Body::Spheres(list) = &e.shape else {
            continue;
        };
        spheres.extend(list.iter().enumerate().map(|(index, &(c, r))| Sphere {
            center: frame.to_local(c),
            radius: r / frame.unit,
            entry: entry as u32,
            index: index as u32,
        }));
    }
    spheres
}

fn union(a: (DVec3, DVec3), b: (DVec3, DVec3)) -> (DVec3, DVec3) {
    (a.0.min(b.0), a.1.max(b.1))
}

/// Distance of a point from a triangle.
pub(crate) fn distance(corners: [DVec3; 3], p: DVec3) -> f64 {
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let mut inside = normal != DVec3::ZERO;
    let mut nearest = f64::INFINITY;
    for i in 0..3 {
        let (a, b) = (corners[i], corners[(i + 1) % 3]);
        let (along, from) = (b - a, p - a);
        inside &= normal.cross(along).dot(from) >= 0.0;
        let squared = along.length_squared();
        let part = if squared > 0.0 {
            (from.dot(along) / squared).clamp(0.0, 1.0)
        } else {
            0.0
        };
        nearest = nearest.min((from - part * along).length());
    }
    if inside {
        nearest = nearest.min(normal.dot(p - corners[0]).abs() / normal.length());
    }
    nearest
}
