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

use super::falloff::Cut;
use super::lookup::{Lookup, Penumbra, Receiver};
use super::maps::{Line, Maps};
use crate::methods::views::View;
use crate::raster::nearest::NONE;

/// Cosine of the smallest turn that makes a corner sharp, 25°: the distance from a blunter one is within 0.05
/// of what it hides.
const SHARP: f64 = 0.9;

/// Texels from a line at which what is beside it is looked up.
const BESIDE: f64 = 1.5;

/// Where a silhouette turns sharply.
#[derive(Debug, Clone, Copy)]
pub struct Corner {
    /// Where, in texels.
    pub point: DVec2,
    /// The lines that end and start there.
    pub lines: [u32; 2],
    /// How far the silhouette runs about straight on from there, on the first line's side and the second's, in
    /// texels.
    pub arms: [f64; 2],
    /// Image points on the lit side of the first line and the second, beside the middles of the arms.
    pub beside: [DVec2; 2],
    /// Whether it hides what both lines hide, not what either does.
    pub convex: bool,
}

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
        let half = arms.map(|arm| 0.5 * arm.min(reach));
        let beside = if convex {
            [
                b.start - a.along * half[0] + a.normal() * BESIDE,
                b.start + b.along * half[1] + b.normal() * BESIDE,
            ]
        } else {
            let out = (b.along - a.along).normalize_or_zero();
            half.map(|d| b.start + out * d)
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

/// What one line, going on straight, does to a receiver.
struct Straight {
    /// The part of the light that it leaves.
    visible: f64,
    cut: Cut,
    /// Half-width of the penumbra in texels.
    width: f64,
}

impl Lookup<'_> {
    fn straight(&self, view: &View, line: &Line, receiver: &Receiver) -> Straight {
        let from = receiver.at - line.start;
        let t = from.dot(line.along).clamp(0.0, line.length);
        let q = view.tangents(line.start + line.along * t);
        let (normal, x) = (line.normal(), from.dot(line.normal()));
        let inverse_near = line.inverse_depth[0] + t * line.inverse_depth[1];
        let scale = view.focal * (inverse_near - receiver.inverse_depth);
        let (radius, part) = view.outline.radius(normal, q);
        let width = scale * radius;
        let s = ((width + x) / (2.0 * width)).clamp(0.0, 1.0);
        Straight {
            visible: self.falloff.visible(s, part, &view.outline),
            cut: Cut {
                gradient: normal.extend(-normal.dot(q)),
                offset: x / scale,
            },
            width,
        }
    }

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
        if line.corners != [NONE; 2] {
            self.cut_corners_of(maps, line, receiver, found);
        }
    }

    #[inline(never)]
    fn cut_corners_of(&self, maps: &Maps, line: &Line, receiver: &Receiver, found: &mut Penumbra) {
        let own = self.straight(&maps.view, line, receiver);
        let at = (receiver.at - line.start).dot(line.along);
        let beyond = [at < 0.0, at > line.length];
        let round = found.visible;
        let mut visible = if beyond[0] || beyond[1] {
            round
        } else {
            own.visible
        };
        for end in 0..2 {
            let Some((weight, exact)) = self.corner(maps, line, end, &own, receiver) else {
                continue;
            };
            let before = if beyond[end] { round } else { own.visible };
            visible += weight * (exact - before);
            found.visible = visible.clamp(0.0, 1.0);
            if weight > 0.5 {
                found.corners[end] = line.corners[end];
            }
        }
    }

    /// How much a corner at an end of a line counts, and what it leaves of the light; `None` where it does not
    /// count.
    fn corner(
        &self,
        maps: &Maps,
        line: &Line,
        end: usize,
        own: &Straight,
        receiver: &Receiver,
    ) -> Option<(f64, f64)> {
        let view = &maps.view;
        let corner = maps.corners.get(line.corners[end] as usize)?;
        let other = &maps.lines[corner.lines[end] as usize];
        let next = self.straight(view, other, receiver);
        if next.width.is_nan() || next.width <= 0.0 {
            return None;
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
            texel.is_some_and(|texel| Self::hidden_at(maps, texel, receiver))
        };
        if weight == 0.0 || corner.beside.into_iter().any(dark) {
            return None;
        }
        let both = own.cut.both(next.cut, &view.outline);
        let exact = match corner.convex {
            true => 1.0 - both,
            false => own.visible + next.visible - 1.0 + both,
        };
        Some((weight, exact))
    }
}

impl Penumbra {
    /// Whether a line is at one of the corners that are taken into account.
    pub(super) fn has(&self, maps: &Maps, line: u32) -> bool {
        let corners = self.corners.iter().filter(|&&c| c != NONE);
        corners
            .into_iter()
            .any(|&c| maps.corners[c as usize].lines.contains(&line))
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
