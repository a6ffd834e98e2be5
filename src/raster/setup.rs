//! From a triangle to edge functions in the image.
//!
//! An edge function is evaluated from the edge's lexicographically lower end, in `f64`, whichever way
//! the triangle runs through it: two triangles at an edge see the same number with opposite signs. Where
//! its sign could be rounding it is found exactly, so that the edges of slivers do not contradict each
//! other. Where it is exactly zero, the pixel's centre is moved by an infinitesimal (ε, ε²), which does what a
//! top-left rule does. The near plane, [`NEAR`] of the scene's size in front of the eye, cuts edges at
//! a point that depends on the edge alone.

use fearless_simd::Simd;
use glam::DVec3;

use super::SPAN;
use super::depth::{self, Depth};
use crate::camera::{Camera, MAX_SIZE};
use crate::simd::positive;

/// Distance of the near plane in local units, in which the scene's half-extent is between ½ and 1:
/// far below what can be seen, far above the `f64` rounding of a projected point.
pub const NEAR: f64 = 1e-7;

/// Just below zero: `e > JUST_BELOW` is `e >= 0`.
const JUST_BELOW: f64 = -f64::MIN_POSITIVE;

/// Below this part of its two terms an edge function's sign may be rounding, and is found exactly.
pub(super) const DOUBT: f64 = 8.0 * f64::EPSILON;

#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeFunction {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) dx: f64,
    pub(super) dy: f64,
    /// The other end, and -1 where the triangle runs from there.
    to: [f64; 2],
    sign: f64,
    /// Inside where the function is greater.
    pub(super) above: f64,
}

impl EdgeFunction {
    /// Whether a point is inside.
    #[inline(always)]
    pub(super) fn contains(&self, p: [f64; 2]) -> bool {
        let (term, other) = (self.dx * (p[1] - self.y), self.dy * (p[0] - self.x));
        let value = term - other;
        if value.abs() > DOUBT * (term.abs() + other.abs()) {
            return value > 0.0;
        }
        self.contains_exactly(p)
    }

    #[cold]
    fn contains_exactly(&self, p: [f64; 2]) -> bool {
        let c = |p: [f64; 2]| robust::Coord { x: p[0], y: p[1] };
        let value = self.sign * robust::orient2d(c([self.x, self.y]), c(self.to), c(p));
        value > self.above
    }

    /// Where the edge crosses rows of pixels: the column in row 0, its change from row to row, and more than
    /// rounding can be wrong by.
    #[inline(always)]
    pub(super) fn crossing(&self) -> (f64, f64, f64) {
        let slope = self.dx / self.dy;
        let first = self.x - 0.5 + slope * (0.5 - self.y);
        let rows = slope.abs() * f64::from(MAX_SIZE);
        let margin = 1e-6 + DOUBT * (first.abs() + self.x.abs() + rows);
        (first, slope, margin)
    }
}

/// A triangle in the image, ready to be filled.
#[derive(Debug, Clone, Copy)]
pub struct Setup {
    pub(super) edges: [EdgeFunction; 3],
    depth: Depth,
    /// First column and row whose centres can be inside.
    pub low: [u32; 2],
    /// Last column and row.
    pub high: [u32; 2],
}

/// How the pixels of a block lie: in rows of so many columns.
#[derive(Debug)]
pub struct BlockShape {
    /// Pixels in a row.
    pub columns: u32,
    /// Mask of the first row: a bit for each of its pixels.
    pub row: u8,
    /// The first pixel of each row.
    starts: u8,
    x: [f64; SPAN],
    y: [f64; SPAN],
}

/// Blocks of 1, 2, 4 and 8 columns.
pub static SHAPES: [BlockShape; 4] = [shape(1), shape(2), shape(4), shape(8)];

const fn shape(columns: u32) -> BlockShape {
    let (mut x, mut y, mut starts) = ([0.0; SPAN], [0.0; SPAN], 0);
    let mut i = 0;
    while i < SPAN as u32 {
        (x[i as usize], y[i as usize]) = ((i % columns) as f64, (i / columns) as f64);
        if i % columns == 0 {
            starts |= 1 << i;
        }
        i += 1;
    }
    let row = (u8::MAX as u32 >> (8 - columns)) as u8;
    BlockShape {
        columns,
        row,
        starts,
        x,
        y,
    }
}

impl BlockShape {
    /// The pixels in the first so many columns and rows.
    #[inline(always)]
    pub fn first(&self, columns: u32, rows: u32) -> u8 {
        let row = u8::MAX >> (8 - columns.min(self.columns));
        let rows = u8::MAX >> (8 - (rows * self.columns).min(8));
        // A product with single bits that are a row apart is a copy to each row.
        row.wrapping_mul(self.starts) & rows
    }
}

/// Centres of [`SPAN`] pixels.
pub struct PixelCentres {
    pub(super) x: [f64; SPAN],
    pub(super) y: [f64; SPAN],
}

impl PixelCentres {
    /// A block with its first pixel at `(x, y)`.
    #[inline(always)]
    pub fn new(shape: &BlockShape, x: u32, y: u32) -> Self {
        let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        PixelCentres {
            x: std::array::from_fn(|i| x + shape.x[i]),
            y: std::array::from_fn(|i| y + shape.y[i]),
        }
    }
}

/// Where an edge crosses the rows of pixels.
#[derive(Clone, Copy)]
pub struct RowCrossing {
    first: f64,
    slope: f64,
    above: bool,
}

/// First and last column, of those from `first` to `last`, whose pixels in row `y` can be inside; none are
/// where the first is beyond the last. Long slanted slivers fill little of their bounds, and miss the
/// pixels' centres in most rows.
#[inline(always)]
pub fn columns(crossings: &[RowCrossing; 3], y: u32, first: u32, last: u32) -> (u32, u32) {
    let (mut low, mut high) = (f64::from(first), f64::from(last));
    for c in crossings {
        let x = c.first + c.slope * f64::from(y);
        // What is not a number, or infinite (a horizontal edge), changes nothing.
        if !x.is_finite() {
            continue;
        }
        if c.above {
            high = smaller(x, high);
        } else {
            low = -smaller(-x, -low);
        }
    }
    let (low, high) = (low.ceil(), high.floor());
    if low > high {
        return (1, 0);
    }
    (low as u32, high as u32)
}

impl Setup {
    /// Change of the inverse depth from column to column and from row to row.
    #[inline(always)]
    pub fn slope(&self) -> [f64; 2] {
        self.depth.slope()
    }

    /// Least and largest inverse depth of the corners.
    #[inline(always)]
    pub fn range(&self) -> [f64; 2] {
        self.depth.range()
    }

    /// Where the edges cross rows: for each edge the column in row 0 and its change from row to row, and more
    /// than rounding can be wrong by; positive `dy` bound from above, negative from below.
    #[inline(always)]
    pub fn crossings(&self) -> [RowCrossing; 3] {
        self.edges.map(|e| {
            let (first, slope, margin) = e.crossing();
            if e.dy > 0.0 {
                RowCrossing {
                    first: first + margin,
                    slope,
                    above: true,
                }
            } else {
                RowCrossing {
                    first: first - margin,
                    slope,
                    above: false,
                }
            }
        })
    }

    /// Which of the pixels `within` a block are inside.
    #[inline(always)]
    pub fn inside<S: Simd>(&self, simd: S, block: &PixelCentres, within: u8) -> u8 {
        // Smallest edge function, and smallest distance of one from what could be rounding.
        let (mut inside, mut clear) = ([f64::INFINITY; SPAN], [f64::INFINITY; SPAN]);
        for e in &self.edges {
            for i in 0..SPAN {
                let (term, other) = (e.dx * (block.y[i] - e.y), e.dy * (block.x[i] - e.x));
                let value = term - other;
                inside[i] = smaller(value - e.above, inside[i]);
                let distance = value.abs() - DOUBT * (term.abs() + other.abs());
                clear[i] = smaller(distance, clear[i]);
            }
        }
        let (inside, clear) = (positive(simd, &inside), positive(simd, &clear));
        if within & !clear == 0 {
            inside & within
        } else {
            self.inside_exact(block) & within
        }
    }

    #[cold]
    fn inside_exact(&self, block: &PixelCentres) -> u8 {
        (0..SPAN).fold(0, |mask, i| {
            let p = [block.x[i], block.y[i]];
            let inside = self.edges.iter().all(|e| e.contains_exactly(p));
            mask | u8::from(inside) << i
        })
    }

    /// Inverse depths of a block's pixels, and as many numbers more.
    #[inline(always)]
    pub fn inverse_depth(&self, block: &PixelCentres) -> [f64; 2 * SPAN] {
        let mut out = [0.0; 2 * SPAN];
        for (i, out) in out[..SPAN].iter_mut().enumerate() {
            *out = self.depth.at(block.x[i], block.y[i]);
        }
        out
    }
}

/// `f64::min`, in one instruction where `b` is a number.
#[inline(always)]
pub(super) fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Pixels whose centres can be covered: first column and row, last column and row negated, so that the
/// bounds of several are their minima.
#[derive(Debug, Clone, Copy)]
pub struct PixelBounds([i32; 4]);

impl PixelBounds {
    /// The bounds of a point behind the near plane, whose place in the image has no meaning.
    pub(super) const BEHIND: PixelBounds = PixelBounds([i32::MIN; 4]);

    /// Bounds of a vertex, as [`Camera::project`] gives it.
    pub fn of_vertex(p: DVec3, camera: &Camera) -> Self {
        if p.z >= NEAR {
            PixelBounds::of_point([p.x / p.z, p.y / p.z], camera)
        } else {
            PixelBounds::BEHIND
        }
    }

    #[inline(always)]
    pub(super) fn of_point(p: [f64; 2], camera: &Camera) -> Self {
        let (first_x, last_x) = centres(p[0], camera.width);
        let (first_y, last_y) = centres(p[1], camera.height);
        PixelBounds([first_x, first_y, -last_x, -last_y])
    }

    #[inline(always)]
    pub(super) fn and(self, o: PixelBounds) -> PixelBounds {
        PixelBounds(std::array::from_fn(|i| self.0[i].min(o.0[i])))
    }

    /// Whether some of it is behind the near plane.
    #[inline(always)]
    pub(super) fn is_behind(self) -> bool {
        self.0 == PixelBounds::BEHIND.0
    }

    /// First and last column and row, if there are any.
    #[inline(always)]
    pub(super) fn pixels(self) -> Option<([u32; 2], [u32; 2])> {
        let [x0, y0, x1, y1] = self.0;
        let some = x0 <= -x1 && y0 <= -y1;
        some.then_some(([x0 as u32, y0 as u32], [-x1 as u32, -y1 as u32]))
    }
}

/// The first of `size` pixels with its centre at `x` or after it (`size` if none) and the last with its centre at `x`
/// or before (-1 if none).
#[inline(always)]
fn centres(x: f64, size: u32) -> (i32, i32) {
    // What is not a number bounds nothing.
    if x.is_nan() {
        return (i32::MAX, -i32::MAX);
    }
    let x = (x - 0.5).clamp(-1.0, f64::from(size));
    // `floor` and `ceil` are calls where the instruction set is not known to have them.
    let near = x as i32;
    let floor = near - i32::from(f64::from(near) > x);
    let ceil = near + i32::from(f64::from(near) < x);
    (ceil.max(0), floor.min(size as i32 - 1))
}

/// First and last column and row of the pixels whose centres any triangle can cover.
#[cold]
pub(super) fn pixels_of(
    face: &[u32; 3],
    points: &[DVec3],
    camera: &Camera,
) -> Option<([u32; 2], [u32; 2])> {
    let (polygon, n) = in_front(face, &face.map(|v| points[v as usize]));
    let corners = polygon[..n].iter();
    corners
        .map(|p| PixelBounds::of_point([p.x / p.z, p.y / p.z], camera))
        .reduce(PixelBounds::and)?
        .pixels()
}

/// The part of a triangle in front of the near plane, in the image.
pub struct ClippedTriangle {
    corners: [[f64; 2]; 4],
    count: usize,
}

impl ClippedTriangle {
    /// The outline of a triangle whose vertices were projected to `points`.
    pub fn new(face: &[u32; 3], points: &[DVec3]) -> Self {
        let (polygon, count) = in_front(face, &face.map(|v| points[v as usize]));
        ClippedTriangle {
            corners: polygon.map(|p| [p.x / p.z, p.y / p.z]),
            count,
        }
    }

    /// Lowest and highest `x` between the rows `top` and `bottom` (both in pixels), a pixel more than rounding
    /// could be wrong by; infinite where a corner is not a number.
    pub fn extent(&self, top: f64, bottom: f64) -> (f64, f64) {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for i in 0..self.count {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % self.count]);
            let [a, b] = if a[1] < b[1] { [a, b] } else { [b, a] };
            if b[1] < top || a[1] > bottom {
                continue;
            }
            let slope = (b[0] - a[0]) / (b[1] - a[1]);
            for (end, row) in [(a, a[1].max(top)), (b, b[1].min(bottom))] {
                let x = if row == end[1] {
                    end[0]
                } else {
                    a[0] + slope * (row - a[1])
                };
                let margin = 1.0 + DOUBT * (a[0].abs() + b[0].abs() + x.abs());
                if !x.is_finite() {
                    return (f64::NEG_INFINITY, f64::INFINITY);
                }
                (low, high) = (low.min(x - margin), high.max(x + margin));
            }
        }
        (low, high)
    }
}

/// Whether all of a triangle is in front of the near plane.
#[inline(always)]
pub fn is_in_front(face: &[u32; 3], points: &[DVec3]) -> bool {
    face.iter().all(|&v| points[v as usize].z >= NEAR)
}

/// Sets up a triangle in front of the near plane, if it can cover a pixel's centre.
#[inline(always)]
pub fn triangle(corners: &[DVec3; 3], camera: &Camera) -> Option<Setup> {
    one(*corners, depth::plane(corners), camera)
}

/// Clips a triangle at the near plane and sets up what can cover a pixel's centre.
#[cold]
pub fn clipped(face: &[u32; 3], points: &[DVec3], camera: &Camera) -> [Option<Setup>; 2] {
    clipped_corners(face, &face.map(|v| points[v as usize]), camera)
}

/// The polygons of [`clipped`], from a triangle's corners.
#[cold]
pub(super) fn clipped_corners(
    face: &[u32; 3],
    corners: &[DVec3; 3],
    camera: &Camera,
) -> [Option<Setup>; 2] {
    // From the whole triangle, since what the near plane leaves of it may have corners millions of pixels
    // away.
    let plane = depth::plane(corners);
    let (polygon, n) = in_front(face, corners);
    let part = |i: usize| {
        let corners = [polygon[0], polygon[i - 1], polygon[i]];
        (i < n).then(|| one(corners, plane, camera)).flatten()
    };
    [part(2), part(3)]
}

/// The corners of a triangle's part in front of the near plane, and their number.
#[cold]
fn in_front(face: &[u32; 3], corners: &[DVec3; 3]) -> ([DVec3; 4], usize) {
    let in_front = corners.map(|p| p.z >= NEAR);
    let mut polygon = [DVec3::ZERO; 4];
    let mut n = 0;
    for i in 0..3 {
        let j = (i + 1) % 3;
        if in_front[i] {
            polygon[n] = corners[i];
            n += 1;
        }
        if in_front[i] != in_front[j] {
            // From the lower vertex, so that both triangles at the edge cut it alike.
            let (a, b) = if face[i] < face[j] { (i, j) } else { (j, i) };
            let (a, b) = (corners[a], corners[b]);
            let cut = a + (b - a) * ((NEAR - a.z) / (b.z - a.z));
            polygon[n] = DVec3::new(cut.x, cut.y, NEAR);
            n += 1;
        }
    }
    (polygon, n)
}

/// Sets up a triangle in front of the near plane, if it has an area and can cover a pixel's centre.
#[inline(always)]
fn one(corners: [DVec3; 3], plane: DVec3, camera: &Camera) -> Option<Setup> {
    let mut s = corners.map(|p| [p.x / p.z, p.y / p.z, 1.0 / p.z]);
    let [a, b, c] = s.map(|p| PixelBounds::of_point([p[0], p[1]], camera));
    let (low, high) = a.and(b).and(c).pixels()?;
    wind(&mut s)?;
    Some(Setup {
        edges: edges(&s),
        depth: Depth::on(plane, [s[0][2], s[1][2], s[2][2]]),
        low,
        high,
    })
}

/// Winds a triangle to a positive area, if it has one, and says whether it was negative; corners are
/// `(x, y, …)`.
#[inline(always)]
pub(super) fn wind<const N: usize>(s: &mut [[f64; N]; 3]) -> Option<bool> {
    let c = |p: &[f64; N]| robust::Coord { x: p[0], y: p[1] };
    let area = robust::orient2d(c(&s[0]), c(&s[1]), c(&s[2]));
    if area == 0.0 || !area.is_finite() {
        return None;
    }
    if area < 0.0 {
        s.swap(1, 2);
    }
    Some(area < 0.0)
}

/// The edges of a quadrilateral, of positive area, whose corners are all convex; `None` if one is not.
pub(super) fn convex_edges(corners: &[[f64; 2]; 4]) -> Option<[EdgeFunction; 4]> {
    let c = |i: usize| {
        let [x, y] = corners[i % 4];
        robust::Coord { x, y }
    };
    let turn = |i: usize| robust::orient2d(c(i), c(i + 1), c(i + 2));
    let first = turn(0);
    let same = |i: usize| turn(i) * first.signum() > 0.0;
    if !(first != 0.0 && first.is_finite() && (1..4).all(same)) {
        return None;
    }
    let [p, q, r, s] = corners;
    Some(if first > 0.0 {
        [edge(p, q), edge(q, r), edge(r, s), edge(s, p)]
    } else {
        [edge(p, s), edge(s, r), edge(r, q), edge(q, p)]
    })
}

/// The edges of a triangle of positive area.
#[inline(always)]
pub(super) fn edges<const N: usize>(s: &[[f64; N]; 3]) -> [EdgeFunction; 3] {
    [edge(&s[0], &s[1]), edge(&s[1], &s[2]), edge(&s[2], &s[0])]
}

/// Positive on the inner side of the edge from `a` to `b` of a triangle with positive area.
#[inline(always)]
fn edge<const N: usize>(a: &[f64; N], b: &[f64; N]) -> EdgeFunction {
    let flip = (b[0], b[1]) < (a[0], a[1]);
    let (from, to) = if flip { (b, a) } else { (a, b) };
    let sign = if flip { -1.0 } else { 1.0 };
    let (dx, dy) = (sign * (to[0] - from[0]), sign * (to[1] - from[1]));
    // Moved by (ε, ε²) the function changes by -dy ε + dx ε².
    let counts_zero = dy < 0.0 || (dy == 0.0 && dx > 0.0);
    let above = if counts_zero { JUST_BELOW } else { 0.0 };
    EdgeFunction {
        x: from[0],
        y: from[1],
        dx,
        dy,
        to: [to[0], to[1]],
        sign,
        above,
    }
}
