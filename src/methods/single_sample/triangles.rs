//! Sixteen shadow rays against triangles: which are blocked, and how far the others pass from them.
//!
//! Blocked is what [`crate::bvh::packet`] calls blocked, decided by the same function. For the distances the
//! vertices, sheared as that test shears them, are turned into places on the light, which takes six more
//! products a vertex: the place of what lies on the ray is zero, so only the two sheared coordinates
//! matter.

use glam::Vec3;

use super::found::Found;
use super::lanes::Views;
use crate::bvh::TriangleBvh;
use crate::bvh::grown::{Leaves, traverse};
use crate::bvh::packet::{Rays, Stack, longest_axes, prepare, shear, triangle};
use crate::simd::{Lanes, Level, Row, dispatch};

/// Which of the rays in `active` triangles block; the distances of the others go into `found`, under the
/// number that `parts` gives the triangle.
pub(super) fn search(
    level: Level,
    bvh: &TriangleBvh,
    parts: Option<&[u32]>,
    views: &Views,
    active: u16,
    found: &mut Found,
    stack: &mut Stack,
) -> u16 {
    dispatch!(level => all_axes(
        bvh: &TriangleBvh,
        parts: Option<&[u32]>,
        views: &Views,
        active: u16,
        found: &mut Found,
        stack: &mut Stack,
    ) -> u16)
}

#[inline(always)]
unsafe fn all_axes<S: Lanes>(
    bvh: &TriangleBvh,
    parts: Option<&[u32]>,
    views: &Views,
    active: u16,
    found: &mut Found,
    stack: &mut Stack,
) -> u16 {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let [x, y, z] = longest_axes::<S>(&views.packet).map(|axis| axis & active);
        let mut blocked = 0;
        if z != 0 {
            blocked |= along::<S, 2>(bvh, parts, views, z, found, stack);
        }
        if x != 0 {
            blocked |= along::<S, 0>(bvh, parts, views, x, found, stack);
        }
        if y != 0 {
            blocked |= along::<S, 1>(bvh, parts, views, y, found, stack);
        }
        blocked
    }
}

#[inline(always)]
unsafe fn along<S: Lanes, const AXIS: usize>(
    bvh: &TriangleBvh,
    parts: Option<&[u32]>,
    views: &Views,
    active: u16,
    found: &mut Found,
    stack: &mut Stack,
) -> u16 {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let rays = prepare::<S, AXIS>(&views.packet, active);
        let [kx, ky, _] = Rays::<S, AXIS>::AXES;
        let sheared = |rows: &[Row; 3]| [S::load(&rows[kx]), S::load(&rows[ky])];
        let one = S::splat(1.0);
        found.restart();
        let mut leaves = Triangles {
            bvh,
            parts,
            views,
            x: sheared(&views.x),
            y: sheared(&views.y),
            w: sheared(&views.w),
            normal: sheared(&views.normal),
            rise: S::load(&views.rise),
            part_of_way: one.div(rays.length),
            rays,
            found,
            blocked: 0,
        };
        let packet = &views.packet;
        traverse::<S, _>(&bvh.tree, packet, &views.spread, &mut leaves, active, stack);
        leaves.blocked
    }
}

/// The triangles of leaves against sixteen rays with the same longest axis.
struct Triangles<'a, S, const AXIS: usize> {
    bvh: &'a TriangleBvh,
    parts: Option<&'a [u32]>,
    views: &'a Views,
    rays: Rays<S, AXIS>,
    /// The functionals for the two sheared coordinates.
    x: [S; 2],
    y: [S; 2],
    w: [S; 2],
    normal: [S; 2],
    rise: S,
    /// One over the rays' extent along the longest axis.
    part_of_way: S,
    found: &'a mut Found,
    blocked: u16,
}

/// A vertex on the light.
#[derive(Clone, Copy)]
struct Place<S> {
    x: S,
    y: S,
    w: S,
    height: S,
}

impl<S: Lanes, const AXIS: usize> Leaves<S> for Triangles<'_, S, AXIS> {
    #[inline(always)]
    unsafe fn visit(&mut self, first: usize, last: usize, mut active: u16) -> u16 {
        for k in first..last {
            // SAFETY: the caller enabled the features of `S`.
            unsafe {
                let corners = &self.bvh.corners[k];
                let hit = triangle(corners, &self.views.packet, &self.rays, active);
                self.blocked |= hit;
                active &= !hit;
                if active == 0 {
                    return 0;
                }
                if active & self.views.soft != 0 {
                    self.measure(k, active & self.views.soft);
                }
            }
        }
        active
    }

    fn narrowed(&mut self) -> Option<&Row> {
        self.found.narrowed()
    }
}

impl<S: Lanes, const AXIS: usize> Triangles<'_, S, AXIS> {
    #[inline(always)]
    unsafe fn place(&self, v: &Vec3) -> Place<S> {
        // SAFETY: the caller enabled the features of `S`.
        unsafe {
            let (x, y, z) = shear(&self.rays, v);
            let z = z.mul(self.part_of_way);
            let of = |f: [S; 2]| x.mul(f[0]).add(y.mul(f[1]));
            Place {
                x: of(self.x),
                y: of(self.y),
                w: of(self.w).add(z),
                height: of(self.normal).add(z.mul(self.rise)),
            }
        }
    }

    /// Finds the distances of triangle `k` from the rays in `active`, which it does not block.
    #[inline(always)]
    unsafe fn measure(&mut self, k: usize, active: u16) {
        // SAFETY: the caller enabled the features of `S`.
        unsafe {
            let corners = &self.bvh.corners[k];
            let [a, b, c] = [
                self.place(&corners[0]),
                self.place(&corners[1]),
                self.place(&corners[2]),
            ];
            let zero = S::splat(0.0);
            let limit = S::load(&self.found.limit);
            // Beyond one side of the pyramid around the limit, behind, or the receiver's own surface.
            let [aw, bw, cw] = [a.w.mul(limit), b.w.mul(limit), c.w.mul(limit)];
            let mut near = active
                & !zero.lt(a.x.sub(aw).min(b.x.sub(bw)).min(c.x.sub(cw)))
                & !a.x.add(aw).max(b.x.add(bw)).max(c.x.add(cw)).lt(zero);
            near &= !zero.lt(a.y.sub(aw).min(b.y.sub(bw)).min(c.y.sub(cw)))
                & !a.y.add(aw).max(b.y.add(bw)).max(c.y.add(cw)).lt(zero);
            if near == 0 {
                return;
            }
            let highest = a.height.max(b.height).max(c.height);
            near &= zero.lt(a.w.max(b.w).max(c.w)) & !highest.le(S::load(&self.views.floor));
            if near == 0 || has_no_area(corners) {
                return;
            }
            let one = S::splat(1.0);
            let between = S::load(&self.views.nearest).lt(a.w.min(b.w).min(c.w))
                & a.w.max(b.w).max(c.w).le(one);
            let mut clipped = near & !between;
            while clipped != 0 {
                let lane = clipped.trailing_zeros() as usize;
                clipped &= clipped - 1;
                let limit = f64::from(self.found.limit.0[lane]);
                let tau = self.views.view(lane).triangle(corners, limit);
                self.found.add(lane, self.part(k), tau as f32);
            }
            let whole = near & between;
            if whole != 0 {
                let strip = S::load(&self.views.strip);
                let low = whole & self.views.low != 0;
                let tau = if self.views.rect() {
                    distance::<S, true>([a, b, c], low.then_some(strip))
                } else {
                    distance::<S, false>([a, b, c], low.then_some(strip))
                };
                self.note(k, tau, whole);
            }
        }
    }

    /// Takes note of the distances of triangle `k`.
    #[inline(always)]
    unsafe fn note(&mut self, k: usize, tau: S, lanes: u16) {
        // SAFETY: the caller enabled the features of `S`.
        unsafe {
            let limit = S::load(&self.found.limit);
            let mut nearer = tau.lt(limit) & lanes;
            if nearer == 0 {
                return;
            }
            if !self.found.keep {
                tau.select(nearer, limit).store(&mut self.found.limit);
                self.found.changed = true;
                return;
            }
            let mut row = Row::default();
            tau.store(&mut row);
            while nearer != 0 {
                let lane = nearer.trailing_zeros() as usize;
                nearer &= nearer - 1;
                self.found.add(lane, self.part(k), row.0[lane]);
            }
        }
    }

    fn part(&self, k: usize) -> u32 {
        self.parts.map_or(0, |parts| parts[k])
    }
}

/// A triangle without area hides nothing, so it has no outer object either.
fn has_no_area([a, b, c]: &[Vec3; 3]) -> bool {
    let a = a.as_dvec3();
    (b.as_dvec3() - a).cross(c.as_dvec3() - a) == glam::DVec3::ZERO
}

/// Distances of triangles from the rays, which pass them; of their parts above the strip, if there is one.
#[inline(always)]
unsafe fn distance<S: Lanes, const RECT: bool>(vertices: [Place<S>; 3], strip: Option<S>) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let one = S::splat(1.0);
        let zero = S::splat(0.0);
        let (mut places, mut heights) = ([[zero; 2]; 3], [zero; 3]);
        for (i, v) in vertices.iter().enumerate() {
            let inverse = one.div(v.w);
            places[i] = [v.x.mul(inverse), v.y.mul(inverse)];
            heights[i] = v.height.mul(inverse);
        }
        let [a, b, c] = places;
        let Some(strip) = strip else {
            let least = from_segment::<S, RECT>(a, b)
                .min(from_segment::<S, RECT>(b, c))
                .min(from_segment::<S, RECT>(c, a));
            return if RECT { least } else { least.sqrt() };
        };
        let rises = [
            heights[0].sub(strip),
            heights[1].sub(strip),
            heights[2].sub(strip),
        ];
        let above = above::<S, RECT>(places, rises);
        // What is all in the strip: its highest corner.
        let second = heights[0].lt(heights[1]);
        let height = heights[1].max(heights[0]);
        let third = height.lt(heights[2]);
        let height = heights[2].max(height);
        let pick = |k: usize| c[k].select(third, b[k].select(second, a[k]));
        let top = [pick(0), pick(1)];
        let tau = from_segment::<S, RECT>(top, top);
        let tau = if RECT { tau } else { tau.sqrt() };
        let part = height.div(strip).max(zero).min(one);
        let counts = part
            .mul(part)
            .mul(S::splat(3.0).sub(S::splat(2.0).mul(part)));
        let faded = tau.add(one.sub(tau).max(zero).mul(one.sub(counts)));
        above.select(strip.le(height), faded)
    }
}

/// Distances of the parts of triangles where `rises`, given at their corners, is not negative.
#[inline(always)]
unsafe fn above<S: Lanes, const RECT: bool>(places: [[S; 2]; 3], rises: [S; 3]) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let zero = S::splat(0.0);
        let none = S::splat(f32::INFINITY);
        let is_above = [zero.le(rises[0]), zero.le(rises[1]), zero.le(rises[2])];
        let (mut cuts, mut is_cut) = ([[zero; 2]; 3], [0; 3]);
        let mut least = none;
        for i in 0..3 {
            let j = (i + 1) % 3;
            let t = rises[i].div(rises[i].sub(rises[j]));
            is_cut[i] = is_above[i] ^ is_above[j];
            let (mut from, mut to) = (places[i], places[j]);
            for k in 0..2 {
                let along = places[j][k].sub(places[i][k]);
                cuts[i][k] = places[i][k].add(t.mul(along));
                from[k] = from[k].select(is_above[i], cuts[i][k]);
                to[k] = to[k].select(is_above[j], cuts[i][k]);
            }
            let found = from_segment::<S, RECT>(from, to);
            least = found.select(is_above[i] | is_above[j], none).min(least);
        }
        // The side that the cut makes: two of the three sides are cut, or none.
        let [ab, bc, ca] = cuts;
        let from = [
            ab[0].select(is_cut[0], bc[0]),
            ab[1].select(is_cut[0], bc[1]),
        ];
        let to = [
            ca[0].select(is_cut[2], bc[0]),
            ca[1].select(is_cut[2], bc[1]),
        ];
        let found = from_segment::<S, RECT>(from, to);
        let any = is_cut[0] | is_cut[1] | is_cut[2];
        least = found.select(any, none).min(least);
        if RECT { least } else { least.sqrt() }
    }
}

/// Distance of a segment from the origin: the larger of the two coordinates, or else their squares' sum.
#[inline(always)]
unsafe fn from_segment<S: Lanes, const RECT: bool>([ax, ay]: [S; 2], [bx, by]: [S; 2]) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let tiny = S::splat(f32::MIN_POSITIVE);
        let (ex, ey) = (bx.sub(ax), by.sub(ay));
        let square = ex.mul(ex).add(ey.mul(ey)).max(tiny);
        // From the nearest place of the line, which moving along only leaves.
        let along = if RECT {
            let offset = ey.mul(ax).sub(ex.mul(ay));
            let offset = offset.div(ex.abs().add(ey.abs()).max(tiny));
            let minus = zero.sub(offset);
            let px = offset.select(zero.le(ey), minus);
            let py = minus.select(zero.le(ex), offset);
            px.sub(ax).mul(ex).add(py.sub(ay).mul(ey))
        } else {
            zero.sub(ax.mul(ex).add(ay.mul(ey)))
        };
        let t = along.div(square).max(zero).min(one);
        let (x, y) = (ax.add(t.mul(ex)), ay.add(t.mul(ey)));
        if RECT {
            x.abs().max(y.abs())
        } else {
            x.mul(x).add(y.mul(y))
        }
    }
}
