//! What the pieces in four texels of a map hide of a pencil's samples.
//!
//! A piece of a surface hides the samples whose segments cross its plane within the
//! texel. Seen from the receiver that is a quadrilateral of slopes; it is taken as the rectangle through the
//! middles of its sides, which neighbours on one plane share.
//!
//! **Bias.** A receiver lies on a surface that is in the map. A piece counts only if its middle is above the
//! receiver's tangent plane, by more than rounding, and, next to the receiver, by more than what the piece
//! itself rises over that plane within half a texel: so far its extent is not known. Where it fills a part of a coarser
//! texel, its middle may be off by `OFF` to either side. A given `bias` is added.
//! Without a normal, the receiver must not lie in the piece's plane by the same margins.
//!
//! **Thickness.** A piece's sides are found at `z_threshold` before and behind it, and the widest count.

use fearless_simd::prelude::*;
use glam::{BVec4A, Vec4};

use super::masks::Mask;
use super::pencil::{FIRST, OUTWARD, ROUNDING, SampleVisibility, SideBins, TINY, Walk};
use crate::maps::layers::map::{Block, Level};
use crate::simd::{Lanes, Row, join, swap_fours};

/// By how much the middle of a part of a texel may be off, in texels: its sides are rounded to quarters.
const OFF: f32 = 0.125;

/// Places at which the surfaces of one layer are told apart.
const MOST_PLACES: u32 = 16;

/// Four texels, as the receiver sees them.
pub(super) struct Four {
    /// Their sides, from the receiver.
    pub(super) left: Vec4,
    pub(super) upper: Vec4,
    pub(super) size: f32,
    /// Depths over the receiver that this level answers for.
    pub(super) band: [f32; 2],
    /// Depth of the light over the receiver, at which segments end.
    pub(super) end: f32,
    /// Least and largest of what each node holds.
    pub(super) range: [Vec4; 2],
}

impl Four {
    /// Which of four opaque pieces this level answers for. A steep surface rises within a texel of the next level from
    /// one band into the other: with its middle in this one, that level leaves it out, so that here whatever reaches
    /// into this band counts. Where both answer, what is hidden is hidden.
    #[inline(always)]
    fn answers(&self, depths: Vec4, block: &Block) -> u32 {
        let end = depths.cmple(Vec4::splat(self.end)).bitmask();
        let to = Vec4::splat(self.band[1]);
        let within = depths.cmple(to).bitmask();
        if within == end {
            return within;
        }
        let [gx, gy] = if self.size > 1.0 {
            block.coarse_slopes()
        } else {
            block.slopes()
        };
        let reach = (gx.abs() + gy.abs()) * 0.5;
        end & (depths - reach).cmple(to).bitmask()
    }
}

impl Walk<'_> {
    /// Removes what the pieces of four texels hide, those that lie in a band of depths over the receiver.
    #[inline(always)]
    pub(super) fn pieces<S: Simd>(
        &self,
        simd: S,
        data: &Level,
        at: usize,
        leaves: u32,
        four: &Four,
        seen: &mut SampleVisibility,
    ) {
        let k = self.map.layers;
        let w = Vec4::splat(self.w);
        let [from, to] = [four.band[0], four.band[1].min(four.end)].map(Vec4::splat);
        let mut before = [1.0f32; 4];
        for (i, block) in data.blocks[at..at + k].iter().enumerate() {
            let depths = Vec4::from_array(block.inverse_depth) - w;
            if !self.transparent {
                let ahead = depths.cmpgt(from).bitmask() & leaves;
                // The layers behind lie deeper still.
                if ahead == 0 {
                    return;
                }
                let active = ahead & four.answers(depths, block);
                if active != 0 {
                    self.met(simd, active, depths, block, four, |_, hidden| {
                        seen.open = seen.open.without(hidden);
                    });
                }
                continue;
            }
            let media = &data.media[at + i];
            let first = Vec4::from_array(media.map(|m| m.first)) - w;
            let mut drop = [0.0f32; 4];
            if self.how.subtract {
                for c in 0..4 {
                    let behind = media[c].visibility;
                    drop[c] = before[c] - behind;
                    before[c] = if behind <= self.how.threshold {
                        1.0
                    } else {
                        behind
                    };
                }
            }
            let ahead = first.cmpgt(from).bitmask() & leaves;
            if ahead == 0 {
                continue;
            }
            let (mut through, mut places) = ([1.0f32; 4], [0u32; 4]);
            let mut most = 0;
            for c in 0..4 {
                let medium = &media[c];
                if ahead >> c & 1 == 0 {
                    continue;
                }
                // Surfaces lie evenly from the first to the last; at most so many places are told apart.
                places[c] = medium.count.min(MOST_PLACES);
                most = most.max(places[c]);
                through[c] = if self.how.subtract {
                    drop[c] / places[c] as f32
                } else if places[c] == medium.count {
                    medium.through
                } else {
                    medium.through.powf(medium.count as f32 / places[c] as f32)
                };
            }
            let gaps = places.map(|p| p.saturating_sub(1).max(1) as f32);
            let step = (first - depths) / Vec4::from_array(gaps);
            for place in 0..most {
                let depths = first - step * place as f32;
                let here = (0..4).fold(0, |m, c| m | u32::from(place < places[c]) << c);
                let active = here & depths.cmpgt(from).bitmask() & depths.cmple(to).bitmask();
                if active != 0 {
                    self.met(simd, active, depths, block, four, |c, met| {
                        if (through[c] == 0.0 && !self.how.subtract) || self.pencil.axes.is_none() {
                            seen.open = seen.open.without(met);
                        } else {
                            seen.attenuate(simd, met & seen.open, through[c], self.how);
                        }
                    });
                }
            }
        }
    }

    /// Calls `with` for the active ones of four pieces, and the samples whose segments cross them.
    #[inline(always)]
    fn met<S: Simd>(
        &self,
        simd: S,
        active: u32,
        depths: Vec4,
        block: &Block,
        four: &Four,
        mut with: impl FnMut(usize, Mask),
    ) {
        let half = Vec4::splat(0.5);
        let size = Vec4::splat(four.size);
        // The middle of the part that is filled, from the texel's centre.
        let (slopes, [[x, y], [hu, hv]]) = if four.size > 1.0 {
            (block.coarse_slopes(), block.parts())
        } else {
            (block.slopes(), [[Vec4::ZERO; 2], [half; 2]])
        };
        let [gx, gy] = slopes;
        let (u, v) = (
            four.left + size * (half + x),
            four.upper + size * (half + y),
        );
        let part = [hu, hv].map(|half_part| half_part.cmplt(half));
        let mut active = active & self.stand_clear(depths, [gx, gy], [u, v], size, part);
        if active == 0 {
            return;
        }
        let (hx, hy) = (gx * hu, gy * hv);
        let (hu, hv) = (hu * size, hv * size);
        let bins = {
            let outward = OUTWARD.load(simd);
            let halves = join(simd, [hu, hu, hv, hv]);
            let mut sides = join(simd, [u, u, v, v]) + halves * outward;
            let rise = join(simd, [hx, hx, hy, hy]);
            let mut at_sides = join(simd, [depths; 4]) + rise * outward;
            let behind = at_sides.le(0.0);
            if u32::from(behind | behind >> 4 | behind >> 8 | behind >> 12) & active != 0 {
                let (mut cut_sides, mut cut_depths) = (Row::default(), Row::default());
                cut_sides.set(sides);
                cut_depths.set(at_sides);
                cut(&mut cut_sides, &cut_depths);
                sides = cut_sides.load(simd);
            }
            // Within what the node holds, which bounds planes that rise beyond the surface.
            let [least, most] = four.range;
            at_sides = at_sides
                .greater(join(simd, [least; 4]))
                .lesser(join(simd, [most.max(least); 4]));
            let scaled = sides * self.scale.load(simd);
            let at = scaled / at_sides;
            let (mut least, mut most) = (at, at);
            if self.how.thickness > 0.0 {
                let w = self.w + at_sides;
                let thick = w * w * self.how.thickness;
                let behind = scaled / (at_sides + thick);
                let before = scaled / (at_sides - thick).greater(TINY);
                (least, most) = (
                    at.lesser(behind).lesser(before),
                    at.greater(behind).greater(before),
                );
            }
            // A steep piece may show its sides in either order.
            let widest = least
                .lesser(swap_fours(least))
                .where_bits(FIRST, most.greater(swap_fours(most)));
            SideBins::new(widest - self.offset.load(simd))
        };
        while active != 0 {
            let c = active.trailing_zeros() as usize & 3;
            active &= active - 1;
            with(c, self.within(&bins, c));
        }
    }

    /// Which of four pieces are occluders, and not the surface that the receiver lies on, with their middles at
    /// `(u, v)`; whether they fill a part of their texels only, along rows and along columns.
    #[inline(always)]
    fn stand_clear(
        &self,
        depths: Vec4,
        [gx, gy]: [Vec4; 2],
        [u, v]: [Vec4; 2],
        size: Vec4,
        part: [BVec4A; 2],
    ) -> u32 {
        let [off_x, off_y] = part.map(|p| Vec4::select(p, Vec4::splat(OFF), Vec4::ZERO));
        let w = depths + Vec4::splat(self.w);
        let next_to = u.abs().cmple(size) & v.abs().cmple(size);
        let near = next_to.any();
        if self.has_plane {
            let [a, b, c] = self.pencil.plane.map(Vec4::splat);
            let (across, down, up) = (a * u, b * v, c * depths);
            let mut margin =
                (across.abs() + down.abs() + c.abs() * w) * ROUNDING + w * self.how.bias;
            margin += (a.abs() * off_x + b.abs() * off_y) * size;
            if near {
                let rise = ((a * size + c * gx).abs() + (b * size + c * gy).abs()) * 0.5;
                margin += Vec4::select(next_to, rise, Vec4::ZERO);
            }
            (across + down + up).cmpgt(margin).bitmask()
        } else {
            let (across, down) = (gx * (u / size), gy * (v / size));
            let mut margin =
                (across.abs() + down.abs() + w) * ROUNDING + w * (self.how.bias * self.w);
            margin += gx.abs() * off_x + gy.abs() * off_y;
            if near {
                let rise = (gx.abs() + gy.abs()) * 0.5;
                margin += Vec4::select(next_to, rise, Vec4::ZERO);
            }
            (depths - across - down).abs().cmpgt(margin).bitmask()
        }
    }
}

/// Moves the sides at which a piece is not before the receiver to where it reaches the receiver's depth.
#[cold]
fn cut(sides: &mut Row, depths: &Row) {
    for axis in [0, 8] {
        for c in axis..axis + 4 {
            let (a, b) = (depths.0[c], depths.0[c + 4]);
            if (a > 0.0) != (b > 0.0) {
                let size = sides.0[c + 4] - sides.0[c];
                let at = sides.0[c] + size * (a / (a - b));
                sides.0[if b <= 0.0 { c + 4 } else { c }] = at;
            }
        }
    }
}
