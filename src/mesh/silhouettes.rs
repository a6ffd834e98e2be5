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
//! Sides are decided exactly: a floating-point filter first, for many faces at a time, `robust::orient3d`
//! where it cannot tell; a face that the point sees edge-on covers nothing and has no side, so that its other
//! edges take over its part of the outline.

use fearless_simd::dispatch;
use glam::DVec3;
use rayon::prelude::*;
use robust::{Coord3D, orient3d};

use super::adjacency::Adjacency;
use crate::simd::detect;

/// Faces or edges that one task looks at: enough to outweigh a task, and a multiple of [`BLOCK`].
const CHUNK: usize = 8192;

/// Faces or edges that are looked at together.
const BLOCK: usize = 64;

/// Shewchuk's error bound of the determinant in [`filtered`], relative to its permanent.
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
    match filtered(corners, point) {
        0 => exact_side_of(corners, point),
        side => side,
    }
}

/// The sign that [`side_of`] gives, but 0 wherever rounding may have decided.
#[inline(always)]
fn filtered(corners: [DVec3; 3], point: DVec3) -> i8 {
    let [a, b, c] = corners;
    let (a, b, c) = (a - point, b - point, c - point);
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
    i8::from(det < -bound) - i8::from(det > bound)
}

#[cold]
fn exact_side_of(corners: [DVec3; 3], point: DVec3) -> i8 {
    let [a, b, c] = corners.map(coord);
    let exact = orient3d(a, b, c, coord(point));
    i8::from(exact < 0.0) - i8::from(exact > 0.0)
}

/// Corners of faces: coordinate `k` of corner `c` of all of them in `[c][k]`.
type Corners = [[[f64; BLOCK]; 3]; 3];

/// Free of branches, for the compiler's vectoriser.
#[inline(always)]
fn filter_lanes(corners: &Corners, point: DVec3, side: &mut [i8; BLOCK]) {
    for (i, side) in side.iter_mut().enumerate() {
        let [a, b, c] = corners;
        *side = filtered([corner(a, i), corner(b, i), corner(c, i)], point);
    }
}

#[inline(always)]
fn corner([x, y, z]: &[[f64; BLOCK]; 3], i: usize) -> DVec3 {
    DVec3::new(x[i], y[i], z[i])
}

/// Which side of each face a point is on, as [`side_of`] says.
fn sides(position: impl Fn(u32) -> DVec3, faces: &[[u32; 3]], point: DVec3, side: &mut [i8]) {
    let level = detect();
    let mut corners: Corners = [[[0.0; BLOCK]; 3]; 3];
    for (faces, side) in faces.chunks(BLOCK).zip(side.chunks_mut(BLOCK)) {
        // No block is longer: `take` says so to the compiler, which then leaves out checks of `i`.
        for (i, f) in faces.iter().enumerate().take(BLOCK) {
            for (corner, &v) in corners.iter_mut().zip(f) {
                let p = position(v);
                (corner[0][i], corner[1][i], corner[2][i]) = (p.x, p.y, p.z);
            }
        }
        let mut found = [0; BLOCK];
        dispatch!(level, _ => filter_lanes(&corners, point, &mut found));
        side.copy_from_slice(&found[..faces.len()]);
        for (side, f) in side.iter_mut().zip(faces) {
            if *side == 0 {
                *side = exact_side_of(f.map(&position), point);
            }
        }
    }
}

/// Finds the silhouette edges that `viewpoint` sees, in the order of the edges.
pub fn silhouette_edges(
    position: impl Fn(u32) -> DVec3 + Sync,
    faces: &[[u32; 3]],
    adjacency: &Adjacency,
    viewpoint: DVec3,
) -> Vec<SilhouetteEdge> {
    let mut side = vec![0i8; faces.len() + 2];
    // Edges that are no pair of faces have these two, unlike any face's.
    side[faces.len()..].copy_from_slice(&[2, 3]);
    side[..faces.len()]
        .par_chunks_mut(CHUNK)
        .zip(faces.par_chunks(CHUNK))
        .for_each(|(side, faces)| sides(&position, faces, viewpoint, side));
    let parts: Vec<Vec<SilhouetteEdge>> = adjacency
        .pairs()
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(chunk, pairs)| {
            let edges = (chunk * CHUNK..).zip(pairs);
            edges
                .filter(|(_, [a, b])| side[*a as usize] != side[*b as usize])
                .filter_map(|(edge, _)| edge_of_outline(adjacency, &side, edge))
                .collect()
        })
        .collect();
    parts.concat()
}

fn edge_of_outline(adjacency: &Adjacency, side: &[i8], edge: usize) -> Option<SilhouetteEdge> {
    let (mut front, mut back) = (0, 0);
    for i in adjacency.incident(edge) {
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

/// A closed loop of silhouette edges around one layer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Loop {
    /// The vertices that it runs through, the first not repeated; what the layer occludes is on its left as
    /// seen from the viewpoint.
    pub vertices: Vec<u32>,
    /// Front and back layers that it bounds: one of either, or one of both.
    pub layers: [i32; 2],
}

/// Orders silhouette edges into loops.
///
/// `edges` are vertices with the front and the back layers on the left less those on the right. Where an
/// edge bounds n layers of a kind it is in n loops; front and back layers have loops of their own, unless
/// every edge bounds the same layers of both.
pub fn loops(
    edges: &[([u32; 2], [i32; 2])],
    position: impl Fn(u32) -> DVec3,
    viewpoint: DVec3,
) -> Vec<Loop> {
    let kinds: &[[i32; 2]] = match edges.iter().all(|(_, [front, back])| front == back) {
        true => &[[1, 1]],
        false => &[[1, 0], [0, 1]],
    };
    let mut out = Vec::new();
    for &layers in kinds {
        let mut directed = Vec::with_capacity(edges.len());
        for &([a, b], [front, back]) in edges {
            let n = if layers[0] == 1 { front } else { back };
            let edge = if n > 0 { [a, b] } else { [b, a] };
            directed.extend(std::iter::repeat_n(edge, n.unsigned_abs() as usize));
        }
        let turn = |from, via, to| {
            let v = position(via);
            turn_at(viewpoint, v, v - position(from), position(to) - v)
        };
        let paths = paths(&directed, turn);
        out.extend(paths.into_iter().map(|vertices| Loop { vertices, layers }));
    }
    out
}

/// Angle by which a path turns to the left at `v`, as `viewpoint` sees it.
pub fn turn_at(viewpoint: DVec3, v: DVec3, before: DVec3, after: DVec3) -> f64 {
    let axis = (v - viewpoint).normalize_or_zero();
    let flat = |d: DVec3| d - d.dot(axis) * axis;
    let (e, f) = (flat(before), flat(after));
    (-axis.dot(e.cross(f))).atan2(e.dot(f))
}

/// Vertices of closed paths along directed edges: each edge is used once, and the edges of a path follow
/// each other head to tail.
///
/// `edges` are vertex pairs that are balanced at every vertex (as many enter as leave); `turn(from, via,
/// to)` says how far to the left a path turns there, and where several edges leave a vertex the one that
/// turns most to the left is taken, so that paths touch and do not cross.
fn paths(edges: &[[u32; 2]], turn: impl Fn(u32, u32, u32) -> f64) -> Vec<Vec<u32>> {
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
            let [from, via] = edges[edge as usize];
            path.push(from);
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
    use proptest::prelude::*;

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

    /// What [`silhouette_edges`] says, edge by edge and with nothing but the exact predicate.
    fn plainly(p: &[DVec3], faces: &[[u32; 3]], viewpoint: DVec3) -> Vec<SilhouetteEdge> {
        let adjacency = Adjacency::new(faces);
        let of_edge = |edge: usize| {
            let (mut front, mut back) = (0, 0);
            for i in adjacency.incident(edge) {
                let [a, b, c] = faces[i.face as usize].map(|v| coord(p[v as usize]));
                let volume = orient3d(a, b, c, coord(viewpoint));
                let left = if i.forward { 1 } else { -1 };
                front += if volume < 0.0 { left } else { 0 };
                back -= if volume > 0.0 { left } else { 0 };
            }
            let edge = edge as u32;
            SilhouetteEdge { edge, front, back }
        };
        (0..adjacency.edges().len())
            .map(of_edge)
            .filter(|s| (s.front, s.back) != (0, 0))
            .collect()
    }

    fn check(p: &[DVec3], faces: &[[u32; 3]], viewpoint: DVec3) {
        let adjacency = Adjacency::new(faces);
        let found = silhouette_edges(|v| p[v as usize], faces, &adjacency, viewpoint);
        assert_eq!(found, plainly(p, faces, viewpoint));
    }

    proptest! {
        /// Few vertices make duplicate, degenerate and non-manifold faces; on a grid, the viewpoint lies
        /// in many of their planes.
        #[test]
        fn edges_are_those_of_the_plain_definition(
            grid in prop::collection::vec(prop::array::uniform3(-2i8..=2), 3..30),
            faces in prop::collection::vec(prop::array::uniform3(0u32..30), 1..200),
            viewpoint in prop::array::uniform3(-3i8..=3),
        ) {
            let p: Vec<DVec3> = grid.iter().map(|v| DVec3::from(v.map(f64::from))).collect();
            let n = p.len() as u32;
            let faces: Vec<_> = faces.iter().map(|f| f.map(|v| v % n)).collect();
            check(&p, &faces, DVec3::from(viewpoint.map(f64::from)));
        }

        /// Viewpoints within rounding of a face's plane, where only the exact predicate can tell.
        #[test]
        fn edges_are_exact_near_planes(
            p in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 4..12),
            faces in prop::collection::vec(prop::array::uniform3(0u32..12), 1..100),
            [s, t] in prop::array::uniform2(-2.0..2.0f64),
        ) {
            let p: Vec<DVec3> = p.into_iter().map(DVec3::from).collect();
            let n = p.len() as u32;
            let faces: Vec<_> = faces.iter().map(|f| f.map(|v| v % n)).collect();
            let [a, b, c] = faces[0].map(|v| p[v as usize]);
            check(&p, &faces, a + s * (b - a) + t * (c - a));
        }
    }

    #[test]
    fn many_tasks_find_the_edges_of_one_in_their_order() {
        // A wavy sheet of several chunks of faces and edges, its last ones no whole block.
        let n = 99;
        let at = |i: u32| {
            let (x, y) = (f64::from(i % n) / 50.0, f64::from(i / n) / 50.0);
            DVec3::new(x, y, (9.0 * x).sin() * (7.0 * y).cos())
        };
        let p: Vec<DVec3> = (0..n * n).map(at).collect();
        let corners = (0..n * (n - 1)).filter(|i| i % n < n - 1);
        let faces: Vec<_> = corners
            .flat_map(|i| [[i, i + 1, i + n], [i + 1, i + n + 1, i + n]])
            .collect();
        assert!(faces.len() > 2 * CHUNK && faces.len() % BLOCK != 0);
        // The second lies in the planes of faces.
        for viewpoint in [DVec3::new(3.0, 4.0, 0.4), p[n as usize * 40 + 40]] {
            check(&p, &faces, viewpoint);
        }
    }
}
