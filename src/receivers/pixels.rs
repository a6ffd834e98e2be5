//! Where the rays through pixels meet the triangles that they hit, for many pixels at once.

use fearless_simd::dispatch;
use glam::{DVec3, Vec3};

use crate::camera::Camera;
use crate::simd::detect;

/// Most pixels at once: a block of 8×8.
pub(crate) const MOST: usize = 64;

type Column<T> = [T; MOST];

/// Pixels, what they hit, and the points found there; a column for every coordinate, so that the loop over
/// pixels becomes one over registers.
pub(crate) struct Pixels {
    x: Column<f64>,
    y: Column<f64>,
    depth: Column<f64>,
    corners: [[Column<f32>; 3]; 3],
    positions: [Column<f64>; 3],
    normals: [Column<f64>; 3],
}

impl Pixels {
    pub(crate) fn new() -> Self {
        Pixels {
            x: [0.0; MOST],
            y: [0.0; MOST],
            depth: [0.0; MOST],
            corners: [[[0.0; MOST]; 3]; 3],
            positions: [[0.0; MOST]; 3],
            normals: [[0.0; MOST]; 3],
        }
    }

    /// Sets pixel `i`: its column and row in the image, and how deep what it shows is.
    #[inline(always)]
    pub(crate) fn set(&mut self, i: usize, x: u32, y: u32, depth: f64) {
        (self.x[i], self.y[i]) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        self.depth[i] = depth;
    }

    /// Sets the triangle that pixel `i` shows.
    #[inline(always)]
    pub(crate) fn set_corners(&mut self, i: usize, corners: [Vec3; 3]) {
        for (columns, corner) in self.corners.iter_mut().zip(corners) {
            for (column, value) in columns.iter_mut().zip(corner.to_array()) {
                column[i] = value;
            }
        }
    }

    /// Sets the triangle that all pixels show.
    pub(crate) fn set_all_corners(&mut self, corners: [Vec3; 3]) {
        for (columns, corner) in self.corners.iter_mut().zip(corners) {
            for (column, value) in columns.iter_mut().zip(corner.to_array()) {
                column.fill(value);
            }
        }
    }

    /// Finds the points; those of pixels that were not set mean nothing.
    pub(crate) fn find(&mut self, camera: &Camera) {
        let pixels = self;
        dispatch!(detect(), _ => find_lanes(pixels, camera));
    }

    /// Position and normal of pixel `i`, once found.
    #[inline(always)]
    pub(crate) fn point(&self, i: usize) -> (DVec3, DVec3) {
        let at = |columns: &[Column<f64>; 3]| DVec3::from_array([0, 1, 2].map(|k| columns[k][i]));
        (at(&self.positions), at(&self.normals))
    }
}

/// Free of branches, for the compiler's vectoriser.
#[inline(always)]
fn find_lanes(pixels: &mut Pixels, camera: &Camera) {
    for i in 0..MOST {
        let d = camera.direction(pixels.x[i], pixels.y[i]);
        let corner = |k: usize| {
            let [x, y, z] = &pixels.corners[k];
            Vec3::new(x[i], y[i], z[i]).as_dvec3()
        };
        let corners = [corner(0), corner(1), corner(2)];
        let (p, n) = on_triangle(camera.eye, d, corners, pixels.depth[i]);
        for k in 0..3 {
            pixels.positions[k][i] = p[k];
            pixels.normals[k][i] = n[k];
        }
    }
}

/// Where the ray from `eye` along `d` meets a triangle, and the normal there, turned to the eye; `z` is the
/// rasteriser's depth.
#[inline(always)]
fn on_triangle(eye: DVec3, d: DVec3, [a, b, c]: [DVec3; 3], z: f64) -> (DVec3, DVec3) {
    // A triangle that covers a pixel's centre has an area; were its normal to underflow all the same, the
    // receiver has no tangent plane.
    let n = (b - a).cross(c - a).normalize_or_zero();
    let slope = n.dot(d);
    // On the triangle's plane; seen exactly edge-on, the rasteriser's depth has to do.
    let exact = n.dot(a - eye) / slope;
    let near = slope != 0.0 && (exact - z).abs() <= 1e-6 * z;
    let p = eye + d * if near { exact } else { z };
    (p, if slope > 0.0 { -n } else { n })
}
