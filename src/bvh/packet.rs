//! Sixteen segments at a time against opaque triangles.
//!
//! Boxes are tested against all segments with slabs widened by more than what the triangle test can
//! round (so that no box hides a triangle that the test would have hit), triangles by Woop's test:
//! vertices are sheared so that the segment runs along one axis from the origin, once a vertex and
//! segment, so that triangles that share an edge see the same numbers; the signs of the three edge
//! functions then decide, zero counting as inside on both sides. The sheared products are rounded
//! monotonically, so a sign is right or zero. Segments are grouped by their longest axis.
//!
//! Where along the segment a triangle lies is decided by the signs of `T` and `D - T`, with `T / D` the
//! fraction of the segment: both have the same sign where the ends are on different sides. A sign
//! within its rounding error is taken from `robust::orient3d` instead: `T` has the sign of the origin
//! over the triangle's plane, `D - T` that of the target under it.

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::Vec3;
use robust::{Coord3D, orient3d};

use super::TriangleBvh;
use super::tree::Node;
use crate::simd::{Lanes, Level, Row, detect};

/// By how much boxes are widened, times the largest coordinate. A sheared vertex is off by up to 6
/// rounding errors (2⁻²⁴) of its distance from the origin (three of the shear's product, one of each of the
/// three differences), an edge function that rounds to zero adds 1.4, widening itself 1; the distance is at
/// most twice the coordinate along the longest axis. 12 in the worst case.
const BOX_SLACK: f32 = 16.0 / (1 << 24) as f32;

/// The slab test's own rounding, `1 + 2 γ(3)` (Ize 2013).
pub(super) const SLAB_SLACK: f32 = 1.0 + 8.0 / (1 << 24) as f32;

/// Rounding error of `T` and `D - T` over the product of the largest sheared x, y and z. Inside, the three
/// edge functions have one sign and sum to at most 4 of these products, so that their own rounding, that of
/// the sums with z, and that of z and the segment's length come to 60 · 2⁻²⁴.
const SIDE_ERROR: f32 = 64.0 / (1 << 24) as f32;

/// Smallest direction component that slabs divide by; local coordinates are of order 1.
pub(super) const TINY: f32 = 1e-20;

/// Nodes still to visit; kept between calls so that no traversal allocates.
pub type Stack = Vec<u32>;

/// Sixteen segments in local coordinates.
#[derive(Debug, Clone, Default)]
pub struct Packet {
    pub(super) origin: [Row; 3],
    pub(super) target: [Row; 3],
}

impl Packet {
    /// Sets one segment.
    #[inline]
    pub fn set(&mut self, lane: usize, origin: Vec3, target: Vec3) {
        for axis in 0..3 {
            self.origin[axis].0[lane] = origin[axis];
            self.target[axis].0[lane] = target[axis];
        }
    }

    /// Sets the ends of all segments.
    #[inline]
    pub fn set_targets(&mut self, targets: &[Row; 3]) {
        self.target = *targets;
    }

    /// Starts of all segments.
    pub(crate) fn origins(&self) -> &[Row; 3] {
        &self.origin
    }

    /// Ends of all segments.
    pub(crate) fn targets(&self) -> &[Row; 3] {
        &self.target
    }

    /// Start of a segment.
    pub fn origin(&self, lane: usize) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|k| self.origin[k].0[lane]))
    }

    /// End of a segment.
    pub fn target(&self, lane: usize) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|k| self.target[k].0[lane]))
    }
}

/// Returns which of the segments in `active` an opaque triangle blocks.
pub fn blocked(bvh: &TriangleBvh, packet: &Packet, active: u16, stack: &mut Stack) -> u16 {
    blocked_at(detect(), bvh, packet, active, stack)
}

fn blocked_at(
    level: Level,
    bvh: &TriangleBvh,
    packet: &Packet,
    active: u16,
    stack: &mut Stack,
) -> u16 {
    if bvh.tree.nodes.is_empty() {
        return 0;
    }
    dispatch!(level, simd => all_axes(simd, bvh, packet, active, stack))
}

/// Groups the segments by their longest axis and traverses once a group; almost always one.
#[inline(always)]
fn all_axes<S: Simd>(
    simd: S,
    bvh: &TriangleBvh,
    packet: &Packet,
    active: u16,
    stack: &mut Stack,
) -> u16 {
    let [along_x, along_y, along_z] = longest_axes(simd, packet);
    let mut out = 0;
    if along_z & active != 0 {
        out |= traverse::<S, 2>(simd, bvh, packet, along_z & active, stack);
    }
    if along_x & active != 0 {
        out |= traverse::<S, 0>(simd, bvh, packet, along_x & active, stack);
    }
    if along_y & active != 0 {
        out |= traverse::<S, 1>(simd, bvh, packet, along_y & active, stack);
    }
    out
}

/// The segments whose longest axis is x, y and z; each is in one of the three.
#[inline(always)]
pub(crate) fn longest_axes<S: Simd>(simd: S, packet: &Packet) -> [u16; 3] {
    let x = along(simd, packet, 0).abs();
    let y = along(simd, packet, 1).abs();
    let z = along(simd, packet, 2).abs();
    let along_z = x.le(z) & y.le(z);
    let along_x = !along_z & y.le(x);
    [along_x, !along_z & !along_x, along_z]
}

/// What the box and triangle tests need of segments whose longest axis is this one.
pub(crate) struct Rays<S: Simd, const AXIS: usize> {
    /// Origins moved down and up by the box slack.
    low: [f32x16<S>; 3],
    high: [f32x16<S>; 3],
    inverse: [f32x16<S>; 3],
    /// Origins in the order of the sheared axes.
    origin: [f32x16<S>; 3],
    shear: [f32x16<S>; 2],
    /// Extent along the longest axis.
    pub(crate) length: f32x16<S>,
}

impl<S: Simd, const AXIS: usize> Rays<S, AXIS> {
    /// Axes in cyclic order, the longest last. Constant, since choosing a coordinate while running would cost
    /// the triangle test more than its arithmetic.
    pub(crate) const AXES: [usize; 3] = [(AXIS + 1) % 3, (AXIS + 2) % 3, AXIS];
}

#[inline(always)]
fn traverse<S: Simd, const AXIS: usize>(
    simd: S,
    bvh: &TriangleBvh,
    packet: &Packet,
    mut active: u16,
    stack: &mut Stack,
) -> u16 {
    let rays = prepare::<S, AXIS>(simd, packet, active);
    let nodes = &bvh.tree.nodes[..];
    let mut found = 0;
    stack.clear();
    stack.reserve(bvh.tree.depth + 1);
    if enter(simd, &nodes[0], &rays) & active == 0 {
        return 0;
    }
    let mut current = 0u32;
    loop {
        let node = &nodes[current as usize];
        if node.count > 0 {
            for k in node.first..node.first + node.count {
                let hit = triangle(&bvh.corners[k as usize], packet, &rays, active);
                found |= hit;
                active &= !hit;
                if active == 0 {
                    return found;
                }
            }
        } else {
            let (left, right) = (current + 1, node.first);
            let in_left = enter(simd, &nodes[left as usize], &rays) & active;
            let in_right = enter(simd, &nodes[right as usize], &rays) & active;
            if in_left != 0 || in_right != 0 {
                // The child that more segments enter first: it is more likely to end them all.
                let (near, far, both) = if in_left.count_ones() >= in_right.count_ones() {
                    (left, right, in_right != 0)
                } else {
                    (right, left, in_left != 0)
                };
                if both {
                    stack.push(far);
                }
                current = near;
                continue;
            }
        }
        match stack.pop() {
            Some(next) => current = next,
            None => return found,
        }
    }
}

// Closures do not inherit the instruction set of the function around them; what is called with lanes
// is a function of its own everywhere here.

/// Extent of the segments along an axis.
#[inline(always)]
pub(super) fn along<S: Simd>(simd: S, packet: &Packet, axis: usize) -> f32x16<S> {
    packet.target[axis].load(simd) - packet.origin[axis].load(simd)
}

/// One over the extent along an axis, finite.
#[inline(always)]
fn inverse<S: Simd>(simd: S, packet: &Packet, axis: usize) -> f32x16<S> {
    let mut row = Row::default();
    row.set(along(simd, packet, axis));
    for x in &mut row.0 {
        *x = if x.abs() < TINY { TINY } else { *x };
    }
    1.0 / row.load(simd)
}

/// By how much boxes are widened.
#[inline(always)]
pub(super) fn box_slack(packet: &Packet, active: u16) -> f32 {
    let mut largest = 1.0f32;
    for row in &packet.origin {
        for (lane, x) in row.0.iter().enumerate() {
            let counts = active >> lane & 1 == 1;
            largest = if counts {
                largest.max(x.abs())
            } else {
                largest
            };
        }
    }
    BOX_SLACK * largest
}

#[inline(always)]
pub(crate) fn prepare<S: Simd, const AXIS: usize>(
    simd: S,
    packet: &Packet,
    active: u16,
) -> Rays<S, AXIS> {
    let axes = Rays::<S, AXIS>::AXES;
    let slack = f32x16::splat(simd, box_slack(packet, active));
    let x = packet.origin[0].load(simd);
    let y = packet.origin[1].load(simd);
    let z = packet.origin[2].load(simd);
    let length = along(simd, packet, AXIS);
    Rays {
        low: [x - slack, y - slack, z - slack],
        high: [x + slack, y + slack, z + slack],
        inverse: [
            inverse(simd, packet, 0),
            inverse(simd, packet, 1),
            inverse(simd, packet, 2),
        ],
        origin: [
            packet.origin[axes[0]].load(simd),
            packet.origin[axes[1]].load(simd),
            packet.origin[axes[2]].load(simd),
        ],
        shear: [
            along(simd, packet, axes[0]) / length,
            along(simd, packet, axes[1]) / length,
        ],
        length,
    }
}

/// A vertex from the segments' origins, sheared so that they run along z.
#[inline(always)]
pub(crate) fn shear<S: Simd, const AXIS: usize>(
    rays: &Rays<S, AXIS>,
    v: &Vec3,
) -> (f32x16<S>, f32x16<S>, f32x16<S>) {
    let [kx, ky, kz] = Rays::<S, AXIS>::AXES;
    let z = v[kz] - rays.origin[2];
    let x = v[kx] - rays.origin[0] - rays.shear[0] * z;
    let y = v[ky] - rays.origin[1] - rays.shear[1] * z;
    (x, y, z)
}

/// Largest of three absolute values.
#[inline(always)]
fn largest<S: Simd>(a: f32x16<S>, b: f32x16<S>, c: f32x16<S>) -> f32x16<S> {
    a.abs().greater(b.abs()).greater(c.abs())
}

/// Segments that may enter the box.
#[inline(always)]
fn enter<S: Simd, const AXIS: usize>(simd: S, node: &Node, rays: &Rays<S, AXIS>) -> u16 {
    let (mut near, mut far) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
    for k in 0..3 {
        let a = (node.min[k] - rays.high[k]) * rays.inverse[k];
        let b = (node.max[k] - rays.low[k]) * rays.inverse[k];
        near = near.greater(a.lesser(b));
        far = far.lesser(a.greater(b));
    }
    near.le(far * SLAB_SLACK)
}

/// Segments of `active` that the triangle blocks.
#[inline(always)]
pub(crate) fn triangle<S: Simd, const AXIS: usize>(
    corners: &[Vec3; 3],
    packet: &Packet,
    rays: &Rays<S, AXIS>,
    active: u16,
) -> u16 {
    let (ax, ay, az) = shear(rays, &corners[0]);
    let (bx, by, bz) = shear(rays, &corners[1]);
    let (cx, cy, cz) = shear(rays, &corners[2]);
    let u = cx * by - cy * bx;
    let v = ax * cy - ay * cx;
    let w = bx * ay - by * ax;
    let zero = f32x16::splat(u.simd, 0.0);
    let inside = (zero.le(u.lesser(v).lesser(w)) | u.greater(v).greater(w).le(zero)) & active;
    if inside == 0 {
        return 0;
    }
    let t = u * az + v * bz + w * cz;
    let rest = (u + v + w) * rays.length - t;
    let reach = largest(az, bz, cz).greater(rays.length.abs());
    let error = largest(ax, bx, cx) * largest(ay, by, cy) * reach * SIDE_ERROR;
    let (low, high) = (t.lesser(rest), t.greater(rest));
    let negative = zero - error;
    let hit = inside & (error.lt(low) | high.lt(negative));
    let miss = low.lt(negative) & error.lt(high);
    let mut unsure = inside & !hit & !miss;
    if unsure != 0 {
        // Edge-on, all three edge functions can round to zero: then the segment may pass far from here.
        let (x0, x1) = (ax.lesser(bx).lesser(cx), ax.greater(bx).greater(cx));
        let (y0, y1) = (ay.lesser(by).lesser(cy), ay.greater(by).greater(cy));
        unsure &= x0.le(zero) & zero.le(x1) & y0.le(zero) & zero.le(y1);
    }
    if unsure == 0 {
        hit
    } else {
        hit | settle(corners, packet, t, rest, error, unsure)
    }
}

/// The exact answer for segments whose rounded one is within its error.
#[inline(always)]
fn settle<S: Simd>(
    corners: &[Vec3; 3],
    packet: &Packet,
    t: f32x16<S>,
    rest: f32x16<S>,
    error: f32x16<S>,
    mut unsure: u16,
) -> u16 {
    let (mut t_row, mut rest_row, mut error_row) = (Row::default(), Row::default(), Row::default());
    t_row.set(t);
    rest_row.set(rest);
    error_row.set(error);
    let mut hit = 0;
    // Segments of one receiver share their origin: its side is found once.
    let mut known: Option<(Vec3, f64)> = None;
    while unsure != 0 {
        let lane = unsure.trailing_zeros() as usize;
        unsure &= unsure - 1;
        let (t, rest, error) = (t_row.0[lane], rest_row.0[lane], error_row.0[lane]);
        // Where even the triangle's orientation is in doubt, both ends are asked exactly: a rounded side and an
        // exact one could speak of two different triangles.
        let oriented = (t + rest).abs() > error;
        let from = if oriented && t.abs() > error {
            f64::from(t)
        } else {
            let origin = packet.origin(lane);
            match known {
                Some((p, side)) if p == origin => side,
                _ => {
                    let side = -plane_side(corners, origin);
                    known = Some((origin, side));
                    side
                }
            }
        };
        let to = if oriented && rest.abs() > error {
            f64::from(rest)
        } else {
            plane_side(corners, packet.target(lane))
        };
        hit |= u16::from((from > 0.0 && to > 0.0) || (from < 0.0 && to < 0.0)) << lane;
    }
    hit
}

/// Exact side of `p`: positive under the triangle (which runs counter-clockwise seen from above).
pub(super) fn plane_side(corners: &[Vec3; 3], p: Vec3) -> f64 {
    let coord = |v: Vec3| Coord3D {
        x: f64::from(v.x),
        y: f64::from(v.y),
        z: f64::from(v.z),
    };
    orient3d(
        coord(corners[0]),
        coord(corners[1]),
        coord(corners[2]),
        coord(p),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::tree::Tree;
    use crate::simd::{LANES, levels};
    use std::sync::OnceLock;

    struct Random(u64);

    impl Random {
        fn bits(&mut self) -> u64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        }

        /// A number in [-1, 1).
        fn number(&mut self) -> f32 {
            (self.bits() >> 40) as f32 / (1 << 23) as f32 - 1.0
        }

        fn point(&mut self) -> Vec3 {
            Vec3::new(self.number(), self.number(), self.number())
        }
    }

    fn bvh(triangles: &[[Vec3; 3]], boxed: bool) -> TriangleBvh {
        let bounds = |[a, b, c]: &[Vec3; 3]| (a.min(*b).min(*c), a.max(*b).max(*c));
        let mut tree = Tree::new(&triangles.iter().map(bounds).collect::<Vec<_>>());
        if !boxed {
            tree.order = (0..triangles.len() as u32).collect();
            tree.depth = 1;
            tree.nodes = vec![Node {
                min: [f32::MIN; 3],
                first: 0,
                max: [f32::MAX; 3],
                count: triangles.len() as u32,
            }];
        }
        TriangleBvh {
            corners: tree.order.iter().map(|&i| triangles[i as usize]).collect(),
            faces: tree.order.clone(),
            tree,
            outline: OnceLock::new(),
        }
    }

    fn soup(random: &mut Random, count: usize, size: f32) -> Vec<[Vec3; 3]> {
        let one = |_| {
            let p = random.point();
            [(); 3].map(|()| (p + size * random.point()).clamp(Vec3::NEG_ONE, Vec3::ONE))
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
            let bvh = bvh(&triangles, true);
            let mut packet = Packet::default();
            for lane in 0..LANES {
                let mut pick = |n: usize| random.bits() as usize % n;
                let (t, kind, far) = (triangles[pick(triangles.len())], pick(4), pick(3));
                let (odd, axis, which) = (pick(16), pick(3), pick(special.len()));
                let from = if round % 2 == 0 {
                    packet.origin(0)
                } else {
                    random.point()
                };
                let through = match kind {
                    0 => t[0],
                    1 => 0.5 * (t[0] + t[1]),
                    2 => (t[0] + t[1] + t[2]) / 3.0,
                    _ => random.point(),
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
            let fallback = blocked_at(first.1, &bvh, &packet, u16::MAX, &mut stack);
            hits += fallback.count_ones();
            for (name, level) in others {
                let got = blocked_at(*level, &bvh, &packet, u16::MAX, &mut stack);
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
                let from = random.point().signum() * far * (1.0 - 0.01 * random.number().abs());
                let through = t[0].lerp(t[1], random.number().abs());
                let to = through + (through - from) * (0.01 + random.number().abs());
                packet.set(lane, from, to);
            }
            let [boxed, all] = [true, false]
                .map(|boxed| blocked(&bvh(&triangles, boxed), &packet, u16::MAX, &mut stack));
            hits += all.count_ones();
            assert_eq!(boxed, all, "round {round}");
        }
        assert!(hits > 50_000, "{hits}");
    }

    #[test]
    fn a_triangle_seen_edge_on_blocks_nothing_beside_it() {
        // All edge functions round to zero, and the plane separates the ends by rounding.
        let mut random = Random(9);
        let mut stack = Stack::new();
        let mut packet = Packet::default();
        packet.set(0, Vec3::NEG_Z, Vec3::Z);
        for _ in 0..20_000 {
            let a = 0.5 * random.point() + Vec3::new(0.6, 0.6, 0.0);
            let mut along = || {
                let k = 1.0 + random.number().abs();
                Vec3::new(a.x * k, a.y * k, random.number())
            };
            let triangle = [a, along(), along()];
            let bvh = bvh(&[triangle], false);
            assert_eq!(blocked(&bvh, &packet, 1, &mut stack), 0, "{triangle:?}");
        }
    }
}
