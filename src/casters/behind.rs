//! Which triangles have nothing of the scene behind them, as an eye sees it: they cast on no surface.
//!
//! A triangle has to be before every vertex of the scene. Fourteen extreme ones rule almost all triangles out, 64 at
//! a time and without roots: in a dense scene that is most of the work.

use std::ops::Range;

use fearless_simd::dispatch;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::Casters;
use crate::casters::CHUNK;
use crate::frame::POINT_OFFSET;
use crate::frame::ROUNDED;
use crate::simd::{LANES, detect};

/// Most comparisons of triangles with all vertices in the search for those with nothing behind them, some ten
/// milliseconds: a ground of many triangles makes the view wider instead.
const COMPARISONS: usize = 1 << 24;

/// Triangles that are looked at together.
const BLOCK: usize = 64;

/// Squared distance behind a triangle at which a vertex rules it out, a part in a million more than is asked for:
/// coordinates and their products are wrong by 1e-15 at most, which is a part in 10⁸ of it.
const CLEARLY_BEHIND: f64 = POINT_OFFSET * POINT_OFFSET * (1.0 + 1e-6);

/// Local size of a convex body of few triangles from which on its own back does not keep its front from having
/// nothing behind it: what is so much larger than the core is a ground, though it may have a thickness.
const LARGE: f64 = 16.0;

/// Most triangles of such a body.
const FEW: u32 = 64;

/// What offsets are times of: a position's largest coordinate, at least 1, and no more than makes what surfaces
/// near a core may be moved by.
fn reach(p: DVec3) -> f64 {
    p.abs().max_element().clamp(1.0, ROUNDED / POINT_OFFSET)
}

/// Squared sine of the angle to a triangle's plane within which rounding might see the eye on either side.
const EDGE_ON: f64 = 1e-24;

type Column = [f64; BLOCK];

/// Ranges of all triangles that cast, [`CHUNK`] at most in each.
pub(crate) fn chunks(casters: &Casters) -> Vec<Range<u32>> {
    let split = |range: Range<u32>| {
        let end = range.end;
        let starts = range.step_by(CHUNK);
        starts.map(move |start| start..(start + CHUNK as u32).min(end))
    };
    casters.face_ranges().flat_map(split).collect()
}

/// What casts, without and only those triangles that have no vertex of the scene behind them as `eye` sees it.
/// There are none of the latter if they are too many.
pub(crate) fn split(casters: &Casters, eye: DVec3) -> (Vec<u32>, Vec<u32>) {
    let last = with_nothing_behind(casters, eye);
    let all = casters.face_ranges().flatten();
    if last.is_empty() {
        return (all.collect(), last);
    }
    (
        all.filter(|f| last.binary_search(f).is_err()).collect(),
        last,
    )
}

/// The triangles that have no vertex of the scene behind them, in order; none if they are too many.
pub(crate) fn with_nothing_behind(casters: &Casters, eye: DVec3) -> Vec<u32> {
    let geometry = casters.geometry();
    let positions = &geometry.positions;
    if !geometry.spheres.is_empty() {
        return Vec::new();
    }
    let extremes = extremes(positions);
    let plane = |face: u32| {
        let [a, b, c] = geometry.corners(face).map(|v| v.as_dvec3());
        let n = (b - a).cross(c - a).try_normalize()?;
        Some((if n.dot(eye - a) < 0.0 { -n } else { n }, a))
    };
    // Less far behind than a receiver has to be to be hidden.
    let before =
        |p: DVec3, n: DVec3, a: DVec3| n.dot(p - a) >= -POINT_OFFSET * reach(p).max(reach(a));
    let candidate =
        |face: u32| plane(face).is_some_and(|(n, a)| extremes.iter().all(|&p| before(p, n, a)));
    let find = |look: &mut Look, range: Range<u32>| {
        let mut found = Vec::new();
        let faces = &geometry.faces[range.start as usize..range.end as usize];
        for (start, faces) in range.step_by(BLOCK).zip(faces.chunks(BLOCK)) {
            let possible = look.look(faces, positions, eye, &extremes);
            let possible = (start..).zip(&possible[..faces.len()]);
            let possible = possible.filter(|(_, possible)| **possible);
            found.extend(possible.map(|(face, _)| face).filter(|&f| candidate(f)));
        }
        found
    };
    let parts: Vec<Vec<u32>> = chunks(casters)
        .into_par_iter()
        .map_init(Look::new, find)
        .collect();
    let candidates = parts.concat();
    if candidates.len().saturating_mul(positions.len()) > COMPARISONS {
        return Vec::new();
    }
    let nothing = |f: &u32| {
        let Some((n, a)) = plane(*f) else {
            return false;
        };
        positions.iter().all(|p| before(p.as_dvec3(), n, a))
    };
    let mut found: Vec<u32> = candidates.into_par_iter().filter(nothing).collect();
    if geometry.frame.is_core {
        found.extend(slabs(casters, eye));
        found.sort_unstable();
        found.dedup();
    }
    found
}

/// Triangles of convex bodies, much larger than the core, that have nothing but their own body behind them: it is
/// dark there in any case, whether a map holds them or not.
fn slabs(casters: &Casters, eye: DVec3) -> Vec<u32> {
    let geometry = casters.geometry();
    let mut found = Vec::new();
    for mesh in &geometry.meshes {
        let faces = mesh.first_face..mesh.first_face + mesh.faces;
        let cast = casters.face_ranges().any(|r| r.contains(&mesh.first_face));
        let pairs = mesh.mesh.adjacency().pairs();
        let closed = pairs.iter().flatten().all(|&f| f < mesh.faces);
        if mesh.faces > FEW || !cast || !closed {
            continue;
        }
        let corners = |f: u32| geometry.corners(f).map(|v| v.as_dvec3());
        let own: Vec<DVec3> = faces.clone().flat_map(corners).collect();
        let size = own.iter().copied().map(reach).fold(0.0, f64::max);
        let others = || {
            let used = (0..geometry.faces.len() as u32).filter(|f| !faces.contains(f));
            used.flat_map(corners)
        };
        // Of each triangle the normal to the eye and a corner; none if the body is not convex.
        let planes: Option<Vec<(DVec3, DVec3)>> = faces
            .clone()
            .map(|face| {
                let [a, b, c] = corners(face);
                let n = (b - a).cross(c - a).try_normalize()?;
                // A dent that is deeper, and all of the core, is none of rounding's.
                let flat = (POINT_OFFSET * size).min(1.0 / 64.0);
                let (low, high) = own.iter().fold((0.0f64, 0.0f64), |(low, high), p| {
                    let height = n.dot(*p - a);
                    (low.min(height), high.max(height))
                });
                let n = if n.dot(eye - a) < 0.0 { -n } else { n };
                (low >= -flat || high <= flat).then_some((n, a))
            })
            .collect();
        let Some(planes) = planes.filter(|_| size > LARGE) else {
            continue;
        };
        for (face, (n, a)) in faces.clone().zip(planes) {
            let free = |p: DVec3| n.dot(p - a) >= -POINT_OFFSET * reach(p);
            if others().all(free) {
                found.push(face);
            }
        }
    }
    found
}

/// Corners of triangles that are looked at together.
struct Look {
    corners: [[Column; 3]; 3],
}

impl Look {
    fn new() -> Self {
        Look {
            corners: [[[0.0; BLOCK]; 3]; 3],
        }
    }

    /// Which of up to [`BLOCK`] triangles no extreme position is clearly behind.
    fn look(
        &mut self,
        faces: &[[u32; 3]],
        positions: &[Vec3],
        eye: DVec3,
        extremes: &[DVec3],
    ) -> [bool; BLOCK] {
        // `take` says to the compiler that no block is longer, which then leaves out checks of `i`.
        for (i, face) in faces.iter().enumerate().take(BLOCK) {
            for (corner, &v) in self.corners.iter_mut().zip(face) {
                let p = positions[v as usize].as_dvec3();
                (corner[0][i], corner[1][i], corner[2][i]) = (p.x, p.y, p.z);
            }
        }
        let (corners, mut possible) = (&self.corners, [true; BLOCK]);
        dispatch!(detect(), _ => look_lanes(corners, eye, extremes, &mut possible));
        possible
    }
}

/// Free of branches, for the compiler's vectoriser.
#[inline(always)]
fn look_lanes(corners: &[[Column; 3]; 3], eye: DVec3, extremes: &[DVec3], out: &mut [bool; BLOCK]) {
    let [a, b, c] = corners;
    let at = |[x, y, z]: &[Column; 3], i: usize| DVec3::new(x[i], y[i], z[i]);
    let (mut normal, mut limit) = ([[0.0; BLOCK]; 3], [0.0; BLOCK]);
    for i in 0..BLOCK {
        let (a, b, c) = (at(a, i), at(b, i), at(c, i));
        let n = (b - a).cross(c - a);
        let (to, squared) = (eye - a, n.length_squared());
        let side = n.dot(to);
        let n = if side < 0.0 { -n } else { n };
        let clear = side * side > EDGE_ON * (squared * to.length_squared());
        (normal[0][i], normal[1][i], normal[2][i]) = (n.x, n.y, n.z);
        limit[i] = if clear {
            CLEARLY_BEHIND * squared * reach(a).powi(2)
        } else {
            f64::INFINITY
        };
    }
    for &p in extremes {
        let far = reach(p).powi(2);
        for i in 0..BLOCK {
            let distance = at(&normal, i).dot(p - at(a, i));
            let behind = (distance < 0.0) & (distance * distance > limit[i] * far);
            out[i] &= !behind;
        }
    }
}

/// Directions in which extreme positions are looked for, and against them.
const DIRECTIONS: [Vec3; 7] = [
    Vec3::X,
    Vec3::Y,
    Vec3::Z,
    Vec3::new(1.0, 1.0, 1.0),
    Vec3::new(1.0, 1.0, -1.0),
    Vec3::new(1.0, -1.0, 1.0),
    Vec3::new(-1.0, 1.0, 1.0),
];

/// Extreme positions along the axes and the diagonals, the first of those that are equal.
fn extremes(positions: &[Vec3]) -> Vec<DVec3> {
    // The largest of each chunk first: looking for where it is takes longer.
    let parts: Vec<[[f32; 2]; 7]> = positions.par_chunks(CHUNK).map(largest).collect();
    let first = |k: usize| {
        let (d, side) = (DIRECTIONS[k / 2], k % 2);
        let along = |p: Vec3| if side == 0 { d.dot(p) } else { -d.dot(p) };
        let of_parts = parts.iter().map(|part| part[k / 2][side]);
        let most = of_parts.clone().reduce(f32::max)?;
        let chunk = of_parts.into_iter().position(|part| part == most)?;
        let rest = &positions[chunk * CHUNK..];
        let found = rest.iter().find(|p| along(**p) == most);
        found.map(|p| p.as_dvec3())
    };
    (0..14).filter_map(first).collect()
}

/// The largest products of positions with each direction and its opposite.
fn largest(positions: &[Vec3]) -> [[f32; 2]; 7] {
    let mut most = [[[f32::NEG_INFINITY; LANES]; 2]; 7];
    let mut columns = [[0.0; BLOCK]; 3];
    for positions in positions.chunks(BLOCK) {
        // What is missing from the last block is its first position.
        for i in 0..BLOCK {
            let p = positions[if i < positions.len() { i } else { 0 }];
            (columns[0][i], columns[1][i], columns[2][i]) = (p.x, p.y, p.z);
        }
        dispatch!(detect(), _ => largest_lanes(&columns, &mut most));
    }
    most.map(|sides| sides.map(|lanes| lanes.into_iter().fold(f32::NEG_INFINITY, f32::max)))
}

/// Raises `most` to the largest products of a block's positions with each direction and its opposite, lane by lane.
/// Free of branches, for the compiler's vectoriser.
#[inline(always)]
fn largest_lanes([x, y, z]: &[[f32; BLOCK]; 3], most: &mut [[[f32; LANES]; 2]; 7]) {
    for (k, d) in DIRECTIONS.iter().enumerate() {
        let [mut up, mut down] = most[k];
        for block in 0..BLOCK / LANES {
            for i in 0..LANES {
                let j = block * LANES + i;
                let along = d.dot(Vec3::new(x[j], y[j], z[j]));
                up[i] = if along > up[i] { along } else { up[i] };
                down[i] = if -along > down[i] { -along } else { down[i] };
            }
        }
        most[k] = [up, down];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::entry::Material;
    use crate::scene::Scene;

    const LOOKS: Material = Material {
        albedo: [1.0; 3],
        opacity: 1.0,
        casts: true,
        receives: true,
    };

    #[test]
    fn what_has_nothing_behind_it_is_what_all_vertices_say() {
        let mut state = 9u64;
        let mut random = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let (mut some, mut none) = (0, 0);
        for round in 0..200 {
            let mut scene = Scene::default();
            // Every other scene is on a grid: faces in one plane, degenerate ones, the eye in their planes.
            let mut point = |size: f64| {
                let p = DVec3::new(random(), random(), random()) * size;
                if round % 2 == 0 { (p * 3.0).round() } else { p }
            };
            let vertices: Vec<_> = (0..40).map(|_| point(2.0)).collect();
            let count = if round % 3 == 0 { 5 } else { 150 };
            let faces: Vec<[i64; 3]> = (0..count)
                .map(|i| [i, 7 * i + 1, 11 * i + 2].map(|v| v % 40))
                .collect();
            scene.add_mesh("soup", vertices, &faces, LOOKS).unwrap();
            let casters = Casters::new("ssoc", scene.snapshot().unwrap(), false).unwrap();
            let geometry = casters.geometry();
            let eye = geometry.frame.to_local(point(9.0));
            let expected: Vec<u32> = (0..count as u32)
                .filter(|&f| {
                    let [a, b, c] = geometry.corners(f).map(|v| v.as_dvec3());
                    let Some(n) = (b - a).cross(c - a).try_normalize() else {
                        return false;
                    };
                    let n = if n.dot(eye - a) < 0.0 { -n } else { n };
                    let mut all = geometry.positions.iter().map(|p| p.as_dvec3());
                    all.all(|p| n.dot(p - a) >= -POINT_OFFSET)
                })
                .collect();
            let found = with_nothing_behind(&casters, eye);
            assert_eq!(found, expected, "round {round}");
            some += found.len();
            none += count as usize - found.len();
        }
        assert!(some > 50 && none > 10_000, "{some} {none}");
    }
}
