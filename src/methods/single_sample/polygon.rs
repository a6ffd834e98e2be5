//! The distance of one triangle from one shadow ray, in `f64`, clipped where it matters.
//!
//! For triangles that reach behind the receiver, beyond the light or under the strip over the tangent
//! plane; all others are measured sixteen rays at a time in [`super::triangles`].

use glam::{DVec4, Vec3};

use super::view::{ReceiverView, STRIP};

/// A triangle cut by seven planes has at most ten corners.
const MOST: usize = 10;

/// A convex polygon of homogeneous places `(X, Y, W, n · p)`.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [DVec4; MOST],
    count: usize,
}

impl Polygon {
    fn corners(&self) -> &[DVec4] {
        &self.corners[..self.count]
    }

    /// The part where `side · corner + offset >= 0`.
    fn cut(&self, side: DVec4, offset: f64) -> Polygon {
        let mut out = Polygon {
            corners: [DVec4::ZERO; MOST],
            count: 0,
        };
        let mut push = |c: DVec4| {
            if out.count < MOST {
                out.corners[out.count] = c;
                out.count += 1;
            }
        };
        for i in 0..self.count {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % self.count]);
            let (ha, hb) = (side.dot(a) + offset, side.dot(b) + offset);
            if ha >= 0.0 {
                push(a);
            }
            if (ha > 0.0 && hb < 0.0) || (ha < 0.0 && hb > 0.0) {
                push(a + (b - a) * (ha / (ha - hb)));
            }
        }
        out
    }

    /// Smallest distance from the ray.
    fn distance(&self, view: &ReceiverView) -> f64 {
        let mut least = f64::INFINITY;
        let place = |c: DVec4| (c.x / c.z, c.y / c.z);
        for (i, &a) in self.corners().iter().enumerate() {
            let b = self.corners[(i + 1) % self.count];
            if a.z <= 0.0 || b.z <= 0.0 {
                continue;
            }
            let ((ax, ay), (bx, by)) = (place(a), place(b));
            let (ex, ey) = (bx - ax, by - ay);
            let square = ex * ex + ey * ey;
            let mut t = 0.0;
            if square > 0.0 {
                // The nearest place of the line, which moving along only leaves.
                let (mut px, mut py) = (0.0, 0.0);
                if view.rect {
                    let offset = (ey * ax - ex * ay) / (ex.abs() + ey.abs());
                    px = offset.copysign(offset * ey);
                    py = offset.copysign(-offset * ex);
                }
                t = (((px - ax) * ex + (py - ay) * ey) / square).clamp(0.0, 1.0);
            }
            let found = view.distance(ax + t * ex, ay + t * ey);
            least = least.min(found);
        }
        least
    }
}

impl ReceiverView {
    /// The distance of a triangle from the ray, at least 1 where it does not count; `limit` is the largest
    /// that is asked for.
    pub(super) fn triangle(&self, corners: &[Vec3; 3], limit: f64) -> f64 {
        let o = self.origin.as_dvec3();
        let mut polygon = Polygon {
            corners: [DVec4::ZERO; MOST],
            count: 3,
        };
        for (out, &c) in polygon.corners.iter_mut().zip(corners) {
            let p = c.as_dvec3() - o;
            *out = DVec4::new(
                self.x.dot(p),
                self.y.dot(p),
                self.w.dot(p),
                self.normal.dot(p),
            );
        }
        let cone = [
            DVec4::new(1.0, 0.0, limit, 0.0),
            DVec4::new(-1.0, 0.0, limit, 0.0),
            DVec4::new(0.0, 1.0, limit, 0.0),
            DVec4::new(0.0, -1.0, limit, 0.0),
        ];
        for side in cone {
            polygon = polygon.cut(side, 0.0);
        }
        polygon = polygon.cut(DVec4::new(0.0, 0.0, -1.0, 0.0), 1.0);
        polygon = polygon.cut(DVec4::new(0.0, 0.0, 1.0, 0.0), -self.nearest);
        if polygon.count == 0 || !self.low {
            return polygon.distance(self);
        }
        let above = polygon.cut(DVec4::new(0.0, 0.0, -STRIP * self.width, 1.0), 0.0);
        if above.count > 0 {
            return above.distance(self);
        }
        // All in the strip: its highest corner, so that what rises out of the strip does so smoothly.
        let highest = |c: &&DVec4| c.w / c.z;
        let top = polygon
            .corners()
            .iter()
            .filter(|c| c.z > 0.0)
            .max_by(|a, b| highest(a).total_cmp(&highest(b)));
        top.map_or(f64::INFINITY, |c| {
            let tau = self.distance(c.x / c.z, c.y / c.z);
            ReceiverView::faded(tau, c.w / c.z / self.width)
        })
    }
}
