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

use super::quad::Quad;
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

/// The part of a texel that a piece fills, in quarters: left, right, upper and lower side.
pub type TexelPart = [u32; 4];

/// The part that is all of a texel.
pub const WHOLE: TexelPart = [0, 4, 0, 4];

/// A slope and a part in 32 bits, from the highest: two slopes, eight bits each, as multiples of a power of two; that
/// power, eight bits; two bits for each side, by how many quarters it is moved in. The steeper slope is right to 0.4 %
/// of the depth that it adds within a texel.
fn packed(slope: [f32; 2], part: TexelPart) -> u32 {
    let steepest = slope[0].abs().max(slope[1].abs());
    let (mut whole, mut power) = ([0.0; 2], 0);
    if steepest > FLAT {
        // The steeper becomes 64 to 127.
        power = (steepest * (129.0 / 128.0)).to_bits() >> 23;
        whole = slope.map(|s| (s / f32::from_bits((power - 6) << 23)).round());
        power -= 30;
    }
    let [x, y] = whole.map(|s| u32::from(s as i8 as u8));
    let [left, right, upper, lower] = part;
    x << 24 | y << 16 | power << 8 | left << 6 | (4 - right) << 4 | upper << 2 | (4 - lower)
}

/// Slopes up to which no depth changes: twice the power of two that is kept as 1.
const FLAT: f32 = 1.0 / (1u128 << 95) as f32;

/// A slope, eight bits at the top, as a multiple of [`unit()`].
#[inline(always)]
fn multiple(packed: u32) -> f32 {
    (packed & 0xff00_0000) as i32 as f32
}

#[inline(always)]
fn unit(packed: u32) -> f32 {
    f32::from_bits(packed << 15 & 0x7f80_0000)
}

/// A piece of a coarser map, unpacked: it may fill a part of its texel.
#[derive(Debug, Clone, Copy)]
pub struct CoarsePiece {
    /// Inverse depth in the middle of the part that it fills.
    pub inverse_depth: f32,
    /// Its change from texel to texel, along a row and along a column.
    pub slope: [f32; 2],
    /// The part of the texel that it fills.
    pub part: TexelPart,
}

impl From<Piece> for CoarsePiece {
    fn from(piece: Piece) -> Self {
        CoarsePiece {
            inverse_depth: piece.inverse_depth,
            slope: piece.slope(),
            part: WHOLE,
        }
    }
}

impl CoarsePiece {
    /// By how much its inverse depth is more in the middle of its part than at the texel's centre.
    pub fn rise(&self) -> f32 {
        let [left, right, upper, lower] = self.part.map(|side| side as f32);
        0.125 * (self.slope[0] * (left + right - 4.0) + self.slope[1] * (upper + lower - 4.0))
    }

    /// Inverse depth at the texel's centre.
    pub fn at_center(&self) -> f32 {
        self.inverse_depth - self.rise()
    }

    /// Whether the next one, to the right (`axis` 0) or below, is of the same surface: at the border between them
    /// they are no farther apart than one of them rises over a texel.
    pub fn joins(&self, next: &CoarsePiece, axis: usize) -> bool {
        let (here, there) = (
            self.at_center() + 0.5 * self.slope[axis],
            next.at_center() - 0.5 * next.slope[axis],
        );
        let rise = |p: &CoarsePiece| p.slope[0].abs() + p.slope[1].abs();
        (here - there).abs() <= rise(self).max(rise(next))
    }
}

/// One layer of 2×2 texels, in the order of [`Quad`]'s children.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(C, align(32))]
pub struct Block {
    /// [`Piece::inverse_depth`] of each.
    pub inverse_depth: [f32; 4],
    /// Their slopes, as a piece keeps them; in coarser maps slopes and parts, as `packed` makes them. The inverse depth
    /// is there that in the middle of the part.
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

    /// The piece of one of the texels of a coarser map; nothing where there is no surface.
    #[inline(always)]
    pub fn plane(&self, child: usize) -> Option<CoarsePiece> {
        let (inverse_depth, p) = (self.inverse_depth[child], self.slope[child]);
        (inverse_depth > 0.0).then(|| CoarsePiece {
            inverse_depth,
            slope: [p, p << 8].map(|m| multiple(m) * unit(p)),
            part: [p >> 6 & 3, 4 - (p >> 4 & 3), p >> 2 & 3, 4 - (p & 3)],
        })
    }

    /// Sets the piece of one of the texels of a coarser map.
    #[inline(always)]
    pub fn set_plane(&mut self, child: usize, plane: &CoarsePiece) {
        self.inverse_depth[child] = plane.inverse_depth;
        self.slope[child] = packed(plane.slope, plane.part);
    }

    /// Slopes along rows and along columns in a coarser map.
    #[inline(always)]
    pub fn coarse_slopes(&self) -> [Vec4; 2] {
        let unit = Vec4::from_array(self.slope.map(unit));
        let along = Vec4::from_array(self.slope.map(multiple));
        let down = Vec4::from_array(self.slope.map(|p| multiple(p << 8)));
        [along * unit, down * unit]
    }

    /// The parts of texels that the pieces fill: how far their middles are from the texels', along rows and along
    /// columns, and half of their extents.
    #[inline(always)]
    pub fn parts(&self) -> [[Vec4; 2]; 2] {
        let axis = |down: u32| {
            let (low, high) = (
                |p: u32| (p >> (down + 2) & 3) as i32,
                |p: u32| (p >> down & 3) as i32,
            );
            let middle = self.slope.map(|p| (low(p) - high(p)) as f32);
            let cut = self.slope.map(|p| (low(p) + high(p)) as f32);
            (
                Vec4::from_array(middle) * 0.125,
                Vec4::splat(0.5) - Vec4::from_array(cut) * 0.125,
            )
        };
        let ((x, half_x), (y, half_y)) = (axis(4), axis(0));
        [[x, y], [half_x, half_y]]
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
    /// What each 2×2 texels hold, row by row: see [`Quad`].
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
    /// The levels from full resolution, each half as fine as the one before, to a single texel.
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
