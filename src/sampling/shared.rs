//! Light points that all receivers of a region share, for methods that draw a picture from each.
//!
//! Of a flat or a distant light they are the points that every receiver has. A sphere's receivers each see another cap of
//! it, so points shared by a region must cover all of these caps: they lie within the angle `t` of the
//! axis to the region, at `2 t / π asin ρ` from it for a point at `ρ` in the unit disk. Seen from far away
//! that is uniform in solid angle; elsewhere [`SharedPoint::area`] weights them, and points that
//! face away from a receiver do not count there.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

use super::fill::coordinates;
use super::{LightSamples, Sampler};
use crate::frame::POINT_OFFSET;
use crate::light::{DistantLight, SphereLight};
use crate::simd::LANES;

/// A light point in local coordinates.
#[derive(Debug, Clone, Copy)]
pub struct SharedPoint {
    /// Where it is, moved off the light by [`POINT_OFFSET`].
    pub position: DVec3,
    /// Direction in which the light emits there; zero for a sphere of size zero.
    pub normal: DVec3,
    /// The light's area that it stands for, times the number of points.
    pub area: f64,
}

impl Sampler {
    /// The light points that receivers in the convex hull of `corners` share, in the pattern's order.
    pub fn shared(&self, corners: &[DVec3]) -> Vec<SharedPoint> {
        if let Some(distant) = self.light.as_distant() {
            return self.shared_distant(&distant, corners);
        }
        match self.light.as_sphere() {
            None => self.shared_flat(corners[0]),
            Some(sphere) => self.shared_on(sphere, corners),
        }
    }

    fn shared_flat(&self, receiver: DVec3) -> Vec<SharedPoint> {
        let mut samples = LightSamples::default();
        self.fill(0, receiver, DVec3::ZERO, &mut samples);
        let flat = self.flat.as_ref();
        let (normal, area) = flat.map_or((DVec3::ZERO, 0.0), |f| (f.normal, f.area));
        let point = |i: usize| SharedPoint {
            position: samples.point(i).as_dvec3(),
            normal,
            area,
        };
        (0..self.len()).map(point).collect()
    }

    /// Directions, all the same for all receivers: points that are far from the region's middle, and each stand for as much of
    /// the cap.
    fn shared_distant(&self, light: &DistantLight, corners: &[DVec3]) -> Vec<SharedPoint> {
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let (e1, e2) = light.towards.any_orthonormal_pair();
        let height = light.sin * light.sin / (1.0 + light.cos);
        let point = |i: usize| {
            let (x, y) = coordinates(&self.pattern, i / LANES, [0, 0], true);
            let (x, y) = (f64::from(x.0[i % LANES]), f64::from(y.0[i % LANES]));
            // The map of `fill_cap`, equal in area.
            let fall = (x * x + y * y) * height;
            let stretch = (height * (2.0 - fall)).sqrt();
            let direction = light.towards * (1.0 - fall) + (e1 * x + e2 * y) * stretch;
            SharedPoint {
                position: middle + direction * light.distance,
                normal: -direction,
                area: light.distance * light.distance,
            }
        };
        (0..self.len()).map(point).collect()
    }

    fn shared_on(&self, sphere: SphereLight, corners: &[DVec3]) -> Vec<SharedPoint> {
        let SphereLight { center, radius } = sphere;
        if radius == 0.0 {
            let point = SharedPoint {
                position: center,
                normal: DVec3::ZERO,
                area: 0.0,
            };
            return vec![point; self.len()];
        }
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let axis = (middle - center).try_normalize().unwrap_or(DVec3::Z);
        let widest = widest(center, radius, axis, corners);
        let (e1, e2) = axis.any_orthonormal_pair();
        let stretch = widest / FRAC_PI_2;
        let size = center.abs().max_element().max(1.0) + radius;
        let reach = radius + POINT_OFFSET * size;
        let point = |i: usize| {
            let (x, y) = coordinates(&self.pattern, i / LANES, [0, 0], true);
            let (x, y) = (f64::from(x.0[i % LANES]), f64::from(y.0[i % LANES]));
            // Not 0: the pattern's numbers are odd multiples of 2⁻²³.
            let rho = x.hypot(y).clamp(1e-7, 1.0 - 1e-7);
            let angle = stretch * rho.asin();
            let normal = axis * angle.cos() + (e1 * x + e2 * y) * (angle.sin() / rho);
            let slope = rho * ((1.0 - rho) * (1.0 + rho)).sqrt();
            SharedPoint {
                position: center + normal * reach,
                normal,
                area: PI * radius * radius * stretch * angle.sin() / slope,
            }
        };
        (0..self.len()).map(point).collect()
    }
}

/// Largest angle from `axis` to a point of the sphere that some receiver in the hull of `corners` sees.
fn widest(center: DVec3, radius: f64, axis: DVec3, corners: &[DVec3]) -> f64 {
    let (mut angle, mut farthest) = (0.0f64, 0.0f64);
    for corner in corners {
        let d = *corner - center;
        angle = angle.max(axis.angle_between(d));
        farthest = farthest.max(d.length());
    }
    // The directions to a hull lie in any cone that holds those to its corners and is convex.
    if angle.is_nan() || angle >= FRAC_PI_2 || farthest <= radius {
        return PI;
    }
    angle + (radius / farthest).acos()
}

#[cfg(test)]
mod tests {
    use super::super::Pattern;
    use super::*;
    use crate::light::Light;

    #[test]
    fn points_on_a_sphere_weigh_as_much_as_the_solid_angle_seen_from_anywhere_in_the_region() {
        let center = DVec3::new(0.1, 0.2, 0.9);
        let light = Light::sphere(center, 0.3, [1.0; 3]).unwrap();
        let sampler = Sampler::new(light, Pattern::part(0..4096, 1), true);
        let corner = |x, y| DVec3::new(x, y, 0.0);
        let corners = [
            corner(-0.8, -0.8),
            corner(0.9, -0.8),
            corner(0.9, 0.7),
            corner(-0.8, 0.7),
        ];
        let points = sampler.shared(&corners);
        for p in corners
            .into_iter()
            .chain([corner(0.1, 0.2), corner(-0.3, 0.5)])
        {
            let weight = |s: &SharedPoint| {
                let d = s.position - p;
                s.area * (-s.normal.dot(d)).max(0.0) / d.length().powi(3)
            };
            let sum = points.iter().map(weight).sum::<f64>() / 4096.0;
            let sin = 0.3 / (center - p).length();
            let exact = 2.0 * PI * (1.0 - (1.0 - sin * sin).sqrt());
            // The integrand has a kink at the horizon: 4096 stratified points, measured 3e-4 relative.
            assert!((sum / exact - 1.0).abs() < 1e-3, "{p}: {sum} {exact}");
        }
    }

    #[test]
    fn points_of_flat_lights_are_those_of_every_receiver() {
        let light = Light::disk(DVec3::new(0.0, 0.1, 1.0), DVec3::NEG_Z, 0.2, [1.0; 3]).unwrap();
        let sampler = Sampler::new(light, Pattern::new(50, 9), true);
        let mut samples = LightSamples::default();
        sampler.fill(3, DVec3::new(0.4, 0.0, 0.0), DVec3::Z, &mut samples);
        for (i, point) in sampler.shared(&[DVec3::ZERO]).iter().enumerate() {
            assert_eq!(point.position, samples.point(i).as_dvec3());
        }
    }
}
