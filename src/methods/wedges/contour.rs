//! The silhouette edges of everything that casts, as a light's centre sees them.

use std::ops::Range;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::control::Control;
use crate::error::{Error, Result};
use crate::geometry::{Geometry, MeshRange};
use crate::light::Light;
use crate::mesh::silhouettes::silhouette_edges;
use crate::sampling::lift;

/// A silhouette edge.
///
/// It runs so that, seen from the light's centre, what it occludes is on its left; where it bounds more
/// than one layer, or front and back layers differently, the numbers say so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Local positions of its ends.
    pub ends: [DVec3; 2],
    /// Indices of its ends in [`Geometry::positions`].
    pub vertices: [u32; 2],
    /// Layers facing the light on its left less those on its right.
    pub front: i32,
    /// Layers facing away on its left less those on its right.
    pub back: i32,
    /// The connected object that it belongs to; edges are in the order of their objects.
    pub object: u32,
}

/// Orders edges so that, within an object, those that bound the same layers follow each other end to start
/// where they can.
pub fn in_chains(edges: &[Edge]) -> Vec<Edge> {
    let start = |e: u32| edges[e as usize].vertices[0];
    let kind = |e: u32| {
        let edge = &edges[e as usize];
        (edge.object, edge.front, edge.back)
    };
    let mut leaving: Vec<u32> = (0..edges.len() as u32).collect();
    leaving.sort_by_key(|&e| start(e));
    let mut used = vec![false; edges.len()];
    let mut out = Vec::with_capacity(edges.len());
    for first in 0..edges.len() as u32 {
        let mut next = Some(first).filter(|&e| !used[e as usize]);
        while let Some(edge) = next {
            used[edge as usize] = true;
            out.push(edges[edge as usize]);
            let end = edges[edge as usize].vertices[1];
            let from = leaving.partition_point(|&e| start(e) < end);
            let ahead = leaving[from..].iter().copied();
            next = ahead
                .take_while(|&e| start(e) == end)
                .find(|&e| !used[e as usize] && kind(e) == kind(edge));
        }
    }
    out
}

/// Returns an error unless everything that casts is opaque, or is to count as `opaque`.
///
/// # Errors
/// As said.
pub fn check_opacity(
    method: &'static str,
    mut casts: impl Iterator<Item = f32>,
    opaque: bool,
) -> Result<()> {
    match casts.find(|o| *o < 1.0) {
        Some(opacity) if !opaque => {
            let reason = format!(
                "it cannot model an opacity of {opacity}; opacity=\"opaque\" lets every mesh of an \
                 opacity above 0 block all light"
            );
            Err(Error::Unsupported { method, reason })
        }
        _ => Ok(()),
    }
}

/// What casts: opaque meshes, or all if transparent ones are to count as opaque.
#[derive(Debug, Clone)]
pub struct Casters {
    geometry: Arc<Geometry>,
    meshes: Vec<usize>,
}

impl Casters {
    /// Finds what casts.
    ///
    /// # Errors
    /// Something that casts and is transparent (unless `opaque`), or is a sphere without triangles.
    pub fn new(method: &'static str, geometry: Arc<Geometry>, opaque: bool) -> Result<Self> {
        let material = |entry: u32| geometry.material(entry);
        if geometry.spheres.iter().any(|s| material(s.entry).casts) {
            let reason = "spheres of add_spheres have no silhouette edges; add them as meshes, or \
                          with casts=False"
                .into();
            return Err(Error::Unsupported { method, reason });
        }
        let casts: Vec<usize> = (0..geometry.meshes.len())
            .filter(|&m| material(geometry.meshes[m].entry).casts)
            .collect();
        let opacity = |&m: &usize| material(geometry.meshes[m].entry).opacity;
        check_opacity(method, casts.iter().map(opacity), opaque)?;
        let meshes = casts.into_iter().filter(|m| opacity(m) > 0.0).collect();
        Ok(Casters { geometry, meshes })
    }

    /// Builds the adjacency, and the connected parts if `objects` are to be told apart.
    ///
    /// # Errors
    /// [`Error::Cancelled`], between two meshes.
    pub fn connect(&self, objects: bool, control: &Control) -> Result<()> {
        for mesh in self.ranges() {
            control.check()?;
            mesh.mesh.oriented();
            if objects {
                mesh.mesh.components();
            }
        }
        control.check()
    }

    fn ranges(&self) -> impl Iterator<Item = &MeshRange> {
        self.meshes.iter().map(|&m| &self.geometry.meshes[m])
    }

    /// The scene.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// All triangles that cast, mesh by mesh, as they are in [`Geometry::faces`].
    pub fn face_ranges(&self) -> impl Iterator<Item = Range<u32>> {
        self.ranges().map(|m| m.first_face..m.first_face + m.faces)
    }

    /// Their numbers.
    pub fn face_ids(&self) -> impl ParallelIterator<Item = u32> {
        let ranges: Vec<_> = self.face_ranges().collect();
        ranges.into_par_iter().flatten()
    }

    /// All triangles that cast, as corners in [`Geometry::positions`], without duplicates and wound alike.
    pub fn faces(&self) -> impl ParallelIterator<Item = [u32; 3]> {
        let meshes: Vec<_> = self.ranges().collect();
        meshes.into_par_iter().flat_map(|mesh| {
            let faces = mesh.mesh.oriented().0.par_iter();
            faces.map(|f| f.map(|v| v + mesh.first_vertex))
        })
    }

    /// The object of a vertex: 0 unless `objects`.
    pub fn object_of(&self, vertex: u32, objects: bool) -> u32 {
        if !objects {
            return 0;
        }
        let meshes = &self.geometry.meshes;
        let mesh = &meshes[meshes.partition_point(|m| m.first_vertex <= vertex) - 1];
        mesh.first_vertex + mesh.mesh.components()[(vertex - mesh.first_vertex) as usize]
    }

    /// Whether a triangle lies in a flat light's plane, up to what samples are moved off the light.
    pub fn lie_in_plane(&self, light: &Light) -> bool {
        let Some(normal) = light.normal() else {
            return false;
        };
        let (near, center) = (lift(light).length(), light.center());
        let in_plane = |p: Vec3| normal.dot(p.as_dvec3() - center).abs() <= near;
        let geometry = &self.geometry;
        self.face_ids()
            .any(|face| geometry.corners(face).into_iter().all(in_plane))
    }

    /// The silhouette edges that `center` sees.
    ///
    /// Duplicate faces are counted once. With `objects`, every connected part of a mesh is an object of its
    /// own; otherwise there is one.
    pub fn silhouettes(&self, center: DVec3, objects: bool) -> Vec<Edge> {
        let mut out = Vec::new();
        for mesh in self.ranges() {
            let positions = &self.geometry.positions[mesh.first_vertex as usize..];
            let position = |v: u32| positions[v as usize].as_dvec3();
            let (faces, adjacency) = mesh.mesh.oriented();
            let found = silhouette_edges(position, faces, adjacency, center);
            let start = out.len();
            out.extend(found.iter().map(|s| {
                let [mut a, mut b] = adjacency.edges()[s.edge as usize];
                let (mut front, mut back) = (s.front, s.back);
                if front + back < 0 {
                    (a, b, front, back) = (b, a, -front, -back);
                }
                let vertices = [a + mesh.first_vertex, b + mesh.first_vertex];
                Edge {
                    ends: [position(a), position(b)],
                    vertices,
                    front,
                    back,
                    object: self.object_of(vertices[0], objects),
                }
            }));
            if objects {
                out[start..].par_sort_by_key(|e: &Edge| e.object);
            }
        }
        out
    }
}
