//! Shadow rays against analytic spheres, as the paper's appendix has them.
//!
//! `t0 = c · v` is where the ray passes the sphere's centre `c` (from the receiver), `d` how far from it.
//! The nearest point of the sphere lies at `t0` and `d - R` off the ray, and its place on the light is `tau`:
//! for a spherical light `(d - R) / b` with `b = D t0 / L`, the paper's numbers. Beside the paper:
//! - a sphere whose middle is beyond the light (`t0 > L`) counts with its cut by the plane across the ray at
//!   the light, so that one that leaves past the light does so smoothly;
//! - a sphere around the receiver hides what the ray crosses, and nothing else;
//! - one that lies under the tangent plane of the receiver does not count, and one that hardly rises above
//!   it hardly does.

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::DVec3;

use super::found::Found;
use super::lanes::ReceiverViews;
use super::view::ReceiverView;
use crate::bvh::SphereBvh;
use crate::bvh::crossing::sphere_crossings;
use crate::bvh::grown::{Leaves, traverse};
use crate::bvh::packet::Stack;
use crate::geometry::Sphere;
use crate::simd::{Lanes, Level, Row};

/// Numbers of spheres as parts have this bit, which those of triangles and objects have not: they are
/// below a quarter of 2³².
const SPHERE: u32 = 1 << 31;

/// Slack of the test in `f32` before the one in `f64`: distances are off by few ulps of local sizes.
const SLACK: f32 = 32.0 / (1 << 24) as f32;

/// Which of the rays in `active` spheres block; the distances of the others go into `found`.
pub(super) fn search(
    level: Level,
    bvh: &SphereBvh,
    views: &ReceiverViews,
    active: u16,
    found: &mut Found,
    stack: &mut Stack,
) -> u16 {
    dispatch!(level, simd => all(simd, bvh, views, active, found, stack))
}

#[inline(always)]
fn all<S: Simd>(
    simd: S,
    bvh: &SphereBvh,
    views: &ReceiverViews,
    active: u16,
    found: &mut Found,
    stack: &mut Stack,
) -> u16 {
    let packet = &views.packet;
    let load = |rows: &[Row; 3]| [rows[0].load(simd), rows[1].load(simd), rows[2].load(simd)];
    let (origin, mut ray) = (load(packet.origins()), load(packet.targets()));
    for k in 0..3 {
        ray[k] -= origin[k];
    }
    let square = ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2];
    let mut leaves = Spheres {
        bvh,
        views,
        origin,
        ray,
        inverse: 1.0 / square.greater(f32::MIN_POSITIVE),
        reach: views.reach(),
        found,
        blocked: 0,
    };
    leaves.found.restart();
    traverse::<S, _>(
        simd,
        &bvh.tree,
        packet,
        &views.spread,
        &mut leaves,
        active,
        stack,
    );
    leaves.blocked
}

struct Spheres<'a, S: Simd> {
    bvh: &'a SphereBvh,
    views: &'a ReceiverViews,
    origin: [f32x16<S>; 3],
    ray: [f32x16<S>; 3],
    /// One over the rays' squared lengths.
    inverse: f32x16<S>,
    /// How far the doubled light reaches from its centre.
    reach: f32,
    found: &'a mut Found,
    blocked: u16,
}

impl<S: Simd> Leaves for Spheres<'_, S> {
    #[inline(always)]
    fn visit(&mut self, first: usize, last: usize, mut active: u16) -> u16 {
        for k in first..last {
            let sphere = &self.bvh.spheres[k];
            let mut near = self.near(sphere) & active;
            while near != 0 {
                let lane = near.trailing_zeros() as usize;
                near &= near - 1;
                let packet = &self.views.packet;
                let (from, to) = (
                    packet.origin(lane).as_dvec3(),
                    packet.target(lane).as_dvec3(),
                );
                if sphere_crossings(sphere, from, to) > 0 {
                    self.blocked |= 1 << lane;
                    active &= !(1 << lane);
                    if active == 0 {
                        return 0;
                    }
                } else if self.views.soft >> lane & 1 == 1 {
                    let view = self.views.view(lane);
                    let tau = view.sphere(sphere.center - from, sphere.radius);
                    self.found.add(lane, SPHERE | k as u32, tau as f32);
                }
            }
        }
        active
    }

    fn narrowed(&mut self) -> Option<&Row> {
        self.found.narrowed()
    }
}

impl<S: Simd> Spheres<'_, S> {
    /// Rays around which the sphere may lie within the limit: those that pass it by no more than the
    /// cone's radius where they leave it.
    #[inline(always)]
    fn near(&self, sphere: &Sphere) -> u16 {
        let simd = self.inverse.simd;
        let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
        let center = sphere.center.as_vec3();
        let radius = sphere.radius as f32;
        let [mut q, d] = [[zero; 3], self.ray];
        for k in 0..3 {
            q[k] = center[k] - self.origin[k];
        }
        let along = q[0] * d[0] + q[1] * d[1] + q[2] * d[2];
        let t = (along * self.inverse).greater(zero).lesser(one);
        let mut square = zero;
        for k in 0..3 {
            let off = q[k] - t * d[k];
            square += off * off;
        }
        let wide = self.reach * self.found.limit().load(simd);
        let slack = SLACK * (2.0 + radius) + 1e-5 * wide;
        let leaves = (radius + wide) * self.inverse.sqrt();
        let most = radius + wide * (t + leaves).lesser(one) + slack;
        square.le(most * most)
    }
}

impl ReceiverView {
    /// The distance from the ray of a sphere around `c` (from the receiver), which the ray does not cross;
    /// at least 1 where it does not count.
    pub(super) fn sphere(&self, c: DVec3, radius: f64) -> f64 {
        let miss = f64::INFINITY;
        let tangent = self.normal != DVec3::ZERO;
        if c.length_squared() < radius * radius || (tangent && self.normal.dot(c) <= -radius) {
            return miss;
        }
        let length = self.ray.length();
        let v = self.ray / length;
        let t0 = c.dot(v);
        if t0 <= 0.0 {
            return miss;
        }
        let off = c - v * t0;
        let d = off.length();
        let (t, r) = if t0 > length {
            let beyond = t0 - length;
            let square = radius * radius - beyond * beyond;
            if square <= 0.0 {
                return miss;
            }
            (length, square.sqrt())
        } else {
            (t0, radius)
        };
        let tau = if d <= r {
            0.0
        } else {
            let p = v * t + off * (1.0 - r / d);
            let w = self.w.dot(p);
            if w <= 0.0 || (self.flat && w > 1.0) {
                return miss;
            }
            self.distance(self.x.dot(p) / w, self.y.dot(p) / w)
        };
        if tau < 1.0 && self.low {
            ReceiverView::faded(tau, self.top(c, radius) / self.width)
        } else {
            tau
        }
    }

    /// How high a sphere rises over the tangent plane, projected onto the light: the largest `n · p / W`.
    ///
    /// The plane `(n - k w) · p = 0` touches the sphere where `(n·c - k w·c)² = R² |n - k w|²`.
    fn top(&self, c: DVec3, radius: f64) -> f64 {
        let (n, w, square) = (self.normal, self.w, radius * radius);
        let (nc, wc) = (n.dot(c), w.dot(c));
        let a = wc * wc - square * w.length_squared();
        if a <= 0.0 || wc <= 0.0 {
            // It reaches beside the receiver, and as high as one likes.
            return f64::INFINITY;
        }
        let b = nc * wc - square * n.dot(w);
        let root = b * b - a * (nc * nc - square * n.length_squared());
        (b + root.max(0.0).sqrt()) / a
    }
}
