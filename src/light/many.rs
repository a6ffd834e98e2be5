//! Unshadowed light without branches: Lambert's contour formula for straight edges, and spheres; for one
//! receiver, or many in registers.

use fearless_simd::dispatch;
use glam::DVec3;

use super::contour::{edge, rect_corners, sphere_irradiance};
use super::{Light, RectLight, Shape, SphereLight};
use crate::simd::detect;

/// Receivers at once.
pub(crate) const MOST: usize = 64;

/// Lights whose share on a receiver needs no branches where all of it is above the tangent plane.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Branchless {
    /// A rectangle, by centre and edges.
    Rect(DVec3, DVec3, DVec3),
    /// A sphere, by centre and radius.
    Sphere(DVec3, f64),
}

/// Up to [`MOST`] receivers and their normals, a column for every coordinate, so that loops over receivers become
/// loops over registers; and what a light sends to them.
pub(crate) struct Many {
    count: usize,
    positions: [[f64; MOST]; 3],
    normals: [[f64; MOST]; 3],
    /// Height of the light's lowest point above each receiver's tangent plane.
    height: [f64; MOST],
    /// Irradiance with radiance 1; means nothing where a point is under the tangent plane.
    irradiance: [f64; MOST],
}

impl Many {
    pub(crate) fn new() -> Self {
        Many {
            count: 0,
            positions: [[0.0; MOST]; 3],
            normals: [[0.0; MOST]; 3],
            height: [0.0; MOST],
            irradiance: [0.0; MOST],
        }
    }

    /// Sets the receivers; columns beyond them keep what they had.
    pub(crate) fn set(&mut self, positions: &[DVec3], normals: &[DVec3]) {
        self.count = positions.len();
        for (i, (p, n)) in positions.iter().zip(normals).enumerate() {
            for k in 0..3 {
                (self.positions[k][i], self.normals[k][i]) = (p[k], n[k]);
            }
        }
    }

    /// Number of receivers.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Receiver and normal in column `i`.
    #[inline(always)]
    pub(crate) fn at(&self, i: usize) -> (DVec3, DVec3) {
        let at = |of: &[[f64; MOST]; 3]| DVec3::new(of[0][i], of[1][i], of[2][i]);
        (at(&self.positions), at(&self.normals))
    }

    /// Finds heights, and irradiances if wanted.
    fn find(&mut self, simple: Branchless, irradiance: bool) {
        let many = self;
        match (simple, irradiance) {
            (Branchless::Rect(center, u, v), false) => {
                dispatch!(detect(), _ => rect_height(many, center, u, v))
            }
            (Branchless::Rect(center, u, v), true) => {
                dispatch!(detect(), _ => rect_irradiance(many, center, u, v))
            }
            (Branchless::Sphere(center, radius), _) => {
                dispatch!(detect(), _ => sphere(many, center, radius))
            }
        }
    }
}

// Free of branches, for the compiler's vectoriser.

#[inline(always)]
fn rect_height(many: &mut Many, center: DVec3, u: DVec3, v: DVec3) {
    for i in 0..MOST {
        let (p, n) = many.at(i);
        many.height[i] = lowest(&rect_corners(center - p, u, v), n);
    }
}

#[inline(always)]
fn rect_irradiance(many: &mut Many, center: DVec3, u: DVec3, v: DVec3) {
    for i in 0..MOST {
        let (p, n) = many.at(i);
        let corners = rect_corners(center - p, u, v);
        many.height[i] = lowest(&corners, n);
        let [a, b, c, d] = corners;
        // What `polygon` computes; its loop over edges would keep this one from being vectorised.
        let sum = edge(a, b) + edge(b, c) + edge(c, d) + edge(d, a);
        many.irradiance[i] = sum.dot(n).abs();
    }
}

#[inline(always)]
fn sphere(many: &mut Many, center: DVec3, radius: f64) {
    for i in 0..MOST {
        let (p, n) = many.at(i);
        let d = center - p;
        let height = n.dot(d);
        many.height[i] = height - radius;
        many.irradiance[i] = sphere_irradiance(radius, d.length(), height);
    }
}

/// Height of the lowest of a rectangle's corners along `n`.
#[inline(always)]
fn lowest(&[a, b, c, d]: &[DVec3; 4], n: DVec3) -> f64 {
    let lower = |a: f64, b: f64| if a < b { a } else { b };
    lower(lower(n.dot(a), n.dot(b)), lower(n.dot(c), n.dot(d)))
}

/// Many receivers at once.
impl Light {
    /// [`Light::fraction_above`] and [`Light::unshadowed_irradiance`] of many receivers, the same to the
    /// bit: calls `each` with the receiver's number and these two.
    pub fn unshadowed(
        &self,
        positions: &[DVec3],
        normals: &[DVec3],
        mut each: impl FnMut(usize, f64, f64),
    ) {
        let mut many = Many::new();
        let parts = positions.chunks(MOST).zip(normals.chunks(MOST));
        for (part, (positions, normals)) in parts.enumerate() {
            many.set(positions, normals);
            self.over(&mut many, true, |i, p, n, whole| match whole {
                Some(irradiance) => each(part * MOST + i, 1.0, irradiance),
                None => {
                    let (h, irradiance) =
                        (self.fraction_above(p, n), self.unshadowed_irradiance(p, n));
                    each(part * MOST + i, h, irradiance);
                }
            });
        }
    }

    /// [`Light::fraction_above`] of many receivers, the same to the bit: calls `each` with the receiver's
    /// number and this.
    pub(crate) fn fractions_above(&self, many: &mut Many, mut each: impl FnMut(usize, f64)) {
        self.over(many, false, |i, p, n, whole| {
            each(i, whole.map_or_else(|| self.fraction_above(p, n), |_| 1.0));
        });
    }

    /// Calls `each` with every receiver's number, position and normal, and, where all of the light is seen to be
    /// above its tangent plane at once, the irradiance if it is wanted.
    #[inline(always)]
    fn over(
        &self,
        many: &mut Many,
        irradiance: bool,
        mut each: impl FnMut(usize, DVec3, DVec3, Option<f64>),
    ) {
        let simple = match self.shape {
            Shape::Rect(RectLight { center, u, v }) => Some(Branchless::Rect(center, u, v)),
            Shape::Sphere(SphereLight { center, radius }) => {
                Some(Branchless::Sphere(center, radius))
            }
            Shape::Disk(..) | Shape::Polygon(..) | Shape::Distant(..) => None,
        };
        if let Some(simple) = simple {
            many.find(simple, irradiance);
        }
        for i in 0..many.count {
            let (p, n) = many.at(i);
            let whole = simple.is_some() && many.height[i] > 0.0 && self.emits_towards(p);
            each(i, p, n, whole.then_some(many.irradiance[i]));
        }
    }
}
