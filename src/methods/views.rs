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

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3, DVec4, Vec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::error::Result;
use crate::light::{Light, Shape};
use crate::methods::wedges::contour::Casters;
use crate::sampling::POINT_OFFSET;

/// Largest tangent of the angle off a single view's axis: beyond it a texel in the middle sees ten times the
/// solid angle per texel that one at the border does, and a cube's faces are better.
pub(super) const WIDEST: f64 = 3.0;

/// Largest margin around what casts, as a tangent: a face of a cube then spends three quarters of its texels
/// on its margin, and penumbrae that are wider than that come from occluders that all but touch the light.
const MARGIN: f64 = 1.0;

/// Most comparisons of triangles with all vertices in the search for those with nothing behind them, some ten
/// milliseconds: a ground of many triangles makes the view wider instead.
const COMPARISONS: usize = 1 << 24;

/// Triangles that one task measures: enough to outweigh a task.
pub(super) const CHUNK: usize = 4096;

/// How much coarser their faces are: what they cast on are points off every surface.
pub(super) const COARSER: u32 = 8;

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
    pub outline: Outline,
    /// Inverse depth of the farthest surface in the scene.
    pub inverse_far: f64,
    /// The only triangles that it holds, if not all that cast.
    pub only: Option<Arc<[u32]>>,
}

/// How far a light reaches from its centre, in a view's coordinates.
#[derive(Debug, Clone, Copy)]
pub enum Outline {
    /// Half edges.
    Rect(DVec3, DVec3),
    /// Normal and radius.
    Disk(DVec3, f64),
    /// Radius.
    Sphere(f64),
}

impl Outline {
    fn new(light: &Light, rotation: DMat3) -> Self {
        match light.shape {
            Shape::Rect { u, v, .. } => Outline::Rect(rotation * (0.5 * u), rotation * (0.5 * v)),
            Shape::Disk { normal, radius, .. } => Outline::Disk(rotation * normal, radius),
            Shape::Sphere { radius, .. } => Outline::Sphere(radius),
        }
    }

    /// The light's equivalent radius for a silhouette with image normal `normal` at the image point `at` of
    /// focal length 1: its half extent along the normal of the plane through its centre and the silhouette,
    /// scaled so that it is the shift across the image. Also which part of a rectangle's width the shorter
    /// of its sides makes up, at most 1/2.
    #[inline(always)]
    pub fn radius(&self, normal: DVec2, at: DVec2) -> (f64, f64) {
        let g = normal.extend(-normal.dot(at));
        match *self {
            Outline::Rect(u, v) => {
                let (a, b) = (g.dot(u).abs(), g.dot(v).abs());
                let sum = a + b;
                (sum, if sum > 0.0 { a.min(b) / sum } else { 0.0 })
            }
            Outline::Disk(m, radius) => {
                let across = g.length_squared() - g.dot(m).powi(2);
                (radius * across.max(0.0).sqrt(), 0.0)
            }
            Outline::Sphere(radius) => (radius * g.length(), 0.0),
        }
    }

    fn widest(&self) -> f64 {
        match *self {
            Outline::Rect(u, v) => u.length() + v.length(),
            Outline::Disk(_, radius) | Outline::Sphere(radius) => radius,
        }
    }
}

impl View {
    /// Column and row in texels, and depth.
    #[inline(always)]
    pub fn project(&self, p: DVec3) -> (DVec2, f64) {
        let h = self.camera.project(p);
        (DVec2::new(h.x / h.z, h.y / h.z), h.z)
    }

    /// From texels to the image of focal length 1.
    #[inline(always)]
    pub fn tangents(&self, q: DVec2) -> DVec2 {
        let k = &self.camera.intrinsics.z_axis;
        (q - DVec2::new(k.x, k.y)) * self.texel_size
    }

    /// Whether a local point is in the view.
    pub fn holds(&self, p: DVec3) -> bool {
        let (q, depth) = self.project(p);
        depth > 0.0 && self.texel(q).is_some()
    }

    /// A texel's centre.
    #[inline(always)]
    pub fn center(&self, texel: usize) -> DVec2 {
        // In 32 bits, half as long.
        let (texel, width) = (texel as u32, self.camera.width);
        DVec2::new(f64::from(texel % width), f64::from(texel / width)) + 0.5
    }

    /// Index of the texel that holds an image point.
    #[inline(always)]
    pub fn texel(&self, q: DVec2) -> Option<usize> {
        let (w, h) = (self.camera.width, self.camera.height);
        if q.x >= 0.0 && q.y >= 0.0 && q.x < f64::from(w) && q.y < f64::from(h) {
            Some(q.y as usize * w as usize + q.x as usize)
        } else {
            None
        }
    }
}

/// What of the casters a pyramid holds.
#[derive(Clone, Copy)]
pub(super) struct Extent {
    low: DVec2,
    high: DVec2,
    near: f64,
    /// Whether something reaches beside or behind the eye.
    open: bool,
}

impl Extent {
    pub(super) const NONE: Extent = Extent {
        low: DVec2::INFINITY,
        high: DVec2::NEG_INFINITY,
        near: f64::INFINITY,
        open: false,
    };

    pub(super) fn union(self, other: Extent) -> Extent {
        Extent {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            near: self.near.min(other.near),
            open: self.open || other.open,
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.near == f64::INFINITY && !self.open
    }

    /// Of a triangle, cut to `|x|, |y| <= limit z` as far as its corners tell; with no limit, what is beside or
    /// behind the eye counts too.
    #[inline(always)]
    pub(super) fn of(corners: [DVec3; 3], limit: Option<f64>) -> Extent {
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
        let mut extent = Extent::NONE;
        for p in corners {
            if p.z <= 0.0 {
                extent.open = true;
                continue;
            }
            let q = p.truncate() / p.z;
            extent.low = extent.low.min(q);
            extent.high = extent.high.max(q);
            extent.near = extent.near.min(p.z);
        }
        extent
    }
}

fn look(along: DVec3) -> DMat3 {
    let x = along.any_orthonormal_vector();
    DMat3::from_cols(x, along.cross(x), along).transpose()
}

/// The views that hold everything that casts.
///
/// # Errors
/// None for a light and a scene that were checked; those of [`Camera::new`] otherwise.
pub fn views(light: &Light, casters: &Casters, resolution: u32) -> Result<Vec<View>> {
    let geometry = casters.geometry();
    let eye = light.center();
    let everything: Vec<u32> = casters.face_ranges().flatten().collect();
    let middle = middle_of(casters).unwrap_or(eye);
    let axis = light.normal().or((middle - eye).try_normalize());
    let rotation = look(axis.unwrap_or(DVec3::Z));
    let flat = light.normal().is_some();
    // What is behind a flat light hides none of it.
    let front = light.normal().unwrap_or_default();
    let extent = |rotation: DMat3, limit: Option<f64>, faces: &[u32]| {
        let of = |&face: &u32| {
            let corners = geometry.corners(face).map(|v| v.as_dvec3() - eye);
            if flat && corners.iter().all(|p| front.dot(*p) <= 0.0) {
                return Extent::NONE;
            }
            Extent::of(corners.map(|p| rotation * p), limit)
        };
        let parts = faces.par_chunks(CHUNK);
        parts
            .map(|faces| faces.iter().map(of).fold(Extent::NONE, Extent::union))
            .reduce(|| Extent::NONE, Extent::union)
    };
    let far = geometry
        .positions
        .par_iter()
        .map(|p| (p.as_dvec3() - eye).length())
        .reduce(|| 0.0, f64::max);
    let widest = Outline::new(light, rotation).widest();
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
            outline: Outline::new(light, rotation),
            inverse_far: 1.0 / far,
            only,
        })
    };
    let (foremost, behind_nothing) = split(casters, eye);
    let (mut resolution, mut faces, mut only) = (resolution, &everything[..], None);
    let main = extent(rotation, None, &foremost);
    let mut out = Vec::new();
    if everything.is_empty() {
        return Ok(out);
    }
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
        only = Some(Arc::from(faces));
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

/// Of cameras that look from around `center` the one that a local point is most central in, by its place.
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
pub(super) fn look_face(base: DMat3, axis: usize, sign: f64) -> DMat3 {
    let forward = sign * base.col(axis);
    let right = base.col((axis + 1) % 3);
    DMat3::from_cols(right, forward.cross(right), forward).transpose()
}

fn middle_of(casters: &Casters) -> Option<DVec3> {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let geometry = casters.geometry();
    let (low, high) = casters
        .face_ids()
        .map(|f| {
            let [a, b, c] = geometry.corners(f).map(|v| v.as_dvec3());
            (a.min(b).min(c), a.max(b).max(c))
        })
        .reduce(|| none, |a, b| (a.0.min(b.0), a.1.max(b.1)));
    (low.x <= high.x).then(|| 0.5 * (low + high))
}

/// What casts, without and only those triangles that have no vertex of the scene behind them as `eye` sees it.
/// There are none of the latter if they are too many.
pub(super) fn split(casters: &Casters, eye: DVec3) -> (Vec<u32>, Vec<u32>) {
    let geometry = casters.geometry();
    let positions = &geometry.positions;
    let all = || (casters.face_ranges().flatten().collect(), Vec::new());
    if !geometry.spheres.is_empty() {
        return all();
    }
    let extremes = extremes(positions);
    let plane = |face: u32| {
        let [a, b, c] = geometry.corners(face).map(|v| v.as_dvec3());
        let n = (b - a).cross(c - a).try_normalize()?;
        Some((if n.dot(eye - a) < 0.0 { -n } else { n }, a))
    };
    // Less far behind than a receiver has to be to be hidden.
    let before = |p: DVec3, n: DVec3, a: DVec3| n.dot(p - a) >= -POINT_OFFSET;
    let candidate =
        |face: u32| plane(face).is_some_and(|(n, a)| extremes.iter().all(|&p| before(p, n, a)));
    let candidates: Vec<u32> = casters.face_ids().filter(|&f| candidate(f)).collect();
    if candidates.len().saturating_mul(positions.len()) > COMPARISONS {
        return all();
    }
    let nothing = |f: &u32| {
        let Some((n, a)) = plane(*f) else {
            return false;
        };
        positions.iter().all(|p| before(p.as_dvec3(), n, a))
    };
    let last: Vec<u32> = candidates.into_par_iter().filter(nothing).collect();
    let first = casters.face_ranges().flatten();
    (
        first.filter(|f| last.binary_search(f).is_err()).collect(),
        last,
    )
}

/// Extreme positions along the axes and the diagonals: they rule almost all triangles out.
fn extremes(positions: &[Vec3]) -> Vec<DVec3> {
    let signs = |x: i32, y: i32, z: i32| Vec3::new(x as f32, y as f32, z as f32);
    let directions = [
        signs(1, 0, 0),
        signs(0, 1, 0),
        signs(0, 0, 1),
        signs(1, 1, 1),
        signs(1, 1, -1),
        signs(1, -1, 1),
        signs(-1, 1, 1),
    ];
    let both = directions.par_iter().flat_map_iter(|&d| [d, -d]);
    both.filter_map(|d| {
        let (mut most, mut found) = (f32::NEG_INFINITY, None);
        for p in positions {
            let along = d.dot(*p);
            if along > most {
                (most, found) = (along, Some(p.as_dvec3()));
            }
        }
        found
    })
    .collect()
}
