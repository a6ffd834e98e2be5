//! Views of sixteen receivers, as rows for the searches.
//!
//! The same numbers as in [`ReceiverView`], found in `f32` for sixteen receivers at once. That is enough: what they are
//! multiplied with is measured from the ray. A light that is low over a receiver's horizon is set up by [`ReceiverView`]
//! itself, and so is what a search wants in `f64`, when it does.

use std::cell::OnceCell;

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::{DVec3, Vec3};

use super::view::{DoubledLight, DoubledOutline, NEAREST, ReceiverView, STRIP};
use crate::bvh::packet::Packet;
use crate::frame::POINT_OFFSET;
use crate::simd::{LANES, Lanes, Level, Row};

/// What rises above the plane that shadow rays start from by no more than this is the receiver's own
/// surface: in `f32`, a height is off by up to ten roundings of the local size, and rays start eight above.
const OWN_SURFACE: f32 = 4.0 * POINT_OFFSET as f32;

/// By how much a cone's boxes are larger than the doubled light, so that rounding loses none of it.
const WIDER: f32 = 1e-3;

/// Views of sixteen receivers.
#[derive(Debug, Clone, Default)]
pub(super) struct ReceiverViews {
    /// The rays.
    pub(super) packet: Packet,
    doubled: DoubledLight,
    normals: [DVec3; LANES],
    views: [OnceCell<ReceiverView>; LANES],
    /// The functionals of [`ReceiverView`].
    pub(super) x: [Row; 3],
    pub(super) y: [Row; 3],
    pub(super) w: [Row; 3],
    pub(super) normal: [Row; 3],
    /// `n · p` of the rays' ends.
    pub(super) rise: Row,
    /// Heights up to which triangles are not looked at.
    pub(super) floor: Row,
    /// Heights of the strip over the tangent plane at the light.
    pub(super) strip: Row,
    /// Least `W` of what is looked at.
    pub(super) nearest: Row,
    /// Half size of the doubled light along the axes.
    pub(super) spread: [Row; 3],
    /// Rays to which the light has an extent.
    pub(super) soft: u16,
    /// Rays around which something may be under the strip.
    pub(super) low: u16,
}

impl ReceiverViews {
    /// Starts anew, with a light.
    pub(super) fn clear(&mut self, doubled: &DoubledLight) {
        self.doubled = *doubled;
        for view in &mut self.views {
            *view = OnceCell::new();
        }
    }

    /// Sets a receiver: where its rays start, and its normal.
    pub(super) fn set(&mut self, lane: usize, origin: Vec3, normal: DVec3) {
        self.packet.set(lane, origin, self.doubled.target());
        self.normals[lane] = normal;
        for k in 0..3 {
            self.normal[k].0[lane] = normal[k] as f32;
        }
    }

    /// Looks at the light from all receivers that are set.
    pub(super) fn look(&mut self, level: Level, active: u16) {
        dispatch!(level, simd => look(simd, self));
        let mut low = self.low & active;
        while low != 0 {
            let lane = low.trailing_zeros() as usize;
            low &= low - 1;
            let view = *self.view(lane);
            self.packet.set(lane, view.origin, view.target);
            for k in 0..3 {
                self.x[k].0[lane] = view.x[k] as f32;
                self.y[k].0[lane] = view.y[k] as f32;
                self.w[k].0[lane] = view.w[k] as f32;
            }
            self.rise.0[lane] = view.normal.dot(view.ray) as f32;
            self.strip.0[lane] = (STRIP * view.width) as f32;
        }
    }

    /// A receiver's view in `f64`.
    pub(super) fn view(&self, lane: usize) -> &ReceiverView {
        self.views[lane].get_or_init(|| {
            let mut view =
                ReceiverView::new(&self.doubled, self.packet.origin(lane), self.normals[lane]);
            // What is low is what the rows say.
            view.low = self.low >> lane & 1 == 1;
            view
        })
    }

    /// Whether the light is a parallelogram.
    pub(super) fn rect(&self) -> bool {
        self.doubled.is_rect()
    }

    /// How far the doubled light reaches from its centre.
    pub(super) fn reach(&self) -> f32 {
        self.doubled.reach as f32
    }
}

type Vector<S> = [f32x16<S>; 3];

#[inline(always)]
fn dot<S: Simd>(a: Vector<S>, b: Vector<S>) -> f32x16<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a - s b`.
#[inline(always)]
fn less<S: Simd>(a: Vector<S>, s: f32x16<S>, b: Vector<S>) -> Vector<S> {
    [a[0] - s * b[0], a[1] - s * b[1], a[2] - s * b[2]]
}

#[inline(always)]
fn splat<S: Simd>(simd: S, v: DVec3) -> Vector<S> {
    let v = v.as_vec3();
    [
        f32x16::splat(simd, v.x),
        f32x16::splat(simd, v.y),
        f32x16::splat(simd, v.z),
    ]
}

#[inline(always)]
fn store<S: Simd>(v: Vector<S>, rows: &mut [Row; 3]) {
    for k in 0..3 {
        rows[k].set(v[k]);
    }
}

/// Two unit vectors across a unit vector (Duff et al. 2017).
#[inline(always)]
fn across<S: Simd>(simd: S, m: Vector<S>) -> [Vector<S>; 2] {
    let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
    let sign = zero.simd_le(m[2]).select(one, f32x16::splat(simd, -1.0));
    let a = -1.0 / (sign + m[2]);
    let b = m[0] * m[1] * a;
    let e = [one + sign * m[0] * m[0] * a, sign * b, zero - sign * m[0]];
    [e, [b, sign + m[1] * m[1] * a, zero - m[1]]]
}

#[inline(always)]
fn look<S: Simd>(simd: S, views: &mut ReceiverViews) {
    let zero = f32x16::splat(simd, 0.0);
    let o: Vector<S> = [
        views.packet.origins()[0].load(simd),
        views.packet.origins()[1].load(simd),
        views.packet.origins()[2].load(simd),
    ];
    let n: Vector<S> = [
        views.normal[0].load(simd),
        views.normal[1].load(simd),
        views.normal[2].load(simd),
    ];
    let doubled = views.doubled;
    let target: Vector<S> = splat(simd, doubled.target().as_dvec3());
    let l = less(target, f32x16::splat(simd, 1.0), o);
    let length = dot(l, l).sqrt().greater(f32::MIN_POSITIVE);
    let inverse = 1.0 / length;
    let plane = match doubled.kind {
        DoubledOutline::Rect(_, _, m) | DoubledOutline::Disk(m, _, _) => splat(simd, m),
        DoubledOutline::Sphere(_) => [l[0] * inverse, l[1] * inverse, l[2] * inverse],
    };
    let depth = dot(plane, l);
    views.soft = (f32::EPSILON * length).lt(depth);
    let over_depth = 1.0 / depth;
    let w = [
        plane[0] * over_depth,
        plane[1] * over_depth,
        plane[2] * over_depth,
    ];
    store(w, &mut views.w);
    let in_plane = less(n, dot(n, plane), plane);
    let wider = 1.0 + WIDER;
    let (x, y, width) = match doubled.kind {
        DoubledOutline::Rect([u, v], [du, dv], _) => {
            store::<S>(
                splat(simd, (u.abs() + v.abs()) * f64::from(wider)),
                &mut views.spread,
            );
            let width = dot(n, splat(simd, u)).abs() + dot(n, splat(simd, v)).abs();
            (splat(simd, du), splat(simd, dv), width)
        }
        DoubledOutline::Disk(_, [e, f], diameter) => {
            let d = f32x16::splat(simd, diameter as f32);
            (
                splat(simd, e / diameter),
                splat(simd, f / diameter),
                d * dot(in_plane, in_plane).sqrt(),
            )
        }
        DoubledOutline::Sphere(diameter) => {
            let (d, over) = (
                f32x16::splat(simd, diameter as f32),
                f32x16::splat(simd, (1.0 / diameter) as f32),
            );
            let [e, f] = across(simd, plane);
            (
                [e[0] * over, e[1] * over, e[2] * over],
                [f[0] * over, f[1] * over, f[2] * over],
                d * dot(in_plane, in_plane).sqrt(),
            )
        }
    };
    if let DoubledOutline::Disk(_, _, diameter) | DoubledOutline::Sphere(diameter) = doubled.kind {
        let d = f32x16::splat(simd, diameter as f32);
        for (m, row) in plane.into_iter().zip(&mut views.spread) {
            let square = (1.0 - m * m).greater(zero);
            let size = d * (square.sqrt() + WIDER);
            row.set(size);
        }
    }
    store(less(x, dot(x, l), w), &mut views.x);
    store(less(y, dot(y, l), w), &mut views.y);
    let height = dot(n, l);
    views.rise.set(height);
    let tangent = zero.lt(dot(n, n));
    views.low = height.lt((1.0 + STRIP as f32) * width) & tangent & views.soft;
    let size = o[0]
        .abs()
        .greater(o[1].abs())
        .greater(o[2].abs())
        .greater(1.0);
    let none = f32x16::splat(simd, f32::NEG_INFINITY);
    let floor = (OWN_SURFACE * size).where_bits(tangent, none);
    views.floor.set(floor);
    let nearest = NEAREST as f32 * size * inverse;
    views.nearest.set(nearest);
    // Everything is above a strip far down.
    views.strip.set(f32x16::splat(simd, -1e30));
}
