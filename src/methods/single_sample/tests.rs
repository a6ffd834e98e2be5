//! The search through the tree against triangles one by one, and those against their points.

use glam::DVec3;

use super::found::Found;
use super::lanes::ReceiverViews;
use super::triangles::search;
use super::view::{DoubledLight, ReceiverView};
use crate::bvh::any_hit;
use crate::bvh::packet::Stack;
use crate::geometry::entry::Material;
use crate::light::Light;
use crate::random::Random;
use crate::scene::Scene;
use crate::simd::{LANES, detect, levels};

fn lights(random: &mut Random) -> [Light; 3] {
    let (c, n) = (random.point() * 1.5, random.point());
    let (u, v) = (random.point() * 0.3, random.point() * 0.3);
    [
        Light::sphere(c, 0.2, [1.0; 3]).unwrap(),
        Light::disk(c, n, 0.2, [1.0; 3]).unwrap(),
        Light::rect(c, u, v, [1.0; 3]).unwrap(),
    ]
}

fn soup(random: &mut Random, count: usize, size: f64) -> Scene {
    let mut vertices = vec![];
    for _ in 0..count {
        let p = random.point();
        vertices.extend([(); 3].map(|()| p + size * random.point()));
    }
    let faces: Vec<[i64; 3]> = (0..count as i64)
        .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
        .collect();
    let material = Material {
        albedo: [1.0; 3],
        opacity: 1.0,
        casts: true,
        receives: true,
    };
    let mut scene = Scene::default();
    scene.add_mesh("soup", vertices, &faces, material).unwrap();
    scene
}

/// Views of random receivers, a third without a tangent plane.
fn views(random: &mut Random, light: &Light) -> ReceiverViews {
    let doubled = DoubledLight::new(light, light.center().as_vec3());
    let mut views = ReceiverViews::default();
    views.clear(&doubled);
    for lane in 0..LANES {
        let mut n = random.point().normalize();
        if lane % 3 == 0 {
            n = DVec3::ZERO;
        } else if lane % 3 == 1 {
            // The light is low.
            let l = light.center();
            n = (n - l * (n.dot(l) / l.length_squared())).normalize();
        }
        let origin = (0.5 * random.point()).as_vec3();
        views.set(lane, origin, n);
    }
    views.look(detect(), u16::MAX);
    views
}

#[test]
fn the_tree_finds_what_all_triangles_one_by_one_say() {
    let mut random = Random(3);
    let (mut stack, mut found) = (Stack::new(), Found::default());
    let (mut partly, mut clipped) = (0, 0);
    for round in 0..300 {
        let mut scene = soup(&mut random, 1 + round % 90, [0.02, 0.2, 1.5][round % 3]);
        let geometry = scene.snapshot().unwrap();
        let bvh = &geometry.occluders().opaque;
        for light in lights(&mut random) {
            let views = views(&mut random, &light.to_local(&geometry.frame));
            let mut rows = vec![];
            for (_, level) in levels() {
                found.clear(false);
                let active = u16::MAX;
                let blocked = search(level, bvh, None, &views, active, &mut found, &mut stack);
                rows.push((blocked, found.limit().0));
            }
            for (level, (blocked, row)) in rows.iter().enumerate() {
                let plain = any_hit::blocked(bvh, &views.packet, u16::MAX, &mut stack);
                assert_eq!(*blocked, plain);
                for lane in (0..LANES).filter(|lane| plain >> lane & 1 == 0) {
                    assert_eq!(row[lane].to_bits(), rows[0].1[lane].to_bits(), "{level}");
                }
            }
            let (blocked, row) = rows[0];
            for lane in (0..LANES).filter(|lane| blocked >> lane & 1 == 0) {
                let view = views.view(lane);
                let all = bvh.corners.iter().map(|c| view.triangle(c, 1.0));
                let expected = all.fold(1.0, f64::min);
                // Places are off by a few ulps of the distance, in lights of a tenth of it and
                // more; where one is seen edge-on, of the height over its plane.
                let depth = 1.0 / view.w.length();
                let tolerance = 3e-6 / depth.min(view.width.max(1e-3)).min(1.0);
                assert!(
                    (f64::from(row[lane]) - expected).abs() < tolerance,
                    "round {round}, lane {lane}: {} {expected} {tolerance}",
                    row[lane]
                );
                partly += usize::from(expected < 1.0);
                clipped += usize::from(expected < 1.0 && view.low);
            }
        }
    }
    assert!(partly > 2000 && clipped > 500, "{partly} {clipped}");
}

#[test]
fn a_triangles_distance_is_that_of_its_nearest_point() {
    let mut random = Random(8);
    let mut counted = 0;
    for round in 0..600 {
        let light = lights(&mut random)[round % 3].clone();
        let doubled = DoubledLight::new(&light, light.center().as_vec3());
        let origin = (0.5 * random.point()).as_vec3();
        let n = if round % 2 == 0 {
            DVec3::ZERO
        } else {
            random.point().normalize()
        };
        let view = ReceiverView::new(&doubled, origin, n);
        if !view.soft || view.low {
            continue;
        }
        let middle = origin.as_dvec3() + view.ray * (0.5 + 0.6 * random.number());
        let corners = [(); 3].map(|()| (middle + 0.4 * random.point()).as_vec3());
        let found = view.triangle(&corners, 1.0);
        let mut least = f64::INFINITY;
        let steps = 400;
        for i in 0..=steps {
            for j in 0..=steps - i {
                let (s, t) = (f64::from(i), f64::from(j));
                let [a, b, c] = corners.map(|c| c.as_dvec3() - origin.as_dvec3());
                let p = a + ((b - a) * s + (c - a) * t) / f64::from(steps);
                let w = view.w.dot(p);
                if w > view.nearest && w <= 1.0 {
                    least = least.min(view.distance(view.x.dot(p) / w, view.y.dot(p) / w));
                }
            }
        }
        // Where the ray's line passes through, the distance of the sides is not the least.
        let places = corners.map(|c| {
            let p = c.as_dvec3() - origin.as_dvec3();
            (view.x.dot(p), view.y.dot(p))
        });
        let turns: [bool; 3] = std::array::from_fn(|i| {
            let (a, b) = (places[i], places[(i + 1) % 3]);
            a.0 * b.1 - a.1 * b.0 > 0.0
        });
        if turns == [true; 3] || turns == [false; 3] || least >= 1.0 {
            continue;
        }
        counted += 1;
        // Points of the grid are at most 0.003 apart, on a light of 0.2 seen from farther than that;
        // where it is seen obliquely, places lie farther apart.
        assert!(found <= least + 1e-9, "round {round}: {found} {least}");
        let oblique = view.ray.length() * view.w.length();
        let farthest = corners.map(|c| view.w.dot(c.as_dvec3() - origin.as_dvec3()));
        let near = farthest.into_iter().fold(f64::INFINITY, f64::min).max(0.05);
        let tolerance = 0.02 * oblique / near;
        assert!(found > least - tolerance, "round {round}: {found} {least}");
    }
    assert!(counted > 40, "{counted}");
}

#[test]
fn parts_keep_their_own_nearest() {
    let mut random = Random(5);
    let mut scene = soup(&mut random, 60, 0.3);
    let geometry = scene.snapshot().unwrap();
    let bvh = &geometry.occluders().opaque;
    let light = lights(&mut random)[0].to_local(&geometry.frame);
    let views = views(&mut random, &light);
    let parts: Vec<u32> = bvh.faces.iter().map(|f| f % 7).collect();
    let (mut found, mut stack) = (Found::default(), Stack::new());
    found.clear(true);
    let level = detect();
    let blocked = search(level, bvh, Some(&parts), &views, !0, &mut found, &mut stack);
    let mut several = 0;
    for lane in (0..LANES).filter(|lane| blocked >> lane & 1 == 0) {
        let near = found.near(lane).to_vec();
        several += usize::from(near.len() > 1);
        for part in 0..7 {
            let of = parts.iter().zip(&bvh.corners).filter(|(p, _)| **p == part);
            let all = of.map(|(_, c)| views.view(lane).triangle(c, 1.0));
            let expected = all.fold(1.0, f64::min);
            let known = near.iter().find(|p| p.0 == part).map_or(1.0, |p| p.1);
            assert!((f64::from(known) - expected).abs() < 1e-4, "{lane} {part}");
        }
    }
    assert!(several > 2, "{several}");
}
