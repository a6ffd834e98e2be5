//! Triangles of a few pixels, whose pixels are found where they are put into bins.
//!
//! In a dense mesh most triangles hold no pixel's centre, or that of one or two. A [`TriangleBatch`] of them is looked at
//! together: bounds, and the edge functions at the centre of those whose bounds hold one, are loops over columns
//! of numbers. No edges are kept, and a triangle need not be wound first: inside are the pixels at which all
//! three edge functions have one sign. The functions are those of [`super::setup`], to the last bit; where one could be
//! rounding, where a corner is behind the near plane or very far off, and where there are more pixels, the
//! triangle is left to it.

use fearless_simd::{Simd, dispatch};
use glam::DVec3;

use super::depth::Depth;
use super::setup::{self, BlockShape, SHAPES};
use super::{SPAN, Tile};
use crate::camera::Camera;
use crate::simd::{detect, positive, whole};

/// Triangles that are looked at together.
pub(super) const BLOCK: usize = 64;

/// Most pixels in the bounds of a triangle of few, in two of [`SHAPES`]: beyond, setting it up pays.
const MOST: i32 = 2 * SPAN as i32;

/// Largest coordinate in the image of a corner that is looked at here: products of two are far from overflow.
const FARTHEST: f64 = (1u64 << 40) as f64;

/// The columns and rows of the image in which pixels are looked for: the first of each, and the end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    low: [i32; 2],
    end: [i32; 2],
}

impl Window {
    /// A camera's whole image.
    pub(super) fn image(camera: &Camera) -> Self {
        Window {
            low: [0; 2],
            end: [camera.width as i32, camera.height as i32],
        }
    }

    /// A part of the image.
    pub(super) fn tile(tile: Tile) -> Self {
        let low = [tile.x as i32, tile.y as i32];
        let end = [low[0] + tile.width as i32, low[1] + tile.height as i32];
        Window { low, end }
    }
}

/// What a triangle covers: no pixel's centre.
const NOTHING: u8 = 0;
/// The pixels that are known.
const FEW: u8 = 1;
/// What is still to be found.
const MORE: u8 = 2;

/// What is known of the pixels that a triangle covers.
pub(super) enum Covered {
    /// The triangle covers no pixel.
    Nothing,
    /// The triangle covers these pixels; their depth is there if it was asked for.
    Few(FewPixels, Depth),
    /// The triangle covers perhaps some of the pixels between a first and a last column and row.
    Within([u32; 2], [u32; 2]),
    /// Nothing is known.
    Unknown,
}

/// A few pixels.
pub(super) struct FewPixels {
    low: [u32; 2],
    high: [u32; 2],
    shape: &'static BlockShape,
    mask: u16,
}

impl FewPixels {
    /// First and last column and row.
    pub(super) fn bounds(&self) -> ([u32; 2], [u32; 2]) {
        (self.low, self.high)
    }
}

impl Iterator for FewPixels {
    type Item = [u32; 2];

    #[inline(always)]
    fn next(&mut self) -> Option<[u32; 2]> {
        let i = self.mask.trailing_zeros();
        self.mask &= self.mask.wrapping_sub(1);
        // Rows have a power of two.
        let shift = self.shape.columns.trailing_zeros();
        let (x, y) = (i & (self.shape.columns - 1), i >> shift);
        (i < u16::BITS).then_some([self.low[0] + x, self.low[1] + y])
    }
}

/// Where a projected point is in the image; not a number if that is not to be looked at here.
#[inline(always)]
pub(super) fn on_screen(p: DVec3) -> [f64; 2] {
    let q = [p.x / p.z, p.y / p.z];
    // Without branches, for loops over registers.
    let known = (p.z >= setup::NEAR) & (q[0].abs() <= FARTHEST) & (q[1].abs() <= FARTHEST);
    q.map(|x| if known { x } else { f64::NAN })
}

/// `N` triangles that are looked at together, and what is found.
pub(super) struct TriangleBatch<const N: usize> {
    x: [[f64; N]; 3],
    y: [[f64; N]; 3],
    /// First column and row, and the last.
    low: [[i32; N]; 2],
    high: [[i32; N]; 2],
    /// Pixels, as they lie in the shape for their width.
    mask: [u16; N],
    what: [u8; N],
    /// For triangles of few pixels, their place in the columns that follow.
    place: [u8; N],
    /// Projected corners.
    corners: [[[f64; N]; 3]; 3],
    depth: [Depth; N],
}

impl<const N: usize> TriangleBatch<N> {
    pub(super) fn new() -> Self {
        TriangleBatch {
            x: [[f64::NAN; N]; 3],
            y: [[f64::NAN; N]; 3],
            low: [[0; N]; 2],
            high: [[0; N]; 2],
            mask: [0; N],
            what: [NOTHING; N],
            place: [0; N],
            corners: [[[1.0; N]; 3]; 3],
            depth: [Depth::default(); N],
        }
    }

    /// Looks at triangles by their corners, in columns for each corner and axis.
    #[inline(always)]
    pub(super) fn look_at<S: Simd>(
        &mut self,
        simd: S,
        corners: &[[[f32; N]; 3]; 3],
        camera: &Camera,
        window: Window,
    ) {
        // A copy, which nothing that is written can change; and short loops, for the compiler's vectoriser.
        let camera = *camera;
        for (k, corner) in corners.iter().enumerate() {
            for (to, axis) in self.corners[k].iter_mut().zip(corner) {
                for (to, &x) in to.iter_mut().zip(axis) {
                    *to = f64::from(x);
                }
            }
            for i in 0..N {
                let [x, y, z] = [0, 1, 2].map(|axis| self.corners[k][axis][i]);
                let q = camera.project(DVec3::new(x, y, z));
                self.corners[k][0][i] = q.x;
                self.corners[k][1][i] = q.y;
                self.corners[k][2][i] = q.z;
            }
            for i in 0..N {
                let [x, y, z] = [0, 1, 2].map(|axis| self.corners[k][axis][i]);
                [self.x[k][i], self.y[k][i]] = on_screen(DVec3::new(x, y, z));
            }
        }
        look_lanes(simd, self, window);
    }

    /// The projected corners of triangle `i`.
    #[inline(always)]
    pub(super) fn corners(&self, i: usize) -> [DVec3; 3] {
        let [a, b, c] = &self.corners;
        [a, b, c].map(|[x, y, z]| DVec3::new(x[i], y[i], z[i]))
    }

    /// Looks at up to `N` triangles, whose vertices are at `screen` ([`on_screen`]).
    pub(super) fn look(&mut self, faces: &[[u32; 3]], screen: &[[f64; 2]], camera: &Camera) {
        // `take` says to the compiler that no block is longer, which then leaves out checks of `i`.
        for (i, face) in faces.iter().enumerate().take(N) {
            for (corner, &v) in face.iter().enumerate() {
                [self.x[corner][i], self.y[corner][i]] = screen[v as usize];
            }
        }
        let (block, window) = (self, Window::image(camera));
        dispatch!(detect(), simd => look_lanes(simd, block, window));
    }

    /// Finds the depth of the triangles of few pixels, of those that [`TriangleBatch::look`] was given.
    pub(super) fn find_depth(&mut self, faces: &[[u32; 3]], points: &[DVec3]) {
        let (mut few, mut count) = ([0; N], 0);
        for (i, &what) in self.what.iter().enumerate().take(faces.len()) {
            self.place[i] = count as u8;
            few[count % N] = i;
            count += usize::from(what == FEW);
        }
        for (k, &i) in few.iter().enumerate().take(count) {
            for (corner, &v) in self.corners.iter_mut().zip(&faces[i]) {
                let p = points[v as usize];
                (corner[0][k], corner[1][k], corner[2][k]) = (p.x, p.y, p.z);
            }
        }
        let block = self;
        dispatch!(detect(), _ => depth_lanes(block, count));
    }

    /// What triangle `i` covers.
    #[inline(always)]
    pub(super) fn covered(&self, i: usize) -> Covered {
        let corner = |at: &[[i32; N]; 2]| [at[0][i] as u32, at[1][i] as u32];
        let (low, high) = (corner(&self.low), corner(&self.high));
        match self.what[i] {
            NOTHING => Covered::Nothing,
            FEW => {
                let pixels = FewPixels {
                    low,
                    high,
                    shape: shape_of(high[0] - low[0] + 1),
                    mask: self.mask[i],
                };
                Covered::Few(pixels, self.depth[self.place[i] as usize])
            }
            _ if self.x.iter().any(|x| x[i].is_nan()) => Covered::Unknown,
            _ => Covered::Within(low, high),
        }
    }

    /// Finds the pixels of triangle `i`, of those between its bounds.
    #[inline(always)]
    fn find<S: Simd>(&mut self, simd: S, i: usize) {
        let mut edges = [([0.0; 2], [0.0; 2]); 3];
        for (a, of) in edges.iter_mut().enumerate() {
            let b = (a + 1) % 3;
            let from = [self.x[a][i], self.y[a][i]];
            *of = edge(from, [self.x[b][i], self.y[b][i]]);
        }
        let [x, y] = [self.low[0][i] as u32, self.low[1][i] as u32];
        let [columns, rows] = [0, 1].map(|k| (self.high[k][i] - self.low[k][i] + 1) as u32);
        let shape = shape_of(columns);
        let in_block = SPAN as u32 >> shape.columns.trailing_zeros();
        let mut found = 0u16;
        for half in 0..2 {
            let done = half * in_block;
            if done >= rows {
                break;
            }
            let block = setup::PixelCentres::new(shape, x, y + done);
            let within = shape.first(columns, rows - done);
            let (mut least, mut most) = ([f64::INFINITY; SPAN], [f64::INFINITY; SPAN]);
            let mut clear = [f64::INFINITY; SPAN];
            for (from, along) in &edges {
                for j in 0..SPAN {
                    let (value, distance) = at(*from, *along, [block.x[j], block.y[j]]);
                    least[j] = setup::smaller(value, least[j]);
                    most[j] = setup::smaller(-value, most[j]);
                    clear[j] = setup::smaller(distance, clear[j]);
                }
            }
            let (left, right, clear) = (
                positive(simd, &least),
                positive(simd, &most),
                positive(simd, &clear),
            );
            if within & !clear != 0 {
                self.what[i] = MORE;
                return;
            }
            found |= u16::from((left | right) & within) << (half * SPAN as u32);
        }
        self.mask[i] = found;
        self.what[i] = if found == 0 { NOTHING } else { FEW };
    }
}

/// The shape in which pixels of so many columns, at most [`SPAN`], lie.
#[inline(always)]
fn shape_of(columns: u32) -> &'static BlockShape {
    &SHAPES[columns.next_power_of_two().trailing_zeros().min(3) as usize]
}

/// The end that an edge's function is taken from, the lower one, and the edge's extent.
#[inline(always)]
fn edge(a: [f64; 2], b: [f64; 2]) -> ([f64; 2], [f64; 2]) {
    let flip = (b[0] < a[0]) | ((b[0] == a[0]) & (b[1] < a[1]));
    let from = if flip { b } else { a };
    (from, [b[0] - a[0], b[1] - a[1]])
}

/// An edge's function at a point, and its distance from what could be rounding.
#[inline(always)]
fn at(from: [f64; 2], along: [f64; 2], p: [f64; 2]) -> (f64, f64) {
    let (term, other) = (along[0] * (p[1] - from[1]), along[1] * (p[0] - from[0]));
    let value = term - other;
    let doubt = setup::DOUBT * (term.abs() + other.abs());
    (value, value.abs() - doubt)
}

/// The first pixel, of those from `start` to `end`, with its centre at `low` or after it and the last with its centre at
/// `high` or before, as [`setup::PixelBounds`] has them.
#[inline(always)]
fn centres(low: f64, high: f64, start: i32, end: i32) -> (i32, i32) {
    let within = |x: f64| {
        let x = setup::smaller(x - 0.5, f64::from(end));
        -setup::smaller(-x, f64::from(1 - start))
    };
    let (low, high) = (within(low), within(high));
    let ((near_low, first), (near_high, last)) = (whole(low), whole(high));
    let first = first + i32::from(near_low < low);
    let last = last - i32::from(near_high > high);
    (first.max(start), last.min(end - 1))
}

/// The first loop is free of branches, for the compiler's vectoriser.
#[inline(always)]
fn look_lanes<S: Simd, const N: usize>(simd: S, block: &mut TriangleBatch<N>, window: Window) {
    let Window { low, end } = window;
    for i in 0..N {
        let x = [block.x[0][i], block.x[1][i], block.x[2][i]];
        let y = [block.y[0][i], block.y[1][i], block.y[2][i]];
        let least = |v: [f64; 3]| setup::smaller(setup::smaller(v[0], v[1]), v[2]);
        let most = |v: [f64; 3]| -setup::smaller(setup::smaller(-v[0], -v[1]), -v[2]);
        let (first_x, last_x) = centres(least(x), most(x), low[0], end[0]);
        let (first_y, last_y) = centres(least(y), most(y), low[1], end[1]);
        let (columns, rows) = (last_x - first_x + 1, last_y - first_y + 1);
        // Of a triangle with one pixel in its bounds, all is found here.
        let p = [f64::from(first_x) + 0.5, f64::from(first_y) + 0.5];
        let (mut left, mut right, mut clear) = (true, true, true);
        for k in 0..3 {
            let next = (k + 1) % 3;
            let (from, along) = edge([x[k], y[k]], [x[next], y[next]]);
            let (value, distance) = at(from, along, p);
            left &= value > 0.0;
            right &= value < 0.0;
            clear &= distance > 0.0;
        }
        let sum = (x[0] + x[1] + x[2]) + (y[0] + y[1] + y[2]);
        let known = !sum.is_nan();
        let some = (columns > 0) & (rows > 0);
        let one = (columns == 1) & (rows == 1);
        let stride = if columns > 4 {
            8
        } else if columns > 2 {
            4
        } else {
            columns
        };
        let few = (columns <= SPAN as i32) & (rows <= MOST) & (stride * rows <= MOST);
        let hit = if left | right { FEW } else { NOTHING };
        let of_one = if clear { hit } else { MORE };
        let of_some = if few { FEW } else { MORE };
        let of_box = if one { of_one } else { of_some };
        let of_known = if some { of_box } else { NOTHING };
        block.what[i] = if known { of_known } else { MORE };
        (block.low[0][i], block.low[1][i]) = (first_x, first_y);
        (block.high[0][i], block.high[1][i]) = (last_x, last_y);
        block.mask[i] = u16::from(one);
    }
    for i in 0..N {
        if block.what[i] == FEW && block.mask[i] == 0 {
            block.find(simd, i);
        }
    }
}

/// Free of branches, for the compiler's vectoriser.
#[inline(always)]
fn depth_lanes<const N: usize>(block: &mut TriangleBatch<N>, count: usize) {
    for k in 0..count.min(N) {
        block.depth[k] = Depth::new(&block.corners(k));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Control;
    use crate::raster::{Sink, Tile, rasterize_projected};
    use glam::DMat3;

    /// Pixels with the triangle and the bits of its depth, in order of arrival.
    struct Pixelwise<const PIXELS: bool>(Vec<(u32, u32, u32, u64)>);

    impl<const PIXELS: bool> Sink for Pixelwise<PIXELS> {
        fn takes_pixels() -> bool {
            PIXELS
        }

        fn span(&mut self, x: u32, y: u32, mask: u8, depth: &[f64; SPAN], triangle: u32) {
            for i in (0..SPAN).filter(|i| mask >> i & 1 == 1) {
                let bits = depth[i].to_bits();
                self.0.push((triangle, y, x + i as u32, bits));
            }
        }
    }

    fn drawn<const PIXELS: bool>(
        points: &[DVec3],
        faces: &[[u32; 3]],
        camera: &Camera,
    ) -> Vec<(u32, u32, u32, u64)> {
        let make = |_: Tile| Pixelwise::<PIXELS>(Vec::new());
        let control = Control::default();
        let tiles = rasterize_projected(points, faces, |f| f % 13 != 5, camera, &control, make);
        let mut out = Vec::new();
        for (_, sink) in tiles.unwrap() {
            assert!(
                sink.0.is_sorted_by_key(|p| p.0),
                "in the order of triangles"
            );
            out.extend(sink.0);
        }
        out.sort_unstable();
        out
    }

    /// A small generator.
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }

        fn between(&mut self, low: f64, high: f64) -> f64 {
            low + (high - low) * self.next()
        }

        /// A triangle of one of several kinds, in the image's homogeneous coordinates.
        fn triangle(&mut self, kind: usize) -> [DVec3; 3] {
            let corner = [self.between(-3.0, 143.0), self.between(-3.0, 73.0)];
            let size = [0.4, 1.0, 2.0, 4.0, 9.0, 40.0][kind % 6];
            let centre = |v: f64| v.floor() + 0.5;
            let mut p = [[0.0; 3]; 3].map(|_| {
                let [x, y] = corner.map(|v| v + self.between(0.0, size));
                match kind / 6 % 4 {
                    // On the pixels' centres, and the lines between them, where edges decide by their rule.
                    1 => [centre(x), centre(y), 1.0],
                    2 => [centre(x), y, 2.0],
                    _ => [x, y, self.between(0.5, 4.0)],
                }
            });
            match kind % 29 {
                // A sliver along an edge through a pixel's centre; folded by rounding, or flat.
                1 => p[2] = [0, 1, 2].map(|k| 0.5 * (p[0][k] + p[1][k])),
                2 => p[2] = [p[0][0] + 1e-14 * self.next(), p[0][1], p[0][2]],
                3 => p[2] = p[1],
                // Far away, so that its edges are almost straight lines across the image, or overflow.
                4 => p[2][0] *= 1e12,
                5 => p[2][1] = 1e18 * (self.next() - 0.5),
                6 => p = p.map(|[x, y, z]| [1e200 * (x - 70.0), 1e200 * (y - 35.0), z]),
                7 => p[0][0] = f64::INFINITY,
                // On the near plane, and behind it.
                8 => p[1][2] = setup::NEAR,
                9 => p[1][2] = -1.0,
                10 => p[1][2] = 0.0,
                _ => {}
            }
            p.map(|[x, y, z]| DVec3::new(x * z, y * z, z))
        }
    }

    #[test]
    fn pixels_and_depths_are_those_of_triangles_that_are_set_up() {
        let mut random = Random(11);
        let mut few = 0;
        for (width, height) in [(140, 70), (1, 90), (65, 1)] {
            let camera =
                Camera::new(DMat3::IDENTITY, DMat3::IDENTITY, DVec3::ZERO, width, height).unwrap();
            let points: Vec<DVec3> = (0..60_000).flat_map(|k| random.triangle(k)).collect();
            let mut faces: Vec<[u32; 3]> = (0..points.len() as u32 / 3)
                .map(|f| [3 * f, 3 * f + 1, 3 * f + 2])
                .collect();
            // Corners of several triangles: edges that are shared, and crossed.
            let count = points.len() as u32;
            faces.extend((0..count - 6).step_by(7).map(|f| [f, f + 1, f + 5]));
            faces.extend((0..count - 6).step_by(5).map(|f| [f + 1, f, f + 6]));
            let expected = drawn::<false>(&points, &faces, &camera);
            assert_eq!(drawn::<true>(&points, &faces, &camera), expected);
            assert!(expected.iter().all(|p| f64::from_bits(p.3).is_finite()));
            let screen: Vec<_> = points.iter().map(|&p| on_screen(p)).collect();
            let mut block = TriangleBatch::<BLOCK>::new();
            for faces in faces.chunks(BLOCK) {
                block.look(faces, &screen, &camera);
                let known = |i: usize| matches!(block.covered(i), Covered::Few(..));
                few += (0..faces.len()).filter(|&i| known(i)).count();
            }
        }
        assert!(few > 5_000, "{few}");
    }

    #[test]
    fn a_grid_of_small_triangles_covers_every_pixel_once() {
        let camera = Camera::new(DMat3::IDENTITY, DMat3::IDENTITY, DVec3::ZERO, 100, 80).unwrap();
        let mut random = Random(3);
        for (step, jitter) in [(0.5, 0.0), (0.7, 0.0), (1.3, 0.6), (2.0, 0.9), (0.35, 0.17)] {
            let columns = (104.0 / step) as u32;
            let rows = (84.0 / step) as u32;
            let mut points = Vec::new();
            for y in 0..=rows {
                for x in 0..=columns {
                    // Every few corners on a pixel's centre.
                    let on = (x + y) % 5 == 0;
                    let at = |v: u32, random: &mut Random| {
                        let v = f64::from(v) * step - 2.0;
                        if jitter == 0.0 && on {
                            return v;
                        }
                        v + jitter * (random.next() - 0.5)
                    };
                    let (x, y) = (at(x, &mut random), at(y, &mut random));
                    let z = random.between(0.5, 2.0);
                    points.push(DVec3::new(x * z, y * z, z));
                }
            }
            let mut faces = Vec::new();
            for y in 0..rows {
                for x in 0..columns {
                    let v = y * (columns + 1) + x;
                    let (right, below) = (v + 1, v + columns + 1);
                    faces.extend([[v, right, below], [right, below + 1, below]]);
                }
            }
            let make = |_: Tile| Pixelwise::<true>(Vec::new());
            let control = Control::default();
            let tiles = rasterize_projected(&points, &faces, |_| true, &camera, &control, make);
            let all = tiles.unwrap().into_iter().flat_map(|(_, s)| s.0);
            let mut pixels: Vec<_> = all.map(|p| (p.1, p.2)).collect();
            pixels.sort_unstable();
            let every = (0..80).flat_map(|y| (0..100).map(move |x| (y, x)));
            assert!(pixels.into_iter().eq(every), "step {step}");
        }
    }
}
