//! Which pixels around each lie on its surface: what windows may take in.

use glam::DVec3;

use super::surface::is_one;
use super::window::{OFFSET, REACH, SIDE, Table, WIDE, half_ring, row};
use crate::raster::nearest::NONE;
use crate::receivers::Receivers;

/// Of an entry that no receiver lies on.
const NOTHING: u32 = NONE - 1;

/// The surfaces that a block of pixels and what is around it lie on.
pub(super) struct Surface {
    /// Whether all pixels lie on one triangle.
    flat: bool,
    entry: Table<u32>,
    position: [Table<f32>; 3],
    normal: [Table<f32>; 3],
    /// Which pairs of opposite neighbours lie on the surface of each of the block's pixels, a bit a pair.
    pub(super) pairs: [u32; SIDE * SIDE],
}

impl Default for Surface {
    fn default() -> Self {
        Surface {
            flat: false,
            entry: [NOTHING; WIDE * WIDE],
            position: [[0.0; WIDE * WIDE]; 3],
            normal: [[0.0; WIDE * WIDE]; 3],
            pairs: [0; SIDE * SIDE],
        }
    }
}

impl Surface {
    /// Takes a block and what is around it; `at`: the receiver of each of these pixels.
    pub(super) fn set(
        &mut self,
        r: &Receivers,
        entries: &[u32],
        at: impl Fn(usize, usize) -> Option<usize>,
    ) {
        let mut origin: Option<DVec3> = None;
        let mut face = None;
        self.flat = true;
        for y in 0..WIDE {
            for x in 0..WIDE {
                let place = y * WIDE + x;
                let Some(i) = at(x, y) else {
                    self.flat = false;
                    self.entry[place] = NOTHING;
                    continue;
                };
                let its = r.faces[i];
                self.flat &= its == *face.get_or_insert(its) && its != NONE;
                self.entry[place] = entries[i];
                let p = r.positions[i] - *origin.get_or_insert(r.positions[i]);
                for k in 0..3 {
                    self.position[k][place] = p[k] as f32;
                    self.normal[k][place] = r.normals[i][k] as f32;
                }
            }
        }
    }

    /// Finds the pairs of the block's pixels.
    #[inline(always)]
    pub(super) fn find(&mut self) {
        if self.flat {
            self.pairs = [u32::MAX; SIDE * SIDE];
            return;
        }
        for y in 0..SIDE {
            let middle = (y + REACH) * WIDE + REACH;
            let mut pairs = [0; SIDE];
            let rings = (1..=REACH).flat_map(half_ring);
            for (bit, away) in rings.enumerate() {
                let mut alike = [1 << bit; SIDE];
                self.keep_alike(middle, middle + away - OFFSET, &mut alike);
                self.keep_alike(middle, middle + OFFSET - away, &mut alike);
                for x in 0..SIDE {
                    pairs[x] |= alike[x];
                }
            }
            self.pairs[y * SIDE..(y + 1) * SIDE].copy_from_slice(&pairs);
        }
    }

    /// Leaves `alike` as it is where pixels from `middle` and from `other` on lie on one surface, and makes it 0
    /// elsewhere.
    #[inline(always)]
    fn keep_alike(&self, middle: usize, other: usize, alike: &mut [u32; SIDE]) {
        let (entry, others) = (row(&self.entry, middle), row(&self.entry, other));
        let (mut turned, mut across) = ([0.0; SIDE], [0.0; SIDE]);
        let mut squared = [0.0; SIDE];
        for k in 0..3 {
            let (n, m) = (row(&self.normal[k], middle), row(&self.normal[k], other));
            let (p, q) = (
                row(&self.position[k], middle),
                row(&self.position[k], other),
            );
            for x in 0..SIDE {
                let d = q[x] - p[x];
                turned[x] += n[x] * m[x];
                across[x] += n[x] * d;
                squared[x] += d * d;
            }
        }
        for x in 0..SIDE {
            let one = (entry[x] == others[x]) & is_one(turned[x], across[x], squared[x]);
            alike[x] = if one { alike[x] } else { 0 };
        }
    }
}
