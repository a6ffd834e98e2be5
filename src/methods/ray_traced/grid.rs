//! A grid over the light as one receiver sees it: which cells silhouette edges touch, and which of
//! the others are connected.

use glam::Vec3;

use crate::sampling::{GRID, View};

/// How far, in cells, an edge's image is thickened at least: the rounding of a clipped and projected
/// segment is below 0.005 cells (positions 1e-6 of the grid's 16 cells, slopes up to 16 / [`FLAT`]), and
/// a sample's cell is known to 1e-5 cells.
const THICKNESS: f32 = 0.01;

/// A segment that rises by less than this, in cells, is drawn over its whole width in every row that it
/// touches: its slope would amplify rounding.
const FLAT: f32 = 0.05;

/// An edge of which more than this many cells are in doubt is not drawn; the receiver gives up.
const WIDEST: f32 = 4.0;

/// An edge as a receiver sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct SeenEdge {
    /// How the receiver sees the light.
    pub(super) view: View,
    /// Ends, from the receiver.
    pub(super) ends: [Vec3; 2],
}

/// What is known about the 16×16 cells.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    /// Cells that an edge touches, a bit a column.
    marked: [u16; GRID],
    /// Part that each cell belongs to, [`NO_PART`] before it is asked for.
    part: [u8; GRID * GRID],
    /// Transmittance of each part, once its segment was traced.
    through: Vec<Option<f32>>,
}

const NO_PART: u8 = u8::MAX;

impl Default for Grid {
    fn default() -> Self {
        Grid { marked: [0; GRID], part: [NO_PART; GRID * GRID], through: Vec::new() }
    }
}

impl Grid {
    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.marked = [0; GRID];
        self.part = [NO_PART; GRID * GRID];
        self.through.clear();
    }

    /// Marks the cells that the edge's image may touch. False: it cannot be said which, because the
    /// edge comes too close to the receiver.
    pub(super) fn mark(&mut self, edge: SeenEdge) -> bool {
        let View { u, v, w } = edge.view;
        let [a, b] = edge.ends;
        let steepness = l1(u).max(l1(v)).max(l1(w));
        // Rounding of three products and their sum, and of the ends and rows themselves: below 8
        // rounding errors (2⁻²⁴).
        let doubt = 8.0 / (1 << 24) as f32 * steepness * l1(a).max(l1(b));
        let at = |p: Vec3| (u.dot(p), v.dot(p), w.dot(p));
        let ((ua, va, wa), (ub, vb, wb)) = (at(a), at(b));
        let (mut start, mut end) = (0.0f32, 1.0f32);
        for (fa, fb) in [(ua, ub), (va, vb), (wa - ua, wb - ub), (wa - va, wb - vb)] {
            let (fa, fb) = (fa + 2.0 * doubt, fb + 2.0 * doubt);
            if fa < 0.0 && fb < 0.0 {
                return true;
            }
            if fa < 0.0 {
                start = start.max(fa / (fa - fb) - 1e-6);
            } else if fb < 0.0 {
                end = end.min(fa / (fa - fb) + 1e-6);
            }
        }
        if start > end {
            return true;
        }
        let point = |t: f32| {
            let w = wa + t * (wb - wa);
            (ua + t * (ub - ua), va + t * (vb - va), w)
        };
        let (p, q) = (point(start), point(end));
        let nearest = p.2.min(q.2);
        let size = GRID as f32;
        let thickness = THICKNESS + 4.0 * size * doubt / nearest;
        if nearest <= 0.0 || thickness.is_nan() || thickness > WIDEST {
            return false;
        }
        let cell = |p: (f32, f32, f32)| (size * p.0 / p.2, size * p.1 / p.2);
        self.draw(cell(p), cell(q), thickness);
        true
    }

    /// Marks every cell within `thickness` (in both directions) of the segment from `p` to `q`.
    fn draw(&mut self, p: (f32, f32), q: (f32, f32), thickness: f32) {
        let (p, q) = if p.1 <= q.1 { (p, q) } else { (q, p) };
        let rise = q.1 - p.1;
        let row = |y: f32| (y.floor() as i32).clamp(0, GRID as i32 - 1);
        for r in row(p.1 - thickness)..=row(q.1 + thickness) {
            let (mut x0, mut x1) = (p.0, q.0);
            if rise > FLAT {
                let along = |y: f32| p.0 + (q.0 - p.0) * ((y - p.1) / rise).clamp(0.0, 1.0);
                x0 = along(r as f32 - thickness);
                x1 = along(r as f32 + 1.0 + thickness);
            }
            let (low, high) = (row(x0.min(x1) - thickness), row(x0.max(x1) + thickness));
            self.marked[r as usize] |= (u16::MAX << low) & (u16::MAX >> (GRID as i32 - 1 - high));
        }
    }

    /// Whether a sample in this cell must be traced: the cell is marked, or it is the first sample in
    /// its part.
    pub(super) fn claim(&mut self, cell: u8) -> bool {
        let cell = usize::from(cell);
        if self.marked[cell / GRID] >> (cell % GRID) & 1 == 1 {
            return true;
        }
        if self.part[cell] != NO_PART {
            return false;
        }
        let part = self.through.len() as u8;
        self.through.push(None);
        self.flood(cell, part);
        true
    }

    /// Tells what a traced sample in this cell has found.
    pub(super) fn learn(&mut self, cell: u8, through: f32) {
        let part = self.part[usize::from(cell)];
        if part != NO_PART {
            self.through[usize::from(part)].get_or_insert(through);
        }
    }

    /// What is known of this cell's part.
    pub(super) fn known(&self, cell: u8) -> Option<f32> {
        let part = self.part[usize::from(cell)];
        self.through.get(usize::from(part)).copied().flatten()
    }

    /// Gives all unmarked cells that are connected to `seed` (through sides) the number `part`.
    ///
    /// There are at most 128 such parts, in a checkerboard, so a byte holds their number.
    fn flood(&mut self, seed: usize, part: u8) {
        let mut rows = [0u16; GRID];
        rows[seed / GRID] = 1 << (seed % GRID);
        let mut changed = true;
        let mut down = true;
        while changed {
            changed = false;
            for step in 0..GRID {
                let r = if down { step } else { GRID - 1 - step };
                let above = if r > 0 { rows[r - 1] } else { 0 };
                let below = if r + 1 < GRID { rows[r + 1] } else { 0 };
                let free = !self.marked[r];
                let mut cells = (rows[r] | above | below) & free;
                loop {
                    let wider = (cells | cells << 1 | cells >> 1) & free;
                    if wider == cells {
                        break;
                    }
                    cells = wider;
                }
                changed |= cells != rows[r];
                rows[r] = cells;
            }
            down = !down;
        }
        for (r, &cells) in rows.iter().enumerate() {
            for c in super::bits(cells) {
                self.part[r * GRID + c] = part;
            }
        }
    }
}

fn l1(v: Vec3) -> f32 {
    let a = v.abs();
    a.x + a.y + a.z
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The receiver sees the light as the unit square at distance 1 along z.
    fn view() -> View {
        View { u: Vec3::X, v: Vec3::Y, w: Vec3::Z }
    }

    fn edge(a: [f32; 3], b: [f32; 3]) -> SeenEdge {
        SeenEdge { view: view(), ends: [a.into(), b.into()] }
    }

    #[test]
    fn every_cell_that_an_edge_passes_through_is_marked() {
        let ends = [[0.1, 0.2], [0.9, 0.7], [0.5, -0.4], [-2.0, 0.503], [0.3, 0.3], [1.7, 1.1]];
        for a in ends {
            for b in ends {
                let mut grid = Grid::default();
                // At half and at 0.8 of the distance: the image is where the ends point to.
                assert!(grid.mark(edge([a[0] * 0.5, a[1] * 0.5, 0.5], [b[0] * 0.8, b[1] * 0.8, 0.8])));
                for step in 0..=1000 {
                    let t = step as f32 / 1000.0;
                    let (x, y) = (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]));
                    let (i, j) = ((x * 16.0).floor() as i32, (y * 16.0).floor() as i32);
                    if (0..16).contains(&i) && (0..16).contains(&j) {
                        assert!(grid.marked[j as usize] >> i & 1 == 1, "{a:?} {b:?} {i} {j}");
                    }
                }
                let cells: u32 = grid.marked.iter().map(|r| r.count_ones()).sum();
                assert!(cells <= 48, "{a:?} {b:?}: {cells} cells for at most 31 that it crosses");
            }
        }
    }

    #[test]
    fn an_edge_through_the_receiver_gives_up_and_one_behind_it_marks_nothing() {
        let mut grid = Grid::default();
        assert!(!grid.mark(edge([0.0, 0.0, 0.0], [0.3, 0.3, 0.5])));
        assert!(grid.mark(edge([0.0, 0.1, -0.5], [0.3, 0.3, -0.2])));
        assert_eq!(grid.marked, [0; GRID]);
    }

    #[test]
    fn a_line_across_the_light_leaves_two_parts() {
        let mut grid = Grid::default();
        assert!(grid.mark(edge([-0.1, 0.52, 1.0], [1.1, 0.55, 1.0])));
        let first = grid.claim(0);
        let same = grid.claim(15);
        let across = grid.claim(255);
        let on_line = (grid.claim(8 * 16), grid.claim(8 * 16));
        assert_eq!((first, same, across, on_line), (true, false, true, (true, true)));
        grid.learn(0, 1.0);
        grid.learn(255, 0.0);
        assert_eq!((grid.known(17), grid.known(254), grid.known(8 * 16)), (Some(1.0), Some(0.0), None));
    }
}
