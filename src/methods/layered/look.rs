//! One receiver's light samples in one map: where they are seen there, and what hides them.

use glam::{DVec3, Vec3};

use super::masks::{Axis, BLOCK, Mask};
use super::near::Near;
use super::pencil::{Pencil, Place, Receiver, SampleVisibility, Tracing};
use super::tracing::{Stack, trace};
use crate::maps::layers::map::LayerMap;
use crate::sampling::{LightSamples, Sampler};
use crate::simd::{LANES, Row};

/// The samples of a flat light in a map that is drawn along its normal: they are the same for all receivers.
pub(super) struct FlatTargets {
    /// Columns and rows, block by block.
    axes: Vec<[Axis; 2]>,
    /// Their points, local.
    points: [Vec<Row>; 3],
    /// Inverse depth of all of them.
    inverse_depth: f64,
}

impl FlatTargets {
    /// Targets in the only map of a group; `None` if there are several maps, or if the light's samples differ in depth
    /// there.
    pub(super) fn new(sampler: &Sampler, maps: &[LayerMap]) -> Option<Self> {
        let (light, [map]) = (sampler.light(), maps) else {
            return None;
        };
        let normal = light.normal()?;
        let axis = map.view.camera.rotation.row(2);
        if axis.cross(normal).length() > ALONG || axis.dot(normal) < 0.0 {
            return None;
        }
        let mut samples = LightSamples::default();
        sampler.fill(0, light.center() + normal, DVec3::ZERO, &mut samples);
        let mut axes = Vec::new();
        let mut inverse_depth = 0.0f64;
        for start in (0..samples.count).step_by(BLOCK) {
            let points = start..(start + BLOCK).min(samples.count);
            let projected: Vec<DVec3> = points
                .map(|i| map.view.project(samples.point(i).as_dvec3()))
                .collect();
            let mut pair = [Axis::default(), Axis::default()];
            for (k, axis) in pair.iter_mut().enumerate() {
                let coordinates: Vec<f32> = projected.iter().map(|p| p[k] as f32).collect();
                axis.set(&coordinates, Mask::first(coordinates.len()));
            }
            axes.push(pair);
            // They differ by the rounding of the points.
            let largest = projected.iter().map(|p| p.z).fold(0.0, f64::max);
            inverse_depth = inverse_depth.max(largest);
        }
        Some(FlatTargets {
            axes,
            points: samples.points,
            inverse_depth,
        })
    }
}

/// Sine of the angle between a flat light's normal and a map's axis up to which they are one: it puts the light's
/// points apart in depth by as little as rounding does.
const ALONG: f64 = f32::EPSILON as f64;

/// What a thread keeps between receivers.
#[derive(Default)]
pub(super) struct Scratch {
    pub(super) samples: LightSamples,
    pub(super) stack: Stack,
    pub(super) nodes: Vec<u32>,
    pub(super) axes: [Axis; 2],
    pub(super) slopes: [Vec<f32>; 2],
}

/// One receiver's look into one map.
pub(super) struct Look<'a> {
    pub(super) map: &'a LayerMap,
    /// What answers before the map.
    pub(super) near: Option<&'a Near>,
    pub(super) tracing: &'a Tracing,
    pub(super) receiver: &'a Receiver,
}

impl Look<'_> {
    /// Removes what is hidden of the samples at `points`, before the map takes over and then in it.
    pub(super) fn along(
        &self,
        mut pencil: Pencil<'_>,
        points: [&[Row]; 3],
        seen: &mut SampleVisibility,
        stack: &mut Stack,
        nodes: &mut Vec<u32>,
    ) {
        let (map, how) = (self.map, self.tracing);
        if let Some(near) = self.near {
            pencil.near = near.depth(&pencil);
            let place = Place {
                map: self.map,
                tracing: self.tracing,
                receiver: self.receiver,
            };
            near.hide(place, &pencil, points, seen, nodes);
        }
        trace(map, how, &pencil, seen, stack);
    }

    /// Looks at the samples of a block of a flat light.
    pub(super) fn flat(
        &self,
        targets: &FlatTargets,
        block: usize,
        seen: &mut SampleVisibility,
        s: &mut Scratch,
    ) {
        let start = self.map.view.project(self.receiver.p);
        let ahead = targets.inverse_depth - start.z;
        if start.z <= 0.0 || ahead <= 0.0 || !start.is_finite() {
            return;
        }
        let [columns, rows] = &targets.axes[block];
        let slopes = |axis: &Axis, from: f64| {
            let low = (f64::from(axis.low) - from) / ahead;
            [low as f32, (f64::from(axis.extent) / ahead) as f32]
        };
        let pencil = Pencil {
            start,
            columns: slopes(columns, start.x),
            rows: slopes(rows, start.y),
            axes: Some([columns, rows]),
            end: targets.inverse_depth as f32,
            plane: tangent_plane(self.map, self.receiver),
            near: 0.0,
        };
        let points = rows_from(&targets.points, block * BLOCK);
        self.along(pencil, points, seen, &mut s.stack, &mut s.nodes);
    }

    /// Looks at the samples of a receiver, which are at hand, from the `first` on.
    pub(super) fn each(
        &self,
        first: usize,
        count: usize,
        seen: &mut SampleVisibility,
        s: &mut Scratch,
    ) {
        let view = &self.map.view;
        let start = view.project(self.receiver.p);
        if start.z <= 0.0 || !start.is_finite() {
            return;
        }
        for slopes in &mut s.slopes {
            slopes.clear();
            slopes.resize(count, 0.0);
        }
        let mut ahead = Mask::NONE;
        let (mut nearest, mut farthest) = (0.0f64, f64::INFINITY);
        for i in 0..count {
            let q = view.project(s.samples.point(first + i).as_dvec3());
            let step = q.z - start.z;
            // A light point that is no nearer to the eye than the receiver: nothing is between them that the map
            // could tell from the light.
            if step > 0.0 && q.z.is_finite() {
                ahead.0[i / 64] |= 1 << (i % 64);
                s.slopes[0][i] = ((q.x - start.x) / step) as f32;
                s.slopes[1][i] = ((q.y - start.y) / step) as f32;
                (nearest, farthest) = (nearest.max(q.z), farthest.min(q.z));
            }
        }
        let valid = ahead & seen.open;
        if valid.is_empty() {
            return;
        }
        let Scratch {
            axes,
            slopes,
            stack,
            nodes,
            samples,
        } = s;
        for (axis, slopes) in axes.iter_mut().zip(slopes) {
            axis.set(slopes, valid);
        }
        let pencil = Pencil {
            start,
            columns: [axes[0].low, axes[0].extent],
            rows: [axes[1].low, axes[1].extent],
            axes: Some([&axes[0], &axes[1]]),
            // Between the nearest and the farthest of the light's points (Section 4.3).
            end: (0.5 * (nearest + farthest)) as f32,
            plane: tangent_plane(self.map, self.receiver),
            near: 0.0,
        };
        let mut traced = SampleVisibility {
            open: valid,
            through: seen.through,
        };
        let points = rows_from(&samples.points, first);
        self.along(pencil, points, &mut traced, stack, nodes);
        seen.open = seen.open.without(valid) | traced.open;
        seen.through = traced.through;
    }
}

/// The rows of light points from a sample on.
fn rows_from(points: &[Vec<Row>; 3], first: usize) -> [&[Row]; 3] {
    points.each_ref().map(|axis| &axis[first / LANES..])
}

/// How the height over a receiver's tangent plane, times inverse depth, grows in a map.
pub(super) fn tangent_plane(map: &LayerMap, receiver: &Receiver) -> [f32; 3] {
    let Receiver { p, n, .. } = *receiver;
    let camera = &map.view.camera;
    let seen = camera.rotation * n;
    let per_texel = 1.0 / map.view.focal;
    let plane = Vec3::new(
        (seen.x * per_texel) as f32,
        (seen.y * per_texel) as f32,
        n.dot(camera.eye - p) as f32,
    );
    plane.to_array()
}
