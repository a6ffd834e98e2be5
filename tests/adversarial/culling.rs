//! Culling changes no bit of any answer.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::DVec3;
use softshadow::geometry::entry::Material;
use softshadow::light::Light;
use softshadow::receivers::Receivers;
use softshadow::scene::snapshot::Snapshot;

use super::{OPAQUE, Random, bits, irradiance, scene, shade, vec};

/// Receivers whose answer culling changes, and those in a penumbra.
fn culling(geometry: &Arc<Snapshot>, light: &Light, at: &Receivers, n: u32) -> (usize, usize) {
    let [with, without] = [true, false].map(|cull| {
        let out = shade(geometry, light, at, n, cull);
        let penumbra = out.visibility.iter().filter(|v| **v > 0.0 && **v < 1.0);
        let penumbra = penumbra.count();
        let light = bits(irradiance(&out));
        let both: Vec<_> = bits(&out.visibility).into_iter().zip(light).collect();
        (both, penumbra)
    });
    let differ = with.0.iter().zip(&without.0).filter(|(a, b)| a != b);
    (differ.count(), without.1)
}

/// A closed body, an open sheet, a soup or a fan of fins, welded where it should be.
fn random_mesh(random: &mut Random, kind: u64) -> (Vec<DVec3>, Vec<[i64; 3]>) {
    let center = 0.4 * random.point();
    let size = [0.02, 0.15, 0.5][random.below(3) as usize];
    match kind {
        0 => {
            // A bumpy sphere, or a lattice one whose edges are seen end-on.
            let (n, m) = (3 + random.below(6), 3 + random.below(8));
            let rough = [0.0, 0.3][random.below(2) as usize];
            let (mut vertices, mut faces) = (Vec::new(), Vec::new());
            for i in 0..=n {
                for j in 0..m {
                    let (a, b) = (i as f64 / n as f64 * TAU / 2.0, j as f64 / m as f64 * TAU);
                    let pole = i == 0 || i == n;
                    let r = size * (1.0 + if pole { 0.0 } else { rough * random.unit() });
                    let xy = if pole { 0.0 } else { a.sin() };
                    vertices.push(center + r * vec(xy * b.cos(), xy * b.sin(), a.cos()));
                    if i < n {
                        let (p, q) = (i * m + j, i * m + (j + 1) % m);
                        faces.extend([[p, p + m, q + m], [p, q + m, q]]);
                    }
                }
            }
            (vertices, faces)
        }
        1 => {
            // A sheet of axis-aligned squares, folded or flat.
            let n = 1 + random.below(8);
            let fold = [0.0, 0.5, 1.0][random.below(3) as usize];
            let (mut vertices, mut faces) = (Vec::new(), Vec::new());
            for i in 0..=n {
                for j in 0..=n {
                    let p = vec(i as f64, j as f64, fold * ((i + j) % 2) as f64);
                    vertices.push(center + size * (p / n as f64 - 0.5));
                    if i < n && j < n {
                        let p = i * (n + 1) + j;
                        faces.extend([[p, p + n + 1, p + 1], [p + 1, p + n + 1, p + n + 2]]);
                    }
                }
            }
            // Some wound the other way, some twice, some without area.
            for f in 0..faces.len() {
                match random.below(20) {
                    0 => faces[f].swap(0, 1),
                    1 => faces.push(faces[f]),
                    2 => faces.push([faces[f][0], faces[f][1], faces[f][1]]),
                    3 => faces[f] = [faces[f][0]; 3],
                    _ => {}
                }
            }
            (vertices, faces)
        }
        2 => {
            let count = 1 + random.below(30);
            let mut vertices = Vec::new();
            for _ in 0..count {
                let p = center + size * random.point();
                let sliver = [1.0, 1e-3, 1e-7][random.below(3) as usize];
                let d = random.point();
                vertices.extend([
                    p,
                    p + size * d,
                    p + size * (0.5 * d + sliver * random.point()),
                ]);
            }
            (
                vertices,
                (0..count).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
            )
        }
        _ => {
            // Fins that share one edge.
            let count = 2 + random.below(5);
            let mut vertices = vec![center, center + size * vec(0.3, 0.2, 1.0)];
            vertices.extend((0..count).map(|_| center + size * random.point()));
            (vertices, (0..count).map(|k| [0, 1, 2 + k]).collect())
        }
    }
}

fn random_light(random: &mut Random) -> Light {
    let far = [0.5, 1.5, 30.0, 1e6][random.below(4) as usize];
    let center = far * random.point();
    let size = far * [1e-4, 0.05, 0.3, 1.0][random.below(4) as usize];
    let one = [1.0; 3];
    match random.below(4) {
        0 => Light::disk(center, -center, size, one).unwrap(),
        1 => Light::sphere(center, size, one).unwrap(),
        2 => Light::disk(center, vec(0.0, 0.0, -1.0), size, one).unwrap(),
        _ => {
            let u = center.cross(random.point()).normalize() * size;
            let v = u.cross(center).normalize() * size + 0.5 * u;
            let light = Light::rect(center, u, v, one).unwrap();
            if light.emits_towards(DVec3::ZERO) {
                light
            } else {
                Light::rect(center, v, u, one).unwrap()
            }
        }
    }
}

#[test]
fn culling_changes_no_bit_for_random_meshes_lights_and_receivers() {
    let mut random = Random(17);
    let (mut penumbra, mut all) = (0, 0);
    for round in 0..400 {
        let material = Material {
            opacity: if random.below(4) == 0 { 0.5 } else { 1.0 },
            ..OPAQUE
        };
        let meshes: Vec<_> = (0..1 + random.below(3))
            .map(|_| {
                let kind = random.bits() % 4;
                random_mesh(&mut random, kind)
            })
            .filter(|(v, f)| {
                f.iter()
                    .flatten()
                    .any(|&k| v[k as usize] != v[f[0][0] as usize])
            })
            .collect();
        if meshes.is_empty() {
            continue;
        }
        let list: Vec<_> = meshes
            .iter()
            .map(|(v, f)| (&v[..], &f[..], material))
            .collect();
        let geometry = scene(&list, 1.0);
        // Anywhere, on vertices, on edges and on faces, with normals, odd ones and none.
        let mut points = Vec::new();
        let (vertices, faces) = &meshes[0];
        for _ in 0..150 {
            let [a, b, c] =
                faces[random.below(faces.len() as u64) as usize].map(|k| vertices[k as usize]);
            points.push(match random.below(6) {
                0 => a,
                1 => 0.5 * (a + b),
                2 => a.lerp(b, random.unit()).lerp(c, random.unit()),
                3 => a + 1e-6 * random.point(),
                _ => random.point(),
            });
        }
        let normal = |_| random.point();
        let normals: Vec<_> = points.iter().map(normal).collect();
        let given = (round % 3 > 0).then_some(&normals[..]);
        let at = Receivers::from_points(&geometry.frame, &points, given).unwrap();
        let light = random_light(&mut random);
        let n = [16, 100, 256][round % 3];
        let (differ, partly) = culling(&geometry, &light, &at, n);
        assert_eq!(differ, 0, "round {round}: {:?}, {n} samples", light.shape);
        (penumbra, all) = (penumbra + partly, all + at.len());
    }
    assert!(penumbra > all / 20, "{penumbra} of {all} say something");
}

#[test]
fn culling_changes_no_bit_where_receivers_are_as_high_as_a_sphere() {
    // The basis around a sphere's axis turns over with the sign of the axis' z.
    let card = [
        vec(0.0, -0.2, 0.05),
        vec(0.0, 0.2, 0.05),
        vec(0.0, 0.2, 0.6),
        vec(0.0, -0.2, 0.6),
    ];
    let geometry = scene(&[(&card, &[[0, 1, 2], [0, 2, 3]], OPAQUE)], 1.0);
    for height in [0.0, 0.1, 0.3] {
        let light = Light::sphere(vec(0.5, 0.0, height), 0.2, [1.0; 3]).unwrap();
        let points: Vec<_> = (0..50)
            .map(|i| vec(-0.5, -0.3 + 0.012 * f64::from(i), height))
            .collect();
        for normal in [DVec3::Z, DVec3::X, DVec3::ZERO] {
            let normals = vec![normal; points.len()];
            let given = (normal != DVec3::ZERO).then_some(&normals[..]);
            let at = Receivers::from_points(&geometry.frame, &points, given).unwrap();
            let (differ, penumbra) = culling(&geometry, &light, &at, 256);
            assert!(penumbra > 0);
            assert_eq!(differ, 0, "height {height}, normal {normal}");
        }
    }
}

#[test]
fn culling_changes_no_bit_for_a_tiny_light_far_from_the_origin() {
    // A light point's rounding is a good part of the light.
    let c = vec(0.7, 0.6, 0.8);
    for (size, distance) in [(1e-3, 0.02), (1e-4, 0.01), (1e-5, 0.01), (1e-5, 0.001)] {
        let m = c - vec(0.0, 0.0, 0.5 * distance);
        let d = 0.25 * distance;
        let corners = [
            m + vec(0.03 * size, -d, 0.0),
            m + vec(d, 0.0, 0.04 * d),
            m + vec(0.1 * size, d, 0.0),
        ];
        let geometry = scene(&[(&corners, &[[0, 1, 2]], OPAQUE)], 1.0);
        let point = |i: i32| {
            let (x, y) = (f64::from(i) / 1000.0 - 1.0, f64::from(i * 7 % 1000) * 1e-3);
            c + vec(size * x, size * y, -distance)
        };
        let points: Vec<_> = (0..2000).map(point).collect();
        let normals = vec![vec(1.0, 0.2, 0.1); points.len()];
        let (u, v) = (vec(0.0, size, 0.0), vec(size, 0.0, 0.0));
        for light in [
            Light::rect(c, u, v, [1.0; 3]).unwrap(),
            Light::disk(c, -DVec3::Z, 0.5 * size, [1.0; 3]).unwrap(),
            Light::sphere(c, 0.5 * size, [1.0; 3]).unwrap(),
        ] {
            for given in [None, Some(&normals[..])] {
                let at = Receivers::from_points(&geometry.frame, &points, given).unwrap();
                let (differ, penumbra) = culling(&geometry, &light, &at, 256);
                assert!(penumbra > 0);
                assert_eq!(differ, 0, "{:?} at {distance}", light.shape);
            }
        }
    }
}

#[test]
fn a_triangle_just_in_front_of_a_light_is_heeded() {
    // From behind the light to twice as far in front of it as its points are moved, over half of it.
    let (c, n) = (vec(0.6, 0.5, 0.8), vec(-0.3, -0.5, -0.8).normalize());
    let u = n.any_orthonormal_vector();
    let v = n.cross(u);
    let light = Light::rect(c, 0.2 * u, 0.2 * v, [1.0; 3]).unwrap();
    let points: Vec<_> = (0..64)
        .map(|i| vec(0.01 * f64::from(i % 8), 0.01 * f64::from(i / 8), -0.5))
        .collect();
    for step in -8..=40 {
        let height = f64::from(step) * 0.5 / f64::from(1 << 24);
        let corners = [(0.3, 0.0), (-0.3, 0.3), (-0.3, -0.3)];
        let corners = corners.map(|(x, y)| c + n * height + u * x + v * y);
        let geometry = scene(&[(&corners, &[[0, 1, 2]], OPAQUE)], 1.0);
        let at = Receivers::from_points(&geometry.frame, &points, None).unwrap();
        let (differ, _) = culling(&geometry, &light, &at, 256);
        assert_eq!(differ, 0, "{step}");
    }
}
