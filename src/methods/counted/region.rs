//! Which part of a slanted row belongs to the light and is above the tangent plane.

use fearless_simd::{f32x16, prelude::*};
use glam::DVec3;

use crate::sampling::square::Square;
use crate::simd::Lanes;

/// Where rows `t - slope s` are inside of the disk in the unit square.
#[inline(always)]
pub(super) fn chord<S: Simd>(t: f32x16<S>, slope: f32) -> [f32x16<S>; 2] {
    // (2s - 1)² + (2(t - slope s) - 1)² = 1 for x = 2s - 1: x² + (c - slope x)² = 1 with c = 2t - 1 - slope.
    let c = t * 2.0 - (1.0 + slope);
    let a = 1.0 + slope * slope;
    let root = a - c * c;
    let (middle, half) = (c * (slope / a), root.greater(0.0).sqrt() * (1.0 / a));
    let passes = root.gt(0.0);
    [
        (middle - half + 1.0).where_bits(passes, 2.0) * 0.5,
        (middle + half + 1.0).where_bits(passes, 0.0) * 0.5,
    ]
}

/// The height over the tangent plane of a row's points, `start + t side + s rise`.
pub(super) struct Horizon {
    start: f32,
    side: f32,
    rise: f32,
}

impl Horizon {
    pub(super) fn new(square: &Square, normal: DVec3, slope: f32) -> Self {
        let [start, along, side] =
            [square.corner, square.sides[0], square.sides[1]].map(|v| normal.dot(v));
        Horizon {
            start: start as f32,
            side: side as f32,
            rise: (along - f64::from(slope) * side) as f32,
        }
    }

    /// What of the rows between two ends is above the plane.
    #[inline(always)]
    pub(super) fn cut<S: Simd>(
        &self,
        t: f32x16<S>,
        low: f32x16<S>,
        high: f32x16<S>,
    ) -> (f32x16<S>, f32x16<S>) {
        let start = t * self.side + self.start;
        if self.rise == 0.0 {
            return (low, high.where_bits(start.gt(0.0), low));
        }
        let at = start / -self.rise;
        if self.rise > 0.0 {
            (low.greater(at), high)
        } else {
            (low, high.lesser(at))
        }
    }
}
