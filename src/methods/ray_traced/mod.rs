//! The reference: stratified light samples traced against the bounding volume hierarchy (the ray
//! tracing that Xie, Tabellion and Pearce 2007, Section 3, measure their shadow maps against).
//!
//! Every receiver has its own scrambled samples of the light, or all have the same ones. A sample counts
//! as blocked under the receiver's tangent plane or behind the light; the others are traced, opaque
//! triangles sixteen segments at a time, transparent ones and spheres segment by segment. Visibility is
//! the mean transmittance; irradiance weights every sample by its cosines and solid angle.
//!
//! **Tracing only what a scene needs** (`cull`). Seen from a receiver, the light changes between hidden
//! and seen only across silhouette edges (see [`crate::bvh::outline`]). Per group of receivers, the edges
//! that can be silhouettes in the shaft to the light are collected from the hierarchy ([`group`]); per
//! receiver, those that are, are drawn conservatively into a grid over the light ([`grid`]). Samples in
//! a connected part of the grid that no edge touches share one traced segment; the rest are traced one
//! by one. Since every doubt is decided towards tracing, the result is the same to the last bit as
//! without; tests hold it to that. Most receivers see no edge at all and need one segment.
//!
//! Where culling does not apply: a light that a triangle cuts or touches, spheres in the shaft, a
//! sphere light so near that it fills most of the hemisphere, a group with more than [`MOST_EDGES`]
//! candidate edges (foliage, hair). Then all samples are traced.

mod grid;
mod group;

use std::sync::Arc;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{Method, Prepared, Shading};
use crate::bvh::Occluders;
use crate::bvh::outline::touches_light;
use crate::bvh::packet::Packet;
use crate::control::Control;
use crate::error::{Error, Result};
use crate::geometry::Geometry;
use crate::light::Light;
use crate::receivers::Receivers;
use crate::sampling::{LightSamples, Pattern, Sampler};
use crate::simd::{LANES, Row};
use grid::Grid;
use group::{Found, Group};

/// Most samples a receiver.
pub const MOST_SAMPLES: usize = 1 << 16;

/// Most candidate edges of a group. Beyond, the group is halved, or its samples are all traced: looking
/// at so many edges costs as much. Half and twice as many make no difference to speed.
pub const MOST_EDGES: usize = 1024;

/// Parameters of the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RayTraced {
    /// Light samples a receiver.
    pub samples: usize,
    /// Seed of the light samples.
    pub seed: u64,
    /// Whether all receivers share the same light points.
    pub fixed: bool,
    /// Whether to trace only what the silhouettes leave open.
    pub cull: bool,
}

impl RayTraced {
    /// Checks the parameters.
    ///
    /// # Errors
    /// A number of samples outside 1 to [`MOST_SAMPLES`].
    pub fn new(samples: i64, seed: u64, fixed: bool, cull: bool) -> Result<Self> {
        if !(1..=MOST_SAMPLES as i64).contains(&samples) {
            let reason = format!("samples must be 1 to {MOST_SAMPLES}, got {samples}");
            return Err(Error::parameter("RayTraced", reason));
        }
        Ok(RayTraced { samples: samples as usize, seed, fixed, cull })
    }
}

impl Method for RayTraced {
    fn name(&self) -> &'static str {
        "ray_traced"
    }

    fn prepare(
        &self,
        geometry: Arc<Geometry>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        control.check()?;
        let occluders = geometry.occluders();
        control.check()?;
        let pattern = Pattern::new(self.samples, self.seed);
        let lights = lights
            .iter()
            .enumerate()
            .map(|(number, light)| {
                let light = light.to_local(&geometry.frame);
                let mut stack = Vec::new();
                let mut touches = |bvh| touches_light(bvh, &light, &mut stack);
                let cut = touches(&occluders.opaque)
                    || occluders.transparent.as_ref().is_some_and(|(bvh, _)| touches(bvh));
                let sampler = Sampler::new(light, number as u32, pattern.clone(), self.fixed);
                PreparedLight { sampler, cull: self.cull && !cut }
            })
            .collect::<Vec<_>>();
        if lights.iter().any(|l| l.cull) {
            occluders.opaque.outline(&geometry);
            if let Some((bvh, _)) = &occluders.transparent {
                bvh.outline(&geometry);
            }
        }
        Ok(Box::new(PreparedRayTraced { geometry, lights }))
    }
}

struct PreparedLight {
    sampler: Sampler,
    cull: bool,
}

struct PreparedRayTraced {
    geometry: Arc<Geometry>,
    lights: Vec<PreparedLight>,
}

impl Prepared for PreparedRayTraced {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        control.expect(receivers.groups.len().saturating_sub(1));
        let parts: Vec<Vec<[f32; 2]>> = receivers
            .group_ranges()
            .map_init(Scratch::default, |scratch, range| {
                control.step()?;
                Ok(self.shade_group(receivers, range, &self.lights[light], scratch))
            })
            .collect::<Result<_>>()?;
        let all = || parts.iter().flatten();
        Ok(Shading {
            visibility: all().map(|v| v[0]).collect(),
            irradiance: Some(all().map(|v| v[1]).collect()),
        })
    }

    fn bytes(&self) -> usize {
        self.geometry.occluders().bytes()
    }
}

/// What a thread keeps between receivers.
#[derive(Default)]
struct Scratch {
    tracer: Tracer,
    samples: LightSamples,
    group: Group,
    grid: Grid,
    /// Transmittance of each sample.
    through: Vec<Row>,
    /// Samples to trace, and for the grid's parts which samples each stands for.
    open: Vec<u32>,
    /// Where the rays of the receivers at hand start.
    origins: Vec<Vec3>,
    /// Receivers without an edge, that wait for a full packet, and their sums if they are lit.
    waiting: Vec<(usize, [f32; 2])>,
}

#[derive(Default)]
struct Tracer {
    packet: Packet,
    stack: Vec<u32>,
}

impl PreparedRayTraced {
    /// Visibility and irradiance of every receiver of a group.
    fn shade_group(
        &self,
        receivers: &Receivers,
        range: std::ops::Range<usize>,
        light: &PreparedLight,
        s: &mut Scratch,
    ) -> Vec<[f32; 2]> {
        let mut out = vec![[0.0f32; 2]; range.len()];
        let first = range.start;
        let mut ids: Vec<usize> = range.collect();
        self.shade_neighbours(receivers, &mut ids, light, s, &mut |i, value| out[i - first] = value);
        out
    }

    /// Shades receivers that share their candidate edges; halves them where there are too many.
    fn shade_neighbours(
        &self,
        receivers: &Receivers,
        ids: &mut [usize],
        light: &PreparedLight,
        s: &mut Scratch,
        put: &mut impl FnMut(usize, [f32; 2]),
    ) {
        s.origins.clear();
        s.origins.extend(ids.iter().map(|&i| receivers.ray_origin(i)));
        let found = if light.cull {
            s.group.collect(&self.geometry, &light.sampler, &s.origins)
        } else {
            Found::NotHere
        };
        if let Found::Split(axis, middle) = found {
            let key = |&i: &usize| receivers.positions[i][axis] < middle;
            ids.sort_by_key(key);
            let (low, high) = ids.split_at_mut(ids.partition_point(|i| !key(i)));
            if !low.is_empty() && !high.is_empty() {
                self.shade_neighbours(receivers, low, light, s, put);
                self.shade_neighbours(receivers, high, light, s, put);
                return;
            }
        }
        self.shade_each(receivers, ids, light, matches!(found, Found::All), s, put);
    }

    /// Shades receivers one by one; `known`: the group holds the edges that they must heed.
    fn shade_each(
        &self,
        receivers: &Receivers,
        ids: &[usize],
        light: &PreparedLight,
        known: bool,
        s: &mut Scratch,
        put: &mut impl FnMut(usize, [f32; 2]),
    ) {
        let occluders = self.geometry.occluders();
        // One segment for a whole receiver can wait for others only where it is all or nothing:
        // otherwise its sums must be made sample by sample, to give the same bits as without culling.
        let binary = occluders.transparent.is_none() && occluders.spheres.is_none();
        s.waiting.clear();
        for (k, &i) in ids.iter().enumerate() {
            let (p, n) = (receivers.positions[i], receivers.normals[i]);
            light.sampler.fill(receivers.index[i], p, n, &mut s.samples);
            let Some(first) = first_valid(&s.samples) else {
                put(i, [0.0; 2]);
                continue;
            };
            let settled = known && s.group.has_view(k);
            if settled && binary && s.group.edges(k).next().is_none() {
                s.tracer.packet.set(s.waiting.len(), s.origins[k], s.samples.point(first));
                s.waiting.push((i, sums(&s.samples, None)));
                if s.waiting.len() == LANES {
                    settle_waiting(occluders, &mut s.tracer, &mut s.waiting, put);
                }
                continue;
            }
            // The packet is in use by those who wait.
            settle_waiting(occluders, &mut s.tracer, &mut s.waiting, put);
            let drawn = settled && {
                s.samples.find_cells();
                s.grid.clear();
                s.group.edges(k).all(|edge| s.grid.mark(edge))
            };
            trace_samples(occluders, s.origins[k], drawn, s);
            put(i, sums(&s.samples, Some(&s.through)));
        }
        settle_waiting(occluders, &mut s.tracer, &mut s.waiting, put);
    }
}

/// Traces one segment for every receiver that waits and passes on its sums, or 0 where it is hidden.
fn settle_waiting(
    occluders: &Occluders,
    tracer: &mut Tracer,
    waiting: &mut Vec<(usize, [f32; 2])>,
    put: &mut impl FnMut(usize, [f32; 2]),
) {
    if waiting.is_empty() {
        return;
    }
    let active = u16::MAX >> (LANES - waiting.len());
    let mut through = [0.0; LANES];
    occluders.transmittance(&tracer.packet, active, &mut tracer.stack, &mut through);
    for ((i, sums), t) in waiting.drain(..).zip(through) {
        put(i, if t == 0.0 { [0.0; 2] } else { sums });
    }
}

/// Fills `s.through`; `drawn`: the grid knows which samples share their answer.
fn trace_samples(occluders: &Occluders, origin: Vec3, drawn: bool, s: &mut Scratch) {
    let samples = &s.samples;
    s.through.clear();
    s.through.resize(samples.valid.len(), Row::default());
    s.open.clear();
    for (r, &valid) in samples.valid.iter().enumerate() {
        for lane in bits(valid) {
            if !drawn || s.grid.claim(samples.cells[r][lane]) {
                s.open.push((r * LANES + lane) as u32);
            }
        }
    }
    for ids in s.open.chunks(LANES) {
        for (lane, &id) in ids.iter().enumerate() {
            s.tracer.packet.set(lane, origin, samples.point(id as usize));
        }
        let active = u16::MAX >> (LANES - ids.len());
        let mut through = [0.0; LANES];
        occluders.transmittance(&s.tracer.packet, active, &mut s.tracer.stack, &mut through);
        for (&id, t) in ids.iter().zip(through) {
            let (r, lane) = (id as usize / LANES, id as usize % LANES);
            s.through[r].0[lane] = t;
            if drawn {
                s.grid.learn(samples.cells[r][lane], t);
            }
        }
    }
    if drawn {
        for (r, &valid) in samples.valid.iter().enumerate() {
            for lane in bits(valid) {
                if let Some(t) = s.grid.known(samples.cells[r][lane]) {
                    s.through[r].0[lane] = t;
                }
            }
        }
    }
}

fn bits(mut mask: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (lane < LANES).then_some(lane)
    })
}

fn first_valid(samples: &LightSamples) -> Option<usize> {
    let row = samples.valid.iter().position(|&v| v != 0)?;
    Some(row * LANES + samples.valid[row].trailing_zeros() as usize)
}

/// Visibility and irradiance from each sample's transmittance, or with every valid sample seen.
///
/// Sixteen partial sums in `f32`, then one in order. With every transmittance 0 or 1 both ways give the
/// same bits: counts are exact, and products with 1 are the weights themselves.
fn sums(samples: &LightSamples, through: Option<&[Row]>) -> [f32; 2] {
    let (mut seen, mut light) = (Row::default(), Row::default());
    match through {
        None => {
            seen.0[0] = samples.valid.iter().map(|v| v.count_ones()).sum::<u32>() as f32;
            for weights in &samples.weights {
                for lane in 0..LANES {
                    light.0[lane] += weights.0[lane];
                }
            }
        }
        Some(through) => {
            for (weights, t) in samples.weights.iter().zip(through) {
                for lane in 0..LANES {
                    seen.0[lane] += t.0[lane];
                    light.0[lane] += weights.0[lane] * t.0[lane];
                }
            }
        }
    }
    let total = |row: Row| row.0.iter().sum::<f32>();
    [(total(seen) / samples.count as f32).min(1.0), total(light)]
}

/// Receivers and lights are in `f64`, rays in `f32`; this is where they meet.
#[inline]
fn relative(p: Vec3, origin: Vec3) -> Vec3 {
    (p.as_dvec3() - DVec3::from(origin)).as_vec3()
}
