//! Lights at infinity, such as the sun: a cap of directions that is the same from everywhere.
//!
//! What a receiver sees of one, and the light that arrives, depend on its normal and not on its place; both are closed
//! forms of the cap. Such a light has no radiance of its own but the irradiance that it casts across its direction, so
//! that an angle of 0 is a parallel light by the same formulas.
//!
//! What needs a place, such as the end of a shadow ray, has one at `FARTHEST`, 2⁴⁰ local units. Segments to it are parallel:
//! an `f32` at that distance has steps of 2¹⁷, so a receiver within the unit changes nothing in a component of more than
//! 2⁻¹⁶ and less than 2⁻⁴⁰ in the others, where the direction itself has 2⁻²⁴. Light samples start from their receiver, so
//! that this holds in scenes of any size; a target that receivers share (`hard`, `single_sample`) is off by
//! their distance from the scene's middle over 2⁴⁰, below an `f32`'s ulp up to 65,536 units.
//!
//! Methods that keep depths never see this shape: [`crate::far`] gives them a sphere.

use std::f64::consts::PI;

use glam::DVec3;

use super::sphere::{cap_fraction_above, cut_sphere_irradiance};
use super::{FARTHEST, Light, Shape, SphereLight, check_finite, unit};
use crate::error::{Error, Result};
use crate::frame::{Frame, LARGEST};

/// A disk at infinity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistantLight {
    /// Where rays to its middle end, in local units from the scene's middle, whatever the frame.
    pub center: DVec3,
    /// How far that is.
    pub distance: f64,
    /// Direction to its middle, unit length.
    pub towards: DVec3,
    /// Sine of half of the angle that it spans.
    pub sin: f64,
    /// Cosine of half of the angle that it spans.
    pub cos: f64,
    /// How far receivers may be from the middle, where that is more than the rounding of what is so far.
    spread: f64,
}

/// Smallest angle above 0 (degrees): its cube is a normal `f64`.
const LEAST_ANGLE: f64 = 1e-90;

/// Largest angle (degrees) of which methods take the disk across the direction: beyond, its rim is more than eleven
/// times as far out as what it lights is far away, and shadows are as wide.
pub const WIDEST_DISK: f64 = 170.0;

impl Light {
    /// A disk at infinity whose light travels along `direction`, of any length but zero; `angle` is that of its whole
    /// diameter, in degrees, `irradiance` what it casts on a surface across the direction.
    ///
    /// # Errors
    /// A value that is not finite, a zero direction, or an angle that is neither 0 nor 1e-90 to below 180.
    pub fn distant(direction: DVec3, angle: f64, irradiance: [f32; 3]) -> Result<Self> {
        check_finite("DistantLight", &[direction, DVec3::splat(angle)])?;
        let Some(direction) = unit(direction) else {
            let reason = "direction must not be zero";
            return Err(Error::parameter("DistantLight", reason));
        };
        if !(angle == 0.0 || (LEAST_ANGLE..180.0).contains(&angle)) {
            let reason =
                format!("angle_deg must be 0, or {LEAST_ANGLE:e} to less than 180, got {angle}");
            return Err(Error::parameter("DistantLight", reason));
        }
        let (sin, cos) = (0.5 * angle).to_radians().sin_cos();
        Ok(Light {
            shape: Shape::Distant(DistantLight {
                center: -direction * FARTHEST,
                distance: FARTHEST,
                towards: -direction,
                sin,
                cos,
                spread: 0.0,
            }),
            radiance: irradiance,
        })
    }

    /// The light, if it is at infinity.
    pub fn as_distant(&self) -> Option<DistantLight> {
        match self.shape {
            Shape::Distant(distant) => Some(distant),
            Shape::Rect(_) | Shape::Disk(_) | Shape::Sphere(_) | Shape::Polygon(_) => None,
        }
    }

    /// Refuses a distant light that is too wide for `method`, which has it as a disk across its direction.
    ///
    /// # Errors
    /// An angle of more than [`WIDEST_DISK`].
    pub fn check_disk(&self, method: &'static str) -> Result<()> {
        let too_wide = |light: DistantLight| light.angle() > WIDEST_DISK * (1.0 + 1e-12);
        if self.as_distant().is_none_or(|light| !too_wide(light)) {
            return Ok(());
        }
        let reason = format!(
            "of a DistantLight it takes an angle_deg of up to {WIDEST_DISK}; hard, ray_traced, \
             counted, single_sample and accumulation take any"
        );
        Err(Error::Unsupported { method, reason })
    }
}

impl DistantLight {
    /// The angle that it spans, degrees.
    pub fn angle(&self) -> f64 {
        2.0 * self.sin.atan2(self.cos).to_degrees()
    }

    /// A sphere that spans the same from the scene's middle.
    pub fn stand_in(&self) -> SphereLight {
        SphereLight {
            center: self.center,
            radius: self.distance * self.sin,
        }
    }

    /// The solid angle of the cap over π sin² of half its angle: what a mean of cosines over it is to be multiplied by for
    /// the irradiance.
    pub fn scale(&self) -> f64 {
        2.0 / (1.0 + self.cos)
    }

    /// Radius of the disk across its direction that fills the cap, where its middle is.
    pub fn disk_radius(&self) -> f64 {
        self.distance * self.sin / self.cos
    }

    /// The same light for a scene in this frame.
    pub(super) fn to_local(self, frame: &Frame) -> Shape {
        Shape::Distant(DistantLight {
            spread: if frame.is_core { 2.0 * LARGEST } else { 0.0 },
            ..self
        })
    }

    /// Moves the place that stands for it, which is to stay in its direction; the light is the same.
    pub(super) fn mapped(
        &self,
        point: impl Fn(DVec3) -> DVec3,
        length: impl Fn(f64) -> f64,
    ) -> Shape {
        Shape::Distant(DistantLight {
            center: point(self.center),
            distance: length(self.distance),
            ..*self
        })
    }

    /// Bounds of all points that are so far from a receiver, whichever it is.
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let most = |cos: f64| self.distance * self.most(cos) + self.spread;
        (-(-self.towards).map(most), self.towards.map(most))
    }

    /// The largest cosine to an axis within the cap, of which the middle has `cos`.
    fn most(&self, cos: f64) -> f64 {
        if cos >= self.cos {
            return 1.0;
        }
        cos * self.cos + ((1.0 - cos) * (1.0 + cos)).max(0.0).sqrt() * self.sin
    }

    pub(super) fn normal(&self) -> Option<DVec3> {
        None
    }

    pub(super) fn as_sphere(&self) -> Option<SphereLight> {
        None
    }

    pub(super) fn half_width(&self) -> f64 {
        // Over a scene of unit size, that of a penumbra.
        self.sin
    }

    pub(super) fn reach(&self, axis: DVec3) -> f64 {
        let farthest = self.farthest(axis.normalize_or_zero());
        (farthest - self.center).dot(axis)
    }

    pub(super) fn farthest(&self, direction: DVec3) -> DVec3 {
        let along = direction.dot(self.towards);
        if along >= self.cos {
            return direction * self.distance;
        }
        let across = (direction - along * self.towards).normalize_or_zero();
        (self.towards * self.cos + across * self.sin) * self.distance
    }

    pub(super) fn half_axes(&self, towards: DVec3) -> (DVec3, DVec3, bool) {
        let e = towards.any_orthonormal_vector();
        let radius = self.disk_radius();
        (e * radius, towards.cross(e) * radius, true)
    }

    pub(super) fn emits_along(&self, _: DVec3) -> bool {
        true
    }

    pub(super) fn fraction_above(&self, _: DVec3, n: DVec3) -> f64 {
        cap_fraction_above(n.dot(self.towards), self.sin)
    }

    /// Over the irradiance across its direction.
    pub(super) fn irradiance(&self, _: DVec3, n: DVec3) -> f64 {
        let cos = n.dot(self.towards);
        if cos.abs() >= self.sin {
            return cos;
        }
        cut_sphere_irradiance(self.sin, 1.0, cos) / (PI * self.sin * self.sin)
    }

    pub(super) fn slopes(&self, point: DVec3, distance: f64, axes: [DVec3; 2]) -> Option<[f64; 2]> {
        self.stand_in().slopes(point, distance, axes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(angle: f64) -> (Light, DistantLight) {
        let direction = DVec3::new(-0.5, 0.3, -0.8);
        let light = Light::distant(direction, angle, [1.0; 3]).unwrap();
        let distant = light.as_distant().unwrap();
        (light, distant)
    }

    #[test]
    fn bounds_and_farthest_points_hold_all_directions_and_touch_them() {
        for angle in [0.0, 0.53, 60.0, 150.0, 179.999] {
            let (light, distant) = light(angle);
            let (low, high) = light.bounds();
            let e = distant.towards.any_orthonormal_vector();
            let f = distant.towards.cross(e);
            let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            let axis = DVec3::new(0.2, 0.9, -0.4).normalize();
            let mut along = f64::NEG_INFINITY;
            for i in 0..400 {
                let turn = f64::from(i) * std::f64::consts::TAU / 400.0;
                for part in 0..=40 {
                    let (sin, cos) = (f64::from(part) / 80.0 * angle.to_radians()).sin_cos();
                    let p = distant.towards * cos + (e * turn.cos() + f * turn.sin()) * sin;
                    let p = p * FARTHEST;
                    (least, most) = (least.min(p), most.max(p));
                    along = along.max(axis.dot(p));
                }
            }
            // Of 400 times 40 directions: half a step of a cap's width, squared.
            let slack = 2e-3 * FARTHEST;
            assert!((least - low).min_element() > -1e-9 * FARTHEST, "{angle}");
            assert!((high - most).min_element() > -1e-9 * FARTHEST, "{angle}");
            assert!(
                (least - low).max(high - most).max_element() < slack,
                "{angle}"
            );
            let farthest = axis.dot(light.farthest(axis));
            assert!(
                (0.0..slack).contains(&(farthest - along + 1e-9 * FARTHEST)),
                "{angle}"
            );
            assert!((light.reach(axis) + axis.dot(light.center()) - farthest).abs() < 1.0);
        }
    }

    #[test]
    fn it_sends_what_a_sphere_of_its_angle_does_and_a_parallel_one_the_cosine() {
        for angle in [1e-6, 0.53, 60.0, 179.0] {
            let (light, distant) = light(angle);
            let sphere = Light::sphere(distant.towards, distant.sin, [1.0; 3]).unwrap();
            let across = distant.towards.any_orthonormal_vector();
            for k in -20..=20 {
                let height = f64::from(k) / 16.0 * distant.sin.min(0.8);
                let n = height * distant.towards + (1.0 - height * height).sqrt() * across;
                let (h, e) = (
                    light.fraction_above(across, n),
                    light.unshadowed_irradiance(across, n),
                );
                // A height is known to 1e-16 of the distance, and at the ends an arccosine takes the root of an ulp.
                let slack = 1e-8 + 1e-15 / distant.sin;
                assert!((h - sphere.fraction_above(DVec3::ZERO, n)).abs() < slack);
                let scale = PI * distant.sin * distant.sin;
                let expected = sphere.unshadowed_irradiance(DVec3::ZERO, n) / scale;
                assert!(
                    (e - expected).abs() < 1e-15 + 1e-9 * distant.sin,
                    "{angle} {k}: {e} {expected}"
                );
            }
        }
        let (light, distant) = light(0.0);
        let across = distant.towards.any_orthonormal_vector();
        let level = Light::distant(DVec3::X, 0.0, [1.0; 3]).unwrap();
        assert_eq!(level.fraction_above(across, DVec3::Z), 0.0);
        let n = (distant.towards + across).normalize();
        let e = light.unshadowed_irradiance(across, n);
        assert!((e - 0.5f64.sqrt()).abs() < 1e-15);
        assert_eq!(light.unshadowed_irradiance(across, -n), 0.0);
    }
}
