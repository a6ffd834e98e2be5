//! How the part of a penumbra's width that lies beyond an edge turns into visibility.

use crate::light::{beyond_line_over_disk, beyond_line_over_rectangle};
use crate::methods::views::Outline;

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
    /// Visibility where `s` (0 or more) of the width is beyond the edge; `part` as of [`Outline::radius`].
    #[inline(always)]
    pub fn visible(self, s: f64, part: f64, outline: &Outline) -> f64 {
        if s >= 1.0 {
            return 1.0;
        }
        match (self, outline) {
            (Falloff::Linear, _) => s,
            (Falloff::Smooth, _) => s * s * (3.0 - 2.0 * s),
            (Falloff::Light, Outline::Rect(..)) => beyond_line_over_rectangle(s, part),
            (Falloff::Light, _) => beyond_line_over_disk(2.0 * s - 1.0),
        }
    }
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
            let outline = Outline::Rect(DVec3::X, DVec3::Y);
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
        let disk = Outline::Sphere(1.0);
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
    fn every_falloff_runs_from_dark_to_lit_through_one_half() {
        let outlines = [Outline::Sphere(1.0), Outline::Rect(DVec3::X, DVec3::Y)];
        for falloff in [Falloff::Light, Falloff::Linear, Falloff::Smooth] {
            for outline in &outlines {
                let value = |s| falloff.visible(s, 0.3, outline);
                assert_eq!(value(1.0), 1.0);
                assert!(value(0.0).abs() < 1e-15 && (value(0.5) - 0.5).abs() < 1e-15);
            }
        }
    }
}
