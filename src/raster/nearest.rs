//! The sink that keeps the nearest triangle of every pixel, in whatever order triangles come.

use super::{SPAN, Sink, Tile};

/// Marks a pixel that nothing covers.
pub const NONE: u32 = u32::MAX;

/// Inverse depth and triangle of a tile's pixels, in rows.
#[derive(Debug, Clone)]
pub struct Nearest {
    tile: Tile,
    /// 0 where nothing was hit.
    pub inverse_depth: Vec<f64>,
    /// [`NONE`] where nothing was hit; of triangles at equal depth the first.
    pub triangle: Vec<u32>,
}

impl Nearest {
    /// Whether a triangle's surface is to be kept at a place: it is nearer than what is there, or as near and the first.
    #[inline(always)]
    fn wins(&self, at: usize, inverse_depth: f64, triangle: u32) -> bool {
        let kept = self.inverse_depth[at];
        inverse_depth > kept || (inverse_depth == kept && triangle < self.triangle[at])
    }

    /// Whether all pixels in these columns and rows of the tile show something nearer than an inverse depth.
    #[inline(always)]
    pub(crate) fn hides(&self, low: [u32; 2], high: [u32; 2], inverse_depth: f64) -> bool {
        let width = self.tile.width as usize;
        let rows = self.inverse_depth[low[1] as usize * width..].chunks(width);
        // Free of branches in a row, for the compiler's vectoriser.
        rows.take((high[1] - low[1] + 1) as usize).all(|row| {
            let row = &row[low[0] as usize..=high[0] as usize];
            row.iter()
                .fold(true, |hides, &kept| hides & (kept > inverse_depth))
        })
    }

    /// An empty tile.
    pub fn new(tile: Tile) -> Self {
        let n = (tile.width * tile.height) as usize;
        Nearest {
            tile,
            inverse_depth: vec![0.0; n],
            triangle: vec![NONE; n],
        }
    }
}

impl Sink for Nearest {
    fn takes_pixels() -> bool {
        true
    }

    #[inline(always)]
    fn pixel(&mut self, x: u32, y: u32, inverse_depth: f64, triangle: u32) {
        let at = ((y - self.tile.y) * self.tile.width + (x - self.tile.x)) as usize;
        if self.wins(at, inverse_depth, triangle) {
            self.inverse_depth[at] = inverse_depth;
            self.triangle[at] = triangle;
        }
    }

    #[inline]
    fn span(&mut self, x: u32, y: u32, mask: u8, inverse_depth: &[f64; SPAN], triangle: u32) {
        let first = ((y - self.tile.y) * self.tile.width + (x - self.tile.x)) as usize;
        if mask == u8::MAX {
            // Without branches, for the middle of large triangles.
            let kept = &mut self.inverse_depth[first..first + SPAN];
            let ids = &mut self.triangle[first..first + SPAN];
            for i in 0..SPAN {
                let same = (inverse_depth[i] == kept[i]) & (triangle < ids[i]);
                let nearer = (inverse_depth[i] > kept[i]) | same;
                kept[i] = if nearer { inverse_depth[i] } else { kept[i] };
                ids[i] = if nearer { triangle } else { ids[i] };
            }
            return;
        }
        let mut left = mask;
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            if self.wins(first + i, inverse_depth[i], triangle) {
                self.inverse_depth[first + i] = inverse_depth[i];
                self.triangle[first + i] = triangle;
            }
        }
    }
}
