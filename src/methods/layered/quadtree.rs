//! The quadtree of a map: least and largest depth of its nodes (Section 4.3).
//!
//! A node of level `l` covers 2ˡ × 2ˡ texels of the map. The quadtree keeps four numbers for every node, by
//! parents, so that four siblings lie in one cache line ([`Quad`]): the range of inverse depths of all that it
//! holds, and, where all of its texels are covered by one connected opaque surface, the range of that. Beside it
//! each level has a coarser map ([`super::coarser`]).

use rayon::prelude::*;

use super::coarser::coarser;
use super::map::{LayerMap, Level, Piece, Plane};

/// What four siblings of the quadtree hold, the children `(2x, 2y)`, `(2x + 1, 2y)`, `(2x, 2y + 1)`,
/// `(2x + 1, 2y + 1)` of their parent `(x, y)`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub struct Quad {
    /// Least inverse depth; larger than the largest where there is nothing.
    pub low: [f32; 4],
    /// Largest inverse depth.
    pub high: [f32; 4],
    /// Least inverse depth of a surface that covers all of the node; -1 where there is none.
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
}

const NOTHING: Node = Node {
    low: f32::MAX,
    high: -1.0,
    cover: [-1.0, f32::MAX],
    covered: false,
    right: false,
    down: false,
};

/// Adds the coarser levels to a map of one, and the quadtree.
pub fn add_levels(map: &mut LayerMap) {
    let k = map.layers;
    let mut nodes = texels(&map.levels[0], k);
    loop {
        let finest = &map.levels[map.levels.len() - 1];
        let (width, height) = (finest.width, finest.height);
        let level = map.levels.len() - 1;
        let quads = quads(&nodes, width, height);
        if width == 1 && height == 1 {
            map.levels[level].quads = quads;
            return;
        }
        nodes = parents(&nodes, width, height);
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
            if let Some(piece) = first(x, y) {
                let (w, reach) = (piece.inverse_depth, piece.reach());
                node.covered = true;
                node.cover = [(w - reach).max(f32::MIN_POSITIVE), w + reach];
                let joined = |next: Option<Piece>, axis: usize| {
                    next.is_some_and(|next| Plane::from(piece).joins(&next.into(), axis))
                };
                node.right = x + 1 < width && joined(first(x + 1, y), 0);
                node.down = y + 1 < height && joined(first(x, y + 1), 1);
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

fn quads(nodes: &[Node], width: usize, height: usize) -> Vec<Quad> {
    let across = width.div_ceil(2);
    let make = |i: usize| {
        let four = siblings(nodes, width, height, i % across, i / across);
        Quad {
            low: four.map(|n| n.low),
            high: four.map(|n| n.high),
            cover_low: four.map(|n| n.cover[0]),
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
        }
    };
    (0..across * height.div_ceil(2))
        .into_par_iter()
        .map(make)
        .collect()
}
