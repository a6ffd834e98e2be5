//! Silhouette edges of a mesh as a point sees them, and the loops that they form.
//!
//! An edge between two faces is a silhouette edge where the point is in front of one and behind the
//! other (Akenine-Möller and Assarsson 2002, Section 3). An edge with one face is always one. At an
//! edge with more faces, those that lie on the same side of it as seen from the point are counted,
//! front faces and back faces apart: it is a silhouette edge unless both sides have the same numbers of
//! both. Each silhouette edge carries by how many layers the occlusion grows from its right to its left,
//! as seen from the point looking along the edge from its first to its second vertex: `front` layers
//! that face the point and `back` layers that face away. Both are balanced at every vertex.
//!
//! Sides are decided exactly: a floating-point filter first, `robust::orient3d` where it cannot tell; a
//! face that the point sees edge-on covers nothing and has no side, so that its other edges take over its
//! part of the outline.

use glam::DVec3;
use rayon::prelude::*;
use robust::{Coord3D, orient3d};

use super::adjacency::Adjacency;

/// Faces or edges that one task looks at: enough to outweigh a task.
const CHUNK: usize = 4096;

/// Shewchuk's error bound of the determinant in [`side_of`], relative to its permanent.
const FILTER: f64 = (7.0 + 56.0 * HALF_ULP) * HALF_ULP;

/// Half an ulp of 1.
const HALF_ULP: f64 = 0.5 * f64::EPSILON;

/// An edge of the outline that a point sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SilhouetteEdge {
    /// Index of the edge in [`Adjacency::edges`].
    pub edge: u32,
    /// Layers that face the point on the left of the edge less those on its right.
    pub front: i32,
    /// Layers that face away on the left of the edge less those on its right.
    pub back: i32,
}

impl SilhouetteEdge {
    /// Layers of both kinds on the left less those on the right.
    pub fn winding(&self) -> i32 {
        self.front + self.back
    }
}

/// Which side of a face a point is on: 1 in front (its corners counter-clockwise as the point sees
/// them), -1 behind, 0 in its plane; exact.
#[inline]
pub fn side_of(corners: [DVec3; 3], point: DVec3) -> i8 {
    let [a, b, c] = corners.map(|v| v - point);
    let (bc, ca, ab) = (
        [b.x * c.y, c.x * b.y],
        [c.x * a.y, a.x * c.y],
        [a.x * b.y, b.x * a.y],
    );
    let det = a.z * (bc[0] - bc[1]) + b.z * (ca[0] - ca[1]) + c.z * (ab[0] - ab[1]);
    let permanent = (bc[0].abs() + bc[1].abs()) * a.z.abs()
        + (ca[0].abs() + ca[1].abs()) * b.z.abs()
        + (ab[0].abs() + ab[1].abs()) * c.z.abs();
    let bound = FILTER * permanent;
    if det > bound {
        return -1;
    }
    if det < -bound {
        return 1;
    }
    let [a, b, c] = corners.map(coord);
    let exact = orient3d(a, b, c, coord(point));
    i8::from(exact < 0.0) - i8::from(exact > 0.0)
}

/// Finds the silhouette edges that `viewpoint` sees, in the order of the edges.
pub fn silhouette_edges(
    position: impl Fn(u32) -> DVec3 + Sync,
    faces: &[[u32; 3]],
    adjacency: &Adjacency,
    viewpoint: DVec3,
) -> Vec<SilhouetteEdge> {
    let mut side = vec![0i8; faces.len()];
    side.par_chunks_mut(CHUNK)
        .zip(faces.par_chunks(CHUNK))
        .for_each(|(side, faces)| {
            for (side, f) in side.iter_mut().zip(faces) {
                *side = side_of(f.map(&position), viewpoint);
            }
        });
    let edges = adjacency.edges().len();
    let parts: Vec<Vec<SilhouetteEdge>> = (0..edges.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let range = chunk * CHUNK..((chunk + 1) * CHUNK).min(edges);
            range
                .filter_map(|edge| edge_of_outline(adjacency, &side, edge))
                .collect()
        })
        .collect();
    parts.concat()
}

#[inline]
fn edge_of_outline(adjacency: &Adjacency, side: &[i8], edge: usize) -> Option<SilhouetteEdge> {
    let incident = adjacency.incident(edge);
    if let [a, b] = incident {
        // By far the most edges: two faces on different sides of the edge cancel.
        let (s, t) = (side[a.face as usize], side[b.face as usize]);
        if s == t && a.forward != b.forward {
            return None;
        }
    }
    let (mut front, mut back) = (0, 0);
    for i in incident {
        // A front face that runs forward through the edge lies on its left, a back face on its right.
        let left = if i.forward { 1 } else { -1 };
        match side[i.face as usize] {
            1 => front += left,
            -1 => back -= left,
            _ => {}
        }
    }
    ((front, back) != (0, 0)).then_some(SilhouetteEdge {
        edge: edge as u32,
        front,
        back,
    })
}

/// Orders directed edges into closed loops: each edge is used once, and each loop's edges follow each
/// other head to tail.
///
/// `edges` are vertex pairs that are balanced at every vertex (as many enter as leave); `turn(from, via,
/// to)` says how far to the left a path turns there, and where several edges leave a vertex the one that
/// turns most to the left is taken, so that loops touch and do not cross.
pub fn loops(edges: &[[u32; 2]], turn: impl Fn(u32, u32, u32) -> f64) -> Vec<Vec<u32>> {
    let mut leaving: Vec<(u32, u32)> = (0..edges.len() as u32)
        .map(|e| (edges[e as usize][0], e))
        .collect();
    leaving.sort_unstable();
    let mut used = vec![false; edges.len()];
    let mut out = Vec::new();
    for start in 0..edges.len() as u32 {
        if used[start as usize] {
            continue;
        }
        let mut path = Vec::new();
        let mut next = Some(start);
        while let Some(edge) = next {
            used[edge as usize] = true;
            path.push(edge);
            let [from, via] = edges[edge as usize];
            if via == edges[start as usize][0] {
                break;
            }
            let first = leaving.partition_point(|l| l.0 < via);
            next = leaving[first..]
                .iter()
                .take_while(|l| l.0 == via)
                .map(|l| l.1)
                .filter(|&e| !used[e as usize])
                .max_by(|&x, &y| {
                    let angle = |e: u32| turn(from, via, edges[e as usize][1]);
                    angle(x).total_cmp(&angle(y))
                });
        }
        out.push(path);
    }
    out
}

fn coord(p: DVec3) -> Coord3D<f64> {
    Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    }
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
        silhouette_edges(|v| p[v as usize], &f, &Adjacency::new(&f), viewpoint).len()
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
        let found = silhouette_edges(|v| p[v as usize], &f, &adjacency, DVec3::new(1.0, 1.0, 5.0));
        let mut balance = [0i32; 8];
        for s in &found {
            let [a, b] = adjacency.edges()[s.edge as usize];
            balance[a as usize] += s.winding();
            balance[b as usize] -= s.winding();
        }
        assert_eq!(balance, [0; 8]);
        assert!(!found.is_empty());
    }

    #[test]
    fn an_open_sheet_shows_its_boundary_and_opposite_windings_from_its_two_sides() {
        let p = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let f = vec![[0, 1, 2]];
        let adjacency = Adjacency::new(&f);
        let above = silhouette_edges(|v| p[v as usize], &f, &adjacency, DVec3::Z);
        let below = silhouette_edges(|v| p[v as usize], &f, &adjacency, -DVec3::Z);
        // Counter-clockwise seen from above: the face is on the left of every edge that runs with it.
        let left: Vec<i32> = above.iter().map(|s| s.winding()).collect();
        assert_eq!(adjacency.edges(), &[[0, 1], [0, 2], [1, 2]]);
        assert_eq!(left, vec![1, -1, 1]);
        assert_eq!(
            below.iter().map(|s| s.winding()).collect::<Vec<_>>(),
            vec![-1, 1, -1]
        );
    }
}
