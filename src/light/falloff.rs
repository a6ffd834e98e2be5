//! How the part of a penumbra's width that lies beyond an edge turns into visibility.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use crate::light::reach::LightOutline;

/// Fraction of a disk on the positive side of a line, its centre at `x` radii (-1 to 1) on that side.
pub(crate) fn beyond_line_over_disk(x: f64) -> f64 {
    let x = x.clamp(-1.0, 1.0);
    // Rounding leaves the interval by an ulp next to its ends.
    (1.0 - (x.acos() - x * (1.0 - x * x).sqrt()) / PI).clamp(0.0, 1.0)
}

/// Fraction of a rectangle beyond a line that has `s` (0 to 1) of its width beyond it, of which the shorter
/// side makes up `part`, at most 1/2: the distribution of the sum of two uniform numbers.
pub(crate) fn beyond_line_over_rectangle(s: f64, part: f64) -> f64 {
    let end = s - (1.0 - part);
    // The two triangles at the ends, of which a rectangle parallel to the line has none.
    let triangles = if part > 0.0 {
        (s.min(part).powi(2) - end.max(0.0).powi(2)) * 0.5 / part
    } else {
        0.0
    };
    // As for a disk, rounding leaves the interval next to its ends.
    ((triangles + (s - part).max(0.0)) / (1.0 - part)).clamp(0.0, 1.0)
}

/// How visibility falls off across a penumbra.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Falloff {
    /// The area of the light that a line cuts off: exact for a straight edge and a small or flat light.
    Light,
    /// The part of the width.
    Linear,
    /// `3 s² - 2 s³`, as the paper.
    Smooth,
}

impl Falloff {
    /// Visibility, 0 to 1, where `s` of the width is beyond the edge; `part` as of [`LightOutline::radius`].
    #[inline(always)]
    pub fn visible(self, s: f64, part: f64, outline: &LightOutline) -> f64 {
        if s >= 1.0 {
            return 1.0;
        }
        match (self, outline) {
            (Falloff::Linear, _) => s.max(0.0),
            (Falloff::Smooth, _) => (s * s * (3.0 - 2.0 * s)).clamp(0.0, 1.0),
            (Falloff::Light, LightOutline::Rect(..)) => beyond_line_over_rectangle(s, part),
            (Falloff::Light, _) => beyond_line_over_disk(2.0 * s - 1.0),
        }
    }
}

/// A half-plane that hides a part of the light, as [`LightOutline::radius`] sees its border.
#[derive(Clone, Copy)]
pub struct Cut {
    /// The image normal `n` to the lit side at the image point `q`, as `(n, -n·q)`.
    pub gradient: DVec3,
    /// Signed distance of the border, positive where the light's centre is lit, in units in which the light reaches
    /// its radius.
    pub offset: f64,
}

impl Cut {
    /// The part of the light that two half-planes both hide.
    pub fn both(self, other: Cut, outline: &LightOutline) -> f64 {
        let (a, b) = (self.gradient, other.gradient);
        let (aa, ab, bb) = match *outline {
            LightOutline::Rect(u, v) => {
                let on = |c: Cut| (DVec2::new(c.gradient.dot(u), c.gradient.dot(v)), c.offset);
                return both_over_square(on(self), on(other));
            }
            LightOutline::Disk(m, radius) => {
                let (am, bm) = (a.dot(m), b.dot(m));
                let squared = radius * radius;
                (
                    squared * (a.dot(a) - am * am),
                    squared * (a.dot(b) - am * bm),
                    squared * (b.dot(b) - bm * bm),
                )
            }
            LightOutline::Sphere(radius) => {
                let squared = radius * radius;
                (squared * a.dot(a), squared * a.dot(b), squared * b.dot(b))
            }
        };
        let (ra, rb) = (aa.max(0.0).sqrt(), bb.max(0.0).sqrt());
        let cos = ab / (ra * rb);
        both_over_disk(self.offset / ra, other.offset / rb, cos)
    }
}

/// Fraction of the unit disk beyond two lines: at `p · n <= -x` and `p · m <= -y`, with `n · m = cos`.
///
/// Half of `∮ p · ds` around it: arcs of the circle, and what of each line is beyond the other.
fn both_over_disk(x: f64, y: f64, cos: f64) -> f64 {
    let [x, y, cos] = [x, y, cos].map(|v| v.clamp(-1.0, 1.0));
    let (a, b, turn) = (x.acos(), y.acos(), cos.acos());
    let arc = (a + b - turn).min(2.0 * a.min(b)).max(0.0) + (a + b + turn - TAU).max(0.0);
    // Of lines that are parallel by rounding each counts half: they are as long, and as far from the centre.
    let sin = (1.0 - cos * cos).sqrt().max(1e-12);
    let chord = |x: f64, y: f64| {
        let half = (1.0 - x * x).sqrt();
        half + ((x * cos - y) / sin).clamp(-half, half)
    };
    let area = 0.5 * (arc - x * chord(x, y) - y * chord(y, x));
    (area / PI).clamp(0.0, 1.0)
}

/// Fraction of the square [-1, 1]² beyond two lines, at `p · n <= -offset`.
fn both_over_square(first: (DVec2, f64), second: (DVec2, f64)) -> f64 {
    let mut polygon = [DVec2::ZERO; 6];
    polygon[..4].copy_from_slice(&[
        DVec2::new(-1.0, -1.0),
        DVec2::new(1.0, -1.0),
        DVec2::new(1.0, 1.0),
        DVec2::new(-1.0, 1.0),
    ]);
    let mut count = 4;
    for (n, offset) in [first, second] {
        let (old, corners) = (polygon, count);
        count = 0;
        for i in 0..corners {
            let (p, q) = (old[i], old[(i + 1) % corners]);
            let (before, after) = (n.dot(p) + offset, n.dot(q) + offset);
            if before <= 0.0 {
                polygon[count] = p;
                count += 1;
            }
            if (before <= 0.0) != (after <= 0.0) && count < polygon.len() {
                polygon[count] = p + (q - p) * (before / (before - after));
                count += 1;
            }
        }
    }
    let twice = |i: usize| polygon[i].perp_dot(polygon[(i + 1) % count]);
    ((0..count).map(twice).sum::<f64>() / 8.0).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn the_lights_falloff_is_the_area_of_its_samples_beyond_the_line() {
        let n = 1000;
        let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n) - 0.5;
        for part in [0.0, 0.1, 0.5] {
            let outline = LightOutline::Rect(DVec3::X, DVec3::Y);
            for s in [0.03, 0.3, 0.5, 0.8, 1.0] {
                let beyond = |i: i32, j: i32| (1.0 - part) * at(i) + part * at(j) + 0.5 < s;
                let count = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
                let count = count.filter(|&(i, j)| beyond(i, j)).count();
                let expected = count as f64 / f64::from(n * n);
                let found = Falloff::Light.visible(s, part, &outline);
                // The grid's cells on the line: one in a row.
                assert!(
                    (found - expected).abs() < 2e-3,
                    "{part} {s}: {found} {expected}"
                );
            }
        }
        let disk = LightOutline::Sphere(1.0);
        let samples = (0..n).flat_map(|i| (0..n).map(move |j| (2.0 * at(i), 2.0 * at(j))));
        let inside: Vec<f64> = samples
            .filter(|(x, y)| x * x + y * y < 1.0)
            .map(|p| p.0)
            .collect();
        for s in [0.1, 0.5, 0.75] {
            let count = inside.iter().filter(|x| **x < 2.0 * s - 1.0).count();
            let found = Falloff::Light.visible(s, 0.0, &disk);
            assert!((found - count as f64 / inside.len() as f64).abs() < 2e-3);
        }
    }

    #[test]
    fn what_two_lines_both_hide_is_the_area_of_the_lights_samples_behind_both() {
        let n = 400;
        let at = |i: i32| 2.0 * (f64::from(i) + 0.5) / f64::from(n) - 1.0;
        let (u, v) = (DVec3::new(0.4, 0.1, 0.05), DVec3::new(-0.1, 0.3, 0.2));
        let m = DVec3::new(0.3, -0.2, 0.9).normalize();
        let e = m.any_orthonormal_vector() * 0.4;
        let round = [e, m.cross(e)];
        let outlines = [
            (LightOutline::Rect(u, v), [u, v]),
            (LightOutline::Disk(m, 0.4), round),
            // Seen along its axis.
            (LightOutline::Sphere(0.4), [DVec3::X * 0.4, DVec3::Y * 0.4]),
        ];
        for (outline, axes) in outlines {
            let round = !matches!(outline, LightOutline::Rect(..));
            let q = match outline {
                LightOutline::Sphere(_) => DVec2::ZERO,
                _ => DVec2::new(0.3, -0.2),
            };
            for (turn, x, y) in (0..13)
                .flat_map(|k| {
                    let turn = f64::from(k) * PI / 6.0;
                    [-0.25, 0.0, 0.1].map(|x| [-0.3, 0.0, 0.2].map(|y| (turn, x, y)))
                })
                .flatten()
            {
                let [a, b] = [(0.4, x), (0.4 + turn, y)].map(|(angle, offset)| {
                    let normal = DVec2::from_angle(angle);
                    Cut {
                        gradient: normal.extend(-normal.dot(q)),
                        offset,
                    }
                });
                let hidden = |c: &Cut, p: DVec3| c.gradient.dot(p) + c.offset <= 0.0;
                let (mut both, mut all) = (0, 0);
                for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                    let (s, t) = (at(i), at(j));
                    if round && s * s + t * t > 1.0 {
                        continue;
                    }
                    let p = s * axes[0] + t * axes[1];
                    all += 1;
                    both += i32::from(hidden(&a, p) && hidden(&b, p));
                }
                let expected = f64::from(both) / f64::from(all);
                let found = a.both(b, &outline);
                // Two borders and the rim, each off by up to a sample of 400.
                assert!(
                    (found - expected).abs() < 5e-3,
                    "{outline:?} {turn} {x} {y}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn every_falloff_runs_from_dark_to_lit_through_one_half() {
        let outlines = [
            LightOutline::Sphere(1.0),
            LightOutline::Rect(DVec3::X, DVec3::Y),
        ];
        for falloff in [Falloff::Light, Falloff::Linear, Falloff::Smooth] {
            for outline in &outlines {
                let value = |s| falloff.visible(s, 0.3, outline);
                assert_eq!(value(1.0), 1.0);
                assert!(value(0.0).abs() < 1e-15 && (value(0.5) - 0.5).abs() < 1e-15);
            }
        }
    }
}
