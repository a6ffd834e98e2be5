//! A receiver as a view of the light has it, and the planes of the triangles that may hide it.

use glam::{DVec2, DVec3, Vec3};

use super::maps::Maps;
use crate::camera::Camera;
use crate::frame::POINT_OFFSET;
use crate::geometry::Geometry;
use crate::maps::views::View;
use crate::raster::nearest::NONE;

/// A receiver in a view.
pub(super) struct Receiver {
    /// Local position.
    pub local: DVec3,
    /// Column and row in texels.
    pub at: DVec2,
    pub inverse_depth: f64,
    /// Normal in the view's coordinates, and its product with the position there; zero without one.
    pub normal: DVec3,
    height: f64,
    /// Farthest that a surface counts as the receiver's own.
    pub slack: f64,
}

impl Receiver {
    /// The receiver at `p` (local) with unit normal `n`, or zero, and its depth; only for positive depths, and places in
    /// the view, does it mean anything.
    #[inline(always)]
    pub(super) fn new(view: &View, p: DVec3, n: DVec3) -> (Self, f64) {
        let (at, depth) = view.project(p);
        let normal = view.camera.rotation * n;
        let slack = POINT_OFFSET * p.abs().max_element().max(1.0);
        // Half a texel's diagonal: a crease may stand out as far within the texel.
        let more = std::f64::consts::FRAC_1_SQRT_2 * depth / view.focal;
        let receiver = Receiver {
            local: p,
            at,
            inverse_depth: 1.0 / depth,
            normal,
            height: normal.dot(view.camera.rotation * (p - view.camera.eye)),
            slack: if n == DVec3::ZERO {
                slack + more
            } else {
                slack
            },
        };
        (receiver, depth)
    }

    /// Height of a direction over the tangent plane's directions.
    #[inline(always)]
    pub(super) fn along(&self, direction: DVec3) -> f64 {
        self.normal.dot(direction)
    }

    /// What [`Receiver::along`] is compared with at an inverse depth of 1.
    #[inline(always)]
    pub(super) fn reach(&self, slack: f64) -> f64 {
        self.height + slack
    }

    /// Whether the point along a direction of depth 1 is over the receiver's tangent plane by more than the slack.
    #[inline(always)]
    pub(super) fn is_below(&self, direction: DVec3, inverse_depth: f64, slack: f64) -> bool {
        self.along(direction) > inverse_depth * self.reach(slack)
    }
}

/// First corners of the four texels around an image point, and the point's part of the way from the first to the last.
#[inline(always)]
pub(super) fn around(view: &View, at: DVec2) -> ([DVec2; 4], DVec2) {
    let last = view.last();
    let corner = at - 0.5;
    // In two steps, since `floor` is a call where the instruction set is not known to have it.
    let base = DVec2::new(
        (corner.x + 1.0) as i32 as f64,
        (corner.y + 1.0) as i32 as f64,
    ) - 1.0;
    let place = |i: f64, j: f64| (base + DVec2::new(i, j)).max(DVec2::ZERO).min(last);
    let places = [
        place(0.0, 0.0),
        place(1.0, 0.0),
        place(0.0, 1.0),
        place(1.0, 1.0),
    ];
    (places, corner - base)
}

/// A triangle's plane, of what is asked for again and again by neighbours.
#[derive(Clone, Copy)]
pub(super) struct TrianglePlane {
    corners: [Vec3; 3],
    /// Unit normal, to the light's side.
    pub normal: DVec3,
    /// Distance from the light's centre.
    pub towards: f64,
    /// Twice the triangle's area.
    pub double_area: f64,
}

impl TrianglePlane {
    /// The plane of a triangle that a light at `eye` sees, if it has one.
    fn new(corners: [Vec3; 3], eye: DVec3) -> Option<TrianglePlane> {
        let [a, b, c] = corners.map(|v| v.as_dvec3());
        let cross = (b - a).cross(c - a);
        let normal = cross.try_normalize()?;
        let towards = normal.dot(eye - a);
        Some(TrianglePlane {
            corners,
            normal: if towards < 0.0 { -normal } else { normal },
            towards: towards.abs(),
            double_area: cross.length(),
        })
    }

    /// Whether a receiver is on the dark side by more than the slack.
    #[inline(always)]
    pub(super) fn hides(&self, receiver: &Receiver, slack: f64) -> bool {
        let [point, ..] = self.corners;
        self.normal.dot(receiver.local - point.as_dvec3()) < -slack
    }

    /// Whether some of the triangle is nearer than a receiver: a plane that is seen almost edge-on may pass over
    /// a receiver that is nearer than its triangle.
    #[inline(always)]
    pub(super) fn starts_before(&self, camera: &Camera, receiver: &Receiver) -> bool {
        let forward = camera.rotation.transpose().z_axis;
        let depth = |v: Vec3| forward.dot(v.as_dvec3() - camera.eye);
        let [a, b, c] = self.corners.map(depth);
        a.min(b).min(c) * receiver.inverse_depth < 1.0
    }
}

/// Planes that a lookup keeps: those that the four texels around a receiver and its neighbours show.
const PLANES: usize = 16;

/// The planes found last for a light, by their triangles' numbers; `None` for a triangle without area.
pub(super) struct Planes {
    last: [(u32, Option<TrianglePlane>); PLANES],
}

impl Planes {
    pub(super) fn new() -> Self {
        Planes {
            last: [(NONE, None); PLANES],
        }
    }

    /// The plane of a triangle.
    #[inline(always)]
    pub(super) fn get(
        &mut self,
        geometry: &Geometry,
        maps: &Maps,
        triangle: u32,
    ) -> Option<&TrianglePlane> {
        let last = &mut self.last[triangle as usize % PLANES];
        if last.0 != triangle {
            let plane = TrianglePlane::new(geometry.corners(triangle), maps.view.camera.eye);
            *last = (triangle, plane);
        }
        last.1.as_ref()
    }
}
