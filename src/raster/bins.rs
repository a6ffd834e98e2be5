//! Which triangles reach into each tile of the image, chunk by chunk of them.
//!
//! What is known of their pixels here goes along ([`super::small`]).

use glam::DVec3;
use rayon::prelude::*;

use super::depth::Depth;
use super::setup::{self, ClippedTriangle};
use super::small::{self, Covered};
use super::{Sink, TILE, tile_count};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Result;

/// Triangles that one task puts into bins: enough to outweigh a task, few enough to balance.
const CHUNK: usize = 4096;

/// What a chunk of triangles has for each tile, in order: that of tile `t` is `items[starts[t]..starts[t + 1]]`.
pub(super) struct Bins<T> {
    starts: Vec<u32>,
    items: Vec<T>,
}

impl<T: Copy + Default> Bins<T> {
    /// Sorts pairs of a tile and an item by tile; pairs of one tile keep their order.
    pub(super) fn new(pairs: &[(u32, T)], tiles: usize) -> Self {
        // Counted two places up, the counts become the starts, and these the ends, as the bins fill.
        let mut starts = vec![0; tiles + 2];
        for &(tile, _) in pairs {
            starts[tile as usize + 2] += 1;
        }
        for t in 2..starts.len() {
            starts[t] += starts[t - 1];
        }
        let mut items = vec![T::default(); pairs.len()];
        for &(tile, item) in pairs {
            let place = &mut starts[tile as usize + 1];
            items[*place as usize] = item;
            *place += 1;
        }
        Bins { starts, items }
    }

    /// What there is of a tile.
    pub(super) fn of(&self, tile: usize) -> &[T] {
        &self.items[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
}

/// What is known of a triangle in a tile.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Item {
    pub(super) triangle: u32,
    /// [`Item::WHOLE`], or a pixel that it covers: `x + TILE y` within the tile.
    pub(super) pixel: u32,
    /// Inverse depth at the pixel.
    pub(super) inverse_depth: f64,
}

impl Item {
    /// Says that the triangle's pixels are still to be found.
    const WHOLE: u32 = u32::MAX;

    /// A pixel of the image.
    #[inline(always)]
    fn new(triangle: u32, x: u32, y: u32, depth: &Depth) -> Self {
        Item {
            triangle,
            pixel: x % TILE + y % TILE * TILE,
            inverse_depth: depth.at(f64::from(x) + 0.5, f64::from(y) + 0.5),
        }
    }

    fn whole(triangle: u32) -> Self {
        Item {
            triangle,
            pixel: Self::WHOLE,
            inverse_depth: 0.0,
        }
    }

    /// Whether its pixels are still to be found.
    pub(super) fn is_whole(&self) -> bool {
        self.pixel == Self::WHOLE
    }
}

/// Sorts the triangles that can cover pixels into the tiles that they reach, and the pixels of small ones if the
/// sink takes them, of points that [`small::on_screen`] found at `screen`.
pub(super) fn items<S: Sink>(
    points: &[DVec3],
    screen: &[[f64; 2]],
    faces: &[[u32; 3]],
    keep: impl Fn(u32) -> bool + Sync,
    camera: &Camera,
    control: &Control,
) -> Result<Vec<Bins<Item>>> {
    let columns = camera.width.div_ceil(TILE);
    faces
        .par_chunks(CHUNK)
        .enumerate()
        .map_init(
            || (Vec::new(), small::TriangleBatch::<{ small::BLOCK }>::new()),
            |(pairs, block), (c, faces)| {
                control.check()?;
                pairs.clear();
                for (b, faces) in faces.chunks(small::BLOCK).enumerate() {
                    block.look(faces, screen, camera);
                    if S::takes_pixels() {
                        block.find_depth(faces, points);
                    }
                    for (i, face) in faces.iter().enumerate() {
                        let triangle = (c * CHUNK + b * small::BLOCK + i) as u32;
                        let within = match block.covered(i) {
                            Covered::Nothing => continue,
                            Covered::Few(pixels, depth) if S::takes_pixels() => {
                                if keep(triangle) {
                                    pairs.extend(pixels.map(|[x, y]| {
                                        let tile = y / TILE * columns + x / TILE;
                                        (tile, Item::new(triangle, x, y, &depth))
                                    }));
                                }
                                continue;
                            }
                            Covered::Few(pixels, _) => Some(pixels.bounds()),
                            Covered::Within(low, high) => Some((low, high)),
                            Covered::Unknown => setup::pixels_of(face, points, camera),
                        };
                        let Some((low, high)) = within.filter(|_| keep(triangle)) else {
                            continue;
                        };
                        let item = Item::whole(triangle);
                        reached(face, points, low, high, columns, |tile| {
                            pairs.push((tile, item))
                        });
                    }
                }
                Ok(Bins::new(pairs, tile_count(camera)))
            },
        )
        .collect()
}

/// Calls `each` for the tiles, in rows of `columns`, that a triangle with its pixels between `low` and `high` can
/// reach into.
#[inline(always)]
fn reached(
    face: &[u32; 3],
    points: &[DVec3],
    low: [u32; 2],
    high: [u32; 2],
    columns: u32,
    mut each: impl FnMut(u32),
) {
    let [xs, ys] = [0, 1].map(|i| low[i] / TILE..=high[i] / TILE);
    // A long sliver lies in few of the tiles of its bounds.
    let long = xs.end() - xs.start() > 1 && ys.end() - ys.start() > 1;
    let outline = long.then(|| ClippedTriangle::new(face, points));
    for ty in ys {
        let mut xs = xs.clone();
        if let Some(outline) = &outline {
            let top = f64::from(ty * TILE) - 1.0;
            let (x0, x1) = outline.extent(top, top + f64::from(TILE) + 2.0);
            let first = (x0.max(0.0) as u32 / TILE).max(*xs.start());
            xs = first..=(x1.max(0.0) as u32 / TILE).min(*xs.end());
        }
        xs.for_each(|tx| each(ty * columns + tx));
    }
}
