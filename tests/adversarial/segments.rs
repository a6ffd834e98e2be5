//! Segments that graze edges, vertices and planes: what they cross stops them, and nothing else does.

use glam::{DVec3, Vec3};
use robust::{Coord3D, orient3d};
use softshadow::bvh::packet::{Packet, Stack};
use softshadow::scene::snapshot::Snapshot;

use super::{OPAQUE, Random, scene, vec};

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

fn blocked(geometry: &Snapshot, segments: &[(Vec3, Vec3)]) -> Vec<bool> {
    let (mut packet, mut out) = (Packet::default(), [0.0; 16]);
    for (lane, (from, to)) in segments.iter().enumerate() {
        packet.set(lane, *from, *to);
    }
    let active = u16::MAX >> (16 - segments.len());
    let occluders = geometry.occluders();
    occluders.transmittance(&packet, active, &mut Stack::new(), &mut out);
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
