//! Sixteen segments, and the test whether one passes through a triangle.
//!
//! By Woop's test: vertices are sheared so that the segment runs along one axis from the origin, once a vertex and
//! segment, so that triangles that share an edge see the same numbers; the signs of the three edge
//! functions then decide, zero counting as inside on both sides. The sheared products are rounded
//! monotonically, so a sign is right or zero. Segments are grouped by their longest axis.
//!
//! Where along the segment a triangle lies is decided by the signs of `T` and `D - T`, with `T / D` the
//! fraction of the segment: both have the same sign where the ends are on different sides. A sign
//! within its rounding error is taken from `robust::orient3d` instead: `T` has the sign of the origin
//! over the triangle's plane, `D - T` that of the target under it.
//!
//! Lanes are segments that meet one triangle (`triangle`), or triangles that one segment meets
//! ([`super::any_hit`]): the same operations, and so the same answer.

use fearless_simd::{f32x16, prelude::*};
use glam::Vec3;
use robust::{Coord3D, orient3d};

use super::crossed::Crossed;
use super::kept::KeptPacks;
use crate::simd::{LANES, Lanes, Row};

/// By how much boxes are widened, times the largest coordinate. A sheared vertex is off by up to 6
/// rounding errors (2⁻²⁴) of its distance from the origin (three of the shear's product, one of each of the
/// three differences), an edge function that rounds to zero adds 1.4, widening itself 1; the distance is at
/// most twice the coordinate along the longest axis. 12 in the worst case.
pub(super) const BOX_SLACK: f32 = 16.0 / (1 << 24) as f32;

/// The slab test's own rounding, `1 + 2 γ(3)` (Ize 2013).
pub(super) const SLAB_SLACK: f32 = 1.0 + 8.0 / (1 << 24) as f32;

/// Rounding error of `T` and `D - T` over the product of the largest sheared x, y and z. Inside, the three
/// edge functions have one sign and sum to at most 4 of these products, so that their own rounding, that of
/// the sums with z, and that of z and the segment's length come to 60 · 2⁻²⁴.
const SIDE_ERROR: f32 = 64.0 / (1 << 24) as f32;

/// Smallest direction component that slabs divide by; local coordinates are of order 1.
pub(super) const TINY: f32 = 1e-20;

/// What a thread keeps between traversals, so that none allocates.
#[derive(Debug, Clone, Default)]
pub struct Stack {
    /// Nodes still to visit.
    pub(super) nodes: Vec<u32>,
    /// What blocked a segment last, where it did: the next ones are likely to meet it, too.
    pub(super) blocker: Option<u32>,
    /// What each segment of a packet has crossed.
    pub(super) crossed: [Crossed; LANES],
    /// Of two levels: nodes of the upper one, segments in a mesh's own coordinates, and triangles in the scene's.
    pub(super) upper: Vec<u32>,
    pub(super) own: Packet,
    pub(super) packs: KeptPacks,
}

impl Stack {
    /// An empty one.
    pub fn new() -> Self {
        Stack::default()
    }
}

/// Sixteen segments in local coordinates.
#[derive(Debug, Clone, Default)]
pub struct Packet {
    pub(super) origin: [Row; 3],
    pub(super) target: [Row; 3],
}

impl Packet {
    /// Sets one segment.
    #[inline]
    pub fn set(&mut self, lane: usize, origin: Vec3, target: Vec3) {
        for axis in 0..3 {
            self.origin[axis].0[lane] = origin[axis];
            self.target[axis].0[lane] = target[axis];
        }
    }

    /// Sets the ends of all segments.
    #[inline]
    pub fn set_targets(&mut self, targets: &[Row; 3]) {
        self.target = *targets;
    }

    /// Starts of all segments.
    pub(crate) fn origins(&self) -> &[Row; 3] {
        &self.origin
    }

    /// Ends of all segments.
    pub(crate) fn targets(&self) -> &[Row; 3] {
        &self.target
    }

    /// Start of a segment.
    pub fn origin(&self, lane: usize) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|k| self.origin[k].0[lane]))
    }

    /// The segments that start where this one does.
    fn sharing(&self, lane: usize) -> u16 {
        let mut same = 0;
        for other in 0..LANES {
            let equal = (0..3).all(|k| self.origin[k].0[other] == self.origin[k].0[lane]);
            same |= u16::from(equal) << other;
        }
        same
    }

    /// End of a segment.
    pub fn target(&self, lane: usize) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|k| self.target[k].0[lane]))
    }
}

/// The segments whose longest axis is x, y and z; each is in one of the three.
#[inline(always)]
pub(crate) fn longest_axes<S: Simd>(simd: S, packet: &Packet) -> [u16; 3] {
    let x = along(simd, packet, 0).abs();
    let y = along(simd, packet, 1).abs();
    let z = along(simd, packet, 2).abs();
    let along_z = x.le(z) & y.le(z);
    let along_x = !along_z & y.le(x);
    [along_x, !along_z & !along_x, along_z]
}

/// What the triangle test needs of segments whose longest axis is this one.
pub(crate) struct Rays<S: Simd, const AXIS: usize> {
    /// Origins in the order of the sheared axes.
    pub(super) origin: [f32x16<S>; 3],
    pub(super) shear: [f32x16<S>; 2],
    /// Extent along the longest axis.
    pub(crate) length: f32x16<S>,
}

impl<S: Simd, const AXIS: usize> Rays<S, AXIS> {
    /// Axes in cyclic order, the longest last. Constant, since choosing a coordinate while running would cost
    /// the triangle test more than its arithmetic.
    pub(crate) const AXES: [usize; 3] = [(AXIS + 1) % 3, (AXIS + 2) % 3, AXIS];
}

// Closures do not inherit the instruction set of the function around them; what is called with lanes
// is a function of its own everywhere here.

/// Extent of the segments along an axis.
#[inline(always)]
pub(super) fn along<S: Simd>(simd: S, packet: &Packet, axis: usize) -> f32x16<S> {
    packet.target[axis].load(simd) - packet.origin[axis].load(simd)
}

/// By how much boxes are widened.
#[inline(always)]
pub(super) fn box_slack(packet: &Packet, active: u16) -> f32 {
    let mut largest = 1.0f32;
    for row in &packet.origin {
        for (lane, x) in row.0.iter().enumerate() {
            let counts = active >> lane & 1 == 1;
            largest = if counts {
                largest.max(x.abs())
            } else {
                largest
            };
        }
    }
    BOX_SLACK * largest
}

#[inline(always)]
pub(crate) fn prepare<S: Simd, const AXIS: usize>(simd: S, packet: &Packet) -> Rays<S, AXIS> {
    let axes = Rays::<S, AXIS>::AXES;
    let length = along(simd, packet, AXIS);
    Rays {
        origin: [
            packet.origin[axes[0]].load(simd),
            packet.origin[axes[1]].load(simd),
            packet.origin[axes[2]].load(simd),
        ],
        shear: [
            along(simd, packet, axes[0]) / length,
            along(simd, packet, axes[1]) / length,
        ],
        length,
    }
}

/// A vertex from the segments' origins, sheared so that they run along z.
#[inline(always)]
pub(crate) fn shear<S: Simd, const AXIS: usize>(
    rays: &Rays<S, AXIS>,
    v: &Vec3,
) -> (f32x16<S>, f32x16<S>, f32x16<S>) {
    let [kx, ky, kz] = Rays::<S, AXIS>::AXES;
    let vertex = [
        f32x16::splat(rays.length.simd, v[kx]),
        f32x16::splat(rays.length.simd, v[ky]),
        f32x16::splat(rays.length.simd, v[kz]),
    ];
    sheared(vertex, rays.origin, rays.shear)
}

/// A vertex, its coordinates in the order of the sheared axes, from the origin and sheared.
#[inline(always)]
pub(super) fn sheared<S: Simd, V: Lanes<S>>(v: [V; 3], origin: [V; 3], shear: [V; 2]) -> (V, V, V) {
    let z = v[2] - origin[2];
    let x = v[0] - origin[0] - shear[0] * z;
    let y = v[1] - origin[1] - shear[1] * z;
    (x, y, z)
}

/// Largest of three absolute values.
#[inline(always)]
pub(super) fn largest<S: Simd, V: Lanes<S>>(a: V, b: V, c: V) -> V {
    a.abs().greater(b.abs()).greater(c.abs())
}

/// Lanes with a positive and with a negative sign, and those whose sign is beyond its rounding error.
#[derive(Debug, Clone, Copy, Default)]
struct Signs {
    positive: u16,
    negative: u16,
    sure: u16,
}

impl Signs {
    #[inline(always)]
    fn new<S: Simd, V: Lanes<S>>(x: V, error: V, sure: u16) -> Self {
        let zero = V::splat(x.token(), 0.0);
        let sure = sure & error.lt(x.abs());
        Signs {
            positive: zero.lt(x) & sure,
            negative: x.lt(zero) & sure,
            sure,
        }
    }

    /// Sets the sign of some lanes to that of `value`.
    fn set(&mut self, lanes: u16, value: f64) {
        let bits = |condition| if condition { lanes } else { 0 };
        self.positive |= bits(value > 0.0);
        self.negative |= bits(value < 0.0);
        self.sure |= lanes;
    }
}

/// What the rounded test says of segments and triangles, a pair a lane.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Crossing {
    /// The segment passes through the triangle.
    pub(super) hit: u16,
    /// It may do so: the exact test decides.
    pub(super) unsure: u16,
    /// On which side of the plane it starts, and opposite to which it ends.
    start: Signs,
    end: Signs,
}

impl Crossing {
    /// Tests pairs of `active` by the sheared corners and the segments' extent along their longest axis.
    #[inline(always)]
    pub(super) fn new<S: Simd, V: Lanes<S>>(
        corners: [(V, V, V); 3],
        length: V,
        active: u16,
    ) -> Self {
        let [(ax, ay, az), (bx, by, bz), (cx, cy, cz)] = corners;
        let u = cx * by - cy * bx;
        let v = ax * cy - ay * cx;
        let w = bx * ay - by * ax;
        let zero = V::splat(u.token(), 0.0);
        let inside = (zero.le(u.lesser(v).lesser(w)) | u.greater(v).greater(w).le(zero)) & active;
        if inside == 0 {
            return Crossing::default();
        }
        let t = u * az + v * bz + w * cz;
        let rest = (u + v + w) * length - t;
        let reach = largest(az, bz, cz).greater(length.abs());
        let error = largest(ax, bx, cx) * largest(ay, by, cy) * reach * SIDE_ERROR;
        let (low, high) = (t.lesser(rest), t.greater(rest));
        let negative = zero - error;
        let hit = inside & (error.lt(low) | high.lt(negative));
        let miss = low.lt(negative) & error.lt(high);
        let mut unsure = inside & !hit & !miss;
        if unsure == 0 {
            return Crossing {
                hit,
                ..Crossing::default()
            };
        }
        // Edge-on, all three edge functions can round to zero: then the segment may pass far from here.
        let (x0, x1) = (ax.lesser(bx).lesser(cx), ax.greater(bx).greater(cx));
        let (y0, y1) = (ay.lesser(by).lesser(cy), ay.greater(by).greater(cy));
        unsure &= x0.le(zero) & zero.le(x1) & y0.le(zero) & zero.le(y1);
        // Where even the triangle's orientation is in doubt, both ends are asked exactly: a rounded side and an
        // exact one could speak of two different triangles.
        let oriented = error.lt((t + rest).abs());
        Crossing {
            hit,
            unsure,
            start: Signs::new(t, error, oriented),
            end: Signs::new(rest, error, oriented),
        }
    }

    /// The lanes that are hit, those in doubt decided by the exact sides of the ends: `start` gives the origin's
    /// for a lane, and the lanes that share it, `end` the target's.
    #[cold]
    #[inline(never)]
    pub(super) fn settled(
        mut self,
        mut start: impl FnMut(usize) -> (u16, f64),
        end: impl Fn(usize) -> f64,
    ) -> u16 {
        let mut asked = self.unsure & !self.start.sure;
        while asked != 0 {
            let lane = asked.trailing_zeros() as usize;
            let (lanes, side) = start(lane);
            let lanes = asked & (lanes | 1 << lane);
            self.start.set(lanes, -side);
            asked &= !lanes;
        }
        let mut asked = self.unsure & !self.end.sure;
        while asked != 0 {
            let lane = asked.trailing_zeros();
            self.end.set(1 << lane, end(lane as usize));
            asked &= asked - 1;
        }
        let positive = self.start.positive & self.end.positive;
        let negative = self.start.negative & self.end.negative;
        self.hit | self.unsure & (positive | negative)
    }
}

/// Segments of `active` that the triangle blocks.
#[inline(always)]
pub(crate) fn triangle<S: Simd, const AXIS: usize>(
    corners: &[Vec3; 3],
    packet: &Packet,
    rays: &Rays<S, AXIS>,
    active: u16,
) -> u16 {
    let sheared = [
        shear(rays, &corners[0]),
        shear(rays, &corners[1]),
        shear(rays, &corners[2]),
    ];
    let crossing = Crossing::new(sheared, rays.length, active);
    if crossing.unsure == 0 {
        return crossing.hit;
    }
    // Segments of one receiver share their origin: its side is found once.
    crossing.settled(
        |lane| {
            (
                packet.sharing(lane),
                plane_side(corners, packet.origin(lane)),
            )
        },
        |lane| plane_side(corners, packet.target(lane)),
    )
}

/// Exact side of `p`: positive under the triangle (which runs counter-clockwise seen from above).
pub(crate) fn plane_side(corners: &[Vec3; 3], p: Vec3) -> f64 {
    let coord = |v: Vec3| Coord3D {
        x: f64::from(v.x),
        y: f64::from(v.y),
        z: f64::from(v.z),
    };
    orient3d(
        coord(corners[0]),
        coord(corners[1]),
        coord(corners[2]),
        coord(p),
    )
}
