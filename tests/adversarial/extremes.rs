//! Extreme sizes, distances and inputs: answers stay finite and light points on the light.

use glam::{DMat3, DVec3};
use proptest::prelude::*;
use softshadow::camera::Camera;
use softshadow::control::Control;
use softshadow::geometry::entry::Material;
use softshadow::light::{Light, Shape, SphereLight};
use softshadow::method::Method;
use softshadow::methods::hard::Hard;
use softshadow::receivers::Receivers;
use softshadow::receivers::visible::from_camera;
use softshadow::sampling::{GRID, LightSamples, Pattern, Sampler};
use softshadow::scene::Scene;

use super::{NO_CASTER, OPAQUE, bits, irradiance, scene, shade, vec};

fn lights_at(distance: f64, size: f64) -> Vec<Light> {
    let c = vec(0.1 * distance, 0.2 * distance, distance + 0.01);
    let one = [1.0; 3];
    let rect = Light::rect(c, vec(0.0, size, 0.1 * size), vec(size, 0.0, 0.0), one);
    let disk = Light::disk(c, vec(0.1, 0.1, -1.0), size, one);
    let sphere = Light::sphere(c, size, one);
    [rect, disk, sphere].into_iter().flatten().collect()
}

#[test]
fn answers_are_finite_for_lights_and_receivers_at_any_distance_within_a_million() {
    let corners = [
        vec(-1.0, -1.0, 0.0),
        vec(1.0, -1.0, 0.0),
        vec(0.0, 1.0, 0.1),
    ];
    let above = corners.map(|v| 0.3 * v + vec(0.0, 0.0, 0.5));
    let one = [[0, 1, 2]];
    let geometry = scene(&[(&corners, &one, OPAQUE), (&above, &one, OPAQUE)], 1.0);
    for far in [0.0, 1e-30, 1e-6, 1.0, 1e3, 1e6] {
        let points = [
            vec(far, far, far),
            vec(-far, 0.0, 0.0),
            vec(0.0, 0.0, -far),
            vec(0.1 * far, 0.2 * far, 0.0),
        ];
        let normals = points.map(|p| -p.try_normalize().unwrap_or(DVec3::X));
        for given in [None, Some(&[DVec3::Z; 4]), Some(&normals)] {
            let at =
                Receivers::from_points(&geometry.frame, &points, given.map(|n| &n[..])).unwrap();
            for distance in [0.0, 1e-3, 1.0, 1e3, 1e6] {
                for size in [0.0, 1e-30, 1e-5, 0.1, 1.0, 1e3, 1e6] {
                    for light in lights_at(distance, size) {
                        let case = format!("{light:?} and receivers {far} away");
                        let [a, b] =
                            [true, false].map(|cull| shade(&geometry, &light, &at, 33, cull));
                        assert_eq!(bits(&a.visibility), bits(&b.visibility), "{case}");
                        assert!(
                            b.visibility.iter().all(|v| (0.0..=1.0).contains(v)),
                            "{case}"
                        );
                        let (a, b) = (irradiance(&a), irradiance(&b));
                        assert_eq!(bits(a), bits(b), "{case}");
                        assert!(
                            b.iter().all(|e| e.is_finite() && *e >= 0.0),
                            "{case}: {b:?}"
                        );
                        let control = Control::default();
                        let hard = Hard
                            .prepare(
                                geometry.clone(),
                                &[light.to_local(&geometry.frame)],
                                &control,
                            )
                            .unwrap();
                        let hard = hard.shade(&at, 0, &control).unwrap().visibility;
                        assert!(hard.iter().all(|v| (0.0..=1.0).contains(v)), "{case}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_sun_is_as_bright_at_its_true_distance_as_nearer_by() {
    let corners = [
        vec(-1.0, -1.0, 0.0),
        vec(1.0, -1.0, 0.0),
        vec(0.0, 1.0, 0.0),
    ];
    let geometry = scene(&[(&corners, &[[0, 1, 2]], OPAQUE)], 1.0);
    let at = Receivers::from_points(&geometry.frame, &[DVec3::ZERO], Some(&[DVec3::Z])).unwrap();
    for distance in [1e3, 1e6, 1e9, 1e10, 1.5e11] {
        let (c, r) = (vec(0.0, 0.0, distance), 0.00465 * distance);
        for light in [
            Light::disk(c, -DVec3::Z, r, [1.0; 3]).unwrap(),
            Light::sphere(c, r, [1.0; 3]).unwrap(),
        ] {
            let got = f64::from(irradiance(&shade(&geometry, &light, &at, 64, true))[0]);
            let expected = light.unshadowed_irradiance(DVec3::ZERO, DVec3::Z);
            assert!(
                (got - expected).abs() < 1e-4 * expected,
                "{light:?}: {got}, not {expected}"
            );
        }
    }
}

#[test]
fn scenes_of_any_scale_without_casters_and_with_one_triangle_work() {
    for scale in [1e-100, 1e-30, 1.0, 1e30, 1e100] {
        for material in [
            OPAQUE,
            NO_CASTER,
            Material {
                opacity: 0.0,
                ..OPAQUE
            },
        ] {
            let corners = [vec(0.0, 0.0, 0.0), vec(1.0, 0.0, 0.0), vec(0.0, 1.0, 0.0)];
            let mut one = Scene::default();
            let corners = corners.map(|c| scale * c).to_vec();
            one.add_mesh("one", corners, &[[0, 1, 2]], material)
                .unwrap();
            let geometry = one.snapshot().unwrap();
            let k = [8.0, 0.0, 0.0, 0.0, 8.0, 0.0, 4.0, 4.0, 1.0];
            let pose = DMat3::from_diagonal(vec(1.0, -1.0, -1.0));
            let eye = scale * vec(0.25, 0.25, 1.0);
            let camera = Camera::new(DMat3::from_cols_array(&k), pose, eye, 8, 8).unwrap();
            let local = camera.to_local(&geometry.frame);
            let (_, seen) = from_camera(&geometry, None, &local, &Control::default()).unwrap();
            assert!(seen.len() > 20, "{}", seen.len());
            let light = Light::sphere(scale * vec(0.2, 0.2, 1.0), 0.1 * scale, [1.0; 3]).unwrap();
            let out = shade(&geometry, &light, &seen, 16, true);
            assert!(out.visibility.iter().all(|v| *v == 1.0), "scale {scale}");
        }
    }
}

#[test]
fn bad_input_is_an_error_and_not_a_panic() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let geometry = scene(&[(&corners, &[[0, 1, 2]], OPAQUE)], 1.0);
    let points = [DVec3::ZERO, DVec3::X];
    assert!(Receivers::from_points(&geometry.frame, &points, Some(&[DVec3::Z])).is_err());
    let mut huge = Scene::default();
    let bounds = [DVec3::splat(1e308), DVec3::splat(-1e308)];
    huge.add_spheres("s", &bounds, &[1e308, 1e308], OPAQUE)
        .unwrap();
    assert!(huge.snapshot().is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn light_points_lie_on_the_light_and_in_their_cells(
        seed in 0u64..1000, index in any::<u32>(), n in 1usize..300, kind in 0..3,
        p in prop::array::uniform3(-1.0f64..1.0), size in -3.0f64..1.0,
    ) {
        let (p, size) = (DVec3::from_array(p), 10f64.powf(size));
        let c = vec(0.3, -0.2, 1.5);
        let light = match kind {
            0 => Light::rect(c, vec(0.3 * size, size, 0.0), vec(size, 0.0, 0.2 * size), [1.0; 3]),
            1 => Light::disk(c, vec(0.1, 0.3, -1.0), size, [1.0; 3]),
            _ => Light::sphere(c, size, [1.0; 3]),
        }.unwrap();
        let sampler = Sampler::new(light.clone(), Pattern::new(n, seed), false);
        let mut out = LightSamples::default();
        sampler.fill(index, p, DVec3::Z, &mut out);
        out.find_cells();
        prop_assert!(out.cells.iter().flatten().all(|c| usize::from(*c) < GRID * GRID));
        let (low, high) = light.bounds();
        let slack = 1e-5;
        for i in 0..out.count {
            let q = out.point(i).as_dvec3();
            prop_assert!(q.cmpge(low - slack).all() && q.cmple(high + slack).all(), "{q}");
            if let Shape::Sphere(SphereLight { radius, .. }) = light.shape {
                let inside = p.distance(c) <= radius;
                prop_assert!(inside || (q.distance(c) - radius).abs() < 1e-4 * (1.0 + radius), "{q}");
            }
        }
        prop_assert!(out.weights.iter().flat_map(|r| r.0).all(|w| w.is_finite() && w >= 0.0));
    }
}
