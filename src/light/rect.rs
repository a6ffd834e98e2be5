//! Parallelograms.

use glam::DVec3;

use super::contour::{self, rect_corners};
use super::{Light, Shape, SphereLight, check_finite};
use crate::error::{Error, Result};

/// A parallelogram with full edge vectors, emitting towards `u × v`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RectLight {
    /// Its middle.
    pub center: DVec3,
    /// First edge.
    pub u: DVec3,
    /// Second edge.
    pub v: DVec3,
}

/// Lengths of which areas and their squares are neither 0 nor infinite in `f64`.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-75..=1e75;

impl Light {
    /// A parallelogram.
    ///
    /// # Errors
    /// A value that is not finite, or edges that span no area.
    pub fn rect(center: DVec3, u: DVec3, v: DVec3, radiance: [f32; 3]) -> Result<Self> {
        check_finite("RectLight", &[center, u, v])?;
        for (name, edge) in [("edge_u", u), ("edge_v", v)] {
            let size = edge.abs().max_element();
            if size != 0.0 && !LENGTHS.contains(&size) {
                let allowed = format!("{:e} to {:e}", LENGTHS.start(), LENGTHS.end());
                let reason = format!("{name} must be {allowed} long, got {size:e}");
                return Err(Error::parameter("RectLight", reason));
            }
        }
        // Below 1e-12 of a rectangle's area the normal is the rounding of the edges.
        if u.cross(v).length() <= 1e-12 * u.length() * v.length() || u == DVec3::ZERO {
            let reason = format!("edge_u {u} and edge_v {v} span no area; a light needs area here");
            return Err(Error::parameter("RectLight", reason));
        }
        Ok(Light {
            shape: Shape::Rect(RectLight { center, u, v }),
            radiance,
        })
    }
}

impl RectLight {
    pub(super) fn mapped(
        &self,
        point: impl Fn(DVec3) -> DVec3,
        length: impl Fn(f64) -> f64,
    ) -> Shape {
        Shape::Rect(RectLight {
            center: point(self.center),
            u: self.u.map(&length),
            v: self.v.map(&length),
        })
    }

    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let half = 0.5 * (self.u.abs() + self.v.abs());
        (self.center - half, self.center + half)
    }

    pub(super) fn normal(&self) -> Option<DVec3> {
        Some(self.u.cross(self.v).normalize())
    }

    pub(super) fn as_sphere(&self) -> Option<SphereLight> {
        None
    }

    pub(super) fn half_width(&self) -> f64 {
        0.5 * self.u.length().max(self.v.length())
    }

    pub(super) fn reach(&self, axis: DVec3) -> f64 {
        0.5 * (axis.dot(self.u).abs() + axis.dot(self.v).abs())
    }

    pub(super) fn farthest(&self, direction: DVec3) -> DVec3 {
        let along = |e: DVec3| e * (0.5 * direction.dot(e).signum());
        self.center + along(self.u) + along(self.v)
    }

    pub(super) fn half_axes(&self, _: DVec3) -> (DVec3, DVec3, bool) {
        (0.5 * self.u, 0.5 * self.v, false)
    }

    pub(super) fn emits_along(&self, d: DVec3) -> bool {
        self.u.cross(self.v).dot(d) < 0.0
    }

    pub(super) fn fraction_above(&self, d: DVec3, n: DVec3) -> f64 {
        let corners = rect_corners(d, self.u, self.v);
        if corners.iter().all(|c| n.dot(*c) > 0.0) {
            return 1.0;
        }
        let clipped = clip_above(&corners, n);
        let area = polygon_area(clipped.corners()) / self.u.cross(self.v).length();
        area.clamp(0.0, 1.0)
    }

    pub(super) fn irradiance(&self, d: DVec3, n: DVec3) -> f64 {
        contour::polygon(clip_above(&rect_corners(d, self.u, self.v), n).corners(), n)
    }

    pub(super) fn slopes(&self, point: DVec3, _: f64, [kappa, mu]: [DVec3; 2]) -> Option<[f64; 2]> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (s, t) in [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)] {
            let corner = self.center + s * self.u + t * self.v - point;
            let (k, m) = (corner.dot(kappa), corner.dot(mu));
            if m <= 0.0 {
                return None;
            }
            (low, high) = (low.min(-k / m), high.max(-k / m));
        }
        Some([high, low])
    }
}

/// A convex polygon of at most five corners: a rectangle cut by a plane.
struct Polygon {
    corners: [DVec3; 5],
    count: usize,
}

impl Polygon {
    fn push(&mut self, p: DVec3) {
        self.corners[self.count] = p;
        self.count += 1;
    }

    fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }
}

/// Sutherland–Hodgman against the plane through the origin with normal `n` (zero: no clipping).
///
/// A corner on the plane is kept, so that a cut adds a corner for every sign change only.
fn clip_above(rect: &[DVec3; 4], n: DVec3) -> Polygon {
    let mut out = Polygon {
        corners: [DVec3::ZERO; 5],
        count: 0,
    };
    for i in 0..4 {
        let (a, b) = (rect[i], rect[(i + 1) % 4]);
        let (ha, hb) = (n.dot(a), n.dot(b));
        if ha >= 0.0 {
            out.push(a);
        }
        // Rounding may give a third and fourth sign change only within an ulp of the plane.
        let crosses = (ha > 0.0 && hb < 0.0) || (ha < 0.0 && hb > 0.0);
        if crosses && out.count < 5 {
            out.push(a + (b - a) * (ha / (ha - hb)));
        }
    }
    out
}

fn polygon_area(polygon: &[DVec3]) -> f64 {
    let fan = polygon.windows(2).skip(1);
    let origin = polygon.first().copied().unwrap_or_default();
    0.5 * fan
        .map(|w| (w[0] - origin).cross(w[1] - origin))
        .sum::<DVec3>()
        .length()
}
