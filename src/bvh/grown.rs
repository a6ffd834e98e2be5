//! One traversal of a tree whose boxes are grown along the segments, for what lies around them.
//!
//! Where a segment has gone the fraction `t` of its way, every box is wider by `t · spread` along each
//! axis, so that it is entered if something in it lies in the segment's cone: `|p - o - t d| ≤ t · spread`
//! for a point `p` of the box and a `t` in [0, 1]. On each axis that is two half-lines of `t`, with the
//! slopes `d + spread` and `d - spread`; without spread they are the slabs of [`super::packet`], and the
//! boxes are widened by the same slack, so that a traversal here visits what that one visits. A visitor
//! may narrow the cones as it finds what it looks for.

use fearless_simd::{f32x16, prelude::*};
use glam::Vec3;

use super::packet::{Packet, SLAB_SLACK, Stack, TINY, along, box_slack};
use super::tree::{Node, Tree};
use crate::simd::{Lanes, Row};

/// What is done with the leaves that segments' cones enter.
pub(crate) trait Leaves {
    /// Looks at primitives `first..last` for the segments in `active`; returns those that go on.
    fn visit(&mut self, first: usize, last: usize, active: u16) -> u16;

    /// By what the spread is to be multiplied from here on, if that has changed.
    fn narrowed(&mut self) -> Option<&Row>;
}

/// Segments' cones, for box tests.
struct Cones<S: Simd> {
    /// Origins moved down and up by the slack.
    low: [f32x16<S>; 3],
    high: [f32x16<S>; 3],
    /// One over the slopes of the cone's upper and lower side.
    upper: [f32x16<S>; 3],
    lower: [f32x16<S>; 3],
    /// Infinity where the half-line of that side starts at its quotient, minus infinity where it ends.
    upper_starts: [f32x16<S>; 3],
    lower_starts: [f32x16<S>; 3],
}

#[inline(always)]
fn cones<S: Simd>(
    simd: S,
    packet: &Packet,
    spread: &[Row; 3],
    scale: &Row,
    slack: f32,
) -> Cones<S> {
    let zero = f32x16::splat(simd, 0.0);
    let slack = f32x16::splat(simd, slack);
    let mut out = Cones {
        low: [zero; 3],
        high: [zero; 3],
        upper: [zero; 3],
        lower: [zero; 3],
        upper_starts: [zero; 3],
        lower_starts: [zero; 3],
    };
    for (k, wide) in spread.iter().enumerate() {
        let origin = packet.origin[k].load(simd);
        (out.low[k], out.high[k]) = (origin - slack, origin + slack);
        let (d, wide) = (along(simd, packet, k), wide.load(simd) * scale.load(simd));
        let one = f32x16::splat(simd, 1.0);
        let (upper, lower) = (not_zero(simd, d + wide), not_zero(simd, d - wide));
        (out.upper[k], out.lower[k]) = (one / upper, one / lower);
        let (up, down) = (
            f32x16::splat(simd, f32::INFINITY),
            f32x16::splat(simd, f32::NEG_INFINITY),
        );
        out.upper_starts[k] = zero.simd_lt(upper).select(up, down);
        out.lower_starts[k] = lower.simd_lt(zero).select(up, down);
    }
    out
}

/// A value, at least [`TINY`] away from zero.
#[inline(always)]
fn not_zero<S: Simd>(simd: S, x: f32x16<S>) -> f32x16<S> {
    x.abs().simd_lt(TINY).select(f32x16::splat(simd, TINY), x)
}

/// Segments whose cones may meet the box.
#[inline(always)]
fn enter<S: Simd>(simd: S, node: &Node, cones: &Cones<S>) -> u16 {
    let (mut near, mut far) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
    for k in 0..3 {
        let a = (node.min[k] - cones.high[k]) * cones.upper[k];
        let b = (node.max[k] - cones.low[k]) * cones.lower[k];
        near = near
            .greater(a.lesser(cones.upper_starts[k]))
            .greater(b.lesser(cones.lower_starts[k]));
        far = far
            .lesser(a.greater(cones.upper_starts[k]))
            .lesser(b.greater(cones.lower_starts[k]));
    }
    near.le(far * SLAB_SLACK)
}

/// How far a box's middle lies off a segment, squared, over how far along it.
fn off_axis(node: &Node, from: Vec3, to: Vec3) -> f32 {
    let d = to - from;
    let c = 0.5 * (Vec3::from(node.min) + Vec3::from(node.max)) - from;
    let along = c.dot(d);
    let square = c.length_squared() * d.length_squared() / (along * along);
    if along > 0.0 { square } else { f32::INFINITY }
}

/// Shows `leaves` what the cones of the segments in `active` enter, nearer children first.
#[inline(always)]
pub(crate) fn traverse<S: Simd, L: Leaves>(
    simd: S,
    tree: &Tree,
    packet: &Packet,
    spread: &[Row; 3],
    leaves: &mut L,
    mut active: u16,
    stack: &mut Stack,
) {
    let nodes = &tree.nodes[..];
    let stack = &mut stack.nodes;
    if nodes.is_empty() {
        return;
    }
    let slack = box_slack(packet, active);
    let mut around = cones(
        simd,
        packet,
        spread,
        leaves.narrowed().unwrap_or(&Row([1.0; crate::simd::LANES])),
        slack,
    );
    stack.clear();
    stack.reserve(tree.depth + 1);
    if enter(simd, &nodes[0], &around) & active == 0 {
        return;
    }
    let mut current = 0u32;
    loop {
        let node = &nodes[current as usize];
        if node.count > 0 {
            let first = node.first as usize;
            active = leaves.visit(first, first + node.count as usize, active);
            if active == 0 {
                return;
            }
            if let Some(scale) = leaves.narrowed() {
                around = cones(simd, packet, spread, scale, slack);
            }
        } else {
            let (left, right) = (current + 1, node.first);
            let in_left = enter(simd, &nodes[left as usize], &around) & active;
            let in_right = enter(simd, &nodes[right as usize], &around) & active;
            if in_left != 0 || in_right != 0 {
                // The child that more segments enter first, or that lies closer around one of them: it is
                // more likely to end them all or to narrow their cones.
                let (l, r) = (in_left.count_ones(), in_right.count_ones());
                let left_first = if l == r {
                    let lane = active.trailing_zeros() as usize;
                    let (from, to) = (packet.origin(lane), packet.target(lane));
                    let off = |child: u32| off_axis(&nodes[child as usize], from, to);
                    off(left) <= off(right)
                } else {
                    l > r
                };
                let (near, far, both) = if left_first {
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
        // Cones may have become narrower since a node was put there.
        current = loop {
            match stack.pop() {
                Some(next) if enter(simd, &nodes[next as usize], &around) & active != 0 => {
                    break next;
                }
                Some(_) => {}
                None => return,
            }
        };
    }
}
