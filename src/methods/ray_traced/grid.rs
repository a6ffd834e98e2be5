//! A grid over the light as one receiver sees it: which cells silhouette edges touch, and which of
//! the others are connected.

use super::project::Line;
use crate::sampling::GRID;

/// A segment that rises by less than this, in cells, is drawn over its whole width in every row that it
/// touches: its slope would amplify rounding.
pub(super) const FLAT: f32 = 0.05;

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

    /// Marks every cell within the line's thickness (in both directions) of it.
    pub(super) fn mark(&mut self, line: &Line) {
        let [p, q] = line.ends;
        let thickness = line.thickness;
        let (p, q) = if p[1] <= q[1] { (p, q) } else { (q, p) };
        let rise = q[1] - p[1];
        // Truncation rounds down where nothing is negative.
        let row = |y: f32| y.clamp(0.0, (GRID - 1) as f32) as i32;
        let (first, last) = (row(p[1] - thickness), row(q[1] + thickness));
        let steep = rise > FLAT && first != last;
        let per_row = if steep { 1.0 / rise } else { 0.0 };
        for r in first..=last {
            let (mut x0, mut x1) = (p[0], q[0]);
            if steep {
                let along = |y: f32| p[0] + (q[0] - p[0]) * ((y - p[1]) * per_row).clamp(0.0, 1.0);
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
/// Upwards, adding the seeds to the free bits carries from the lowest seed of a run to the run's end: what
/// the carry turned over, and the other seeds, is filled. Downwards, by doubling steps (Kogge and Stone
/// 1973): cheaper than mirroring the words for another carry.
fn run(seeds: Cells, free: Cells) -> Cells {
    let mut filled = (free.wrapping_add(seeds) ^ free) & free | seeds;
    let mut open = free;
    for step in [1, 2, 4, 8, 16] {
        filled |= open & (filled >> step);
        open &= open >> step;
    }
    filled
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(p: [f32; 2], q: [f32; 2]) -> Line {
        Line {
            ends: [p, q],
            thickness: 0.01,
        }
    }

    #[test]
    fn every_cell_that_a_line_passes_through_is_marked_and_few_others() {
        let ends = [
            [3.2, 6.4],
            [28.8, 22.4],
            [16.0, 0.0],
            [0.0, 16.1],
            [9.6, 9.6],
            [32.0, 31.9],
        ];
        for a in ends {
            for b in ends {
                let mut grid = Grid::default();
                grid.mark(&line(a, b));
                for step in 0..=1000 {
                    let t = step as f32 / 1000.0;
                    let (x, y) = (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]));
                    let (i, j) = (x.floor() as usize, y.floor() as usize);
                    if i < GRID && j < GRID {
                        assert!(grid.marked[j] >> i & 1 == 1, "{a:?} {b:?} {i} {j}");
                    }
                }
                let cells: u32 = grid.marked.iter().map(|r| r.count_ones()).sum();
                assert!(
                    cells <= 72,
                    "{a:?} {b:?}: {cells} cells for at most 63 that it crosses"
                );
            }
        }
    }

    #[test]
    fn a_line_across_the_light_leaves_two_parts() {
        let mut grid = Grid::default();
        grid.mark(&line([0.0, 16.7], [32.0, 17.5]));
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
