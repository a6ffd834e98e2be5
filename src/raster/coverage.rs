//! The pixels that triangles cover, row by row and without depth: for flattened shadows, which are drawn
//! hundreds of times a texture.
//!
//! The same pixels as [`super::rasterize`] finds, from the same edge functions. Where a row's pixel is
//! farther from all edges than rounding can be wrong by, it is inside or outside without being looked at;
//! the others, a few in a million, are decided by the edge functions. One thread draws an image: callers
//! have many to draw at once.

use glam::DVec3;

use super::setup::{self, Bounds, EdgeFunction, NEAR};
use crate::camera::Camera;

/// A point with its place in the image.
#[derive(Debug, Clone, Copy)]
pub struct Projected {
    /// As [`Camera::project`] gives it.
    point: DVec3,
    /// In pixels; nothing where the point is behind the near plane.
    screen: [f64; 2],
    bounds: Bounds,
}

impl Projected {
    /// Projects a point.
    #[inline(always)]
    pub fn new(p: DVec3, camera: &Camera) -> Self {
        let point = camera.project(p);
        if point.z >= NEAR {
            let screen = [point.x / point.z, point.y / point.z];
            let bounds = Bounds::of_point(screen, camera);
            return Projected {
                point,
                screen,
                bounds,
            };
        }
        Projected {
            point,
            screen: [0.0; 2],
            bounds: Bounds::BEHIND,
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
    let [a, b, c] = face.map(|v| &points[v as usize]);
    if a.point.z >= NEAR && b.point.z >= NEAR && c.point.z >= NEAR {
        let Some((low, high)) = a.bounds.and(b.bounds).and(c.bounds).pixels() else {
            return;
        };
        if let Some(edges) = setup::edges(&mut [a.screen, b.screen, c.screen]) {
            spans(&edges, low, high, span);
        }
    } else {
        let corners = [a.point, b.point, c.point];
        for setup in setup::clipped_corners(face, &corners, camera)
            .iter()
            .flatten()
        {
            spans(&setup.edges, setup.low, setup.high, &mut span);
        }
    }
}

/// What an edge does to a row.
#[derive(Clone, Copy)]
enum Side {
    /// It bounds the pixels inside from the right.
    Right,
    /// It bounds them from the left.
    Left,
    /// It runs along the row.
    Level,
    /// Every pixel has to be looked at.
    Unclear,
}

/// Rows of the pixels inside three edges, between `low` and `high`.
#[inline(always)]
fn spans(
    edges: &[EdgeFunction; 3],
    low: [u32; 2],
    high: [u32; 2],
    mut span: impl FnMut(u32, u32, u32),
) {
    let crossings = edges.each_ref().map(|e| {
        let (first, slope, margin) = e.crossing();
        let side = if e.dy == 0.0 {
            Side::Level
        } else if !(first.is_finite() && slope.is_finite() && margin.is_finite()) {
            Side::Unclear
        } else if e.dy > 0.0 {
            Side::Right
        } else {
            Side::Left
        };
        (first, slope, margin, side)
    });
    'rows: for y in low[1]..=high[1] {
        let row = f64::from(y);
        // Beyond the outer bounds nothing is inside, within the inner ones everything.
        let (mut left, mut right) = (f64::from(low[0]), f64::from(high[0]));
        let (mut inner_left, mut inner_right) = (left, right);
        for (e, &(first, slope, margin, side)) in edges.iter().zip(&crossings) {
            let x = first + slope * row;
            match side {
                Side::Right => {
                    right = right.min(x + margin);
                    inner_right = inner_right.min(x - margin);
                }
                Side::Left => {
                    left = left.max(x - margin);
                    inner_left = inner_left.max(x + margin);
                }
                Side::Level => {
                    if e.dx * (row + 0.5 - e.y) <= e.above {
                        continue 'rows;
                    }
                }
                Side::Unclear => inner_left = f64::INFINITY,
            }
        }
        if left > right {
            continue;
        }
        // `left` is not negative, and so neither is `right`.
        let (mut first, mut last) = (left as i64, right as i64);
        first += i64::from((first as f64) < left);
        let inside = |x: i64| {
            let p = [x as f64 + 0.5, row + 0.5];
            edges.iter().all(|e| e.contains(p))
        };
        while first <= last && (first as f64) < inner_left && !inside(first) {
            first += 1;
        }
        while last >= first && (last as f64) > inner_right && !inside(last) {
            last -= 1;
        }
        if first <= last {
            span(y, first as u32, last as u32);
        }
    }
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
            let (points, bounds): (Vec<_>, Vec<_>) = p
                .iter()
                .map(|&p| crate::raster::project(p, &camera))
                .unzip();
            let control = Control::default();
            let make = Nearest::new;
            let tiles = rasterize_projected(
                &points,
                &bounds,
                &[[0, 1, 2]],
                |_| true,
                &camera,
                &control,
                make,
            )
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
