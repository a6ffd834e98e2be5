//! Few triangles, given by their corners, drawn into one tile: what a leaf of a hierarchy holds.
//!
//! The same pixels and depths as [`super::rasterize`] finds, to the last bit. Triangles are projected here, as most of
//! a dense mesh never are.

use fearless_simd::Simd;

use super::depth::Depth;
use super::nearest::Nearest;
use super::small::{Covered, TriangleBatch, Window};
use super::{Sink, Tile, fill_whole};
use crate::camera::Camera;

/// Most triangles of a leaf.
pub(crate) const LEAF: usize = 8;

/// Triangles that leaves number.
#[derive(Clone, Copy)]
pub(crate) struct Triangles<'a> {
    /// Their corners, which tell those that are shared.
    pub(crate) faces: &'a [[u32; 3]],
    /// What the first is called in the picture.
    pub(crate) first: u32,
}

/// Draws leaves into one tile.
pub(crate) struct LeafPainter<'a> {
    camera: &'a Camera,
    tile: Tile,
    batch: TriangleBatch<LEAF>,
}

impl<'a> LeafPainter<'a> {
    /// Of what a camera sees in a tile.
    pub(crate) fn new(camera: &'a Camera, tile: Tile) -> Self {
        let batch = TriangleBatch::new();
        LeafPainter {
            camera,
            tile,
            batch,
        }
    }

    /// Draws `triangles` of a mesh with these corners, in columns for each corner and axis.
    #[inline(always)]
    pub(crate) fn draw<S: Simd>(
        &mut self,
        simd: S,
        mesh: Triangles<'_>,
        triangles: &[u32],
        corners: &[[[f32; LEAF]; 3]; 3],
        sink: &mut Nearest,
    ) {
        let window = Window::tile(self.tile);
        self.batch.look_at(simd, corners, self.camera, window);
        for (i, &face) in triangles.iter().enumerate() {
            let triangle = mesh.first + face;
            match self.batch.covered(i) {
                Covered::Nothing => {}
                Covered::Few(pixels, _) => {
                    let depth = Depth::new(&self.batch.corners(i));
                    for [x, y] in pixels {
                        let inverse_depth = depth.at(f64::from(x) + 0.5, f64::from(y) + 0.5);
                        sink.pixel(x, y, inverse_depth, triangle);
                    }
                }
                Covered::Within(..) | Covered::Unknown => {
                    let face = &mesh.faces[face as usize];
                    let corners = self.batch.corners(i);
                    fill_whole(simd, face, &corners, triangle, self.camera, self.tile, sink);
                }
            }
        }
    }
}
