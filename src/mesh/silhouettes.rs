//! Silhouette edges of a mesh as a point sees them.
//!
//! An edge between two faces is a silhouette edge where the point is in front of one and behind the
//! other (Akenine-Möller and Assarsson 2002, Section 3). An edge with one face is always one. At an
//! edge with more faces, those that lie on the same side of it as seen from the point are counted:
//! it is a silhouette edge unless both sides have the same number. Each silhouette edge carries a
//! `winding`: by how many layers the occlusion grows from its right to its left, as seen from the
//! point looking along the edge from its first to its second vertex.
//!
//! Sides are decided by `robust::orient3d`, exactly; a face that the point sees edge-on covers
//! nothing and has no side, so that its other edges take over its part of the outline.

use glam::DVec3;
use rayon::prelude::*;
use robust::{Coord3D, orient3d};

use super::adjacency::Adjacency;

/// An edge of the outline that a point sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SilhouetteEdge {
    /// Index of the edge in [`Adjacency::edges`].
    pub edge: u32,
    /// Layers of occlusion on the left of the edge less those on its right, never 0.
    pub winding: i32,
}

/// Finds the silhouette edges that `viewpoint` sees, in the order of the edges.
pub fn silhouette_edges(
    positions: &[DVec3],
    faces: &[[u32; 3]],
    adjacency: &Adjacency,
    viewpoint: DVec3,
) -> Vec<SilhouetteEdge> {
    let side: Vec<i8> = faces
        .par_iter()
        .map(|f| {
            let [a, b, c] = f.map(|v| coord(positions[v as usize]));
            sign(orient3d(a, b, c, coord(viewpoint)))
        })
        .collect();
    (0..adjacency.edges().len())
        .into_par_iter()
        .filter_map(|edge| {
            // Seen from the front (`orient3d` negative in its convention is one fixed side), a face
            // that runs forward through the edge lies on one hand, and on the other from behind.
            let winding = adjacency
                .incident(edge)
                .iter()
                .map(|i| {
                    let hand = if i.forward { -1 } else { 1 };
                    hand * i32::from(side[i.face as usize])
                })
                .sum();
            (winding != 0).then_some(SilhouetteEdge {
                edge: edge as u32,
                winding,
            })
        })
        .collect()
}

fn coord(p: DVec3) -> Coord3D<f64> {
    Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    }
}

fn sign(x: f64) -> i8 {
    i8::from(x > 0.0) - i8::from(x < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let corner = |i: u32| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
        let faces = vec![
            [0, 2, 1],
            [1, 2, 3],
            [4, 5, 6],
            [5, 7, 6],
            [0, 1, 4],
            [1, 5, 4],
            [2, 6, 3],
            [3, 6, 7],
            [0, 4, 2],
            [2, 4, 6],
            [1, 3, 5],
            [3, 7, 5],
        ];
        ((0..8).map(corner).collect(), faces)
    }

    fn outline(viewpoint: DVec3) -> usize {
        let (p, f) = cube();
        silhouette_edges(&p, &f, &Adjacency::new(&f), viewpoint).len()
    }

    #[test]
    fn a_cube_shows_a_square_or_a_hexagon() {
        assert_eq!(outline(DVec3::new(0.5, 0.5, 5.0)), 4);
        assert_eq!(outline(DVec3::new(5.0, 6.0, 7.0)), 6);
    }

    #[test]
    fn a_cube_whose_side_is_seen_edge_on_still_shows_a_closed_outline() {
        // The viewpoint lies in the planes x = 1 and y = 1; every vertex of the outline must have
        // as many edges entering as leaving.
        let (p, f) = cube();
        let adjacency = Adjacency::new(&f);
        let found = silhouette_edges(&p, &f, &adjacency, DVec3::new(1.0, 1.0, 5.0));
        let mut balance = [0i32; 8];
        for s in &found {
            let [a, b] = adjacency.edges()[s.edge as usize];
            balance[a as usize] += s.winding;
            balance[b as usize] -= s.winding;
        }
        assert_eq!(balance, [0; 8]);
        assert!(!found.is_empty());
    }

    #[test]
    fn an_open_sheet_shows_its_boundary_and_opposite_windings_from_its_two_sides() {
        let p = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
        let f = vec![[0, 1, 2]];
        let adjacency = Adjacency::new(&f);
        let above = silhouette_edges(&p, &f, &adjacency, DVec3::Z);
        let below = silhouette_edges(&p, &f, &adjacency, -DVec3::Z);
        // Counter-clockwise seen from above: the face is on the left of every edge that runs with it.
        let left: Vec<i32> = above.iter().map(|s| s.winding).collect();
        assert_eq!(adjacency.edges(), &[[0, 1], [0, 2], [1, 2]]);
        assert_eq!(left, vec![1, -1, 1]);
        assert_eq!(
            below.iter().map(|s| s.winding).collect::<Vec<_>>(),
            vec![-1, 1, -1]
        );
    }
}
