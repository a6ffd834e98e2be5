//! How far a light reaches from its centre, as a view has it.

use glam::{DMat3, DVec2, DVec3};

use super::{DiskLight, Light, RectLight, Shape, SphereLight};

/// How far a light reaches from its centre, in a view's coordinates.
#[derive(Debug, Clone, Copy)]
pub enum LightOutline {
    /// Half edges.
    Rect(DVec3, DVec3),
    /// Normal and radius.
    Disk(DVec3, f64),
    /// Radius.
    Sphere(f64),
}

impl LightOutline {
    pub(crate) fn new(light: &Light, rotation: DMat3) -> Self {
        let rect = |&RectLight { u, v, .. }: &RectLight| {
            LightOutline::Rect(rotation * (0.5 * u), rotation * (0.5 * v))
        };
        match &light.shape {
            Shape::Rect(light) => rect(light),
            Shape::Polygon(polygon) => rect(&polygon.stand_in()),
            &Shape::Disk(DiskLight { normal, radius, .. }) => {
                LightOutline::Disk(rotation * normal, radius)
            }
            &Shape::Sphere(SphereLight { radius, .. }) => LightOutline::Sphere(radius),
            Shape::Distant(distant) => LightOutline::Sphere(distant.stand_in().radius),
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
            LightOutline::Rect(u, v) => {
                let (a, b) = (g.dot(u).abs(), g.dot(v).abs());
                let sum = a + b;
                (sum, if sum > 0.0 { a.min(b) / sum } else { 0.0 })
            }
            LightOutline::Disk(m, radius) => {
                let across = g.length_squared() - g.dot(m).powi(2);
                (radius * across.max(0.0).sqrt(), 0.0)
            }
            LightOutline::Sphere(radius) => (radius * g.length(), 0.0),
        }
    }

    pub(crate) fn widest(&self) -> f64 {
        match *self {
            LightOutline::Rect(u, v) => u.length() + v.length(),
            LightOutline::Disk(_, radius) | LightOutline::Sphere(radius) => radius,
        }
    }
}
