//! The course of a silhouette over the width of the light.
//!
//! Where a silhouette is made of edges shorter than its penumbra, as those of bumps, folds and curved bodies, the
//! nearest of them does not stand for all that hides the light: a bump's tip hides less than the line through it, a
//! dent's bottom more. The shadow map around an edge tells what does. In columns along the edge's normal, over
//! nearly the penumbra's half-width to both sides, the border of what is hidden is followed from the edge; its mean
//! and slope make up a line that hides as much of the light. Where the occluder's other side comes into the light's
//! reach, the area that is free there says how far away that side is, on average.

use std::f64::consts::PI;

use glam::DVec2;

use super::maps::{Line, Maps, Trend};

/// Smallest half-width in texels of a penumbra whose silhouette is followed: the shadow map's staircase is an eighth
/// of it.
const LEAST_WIDTH: f64 = 4.0;

/// Length of an edge over the half-width from which it stands for itself.
const LONGEST: f64 = 0.5;

/// Part of the half-width that is followed: beyond, columns of a disk are short.
const FOLLOWED: f64 = 0.9;

/// Most columns to a side: more, and their steps are finer than the error of the fit.
const MOST_COLUMNS: f64 = 16.0;

/// Texels from an edge at which the border that it draws has to be.
const NEAR: f64 = 3.0;

/// Smallest part of the light that has to be free past the other side: less is the staircase's.
const LEAST_FREE: f64 = 0.01;

/// The shadow map around an edge's middle, in its directions.
struct Around<'a> {
    maps: &'a Maps,
    middle: DVec2,
    along: DVec2,
    normal: DVec2,
    /// Inverse depth from which something hides what is behind the edge.
    bound: f64,
}

impl Around<'_> {
    fn hides(&self, t: f64, y: f64) -> bool {
        let texel = self
            .maps
            .view
            .texel(self.middle + self.along * t + self.normal * y);
        texel.is_some_and(|texel| self.maps.inverse_depth[texel] > self.bound)
    }

    /// Where a column enters the map from its dark end; nothing hides before.
    fn low(&self, t: f64) -> f64 {
        let camera = &self.maps.view.camera;
        let size = [camera.width, camera.height].map(f64::from);
        let from = self.middle + self.along * t;
        let low = |k: usize| {
            let end = if self.normal[k] > 0.0 { 0.0 } else { size[k] };
            match self.normal[k] {
                0.0 => f64::NEG_INFINITY,
                slope => (end - from[k]) / slope,
            }
        };
        low(0).max(low(1))
    }

    /// The border in a column, from that of its neighbour, at most `most` away from the edge. Its steps are as many
    /// as the map is wide, however wide the penumbra.
    fn border(&self, from: f64, t: f64, most: f64) -> f64 {
        let mut y = from;
        if self.hides(t, y) {
            while y < most {
                y += 1.0;
                if !self.hides(t, y) {
                    return (y - 0.5).min(most);
                }
            }
            return most;
        }
        let low = self.low(t);
        while y > low.max(-most) {
            y -= 1.0;
            if self.hides(t, y) {
                return (y + 0.5).max(-most);
            }
        }
        -most
    }

    /// How much of a column is past the other side of what the border at `top` bounds.
    fn free(&self, top: f64, t: f64, most: f64) -> f64 {
        if top.abs() >= most {
            return 0.0;
        }
        let mut y = top - 0.5;
        while y > -most && self.hides(t, y) {
            y -= 2.0;
        }
        if y > -most { y + 1.0 + most } else { 0.0 }
    }
}

impl Maps {
    /// What the silhouette is like around a line whose widest penumbra has the half-width `width`, in texels.
    pub(super) fn trend(&self, line: &Line, width: f64) -> Trend {
        if width < LEAST_WIDTH || line.length > LONGEST * width {
            return Trend::NONE;
        }
        let inverse_near = line.inverse_depth[0] + 0.5 * line.length * line.inverse_depth[1];
        let around = Around {
            maps: self,
            middle: line.start + line.along * (0.5 * line.length),
            along: line.along,
            normal: line.normal(),
            bound: 0.5 * (inverse_near + line.inverse_far),
        };
        let start = around.border(0.0, 0.0, NEAR + 1.0);
        if start.abs() >= NEAR {
            return Trend::NONE;
        }
        let columns = (FOLLOWED * width).ceil().min(MOST_COLUMNS);
        let step = FOLLOWED * width / columns;
        let (mut sum, mut sum_t, mut sum_tt) = (start, 0.0, 0.0);
        let (mut free, mut all) = (around.free(start, 0.0, width), 2.0 * width);
        for side in [-1.0, 1.0] {
            let (mut y, mut ended) = (start, false);
            for column in 1..=columns as u32 {
                let t = step * f64::from(column);
                let most = (width * width - t * t).sqrt();
                y = y.clamp(-most, most);
                if !ended {
                    y = around.border(y, side * t, most);
                    ended = y.abs() == most;
                }
                free += around.free(y, side * t, most);
                all += 2.0 * most;
                sum += y;
                sum_t += side * t * y;
                sum_tt += t * t;
            }
        }
        let mean = sum / (2.0 * columns + 1.0);
        let normal = (around.normal - around.along * (sum_t / sum_tt)).normalize();
        let part = free / all;
        Trend {
            normal,
            offset: (around.middle + around.normal * mean).dot(normal),
            inverse_width: 1.0 / width,
            thickness: if part > LEAST_FREE {
                (mean + width * distance_of(part)).max(0.0)
            } else {
                f64::INFINITY
            },
        }
    }
}

/// Distance from a unit disk's centre of the line that cuts off a part of it, to 2⁻²⁰.
fn distance_of(part: f64) -> f64 {
    let (mut low, mut high) = (-1.0f64, 1.0f64);
    for _ in 0..20 {
        let d = 0.5 * (low + high);
        if d.acos() - d * (1.0 - d * d).sqrt() > PI * part {
            low = d;
        } else {
            high = d;
        }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::falloff::beyond_line_over_disk;

    #[test]
    fn a_line_at_the_distance_of_a_part_cuts_it_off() {
        for k in 1..100 {
            let part = f64::from(k) / 100.0;
            let found = beyond_line_over_disk(-distance_of(part));
            assert!((found - part).abs() < 1e-5, "{part} {found}");
        }
    }
}
