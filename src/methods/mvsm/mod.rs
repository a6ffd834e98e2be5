//! Ray-traced multi-view shadow maps (Agrawala, Ramamoorthi, Heirich and Moll 2000).
//!
//! Plain shadow maps from several points of the light: its centre, then its corners. A segment from a receiver
//! to a light sample is followed through the first map ([`trace`]); only what of it that map's eye does not see
//! is followed through the next, and so on. What no view sees counts as free. Blockers are coherent: the texel
//! that blocked the sample before, and the one that blocked the same sample of the receiver before, are tried
//! first.
//!
//! Assumptions and failures, as the paper and its successor (Xie, Tabellion and Pearce 2007) state them: what
//! no view sees lets light through; gaps between texels are closed by a threshold, which closes holes of
//! that depth too, and leaves open what is steeper; where edges are as fine as texels, in fur and
//! foliage, maps alias and coherence does not help. Transparent occluders cannot be modelled. Cost grows with the
//! number of views.

pub mod trace;

use crate::sampling::MOST_SAMPLES;
use crate::scene::snapshot::Snapshot;
use std::sync::Arc;
use std::time::Instant;

use glam::{DVec3, Vec3};

use crate::casters::Casters;
use crate::control::Control;
use crate::error::{Result, in_range};
use crate::far::REACH;
use crate::frame::POINT_OFFSET;
use crate::geometry::Geometry;
use crate::light::Light;
use crate::maps::RESOLUTIONS;
use crate::maps::layers::construction::{Layers, layer_map};
use crate::maps::layers::map::LayerMap;
use crate::maps::layers::views::light_views;
use crate::maps::region::{Region, Source};
use crate::method::{Method, Prepared, Shading};
use crate::receivers::Receivers;
use crate::sampling::{LightSamples, Pattern, Sampler};
use crate::simd::LANES;
use trace::{Blocker, Intervals, Tracer};

/// Most views: the centre, corners, and the middles between them.
pub const MOST_VIEWS: u32 = 9;

/// Widths of a texel that a wall closes. Floors are pieces of planes, so only folds and curves need walls: from 0
/// to 4 the errors are the same to a hundredth, and more close the gaps between leaves.
const GAP: f64 = 2.0;

/// Widths of a texel that a segment starts off its receiver: within that a curved surface's own texels may lie
/// above it. Half of it doubles the errors of smooth bodies; twice as much loses contact shadows.
const BIAS: f64 = 3.0;

/// Parameters of multi-view shadow maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mvsm {
    /// Texels on the longer side of a map.
    pub resolution: u32,
    /// Points of the light that maps are drawn from.
    pub views: u32,
    /// Light samples a receiver.
    pub samples: u32,
    /// Seed of the light samples.
    pub seed: u64,
    /// Largest difference of depth that a wall closes, world units.
    pub gap: Option<f64>,
    /// How far off a receiver its segments start, world units.
    pub bias: Option<f64>,
    /// Whether transparent meshes count as opaque.
    pub opaque: bool,
}

impl Mvsm {
    /// Checks the parameters.
    ///
    /// # Errors
    /// What is out of its range.
    pub fn checked(self) -> Result<Self> {
        in_range("Mvsm", "resolution", self.resolution, RESOLUTIONS)?;
        in_range("Mvsm", "views", self.views, 1..=MOST_VIEWS)?;
        in_range("Mvsm", "samples", self.samples, 1..=MOST_SAMPLES)?;
        in_range("Mvsm", "gap", self.gap.unwrap_or(0.0), 0.0..=f64::MAX)?;
        in_range("Mvsm", "bias", self.bias.unwrap_or(0.0), 0.0..=f64::MAX)?;
        Ok(self)
    }
}

/// Points of a light that views are drawn from; one if it has no size.
fn view_points(light: &Light, middle: DVec3, count: usize) -> Vec<DVec3> {
    let center = light.center();
    if light.is_point() {
        return vec![center];
    }
    // Of a sphere the outline that the scene sees, about.
    let axis = (middle - center).try_normalize().unwrap_or(DVec3::Z);
    let (u, v, disk) = light.half_axes(axis);
    let rim = if disk { std::f64::consts::SQRT_2 } else { 1.0 };
    let corners = [(-1.0, -1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, 1.0)]
        .map(|(x, y)| center + (x * u + y * v) / rim);
    let sides = [-u, u, -v, v].map(|d| center + d);
    let all = std::iter::once(center).chain(corners).chain(sides);
    all.take(count).collect()
}

/// A light with its views: of each a list of groups of maps, foremost casters first.
struct Views {
    light: Light,
    sampler: Sampler,
    maps: Vec<LayerMap>,
    /// The whole light as each map sees it.
    sources: Vec<Source>,
    /// For each map, the planes of its triangles, turned towards the light; empty where they are many, or one has the
    /// light on both sides.
    planes: Vec<Vec<(DVec3, f64)>>,
    /// For every view and group of faces, the range of maps in `maps` that belong to it.
    groups: Vec<Vec<std::ops::Range<usize>>>,
}

/// Most planes that a receiver is compared with.
const MOST_PLANES: usize = 64;

/// The planes of a map's triangles in a scene that is far larger than its core, where one texel may hold all of
/// the core and depths say nothing; none if they are many, or one has the light on both sides.
fn planes(geometry: &Geometry, light: &Light, map: &LayerMap) -> Vec<(DVec3, f64)> {
    let faces = &map.view.faces;
    if !geometry.frame.is_core || faces.len() > MOST_PLANES {
        return Vec::new();
    }
    let (low, high) = light.bounds();
    let (center, half) = (0.5 * (low + high), 0.5 * (high - low));
    let plane = |&face: &u32| {
        let [a, b, c] = geometry.corners(face).map(|v| v.as_dvec3());
        let normal = (b - a).cross(c - a).try_normalize()?;
        let height = normal.dot(center - a);
        let normal = normal * height.signum();
        (height.abs() > normal.abs().dot(half)).then(|| (normal, normal.dot(a)))
    };
    let all: Option<Vec<_>> = faces.iter().map(plane).collect();
    all.unwrap_or_default()
}

impl Views {
    /// Whether a map's triangles are all behind a point, as the light sees it.
    fn is_before(&self, map: usize, p: DVec3) -> bool {
        let slack = POINT_OFFSET * p.abs().max_element().max(1.0);
        let planes = &self.planes[map];
        !planes.is_empty() && planes.iter().all(|(n, offset)| n.dot(p) - offset >= -slack)
    }
}

impl Method for Mvsm {
    fn name(&self) -> &'static str {
        "mvsm"
    }

    fn reach(&self) -> f64 {
        REACH
    }

    fn prepare(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        let frame = geometry.frame;
        let casters = Casters::new(self.name(), geometry, self.opaque)?;
        let layers = Layers::opaque(1);
        let start = Instant::now();
        let pattern = Pattern::new(self.samples as usize, self.seed);
        let mut found = Vec::with_capacity(lights.len());
        for light in lights {
            let (mut maps, mut groups) = (Vec::new(), Vec::new());
            for point in view_points(light, DVec3::ZERO, self.views as usize) {
                let eye = light.point_at(point);
                let mut of_view = Vec::new();
                for views in light_views(&eye, &casters, self.resolution)?.groups {
                    let first = maps.len();
                    for view in views {
                        maps.push(layer_map(view, &casters, &layers, control)?);
                    }
                    of_view.push(first..maps.len());
                }
                groups.push(of_view);
            }
            found.push(Views {
                light: light.clone(),
                planes: maps
                    .iter()
                    .map(|m| planes(casters.geometry(), light, m))
                    .collect(),
                sources: maps
                    .iter()
                    .map(|m: &LayerMap| Source::new(light, &m.view.camera))
                    .collect(),
                sampler: Sampler::new(light.clone(), pattern.clone(), true),
                maps,
                groups,
            });
        }
        Ok(Box::new(PreparedMvsm {
            lights: found,
            gap: self.gap.map(|g| (g / frame.unit) as f32),
            bias: self.bias.map(|b| b / frame.unit),
            seconds: start.elapsed().as_secs_f64(),
        }))
    }
}

struct PreparedMvsm {
    lights: Vec<Views>,
    gap: Option<f32>,
    bias: Option<f64>,
    seconds: f64,
}

/// What a receiver needs, and what a group of receivers passes on from one to the next.
#[derive(Default)]
struct Memory {
    samples: LightSamples,
    /// What blocked each sample of the receiver before.
    blockers: Vec<Option<Blocker>>,
    /// The receiver in each map: homogeneous image coordinates, and a bound on the inverse depth of blockers.
    places: Vec<([f32; 3], f32)>,
    /// How far off the receiver segments start.
    bias: f64,
}

impl PreparedMvsm {
    /// Finds a receiver's places; whether anything can be between it and the light.
    fn place(
        &self,
        views: &Views,
        tracers: &[Tracer<'_>],
        p: DVec3,
        n: DVec3,
        memory: &mut Memory,
    ) -> bool {
        memory.places.clear();
        memory
            .places
            .extend(tracers.iter().enumerate().map(|(map, t)| {
                let nearest = t.map.view.inverse_near as f32;
                let nothing = views.is_before(map, p);
                (t.project(p), if nothing { 0.0 } else { nearest })
            }));
        let texel =
            |map: usize| f64::from(memory.places[map].0[2].abs()) / tracers[map].map.view.focal;
        memory.bias = match (self.bias, tracers.is_empty()) {
            (Some(bias), _) => bias,
            (None, false) => BIAS * texel(0),
            (None, true) => 0.0,
        };
        let mut free = true;
        for maps in views.groups.first().into_iter().flatten() {
            // Segments to all of the light may leave a face of a cube.
            if maps.len() != 1 {
                return true;
            }
            let map = maps.start;
            if memory.places[map].1 == 0.0 {
                continue;
            }
            let (of, source) = (&views.maps[map], &views.sources[map]);
            // A view from a point of the light may see a part of it behind the receiver.
            if !source.is_nearer_than(f64::from(memory.places[map].0[2])) {
                return true;
            }
            match Region::new(of, source, p, n, Some(memory.bias)) {
                Some(region) => {
                    free = false;
                    memory.places[map].1 = region.nearest;
                }
                None => memory.places[map].1 = 0.0,
            }
        }
        !free
    }

    fn visibility(
        &self,
        views: &Views,
        tracers: &[Tracer<'_>],
        p: DVec3,
        memory: &mut Memory,
    ) -> f32 {
        let count = memory.samples.count;
        let (mut seen, mut latest) = (0u32, None);
        for i in 0..count {
            if memory.samples.valid[i / LANES] >> (i % LANES) & 1 == 0 {
                continue;
            }
            let to = memory.samples.point(i);
            let length = (to.as_dvec3() - p).length().max(f64::MIN_POSITIVE);
            let start = (memory.bias / length).min(0.5) as f32;
            let remembered = [memory.blockers[i], latest];
            let again = remembered.into_iter().flatten().find(|b| {
                let tracer = &tracers[b.map as usize];
                let segment = tracer.segment(memory.places[b.map as usize].0, to);
                tracer.is_blocked_at(&segment, start, b.x, b.y)
            });
            let blocker = again.or_else(|| blocker(views, tracers, &memory.places, to, start));
            seen += u32::from(blocker.is_none());
            latest = blocker;
            memory.blockers[i] = blocker;
        }
        seen as f32 / count as f32
    }
}

/// What blocks a segment.
fn blocker(
    views: &Views,
    tracers: &[Tracer<'_>],
    places: &[([f32; 3], f32)],
    to: Vec3,
    start: f32,
) -> Option<Blocker> {
    let groups = views.groups.iter().map(Vec::len).max().unwrap_or(0);
    for group in 0..groups {
        let mut left = Intervals::one(start, 1.0);
        for view in &views.groups {
            let Some(maps) = view.get(group) else {
                continue;
            };
            let mut hidden = Intervals::default();
            for map in maps.clone() {
                let (tracer, (from, nearest)) = (&tracers[map], places[map]);
                if nearest == 0.0 {
                    continue;
                }
                let segment = tracer.segment(from, to);
                if let Some((x, y)) = tracer.trace(&segment, &left, nearest, &mut hidden) {
                    return Some(Blocker {
                        map: map as u32,
                        x,
                        y,
                    });
                }
            }
            left = hidden;
            if left.is_empty() {
                break;
            }
        }
    }
    None
}

impl Prepared for PreparedMvsm {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let views = &self.lights[light];
        let tracers: Vec<Tracer<'_>> = views
            .maps
            .iter()
            .map(|map| Tracer::new(map, GAP, self.gap))
            .collect();
        let one = |i: usize, memory: &mut Memory| {
            let (p, n) = (receivers.positions[i], receivers.normals[i]);
            let h = views.light.fraction_above(p, n);
            if h == 0.0 || !self.place(views, &tracers, p, n, memory) {
                return h as f32;
            }
            views
                .sampler
                .fill(receivers.index[i], p, n, &mut memory.samples);
            self.visibility(views, &tracers, p, memory)
        };
        let visibility =
            receivers.by_groups(control, 0.0, Memory::default, |memory, range, out| {
                memory.blockers.clear();
                memory.blockers.resize(views.sampler.len(), None);
                for (i, out) in range.zip(out) {
                    // With the most samples a receiver takes a tenth of a second.
                    control.check()?;
                    *out = one(i, memory);
                }
                Ok(())
            })?;
        Ok(Shading {
            visibility,
            irradiance: None,
            by_rays: 0,
        })
    }

    fn bytes(&self) -> usize {
        let maps = self.lights.iter().flat_map(|v| &v.maps);
        maps.map(LayerMap::bytes).sum()
    }

    fn seconds(&self) -> Vec<(&'static str, f64)> {
        vec![("shadow maps", self.seconds)]
    }
}
