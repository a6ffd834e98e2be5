//! Tracing all segments from a receiver to its light samples at once (Sections 4.3, 5.2 and 6.1).
//!
//! The quadtree is walked once for 256 samples. At each node two sets are looked up ([`super::masks`]):
//! the samples whose segments can meet what the node holds, and, where one surface covers it, those that surely
//! cross that surface, above the receiver's tangent plane. A node that none of the undecided samples can meet is
//! left out with all below it: so a receiver with nothing before the light takes a few nodes. Of four siblings the
//! one that most undecided samples can meet comes first, so that in the umbra few are left to look at.
//!
//! At the leaves the pieces of surfaces hide samples (`pieces`).
//!
//! **Coarser maps.** Where a texel, seen from the receiver, is less than a chosen part of the light, the walk
//! ends at a coarser level. Each level answers for a band of depths, half-open, so that no transparent surface counts
//! twice; opaque ones in two bands where they rise from one into the next, so that none is between them. The
//! part is larger near the receiver, where the light is seen through little of the map and penumbrae are narrow: else
//! a finer map would cost a level more, with as much of the receiver's own surface in it as the levels before have.
//! Where the outline of a body passes, the pieces of the finer levels answer for a band, up to `FINER` levels down.

use fearless_simd::{dispatch, prelude::*};
use glam::Vec4;

use super::pencil::{Pencil, ROUNDING, SampleVisibility, TINY, Tracing, Walk};
use super::pieces::Four;
use crate::maps::layers::map::LayerMap;
use crate::maps::layers::quad::Quad;
use crate::simd::{detect, prefetch};

/// Levels by which outlines are looked at finer than the rest. On the statue two take a quarter of the error over the
/// penumbra for a quarter more time; all levels, a third.
const FINER: u32 = 2;

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
    let walk = Walk::new(map, how, pencil);
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
        walk.siblings(simd, siblings, siblings.level == top, seen, stack);
    }
}

impl Walk<'_> {
    /// Looks at four siblings.
    #[inline(always)]
    fn siblings<S: Simd>(
        &self,
        simd: S,
        siblings: Siblings,
        top: bool,
        seen: &mut SampleVisibility,
        stack: &mut Stack,
    ) {
        let Siblings { level, x, y, finer } = siblings;
        let data = &self.map.levels[level as usize];
        let across = data.width.div_ceil(2);
        let quad: &Quad = &data.quads[y as usize * across + x as usize];
        let size = (1u64 << level) as f32;
        let before = if level == 0 {
            0.0
        } else {
            self.bands.end(level - 1)
        };
        let to = if top {
            f32::MAX
        } else {
            self.bands.end(level + finer)
        };
        // Triangles answer in place of finer levels, or of this one's part of them.
        let from = before.max(self.pencil.near);
        let goes_on = before > self.pencil.near;
        let w = Vec4::splat(self.w);
        let end = self.pencil.end - self.w;
        let near = Vec4::from_array(quad.high) - w;
        let far = (Vec4::from_array(quad.low) - w).max(Vec4::splat(TINY));
        let near = near.min(Vec4::splat(to.min(end)));
        // Nothing before the receiver and the light, or all left to coarser levels.
        let mut some = near.cmpge(far.max(Vec4::splat(self.pencil.near))).bitmask();
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
        let all = self.widest(simd, sides, far.max(Vec4::splat(self.pencil.near)), near);
        // What finer levels answer for is seen under less of them.
        let straddle =
            near.cmpgt(Vec4::splat(from)).bitmask() & far.cmple(Vec4::splat(from)).bitmask();
        let nearer = if goes_on && straddle != 0 {
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
            if (goes_on && far[i] <= from) || outline {
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
            self.pieces(simd, data, at, leaves, &four, seen);
        }
        if last < stack.len() {
            let top = stack.len() - 1;
            stack.swap(last, top);
        }
    }
}
