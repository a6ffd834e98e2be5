//! What a layered map stores: per texel the nearest surfaces, each as a piece of its plane.
//!
//! A texel's layer is more than a depth. It keeps the plane of the triangle that covers the texel's centre,
//! as inverse depth and its change from texel to texel (inverse depth is linear in the image). A
//! segment meets the piece where it crosses that plane within the texel: a plane surface, however oblique, has
//! neither gaps between texels nor two hits at their border, and a thickness is needed only where planes
//! differ. Seen from anywhere, pieces cover in the mean over the texels what the triangles cover, also those
//! that are smaller than a texel.
//!
//! A layer of a transparent map may stand for several surfaces: `count` of them, evenly from `first` to its
//! own inverse depth, each with the transmittance `through` (Section 5.1).

use glam::Vec4;

use super::quadtree::Quad;
use super::views::LayerView;

/// One surface in one texel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(C)]
pub struct Piece {
    /// Inverse depth at the texel's centre; 0 where there is no surface.
    pub inverse_depth: f32,
    /// Change of inverse depth along a row and along a column, 16 bits each.
    slope: u32,
}

impl Piece {
    /// A piece with this change of inverse depth from texel to texel.
    pub fn new(inverse_depth: f32, slope: [f32; 2]) -> Self {
        // The upper half of an `f32`, rounded: eight bits of a slope are right to 0.4 % of the depth that it
        // adds within a texel.
        let upper = |x: f32| (x.to_bits().saturating_add(0x8000)) >> 16;
        Piece {
            inverse_depth,
            slope: upper(slope[0]) << 16 | upper(slope[1]),
        }
    }

    /// Whether there is a surface.
    #[inline(always)]
    pub fn is_some(&self) -> bool {
        self.inverse_depth > 0.0
    }

    /// Change of inverse depth from texel to texel, along a row and along a column.
    #[inline(always)]
    pub fn slope(&self) -> [f32; 2] {
        [
            f32::from_bits(self.slope & 0xffff_0000),
            f32::from_bits(self.slope << 16),
        ]
    }

    /// By how much its inverse depth differs from its centre's at most.
    #[inline(always)]
    pub fn reach(&self) -> f32 {
        let [x, y] = self.slope();
        0.5 * (x.abs() + y.abs())
    }
}

/// One layer of 2×2 texels, in the order of [`Quad`]'s children.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Block {
    /// [`Piece::inverse_depth`] of each.
    pub inverse_depth: [f32; 4],
    /// Their slopes, as a piece keeps them.
    pub slope: [u32; 4],
}

impl Block {
    /// The piece of one of its texels.
    #[inline(always)]
    pub fn piece(&self, child: usize) -> Piece {
        Piece {
            inverse_depth: self.inverse_depth[child],
            slope: self.slope[child],
        }
    }

    /// Sets the piece of one of its texels.
    #[inline(always)]
    pub fn set(&mut self, child: usize, piece: Piece) {
        (self.inverse_depth[child], self.slope[child]) = (piece.inverse_depth, piece.slope);
    }

    /// Slopes along rows and along columns.
    #[inline(always)]
    pub fn slopes(&self) -> [Vec4; 2] {
        [
            Vec4::from_array(self.slope.map(|s| f32::from_bits(s & 0xffff_0000))),
            Vec4::from_array(self.slope.map(|s| f32::from_bits(s << 16))),
        ]
    }
}

/// What a layer of a transparent map does to light.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Medium {
    /// Inverse depth of the nearest surface that it stands for.
    pub first: f32,
    /// Visibility behind it of the texel's own ray, from 1 at the light or behind what is opaque.
    pub visibility: f32,
    /// Transmittance of each of its surfaces.
    pub through: f32,
    /// Surfaces that it stands for.
    pub count: u32,
}

impl Medium {
    /// No surface.
    pub const NONE: Medium = Medium {
        first: 0.0,
        visibility: 1.0,
        through: 1.0,
        count: 0,
    };
}

/// One resolution of a map.
#[derive(Debug, Clone, Default)]
pub struct Level {
    /// Texels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The layers of each 2×2 texels, these row by row, the nearest to the eye first: tracing looks at four
    /// texels at once.
    pub blocks: Vec<Block>,
    /// What they let through, four for each block; empty where all are opaque.
    pub media: Vec<[Medium; 4]>,
    /// Of each 2×2 texels, row by row, what they hold: see [`Quad`].
    pub quads: Vec<Quad>,
}

impl Level {
    /// An empty level.
    pub fn new(width: usize, height: usize, layers: usize, transparent: bool) -> Self {
        let blocks = width.div_ceil(2) * height.div_ceil(2) * layers;
        Level {
            width,
            height,
            blocks: vec![Block::default(); blocks],
            media: vec![[Medium::NONE; 4]; if transparent { blocks } else { 0 }],
            quads: Vec::new(),
        }
    }

    /// Where the first layer of a texel is in `blocks` and `media`, and which of the four it is.
    #[inline(always)]
    pub fn place(&self, x: usize, y: usize, layers: usize) -> (usize, usize) {
        let block = (y / 2 * self.width.div_ceil(2) + x / 2) * layers;
        (block, y % 2 * 2 + x % 2)
    }
}

/// A layered shadow map.
#[derive(Debug, Clone)]
pub struct LayerMap {
    /// What it was drawn from.
    pub view: LayerView,
    /// Layers of a texel.
    pub layers: usize,
    /// From full resolution, each half as fine as the one before, to a single texel.
    pub levels: Vec<Level>,
}

impl LayerMap {
    /// Bytes of its arrays.
    pub fn bytes(&self) -> usize {
        let of = |l: &Level| {
            size_of_val(&l.blocks[..]) + size_of_val(&l.media[..]) + size_of_val(&l.quads[..])
        };
        self.levels.iter().map(of).sum()
    }

    /// The layers of a texel at full resolution, the nearest to the eye first.
    #[inline]
    pub fn texel(&self, x: usize, y: usize) -> impl Iterator<Item = Piece> {
        let (at, child) = self.levels[0].place(x, y, self.layers);
        let blocks = self.levels[0].blocks[at..at + self.layers].iter();
        blocks
            .map(move |b| b.piece(child))
            .take_while(Piece::is_some)
    }

    /// What the layers of a texel let through, if the map is transparent; otherwise nothing.
    #[inline]
    pub fn texel_media(&self, x: usize, y: usize) -> impl Iterator<Item = Medium> {
        let (at, child) = self.levels[0].place(x, y, self.layers);
        let media = self.levels[0].media.iter().skip(at).take(self.layers);
        media.map(move |m| m[child]).take_while(|m| m.count > 0)
    }

    /// Whether some of its layers let light through.
    pub fn is_transparent(&self) -> bool {
        !self.levels[0].media.is_empty()
    }
}
