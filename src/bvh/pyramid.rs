//! The triangles in a convex region next to a point, such as the pyramid from a receiver to a light up to some height.
//!
//! The region is bounded by planes. A node is entered unless its box lies behind one of them, a triangle is met
//! unless its corners do: so what is found may lie outside, where two planes meet, and nothing within is missing.
//! Both are tested two at a time, eight planes each. Planes are moved outward by more than these tests round.

use std::ops::Range;

use fearless_simd::{f32x8, f32x16, prelude::*};
use glam::Vec3;

use super::packet::BOX_SLACK;
use super::tree::{Node, Tree};
use crate::simd::{LANES, Lanes, Row};

/// Most planes of a region.
pub(crate) const PLANES: usize = LANES / 2;

/// A convex region.
pub(crate) struct Pyramid {
    /// What its coordinates are relative to.
    pub(crate) origin: Vec3,
    /// Inward normals, and distances of the origin from the planes, twice each.
    normals: [Row; 3],
    offsets: Row,
}

impl Pyramid {
    /// The region before all planes, each given by its inward normal, of unit length, and the origin's distance from
    /// it; what is nearest to the first plane comes last.
    pub(crate) fn new(origin: Vec3, planes: [(Vec3, f32); PLANES]) -> Self {
        let slack = BOX_SLACK * origin.abs().max_element().max(1.0);
        let row = |of: &dyn Fn(&(Vec3, f32)) -> f32| {
            Row(std::array::from_fn(|lane| of(&planes[lane % PLANES])))
        };
        Pyramid {
            origin,
            normals: [0, 1, 2].map(|axis| row(&|plane| plane.0[axis])),
            offsets: row(&|plane| plane.1 + slack),
        }
    }

    /// For two boxes, which of the planes they lie behind, and the distance of their innermost corners from the first.
    #[inline(always)]
    fn behind<S: Simd>(&self, simd: S, [a, b]: [&Node; 2]) -> (u16, [f32; 2]) {
        let mut inside = self.offsets.load(simd);
        for axis in 0..3 {
            let at = self.origin[axis];
            let normal = self.normals[axis].load(simd);
            let low = normal * pair(simd, a.min[axis] - at, b.min[axis] - at);
            let high = normal * pair(simd, a.max[axis] - at, b.max[axis] - at);
            inside += low.greater(high);
        }
        let mut row = Row::default();
        row.set(inside);
        (inside.lt(0.0), [row.0[0], row.0[PLANES]])
    }

    /// Which of two triangles, given from the origin, are not behind one of the planes.
    #[inline(always)]
    pub(crate) fn meets<S: Simd>(&self, simd: S, [a, b]: [&[Vec3; 3]; 2]) -> [bool; 2] {
        let offsets = self.offsets.load(simd);
        let mut innermost = offsets + self.heights(simd, a[0], b[0]);
        innermost = innermost.greater(offsets + self.heights(simd, a[1], b[1]));
        innermost = innermost.greater(offsets + self.heights(simd, a[2], b[2]));
        let behind = innermost.lt(0.0);
        [behind & FIRST == 0, behind & !FIRST == 0]
    }

    /// Heights of two points, given from the origin, over planes through it.
    #[inline(always)]
    fn heights<S: Simd>(&self, simd: S, a: Vec3, b: Vec3) -> f32x16<S> {
        self.normals[0].load(simd) * pair(simd, a.x, b.x)
            + self.normals[1].load(simd) * pair(simd, a.y, b.y)
            + self.normals[2].load(simd) * pair(simd, a.z, b.z)
    }
}

/// The planes of the first of two.
const FIRST: u16 = 0xff;

#[inline(always)]
fn pair<S: Simd>(simd: S, a: f32, b: f32) -> f32x16<S> {
    simd.combine_f32x8(f32x8::splat(simd, a), f32x8::splat(simd, b))
}

/// A walk through a tree for the leaves that a region meets.
pub(crate) struct Search<'a> {
    tree: &'a Tree,
    pyramid: &'a Pyramid,
    stack: &'a mut Vec<u32>,
}

impl<'a> Search<'a> {
    /// A walk that has not begun.
    pub(crate) fn new(tree: &'a Tree, pyramid: &'a Pyramid, stack: &'a mut Vec<u32>) -> Self {
        stack.clear();
        if !tree.nodes.is_empty() {
            stack.push(0);
        }
        Search {
            tree,
            pyramid,
            stack,
        }
    }

    /// The primitives of the next leaf.
    #[inline(always)]
    pub(crate) fn next_leaf<S: Simd>(&mut self, simd: S) -> Option<Range<usize>> {
        let nodes = &self.tree.nodes[..];
        while let Some(mut current) = self.stack.pop() {
            loop {
                let node = &nodes[current as usize];
                if node.count > 0 {
                    let first = node.first as usize;
                    return Some(first..first + node.count as usize);
                }
                let (left, right) = (current + 1, node.first);
                let both = [&nodes[left as usize], &nodes[right as usize]];
                let (behind, [a, b]) = self.pyramid.behind(simd, both);
                match (behind & FIRST == 0, behind & !FIRST == 0) {
                    (true, true) => {
                        let (near, far) = if a >= b { (left, right) } else { (right, left) };
                        self.stack.push(far);
                        current = near;
                    }
                    (true, false) => current = left,
                    (false, true) => current = right,
                    (false, false) => break,
                }
            }
        }
        None
    }
}
