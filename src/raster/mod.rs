//! The one triangle rasteriser.
//!
//! - this file: [`rasterize`], which bins triangles to tiles and hands each tile's fragments, triangle
//!   by triangle, to a [`Sink`] of the caller's choice;
//! - `bins`: which triangles reach into each tile;
//! - `small`: the pixels of triangles that cover a few, found where they are binned;
//! - `leaf`: triangles that a hierarchy gives, a leaf at a time, drawn into a tile;
//! - [`setup`]: from a triangle in space to edge functions in the image, and `depth`, its depth plane there;
//! - [`nearest`]: the sink that keeps the nearest triangle a pixel;
//! - [`coverage`]: the pixels that triangles cover, row by row, for hard shadows that need no depth.
//!
//! A pixel belongs to a triangle when its centre does; a centre on an edge that two triangles share
//! belongs to exactly one of them. Edge functions are `f64` and the same number, but for the sign, in
//! both triangles at an edge, so there are neither cracks nor double hits (but for a sliver that rounding
//! folds over its neighbour: it may be hit too). Screen coordinates are not snapped to a grid. Depth is perspective-correct, as `1 / z` in `f64`.

mod bins;
pub mod coverage;
mod depth;
pub(crate) mod leaf;
pub mod nearest;
pub mod setup;
mod small;

use fearless_simd::{Simd, dispatch};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::control::Control;
use crate::error::Result;
use crate::memory::filled;
use crate::simd::detect;
use bins::{Bins, Item};
use coverage::{Quadrilateral, Rows};
use nearest::NONE;
use setup::{PixelBounds, PixelCentres, SHAPES, Setup};

/// Pixels in a span, the unit that sinks receive.
pub const SPAN: usize = 8;

/// Side of a tile in pixels: its 4096 depths and ids stay in the nearest caches.
pub const TILE: u32 = 64;

/// A tile of the image; its right and lower end may lie in the image's last, partial tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tile {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// What becomes of the fragments of one tile.
pub trait Sink: Send {
    /// Whether pixels of small triangles may come by [`Sink::pixel`], without what the other functions are told
    /// of a triangle.
    fn takes_pixels() -> bool
    where
        Self: Sized,
    {
        false
    }

    /// Takes a pixel alone, as [`Sink::span`] does.
    fn pixel(&mut self, x: u32, y: u32, inverse_depth: f64, triangle: u32)
    where
        Self: Sized,
    {
        self.span(x, y, 1, &[inverse_depth; SPAN], triangle);
    }

    /// Takes a span of pixels: bit `i` of `mask` is pixel `(x + i, y)`, covered by `triangle` at the
    /// inverse depth `inverse_depth[i]`. Triangles arrive in the order of their indices.
    fn span(&mut self, x: u32, y: u32, mask: u8, inverse_depth: &[f64; SPAN], triangle: u32);

    /// Is told of a triangle, or of a part of one that the near plane cuts, before its spans come.
    fn surface(&mut self, _triangle: u32, _setup: &Setup) {}
}

/// Number of tiles of an image: the steps that [`rasterize`] takes.
pub fn tile_count(camera: &Camera) -> usize {
    (camera.width.div_ceil(TILE) * camera.height.div_ceil(TILE)) as usize
}

/// Rasterises `faces` (those for which `keep` is true) and returns every tile's sink, in rows of
/// tiles from the top left, with one [`Control::step`] each.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub fn rasterize<S: Sink>(
    positions: &[Vec3],
    faces: &[[u32; 3]],
    keep: impl Fn(u32) -> bool + Sync,
    camera: &Camera,
    control: &Control,
    make: impl Fn(Tile) -> S + Sync,
) -> Result<Vec<(Tile, S)>> {
    let (points, screen): (Vec<_>, Vec<_>) = positions
        .par_iter()
        .map(|p| {
            let p = camera.project(p.as_dvec3());
            (p, small::on_screen(p))
        })
        .unzip();
    rasterize_on_screen(&points, &screen, faces, keep, camera, control, make)
}

/// Draws as [`rasterize`] does, from points in `f64` as [`Camera::project`] gives them.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub fn rasterize_projected<S: Sink>(
    points: &[DVec3],
    faces: &[[u32; 3]],
    keep: impl Fn(u32) -> bool + Sync,
    camera: &Camera,
    control: &Control,
    make: impl Fn(Tile) -> S + Sync,
) -> Result<Vec<(Tile, S)>> {
    let screen: Vec<_> = points.par_iter().map(|&p| small::on_screen(p)).collect();
    rasterize_on_screen(points, &screen, faces, keep, camera, control, make)
}

fn rasterize_on_screen<S: Sink>(
    points: &[DVec3],
    screen: &[[f64; 2]],
    faces: &[[u32; 3]],
    keep: impl Fn(u32) -> bool + Sync,
    camera: &Camera,
    control: &Control,
    make: impl Fn(Tile) -> S + Sync,
) -> Result<Vec<(Tile, S)>> {
    let chunks = bins::items::<S>(points, screen, faces, keep, camera, control)?;
    each_tile(camera, control, make, |index, tile, sink| {
        for chunk in &chunks {
            fill(faces, points, chunk.of(index), camera, tile, sink);
        }
    })
}

/// What [`cover_projected`] needs to know of a point.
pub fn project(p: DVec3, camera: &Camera) -> (DVec3, PixelBounds) {
    let p = camera.project(p);
    (p, PixelBounds::of_vertex(p, camera))
}

/// What becomes of the pixels that polygons cover in one tile.
pub trait Cover: Send {
    /// Takes the pixels of row `y` from column `first` to `last`, covered by `face`. Faces arrive in the order of
    /// their indices, some in several parts.
    fn row(&mut self, y: u32, first: u32, last: u32, face: u32);

    /// Whether the tile needs the pixels of a face at all; asked before each of its parts comes.
    fn wants(&mut self, _face: u32) -> bool {
        true
    }
}

/// A face in a tile, and which of [`TiledPolygons::rows`] it is drawn by, or [`NONE`].
type TileFace = (u32, u32);

/// Some polygons by tile.
struct TiledPolygons {
    /// The rows of polygons that lie in several tiles; the rows of one tile's polygons are set up there, which saves
    /// writing and reading them.
    rows: Vec<Rows<4>>,
    bins: Bins<TileFace>,
}

/// Polygons that one task sets up: mostly long ones, of which a scene has thousands.
const POLYGONS: usize = 512;

/// The pixels that convex polygons cover, without depth, of points for each of which [`project`] was called.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub fn cover_projected<S: Cover>(
    points: &[DVec3],
    bounds: &[PixelBounds],
    faces: &[Quadrilateral],
    camera: &Camera,
    control: &Control,
    make: impl Fn(Tile) -> S + Sync,
) -> Result<Vec<(Tile, S)>> {
    let (columns, tiles) = (camera.width.div_ceil(TILE), tile_count(camera));
    let parts = |(chunk, faces): (usize, &[Quadrilateral])| {
        let (mut rows, mut pairs) = (Vec::new(), Vec::with_capacity(faces.len()));
        for (i, face) in faces.iter().enumerate() {
            let id = (chunk * POLYGONS + i) as u32;
            if let Some((low, high)) = coverage::within(face, bounds) {
                let [first, last] = [low, high].map(|[x, y]| y / TILE * columns + x / TILE);
                if first == last {
                    pairs.push((first, (id, NONE)));
                    continue;
                }
            }
            Rows::each(face, points, bounds, camera, |part| {
                for ty in part.low[1] / TILE..=part.high[1] / TILE {
                    // A long sliver lies in few of the tiles of its bounds.
                    let (top, bottom) = (ty * TILE, ty * TILE + TILE - 1);
                    let (top, bottom) = (top.max(part.low[1]), bottom.min(part.high[1]));
                    let [first, last] = part.columns(top, bottom).map(|x| x / TILE);
                    let place = rows.len() as u32;
                    pairs.extend((first..=last).map(|tx| (ty * columns + tx, (id, place))));
                }
                rows.push(part);
            });
        }
        let bins = Bins::new(&pairs, tiles);
        TiledPolygons { rows, bins }
    };
    let chunks: Vec<_> = faces.par_chunks(POLYGONS).enumerate().map(parts).collect();
    control.check()?;
    each_tile(camera, control, make, |index, tile, sink| {
        for chunk in &chunks {
            for &(id, place) in chunk.bins.of(index) {
                if !sink.wants(id) {
                    continue;
                }
                let mut draw = |rows: &Rows<4>| {
                    rows.within(tile, |y, first, last| sink.row(y, first, last, id));
                };
                match place {
                    NONE => {
                        let face = &faces[id as usize];
                        Rows::each(face, points, bounds, camera, |rows| draw(&rows));
                    }
                    place => draw(&chunk.rows[place as usize]),
                }
            }
        }
    })
}

/// Makes every tile's sink and lets `draw(number, tile, sink)` draw into it.
pub(crate) fn each_tile<S: Send>(
    camera: &Camera,
    control: &Control,
    make: impl Fn(Tile) -> S + Sync,
    draw: impl Fn(usize, Tile, &mut S) + Sync,
) -> Result<Vec<(Tile, S)>> {
    let columns = camera.width.div_ceil(TILE);
    // One by one: their work is as uneven as the picture.
    (0..tile_count(camera))
        .into_par_iter()
        .with_max_len(1)
        .map(|index| {
            control.step()?;
            let (x, y) = (index as u32 % columns * TILE, index as u32 / columns * TILE);
            let tile = Tile {
                x,
                y,
                width: TILE.min(camera.width - x),
                height: TILE.min(camera.height - y),
            };
            let mut sink = make(tile);
            draw(index, tile, &mut sink);
            Ok((tile, sink))
        })
        .collect()
}

/// The image that the tiles of a camera make up: `of` gives a sink's values, row by row of its tile.
pub fn image<S: Sync, T: Copy + Default + Send + Sync>(
    tiles: &[(Tile, S)],
    camera: &Camera,
    of: impl Fn(&S) -> &[T] + Sync,
) -> Vec<T> {
    let width = camera.width as usize;
    let mut image = filled(T::default(), camera.pixels());
    image
        .par_chunks_mut(width * TILE as usize)
        .zip(tiles.par_chunks(camera.width.div_ceil(TILE) as usize))
        .for_each(|(image, tiles)| {
            for (tile, sink) in tiles {
                let rows = of(sink).chunks_exact(tile.width as usize);
                for (to, from) in image.chunks_mut(width).zip(rows) {
                    to[tile.x as usize..][..from.len()].copy_from_slice(from);
                }
            }
        });
    image
}

/// Draws the pixels that are known, and sets up and fills what else there is of triangles in a tile. A triangle is
/// set up once a tile: most lie in one, and edge functions kept in memory from a pass of their own take longer to
/// write and read.
fn fill<T: Sink>(
    faces: &[[u32; 3]],
    points: &[DVec3],
    items: &[Item],
    camera: &Camera,
    tile: Tile,
    sink: &mut T,
) {
    for items in items.chunk_by(|a, b| a.is_whole() == b.is_whole()) {
        if items[0].is_whole() {
            // A trait object, so that the kernel is compiled once a level and not for every sink as well; it is called
            // once a span.
            let sink: &mut dyn Sink = sink;
            dispatch!(detect(), simd => fill_lanes(simd, faces, points, items, camera, tile, sink));
        } else {
            for item in items {
                let (x, y) = (item.pixel % TILE, item.pixel / TILE);
                sink.pixel(tile.x + x, tile.y + y, item.inverse_depth, item.triangle);
            }
        }
    }
}

/// Compiled once per instruction set; the loops over a block's pixels are left to the compiler's
/// vectoriser, which turns these few independent `f64` operations into whole registers.
#[inline(always)]
fn fill_lanes<S: Simd>(
    simd: S,
    faces: &[[u32; 3]],
    points: &[DVec3],
    items: &[Item],
    camera: &Camera,
    tile: Tile,
    sink: &mut dyn Sink,
) {
    for &Item { triangle, .. } in items {
        let face = &faces[triangle as usize];
        let corners = face.map(|v| points[v as usize]);
        fill_whole(simd, face, &corners, triangle, camera, tile, sink);
    }
}

/// Sets up and fills a triangle, by its projected corners.
#[inline(always)]
fn fill_whole<S: Simd>(
    simd: S,
    face: &[u32; 3],
    corners: &[DVec3; 3],
    triangle: u32,
    camera: &Camera,
    tile: Tile,
    sink: &mut dyn Sink,
) {
    if corners.iter().all(|p| p.z >= setup::NEAR) {
        if let Some(setup) = setup::triangle(corners, camera) {
            sink.surface(triangle, &setup);
            fill_one(simd, &setup, triangle, tile, sink);
        }
    } else {
        for setup in setup::clipped_corners(face, corners, camera)
            .iter()
            .flatten()
        {
            sink.surface(triangle, setup);
            fill_one(simd, setup, triangle, tile, sink);
        }
    }
}

#[inline(always)]
fn fill_one<S: Simd>(simd: S, setup: &Setup, triangle: u32, tile: Tile, sink: &mut dyn Sink) {
    let (x_start, y_start) = (setup.low[0].max(tile.x), setup.low[1].max(tile.y));
    let x_end = setup.high[0].min(tile.x + tile.width - 1);
    let y_end = setup.high[1].min(tile.y + tile.height - 1);
    if x_start > x_end || y_start > y_end {
        return;
    }
    // Narrow triangles are seen in blocks of several rows.
    let shape = &SHAPES[(x_end - x_start + 1)
        .next_power_of_two()
        .trailing_zeros()
        .min(3) as usize];
    let (columns, rows) = (shape.columns, SPAN as u32 / shape.columns);
    // Only wide triangles are worth the divisions.
    let crossings = (columns == 8).then(|| setup.crossings());
    let mut y = y_start;
    while y <= y_end {
        let (mut x, x_end) = match &crossings {
            Some(crossings) => setup::columns(crossings, y, x_start, x_end),
            None => (x_start, x_end),
        };
        while x <= x_end {
            let block = PixelCentres::new(shape, x, y);
            let within = shape.first(x_end - x + 1, y_end - y + 1);
            let mask = setup.inside(simd, &block, within);
            if mask != 0 {
                let depth = setup.inverse_depth(&block);
                for row in 0..rows {
                    let from = (row * columns) as usize;
                    let mask = (mask >> from) & shape.row;
                    if mask != 0 {
                        let depth = depth[from..]
                            .first_chunk()
                            .expect("a span from any pixel on");
                        sink.span(x, y + row, mask, depth, triangle);
                    }
                }
            }
            x += columns;
        }
        y += rows;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};
    use std::collections::HashMap;

    struct Count(HashMap<(u32, u32), Vec<u32>>);

    impl Sink for Count {
        fn span(&mut self, x: u32, y: u32, mask: u8, _: &[f64; SPAN], triangle: u32) {
            for i in (0..SPAN as u32).filter(|i| mask >> i & 1 == 1) {
                self.0.entry((x + i, y)).or_default().push(triangle);
            }
        }
    }

    /// A camera at the origin looking along z; image plane of 128 × 96 at unit focal length 100.
    fn camera() -> Camera {
        let k = DMat3::from_cols_array(&[100.0, 0.0, 0.0, 0.0, 100.0, 0.0, 64.0, 48.0, 1.0]);
        Camera::new(k, DMat3::IDENTITY, DVec3::ZERO, 128, 96).unwrap()
    }

    fn hits(positions: &[Vec3], faces: &[[u32; 3]]) -> HashMap<(u32, u32), Vec<u32>> {
        let control = Control::default();
        let make = |_| Count(HashMap::new());
        let tiles = rasterize(positions, faces, |_| true, &camera(), &control, make).unwrap();
        tiles.into_iter().flat_map(|(_, s)| s.0).collect()
    }

    #[test]
    fn a_fan_whose_spokes_run_through_pixel_centres_covers_every_pixel_once() {
        // Hub at a pixel centre; spokes horizontal, vertical, diagonal and in between.
        let hub = Vec3::new(0.005, 0.005, 1.0);
        let rim = [
            (4, 0),
            (4, 4),
            (2, 4),
            (0, 4),
            (-4, 4),
            (-4, 0),
            (-4, -4),
            (0, -4),
            (3, -4),
        ];
        let mut positions = vec![hub];
        positions.extend(rim.map(|(x, y)| hub + Vec3::new(x as f32, y as f32, 0.0)));
        let n = rim.len() as u32;
        let faces: Vec<_> = (0..n).map(|k| [0, 1 + k, 1 + (k + 1) % n]).collect();
        let hits = hits(&positions, &faces);
        assert_eq!(hits.len(), 128 * 96);
        assert!(hits.values().all(|h| h.len() == 1));
    }

    #[test]
    fn triangles_that_reach_behind_the_camera_are_clipped_without_cracks() {
        // A floor from far ahead to behind the camera, split along a diagonal.
        let y = 0.5;
        let corner = |x: f32, z: f32| Vec3::new(x, y, z);
        let positions = [
            corner(-9.0, -9.0),
            corner(9.0, -9.0),
            corner(9.0, 50.0),
            corner(-9.0, 50.0),
        ];
        let hits = hits(&positions, &[[0, 1, 2], [0, 2, 3]]);
        assert!(hits.values().all(|h| h.len() == 1));
        // Below the horizon's row all 128 columns are floor as far as the floor is wide.
        for row in 60..96 {
            let z = 100.0 * f64::from(y) / (f64::from(row) + 0.5 - 48.0);
            let half = 100.0 * 9.0 / z;
            let expected = (0..128)
                .filter(|x| (f64::from(*x) + 0.5 - 64.0).abs() < half)
                .count();
            let got = (0..128).filter(|&x| hits.contains_key(&(x, row))).count();
            assert_eq!(got, expected, "row {row}");
        }
    }

    #[test]
    fn degenerate_and_off_screen_triangles_leave_nothing() {
        let p = [
            Vec3::Z,
            Vec3::new(0.3, 0.2, 1.0),
            Vec3::new(0.6, 0.4, 1.0),
            -Vec3::Z,
            Vec3::new(9.0, 9.0, 1.0),
        ];
        assert!(hits(&p, &[[0, 1, 2], [0, 0, 1], [3, 3, 3], [4, 4, 0]]).is_empty());
    }
}
