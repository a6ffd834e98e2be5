//! The one triangle rasteriser.
//!
//! - this file: [`rasterize`], which bins triangles to tiles and hands each tile's fragments, triangle
//!   by triangle, to a [`Sink`] of the caller's choice;
//! - [`setup`]: from a triangle in space to edge functions and a depth plane in the image;
//! - [`nearest`]: the sink that keeps the nearest triangle a pixel.
//!
//! A pixel belongs to a triangle when its centre does; a centre on an edge that two triangles share
//! belongs to exactly one of them. Edge functions are `f64` and the same number, but for the sign, in
//! both triangles at an edge, so there are neither cracks nor double hits (but for a sliver that rounding
//! folds over its neighbour: it may be hit too). Screen coordinates are not snapped to a grid. Depth is perspective-correct, as `1 / z` in `f64`.

pub mod nearest;
pub mod setup;

use glam::Vec3;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::control::Control;
use crate::error::Result;
use crate::simd::{Lanes, detect, dispatch};
use setup::Setup;

/// Pixels in a span, the unit that sinks receive.
pub const SPAN: usize = 8;

/// Side of a tile in pixels: its 4096 depths and ids stay in the nearest caches.
pub const TILE: u32 = 64;

/// Triangles that one task sets up: enough to outweigh a task, few enough to balance.
const CHUNK: usize = 4096;

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
    /// Takes a span of pixels: bit `i` of `mask` is pixel `(x + i, y)`, covered by `triangle` at the
    /// inverse depth `inverse_depth[i]`. Triangles arrive in the order of their indices.
    fn span(&mut self, x: u32, y: u32, mask: u8, inverse_depth: &[f64; SPAN], triangle: u32);
}

struct Chunk {
    setups: Vec<Setup>,
    bins: Vec<Vec<u32>>,
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
    let columns = camera.width.div_ceil(TILE);
    let rows = camera.height.div_ceil(TILE);
    let points: Vec<_> = positions
        .par_iter()
        .map(|p| camera.project(p.as_dvec3()))
        .collect();
    let chunks: Vec<Chunk> = faces
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(c, faces)| {
            control.check()?;
            let mut chunk = Chunk {
                setups: Vec::new(),
                bins: vec![Vec::new(); (columns * rows) as usize],
            };
            for (i, face) in faces.iter().enumerate() {
                let id = (c * CHUNK + i) as u32;
                if keep(id) {
                    setup::triangles(face, &points, id, camera, &mut |setup| {
                        let place = chunk.setups.len() as u32;
                        for ty in setup.low[1] / TILE..=setup.high[1] / TILE {
                            for tx in setup.low[0] / TILE..=setup.high[0] / TILE {
                                chunk.bins[(ty * columns + tx) as usize].push(place);
                            }
                        }
                        chunk.setups.push(setup);
                    });
                }
            }
            Ok(chunk)
        })
        .collect::<Result<_>>()?;
    (0..columns * rows)
        .into_par_iter()
        .map(|index| {
            control.step()?;
            let (x, y) = (index % columns * TILE, index / columns * TILE);
            let tile = Tile {
                x,
                y,
                width: TILE.min(camera.width - x),
                height: TILE.min(camera.height - y),
            };
            let mut sink = make(tile);
            for chunk in &chunks {
                let bin = &chunk.bins[index as usize];
                fill(&chunk.setups, bin, tile, &mut sink);
            }
            Ok((tile, sink))
        })
        .collect()
}

fn fill<T: Sink>(setups: &[Setup], bin: &[u32], tile: Tile, sink: &mut T) {
    // A generic item cannot be named inside the functions that `dispatch!` makes, hence the trait
    // object; it is called once a span.
    let sink: &mut dyn Sink = sink;
    dispatch!(detect() => fill_lanes(setups: &[Setup], bin: &[u32], tile: Tile, sink: &mut dyn Sink));
}

/// Compiled once per instruction set; the loops over a span are left to the compiler's vectoriser,
/// which turns these few independent `f64` operations into whole registers.
#[inline(always)]
unsafe fn fill_lanes<S: Lanes>(setups: &[Setup], bin: &[u32], tile: Tile, sink: &mut dyn Sink) {
    for &place in bin {
        let setup = &setups[place as usize];
        let x_end = setup.high[0].min(tile.x + tile.width - 1);
        let y_end = setup.high[1].min(tile.y + tile.height - 1);
        let x_start = setup.low[0].max(tile.x);
        for y in setup.low[1].max(tile.y)..=y_end {
            let row = setup.row(y);
            let mut x = x_start;
            while x <= x_end {
                // SAFETY: the caller enabled the features of `S`.
                let mut mask = unsafe { row.inside::<S>(x) };
                let left = x_end - x + 1;
                if left < SPAN as u32 {
                    mask &= (1u8 << left) - 1;
                }
                if mask != 0 {
                    sink.span(x, y, mask, &row.inverse_depth(x), setup.triangle);
                }
                x += SPAN as u32;
            }
        }
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
