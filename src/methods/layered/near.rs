//! What is next to a receiver: triangles themselves, where the light is seen through few texels of a map.
//!
//! Near a receiver a map's texels are as large as the penumbrae of what is there. So up to a depth over the receiver
//! the scene's triangles answer in place of pieces: as one level more of the map, finer than all others. They are found
//! in the scene's hierarchy, in the pyramid from the receiver to its light samples up to that depth, the lowest
//! first, and above the receiver's tangent plane.
//!
//! A segment crosses a triangle if the light point lies inside of the planes through the receiver and the triangle's
//! edges, and beyond the triangle's own: four linear functions of the light point, for sixteen of them at a time. An edge
//! has the same function from either of its triangles, but for the sign, so that no segment passes between them.
//! The receiver's side of the triangle's plane is exact, as for rays ([`crate::bvh`]).
//!
//! **Where the map takes over**, [`Pencil::near`]. The map counts a surface of a texel if its middle is deeper than that. A
//! triangle is cut at the depth; an opaque one as much later as it rises within half a texel, so that
//! nothing is between what both see of it. Had it counted as a whole, hairs would be in two shapes, the map's and their
//! own, and together too wide.

use std::sync::Arc;

use fearless_simd::{dispatch, prelude::*};
use glam::{DVec3, Vec3};

use super::masks::{Axis, BINS, BLOCK, Mask};
use super::pencil::{Bands, Pencil, Place, SampleVisibility, Tracing};
use crate::bvh::TriangleBvh;
use crate::bvh::packet::plane_side;
use crate::bvh::pyramid::{PLANES, Pyramid, Search};
use crate::frame::POINT_OFFSET;
use crate::geometry::Geometry;
use crate::light::Light;
use crate::maps::layers::map::LayerMap;
use crate::scene::snapshot::Snapshot;
use crate::simd::{LANES, Lanes, Row, detect};

/// By how much a pyramid is wider than its samples, of its own width: more than slopes in `f32` are off by, since they
/// are at least 4096 roundings apart.
const WIDER: f64 = 1.0 / 1024.0;

/// The least positive number: what is at least as large is greater than zero.
const POSITIVE: f32 = f32::from_bits(1);

/// The triangles that answer next to receivers, for one light.
pub(super) struct Near {
    geometry: Arc<Snapshot>,
    light: Light,
    /// By how much light points may be off the light.
    off: f64,
    /// What the transparent triangles let through, in the order of their leaves; 1 where the maps have them alone.
    through: Vec<f32>,
    /// How many texels of the map the light is as wide as where the map takes over.
    texels: f32,
}

impl Near {
    /// What answers next to receivers for maps that hold triangles of the scene.
    pub(super) fn new(
        geometry: &Arc<Snapshot>,
        light: &Light,
        maps: &[LayerMap],
        opaque: bool,
        texels: f32,
    ) -> Self {
        let transparent = geometry.occluders().transparent.as_ref();
        let (low, high) = light.bounds();
        let largest = low.abs().max(high.abs()).max_element().max(1.0);
        Near {
            geometry: geometry.clone(),
            light: light.clone(),
            off: 4.0 * POINT_OFFSET * largest,
            through: transparent.map_or(Vec::new(), |(bvh, through)| {
                within_maps(geometry, bvh, through, maps, opaque)
            }),
            texels,
        }
    }

    /// Depth over a receiver up to which triangles answer.
    pub(super) fn depth(&self, pencil: &Pencil<'_>) -> f32 {
        let ahead = pencil.end - pencil.start.z as f32;
        (self.texels / pencil.width()).min(ahead).max(0.0)
    }

    /// Removes from `seen` what triangles hide of a pencil's samples at `points`, up to its depth; all of them, if
    /// something is in the pencil of an unknown light.
    pub(super) fn hide(
        &self,
        place: Place<'_>,
        pencil: &Pencil<'_>,
        points: [&[Row]; 3],
        seen: &mut SampleVisibility,
        stack: &mut Vec<u32>,
    ) {
        if pencil.near > 0.0 {
            let walk = NearWalk::new(self, place, pencil, points);
            dispatch!(detect(), simd => walk.all(simd, seen, stack));
        }
    }
}

/// What transparent triangles let through; 1 for those that none of the maps holds.
fn within_maps(
    geometry: &Geometry,
    bvh: &TriangleBvh,
    through: &[f32],
    maps: &[LayerMap],
    opaque: bool,
) -> Vec<f32> {
    let mut held = vec![false; geometry.faces.len()];
    for &face in maps.iter().flat_map(|map| map.view.faces.iter()) {
        held[face as usize] = true;
    }
    let of = |(&face, &through): (&u32, &f32)| match (held[face as usize], opaque) {
        (false, _) => 1.0,
        (true, true) => 0.0,
        (true, false) => through,
    };
    bvh.faces.iter().zip(through).map(of).collect()
}

/// Light points `q` of which `normal · q + offset` is at least `least`.
#[derive(Debug, Clone, Copy)]
struct HalfSpace {
    normal: Vec3,
    offset: f32,
    least: f32,
}

impl HalfSpace {
    const ALL: HalfSpace = HalfSpace {
        normal: Vec3::ZERO,
        offset: 0.0,
        least: 0.0,
    };

    /// On one side of a plane through a point. What lies on the plane is on one of its two sides.
    #[inline(always)]
    fn through(origin: Vec3, normal: Vec3) -> Self {
        let [x, y, z] = normal.to_array();
        let first = x > 0.0 || (x == 0.0 && (y > 0.0 || (y == 0.0 && z > 0.0)));
        HalfSpace {
            normal,
            offset: -normal.dot(origin),
            least: if first { 0.0 } else { POSITIVE },
        }
    }
}

/// A walk for one receiver.
struct NearWalk<'a> {
    near: &'a Near,
    how: &'a Tracing,
    pyramid: Pyramid,
    points: [&'a [Row]; 3],
    /// From the map's eye to what it sees.
    forward: DVec3,
    /// Depth over the receiver up to which triangles answer, its own depth, and the same as a height, against that.
    depth: f64,
    start: f64,
    height: f64,
    /// The map's eye, and by how much a triangle's plane rises within half a texel of the level that takes over, over its
    /// slope in tangents.
    eye: DVec3,
    across: [DVec3; 2],
    /// Distance from a triangle's plane that counts as none, for a receiver that may lie on it.
    on_surface: f64,
    /// The samples by their slopes; without, whatever is met hides all.
    axes: Option<[&'a Axis; 2]>,
    /// Columns and rows of samples, and depth, in which a place above the receiver is seen: the former over the latter are
    /// bins of the axes.
    bins: [Vec3; 3],
}

impl<'a> NearWalk<'a> {
    fn new(near: &'a Near, place: Place<'a>, pencil: &Pencil<'a>, points: [&'a [Row]; 3]) -> Self {
        let Place {
            map,
            tracing: how,
            receiver,
        } = place;
        let (view, start) = (&map.view, pencil.start);
        let rotation = view.camera.rotation;
        let [right, down, forward] = [0, 1, 2].map(|i| rotation.row(i));
        let depth = f64::from(pencil.near);
        let height = depth / (start.z * (start.z + depth));
        let level = Bands::new(map, how, pencil).at(pencil.near);
        let half_texel = 0.5 * f64::from(level).exp2() / view.focal;
        // Points of one slope in the map are a plane through the receiver.
        let center = view.camera.intrinsics.z_axis;
        let side = |axis: DVec3, from_center: f64, slope: f64, inward: f64| {
            let normal = view.focal * axis + (from_center + slope * start.z) * forward;
            ((inward * normal.normalize()).as_vec3(), 0.0)
        };
        let ends = |[low, extent]: [f32; 2]| {
            let (low, extent) = (f64::from(low), f64::from(extent));
            [low - WIDER * extent, low + (1.0 + WIDER) * extent]
        };
        let ([left, last], [upper, lower]) = (ends(pencil.columns), ends(pencil.rows));
        let (x, y) = (center.x - start.x, center.y - start.y);
        let bins = |axis: DVec3, from_center: f64, [low, extent]: [f32; 2]| {
            let slope = view.focal * axis + (from_center + f64::from(low) * start.z) * forward;
            (slope * (BINS as f64 / f64::from(extent))).as_vec3()
        };
        let everything = (Vec3::ZERO, 1.0);
        let has_plane = receiver.n != DVec3::ZERO;
        let planes: [(Vec3, f32); PLANES] = [
            (forward.as_vec3(), height as f32),
            (-forward.as_vec3(), 0.0),
            side(right, x, left, 1.0),
            side(right, x, last, -1.0),
            side(down, y, upper, 1.0),
            side(down, y, lower, -1.0),
            if has_plane {
                (receiver.n.as_vec3(), -how.bias)
            } else {
                everything
            },
            everything,
        ];
        let largest = receiver.p.abs().max_element().max(1.0);
        NearWalk {
            near,
            how,
            pyramid: Pyramid::new(receiver.origin, planes),
            points,
            forward,
            depth,
            start: start.z,
            height,
            eye: view.camera.eye,
            across: [right * half_texel, down * half_texel],
            on_surface: if has_plane {
                0.0
            } else {
                4.0 * POINT_OFFSET * largest
            },
            axes: pencil.axes,
            bins: [
                bins(right, x, pencil.columns),
                bins(down, y, pencil.rows),
                (-start.z * forward).as_vec3(),
            ],
        }
    }

    /// Looks at all triangles.
    #[inline(always)]
    fn all<S: Simd>(&self, simd: S, seen: &mut SampleVisibility, stack: &mut Vec<u32>) {
        let occluders = self.near.geometry.occluders();
        self.of(simd, &occluders.opaque, None, seen, stack);
        if let Some((bvh, _)) = &occluders.transparent {
            self.of(simd, bvh, Some(&self.near.through), seen, stack);
        }
    }

    /// Looks at the triangles of a hierarchy; `through`: what they let through, if they are not opaque.
    #[inline(always)]
    fn of<S: Simd>(
        &self,
        simd: S,
        bvh: &TriangleBvh,
        through: Option<&[f32]>,
        seen: &mut SampleVisibility,
        stack: &mut Vec<u32>,
    ) {
        let origin = self.pyramid.origin;
        let mut search = Search::new(&bvh.tree, &self.pyramid, stack);
        while !seen.open.is_empty()
            && let Some(leaf) = search.next_leaf(simd)
        {
            let mut first = leaf.start;
            while first < leaf.end {
                let two = [first, (first + 1).min(leaf.end - 1)];
                let corners = [0, 1].map(|i| bvh.corners[two[i]]);
                let seen_from = [
                    from_origin(&corners[0], origin),
                    from_origin(&corners[1], origin),
                ];
                let meets = self.pyramid.meets(simd, [&seen_from[0], &seen_from[1]]);
                for i in 0..2.min(leaf.end - first) {
                    let through = through.map_or(0.0, |through| through[two[i]]);
                    if meets[i] && through < 1.0 {
                        self.triangle(simd, &corners[i], &seen_from[i], through, seen);
                    }
                }
                first += 2;
            }
        }
    }

    /// Removes what a triangle hides, given by its corners and by those from the origin.
    #[inline(always)]
    fn triangle<S: Simd>(
        &self,
        simd: S,
        corners: &[Vec3; 3],
        from: &[Vec3; 3],
        through: f32,
        seen: &mut SampleVisibility,
    ) {
        let around = seen.open & self.around(from);
        if around.is_empty() {
            return;
        }
        let Some((sides, extra)) = self.half_spaces(corners, from, through > 0.0) else {
            return;
        };
        if self.axes.is_none() {
            seen.open = Mask::NONE;
            return;
        }
        let mut met = self.within(simd, &sides, around);
        if !met.is_empty()
            && extra
                .iter()
                .any(|h| h.least > 0.0 || h.normal != Vec3::ZERO)
        {
            met = self.within(simd, &extra, met);
        }
        if met.is_empty() {
            return;
        }
        if through == 0.0 {
            seen.open = seen.open.without(met);
        } else {
            seen.attenuate(simd, met, through, self.how);
        }
    }

    /// The samples that may be seen through a triangle: those in a rectangle around it, and a bin more on every side.
    #[inline(always)]
    fn around(&self, from: &[Vec3; 3]) -> Mask {
        let all = Mask([u64::MAX; 4]);
        let Some([u, v]) = self.axes else {
            return all;
        };
        let [columns, rows, depth] = self.bins;
        let (mut low, mut high) = ([f32::MAX; 2], [f32::MIN; 2]);
        for corner in from {
            let depth = depth.dot(*corner);
            if depth <= 0.0 {
                return all;
            }
            let bins = [columns.dot(*corner) / depth, rows.dot(*corner) / depth];
            for axis in 0..2 {
                low[axis] = low[axis].min(bins[axis]);
                high[axis] = high[axis].max(bins[axis]);
            }
        }
        // Conversion saturates.
        let first = low.map(|bin| ((bin - 1.0) as u32).min(BINS as u32));
        let last = high.map(|bin| ((bin + 2.0) as u32).min(BINS as u32));
        u.between(first[0], last[0]) & v.between(first[1], last[1])
    }

    /// The half-spaces of light points that are hidden by a triangle: inside of its edges; beyond it, and hidden by the
    /// part before the map takes over, `exactly` or up to half a texel more. Nothing if there are none.
    #[inline(always)]
    fn half_spaces(
        &self,
        corners: &[Vec3; 3],
        from: &[Vec3; 3],
        exactly: bool,
    ) -> Option<([HalfSpace; 3], [HalfSpace; 2])> {
        let origin = self.pyramid.origin;
        let side = plane_side(corners, origin);
        if side == 0.0 {
            return None;
        }
        let [a, b, c] = corners.map(|v| v.as_dvec3());
        // Away from the receiver.
        let normal = (b - a).cross(c - a) * side.signum();
        let length = normal.length();
        if side.abs() <= length * self.on_surface {
            return None;
        }
        let (center, reach) = (self.near.light.center(), self.near.light.reach(normal));
        let (middle, off) = (normal.dot(center - a), length * self.near.off);
        if middle + reach < -off {
            return None;
        }
        let mut extra = [HalfSpace::ALL; 2];
        if middle - reach <= off {
            extra[0] = HalfSpace {
                normal: normal.as_vec3(),
                offset: -normal.dot(a) as f32,
                least: POSITIVE,
            };
        }
        let height = |v: &Vec3| -self.forward.dot(v.as_dvec3());
        let highest = from.iter().map(height).fold(f64::MIN, f64::max);
        if highest > self.height {
            let mut end = self.height;
            if !exactly {
                // Inverse depth in the map is `normal · direction / from_eye`.
                let from_eye = normal.dot(a - self.eye).abs();
                let rise = self.across.map(|axis| normal.dot(axis).abs());
                let depth = self.start + self.depth + (rise[0] + rise[1]) / from_eye;
                end = 1.0 / self.start - 1.0 / depth;
            }
            if highest > end {
                let plane = normal * end + self.forward * side.abs();
                extra[1] = HalfSpace::through(origin, plane.as_vec3());
            }
        }
        let [a, b, c] = *from;
        let sign = side.signum() as f32;
        let edges = [
            HalfSpace::through(origin, a.cross(b) * sign),
            HalfSpace::through(origin, b.cross(c) * sign),
            HalfSpace::through(origin, c.cross(a) * sign),
        ];
        Some((edges, extra))
    }

    /// The samples of a set whose light points are in all of some half-spaces.
    #[inline(always)]
    fn within<S: Simd>(&self, simd: S, sides: &[HalfSpace], set: Mask) -> Mask {
        let mut found = Mask::NONE;
        for r in 0..self.points[0].len().min(BLOCK / LANES) {
            let mut inside = set.row(r);
            if inside == 0 {
                continue;
            }
            let x = self.points[0][r].load(simd);
            let y = self.points[1][r].load(simd);
            let z = self.points[2][r].load(simd);
            for side in sides {
                let n = side.normal;
                let over = x * n.x + y * n.y + z * n.z + side.offset;
                inside &= over.ge(side.least);
            }
            found.0[r / 4] |= u64::from(inside) << (LANES * (r % 4));
        }
        found
    }
}

/// Corners as seen from the origin.
#[inline(always)]
fn from_origin(corners: &[Vec3; 3], origin: Vec3) -> [Vec3; 3] {
    [
        corners[0] - origin,
        corners[1] - origin,
        corners[2] - origin,
    ]
}
