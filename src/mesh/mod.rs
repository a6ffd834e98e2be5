//! Triangle meshes: validation, joining of equal vertices, adjacency.
//!
//! - this file: [`TriMesh`], what every mesh is checked for, and which vertices are one;
//! - [`adjacency`]: edges with all the triangles at them, manifold or not;
//! - [`oriented`]: the faces without duplicates and wound alike;
//! - [`silhouettes`]: the edges that bound what a point sees as the mesh's outline, and their loops;
//! - [`tubes`]: curves made into closed tubes.

pub mod adjacency;
pub mod oriented;
pub mod silhouettes;
pub mod tubes;

use std::sync::OnceLock;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use adjacency::Adjacency;
use oriented::Oriented;

/// A validated triangle mesh in object space.
///
/// Vertices with exactly equal coordinates are one vertex to everything that looks at the mesh's
/// connectivity; nothing else is repaired. Degenerate and duplicate faces are kept.
#[derive(Debug)]
pub struct TriMesh {
    vertices: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
    uses_all: bool,
    adjacency: OnceLock<Adjacency>,
    components: OnceLock<Vec<u32>>,
    oriented: OnceLock<Option<Oriented>>,
}

impl TriMesh {
    /// Checks and stores a mesh. `faces` index `vertices`; signed so that -1 can be reported.
    ///
    /// # Errors
    /// No faces, an index out of range, a coordinate that is not finite, or no extent.
    pub fn new(name: &str, vertices: Vec<DVec3>, faces: &[[i64; 3]]) -> Result<Self> {
        if faces.is_empty() {
            return Err(Error::EmptyMesh {
                mesh: name.into(),
                vertices: vertices.len(),
            });
        }
        for (items, count) in [("vertices", vertices.len()), ("faces", faces.len())] {
            // Corner ids (3 per face) are 32-bit.
            let limit = u32::MAX as usize / 4;
            if count > limit {
                return Err(Error::TooLarge {
                    what: format!("mesh {name:?}"),
                    count,
                    items,
                    limit,
                });
            }
        }
        check_finite(&format!("mesh {name:?}"), "vertex", &vertices)?;
        let count = vertices.len();
        let representative = join_equal(&vertices);
        let mut welded = Vec::with_capacity(faces.len());
        for (face, corners) in faces.iter().enumerate() {
            let mut out = [0u32; 3];
            for (slot, &index) in out.iter_mut().zip(corners) {
                let valid = usize::try_from(index).ok().filter(|&i| i < count);
                let Some(i) = valid else {
                    return Err(Error::FaceIndex {
                        mesh: name.into(),
                        face,
                        index,
                        count,
                    });
                };
                *slot = representative[i];
            }
            welded.push(out);
        }
        let mut used = vec![false; count];
        for &v in welded.iter().flatten() {
            used[v as usize] = true;
        }
        let mesh = TriMesh {
            vertices,
            faces: welded,
            uses_all: representative.iter().all(|&v| used[v as usize]),
            adjacency: OnceLock::new(),
            components: OnceLock::new(),
            oriented: OnceLock::new(),
        };
        mesh.check_extent(name)?;
        Ok(mesh)
    }

    /// Returns the mesh with its vertices moved and its connectivity kept.
    ///
    /// # Errors
    /// Another number of vertices, a coordinate that is not finite, no extent, or equal vertices
    /// that are no longer equal.
    pub fn with_vertices(&self, name: &str, vertices: Vec<DVec3>) -> Result<Self> {
        let what = format!("mesh {name:?}");
        if vertices.len() != self.vertices.len() {
            let (old, new) = (self.vertices.len(), vertices.len());
            return Err(Error::scene(
                what,
                format!("expected {old} vertices as before, got {new}"),
            ));
        }
        check_finite(&what, "vertex", &vertices)?;
        for (i, &r) in join_equal(&self.vertices).iter().enumerate() {
            if vertices[i] != vertices[r as usize] {
                let reason = format!(
                    "vertices {r} and {i} were at one position and are one vertex; they must stay equal"
                );
                return Err(Error::scene(what, reason));
            }
        }
        let mesh = TriMesh {
            vertices,
            faces: self.faces.clone(),
            uses_all: self.uses_all,
            adjacency: self.adjacency.clone(),
            components: self.components.clone(),
            oriented: self.oriented.clone(),
        };
        mesh.check_extent(name)?;
        Ok(mesh)
    }

    /// All vertices, joined ones included.
    pub fn vertices(&self) -> &[DVec3] {
        &self.vertices
    }

    /// Faces; of vertices at one position always the same index is used.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// Whether all vertices are corners of faces, or where a corner is.
    pub fn uses_all_vertices(&self) -> bool {
        self.uses_all
    }

    /// Edges and the faces at them; built at the first call.
    pub fn adjacency(&self) -> &Adjacency {
        self.adjacency.get_or_init(|| Adjacency::new(&self.faces))
    }

    /// Faces without duplicates and wound alike, and their edges; found at the first call.
    pub fn oriented(&self) -> (&[[u32; 3]], &Adjacency) {
        let found = self
            .oriented
            .get_or_init(|| Oriented::new(&self.faces, self.adjacency()));
        match found {
            Some(o) => (&o.faces, &o.adjacency),
            None => (&self.faces, self.adjacency()),
        }
    }

    /// For every vertex a number of the connected part that it belongs to; built at the first call.
    pub fn components(&self) -> &[u32] {
        self.components
            .get_or_init(|| self.adjacency().components(self.vertices.len()))
    }

    fn check_extent(&self, name: &str) -> Result<()> {
        let first = self.vertices[self.faces[0][0] as usize];
        if self
            .faces
            .iter()
            .flatten()
            .any(|&v| self.vertices[v as usize] != first)
        {
            return Ok(());
        }
        let point = first.to_array();
        Err(Error::NoExtent {
            mesh: name.into(),
            faces: self.faces.len(),
            point,
        })
    }
}

/// Returns an error that names the first point with a NaN or infinite coordinate.
///
/// # Errors
/// As said.
pub fn check_finite(what: &str, item: &'static str, points: &[DVec3]) -> Result<()> {
    match points.par_iter().position_first(|p| !p.is_finite()) {
        None => Ok(()),
        Some(index) => {
            let value = points[index].to_array();
            Err(Error::NotFinite {
                what: what.into(),
                item,
                index,
                value,
            })
        }
    }
}

/// For every vertex the lowest index of a vertex with exactly equal coordinates (`-0` equals `0`).
fn join_equal(vertices: &[DVec3]) -> Vec<u32> {
    // Adding zero turns -0 into 0.
    let key = |i: u32| {
        (vertices[i as usize] + DVec3::ZERO)
            .to_array()
            .map(f64::to_bits)
    };
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    order.par_sort_unstable_by_key(|&i| (key(i), i));
    let mut representative = vec![0; vertices.len()];
    let mut current = 0;
    for (k, &i) in order.iter().enumerate() {
        if k == 0 || key(order[k - 1]) != key(i) {
            current = i;
        }
        representative[i as usize] = current;
    }
    representative
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quad_soup() -> (Vec<DVec3>, Vec<[i64; 3]>) {
        let v = [(0., 0.), (1., 0.), (1., 1.), (0., 0.), (1., 1.), (0., 1.)];
        (
            v.iter().map(|&(x, y)| DVec3::new(x, y, -0.0)).collect(),
            vec![[0, 1, 2], [3, 4, 5]],
        )
    }

    #[test]
    fn equal_vertices_are_joined_and_others_are_not() {
        let (v, f) = quad_soup();
        let mesh = TriMesh::new("quad", v, &f).unwrap();
        assert_eq!(mesh.faces(), &[[0, 1, 2], [0, 2, 5]]);
        assert_eq!(mesh.adjacency().edges().len(), 5);
    }

    #[test]
    fn errors_name_mesh_index_and_value() {
        let (mut v, f) = quad_soup();
        let out_of_range = TriMesh::new("q", v.clone(), &[[0, 1, 6]])
            .unwrap_err()
            .to_string();
        assert_eq!(
            out_of_range,
            "mesh \"q\": face 0 refers to vertex 6, allowed are 0 to 5 (6 vertices)"
        );
        let empty = TriMesh::new("q", v.clone(), &[]).unwrap_err().to_string();
        assert_eq!(empty, "mesh \"q\": it has no faces (6 vertices)");
        let point = TriMesh::new("q", v.clone(), &[[0, 0, 3]]).unwrap_err();
        assert!(matches!(point, Error::NoExtent { faces: 1, .. }));
        v[4].y = f64::NAN;
        let nan = TriMesh::new("q", v, &f).unwrap_err().to_string();
        assert_eq!(nan, "mesh \"q\": vertex 4 is not finite: [1.0, NaN, -0.0]");
    }

    #[test]
    fn moved_vertices_keep_joined_ones_joined() {
        let (v, f) = quad_soup();
        let mesh = TriMesh::new("q", v.clone(), &f).unwrap();
        let moved: Vec<_> = v.iter().map(|p| *p * 2.0).collect();
        assert_eq!(
            mesh.with_vertices("q", moved).unwrap().faces(),
            mesh.faces()
        );
        let mut torn = v;
        torn[3].x = 0.5;
        let error = mesh.with_vertices("q", torn).unwrap_err().to_string();
        assert!(error.contains("vertices 0 and 3"), "{error}");
    }
}
