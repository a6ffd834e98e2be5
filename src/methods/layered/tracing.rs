//! Tracing all segments from a receiver to its light samples at once (Sections 4.3, 5.2 and 6.1).
//!
//! The quadtree is walked once for 256 samples. At each node two sets are looked up ([`super::masks`]):
//! the samples whose segments can meet what the node holds, and, where one surface covers it, those that surely
//! cross that surface, above the receiver's tangent plane. A node that none of the undecided samples can meet is
//! left out with all below it: so a receiver with nothing before the light takes a few nodes. Of four siblings the
//! one that most undecided samples can meet comes first, so that in the umbra few are left to look at.
//!
//! At the leaves a piece of a surface hides the samples whose segments cross its plane within the
//! texel. Seen from the receiver that is a quadrilateral of slopes; it is taken as the rectangle through the
//! middles of its sides, which neighbours on one plane share.
//!
//! **Coarser maps.** Where a texel, seen from the receiver, is less than a chosen part of the light, the walk
//! ends at a coarser level. Each level answers for a band of depths, half-open, so that no transparent surface counts
//! twice; opaque ones in two bands where they rise from one into the next, so that none is between them. The
//! part is larger near the receiver, where the light is seen through little of the map and penumbrae are narrow: else
//! a finer map would cost a level more, with as much of the receiver's own surface in it as the levels before have.
//! Where the outline of a body passes, the pieces of the finer levels answer for a band, up to `FINER` levels down.
//!
//! **Bias.** A receiver lies on a surface that is in the map. A piece counts only if its middle is above the
//! receiver's tangent plane, by more than rounding, and, next to the receiver, by more than what the piece
//! itself rises over that plane within half a texel: so far its extent is not known. Where it fills a part of a coarser
//! texel, its middle may be off by `OFF` to either side. A given `bias` is added.
//! Without a normal, the receiver must not lie in the piece's plane by the same margins.
//!
//! **Thickness.** A piece's sides are found at `z_threshold` before and behind it, and the widest count.

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::{BVec4A, DVec3, Vec4};

use super::masks::{Axis, BINS, Mask};
use crate::maps::layers::map::{Block, LayerMap, Level};
use crate::maps::layers::quad::Quad;
use crate::simd::{LANES, Lanes, Row, detect, join, prefetch, swap_fours};

/// Relative rounding of the receiver's and the pieces' coordinates: some ulps of an `f32`.
const ROUNDING: f32 = 8.0 * f32::EPSILON;

/// Depths nearer to the receiver than this count as at it: only to divide by something.
const TINY: f32 = 1e-30;

/// Adding it to a number from 0 to 2²² leaves the nearest whole number in the low bits.
const WHOLE: f32 = (1 << 23) as f32;

/// Levels by which outlines are looked at finer than the rest. On the statue two take a quarter of the error over the
/// penumbra for a quarter more time; all levels, a third.
const FINER: u32 = 2;

/// How much farther than the finest level each level answers: texels twice as large, and as many of them as the
/// square root of that. With as many at all levels (18), statue and tree have the same error in the same time at 1024
/// texels, the fur ball a seventh less; but at 2048 the statue takes 1.5 times as long as at 512, not 1.3 times.
const GROWTH: [f32; LEVELS] = {
    let mut growth = [1.0; LEVELS];
    let mut level = 1;
    while level < LEVELS {
        // From √2³ on, eight times as far every two levels: exact but for the root.
        growth[level] = if level == 1 {
            2.0 * std::f32::consts::SQRT_2
        } else {
            8.0 * growth[level - 2]
        };
        level += 1;
    }
    growth
};

/// Levels of the largest map, of 16384 texels, and one.
const LEVELS: usize = 16;

/// How segments are traced.
#[derive(Debug, Clone, Copy)]
pub struct Tracing {
    /// Thickness of surfaces to either side, local units.
    pub thickness: f32,
    /// How far above the tangent plane an occluder must be, local units.
    pub bias: f32,
    /// Texels that are told apart across a light which is seen through the whole of a map: the walk ends at the level
    /// that still has as many. Through a part of it, as many times the cube root of the part.
    pub detail: f32,
    /// Transmittance at which a sample counts as hidden.
    pub threshold: f32,
    /// Whether crossings subtract what they take from the map's own ray (equation 3), and do not multiply.
    pub subtract: bool,
}

/// What the segments of a receiver to up to 256 light points have in common.
pub struct Pencil<'a> {
    /// The receiver: column, row, inverse depth.
    pub start: DVec3,
    /// Slopes of the samples across columns: the least, and the largest less the least.
    pub columns: [f32; 2],
    /// Slopes of the samples across rows: the least, and the largest less the least.
    pub rows: [f32; 2],
    /// The samples by their slopes; without, all samples count as hidden by whatever lies among the slopes.
    pub axes: Option<[&'a Axis; 2]>,
    /// Inverse depth from which on nothing counts: the light's.
    pub end: f32,
    /// Height over the tangent plane, times inverse depth, grows so much per column, row and inverse depth; 0
    /// without a tangent plane.
    pub plane: [f32; 3],
}

/// The samples of a pencil, and what reaches them.
pub struct SampleVisibility {
    /// Samples that are not hidden.
    pub open: Mask,
    /// Transmittance of each, in a transparent map.
    pub through: [Row; BINS / LANES],
}

impl SampleVisibility {
    /// The state before a walk: the samples in `open` are seen in full.
    pub fn new(open: Mask) -> Self {
        SampleVisibility {
            open,
            through: [Row([1.0; LANES]); BINS / LANES],
        }
    }

    /// Sum of the samples' transmittances.
    pub fn sum(&self, transparent: bool) -> f32 {
        if !transparent {
            return self.open.count() as f32;
        }
        let mut sums = Row::default();
        for (r, row) in self.through.iter().enumerate() {
            let bits = self.open.row(r);
            for lane in 0..LANES {
                if bits >> lane & 1 == 1 {
                    sums.0[lane] += row.0[lane];
                }
            }
        }
        sums.0.iter().sum()
    }
}

/// Siblings that are still to be looked at.
#[derive(Debug, Clone, Copy)]
pub struct Siblings {
    level: u32,
    /// Place of their parent.
    x: u32,
    y: u32,
    /// Number of coarser levels that these four nodes answer for as well, as at an outline.
    finer: u32,
}

/// The nodes that a walk has still to look at.
pub type Stack = Vec<Siblings>;

/// Removes from `seen` what the map hides of a pencil's samples.
pub fn trace(
    map: &LayerMap,
    how: &Tracing,
    pencil: &Pencil<'_>,
    seen: &mut SampleVisibility,
    stack: &mut Stack,
) {
    dispatch!(detect(), simd => trace_lanes(simd, map, how, pencil, seen, stack));
}

/// A pencil, ready for a walk.
struct Walk<'a> {
    map: &'a LayerMap,
    how: &'a Tracing,
    pencil: &'a Pencil<'a>,
    /// Whole and fractional part of the receiver's column and row.
    place: [f64; 2],
    w: f32,
    /// The map from slopes to bins: factors and offsets, of four left, right, upper and lower sides.
    scale: Row,
    offset: Row,
    /// Depth over the receiver up to which the finest level answers.
    band: f32,
    has_plane: bool,
}

/// Directions in which the left, right, upper and lower sides of four rectangles move outward.
const OUTWARD: Row = four_sides([-1.0, 1.0, -1.0, 1.0]);

/// The lanes of left and upper sides.
const FIRST: u16 = 0x0f0f;

/// A value for four left, right, upper and lower sides.
const fn four_sides(values: [f32; 4]) -> Row {
    let mut row = [0.0; LANES];
    let mut i = 0;
    while i < LANES {
        row[i] = values[i / 4];
        i += 1;
    }
    Row(row)
}

/// Bins of four left, right, upper and lower sides of rectangles.
#[derive(Clone, Copy)]
struct Bins(Row);

impl Bins {
    /// The bins of coordinates: the nearest whole numbers within a table's range.
    #[inline(always)]
    fn new<S: Simd>(x: f32x16<S>) -> Self {
        let mut bins = Row::default();
        let within = x.greater(0.0).lesser(BINS as f32);
        bins.set(within + WHOLE);
        Bins(bins)
    }

    /// Sides of one of the rectangles.
    #[inline(always)]
    fn sides(&self, i: usize) -> [u32; 4] {
        [0, 4, 8, 12].map(|side| self.0.0[side + i].to_bits() & 0x1ff)
    }
}

/// Compiled once per instruction set, for its 256-bit operations.
#[inline(always)]
fn trace_lanes<S: Simd>(
    simd: S,
    map: &LayerMap,
    how: &Tracing,
    pencil: &Pencil<'_>,
    seen: &mut SampleVisibility,
    stack: &mut Stack,
) {
    let [(low_u, extent_u), (low_v, extent_v)] =
        [pencil.columns, pencil.rows].map(|[low, extent]| (low, extent));
    let scale = [BINS as f32 / extent_u, BINS as f32 / extent_v];
    let walk = Walk {
        map,
        how,
        pencil,
        place: [pencil.start.x, pencil.start.y],
        w: pencil.start.z as f32,
        scale: four_sides([scale[0], scale[0], scale[1], scale[1]]),
        offset: {
            let [u, v] = [low_u * scale[0], low_v * scale[1]];
            four_sides([u, u, v, v])
        },
        band: {
            let across = map.levels[0].width.max(map.levels[0].height) as f32;
            how.detail * (how.detail / across).sqrt() / extent_u.max(extent_v)
        },
        has_plane: pencil.plane != [0.0; 3],
    };
    let transparent = map.is_transparent();
    let top = map.levels.len() as u32 - 1;
    stack.clear();
    stack.push(Siblings {
        level: top,
        x: 0,
        y: 0,
        finer: 0,
    });
    while let Some(siblings) = stack.pop() {
        if seen.open.is_empty() {
            return;
        }
        walk.siblings(
            simd,
            siblings,
            siblings.level == top,
            transparent,
            seen,
            stack,
        );
    }
}

impl Walk<'_> {
    /// The samples in one of four rectangles.
    #[inline(always)]
    fn within(&self, bins: &Bins, i: usize) -> Mask {
        let [u0, u1, v0, v1] = bins.sides(i);
        match self.pencil.axes {
            Some([u, v]) => u.between(u0, u1) & v.between(v0, v1),
            None if u0 < u1 && v0 < v1 => !Mask::NONE,
            None => Mask::NONE,
        }
    }

    /// The bins of what lies in four nodes between two depths over the receiver: of the sides, the least and the largest.
    #[inline(always)]
    fn spans<S: Simd>(&self, simd: S, sides: [Vec4; 4], far: Vec4, near: Vec4) -> [f32x16<S>; 2] {
        let sides = join(simd, sides) * self.scale.load(simd);
        let a = sides * join(simd, [far.recip(); 4]);
        let b = sides * join(simd, [near.recip(); 4]);
        let offset = self.offset.load(simd);
        [a.lesser(b) - offset, a.greater(b) - offset]
    }

    /// The bins in which it may be seen.
    #[inline(always)]
    fn widest<S: Simd>(&self, simd: S, sides: [Vec4; 4], far: Vec4, near: Vec4) -> Bins {
        let [least, most] = self.spans(simd, sides, far, near);
        let half = OUTWARD.load(simd) * 0.5;
        Bins::new(least.where_bits(FIRST, most) + half)
    }

    /// The bins in which it surely is, if it covers the nodes.
    #[inline(always)]
    fn narrowest<S: Simd>(&self, simd: S, sides: [Vec4; 4], far: Vec4, near: Vec4) -> Bins {
        let [least, most] = self.spans(simd, sides, far, near);
        let half = OUTWARD.load(simd) * 0.5;
        Bins::new(most.where_bits(FIRST, least) - half)
    }

    /// Looks at four siblings.
    #[inline(always)]
    fn siblings<S: Simd>(
        &self,
        simd: S,
        siblings: Siblings,
        top: bool,
        transparent: bool,
        seen: &mut SampleVisibility,
        stack: &mut Stack,
    ) {
        let Siblings { level, x, y, finer } = siblings;
        let data = &self.map.levels[level as usize];
        let across = data.width.div_ceil(2);
        let quad: &Quad = &data.quads[y as usize * across + x as usize];
        let size = (1u64 << level) as f32;
        let answers = |level: u32| self.band * GROWTH[level as usize];
        let (from, to) = (
            if level == 0 { 0.0 } else { answers(level - 1) },
            if top {
                f32::MAX
            } else {
                answers(level + finer)
            },
        );
        let w = Vec4::splat(self.w);
        let end = self.pencil.end - self.w;
        let near = Vec4::from_array(quad.high) - w;
        let far = (Vec4::from_array(quad.low) - w).max(Vec4::splat(TINY));
        let near = near.min(Vec4::splat(to.min(end)));
        // Nothing before the receiver and the light, or all left to coarser levels.
        let mut some = near.cmpge(far).bitmask();
        if some == 0 {
            return;
        }
        // The siblings' sides, from the receiver.
        let corner =
            |i: usize, at: u32| (f64::from(2 * at) * f64::from(size) - self.place[i]) as f32;
        let (u, v) = (corner(0, x), corner(1, y));
        let left = Vec4::new(u, u + size, u, u + size);
        let right = left + Vec4::splat(size);
        let upper = Vec4::new(v, v, v + size, v + size);
        let lower = upper + Vec4::splat(size);
        let half = Vec4::splat(0.5);
        // What is before the receiver as a whole is seldom below its tangent plane.
        if self.has_plane && far.min_element() <= TINY {
            let [a, b, c] = self.pencil.plane.map(Vec4::splat);
            let high =
                (a * left).max(a * right) + (b * upper).max(b * lower) + (c * near).max(c * far);
            let terms = (a * left).abs() + (b * upper).abs() + (c * (near + w)).abs();
            some &= high.cmpgt(terms * ROUNDING).bitmask();
            if some == 0 {
                return;
            }
            // Nor are the texels' surfaces above it, if their plane is below: nearer is higher where one faces the eye.
            if self.pencil.plane[2] > 0.0 {
                let ([gx, gy], middle) = quad.planes();
                let (x, y) = (left + half * size, upper + half * size);
                let (over_x, over_y) = (a * size + c * gx, b * size + c * gy);
                let rise = (over_x.abs() + over_y.abs()) * (0.5 - 0.5 / size);
                let terms = (a * x).abs() + (b * y).abs() + c * (middle + w);
                let high = (a * x + b * y) + c * (middle - w) + rise;
                some &= high.cmpgt(terms * ROUNDING).bitmask();
                if some == 0 {
                    return;
                }
            }
        }
        let sides = [left, right, upper, lower];
        let all = self.widest(simd, sides, far, near);
        // What finer levels answer for is seen under less of them.
        let straddle =
            near.cmpgt(Vec4::splat(from)).bitmask() & far.cmple(Vec4::splat(from)).bitmask();
        let nearer = if level > 0 && straddle != 0 {
            self.widest(simd, sides, far, near.min(Vec4::splat(from)))
        } else {
            all
        };
        let (covers, [cover_low, cover_high]) = quad.covers();
        // A cover that is no thicker than it is far from the receiver.
        let mut covered = if level == 0 {
            0
        } else {
            let margin = (half * (cover_high - cover_low)).max(w * (4.0 * ROUNDING));
            some & covers
                & cover_low.cmpgt(w + margin).bitmask()
                & cover_high.cmplt(Vec4::splat(self.pencil.end)).bitmask()
        };
        // All of it is above the tangent plane, as a piece's middle has to be.
        if self.has_plane && covered != 0 {
            let [a, b, c] = self.pencil.plane.map(Vec4::splat);
            let (low, high) = (c * (cover_low - w), c * (cover_high - w));
            let height = (a * left).min(a * right) + (b * upper).min(b * lower) + low.min(high);
            let terms = (a * left).abs() + (b * upper).abs() + (c * cover_high).abs();
            let margin = terms * ROUNDING + cover_high * self.how.bias;
            covered &= height.cmpgt(margin).bitmask();
        }
        let sure = if covered != 0 {
            Some(self.narrowest(simd, sides, cover_low - w, cover_high - w))
        } else {
            None
        };
        // The child that most undecided samples can meet comes next.
        let (mut most, mut last) = (0, stack.len());
        // The children whose own pieces are to be looked at.
        let mut leaves = 0;
        for i in 0..4 {
            if some >> i & 1 == 0 {
                continue;
            }
            let met = self.within(&all, i) & seen.open;
            if met.is_empty() {
                continue;
            }
            if let Some(sure) = &sure
                && covered >> i & 1 == 1
            {
                let hidden = self.within(sure, i);
                seen.open = seen.open.without(hidden);
                if met.without(hidden).is_empty() {
                    continue;
                }
            }
            let outline = level > 0 && finer < FINER && quad.is_outline(i);
            if near[i] > from && !outline {
                leaves |= 1 << i;
            }
            if level > 0 && (far[i] <= from || outline) {
                let met = if outline {
                    met
                } else {
                    self.within(&nearer, i) & seen.open
                };
                if met.is_empty() {
                    continue;
                }
                let count = met.count();
                if count >= most {
                    (most, last) = (count, stack.len());
                }
                let next = Siblings {
                    level: level - 1,
                    x: 2 * x + (i as u32 & 1),
                    y: 2 * y + (i as u32 >> 1),
                    finer: if outline && near[i] > from {
                        finer + 1
                    } else {
                        0
                    },
                };
                stack.push(next);
                let below = &self.map.levels[next.level as usize];
                let at = next.y as usize * below.width.div_ceil(2) + next.x as usize;
                prefetch(&below.quads, at);
                prefetch(&below.blocks, at * self.map.layers);
            }
        }
        if leaves != 0 {
            let four = Four {
                left: Vec4::new(u, u + size, u, u + size),
                upper: Vec4::new(v, v, v + size, v + size),
                size,
                band: [from, to],
                end,
                range: [far, Vec4::from_array(quad.high) - w],
            };
            let at = (y as usize * across + x as usize) * self.map.layers;
            self.pieces(simd, data, at, leaves, &four, transparent, seen);
        }
        if last < stack.len() {
            let top = stack.len() - 1;
            stack.swap(last, top);
        }
    }

    /// Removes what the pieces of four texels hide, those that lie in a band of depths over the receiver.
    #[inline(always)]
    fn pieces<S: Simd>(
        &self,
        simd: S,
        data: &Level,
        at: usize,
        leaves: u32,
        four: &Four,
        transparent: bool,
        seen: &mut SampleVisibility,
    ) {
        let k = self.map.layers;
        let w = Vec4::splat(self.w);
        let [from, to] = [four.band[0], four.band[1].min(four.end)].map(Vec4::splat);
        let mut before = [1.0f32; 4];
        for (i, block) in data.blocks[at..at + k].iter().enumerate() {
            let depths = Vec4::from_array(block.inverse_depth) - w;
            if !transparent {
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
                        self.attenuate(simd, met & seen.open, through[c], seen);
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
            Bins::new(widest - self.offset.load(simd))
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

    #[inline(always)]
    fn attenuate<S: Simd>(&self, simd: S, met: Mask, through: f32, seen: &mut SampleVisibility) {
        if (through == 0.0 && !self.how.subtract) || self.pencil.axes.is_none() {
            seen.open = seen.open.without(met);
            return;
        }
        let mut done = Mask::NONE;
        for word in 0..4 {
            let mut left = met.0[word];
            // A piece is met by few samples, as a rule.
            if left.count_ones() <= FEW {
                while left != 0 {
                    let bit = left.trailing_zeros() as usize;
                    left &= left - 1;
                    let sample = &mut seen.through[4 * word + bit / LANES].0[bit % LANES];
                    *sample = if self.how.subtract {
                        (*sample - through).max(0.0)
                    } else {
                        *sample * through
                    };
                    done.0[word] |= u64::from(*sample <= self.how.threshold) << bit;
                }
                continue;
            }
            for r in 4 * word..4 * word + 4 {
                let bits = met.row(r);
                let old = seen.through[r].load(simd);
                let new = if self.how.subtract {
                    (old - through).greater(0.0)
                } else {
                    old * through
                };
                seen.through[r].set(new.where_bits(bits, old));
                let closed = new.le(self.how.threshold) & bits;
                done.0[word] |= u64::from(closed) << (LANES * (r % 4));
            }
        }
        seen.open = seen.open.without(done);
    }
}

/// Four texels, as the receiver sees them.
struct Four {
    /// Their sides, from the receiver.
    left: Vec4,
    upper: Vec4,
    size: f32,
    /// Depths over the receiver that this level answers for.
    band: [f32; 2],
    /// Depth of the light over the receiver, at which segments end.
    end: f32,
    /// Least and largest of what each node holds.
    range: [Vec4; 2],
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

/// Up to this many of 64 samples are attenuated one by one; more go through lanes.
const FEW: u32 = 8;

/// By how much the middle of a part of a texel may be off, in texels: its sides are rounded to quarters.
const OFF: f32 = 0.125;

/// Places at which the surfaces of one layer are told apart.
const MOST_PLACES: u32 = 16;

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
