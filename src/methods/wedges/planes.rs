//! Penumbra wedges: their planes, around every vertex of a silhouette loop (Akenine-Möller and Assarsson
//! 2002, Section 4.1).
//!
//! Silhouette edges are ordered into closed loops, one layer each: where an edge bounds several layers it is
//! in as many loops, and where more than two edges meet at a vertex, loops touch there and do not cross. So
//! every wedge has two neighbours, whatever the mesh, and the intensity is continuous around every loop.
//!
//! - An edge whose line meets the light (seen end-on by some of it) has no front and back plane: it is left
//!   out and its neighbours are joined at its far end. So is one that points past the light so closely that
//!   its planes open by more than a right angle: it spans next to nothing of the outline, but its wedge would
//!   reach over everything beside it.
//! - Where neighbours turn by more than `vertex_angle`, further wedges are set around the vertex, their edges
//!   of no length turned in equal steps from one neighbour's direction to the other's (Figure 7).
//! - Neighbours share the rays in which their front planes and their back planes meet, and the side plane
//!   through both. Where the planes coincide (collinear edges, whose side plane the paper leaves undefined)
//!   the ray is the light's central ray, projected into the plane.
//! - Where the side planes of a wedge cross, the part beyond the crossing has the two neighbours in it, one on
//!   top of the other, and the wedge counts negatively (see [`super::interpolate`]); that is continuous, where
//!   the paper's Figure 6 only cuts the wedge off.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use super::volume::VolumeQuad;
use crate::casters::edges::Edge;
use crate::light::tangents::{Tangents, tangents};
use crate::light::{Light, SphereLight};
use crate::mesh::silhouettes::{loops, turn_at};

/// How wedges are built.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Construction {
    /// Largest turn between neighbours without further wedges, radians.
    pub vertex_angle: f64,
    /// Whether front and back planes of a sphere go through the paper's points `c ∓ r n`.
    pub paper_planes: bool,
}

/// A plane: points with `normal · p = offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit normal.
    pub normal: DVec3,
    /// Its distance from the origin.
    pub offset: f64,
}

impl Plane {
    fn through(point: DVec3, normal: DVec3) -> Plane {
        Plane {
            normal,
            offset: normal.dot(point),
        }
    }
}

/// A wedge, and what its neighbours share with it.
#[derive(Debug, Clone, Copy)]
pub struct Wedge {
    /// Local positions of its edge; equal for one around a vertex.
    pub ends: [DVec3; 2],
    /// Unit direction of its edge.
    pub direction: DVec3,
    /// Unit normal of the shadow quad, out of the shadow.
    pub outside: DVec3,
    /// Lit limit.
    pub front: Plane,
    /// Umbra's limit.
    pub back: Plane,
    /// Side planes at both ends; normals along the loop.
    pub sides: [Plane; 2],
    /// Unit directions of interpolation in the side planes.
    pub across: [DVec3; 2],
    /// Unit directions, away from the light, in which the front planes of neighbours meet.
    pub front_rays: [DVec3; 2],
    /// Front and back planes' normals of the wedges before and after.
    pub beside: [Tangents; 2],
    /// Front and back layers that it bounds.
    pub layers: [i32; 2],
    /// Its object.
    pub object: u32,
}

/// An edge of a loop before it has neighbours.
#[derive(Clone, Copy)]
struct Link {
    ends: [DVec3; 2],
    direction: DVec3,
    outside: DVec3,
    limits: Tangents,
}

/// Sine of the angle between an edge and the way from the light below which it may be seen end-on.
const END_ON: f64 = 0.5;

impl Link {
    fn new(
        light: &Light,
        ends: [DVec3; 2],
        direction: DVec3,
        construction: Construction,
    ) -> Option<Link> {
        let direction = direction.try_normalize()?;
        let from_light = ends[0] - light.center();
        let outside = from_light.cross(direction).try_normalize()?;
        let touching = tangents(light, ends[0], direction, outside)?;
        let sine = from_light.cross(direction).length() / from_light.length();
        if sine < END_ON && touching.front.dot(touching.back) < 0.0 {
            return None;
        }
        let limits = match light.as_sphere() {
            Some(SphereLight { center, radius }) if construction.paper_planes => {
                let plane = |p: DVec3| {
                    let n = direction.cross(p - ends[0]).normalize();
                    if n.dot(outside) < 0.0 { -n } else { n }
                };
                Tangents {
                    front: plane(center - radius * outside),
                    back: plane(center + radius * outside),
                }
            }
            _ => touching,
        };
        Some(Link {
            ends,
            direction,
            outside,
            limits,
        })
    }
}

/// Builds the wedges of silhouette edges, loop after loop, in the order of objects.
pub fn wedges(edges: &[Edge], light: &Light, construction: Construction) -> Vec<Wedge> {
    let mut out = Vec::new();
    let mut first = 0;
    while first < edges.len() {
        let object = edges[first].object;
        let count = edges[first..]
            .iter()
            .take_while(|e| e.object == object)
            .count();
        around_object(&edges[first..first + count], light, construction, &mut out);
        first += count;
    }
    out
}

fn around_object(edges: &[Edge], light: &Light, construction: Construction, out: &mut Vec<Wedge>) {
    let mut positions = HashMap::new();
    for edge in edges {
        positions.extend(edge.vertices.into_iter().zip(edge.ends));
    }
    let layers = |e: &Edge| (e.vertices, [e.front, e.back]);
    let edges_of_layers: Vec<_> = edges.iter().map(layers).collect();
    for around in loops(&edges_of_layers, |v| positions[&v], light.center()) {
        let vertices = around.vertices.iter();
        let next = around.vertices.iter().cycle().skip(1);
        let path: Vec<[DVec3; 2]> = vertices
            .zip(next)
            .map(|(a, b)| [positions[a], positions[b]])
            .collect();
        let object = edges[0].object;
        around_loop(&path, around.layers, object, light, construction, out);
    }
}

fn around_loop(
    path: &[[DVec3; 2]],
    layers: [i32; 2],
    object: u32,
    light: &Light,
    construction: Construction,
    out: &mut Vec<Wedge>,
) {
    let links = turned(&joined(path, light, construction), light, construction);
    let n = links.len();
    if n < 2 {
        return;
    }
    let shared: Vec<Shared> = (0..n)
        .map(|i| Shared::new(light, &links[i], &links[(i + 1) % n]))
        .collect();
    for (i, link) in links.iter().enumerate() {
        let [start, end] = [&shared[(i + n - 1) % n], &shared[i]];
        out.push(Wedge {
            ends: link.ends,
            direction: link.direction,
            outside: link.outside,
            front: Plane::through(link.ends[0], link.limits.front),
            back: Plane::through(link.ends[0], link.limits.back),
            sides: [start.plane, end.plane],
            across: [start.across, end.across],
            front_rays: [start.front, end.front],
            beside: [links[(i + n - 1) % n].limits, links[(i + 1) % n].limits],
            layers,
            object,
        });
    }
}

/// Links of a path, without the edges whose line meets the light.
fn joined(path: &[[DVec3; 2]], light: &Light, construction: Construction) -> Vec<Link> {
    let link = |[a, b]: [DVec3; 2]| Link::new(light, [a, b], b - a, construction);
    let mut kept: Vec<[DVec3; 2]> = Vec::new();
    // What is left out before the first edge that is kept moves that one's start.
    let mut gap = None;
    for &ends in path {
        match (link(ends), kept.last_mut()) {
            (Some(_), _) => kept.push(ends),
            (None, Some(last)) => last[1] = ends[1],
            (None, None) => gap = gap.or(Some(ends[0])),
        }
    }
    if let (Some(start), Some(first)) = (gap, kept.first_mut()) {
        first[0] = start;
    }
    // Moved ends may turn an edge towards the light; then the loop has a gap there, of an edge that the
    // light sees end-on.
    kept.into_iter().filter_map(link).collect()
}

/// Adds links around vertices where the path turns by more than the construction's angle.
fn turned(links: &[Link], light: &Light, construction: Construction) -> Vec<Link> {
    let mut out = Vec::with_capacity(links.len());
    let center = light.center();
    for (i, link) in links.iter().enumerate() {
        out.push(*link);
        let next = &links[(i + 1) % links.len()];
        let v = link.ends[1];
        let turn = turn_at(center, v, link.direction, next.direction);
        let count = (turn.abs() / construction.vertex_angle)
            .ceil()
            .min(TAU * 100.0) as usize;
        let axis = (center - v).normalize_or_zero();
        let flat = link.direction - link.direction.dot(axis) * axis;
        for k in 1..count {
            let by = DQuat::from_axis_angle(axis, turn * k as f64 / count as f64);
            out.extend(Link::new(light, [v, v], by * flat, construction));
        }
    }
    out
}

/// What two neighbours share.
struct Shared {
    plane: Plane,
    across: DVec3,
    front: DVec3,
}

/// Below this sine of the angle between two planes their line is taken from the light's central ray, which
/// then lies in both to the square of it: to rounding.
const PARALLEL: f64 = 1e-7;

impl Shared {
    fn new(light: &Light, a: &Link, b: &Link) -> Shared {
        let v = 0.5 * (a.ends[1] + b.ends[0]);
        let from_light = v - light.center();
        let ray = |m: DVec3, n: DVec3| meeting(m, n, from_light);
        let front = ray(a.limits.front, b.limits.front);
        let back = ray(a.limits.back, b.limits.back);
        let along = (a.direction + b.direction).normalize_or(a.direction);
        let normal = front.cross(back);
        // A light of no width has one ray: the side plane then has no extent, and only must not be parallel
        // to the edge.
        let normal = normal.try_normalize().unwrap_or(along);
        let normal = if normal.dot(along) < 0.0 {
            -normal
        } else {
            normal
        };
        let mean = a.outside + b.outside;
        let across = mean - mean.dot(normal) * normal;
        Shared {
            plane: Plane::through(v, normal),
            across: across.normalize_or(a.outside),
            front,
        }
    }
}

/// Unit direction, away from the light, of the line in which two planes meet.
fn meeting(m: DVec3, n: DVec3, from_light: DVec3) -> DVec3 {
    let line = m.cross(n);
    if line.length() > PARALLEL {
        let line = line.normalize();
        return if line.dot(from_light) < 0.0 {
            -line
        } else {
            line
        };
    }
    let normal = (m + n).normalize_or(m);
    (from_light - from_light.dot(normal) * normal).normalize_or_zero()
}

impl Wedge {
    /// A quad through the wedge's edge between its front plane (`part` 0) and its back plane (1); it shares
    /// the lines in which it meets its neighbours' quads of the same part.
    pub fn quad(&self, part: f64, center: DVec3) -> VolumeQuad {
        let between = |front: DVec3, back: DVec3| front.lerp(back, part).normalize();
        let normal = between(self.front.normal, self.back.normal);
        let ray = |end: usize| {
            let other = self.beside[end];
            meeting(
                normal,
                between(other.front, other.back),
                self.ends[end] - center,
            )
        };
        VolumeQuad {
            ends: self.ends,
            rays: [ray(0), ray(1)],
            normal,
            offset: normal.dot(self.ends[0]),
            front: self.layers[0],
            back: self.layers[1],
            object: self.object,
        }
    }

    /// The quad in the front plane.
    pub fn front_quad(&self) -> VolumeQuad {
        VolumeQuad {
            ends: self.ends,
            rays: self.front_rays,
            normal: self.front.normal,
            offset: self.front.offset,
            front: self.layers[0],
            back: self.layers[1],
            object: self.object,
        }
    }
}
