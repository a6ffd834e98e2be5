//! Sixteen shadow rays against triangles: which are blocked, and how far the others pass from them.
//!
//! Blocked is what [`crate::bvh::packet`] calls blocked, decided by the same function. For the distances the
//! vertices, sheared as that test shears them, are turned into places on the light, which takes six more
//! products a vertex: the place of what lies on the ray is zero, so only the two sheared coordinates
//! matter.

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::Vec3;

use super::found::Found;
use super::lanes::ReceiverViews;
use crate::bvh::TriangleBvh;
use crate::bvh::grown::{Leaves, traverse};
use crate::bvh::packet::{Rays, Stack, longest_axes, prepare, shear, triangle};
use crate::simd::{Lanes, Level, Row};

/// Which of the rays in `active` triangles block; the distances of the others go into `found`, under the
/// number that `parts` gives the triangle.
pub(super) fn search(
    level: Level,
    bvh: &TriangleBvh,
    parts: Option<&[u32]>,
    views: &ReceiverViews,
    active: u16,
    found: &mut Found,
    stack: &mut Stack,
) -> u16 {
    dispatch!(level, simd => all_axes(simd, bvh, parts, views, active, found, stack))
}

#[inline(always)]
fn all_axes<S: Simd>(
    simd: S,
    bvh: &TriangleBvh,
    parts: Option<&[u32]>,
    views: &ReceiverViews,
    active: u16,
    found: &mut Found,
    stack: &mut Stack,
) -> u16 {
    let [x, y, z] = longest_axes(simd, &views.packet).map(|axis| axis & active);
    let mut blocked = 0;
    if z != 0 {
        blocked |= along::<S, 2>(simd, bvh, parts, views, z, found, stack);
    }
    if x != 0 {
        blocked |= along::<S, 0>(simd, bvh, parts, views, x, found, stack);
    }
    if y != 0 {
        blocked |= along::<S, 1>(simd, bvh, parts, views, y, found, stack);
    }
    blocked
}

#[inline(always)]
fn along<S: Simd, const AXIS: usize>(
    simd: S,
    bvh: &TriangleBvh,
    parts: Option<&[u32]>,
    views: &ReceiverViews,
    active: u16,
    found: &mut Found,
    stack: &mut Stack,
) -> u16 {
    let rays = prepare::<S, AXIS>(simd, &views.packet);
    let [kx, ky, _] = Rays::<S, AXIS>::AXES;
    let sheared = |rows: &[Row; 3]| [rows[kx].load(simd), rows[ky].load(simd)];
    let one = f32x16::splat(simd, 1.0);
    found.restart();
    let mut leaves = Triangles {
        bvh,
        parts,
        views,
        x: sheared(&views.x),
        y: sheared(&views.y),
        w: sheared(&views.w),
        normal: sheared(&views.normal),
        rise: views.rise.load(simd),
        part_of_way: one / rays.length,
        rays,
        found,
        blocked: 0,
    };
    let packet = &views.packet;
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

/// The triangles of leaves against sixteen rays with the same longest axis.
struct Triangles<'a, S: Simd, const AXIS: usize> {
    bvh: &'a TriangleBvh,
    parts: Option<&'a [u32]>,
    views: &'a ReceiverViews,
    rays: Rays<S, AXIS>,
    /// The functionals for the two sheared coordinates.
    x: [f32x16<S>; 2],
    y: [f32x16<S>; 2],
    w: [f32x16<S>; 2],
    normal: [f32x16<S>; 2],
    rise: f32x16<S>,
    /// One over the rays' extent along the longest axis.
    part_of_way: f32x16<S>,
    found: &'a mut Found,
    blocked: u16,
}

/// A vertex on the light.
#[derive(Clone, Copy)]
struct Place<S: Simd> {
    x: f32x16<S>,
    y: f32x16<S>,
    w: f32x16<S>,
    height: f32x16<S>,
}

impl<S: Simd, const AXIS: usize> Leaves for Triangles<'_, S, AXIS> {
    #[inline(always)]
    fn visit(&mut self, first: usize, last: usize, mut active: u16) -> u16 {
        for k in first..last {
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
        active
    }

    fn narrowed(&mut self) -> Option<&Row> {
        self.found.narrowed()
    }
}

impl<S: Simd, const AXIS: usize> Triangles<'_, S, AXIS> {
    #[inline(always)]
    fn place(&self, v: &Vec3) -> Place<S> {
        let (x, y, z) = shear(&self.rays, v);
        let z = z * self.part_of_way;
        let of = |f: [f32x16<S>; 2]| x * f[0] + y * f[1];
        Place {
            x: of(self.x),
            y: of(self.y),
            w: of(self.w) + z,
            height: of(self.normal) + z * self.rise,
        }
    }

    /// Finds the distances of triangle `k` from the rays in `active`, which it does not block.
    #[inline(always)]
    fn measure(&mut self, k: usize, active: u16) {
        let corners = &self.bvh.corners[k];
        let [a, b, c] = [
            self.place(&corners[0]),
            self.place(&corners[1]),
            self.place(&corners[2]),
        ];
        let simd = a.x.simd;
        let zero = f32x16::splat(simd, 0.0);
        let limit = self.found.limit.load(simd);
        // Beyond one side of the pyramid around the limit, behind, or the receiver's own surface.
        let [aw, bw, cw] = [a.w * limit, b.w * limit, c.w * limit];
        let mut near = active
            & !zero.lt((a.x - aw).lesser(b.x - bw).lesser(c.x - cw))
            & !(a.x + aw).greater(b.x + bw).greater(c.x + cw).lt(zero);
        near &= !zero.lt((a.y - aw).lesser(b.y - bw).lesser(c.y - cw))
            & !(a.y + aw).greater(b.y + bw).greater(c.y + cw).lt(zero);
        if near == 0 {
            return;
        }
        let highest = a.height.greater(b.height).greater(c.height);
        near &= zero.lt(a.w.greater(b.w).greater(c.w)) & !highest.le(self.views.floor.load(simd));
        if near == 0 || has_no_area(corners) {
            return;
        }
        let one = f32x16::splat(simd, 1.0);
        let between = self
            .views
            .nearest
            .load(simd)
            .lt(a.w.lesser(b.w).lesser(c.w))
            & a.w.greater(b.w).greater(c.w).le(one);
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
            let strip = self.views.strip.load(simd);
            let low = whole & self.views.low != 0;
            let tau = if self.views.rect() {
                distance::<S, true>(simd, [a, b, c], low.then_some(strip))
            } else {
                distance::<S, false>(simd, [a, b, c], low.then_some(strip))
            };
            self.note(k, tau, whole);
        }
    }

    /// Takes note of the distances of triangle `k`.
    #[inline(always)]
    fn note(&mut self, k: usize, tau: f32x16<S>, lanes: u16) {
        let limit = self.found.limit.load(tau.simd);
        let mut nearer = tau.lt(limit) & lanes;
        if nearer == 0 {
            return;
        }
        if !self.found.keep {
            self.found.limit.set(tau.where_bits(nearer, limit));
            self.found.changed = true;
            return;
        }
        let mut row = Row::default();
        row.set(tau);
        while nearer != 0 {
            let lane = nearer.trailing_zeros() as usize;
            nearer &= nearer - 1;
            self.found.add(lane, self.part(k), row.0[lane]);
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
fn distance<S: Simd, const RECT: bool>(
    simd: S,
    vertices: [Place<S>; 3],
    strip: Option<f32x16<S>>,
) -> f32x16<S> {
    let one = f32x16::splat(simd, 1.0);
    let zero = f32x16::splat(simd, 0.0);
    let (mut places, mut heights) = ([[zero; 2]; 3], [zero; 3]);
    for (i, v) in vertices.iter().enumerate() {
        let inverse = one / v.w;
        places[i] = [v.x * inverse, v.y * inverse];
        heights[i] = v.height * inverse;
    }
    let [a, b, c] = places;
    let Some(strip) = strip else {
        let least = from_segment::<S, RECT>(simd, a, b)
            .lesser(from_segment::<S, RECT>(simd, b, c))
            .lesser(from_segment::<S, RECT>(simd, c, a));
        return if RECT { least } else { least.sqrt() };
    };
    let rises = [heights[0] - strip, heights[1] - strip, heights[2] - strip];
    let above = above::<S, RECT>(simd, places, rises);
    // What is all in the strip: its highest corner.
    let second = heights[0].lt(heights[1]);
    let height = heights[1].greater(heights[0]);
    let third = height.lt(heights[2]);
    let height = heights[2].greater(height);
    let pick = |k: usize| c[k].where_bits(third, b[k].where_bits(second, a[k]));
    let top = [pick(0), pick(1)];
    let tau = from_segment::<S, RECT>(simd, top, top);
    let tau = if RECT { tau } else { tau.sqrt() };
    let part = (height / strip).greater(zero).lesser(one);
    let counts = part * part * (3.0 - 2.0 * part);
    let faded = tau + (one - tau).greater(zero) * (one - counts);
    strip.simd_le(height).select(above, faded)
}

/// Distances of the parts of triangles where `rises`, given at their corners, is not negative.
#[inline(always)]
fn above<S: Simd, const RECT: bool>(
    simd: S,
    places: [[f32x16<S>; 2]; 3],
    rises: [f32x16<S>; 3],
) -> f32x16<S> {
    let zero = f32x16::splat(simd, 0.0);
    let none = f32x16::splat(simd, f32::INFINITY);
    let is_above = [zero.le(rises[0]), zero.le(rises[1]), zero.le(rises[2])];
    let (mut cuts, mut is_cut) = ([[zero; 2]; 3], [0; 3]);
    let mut least = none;
    for i in 0..3 {
        let j = (i + 1) % 3;
        let t = rises[i] / (rises[i] - rises[j]);
        is_cut[i] = is_above[i] ^ is_above[j];
        let (mut from, mut to) = (places[i], places[j]);
        for k in 0..2 {
            let along = places[j][k] - places[i][k];
            cuts[i][k] = places[i][k] + t * along;
            from[k] = from[k].where_bits(is_above[i], cuts[i][k]);
            to[k] = to[k].where_bits(is_above[j], cuts[i][k]);
        }
        let found = from_segment::<S, RECT>(simd, from, to);
        least = found
            .where_bits(is_above[i] | is_above[j], none)
            .lesser(least);
    }
    // The side that the cut makes: two of the three sides are cut, or none.
    let [ab, bc, ca] = cuts;
    let from = [
        ab[0].where_bits(is_cut[0], bc[0]),
        ab[1].where_bits(is_cut[0], bc[1]),
    ];
    let to = [
        ca[0].where_bits(is_cut[2], bc[0]),
        ca[1].where_bits(is_cut[2], bc[1]),
    ];
    let found = from_segment::<S, RECT>(simd, from, to);
    let any = is_cut[0] | is_cut[1] | is_cut[2];
    least = found.where_bits(any, none).lesser(least);
    if RECT { least } else { least.sqrt() }
}

/// Distance of a segment from the origin: the larger of the two coordinates, or else their squares' sum.
#[inline(always)]
fn from_segment<S: Simd, const RECT: bool>(
    simd: S,
    [ax, ay]: [f32x16<S>; 2],
    [bx, by]: [f32x16<S>; 2],
) -> f32x16<S> {
    let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
    let tiny = f32x16::splat(simd, f32::MIN_POSITIVE);
    let (ex, ey) = (bx - ax, by - ay);
    let square = (ex * ex + ey * ey).greater(tiny);
    // From the nearest place of the line, which moving along only leaves.
    let along = if RECT {
        let offset = ey * ax - ex * ay;
        let offset = offset / (ex.abs() + ey.abs()).greater(tiny);
        let minus = zero - offset;
        let px = zero.simd_le(ey).select(offset, minus);
        let py = zero.simd_le(ex).select(minus, offset);
        (px - ax) * ex + (py - ay) * ey
    } else {
        zero - (ax * ex + ay * ey)
    };
    let t = (along / square).greater(zero).lesser(one);
    let (x, y) = (ax + t * ex, ay + t * ey);
    if RECT {
        x.abs().greater(y.abs())
    } else {
        x * x + y * y
    }
}
