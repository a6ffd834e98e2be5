//! Drawing layered maps: a Z-buffer of `k` layers (Section 4.2), or all crossings compressed (Section 5.1).
//!
//! Both are sinks of the shared rasteriser. Opaque scenes get the first: of every texel, of the
//! nearest surfaces, sorted, equal depths once, the `k` that are farthest behind one another. Duplicate faces and what lies before the view's nearest plane take no
//! layer. With transparent casters all crossings of a tile are collected, sorted by texel and depth, and
//! compressed texel by texel; duplicates count as often as they are there.
//!
//! Memory is asked for before it is taken; a map that does not fit is an error.

use rayon::prelude::*;

use super::compress::{Compression, Crossing, compress};
use super::map::{Block, LayerMap, Level, Medium, Piece};
use super::quadtree::{TREE_BYTES, add_levels};
use super::views::LayerView;
use crate::casters::Casters;
use crate::control::Control;
use crate::error::Result;
use crate::geometry::Geometry;
use crate::memory;
use crate::raster::setup::Setup;
use crate::raster::{SPAN, Sink, TILE, Tile, rasterize, tile_count};

/// What is kept of a scene.
#[derive(Debug, Clone, Copy)]
pub struct Layers {
    /// Most layers of a texel.
    pub count: usize,
    /// The nearest surfaces of a texel that they are chosen from, where all are opaque; at least `count`.
    pub of: usize,
    /// How transparent crossings are compressed.
    pub compression: Compression,
    /// Whether meshes that are transparent count as opaque.
    pub opaque: bool,
}

impl Layers {
    /// The nearest `count` surfaces, all of them opaque.
    pub fn opaque(count: usize) -> Self {
        Layers {
            count,
            of: count,
            // Not used: nothing is transparent.
            compression: Compression {
                error: 0.0,
                threshold: 0.0,
                resets: 0,
            },
            opaque: true,
        }
    }
}

/// Draws the map of a view; a step a tile.
///
/// # Errors
/// A map that does not fit into memory, or [`crate::error::Error::Cancelled`].
pub fn layer_map(
    view: LayerView,
    casters: &Casters,
    layers: &Layers,
    control: &Control,
) -> Result<LayerMap> {
    let geometry = casters.geometry();
    let mut held = vec![false; geometry.faces.len()];
    for &face in view.faces.iter() {
        held[face as usize] = true;
    }
    control.expect(tile_count(&view.camera));
    let opacity = |m: &crate::geometry::MeshRange| geometry.material(m.entry).opacity;
    let clear = geometry.meshes.iter().any(|m| {
        let range = m.first_face as usize..(m.first_face + m.faces) as usize;
        opacity(m) < 1.0 && held[range].iter().any(|h| *h)
    });
    let transparent = clear && !layers.opaque;
    check_memory(&view, layers.count, layers.of, transparent)?;
    let (faces, camera) = (&geometry.faces, &view.camera);
    let keep = |face: u32| held[face as usize];
    let near = view.inverse_near;
    let (width, height) = (camera.width as usize, camera.height as usize);
    let k = layers.count;
    let mut level = Level::new(width, height, k, transparent);
    // A row of tiles is a whole number of rows of blocks.
    let rows = width.div_ceil(2) * (TILE as usize / 2) * k;
    let across = camera.width.div_ceil(TILE) as usize;
    if transparent {
        let make = |tile| AllCrossings::new(tile, near, geometry);
        let tiles = rasterize(&geometry.positions, faces, keep, camera, control, make)?;
        let blocks = level.blocks.par_chunks_mut(rows);
        blocks
            .zip(level.media.par_chunks_mut(rows))
            .zip(tiles.into_par_iter().chunks(across))
            .try_for_each(|((blocks, media), tiles)| {
                for (tile, sink) in tiles {
                    control.check()?;
                    sink.put(tile, width, k, &layers.compression, blocks, media);
                }
                Ok(())
            })?;
    } else {
        let of = layers.of.max(k);
        let make = |tile| NearestLayers::new(tile, near, of);
        let mut tiles = rasterize(&geometry.positions, faces, keep, camera, control, make)?;
        let blocks = level.blocks.par_chunks_mut(rows);
        blocks
            .zip(tiles.par_chunks_mut(across))
            .try_for_each(|(blocks, tiles)| {
                control.check()?;
                for (tile, sink) in tiles {
                    for (i, texel) in sink.pieces.chunks_exact_mut(of).enumerate() {
                        keep_apart(texel, k);
                        let (at, child) = in_row_of_tiles(tile, i as u32, width, k);
                        for (block, piece) in blocks[at..at + k].iter_mut().zip(texel) {
                            block.set(child, *piece);
                        }
                    }
                }
                Ok(())
            })?;
    }
    control.check()?;
    let mut map = LayerMap {
        view,
        layers: k,
        levels: vec![level],
    };
    add_levels(&mut map, control)?;
    Ok(map)
}

/// Moves those of a texel's surfaces to the front that are to be kept: in turn, the one that is the least behind
/// the one before it is left out. A segment that crosses it is the most likely to cross the other, too.
fn keep_apart(texel: &mut [Piece], keep: usize) {
    let filled = texel.iter().take_while(|p| p.is_some()).count();
    for left in (keep + 1..=filled).rev() {
        let behind = |i: &usize| texel[i - 1].inverse_depth - texel[*i].inverse_depth;
        let closest = (1..left).min_by(|a, b| behind(a).total_cmp(&behind(b)));
        if let Some(closest) = closest {
            texel.copy_within(closest + 1..left, closest);
        }
    }
}

/// Where a tile's texel number `i` is among the blocks of its row of tiles: its first layer, and which of the
/// four texels it is.
fn in_row_of_tiles(tile: &Tile, i: u32, width: usize, layers: usize) -> (usize, usize) {
    let (x, y) = (
        (tile.x + i % tile.width) as usize,
        (i / tile.width) as usize,
    );
    let block = y / 2 * width.div_ceil(2) + x / 2;
    (block * layers, y % 2 * 2 + x % 2)
}

/// Bytes that a map takes while it is built: its texels in levels, a third more for the coarser ones, and beside them
/// first in tiles, with all surfaces that layers are chosen from, then in the quadtree. A process was seen to grow by up
/// to one and a half times that: what tiles give back is not all taken again at once.
fn bytes_needed(view: &LayerView, layers: usize, of: usize, transparent: bool) -> usize {
    let layer = size_of::<Piece>() + if transparent { size_of::<Medium>() } else { 0 };
    let levels = layers.saturating_mul(layer).saturating_mul(4).div_ceil(3);
    let tiles = layers.max(of).saturating_mul(layer);
    let texel = levels.saturating_add(tiles.max(TREE_BYTES));
    let bytes = view.camera.pixels().saturating_mul(texel);
    bytes.saturating_mul(3) / 2
}

/// Fails if a map would take more memory than there is.
pub(crate) fn check_memory(
    view: &LayerView,
    layers: usize,
    of: usize,
    transparent: bool,
) -> Result<()> {
    let bytes = bytes_needed(view, layers, of, transparent);
    let (width, height) = (view.camera.width, view.camera.height);
    let what =
        || format!("layered shadow map: a map of {width} x {height} texels and {layers} layers");
    memory::check(what, bytes)
}

/// Change of inverse depth from texel to texel; a triangle smaller than a texel reaches no farther in depth
/// than its corners do.
#[inline(always)]
fn slope(setup: &Setup) -> [f32; 2] {
    let [x, y] = setup.slope();
    let [low, high] = setup.range();
    let (reach, extent) = (0.5 * (x.abs() + y.abs()), high - low);
    let scale = if reach > extent { extent / reach } else { 1.0 };
    [(x * scale) as f32, (y * scale) as f32]
}

/// The sink that keeps the nearest surfaces of every texel.
struct NearestLayers {
    tile: Tile,
    layers: usize,
    near: f64,
    slope: [f32; 2],
    pieces: Vec<Piece>,
}

impl NearestLayers {
    fn new(tile: Tile, near: f64, layers: usize) -> Self {
        NearestLayers {
            tile,
            layers,
            near,
            slope: [0.0; 2],
            pieces: vec![Piece::default(); (tile.width * tile.height) as usize * layers],
        }
    }
}

impl Sink for NearestLayers {
    fn surface(&mut self, _triangle: u32, setup: &Setup) {
        self.slope = slope(setup);
    }

    #[inline]
    fn span(&mut self, x: u32, y: u32, mask: u8, inverse_depth: &[f64; SPAN], _triangle: u32) {
        let first = ((y - self.tile.y) * self.tile.width + (x - self.tile.x)) as usize;
        let last = self.layers - 1;
        let mut left = mask;
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            if inverse_depth[i] > self.near {
                continue;
            }
            let depth = inverse_depth[i] as f32;
            let at = (first + i) * self.layers;
            let texel = &mut self.pieces[at..=at + last];
            if depth <= texel[last].inverse_depth {
                continue;
            }
            let place = texel.iter().take_while(|p| p.inverse_depth > depth).count();
            if texel[place].inverse_depth == depth {
                continue;
            }
            texel.copy_within(place..last, place + 1);
            texel[place] = Piece::new(depth, self.slope);
        }
    }
}

/// The sink that collects all crossings of a tile.
struct AllCrossings<'a> {
    tile: Tile,
    near: f64,
    geometry: &'a Geometry,
    slope: [f32; 2],
    through: f32,
    /// Texel of the tile, and what its ray crosses.
    crossings: Vec<(u32, Crossing)>,
}

impl<'a> AllCrossings<'a> {
    fn new(tile: Tile, near: f64, geometry: &'a Geometry) -> Self {
        AllCrossings {
            tile,
            near,
            geometry,
            slope: [0.0; 2],
            through: 0.0,
            crossings: Vec::new(),
        }
    }

    /// Compresses the tile's texels into rows of the image.
    fn put(
        mut self,
        tile: Tile,
        width: usize,
        layers: usize,
        how: &Compression,
        blocks: &mut [Block],
        media: &mut [[Medium; 4]],
    ) {
        // Stable, so that equal depths stay in the order of their triangles.
        self.crossings.sort_by(|(at, a), (bt, b)| {
            let depth = |c: &Crossing| c.piece.inverse_depth;
            at.cmp(bt).then(depth(b).total_cmp(&depth(a)))
        });
        let (mut list, mut out) = (Vec::new(), Vec::new());
        for texel in self.crossings.chunk_by(|a, b| a.0 == b.0) {
            list.clear();
            list.extend(texel.iter().map(|(_, c)| *c));
            compress(&list, layers, how, &mut out);
            let (at, child) = in_row_of_tiles(&tile, texel[0].0, width, layers);
            for (i, (piece, medium)) in out.iter().enumerate() {
                blocks[at + i].set(child, *piece);
                media[at + i][child] = *medium;
            }
        }
    }
}

impl Sink for AllCrossings<'_> {
    fn surface(&mut self, triangle: u32, setup: &Setup) {
        self.slope = slope(setup);
        let entry = self.geometry.mesh_of(triangle).entry;
        self.through = 1.0 - self.geometry.material(entry).opacity;
    }

    #[inline]
    fn span(&mut self, x: u32, y: u32, mask: u8, inverse_depth: &[f64; SPAN], _triangle: u32) {
        let first = (y - self.tile.y) * self.tile.width + (x - self.tile.x);
        let mut left = mask;
        while left != 0 {
            let i = left.trailing_zeros();
            left &= left - 1;
            let depth = inverse_depth[i as usize];
            if depth <= self.near {
                let piece = Piece::new(depth as f32, self.slope);
                let through = self.through;
                self.crossings
                    .push((first + i, Crossing { piece, through }));
            }
        }
    }
}
