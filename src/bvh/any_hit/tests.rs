use super::*;
use crate::bvh::tree::Tree;
use crate::random::Random;
use crate::simd::{LANES, levels};

/// In [-1, 1].
fn number(random: &mut Random) -> f32 {
    random.number() as f32
}

fn point(random: &mut Random) -> Vec3 {
    random.point().as_vec3()
}

fn wide(triangles: &[[Vec3; 3]]) -> Wide {
    let bounds = |[a, b, c]: &[Vec3; 3]| (a.min(*b).min(*c), a.max(*b).max(*c));
    let tree = Tree::new(&triangles.iter().map(bounds).collect::<Vec<_>>());
    let corners: Vec<_> = tree.order.iter().map(|&i| triangles[i as usize]).collect();
    Wide::new(&tree, &corners)
}

fn blocked(tree: &Wide, packet: &Packet, active: u16, stack: &mut Stack) -> u16 {
    blocked_at(detect(), tree, packet, active, stack)
}

/// What blocks without boxes: all segments against each triangle.
fn without_boxes(triangles: &[[Vec3; 3]], packet: &Packet) -> u16 {
    dispatch!(detect(), simd => {
        let axes = longest_axes(simd, packet);
        let rays = (prepare::<_, 0>(simd, packet), prepare::<_, 1>(simd, packet), prepare::<_, 2>(simd, packet));
        triangles.iter().fold(0, |found, t| {
            found
                | triangle(t, packet, &rays.0, axes[0])
                | triangle(t, packet, &rays.1, axes[1])
                | triangle(t, packet, &rays.2, axes[2])
        })
    })
}

fn soup(random: &mut Random, count: usize, size: f32) -> Vec<[Vec3; 3]> {
    let one = |_| {
        let p = point(random);
        [(); 3].map(|()| (p + size * point(random)).clamp(Vec3::NEG_ONE, Vec3::ONE))
    };
    (0..count).map(one).collect()
}

#[test]
fn all_levels_agree_also_on_segments_that_are_not_finite() {
    let mut random = Random(1);
    let mut stack = Stack::new();
    let special = [f32::INFINITY, f32::NAN, 0.0, 1e30, -1e30, 1e-40];
    let mut hits = 0;
    for round in 0..2000 {
        let triangles = soup(&mut random, 1 + round % 50, [0.05, 0.5, 2.0][round % 3]);
        let tree = wide(&triangles);
        let mut packet = Packet::default();
        for lane in 0..LANES {
            let mut pick = |n: usize| random.bits() as usize % n;
            let (t, kind, far) = (triangles[pick(triangles.len())], pick(4), pick(3));
            let (odd, axis, which) = (pick(16), pick(3), pick(special.len()));
            let from = if round % 2 == 0 {
                packet.origin(0)
            } else {
                point(&mut random)
            };
            let through = match kind {
                0 => t[0],
                1 => 0.5 * (t[0] + t[1]),
                2 => (t[0] + t[1] + t[2]) / 3.0,
                _ => point(&mut random),
            };
            let mut to = from + (through - from) * [1.0, 2.0, 1e6][far];
            match odd {
                0 => to[axis] = special[which],
                1 => to = from,
                _ => {}
            }
            packet.set(lane, from, to);
        }
        let [first, others @ ..] = &levels()[..] else {
            unreachable!("every machine has a level");
        };
        let fallback = blocked_at(first.1, &tree, &packet, u16::MAX, &mut stack);
        hits += fallback.count_ones();
        for (name, level) in others {
            let got = blocked_at(*level, &tree, &packet, u16::MAX, &mut stack);
            assert_eq!(got, fallback, "{name}, round {round}");
        }
    }
    assert!(hits > 5000, "{hits}");
}

#[test]
fn no_box_hides_a_triangle_that_the_test_hits() {
    // Flat boxes seen from beyond the opposite corner, and segments through their borders.
    let mut random = Random(5);
    let mut stack = Stack::new();
    let mut hits = 0;
    for round in 0..10_000 {
        let size = [0.001, 0.05, 1.0, 3.0][round % 4];
        let mut triangles = soup(&mut random, 1 + round % 3, size);
        let (flat, straight) = (round % 3, (round + 1) % 3);
        for t in &mut triangles {
            (t[1][flat], t[2][flat]) = (t[0][flat], t[0][flat]);
            t[1][straight] = t[0][straight];
        }
        let far = [1.0, 1.01, 1.9, 10.0][random.bits() as usize % 4];
        let mut packet = Packet::default();
        for lane in 0..LANES {
            let t = triangles[lane % triangles.len()];
            let from = point(&mut random).signum() * far * (1.0 - 0.01 * number(&mut random).abs());
            let through = t[0].lerp(t[1], number(&mut random).abs());
            let to = through + (through - from) * (0.01 + number(&mut random).abs());
            packet.set(lane, from, to);
        }
        let boxed = blocked(&wide(&triangles), &packet, u16::MAX, &mut stack);
        let all = without_boxes(&triangles, &packet);
        hits += all.count_ones();
        assert_eq!(boxed, all, "round {round}");
    }
    assert!(hits > 50_000, "{hits}");
}

#[test]
fn segments_alone_and_together_get_the_answer_of_the_triangles_alone() {
    // Needles, triangles twice and points for triangles; rays from, along and towards corners, edges and planes.
    let mut random = Random(13);
    let mut stack = Stack::new();
    let mut hits = 0;
    for round in 0..1000 {
        let mut triangles = soup(&mut random, 3 + round % 120, [0.02, 0.2, 1.0][round % 3]);
        for k in (0..triangles.len()).step_by(3) {
            let t = triangles[k];
            match random.bits() % 4 {
                0 => triangles.push(t),
                1 => triangles[k][2] = t[0].lerp(t[1], 0.3),
                2 => triangles[k] = [t[0]; 3],
                _ => triangles.push([t[1], t[0], t[2]]),
            }
        }
        let tree = wide(&triangles);
        let place = |random: &mut Random| {
            let t = triangles[random.bits() as usize % triangles.len()];
            match random.bits() % 5 {
                0 => t[0],
                1 => 0.5 * (t[0] + t[1]),
                2 => (t[0] + t[1] + t[2]) / 3.0,
                3 => t[0] + (t[1] - t[0]) * number(random) + (t[2] - t[0]) * number(random),
                _ => point(random),
            }
        };
        let mut packet = Packet::default();
        let shared = place(&mut random);
        for lane in 0..LANES {
            let from = if round % 2 == 0 {
                shared
            } else {
                place(&mut random)
            };
            let through = place(&mut random);
            let reach = [0.5, 1.0, 3.0][random.bits() as usize % 3];
            packet.set(lane, from, from + (through - from) * reach);
        }
        let expected = without_boxes(&triangles, &packet);
        let together = blocked(&tree, &packet, u16::MAX, &mut stack);
        let alone = (0..LANES).fold(0, |found, lane| {
            found | blocked(&tree, &packet, 1 << lane, &mut stack)
        });
        let few = [0x1111, 0x2222, 0x4444, 0x8888];
        let few = few.map(|lanes| blocked(&tree, &packet, lanes, &mut stack));
        assert_eq!([together, alone], [expected; 2], "round {round}");
        assert_eq!(
            few.iter().fold(0, |all, some| all | some),
            expected,
            "round {round}"
        );
        hits += expected.count_ones();
    }
    assert!(hits > 5000, "{hits}");
}

#[test]
fn a_triangle_seen_edge_on_blocks_nothing_beside_it() {
    // All edge functions round to zero, and the plane separates the ends by rounding.
    let mut random = Random(9);
    let mut stack = Stack::new();
    let mut packet = Packet::default();
    packet.set(0, Vec3::NEG_Z, Vec3::Z);
    for _ in 0..20_000 {
        let a = 0.5 * point(&mut random) + Vec3::new(0.6, 0.6, 0.0);
        let mut along = || {
            let k = 1.0 + number(&mut random).abs();
            Vec3::new(a.x * k, a.y * k, number(&mut random))
        };
        let triangle = [a, along(), along()];
        let tree = wide(&[triangle]);
        assert_eq!(blocked(&tree, &packet, 1, &mut stack), 0, "{triangle:?}");
    }
}
