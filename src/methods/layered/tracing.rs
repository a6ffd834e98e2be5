//! Tracing all segments from a receiver to its light samples at once (Sections 4.3, 5.2 and 6.1).
//!
//! The quadtree is walked once for 256 samples. At each node two sets are looked up ([`super::masks`]):
//! the samples whose segments can meet what the node holds, and, where one surface covers it, those that surely
//! cross that surface. A node that none of the undecided samples can meet is left out with all below it: so a
//! receiver with nothing before the light takes a few nodes, and one in the umbra little more.
//!
//! At the leaves a piece of a surface hides the samples whose segments cross its plane within the
//! texel. Seen from the receiver that is a quadrilateral of slopes; it is taken as the rectangle through the
//! middles of its sides, which neighbours on one plane share.
//!
//! **Coarser maps.** Where a texel, seen from the receiver, is less than a chosen part of the light, the walk
//! ends at a coarser level. Each level answers for a band of depths, half-open, so that no surface counts twice.
//!
//! **Bias.** A receiver lies on a surface that is in the map. A piece counts only if its middle is above the
//! receiver's tangent plane, by more than rounding, and, next to the receiver, by more than what the piece
//! itself rises over that plane within half a texel: so far its extent is not known. A given `bias` is added.
//! Without a normal, the receiver must not lie in the piece's plane by the same margins.
//!
//! **Thickness.** A piece's sides are found at `z_threshold` before and behind it, and the widest count.

use glam::{DVec3, Vec4};

use super::map::LayerMap;
use super::masks::{Axis, BINS, Mask};
use super::quadtree::Quad;
use crate::simd::{LANES, Lanes, Row, detect, dispatch};

/// Relative rounding of the receiver's and the pieces' coordinates: some ulps of an `f32`.
const ROUNDING: f32 = 8.0 * f32::EPSILON;

/// Depths nearer to the receiver than this count as at it: only to divide by something.
const TINY: f32 = 1e-30;

/// Adding it to a number from 0 to 2²² leaves the nearest whole number in the low bits.
const WHOLE: f32 = (1 << 23) as f32;

/// How segments are traced.
#[derive(Debug, Clone, Copy)]
pub struct Tracing {
    /// Thickness of surfaces to either side, local units.
    pub thickness: f32,
    /// How far above the tangent plane an occluder must be, local units.
    pub bias: f32,
    /// Texels across the light that are told apart: the walk ends at the level that still has as many.
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
    /// The same across rows.
    pub rows: [f32; 2],
    /// The samples by their slopes.
    pub axes: [&'a Axis; 2],
    /// Inverse depth from which on nothing counts: the light's.
    pub end: f32,
    /// Height over the tangent plane, times inverse depth, grows so much per column, row and inverse depth; 0
    /// without a tangent plane.
    pub plane: [f32; 3],
}

/// The samples of a pencil, and what reaches them.
pub struct Seen {
    /// Samples that are not hidden.
    pub open: Mask,
    /// Transmittance of each, in a transparent map.
    pub through: [Row; BINS / LANES],
}

impl Seen {
    /// Of the samples in `open` everything is seen.
    pub fn new(open: Mask) -> Self {
        Seen {
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

/// Nodes whose children are still to be looked at: the children's level, and their parent's place.
pub type Stack = Vec<(u32, u32, u32)>;

/// Removes from `seen` what the map hides of a pencil's samples.
pub fn trace(
    map: &LayerMap,
    how: &Tracing,
    pencil: &Pencil<'_>,
    seen: &mut Seen,
    stack: &mut Stack,
) {
    dispatch!(detect() => trace_lanes(
        map: &LayerMap, how: &Tracing, pencil: &Pencil<'_>, seen: &mut Seen, stack: &mut Stack));
}

/// A pencil, ready for a walk.
struct Walk<'a> {
    map: &'a LayerMap,
    how: &'a Tracing,
    pencil: &'a Pencil<'a>,
    /// Whole and fractional part of the receiver's column and row.
    place: [f64; 2],
    w: f32,
    /// From slopes to bins: factors and offsets.
    scale: [f32; 2],
    offset: [f32; 2],
    /// Depth over the receiver up to which the finest level answers; each coarser one up to twice as much.
    band: f32,
    has_plane: bool,
}

/// Four numbers to the nearest whole ones, within a table's range.
#[inline(always)]
fn bins(x: Vec4) -> [u32; 4] {
    let x = x.max(Vec4::ZERO).min(Vec4::splat(BINS as f32)) + Vec4::splat(WHOLE);
    x.to_array().map(|b| b.to_bits() & 0x3ff)
}

/// Compiled once per instruction set, for its 256-bit operations.
#[inline(always)]
unsafe fn trace_lanes<S: Lanes>(
    map: &LayerMap,
    how: &Tracing,
    pencil: &Pencil<'_>,
    seen: &mut Seen,
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
        scale,
        offset: [low_u * scale[0], low_v * scale[1]],
        band: how.detail / extent_u.max(extent_v),
        has_plane: pencil.plane != [0.0; 3],
    };
    let transparent = map.is_transparent();
    let top = map.levels.len() as u32 - 1;
    stack.clear();
    stack.push((top, 0, 0));
    while let Some((level, x, y)) = stack.pop() {
        if seen.open.is_empty() {
            return;
        }
        // SAFETY: the caller enabled the features of `S`.
        unsafe { walk.siblings::<S>(level, x, y, level == top, transparent, seen, stack) };
    }
}

impl Walk<'_> {
    /// Looks at the four children of node `(x, y)`, which are of `level`.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "one call, inlined")]
    unsafe fn siblings<S: Lanes>(
        &self,
        level: u32,
        x: u32,
        y: u32,
        top: bool,
        transparent: bool,
        seen: &mut Seen,
        stack: &mut Stack,
    ) {
        let data = &self.map.levels[level as usize];
        let across = data.width.div_ceil(2);
        let quad: &Quad = &data.quads[y as usize * across + x as usize];
        let size = (1u64 << level) as f32;
        let wide = self.band * size;
        let (from, to) = (
            if level == 0 { 0.0 } else { 0.5 * wide },
            if top { f32::MAX } else { wide },
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
        if self.has_plane {
            let [a, b, c] = self.pencil.plane.map(Vec4::splat);
            let high =
                (a * left).max(a * right) + (b * upper).max(b * lower) + (c * near).max(c * far);
            let terms = (a * left).abs() + (b * upper).abs() + (c * (near + w)).abs();
            some &= high.cmpgt(terms * ROUNDING).bitmask();
            if some == 0 {
                return;
            }
        }
        let (inverse_far, inverse_near) = (far.recip(), near.recip());
        let [su, sv] = self.scale.map(Vec4::splat);
        let [ou, ov] = self.offset.map(Vec4::splat);
        let half = Vec4::splat(0.5);
        let (left, right) = (left * su, right * su);
        let (upper, lower) = (upper * sv, lower * sv);
        let u0 = bins((left * inverse_far).min(left * inverse_near) - ou - half);
        let u1 = bins((right * inverse_far).max(right * inverse_near) - ou + half);
        let v0 = bins((upper * inverse_far).min(upper * inverse_near) - ov - half);
        let v1 = bins((lower * inverse_far).max(lower * inverse_near) - ov + half);
        let [columns, rows] = self.pencil.axes;
        let cover_low = Vec4::from_array(quad.cover_low);
        let cover_high = Vec4::from_array(quad.cover_high);
        // A cover that is no thicker than it is far from the receiver.
        let covered = if level == 0 {
            0
        } else {
            let margin = (half * (cover_high - cover_low)).max(w * (4.0 * ROUNDING));
            cover_low.cmpgt(w + margin).bitmask()
                & cover_high.cmplt(Vec4::splat(self.pencil.end)).bitmask()
        };
        let sure = if covered & some != 0 {
            let (far, near) = ((cover_low - w).recip(), (cover_high - w).recip());
            Some([
                bins((left * far).max(left * near) - ou + half),
                bins((right * far).min(right * near) - ou - half),
                bins((upper * far).max(upper * near) - ov + half),
                bins((lower * far).min(lower * near) - ov - half),
            ])
        } else {
            None
        };
        for i in 0..4 {
            if some >> i & 1 == 0 || u0[i] >= u1[i] || v0[i] >= v1[i] {
                continue;
            }
            let met = columns.between(u0[i], u1[i]) & rows.between(v0[i], v1[i]) & seen.open;
            if met.is_empty() {
                continue;
            }
            if let Some([u0, u1, v0, v1]) = &sure
                && covered >> i & 1 == 1
                && u0[i] < u1[i]
                && v0[i] < v1[i]
            {
                let hidden = columns.between(u0[i], u1[i]) & rows.between(v0[i], v1[i]);
                seen.open = seen.open.without(hidden);
                if met.without(hidden).is_empty() {
                    continue;
                }
            }
            let (cx, cy) = (2 * x + (i as u32 & 1), 2 * y + (i as u32 >> 1));
            if near[i] > from {
                let range = [far[i], quad.high[i] - self.w];
                // SAFETY: the caller enabled the features of `S`.
                unsafe {
                    self.texel::<S>(level, cx, cy, [from, to.min(end)], range, transparent, seen);
                }
            }
            if level > 0 && far[i] <= from {
                stack.push((level - 1, cx, cy));
            }
        }
    }

    /// Removes what the pieces of a texel hide, those that lie in a band of depths over the receiver.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "one call, inlined")]
    unsafe fn texel<S: Lanes>(
        &self,
        level: u32,
        x: u32,
        y: u32,
        band: [f32; 2],
        range: [f32; 2],
        transparent: bool,
        seen: &mut Seen,
    ) {
        let data = &self.map.levels[level as usize];
        let k = self.map.layers;
        let at = (y as usize * data.width + x as usize) * k;
        let size = (1u64 << level) as f32;
        let side = |i: usize, at: u32| (f64::from(at) * f64::from(size) - self.place[i]) as f32;
        let (u, v) = (side(0, x), side(1, y));
        let sides = Vec4::new(u, u + size, v, v + size);
        let mut before = 1.0;
        for (i, piece) in data.pieces[at..at + k].iter().enumerate() {
            if !piece.is_some() {
                return;
            }
            let depth = piece.inverse_depth - self.w;
            if !transparent {
                if depth <= band[0] {
                    return;
                }
                if depth > band[1] || !self.stands_clear(piece.inverse_depth, piece.slope(), sides)
                {
                    continue;
                }
                let hidden = self.samples(depth, piece.slope(), sides, size, range);
                seen.open = seen.open.without(hidden);
                continue;
            }
            let medium = &data.media[at + i];
            let (first, drop) = (medium.first - self.w, before - medium.visibility);
            before = medium.visibility;
            if before <= self.how.threshold {
                before = 1.0;
            }
            if first <= band[0] {
                return;
            }
            // Surfaces lie evenly from the first to the last; at most so many places are told apart.
            let places = medium.count.min(MOST_PLACES);
            let step = if places > 1 {
                (first - depth) / (places - 1) as f32
            } else {
                0.0
            };
            let each = medium.count as f32 / places as f32;
            let through = if self.how.subtract {
                drop / places as f32
            } else if each == 1.0 {
                medium.through
            } else {
                medium.through.powf(each)
            };
            for place in 0..places {
                let depth = first - step * place as f32;
                if depth <= band[0] || depth > band[1] {
                    continue;
                }
                if !self.stands_clear(depth + self.w, piece.slope(), sides) {
                    continue;
                }
                let met = self.samples(depth, piece.slope(), sides, size, range) & seen.open;
                // SAFETY: the caller enabled the features of `S`.
                unsafe { self.attenuate::<S>(met, through, seen) };
            }
        }
    }

    #[inline(always)]
    unsafe fn attenuate<S: Lanes>(&self, met: Mask, through: f32, seen: &mut Seen) {
        if through == 0.0 && !self.how.subtract {
            seen.open = seen.open.without(met);
            return;
        }
        let mut done = Mask::NONE;
        for r in 0..BINS / LANES {
            let bits = met.row(r);
            if bits == 0 {
                continue;
            }
            // SAFETY: the caller enabled the features of `S`.
            unsafe {
                let old = S::load(&seen.through[r]);
                let new = if self.how.subtract {
                    old.sub(S::splat(through)).max(S::splat(0.0))
                } else {
                    old.mul(S::splat(through))
                };
                new.select(bits, old).store(&mut seen.through[r]);
                let closed = new.le(S::splat(self.how.threshold)) & bits;
                done.0[r / 4] |= u64::from(closed) << (16 * (r % 4));
            }
        }
        seen.open = seen.open.without(done);
    }

    /// Whether a piece is an occluder, and not the surface that the receiver lies on.
    #[inline(always)]
    fn stands_clear(&self, w: f32, [gx, gy]: [f32; 2], sides: Vec4) -> bool {
        let [left, right, upper, lower] = sides.to_array();
        let size = right - left;
        let (u, v) = (0.5 * (left + right), 0.5 * (upper + lower));
        let depth = w - self.w;
        let next_to = u.abs() <= size && v.abs() <= size;
        if self.has_plane {
            let [a, b, c] = self.pencil.plane;
            let (across, down, up) = (a * u, b * v, c * depth);
            let mut margin =
                ROUNDING * (across.abs() + down.abs() + c.abs() * w) + self.how.bias * w;
            if next_to {
                margin += 0.5 * ((a * size + c * gx).abs() + (b * size + c * gy).abs());
            }
            across + down + up > margin
        } else {
            let (across, down) = (gx * (u / size), gy * (v / size));
            let mut margin =
                ROUNDING * (across.abs() + down.abs() + w) + self.how.bias * w * self.w;
            if next_to {
                margin += 0.5 * (gx.abs() + gy.abs());
            }
            (depth - across - down).abs() > margin
        }
    }

    /// The samples whose segments cross a piece.
    #[inline(always)]
    fn samples(
        &self,
        depth: f32,
        [gx, gy]: [f32; 2],
        mut sides: Vec4,
        size: f32,
        range: [f32; 2],
    ) -> Mask {
        let change = Vec4::new(-0.5 * gx, 0.5 * gx, -0.5 * gy, 0.5 * gy);
        let depths = Vec4::splat(depth) + change;
        if depths.min_element() <= 0.0 {
            sides = cut(sides, depths, size);
        }
        // Within what the node holds, which bounds planes that rise beyond the surface.
        let depths = depths
            .max(Vec4::splat(range[0]))
            .min(Vec4::splat(range[1].max(range[0])));
        let [su, sv] = self.scale;
        let [ou, ov] = self.offset;
        let offset = Vec4::new(ou, ou, ov, ov);
        let sides = sides * Vec4::new(su, su, sv, sv);
        let mut low = sides / depths;
        let mut high = low;
        if self.how.thickness > 0.0 {
            let w = Vec4::splat(self.w) + depths;
            let thick = w * w * self.how.thickness;
            let other = [depths + thick, (depths - thick).max(Vec4::splat(TINY))];
            for depths in other {
                let x = sides / depths;
                (low, high) = (low.min(x), high.max(x));
            }
        }
        let (low, high) = ((low - offset).to_array(), (high - offset).to_array());
        let all = Vec4::new(
            low[0].min(low[1]),
            high[0].max(high[1]),
            low[2].min(low[3]),
            high[2].max(high[3]),
        );
        let [u0, u1, v0, v1] = bins(all);
        let [columns, rows] = self.pencil.axes;
        if u0 >= u1 || v0 >= v1 {
            return Mask::NONE;
        }
        columns.between(u0, u1) & rows.between(v0, v1)
    }
}

/// Places at which the surfaces of one layer are told apart.
const MOST_PLACES: u32 = 16;

/// Moves the sides at which a piece is not before the receiver to where it reaches the receiver's depth.
#[cold]
fn cut(sides: Vec4, depths: Vec4, size: f32) -> Vec4 {
    let mut sides = sides.to_array();
    let depths = depths.to_array();
    for axis in [0, 2] {
        let (a, b) = (depths[axis], depths[axis + 1]);
        if (a > 0.0) == (b > 0.0) {
            continue;
        }
        let at = sides[axis] + size * (a / (a - b));
        sides[axis + usize::from(b <= 0.0)] = at;
    }
    Vec4::from_array(sides)
}
