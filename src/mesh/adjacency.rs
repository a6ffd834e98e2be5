//! Edges of a triangle mesh with all faces at them.
//!
//! Any number of faces may meet at an edge: one at a boundary, two where the mesh is manifold, more
//! elsewhere. A face that repeats a vertex has no area and no place here. Edges are sorted by their
//! vertices and the faces at an edge by index, so the result depends on the faces alone.

use rayon::prelude::*;

/// A face at an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Incident {
    /// The face.
    pub face: u32,
    /// Its corner that is not on the edge.
    pub opposite: u32,
    /// Whether the face runs through the edge from its lower to its higher vertex.
    pub forward: bool,
}

/// The edges of a mesh, each with the faces at it.
#[derive(Debug, Clone)]
pub struct Adjacency {
    edges: Vec<[u32; 2]>,
    first: Vec<u32>,
    incident: Vec<Incident>,
    pairs: Vec<[u32; 2]>,
}

impl Adjacency {
    /// Finds the edges of `faces`, whose vertices must already be joined.
    pub fn new(faces: &[[u32; 3]]) -> Self {
        let mut halves: Vec<(u64, u32)> = faces
            .par_iter()
            .enumerate()
            .filter(|(_, f)| f[0] != f[1] && f[1] != f[2] && f[2] != f[0])
            .flat_map_iter(|(face, f)| {
                (0..3).map(move |corner| {
                    let (a, b) = (f[corner], f[(corner + 1) % 3]);
                    let key = (u64::from(a.min(b)) << 32) | u64::from(a.max(b));
                    (key, face as u32 * 3 + corner as u32)
                })
            })
            .collect();
        halves.par_sort_unstable();
        let mut edges = Vec::with_capacity(halves.len() / 2);
        let mut first = Vec::with_capacity(halves.len() / 2 + 1);
        let mut incident = Vec::with_capacity(halves.len());
        for (i, &(key, half)) in halves.iter().enumerate() {
            let edge = [(key >> 32) as u32, key as u32];
            if i == 0 || halves[i - 1].0 != key {
                edges.push(edge);
                first.push(i as u32);
            }
            let (face, corner) = (half / 3, half as usize % 3);
            let f = faces[face as usize];
            incident.push(Incident {
                face,
                opposite: f[(corner + 2) % 3],
                forward: f[corner] == edge[0],
            });
        }
        first.push(halves.len() as u32);
        let none = faces.len() as u32;
        let pairs = first
            .windows(2)
            .map(|ends| match &incident[ends[0] as usize..ends[1] as usize] {
                [a, b] if a.forward != b.forward => [a.face, b.face],
                _ => [none, none + 1],
            })
            .collect();
        Adjacency {
            edges,
            first,
            incident,
            pairs,
        }
    }

    /// For every vertex the lowest vertex that edges connect it with: one number a connected part.
    pub fn components(&self, vertices: usize) -> Vec<u32> {
        let mut parent: Vec<u32> = (0..vertices as u32).collect();
        let root = |parent: &mut Vec<u32>, mut v: u32| {
            while parent[v as usize] != v {
                // Halving the path keeps it short.
                parent[v as usize] = parent[parent[v as usize] as usize];
                v = parent[v as usize];
            }
            v
        };
        for &[a, b] in &self.edges {
            let (a, b) = (root(&mut parent, a), root(&mut parent, b));
            parent[a.max(b) as usize] = a.min(b);
        }
        (0..vertices as u32).map(|v| root(&mut parent, v)).collect()
    }

    /// Vertex pairs, the lower index first.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// Faces at an edge.
    pub fn incident(&self, edge: usize) -> &[Incident] {
        &self.incident[self.first[edge] as usize..self.first[edge + 1] as usize]
    }

    /// For every edge with two faces that run through it in opposite directions these two; for every other
    /// edge the number of faces and the number after it.
    ///
    /// So whoever gives each face a value, and these two beyond the last face two different ones, need not
    /// look at an edge any closer if its pair have equal values.
    pub fn pairs(&self) -> &[[u32; 2]] {
        &self.pairs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_faces(adjacency: &Adjacency, wanted: impl Fn(usize) -> bool) -> usize {
        (0..adjacency.edges().len())
            .filter(|&e| wanted(adjacency.incident(e).len()))
            .count()
    }

    fn boundary(adjacency: &Adjacency) -> usize {
        with_faces(adjacency, |faces| faces == 1)
    }

    fn non_manifold(adjacency: &Adjacency) -> usize {
        with_faces(adjacency, |faces| faces > 2)
    }

    #[test]
    fn a_tetrahedron_has_six_edges_with_two_opposite_faces_each() {
        let adjacency = Adjacency::new(&[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
        assert_eq!(adjacency.edges().len(), 6);
        for e in 0..6 {
            let [a, b] = adjacency.incident(e) else {
                panic!("edge {e} is not manifold")
            };
            assert_ne!(a.forward, b.forward, "edge {e} is wound consistently");
            assert_ne!(a.opposite, b.opposite);
            assert_eq!(adjacency.pairs()[e], [a.face, b.face]);
        }
        assert_eq!((boundary(&adjacency), non_manifold(&adjacency)), (0, 0));
    }

    #[test]
    fn three_sheets_share_one_edge_and_degenerate_faces_are_left_out() {
        let adjacency = Adjacency::new(&[[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 0, 1]]);
        assert_eq!(adjacency.edges().len(), 7);
        assert_eq!(adjacency.incident(0).len(), 3);
        assert_eq!((boundary(&adjacency), non_manifold(&adjacency)), (6, 1));
        assert_eq!(adjacency.pairs(), &[[4, 5]; 7]);
    }

    #[test]
    fn two_faces_that_run_through_an_edge_in_one_direction_are_no_pair() {
        let adjacency = Adjacency::new(&[[0, 1, 2], [0, 1, 3]]);
        assert_eq!(adjacency.incident(0).len(), 2);
        assert_eq!(adjacency.pairs()[0], [2, 3]);
    }
}
