//! One traversal of a tree whose boxes are grown along the segments, for what lies around them.
//!
//! Where a segment has gone the fraction `t` of its way, every box is wider by `t · spread` along each
//! axis, so that it is entered if something in it lies in the segment's cone: `|p - o - t d| ≤ t · spread`
//! for a point `p` of the box and a `t` in [0, 1]. On each axis that is two half-lines of `t`, with the
//! slopes `d + spread` and `d - spread`; without spread they are the slabs of [`super::packet`], and the
//! boxes are widened by the same slack, so that a traversal here visits what that one visits. A visitor
//! may narrow the cones as it finds what it looks for.

use glam::Vec3;

use super::packet::{Packet, SLAB_SLACK, Stack, TINY, along, box_slack};
use super::tree::{Node, Tree};
use crate::simd::{Lanes, Row};

/// What is done with the leaves that segments' cones enter.
pub(crate) trait Leaves<S> {
    /// Looks at primitives `first..last` for the segments in `active`; returns those that go on.
    ///
    /// # Safety
    /// The caller enabled the features of `S`.
    unsafe fn visit(&mut self, first: usize, last: usize, active: u16) -> u16;

    /// By what the spread is to be multiplied from here on, if that has changed.
    fn narrowed(&mut self) -> Option<&Row>;
}

/// Segments' cones, for box tests.
struct Cones<S> {
    /// Origins moved down and up by the slack.
    low: [S; 3],
    high: [S; 3],
    /// One over the slopes of the cone's upper and lower side.
    upper: [S; 3],
    lower: [S; 3],
    /// Infinity where the half-line of that side starts at its quotient, minus infinity where it ends.
    upper_starts: [S; 3],
    lower_starts: [S; 3],
}

#[inline(always)]
unsafe fn cones<S: Lanes>(packet: &Packet, spread: &[Row; 3], scale: &Row, slack: f32) -> Cones<S> {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let zero = S::splat(0.0);
        let slack = S::splat(slack);
        let mut out = Cones {
            low: [zero; 3],
            high: [zero; 3],
            upper: [zero; 3],
            lower: [zero; 3],
            upper_starts: [zero; 3],
            lower_starts: [zero; 3],
        };
        for (k, wide) in spread.iter().enumerate() {
            let origin = S::load(&packet.origin[k]);
            (out.low[k], out.high[k]) = (origin.sub(slack), origin.add(slack));
            let (d, wide) = (along::<S>(packet, k), S::load(wide).mul(S::load(scale)));
            let one = S::splat(1.0);
            let (upper, lower) = (not_zero(d.add(wide)), not_zero(d.sub(wide)));
            (out.upper[k], out.lower[k]) = (one.div(upper), one.div(lower));
            let (up, down) = (S::splat(f32::INFINITY), S::splat(f32::NEG_INFINITY));
            out.upper_starts[k] = up.select(zero.lt(upper), down);
            out.lower_starts[k] = up.select(lower.lt(zero), down);
        }
        out
    }
}

/// A value, at least [`TINY`] away from zero.
#[inline(always)]
unsafe fn not_zero<S: Lanes>(x: S) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe { S::splat(TINY).select(x.abs().lt(S::splat(TINY)), x) }
}

/// Segments whose cones may meet the box.
#[inline(always)]
unsafe fn enter<S: Lanes>(node: &Node, cones: &Cones<S>) -> u16 {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let (mut near, mut far) = (S::splat(0.0), S::splat(1.0));
        for k in 0..3 {
            let a = S::splat(node.min[k]).sub(cones.high[k]).mul(cones.upper[k]);
            let b = S::splat(node.max[k]).sub(cones.low[k]).mul(cones.lower[k]);
            near = near
                .max(a.min(cones.upper_starts[k]))
                .max(b.min(cones.lower_starts[k]));
            far = far
                .min(a.max(cones.upper_starts[k]))
                .min(b.max(cones.lower_starts[k]));
        }
        near.le(far.mul(S::splat(SLAB_SLACK)))
    }
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
pub(crate) unsafe fn traverse<S: Lanes, L: Leaves<S>>(
    tree: &Tree,
    packet: &Packet,
    spread: &[Row; 3],
    leaves: &mut L,
    mut active: u16,
    stack: &mut Stack,
) {
    let nodes = &tree.nodes[..];
    if nodes.is_empty() {
        return;
    }
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let slack = box_slack(packet, active);
        let mut around = cones::<S>(
            packet,
            spread,
            leaves.narrowed().unwrap_or(&Row([1.0; crate::simd::LANES])),
            slack,
        );
        stack.clear();
        stack.reserve(tree.depth + 1);
        if enter(&nodes[0], &around) & active == 0 {
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
                    around = cones::<S>(packet, spread, scale, slack);
                }
            } else {
                let (left, right) = (current + 1, node.first);
                let in_left = enter(&nodes[left as usize], &around) & active;
                let in_right = enter(&nodes[right as usize], &around) & active;
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
                    Some(next) if enter(&nodes[next as usize], &around) & active != 0 => {
                        break next;
                    }
                    Some(_) => {}
                    None => return,
                }
            };
        }
    }
}
