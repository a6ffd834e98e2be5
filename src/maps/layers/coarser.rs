//! Coarser maps: each level half as fine as the one before.
//!
//! Far from a receiver, where hundreds of texels lie between two neighbouring light samples, tracing uses coarser
//! maps: so its cost grows slowly with the map's resolution and the light's size. What covers a part of four texels
//! has to cover the same part of the one that stands for them, without a shift:
//! - The pieces of one surface, which go on from texel to texel, become one piece: the plane in the middle of
//!   theirs, over a rectangle that is in the mean as large as they are and about where they are. So silhouettes
//!   stay sharp, and the front and the back of a body have the same one.
//! - Where these are more than a texel has layers, or the map is transparent, one of the four texels stands for
//!   them all, chosen by a hash of its place.

use rayon::prelude::*;

use super::map::{Block, CoarsePiece, Level, TexelPart, WHOLE};
use crate::control::Control;
use crate::error::Result;

/// A map of half the resolution.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub fn coarser(level: &Level, k: usize, number: u32, control: &Control) -> Result<Level> {
    let (width, height) = (level.width.div_ceil(2), level.height.div_ceil(2));
    let opaque = level.media.is_empty();
    let plane = |block: &Block, child: usize| {
        if number > 0 {
            return block.plane(child);
        }
        let piece = block.piece(child);
        piece.is_some().then(|| piece.into())
    };
    let mut out = Level::new(width, height, k, !opaque);
    let across = width.div_ceil(2);
    // Of the texels that become one: their block, random bits, and which of them stands for all.
    let source = |block: usize, child: usize| {
        let (x, y) = (
            block % across * 2 + child % 2,
            block / across * 2 + child / 2,
        );
        (x < width && y < height).then(|| {
            let bits = hash(x as u32, y as u32, number);
            (level.place(2 * x, 2 * y, k).0, bits, (bits & 3) as usize)
        })
    };
    let make = |surfaces: &mut Vec<Surface>, (block, layers): (usize, &mut [Block])| {
        control.check()?;
        for child in 0..4 {
            let Some((at, bits, from)) = source(block, child) else {
                continue;
            };
            let fine = &level.blocks[at..at + k];
            if opaque && gather(fine, plane, surfaces) {
                put(surfaces, bits, layers, child);
                continue;
            }
            let planes = fine.iter().map_while(|block| plane(block, from));
            for (to, mut plane) in layers.iter_mut().zip(planes) {
                plane.inverse_depth = moved(plane.at_center(), plane.slope, place(from));
                to.set_plane(child, &halved(plane));
            }
        }
        Ok(())
    };
    out.blocks
        .par_chunks_mut(k)
        .enumerate()
        .try_for_each_init(Vec::new, make)?;
    let media = out.media.par_chunks_mut(k).enumerate();
    media.try_for_each(|(block, layers)| {
        control.check()?;
        for child in 0..4 {
            if let Some((at, _, from)) = source(block, child) {
                let fine = level.blocks[at..at + k].iter().map(|b| plane(b, from));
                let media = level.media[at..at + k].iter().zip(fine);
                for (to, (media, plane)) in layers.iter_mut().zip(media) {
                    let mut medium = media[from];
                    if let Some(plane) = plane {
                        let here = plane.at_center();
                        let shift = moved(here, plane.slope, place(from)) - here;
                        medium.first = before_horizon(medium.first + shift, medium.first);
                    }
                    to[child] = medium;
                }
            }
        }
        Ok(())
    })?;
    Ok(out)
}

/// Where the middle of one of four texels is, in texels from that of all.
fn place(child: usize) -> [f32; 2] {
    [child % 2, child / 2].map(|i| i as f32 - 0.5)
}

/// The inverse depth of a plane in the middle of four texels, from that at a place.
fn moved(inverse_depth: f32, slope: [f32; 2], place: [f32; 2]) -> f32 {
    let moved = inverse_depth - (slope[0] * place[0] + slope[1] * place[1]);
    before_horizon(moved, inverse_depth)
}

/// A plane at half the resolution, from its inverse depth at the texel's centre.
fn halved(mut plane: CoarsePiece) -> CoarsePiece {
    let center = plane.inverse_depth;
    plane.slope = plane.slope.map(|s| 2.0 * s);
    plane.inverse_depth = before_horizon(center + plane.rise(), center);
    plane
}

/// A plane may reach beyond the eye's horizon within a texel; nothing does.
fn before_horizon(inverse_depth: f32, otherwise: f32) -> f32 {
    if inverse_depth > 0.0 {
        inverse_depth
    } else {
        otherwise
    }
}

/// Puts surfaces into a texel, the nearest first.
fn put(surfaces: &[Surface], bits: u32, layers: &mut [Block], child: usize) {
    let mut filled = 0;
    for surface in surfaces {
        // The same bits for all: the front and the back of a body fill the same part.
        let Some(plane) = surface.plane(bits) else {
            continue;
        };
        let mut to = filled;
        while to > 0 && layers[to - 1].inverse_depth[child] < plane.inverse_depth {
            let behind = layers[to - 1];
            layers[to].inverse_depth[child] = behind.inverse_depth[child];
            layers[to].slope[child] = behind.slope[child];
            to -= 1;
        }
        layers[to].set_plane(child, &plane);
        filled += 1;
    }
}

/// Pieces of one surface in the four texels that become one.
struct Surface {
    pieces: [Option<CoarsePiece>; 4],
    /// Sums over the pieces: how many, inverse depths, slopes, and places of their texels.
    count: f32,
    inverse_depth: f32,
    slope: [f32; 2],
    place: [f32; 2],
    /// What they fill of the coarser texel, in eighths: a box around it, its area, and twice its first moment.
    around: TexelPart,
    area: u32,
    moment: [u32; 2],
}

impl Surface {
    const NONE: Surface = Surface {
        pieces: [None; 4],
        count: 0.0,
        inverse_depth: 0.0,
        slope: [0.0; 2],
        place: [0.0; 2],
        around: [8, 0, 8, 0],
        area: 0,
        moment: [0; 2],
    };

    /// Takes the piece of a texel.
    fn add(&mut self, child: usize, piece: CoarsePiece) {
        self.pieces[child] = Some(piece);
        self.count += 1.0;
        self.inverse_depth += piece.at_center();
        let (slope, at) = (piece.slope, place(child));
        for axis in 0..2 {
            self.slope[axis] += slope[axis];
            self.place[axis] += at[axis];
        }
        let (i, j) = (4 * (child as u32 & 1), 4 * (child as u32 >> 1));
        let [left, right, upper, lower] = piece.part;
        let [left, right, upper, lower] = [left + i, right + i, upper + j, lower + j];
        let a = &mut self.around;
        *a = [
            a[0].min(left),
            a[1].max(right),
            a[2].min(upper),
            a[3].max(lower),
        ];
        let area = (right - left) * (lower - upper);
        self.area += area;
        self.moment[0] += area * (left + right);
        self.moment[1] += area * (upper + lower);
    }

    /// Whether it goes on in the piece of a texel.
    fn takes(&self, child: usize, piece: &CoarsePiece) -> bool {
        if self.pieces[child].is_some() {
            return false;
        }
        let beside = |axis: usize| {
            self.pieces[child ^ 1 << axis].is_some_and(|other| {
                if child >> axis & 1 == 1 {
                    other.joins(piece, axis)
                } else {
                    piece.joins(&other, axis)
                }
            })
        };
        beside(0) || beside(1)
    }

    /// One piece for all of them; none where they fill less than can be told.
    fn plane(&self, bits: u32) -> Option<CoarsePiece> {
        let part = self.part(bits)?;
        let each = 1.0 / self.count;
        let slope = self.slope.map(|s| s * each);
        let place = self.place.map(|p| p * each);
        let center = moved(self.inverse_depth * each, slope, place);
        Some(halved(CoarsePiece {
            inverse_depth: center,
            slope,
            part,
        }))
    }

    /// A rectangle, in quarters, that has the same area in the mean over random bits.
    fn part(&self, bits: u32) -> Option<TexelPart> {
        let a = self.around;
        let full = (a[1] - a[0]) * (a[3] - a[2]) == self.area;
        if full && a.iter().all(|side| side % 2 == 0) {
            return Some(a.map(|side| side / 2));
        }
        // The box is cut where the middle of what is filled is off its own.
        let off = [0, 1].map(|axis| {
            let middle = self.area * (a[2 * axis] + a[2 * axis + 1]);
            self.moment[axis].abs_diff(middle)
        });
        let cut = if off[0] == off[1] {
            bits as usize & 1
        } else {
            usize::from(off[1] > off[0])
        };
        let kept = 2 * (1 - cut);
        let cut = 2 * cut;
        // The sides along the other axis become quarters, up or down at random, no closer than the area fits in.
        let least = self.area.div_ceil(16);
        let high = ((a[kept + 1] + (bits >> 1 & 1)) / 2).max(least);
        let low = ((a[kept] + (bits >> 2 & 1)) / 2).min(high - least);
        let width = self.area as f32 / (4 * (high - low)) as f32;
        let chance = (bits >> 8) as f32 / (1 << 24) as f32;
        let width = ((width + chance) as u32).min(4);
        if width == 0 {
            return None;
        }
        let up = bits >> 3 & 1;
        // It stays at that side of the box which is on the same side of the texel as the middle of what is filled.
        let from = if self.moment[cut / 2] > 8 * self.area {
            ((a[cut + 1] + up) / 2).saturating_sub(width)
        } else {
            ((a[cut] + up) / 2).min(4 - width)
        };
        let mut part = WHOLE;
        (part[kept], part[kept + 1]) = (low, high);
        (part[cut], part[cut + 1]) = (from, from + width);
        Some(part)
    }
}

/// Sorts the pieces of four texels into surfaces; false if they are more than a texel has layers.
fn gather(
    fine: &[Block],
    plane: impl Fn(&Block, usize) -> Option<CoarsePiece>,
    surfaces: &mut Vec<Surface>,
) -> bool {
    surfaces.clear();
    for child in 0..4 {
        for piece in fine.iter().map_while(|block| plane(block, child)) {
            if let Some(surface) = surfaces.iter_mut().find(|s| s.takes(child, &piece)) {
                surface.add(child, piece);
            } else if surfaces.len() < fine.len() {
                let mut surface = Surface::NONE;
                surface.add(child, piece);
                surfaces.push(surface);
            } else {
                return false;
            }
        }
    }
    true
}

/// Bits that look random.
fn hash(x: u32, y: u32, level: u32) -> u32 {
    let mut h =
        x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77) ^ level.wrapping_mul(0xc2b2_ae3d);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2c1b_3c6d);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297a_2d39);
    h.rotate_right(15)
}
