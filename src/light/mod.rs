//! Area lights: their shapes, the part of them that a point faces, and their unshadowed irradiance.
//!
//! Everything here is closed form, in `f64`, in any one coordinate system (world or local: no result
//! depends on the unit). `n` is the receiver's unit normal, or zero for a receiver without a tangent
//! plane. Points behind a flat light or inside a sphere receive nothing from it.
//!
//! - a file a shape: [`rect`], [`disk`], [`sphere`], [`polygon`], [`distant`];
//! - [`contour`]: Lambert's contour formula; `many`: unshadowed light of many receivers at once;
//! - [`falloff`]: what of a light lies beyond a line; [`reach`]: how far it reaches in a view;
//! - [`tangents`]: planes through a line that touch it.

pub mod contour;
pub mod disk;
pub mod distant;
pub mod falloff;
pub(crate) mod many;
pub mod polygon;
pub mod reach;
pub mod rect;
pub mod sphere;
pub mod tangents;
#[cfg(test)]
mod tests;

use glam::{DVec3, Vec3};

use crate::error::{Error, Result};
use crate::frame::{Frame, POINT_OFFSET};
pub use disk::DiskLight;
pub use distant::DistantLight;
pub use polygon::PolygonLight;
pub use rect::RectLight;
pub use sphere::SphereLight;

/// Local distance, in scene sizes, at which farther lights are put, along the same line and under the same angle: they
/// differ by less than a ten-thousandth of an `f32`'s ulp, and products of coordinates stay finite.
const FARTHEST: f64 = (1u64 << 40) as f64;

/// Half width of a local light below which it is a point: the scene's coordinates are not known any better.
const POINT: f64 = f32::EPSILON as f64;

/// Where a light is and what it looks like.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A parallelogram.
    Rect(RectLight),
    /// A disk.
    Disk(DiskLight),
    /// A sphere.
    Sphere(SphereLight),
    /// A planar polygon.
    Polygon(PolygonLight),
    /// A disk at infinity.
    Distant(DistantLight),
}

/// What the shape of a light answers.
macro_rules! of_shape {
    ($light:expr, $shape:ident => $answer:expr) => {
        match &$light.shape {
            Shape::Rect($shape) => $answer,
            Shape::Disk($shape) => $answer,
            Shape::Sphere($shape) => $answer,
            Shape::Polygon($shape) => $answer,
            Shape::Distant($shape) => $answer,
        }
    };
}

/// A light: a shape and the radiance that it emits, linear RGB.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Where it is.
    pub shape: Shape,
    /// What it emits; of a distant light the irradiance across its direction.
    pub radiance: [f32; 3],
}

impl Light {
    /// The same light with its middle moved by `point` and all lengths changed by `length`.
    pub fn mapped(&self, point: impl Fn(DVec3) -> DVec3, length: impl Fn(f64) -> f64) -> Light {
        let shape = of_shape!(self, shape => shape.mapped(point, length));
        let radiance = self.radiance;
        Light { shape, radiance }
    }

    /// The same light in a scene's local coordinates; farther away than `FARTHEST`, one there that looks the same.
    pub fn to_local(&self, frame: &Frame) -> Light {
        if let Some(distant) = self.as_distant() {
            let shape = distant.to_local(frame);
            return Light { shape, ..*self };
        }
        let distance = frame.to_local(self.center()).length();
        let unit = frame.unit * (distance / FARTHEST).max(1.0);
        let frame = &Frame { unit, ..*frame };
        self.mapped(|p| frame.to_local(p), |x| x / frame.unit)
    }

    /// A light of no size at `point`, which emits to the same side.
    pub fn point_at(&self, point: DVec3) -> Light {
        let (center, radius) = (point, 0.0);
        let shape = match self.normal() {
            Some(normal) => Shape::Disk(DiskLight {
                center,
                normal,
                radius,
            }),
            None => Shape::Sphere(SphereLight { center, radius }),
        };
        let radiance = self.radiance;
        Light { shape, radiance }
    }

    /// By how much a local flat light is moved off itself to its emitting side; what lies nearer to its plane, such as
    /// the ceiling that it is set into, hides none of it, in any method.
    pub fn lift(&self) -> DVec3 {
        let (low, high) = self.bounds();
        let size = low.abs().max(high.abs()).max_element().max(1.0);
        self.normal().unwrap_or_default() * (POINT_OFFSET * size)
    }

    /// A local light, moved so.
    pub fn lifted(&self) -> Light {
        let by = self.lift();
        self.mapped(|p| p + by, |x| x)
    }

    /// Where shadow rays to a local light's middle end.
    pub fn target(&self) -> Vec3 {
        (self.center() + self.lift()).as_vec3()
    }

    /// The light's middle.
    pub fn center(&self) -> DVec3 {
        of_shape!(self, shape => shape.center)
    }

    /// Axis-aligned bounds.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        of_shape!(self, shape => shape.bounds())
    }

    /// The side that a flat light emits to, unit length; `None` for a sphere and a distant light.
    pub fn normal(&self) -> Option<DVec3> {
        of_shape!(self, shape => shape.normal())
    }

    /// The light, if it is a sphere and not flat.
    pub fn as_sphere(&self) -> Option<SphereLight> {
        of_shape!(self, shape => shape.as_sphere())
    }

    /// Whether a local light has no width.
    pub fn is_point(&self) -> bool {
        of_shape!(self, shape => shape.half_width()) <= POINT
    }

    /// How far the light reaches from its middle along `axis`, times the length of it.
    pub fn reach(&self, axis: DVec3) -> f64 {
        of_shape!(self, shape => shape.reach(axis))
    }

    /// The light's point that lies farthest along a direction of unit length.
    pub fn farthest(&self, direction: DVec3) -> DVec3 {
        of_shape!(self, shape => shape.farthest(direction))
    }

    /// Half axes of the light as seen along a direction of unit length, and whether it is the ellipse that they span
    /// and not the parallelogram. A sphere's are across the direction, a flat light's in its plane; a polygon's are those
    /// of the rectangle that stands in for it.
    pub fn half_axes(&self, towards: DVec3) -> (DVec3, DVec3, bool) {
        of_shape!(self, shape => shape.half_axes(towards))
    }

    /// `h`: the fraction of the light above the tangent plane and emitting towards `p`.
    ///
    /// By area for flat lights, by solid angle for spheres and distant lights; what visibility would be without
    /// occluders. A light of size zero is all or nothing.
    pub fn fraction_above(&self, p: DVec3, n: DVec3) -> f64 {
        if !self.emits_towards(p) {
            return 0.0;
        }
        let d = self.center() - p;
        if n == DVec3::ZERO {
            return 1.0;
        }
        of_shape!(self, shape => shape.fraction_above(d, n))
    }

    /// Irradiance at `p` from the whole light with radiance 1 (a distant one: irradiance 1 across its direction), without
    /// occluders.
    ///
    /// Lambert's contour formula, the contour clipped by the tangent plane: straight edges for a
    /// rectangle, a circle's arc for a disk; a sphere is the disk that its outline spans, seen along its axis.
    pub fn unshadowed_irradiance(&self, p: DVec3, n: DVec3) -> f64 {
        if !self.emits_towards(p) {
            return 0.0;
        }
        let d = self.center() - p;
        let value = of_shape!(self, shape => shape.irradiance(d, n));
        value.max(0.0)
    }

    /// Whether `p` is in front of a flat light, or outside a sphere.
    pub fn emits_towards(&self, p: DVec3) -> bool {
        let d = self.center() - p;
        of_shape!(self, shape => shape.emits_along(d))
    }

    /// Slopes `s` of the two planes through a line that touch the light, by their normals `κ + s µ`: the line goes
    /// through `point` across `κ` and `µ`, and the light's middle is at `distance` from it, along `µ`. No slopes where
    /// the line meets the light.
    fn slopes(&self, point: DVec3, distance: f64, axes: [DVec3; 2]) -> Option<[f64; 2]> {
        of_shape!(self, shape => shape.slopes(point, distance, axes))
    }
}

fn check_finite(what: &str, values: &[DVec3]) -> Result<()> {
    match values.iter().find(|v| !v.is_finite()) {
        None => Ok(()),
        Some(v) => Err(Error::parameter(
            what,
            format!("expected finite numbers, got {v}"),
        )),
    }
}

/// Radii of which squares are, as local units may be as large or small.
const RADII: std::ops::RangeInclusive<f64> = 1e-150..=1e150;

fn check_radius(what: &str, radius: f64) -> Result<()> {
    if radius == 0.0 || RADII.contains(&radius) {
        return Ok(());
    }
    let (least, most) = (RADII.start(), RADII.end());
    let reason =
        format!("radius must be 0 or more, and if more {least:e} to {most:e}, got {radius}");
    Err(Error::parameter(what, reason))
}

/// A vector at unit length, however long or short it is; `None` of zero.
pub(crate) fn unit(v: DVec3) -> Option<DVec3> {
    // Squares of what is very long or short are infinite or 0.
    let scaled = || (v / v.abs().max_element()).try_normalize();
    v.try_normalize().or_else(scaled)
}
