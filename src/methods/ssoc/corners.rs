//! Sharp corners of silhouettes in a map.
//!
//! The distance from a corner is not how much of the light it hides: that is the area that both of its lines
//! cut off together. A lookup that finds either line near a corner takes the other into account, as far as the
//! silhouette runs about straight on from the corner for as long as the light is wide.
//!
//! With `A` and `B` the parts that the two lines hide, a convex corner hides `|A ∩ B|` and a reflex one
//! `|A ∪ B| = |A| + |B| - |A ∩ B|`, in closed form ([`Cut::both`]): the same from whichever line it is found, and
//! where the other line does not cross the light, what one line hides.

use glam::DVec2;

use super::lookup::{Lookup, Penumbra};
use super::maps::{Corner, Line, Maps};
use super::receiver::Receiver;
use crate::light::falloff::Cut;
use crate::maps::views::View;
use crate::raster::nearest::NONE;

/// Cosine of the smallest turn that makes a corner sharp, 25°: the distance from a blunter one is within 0.05
/// of what it hides.
const SHARP: f64 = 0.9;

/// Texels from a line at which what is beside it is looked up.
const BESIDE: f64 = 1.5;

/// Finds the sharp corners among lines that follow each other, and notes them in the lines that run straight
/// to them.
pub fn find(lines: &mut [Line], joints: &[[u32; 2]]) -> Vec<Corner> {
    let mut next = [vec![NONE; lines.len()], vec![NONE; lines.len()]];
    for &[before, after] in joints {
        next[0][after as usize] = before;
        next[1][before as usize] = after;
    }
    let mut out = Vec::new();
    for &pair in joints {
        let [a, b] = pair.map(|i| lines[i as usize]);
        if a.along.dot(b.along) > SHARP {
            continue;
        }
        let corner = out.len() as u32;
        let mut arm = |side: usize| {
            let first = lines[pair[side] as usize].along;
            let (mut at, mut length) = (pair[side], 0.0);
            loop {
                let line = &mut lines[at as usize];
                if line.corners[1 - side] != NONE {
                    break length;
                }
                line.corners[1 - side] = corner;
                length += line.length;
                let more = next[side][at as usize];
                if more == NONE || length > line.reach {
                    break length;
                }
                if lines[more as usize].along.dot(first) < SHARP {
                    break length;
                }
                at = more;
            }
        };
        let arms = [arm(0), arm(1)];
        let convex = a.along.perp_dot(b.along) < 0.0;
        let reach = a.reach.min(b.reach);
        let far = arms.map(|arm| arm.min(reach));
        let beside = if convex {
            [
                b.start - a.along * (0.5 * far[0]) + a.normal() * BESIDE,
                b.start + b.along * (0.5 * far[1]) + b.normal() * BESIDE,
            ]
        } else {
            // In a notch, where it is wider than a texel if it is anywhere.
            let out = (b.along - a.along).normalize_or_zero();
            [b.start + out * far[0].min(far[1]); 2]
        };
        out.push(Corner {
            point: b.start,
            lines: pair,
            arms,
            beside,
            convex,
        });
    }
    out
}

/// The penumbra of a line that goes on straight, as a receiver is in it.
struct Straight {
    cut: Cut,
    /// Distance and half-width in texels.
    x: f64,
    width: f64,
    /// The part as of [`LightOutline::radius`](crate::light::reach::LightOutline::radius).
    part: f64,
}

impl Straight {
    #[inline(always)]
    fn new(view: &View, line: &Line, receiver: &Receiver) -> Self {
        let from = receiver.at - line.start;
        let t = from.dot(line.along).clamp(0.0, line.length);
        let q = view.tangents(line.start + line.along * t);
        let (normal, x) = (line.normal(), from.dot(line.normal()));
        let inverse_near = line.inverse_depth[0] + t * line.inverse_depth[1];
        let scale = view.focal * (inverse_near - receiver.inverse_depth);
        let (radius, part) = view.outline.radius(normal, q);
        Straight {
            cut: Cut {
                gradient: normal.extend(-normal.dot(q)),
                offset: x / scale,
            },
            x,
            width: scale * radius,
            part,
        }
    }

    fn visible(&self, lookup: &Lookup, view: &View) -> f64 {
        let s = ((self.width + self.x) / (2.0 * self.width)).clamp(0.0, 1.0);
        lookup.rules.falloff.visible(s, self.part, &view.outline)
    }
}

impl Lookup<'_> {
    /// Takes the sharp corners at the ends of an edge into account in what it does to a receiver.
    #[inline(always)]
    pub(super) fn cut_corners(
        &self,
        maps: &Maps,
        edge: u32,
        receiver: &Receiver,
        found: &mut Penumbra,
    ) {
        let line = &maps.lines[edge as usize];
        for end in 0..2 {
            if line.corners[end] != NONE {
                self.cut_corner(maps, line, end, receiver, found);
            }
        }
    }

    #[inline(never)]
    fn cut_corner(
        &self,
        maps: &Maps,
        line: &Line,
        end: usize,
        receiver: &Receiver,
        found: &mut Penumbra,
    ) {
        let view = &maps.view;
        let corner = &maps.corners[line.corners[end] as usize];
        let other = &maps.lines[corner.lines[end] as usize];
        let at = (receiver.at - line.start).dot(line.along);
        let beyond = if end == 0 { at < 0.0 } else { at > line.length };
        let next = Straight::new(view, other, receiver);
        // Along the lines all of the light is on one side of the other one.
        let apart = match corner.convex {
            true => next.x <= -next.width,
            false => next.x >= next.width,
        };
        if next.width.is_nan() || next.width <= 0.0 {
            return;
        }
        if apart && !beyond {
            found.corners[end] = line.corners[end];
            return;
        }
        // Both sides have to go on beside the receiver, all of it for half of the light's width.
        let from = receiver.at - corner.point;
        let (onwards, back) = match end {
            0 => (-from.dot(other.along), from.dot(line.along)),
            _ => (from.dot(other.along), -from.dot(line.along)),
        };
        let rest = (corner.arms[end] - onwards).min(corner.arms[1 - end] - back);
        let weight = (2.0 * rest / next.width).clamp(0.0, 1.0);
        // A line that is dark on both sides bounds nothing: an outline goes on behind what hides it.
        let dark = |q| {
            let texel = view.texel(q);
            texel.is_some_and(|texel| self.hidden_at(maps, texel, receiver))
        };
        if weight == 0.0 || corner.beside.into_iter().any(dark) {
            return;
        }
        let own = Straight::new(view, line, receiver);
        let both = own.cut.both(next.cut, &view.outline);
        let alone = own.visible(self, view);
        let exact = match corner.convex {
            true => 1.0 - both,
            false => alone + next.visible(self, view) - 1.0 + both,
        };
        let before = if beyond { found.visible } else { alone };
        found.visible = (found.visible + weight * (exact - before)).clamp(0.0, 1.0);
        if weight > 0.5 {
            found.corners[end] = line.corners[end];
        }
    }
}

impl Penumbra {
    /// Whether a line is at one of the corners that are taken into account.
    pub(super) fn has(&self, maps: &Maps, line: u32) -> bool {
        let mut corners = self.corners.iter().filter(|&&c| c != NONE);
        corners.any(|&c| maps.corners[c as usize].lines.contains(&line))
    }

    /// The middle of what is left of the light, in the image, for a receiver at `at`.
    pub(super) fn middle(&self, maps: &Maps, at: DVec2, distortion: f64) -> DVec2 {
        let from = at + self.normal * distortion;
        for (end, &corner) in self.corners.iter().enumerate() {
            if corner == NONE {
                continue;
            }
            let corner = &maps.corners[corner as usize];
            let [a, b] = corner.lines.map(|l| &maps.lines[l as usize]);
            let other = [a, b][end];
            if !corner.convex && (from - corner.point).dot(other.normal()) < 0.0 {
                // Under the other side of a notch: along the middle of the notch instead.
                let out = (b.along - a.along).normalize_or_zero();
                let way = (at - corner.point).dot(out);
                return corner.point + out * (0.5 * ((way - self.w).max(0.0) + way + self.w));
            }
        }
        from
    }
}
