//! Soft shadows by filtering a shadow map: the rivals of ray-traced maps (Xie, Tabellion and Pearce 2007, Section 3).
//!
//! - [`pcf`]: percentage-closer soft shadows on one or several layers of depth, the *Antz* method;
//! - [`deep`]: the same filter on deep shadow maps, for fur and what is translucent;
//! - [`crate::maps::region`]: what both look at: the part of a map that can hide the light from a receiver.
//!
//! Neither follows a ray. All that is found in the filter's region and lies between receiver and light counts
//! as if it were at one depth, which is where their errors come from, and why these grow with the light.

pub mod deep;
pub mod pcf;

use std::time::Instant;

use glam::DVec3;

use crate::casters::Casters;
use crate::control::Control;
use crate::error::{Result, in_range};
use crate::light::Light;
use crate::maps::RESOLUTIONS;
use crate::maps::layers::MOST_LAYERS;
use crate::maps::layers::construction::{Layers, layer_map};
use crate::maps::layers::map::LayerMap;
use crate::maps::layers::views::light_views;
use crate::maps::region::{Region, RegionScratch, Source};
use crate::maps::views::most_central;
use crate::method::{Prepared, Shading};
use crate::receivers::Receivers;
use crate::sampling::MOST_SAMPLES;
use crate::sampling::{Pattern, Sampler};

/// Which depth stands for all blockers in a filter's region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Estimate {
    /// The one nearest to the light (Section 3).
    Nearest,
    /// The mean of their inverse depths (after Fernando 2005): narrower, and without a step where another
    /// blocker comes into the region.
    Mean,
}

/// What both methods are told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilterSettings {
    /// Texels on the longer side of a map.
    pub resolution: u32,
    /// Layers of a texel.
    pub layers: u32,
    /// Light samples a receiver.
    pub samples: u32,
    /// Seed of the light samples.
    pub seed: u64,
    /// Which depth stands for all blockers.
    pub estimate: Estimate,
    /// How far off its tangent plane (without one: nearer to the light) a blocker has to be, world units; by
    /// default a texel's width at the receiver.
    pub bias: Option<f64>,
}

impl FilterSettings {
    /// Checks the numbers.
    ///
    /// # Errors
    /// What is out of its range.
    fn check(&self, method: &str) -> Result<()> {
        in_range(method, "resolution", self.resolution, RESOLUTIONS)?;
        in_range(method, "layers", self.layers, 1..=MOST_LAYERS)?;
        in_range(method, "samples", self.samples, 1..=MOST_SAMPLES)?;
        in_range(method, "bias", self.bias.unwrap_or(0.0), 0.0..=f64::MAX)
    }
}

/// Both passes over a region's map, with the depth that stands for all blockers.
type Hide = fn(&Region<'_>, Estimate, &mut RegionScratch);

/// Either method, ready to answer.
struct PreparedFilter {
    maps: Vec<LightMaps>,
    hide: Hide,
    /// What drawing the maps is called, and its seconds.
    stage: (&'static str, f64),
}

impl PreparedFilter {
    /// Draws the lights' maps.
    fn new(
        casters: &Casters,
        lights: &[Light],
        settings: &FilterSettings,
        layers: &Layers,
        (stage, hide): (&'static str, Hide),
        control: &Control,
    ) -> Result<Self> {
        let start = Instant::now();
        let maps = lights
            .iter()
            .map(|light| LightMaps::new(light, casters, settings, layers, control));
        Ok(PreparedFilter {
            maps: maps.collect::<Result<_>>()?,
            hide,
            stage: (stage, start.elapsed().as_secs_f64()),
        })
    }
}

impl Prepared for PreparedFilter {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let maps = &self.maps[light];
        maps.shade(receivers, control, |region, scratch| {
            (self.hide)(region, maps.estimate, scratch);
        })
    }

    fn bytes(&self) -> usize {
        self.maps.iter().map(LightMaps::bytes).sum()
    }

    fn seconds(&self) -> Vec<(&'static str, f64)> {
        vec![self.stage]
    }
}

/// The maps of one light, its samples, and what a receiver in them needs.
pub struct LightMaps {
    light: Light,
    sampler: Sampler,
    /// Groups of views, of each of which a receiver looks into one.
    groups: Vec<Vec<(LayerMap, Source)>>,
    estimate: Estimate,
    /// Local units.
    bias: Option<f64>,
}

impl LightMaps {
    /// Draws the maps of a light, local.
    ///
    /// # Errors
    /// Maps that do not fit into memory, or [`crate::error::Error::Cancelled`].
    pub fn new(
        light: &Light,
        casters: &Casters,
        settings: &FilterSettings,
        layers: &Layers,
        control: &Control,
    ) -> Result<Self> {
        let mut groups = Vec::new();
        for views in light_views(light, casters, settings.resolution)?.groups {
            let mut maps = Vec::with_capacity(views.len());
            for view in views {
                let source = Source::new(light, &view.camera);
                maps.push((layer_map(view, casters, layers, control)?, source));
            }
            groups.push(maps);
        }
        let pattern = Pattern::new(settings.samples as usize, settings.seed);
        Ok(LightMaps {
            light: light.clone(),
            sampler: Sampler::new(light.clone(), pattern, false),
            groups,
            estimate: settings.estimate,
            bias: settings.bias.map(|b| b / casters.geometry().frame.unit),
        })
    }

    /// Bytes of the maps.
    pub fn bytes(&self) -> usize {
        self.groups.iter().flatten().map(|(m, _)| m.bytes()).sum()
    }

    /// The part of each group that can hide the light from a receiver.
    fn regions(&self, p: DVec3, n: DVec3) -> impl Iterator<Item = Region<'_>> {
        self.groups.iter().filter_map(move |group| {
            let cameras = group.iter().map(|(map, _)| &map.view.camera);
            let (map, source) = &group[most_central(cameras, self.light.center(), p)];
            Region::new(map, source, p, n, self.bias)
        })
    }

    /// Asks `hidden` of every receiver that has something between it and the light: it multiplies what the
    /// light samples' transmittances were by what a region lets through, in the places of the samples.
    pub fn shade(
        &self,
        receivers: &Receivers,
        control: &Control,
        hidden: impl Fn(&Region<'_>, &mut RegionScratch) + Sync,
    ) -> Result<Shading> {
        let one = |i: usize, scratch: &mut RegionScratch| {
            let (p, n) = (receivers.positions[i], receivers.normals[i]);
            let h = self.light.fraction_above(p, n);
            if h == 0.0 {
                return 0.0;
            }
            let mut started = false;
            for region in self.regions(p, n) {
                if !started {
                    self.sampler
                        .fill(receivers.index[i], p, n, &mut scratch.samples);
                    scratch.start();
                    started = true;
                }
                scratch.project(&region);
                hidden(&region, scratch);
            }
            // What nothing is before sees the part of the light above its tangent plane, exactly.
            if started {
                scratch.visibility()
            } else {
                h as f32
            }
        };
        let visibility = receivers.by_groups(
            control,
            0.0,
            RegionScratch::default,
            |scratch, range, out| {
                for (i, out) in range.zip(out) {
                    // With the most samples a receiver takes a tenth of a second.
                    control.check()?;
                    *out = one(i, scratch);
                }
                Ok(())
            },
        )?;
        Ok(Shading {
            visibility,
            irradiance: None,
            by_rays: 0,
        })
    }
}
