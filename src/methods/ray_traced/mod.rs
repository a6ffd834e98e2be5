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
//! that can be silhouettes in the shaft to the light are collected from the hierarchy (`group`); per
//! receiver, those that are, are projected onto the light (`project`) and drawn conservatively into a grid
//! over it (`grid`). Samples in a connected part of the grid that no edge touches share one traced segment;
//! the rest are traced one by one. A group's segments are sorted by where on the light they end, so that
//! sixteen go together that are nearly the same. Since every doubt is decided towards tracing, the result is
//! the same to the last bit as without; tests hold it to that. Most receivers see no edge at all and need
//! one segment.
//!
//! Where culling does not apply: a scene whose meshes are instances, a light that a triangle cuts or touches, spheres in the shaft, a
//! sphere light so near that it fills most of the hemisphere, a group with more than `MOST_EDGES`
//! candidate edges (foliage, hair), or more than pay for its samples (`EDGES_A_SAMPLE`), and some groups
//! after it (`group::Pause`). Then all samples are traced.

mod adaptive;
mod batch;
mod grid;
mod group;
mod project;

use crate::sampling::MOST_SAMPLES;
use crate::scene::snapshot::Snapshot;
use std::sync::Arc;

use glam::Vec3;

use crate::adaptive::LEAST_ERROR;
use crate::bvh::outline::touches_light;
use crate::control::Control;
use crate::error::{Error, Result, in_range};
use crate::light::Light;
use crate::method::{Irradiance, Method, Prepared, Shading};
use crate::receivers::Receivers;
use crate::sampling::shaft::halves;
use crate::sampling::tracing::{Sums, Tracer, bits};
use crate::sampling::{GRID, LightSamples, Pattern, Sampler};
use crate::simd::{LANES, Row};
use batch::Batch;
use grid::Grid;
use group::{EdgeCells, Group, Pause, SearchResult};

/// Most candidate edges of a group. Beyond, the group is halved, or its samples are all traced: looking
/// at so many edges costs as much. Half and twice as many make no difference to speed.
const MOST_EDGES: usize = 1024;

/// Most candidate edges for each sample of a receiver: looking at more costs as much as tracing it. Twice as
/// many are up to 9 % slower with 16 samples, half as many up to 20 % with 64.
const EDGES_A_SAMPLE: usize = 8;

/// Parameters of the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayTraced {
    /// Light samples a receiver.
    pub samples: u32,
    /// Seed of the light samples.
    pub seed: u64,
    /// Whether all receivers share the same light points.
    pub fixed: bool,
    /// Whether to trace only what the silhouettes leave open.
    pub cull: bool,
    /// Root mean square error of visibility at which sampling ends; otherwise every receiver has all samples.
    pub error: Option<f64>,
}

impl RayTraced {
    /// Checks the parameters.
    ///
    /// # Errors
    /// What is out of its range.
    pub fn checked(self) -> Result<Self> {
        in_range("RayTraced", "samples", self.samples, 1..=MOST_SAMPLES)?;
        if let Some(error) = self.error {
            in_range("RayTraced", "error", error, LEAST_ERROR..=1.0)?;
            if self.fixed {
                let reason = "\"fixed\" light points have errors that neighbours share; an error needs \"per_receiver\"";
                return Err(Error::parameter("RayTraced.pattern", reason));
            }
        }
        Ok(self)
    }
}

impl Method for RayTraced {
    fn name(&self) -> &'static str {
        "ray_traced"
    }

    fn takes_instances(&self) -> bool {
        true
    }

    fn prepare(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        control.check()?;
        let occluders = geometry.occluders();
        control.check()?;
        let steps = adaptive::patterns(self);
        let lights = lights
            .iter()
            .map(|light| {
                let mut stack = Vec::new();
                let mut touches = |bvh| touches_light(bvh, light, &mut stack);
                let cut = touches(&occluders.opaque)
                    || occluders
                        .transparent
                        .as_ref()
                        .is_some_and(|(bvh, _)| touches(bvh));
                let step = |(k, pattern): (usize, &Pattern)| PreparedLight {
                    sampler: Sampler::new(light.clone(), pattern.clone(), self.fixed),
                    // Receivers that need more samples than the first have edges before their light.
                    // Instances have no list of edges.
                    cull: self.cull && !cut && k == 0 && occluders.placed.is_none(),
                };
                steps.iter().enumerate().map(step).collect()
            })
            .collect::<Vec<Vec<_>>>();
        if lights.iter().flatten().any(|l| l.cull) {
            occluders.opaque.outline(&geometry);
            if let Some((bvh, _)) = &occluders.transparent {
                bvh.outline(&geometry);
            }
        }
        Ok(Box::new(PreparedRayTraced {
            geometry,
            lights,
            error: self.error,
        }))
    }
}

struct PreparedLight {
    sampler: Sampler,
    cull: bool,
}

struct PreparedRayTraced {
    geometry: Arc<Snapshot>,
    /// Each light, with the samples of every step.
    lights: Vec<Vec<PreparedLight>>,
    error: Option<f64>,
}

impl Prepared for PreparedRayTraced {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        if let Some(error) = self.error {
            return self.shade_within(error, receivers, &self.lights[light], control);
        }
        let light = &self.lights[light][0];
        let both = receivers.by_groups(
            control,
            [0.0; 2],
            Scratch::default,
            |scratch, range, out| {
                let first = range.start;
                let mut ids: Vec<usize> = range.collect();
                let mut put = |i: usize, answer: Answer| out[i - first] = answer.sums.both;
                self.shade_group(receivers, &mut ids, light, scratch, &mut put);
                Ok(())
            },
        )?;
        Ok(Shading {
            visibility: both.iter().map(|v| v[0]).collect(),
            irradiance: Some(Irradiance::Whole(both.iter().map(|v| v[1]).collect())),
            by_rays: 0,
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
    batch: Batch,
    samples: LightSamples,
    group: Group,
    pause: Pause,
    grid: Grid,
    /// Where the rays of the receivers at hand start.
    origins: Vec<Vec3>,
    /// Transmittance of each sample of one receiver.
    through: Vec<Row>,
    /// Receivers whose segments are still to be traced.
    pending: Vec<Pending>,
    /// Weights of the pending receivers' samples, and the segment that answers for each.
    weights: Vec<Row>,
    sources: Vec<[u32; LANES]>,
}

/// What is found for a receiver.
#[derive(Debug, Clone, Copy, Default)]
struct Answer {
    sums: Sums,
    /// Whether all of the light that is above the tangent plane is seen alike.
    whole: bool,
}

impl Answer {
    /// Where some of the light may be seen and some not.
    fn in_parts(sums: Sums) -> Self {
        Answer { sums, whole: false }
    }
}

/// A receiver that waits for its segments.
enum Pending {
    /// One segment decides between this and nothing.
    Whole {
        receiver: usize,
        segment: u32,
        seen: Sums,
    },
    /// Every sample has a segment, from this row on.
    Parts {
        receiver: usize,
        row: usize,
        whole: bool,
    },
}

/// Marks a sample that is not valid and has no segment.
const NO_SEGMENT: u32 = u32::MAX;

/// The grid cell that the light's middle lies in.
const MIDDLE: u16 = (GRID * GRID / 2 + GRID / 2) as u16;

impl PreparedRayTraced {
    /// Shades receivers that are neighbours, with culling where it applies and may pay.
    fn shade_group(
        &self,
        receivers: &Receivers,
        ids: &mut [usize],
        light: &PreparedLight,
        s: &mut Scratch,
        put: &mut impl FnMut(usize, Answer),
    ) {
        if light.cull && s.pause.is_over() {
            let too_many = self.shade_neighbours(receivers, ids, light, s, put);
            s.pause.searched(too_many);
        } else {
            s.set_origins(receivers, ids);
            self.shade_each(receivers, ids, light, false, s, put);
        }
    }

    /// Shades receivers that share their candidate edges; halves them where there are too many. Returns whether
    /// there still were for some.
    fn shade_neighbours(
        &self,
        receivers: &Receivers,
        ids: &mut [usize],
        light: &PreparedLight,
        s: &mut Scratch,
        put: &mut impl FnMut(usize, Answer),
    ) -> bool {
        s.set_origins(receivers, ids);
        let found = s.group.collect(&self.geometry, &light.sampler, &s.origins);
        if let SearchResult::Split(middle) = found
            && let Some([low, high]) = halves(receivers, ids, middle)
        {
            let one = self.shade_neighbours(receivers, low, light, s, put);
            return self.shade_neighbours(receivers, high, light, s, put) || one;
        }
        let known = found == SearchResult::All;
        self.shade_each(receivers, ids, light, known, s, put);
        !known && found != SearchResult::NotHere
    }

    /// Shades receivers, whose rays' origins are at hand, one by one; `known`: the group holds the edges that
    /// they must heed.
    fn shade_each(
        &self,
        receivers: &Receivers,
        ids: &[usize],
        light: &PreparedLight,
        known: bool,
        s: &mut Scratch,
        put: &mut impl FnMut(usize, Answer),
    ) {
        let occluders = self.geometry.occluders();
        // One segment can stand for a receiver's sums only where it is all or nothing: otherwise they
        // must be made sample by sample, to give the same bits as without culling.
        let binary = occluders.is_binary();
        s.pending.clear();
        s.weights.clear();
        s.sources.clear();
        for (k, &i) in ids.iter().enumerate() {
            let (p, n) = (s.origins[k].as_dvec3(), receivers.normals[i]);
            light.sampler.fill(receivers.index[i], p, n, &mut s.samples);
            if s.samples.valid.iter().all(|&v| v == 0) {
                put(i, Answer::default());
                continue;
            }
            let seen = if known {
                s.group.seen_by(k)
            } else {
                EdgeCells::Unclear
            };
            match seen {
                EdgeCells::NoEdge if binary => {
                    // Any light point will do; the same for neighbours keeps their segments together.
                    let segment = s.tracer.add(k, MIDDLE, light.sampler.middle(p));
                    s.pending.push(Pending::Whole {
                        receiver: i,
                        segment,
                        seen: Sums::of_valid(&s.samples),
                    });
                }
                EdgeCells::NoEdge | EdgeCells::Edges(_) => {
                    let marked = if let EdgeCells::Edges(cells) = seen {
                        cells
                    } else {
                        &[0; GRID]
                    };
                    s.grid.connect(marked, light.sampler.is_disk());
                    s.pending.push(Pending::Parts {
                        receiver: i,
                        row: s.weights.len(),
                        whole: matches!(seen, EdgeCells::NoEdge),
                    });
                    s.share_segments(k);
                }
                EdgeCells::Unclear if 2 * s.samples.count <= LANES => {
                    if !s.batch.fits(&s.samples) {
                        s.batch.trace(occluders, put);
                    }
                    s.batch.add(i, s.origins[k], &s.samples);
                }
                EdgeCells::Unclear => {
                    let (tracer, samples) = (&mut s.tracer, &s.samples);
                    put(
                        i,
                        Answer::in_parts(tracer.trace_samples(occluders, s.origins[k], samples)),
                    );
                }
            }
        }
        s.batch.trace(occluders, put);
        s.tracer.trace(occluders, &s.origins);
        let rows = s.samples.weights.len();
        for pending in &s.pending {
            match *pending {
                Pending::Whole {
                    receiver,
                    segment,
                    seen,
                } => {
                    let hidden = s.tracer.through(segment) == 0.0;
                    let sums = if hidden { seen.hidden() } else { seen };
                    put(receiver, Answer { sums, whole: true });
                }
                Pending::Parts {
                    receiver,
                    row,
                    whole,
                } => {
                    s.through.clear();
                    s.through.extend(
                        s.sources[row..row + rows]
                            .iter()
                            .map(|sources| Row(sources.map(|x| s.tracer.through(x)))),
                    );
                    let weights = &s.weights[row..row + rows];
                    let sums = Sums::new(weights, &s.through, s.samples.count);
                    put(receiver, Answer { sums, whole });
                }
            }
        }
    }
}

impl Scratch {
    fn set_origins(&mut self, receivers: &Receivers, ids: &[usize]) {
        self.origins.clear();
        self.origins
            .extend(ids.iter().map(|&i| receivers.ray_origin(i)));
    }

    /// Finds the segments that answer for the samples of receiver `k`, which are at hand.
    fn share_segments(&mut self, k: usize) {
        self.samples.find_cells();
        let Scratch {
            samples,
            grid,
            tracer,
            ..
        } = self;
        for (r, &valid) in samples.valid.iter().enumerate() {
            let mut sources = [NO_SEGMENT; LANES];
            for lane in bits(valid) {
                let sample = r * LANES + lane;
                let cell = samples.cells[r][lane];
                sources[lane] = grid.segment(cell, || tracer.add(k, cell, samples.point(sample)));
            }
            self.sources.push(sources);
        }
        self.weights.extend_from_slice(&self.samples.weights);
    }
}
