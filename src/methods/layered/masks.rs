//! Sets of a receiver's light samples, and which of them lie in a rectangle of the map.
//!
//! From a receiver, in map coordinates (column, row, inverse depth `w`), segments to light points are straight
//! lines; a line is known by its slopes, columns and rows per `w`. A rectangle of the map at one depth is a
//! rectangle of slopes: four table lookups and three operations on 256 bits say which of 256 samples pass
//! through it. Tables are by bins: a slope that lies within a bin counts as its middle, so that
//! rectangles which share a side share no sample and leave none out.

use std::ops::{BitAnd, BitOr, Not};

/// Samples in a set.
pub const BLOCK: usize = 256;

/// Bins of a table: as many as samples, for one of 256 stratified samples lies in each of as many columns of a
/// light.
pub const BINS: usize = 256;

/// A set of light samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C, align(32))]
pub struct Mask(pub [u64; 4]);

impl Mask {
    /// No sample.
    pub const NONE: Mask = Mask([0; 4]);

    /// The first `n` samples.
    pub fn first(n: usize) -> Mask {
        Mask(std::array::from_fn(|i| {
            let left = n.saturating_sub(64 * i);
            if left >= 64 {
                u64::MAX
            } else {
                (1 << left) - 1
            }
        }))
    }

    /// The set of samples whose bits are given, sixteen samples a row.
    pub fn from_rows(rows: &[u16]) -> Mask {
        let mut mask = Mask::NONE;
        for (r, &bits) in rows.iter().enumerate() {
            mask.0[r / 4] |= u64::from(bits) << (16 * (r % 4));
        }
        mask
    }

    /// The bits of samples `16 r` to `16 r + 15`.
    #[inline(always)]
    pub fn row(&self, r: usize) -> u16 {
        (self.0[r / 4] >> (16 * (r % 4))) as u16
    }

    /// Whether it is empty.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.0[0] | self.0[1] | self.0[2] | self.0[3] == 0
    }

    /// Number of samples.
    pub fn count(&self) -> u32 {
        self.0.iter().map(|w| w.count_ones()).sum()
    }

    /// The samples of this set that are not in `o`.
    #[inline(always)]
    pub fn without(self, o: Mask) -> Mask {
        self & !o
    }
}

impl BitAnd for Mask {
    type Output = Mask;
    #[inline(always)]
    fn bitand(self, o: Mask) -> Mask {
        Mask(std::array::from_fn(|i| self.0[i] & o.0[i]))
    }
}

impl BitOr for Mask {
    type Output = Mask;
    #[inline(always)]
    fn bitor(self, o: Mask) -> Mask {
        Mask(std::array::from_fn(|i| self.0[i] | o.0[i]))
    }
}

impl Not for Mask {
    type Output = Mask;
    #[inline(always)]
    fn not(self) -> Mask {
        Mask(self.0.map(|w| !w))
    }
}

/// The least coordinate, and the extent, that bins are made for. Samples in one point keep a bin's width of sixteen
/// ulps: what is nearer cannot be told apart.
pub fn spread(low: f32, high: f32) -> [f32; 2] {
    let least = (256.0 * 16.0 * f32::EPSILON) * low.abs().max(high.abs()).max(f32::MIN_POSITIVE);
    let extent = (high - low).max(least);
    [0.5 * (low + high) - 0.5 * extent, extent]
}

/// One coordinate of up to 256 samples.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Least coordinate.
    pub low: f32,
    /// Largest less least; not zero.
    pub extent: f32,
    /// The samples in the bins below each bin; a power of two, so that indices need no check.
    below: Box<[Mask; 2 * BINS]>,
}

impl Default for Axis {
    fn default() -> Self {
        Axis {
            low: 0.0,
            extent: 1.0,
            below: Box::new([Mask::NONE; 2 * BINS]),
        }
    }
}

impl Axis {
    /// Sorts samples with these coordinates into bins; those not in `valid` are in none.
    pub fn set(&mut self, coordinates: &[f32], valid: Mask) {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        let is_valid = |i: usize| valid.0[i / 64] >> (i % 64) & 1 == 1;
        for (i, &c) in coordinates.iter().enumerate() {
            if is_valid(i) {
                (low, high) = (low.min(c), high.max(c));
            }
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        [self.low, self.extent] = spread(low, high);
        let extent = self.extent;
        let mut bins = [Mask::NONE; BINS];
        let scale = BINS as f32 / extent;
        for (i, &c) in coordinates.iter().enumerate() {
            if is_valid(i) {
                let bin = ((c - self.low) * scale) as usize;
                bins[bin.min(BINS - 1)].0[i / 64] |= 1 << (i % 64);
            }
        }
        let mut all = Mask::NONE;
        for (bin, below) in bins.iter().zip(self.below.iter_mut()) {
            *below = all;
            all = all | *bin;
        }
        self.below[BINS] = all;
    }

    /// The samples in the bins from `from` on and below `to`, none if that is not larger; both are at most [`BINS`].
    #[inline(always)]
    pub fn between(&self, from: u32, to: u32) -> Mask {
        let at = |bin: u32| self.below[bin as usize % (2 * BINS)];
        at(to).without(at(from))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adjacent_intervals_share_no_sample_and_leave_none_out() {
        let coordinates: Vec<f32> = (0..200).map(|i| (i * 37 % 200) as f32 * 0.01).collect();
        let mut axis = Axis::default();
        axis.set(&coordinates, Mask::first(200));
        let mut seen = Mask::NONE;
        for (from, to) in [(0, 10), (10, 11), (11, 200), (200, 256)] {
            let part = axis.between(from, to);
            assert!((part & seen).is_empty());
            seen = seen | part;
        }
        assert_eq!(seen, Mask::first(200));
    }

    #[test]
    fn samples_in_one_point_and_none_at_all_have_tables() {
        let mut axis = Axis::default();
        axis.set(&[3.0; 5], Mask::first(5));
        assert_eq!(axis.between(0, 256).count(), 5);
        assert!(axis.extent > 0.0);
        axis.set(&[3.0; 5], Mask::NONE);
        assert!(axis.between(0, 256).is_empty());
    }
}
