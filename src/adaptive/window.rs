//! Blocks of pixels with what is around them, over which windows grow.

use crate::receivers::BLOCK;

/// Most pixels from a window's middle to its side.
pub(super) const REACH: usize = 3;

/// Pixels of a block's side.
pub(super) const SIDE: usize = BLOCK as usize;

/// Pixels of a side of a block with what windows take in around it.
pub(super) const WIDE: usize = SIDE + 2 * REACH;

/// A table over a block of pixels and what windows take in around it.
pub(super) type Table<T> = [T; WIDE * WIDE];

/// The pixels from a place in a table on.
#[inline(always)]
pub(super) fn row<T>(table: &Table<T>, at: usize) -> &[T] {
    &table[at..at + SIDE]
}

/// Offsets of a window's pixels at this distance from its middle, half of them: the others are opposite. As
/// places in a table whose middle is at [`OFFSET`].
#[inline(always)]
pub(super) fn half_ring(reach: usize) -> impl Iterator<Item = usize> {
    (REACH - reach..REACH + reach)
        .flat_map(move |k| [k * WIDE + REACH + reach, (REACH - reach) * WIDE + k])
}

/// What offsets are counted from, so that they are not negative.
pub(super) const OFFSET: usize = REACH * WIDE + REACH;
