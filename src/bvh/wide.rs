//! Trees of eight children a node, for rays that only ask whether anything is in their way.
//!
//! Made from a binary [`Tree`]: a node takes over the largest of its descendants until it has eight children or
//! all of them are leaves, and any part of the binary tree with up to eight triangles is a leaf, a [`Pack`]. Boxes
//! and corners stand as eight lanes, so that one ray meets all of a node's children or of a pack's triangles at
//! once; many rays take them one by one.

use glam::Vec3;
use rayon::prelude::*;

use super::tree::{LEAF_SIZE, Tree};
use crate::simd::prefetch;

/// Children of a node, and triangles of a leaf.
pub(super) const WIDTH: usize = 8;
const _: () = assert!(LEAF_SIZE as usize <= WIDTH, "a leaf of the tree is a pack");

/// A node's children.
#[derive(Debug, Clone)]
#[repr(C, align(32))]
pub(super) struct Node {
    /// For each axis the lower and the upper sides of the boxes; of those that are not used, sides that no ray passes.
    pub(super) planes: [[[f32; WIDTH]; 2]; 3],
    /// What is in the boxes, the largest first.
    pub(super) child: [Child; WIDTH],
    /// How many there are.
    pub(super) count: u32,
}

/// Triangles of a leaf.
#[derive(Debug, Clone)]
#[repr(C, align(32))]
pub(super) struct Pack {
    /// For each corner and axis; those beyond the last triangle are no numbers, which no test lets pass.
    pub(super) corners: [[[f32; WIDTH]; 3]; 3],
}

impl Pack {
    pub(super) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let mut corners = [[[f32::NAN; WIDTH]; 3]; 3];
        for (k, triangle) in triangles.iter().enumerate() {
            for (corner, v) in corners.iter_mut().zip(triangle) {
                for (axis, x) in corner.iter_mut().zip(v.to_array()) {
                    axis[k] = x;
                }
            }
        }
        Pack { corners }
    }

    /// The corners of one triangle.
    #[inline(always)]
    pub(super) fn triangle(&self, k: usize) -> [Vec3; 3] {
        let [a, b, c] = &self.corners;
        [
            Vec3::new(a[0][k], a[1][k], a[2][k]),
            Vec3::new(b[0][k], b[1][k], b[2][k]),
            Vec3::new(c[0][k], c[1][k], c[2][k]),
        ]
    }
}

/// A node, or a leaf with how many triangles it has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Child(u32);

impl Child {
    /// The first node.
    pub(super) const ROOT: Child = Child(0);
    const LEAF: u32 = 1 << 31;
    const COUNT_AT: u32 = 28;
    const PLACE: u32 = (1 << Self::COUNT_AT) - 1;

    fn leaf(place: usize, count: u32) -> Self {
        Child(Self::LEAF | (count - 1) << Self::COUNT_AT | place as u32)
    }

    /// As a word of a stack.
    #[inline(always)]
    pub(super) fn word(self) -> u32 {
        self.0
    }

    /// Back from a word.
    #[inline(always)]
    pub(super) fn from_word(word: u32) -> Self {
        Child(word)
    }

    #[inline(always)]
    pub(super) fn is_leaf(self) -> bool {
        self.0 & Self::LEAF != 0
    }

    /// The node's or the pack's place.
    #[inline(always)]
    pub(super) fn place(self) -> usize {
        (self.0 & Self::PLACE) as usize
    }

    /// Triangles of a leaf.
    #[inline(always)]
    pub(super) fn triangles(self) -> usize {
        (self.0 >> Self::COUNT_AT & 7) as usize + 1
    }
}

/// A tree of [`Node`]s over [`Pack`]s.
#[derive(Debug, Clone, Default)]
pub(super) struct Wide {
    /// Empty when there are no triangles.
    pub(super) nodes: Vec<Node>,
    /// A leaf each; empty where corners are kept elsewhere.
    pub(super) packs: Vec<Pack>,
    /// Where the triangles of each leaf start in the order of the binary tree's leaves.
    pub(super) firsts: Vec<u32>,
}

impl Wide {
    /// The tree for triangles, given by their corners in the order of the leaves of `tree`.
    pub(super) fn new(tree: &Tree, corners: &[[Vec3; 3]]) -> Self {
        let (mut wide, leaves) = Wide::with_leaves(tree, WIDTH);
        let pack = |range: std::ops::Range<usize>| Pack::new(&corners[range]);
        wide.packs = leaves.into_par_iter().map(pack).collect();
        wide
    }

    /// The tree for primitives that it does not keep, with up to so many in a leaf, but for larger leaves of `tree`.
    pub(super) fn of_boxes(tree: &Tree, most: usize) -> Self {
        Wide::with_leaves(tree, most).0
    }

    /// The nodes, and the primitives of each leaf.
    fn with_leaves(tree: &Tree, most: usize) -> (Self, Vec<std::ops::Range<usize>>) {
        let mut nodes = Vec::new();
        let mut leaves = Vec::new();
        if !tree.nodes.is_empty() {
            let below = triangles_below(tree);
            // A node to make, and where its parent keeps it.
            let mut stack = vec![(0, None::<(usize, usize)>)];
            while let Some((root, parent)) = stack.pop() {
                let place = nodes.len();
                if let Some((node, child)) = parent {
                    let node: &mut Node = &mut nodes[node];
                    node.child[child] = Child(place as u32);
                }
                let is_leaf = |i: usize| below[i].1 as usize <= most || tree.nodes[i].count > 0;
                let children = children(tree, is_leaf, root);
                let mut node = Node {
                    planes: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3],
                    child: [Child::ROOT; WIDTH],
                    count: children.len() as u32,
                };
                for (k, &child) in children.iter().enumerate() {
                    let bounds = &tree.nodes[child];
                    for (axis, planes) in node.planes.iter_mut().enumerate() {
                        planes[0][k] = bounds.min[axis];
                        planes[1][k] = bounds.max[axis];
                    }
                    let (first, count) = below[child];
                    if is_leaf(child) {
                        node.child[k] = Child::leaf(leaves.len(), count);
                        leaves.push(first as usize..(first + count) as usize);
                    } else {
                        stack.push((child, Some((place, k))));
                    }
                }
                nodes.push(node);
            }
        }
        let wide = Wide {
            nodes,
            packs: Vec::new(),
            firsts: leaves.iter().map(|range| range.start as u32).collect(),
        };
        (wide, leaves)
    }

    /// Asks for a child before it is needed.
    #[inline(always)]
    pub(super) fn prefetch(&self, child: Child) {
        if child.is_leaf() {
            prefetch(&self.packs, child.place());
        } else {
            prefetch(&self.nodes, child.place());
        }
    }

    /// Bytes of all of it.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.packs[..]) + size_of_val(&self.firsts[..])
    }
}

/// The first triangle below each node of a binary tree, and how many there are.
fn triangles_below(tree: &Tree) -> Vec<(u32, u32)> {
    let mut below = vec![(0, 0); tree.nodes.len()];
    for (i, node) in tree.nodes.iter().enumerate().rev() {
        below[i] = if node.count > 0 {
            (node.first, node.count)
        } else {
            let (first, left) = below[i + 1];
            (first, left + below[node.first as usize].1)
        };
    }
    below
}

/// The nodes of a binary tree that are to be children of the one made for `root`, the largest first.
fn children(tree: &Tree, is_leaf: impl Fn(usize) -> bool, root: usize) -> Vec<usize> {
    let area = |&i: &usize| tree.nodes[i].half_area();
    let mut children = vec![root];
    while children.len() < WIDTH {
        let open = (0..children.len())
            .filter(|&k| !is_leaf(children[k]))
            .max_by(|&a, &b| area(&children[a]).total_cmp(&area(&children[b])));
        let Some(k) = open else {
            break;
        };
        let node = children[k];
        children[k] = node + 1;
        children.push(tree.nodes[node].first as usize);
    }
    children.sort_by(|a, b| area(b).total_cmp(&area(a)));
    children
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_triangle_is_in_one_pack_within_all_boxes_above() {
        for count in [0, 1, 8, 9, 1000] {
            let triangles: Vec<[Vec3; 3]> = (0..count)
                .map(|i| {
                    let p = Vec3::new((i * 7 % 13) as f32, (i * 5 % 17) as f32, i as f32);
                    [p, p + Vec3::X, p + Vec3::Y]
                })
                .collect();
            let bounds: Vec<_> = triangles
                .iter()
                .map(|t| (t[0], t[0].max(t[1]).max(t[2])))
                .collect();
            let tree = Tree::new(&bounds);
            let corners: Vec<_> = tree.order.iter().map(|&i| triangles[i as usize]).collect();
            let wide = Wide::new(&tree, &corners);
            let mut found = vec![];
            let mut stack = vec![];
            if count > 0 {
                stack.push((Child::ROOT, Vec3::NEG_INFINITY, Vec3::INFINITY));
            }
            while let Some((child, low, high)) = stack.pop() {
                if child.is_leaf() {
                    for k in 0..child.triangles() {
                        let triangle = wide.packs[child.place()].triangle(k);
                        assert!(
                            triangle
                                .iter()
                                .all(|v| v.cmpge(low).all() && v.cmple(high).all())
                        );
                        found.push(triangle[0].z as usize);
                    }
                    continue;
                }
                let node = &wide.nodes[child.place()];
                for k in 0..node.count as usize {
                    let side = |s: usize| Vec3::from_array(node.planes.map(|axis| axis[s][k]));
                    stack.push((node.child[k], low.max(side(0)), high.min(side(1))));
                }
            }
            found.sort_unstable();
            assert!(found.iter().copied().eq(0..count), "{count}: {found:?}");
        }
    }
}
