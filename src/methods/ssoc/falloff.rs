//! How the part of a penumbra's width that lies beyond an edge turns into visibility.

use super::view::Outline;
use crate::light::{beyond_line_over_disk, beyond_line_over_rectangle};

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
