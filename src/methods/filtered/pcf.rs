//! Percentage-closer soft shadows on one or several layers of depth (Xie, Tabellion and Pearce 2007, Section 3).
//!
//! The method of the film *Antz*, in two passes. Light samples are spread over the conservative region of
//! equation (1); the depth of the blockers among them, nearer to the light than the receiver, makes a narrower
//! region, in which the part of the samples that hit blockers is what is hidden. The region has the light's own
//! shape, and its samples are those of the light, so that a flat occluder parallel to a flat light is exact.
//!
//! With several layers (after Bavoil, Callahan and Silva 2006) each layer finds its own blockers and is filtered
//! at their depth; a light sample is hidden if any layer hides it.
//!
//! Assumptions and failures, those of the paper: all blockers of a layer count as if they were at one depth. A
//! receiver loses its contact shadow where something else in the region is much nearer to the light; blockers
//! one behind the other hide the light twice; what the nearest layer hides from the light's centre lets
//! light through. All grow with the light. Blockers that no sample of the first pass hits are missed.
//! Transparent occluders cannot be modelled: [`super::deep`] does.

use crate::scene::snapshot::Snapshot;
use std::sync::Arc;

use super::{Estimate, FilterSettings, Hide, MOST_LAYERS, PreparedFilter};
use crate::casters::Casters;
use crate::control::Control;
use crate::error::Result;
use crate::far::REACH;
use crate::light::Light;
use crate::maps::layers::construction::Layers;
use crate::maps::region::{Region, RegionScratch, Texel};
use crate::method::{Method, Prepared};
use crate::simd::LANES;

/// Percentage-closer soft shadows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pcf {
    /// What it shares with deep shadow maps.
    pub settings: FilterSettings,
    /// Whether transparent meshes count as opaque.
    pub opaque: bool,
}

impl Pcf {
    /// Checks the parameters.
    ///
    /// # Errors
    /// What is out of its range.
    pub fn checked(self) -> Result<Self> {
        self.settings.check("Pcf")?;
        Ok(self)
    }
}

impl Method for Pcf {
    fn name(&self) -> &'static str {
        "pcf"
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
        let casters = Casters::new(self.name(), geometry, self.opaque)?;
        let layers = Layers::opaque(self.settings.layers as usize);
        let filter = ("shadow map", hide as Hide);
        let prepared =
            PreparedFilter::new(&casters, lights, &self.settings, &layers, filter, control)?;
        Ok(Box::new(prepared))
    }
}

/// Both passes over a region's map.
fn hide(region: &Region<'_>, estimate: Estimate, scratch: &mut RegionScratch) {
    let layers = region.map.layers;
    // Of every layer the largest inverse depth of a blocker, their sum, and their number.
    let mut found = [(0.0f32, 0.0f32, 0.0f32); MOST_LAYERS as usize];
    scratch.place(region, region.nearest);
    each_place(region, scratch, |_, _, x, y, texel| {
        for (layer, found) in found[..layers].iter_mut().enumerate() {
            let Some((_, w)) = region.layer(texel, layer) else {
                break;
            };
            if region.is_between(x, y, w) {
                *found = (found.0.max(w), found.1 + w, found.2 + 1.0);
            }
        }
    });
    for (layer, &(nearest, sum, count)) in found[..layers].iter().enumerate() {
        if count == 0.0 {
            continue;
        }
        let w = match estimate {
            Estimate::Nearest => nearest,
            Estimate::Mean => sum / count,
        };
        scratch.place(region, w.min(region.nearest));
        let mut through = std::mem::take(&mut scratch.through);
        each_place(region, scratch, |row, lane, x, y, texel| {
            let found = region.layer(texel, layer);
            if found.is_some_and(|(_, w)| region.is_between(x, y, w)) {
                through[row].0[lane] = 0.0;
            }
        });
        scratch.through = through;
    }
}

/// Calls `f` with row, lane, place and texel of every valid sample within the map.
#[inline(always)]
pub(super) fn each_place(
    region: &Region<'_>,
    scratch: &RegionScratch,
    mut f: impl FnMut(usize, usize, f32, f32, Texel),
) {
    let [xs, ys] = &scratch.places;
    for (row, &valid) in scratch.samples.valid.iter().enumerate() {
        for lane in 0..LANES {
            let (x, y) = (xs[row].0[lane], ys[row].0[lane]);
            if valid >> lane & 1 == 0 {
                continue;
            }
            if let Some(texel) = region.texel(x, y) {
                f(row, lane, x, y, texel);
            }
        }
    }
}
