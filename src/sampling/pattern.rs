//! The points of the unit square that samples start from: a scrambled Sobol sequence.

use std::ops::Range;

use super::cells::morton;
use crate::simd::LANES;

/// The points of the unit square that all receivers start from, in Morton order of the grid's cells,
/// so that sixteen neighbours lie in a compact part of the light.
#[derive(Debug, Clone)]
pub struct Pattern {
    len: usize,
    /// Padded with zeros to whole rows.
    pub(super) x: Vec<[u32; LANES]>,
    pub(super) y: Vec<[u32; LANES]>,
    seed: u64,
}

impl Pattern {
    /// The first `n` points of the sequence with this seed.
    pub fn new(n: usize, seed: u64) -> Self {
        let mut points: Vec<(u32, u32)> = (0..n as u32).map(|i| point(i, seed)).collect();
        sort(&mut points);
        Pattern::of(&points, seed)
    }

    /// [`Pattern::part`] with each half of its points in Morton order.
    pub fn halves(range: Range<usize>, seed: u64) -> Self {
        let mut points: Vec<_> = range.map(|i| point(i as u32, seed)).collect();
        let middle = points.len() / 2;
        let (early, late) = points.split_at_mut(middle);
        sort(early);
        sort(late);
        Pattern::of(&points, seed)
    }

    /// The points of the sequence from number `range.start` to `range.end`, in its order: what refining adds to
    /// the points before.
    pub fn part(range: Range<usize>, seed: u64) -> Self {
        let points: Vec<_> = range.map(|i| point(i as u32, seed)).collect();
        Pattern::of(&points, seed)
    }

    fn of(points: &[(u32, u32)], seed: u64) -> Self {
        let rows = |pick: fn(&(u32, u32)) -> u32| {
            let row = |c: &[(u32, u32)]| std::array::from_fn(|i| c.get(i).map_or(0, pick));
            points.chunks(LANES).map(row).collect()
        };
        Pattern {
            len: points.len(),
            x: rows(|p| p.0),
            y: rows(|p| p.1),
            seed,
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The digits that receiver `index` flips for its own pattern.
    pub fn scramble(&self, index: u32) -> [u32; 2] {
        let h = hash(self.seed, u64::from(index) + 0x9e37_79b9);
        [h as u32, (h >> 32) as u32]
    }
}

/// Sorts points along a Morton curve.
fn sort(points: &mut [(u32, u32)]) {
    points.sort_unstable_by_key(|&(x, y)| (morton(x >> 16) | (morton(y >> 16) << 1), x, y));
}

/// Point `i` of the sequence, as 32-bit fractions.
fn point(i: u32, seed: u64) -> (u32, u32) {
    let (sx, sy) = (hash(seed, 0x51) as u32, hash(seed, 0x52) as u32);
    (
        owen_scramble(i.reverse_bits(), sx),
        owen_scramble(sobol_second(i), sy),
    )
}

/// Second dimension of the Sobol sequence, as a 32-bit fraction.
fn sobol_second(index: u32) -> u32 {
    let (mut v, mut bits, mut out) = (1u32 << 31, index, 0);
    while bits != 0 {
        if bits & 1 != 0 {
            out ^= v;
        }
        bits >>= 1;
        v ^= v >> 1;
    }
    out
}

/// Nested uniform scrambling of a 32-bit fraction: each digit is flipped by a hash of those above it.
fn owen_scramble(fraction: u32, seed: u32) -> u32 {
    let mut x = fraction.reverse_bits();
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// SplitMix64's mixing of two words.
fn hash(a: u64, b: u64) -> u64 {
    let mut z = a
        .wrapping_add(b.wrapping_mul(0x9e37_79b9_7f4a_7c15))
        .wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_two_fill_every_elementary_interval_once_also_when_scrambled() {
        for n in [16usize, 64, 256, 1024] {
            let pattern = Pattern::new(n, 7);
            let m = n.trailing_zeros();
            for scramble in [[0, 0], pattern.scramble(5), pattern.scramble(123_456)] {
                for kx in 0..=m {
                    let mut seen = vec![0; n];
                    for i in 0..n {
                        let digits = |axis: &[[u32; LANES]], k: usize| {
                            u64::from(axis[i / LANES][i % LANES] ^ scramble[k])
                        };
                        let x = (digits(&pattern.x, 0) >> (32 - kx)) as usize;
                        let y = (digits(&pattern.y, 1) >> (32 - (m - kx))) as usize;
                        seen[(x << (m - kx)) | y] += 1;
                    }
                    assert!(seen.iter().all(|&c| c == 1), "n {n}, 2^{kx} columns");
                }
            }
        }
    }

    #[test]
    fn refining_keeps_the_samples_that_were_there() {
        let sorted = |n| {
            let p = Pattern::new(n, 3);
            let (x, y) = (p.x.into_iter().flatten(), p.y.into_iter().flatten());
            let mut points: Vec<_> = x.zip(y).take(n).collect();
            points.sort_unstable();
            points
        };
        let (few, many) = (sorted(100), sorted(200));
        assert!(few.iter().all(|p| many.binary_search(p).is_ok()));
        let part = Pattern::part(100..200, 3);
        let (x, y) = (part.x.into_iter().flatten(), part.y.into_iter().flatten());
        let mut both: Vec<_> = x.zip(y).take(100).chain(few).collect();
        both.sort_unstable();
        assert_eq!(both, many);
    }

    #[test]
    fn sixteen_neighbours_of_256_samples_lie_in_one_sixteenth_of_the_light() {
        let p = Pattern::new(256, 1);
        for block in 0..16 {
            let corner = |i: usize| (p.x[block][i] >> 30, p.y[block][i] >> 30);
            assert!((0..16).all(|i| corner(i) == corner(0)));
        }
    }
}
