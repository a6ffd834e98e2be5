//! Which receivers of a group are asked where an error is allowed, and what the others have from them.
//!
//! A group's pixels are a cell. Where all of a cell's pixels lie on one surface, its corners, the middles of its
//! sides and its own middle are asked; if all that is known in it is what its corners let expect, the rest is
//! interpolated. Otherwise it is cut into four that share their sides.
//!
//! **Thin shadows** would pass between such places where they run along rows or columns of pixels. So where there
//! are edges, some pixels more are asked, one at least in every row and column of the cell. Where there are none
//! before the light, what is seen can hardly change, and corners and the middle do.
//!
//! What is interpolated is the part that is left of the light: what there is without casters is exact for every pixel.

use super::Answer;
use crate::adaptive::surface::is_one;
use crate::receivers::{BLOCK, Receivers};

/// Pixels of a group's side.
const SIDE: usize = BLOCK as usize;

/// What pixels that show nothing have instead of a receiver's number.
const NOBODY: u8 = u8::MAX;

/// First and last column and row of some pixels.
type Cell = [[usize; 2]; 2];

/// One receiver of a group.
#[derive(Debug, Clone, Copy, Default)]
struct Place {
    /// Its number among all receivers.
    i: usize,
    /// Visibility and irradiance without casters, and the part of them that is left.
    unshadowed: [f32; 2],
    left: [f32; 2],
    known: bool,
    settled: bool,
}

/// The cells of a group.
#[derive(Debug, Default)]
pub(super) struct Cells {
    places: Vec<Place>,
    /// The receiver of each pixel.
    pixels: Vec<u8>,
    /// Whether any edge is before the light.
    edges: bool,
    /// Cells of one surface whose receivers have been asked, and those that are to be cut.
    asked: Vec<Cell>,
    open: Vec<Cell>,
}

impl Cells {
    /// Takes the receivers `ids` of a camera with so many columns of pixels.
    pub(super) fn start(
        &mut self,
        receivers: &Receivers,
        ids: &[usize],
        columns: usize,
        unshadowed: &[[f32; 2]],
        edges: bool,
    ) {
        self.edges = edges;
        self.places.clear();
        self.pixels.clear();
        self.pixels.resize(SIDE * SIDE, NOBODY);
        self.asked.clear();
        self.open.clear();
        let mut last = [0, 0];
        for (k, (&i, &unshadowed)) in ids.iter().zip(unshadowed).enumerate() {
            let pixel = receivers.index[i] as usize;
            let at = [pixel % columns % SIDE, pixel / columns % SIDE];
            self.pixels[at[1] * SIDE + at[0]] = k as u8;
            last = [0, 1].map(|axis| at[axis].max(last[axis]));
            self.places.push(Place {
                i,
                unshadowed,
                ..Place::default()
            });
        }
        self.open.push(last.map(|last| [0, last]));
    }

    /// Settles what can be settled within a tolerance of visibility, and puts into `wanted` the numbers in the group
    /// of those receivers that are to be asked next, if any.
    pub(super) fn next(
        &mut self,
        receivers: &Receivers,
        entries: &[u32],
        tolerance: f32,
        wanted: &mut Vec<usize>,
    ) {
        wanted.clear();
        while let Some(cell) = self.asked.pop() {
            if !self.settle(cell, tolerance) {
                self.cut(cell);
            }
        }
        while let Some(cell) = self.open.pop() {
            if cell.iter().all(|[first, last]| last - first <= 2) {
                self.ask_all(cell, wanted);
            } else if self.is_one_surface(cell, receivers, entries) {
                self.ask(cell, wanted);
                self.asked.push(cell);
            } else {
                self.cut(cell);
            }
        }
    }

    /// Takes what was found for the group's receiver `k`.
    pub(super) fn set(&mut self, k: usize, answer: &Answer) {
        let place = &mut self.places[k];
        for i in 0..2 {
            let part = answer.sums[i] / place.unshadowed[i];
            // Samples of rays may find more than there is. Light at the horizon may be none at all.
            place.left[i] = if part.is_finite() { part.min(1.0) } else { 0.0 };
        }
    }

    /// What receiver `k` has from others; `None` if it was asked itself.
    pub(super) fn interpolated(&self, k: usize) -> Option<[f32; 2]> {
        let place = &self.places[k];
        (!place.known).then(|| [0, 1].map(|i| place.unshadowed[i] * place.left[i]))
    }

    fn place(&self, x: usize, y: usize) -> Option<usize> {
        let k = self.pixels[y * SIDE + x];
        (k != NOBODY).then_some(usize::from(k))
    }

    /// Whether all pixels of a cell lie on the surface that its middle lies on, and on the same side of a horizon that
    /// hides all of the light.
    fn is_one_surface(&self, cell: Cell, receivers: &Receivers, entries: &[u32]) -> bool {
        let [x, y] = cell.map(middle);
        let Some(of) = self.place(x, y) else {
            return false;
        };
        let of = &self.places[of];
        let (p, n) = (receivers.positions[of.i], receivers.normals[of.i]);
        pixels(cell).all(|[x, y]| {
            self.place(x, y).is_some_and(|k| {
                let other = &self.places[k];
                let i = other.i;
                let (d, turned) = (receivers.positions[i] - p, receivers.normals[i].dot(n));
                let (across, squared) = (d.dot(n) as f32, d.length_squared() as f32);
                entries[i] == entries[of.i]
                    && is_one(turned as f32, across, squared)
                    && (other.unshadowed[0] > 0.0) == (of.unshadowed[0] > 0.0)
            })
        })
    }

    fn ask_one(&mut self, [x, y]: [usize; 2], wanted: &mut Vec<usize>) {
        if let Some(k) = self.place(x, y)
            && !self.places[k].known
        {
            self.places[k].known = true;
            wanted.push(k);
        }
    }

    fn ask_all(&mut self, cell: Cell, wanted: &mut Vec<usize>) {
        for at in pixels(cell) {
            self.ask_one(at, wanted);
        }
    }

    fn ask(&mut self, cell: Cell, wanted: &mut Vec<usize>) {
        let [[left, right], [low, high]] = cell;
        let [x, y] = cell.map(middle);
        for at in [
            [left, low],
            [right, low],
            [left, high],
            [right, high],
            [x, y],
        ] {
            self.ask_one(at, wanted);
        }
        if !self.edges {
            return;
        }
        for at in [[x, low], [left, y], [right, y], [x, high]] {
            self.ask_one(at, wanted);
        }
        let [columns, rows] = cell.map(|side| left_out(side).count());
        for n in 0..columns.max(rows) {
            // Rows turned by half, so that the pixels are not all on one diagonal.
            let other_x = left_out(cell[0]).nth(n % columns.max(1)).unwrap_or(x);
            let other_y = left_out(cell[1])
                .nth((n + rows / 2) % rows.max(1))
                .unwrap_or(y);
            self.ask_one([other_x, other_y], wanted);
        }
    }

    /// Interpolates a cell if what is known there allows it.
    fn settle(&mut self, cell: Cell, tolerance: f32) -> bool {
        let agrees = pixels(cell).all(|at| {
            let Some(place) = self.place(at[0], at[1]).map(|k| &self.places[k]) else {
                return true;
            };
            let off = self.between(cell, at)[0] - place.left[0];
            !place.known || off.abs() * place.unshadowed[0] <= tolerance
        });
        if !agrees {
            return false;
        }
        let [x, y] = cell.map(middle);
        for at in pixels(cell) {
            let Some(k) = self.place(at[0], at[1]) else {
                continue;
            };
            if self.places[k].known || self.places[k].settled {
                continue;
            }
            // Between the nearest of the pixels that were asked.
            let nearest = if self.edges {
                let half = |[first, last]: [usize; 2], middle: usize, at: usize| {
                    if at < middle {
                        [first, middle]
                    } else {
                        [middle, last]
                    }
                };
                [half(cell[0], x, at[0]), half(cell[1], y, at[1])]
            } else {
                cell
            };
            self.places[k].left = self.between(nearest, at);
            self.places[k].settled = true;
        }
        true
    }

    /// What the corners of a cell let expect at a pixel.
    fn between(&self, cell: Cell, at: [usize; 2]) -> [f32; 2] {
        let part = |axis: usize| {
            let [first, last] = cell[axis];
            (at[axis] - first) as f32 / (last - first).max(1) as f32
        };
        let (right, high) = (part(0), part(1));
        let [xs, ys] = cell;
        let corner =
            |x: usize, y: usize| self.place(x, y).map_or([0.0; 2], |k| self.places[k].left);
        let [low, up] = ys.map(|y| xs.map(|x| corner(x, y)));
        [0, 1].map(|i| {
            let along = |[a, b]: [[f32; 2]; 2]| a[i] + right * (b[i] - a[i]);
            along(low) + high * (along(up) - along(low))
        })
    }

    fn cut(&mut self, cell: Cell) {
        let parts = cell.map(|side| {
            let middle = middle(side);
            if middle == side[0] {
                [Some(side), None]
            } else {
                [Some([side[0], middle]), Some([middle, side[1]])]
            }
        });
        for y in parts[1].into_iter().flatten() {
            self.open
                .extend(parts[0].into_iter().flatten().map(|x| [x, y]));
        }
    }
}

/// The column or row in the middle of a cell's side.
fn middle([first, last]: [usize; 2]) -> usize {
    first.midpoint(last)
}

/// Columns or rows that are neither at a side's ends nor its middle.
fn left_out(side: [usize; 2]) -> impl Iterator<Item = usize> {
    let [first, last] = side;
    (first + 1..last).filter(move |at| *at != middle(side))
}

fn pixels([[left, right], [low, high]]: Cell) -> impl Iterator<Item = [usize; 2]> {
    (low..=high).flat_map(move |y| (left..=right).map(move |x| [x, y]))
}
