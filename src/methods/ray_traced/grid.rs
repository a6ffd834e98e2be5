//! A grid over the light as one receiver sees it: which cells silhouette edges touch, and which of
//! the others are connected.

use glam::Vec3;

use crate::sampling::{GRID, View};

/// How far, in cells, an edge's image is thickened at least: the rounding of a clipped and projected
/// segment is below 0.005 cells (positions 1e-6 of the grid's 32 cells, slopes up to 32 / [`FLAT`]), and
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

/// A row of cells, a bit a column.
type Cells = u32;

/// What is known about the cells.
#[derive(Debug, Clone, Default)]
pub(super) struct Grid {
    /// Cells that an edge touches.
    marked: [Cells; GRID],
    /// Connected parts of the others that were asked for, and the segment that answers for each. A
    /// receiver seldom sees more than three, so a list is searched faster than cells are labelled.
    parts: Vec<([Cells; GRID], u32)>,
}

impl Grid {
    /// Forgets everything; `disk`: the light is the disk in the square.
    ///
    /// Edges are only known where they can cross the light. So cells outside of a disk must not connect
    /// what is in it; the cells that it covers in part may, since it is convex.
    pub(super) fn clear(&mut self, disk: bool) {
        self.marked = if disk { OUTSIDE_DISK } else { [0; GRID] };
        self.parts.clear();
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
        // Truncation rounds down where nothing is negative.
        let row = |y: f32| y.clamp(0.0, (GRID - 1) as f32) as i32;
        for r in row(p.1 - thickness)..=row(q.1 + thickness) {
            let (mut x0, mut x1) = (p.0, q.0);
            if rise > FLAT {
                let along = |y: f32| p.0 + (q.0 - p.0) * ((y - p.1) / rise).clamp(0.0, 1.0);
                x0 = along(r as f32 - thickness);
                x1 = along(r as f32 + 1.0 + thickness);
            }
            let (low, high) = (row(x0.min(x1) - thickness), row(x0.max(x1) + thickness));
            self.marked[r as usize] |=
                (Cells::MAX << low) & (Cells::MAX >> (GRID as i32 - 1 - high));
        }
    }

    /// The segment that answers for a sample in this cell: that of its part, if there is one already,
    /// else `new()`, which stands for the whole part unless the cell is marked.
    pub(super) fn segment(&mut self, cell: u16, new: impl FnOnce() -> u32) -> u32 {
        let (row, column) = (usize::from(cell) / GRID, usize::from(cell) % GRID);
        let holds = |rows: &[Cells; GRID]| rows[row] >> column & 1 == 1;
        if holds(&self.marked) {
            return new();
        }
        if let Some((_, segment)) = self.parts.iter().find(|(rows, _)| holds(rows)) {
            return *segment;
        }
        let segment = new();
        self.parts.push((self.flood(row, column), segment));
        segment
    }

    /// All unmarked cells that are connected to one of them (through sides).
    fn flood(&self, row: usize, column: usize) -> [Cells; GRID] {
        let mut rows: [Cells; GRID] = [0; GRID];
        rows[row] = run(1 << column, !self.marked[row]);
        // Sweeps down and up, each row filled from its neighbours, until nothing changes.
        loop {
            let mut changed = false;
            let mut fill = |r: usize| {
                let above = if r > 0 { rows[r - 1] } else { 0 };
                let below = if r + 1 < GRID { rows[r + 1] } else { 0 };
                let free = !self.marked[r];
                let seeds = (rows[r] | above | below) & free;
                if seeds != rows[r] {
                    (changed, rows[r]) = (true, run(seeds, free));
                }
            };
            for r in row..GRID {
                fill(r);
            }
            for r in (0..GRID).rev() {
                fill(r);
            }
            if !changed {
                return rows;
            }
        }
    }
}

/// The cells that the square's inscribed disk does not reach.
const OUTSIDE_DISK: [Cells; GRID] = {
    let half = GRID as i32 / 2;
    let mut rows = [0; GRID];
    let mut cell = 0;
    while cell < GRID * GRID {
        let (r, c) = (cell / GRID, cell % GRID);
        // The cell's corner nearest to the middle, in cells from there.
        let (x, y) = (c as i32 - half, r as i32 - half);
        let x = if x < 0 { -1 - x } else { x };
        let y = if y < 0 { -1 - y } else { y };
        if x * x + y * y >= half * half {
            rows[r] |= 1 << c;
        }
        cell += 1;
    }
    rows
};

/// All bits of `free` that adjoin `seeds` (bits of `free`) without a gap.
///
/// Adding the seeds to the free bits carries from the lowest seed of a run to the run's end: what the
/// carry turned over, and the other seeds, is filled; the same mirrored for the other direction.
fn run(seeds: Cells, free: Cells) -> Cells {
    let up = |seeds: Cells, free: Cells| (free.wrapping_add(seeds) ^ free) & free | seeds;
    let filled = up(seeds, free);
    up(filled.reverse_bits(), free.reverse_bits()).reverse_bits()
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
        View {
            u: Vec3::X,
            v: Vec3::Y,
            w: Vec3::Z,
        }
    }

    fn edge(a: [f32; 3], b: [f32; 3]) -> SeenEdge {
        SeenEdge {
            view: view(),
            ends: [a.into(), b.into()],
        }
    }

    #[test]
    fn every_cell_that_an_edge_passes_through_is_marked() {
        let ends = [
            [0.1, 0.2],
            [0.9, 0.7],
            [0.5, -0.4],
            [-2.0, 0.503],
            [0.3, 0.3],
            [1.7, 1.1],
        ];
        for a in ends {
            for b in ends {
                let mut grid = Grid::default();
                // At half and at 0.8 of the distance: the image is where the ends point to.
                assert!(grid.mark(edge(
                    [a[0] * 0.5, a[1] * 0.5, 0.5],
                    [b[0] * 0.8, b[1] * 0.8, 0.8]
                )));
                for step in 0..=1000 {
                    let t = step as f32 / 1000.0;
                    let (x, y) = (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]));
                    let size = GRID as f32;
                    let (i, j) = ((x * size).floor() as i32, (y * size).floor() as i32);
                    if (0..32).contains(&i) && (0..32).contains(&j) {
                        assert!(grid.marked[j as usize] >> i & 1 == 1, "{a:?} {b:?} {i} {j}");
                    }
                }
                let cells: u32 = grid.marked.iter().map(|r| r.count_ones()).sum();
                assert!(
                    cells <= 96,
                    "{a:?} {b:?}: {cells} cells for at most 63 that it crosses"
                );
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
        let mut next = 0;
        let mut ask = |cell: u16| {
            grid.segment(cell, || {
                next += 1;
                next - 1
            })
        };
        let line = 16 * GRID as u16;
        let answers = [0, 31, 33, 1023, 1000, line, line].map(&mut ask);
        assert_eq!(answers, [0, 0, 0, 1, 1, 2, 3]);
    }

    #[test]
    fn runs_fill_up_and_down_to_the_next_gap() {
        assert_eq!(run(0b0000_0100, 0b1110_1110), 0b0000_1110);
        assert_eq!(run(0b0100_0100, 0b1110_1110), 0b1110_1110);
        assert_eq!(run(1 << 31, !0), !0);
        assert_eq!(run(0b101, 0b111), 0b111);
        assert_eq!(run(0, !0), 0);
    }

    #[test]
    fn a_part_that_winds_is_found_whole() {
        // A spiral of free cells, one wide: every free cell must end up in the part of the first.
        let mut grid = Grid {
            marked: [Cells::MAX; GRID],
            ..Grid::default()
        };
        let (mut x, mut y, mut dx, mut dy) = (0i32, 0i32, 1i32, 0i32);
        let free = |grid: &Grid, x: i32, y: i32| {
            (0..32).contains(&x) && (0..32).contains(&y) && grid.marked[y as usize] >> x & 1 == 0
        };
        let mut cells = Vec::new();
        for _ in 0..500 {
            grid.marked[y as usize] &= !(1 << x);
            cells.push((y * 32 + x) as u16);
            let ahead = (x + 2 * dx, y + 2 * dy);
            let inside = (0..32).contains(&(x + dx)) && (0..32).contains(&(y + dy));
            if !inside || free(&grid, ahead.0, ahead.1) {
                (dx, dy) = (-dy, dx);
                if free(&grid, x + 2 * dx, y + 2 * dy) {
                    break;
                }
            }
            (x, y) = (x + dx, y + dy);
        }
        assert!(cells.len() > 400);
        assert!(
            cells
                .iter()
                .all(|&c| grid.segment(c, || c.into()) == u32::from(cells[0]))
        );
    }
}
