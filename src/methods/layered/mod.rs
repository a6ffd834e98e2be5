//! Soft shadows by ray tracing multilayer transparent shadow maps (Xie, Tabellion and Pearce 2007).
//!
//! The scene is drawn from behind the light into a map with several layers a texel; segments from a receiver
//! to points of the light are traced through the map instead of the scene. The map is [`crate::maps::layers`]; here:
//! - [`choose`]: resolution and layers where none are given;
//! - [`given`]: a map from a user's own arrays instead;
//! - [`masks`]: sets of light samples; [`tracing`]: the walk for all samples of a receiver, by
//!   its [`pencil`] of segments; `pieces`: what surfaces in texels hide of them;
//! - `look`: one receiver's samples in one map; `near`: triangles next to a receiver, in place of the map.
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
mod look;
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

use glam::DVec3;

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
use crate::sampling::{Pattern, Sampler};
use given::Given;
use look::{FlatTargets, Look, Scratch, tangent_plane};
use masks::{BLOCK, Mask, spread};
use near::Near;
use pencil::{Pencil, Receiver, SampleVisibility, Tracing};

/// Nearest surfaces for each layer, of which the layers are chosen: with more, on fur, those that are left are too
/// few to close the nearest strands.
const CHOICE: usize = 2;

/// Texels that are told apart everywhere across the light, of [`LayeredSettings::detail`], where triangles answer next
/// to receivers: without the receiver's own surface, levels cost less there. Less of them and flat hair is off by a
/// tenth more; half as many again, and it takes a third more time.
const LEAST: f32 = 0.4;

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
            tracing: self.tracing(frame, false),
            seconds: Vec::new(),
        })
    }

    /// Whether triangles answer next to receivers; not where the map's own ray is what counts.
    fn triangles_answer(&self) -> bool {
        self.settings.near > 0.0 && !self.settings.subtract
    }

    fn tracing(&self, frame: &Frame, triangles_answer: bool) -> Tracing {
        let settings = &self.settings;
        Tracing {
            thickness: (settings.z_threshold.unwrap_or(0.0) / frame.unit) as f32,
            bias: (settings.bias / frame.unit) as f32,
            detail: settings.detail as f32,
            least: if triangles_answer {
                LEAST * settings.detail as f32
            } else {
                0.0
            },
            threshold: settings.threshold as f32,
            subtract: settings.subtract,
        }
    }

    /// What answers next to receivers, before the first group of maps of a local light.
    fn near(&self, casters: &Casters, light: &Light, groups: &[Vec<LayerMap>]) -> Option<Near> {
        let maps = groups.first()?;
        let texels = self.settings.near as f32;
        self.triangles_answer()
            .then(|| Near::new(casters.shared(), light, maps, self.settings.opaque, texels))
    }

    /// The light points of a local light, the `number`-th of a scene.
    fn sampler(&self, light: Light) -> Sampler {
        let pattern = Pattern::new(self.settings.samples as usize, self.settings.seed);
        Sampler::new(light, pattern, true)
    }
}

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
        if self.triangles_answer() {
            casters.geometry().occluders();
        }
        let start = Instant::now();
        let mut found = Vec::with_capacity(lights.len());
        for light in lights {
            let groups = self.maps(&casters, light, control)?;
            let near = self.near(&casters, light, &groups);
            found.push(LayeredLight::new(self.sampler(light.clone()), groups, near));
        }
        Ok(Box::new(PreparedLayered {
            lights: found,
            tracing: self.tracing(&frame, self.triangles_answer()),
            seconds: vec![("maps", start.elapsed().as_secs_f64())],
        }))
    }
}

impl LayeredLight {
    fn new(sampler: Sampler, groups: Vec<Vec<LayerMap>>, near: Option<Near>) -> Self {
        let flat = groups.iter().map(|maps| FlatTargets::new(&sampler, maps));
        LayeredLight {
            light: sampler.light().clone(),
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
            by_rays: 0,
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
