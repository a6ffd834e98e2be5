//! The quadtree of a map: least and largest depth of its nodes (Section 4.3).
//!
//! A node of level `l` covers 2ˡ × 2ˡ texels of the map. The quadtree keeps four numbers for every node, by
//! parents, so that four siblings lie in one cache line ([`Quad`]): the range of inverse depths of all that it
//! holds, and, where all of its texels are covered by one connected opaque surface, the range of that. Beside it
//! each level has a coarser map ([`super::coarser`]).
//!
//! Where no surface covers a node, but few end around it, the outline of a body passes: a coarser map knows it less
//! well than a finer one, which costs little, for an outline is thin. Such nodes are marked ([`OUTLINE`]). Among leaves
//! and hair, where everything is outline, none is: there the errors of many pieces cancel.

use rayon::prelude::*;

use super::coarser::coarser;
use super::map::{LayerMap, Level, Plane};

/// What four siblings of the quadtree hold, the children `(2x, 2y)`, `(2x + 1, 2y)`, `(2x, 2y + 1)`,
/// `(2x + 1, 2y + 1)` of their parent `(x, y)`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub struct Quad {
    /// Least inverse depth; larger than the largest where there is nothing.
    pub low: [f32; 4],
    /// Largest inverse depth.
    pub high: [f32; 4],
    /// Least inverse depth of a surface that covers all of the node; -1 or [`OUTLINE`] where there is none.
    pub cover_low: [f32; 4],
    /// Its largest inverse depth.
    pub cover_high: [f32; 4],
}

impl Quad {
    /// Four empty nodes.
    pub const EMPTY: Quad = Quad {
        low: [f32::MAX; 4],
        high: [-1.0; 4],
        cover_low: [-1.0; 4],
        cover_high: [f32::MAX; 4],
    };
}

/// In place of a cover: there is none, and an outline passes through the node.
pub const OUTLINE: f32 = -2.0;

/// Borders between texels, for each texel along the side of a node's grandparent, at which surfaces may end where
/// outlines pass: as many as on three oblique ones. With 4 the statue's penumbra has a tenth more error, with 8 the
/// tree takes a fifth longer.
const ENDS: u32 = 6;

/// A node while the tree is built.
#[derive(Debug, Clone, Copy)]
struct Node {
    low: f32,
    high: f32,
    cover: [f32; 2],
    /// Whether one opaque surface covers all of it, connected within.
    covered: bool,
    /// Whether that surface goes on in the neighbours on the right and below, all along the border.
    right: bool,
    down: bool,
    /// Borders of its texels with one another, and with those on the right and below, at which the nearest surface ends.
    ends: u32,
}

/// Bytes a texel of the quadtree, a quad for every four nodes, and of the nodes of three levels while it is built.
pub const TREE_BYTES: usize =
    size_of::<Quad>().div_ceil(3) + (size_of::<Node>() * (16 + 4 + 1)).div_ceil(16);

const NOTHING: Node = Node {
    low: f32::MAX,
    high: -1.0,
    cover: [-1.0, f32::MAX],
    covered: false,
    right: false,
    down: false,
    ends: 0,
};

/// Adds the coarser levels to a map of one, and the quadtree.
pub fn add_levels(map: &mut LayerMap) {
    let k = map.layers;
    let (width, height) = (map.levels[0].width, map.levels[0].height);
    let mut nodes = texels(&map.levels[0], k);
    let mut above = parents(&nodes, width, height);
    loop {
        let finest = &map.levels[map.levels.len() - 1];
        let (width, height) = (finest.width, finest.height);
        let level = map.levels.len() - 1;
        let grandparents = parents(&above, width.div_ceil(2), height.div_ceil(2));
        let ends = if map.is_transparent() {
            0
        } else {
            ENDS << (level + 2)
        };
        let quads = quads(&nodes, &grandparents, ends, width, height);
        if width == 1 && height == 1 {
            map.levels[level].quads = quads;
            return;
        }
        (nodes, above) = (above, grandparents);
        let next = coarser(finest, k, level as u32);
        map.levels[level].quads = quads;
        map.levels.push(next);
    }
}

/// Nodes of the finest level.
fn texels(level: &Level, k: usize) -> Vec<Node> {
    let (width, height) = (level.width, level.height);
    let first = |x: usize, y: usize| {
        let (at, child) = level.place(x, y, k);
        let opaque = level.media.get(at).is_none_or(|m| m[child].through == 0.0);
        let piece = level.blocks[at].piece(child);
        (opaque && piece.is_some()).then_some(piece)
    };
    let row = |y: usize| {
        (0..width).map(move |x| {
            let (at, child) = level.place(x, y, k);
            let mut node = NOTHING;
            for (i, block) in level.blocks[at..at + k].iter().enumerate() {
                let piece = block.piece(child);
                if !piece.is_some() {
                    break;
                }
                let nearest = level
                    .media
                    .get(at + i)
                    .map_or(piece.inverse_depth, |m| m[child].first);
                // A plane may reach beyond the eye's horizon within a texel; nothing does.
                node.low = node
                    .low
                    .min((piece.inverse_depth - piece.reach()).max(f32::MIN_POSITIVE));
                node.high = node.high.max(nearest + piece.reach());
            }
            let here = first(x, y);
            let next = [(1, 0), (0, 1)].map(|(i, j)| {
                let (x, y) = (x + i, y + j);
                (x < width && y < height).then(|| first(x, y))
            });
            if let Some(piece) = here {
                let (w, reach) = (piece.inverse_depth, piece.reach());
                node.covered = true;
                node.cover = [(w - reach).max(f32::MIN_POSITIVE), w + reach];
                let joined = |axis: usize| {
                    let next = next[axis].flatten();
                    next.is_some_and(|next| Plane::from(piece).joins(&next.into(), axis))
                };
                (node.right, node.down) = (joined(0), joined(1));
            }
            for (next, goes_on) in next.into_iter().zip([node.right, node.down]) {
                let some = next.is_some_and(|next| here.is_some() || next.is_some());
                node.ends += u32::from(some && !goes_on);
            }
            node
        })
    };
    (0..height).into_par_iter().flat_map_iter(row).collect()
}

fn child(nodes: &[Node], width: usize, height: usize, x: usize, y: usize) -> Node {
    if x < width && y < height {
        nodes[y * width + x]
    } else {
        NOTHING
    }
}

fn siblings(nodes: &[Node], width: usize, height: usize, x: usize, y: usize) -> [Node; 4] {
    [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| child(nodes, width, height, 2 * x + i, 2 * y + j))
}

/// Of nodes, by their grandparents: outlines pass where at most so many borders are ends.
fn quads(
    nodes: &[Node],
    grandparents: &[Node],
    most: u32,
    width: usize,
    height: usize,
) -> Vec<Quad> {
    let across = width.div_ceil(2);
    let make = |i: usize| {
        let (x, y) = (i % across, i / across);
        let four = siblings(nodes, width, height, x, y);
        let ends = grandparents[y / 2 * across.div_ceil(2) + x / 2].ends;
        let outline = (1..=most).contains(&ends);
        let cover_low = |n: Node| {
            if outline && !n.covered {
                OUTLINE
            } else {
                n.cover[0]
            }
        };
        Quad {
            low: four.map(|n| n.low),
            high: four.map(|n| n.high),
            cover_low: four.map(cover_low),
            cover_high: four.map(|n| n.cover[1]),
        }
    };
    (0..across * height.div_ceil(2))
        .into_par_iter()
        .map(make)
        .collect()
}

fn parents(nodes: &[Node], width: usize, height: usize) -> Vec<Node> {
    let across = width.div_ceil(2);
    let make = |i: usize| {
        let [a, b, c, d] = siblings(nodes, width, height, i % across, i / across);
        let all = [a, b, c, d];
        let fold = |f: fn(f32, f32) -> f32, of: fn(&Node) -> f32| {
            all[1..].iter().fold(of(&all[0]), |m, n| f(m, of(n)))
        };
        let covered = all.iter().all(|n| n.covered) && a.right && c.right && a.down && b.down;
        Node {
            low: fold(f32::min, |n| n.low),
            high: fold(f32::max, |n| n.high),
            cover: if covered {
                [
                    fold(f32::min, |n| n.cover[0]),
                    fold(f32::max, |n| n.cover[1]),
                ]
            } else {
                NOTHING.cover
            },
            covered,
            right: b.right && d.right,
            down: c.down && d.down,
            ends: all.iter().map(|n| n.ends).sum(),
        }
    };
    (0..across * height.div_ceil(2))
        .into_par_iter()
        .map(make)
        .collect()
}
