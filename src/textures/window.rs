//! Where on a receiver polygon shadows can fall, in scenes that are far larger than what casts in them.
//!
//! A texture has so many texels and no more, and a ground without end would have none smaller than a house. In
//! the frame of a core ([`crate::frame`]) the texture of a large polygon is fitted to the shadows of what is
//! over it; elsewhere the light is unshadowed, and its closed form does.

use glam::{DVec2, DVec3};

use super::patches::{Parallelogram, Patch, Patches};
use crate::geometry::Geometry;
use crate::light::Light;

/// Local length from which on a polygon is large.
const LARGE: f64 = 16.0;

/// Part of a window's size that it is larger by on all sides, so that its border is lit.
const MARGIN: f64 = 1.0 / 16.0;

/// Least half size of a window, local units.
const LEAST: f64 = 1.0 / 16.0;

/// Size of a window, in lengths of [`LARGE`], beyond which its texels are no use.
const WIDEST: f64 = 64.0;

/// Fits the bounds of large patches to where shadows can fall, and marks the sides on which they can fall
/// without bound: something over them is as high as a light, or as large as they are.
pub(super) fn fit(geometry: &Geometry, patches: &mut Patches, lights: &[Light]) {
    for id in 0..patches.list.len() {
        let patch = &patches.list[id];
        if patch.bounds.edges.iter().all(|e| e.length() <= LARGE) {
            continue;
        }
        let sides = [-patch.normal, patch.normal].map(|n| window(geometry, patches, id, lights, n));
        let known: Vec<Window> = sides.iter().flatten().copied().collect();
        let both = known.into_iter().fold(Window::NONE, Window::union);
        let fitted = both.on(patch);
        let patch = &mut patches.list[id];
        patch.bounds = fitted;
        patch.fitted = true;
        patch.boundless = sides.map(|s| s.is_none());
    }
}

/// Where shadows can fall, in parts of a patch's edges.
#[derive(Clone, Copy)]
struct Window {
    low: DVec2,
    high: DVec2,
}

impl Window {
    const NONE: Window = Window {
        low: DVec2::INFINITY,
        high: DVec2::NEG_INFINITY,
    };

    fn union(self, other: Window) -> Window {
        Window {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }

    fn add(&mut self, at: DVec2) {
        *self = self.union(Window { low: at, high: at });
    }

    /// What it is on a patch, and a margin around it; a small part of the patch where nothing casts.
    fn on(self, patch: &Patch) -> Parallelogram {
        let bounds = &patch.bounds;
        let mut all = self;
        if !(self.low.is_finite() && self.high.is_finite()) {
            all.add(place(
                bounds,
                patch.normal * patch.normal.dot(bounds.corner),
            ));
        }
        let lengths = DVec2::from_array(bounds.edges.map(|e| e.length()));
        let border = MARGIN * (all.high - all.low) + LEAST / lengths;
        let (mut low, mut high) = (all.low - border, all.high + border);
        let (first, last) = (low.max(DVec2::ZERO), high.min(DVec2::ONE));
        if (last - first).min_element() > 0.0 {
            (low, high) = (first, last);
        }
        let size = high - low;
        Parallelogram {
            corner: bounds.at(low.x, low.y),
            edges: [bounds.edges[0] * size.x, bounds.edges[1] * size.y],
        }
    }
}

/// Where a point over a parallelogram is, in parts of its edges.
fn place(bounds: &Parallelogram, p: DVec3) -> DVec2 {
    let d = p - bounds.corner;
    let [x, y] = bounds.dual();
    DVec2::new(x.dot(d), y.dot(d))
}

/// Where shadows can fall on a side of a patch; `None` if there is no end to it.
fn window(
    geometry: &Geometry,
    patches: &Patches,
    id: usize,
    lights: &[Light],
    normal: DVec3,
) -> Option<Window> {
    let bounds = &patches.list[id].bounds;
    let height = |p: DVec3| normal.dot(p - bounds.corner);
    let mut window = Window::NONE;
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
        let heights = corners.map(height);
        if heights.iter().all(|h| *h <= 0.0) {
            continue;
        }
        let lowest = heights.into_iter().fold(f64::INFINITY, f64::min);
        for face in 0..geometry.faces.len() as u32 {
            let material = geometry.material(geometry.mesh_of(face).entry);
            let own = patches.of_face[face as usize] == id as u32;
            if own || !material.casts || material.opacity == 0.0 {
                continue;
            }
            let triangle = geometry.corners(face).map(|v| v.as_dvec3());
            for i in 0..3 {
                let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
                let (h, other) = (height(a), height(b));
                // What is on the surface, within its rounding, only touches it.
                let rounding = 1e-6 * a.abs().max_element().max(1.0);
                if (h > rounding) != (other > rounding) {
                    let part = (h / (h - other)).clamp(0.0, 1.0);
                    window.add(place(bounds, a + (b - a) * part));
                }
                if h <= rounding {
                    continue;
                }
                if h * (1.0 + MARGIN) >= lowest {
                    return None;
                }
                for (l, full) in corners.iter().zip(heights) {
                    window.add(place(bounds, a + (a - *l) * (h / (full - h))));
                }
            }
        }
    }
    let size = (window.high - window.low) * DVec2::from_array(bounds.edges.map(|e| e.length()));
    (size.max_element() <= WIDEST * LARGE).then_some(window)
}
