//! Planar polygons, convex or not.
//!
//! A polygon is kept in the frame of its plane: its centroid, and two half axes across each other, the first along
//! its longest edge, that reach as far as the outline does on either side. Corners then lie in the square [-1, 1]²,
//! and moving or scaling a light leaves them as they are (`Outline`).
//!
//! What a plane cuts off is found by Sutherland and Hodgman's clipping. Of an outline with reflex corners it may leave
//! several parts, with an edge there and back along the plane between them; in sums with signs these cancel, so that
//! areas and Lambert's formula hold for any outline (tested against the sum over triangles).
//!
//! - `outline`: checks, and what is derived from an outline once;
//! - `strips`: an outline cut into trapezoids, and the map from the square onto them, equal in area.

mod outline;
pub(crate) mod strips;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::contour;
use super::{Light, RectLight, Shape, SphereLight};
use crate::error::Result;
pub use outline::MOST_CORNERS;
use outline::Outline;

/// A planar polygon that emits to the side from which its outline runs counter-clockwise.
#[derive(Debug, Clone, PartialEq)]
pub struct PolygonLight {
    /// Its centroid, which need not be on it.
    pub center: DVec3,
    /// Half axes; the outline's corners are `center + x u + y v`.
    pub u: DVec3,
    /// See `u`; `u × v` is the emitting side.
    pub v: DVec3,
    outline: Arc<Outline>,
}

impl Light {
    /// A planar polygon by its corners.
    ///
    /// # Errors
    /// Fewer than three corners or more than [`MOST_CORNERS`], a value that is not finite, corners out of one plane,
    /// an outline that meets itself, or one that spans no area.
    pub fn polygon(corners: &[DVec3], radiance: [f32; 3]) -> Result<Self> {
        let (center, [u, v], outline) = Outline::new(corners)?;
        let shape = Shape::Polygon(PolygonLight {
            center,
            u,
            v,
            outline: Arc::new(outline),
        });
        Ok(Light { shape, radiance })
    }
}

impl PolygonLight {
    /// Corners in the frame of the half axes, in [-1, 1]².
    pub fn corners(&self) -> &[DVec2] {
        &self.outline.corners
    }

    /// Its area.
    pub fn area(&self) -> f64 {
        self.outline.area * self.u.cross(self.v).length()
    }

    /// The rectangle along the half axes around the outline: middle and half edges.
    pub(crate) fn around(&self) -> (DVec3, DVec3, DVec3) {
        let (middle, half) = self.outline.strips.around;
        let center = self.center + middle.x * self.u + middle.y * self.v;
        (center, half.x * self.u, half.y * self.v)
    }

    /// Corners in the unit square that is the rectangle around the outline.
    pub(crate) fn in_square(&self) -> Vec<[f32; 2]> {
        let (middle, half) = self.outline.strips.around;
        let place = |c: &DVec2| ((*c - middle) / half * 0.5 + 0.5).as_vec2().to_array();
        self.corners().iter().map(place).collect()
    }

    /// The map from the square onto the light, equal in area; coordinates are those of [`PolygonLight::around`].
    pub(crate) fn strips(&self) -> &strips::Strips {
        &self.outline.strips
    }

    /// The rectangle with the polygon's centroid, area and principal axes, whose sides are as the square roots of the
    /// second moments: that of a rectangle is itself.
    pub fn stand_in(&self) -> RectLight {
        let [a, b] = self.outline.half_axes;
        let along = |e: DVec2| 2.0 * (e.x * self.u + e.y * self.v);
        RectLight {
            center: self.center,
            u: along(a),
            v: along(b),
        }
    }

    /// Corners of triangles that make up the polygon, counter-clockwise as it is. Corners on a line may be in none.
    pub fn triangles(&self) -> Vec<[u32; 3]> {
        let corners = self.corners();
        let mut found: Vec<u32> = Vec::new();
        let data = corners.iter().map(DVec2::to_array);
        earcut::Earcut::new().earcut(data, &[], &mut found);
        let (triangles, _) = found.as_chunks::<3>();
        let counter_clockwise = |&[i, j, k]: &[u32; 3]| {
            let [a, b, c] = [i, j, k].map(|i| corners[i as usize]);
            match (b - a).perp_dot(c - a) > 0.0 {
                true => [i, j, k],
                false => [i, k, j],
            }
        };
        triangles.iter().map(counter_clockwise).collect()
    }

    pub(super) fn mapped(
        &self,
        point: impl Fn(DVec3) -> DVec3,
        length: impl Fn(f64) -> f64,
    ) -> Shape {
        Shape::Polygon(PolygonLight {
            center: point(self.center),
            u: self.u.map(&length),
            v: self.v.map(&length),
            outline: self.outline.clone(),
        })
    }

    /// Those of the rectangle around it, which is the square that samplers lay their grids over: silhouettes are then
    /// known in all of the grid.
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let (center, u, v) = self.around();
        let half = u.abs() + v.abs();
        (center - half, center + half)
    }

    pub(super) fn normal(&self) -> Option<DVec3> {
        Some(self.u.cross(self.v).normalize())
    }

    pub(super) fn as_sphere(&self) -> Option<SphereLight> {
        None
    }

    pub(super) fn half_width(&self) -> f64 {
        self.u.length().max(self.v.length())
    }

    pub(super) fn reach(&self, axis: DVec3) -> f64 {
        let (x, y) = (axis.dot(self.u), axis.dot(self.v));
        let corners = self.corners().iter();
        corners.fold(0.0, |most, c| most.max((c.x * x + c.y * y).abs()))
    }

    pub(super) fn farthest(&self, direction: DVec3) -> DVec3 {
        let axis = DVec2::new(direction.dot(self.u), direction.dot(self.v));
        let corners = self.corners().iter();
        let far = corners.fold((f64::NEG_INFINITY, DVec2::ZERO), |far, &c| {
            let along = axis.dot(c);
            if along > far.0 { (along, c) } else { far }
        });
        self.center + far.1.x * self.u + far.1.y * self.v
    }

    pub(super) fn half_axes(&self, _: DVec3) -> (DVec3, DVec3, bool) {
        let RectLight { u, v, .. } = self.stand_in();
        (0.5 * u, 0.5 * v, false)
    }

    pub(super) fn emits_along(&self, d: DVec3) -> bool {
        self.u.cross(self.v).dot(d) < 0.0
    }

    pub(super) fn fraction_above(&self, d: DVec3, n: DVec3) -> f64 {
        let height = self.heights(d, n);
        if self.corners().iter().all(|&c| height(c) > 0.0) {
            return 1.0;
        }
        let mut twice = 0.0;
        self.each_edge_above(height, |a, b| twice += a.perp_dot(b));
        (0.5 * twice / self.outline.area).clamp(0.0, 1.0)
    }

    pub(super) fn irradiance(&self, d: DVec3, n: DVec3) -> f64 {
        let place = |c: DVec2| d + c.x * self.u + c.y * self.v;
        let mut sum = DVec3::ZERO;
        self.each_edge_above(self.heights(d, n), |a, b| {
            sum += contour::edge(place(a), place(b));
        });
        sum.dot(n).abs()
    }

    pub(super) fn slopes(&self, point: DVec3, _: f64, [kappa, mu]: [DVec3; 2]) -> Option<[f64; 2]> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for c in self.corners() {
            let corner = self.center + c.x * self.u + c.y * self.v - point;
            let (k, m) = (corner.dot(kappa), corner.dot(mu));
            if m <= 0.0 {
                return None;
            }
            (low, high) = (low.min(-k / m), high.max(-k / m));
        }
        Some([high, low])
    }

    /// Heights of points of the light over a tangent plane through the origin, its centroid at `d`.
    fn heights(&self, d: DVec3, n: DVec3) -> impl Fn(DVec2) -> f64 + Copy {
        let (x, y, at) = (n.dot(self.u), n.dot(self.v), n.dot(d));
        move |c: DVec2| at + c.x * x + c.y * y
    }

    /// Calls `each` with the edges, in the frame, of what has no negative height.
    ///
    /// A corner on the plane is kept, so that a cut adds a corner for every sign change only.
    fn each_edge_above(&self, height: impl Fn(DVec2) -> f64, mut each: impl FnMut(DVec2, DVec2)) {
        let (mut first, mut last) = (None, None);
        let mut add = |p: DVec2| {
            match last {
                Some(before) => each(before, p),
                None => first = Some(p),
            }
            last = Some(p);
        };
        let corners = self.corners();
        let next = corners.iter().cycle().skip(1);
        for (&a, &b) in corners.iter().zip(next) {
            let (above, beyond) = (height(a), height(b));
            if above >= 0.0 {
                add(a);
            }
            if (above > 0.0 && beyond < 0.0) || (above < 0.0 && beyond > 0.0) {
                add(a + (b - a) * (above / (above - beyond)));
            }
        }
        if let (Some(first), Some(last)) = (first, last) {
            each(last, first);
        }
    }
}
