//! A mesh's faces without duplicates and wound alike, for what tells front layers from back layers.
//!
//! Of faces with the same three vertices the first is kept. Faces that share an edge are wound alike: first
//! those at edges of two faces, then, as far as that leaves a choice, those at edges of more, so that sheets
//! that meet face the same way. Where no winding is consistent (a Möbius strip) edges are left where it is
//! not.

use rayon::prelude::*;

use super::adjacency::Adjacency;

/// Faces, and the edges between them.
#[derive(Debug, Clone)]
pub struct Oriented {
    /// Vertex indices; fewer than the mesh's where some were duplicates.
    pub faces: Vec<[u32; 3]>,
    /// Their edges.
    pub adjacency: Adjacency,
}

impl Oriented {
    /// Orients faces; `None` where they already are.
    pub fn new(faces: &[[u32; 3]], adjacency: &Adjacency) -> Option<Self> {
        let distinct = without_duplicates(faces);
        let known = (distinct.len() < faces.len()).then(|| Adjacency::new(&distinct));
        let turned = turned(distinct.len(), known.as_ref().unwrap_or(adjacency));
        if known.is_none() && !turned.contains(&true) {
            return None;
        }
        let mut faces = distinct;
        for (face, turned) in faces.iter_mut().zip(turned) {
            if turned {
                face.swap(1, 2);
            }
        }
        let adjacency = Adjacency::new(&faces);
        Some(Oriented { faces, adjacency })
    }
}

fn without_duplicates(faces: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut keys: Vec<([u32; 3], u32)> = faces
        .par_iter()
        .enumerate()
        .map(|(i, f)| {
            let mut key = *f;
            key.sort_unstable();
            (key, i as u32)
        })
        .collect();
    keys.par_sort_unstable();
    keys.dedup_by_key(|k| k.0);
    let mut kept: Vec<u32> = keys.into_iter().map(|k| k.1).collect();
    kept.par_sort_unstable();
    kept.into_iter().map(|i| faces[i as usize]).collect()
}

/// Faces that are known to be wound alike or not, in sets with a representative each.
struct Sets {
    parent: Vec<u32>,
    /// Whether a face is wound against its parent.
    against: Vec<bool>,
}

impl Sets {
    /// The representative of a face's set, and whether the face is wound against it.
    fn find(&mut self, face: u32) -> (u32, bool) {
        let (mut root, mut against) = (face, false);
        while self.parent[root as usize] != root {
            against ^= self.against[root as usize];
            root = self.parent[root as usize];
        }
        // The path now leads there at once.
        let (mut at, mut left) = (face, against);
        while self.parent[at as usize] != root && at != root {
            let (parent, own) = (self.parent[at as usize], self.against[at as usize]);
            (self.parent[at as usize], self.against[at as usize]) = (root, left);
            (at, left) = (parent, left ^ own);
        }
        (root, against)
    }

    /// Joins two sets; the lower representative stays, so that the first face keeps its winding.
    fn join(&mut self, a: u32, b: u32, against: bool) {
        let ((a, turned_a), (b, turned_b)) = (self.find(a), self.find(b));
        if a != b {
            self.parent[a.max(b) as usize] = a.min(b);
            self.against[a.max(b) as usize] = turned_a ^ turned_b ^ against;
        }
    }
}

/// Which faces have to be turned.
fn turned(faces: usize, adjacency: &Adjacency) -> Vec<bool> {
    let mut sets = Sets {
        parent: (0..faces as u32).collect(),
        against: vec![false; faces],
    };
    for two in [true, false] {
        for e in 0..adjacency.edges().len() {
            let incident = adjacency.incident(e);
            if (incident.len() == 2) == two {
                for pair in incident.windows(2) {
                    let against = pair[0].forward == pair[1].forward;
                    sets.join(pair[0].face, pair[1].face, against);
                }
            }
        }
    }
    (0..faces as u32).map(|f| sets.find(f).1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    fn oriented(faces: &[[u32; 3]]) -> Option<Vec<[u32; 3]>> {
        Oriented::new(faces, &Adjacency::new(faces)).map(|o| o.faces)
    }

    #[test]
    fn a_mesh_that_is_in_order_stays_as_it_is() {
        assert!(oriented(&TETRAHEDRON).is_none());
        assert!(oriented(&TETRAHEDRON[..2]).is_none());
    }

    #[test]
    fn turned_faces_are_turned_back_and_duplicates_go() {
        let mut faces = TETRAHEDRON.to_vec();
        faces[2].swap(0, 1);
        let same = |f: &[u32; 3]| {
            let low = f.iter().min().unwrap();
            let at = f.iter().position(|v| v == low).unwrap();
            [f[at], f[(at + 1) % 3], f[(at + 2) % 3]]
        };
        let expected: Vec<_> = TETRAHEDRON.iter().map(same).collect();
        let found: Vec<_> = oriented(&faces).unwrap().iter().map(same).collect();
        assert_eq!(found, expected);
        faces = TETRAHEDRON.to_vec();
        faces.push([3, 1, 0]);
        faces.push([1, 2, 3]);
        let found: Vec<_> = oriented(&faces).unwrap().iter().map(same).collect();
        assert_eq!(found, expected);
    }
}
