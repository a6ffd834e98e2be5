//! Which of sixteen segments opaque triangles block, by a tree of eight children a node.
//!
//! A node or a leaf is taken in one of two ways: each of its boxes or triangles against all segments at once, which
//! is the faster one while they are many, or each segment against all boxes or triangles at once, which is so when
//! most of them have gone elsewhere or met something: both are chosen at every node by counting. Segments towards a
//! small light stay together; those in foliage, in hair, or towards a large light do not.
//!
//! Boxes are tested with slabs widened by more than what the triangle test can round, so that no box hides a
//! triangle that the test would have hit: the answer does not depend on the tree, on the way, or on what
//! segments are asked together.

use fearless_simd::{dispatch, f32x8, f32x16, prelude::*};
use glam::Vec3;

use super::TriangleBvh;
use super::packet::{
    Crossing, Packet, Rays, SLAB_SLACK, Stack, TINY, along, box_slack, longest_axes, plane_side,
    prepare, sheared, triangle,
};
use super::wide::{Child, Node, Pack, WIDTH, Wide};
use crate::simd::{Lanes, Level, Row, detect};

/// Segments for each child or triangle above which these are taken one by one: as an instruction takes
/// eight lanes on most machines, it could be two segments for three or four of them.
const SEGMENTS_A_CHILD: (u32, u32) = (5, 4);

/// Returns which of the segments in `active` an opaque triangle blocks.
pub fn blocked(bvh: &TriangleBvh, packet: &Packet, active: u16, stack: &mut Stack) -> u16 {
    blocked_at(detect(), &bvh.wide, packet, active, stack)
}

fn blocked_at(level: Level, tree: &Wide, packet: &Packet, active: u16, stack: &mut Stack) -> u16 {
    if tree.nodes.is_empty() {
        return 0;
    }
    dispatch!(level, simd => all_axes(simd, tree, packet, active, stack))
}

/// Groups the segments by their longest axis and traverses once a group; almost always one.
#[inline(always)]
fn all_axes<S: Simd>(simd: S, tree: &Wide, packet: &Packet, active: u16, stack: &mut Stack) -> u16 {
    let [along_x, along_y, along_z] = longest_axes(simd, packet);
    let mut out = 0;
    if along_z & active != 0 {
        out |= traverse::<S, 2>(simd, tree, packet, along_z & active, stack);
    }
    if along_x & active != 0 {
        out |= traverse::<S, 0>(simd, tree, packet, along_x & active, stack);
    }
    if along_y & active != 0 {
        out |= traverse::<S, 1>(simd, tree, packet, along_y & active, stack);
    }
    out
}

/// What the tests need of segments whose longest axis is this one.
pub(super) struct Segments<'a, S: Simd, const AXIS: usize> {
    pub(super) packet: &'a Packet,
    pub(super) rays: Rays<S, AXIS>,
    /// The same as `rays`, to take one segment of it.
    origin: [Row; 3],
    shear: [Row; 2],
    pub(super) length: Row,
    pub(super) slabs: Slabs,
}

/// What the test of boxes needs of segments.
pub(super) struct Slabs {
    /// For each axis what boxes' lower and upper sides are measured from: origins moved up and down by the slack.
    from: [[Row; 2]; 3],
    inverse: [Row; 3],
}

impl Slabs {
    /// With boxes widened by `slack` along each axis.
    #[inline(always)]
    pub(super) fn new<S: Simd>(simd: S, packet: &Packet, slack: [f32; 3]) -> Self {
        let mut out = Slabs {
            from: [[Row::default(); 2]; 3],
            inverse: [Row::default(); 3],
        };
        for (k, slack) in slack.into_iter().enumerate() {
            let from = packet.origins()[k].load(simd);
            out.from[k][0].set(from + slack);
            out.from[k][1].set(from - slack);
            out.inverse[k].set(inverse(simd, packet, k));
        }
        out
    }
}

impl<'a, S: Simd, const AXIS: usize> Segments<'a, S, AXIS> {
    #[inline(always)]
    pub(super) fn new(simd: S, packet: &'a Packet, active: u16) -> Self {
        let slack = box_slack(packet, active);
        let rays = prepare::<S, AXIS>(simd, packet);
        let mut out = Segments {
            packet,
            origin: [Row::default(); 3],
            shear: [Row::default(); 2],
            length: Row::default(),
            slabs: Slabs::new(simd, packet, [slack; 3]),
            rays,
        };
        for k in 0..3 {
            out.origin[k].set(out.rays.origin[k]);
        }
        for k in 0..2 {
            out.shear[k].set(out.rays.shear[k]);
        }
        out.length.set(out.rays.length);
        out
    }
}

/// One over the extent along an axis, finite.
#[inline(always)]
fn inverse<S: Simd>(simd: S, packet: &Packet, axis: usize) -> f32x16<S> {
    let extent = along(simd, packet, axis);
    let tiny = f32x16::splat(simd, TINY);
    1.0 / extent.abs().simd_lt(TINY).select(tiny, extent)
}

#[inline(always)]
fn traverse<S: Simd, const AXIS: usize>(
    simd: S,
    tree: &Wide,
    packet: &Packet,
    mut active: u16,
    stack: &mut Stack,
) -> u16 {
    let segments = Segments::<S, AXIS>::new(simd, packet, active);
    let (nodes, blocker) = (&mut stack.nodes, &mut stack.blocker);
    let mut found = 0;
    // It may be of another tree: then it is a leaf like any other, if there is one of its number.
    if let Some(leaf) = blocker.map(Child::from_word) {
        if leaf.place() < tree.packs.len() {
            let pack = &tree.packs[leaf.place()];
            found = meet_leaf(simd, pack, leaf.triangles(), &segments, active);
            active &= !found;
            if active == 0 {
                return found;
            }
        }
        if found == 0 {
            *blocker = None;
        }
    }
    nodes.clear();
    let (mut child, mut mask) = (Child::ROOT, active);
    loop {
        if child.is_leaf() {
            let pack = &tree.packs[child.place()];
            let hit = meet_leaf(simd, pack, child.triangles(), &segments, mask);
            if hit != 0 {
                *blocker = Some(child.word());
                found |= hit;
                active &= !hit;
                if active == 0 {
                    return found;
                }
            }
        } else {
            let next = descend(simd, tree, child, &segments.slabs, mask, nodes);
            if let Some(nearest) = next {
                (child, mask) = nearest;
                continue;
            }
        }
        let Some(next) = next_open(nodes, active) else {
            return found;
        };
        (child, mask) = next;
    }
}

/// What [`descend`] has left that segments of `active` have still to visit, and which of them; nothing at the end.
#[inline(always)]
pub(super) fn next_open(nodes: &mut Vec<u32>, active: u16) -> Option<(Child, u16)> {
    loop {
        let (segments, word) = (nodes.pop()?, nodes.pop()?);
        let mask = segments as u16 & active;
        if mask != 0 {
            return Some((Child::from_word(word), mask));
        }
    }
}

/// Puts a node's children that segments may enter on the stack, but for the one that most enter first, and of those
/// the largest: it is most likely to end them all.
#[inline(always)]
pub(super) fn descend<S: Simd>(
    simd: S,
    tree: &Wide,
    child: Child,
    slabs: &Slabs,
    mask: u16,
    nodes: &mut Vec<u32>,
) -> Option<(Child, u16)> {
    let node = &tree.nodes[child.place()];
    let (inside, mut any) = meet_node(simd, node, slabs, mask);
    let mut next = None;
    let mut most = 0;
    while any != 0 {
        let k = any.trailing_zeros() as usize % WIDTH;
        any &= any - 1;
        let (mut other, count) = ((node.child[k], inside[k]), inside[k].count_ones());
        tree.prefetch(other.0);
        if count > most {
            most = count;
            other = match next.replace(other) {
                Some(before) => before,
                None => continue,
            };
        }
        nodes.extend([other.0.word(), u32::from(other.1)]);
    }
    next
}

/// Whether so many segments are better taken together, for each of `count` boxes or triangles.
#[inline(always)]
pub(super) fn together(mask: u16, count: u32) -> bool {
    let (segments, children) = SEGMENTS_A_CHILD;
    mask.count_ones() * children > count * segments
}

/// Segments that may enter each child's box, and the children that any may enter.
#[inline(always)]
pub(super) fn meet_node<S: Simd>(
    simd: S,
    node: &Node,
    slabs: &Slabs,
    mut mask: u16,
) -> ([u16; WIDTH], u32) {
    let mut inside = [0; WIDTH];
    let mut any = 0;
    if together(mask, node.count) {
        for (k, inside) in inside.iter_mut().enumerate().take(node.count as usize) {
            *inside = enter_together(simd, node, k, slabs) & mask;
            any |= u32::from(*inside != 0) << k;
        }
        return (inside, any);
    }
    if mask.is_power_of_two() {
        let lane = mask.trailing_zeros() as usize;
        return ([mask; WIDTH], enter_alone(simd, node, lane, slabs));
    }
    // A byte for each child, a bit for each of eight segments.
    let mut halves = [0u64; 2];
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask - 1;
        let children = enter_alone(simd, node, lane, slabs);
        any |= children;
        halves[lane / 8] |= spread(children) << (lane % 8);
    }
    let [low, high] = halves.map(u64::to_le_bytes);
    for (k, inside) in inside.iter_mut().enumerate() {
        *inside = u16::from_le_bytes([low[k], high[k]]);
    }
    (inside, any)
}

/// Bit `k` of eight as the lowest bit of byte `k`.
#[inline(always)]
fn spread(bits: u32) -> u64 {
    const LOWEST: u64 = 0x0101_0101_0101_0101;
    const LOWER: u64 = 0x7f7f_7f7f_7f7f_7f7f;
    // Every byte has its own bit alone, which a carry takes to the top.
    let own = (u64::from(bits) * LOWEST) & 0x8040_2010_0804_0201;
    ((own + LOWER) | own) >> 7 & LOWEST
}

/// Segments that may enter one child's box.
#[inline(always)]
fn enter_together<S: Simd>(simd: S, node: &Node, child: usize, slabs: &Slabs) -> u16 {
    let (mut near, mut far) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
    for k in 0..3 {
        let inverse = slabs.inverse[k].load(simd);
        let a = (node.planes[k][0][child] - slabs.from[k][0].load(simd)) * inverse;
        let b = (node.planes[k][1][child] - slabs.from[k][1].load(simd)) * inverse;
        near = near.greater(a.lesser(b));
        far = far.lesser(a.greater(b));
    }
    near.le(far * SLAB_SLACK)
}

#[inline(always)]
fn load<S: Simd>(simd: S, lanes: &[f32; WIDTH]) -> f32x8<S> {
    f32x8::load_array_ref(simd, lanes)
}

#[inline(always)]
pub(super) fn splat<S: Simd>(simd: S, row: &Row, lane: usize) -> f32x8<S> {
    f32x8::splat(simd, row.0[lane])
}

/// Children whose boxes one segment may enter.
#[inline(always)]
fn enter_alone<S: Simd>(simd: S, node: &Node, lane: usize, slabs: &Slabs) -> u32 {
    let (mut near, mut far) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
    for k in 0..3 {
        // A segment comes first to the side that its direction's sign tells.
        let first = usize::from(slabs.inverse[k].0[lane].is_sign_negative());
        let last = 1 - first;
        let inverse = splat(simd, &slabs.inverse[k], lane);
        let (planes, from) = (&node.planes[k], &slabs.from[k]);
        near = ((load(simd, &planes[first]) - splat(simd, &from[first], lane)) * inverse)
            .greater(near);
        far = ((load(simd, &planes[last]) - splat(simd, &from[last], lane)) * inverse).lesser(far);
    }
    u32::from(near.le(far * SLAB_SLACK))
}

/// Segments that a leaf's triangles block.
#[inline(always)]
pub(super) fn meet_leaf<S: Simd, const AXIS: usize>(
    simd: S,
    pack: &Pack,
    count: usize,
    segments: &Segments<'_, S, AXIS>,
    mut mask: u16,
) -> u16 {
    let mut found = 0;
    if together(mask, count as u32) {
        for k in 0..count {
            let hit = triangle(&pack.triangle(k), segments.packet, &segments.rays, mask);
            found |= hit;
            mask &= !hit;
            if mask == 0 {
                break;
            }
        }
        return found;
    }
    let mut known = None;
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask - 1;
        let blocked = meet_alone(simd, pack, lane, segments, &mut known);
        found |= u16::from(blocked) << lane;
    }
    found
}

/// The side of a triangle of a pack on which a point is.
type KnownSide = (usize, Vec3, f64);

/// Whether a triangle of a pack blocks one segment; `known`: what was last asked exactly, for segments that
/// start at the same point on one of the triangles.
#[inline(always)]
fn meet_alone<S: Simd, const AXIS: usize>(
    simd: S,
    pack: &Pack,
    lane: usize,
    segments: &Segments<'_, S, AXIS>,
    known: &mut Option<KnownSide>,
) -> bool {
    let corners = [
        corner(simd, pack, 0, lane, segments),
        corner(simd, pack, 1, lane, segments),
        corner(simd, pack, 2, lane, segments),
    ];
    let crossing = Crossing::new(corners, splat(simd, &segments.length, lane), u16::MAX);
    if crossing.hit != 0 {
        return true;
    }
    crossing.unsure != 0 && settle(crossing, pack, segments.packet, lane, known)
}

/// A corner of all triangles, sheared for one segment.
#[inline(always)]
pub(super) fn corner<S: Simd, const AXIS: usize>(
    simd: S,
    pack: &Pack,
    corner: usize,
    lane: usize,
    segments: &Segments<'_, S, AXIS>,
) -> (f32x8<S>, f32x8<S>, f32x8<S>) {
    let [x, y, z] = Rays::<S, AXIS>::AXES;
    let corner = &pack.corners[corner];
    let (origin, shear) = (&segments.origin, &segments.shear);
    sheared(
        [
            load(simd, &corner[x]),
            load(simd, &corner[y]),
            load(simd, &corner[z]),
        ],
        [
            splat(simd, &origin[0], lane),
            splat(simd, &origin[1], lane),
            splat(simd, &origin[2], lane),
        ],
        [splat(simd, &shear[0], lane), splat(simd, &shear[1], lane)],
    )
}

/// The exact answer for triangles in doubt.
#[cold]
#[inline(never)]
fn settle(
    crossing: Crossing,
    pack: &Pack,
    packet: &Packet,
    lane: usize,
    known: &mut Option<KnownSide>,
) -> bool {
    let (origin, target) = (packet.origin(lane), packet.target(lane));
    let start = |k: usize| {
        let side = match *known {
            Some((triangle, point, side)) if triangle == k && point == origin => side,
            _ => plane_side(&pack.triangle(k), origin),
        };
        *known = Some((k, origin, side));
        (0, side)
    };
    crossing.settled(start, |k| plane_side(&pack.triangle(k), target)) != 0
}

#[cfg(test)]
mod tests;
