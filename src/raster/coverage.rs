//! The pixels that triangles and convex quadrilaterals cover, row by row and without depth: for flattened shadows,
//! which are drawn hundreds of times a texture, and for the sides of shadow volumes.
//!
//! The same pixels as [`super::rasterize`] finds, from the same edge functions. Where a row's pixel is
//! farther from all edges than rounding can be wrong by, it is inside or outside without being looked at;
//! the others, a few in a million, are decided by the edge functions. [`cover`] draws an image with one thread:
//! its callers have many to draw at once.

use glam::DVec3;

use super::Tile;
use super::setup::{self, EdgeFunction, NEAR, PixelBounds, smaller};
use crate::camera::Camera;

/// A point with its place in the image.
#[derive(Debug, Clone, Copy)]
pub struct Projected {
    /// The point in homogeneous pixel coordinates, as [`Camera::project`] gives it.
    point: DVec3,
    /// The point's place in the image, in pixels; without meaning where it is behind the near plane.
    screen: [f64; 2],
    bounds: PixelBounds,
}

impl Projected {
    /// Projects a point.
    #[inline(always)]
    pub fn new(p: DVec3, camera: &Camera) -> Self {
        let point = camera.project(p);
        if point.z >= NEAR {
            let screen = [point.x / point.z, point.y / point.z];
            let bounds = PixelBounds::of_point(screen, camera);
            return Projected {
                point,
                screen,
                bounds,
            };
        }
        Projected {
            point,
            screen: [0.0; 2],
            bounds: PixelBounds::BEHIND,
        }
    }
}

/// Calls `span(row, first, last)` for the pixels that a triangle covers in each row.
#[inline(always)]
pub fn cover(
    face: &[u32; 3],
    points: &[Projected],
    camera: &Camera,
    mut span: impl FnMut(u32, u32, u32),
) {
    cover_facing(face, points, camera, false, &mut span);
}

/// Calls `span` as [`cover`] does; with `front` only for a triangle that has a positive area in the image. Of a closed
/// body that is all in front of the near plane, they cover what all of its triangles do.
#[inline(always)]
pub fn cover_facing(
    face: &[u32; 3],
    points: &[Projected],
    camera: &Camera,
    front: bool,
    mut span: impl FnMut(u32, u32, u32),
) {
    let [a, b, c] = face.map(|v| &points[v as usize]);
    if a.point.z >= NEAR && b.point.z >= NEAR && c.point.z >= NEAR {
        let Some((low, high)) = a.bounds.and(b.bounds).and(c.bounds).pixels() else {
            return;
        };
        let mut corners = [a.screen, b.screen, c.screen];
        match setup::wind(&mut corners) {
            None => {}
            Some(negative) if negative && front => {}
            Some(_) => {
                if let Some(rows) = Rows::of(setup::edges(&corners), low, high) {
                    rows.spans(rows.low, rows.high, span);
                }
            }
        }
    } else {
        let corners = [a.point, b.point, c.point];
        for setup in setup::clipped_corners(face, &corners, camera)
            .iter()
            .flatten()
        {
            if let Some(rows) = Rows::of(setup.edges, setup.low, setup.high) {
                rows.spans(rows.low, rows.high, &mut span);
            }
        }
    }
}

/// Where edges of one side of a polygon with `N` corners cross rows.
#[derive(Clone, Copy)]
struct Crossings<const N: usize> {
    /// Column in row 0, and its change from row to row.
    lines: [[f64; 2]; N],
    /// There may be none, at infinity.
    count: usize,
}

impl<const N: usize> Crossings<N> {
    #[inline(always)]
    fn push(&mut self, line: [f64; 2]) {
        // Edges around an area are never all on one side; were they, the last would not be looked at, and
        // the exact test would.
        self.lines[self.count.min(N - 2)] = line;
        self.count += 1;
    }

    /// The largest column of a row, with `sign` -1 the smallest.
    #[inline(always)]
    fn at(&self, row: f64, sign: f64) -> f64 {
        let mut x = self.lines[0][0] + self.lines[0][1] * row;
        for i in 1..N - 1 {
            if i < self.count {
                let other = self.lines[i][0] + self.lines[i][1] * row;
                x = if sign * other > sign * x { other } else { x };
            }
        }
        x
    }
}

/// The rows of pixels of a convex polygon with `N` corners, ready to be drawn.
#[derive(Clone, Copy)]
pub(super) struct Rows<const N: usize> {
    edges: [EdgeFunction; N],
    lefts: Crossings<N>,
    rights: Crossings<N>,
    /// More than the crossings can be wrong by.
    margin: f64,
    /// Whether they say anything; otherwise every pixel of a row is in doubt.
    clear: bool,
    pub(super) low: [u32; 2],
    pub(super) high: [u32; 2],
}

/// Corners of a convex quadrilateral, in order. A triangle names its last corner twice; what is not convex in
/// the image, or is cut by the near plane, is drawn as the two triangles that the first and the third corner
/// part it into.
pub type Quadrilateral = [u32; 4];

/// A triangle as a [`Quadrilateral`].
pub fn triangle([a, b, c]: [u32; 3]) -> Quadrilateral {
    [a, b, c, c]
}

/// First and last column and row of the pixels that a face before the near plane can cover; `None` if there are none,
/// or if it reaches behind.
pub(super) fn within(face: &Quadrilateral, bounds: &[PixelBounds]) -> Option<([u32; 2], [u32; 2])> {
    let [a, b, c, d] = face.map(|v| bounds[v as usize]);
    let all = a.and(b).and(c).and(d);
    if all.is_behind() { None } else { all.pixels() }
}

impl Rows<4> {
    /// Calls `part` for what is drawn of `face`, of points for each of which [`super::project`] was called.
    pub(super) fn each(
        face: &Quadrilateral,
        points: &[DVec3],
        bounds: &[PixelBounds],
        camera: &Camera,
        mut part: impl FnMut(Self),
    ) {
        let [a, b, c, d] = *face;
        if c != d && face.iter().all(|&v| points[v as usize].z >= NEAR) {
            let Some((low, high)) = within(face, bounds) else {
                return;
            };
            let corners = face.map(|v| {
                let p = points[v as usize];
                [p.x / p.z, p.y / p.z]
            });
            if let Some(edges) = setup::convex_edges(&corners) {
                Rows::of(edges, low, high).into_iter().for_each(part);
                return;
            }
        }
        let halves = [[a, b, c], [a, c, d]];
        for half in &halves[..1 + usize::from(c != d)] {
            // An edge that is looked at twice changes nothing.
            let rows = |[a, b, c]: [EdgeFunction; 3], low, high| Rows::of([a, b, c, c], low, high);
            if setup::is_in_front(half, points) {
                let Some((low, high)) = within(&triangle(*half), bounds) else {
                    continue;
                };
                let mut corners = half.map(|v| {
                    let p = points[v as usize];
                    [p.x / p.z, p.y / p.z]
                });
                if setup::wind(&mut corners).is_some() {
                    rows(setup::edges(&corners), low, high)
                        .into_iter()
                        .for_each(&mut part);
                }
            } else {
                for s in setup::clipped(half, points, camera).iter().flatten() {
                    rows(s.edges, s.low, s.high).into_iter().for_each(&mut part);
                }
            }
        }
    }

    /// Columns that can be covered in the rows from `top` to `bottom`.
    pub(super) fn columns(&self, top: u32, bottom: u32) -> [u32; 2] {
        let (mut low, mut high) = (f64::from(self.low[0]), f64::from(self.high[0]));
        if self.clear {
            // Each line's own extreme over the rows bounds what the lines together bound.
            for &[first, slope] in &self.lefts.lines[..self.lefts.count] {
                let [x0, x1] = [top, bottom].map(|row| first + slope * f64::from(row));
                low = larger(smaller(x0, x1) - self.margin, low);
            }
            for &[first, slope] in &self.rights.lines[..self.rights.count] {
                let [x0, x1] = [top, bottom].map(|row| first + slope * f64::from(row));
                high = smaller(larger(x0, x1) + self.margin, high);
            }
        }
        [low as u32, high.max(0.0) as u32]
    }

    /// Calls `span(row, first, last)` for the pixels in each row of a tile.
    #[inline(always)]
    pub(super) fn within(&self, tile: Tile, span: impl FnMut(u32, u32, u32)) {
        let low = [self.low[0].max(tile.x), self.low[1].max(tile.y)];
        let end = [tile.x + tile.width - 1, tile.y + tile.height - 1];
        let high = [self.high[0].min(end[0]), self.high[1].min(end[1])];
        if low[0] <= high[0] {
            self.spans(low, high, span);
        }
    }
}

impl<const N: usize> Rows<N> {
    /// The rows of pixels inside the edges, between the pixels `low` and `high`; `None` where there are none.
    #[inline(always)]
    fn of(edges: [EdgeFunction; N], low: [u32; 2], high: [u32; 2]) -> Option<Self> {
        let none = |x: f64| Crossings {
            lines: [[x, 0.0]; N],
            count: 0,
        };
        let mut rows = Rows {
            edges,
            lefts: none(f64::NEG_INFINITY),
            rights: none(f64::INFINITY),
            margin: 0.0,
            clear: false,
            low,
            high,
        };
        for e in &edges {
            if e.dy == 0.0 {
                // Along a row of centres it decides about that row, and of no other.
                if e.above >= 0.0 {
                    let at = |row: u32| f64::from(row) + 0.5 == e.y;
                    rows.low[1] += u32::from(at(rows.low[1]));
                    if at(rows.high[1]) {
                        rows.high[1] = rows.high[1].checked_sub(1)?;
                    }
                }
                continue;
            }
            let (first, slope, wrong) = e.crossing();
            if e.dy > 0.0 {
                rows.rights.push([first, slope]);
            } else {
                rows.lefts.push([first, slope]);
            }
            // Not a number, where the crossing is none: then every pixel of a row is in doubt.
            rows.margin = if wrong <= rows.margin {
                rows.margin
            } else {
                wrong
            };
        }
        let few = |side: &Crossings<N>| side.count < N;
        rows.clear = rows.margin < 0.25 && few(&rows.lefts) && few(&rows.rights);
        Some(rows)
    }

    /// Calls `span(row, first, last)` for the pixels in each row, between `low` and `high`.
    #[inline(always)]
    fn spans(&self, low: [u32; 2], high: [u32; 2], mut span: impl FnMut(u32, u32, u32)) {
        if !self.clear {
            return spans_in_doubt(&self.edges, low, high, &mut span);
        }
        let margin = self.margin;
        let (least, most) = (f64::from(low[0]), f64::from(high[0]));
        for y in low[1]..=high[1] {
            let row = f64::from(y);
            let (left, right) = (self.lefts.at(row, 1.0), self.rights.at(row, -1.0));
            // Inside are all columns from `first` to `last`; one before and after may be.
            let first = ceil(larger(left + margin, least), most);
            let last = floor(smaller(right - margin, most), least);
            let before = first > least && first - 1.0 >= left - margin;
            let after = last < most && last + 1.0 <= right + margin;
            let (mut first, mut last) = (first, last);
            if before || after {
                let p = |x: f64| [x + 0.5, row + 0.5];
                let inside = |x: f64| self.edges.iter().all(|e| e.contains(p(x)));
                if before && inside(first - 1.0) {
                    first -= 1.0;
                }
                if after && inside(last + 1.0) {
                    last += 1.0;
                }
            }
            if first <= last {
                span(y, first as u32, last as u32);
            }
        }
    }
}

/// Rows of which every pixel is looked at: of slivers that lie along a row.
#[cold]
fn spans_in_doubt(
    edges: &[EdgeFunction],
    low: [u32; 2],
    high: [u32; 2],
    span: &mut dyn FnMut(u32, u32, u32),
) {
    for y in low[1]..=high[1] {
        let inside = |x: &u32| {
            let p = [f64::from(*x) + 0.5, f64::from(y) + 0.5];
            edges.iter().all(|e| e.contains(p))
        };
        if let Some(first) = (low[0]..=high[0]).find(inside) {
            let last = (first..=high[0]).rev().find(inside).unwrap_or(first);
            span(y, first, last);
        }
    }
}

#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The next whole number, of one from 0 on; at most `most + 1`.
#[inline(always)]
fn ceil(x: f64, most: f64) -> f64 {
    // A cast, since `ceil` is a call where the instruction set is not known to have it.
    let x = smaller(x, most + 1.0);
    let whole = f64::from(x as i32);
    if whole < x { whole + 1.0 } else { whole }
}

/// The whole number before, of one that is not large; at least `least - 1`.
#[inline(always)]
fn floor(x: f64, least: f64) -> f64 {
    let x = larger(x, least - 1.0);
    let whole = f64::from(x as i32);
    if whole > x { whole - 1.0 } else { whole }
}

/// One bit a pixel, in rows of whole words.
#[derive(Debug, Clone, Default)]
pub struct Bitmap {
    /// Words in a row.
    pub stride: usize,
    /// Row by row; bits beyond the width mean nothing.
    pub words: Vec<u64>,
}

impl Bitmap {
    /// Empties the bitmap for an image of this size.
    pub fn reset(&mut self, width: u32, height: u32) {
        self.stride = (width as usize).div_ceil(64);
        self.words.clear();
        self.words.resize(self.stride * height as usize, 0);
    }

    /// Sets the pixels of a row from `first` to `last`.
    #[inline(always)]
    pub fn set(&mut self, y: u32, first: u32, last: u32) {
        let row = y as usize * self.stride;
        let (a, b) = ((first / 64) as usize, (last / 64) as usize);
        let (from, to) = (u64::MAX << (first % 64), u64::MAX >> (63 - last % 64));
        if a == b {
            self.words[row + a] |= from & to;
            return;
        }
        self.words[row + a] |= from;
        self.words[row + a + 1..row + b].fill(u64::MAX);
        self.words[row + b] |= to;
    }

    /// Whether a pixel is set.
    #[inline(always)]
    pub fn get(&self, x: u32, y: u32) -> bool {
        self.words[y as usize * self.stride + (x / 64) as usize] >> (x % 64) & 1 == 1
    }

    /// Sixteen pixels from column `16 block` on.
    #[inline(always)]
    pub fn block(&self, y: usize, block: usize) -> u16 {
        (self.words[y * self.stride + block / 4] >> (16 * (block % 4))) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Control;
    use crate::raster::nearest::{NONE, Nearest};
    use crate::raster::rasterize_projected;
    use glam::DMat3;

    /// A small generator, for corners on and off the grid of pixels.
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    #[test]
    fn the_same_pixels_as_the_rasteriser_finds() {
        let k = DMat3::from_cols_array(&[60.0, 0.0, 0.0, 0.0, 60.0, 0.0, 70.0, 30.0, 1.0]);
        let camera = Camera::new(k, DMat3::IDENTITY, DVec3::ZERO, 140, 70).unwrap();
        let mut random = Random(7);
        let mut covered = 0;
        for round in 0..3000 {
            let p = [0, 1, 2].map(|_| {
                let z = random.next() * 2.0 - if round % 4 == 0 { 0.6 } else { 0.0 };
                let spread = [0.02, 0.3, 4.0, 300.0][round / 4 % 4];
                let mut p = DVec3::new(
                    (random.next() - 0.5) * spread,
                    (random.next() - 0.5) * spread,
                    z,
                );
                if round % 3 == 0 && z > 0.1 {
                    // On the pixels' centres, where edges decide by their rule.
                    let screen = camera.project(p) / z;
                    let centre = |v: f64| v.floor() + 0.5;
                    p.x = (centre(screen.x) - 70.0) / 60.0 * z;
                    p.y = (centre(screen.y) - 30.0) / 60.0 * z;
                }
                p
            });
            let points: Vec<_> = p.iter().map(|&p| Projected::new(p, &camera)).collect();
            let mut found = Bitmap::default();
            found.reset(camera.width, camera.height);
            cover(&[0, 1, 2], &points, &camera, |y, a, b| found.set(y, a, b));
            let points: Vec<_> = p.iter().map(|&p| camera.project(p)).collect();
            let control = Control::default();
            let make = Nearest::new;
            let tiles =
                rasterize_projected(&points, &[[0, 1, 2]], |_| true, &camera, &control, make)
                    .unwrap();
            for (tile, nearest) in tiles {
                for i in 0..tile.width * tile.height {
                    let (x, y) = (tile.x + i % tile.width, tile.y + i / tile.width);
                    let expected = nearest.triangle[i as usize] != NONE;
                    assert_eq!(found.get(x, y), expected, "round {round}, {x} {y}: {p:?}");
                    covered += usize::from(expected);
                }
            }
        }
        assert!(covered > 100_000, "{covered}");
    }

    /// Counts how often a pixel is covered.
    struct Times(Tile, Vec<u32>);

    impl super::super::Cover for Times {
        fn row(&mut self, y: u32, first: u32, last: u32, _face: u32) {
            let from = (y - self.0.y) * self.0.width;
            for x in first..=last {
                self.1[(from + x - self.0.x) as usize] += 1;
            }
        }
    }

    #[test]
    fn a_quadrilateral_covers_what_its_two_triangles_do() {
        let k = DMat3::from_cols_array(&[60.0, 0.0, 0.0, 0.0, 60.0, 0.0, 70.0, 30.0, 1.0]);
        let camera = Camera::new(k, DMat3::IDENTITY, DVec3::ZERO, 140, 70).unwrap();
        let mut random = Random(11);
        let (mut covered, mut convex) = (0, 0);
        for round in 0..3000 {
            let spread = [0.3, 3.0, 60.0][round % 3];
            // Corners of a plane, some on pixels' centres, some quadrilaterals not convex or behind the eye.
            let slope = [random.next() - 0.5, random.next() - 0.5];
            let p = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[u, v]: [f64; 2]| {
                let mut at = [u, v].map(|c| 0.5 * spread * (c + 2.2 * (random.next() - 0.5)));
                if round % 2 == 0 {
                    at = at.map(|c| (c * 60.0).floor() / 60.0 + 0.5 / 60.0);
                }
                let z = 1.0
                    + if round % 5 == 0 {
                        slope[0] * at[0] + slope[1] * at[1]
                    } else {
                        0.0
                    };
                DVec3::new(at[0] * z.abs(), at[1] * z.abs(), z)
            });
            let (points, bounds): (Vec<_>, Vec<_>) = p
                .iter()
                .map(|&p| crate::raster::project(p, &camera))
                .unzip();
            let times = |faces: &[Quadrilateral]| {
                let make = |tile: Tile| Times(tile, vec![0; (tile.width * tile.height) as usize]);
                let quiet = Control::default();
                let tiles =
                    super::super::cover_projected(&points, &bounds, faces, &camera, &quiet, make);
                let tiles = tiles.unwrap();
                tiles.into_iter().flat_map(|(_, t)| t.1).collect::<Vec<_>>()
            };
            let once = times(&[[0, 1, 2, 3]]);
            let halves = times(&[triangle([0, 1, 2]), triangle([0, 2, 3])]);
            assert_eq!(once, halves, "round {round}: {p:?}");
            covered += once.iter().sum::<u32>();
            let corners = p.map(|p| [p.x / p.z, p.y / p.z]);
            convex += usize::from(setup::convex_edges(&corners).is_some());
        }
        assert!(
            covered > 100_000 && (500..2500).contains(&convex),
            "{covered} {convex}"
        );
    }

    #[test]
    fn a_span_sets_its_bits_and_no_others() {
        for (first, last) in [
            (0, 0),
            (3, 9),
            (0, 63),
            (63, 64),
            (5, 130),
            (64, 127),
            (140, 140),
        ] {
            let mut bitmap = Bitmap::default();
            bitmap.reset(141, 2);
            bitmap.set(1, first, last);
            for x in 0..141 {
                assert!(!bitmap.get(x, 0));
                assert_eq!(bitmap.get(x, 1), (first..=last).contains(&x), "{x}");
            }
        }
    }
}
