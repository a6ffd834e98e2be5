//! Hard cases for the core's promises: exact occlusion, culling that changes no bit, finite answers to
//! any finite question, and a rasteriser that neither drops nor doubles a pixel.

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};
use proptest::prelude::*;
use robust::{Coord3D, orient3d};
use softshadow::bvh::packet::Packet;
use softshadow::camera::Camera;
use softshadow::control::Control;
use softshadow::geometry::Geometry;
use softshadow::light::{Light, Shape};
use softshadow::methods::hard::Hard;
use softshadow::methods::ray_traced::RayTraced;
use softshadow::methods::{Method, Shading};
use softshadow::raster::{SPAN, Sink, rasterize};
use softshadow::receivers::{Receivers, from_camera};
use softshadow::sampling::{GRID, LightSamples, Pattern, Sampler};
use softshadow::scene::{Material, Scene};

const OPAQUE: Material = Material {
    albedo: [0.8; 3],
    opacity: 1.0,
    casts: true,
    receives: true,
};
const NO_CASTER: Material = Material {
    casts: false,
    ..OPAQUE
};

fn vec(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn point(&mut self) -> DVec3 {
        let mut x = || 2.0 * self.unit() - 1.0;
        vec(x(), x(), x())
    }

    fn below(&mut self, n: u64) -> i64 {
        (self.bits() % n) as i64
    }

    fn lattice(&mut self, n: u64) -> DVec3 {
        vec(
            self.below(n) as f64,
            self.below(n) as f64,
            self.below(n) as f64,
        )
    }
}

/// Vertices, faces and look of a mesh.
type Part<'a> = (&'a [DVec3], &'a [[i64; 3]], Material);

/// A scene with these meshes, and one that casts nothing and fixes the scale.
fn scene(meshes: &[Part], size: f64) -> Arc<Geometry> {
    let mut scene = Scene::default();
    for (i, (vertices, faces, material)) in meshes.iter().enumerate() {
        let (name, vertices) = (format!("mesh {i}"), vertices.to_vec());
        scene.add_mesh(&name, vertices, faces, *material).unwrap();
    }
    let frame = vec![
        DVec3::splat(-size),
        DVec3::splat(size),
        vec(-size, size, 0.0),
    ];
    scene
        .add_mesh("frame", frame, &[[0, 1, 2]], NO_CASTER)
        .unwrap();
    scene.geometry().unwrap()
}

fn shade(geometry: &Arc<Geometry>, light: Light, at: &Receivers, n: i64, cull: bool) -> Shading {
    let control = Control::default();
    let method = RayTraced::new(n, 3, false, cull).unwrap();
    let prepared = method
        .prepare(geometry.clone(), &[light], &control)
        .unwrap();
    prepared.shade(at, 0, &control).unwrap()
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|x| x.to_bits()).collect()
}

/// Receivers whose answer culling changes, and those in a penumbra.
fn culling(geometry: &Arc<Geometry>, light: Light, at: &Receivers, n: i64) -> (usize, usize) {
    let [with, without] = [true, false].map(|cull| {
        let out = shade(geometry, light, at, n, cull);
        let penumbra = out.visibility.iter().filter(|v| **v > 0.0 && **v < 1.0);
        let penumbra = penumbra.count();
        let irradiance = bits(&out.irradiance.unwrap());
        let both: Vec<_> = bits(&out.visibility).into_iter().zip(irradiance).collect();
        (both, penumbra)
    });
    let differ = with.0.iter().zip(&without.0).filter(|(a, b)| a != b);
    (differ.count(), without.1)
}

// ---- segments ----

fn side(a: Vec3, b: Vec3, c: Vec3, p: Vec3) -> f64 {
    let coord = |v: Vec3| Coord3D {
        x: f64::from(v.x),
        y: f64::from(v.y),
        z: f64::from(v.z),
    };
    orient3d(coord(a), coord(b), coord(c), coord(p))
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Meets {
    Nothing,
    /// An edge or a vertex.
    Rim,
    Inside,
}

/// How a segment with its ends strictly on different sides of a triangle meets it, exactly.
fn exact([a, b, c]: [Vec3; 3], from: Vec3, to: Vec3) -> Meets {
    if side(a, b, c, from) * side(a, b, c, to) >= 0.0 {
        return Meets::Nothing;
    }
    let signs =
        [[a, b], [b, c], [c, a]].map(|[p, q]| side(from, to, p, q).partial_cmp(&0.0).unwrap());
    let all = |s: std::cmp::Ordering| signs.iter().all(|x| *x == s || x.is_eq());
    if signs.iter().all(|s| *s == signs[0]) && signs[0].is_ne() {
        Meets::Inside
    } else if all(std::cmp::Ordering::Less) || all(std::cmp::Ordering::Greater) {
        Meets::Rim
    } else {
        Meets::Nothing
    }
}

fn blocked(geometry: &Geometry, segments: &[(Vec3, Vec3)]) -> Vec<bool> {
    let (mut packet, mut out) = (Packet::default(), [0.0; 16]);
    for (lane, (from, to)) in segments.iter().enumerate() {
        packet.set(lane, *from, *to);
    }
    let active = u16::MAX >> (16 - segments.len());
    let occluders = geometry.occluders();
    occluders.transmittance(&packet, active, &mut Vec::new(), &mut out);
    out[..segments.len()].iter().map(|t| *t == 0.0).collect()
}

#[test]
fn segments_on_a_lattice_are_blocked_by_what_they_cross_and_by_nothing_else() {
    let mut random = Random(7);
    let mut seen = [0; 3];
    for round in 0..300 {
        let m = [3, 5, 9, 17][round % 4];
        let count = 1 + random.below(40);
        let vertices: Vec<_> = (0..3 * count).map(|_| random.lattice(m)).collect();
        let faces: Vec<_> = (0..count).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        if vertices.iter().all(|v| *v == vertices[0]) {
            continue;
        }
        let geometry = scene(&[(&vertices, &faces, OPAQUE)], 16.0);
        let mut point = || geometry.frame.to_local(random.lattice(m)).as_vec3();
        for packet in 0..30 {
            let shared = point();
            let mut segment = |lane| {
                let from = if packet % 2 == 0 { shared } else { point() };
                let far = if lane == 15 { 1024.0 } else { 1.0 };
                (from, far * point())
            };
            let segments: Vec<_> = (0..16).map(&mut segment).collect();
            for ((from, to), got) in segments.iter().zip(blocked(&geometry, &segments)) {
                let corners = || (0..count as u32).map(|f| geometry.corners(f));
                let meets: Vec<_> = corners().map(|c| exact(c, *from, *to)).collect();
                let best = [Meets::Inside, Meets::Rim, Meets::Nothing]
                    .into_iter()
                    .position(|m| meets.contains(&m))
                    .unwrap();
                seen[best] += 1;
                match best {
                    0 => assert!(got, "{from} to {to} passes {meets:?}"),
                    2 => assert!(!got, "{from} to {to} is stopped by nothing"),
                    _ => {}
                }
            }
        }
    }
    assert!(seen.iter().all(|n| *n > 10_000), "{seen:?}");
}

#[test]
fn no_segment_on_a_lattice_enters_a_closed_body_through_its_edges_or_vertices() {
    // Octahedra cut into 2 × 2 × 2 coarser or finer lattice triangles, and boxes with any diagonals.
    let mut random = Random(3);
    let mut through_rims = 0;
    for round in 0..60u64 {
        let s = 4.0;
        let (mut vertices, mut faces) = (Vec::new(), Vec::new());
        let n = 1 + round % 4;
        let step = 2.0 * s / n as f64;
        for axis in 0..3 {
            for far in [-s, s] {
                for i in 0..n {
                    for j in 0..n {
                        let corner = |di: u64, dj: u64| {
                            let (a, b) = ((i + di) as f64 * step - s, (j + dj) as f64 * step - s);
                            let mut p = [0.0; 3];
                            p[axis] = far;
                            p[(axis + 1) % 3] = a;
                            p[(axis + 2) % 3] = b;
                            let p = DVec3::from_array(p);
                            // Every other body is an octahedron-like one, with slanted faces.
                            if round % 2 == 0 {
                                p
                            } else {
                                p / p.abs().element_sum() * 12.0
                            }
                        };
                        let first = vertices.len() as i64;
                        vertices.extend([corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)]);
                        let quad = if random.bits() & 1 == 0 {
                            [[0, 1, 2], [0, 2, 3]]
                        } else {
                            [[0, 1, 3], [1, 2, 3]]
                        };
                        faces.extend(quad.map(|f: [i64; 3]| f.map(|k| k + first)));
                    }
                }
            }
        }
        let geometry = scene(&[(&vertices, &faces, OPAQUE)], 16.0);
        let local = |p: DVec3| geometry.frame.to_local(p).as_vec3();
        for _ in 0..100 {
            let mut segments = Vec::new();
            while segments.len() < 16 {
                let inner = random.lattice(3) - 1.0;
                let outer =
                    (random.lattice(33) - 16.0) * if random.below(4) == 0 { 1e6 } else { 1.0 };
                if outer.abs().max_element() > 12.0 {
                    let (a, b) = (local(inner), local(outer));
                    segments.push(if random.bits() & 1 == 0 {
                        (a, b)
                    } else {
                        (b, a)
                    });
                }
            }
            let rims = segments.iter().filter(|(a, b)| {
                (0..faces.len() as u32).any(|f| exact(geometry.corners(f), *a, *b) == Meets::Rim)
            });
            through_rims += rims.count();
            for (segment, got) in segments.iter().zip(blocked(&geometry, &segments)) {
                assert!(got, "round {round}: {segment:?} leaks");
            }
        }
    }
    assert!(through_rims > 2000, "{through_rims}");
}

#[test]
fn a_triangle_seen_edge_on_does_not_stop_a_segment_that_passes_beside_it() {
    // Segments that lie in a triangle's plane, but for rounding, and miss the triangle by far.
    let mut random = Random(11);
    let mut wrong = Vec::new();
    for _ in 0..5000 {
        let mut jitter = |x: f64, by: f64| x + by * (2.0 * random.unit() - 1.0);
        let e1 = vec(1.0, jitter(0.0, 0.3), jitter(0.6, 0.2));
        let e2 = vec(jitter(0.0, 0.2), 1.0, jitter(-0.5, 0.2));
        let at = |x: f64, y: f64| e1 * x + e2 * y;
        let corners = [(-0.5, -0.6), (0.5, 0.4), (0.4, -0.6)];
        let corners = corners.map(|(x, y)| at(jitter(x, 0.05), jitter(y, 0.05)));
        let (from, to) = (at(-0.5, jitter(-0.15, 0.05)), at(jitter(0.15, 0.05), 0.5));
        let geometry = scene(&[(&corners, &[[0, 1, 2]], OPAQUE)], 2.0);
        let [from, to] = [from, to].map(|p| geometry.frame.to_local(p).as_vec3());
        if exact(geometry.corners(0), from, to) == Meets::Nothing
            && blocked(&geometry, &[(from, to)])[0]
        {
            wrong.push((geometry.corners(0), from, to));
        }
    }
    assert!(
        wrong.is_empty(),
        "{} of 5000, first {:?}",
        wrong.len(),
        wrong[0]
    );
}

// ---- culling ----

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
        let at = Receivers::from_points(&geometry, &points, given).unwrap();
        let light = random_light(&mut random);
        let n = [16, 100, 256][round % 3];
        let (differ, partly) = culling(&geometry, light, &at, n);
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
            let at = Receivers::from_points(&geometry, &points, given).unwrap();
            let (differ, penumbra) = culling(&geometry, light, &at, 256);
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
                let at = Receivers::from_points(&geometry, &points, given).unwrap();
                let (differ, penumbra) = culling(&geometry, light, &at, 256);
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
        let at = Receivers::from_points(&geometry, &points, None).unwrap();
        let (differ, _) = culling(&geometry, light, &at, 256);
        assert_eq!(differ, 0, "{step}");
    }
}

// ---- extremes ----

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
            let at = Receivers::from_points(&geometry, &points, given.map(|n| &n[..])).unwrap();
            for distance in [0.0, 1e-3, 1.0, 1e3, 1e6] {
                for size in [0.0, 1e-30, 1e-5, 0.1, 1.0, 1e3, 1e6] {
                    for light in lights_at(distance, size) {
                        let case = format!("{light:?} and receivers {far} away");
                        let [a, b] =
                            [true, false].map(|cull| shade(&geometry, light, &at, 33, cull));
                        assert_eq!(bits(&a.visibility), bits(&b.visibility), "{case}");
                        assert!(
                            b.visibility.iter().all(|v| (0.0..=1.0).contains(v)),
                            "{case}"
                        );
                        let (a, b) = (a.irradiance.unwrap(), b.irradiance.unwrap());
                        assert_eq!(bits(&a), bits(&b), "{case}");
                        assert!(
                            b.iter().all(|e| e.is_finite() && *e >= 0.0),
                            "{case}: {b:?}"
                        );
                        let control = Control::default();
                        let hard = Hard.prepare(geometry.clone(), &[light], &control).unwrap();
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
    let at = Receivers::from_points(&geometry, &[DVec3::ZERO], Some(&[DVec3::Z])).unwrap();
    for distance in [1e3, 1e6, 1e9, 1e10, 1.5e11] {
        let (c, r) = (vec(0.0, 0.0, distance), 0.00465 * distance);
        for light in [
            Light::disk(c, -DVec3::Z, r, [1.0; 3]).unwrap(),
            Light::sphere(c, r, [1.0; 3]).unwrap(),
        ] {
            let got = f64::from(shade(&geometry, light, &at, 64, true).irradiance.unwrap()[0]);
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
            let geometry = one.geometry().unwrap();
            let k = [8.0, 0.0, 0.0, 0.0, 8.0, 0.0, 4.0, 4.0, 1.0];
            let pose = DMat3::from_diagonal(vec(1.0, -1.0, -1.0));
            let eye = scale * vec(0.25, 0.25, 1.0);
            let camera = Camera::new(DMat3::from_cols_array(&k), pose, eye, 8, 8).unwrap();
            let local = camera.to_local(&geometry.frame);
            let (_, seen) = from_camera(&geometry, &local, &Control::default()).unwrap();
            assert!(seen.len() > 20, "{}", seen.len());
            let light = Light::sphere(scale * vec(0.2, 0.2, 1.0), 0.1 * scale, [1.0; 3]).unwrap();
            let out = shade(&geometry, light, &seen, 16, true);
            assert!(out.visibility.iter().all(|v| *v == 1.0), "scale {scale}");
        }
    }
}

#[test]
fn bad_input_is_an_error_and_not_a_panic() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let geometry = scene(&[(&corners, &[[0, 1, 2]], OPAQUE)], 1.0);
    let points = [DVec3::ZERO, DVec3::X];
    assert!(Receivers::from_points(&geometry, &points, Some(&[DVec3::Z])).is_err());
    let mut huge = Scene::default();
    let bounds = [DVec3::splat(1e308), DVec3::splat(-1e308)];
    huge.add_spheres("s", &bounds, &[1e308, 1e308], OPAQUE)
        .unwrap();
    assert!(huge.geometry().is_err());
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
        let sampler = Sampler::new(light, 0, Pattern::new(n, seed), false);
        let mut out = LightSamples::default();
        sampler.fill(index, p, DVec3::Z, &mut out);
        out.find_cells();
        prop_assert!(out.cells.iter().flatten().all(|c| usize::from(*c) < GRID * GRID));
        let (low, high) = light.bounds();
        let slack = 1e-5;
        for i in 0..out.count {
            let q = out.point(i).as_dvec3();
            prop_assert!(q.cmpge(low - slack).all() && q.cmple(high + slack).all(), "{q}");
            if let Shape::Sphere { radius, .. } = light.shape {
                let inside = p.distance(c) <= radius;
                prop_assert!(inside || (q.distance(c) - radius).abs() < 1e-4 * (1.0 + radius), "{q}");
            }
        }
        prop_assert!(out.weights.iter().flat_map(|r| r.0).all(|w| w.is_finite() && w >= 0.0));
    }
}

// ---- the rasteriser ----

struct Count(HashMap<(u32, u32), Vec<u32>>);

impl Sink for Count {
    fn span(&mut self, x: u32, y: u32, mask: u8, inverse: &[f64; SPAN], triangle: u32) {
        for i in (0..SPAN as u32).filter(|i| mask >> i & 1 == 1) {
            assert!(inverse[i as usize].is_finite() && inverse[i as usize] > 0.0);
            self.0.entry((x + i, y)).or_default().push(triangle);
        }
    }
}

const SIZE: u32 = 64;

fn pixels(positions: &[Vec3], faces: &[[u32; 3]]) -> HashMap<(u32, u32), Vec<u32>> {
    let k = [64.0, 0.0, 0.0, 0.0, 64.0, 0.0, 32.0, 32.0, 1.0];
    let size = i64::from(SIZE);
    let k = DMat3::from_cols_array(&k);
    let camera = Camera::new(k, DMat3::IDENTITY, DVec3::ZERO, size, size).unwrap();
    let make = |_| Count(HashMap::new());
    let tiles = rasterize(
        positions,
        faces,
        |_| true,
        &camera,
        &Control::default(),
        make,
    );
    tiles.unwrap().into_iter().flat_map(|(_, s)| s.0).collect()
}

/// A fan around a pixel's centre that covers the image, its rim on a coarse lattice.
fn fan(random: &mut Random, depth: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut center = || (random.below(20) as f32 + 20.5 - 32.0) / 64.0 * depth;
    let hub = Vec3::new(center(), center(), depth);
    let n = 5 + random.below(6) as u32;
    let mut positions = vec![hub];
    for k in 0..n {
        let angle = (f64::from(k) + 0.8 * random.unit()) / f64::from(n) * TAU;
        let r = 20.0 + random.below(4) as f64;
        let snap = |x: f64| ((x * 8.0).round() / 8.0) as f32;
        positions.push(hub + Vec3::new(snap(r * angle.cos()), snap(r * angle.sin()), 0.0));
    }
    let faces = (0..n).map(|k| [0, 1 + k, 1 + (k + 1) % n]).collect();
    (positions, faces)
}

#[test]
fn random_fans_cover_every_pixel_once_also_across_the_near_plane() {
    let mut random = Random(3);
    for round in 0..500 {
        let depth = 1.0 + (round % 64) as f32 / 16.0;
        let (mut positions, mut faces) = fan(&mut random, depth);
        if round % 2 == 0 {
            // The rim comes towards the eye and past it: a cone around it, whose inside fills the image.
            for p in &mut positions[1..] {
                p.z -= [2.0, 6.0, 8.0][round / 2 % 3];
            }
        }
        for f in &mut faces {
            if random.bits() & 1 == 0 {
                f.swap(1, 2);
            }
        }
        let hits = pixels(&positions, &faces);
        assert_eq!(hits.len(), (SIZE * SIZE) as usize, "round {round}");
        assert!(hits.values().all(|h| h.len() == 1), "round {round}");
    }
}

#[test]
fn a_spoke_split_by_a_triangle_without_area_leaves_no_crack() {
    let mut random = Random(3);
    let mut cracks = Vec::new();
    for _ in 0..1000 {
        let depth = 1.0 + random.below(64) as f32 / 16.0;
        let (mut positions, faces) = fan(&mut random, depth);
        let mut split = Vec::new();
        for [hub, a, b] in faces {
            if a % 2 == 0 {
                split.push([hub, a, b]);
                continue;
            }
            let middle = positions.len() as u32;
            positions.push(0.5 * (positions[0] + positions[a as usize]));
            split.extend([[hub, middle, b], [middle, a, b], [hub, a, middle]]);
        }
        let hits = pixels(&positions, &split);
        let all = (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE));
        cracks.extend(all.filter(|p| !hits.contains_key(p)));
    }
    // A pixel may be hit twice: rounding can fold the split triangle over its neighbour.
    assert!(
        cracks.is_empty(),
        "{} pixels, {:?}",
        cracks.len(),
        cracks[0]
    );
}
