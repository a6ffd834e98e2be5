//! Shadow volumes: how many layers lie between a light and what the camera sees (Akenine-Möller and
//! Assarsson 2002, Section 3), counted where view rays cross the volumes' surfaces.
//!
//! A volume's sides are quads that start at silhouette edges and reach away from the light to infinity,
//! however wide the angle in which the light sees an edge. They go through the one rasteriser, whose rule
//! at shared edges makes each view ray cross each surface exactly once. Whether a crossing lies before
//! a receiver is the side of the quad's plane that the receiver is on, decided by one number, the same that
//! decides what a wedge does there: depths are never compared. Counting from the eye, quads end where they
//! leave the half-spaces that hold all receivers and the eye: what is beyond lies behind every receiver.
//!
//! Counting from the eye (*Z-pass*) starts with the layers between the light and the eye itself, found from
//! the triangles that the segment from the light to the eye crosses; so it is right for a viewer in shadow
//! or inside an occluder too. View rays begin at the rasteriser's near plane, though: where a triangle, or the
//! plane of a quad, comes between that and the eye, some rays begin beyond it and some do not, no one number
//! is right for all, and layers are counted from the other end. Counting from behind the receiver (*Z-fail*,
//! the paper's Section 8) needs the volumes closed, by the triangles themselves and by their copies at the far
//! end, and no start.

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::casters::Casters;
use crate::casters::edges::Edge;
use crate::geometry::distance;
use crate::mesh::silhouettes::side_of;
use crate::raster::coverage;
use crate::raster::coverage::Quadrilateral;
use crate::raster::project;
use crate::raster::setup::{NEAR, PixelBounds};

/// One side of a shadow volume: from an edge away from the light.
#[derive(Debug, Clone, Copy)]
pub struct VolumeQuad {
    /// Local positions of its edge.
    pub ends: [DVec3; 2],
    /// Unit directions of its sides; each is shared with the neighbour.
    pub rays: [DVec3; 2],
    /// Normal of its plane, out of the shadow.
    pub normal: DVec3,
    /// A point is on the shadow's side where `normal · p < offset`.
    pub offset: f64,
    /// Front layers that the volume has more on the shadow's side.
    pub front: i32,
    /// Back layers.
    pub back: i32,
    /// Object; quads are in the order of their objects.
    pub object: u32,
}

impl VolumeQuad {
    /// The side of a hard shadow's volume: the plane through an edge and the light's centre.
    pub fn hard(edge: &Edge, center: DVec3) -> VolumeQuad {
        let [a, b] = edge.ends.map(|v| v - center);
        let normal = a.cross(b);
        VolumeQuad {
            ends: edge.ends,
            rays: [a, b].map(DVec3::normalize_or_zero),
            normal,
            offset: normal.dot(center),
            front: edge.front,
            back: edge.back,
            object: edge.object,
        }
    }

    fn behind(&self, p: DVec3) -> bool {
        self.normal.dot(p) < self.offset
    }
}

/// From which end of the view ray layers are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Counting {
    /// Layers are counted from the eye, starting with the layers over it; from infinity where the eye is on a volume's
    /// side or on a triangle.
    ZPass,
    /// Layers are counted from infinity, the volumes closed by caps.
    ZFail,
}

/// What a rasterised face, a piece of a quad or of a cap, counts.
#[derive(Debug, Clone, Copy)]
pub struct CountedFace {
    /// Plane of a quad; unused for caps.
    pub normal: DVec3,
    /// Offset of the plane.
    pub offset: f64,
    /// Whether it counts for receivers on the shadow's side of the plane, or for those on the other.
    pub counts_behind: bool,
    /// Whether it counts wherever it covers a pixel.
    pub cap: bool,
    /// Change of the front layers that its crossing stands for.
    pub front: i32,
    /// Change of the back layers.
    pub back: i32,
    /// Its object.
    pub object: u32,
}

impl CountedFace {
    /// Whether the crossing counts for a receiver on the shadow's side (or not) of its plane.
    pub fn counts(&self, behind: bool) -> bool {
        behind == self.counts_behind
    }
}

/// Layers over the eye, by object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Start {
    /// The object.
    pub object: u32,
    /// Front layers.
    pub front: i32,
    /// Back layers.
    pub back: i32,
}

/// What the rasteriser gets for one camera.
pub struct VolumeDrawing {
    /// Homogeneous pixel coordinates.
    pub points: Vec<DVec3>,
    /// Their pixels.
    pub bounds: Vec<PixelBounds>,
    /// Sides of volumes and caps.
    pub faces: Vec<Quadrilateral>,
    /// What each face counts.
    pub surfaces: Vec<CountedFace>,
    /// Layers that counting starts with, where there are any; in the order of objects.
    pub start: Vec<Start>,
}

/// What is drawn.
pub struct VolumeView<'a> {
    /// The camera, local.
    pub camera: &'a Camera,
    /// Bounds of all receivers.
    pub receivers: [DVec3; 2],
    /// Where layers are counted from.
    pub counting: Counting,
    /// Whether objects are told apart.
    pub objects: bool,
    /// Quads that stand for one edge.
    pub copies: i32,
}

/// A point, or the point at infinity in a direction.
#[derive(Clone, Copy)]
struct Corner {
    at: DVec3,
    weight: f64,
}

impl Corner {
    fn point(at: DVec3) -> Self {
        Corner { at, weight: 1.0 }
    }

    fn infinite(at: DVec3) -> Self {
        Corner { at, weight: 0.0 }
    }

    /// Where the eye sees it: for the rasteriser, which looks at points in homogeneous coordinates about the
    /// eye, a direction from there is the point at infinity.
    fn seen_from(self, eye: DVec3) -> DVec3 {
        self.at + (1.0 - self.weight) * eye
    }
}

/// Half-spaces that hold all receivers and the eye: what is outside one is behind every receiver.
struct Room {
    planes: Vec<(usize, f64, f64)>,
}

impl Room {
    fn new(receivers: [DVec3; 2], eye: DVec3) -> Self {
        let mut planes = Vec::new();
        for axis in 0..3 {
            for (sign, limit) in [(-1.0, receivers[0][axis]), (1.0, receivers[1][axis])] {
                // The slack is far above the rounding of coordinates and far below a pixel.
                let limit = sign * limit + 1e-9 * eye[axis].abs().max(limit.abs()).max(1.0);
                if sign * eye[axis] < limit {
                    planes.push((axis, sign, limit));
                }
            }
        }
        Room { planes }
    }

    /// Where a ray leaves, and through which plane.
    fn exit(&self, start: DVec3, ray: DVec3) -> Option<(usize, DVec3)> {
        let mut first: Option<(usize, f64)> = None;
        for (i, &(axis, sign, limit)) in self.planes.iter().enumerate() {
            let speed = sign * ray[axis];
            if speed > 0.0 {
                let t = ((limit - sign * start[axis]) / speed).max(0.0);
                if first.is_none_or(|f| t < f.1) {
                    first = Some((i, t));
                }
            }
        }
        first.map(|(i, t)| (i, start + t * ray))
    }
}

/// The pieces of a quad, each cut in two by its first and third corner; a triangle repeats its last. Where both
/// sides leave the room of the receivers through one plane it ends there;
/// a side that leaves has a corner there in any case, so that neighbours share their sides piece by piece.
fn pieces(quad: &VolumeQuad, room: Option<&Room>, out: &mut Vec<[Corner; 4]>) {
    let [a, b] = quad.ends.map(Corner::point);
    let [far_a, far_b] = quad.rays.map(Corner::infinite);
    let exit = |end: usize| room.and_then(|r| r.exit(quad.ends[end], quad.rays[end]));
    out.clear();
    match (exit(0), exit(1)) {
        (Some((i, p)), Some((j, q))) => {
            let (p, q) = (Corner::point(p), Corner::point(q));
            out.push([a, b, q, p]);
            if i != j {
                out.push([p, q, far_b, far_a]);
            }
        }
        (Some((_, p)), None) => {
            let p = Corner::point(p);
            out.extend([[b, far_b, p, a], [p, far_b, far_a, far_a]]);
        }
        (None, Some((_, q))) => {
            let q = Corner::point(q);
            out.extend([[a, b, q, far_b], [a, far_b, far_a, far_a]]);
        }
        (None, None) => out.push([a, b, far_b, far_a]),
    }
}

/// Prepares the volumes of `quads`.
pub fn draw(
    casters: &Casters,
    quads: &[VolumeQuad],
    center: DVec3,
    view: &VolumeView,
) -> VolumeDrawing {
    let &VolumeView {
        camera,
        objects,
        copies,
        ..
    } = view;
    let eye = camera.eye;
    let counting = match view.counting {
        Counting::ZPass if touches(casters, quads, camera) => Counting::ZFail,
        other => other,
    };
    let room = (counting == Counting::ZPass).then(|| Room::new(view.receivers, eye));
    let mut drawing = VolumeDrawing {
        points: Vec::with_capacity(4 * quads.len()),
        bounds: Vec::with_capacity(4 * quads.len()),
        faces: Vec::with_capacity(quads.len()),
        surfaces: Vec::with_capacity(quads.len()),
        start: Vec::new(),
    };
    let mut parts = Vec::new();
    for quad in quads {
        let eye_behind = quad.behind(eye);
        // Crossed before a receiver on the other side than the eye; the other surfaces that cover it lie
        // behind it, and are crossed in the other direction when counting from there.
        let (sign, counts_behind) = match counting {
            Counting::ZPass => (1 - 2 * i32::from(eye_behind), !eye_behind),
            Counting::ZFail => (2 * i32::from(eye_behind) - 1, eye_behind),
        };
        // Where the rays cross, the part beyond is turned over and counts the other way.
        let turned = |p: &Corner, q: &Corner, r: &Corner| {
            let normal = p.weight * q.at.cross(r.at)
                + q.weight * r.at.cross(p.at)
                + r.weight * p.at.cross(q.at);
            normal.dot(quad.normal) > 0.0
        };
        let surface = |turned: bool| {
            let sign = if turned { -sign } else { sign };
            CountedFace {
                normal: quad.normal,
                offset: quad.offset,
                counts_behind,
                cap: false,
                front: sign * quad.front,
                back: sign * quad.back,
                object: quad.object,
            }
        };
        pieces(quad, room.as_ref(), &mut parts);
        for corners in &parts {
            let [p, q, r, s] = corners;
            let first = drawing.points(camera, corners.map(|c| c.seen_from(eye)));
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| first + i);
            match (turned(p, q, r), turned(p, r, s)) {
                (half, other) if half == other => {
                    drawing.push([a, b, c, d], surface(half));
                }
                (half, other) => {
                    drawing.push(coverage::triangle([a, b, c]), surface(half));
                    drawing.push(coverage::triangle([a, c, d]), surface(other));
                }
            }
        }
    }
    match counting {
        Counting::ZPass => {
            drawing.start = layers_over(casters, quads, center, eye, objects, copies)
        }
        Counting::ZFail => {
            let caps = Caps { center, copies };
            caps.draw(casters, quads, camera, objects, &mut drawing);
            // Tiles want each object's surfaces together.
            drawing.surfaces_by_object();
        }
    }
    drawing
}

/// Whether the plane of a quad or a triangle comes closer to the eye than the near plane does, in any pixel.
fn touches(casters: &Casters, quads: &[VolumeQuad], camera: &Camera) -> bool {
    let eye = camera.eye;
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
    let widest = corners.map(|(x, y)| camera.direction(x, y).length());
    let near = NEAR * widest.into_iter().fold(1.0 + eye.length(), f64::max);
    let quad = |q: &VolumeQuad| (q.normal.dot(eye) - q.offset).abs() <= near * q.normal.length();
    let geometry = casters.geometry();
    let triangle = |face: [u32; 3]| {
        let corners = face.map(|v| geometry.positions[v as usize].as_dvec3());
        let low = corners[0].min(corners[1]).min(corners[2]);
        let high = corners[0].max(corners[1]).max(corners[2]);
        // Most are far away.
        let outside = (low - eye).max(eye - high).max_element();
        outside <= near && distance(corners, eye) <= near
    };
    quads.par_iter().any(quad) || casters.faces().any(triangle)
}

impl VolumeDrawing {
    /// Adds points and returns the first one's number.
    fn points<const N: usize>(&mut self, camera: &Camera, points: [DVec3; N]) -> u32 {
        let first = self.points.len() as u32;
        for (point, bounds) in points.map(|p| project(p, camera)) {
            self.points.push(point);
            self.bounds.push(bounds);
        }
        first
    }

    fn push(&mut self, face: Quadrilateral, surface: CountedFace) {
        self.faces.push(face);
        self.surfaces.push(surface);
    }

    fn surfaces_by_object(&mut self) {
        let mut order: Vec<usize> = (0..self.faces.len()).collect();
        order.sort_by_key(|&i| self.surfaces[i].object);
        self.faces = order.iter().map(|&i| self.faces[i]).collect();
        self.surfaces = order.iter().map(|&i| self.surfaces[i]).collect();
    }
}

/// Six times the volume of a tetrahedron; positive where its first three corners run clockwise as `d`
/// sees them.
fn volume(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    (a - d).dot((b - d).cross(c - d))
}

/// What closes the volumes: triangles, their copies at the far end, and what the quads' rays leave between.
struct Caps {
    center: DVec3,
    copies: i32,
}

impl Caps {
    fn draw(
        &self,
        casters: &Casters,
        quads: &[VolumeQuad],
        camera: &Camera,
        objects: bool,
        drawing: &mut VolumeDrawing,
    ) {
        let &Caps { center, copies } = self;
        let geometry = casters.geometry();
        let far =
            |p: DVec3| Corner::infinite((p - center).normalize_or_zero()).seen_from(camera.eye);
        let mut add = |corners: [DVec3; 3], layers: [i32; 2], object: u32| {
            let surface = CountedFace {
                normal: DVec3::ZERO,
                offset: 0.0,
                counts_behind: false,
                cap: true,
                front: layers[0],
                back: layers[1],
                object,
            };
            let first = drawing.points(camera, corners);
            let face = coverage::triangle([0, 1, 2].map(|i| first + i));
            drawing.push(face, surface);
        };
        for face in casters.faces().collect::<Vec<_>>() {
            let object = casters.object_of(face[0], objects);
            let corners = face.map(|v| geometry.positions[v as usize].as_dvec3());
            let side = side_of(corners, center);
            let seen = side_of(corners, camera.eye);
            if side == 0 {
                continue;
            }
            let layers = |n: i32| {
                if side > 0 {
                    [n * copies, 0]
                } else {
                    [0, n * copies]
                }
            };
            // Going away from the eye, a ray enters through the near cap where the eye is on the light's
            // side; what is found behind the receiver is not over it. Seen edge-on it is not entered.
            if seen != 0 {
                add(corners, layers(if seen == side { -1 } else { 1 }), object);
            }
            // The eye is always before the far end.
            add(corners.map(far), layers(1), object);
        }
        for quad in quads {
            let [a, b] = quad.ends;
            let [fa, fb] = [far(a), far(b)];
            let [ga, gb] = quad
                .rays
                .map(|ray| Corner::infinite(ray).seen_from(camera.eye));
            for [p, q, r] in [[ga, gb, fb], [ga, fb, fa]] {
                let sign = match volume(p, q, r, camera.eye) {
                    v if v < 0.0 => 1,
                    v if v > 0.0 => -1,
                    _ => continue,
                };
                add(
                    [p, q, r],
                    [sign * quad.front, sign * quad.back],
                    quad.object,
                );
            }
        }
    }
}

/// Layers between the light's centre and the eye: what the segment between them crosses. A triangle closes
/// `copies` volumes.
fn layers_over(
    casters: &Casters,
    quads: &[VolumeQuad],
    center: DVec3,
    eye: DVec3,
    objects: bool,
    copies: i32,
) -> Vec<Start> {
    let geometry = casters.geometry();
    let Some(axis) = (eye - center).try_normalize() else {
        return Vec::new();
    };
    let u = axis.any_orthonormal_vector();
    let v = axis.cross(u);
    // Where the segment is seen as a point, a triangle that it crosses surrounds that point; the margin is
    // far above the rounding of coordinates and far below a triangle's size.
    let positions = geometry.positions.par_iter();
    let far = positions
        .map(|p| p.abs().max_element())
        .reduce(|| 0.0, f32::max);
    let margin = 1e-12 * (4.0 + eye.length() + center.length() + f64::from(far));
    let seen: Vec<[f64; 2]> = geometry
        .positions
        .par_iter()
        .map(|p| [u, v].map(|w| w.dot(p.as_dvec3() - eye)))
        .collect();
    let mut found: Vec<Start> = casters
        .faces()
        .filter(|face| {
            let corners = face.map(|v| seen[v as usize]);
            (0..2).all(|axis| {
                let d = corners.map(|c| c[axis]);
                d.iter().any(|d| *d <= margin) && d.iter().any(|d| *d >= -margin)
            })
        })
        .filter_map(|face| {
            let corners = face.map(|v| geometry.positions[v as usize].as_dvec3());
            let [side, other] = [center, eye].map(|p| side_of(corners, p));
            if side == 0 || side == other {
                return None;
            }
            let around = (0..3).all(|i| {
                let (p, q) = (face[i], face[(i + 1) % 3]);
                let at = |v: u32| geometry.positions[v as usize].as_dvec3();
                on_left(center, eye, at(p), at(q)) == (side > 0)
            });
            let (front, back) = if side > 0 { (copies, 0) } else { (0, copies) };
            around.then_some(Start {
                object: casters.object_of(face[0], objects),
                front,
                back,
            })
        })
        .collect();
    found.extend(quads.iter().filter_map(|q| crossing(q, center, eye)));
    found.sort_by_key(|s| s.object);
    let mut out: Vec<Start> = Vec::new();
    for s in found {
        match out.last_mut() {
            Some(last) if last.object == s.object => {
                last.front += s.front;
                last.back += s.back;
            }
            _ => out.push(s),
        }
    }
    out
}

/// Whether `center` sees `eye` on the left of the line from `p` to `q`. Of the two directions of a line
/// always one has it on its left, so that a segment through a shared edge crosses one of what meets there.
fn on_left(center: DVec3, eye: DVec3, p: DVec3, q: DVec3) -> bool {
    if p.to_array() < q.to_array() {
        side_of([center, p, q], eye) < 0
    } else {
        side_of([center, q, p], eye) >= 0
    }
}

/// What the segment from the light's centre to the eye gains where it crosses a quad, on whose lit side the
/// centre is. Quads of hard shadows run along the segment and gain nothing.
fn crossing(quad: &VolumeQuad, center: DVec3, eye: DVec3) -> Option<Start> {
    if quad.normal.dot(center) <= quad.offset || !quad.behind(eye) {
        return None;
    }
    // Seen from the centre, the quad is on the right of its edge, of its second ray, and of the way back
    // along its first; turned over where the rays cross.
    let [a, b] = quad.ends;
    let beside_a = !on_left(center, eye, a, a + quad.rays[0]);
    let beside_b = !on_left(center, eye, b, b + quad.rays[1]);
    if beside_a == beside_b {
        return None;
    }
    let away = if a == b {
        // No edge, only a vertex: whether the crossing lies on the rays' side of it.
        let [c, e] = [center, eye].map(|p| quad.normal.dot(p) - quad.offset);
        let crossing = center + (eye - center) * (c / (c - e));
        (crossing - a).dot(quad.rays[0] + quad.rays[1]) > 0.0
    } else {
        !on_left(center, eye, a, b)
    };
    if !away {
        return None;
    }
    let sign = if beside_b { 1 } else { -1 };
    Some(Start {
        object: quad.object,
        front: sign * quad.front,
        back: sign * quad.back,
    })
}
