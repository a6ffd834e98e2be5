//! The pinhole views of a light, and how a light looks in them.
//!
//! One view holds everything that casts where it lies in front of the light within `WIDEST`; otherwise
//! there are up to six faces of a cube, those that something casts into. For a flat light the views look
//! along its normal, so that its points differ only across the view, and the penumbra of a straight edge is
//! exact.
//!
//! Triangles with nothing in the scene behind them, such as a ground's, cast on no surface of it. They do not
//! widen the view, but get coarse faces of a cube to themselves, for points that a user may have behind
//! them. A margin around what casts, as wide as the widest penumbra, keeps edges near a border findable.

use std::ops::Range;
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3, DVec4, Vec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::casters::CHUNK;
use crate::casters::Casters;
use crate::casters::behind::{chunks, with_nothing_behind};
use crate::error::Result;
use crate::geometry::Geometry;
use crate::light::Light;
use crate::light::reach::LightOutline;

/// Largest tangent of the angle off a single view's axis: beyond it a texel in the middle sees ten times the
/// solid angle per texel that one at the border does, and a cube's faces are better.
pub(crate) const WIDEST: f64 = 3.0;

/// Largest margin around what casts, as a tangent: a face of a cube then spends three quarters of its texels
/// on its margin, and penumbrae that are wider than that come from occluders that all but touch the light.
const MARGIN: f64 = 1.0;

/// How much coarser their faces are: what they cast on are points off every surface.
pub(crate) const COARSER: u32 = 8;

/// A view from the light's centre.
#[derive(Debug, Clone)]
pub struct View {
    /// Its camera, local.
    pub camera: Camera,
    /// Focal length in texels.
    pub focal: f64,
    /// Its reciprocal.
    pub texel_size: f64,
    /// The light as seen along this view.
    pub outline: LightOutline,
    /// Inverse depth of the farthest surface in the scene.
    pub inverse_far: f64,
    /// The only triangles that it holds, if not all that cast.
    pub only: Option<Arc<[u32]>>,
}

impl View {
    /// Column and row in texels, and depth.
    #[inline(always)]
    pub fn project(&self, p: DVec3) -> (DVec2, f64) {
        let h = self.camera.project(p);
        (DVec2::new(h.x / h.z, h.y / h.z), h.z)
    }

    /// The map from texels to the image of focal length 1.
    #[inline(always)]
    pub fn tangents(&self, q: DVec2) -> DVec2 {
        let k = &self.camera.intrinsics.z_axis;
        (q - DVec2::new(k.x, k.y)) * self.texel_size
    }

    /// Whether a local point is in the view.
    pub fn holds(&self, p: DVec3) -> bool {
        let (q, depth) = self.project(p);
        depth > 0.0 && self.contains(q)
    }

    /// A texel's centre.
    #[inline(always)]
    pub fn center(&self, texel: usize) -> DVec2 {
        // In 32 bits, half as long.
        let (texel, width) = (texel as u32, self.camera.width);
        DVec2::new(f64::from(texel % width), f64::from(texel / width)) + 0.5
    }

    /// First corner of the last texel.
    #[inline(always)]
    pub fn last(&self) -> DVec2 {
        let [w, h] = [self.camera.width, self.camera.height].map(|n| f64::from(n - 1));
        DVec2::new(w, h)
    }

    /// Index of the texel that holds an image point.
    #[inline(always)]
    pub fn texel(&self, q: DVec2) -> Option<usize> {
        if self.contains(q) {
            Some(q.y as usize * self.camera.width as usize + q.x as usize)
        } else {
            None
        }
    }

    /// Whether an image point is in the image; without branches.
    #[inline(always)]
    pub fn contains(&self, q: DVec2) -> bool {
        let [w, h] = [self.camera.width, self.camera.height].map(f64::from);
        (q.x >= 0.0) & (q.y >= 0.0) & (q.x < w) & (q.y < h)
    }
}

/// What of the casters a pyramid holds.
#[derive(Clone, Copy)]
pub(crate) struct Extent {
    low: DVec2,
    high: DVec2,
    near: f64,
    /// Whether something reaches beside or behind the eye.
    open: bool,
}

impl Extent {
    pub(crate) const NONE: Extent = Extent {
        low: DVec2::INFINITY,
        high: DVec2::NEG_INFINITY,
        near: f64::INFINITY,
        open: false,
    };

    pub(crate) fn union(self, other: Extent) -> Extent {
        Extent {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            near: self.near.min(other.near),
            open: self.open || other.open,
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.near == f64::INFINITY && !self.open
    }

    /// The extent of a triangle, cut to `|x|, |y| <= limit z` as far as its corners tell; with no limit, what is beside
    /// or behind the eye counts too.
    #[inline(always)]
    pub(crate) fn of(corners: [DVec3; 3], limit: Option<f64>) -> Extent {
        let [a, b, c] = corners;
        if let Some(limit) = limit {
            // Positive beyond the side planes; beyond one of them with all corners, nothing is within.
            let beyond = |p: DVec3| {
                let (right, down) = (limit * p.z - p.x, limit * p.z - p.y);
                let (left, up) = (limit * p.z + p.x, limit * p.z + p.y);
                DVec4::new(right, left, down, up)
            };
            let nearest = beyond(a).max(beyond(b)).max(beyond(c));
            if nearest.min_element() < 0.0 || a.z.max(b.z).max(c.z) <= 0.0 {
                return Extent::NONE;
            }
        }
        let corners = corners.map(Extent::of_point);
        corners.into_iter().fold(Extent::NONE, Extent::union)
    }

    #[inline(always)]
    fn of_point(p: DVec3) -> Extent {
        if p.z <= 0.0 {
            return Extent {
                open: true,
                ..Extent::NONE
            };
        }
        let q = p.truncate() / p.z;
        Extent {
            low: q,
            high: q,
            near: p.z,
            open: false,
        }
    }
}

/// What casts, in parts for a task each.
struct Parts {
    /// Vertices of meshes that all cast, where these are the corners of their faces and no others.
    points: Vec<Range<u32>>,
    /// Triangles of the other meshes.
    faces: Vec<Range<u32>>,
    /// Triangles of all.
    all_faces: Vec<Range<u32>>,
}

impl Parts {
    /// The parts of `faces`, less the triangles in `without`, which is sorted.
    fn new(geometry: &Geometry, faces: &[Range<u32>], without: &[u32]) -> Self {
        let mut parts = Parts {
            points: Vec::new(),
            faces: Vec::new(),
            all_faces: Vec::new(),
        };
        for chunk in faces {
            let mesh = geometry.mesh_of(chunk.start);
            let left_out = |faces: Range<u32>| {
                let at = |face| without.partition_point(|f| *f < face);
                &without[at(faces.start)..at(faces.end)]
            };
            let mut start = chunk.start;
            let first = parts.all_faces.len();
            for &face in left_out(chunk.clone()).iter().chain([&chunk.end]) {
                if start < face {
                    parts.all_faces.push(start..face);
                }
                start = face + 1;
            }
            let end = mesh.first_face + mesh.faces;
            if !mesh.mesh.uses_all_vertices() || !left_out(mesh.first_face..end).is_empty() {
                parts.faces.extend_from_slice(&parts.all_faces[first..]);
            } else if chunk.start == mesh.first_face {
                let end = mesh.first_vertex + mesh.mesh.vertices().len() as u32;
                let starts = (mesh.first_vertex..end).step_by(CHUNK);
                let points = starts.map(|start| start..(start + CHUNK as u32).min(end));
                parts.points.extend(points);
            }
        }
        parts
    }

    /// What all corners of the triangles make up.
    fn fold<T: Copy + Send + Sync>(
        &self,
        geometry: &Geometry,
        none: T,
        of: impl Fn(Vec3) -> T + Sync,
        union: impl Fn(T, T) -> T + Sync,
    ) -> T {
        let of_face = |face: u32| {
            let [a, b, c] = geometry.corners(face).map(&of);
            union(union(a, b), c)
        };
        let faces = self.faces.par_iter().cloned();
        let faces = faces.map(|faces| faces.map(of_face).fold(none, &union));
        let points = self.fold_points(geometry, none, &of, &union);
        union(points, faces.reduce(|| none, &union))
    }

    /// What the vertices make up of those meshes of which these are enough.
    fn fold_points<T: Copy + Send + Sync>(
        &self,
        geometry: &Geometry,
        none: T,
        of: impl Fn(Vec3) -> T + Sync,
        union: impl Fn(T, T) -> T + Sync,
    ) -> T {
        let part = |points: &Range<u32>| {
            let points = &geometry.positions[points.start as usize..points.end as usize];
            points.iter().map(|p| of(*p)).fold(none, &union)
        };
        self.points.par_iter().map(part).reduce(|| none, &union)
    }
}

fn look(along: DVec3) -> DMat3 {
    let x = along.any_orthonormal_vector();
    DMat3::from_cols(x, along.cross(x), along).transpose()
}

/// The views that hold everything that casts.
///
/// # Errors
/// No error for a light and a scene that were checked; the errors of [`Camera::new`] otherwise.
pub fn views(light: &Light, casters: &Casters, resolution: u32) -> Result<Vec<View>> {
    let geometry = casters.geometry();
    let eye = light.center();
    let everything = chunks(casters);
    let all = Parts::new(geometry, &everything, &[]);
    let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let union = |a: (Vec3, Vec3), b: (Vec3, Vec3)| (a.0.min(b.0), a.1.max(b.1));
    let (low, high) = all.fold(geometry, none, |p| (p, p), union);
    let middle = 0.5 * (low.as_dvec3() + high.as_dvec3());
    let axis = light.normal().or((middle - eye).try_normalize());
    let rotation = look(axis.unwrap_or(DVec3::Z));
    // What is behind a flat light hides none of it.
    let behind = |p: DVec3| {
        light
            .normal()
            .is_some_and(|front| front.dot(p - eye) <= 0.0)
    };
    let extent = |rotation: DMat3, limit: Option<f64>, faces: &[Range<u32>]| {
        let of = |face: u32| {
            let corners = geometry.corners(face).map(|v| v.as_dvec3());
            if corners.iter().all(|p| behind(*p)) {
                return Extent::NONE;
            }
            Extent::of(corners.map(|p| rotation * (p - eye)), limit)
        };
        let parts = faces.par_iter().cloned();
        parts
            .map(|faces| faces.map(of).fold(Extent::NONE, Extent::union))
            .reduce(|| Extent::NONE, Extent::union)
    };
    let far = geometry
        .positions
        .par_iter()
        .map(|p| (p.as_dvec3() - eye).length_squared())
        .reduce(|| 0.0, f64::max)
        .sqrt();
    let widest = LightOutline::new(light, rotation).widest();
    let margin = |near: f64| (widest * (1.0 / near - 1.0 / far).max(0.0)).min(MARGIN);
    let make = |resolution: u32, rotation: DMat3, low: DVec2, high: DVec2, only| -> Result<View> {
        let size = high - low;
        let focal = f64::from(resolution) / size.max_element();
        let texels = (size * focal)
            .ceil()
            .clamp(DVec2::ONE, DVec2::splat(f64::from(resolution)));
        let k = DMat3::from_cols(
            DVec3::new(focal, 0.0, 0.0),
            DVec3::new(0.0, focal, 0.0),
            (-low * focal).extend(1.0),
        );
        let (w, h) = (texels.x as i64, texels.y as i64);
        Ok(View {
            camera: Camera::new(k, rotation.transpose(), eye, w, h)?,
            focal,
            texel_size: 1.0 / focal,
            outline: LightOutline::new(light, rotation),
            inverse_far: 1.0 / far,
            only,
        })
    };
    let mut out = Vec::new();
    if everything.is_empty() {
        return Ok(out);
    }
    let last = with_nothing_behind(casters, eye);
    let behind_nothing: Vec<Range<u32>> = last.iter().map(|&f| f..f + 1).collect();
    let (mut resolution, mut faces, mut only) = (resolution, &everything, None);
    let foremost = Parts::new(geometry, &everything, &last);
    let in_front = |points: &Range<u32>| {
        let points = &geometry.positions[points.start as usize..points.end as usize];
        points.iter().all(|p| !behind(p.as_dvec3()))
    };
    let main = if foremost.points.par_iter().all(in_front) {
        let seen = |p: Vec3| Extent::of_point(rotation * (p.as_dvec3() - eye));
        let points = foremost.fold_points(geometry, Extent::NONE, seen, Extent::union);
        points.union(extent(rotation, None, &foremost.faces))
    } else {
        extent(rotation, None, &foremost.all_faces)
    };
    let tangent = main.low.abs().max(main.high.abs()).max_element();
    // A texel and more around what casts, however small it is.
    let texel = (main.high - main.low).max_element() * 2.0 / f64::from(resolution);
    let border = margin(main.near) * (1.0 + tangent) + texel;
    if !main.is_empty() && !main.open && tangent + border <= WIDEST && border > 0.0 {
        let (low, high) = (main.low - border, main.high + border);
        out.push(make(resolution, rotation, low, high, None)?);
        let rest = extent(rotation, None, &behind_nothing);
        let held = rest.low.cmpge(low).all() && rest.high.cmple(high).all();
        if held && !rest.open {
            return Ok(out);
        }
        resolution = (resolution / COARSER).max(16);
        faces = &behind_nothing;
        only = Some(Arc::from(&last[..]));
    }
    let base = rotation.transpose();
    for k in 0..3 {
        for sign in [1.0, -1.0] {
            let rotation = look_face(base, 2 - k, sign);
            let seen = extent(rotation, Some(1.0 + MARGIN), faces);
            if seen.is_empty() {
                continue;
            }
            let border = if seen.open {
                MARGIN
            } else {
                2.0 * margin(seen.near)
            };
            // Two texels of margin at least, for the neighbours that a lookup interpolates.
            let half = DVec2::splat(1.0 + border.min(MARGIN).max(4.0 / f64::from(resolution)));
            out.push(make(resolution, rotation, -half, half, only.clone())?);
        }
    }
    Ok(out)
}

/// The place of the camera that a local point is most central in, of `cameras` that look from around `center`.
pub fn most_central<'a>(
    cameras: impl ExactSizeIterator<Item = &'a Camera>,
    center: DVec3,
    p: DVec3,
) -> usize {
    if cameras.len() == 1 {
        return 0;
    }
    let mut best = (0, f64::NEG_INFINITY);
    for (i, camera) in cameras.enumerate() {
        let along = camera.rotation.row(2).dot(p - center);
        if along > best.1 {
            best = (i, along);
        }
    }
    best.0
}

/// The face of a cube that looks along `sign` times column `axis` of `base`.
pub(crate) fn look_face(base: DMat3, axis: usize, sign: f64) -> DMat3 {
    let forward = sign * base.col(axis);
    let right = base.col((axis + 1) % 3);
    DMat3::from_cols(right, forward.cross(right), forward).transpose()
}
