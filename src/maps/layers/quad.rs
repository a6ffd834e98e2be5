//! What the nodes of a quadtree hold: the range of their depths, and planes in front of it.
//!
//! A node's depths alone say little about a receiver in it: its own surface reaches from one end of their range to the
//! other, so that some of it might be above the receiver's tangent plane at every level. Hence a node has a plane,
//! too, that no surface is nearer than. On a plane surface it is the surface, and the walk ends at the coarsest node
//! that holds nothing else.

use glam::Vec4;

/// Bounds of a node while the tree is built.
#[derive(Debug, Clone, Copy)]
pub struct NodeBounds {
    /// Least inverse depth; larger than the largest where there is nothing.
    pub low: f32,
    /// Largest inverse depth.
    pub high: f32,
    /// A plane that no texel's surfaces are nearer than at its centre: its inverse depth in the middle of the node.
    pub middle: f32,
    /// What the plane's inverse depth changes by from texel to texel.
    pub slope: [f32; 2],
    /// Least and largest inverse depth of a surface that covers all of the node.
    pub cover: Option<[f32; 2]>,
}

impl NodeBounds {
    /// The bounds of no node at all.
    pub const NONE: NodeBounds = NodeBounds {
        low: f32::MAX,
        high: -1.0,
        middle: -1.0,
        slope: [0.0; 2],
        cover: None,
    };

    fn is_some(&self) -> bool {
        self.low <= self.high
    }

    /// The bounds of four nodes of one size, without what covers them.
    pub fn of(nodes: &[NodeBounds; 4], size: f32) -> Self {
        let some = || nodes.iter().filter(|n| n.is_some());
        let mut all = NodeBounds::NONE;
        for node in some() {
            all.low = all.low.min(node.low);
            all.high = all.high.max(node.high);
        }
        if !all.is_some() {
            return all;
        }
        // Two planes: with the slopes of the nodes' planes, and with those from middle to middle. The latter are exact on
        // a plane surface; where one surface ends before another, the former are less steep.
        let each = 1.0 / some().count() as f32;
        let own = [0, 1].map(|axis| some().map(|n| n.slope[axis]).sum::<f32>() * each);
        let mut between = own;
        for (axis, between) in between.iter_mut().enumerate() {
            let next = 1 << axis;
            let (mut rise, mut across) = (0.0, 0.0);
            for (here, there) in [(0, next), (3 - next, 3)] {
                let [here, there] = [&nodes[here], &nodes[there]];
                if here.is_some() && there.is_some() {
                    rise += there.middle - here.middle;
                    across += size;
                }
            }
            if across > 0.0 {
                *between = rise / across;
            }
        }
        let [own, between] =
            [own, between].map(|slope| (NodeBounds::in_front(nodes, size, slope), slope));
        // The one that is lower on the whole.
        (all.middle, all.slope) = if own.0 < between.0 { own } else { between };
        all
    }

    /// Where a plane with such a slope is in the middle of four nodes when it is in front of their planes.
    fn in_front(nodes: &[NodeBounds; 4], size: f32, slope: [f32; 2]) -> f32 {
        let mut middle = f32::MIN;
        for (i, node) in nodes.iter().enumerate().filter(|(_, n)| n.is_some()) {
            // From the middle of all, and as far as texels' centres are from the node's own.
            let at = [i % 2, i / 2].map(|i| (i as f32 - 0.5) * size);
            let reach = 0.5 * (size - 1.0);
            let over = [0, 1].map(|axis| {
                reach * (node.slope[axis] - slope[axis]).abs() - slope[axis] * at[axis]
            });
            middle = middle.max(node.middle + over[0] + over[1]);
        }
        middle
    }
}

/// What four siblings of the quadtree hold, the children `(2x, 2y)`, `(2x + 1, 2y)`, `(2x, 2y + 1)`,
/// `(2x + 1, 2y + 1)` of their parent `(x, y)`: a cache line. All but the ranges of depths is kept in parts of them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub struct Quad {
    /// Least inverse depth; larger than the largest where there is nothing.
    pub low: [f32; 4],
    /// Largest inverse depth.
    pub high: [f32; 4],
    /// By how much planes rise over the width and height of their nodes.
    slopes: [[i16; 4]; 2],
    /// Inverse depths of planes in the middle, from one range below the least on.
    middle: [u16; 4],
    /// Least depths of covers, from the least of all up, or [`OPEN`] or [`OUTLINE`].
    cover_low: [u8; 4],
    /// Largest depths of covers, from the largest of all down.
    cover_high: [u8; 4],
}

/// Stands in place of a cover: there is no cover.
const OPEN: u8 = 255;

/// Stands in place of a cover: there is no cover, and an outline passes through the node.
const OUTLINE: u8 = 254;

/// Parts of a range in which planes are kept. On the part of a surface that is a hundredth of its depth deep they are as
/// fine as the rounding of an `f32`.
const FINE: f32 = 32767.0;

/// Parts of a range in which covers are kept.
const COARSE: f32 = 253.0;

impl Quad {
    /// Four nodes of a size, with an outline through those that no surface covers or without.
    pub fn new(nodes: &[NodeBounds; 4], size: f32, outline: bool) -> Self {
        let mut quad = Quad {
            low: nodes.map(|n| n.low),
            high: nodes.map(|n| n.high),
            slopes: [[0; 4]; 2],
            middle: [0; 4],
            cover_low: [if outline { OUTLINE } else { OPEN }; 4],
            cover_high: [0; 4],
        };
        for (i, node) in nodes.iter().enumerate() {
            let range = node.high - node.low;
            if range > 0.0 {
                quad.set_plane(i, node, size, range / FINE);
            }
            if let Some([low, high]) = node.cover {
                // No narrower.
                let part = (range / COARSE).max(f32::MIN_POSITIVE);
                quad.cover_low[i] = (((low - node.low) / part) as u8).min(OUTLINE - 1);
                quad.cover_high[i] = ((node.high - high) / part) as u8;
            }
        }
        quad
    }

    /// Keeps a node's plane, no lower anywhere; level where it would be above all that the node holds.
    fn set_plane(&mut self, i: usize, node: &NodeBounds, size: f32, part: f32) {
        let rises = node.slope.map(|s| s * size);
        let kept = rises.map(|rise| (rise / part).round() as i16);
        let lost = [0, 1].map(|axis| (rises[axis] - f32::from(kept[axis]) * part).abs());
        let mut middle = node.middle + 0.5 * (lost[0] + lost[1]);
        if middle < node.high {
            [self.slopes[0][i], self.slopes[1][i]] = kept;
        } else {
            middle = node.high;
        }
        self.middle[i] = (FINE + (middle - node.low) / part).ceil() as u16;
    }

    fn ranges(&self) -> [Vec4; 3] {
        let (low, high) = (Vec4::from_array(self.low), Vec4::from_array(self.high));
        [low, high, high - low]
    }

    /// Planes that no texel's surfaces are nearer than at its centre: by how much each rises over its node's width and
    /// height, and its inverse depth in the middle.
    #[inline(always)]
    pub fn planes(&self) -> ([Vec4; 2], Vec4) {
        let [low, _, range] = self.ranges();
        let part = range * (1.0 / FINE);
        let parts = |kept: [i16; 4]| Vec4::from_array(kept.map(f32::from)) * part;
        let middle = Vec4::from_array(self.middle.map(f32::from));
        (self.slopes.map(parts), (low - range) + middle * part)
    }

    /// Which nodes are covered by a surface, and the least and the largest inverse depth of that.
    #[inline(always)]
    pub fn covers(&self) -> (u32, [Vec4; 2]) {
        let [low, high, range] = self.ranges();
        let part = range * (1.0 / COARSE);
        let parts = |kept: [u8; 4]| Vec4::from_array(kept.map(f32::from)) * part;
        let covered = (0..4).fold(0, |m, i| m | u32::from(self.cover_low[i] < OUTLINE) << i);
        (
            covered,
            [low + parts(self.cover_low), high - parts(self.cover_high)],
        )
    }

    /// Whether an outline passes through a node.
    #[inline(always)]
    pub fn is_outline(&self, i: usize) -> bool {
        self.cover_low[i] == OUTLINE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A texel with a surface.
    fn texel(middle: f32, slope: [f32; 2]) -> NodeBounds {
        let reach = 0.5 * (slope[0].abs() + slope[1].abs());
        let [low, high] = [middle - reach, middle + reach];
        NodeBounds {
            low,
            high,
            middle,
            slope,
            cover: Some([low, high]),
        }
    }

    /// Parents of as many texels a side, with the surface `at(x, y)`, and what they hold at each texel's centre.
    fn pyramid(side: usize, at: impl Fn(f32, f32) -> Option<NodeBounds>) -> Vec<Vec<NodeBounds>> {
        let place = |i: usize| (i % side, i / side);
        let texels = (0..side * side).map(|i| {
            let (x, y) = place(i);
            at(x as f32, y as f32).unwrap_or(NodeBounds::NONE)
        });
        let mut levels = vec![texels.collect::<Vec<_>>()];
        let mut size = 1;
        while size < side {
            let across = side / size;
            let below = &levels[levels.len() - 1];
            let parents = (0..across * across / 4).map(|i| {
                let (x, y) = (i % (across / 2) * 2, i / (across / 2) * 2);
                let four = [0, 1, across, across + 1].map(|at| below[y * across + x + at]);
                NodeBounds::of(&four, size as f32)
            });
            let parents = parents.collect();
            levels.push(parents);
            size *= 2;
        }
        levels
    }

    /// Least and largest height of kept planes over texels' centres, of all levels.
    fn heights(levels: &[Vec<NodeBounds>], side: usize) -> [f32; 2] {
        let (mut least, mut most) = (f32::MAX, f32::MIN);
        for (level, nodes) in levels.iter().enumerate() {
            let size = 1 << level;
            for (i, node) in nodes.iter().enumerate() {
                let quad = Quad::new(&[*node; 4], size as f32, false);
                let (slopes, middle) = quad.planes();
                let (nx, ny) = (i % (side / size), i / (side / size));
                for j in 0..size * size {
                    let (x, y) = (j % size, j / size);
                    let texel = &levels[0][(ny * size + y) * side + nx * size + x];
                    if texel.low <= texel.high {
                        let off = |k: usize| (k as f32 + 0.5) / size as f32 - 0.5;
                        let plane = middle[0] + slopes[0][0] * off(x) + slopes[1][0] * off(y);
                        least = least.min(plane - texel.middle);
                        most = most.max(plane - texel.middle);
                    }
                }
            }
        }
        [least, most]
    }

    #[test]
    fn planes_are_in_front_of_everything() {
        // Bumps, a step, holes and a steep ramp. Inverse depths are about 1: kept and built planes round by some ulps.
        let surface = |x: f32, y: f32| {
            let bump = 0.03 * (0.7 * x).sin() * (0.9 * y).cos();
            let slope = [
                0.021 * (0.7 * x).cos() * (0.9 * y).cos(),
                -0.027 * (0.7 * x).sin() * (0.9 * y).sin(),
            ];
            let step = if x > 17.0 { 0.5 } else { 0.0 };
            let hole = (x * 13.0 + y * 7.0) % 11.0 < 3.0;
            (!hole).then(|| texel(1.0 + bump + step, slope))
        };
        let ramp = |x: f32, y: f32| Some(texel(10.0 + 0.3 * x - 0.2 * y, [0.3, -0.2]));
        for levels in [pyramid(32, surface), pyramid(32, ramp)] {
            let largest = levels[5][0].high;
            let [least, most] = heights(&levels, 32);
            assert!(least >= -8.0 * f32::EPSILON * largest, "{least}");
            assert!(most <= largest);
        }
    }

    #[test]
    fn a_plane_surface_is_its_own_bound() {
        // Slopes as pieces keep them, wrong by 0.4 %.
        let plane = |x: f32, y: f32| Some(texel(1.0 + 3e-4 * x + 2e-4 * y, [3.01e-4, 1.99e-4]));
        let levels = pyramid(32, plane);
        let range = levels[5][0].high - levels[5][0].low;
        let [least, most] = heights(&levels, 32);
        // Rounding of the depths, and of what is kept: a part for the middle, half a part for each slope.
        let rounding = 8.0 * f32::EPSILON;
        assert!(least >= -rounding, "{least}");
        assert!(most <= rounding + 2.0 * range / FINE, "{most}");
    }

    #[test]
    fn covers_are_kept_no_narrower() {
        for (low, high) in [(1.0, 1.0), (1.0, 1.5), (1.2, 1.3), (1.7, 2.0), (1.999, 2.0)] {
            let node = NodeBounds {
                low: 1.0,
                high: 2.0,
                cover: Some([low, high]),
                ..NodeBounds::NONE
            };
            let nodes = [
                node,
                NodeBounds {
                    cover: None,
                    ..node
                },
                NodeBounds::NONE,
                texel(1.5, [0.0; 2]),
            ];
            let quad = Quad::new(&nodes, 4.0, true);
            let (covered, [kept_low, kept_high]) = quad.covers();
            assert_eq!(covered, 0b1001);
            assert!(kept_low[0] <= low && kept_low[0] >= low - 1.5 / COARSE);
            assert!(kept_high[0] >= high && kept_high[0] <= high + 1.5 / COARSE);
            assert_eq!([kept_low[3], kept_high[3]], [1.5; 2]);
            assert_eq!(
                [0, 1, 2, 3].map(|i| quad.is_outline(i)),
                [false, true, true, false]
            );
            assert!(!Quad::new(&nodes, 4.0, false).is_outline(1));
        }
    }
}
