//! Sharp corners of silhouettes in a map.
//!
//! The distance from a corner is not how much of the light it hides: that is the area that both of its lines
//! cut off together. A lookup that finds either line near a corner takes the other into account, as far as the
//! silhouette runs about straight on from the corner for as long as the light is wide.

use glam::DVec2;

use super::maps::Line;
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
