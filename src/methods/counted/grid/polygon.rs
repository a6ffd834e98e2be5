//! Which points of the square belong to a polygon in it.

use super::{Grid, Layout, NOWHERE, column};
use crate::simd::LANES;

impl Grid {
    /// Leaves no counts at points outside of a polygon, given by its corners in the square.
    pub(in crate::methods::counted) fn keep_within(&mut self, corners: &[[f32; 2]]) {
        let Layout { columns, fall, .. } = self.layout;
        let height = self.layout.height() as f32;
        let slope = fall as f32 / height;
        // A bit a column: whether a side of the polygon passes before it, counted twice as none.
        self.turns.resize(columns + 1, false);
        for r in 0..self.layout.rows {
            let (block, lane) = (r / LANES, r % LANES);
            let row = (r as f32 + self.offset) / height;
            let shift = self.shifts[block].0[lane];
            let above = |[s, t]: [f32; 2]| t + slope * s - row;
            self.turns.fill(false);
            let mut a = corners[corners.len() - 1];
            for &b in corners {
                let (from, to) = (above(a), above(b));
                if (from < 0.0) != (to < 0.0) {
                    let s = a[0] + (b[0] - a[0]) * (from / (from - to));
                    self.turns[column(s * columns as f32, shift, columns)] ^= true;
                }
                a = b;
            }
            let mut inside = false;
            let counts = &mut self.changes[block * (columns + 1)..][..columns];
            for (counts, turn) in counts.iter_mut().zip(&self.turns) {
                inside ^= turn;
                if !inside {
                    counts.0[lane] = NOWHERE;
                }
            }
        }
    }
}
