//! Planes through an edge that touch a light (Akenine-Möller and Assarsson 2002, Sections 4.1 and 8).
//!
//! The paper puts a spherical light's front and back planes through `c ∓ r n`, with `n` the normal of
//! the edge's shadow quad; those planes cut the sphere slightly. Turning the planes about the edge until
//! they touch the light, as its Section 8 suggests for any convex light, is exact for spheres too.
//!
//! Seen along the edge, with `μ` the direction from the edge to the light's centre and `κ` the direction
//! out of the shadow, both perpendicular to the edge, a plane through the edge has the normal
//! `κ + τ μ`. It has all of the light on its outer side and touches it for the largest `τ`, and on its
//! inner side for the smallest.

use glam::DVec3;

use super::Light;

/// Two planes through an axis that touch a light.
#[derive(Debug, Clone, Copy)]
pub struct Tangents {
    /// Unit normal, out of the shadow, of the plane that has all of the light on its outer side: the
    /// lit limit, the front plane.
    pub front: DVec3,
    /// Unit normal, out of the shadow, of the plane that has all of the light on its inner side: the
    /// umbra's limit, the back plane.
    pub back: DVec3,
}

/// Returns the planes through `point` along `axis` (unit) that touch the light; their normals point to the
/// side of `outside`. `None` where the axis runs through the light or the vectors leave no direction.
pub fn tangents(light: &Light, point: DVec3, axis: DVec3, outside: DVec3) -> Option<Tangents> {
    let across = |v: DVec3| v - v.dot(axis) * axis;
    let center = across(light.center() - point);
    let distance = center.length();
    let mu = center.try_normalize()?;
    let kappa = axis.cross(mu);
    let kappa = if kappa.dot(outside) < 0.0 {
        -kappa
    } else {
        kappa
    };
    let [front, back] = light.slopes(point, distance, [kappa, mu])?;
    let plane = |slope: f64| (kappa + slope * mu).normalize();
    Some(Tangents {
        front: plane(front),
        back: plane(back),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::{DiskLight, RectLight, Shape, SphereLight};
    use glam::DVec2;
    use std::f64::consts::TAU;

    /// Corners of an arrowhead, which has a reflex one.
    fn arrow(c: DVec3) -> [DVec3; 4] {
        let plan = [(0.4, 0.0), (-0.3, 0.4), (-0.1, 0.0), (-0.3, -0.4)];
        plan.map(|(x, y)| c + DVec3::new(x, -y, 0.2 * x))
    }

    /// Points on the outline of a light, or all over a sphere.
    fn points(light: &Light) -> Vec<DVec3> {
        let n = 400;
        let turn = |i: usize| {
            DVec3::new(
                (TAU * i as f64 / n as f64).cos(),
                (TAU * i as f64 / n as f64).sin(),
                0.0,
            )
        };
        match &light.shape {
            &Shape::Rect(RectLight { center, u, v }) => {
                [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
                    .map(|(s, t)| center + s * u + t * v)
                    .to_vec()
            }
            &Shape::Disk(DiskLight {
                center,
                normal,
                radius,
            }) => {
                let e = normal.any_orthonormal_vector();
                let f = normal.cross(e);
                (0..n)
                    .map(|i| center + radius * (turn(i).x * e + turn(i).y * f))
                    .collect()
            }
            &Shape::Sphere(SphereLight { center, radius }) => (0..n)
                .flat_map(|i| (0..=n).map(move |j| (i, j)))
                .map(|(i, j)| {
                    let z = 2.0 * j as f64 / n as f64 - 1.0;
                    center + radius * (turn(i) * (1.0 - z * z).max(0.0).sqrt() + z * DVec3::Z)
                })
                .collect(),
            Shape::Polygon(polygon) => {
                let place = |c: &DVec2| polygon.center + c.x * polygon.u + c.y * polygon.v;
                polygon.corners().iter().map(place).collect()
            }
            Shape::Distant(distant) => points(&Light {
                shape: Shape::Sphere(distant.stand_in()),
                radiance: light.radiance,
            }),
        }
    }

    #[test]
    fn both_planes_touch_the_light_and_have_it_on_one_side() {
        let c = DVec3::new(0.2, 0.1, 2.0);
        let lights = [
            Light::rect(
                c,
                DVec3::new(0.1, 0.5, 0.2),
                DVec3::new(-0.6, 0.1, 0.1),
                [1.0; 3],
            )
            .unwrap(),
            Light::disk(c, DVec3::new(0.3, 0.2, -1.0), 0.4, [1.0; 3]).unwrap(),
            Light::sphere(c, 0.4, [1.0; 3]).unwrap(),
            Light::polygon(&arrow(c), [1.0; 3]).unwrap(),
        ];
        let axis = DVec3::new(0.3, 1.0, -0.2).normalize();
        for light in lights {
            let a = DVec3::new(0.1, -0.3, 0.2);
            let t = tangents(&light, a, axis, DVec3::X).unwrap();
            assert!(t.front.dot(DVec3::X) > 0.0 && t.back.dot(DVec3::X) > 0.0);
            let range = |n: DVec3| {
                points(&light)
                    .iter()
                    .map(|p| n.dot(*p - a))
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), d| {
                        (l.min(d), h.max(d))
                    })
            };
            // The sampled outline misses the point of contact by at most half a step: r (1 - cos(π/400)).
            assert!(range(t.front).0.abs() < 4e-5, "{light:?}");
            assert!(range(t.back).1.abs() < 4e-5, "{light:?}");
        }
    }

    #[test]
    fn an_axis_through_the_light_has_no_tangents() {
        let light = Light::sphere(DVec3::Z, 0.5, [1.0; 3]).unwrap();
        assert!(tangents(&light, DVec3::Z * 0.7, DVec3::X, DVec3::Y).is_none());
    }
}
