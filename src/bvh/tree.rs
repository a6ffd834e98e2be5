//! Binary trees of boxes: obvhs builds them, this file lays them out for the traversals here.
//!
//! Nodes stand in depth-first order: the left child follows its parent, and every child comes after
//! its parent, so that a refit is one pass from the back.

use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::{Boundable, BvhBuildParams};

/// A refit whose expected cost has grown by more than this factor is thrown away for a new tree:
/// the cost counts node visits, and a rebuild costs as much as about a million of them.
const REBUILD_AT: f32 = 1.5;

/// Most primitives of a leaf.
pub(super) const LEAF_SIZE: u32 = 8;

/// A box with two children or some primitives.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(32))]
pub struct Node {
    /// Lower corner.
    pub min: [f32; 3],
    /// The right child of an inner node (the left one follows the node), the first primitive of a leaf.
    pub first: u32,
    /// Upper corner.
    pub max: [f32; 3],
    /// Primitives of a leaf, 0 for an inner node.
    pub count: u32,
}

impl Node {
    /// Half the surface area of the box.
    pub(super) fn half_area(&self) -> f32 {
        let d = Vec3::from(self.max) - Vec3::from(self.min);
        d.x * d.y + d.y * d.z + d.z * d.x
    }
}

/// A binary tree of boxes over numbered primitives.
#[derive(Debug, Clone, Default)]
pub struct Tree {
    /// Depth-first; empty when there are no primitives.
    pub nodes: Vec<Node>,
    /// Primitives in the order of the leaves.
    pub order: Vec<u32>,
    /// Nodes on the longest path from the root to a leaf.
    pub depth: usize,
    cost: f32,
}

struct Bounds(Aabb);

impl Boundable for Bounds {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl Tree {
    /// Builds a tree over boxes, given by lower and upper corners.
    pub fn new(bounds: &[(Vec3, Vec3)]) -> Self {
        Tree::with_leaves(bounds, LEAF_SIZE)
    }

    /// Builds a tree with up to so many primitives in a leaf.
    pub(super) fn with_leaves(bounds: &[(Vec3, Vec3)], most: u32) -> Self {
        if bounds.is_empty() {
            return Tree::default();
        }
        let boxes: Vec<Bounds> = bounds
            .iter()
            .map(|&(low, high)| Bounds(Aabb::new(Vec3A::from(low), Vec3A::from(high))))
            .collect();
        // On a million triangles obvhs' thorough presets take twice as long as this one, for packets that are
        // no faster; leaves of 8 are a few per cent faster than 4, 2 or 1.
        let mut elapsed = std::time::Duration::ZERO;
        let params = BvhBuildParams {
            max_prims_per_leaf: most,
            ..BvhBuildParams::medium_build()
        };
        let built = build_bvh2(&boxes, params, &mut elapsed);
        let mut tree = Tree {
            nodes: Vec::with_capacity(built.nodes.len()),
            order: Vec::with_capacity(bounds.len()),
            depth: 0,
            cost: 0.0,
        };
        // (node of obvhs, place of the parent whose right child it is, depth)
        let mut stack = vec![(0u32, u32::MAX, 1usize)];
        while let Some((source, parent, depth)) = stack.pop() {
            let node = &built.nodes[source as usize];
            let place = tree.nodes.len() as u32;
            tree.depth = tree.depth.max(depth);
            if parent != u32::MAX {
                tree.nodes[parent as usize].first = place;
            }
            let (min, max) = (node.aabb.min.to_array(), node.aabb.max.to_array());
            if node.is_leaf() {
                let first = tree.order.len() as u32;
                let range =
                    node.first_index as usize..(node.first_index + node.prim_count) as usize;
                tree.order
                    .extend_from_slice(&built.primitive_indices[range]);
                tree.nodes.push(Node {
                    min,
                    first,
                    max,
                    count: node.prim_count,
                });
            } else {
                tree.nodes.push(Node {
                    min,
                    first: 0,
                    max,
                    count: 0,
                });
                stack.push((node.first_index + 1, place, depth + 1));
                stack.push((node.first_index, u32::MAX, depth + 1));
            }
        }
        tree.cost = tree.expected_cost();
        tree
    }

    /// A tree of the same topology over moved boxes, numbered in the order of this tree's leaves; `None` where that has
    /// become much slower to traverse than when it was built.
    pub fn refitted(&self, bounds: &[(Vec3, Vec3)]) -> Option<Self> {
        let mut tree = self.clone();
        for i in (0..tree.nodes.len()).rev() {
            let node = tree.nodes[i];
            let (low, high) = if node.count > 0 {
                let leaf = &bounds[node.first as usize..(node.first + node.count) as usize];
                leaf.iter()
                    .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), b| {
                        (low.min(b.0), high.max(b.1))
                    })
            } else {
                let (left, right) = (tree.nodes[i + 1], tree.nodes[node.first as usize]);
                (
                    Vec3::from(left.min).min(right.min.into()),
                    Vec3::from(left.max).max(right.max.into()),
                )
            };
            tree.nodes[i].min = low.to_array();
            tree.nodes[i].max = high.to_array();
        }
        // The cost at building stays the measure, so that slow drift ends in a rebuild too.
        (tree.expected_cost() <= REBUILD_AT * self.cost).then_some(tree)
    }

    /// Whether a leaf meets what it and all nodes above it must meet.
    pub fn any_leaf(&self, meets: impl Fn(&Node) -> bool) -> bool {
        let mut stack = vec![0u32];
        while let Some(i) = stack.pop() {
            let Some(node) = self.nodes.get(i as usize) else {
                return false;
            };
            if !meets(node) {
                continue;
            }
            if node.count > 0 {
                return true;
            }
            stack.extend([node.first, i + 1]);
        }
        false
    }

    /// Bytes of nodes and order.
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>() + self.order.len() * 4
    }

    /// Surface area heuristic: expected node visits and primitive tests of a random line.
    fn expected_cost(&self) -> f32 {
        let Some(root) = self.nodes.first() else {
            return 0.0;
        };
        let sum: f32 = self
            .nodes
            .iter()
            .map(|n| n.half_area() * (1 + n.count) as f32)
            .sum();
        let area = root.half_area();
        if area > 0.0 { sum / area } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxes(n: usize, shift: f32) -> Vec<(Vec3, Vec3)> {
        (0..n)
            .map(|i| {
                let p = Vec3::new((i * 7 % 13) as f32, (i * 5 % 17) as f32, (i % 3) as f32) + shift;
                (p, p + 0.5)
            })
            .collect()
    }

    fn check(tree: &Tree, bounds: &[(Vec3, Vec3)]) {
        let mut order = tree.order.clone();
        order.sort_unstable();
        assert!(order.iter().enumerate().all(|(i, &o)| i as u32 == o));
        for (i, node) in tree.nodes.iter().enumerate() {
            let inside = |low: Vec3, high: Vec3| {
                low.cmpge(node.min.into()).all() && high.cmple(node.max.into()).all()
            };
            if node.count > 0 {
                for k in node.first..node.first + node.count {
                    let (low, high) = bounds[tree.order[k as usize] as usize];
                    assert!(inside(low, high));
                }
            } else {
                for child in [i + 1, node.first as usize] {
                    assert!(child > i);
                    let child = tree.nodes[child];
                    assert!(inside(child.min.into(), child.max.into()));
                }
            }
        }
    }

    #[test]
    fn every_primitive_is_in_one_leaf_and_every_box_in_its_parent() {
        for n in [1, 2, 5, 300] {
            let bounds = boxes(n, 0.0);
            check(&Tree::new(&bounds), &bounds);
        }
        assert!(Tree::new(&[]).nodes.is_empty());
    }

    #[test]
    fn a_refit_follows_a_shift_and_gives_up_when_everything_is_shuffled() {
        let tree = Tree::new(&boxes(300, 0.0));
        let moved = boxes(300, 2.5);
        let ordered: Vec<_> = tree.order.iter().map(|&i| moved[i as usize]).collect();
        check(&tree.refitted(&ordered).unwrap(), &moved);
        // Numbered as if the leaves' order were the original one: neighbours are no longer near.
        assert!(tree.refitted(&moved).is_none());
    }
}
