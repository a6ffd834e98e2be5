//! From a triangle to edge functions and a depth plane in the image.
//!
//! An edge function is evaluated from the edge's lexicographically lower end, in `f64`, whichever way
//! the triangle runs through it: two triangles at an edge see the same number with opposite signs. Where
//! its sign could be rounding it is found exactly, so that the edges of slivers do not contradict each
//! other. Where it is exactly zero, the pixel's centre is moved by an infinitesimal (ε, ε²), which does what a
//! top-left rule does. The near plane, [`NEAR`] of the scene's size in front of the eye, cuts edges at
//! a point that depends on the edge alone.

use glam::DVec3;

use super::SPAN;
use crate::camera::Camera;
use crate::simd::Lanes;

/// Distance of the near plane in local units, in which the scene's half-extent is between ½ and 1:
/// far below what can be seen, far above the `f64` rounding of a projected point.
pub const NEAR: f64 = 1e-7;

/// Just below zero: `e > JUST_BELOW` is `e >= 0`.
const JUST_BELOW: f64 = -f64::MIN_POSITIVE;

/// Below this part of its two terms an edge function's sign may be rounding, and is found exactly.
const DOUBT: f64 = 8.0 * f64::EPSILON;

#[derive(Debug, Clone, Copy)]
struct EdgeFunction {
    x: f64,
    y: f64,
    dx: f64,
    dy: f64,
    /// The other end, and -1 where the triangle runs from there.
    to: [f64; 2],
    sign: f64,
    /// Inside where the function is greater.
    above: f64,
}

/// A triangle in the image, ready to be filled.
#[derive(Debug, Clone, Copy)]
pub struct Setup {
    edges: [EdgeFunction; 3],
    /// Inverse depth at `(x, y)` is `depth · (x, y, 1)`.
    depth: DVec3,
    range: [f64; 2],
    /// First column and row whose centres can be inside.
    pub low: [u32; 2],
    /// Last column and row.
    pub high: [u32; 2],
    /// Index of the triangle.
    pub triangle: u32,
}

/// One row of a [`Setup`].
pub struct RowSetup<'a> {
    setup: &'a Setup,
    terms: [f64; 3],
    cy: f64,
    depth: f64,
}

impl Setup {
    /// Prepares a row of pixels.
    #[inline(always)]
    pub fn row(&self, y: u32) -> RowSetup<'_> {
        let cy = f64::from(y) + 0.5;
        RowSetup {
            setup: self,
            terms: std::array::from_fn(|i| self.edges[i].dx * (cy - self.edges[i].y)),
            cy,
            depth: self.depth.y * cy + self.depth.z,
        }
    }
}

impl RowSetup<'_> {
    /// Which of the pixels from column `x` on are inside.
    ///
    /// # Safety
    /// As for every function of [`Lanes`].
    #[inline(always)]
    pub unsafe fn inside<S: Lanes>(&self, x: u32) -> u8 {
        // Smallest edge function, and smallest distance of one from what could be rounding.
        let (mut inside, mut clear) = ([f64::INFINITY; SPAN], [f64::INFINITY; SPAN]);
        for (e, &term) in self.setup.edges.iter().zip(&self.terms) {
            for i in 0..SPAN {
                let other = e.dy * (f64::from(x + i as u32) + 0.5 - e.x);
                let value = term - other;
                inside[i] = inside[i].min(value - e.above);
                clear[i] = clear[i].min(value.abs() - DOUBT * (term.abs() + other.abs()));
            }
        }
        // SAFETY: the caller enabled the features of `S`.
        let (inside, clear) = unsafe { (S::positive(&inside), S::positive(&clear)) };
        if clear == u8::MAX {
            inside
        } else {
            self.inside_exact(x)
        }
    }

    #[cold]
    fn inside_exact(&self, x: u32) -> u8 {
        (0..SPAN).fold(0, |mask, i| {
            let p = [f64::from(x + i as u32) + 0.5, self.cy];
            let inside = self.setup.edges.iter().all(|e| {
                let c = |p: [f64; 2]| robust::Coord { x: p[0], y: p[1] };
                let value = e.sign * robust::orient2d(c([e.x, e.y]), c(e.to), c(p));
                value > e.above
            });
            mask | u8::from(inside) << i
        })
    }

    /// Inverse depths of the pixels from column `x` on; kept within the triangle's own range, which
    /// only matters for slivers.
    #[inline(always)]
    pub fn inverse_depth(&self, x: u32) -> [f64; SPAN] {
        let s = self.setup;
        std::array::from_fn(|i| {
            let cx = f64::from(x + i as u32) + 0.5;
            (self.depth + s.depth.x * cx).clamp(s.range[0], s.range[1])
        })
    }
}

/// Clips a triangle at the near plane and passes on what can cover a pixel's centre.
pub fn triangles(
    face: &[u32; 3],
    points: &[DVec3],
    triangle: u32,
    camera: &Camera,
    emit: &mut impl FnMut(Setup),
) {
    let corners = face.map(|v| points[v as usize]);
    // The triangle's plane n·(x z, y z, z) = d gives 1/z = n·(x, y, 1) / d; from the whole triangle, since
    // what the near plane leaves of it may have corners millions of pixels away.
    let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let depth = n / n.dot(corners[0]);
    let depth = if depth.is_finite() {
        depth
    } else {
        DVec3::new(0.0, 0.0, 1.0 / corners[0].z)
    };
    let in_front = corners.map(|p| p.z >= NEAR);
    match in_front.iter().filter(|f| **f).count() {
        0 => {}
        3 => emit_one(corners, depth, triangle, camera, emit),
        _ => {
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
            emit_one(
                [polygon[0], polygon[1], polygon[2]],
                depth,
                triangle,
                camera,
                emit,
            );
            if n == 4 {
                emit_one(
                    [polygon[0], polygon[2], polygon[3]],
                    depth,
                    triangle,
                    camera,
                    emit,
                );
            }
        }
    }
}

fn emit_one(
    corners: [DVec3; 3],
    depth: DVec3,
    triangle: u32,
    camera: &Camera,
    emit: &mut impl FnMut(Setup),
) {
    let mut s = corners.map(|p| [p.x / p.z, p.y / p.z, 1.0 / p.z]);
    let (mut low, mut high) = ([0u32; 2], [0u32; 2]);
    for (axis, size) in [camera.width, camera.height].into_iter().enumerate() {
        let min = s[0][axis].min(s[1][axis]).min(s[2][axis]);
        let max = s[0][axis].max(s[1][axis]).max(s[2][axis]);
        // Pixel centres within [min, max]. (What is not a number has no area, below.)
        let first = (min - 0.5).ceil().max(0.0);
        let last = (max - 0.5).floor().min(f64::from(size - 1));
        if !(first <= last && min <= max) {
            return;
        }
        (low[axis], high[axis]) = (first as u32, last as u32);
    }
    let c = |p: &[f64; 3]| robust::Coord { x: p[0], y: p[1] };
    let area = robust::orient2d(c(&s[0]), c(&s[1]), c(&s[2]));
    if area == 0.0 || !area.is_finite() {
        return;
    }
    if area < 0.0 {
        s.swap(1, 2);
    }
    let edges = [edge(&s[0], &s[1]), edge(&s[1], &s[2]), edge(&s[2], &s[0])];
    let range = [
        s[0][2].min(s[1][2]).min(s[2][2]),
        s[0][2].max(s[1][2]).max(s[2][2]),
    ];
    emit(Setup {
        edges,
        depth,
        range,
        low,
        high,
        triangle,
    });
}

/// Positive on the inner side of the edge from `a` to `b` of a triangle with positive area.
fn edge(a: &[f64; 3], b: &[f64; 3]) -> EdgeFunction {
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
