//! A grid over the light as one receiver sees it: which cells silhouette edges touch, and which of
//! the others are connected.

use crate::sampling::{GRID, grid_index};

/// A segment that rises by less than this, in cells, is drawn over its whole width in every row that it
/// touches: its slope would amplify rounding.
pub(super) const FLAT: f32 = 0.05;

/// A row of cells, a bit a column.
pub(super) type Cells = u32;

/// The image of an edge in the grid over the light, in cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EdgeImage {
    /// Ends.
    pub(super) ends: [[f32; 2]; 2],
    /// By how much the image may be off, in both directions.
    pub(super) thickness: f32,
}

/// Marks every cell within the line's thickness (in both directions) of it.
pub(super) fn draw(marked: &mut [Cells; GRID], line: &EdgeImage) {
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
        marked[r as usize] |= columns(low, high);
    }
}

/// Cells of a row from one column to another.
pub(super) fn columns(low: u32, high: u32) -> Cells {
    (Cells::MAX << low) & (Cells::MAX >> (GRID as u32 - 1 - high))
}

/// What is known about the cells.
///
/// Connected parts of the cells that no edge touches are found as in connected-component labelling
/// (Rosenfeld and Pfaltz 1966): by rows, each a few runs, joined to the runs of the row above that they
/// adjoin. A run is named by its first cell.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    /// Cells that an edge touches.
    marked: [Cells; GRID],
    /// First cells of the runs of each row.
    starts: [Cells; GRID],
    /// A run of the same part as each run, itself for the one that names the part.
    part: [u16; GRID * GRID],
    /// The segment that answers for each part, or [`NO_SEGMENT`].
    segments: [u32; GRID * GRID],
}

/// Marks a part that no segment answers for yet.
const NO_SEGMENT: u32 = u32::MAX;

impl Default for Grid {
    fn default() -> Self {
        Grid {
            marked: [0; GRID],
            starts: [0; GRID],
            part: [0; GRID * GRID],
            segments: [NO_SEGMENT; GRID * GRID],
        }
    }
}

impl Grid {
    /// Takes the cells that edges touch and finds the connected parts of the others; `disk`: the light is the
    /// disk in the square.
    ///
    /// Edges are only known where they can cross the light. So cells outside of a disk must not connect
    /// what is in it; the cells that it covers in part may, since it is convex.
    pub(super) fn connect(&mut self, marked: &[Cells; GRID], disk: bool) {
        let outside = if disk { &OUTSIDE_DISK } else { &[0; GRID] };
        let mut free_above = 0;
        for r in 0..GRID {
            self.marked[r] = marked[r] | outside[r];
            let free = !self.marked[r];
            self.starts[r] = free & !(free << 1);
            let mut left = free;
            while left != 0 {
                // Adding the run's first cell carries past its end.
                let first = left & left.wrapping_neg();
                let run = left & !left.wrapping_add(first);
                left &= !run;
                self.place(r, run, run & free_above);
            }
            free_above = free;
        }
    }

    /// Finds the part of a new run, given the free cells above it, and joins the parts that it adjoins.
    fn place(&mut self, row: usize, run: Cells, above: Cells) {
        let name = (row * GRID) as u16 + run.trailing_zeros() as u16;
        let mut adjoining = above & !(above << 1);
        if adjoining == 0 {
            self.part[usize::from(name)] = name;
            self.segments[usize::from(name)] = NO_SEGMENT;
            return;
        }
        let mut part = u16::MAX;
        while adjoining != 0 {
            let other = self.part_at(row - 1, adjoining.trailing_zeros() as usize);
            adjoining &= adjoining - 1;
            let (low, high) = (part.min(other), part.max(other));
            if high != u16::MAX {
                self.part[usize::from(high)] = low;
            }
            part = low;
        }
        self.part[usize::from(name)] = part;
    }

    /// The part that a free cell belongs to.
    fn part_at(&self, row: usize, column: usize) -> u16 {
        let up_to = Cells::MAX >> (GRID - 1 - column);
        let start = Cells::BITS - 1 - (self.starts[row] & up_to).leading_zeros();
        let mut run = (row * GRID) as u16 + start as u16;
        while self.part[usize::from(run)] != run {
            run = self.part[usize::from(run)];
        }
        run
    }

    /// The segment that answers for a sample in this cell: that of its part, if there is one already,
    /// else `new()`, which stands for the whole part unless the cell is marked.
    pub(super) fn segment(&mut self, cell: u16, new: impl FnOnce() -> u32) -> u32 {
        let (row, column) = (usize::from(cell) / GRID, usize::from(cell) % GRID);
        if self.marked[row] >> column & 1 == 1 {
            return new();
        }
        let part = usize::from(self.part_at(row, column));
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

    fn line(p: [f32; 2], q: [f32; 2]) -> EdgeImage {
        EdgeImage {
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
                let mut marked = [0; GRID];
                draw(&mut marked, &line(a, b));
                for step in 0..=1000 {
                    let t = step as f32 / 1000.0;
                    let (x, y) = (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]));
                    let (i, j) = (x.floor() as usize, y.floor() as usize);
                    if i < GRID && j < GRID {
                        assert!(marked[j] >> i & 1 == 1, "{a:?} {b:?} {i} {j}");
                    }
                }
                let cells: u32 = marked.iter().map(|r| r.count_ones()).sum();
                assert!(
                    cells <= 72,
                    "{a:?} {b:?}: {cells} cells for at most 63 that it crosses"
                );
            }
        }
    }

    #[test]
    fn a_line_across_the_light_leaves_two_parts() {
        let (mut grid, mut marked) = (Grid::default(), [0; GRID]);
        draw(&mut marked, &line([0.0, 16.7], [32.0, 17.5]));
        grid.connect(&marked, false);
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
        let mut marked = [Cells::MAX; GRID];
        let (mut x, mut y, mut dx, mut dy) = (0i32, 0i32, 1i32, 0i32);
        let free = |marked: &[Cells; GRID], x: i32, y: i32| {
            (0..32).contains(&x) && (0..32).contains(&y) && marked[y as usize] >> x & 1 == 0
        };
        let mut cells = Vec::new();
        for _ in 0..500 {
            marked[y as usize] &= !(1 << x);
            cells.push((y * 32 + x) as u16);
            let ahead = (x + 2 * dx, y + 2 * dy);
            let inside = (0..32).contains(&(x + dx)) && (0..32).contains(&(y + dy));
            if !inside || free(&marked, ahead.0, ahead.1) {
                (dx, dy) = (-dy, dx);
                if free(&marked, x + 2 * dx, y + 2 * dy) {
                    break;
                }
            }
            (x, y) = (x + dx, y + dy);
        }
        assert!(cells.len() > 400);
        let mut grid = Grid::default();
        grid.connect(&marked, false);
        assert!(
            cells
                .iter()
                .all(|&c| grid.segment(c, || c.into()) == u32::from(cells[0]))
        );
    }
}
