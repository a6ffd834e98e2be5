//! Soft shadows by ray tracing multilayer transparent shadow maps (Xie, Tabellion and Pearce 2007).
//!
//! The scene is drawn from behind the light into a map with several layers a texel; segments from a receiver
//! to points of the light are traced through the map instead of the scene. The map is [`crate::maps::layers`]; here:
//! - [`choose`]: resolution and layers where none are given;
//! - [`given`]: a map from a user's own arrays instead;
//! - [`masks`]: sets of light samples; [`tracing`]: the walk for all samples of a receiver, by
//!   its [`pencil`] of segments; `pieces`: what surfaces in texels hide of them;
//! - `near`: triangles next to a receiver, in place of the map.
//!
//! `slsm` keeps one layer, `mlsm` several, `mtsm` several that can be transparent. An opaque scene gets plain
//! depths from all three.
//!
//! Assumptions and failures: a map holds what it was drawn from at its texels' centres. Occluders behind its
//! last layer are missing and let light through (Section 6.2); what is smaller than a texel is right in the
//! mean only. Both hold beyond the depth up to which triangles answer; without them contact shadows begin half a
//! texel away.

pub mod choose;
pub mod given;
pub mod masks;
mod near;
pub mod pencil;
mod pieces;
pub mod tracing;

use crate::maps::RESOLUTIONS;
use crate::maps::layers::MOST_LAYERS;
use crate::scene::snapshot::Snapshot;
use std::sync::Arc;
use std::time::Instant;

use glam::{DVec3, Vec3};

use crate::bvh::packet;
use crate::casters::Casters;
use crate::control::Control;
use crate::error::{Result, in_range};
use crate::far::REACH;
use crate::frame::Frame;
use crate::light::{Light, SphereLight};
use crate::maps::layers::compress::Compression;
use crate::maps::layers::construction::{Layers, layer_map};
use crate::maps::layers::map::LayerMap;
use crate::maps::layers::views::light_views;
use crate::maps::views::most_central;
use crate::method::{Method, Prepared, Shading};
use crate::receivers::Receivers;
use crate::sampling::MOST_SAMPLES;
use crate::sampling::{LightSamples, Pattern, Sampler};
use crate::simd::{LANES, Row};
use given::Given;
use masks::{Axis, BLOCK, Mask, spread};
use near::{Near, Receiver};
use pencil::{Pencil, SampleVisibility, Tracing};
use tracing::{Stack, trace};

/// Nearest surfaces for each layer, of which the layers are chosen: with more, on fur, those that are left are too
/// few to close the nearest strands.
const CHOICE: usize = 2;

/// Which of the paper's maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayerKind {
    /// One layer.
    Single,
    /// Several opaque layers.
    Multi,
    /// Several layers that may be transparent.
    Transparent,
}

impl LayerKind {
    /// The name that users call the method by.
    pub fn name(self) -> &'static str {
        match self {
            LayerKind::Single => "slsm",
            LayerKind::Multi => "mlsm",
            LayerKind::Transparent => "mtsm",
        }
    }

    /// The name of its Python class.
    pub fn class(self) -> &'static str {
        match self {
            LayerKind::Single => "Slsm",
            LayerKind::Multi => "Mlsm",
            LayerKind::Transparent => "Mtsm",
        }
    }
}

/// Most times that visibility may start again.
const MOST_RESETS: u32 = 64;

/// What layered maps are built and traced with; lengths in world units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LayeredSettings {
    /// Texels on the longer side of a map; from the number of triangles if not given.
    pub resolution: Option<u32>,
    /// Layers of a texel; from the scene's depth complexity if not given.
    pub layers: Option<u32>,
    /// Light samples a receiver.
    pub samples: u32,
    /// Seed of the light samples.
    pub seed: u64,
    /// Thickness of surfaces to either side; from texel size and slope if not given.
    pub z_threshold: Option<f64>,
    /// Least height of an occluder over a receiver's tangent plane, beside what texel size and slope ask for.
    pub bias: f64,
    /// Texels across the light that are told apart.
    pub detail: f64,
    /// Texels across the light up to which triangles answer in place of the map.
    pub near: f64,
    /// Largest error of visibility in the compression of transparent layers.
    pub error: f64,
    /// Visibility that counts as none.
    pub threshold: f64,
    /// How often visibility starts again behind what is opaque.
    pub resets: u32,
    /// The paper's equation 3 as printed.
    pub subtract: bool,
    /// Whether transparent meshes count as opaque.
    pub opaque: bool,
}

/// A layered shadow map method with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layered {
    kind: LayerKind,
    settings: LayeredSettings,
}

impl Layered {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`crate::error::Error::Parameter`] for a parameter that is out of its range.
    pub fn new(kind: LayerKind, settings: LayeredSettings) -> Result<Self> {
        let what = kind.class();
        in_range(
            what,
            "resolution",
            settings.resolution.unwrap_or(16),
            RESOLUTIONS,
        )?;
        in_range(
            what,
            "layers",
            settings.layers.unwrap_or(1),
            1..=MOST_LAYERS,
        )?;
        in_range(what, "samples", settings.samples, 1..=MOST_SAMPLES)?;
        in_range(what, "resets", settings.resets, 0..=MOST_RESETS)?;
        in_range(
            what,
            "z_threshold",
            settings.z_threshold.unwrap_or(0.0),
            0.0..=f64::MAX,
        )?;
        in_range(what, "bias", settings.bias, 0.0..=f64::MAX)?;
        in_range(what, "error", settings.error, 0.0..=1.0)?;
        in_range(what, "threshold", settings.threshold, 0.0..=1.0)?;
        in_range(what, "detail", settings.detail, 1.0..=65536.0)?;
        in_range(what, "near", settings.near, 0.0..=65536.0)?;
        Ok(Layered { kind, settings })
    }

    /// Whether meshes that let light through are no error.
    pub fn takes_transparent(&self) -> bool {
        self.settings.opaque || self.kind == LayerKind::Transparent
    }

    /// The maps of a local light.
    ///
    /// # Errors
    /// Maps that do not fit into memory, or [`crate::error::Error::Cancelled`].
    pub fn maps(
        &self,
        casters: &Casters,
        light: &Light,
        control: &Control,
    ) -> Result<Vec<Vec<LayerMap>>> {
        let settings = &self.settings;
        let resolution = settings
            .resolution
            .unwrap_or_else(|| choose::resolution(casters));
        let count = match (self.kind, settings.layers) {
            (LayerKind::Single, _) => 1,
            (_, Some(layers)) => layers as usize,
            (_, None) => choose::layers(light, casters, control)?,
        };
        let layers = Layers {
            count,
            of: if count > 1 { CHOICE * count } else { 1 },
            compression: Compression {
                error: settings.error as f32,
                threshold: settings.threshold as f32,
                resets: settings.resets as usize,
            },
            opaque: settings.opaque || self.kind != LayerKind::Transparent,
        };
        let views = light_views(light, casters, resolution)?;
        let draw = |view| layer_map(view, casters, &layers, control);
        let group = |views: Vec<_>| views.into_iter().map(draw).collect();
        views.groups.into_iter().map(group).collect()
    }

    /// Ready to answer for one local light through maps that a user gives, instead of a scene's.
    ///
    /// # Errors
    /// The errors of [`Given::map`], or [`crate::error::Error::Cancelled`].
    pub fn through(
        &self,
        light: Light,
        groups: &[Vec<Given>],
        frame: &Frame,
        control: &Control,
    ) -> Result<impl Prepared + use<>> {
        let threshold = self.settings.threshold as f32;
        let make = |given: &Given| given.map(&light, frame, threshold, control);
        let group = |maps: &Vec<Given>| maps.iter().map(make).collect();
        let groups = groups.iter().map(group).collect::<Result<_>>()?;
        Ok(PreparedLayered {
            lights: vec![LayeredLight::new(self.sampler(light), groups, None)],
            tracing: self.tracing(frame),
            seconds: Vec::new(),
        })
    }

    fn tracing(&self, frame: &Frame) -> Tracing {
        let settings = &self.settings;
        Tracing {
            thickness: (settings.z_threshold.unwrap_or(0.0) / frame.unit) as f32,
            bias: (settings.bias / frame.unit) as f32,
            detail: settings.detail as f32,
            threshold: settings.threshold as f32,
            subtract: settings.subtract,
        }
    }

    /// What answers next to receivers for the maps of a local light; nothing where the map's own ray is what counts.
    fn near(&self, casters: &Casters, light: &Light, groups: &[Vec<LayerMap>]) -> Option<Near> {
        let settings = &self.settings;
        let maps = groups.first()?;
        let wanted = settings.near > 0.0 && !settings.subtract;
        wanted.then(|| {
            let texels = settings.near as f32;
            Near::new(casters.shared(), light, maps, settings.opaque, texels)
        })
    }

    /// The light points of a local light, the `number`-th of a scene.
    fn sampler(&self, light: Light) -> Sampler {
        let pattern = Pattern::new(self.settings.samples as usize, self.settings.seed);
        Sampler::new(light, pattern, true)
    }
}

/// The samples of a flat light in a map that is drawn along its normal: they are the same for all receivers.
struct FlatTargets {
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
    fn new(sampler: &Sampler, maps: &[LayerMap]) -> Option<Self> {
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

struct LayeredLight {
    light: Light,
    sampler: Sampler,
    groups: Vec<Vec<LayerMap>>,
    /// For every group of maps, its flat targets, if the light's samples have one depth in it.
    flat: Vec<Option<FlatTargets>>,
    transparent: bool,
    /// What answers next to receivers, before the first group.
    near: Option<Near>,
}

struct PreparedLayered {
    lights: Vec<LayeredLight>,
    tracing: Tracing,
    seconds: Vec<(&'static str, f64)>,
}

impl Method for Layered {
    fn name(&self) -> &'static str {
        self.kind.name()
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
        let casters = Casters::new(self.name(), geometry, self.takes_transparent())?;
        if self.settings.near > 0.0 {
            casters.geometry().occluders();
        }
        let start = Instant::now();
        let mut found = Vec::with_capacity(lights.len());
        for light in lights {
            let groups = self.maps(&casters, light, control)?;
            let near = self.near(&casters, light, &groups);
            found.push(LayeredLight::new(self.sampler(*light), groups, near));
        }
        Ok(Box::new(PreparedLayered {
            lights: found,
            tracing: self.tracing(&frame),
            seconds: vec![("maps", start.elapsed().as_secs_f64())],
        }))
    }
}

/// What a thread keeps between receivers.
#[derive(Default)]
struct Scratch {
    samples: LightSamples,
    stack: Stack,
    nodes: packet::Stack,
    axes: [Axis; 2],
    slopes: [Vec<f32>; 2],
}

impl LayeredLight {
    fn new(sampler: Sampler, groups: Vec<Vec<LayerMap>>, near: Option<Near>) -> Self {
        let flat = groups.iter().map(|maps| FlatTargets::new(&sampler, maps));
        LayeredLight {
            light: *sampler.light(),
            flat: flat.collect(),
            transparent: groups.iter().flatten().any(LayerMap::is_transparent),
            sampler,
            groups,
            near,
        }
    }

    /// Fraction of the light that a receiver sees.
    fn visibility(&self, receiver: &Receiver, tracing: &Tracing, s: &mut Scratch) -> f32 {
        let Receiver { p, n, .. } = *receiver;
        let h = self.light.fraction_above(p, n);
        if h == 0.0 {
            return 0.0;
        }
        let count = self.sampler.len();
        let flat = self.flat.iter().all(Option::is_some);
        if !flat && h == 1.0 && !self.meets_sphere(receiver, tracing, s) {
            return 1.0;
        }
        if h < 1.0 || !flat {
            self.sampler.fill(0, p, n, &mut s.samples);
        }
        let mut sum = 0.0;
        for (b, start) in (0..count).step_by(BLOCK).enumerate() {
            let within = (count - start).min(BLOCK);
            let valid = if h < 1.0 || !flat {
                let rows = s.samples.valid[start / 16..].iter().copied();
                let rows: Vec<u16> = rows.take(BLOCK / 16).collect();
                Mask::from_rows(&rows) & Mask::first(within)
            } else {
                Mask::first(within)
            };
            if valid.is_empty() {
                continue;
            }
            let mut seen = SampleVisibility::new(valid);
            for (g, maps) in self.groups.iter().enumerate() {
                let cameras = maps.iter().map(|m| &m.view.camera);
                let map = &maps[most_central(cameras, self.light.center(), p)];
                // Triangles answer once, before the first group's map.
                let near = self.near.as_ref().filter(|_| g == 0);
                let look = Look {
                    map,
                    near,
                    tracing,
                    receiver,
                };
                match &self.flat[g] {
                    Some(targets) => look.flat(targets, b, &mut seen, s),
                    None => look.each(start, within, &mut seen, s),
                }
                if seen.open.is_empty() && !self.transparent {
                    break;
                }
            }
            sum += seen.sum(self.transparent);
        }
        (sum / count as f32).min(1.0)
    }

    /// Whether anything may be between a receiver and a sphere. It costs far less than its light samples, which
    /// are others for every receiver, and most receivers are lit.
    fn meets_sphere(&self, receiver: &Receiver, tracing: &Tracing, s: &mut Scratch) -> bool {
        let p = receiver.p;
        let center = self.light.center();
        let Some(SphereLight { radius, .. }) = self.light.as_sphere() else {
            return true;
        };
        if (p - center).length() <= radius {
            return true;
        }
        self.groups.iter().enumerate().any(|(g, maps)| {
            let map = &maps[most_central(maps.iter().map(|m| &m.view.camera), center, p)];
            let start = map.view.project(p);
            let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            // Slopes are fractions of linear functions of a light point: the extremes over a cube are at corners. One
            // along the view's axes lies before the eye.
            let axes = map.view.camera.rotation.transpose();
            for corner in 0..8 {
                let side = |bit: u32| {
                    if corner >> bit & 1 == 1 {
                        radius
                    } else {
                        -radius
                    }
                };
                let q = map
                    .view
                    .project(center + axes * DVec3::new(side(0), side(1), side(2)));
                let step = q.z - start.z;
                if !(start.z > 0.0 && step > 0.0 && step.is_finite()) {
                    return true;
                }
                let slopes = (q - start) / step;
                (low, high) = (low.min(slopes.with_z(q.z)), high.max(slopes.with_z(q.z)));
            }
            let ends = [[low.x, high.x], [low.y, high.y]];
            let [columns, rows] = ends.map(|[low, high]| spread(low as f32, high as f32));
            let pencil = Pencil {
                start,
                columns,
                rows,
                axes: None,
                end: high.z as f32,
                plane: tangent_plane(map, receiver),
                near: 0.0,
            };
            let look = Look {
                map,
                near: self.near.as_ref().filter(|_| g == 0),
                tracing,
                receiver,
            };
            let mut seen = SampleVisibility::new(Mask::first(1));
            look.along(pencil, [&[]; 3], &mut seen, &mut s.stack, &mut s.nodes);
            seen.open.is_empty()
        })
    }
}

/// One receiver's look into one map.
struct Look<'a> {
    map: &'a LayerMap,
    /// What answers before the map.
    near: Option<&'a Near>,
    tracing: &'a Tracing,
    receiver: &'a Receiver,
}

impl Look<'_> {
    /// Removes what is hidden of the samples at `points`, before the map takes over and then in it.
    fn along(
        &self,
        mut pencil: Pencil<'_>,
        points: [&[Row]; 3],
        seen: &mut SampleVisibility,
        stack: &mut Stack,
        nodes: &mut packet::Stack,
    ) {
        let (map, how) = (self.map, self.tracing);
        if let Some(near) = self.near {
            pencil.near = near.depth(&pencil);
            near.hide(map, how, &pencil, self.receiver, points, seen, nodes);
        }
        trace(map, how, &pencil, seen, stack);
    }

    /// Looks at the samples of a block of a flat light.
    fn flat(
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
    fn each(&self, first: usize, count: usize, seen: &mut SampleVisibility, s: &mut Scratch) {
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
fn tangent_plane(map: &LayerMap, receiver: &Receiver) -> [f32; 3] {
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

impl Prepared for PreparedLayered {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let maps = &self.lights[light];
        let visibility =
            receivers.by_groups(control, 0.0, Scratch::default, |scratch, range, out| {
                for (i, out) in range.zip(out) {
                    let receiver = Receiver {
                        p: receivers.positions[i],
                        n: receivers.normals[i],
                        origin: receivers.ray_origin(i),
                    };
                    *out = maps.visibility(&receiver, &self.tracing, scratch);
                }
                Ok(())
            })?;
        Ok(Shading {
            visibility,
            irradiance: None,
        })
    }

    fn bytes(&self) -> usize {
        let maps = self.lights.iter().flat_map(|l| l.groups.iter().flatten());
        maps.map(LayerMap::bytes).sum()
    }

    fn seconds(&self) -> Vec<(&'static str, f64)> {
        self.seconds.clone()
    }
}
