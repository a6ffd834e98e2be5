//! Views of sixteen receivers, as rows for the searches.
//!
//! The same numbers as in [`View`], found sixteen at a time in `f32`. That is enough: what they are multiplied
//! with is measured from the ray. A light that is low over a receiver's horizon is set up by [`View`]
//! itself, and so is what a search wants in `f64`, when it does.

use std::cell::OnceCell;

use glam::{DVec3, Vec3};

use super::view::{Kind, NEAREST, Outline, STRIP, View};
use crate::bvh::packet::Packet;
use crate::frame::POINT_OFFSET;
use crate::simd::{LANES, Lanes, Level, Row, dispatch};

/// What rises above the plane that shadow rays start from by no more than this is the receiver's own
/// surface: in `f32`, a height is off by up to ten roundings of the local size, and rays start eight above.
const OWN_SURFACE: f32 = 4.0 * POINT_OFFSET as f32;

/// By how much a cone's boxes are larger than the doubled light, so that rounding loses none of it.
const WIDER: f32 = 1e-3;

/// Views of sixteen receivers.
#[derive(Debug, Clone, Default)]
pub(super) struct Views {
    /// The rays.
    pub(super) packet: Packet,
    outline: Outline,
    normals: [DVec3; LANES],
    views: [OnceCell<View>; LANES],
    /// The functionals of [`View`].
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

impl Views {
    /// Starts anew, with a light.
    pub(super) fn clear(&mut self, outline: &Outline) {
        self.outline = *outline;
        for view in &mut self.views {
            *view = OnceCell::new();
        }
    }

    /// Sets a receiver: where its rays start, and its normal.
    pub(super) fn set(&mut self, lane: usize, origin: Vec3, normal: DVec3) {
        self.packet.set(lane, origin, self.outline.target());
        self.normals[lane] = normal;
        for k in 0..3 {
            self.normal[k].0[lane] = normal[k] as f32;
        }
    }

    /// Looks at the light from all receivers that are set.
    pub(super) fn look(&mut self, level: Level, active: u16) {
        let views = &mut *self;
        dispatch!(level => look(views: &mut Views));
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
    pub(super) fn view(&self, lane: usize) -> &View {
        self.views[lane].get_or_init(|| {
            let mut view = View::new(&self.outline, self.packet.origin(lane), self.normals[lane]);
            // What is low is what the rows say.
            view.low = self.low >> lane & 1 == 1;
            view
        })
    }

    /// Whether the light is a parallelogram.
    pub(super) fn rect(&self) -> bool {
        self.outline.is_rect()
    }

    /// How far the doubled light reaches from its centre.
    pub(super) fn reach(&self) -> f32 {
        self.outline.reach as f32
    }
}

type Vector<S> = [S; 3];

#[inline(always)]
unsafe fn dot<S: Lanes>(a: Vector<S>, b: Vector<S>) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe { a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2])) }
}

/// `a - s b`.
#[inline(always)]
unsafe fn less<S: Lanes>(a: Vector<S>, s: S, b: Vector<S>) -> Vector<S> {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        [
            a[0].sub(s.mul(b[0])),
            a[1].sub(s.mul(b[1])),
            a[2].sub(s.mul(b[2])),
        ]
    }
}

#[inline(always)]
unsafe fn splat<S: Lanes>(v: DVec3) -> Vector<S> {
    let v = v.as_vec3();
    // SAFETY: the caller enabled the features of `S`.
    unsafe { [S::splat(v.x), S::splat(v.y), S::splat(v.z)] }
}

#[inline(always)]
unsafe fn store<S: Lanes>(v: Vector<S>, rows: &mut [Row; 3]) {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        for k in 0..3 {
            v[k].store(&mut rows[k]);
        }
    }
}

/// Two unit vectors across a unit vector (Duff et al. 2017).
#[inline(always)]
unsafe fn across<S: Lanes>(m: Vector<S>) -> [Vector<S>; 2] {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let sign = one.select(zero.le(m[2]), S::splat(-1.0));
        let a = S::splat(-1.0).div(sign.add(m[2]));
        let b = m[0].mul(m[1]).mul(a);
        let e = [
            one.add(sign.mul(m[0]).mul(m[0]).mul(a)),
            sign.mul(b),
            zero.sub(sign.mul(m[0])),
        ];
        [e, [b, sign.add(m[1].mul(m[1]).mul(a)), zero.sub(m[1])]]
    }
}

#[inline(always)]
unsafe fn look<S: Lanes>(views: &mut Views) {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let zero = S::splat(0.0);
        let o: Vector<S> = [
            S::load(&views.packet.origins()[0]),
            S::load(&views.packet.origins()[1]),
            S::load(&views.packet.origins()[2]),
        ];
        let n: Vector<S> = [
            S::load(&views.normal[0]),
            S::load(&views.normal[1]),
            S::load(&views.normal[2]),
        ];
        let outline = views.outline;
        let target: Vector<S> = splat(outline.target().as_dvec3());
        let l = less(target, S::splat(1.0), o);
        let length = dot(l, l).sqrt().max(S::splat(f32::MIN_POSITIVE));
        let inverse = S::splat(1.0).div(length);
        let plane = match outline.kind {
            Kind::Rect(_, _, m) | Kind::Disk(m, _, _) => splat(m),
            Kind::Sphere(_) => [l[0].mul(inverse), l[1].mul(inverse), l[2].mul(inverse)],
        };
        let depth = dot(plane, l);
        views.soft = S::splat(f32::EPSILON).mul(length).lt(depth);
        let over_depth = S::splat(1.0).div(depth);
        let w = [
            plane[0].mul(over_depth),
            plane[1].mul(over_depth),
            plane[2].mul(over_depth),
        ];
        store(w, &mut views.w);
        let in_plane = less(n, dot(n, plane), plane);
        let wider = 1.0 + WIDER;
        let (x, y, width) = match outline.kind {
            Kind::Rect([u, v], [du, dv], _) => {
                store::<S>(
                    splat((u.abs() + v.abs()) * f64::from(wider)),
                    &mut views.spread,
                );
                let width = dot(n, splat(u)).abs().add(dot(n, splat(v)).abs());
                (splat(du), splat(dv), width)
            }
            Kind::Disk(_, [e, f], diameter) => {
                let d = S::splat(diameter as f32);
                (
                    splat(e / diameter),
                    splat(f / diameter),
                    d.mul(dot(in_plane, in_plane).sqrt()),
                )
            }
            Kind::Sphere(diameter) => {
                let (d, over) = (S::splat(diameter as f32), S::splat((1.0 / diameter) as f32));
                let [e, f] = across(plane);
                (
                    [e[0].mul(over), e[1].mul(over), e[2].mul(over)],
                    [f[0].mul(over), f[1].mul(over), f[2].mul(over)],
                    d.mul(dot(in_plane, in_plane).sqrt()),
                )
            }
        };
        if let Kind::Disk(_, _, diameter) | Kind::Sphere(diameter) = outline.kind {
            let d = S::splat(diameter as f32);
            for (m, row) in plane.into_iter().zip(&mut views.spread) {
                let square = S::splat(1.0).sub(m.mul(m)).max(zero);
                let size = d.mul(square.sqrt().add(S::splat(WIDER)));
                size.store(row);
            }
        }
        store(less(x, dot(x, l), w), &mut views.x);
        store(less(y, dot(y, l), w), &mut views.y);
        let height = dot(n, l);
        height.store(&mut views.rise);
        let tangent = zero.lt(dot(n, n));
        views.low = height.lt(S::splat(1.0 + STRIP as f32).mul(width)) & tangent & views.soft;
        let size = o[0]
            .abs()
            .max(o[1].abs())
            .max(o[2].abs())
            .max(S::splat(1.0));
        let none = S::splat(f32::NEG_INFINITY);
        let floor = S::splat(OWN_SURFACE).mul(size).select(tangent, none);
        floor.store(&mut views.floor);
        let nearest = S::splat(NEAREST as f32).mul(size).mul(inverse);
        nearest.store(&mut views.nearest);
        // Everything is above a strip far down.
        S::splat(-1e30).store(&mut views.strip);
    }
}
