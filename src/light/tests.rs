use std::f64::consts::{PI, TAU};

use super::disk::disk_irradiance;
use super::falloff::{beyond_line_over_disk, beyond_line_over_rectangle};
use super::sphere::{cap_fraction_above, cut_sphere_irradiance};
use super::*;
use proptest::prelude::*;

/// A number and those some ulps beside it.
fn beside(x: f64, ulps: i64) -> f64 {
    (0..ulps.abs()).fold(x, |x, _| if ulps > 0 { x.next_up() } else { x.next_down() })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// Next to the ends of their intervals, in the middle, and beyond.
    #[test]
    fn parts_of_a_light_are_never_negative_and_never_more_than_all(
        end in prop::sample::select(vec![-1.0, 0.0, 0.5, 1.0]), ulps in -40i64..=40, wide in -1.2..1.2f64,
        part in prop::sample::select(vec![0.0, 1e-300, 1e-17, 1e-9, 0.1, 1.0 / 3.0, 0.5]),
        sin in prop::sample::select(vec![1e-200, 1e-160, 1e-9, 1e-4, 0.3, 1.0 - 1e-16, 1.0]),
    ) {
        for x in [beside(end, ulps), wide, beside(part, ulps), beside(1.0 - part, ulps)] {
            let all = [
                beyond_line_over_disk(x),
                beyond_line_over_rectangle(x.clamp(0.0, 1.0), part),
                cap_fraction_above(x * sin, sin),
                cap_fraction_above(beside(end * sin, ulps), sin),
            ];
            prop_assert!(all.iter().all(|v| (0.0..=1.0).contains(v)), "{x} {part} {sin}: {all:?}");
        }
    }

    /// Tangent planes that touch a light's border or nearly do, and points on the rim of a disk or nearly so.
    #[test]
    fn a_light_that_the_tangent_plane_touches_sends_nothing_negative(
        direction in prop::array::uniform3(-1.0..1.0f64), turn in 0.0..TAU, ulps in -8i64..=8,
        exponent in -12..2i32, radius in prop::sample::select(vec![1e-74, 1e-8, 0.3, 5.0]),
    ) {
        let m = DVec3::from(direction).normalize_or(DVec3::Z);
        let e = m.any_orthonormal_vector();
        let rim = turn.cos() * e + turn.sin() * m.cross(e);
        let near = beside(radius, ulps) * rim - m * 10f64.powi(exponent);
        for light in [
            Light::disk(DVec3::ZERO, -m, radius, [1.0; 3]).unwrap(),
            Light::sphere(DVec3::ZERO, radius, [1.0; 3]).unwrap(),
            Light::rect(DVec3::ZERO, radius * e, m.cross(e), [1.0; 3]).unwrap(),
        ] {
            for p in [near, -near, near + 0.5 * rim, DVec3::from(direction)] {
                // Normals across the direction to the border, and some ulps of it up and down.
                let to = (radius * rim - p).normalize_or(m);
                let across = to.cross(m).normalize_or(e);
                for lift in [0.0, 1e-16, -1e-16, 1e-12, -1e-12, 0.1] {
                    for n in [to.cross(across) + lift * to, across + lift * to] {
                        let n = n.normalize_or(m);
                        let h = light.fraction_above(p, n);
                        prop_assert!((0.0..=1.0).contains(&h), "{light:?} {p} {n}: {h}");
                        let e = light.unshadowed_irradiance(p, n);
                        // All of a hemisphere sends π; next to a rim the terms cancel.
                        prop_assert!((0.0..=PI * (1.0 + 1e-4)).contains(&e), "{light:?} {p} {n}: {e}");
                    }
                }
            }
        }
    }
}

#[test]
fn of_a_small_sphere_as_much_is_above_as_of_the_disk_that_it_looks_like() {
    for sin in [1e-200, 1e-150, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3] {
        for x in [-0.99, -0.3, 0.0, 0.2, 0.7, 0.999] {
            let (got, disk) = (cap_fraction_above(x * sin, sin), beyond_line_over_disk(x));
            assert!(
                (got - disk).abs() < 1e-15 + sin * sin,
                "{sin} {x}: {got} {disk}"
            );
        }
    }
    // A hemisphere: a lune.
    for x in [-0.9f64, -0.2, 0.0, 0.5, 0.8] {
        let lune = 1.0 - x.acos() / PI;
        assert!((cap_fraction_above(x, 1.0) - lune).abs() < 1e-15);
    }
}

/// Midpoint rule over the light's area or solid angle: irradiance and fraction above.
fn brute_force(light: &Light, p: DVec3, n: DVec3, steps: usize) -> (f64, f64) {
    let (mut irradiance, mut above, mut total) = (0.0, 0.0, 0.0);
    for i in 0..steps {
        for j in 0..steps {
            let (s, t) = (
                (i as f64 + 0.5) / steps as f64,
                (j as f64 + 0.5) / steps as f64,
            );
            let (direction, weight) = match &light.shape {
                &Shape::Rect(RectLight { center, u, v }) => {
                    let r = center + (s - 0.5) * u + (t - 0.5) * v - p;
                    (r, -u.cross(v).dot(r) / r.length().powi(3))
                }
                &Shape::Disk(DiskLight {
                    center,
                    normal,
                    radius,
                }) => {
                    let e1 = normal.any_orthonormal_vector();
                    let (rho, phi) = (s.sqrt() * radius, TAU * t);
                    let e = phi.cos() * e1 + phi.sin() * normal.cross(e1);
                    let r = center + rho * e - p;
                    (
                        r,
                        -normal.dot(r) * PI * radius * radius / r.length().powi(3),
                    )
                }
                &Shape::Sphere(SphereLight { center, radius }) => {
                    let d = center - p;
                    let w = d.normalize();
                    let e1 = w.any_orthonormal_vector();
                    let cap = 1.0 - (1.0 - (radius / d.length()).powi(2)).sqrt();
                    let cos = 1.0 - s * cap;
                    let e = (TAU * t).cos() * e1 + (TAU * t).sin() * w.cross(e1);
                    (w * cos + e * (1.0 - cos * cos).sqrt(), TAU * cap)
                }
                // The sum of its parts, in its own tests.
                Shape::Polygon(_) => unreachable!(),
                Shape::Distant(distant) => {
                    let w = distant.towards;
                    let e1 = w.any_orthonormal_vector();
                    let cos = 1.0 - s * (1.0 - distant.cos);
                    let e = (TAU * t).cos() * e1 + (TAU * t).sin() * w.cross(e1);
                    (w * cos + e * (1.0 - cos * cos).sqrt(), distant.scale())
                }
            };
            total += 1.0;
            if n.dot(direction) > 0.0 {
                above += 1.0;
                irradiance += n.dot(direction.normalize()) * weight;
            }
        }
    }
    (irradiance / total, above / total)
}

fn lights() -> [Light; 5] {
    let c = DVec3::new(0.3, -0.2, 1.5);
    let (u, v) = (DVec3::new(0.1, 0.9, 0.2), DVec3::new(1.1, 0.1, -0.3));
    [
        Light::rect(c, u, v, [1.0; 3]).unwrap(),
        Light::disk(c, DVec3::new(0.2, 0.1, -1.0), 0.7, [1.0; 3]).unwrap(),
        Light::disk(DVec3::new(0.0, 0.0, 2.0), -DVec3::Z, 0.7, [1.0; 3]).unwrap(),
        Light::sphere(c, 0.6, [1.0; 3]).unwrap(),
        Light::distant(-c, 50.0, [1.0; 3]).unwrap(),
    ]
}

#[test]
fn closed_forms_agree_with_quadrature_above_and_across_the_tangent_plane() {
    // 400² midpoints: smooth integrands to 1e-5, the horizon's cut to about 1/400 of a row.
    let normals = [
        DVec3::Z,
        DVec3::new(0.9, 0.1, 0.3),
        DVec3::new(-1.0, 0.2, 0.02),
    ];
    for light in lights() {
        for n in normals.map(DVec3::normalize) {
            let p = DVec3::new(0.1, 0.2, -0.1);
            let (irradiance, above) = brute_force(&light, p, n, 400);
            let got = light.unshadowed_irradiance(p, n);
            assert!(
                (got - irradiance).abs() < 2e-4 * irradiance.max(0.05),
                "{light:?} {n}: {got} {irradiance}"
            );
            let h = light.fraction_above(p, n);
            assert!((h - above).abs() < 3e-3, "{light:?} {n}: {h} {above}");
        }
    }
}

#[test]
fn a_sphere_that_the_tangent_plane_cuts_is_the_disk_that_its_outline_spans() {
    for sin in [1e-8f64, 1e-5, 1e-3, 0.02, 0.2, 0.24, 0.26, 0.5, 0.9, 0.999] {
        for part in [-0.999, -0.7, -0.2, 0.0, 0.3, 0.8, 0.999] {
            let cos_axis = part * sin;
            let axis = DVec3::new((1.0 - cos_axis * cos_axis).sqrt(), 0.0, cos_axis);
            let cos = (1.0 - sin * sin).sqrt();
            let disk = disk_irradiance(axis * cos, -axis, sin, DVec3::Z);
            let sphere = cut_sphere_irradiance(sin, 1.0, cos_axis);
            // Of the same size seen from the front; the disk's chord and arc cancel as the terms here would
            // without their series: to ulps of the sine, while the light falls with its square.
            let all = PI * sin * sin;
            let tolerance = (1e-14 + 2.0 * f64::EPSILON / sin) * all;
            assert!(
                (sphere - disk).abs() < tolerance,
                "{sin} {part}: {sphere} {disk}"
            );
        }
    }
    // Half of it above: (σ - sin σ cos σ), of a small one 2/3 σ³ but for 1/5 σ².
    for sin in [1e-9, 1e-6, 1e-4] {
        let got = cut_sphere_irradiance(sin, 1.0, 0.0);
        assert!((got / (2.0 / 3.0 * sin.powi(3)) - 1.0).abs() < 1e-14 + sin * sin);
    }
}

#[test]
fn known_values() {
    // A disk overhead: π sin² of its half-angle. A sphere: the same. A huge square: π.
    let disk = Light::disk(DVec3::Z, -DVec3::Z, 1.0, [1.0; 3]).unwrap();
    assert!((disk.unshadowed_irradiance(DVec3::ZERO, DVec3::Z) - PI / 2.0).abs() < 1e-12);
    let sphere = Light::sphere(DVec3::Z * 2.0, 1.0, [1.0; 3]).unwrap();
    assert!((sphere.unshadowed_irradiance(DVec3::ZERO, DVec3::Z) - PI / 4.0).abs() < 1e-12);
    let sky = Light::rect(DVec3::Z, DVec3::Y * 1e7, DVec3::X * 1e7, [1.0; 3]).unwrap();
    assert!((sky.unshadowed_irradiance(DVec3::ZERO, DVec3::Z) - PI).abs() < 1e-6);
    // Half below the horizon.
    assert!((sphere.fraction_above(DVec3::ZERO, DVec3::X) - 0.5).abs() < 1e-12);
    assert!((disk.fraction_above(DVec3::ZERO, DVec3::X) - 0.5).abs() < 1e-12);
    assert!((sky.fraction_above(DVec3::ZERO, DVec3::X) - 0.5).abs() < 1e-12);
}

#[test]
fn nothing_reaches_the_back_of_a_flat_light_or_the_inside_of_a_sphere() {
    // One at infinity has neither.
    for light in lights().into_iter().filter(|l| l.as_distant().is_none()) {
        let inside = match light.normal() {
            Some(m) => light.center() - 0.1 * m,
            None => light.center() + DVec3::new(0.1, 0.2, 0.3),
        };
        assert_eq!(light.unshadowed_irradiance(inside, DVec3::Z), 0.0);
        assert_eq!(light.fraction_above(inside, DVec3::Z), 0.0);
    }
}

#[test]
fn bad_lights_are_errors_and_lights_of_size_zero_are_not() {
    let z = DVec3::Z;
    assert!(Light::rect(z, DVec3::X, DVec3::X * 2.0, [1.0; 3]).is_err());
    assert!(Light::rect(z, DVec3::X, DVec3::ZERO, [1.0; 3]).is_err());
    assert!(Light::disk(z, DVec3::ZERO, 1.0, [1.0; 3]).is_err());
    assert!(Light::sphere(z, -1.0, [1.0; 3]).is_err());
    assert!(Light::sphere(z, f64::NAN, [1.0; 3]).is_err());
    let point = Light::sphere(z, 0.0, [1.0; 3]).unwrap();
    assert_eq!(point.unshadowed_irradiance(DVec3::ZERO, z), 0.0);
    assert_eq!(point.fraction_above(DVec3::ZERO, z), 1.0);
    assert_eq!(point.fraction_above(DVec3::ZERO, -z), 0.0);
}
