//! What sixteen segments pass through of transparent triangles, by the tree of eight children a node.
//!
//! Boxes are met as in [`super::any_hit`]. Whether a segment crosses a triangle is a question with an exact answer
//! ([`super::crossing`]), since a product must count every surface once. Most answers are told in single precision:
//! where all signs are beyond what rounding can turn. The others, at edges and edge-on, are asked exactly. So the
//! answer does not depend on the tree, on the way, or on what segments are asked together.

use fearless_simd::{dispatch, prelude::*};

use super::TriangleBvh;
use super::any_hit::{Segments, corner, meet_node, splat, together};
use super::crossed::Crossed;
use super::crossing::Shear;
use super::packet::{Packet, Stack, largest, longest_axes, shear};
use super::wide::{Child, Pack, WIDTH, Wide};
use crate::simd::{LANES, Lanes, Level, detect};

/// What an edge function can be wrong by, over `M (M + Z)`, with `M` the largest sheared x or y and `Z` the largest z. A
/// sheared vertex is off by up to 8 (M + Z) rounding errors (2⁻²⁴): three of the slope and one each of the product, z and
/// two differences. Four products with one such vertex, and the function's own roundings, come to 36.
const EDGE_ERROR: f32 = 64.0 / (1 << 24) as f32;

/// What the distances of the ends from the triangle's plane can be wrong by, over `M (M + Z) R`, with `R` the largest of `Z`
/// and the segment's length: three edge functions times z or the length, twice, and the sums' roundings come to 270.
const SIDE_ERROR: f32 = 512.0 / (1 << 24) as f32;

/// Multiplies `out` by the transmittance of each segment of `active` through triangles, `through[i]` each.
pub(super) fn triangles(
    bvh: &TriangleBvh,
    through: &[f32],
    packet: &Packet,
    active: u16,
    stack: &mut Stack,
    out: &mut [f32; LANES],
) {
    triangles_at(detect(), bvh, through, packet, active, stack, out);
}

fn triangles_at(
    level: Level,
    bvh: &TriangleBvh,
    through: &[f32],
    packet: &Packet,
    active: u16,
    stack: &mut Stack,
    out: &mut [f32; LANES],
) {
    if active == 0 || bvh.wide.nodes.is_empty() {
        return;
    }
    stack.crossed.iter_mut().for_each(Crossed::clear);
    let triangles = Triangles { bvh, through };
    dispatch!(level, simd => all_axes(simd, &triangles, packet, active, stack));
    for (lane, out) in out.iter_mut().enumerate() {
        if active >> lane & 1 == 1 {
            *out *= stack.crossed[lane].product();
        }
    }
}

/// Triangles and what passes each.
struct Triangles<'a> {
    bvh: &'a TriangleBvh,
    through: &'a [f32],
}

/// Groups the segments by their longest axis and traverses once a group; almost always one.
#[inline(always)]
fn all_axes<S: Simd>(
    simd: S,
    triangles: &Triangles<'_>,
    packet: &Packet,
    active: u16,
    stack: &mut Stack,
) {
    let [along_x, along_y, along_z] = longest_axes(simd, packet);
    if along_z & active != 0 {
        traverse::<S, 2>(simd, triangles, packet, along_z & active, stack);
    }
    if along_x & active != 0 {
        traverse::<S, 0>(simd, triangles, packet, along_x & active, stack);
    }
    if along_y & active != 0 {
        traverse::<S, 1>(simd, triangles, packet, along_y & active, stack);
    }
}

#[inline(always)]
fn traverse<S: Simd, const AXIS: usize>(
    simd: S,
    triangles: &Triangles<'_>,
    packet: &Packet,
    active: u16,
    stack: &mut Stack,
) {
    let segments = Segments::<S, AXIS>::new(simd, packet, active);
    let tree: &Wide = &triangles.bvh.wide;
    let (nodes, crossed) = (&mut stack.nodes, &mut stack.crossed);
    nodes.clear();
    let (mut child, mut mask) = (Child::ROOT, active);
    loop {
        if child.is_leaf() {
            let first = tree.firsts[child.place()] as usize;
            let through = &triangles.through[first..first + child.triangles()];
            let pack = &tree.packs[child.place()];
            meet_leaf(simd, pack, through, &segments, mask, crossed);
        } else {
            let node = &tree.nodes[child.place()];
            let (inside, mut any) = meet_node(simd, node, &segments.slabs, mask);
            while any != 0 {
                let k = any.trailing_zeros() as usize % WIDTH;
                any &= any - 1;
                tree.prefetch(node.child[k]);
                nodes.extend([node.child[k].word(), u32::from(inside[k])]);
            }
        }
        let (Some(segments), Some(word)) = (nodes.pop(), nodes.pop()) else {
            return;
        };
        (child, mask) = (Child::from_word(word), segments as u16);
    }
}

/// Counts what the segments cross of a leaf's triangles, each with what passes it.
#[inline(always)]
pub(super) fn meet_leaf<S: Simd, const AXIS: usize>(
    simd: S,
    pack: &Pack,
    through: &[f32],
    segments: &Segments<'_, S, AXIS>,
    mut mask: u16,
    crossed: &mut [Crossed; LANES],
) {
    if together(mask, through.len() as u32) {
        for (k, &through) in through.iter().enumerate() {
            let corners = pack.triangle(k);
            let rays = &segments.rays;
            let sheared = [
                shear(rays, &corners[0]),
                shear(rays, &corners[1]),
                shear(rays, &corners[2]),
            ];
            let passing = Passing::new(sheared, rays.length, mask);
            let mut hit = passing.hit;
            if passing.unsure != 0 {
                hit |= exactly(passing.unsure, |lane| {
                    crosses(pack, k, segments.packet, lane)
                });
            }
            while hit != 0 {
                crossed[hit.trailing_zeros() as usize % LANES].add(through, 1);
                hit &= hit - 1;
            }
        }
        return;
    }
    let all = u16::MAX >> (u16::BITS as usize - through.len());
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize % LANES;
        mask &= mask - 1;
        let corners = [
            corner(simd, pack, 0, lane, segments),
            corner(simd, pack, 1, lane, segments),
            corner(simd, pack, 2, lane, segments),
        ];
        let passing = Passing::new(corners, splat(simd, &segments.length, lane), all);
        let mut hit = passing.hit;
        if passing.unsure != 0 {
            hit |= exactly(passing.unsure, |k| crosses(pack, k, segments.packet, lane));
        }
        while hit != 0 {
            let k = hit.trailing_zeros() as usize;
            crossed[lane].add(through[k], 1);
            hit &= hit - 1;
        }
    }
}

/// Those of some pairs that the exact test lets pass.
#[cold]
#[inline(never)]
fn exactly(mut unsure: u16, crosses: impl Fn(usize) -> bool) -> u16 {
    let mut hit = 0;
    while unsure != 0 {
        let lane = unsure.trailing_zeros() as usize;
        unsure &= unsure - 1;
        hit |= u16::from(crosses(lane)) << lane;
    }
    hit
}

/// Whether one segment crosses one triangle of a pack.
fn crosses(pack: &Pack, triangle: usize, packet: &Packet, lane: usize) -> bool {
    let (from, to) = (packet.origin(lane), packet.target(lane));
    Shear::new(from, to).crosses(&pack.triangle(triangle), from, to)
}

/// What single precision tells of segments and triangles, a pair a lane.
#[derive(Debug, Clone, Copy, Default)]
struct Passing {
    /// The segment crosses the triangle.
    hit: u16,
    /// It may do so.
    unsure: u16,
}

impl Passing {
    /// Tests pairs of `active` by the sheared corners and the segments' extent along their longest axis.
    #[inline(always)]
    fn new<S: Simd, V: Lanes<S>>(corners: [(V, V, V); 3], length: V, active: u16) -> Self {
        let [(ax, ay, az), (bx, by, bz), (cx, cy, cz)] = corners;
        let u = cx * by - cy * bx;
        let v = ax * cy - ay * cx;
        let w = bx * ay - by * ax;
        let across = largest(ax, bx, cx).greater(largest(ay, by, cy));
        let along = largest(az, bz, cz);
        // What is too small for single precision is unsure.
        let least = f32::MIN_POSITIVE;
        let scale = across * (across + along);
        let error = (scale * EDGE_ERROR).greater(least);
        let (low, high) = (u.lesser(v).lesser(w), u.greater(v).greater(w));
        let zero = V::splat(u.token(), 0.0);
        let beside = low.lt(zero - error) & error.lt(high);
        let active = active & !beside;
        if active == 0 {
            return Passing::default();
        }
        let inside = error.lt(low) | high.lt(zero - error);
        let start = u * az + v * bz + w * cz;
        let end = (u + v + w) * length - start;
        let error = (scale * along.greater(length.abs()) * SIDE_ERROR).greater(least);
        let (low, high) = (start.lesser(end), start.greater(end));
        let through = error.lt(low) | high.lt(zero - error);
        let apart = low.lt(zero - error) & error.lt(high);
        let hit = active & inside & through;
        Passing {
            hit,
            unsure: active & !hit & !apart,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::entry::Material;
    use crate::random::Random;
    use crate::scene::Scene;
    use crate::simd::levels;

    /// Triangles of nine opacities, some with corners on a lattice, doubles, and some without an area.
    fn scene(random: &mut Random, size: f64) -> Scene {
        let mut scene = Scene::default();
        for kind in 0..9 {
            let (mut points, mut faces) = (Vec::new(), Vec::new());
            for k in 0..60 {
                let first = points.len() as i64;
                let centre = random.point();
                for _ in 0..3 {
                    points.push(match k % 3 {
                        0 => random.lattice(5) * 0.5 - 1.0,
                        _ => centre + size * random.point(),
                    });
                }
                faces.push([first, first + 1, first + 2]);
                match k % 10 {
                    1 => faces.push([first + 1, first, first + 2]),
                    2 if first > 0 => faces.push([first, first + 1, first - 1]),
                    3 => {
                        points[first as usize + 2] =
                            0.5 * (points[first as usize] + points[first as usize + 1]);
                    }
                    _ => {}
                }
            }
            let looks = Material {
                albedo: [1.0; 3],
                opacity: 0.1 * (kind + 1) as f32 - 0.05,
                casts: true,
                receives: true,
            };
            let name = kind.to_string();
            scene.add_mesh(&name, points, &faces, looks).unwrap();
        }
        scene
    }

    #[test]
    fn transmittance_is_that_of_the_exact_crossings_in_any_packet_and_at_every_level() {
        let mut random = Random(5);
        let (mut stack, mut packet) = (Stack::new(), Packet::default());
        let mut crossings = 0;
        for size in [0.05, 0.5] {
            let geometry = scene(&mut random, size).snapshot().unwrap();
            let (bvh, through) = geometry.occluders().transparent.as_ref().unwrap();
            for round in 0..200 {
                // From one point, in and along the lattice, and from one triangle's plane to another's corner.
                let same = random.point().as_vec3();
                for lane in 0..LANES {
                    let lattice = |random: &mut Random| {
                        let p = random.lattice(5) * 0.5 - 1.0;
                        geometry.frame.to_local(p).as_vec3()
                    };
                    let any = (random.below(bvh.corners.len() as u64)) as usize;
                    let corners = &bvh.corners[any];
                    let (from, to) = match round % 4 {
                        0 => (same, random.point().as_vec3()),
                        1 => (lattice(&mut random), lattice(&mut random)),
                        2 => ((corners[0] + corners[1]) * 0.5, lattice(&mut random)),
                        _ => (same, corners[0]),
                    };
                    packet.set(lane, from, to);
                }
                let mut expected = [0.0; LANES];
                for (lane, expected) in expected.iter_mut().enumerate() {
                    let (from, to) = (packet.origin(lane), packet.target(lane));
                    let shear = Shear::new(from, to);
                    let mut crossed = Crossed::default();
                    // In another order than the tree's.
                    for (corners, &through) in bvh.corners.iter().zip(through).rev() {
                        if shear.crosses(corners, from, to) {
                            crossed.add(through, 1);
                            crossings += 1;
                        }
                    }
                    *expected = crossed.product();
                }
                for (name, level) in levels() {
                    for active in [u16::MAX, 0x0421, 1 << (round % 16)] {
                        let mut out = [1.0; LANES];
                        triangles_at(level, bvh, through, &packet, active, &mut stack, &mut out);
                        for (lane, (out, expected)) in out.iter().zip(&expected).enumerate() {
                            let asked = active >> lane & 1 == 1;
                            let expected = if asked { *expected } else { 1.0 };
                            assert_eq!(*out, expected, "{name}, round {round}, lane {lane}");
                        }
                    }
                }
            }
        }
        assert!(crossings > 10_000, "{crossings}");
    }
}
