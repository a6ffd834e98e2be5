//! Where on a receiver polygon shadows can fall, in scenes that are far larger than what casts in them.
//!
//! A texture has so many texels and no more, and a ground without end would have none smaller than a house. In
//! the frame of a core ([`crate::frame`]) the texture of a large polygon is fitted to the shadows of what is
//! over it; elsewhere the light is unshadowed, and its closed form does.

use glam::{DVec2, DVec3};

use super::patches::{Parallelogram, Patches};
use crate::error::{Error, Result};
use crate::geometry::Geometry;
use crate::light::Light;

/// Local length from which on a polygon is large.
const LARGE: f64 = 16.0;

/// Part of a window's size that it is larger by on all sides, so that its border is lit.
const MARGIN: f64 = 1.0 / 16.0;

/// Least half size of a window, local units.
const LEAST: f64 = 1.0 / 16.0;

/// Fits the bounds of large patches to where shadows can fall; `method` is who asks.
///
/// # Errors
/// A large polygon on which shadows can fall without bound: something over it is as high as a light.
pub(super) fn fit(
    geometry: &Geometry,
    patches: &mut Patches,
    lights: &[Light],
    method: &'static str,
) -> Result<()> {
    for id in 0..patches.list.len() {
        let patch = &patches.list[id];
        if patch.bounds.edges.iter().all(|e| e.length() <= LARGE) {
            continue;
        }
        let entry = geometry.mesh_of(patch.faces[0]).entry;
        if !geometry.material(entry).receives {
            continue;
        }
        let fitted = window(geometry, patches, id, lights).ok_or_else(|| {
            let reason = format!(
                "the surface of triangle {} is {:.3e} times as large as what is around the origin, and something \
                 over it is as high as a light: no texture holds its shadow; divide the surface, or lift the light",
                patch.faces[0],
                patch.bounds.edges[0].length().max(patch.bounds.edges[1].length()),
            );
            Error::Unsupported { method, reason }
        })?;
        let patch = &mut patches.list[id];
        patch.bounds = fitted;
        patch.fitted = true;
    }
    Ok(())
}

/// The part of a patch's bounds on which shadows can fall; `None` if there is no end to it.
fn window(
    geometry: &Geometry,
    patches: &Patches,
    id: usize,
    lights: &[Light],
) -> Option<Parallelogram> {
    let patch = &patches.list[id];
    let bounds = &patch.bounds;
    let dual = bounds.dual();
    let place = |p: DVec3| {
        let d = p - bounds.corner;
        DVec2::new(dual[0].dot(d), dual[1].dot(d))
    };
    let lengths = DVec2::from_array(bounds.edges.map(|e| e.length()));
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for light in lights {
        let (from, to) = light.bounds();
        let corner = |i: usize| {
            let side = |axis: usize| {
                if i >> axis & 1 == 1 {
                    to[axis]
                } else {
                    from[axis]
                }
            };
            DVec3::new(side(0), side(1), side(2))
        };
        let corners: [DVec3; 8] = std::array::from_fn(corner);
        for normal in [patch.normal, -patch.normal] {
            let height = |p: DVec3| normal.dot(p - bounds.corner);
            let heights = corners.map(height);
            if heights.iter().all(|h| *h <= 0.0) {
                continue;
            }
            let lowest = heights.into_iter().fold(f64::INFINITY, f64::min);
            for face in 0..geometry.faces.len() as u32 {
                let entry = geometry.mesh_of(face).entry;
                let own = patches.of_face[face as usize] == id as u32;
                let material = geometry.material(entry);
                if own || !material.casts || material.opacity == 0.0 {
                    continue;
                }
                let triangle = geometry.corners(face).map(|v| v.as_dvec3());
                for i in 0..3 {
                    let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
                    let h = height(a);
                    let other = height(b);
                    // What is on the surface, within its rounding, touches it.
                    let rounding = 1e-6 * a.abs().max_element().max(1.0);
                    if (h > rounding) != (other > rounding) {
                        let cut = a + (b - a) * (h / (h - other)).clamp(0.0, 1.0);
                        let at = place(cut);
                        (low, high) = (low.min(at), high.max(at));
                    }
                    if h <= rounding {
                        continue;
                    }
                    if h * (1.0 + MARGIN) >= lowest {
                        return None;
                    }
                    for (l, full) in corners.iter().zip(heights) {
                        let p = a + (a - *l) * (h / (full - h));
                        let at = place(p);
                        (low, high) = (low.min(at), high.max(at));
                    }
                }
            }
        }
    }
    // Below what stands on the surface there is no light; where nothing casts, a window does for any place.
    let nothing = !(low.is_finite() && high.is_finite());
    if nothing {
        let middle = place(patch.normal * patch.normal.dot(bounds.corner));
        (low, high) = (middle, middle);
    }
    let border = MARGIN * (high - low) + LEAST / lengths;
    let (low, high) = (low - border, high + border);
    // Of the patch, if there is something of it.
    let within = |low: DVec2, high: DVec2| (low.max(DVec2::ZERO), high.min(DVec2::ONE));
    let (low, high) = match within(low, high) {
        (a, b) if (b - a).min_element() > 0.0 => (a, b),
        _ => (low, high),
    };
    let size = high - low;
    Some(Parallelogram {
        corner: bounds.at(low.x, low.y),
        edges: [bounds.edges[0] * size.x, bounds.edges[1] * size.y],
    })
}
