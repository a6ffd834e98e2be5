//! The views that layered shadow maps are drawn from (Xie, Tabellion and Pearce 2007, Section 6.2).
//!
//! A view's eye is behind the light, so that whatever can hide a point of the light lies before the eye and
//! within the view. Equation 4 (`d = r / tan(fov / 2)`) also puts the light itself into the view. Nothing
//! asks for that here: the view is made to hold all that casts, and segments may leave it. Its distance makes
//! segments cross more texels, for errors that are a few hundredths of themselves smaller or larger, so the
//! eye stays as near as `WIDEST` lets it.
//! - **Flat light:** the view looks along its normal and starts at its plane; what is behind the plane hides
//!   nothing. Seen from so far behind, all of a scene in front of the plane fits into one view, also where it
//!   surrounds the light.
//! - **Sphere:** one view, if all that casts lies beyond the sphere and within `WIDEST`. Otherwise the
//!   faces of a cube that something casts into, each pushed back until its pyramid holds the sphere
//!   (`r √2`): the segments from a receiver to the light then lie in the pyramid that the receiver is most
//!   central in, and none crosses from one face to another.
//!
//! Triangles with nothing of the scene behind them, such as a ground's, hide no surface. They get a coarse
//! view to themselves, and do not widen the other nor take layers in it. A receiver looks at both.
//!
//! Fails where a sphere is cut by an occluder, and for receivers that all but touch it: within its depth
//! extent the map cannot tell what is before it (Section 4.3's conservative clipping).

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::casters::CHUNK;
use crate::casters::Casters;
use crate::casters::behind::split;
use crate::error::Result;
use crate::geometry::Geometry;
use crate::light::{Light, PolygonLight, RectLight, Shape};
use crate::maps::views::{COARSER, Extent, WIDEST, look_face};

/// The least distance from eye to light, over that from the light to the farthest caster. It keeps inverse
/// depths finite for lights without size, and costs no more than its own part of the resolution.
const LEAST_PUSH: f64 = 1.0 / 256.0;

/// Most doublings of the eye's distance: from a millionth of the scene to more than all of it.
const ROUNDS: usize = 24;

/// Least resolution of a coarse view.
const LEAST_RESOLUTION: u32 = 16;

/// One view.
#[derive(Debug, Clone)]
pub struct LayerView {
    /// Its camera, local, of one focal length.
    pub camera: Camera,
    /// Focal length in texels.
    pub focal: f64,
    /// Inverse depth of the nearest that it holds.
    pub inverse_near: f64,
    /// The triangles that it holds, in order.
    pub faces: Arc<[u32]>,
}

impl LayerView {
    /// Column, row and inverse depth of a local point; not finite for the eye.
    #[inline(always)]
    pub fn project(&self, p: DVec3) -> DVec3 {
        let h = self.camera.project(p);
        let inverse = 1.0 / h.z;
        DVec3::new(h.x * inverse, h.y * inverse, inverse)
    }
}

/// The views of one light: of every group, a receiver looks into the view that it is most central in.
#[derive(Debug, Clone)]
pub struct LightViews {
    /// A group is a single view, or the faces of a cube.
    pub groups: Vec<Vec<LayerView>>,
}

/// The views of a local light, `resolution` texels on the longer side of each.
///
/// # Errors
/// No error for a light and a scene that were checked; the errors of [`Camera::new`] otherwise.
pub fn light_views(light: &Light, casters: &Casters, resolution: u32) -> Result<LightViews> {
    // What lies in a flat light's plane, but for rounding, is behind it, as it is for light samples.
    let light = &light.lifted();
    let (foremost, rest) = split(casters, light.center());
    let coarse = (resolution / COARSER).max(LEAST_RESOLUTION);
    let mut groups = Vec::new();
    for (faces, resolution) in [(foremost, resolution), (rest, coarse)] {
        let group = match light.normal() {
            Some(normal) => flat(light, normal, casters.geometry(), &faces, resolution)?,
            None => sphere(light, casters, &faces, resolution)?,
        };
        if !group.is_empty() {
            groups.push(group);
        }
    }
    Ok(LightViews { groups })
}

/// The view along a flat light's normal; none if nothing is in front of it.
fn flat(
    light: &Light,
    normal: DVec3,
    geometry: &Geometry,
    faces: &[u32],
    resolution: u32,
) -> Result<Vec<LayerView>> {
    let center = light.center();
    // Along an edge, so that its samples fill the view's columns and rows evenly.
    let right = match light.shape {
        Shape::Rect(RectLight { u, .. }) | Shape::Polygon(PolygonLight { u, .. }) => {
            u.try_normalize()
        }
        Shape::Disk(..) | Shape::Sphere(..) | Shape::Distant(..) => None,
    };
    let right = right.unwrap_or_else(|| normal.any_orthonormal_vector());
    let rotation = DMat3::from_cols(right, normal.cross(right), normal).transpose();
    let far = farthest(geometry, faces, |p| normal.dot(p - center));
    if far <= 0.0 {
        return Ok(Vec::new());
    }
    let (push, bounds) = pushed(far, 0.0, |push| {
        tangents(geometry, faces, center - push * normal, rotation, push)
    });
    let Some((low, high)) = bounds else {
        return Ok(Vec::new());
    };
    let eye = center - push * normal;
    Ok(vec![view(
        eye, rotation, low, high, resolution, push, faces,
    )?])
}

/// One view of all that a sphere lights, or faces of a cube around it.
fn sphere(
    light: &Light,
    casters: &Casters,
    faces: &[u32],
    resolution: u32,
) -> Result<Vec<LayerView>> {
    if faces.is_empty() {
        return Ok(Vec::new());
    }
    let geometry = casters.geometry();
    let center = light.center();
    let radius = light.as_sphere().map_or(0.0, |sphere| sphere.radius);
    let middle = middle(geometry, faces);
    let axis = (middle - center).try_normalize().unwrap_or(DVec3::Z);
    let right = axis.any_orthonormal_vector();
    let base = DMat3::from_cols(right, axis.cross(right), axis);
    let rotation = base.transpose();
    let nearest = -farthest(geometry, faces, |p| -axis.dot(p - center));
    let far = farthest(geometry, faces, |p| (p - center).length());
    // A sphere needs to be pushed by more than its radius for its own points to be before the eye.
    let least = radius * std::f64::consts::SQRT_2;
    if nearest >= radius {
        let (push, bounds) = pushed(far, least, |push| {
            tangents(geometry, faces, center - push * axis, rotation, push)
        });
        if let Some((low, high)) = bounds
            && low.abs().max(high.abs()).max_element() <= WIDEST
        {
            let eye = center - push * axis;
            let near = push + radius * (1.0 - f64::EPSILON);
            return Ok(vec![view(
                eye, rotation, low, high, resolution, near, faces,
            )?]);
        }
    }
    let push = least.max(LEAST_PUSH * far);
    let mut out = Vec::new();
    for k in 0..3 {
        for sign in [1.0, -1.0] {
            let rotation = look_face(base, 2 - k, sign);
            let eye = center - push * rotation.row(2);
            let within: Vec<u32> = faces
                .par_iter()
                .copied()
                .filter(|&face| {
                    let corners = geometry.corners(face);
                    let seen = corners.map(|v| rotation * (v.as_dvec3() - eye));
                    !Extent::of(seen, Some(1.0)).is_empty()
                })
                .collect();
            if within.is_empty() {
                continue;
            }
            let near = (push - radius).max(0.5 * push);
            let half = DVec2::ONE;
            out.push(view(eye, rotation, -half, half, resolution, near, &within)?);
        }
    }
    Ok(out)
}

/// How far the eye is pushed back so that all that casts is within a view, and the tangents of what it sees.
fn pushed(
    far: f64,
    least: f64,
    tangents: impl Fn(f64) -> Option<(DVec2, DVec2)>,
) -> (f64, Option<(DVec2, DVec2)>) {
    let mut push = least.max(LEAST_PUSH * far);
    for _ in 0..ROUNDS {
        let Some((low, high)) = tangents(push) else {
            return (push, None);
        };
        let widest = low.abs().max(high.abs()).max_element();
        let next = if widest > WIDEST { 2.0 * push } else { push };
        if next <= push {
            return (push, Some((low, high)));
        }
        push = next;
    }
    (push, tangents(push))
}

/// A view that holds these tangents and a texel more on every side.
fn view(
    eye: DVec3,
    rotation: DMat3,
    low: DVec2,
    high: DVec2,
    resolution: u32,
    near: f64,
    faces: &[u32],
) -> Result<LayerView> {
    // What casts may be a single point of the view: then any size will do.
    let size = (high - low).max_element().max(1e-9);
    let focal = (f64::from(resolution) - 2.0) / size;
    let texels = ((high - low) * focal + 2.0)
        .ceil()
        .clamp(DVec2::splat(3.0), DVec2::splat(f64::from(resolution)));
    let origin = DVec2::splat(1.0) - low * focal;
    let intrinsics = DMat3::from_cols(
        DVec3::new(focal, 0.0, 0.0),
        DVec3::new(0.0, focal, 0.0),
        origin.extend(1.0),
    );
    let (w, h) = (texels.x as i64, texels.y as i64);
    Ok(LayerView {
        camera: Camera::new(intrinsics, rotation.transpose(), eye, w, h)?,
        focal,
        inverse_near: 1.0 / near,
        faces: Arc::from(faces),
    })
}

/// The largest value at a corner of these triangles.
fn farthest(geometry: &Geometry, faces: &[u32], of: impl Fn(DVec3) -> f64 + Sync) -> f64 {
    let at = |&face: &u32| {
        let [a, b, c] = geometry.corners(face).map(|v| of(v.as_dvec3()));
        a.max(b).max(c)
    };
    let parts = faces.par_chunks(CHUNK);
    parts
        .map(|faces| faces.iter().map(at).fold(f64::NEG_INFINITY, f64::max))
        .reduce(|| f64::NEG_INFINITY, f64::max)
}

/// The middle of the bounds of these triangles.
fn middle(geometry: &Geometry, faces: &[u32]) -> DVec3 {
    let along = |axis: DVec3| {
        let high = farthest(geometry, faces, |p| axis.dot(p));
        let low = -farthest(geometry, faces, |p| -axis.dot(p));
        0.5 * (low + high)
    };
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
}

/// Least and largest tangents of what lies beyond the plane at depth `near`, cut there.
fn tangents(
    geometry: &Geometry,
    faces: &[u32],
    eye: DVec3,
    rotation: DMat3,
    near: f64,
) -> Option<(DVec2, DVec2)> {
    let none = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let union = |a: (DVec2, DVec2), b: (DVec2, DVec2)| (a.0.min(b.0), a.1.max(b.1));
    let of = |&face: &u32| {
        let corners = geometry
            .corners(face)
            .map(|v| rotation * (v.as_dvec3() - eye));
        let mut bounds = none;
        let mut add = |p: DVec3| {
            let q = p.truncate() / p.z;
            bounds = union(bounds, (q, q));
        };
        for i in 0..3 {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            if a.z >= near {
                add(a);
            }
            if (a.z >= near) != (b.z >= near) {
                let cut = a + (b - a) * ((near - a.z) / (b.z - a.z));
                add(cut.truncate().extend(near));
            }
        }
        bounds
    };
    let parts = faces.par_chunks(CHUNK);
    let (low, high) = parts
        .map(|faces| faces.iter().map(of).fold(none, union))
        .reduce(|| none, union);
    (low.x <= high.x).then_some((low, high))
}
