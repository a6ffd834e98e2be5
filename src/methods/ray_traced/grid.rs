//! A grid over the light as one receiver sees it: which cells silhouette edges touch, and which of
//! the others are connected.

use super::project::Line;
use crate::sampling::{GRID, grid_index};

/// A segment that rises by less than this, in cells, is drawn over its whole width in every row that it
/// touches: its slope would amplify rounding.
pub(super) const FLAT: f32 = 0.05;

/// A row of cells, a bit a column.
type Cells = u32;

/// Most runs of free cells in a grid: every other cell of every row.
const RUNS: usize = GRID * GRID / 2;

/// What is known about the cells.
///
/// Connected parts of the cells that no edge touches are found as in connected-component labelling
/// (Rosenfeld and Pfaltz 1966): by rows, each a few runs, joined to the runs of the row above that they
/// adjoin.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    /// Cells that an edge touches.
    marked: [Cells; GRID],
    /// First cells of the runs of each row, and the number of runs in the rows before.
    starts: [Cells; GRID],
    before: [u16; GRID],
    /// The part that each run belongs to, named by one of its runs.
    part: [u16; RUNS],
    /// The segment that answers for each part, or [`NO_SEGMENT`].
    segments: [u32; RUNS],
}

/// Marks a part that no segment answers for yet.
const NO_SEGMENT: u32 = u32::MAX;

impl Default for Grid {
    fn default() -> Self {
        Grid {
            marked: [0; GRID],
            starts: [0; GRID],
            before: [0; GRID],
            part: [0; RUNS],
            segments: [NO_SEGMENT; RUNS],
        }
    }
}

impl Grid {
    /// Forgets everything; `disk`: the light is the disk in the square.
    ///
    /// Edges are only known where they can cross the light. So cells outside of a disk must not connect
    /// what is in it; the cells that it covers in part may, since it is convex.
    pub(super) fn clear(&mut self, disk: bool) {
        self.marked = if disk { OUTSIDE_DISK } else { [0; GRID] };
    }

    /// Marks every cell within the line's thickness (in both directions) of it.
    pub(super) fn mark(&mut self, line: &Line) {
        let [p, q] = line.ends;
        let thickness = line.thickness;
        let (p, q) = if p[1] <= q[1] { (p, q) } else { (q, p) };
        let rise = q[1] - p[1];
        let (first, last) = (grid_index(p[1] - thickness), grid_index(q[1] + thickness));
        let steep = rise > FLAT && first != last;
        let per_row = if steep { 1.0 / rise } else { 0.0 };
        for r in first..=last {
            let (mut x0, mut x1) = (p[0], q[0]);
            if steep {
                let along = |y: f32| p[0] + (q[0] - p[0]) * ((y - p[1]) * per_row).clamp(0.0, 1.0);
                x0 = along(r as f32 - thickness);
                x1 = along(r as f32 + 1.0 + thickness);
            }
            let low = grid_index(x0.min(x1) - thickness);
            let high = grid_index(x0.max(x1) + thickness);
            self.marked[r as usize] |=
                (Cells::MAX << low) & (Cells::MAX >> (GRID as u32 - 1 - high));
        }
    }

    /// Finds the connected parts, once all lines are marked.
    pub(super) fn connect(&mut self) {
        let mut runs = 0u16;
        for r in 0..GRID {
            let free = !self.marked[r];
            self.starts[r] = free & !(free << 1);
            self.before[r] = runs;
            let mut left = free;
            while left != 0 {
                // Adding the run's first cell carries past its end.
                let first = left & left.wrapping_neg();
                let run = left & !left.wrapping_add(first);
                left &= !run;
                self.part[usize::from(runs)] = runs;
                self.segments[usize::from(runs)] = NO_SEGMENT;
                let above = if r > 0 { run & !self.marked[r - 1] } else { 0 };
                let mut adjoining = above & !(above << 1);
                while adjoining != 0 {
                    let other = self.run_at(r - 1, adjoining.trailing_zeros() as usize);
                    self.join(other, runs);
                    adjoining &= adjoining - 1;
                }
                runs += 1;
            }
        }
        // A run's part is named by an earlier run, so one pass in order names all by their first.
        for run in 0..usize::from(runs) {
            self.part[run] = self.part[usize::from(self.part[run])];
        }
    }

    /// Number of the run that a free cell lies in.
    fn run_at(&self, row: usize, column: usize) -> u16 {
        let up_to = Cells::MAX >> (GRID - 1 - column);
        self.before[row] + (self.starts[row] & up_to).count_ones() as u16 - 1
    }

    fn first_of(&self, mut run: u16) -> u16 {
        while self.part[usize::from(run)] != run {
            run = self.part[usize::from(run)];
        }
        run
    }

    fn join(&mut self, a: u16, b: u16) {
        let (a, b) = (self.first_of(a), self.first_of(b));
        self.part[usize::from(a.max(b))] = a.min(b);
    }

    /// The segment that answers for a sample in this cell: that of its part, if there is one already,
    /// else `new()`, which stands for the whole part unless the cell is marked.
    pub(super) fn segment(&mut self, cell: u16, new: impl FnOnce() -> u32) -> u32 {
        let (row, column) = (usize::from(cell) / GRID, usize::from(cell) % GRID);
        if self.marked[row] >> column & 1 == 1 {
            return new();
        }
        let part = usize::from(self.part[usize::from(self.run_at(row, column))]);
        if self.segments[part] == NO_SEGMENT {
            self.segments[part] = new();
        }
        self.segments[part]
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
        grid.connect();
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
        grid.connect();
        assert!(
            cells
                .iter()
                .all(|&c| grid.segment(c, || c.into()) == u32::from(cells[0]))
        );
    }
}
