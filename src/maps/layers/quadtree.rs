//! The quadtree of a map: least and largest depth of its nodes (Section 4.3).
//!
//! A node of level `l` covers 2ˡ × 2ˡ texels of the map. The quadtree keeps the nodes by parents, so that four
//! siblings lie in one cache line ([`Quad`]): the range of inverse depths of all that a node holds, a plane in front
//! of it, and, where all of its texels are covered by one connected opaque surface, the range of that. Beside it each
//! level has a coarser map ([`crate::maps::layers::coarser`]).
//!
//! Where no surface covers a node, but few end around it, the outline of a body passes: a coarser map knows it less
//! well than a finer one, which costs little, for an outline is thin. Such nodes are marked ([`Quad::is_outline`]).
//! Among leaves and hair, where everything is outline, none is: there the errors of many pieces cancel.

use rayon::prelude::*;

use super::coarser::coarser;
use super::map::{CoarsePiece, LayerMap, Level};
use super::quad::{NodeBounds, Quad};
use crate::control::Control;
use crate::error::Result;

/// Borders between texels, for each texel along the side of a node's grandparent, at which surfaces may end where
/// outlines pass: as many as on three oblique ones. With 4 the statue's penumbra has a tenth more error, with 8 the
/// tree takes a fifth longer.
const ENDS: u32 = 6;

/// A node while the tree is built.
#[derive(Debug, Clone, Copy)]
struct Node {
    /// What it holds; one opaque surface covers it, connected within, or none.
    bounds: NodeBounds,
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
    bounds: NodeBounds::NONE,
    right: false,
    down: false,
    ends: 0,
};

/// Adds the coarser levels to a map of one, and the quadtree.
///
/// # Errors
/// [`crate::error::Error::Cancelled`]: every row of nodes asks, for a large map takes seconds.
pub fn add_levels(map: &mut LayerMap, control: &Control) -> Result<()> {
    let k = map.layers;
    let (width, height) = (map.levels[0].width, map.levels[0].height);
    let mut nodes = texels(&map.levels[0], k, control)?;
    let mut above = parents(&nodes, width, height, 0, control)?;
    loop {
        let finest = &map.levels[map.levels.len() - 1];
        let (width, height) = (finest.width, finest.height);
        let level = map.levels.len() - 1;
        let (w, h) = (width.div_ceil(2), height.div_ceil(2));
        let grandparents = parents(&above, w, h, level + 1, control)?;
        let ends = if map.is_transparent() {
            0
        } else {
            ENDS << (level + 2)
        };
        let quads = quads(&nodes, &grandparents, ends, width, height, level, control)?;
        if width == 1 && height == 1 {
            map.levels[level].quads = quads;
            return Ok(());
        }
        (nodes, above) = (above, grandparents);
        let next = coarser(finest, k, level as u32, control)?;
        map.levels[level].quads = quads;
        map.levels.push(next);
    }
}

/// Nodes of the finest level.
fn texels(level: &Level, k: usize, control: &Control) -> Result<Vec<Node>> {
    let (width, height) = (level.width, level.height);
    let first = |x: usize, y: usize| {
        let (at, child) = level.place(x, y, k);
        let opaque = level.media.get(at).is_none_or(|m| m[child].through == 0.0);
        let piece = level.blocks[at].piece(child);
        (opaque && piece.is_some()).then_some(piece)
    };
    let node = |x: usize, y: usize| {
        let (at, child) = level.place(x, y, k);
        let mut node = NOTHING;
        let bounds = &mut node.bounds;
        for (i, block) in level.blocks[at..at + k].iter().enumerate() {
            let piece = block.piece(child);
            if !piece.is_some() {
                break;
            }
            let (w, reach) = (piece.inverse_depth, piece.reach());
            let nearest = level.media.get(at + i).map_or(w, |m| m[child].first);
            // A plane may reach beyond the eye's horizon within a texel; nothing does.
            bounds.low = bounds.low.min((w - reach).max(f32::MIN_POSITIVE));
            bounds.high = bounds.high.max(nearest + reach);
            if nearest > bounds.middle {
                (bounds.middle, bounds.slope) = (nearest, piece.slope());
            }
        }
        let here = first(x, y);
        let next = [(1, 0), (0, 1)].map(|(i, j)| {
            let (x, y) = (x + i, y + j);
            (x < width && y < height).then(|| first(x, y))
        });
        if let Some(piece) = here {
            let (w, reach) = (piece.inverse_depth, piece.reach());
            node.bounds.cover = Some([(w - reach).max(f32::MIN_POSITIVE), w + reach]);
            let joined = |axis: usize| {
                let next = next[axis].flatten();
                next.is_some_and(|next| CoarsePiece::from(piece).joins(&next.into(), axis))
            };
            (node.right, node.down) = (joined(0), joined(1));
        }
        for (next, goes_on) in next.into_iter().zip([node.right, node.down]) {
            let some = next.is_some_and(|next| here.is_some() || next.is_some());
            node.ends += u32::from(some && !goes_on);
        }
        node
    };
    by_rows(width, height, control, node)
}

/// What `make` makes of columns and rows, row by row.
fn by_rows<T: Send>(
    width: usize,
    height: usize,
    control: &Control,
    make: impl Fn(usize, usize) -> T + Sync,
) -> Result<Vec<T>> {
    let make = &make;
    let row = |y: usize| {
        // A row that is left out is an error below.
        let wanted = if control.check().is_ok() { width } else { 0 };
        (0..wanted).map(move |x| make(x, y))
    };
    let made = (0..height).into_par_iter().flat_map_iter(row).collect();
    control.check()?;
    Ok(made)
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

/// The quads of nodes, by their grandparents: outlines pass where at most so many borders are ends.
fn quads(
    nodes: &[Node],
    grandparents: &[Node],
    most: u32,
    width: usize,
    height: usize,
    level: usize,
    control: &Control,
) -> Result<Vec<Quad>> {
    let across = width.div_ceil(2);
    let make = |x: usize, y: usize| {
        let four = siblings(nodes, width, height, x, y);
        let ends = grandparents[y / 2 * across.div_ceil(2) + x / 2].ends;
        let outline = (1..=most).contains(&ends);
        Quad::new(&four.map(|n| n.bounds), (1u64 << level) as f32, outline)
    };
    by_rows(width.div_ceil(2), height.div_ceil(2), control, make)
}

fn parents(
    nodes: &[Node],
    width: usize,
    height: usize,
    level: usize,
    control: &Control,
) -> Result<Vec<Node>> {
    let make = |x: usize, y: usize| {
        let [a, b, c, d] = siblings(nodes, width, height, x, y);
        let all = [a, b, c, d].map(|n| n.bounds);
        let mut bounds = NodeBounds::of(&all, (1u64 << level) as f32);
        if a.right && c.right && a.down && b.down {
            let join = |[a, b]: [f32; 2], [c, d]: [f32; 2]| [a.min(c), b.max(d)];
            let covers = all.iter().map(|n| n.cover);
            bounds.cover = covers.reduce(|a, b| Some(join(a?, b?))).flatten();
        }
        Node {
            bounds,
            right: b.right && d.right,
            down: c.down && d.down,
            ends: a.ends + b.ends + c.ends + d.ends,
        }
    };
    by_rows(width.div_ceil(2), height.div_ceil(2), control, make)
}
