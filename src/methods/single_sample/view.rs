//! How one receiver sees a light: what turns a point into its place on the light.
//!
//! Projected from the receiver `o` onto the light's plane (through its centre; for a sphere across the
//! shadow ray), a point `p` lies at `x = p / W - l`, `W = m · p / m · l`, with `l` the light's centre and
//! `m` the plane's normal, all from `o`. `W` is the fraction of the way to the light, 0 at the receiver, 1
//! at the light. The outer limit of the penumbra is the light at twice its size, so `x` is measured in
//! those: a parallelogram with edges `u`, `v` by `max(|u* · x|, |v* · x|)` (dual vectors), a disk or sphere
//! of diameter `D` by `|x| / D`. All of it is linear before the division: `X = W u* · x = a · p` and the
//! like, with `a · l = 0`.
//!
//! Heights over the receiver's tangent plane are measured the same way: `n · p / W` over the light's width
//! `w` along `n`, so that the light, where it is above the plane, spans heights `n · l / w ± 1/2`.

use glam::{DVec3, Vec3};

use crate::frame::POINT_OFFSET;
use crate::light::{DiskLight, Light, RectLight, Shape, SphereLight};

/// Height over the tangent plane, in widths of the light, up to which it is left to `h` what hides the
/// light, with what rises so high fading in.
///
/// What rises less can hide no more than such a strip of the light (20 % of a disk at its rim, 31 % at the
/// middle), but would, like all small things, count fully here: the facets of a round wall would darken
/// it under a low light. Measured where the light is low (six scenes), against a sixteenth: errors a
/// third to a half smaller, and nowhere more than 0.3 too light; with a half they grow again under
/// large lights. It is also far above what `f32` coordinates make of a flat floor of small triangles.
pub(super) const STRIP: f64 = 1.0 / 4.0;

/// What is nearer to a receiver than this, times its largest coordinate or 1, is not looked at: `f32`
/// coordinates leave its direction uncertain by a hundredth or more.
pub(super) const NEAREST: f64 = 16.0 * POINT_OFFSET;

/// A light's shape, ready for views.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct DoubledLight {
    /// Where shadow rays go.
    target: DVec3,
    pub(super) kind: DoubledOutline,
    /// Largest distance of a point on the doubled light from its centre.
    pub(super) reach: f64,
}

/// What a light's shape is once it is doubled, for each shape.
#[derive(Debug, Clone, Copy)]
pub(super) enum DoubledOutline {
    /// Edges, their dual vectors and the normal away from the lit side.
    Rect([DVec3; 2], [DVec3; 2], DVec3),
    /// Normal away from the lit side, two unit vectors across and the diameter.
    Disk(DVec3, [DVec3; 2], f64),
    /// Diameter.
    Sphere(f64),
}

impl Default for DoubledOutline {
    fn default() -> Self {
        DoubledOutline::Sphere(0.0)
    }
}

impl DoubledLight {
    /// The shape of a local light that is not a point, or the rectangle that stands in for a polygon; `target` is where
    /// shadow rays to its centre end.
    pub(super) fn new(light: &Light, target: Vec3) -> Self {
        let target = target.as_dvec3();
        let rect = |&RectLight { u, v, .. }: &RectLight| {
            let across = u.cross(v);
            let (du, dv) = (v.cross(across), across.cross(u));
            let duals = [du / u.dot(du), dv / v.dot(dv)];
            DoubledLight {
                target,
                kind: DoubledOutline::Rect([u, v], duals, -across.normalize()),
                reach: u.length() + v.length(),
            }
        };
        match &light.shape {
            Shape::Rect(light) => rect(light),
            Shape::Polygon(polygon) => rect(&polygon.stand_in()),
            &Shape::Disk(DiskLight { normal, radius, .. }) => {
                let (e, f) = normal.any_orthonormal_pair();
                DoubledLight {
                    target,
                    kind: DoubledOutline::Disk(-normal, [e, f], 2.0 * radius),
                    reach: 2.0 * radius,
                }
            }
            &Shape::Sphere(SphereLight { radius, .. }) => DoubledLight {
                target,
                kind: DoubledOutline::Sphere(2.0 * radius),
                reach: 2.0 * radius,
            },
            Shape::Distant(distant) => {
                let diameter = 2.0 * distant.stand_in().radius;
                DoubledLight {
                    target,
                    kind: DoubledOutline::Sphere(diameter),
                    reach: diameter,
                }
            }
        }
    }

    /// Where shadow rays go.
    pub(super) fn target(&self) -> Vec3 {
        self.target.as_vec3()
    }

    /// Whether places are measured by the larger of two coordinates, not by their length.
    pub(super) fn is_rect(&self) -> bool {
        matches!(self.kind, DoubledOutline::Rect(..))
    }
}

/// A receiver's view of a light.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ReceiverView {
    /// Start of the shadow ray.
    pub(super) origin: Vec3,
    /// End of the shadow ray: the light's centre, or the nearest place on the light's plane that is
    /// [`STRIP`] above the tangent plane.
    pub(super) target: Vec3,
    /// The shadow ray, from start to end.
    pub(super) ray: DVec3,
    /// The functionals of `X`, `Y` and `W`.
    pub(super) x: DVec3,
    pub(super) y: DVec3,
    pub(super) w: DVec3,
    /// Least `W` of what is looked at.
    pub(super) nearest: f64,
    /// The receiver's normal, zero without a tangent plane.
    pub(super) normal: DVec3,
    /// Height of a light's width along the normal.
    pub(super) width: f64,
    /// Whether something around the ray may be under the strip over the tangent plane.
    pub(super) low: bool,
    /// Half size of the doubled light along the axes.
    pub(super) spread: DVec3,
    /// Whether the light has an extent from here: a flat one seen edge-on, to rounding, has none.
    pub(super) soft: bool,
    /// Whether the light is a parallelogram.
    pub(super) rect: bool,
    /// Whether the light has a back that nothing behind it can hide.
    pub(super) flat: bool,
}

impl ReceiverView {
    /// The view from a receiver with this start of its rays and this normal.
    pub(super) fn new(doubled: &DoubledLight, origin: Vec3, normal: DVec3) -> Self {
        let o = origin.as_dvec3();
        let mut l = doubled.target - o;
        let length = l.length();
        let plane = match doubled.kind {
            DoubledOutline::Rect(_, _, m) | DoubledOutline::Disk(m, _, _) => m,
            DoubledOutline::Sphere(_) if length > 0.0 => l / length,
            DoubledOutline::Sphere(_) => DVec3::ZERO,
        };
        let depth = plane.dot(l);
        let mut view = ReceiverView {
            origin,
            target: doubled.target.as_vec3(),
            ray: l,
            normal,
            rect: doubled.is_rect(),
            ..ReceiverView::default()
        };
        // Below an ulp of the distance the coordinates cannot tell how the light is seen.
        if depth <= f64::from(f32::EPSILON) * length {
            return view;
        }
        view.soft = true;
        view.flat = !matches!(doubled.kind, DoubledOutline::Sphere(_));
        let in_plane = normal - normal.dot(plane) * plane;
        // The doubled light's size along the axes and the normal, and what moves a place up the normal
        // within the light's plane.
        let (up, width) = match doubled.kind {
            DoubledOutline::Rect([u, v], ..) => {
                view.spread = u.abs() + v.abs();
                let (nu, nv) = (normal.dot(u), normal.dot(v));
                (u * nu + v * nv, nu.abs() + nv.abs())
            }
            DoubledOutline::Disk(_, _, diameter) | DoubledOutline::Sphere(diameter) => {
                let across = (DVec3::ONE - plane * plane).max(DVec3::ZERO);
                view.spread = diameter * across.map(f64::sqrt);
                (in_plane, diameter * in_plane.length())
            }
        };
        view.width = width;
        let height = normal.dot(l);
        if normal != DVec3::ZERO {
            view.low = height < (1.0 + STRIP) * width;
            let lift = STRIP * width - height;
            let per_up = normal.dot(up);
            if lift > 0.0 && per_up > 0.0 {
                l += up * (lift / per_up);
                view.target = (o + l).as_vec3();
            }
        }
        // The ray that is traced, so that places are measured from it.
        l = view.target.as_dvec3() - o;
        view.ray = l;
        view.w = plane / plane.dot(l);
        view.nearest = NEAREST * o.abs().max_element().max(1.0) / l.length();
        let place = |dual: DVec3| dual - dual.dot(l) * view.w;
        (view.x, view.y) = match doubled.kind {
            DoubledOutline::Rect(_, [u, v], _) => (place(u), place(v)),
            DoubledOutline::Disk(_, [e, f], diameter) => (place(e / diameter), place(f / diameter)),
            DoubledOutline::Sphere(diameter) => {
                let (e, f) = plane.any_orthonormal_pair();
                (place(e / diameter), place(f / diameter))
            }
        };
        view
    }

    /// Distance of a place from the shadow ray: 1 on the outer limit.
    pub(super) fn distance(&self, x: f64, y: f64) -> f64 {
        if self.rect {
            x.abs().max(y.abs())
        } else {
            (x * x + y * y).sqrt()
        }
    }

    /// `tau` of what rises to `height` only, in widths of the light.
    pub(super) fn faded(tau: f64, height: f64) -> f64 {
        let part = (height / STRIP).clamp(0.0, 1.0);
        let counts = part * part * (3.0 - 2.0 * part);
        tau + (1.0 - tau).max(0.0) * (1.0 - counts)
    }
}
