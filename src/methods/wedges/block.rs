//! Sixteen receivers, and how each draws directions onto the light.

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::DVec3;

use super::edge::{AreaEdge, Split};
use super::polygon::FlatPolygon;
use crate::light::{DiskLight, Light, PolygonLight, RectLight, Shape, SphereLight};
use crate::simd::{LANES, Row, detect};

/// Sixteen receivers.
#[derive(Debug, Clone, Default)]
pub struct ReceiverBlock {
    /// Local positions by axes, as [`Split`] does.
    pub(super) position: [[Row; 2]; 3],
    /// Local positions, for the side of a plane that a receiver is on.
    exact: [[f64; LANES]; 3],
    /// The map from directions to homogeneous coordinates on the light, by rows.
    matrix: [[Row; 3]; 3],
    /// What the last row gives at the light's centre: silhouettes farther away do not occlude.
    pub(super) far: Row,
}

impl ReceiverBlock {
    /// Fills the lanes; what is left over repeats the first receiver.
    pub fn set(&mut self, frame: &LightFrame, receivers: &[DVec3]) {
        for lane in 0..LANES {
            let p = receivers[if lane < receivers.len() { lane } else { 0 }];
            for axis in 0..3 {
                self.exact[axis][lane] = p[axis];
            }
        }
        let block = self;
        dispatch!(detect(), simd => set_lanes(simd, block, frame));
    }

    /// Homogeneous coordinates on the light of directions.
    #[inline(always)]
    pub(super) fn draw<S: Simd>(&self, simd: S, [x, y, z]: [f32x16<S>; 3]) -> [f32x16<S>; 3] {
        let mut out = [x, y, z];
        for (out, [a, b, c]) in out.iter_mut().zip(&self.matrix) {
            let (a, b, c) = (a.load(simd), b.load(simd), c.load(simd));
            *out = a * x + b * y + c * z;
        }
        out
    }

    /// Receivers on the lit side of the plane through an edge and the light's centre, as the layers of
    /// volumes are counted.
    #[inline(always)]
    pub(super) fn lit(&self, edge: &AreaEdge) -> u16 {
        let [x, y, z] = &self.exact;
        let n = &edge.normal;
        let mut lit = 0;
        for i in 0..LANES {
            let value = n[0] * x[i] + n[1] * y[i] + n[2] * z[i] - edge.offset;
            lit |= u16::from(value >= 0.0) << i;
        }
        lit
    }
}

/// A light's own coordinates, in which it is the unit disk or the square [-1, 1]², or a polygon in the square.
#[derive(Debug, Clone)]
pub enum LightFrame {
    /// A sphere: a disk towards each receiver.
    Sphere {
        /// Centre.
        center: DVec3,
        /// Radius.
        radius: f64,
    },
    /// A disk, a rectangle or a polygon, by the dual basis of its half-axes.
    Flat {
        /// Centre.
        center: DVec3,
        /// The vector that gives a point's first coordinate.
        u: DVec3,
        /// The vector that gives its second.
        v: DVec3,
        /// The vector that gives its distance from the light's plane.
        n: DVec3,
        /// Whether it is a rectangle or a polygon.
        square: bool,
        /// The polygon.
        polygon: Option<FlatPolygon>,
    },
}

impl LightFrame {
    /// The light's own coordinates, for a light that has a width.
    pub fn new(light: &Light) -> Self {
        match &light.shape {
            &Shape::Sphere(SphereLight { center, radius }) => LightFrame::Sphere { center, radius },
            Shape::Distant(distant) => {
                let SphereLight { center, radius } = distant.stand_in();
                LightFrame::Sphere { center, radius }
            }
            &Shape::Disk(DiskLight {
                center,
                normal,
                radius,
            }) => {
                let e = normal.any_orthonormal_vector();
                LightFrame::Flat {
                    center,
                    u: e / radius,
                    v: normal.cross(e) / radius,
                    n: normal,
                    square: false,
                    polygon: None,
                }
            }
            &Shape::Rect(RectLight { center, u, v }) => {
                let n = u.cross(v);
                let area = n.length_squared();
                LightFrame::Flat {
                    center,
                    u: 2.0 * v.cross(n) / area,
                    v: 2.0 * n.cross(u) / area,
                    n: n / area.sqrt(),
                    square: true,
                    polygon: None,
                }
            }
            Shape::Polygon(polygon) => {
                let &PolygonLight { center, u, v, .. } = polygon;
                LightFrame::Flat {
                    center,
                    u: u / u.length_squared(),
                    v: v / v.length_squared(),
                    n: u.cross(v).normalize(),
                    square: true,
                    polygon: Some(FlatPolygon::new(polygon)),
                }
            }
        }
    }
}

/// Rows of the matrix from directions at `p` to homogeneous coordinates on a sphere's outline, and the last
/// coordinate beyond which geometry is behind the light.
#[inline(always)]
fn towards_sphere(center: DVec3, radius: f64, p: DVec3) -> ([DVec3; 3], f64) {
    let d = center - p;
    let distance = d.length();
    let axis = d / distance;
    let e = axis.any_orthonormal_vector();
    // Cotangent of the half-angle of the cone in which the light is seen; inside it, anything.
    let cot = (distance * distance - radius * radius).max(0.0).sqrt() / radius;
    ([e * cot, e.cross(axis) * cot, axis], distance)
}

/// Rows of the matrix from directions at `p` to homogeneous coordinates on a flat light.
#[inline(always)]
fn towards_flat(center: DVec3, u: DVec3, v: DVec3, n: DVec3, p: DVec3) -> [DVec3; 3] {
    let d = p - center;
    // The ray p + t w meets the light's plane at t = -(d·n) / (w·n).
    let (x, y, z) = (u.dot(d), v.dot(d), n.dot(d));
    [z * u - x * n, z * v - y * n, -n]
}

/// Fills all but the exact positions of a block from these.
#[inline(always)]
fn set_lanes<S: Simd>(simd: S, block: &mut ReceiverBlock, frame: &LightFrame) {
    let [x, y, z] = block.exact;
    let p = |lane: usize| DVec3::new(x[lane], y[lane], z[lane]);
    for lane in 0..LANES {
        Split::new([x[lane], y[lane], z[lane]]).store(lane, &mut block.position);
    }
    let put = |matrix: &mut [[Row; 3]; 3], lane: usize, rows: [DVec3; 3]| {
        for axis in 0..3 {
            for row in 0..3 {
                matrix[row][axis].0[lane] = rows[row][axis] as f32;
            }
        }
    };
    match *frame {
        LightFrame::Sphere { center, radius } => {
            for lane in 0..LANES {
                let (rows, far) = towards_sphere(center, radius, p(lane));
                put(&mut block.matrix, lane, rows);
                block.far.0[lane] = far as f32;
            }
        }
        LightFrame::Flat {
            center, u, v, n, ..
        } => {
            block.far.set(f32x16::splat(simd, f32::INFINITY));
            for lane in 0..LANES {
                put(
                    &mut block.matrix,
                    lane,
                    towards_flat(center, u, v, n, p(lane)),
                );
            }
        }
    }
}
