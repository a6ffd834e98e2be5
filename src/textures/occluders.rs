//! What can cast on a receiver polygon: the occluders in its pyramid, cut at its plane.
//!
//! Herf and Heckbert 1996 transform every occluder for every light sample and clip it to
//! `[0, 1]² × [1, ∞]`. Here the receiver's plane, `z = 1`, clips once for all samples, the hierarchy leaves out
//! what is outside of the shaft from the receiver's bounds to the light's, and the rasteriser clips the
//! rest: `[0, 1]²` are the image's borders, `∞` its near plane.
//!
//! The plane is the receiver's, moved towards the light by [`LIFT`], so that what stands on the receiver or is
//! joined to it casts from there on and what lies in it does not cast.

use std::collections::HashMap;
use std::ops::Range;

use glam::{DVec3, Vec3};

use super::patches::{FLAT, Parallelogram, Patches};
use crate::bvh::TriangleBvh;
use crate::bvh::outline::{Shaft, padded_bounds};
use crate::frame::POINT_OFFSET;
use crate::geometry::{Geometry, MeshRange};
use crate::light::Light;
use crate::scene::snapshot::Snapshot;

/// How far the clipping plane is in front of the receiver's, times the largest coordinate (at least 1): beyond
/// all corners of the patch itself, and the rounding of the others'.
pub const LIFT: f64 = FLAT + POINT_OFFSET;

/// The occluders of a patch.
#[derive(Debug, Default)]
pub struct PatchOccluders {
    /// Corners, local coordinates.
    pub points: Vec<DVec3>,
    /// Triangles that block everything.
    pub opaque: Vec<[u32; 3]>,
    /// Opaque triangles of closed bodies between the receiver and the light: the ones that face one way do for all.
    pub closed: Vec<[u32; 3]>,
    /// Triangles that let a part through, and that part.
    pub clear: Vec<([u32; 3], f32)>,
    /// Lines along which they pass through the receiver's plane.
    pub contacts: Vec<[DVec3; 2]>,
}

impl PatchOccluders {
    /// The triangles of a mesh over a receiver's plane, opaque.
    pub fn of_mesh(positions: &[DVec3], faces: &[[u32; 3]], side: &Side) -> Self {
        let mut found = Gatherer::default();
        found.vertices.clear(positions.len());
        let mut out = PatchOccluders::default();
        for face in faces {
            let corners = face.map(|v| positions[v as usize]);
            found.add(&mut out, face, &corners, side, Part::Opaque);
        }
        out
    }

    /// Bytes that they take.
    pub fn bytes(&self) -> usize {
        self.points.len() * size_of::<DVec3>()
            + (self.opaque.len() + self.closed.len()) * 12
            + self.clear.len() * 16
            + self.contacts.len() * size_of::<[DVec3; 2]>()
    }
}

/// The side of a patch that is lit: its parallelogram, moved in front of the patch, and the unit normal there.
#[derive(Debug, Clone, Copy)]
pub struct Side {
    /// Moved by [`LIFT`].
    pub bounds: Parallelogram,
    /// Towards the side that is looked at.
    pub normal: DVec3,
}

impl Side {
    /// The side of a parallelogram that `normal` points to.
    pub fn new(bounds: &Parallelogram, normal: DVec3) -> Self {
        let largest = |m: f64, p: DVec3| m.max(p.abs().max_element());
        let size = bounds.corners().into_iter().fold(1.0, largest);
        Side {
            bounds: bounds.moved(normal * (LIFT * size)),
            normal,
        }
    }

    /// Height of a point over it.
    #[inline(always)]
    pub(super) fn height(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.bounds.corner)
    }
}

/// How a triangle casts.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Part {
    Opaque,
    Closed,
    /// It lets this part through.
    Clear(f32),
}

/// What holds the shadows' part of space: the half-spaces around a receiver and a light.
#[derive(Debug, Clone, Copy)]
pub struct Pyramid([HalfSpace; 4]);

impl Pyramid {
    /// Around a side of a patch and a light.
    pub fn new(light: &Light, side: &Side) -> Self {
        Pyramid(pyramid(light, side))
    }

    /// The greatest height over the receiver of a part of an occluder within, 0 if there is none.
    pub fn highest(&self, occluders: &PatchOccluders, side: &Side) -> f64 {
        let faces = occluders.opaque.iter().chain(&occluders.closed);
        let clear = occluders.clear.iter().map(|(face, _)| face);
        let (mut polygon, mut cut) = (Vec::new(), Vec::new());
        let mut highest = 0.0f64;
        for face in faces.chain(clear) {
            let corners = face.map(|v| occluders.points[v as usize]);
            if corners.iter().all(|p| side.height(*p) <= highest) {
                continue;
            }
            polygon.clear();
            polygon.extend(corners);
            for half in &self.0 {
                half.clip(&polygon, &mut cut);
                std::mem::swap(&mut polygon, &mut cut);
            }
            highest = polygon.iter().fold(highest, |m, p| m.max(side.height(*p)));
        }
        highest
    }
}

/// What casts in a scene.
#[derive(Debug, Clone, Copy)]
pub struct Casting<'a> {
    /// The scene.
    pub geometry: &'a Snapshot,
    /// Its receiver polygons.
    pub patches: &'a Patches,
    /// For each of its meshes the corners of its bounds, if it is closed.
    pub bodies: &'a [Option<[DVec3; 8]>],
    /// Whether what has an opacity above 0 blocks everything.
    pub opaque: bool,
}

/// Finds the closed meshes: every edge has two faces that run through it in opposite directions.
pub fn bodies(geometry: &Geometry) -> Vec<Option<[DVec3; 8]>> {
    let closed = |mesh: &MeshRange| {
        let faces = mesh.mesh.adjacency().pairs();
        faces.iter().flatten().all(|&f| f < mesh.faces)
    };
    let corners = |mesh: &MeshRange| {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for face in mesh.first_face..mesh.first_face + mesh.faces {
            for p in geometry.corners(face) {
                (low, high) = (low.min(p), high.max(p));
            }
        }
        corners_of(low, high)
    };
    let meshes = geometry.meshes.iter();
    meshes.map(|m| closed(m).then(|| corners(m))).collect()
}

/// Numbers of some of a scene's vertices: a table, since to look in a hash map took half of the time.
#[derive(Debug, Default)]
struct Numbers {
    /// The round in which a vertex got its number, and the number.
    table: Vec<(u32, u32)>,
    round: u32,
}

impl Numbers {
    /// Forgets all numbers, for a scene with so many vertices.
    fn clear(&mut self, vertices: usize) {
        if self.table.len() != vertices || self.round == u32::MAX {
            self.table.clear();
            self.table.resize(vertices, (0, 0));
            self.round = 0;
        }
        self.round += 1;
    }

    /// The number of a vertex, `next` if it has none.
    #[inline(always)]
    fn of(&mut self, vertex: u32, next: impl FnOnce() -> u32) -> u32 {
        let (round, number) = &mut self.table[vertex as usize];
        if *round != self.round {
            (*round, *number) = (self.round, next());
        }
        *number
    }
}

/// What a thread keeps between patches.
#[derive(Debug, Default)]
pub struct Gatherer {
    stack: Vec<u32>,
    found: Vec<(u32, Part)>,
    vertices: Numbers,
    cuts: HashMap<(u32, u32), u32>,
}

impl Gatherer {
    /// Collects what can hide a part of the light from a side of a patch.
    pub fn collect(
        &mut self,
        casting: &Casting<'_>,
        patch: u32,
        side: &Side,
        light: &Light,
    ) -> PatchOccluders {
        let shaft = Shaft::new(bounds_of(&side.bounds), padded_bounds(light));
        self.collect_in(&shaft, casting, patch, side, light)
    }

    /// Lines along which what casts passes through a patch.
    pub fn contacts(
        &mut self,
        casting: &Casting<'_>,
        patch: u32,
        side: &Side,
        light: &Light,
    ) -> Vec<[DVec3; 2]> {
        let around = bounds_of(&side.bounds);
        let near = Shaft::new(around, around);
        self.collect_in(&near, casting, patch, side, light).contacts
    }

    /// Whether more than so many triangles may hide a part of the light from a side of a patch.
    pub fn has_more(
        &mut self,
        casting: &Casting<'_>,
        side: &Side,
        light: &Light,
        most: usize,
    ) -> bool {
        let shaft = Shaft::new(bounds_of(&side.bounds), padded_bounds(light));
        let occluders = casting.geometry.occluders();
        let transparent = occluders.transparent.iter().map(|(bvh, _)| bvh);
        let mut count = 0;
        for bvh in transparent.chain([&occluders.opaque]) {
            self.search(bvh, &shaft, |leaf| {
                count += leaf.len();
                count <= most
            });
        }
        count > most
    }

    /// Collects what can hide a part of the light and has a part in a shaft.
    fn collect_in(
        &mut self,
        shaft: &Shaft,
        casting: &Casting<'_>,
        patch: u32,
        side: &Side,
        light: &Light,
    ) -> PatchOccluders {
        let Casting {
            geometry,
            patches,
            opaque,
            ..
        } = *casting;
        let occluders = geometry.occluders();
        let mut found = std::mem::take(&mut self.found);
        found.clear();
        let opaque_faces = &occluders.opaque.faces;
        self.search(&occluders.opaque, shaft, |leaf| {
            found.extend(leaf.map(|k| (opaque_faces[k], Part::Opaque)));
            true
        });
        if let Some((bvh, through)) = &occluders.transparent {
            let part = |i: usize| {
                if opaque {
                    Part::Opaque
                } else {
                    Part::Clear(through[i])
                }
            };
            self.search(bvh, shaft, |leaf| {
                found.extend(leaf.map(|k| (bvh.faces[k], part(k))));
                true
            });
        }
        let front = light.normal().map(|m| (m, light.center() + light.lift()));
        let pyramid = pyramid(light, side);
        let (lowest, highest) = heights(light, side);
        // Bodies that do not reach either plane, by more than rounding and the rasteriser's near plane.
        let between = |body: &Option<[DVec3; 8]>| {
            body.is_some_and(|corners| {
                let far =
                    |p: &DVec3| (POINT_OFFSET..lowest * (1.0 - 1e-6)).contains(&side.height(*p));
                corners.iter().all(far)
            })
        };
        let closed: Vec<bool> = casting.bodies.iter().map(between).collect();
        let mut out = PatchOccluders::default();
        self.vertices.clear(geometry.positions.len());
        self.cuts.clear();
        for &(face, mut part) in &found {
            if patches.of_face[face as usize] == patch {
                continue;
            }
            let corners = geometry.corners(face).map(|p| p.as_dvec3());
            let heights = corners.map(|p| side.height(p));
            let behind = |(m, c): (DVec3, DVec3)| corners.iter().all(|p| m.dot(*p - c) < 0.0);
            if heights.iter().all(|h| *h <= 0.0)
                || heights.iter().all(|h| *h > highest)
                || front.is_some_and(behind)
                || pyramid.iter().any(|s| s.leaves_out(&corners))
            {
                continue;
            }
            let mesh = geometry.meshes.partition_point(|m| m.first_face <= face) - 1;
            if part == Part::Opaque && closed[mesh] {
                part = Part::Closed;
            }
            let face = geometry.faces[face as usize];
            self.add(&mut out, &face, &corners, side, part);
        }
        self.found = found;
        out
    }

    /// Adds the part of a triangle over the receiver's plane.
    fn add(
        &mut self,
        out: &mut PatchOccluders,
        face: &[u32; 3],
        corners: &[DVec3; 3],
        side: &Side,
        part: Part,
    ) {
        let heights = corners.map(|p| side.height(p));
        let mut polygon = [0; 4];
        let mut n = 0;
        let mut cut_at = [DVec3::ZERO; 2];
        let mut cut = 0;
        for i in 0..3 {
            let j = (i + 1) % 3;
            if heights[i] >= 0.0 {
                polygon[n] = self
                    .vertices
                    .of(face[i], || push(&mut out.points, corners[i]));
                n += 1;
            }
            if (heights[i] >= 0.0) != (heights[j] >= 0.0) {
                // From the lower vertex, so that all triangles at the edge are cut at one point.
                let (a, b) = if face[i] < face[j] { (i, j) } else { (j, i) };
                polygon[n] = *self.cuts.entry((face[a], face[b])).or_insert_with(|| {
                    let t = heights[a] / (heights[a] - heights[b]);
                    push(&mut out.points, corners[a] + (corners[b] - corners[a]) * t)
                });
                (cut_at[cut], cut) = (out.points[polygon[n] as usize], cut + 1);
                n += 1;
            }
        }
        if cut == 2 {
            out.contacts.push(cut_at);
        }
        for k in 2..n {
            let corners = [polygon[0], polygon[k - 1], polygon[k]];
            match part {
                Part::Opaque => out.opaque.push(corners),
                Part::Closed => out.closed.push(corners),
                Part::Clear(through) => out.clear.push((corners, through)),
            }
        }
    }

    /// Calls `each` for the leaves with a part in a shaft until it returns false.
    fn search(
        &mut self,
        bvh: &TriangleBvh,
        shaft: &Shaft,
        mut each: impl FnMut(Range<usize>) -> bool,
    ) {
        self.stack.clear();
        self.stack.push(0);
        while let Some(i) = self.stack.pop() {
            let Some(node) = bvh.tree.nodes.get(i as usize) else {
                return;
            };
            if !shaft.meets(node) {
                continue;
            }
            if node.count == 0 {
                self.stack.extend([node.first, i + 1]);
                continue;
            }
            if !each(node.first as usize..(node.first + node.count) as usize) {
                return;
            }
        }
    }
}

/// A half-space that holds the receiver and the light.
#[derive(Debug, Clone, Copy)]
struct HalfSpace {
    normal: DVec3,
    offset: f64,
}

impl HalfSpace {
    /// The part of a polygon inside.
    fn clip(&self, polygon: &[DVec3], out: &mut Vec<DVec3>) {
        out.clear();
        for (i, &a) in polygon.iter().enumerate() {
            let b = polygon[(i + 1) % polygon.len()];
            let [s, t] = [a, b].map(|p| self.offset - self.normal.dot(p));
            if s >= 0.0 {
                out.push(a);
            }
            if (s >= 0.0) != (t >= 0.0) {
                out.push(a + (b - a) * (s / (s - t)));
            }
        }
    }

    #[inline(always)]
    fn leaves_out(&self, corners: &[DVec3; 3]) -> bool {
        corners.iter().all(|p| self.normal.dot(*p) > self.offset)
    }
}

/// For each side of the receiver the half-space bounded by a plane through it that fits tightest around the
/// light's box.
fn pyramid(light: &Light, side: &Side) -> [HalfSpace; 4] {
    let box_ = box_of(light);
    let corners = side.bounds.corners();
    [0, 1, 2, 3].map(|i| {
        let (a, b) = (corners[i], corners[(i + 1) % 4]);
        let inside = corners[(i + 2) % 4];
        let through = |l: &DVec3| {
            let n = (b - a).cross(*l - a).normalize_or_zero();
            let normal = if n.dot(inside - a) > 0.0 { -n } else { n };
            let all = box_.iter().chain(&corners);
            let offset = all
                .map(|p| normal.dot(*p))
                .fold(f64::NEG_INFINITY, f64::max);
            (offset - normal.dot(a), HalfSpace { normal, offset })
        };
        let tightest = box_
            .iter()
            .map(through)
            .filter(|(_, h)| h.normal != DVec3::ZERO);
        let none = HalfSpace {
            normal: DVec3::ZERO,
            offset: 0.0,
        };
        let best = tightest
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(none, |t| t.1);
        // Far more than rounding, far less than a texel.
        HalfSpace {
            offset: best.offset + POINT_OFFSET,
            ..best
        }
    })
}

/// Adds a point and returns its number.
fn push(points: &mut Vec<DVec3>, p: DVec3) -> u32 {
    points.push(p);
    points.len() as u32 - 1
}

/// The bounds of a parallelogram, in `f32`.
fn bounds_of(p: &Parallelogram) -> (Vec3, Vec3) {
    let corners = p.corners();
    let low = corners.iter().fold(DVec3::INFINITY, |m, c| m.min(*c));
    let high = corners.iter().fold(DVec3::NEG_INFINITY, |m, c| m.max(*c));
    (
        low.as_vec3().map(f32::next_down),
        high.as_vec3().map(f32::next_up),
    )
}

/// Corners of a box around all light points.
fn box_of(light: &Light) -> [DVec3; 8] {
    let (low, high) = padded_bounds(light);
    corners_of(low, high)
}

/// Corners of a box.
fn corners_of(low: Vec3, high: Vec3) -> [DVec3; 8] {
    std::array::from_fn(|k| {
        let pick = |axis: usize| {
            f64::from(if k >> axis & 1 == 1 {
                high[axis]
            } else {
                low[axis]
            })
        };
        DVec3::new(pick(0), pick(1), pick(2))
    })
}

/// No light point is lower over the receiver, and none higher.
fn heights(light: &Light, side: &Side) -> (f64, f64) {
    let heights = box_of(light).map(|p| side.height(p));
    let low = heights.into_iter().fold(f64::INFINITY, f64::min);
    (low, heights.into_iter().fold(f64::NEG_INFINITY, f64::max))
}
