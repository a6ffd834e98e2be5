//! What the samples of neighbours on the same surface tell together.
//!
//! Around each pixel, windows of up to three pixels to every side grow while the mean over the larger one is what the
//! smaller ones let expect (the intersection of confidence intervals of Goldenshluger and Nemirovski 1997): over a
//! smooth penumbra they grow to the full size, at the edge of a hard shadow not at all. Only neighbours of the same entry of
//! the scene count, near the receiver's tangent plane and turned alike, and each only together with the one
//! opposite, so that what changes linearly over the picture stays as it is.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};

use fearless_simd::dispatch;
use rayon::prelude::*;

use super::neighbours::Surface;
use super::surface::entries;
use super::window::{OFFSET, REACH, SIDE, Table, WIDE, half_ring, row};
use super::{Estimate, part};
use crate::control::Control;
use crate::error::Result;
use crate::geometry::Geometry;
use crate::raster::nearest::NONE;
use crate::receivers::Receivers;
use crate::simd::detect;

/// Standard deviations that make a confidence interval. With more, windows that are too large blur what is sharp
/// before their means tell, with fewer they stay small where nothing is.
const CONFIDENCE: f32 = 0.7;

/// Squared error of a mean over a window as a multiple of its variance: the largest window whose mean is not yet
/// seen to be off is off by as much again as its samples vary, and by more in pictures of few pixels.
const BLUR: f32 = 3.0;

/// Squared error that is left where `n` samples agree, times `n²`.
const UNSEEN: f32 = 0.05;

/// What is found for a receiver.
#[derive(Debug, Clone, Copy, Default)]
pub struct Filtered {
    /// Visibility.
    pub seen: f32,
    /// Part of the unshadowed irradiance.
    pub part: f32,
    /// Squared error of the visibility that is to be expected.
    pub error: f32,
}

/// Which receivers are neighbours.
pub struct Filter<'a> {
    receivers: &'a Receivers,
    /// Width and height of the image.
    size: [usize; 2],
    /// The receiver of each pixel; none where receivers are a user's own points.
    pixels: Vec<AtomicU32>,
    /// Of each receiver, a bit for every pair of opposite neighbours that lie on its surface, both of them.
    pairs: Vec<u32>,
}

impl<'a> Filter<'a> {
    /// Finds the neighbours of receivers with these estimates; those that are exact need none.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    pub fn new(
        geometry: &Geometry,
        receivers: &'a Receivers,
        estimates: &[Estimate],
        control: &Control,
    ) -> Result<Self> {
        let camera = receivers.camera.as_ref();
        let size = camera.map_or([0, 0], |c| [c.width as usize, c.height as usize]);
        let mut pixels = Vec::new();
        pixels.resize_with(size[0] * size[1], || AtomicU32::new(NONE));
        if camera.is_some() {
            let set =
                |(i, &at): (usize, &u32)| pixels[at as usize].store(i as u32, Ordering::Relaxed);
            receivers.index.par_iter().enumerate().for_each(set);
        }
        let mut filter = Filter {
            receivers,
            size,
            pixels,
            pairs: Vec::new(),
        };
        if camera.is_some() {
            filter.pairs = filter.find_pairs(geometry, estimates, control)?;
        }
        Ok(filter)
    }

    fn find_pairs(
        &self,
        geometry: &Geometry,
        estimates: &[Estimate],
        control: &Control,
    ) -> Result<Vec<u32>> {
        let entries = entries(geometry, self.receivers);
        let find = |surface: &mut Box<Surface>, range: Range<usize>, out: &mut [u32]| {
            if estimates[range.clone()].iter().all(Estimate::is_exact) {
                return Ok(());
            }
            let corner = self.corner(range.start);
            surface.set(self.receivers, &entries, |x, y| {
                self.at(corner.0 + x, corner.1 + y)
            });
            dispatch!(detect(), _simd => surface.find());
            for (i, out) in range.zip(out) {
                *out = surface.pairs[self.in_block(i, corner)];
            }
            Ok(())
        };
        self.receivers
            .by_groups(control, 0, Box::<Surface>::default, find)
    }

    /// What is found for all receivers; as `before`, which may be empty, where nothing in a block and the blocks around it
    /// is `new`.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    pub fn apply(
        &self,
        estimates: &[Estimate],
        new: &[bool],
        before: Vec<Filtered>,
        control: &Control,
    ) -> Result<Vec<Filtered>> {
        let blocks = self.new_blocks(new);
        let find = |tile: &mut Box<Tile>, range: Range<usize>, out: &mut [Filtered]| {
            let own = &estimates[range.clone()];
            if !before.is_empty() && !self.is_near(&blocks, range.start) {
                out.copy_from_slice(&before[range]);
            } else if self.pixels.is_empty() || own.iter().all(Estimate::is_exact) {
                let variance = variance_of_points(own);
                let found = own.iter().map(|e| alone(e, variance));
                out.iter_mut()
                    .zip(found)
                    .for_each(|(out, found)| *out = found);
            } else {
                let corner = self.corner(range.start);
                tile.set(self, estimates, range.clone(), corner);
                dispatch!(detect(), _simd => tile.find());
                for (i, out) in range.zip(out) {
                    let at = self.in_block(i, corner);
                    *out = Filtered {
                        seen: tile.found[0][at],
                        part: tile.found[1][at],
                        error: tile.found[2][at],
                    };
                }
            }
            Ok(())
        };
        let receivers = self.receivers;
        receivers.by_groups(control, Filtered::default(), Box::<Tile>::default, find)
    }

    /// Which blocks of pixels have something new; none where there are no pixels.
    fn new_blocks(&self, new: &[bool]) -> Vec<bool> {
        let [columns, rows] = self.size.map(|pixels| pixels.div_ceil(SIDE));
        let mut blocks = vec![false; columns * rows];
        if !blocks.is_empty() {
            for i in (0..new.len()).filter(|&i| new[i]) {
                let (x, y) = self.corner(i);
                blocks[y / SIDE * columns + x / SIDE] = true;
            }
        }
        blocks
    }

    /// Whether the block of receiver `i` or one around it is among these; everything is, where there are no blocks.
    fn is_near(&self, blocks: &[bool], i: usize) -> bool {
        if blocks.is_empty() {
            return true;
        }
        let (x, y) = self.corner(i);
        let columns = self.size[0].div_ceil(SIDE);
        let (x, y) = (x / SIDE, y / SIDE);
        let last = blocks.len() / columns - 1;
        (y.saturating_sub(1)..=(y + 1).min(last)).any(|y| {
            (x.saturating_sub(1)..=(x + 1).min(columns - 1)).any(|x| blocks[y * columns + x])
        })
    }

    /// Column and row of the pixel of receiver `i`.
    fn place(&self, i: usize) -> (usize, usize) {
        let at = self.receivers.index[i] as usize;
        (at % self.size[0], at / self.size[0])
    }

    /// The first pixel of the block that the pixel of receiver `i` is in.
    fn corner(&self, i: usize) -> (usize, usize) {
        let (x, y) = self.place(i);
        (x / SIDE * SIDE, y / SIDE * SIDE)
    }

    /// The place of receiver `i` in its block, row by row.
    fn in_block(&self, i: usize, corner: (usize, usize)) -> usize {
        let (x, y) = self.place(i);
        (y - corner.1) * SIDE + (x - corner.0)
    }

    /// The receiver of a pixel, counted from outside of the image by the reach of windows.
    fn at(&self, x: usize, y: usize) -> Option<usize> {
        let (x, y) = (x.checked_sub(REACH)?, y.checked_sub(REACH)?);
        if x >= self.size[0] || y >= self.size[1] {
            return None;
        }
        let i = self.pixels[y * self.size[0] + x].load(Ordering::Relaxed);
        (i != NONE).then_some(i as usize)
    }
}

/// What a receiver's own samples tell, each of which has this variance.
fn alone(e: &Estimate, variance: f32) -> Filtered {
    let samples = e.samples as f32;
    Filtered {
        seen: e.seen,
        part: e.part(),
        error: if e.is_exact() {
            0.0
        } else {
            variance / samples + unseen(samples)
        },
    }
}

/// Squared error that is left where so many samples agree.
fn unseen(samples: f32) -> f32 {
    UNSEEN / (samples * samples)
}

/// The variance of one sample of points that are neighbours: two halves of four samples agree too often to be
/// asked alone.
fn variance_of_points(estimates: &[Estimate]) -> f32 {
    let open = || estimates.iter().filter(|e| !e.is_exact());
    let sum: f32 = open().map(|e| e.variance * e.samples as f32).sum();
    sum / open().count().max(1) as f32
}

/// What samples tell of a block of pixels and what is around it.
struct Tile {
    /// What windows add up, a table each.
    values: [Table<f32>; SUMS],
    pairs: [u32; SIDE * SIDE],
    /// Visibility, part of the irradiance and squared error of the block's pixels.
    found: [[f32; SIDE * SIDE]; 3],
}

/// How many quantities windows add up, and which is which.
const SUMS: usize = 5;
const SEEN: usize = 0;
const VARIANCE: usize = 1;
const IRRADIANCE: usize = 2;
const UNSHADOWED: usize = 3;
const SAMPLES: usize = 4;

impl Default for Tile {
    fn default() -> Self {
        Tile {
            values: [[0.0; WIDE * WIDE]; SUMS],
            pairs: [0; SIDE * SIDE],
            found: [[0.0; SIDE * SIDE]; 3],
        }
    }
}

impl Tile {
    /// Takes the block with this first pixel, which these receivers lie in.
    fn set(
        &mut self,
        filter: &Filter,
        estimates: &[Estimate],
        range: Range<usize>,
        corner: (usize, usize),
    ) {
        for y in 0..WIDE {
            for x in 0..WIDE {
                let at = y * WIDE + x;
                let e = filter
                    .at(corner.0 + x, corner.1 + y)
                    .map_or_else(Estimate::default, |i| estimates[i]);
                let samples = e.samples as f32;
                let values = [e.seen, e.variance, e.irradiance, e.unshadowed, samples];
                for (table, value) in self.values.iter_mut().zip(values) {
                    table[at] = value;
                }
            }
        }
        self.pairs = [0; SIDE * SIDE];
        for i in range {
            self.pairs[filter.in_block(i, corner)] = filter.pairs[i];
        }
    }

    /// Finds the block's pixels.
    #[inline(always)]
    fn find(&mut self) {
        for y in 0..SIDE {
            self.find_row(y);
        }
    }

    #[inline(always)]
    fn find_row(&mut self, y: usize) {
        let middle = (y + REACH) * WIDE + REACH;
        let mut sums = [[0.0; SIDE]; SUMS];
        for (sum, values) in sums.iter_mut().zip(&self.values) {
            sum.copy_from_slice(row(values, middle));
        }
        let (own_samples, own) = (sums[SAMPLES], sums[SEEN]);
        let (mut seen, mut irradiance, mut unshadowed) = (own, sums[IRRADIANCE], sums[UNSHADOWED]);
        let mut error = [0.0; SIDE];
        if own_samples != [0.0; SIDE] {
            self.errors_alone(middle, &mut error);
            let pairs = &self.pairs[y * SIDE..(y + 1) * SIDE];
            let (mut low, mut high) = ([0.0; SIDE], [0.0; SIDE]);
            for x in 0..SIDE {
                let spread = CONFIDENCE * error[x].sqrt();
                (low[x], high[x]) = (own[x] - spread, own[x] + spread);
            }
            // What is exact stays so.
            let mut grows = own_samples.map(|samples| samples > 0.0);
            let mut count = [1.0f32; SIDE];
            let mut bit = 0;
            for reach in 1..=REACH {
                let before = count;
                for away in half_ring(reach) {
                    let (a, b) = (middle + away - OFFSET, middle + OFFSET - away);
                    let mut alike = [0.0; SIDE];
                    for x in 0..SIDE {
                        alike[x] = (pairs[x] >> bit & 1) as f32;
                        count[x] += 2.0 * alike[x];
                    }
                    bit += 1;
                    for (sum, values) in sums.iter_mut().zip(&self.values) {
                        let (a, b) = (row(values, a), row(values, b));
                        for x in 0..SIDE {
                            sum[x] += alike[x] * (a[x] + b[x]);
                        }
                    }
                }
                for x in 0..SIDE {
                    let mean = sums[SEEN][x] / count[x];
                    let samples = sums[SAMPLES][x].max(1.0);
                    let of_mean = sums[VARIANCE][x] / (count[x] * count[x]) + unseen(samples);
                    let spread = CONFIDENCE * of_mean.sqrt();
                    low[x] = low[x].max(mean - spread);
                    high[x] = high[x].min(mean + spread);
                    grows[x] = grows[x] & (count[x] > before[x]) & (low[x] <= high[x]);
                    let better = grows[x] & (BLUR * of_mean < error[x]);
                    let take = |of: f32, old: &mut f32| *old = if better { of } else { *old };
                    take(BLUR * of_mean, &mut error[x]);
                    take(mean, &mut seen[x]);
                    take(sums[IRRADIANCE][x], &mut irradiance[x]);
                    take(sums[UNSHADOWED][x], &mut unshadowed[x]);
                }
            }
        }
        for x in 0..SIDE {
            let exact = own_samples[x] == 0.0;
            self.found[0][y * SIDE + x] = seen[x];
            self.found[1][y * SIDE + x] = part(irradiance[x], unshadowed[x]);
            self.found[2][y * SIDE + x] = if exact { 0.0 } else { error[x] };
        }
    }

    /// Squared errors of pixels' own means, by the variance of one sample around them.
    #[inline(always)]
    fn errors_alone(&self, middle: usize, out: &mut [f32; SIDE]) {
        let (mut sum, mut count) = ([0.0; SIDE], [0.0f32; SIDE]);
        for dy in 0..3 {
            for dx in 0..3 {
                let at = middle + dy * WIDE + dx - (WIDE + 1);
                let samples = row(&self.values[SAMPLES], at);
                let variance = row(&self.values[VARIANCE], at);
                for x in 0..SIDE {
                    sum[x] += variance[x] * samples[x];
                    count[x] += if samples[x] > 0.0 { 1.0 } else { 0.0 };
                }
            }
        }
        let samples = row(&self.values[SAMPLES], middle);
        for x in 0..SIDE {
            let samples = samples[x].max(1.0);
            out[x] = sum[x] / (count[x].max(1.0) * samples) + unseen(samples);
        }
    }
}
