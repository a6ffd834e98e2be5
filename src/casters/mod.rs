//! The silhouette edges of everything that casts, as a light's centre sees them.

pub(crate) mod behind;
pub mod edges;

use crate::scene::snapshot::Snapshot;
use std::ops::Range;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::control::Control;
use crate::error::{Error, Result};
use crate::geometry::MeshRange;
use crate::light::Light;
use crate::mesh::silhouettes::silhouette_edges;
use edges::Edge;

/// Triangles that one task looks at: enough to outweigh a task.
pub const CHUNK: usize = 4096;

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
    geometry: Arc<Snapshot>,
    meshes: Vec<usize>,
}

impl Casters {
    /// Finds what casts.
    ///
    /// # Errors
    /// Something that casts and is transparent (unless `opaque`), or is a sphere without triangles.
    pub fn new(method: &'static str, geometry: Arc<Snapshot>, opaque: bool) -> Result<Self> {
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
    pub fn geometry(&self) -> &Snapshot {
        &self.geometry
    }

    /// The scene, to be kept.
    pub fn shared(&self) -> &Arc<Snapshot> {
        &self.geometry
    }

    /// All triangles that cast, mesh by mesh, as they are in [`crate::geometry::Geometry::faces`].
    pub fn face_ranges(&self) -> impl Iterator<Item = Range<u32>> {
        self.ranges().map(|m| m.first_face..m.first_face + m.faces)
    }

    /// Their numbers.
    pub fn face_ids(&self) -> impl ParallelIterator<Item = u32> {
        let ranges: Vec<_> = self.face_ranges().collect();
        ranges.into_par_iter().flatten()
    }

    /// All triangles that cast, as corners in [`crate::geometry::Geometry::positions`], without duplicates and wound alike.
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
    fn lie_in_plane(&self, light: &Light) -> bool {
        let Some(normal) = light.normal() else {
            return false;
        };
        let (near, center) = (light.lift().length(), light.center());
        let in_plane = |p: Vec3| normal.dot(p.as_dvec3() - center).abs() <= near;
        let geometry = &self.geometry;
        self.face_ids()
            .any(|face| geometry.corners(face).into_iter().all(in_plane))
    }

    /// A light, moved off what lies in its plane, if something does: only then, as silhouettes jump where edges pass
    /// through the light's centre.
    pub fn off_ceilings(&self, light: &Light) -> Light {
        if self.lie_in_plane(light) {
            light.lifted()
        } else {
            light.clone()
        }
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
