//! Spheres.

use std::f64::consts::PI;

use glam::DVec3;

use super::contour::sphere_irradiance;
use super::{Light, Shape, check_finite, check_radius};
use crate::error::Result;

/// A sphere emitting outwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereLight {
    /// Its middle.
    pub center: DVec3,
    /// Radius, may be zero.
    pub radius: f64,
}

impl Light {
    /// A sphere.
    ///
    /// # Errors
    /// A value that is not finite or a negative radius.
    pub fn sphere(center: DVec3, radius: f64, radiance: [f32; 3]) -> Result<Self> {
        check_finite("SphereLight", &[center, DVec3::splat(radius)])?;
        check_radius("SphereLight", radius)?;
        Ok(Light {
            shape: Shape::Sphere(SphereLight { center, radius }),
            radiance,
        })
    }
}

impl SphereLight {
    pub(super) fn mapped(
        &self,
        point: impl Fn(DVec3) -> DVec3,
        length: impl Fn(f64) -> f64,
    ) -> Shape {
        Shape::Sphere(SphereLight {
            center: point(self.center),
            radius: length(self.radius),
        })
    }

    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let half = DVec3::splat(self.radius);
        (self.center - half, self.center + half)
    }

    pub(super) fn normal(&self) -> Option<DVec3> {
        None
    }

    pub(super) fn as_sphere(&self) -> Option<SphereLight> {
        Some(*self)
    }

    pub(super) fn half_width(&self) -> f64 {
        self.radius
    }

    pub(super) fn reach(&self, axis: DVec3) -> f64 {
        self.radius * axis.length()
    }

    pub(super) fn farthest(&self, direction: DVec3) -> DVec3 {
        self.center + direction * self.radius
    }

    pub(super) fn half_axes(&self, towards: DVec3) -> (DVec3, DVec3, bool) {
        let e = towards.any_orthonormal_vector();
        (e * self.radius, towards.cross(e) * self.radius, true)
    }

    pub(super) fn emits_along(&self, d: DVec3) -> bool {
        d.length_squared() > self.radius * self.radius
    }

    pub(super) fn fraction_above(&self, d: DVec3, n: DVec3) -> f64 {
        let height = n.dot(d);
        if height.abs() >= self.radius {
            return if height > 0.0 { 1.0 } else { 0.0 };
        }
        let distance = d.length();
        let sin = self.radius / distance;
        cap_fraction_above(n.dot(d) / distance, sin)
    }

    pub(super) fn irradiance(&self, d: DVec3, n: DVec3) -> f64 {
        let distance = d.length();
        let height = n.dot(d);
        if height >= self.radius {
            return sphere_irradiance(self.radius, distance, height);
        }
        cut_sphere_irradiance(self.radius, distance, height)
    }

    pub(super) fn slopes(&self, _: DVec3, distance: f64, _: [DVec3; 2]) -> Option<[f64; 2]> {
        let rest = distance * distance - self.radius * self.radius;
        if rest <= 0.0 {
            return None;
        }
        let slope = self.radius / rest.sqrt();
        Some([slope, -slope])
    }
}

/// Fraction of a spherical cap's solid angle above a plane through the sphere's centre: the cap's
/// axis has height `cos` over the plane, `sin` is the sine of the cap's half-angle. Tovchigrechko
/// and Vakser 2001, their intersection of two caps with one of them a hemisphere.
///
/// With `x = cos / sin`, `k = cap_cos / axis_sin` and `w = acos(-k x)` their area is
///
/// ```text
///     2π - 2 acos x - 2 cap_cos w  =  2 (asin x - asin(k x)) + 2 (1 - cap_cos) w
/// ```
///
/// of which the left side, and each arcsine of the right, loses all digits of a small cap. The difference of
/// the arcsines is that of one number, and both terms go with the square of `sin`, as the whole cap's area
/// `2π (1 - cap_cos)` does.
pub(super) fn cap_fraction_above(cos: f64, sin: f64) -> f64 {
    if cos.abs() >= sin {
        return if cos > 0.0 { 1.0 } else { 0.0 };
    }
    let (x, squared) = ((cos / sin).clamp(-1.0, 1.0), sin * sin);
    let cap_cos = ((1.0 - sin) * (1.0 + sin)).max(0.0).sqrt();
    let axis_sin = ((1.0 - cos) * (1.0 + cos)).sqrt();
    let k = (cap_cos / axis_sin).min(1.0);
    let beyond = (1.0 - x) * (1.0 + x);
    let sum = ((1.0 - k * x) * (1.0 + k * x)).sqrt() + k * beyond.sqrt();
    // The sine of the difference, over `sin²`; at the ends both are zero.
    let sine = if beyond > 0.0 {
        x * beyond / (axis_sin * axis_sin * sum)
    } else {
        0.0
    };
    // An arcsine is its argument up to 1e-16 of it, where squares might underflow.
    let difference = if squared < 1e-16 {
        sine
    } else {
        (squared * sine).clamp(-1.0, 1.0).asin() / squared
    };
    let wedge = (-k * x).acos();
    ((wedge + difference * (1.0 + cap_cos)) / PI).clamp(0.0, 1.0)
}

/// Irradiance from a sphere of radiance 1 that the tangent plane cuts; `height` is that of its centre.
///
/// With `σ` the half-angle of its cone, `θ` the angle between axis and normal and `y = -cot θ cot σ`, Lambert's
/// contour integral over the circle's arc and the chord is
///
/// ```text
///     sin²σ cos θ acos y - sin σ cos σ t + atan(tan σ t),    t = sin θ √(1 - y²)
/// ```
pub(super) fn cut_sphere_irradiance(radius: f64, distance: f64, height: f64) -> f64 {
    let (sin, cos_axis) = (radius / distance, height / distance);
    if cos_axis <= -sin {
        return 0.0;
    }
    let cos = ((1.0 - sin) * (1.0 + sin)).max(0.0).sqrt();
    let sin_axis = ((1.0 - cos_axis) * (1.0 + cos_axis)).max(f64::MIN_POSITIVE);
    let sin_axis = sin_axis.sqrt();
    let y = (-cos_axis * cos / (sin_axis * sin)).clamp(-1.0, 1.0);
    let across = sin * sin_axis * ((1.0 - y) * (1.0 + y)).sqrt();
    let arc = sin * sin * cos_axis * y.acos();
    if 4.0 * across < cos {
        // Of a small sphere the last two terms cancel to their third powers.
        let w = across / cos;
        return arc + sin * sin * w - beyond_arctangent(w);
    }
    arc - cos * across + across.atan2(cos)
}

/// `w - atan w` for `w` up to a quarter, by its series.
fn beyond_arctangent(w: f64) -> f64 {
    let z = w * w;
    let sum = (0..14)
        .rev()
        .fold(0.0, |sum, k| 1.0 / f64::from(2 * k + 3) - z * sum);
    w * z * sum
}
