//! Deep shadow maps (Lokovic and Veach 2000), filtered by the percentage-closer filter.
//!
//! A texel of a deep shadow map holds how visibility falls with depth along its ray, as a few vertices between
//! which it is linear. Where the filter of [`super::pcf`] asks whether a place in the map is nearer than the
//! receiver, this one asks how much light is left at the receiver's depth, and takes the mean. The region has two
//! passes, as there, and the depth of what falls first stands for all of it. This is the method that the paper
//! compares with on fur ("PCF or Deep").
//!
//! Assumptions and failures: those of [`super::pcf`]; self-shadowing of fur is soft and plausible, shadows
//! on what is behind it are too wide. What lies behind the first opaque surface of a texel is not kept.

use crate::scene::snapshot::Snapshot;
use std::sync::Arc;

use super::pcf::each_place;
use super::{Estimate, FilterSettings, Hide, PreparedFilter};
use crate::casters::Casters;
use crate::control::Control;
use crate::error::{Result, in_range};
use crate::far::REACH;
use crate::light::Light;
use crate::maps::layers::compress::Compression;
use crate::maps::layers::construction::Layers;
use crate::maps::region::{Region, RegionScratch, Texel};
use crate::method::{Method, Prepared};

/// Visibility that counts as none: half an 8-bit step, which nothing shows.
const NOTHING: f32 = 1.0 / 512.0;

/// Deep shadow maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeepShadow {
    /// What it shares with percentage-closer soft shadows.
    pub settings: FilterSettings,
    /// Largest error that compressing a texel's visibility may make.
    pub error: f64,
}

impl DeepShadow {
    /// Checks the parameters.
    ///
    /// # Errors
    /// What is out of its range.
    pub fn checked(self) -> Result<Self> {
        self.settings.check("DeepShadow")?;
        in_range("DeepShadow", "error", self.error, 0.0..=1.0)?;
        Ok(self)
    }
}

impl Method for DeepShadow {
    fn name(&self) -> &'static str {
        "deep"
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
        let casters = Casters::new(self.name(), geometry, true)?;
        let layers = Layers {
            count: self.settings.layers as usize,
            of: self.settings.layers as usize,
            compression: Compression {
                error: self.error as f32,
                threshold: NOTHING,
                resets: 0,
            },
            opaque: false,
        };
        let filter = ("deep shadow map", hide as Hide);
        let prepared =
            PreparedFilter::new(&casters, lights, &self.settings, &layers, filter, control)?;
        Ok(Box::new(prepared))
    }
}

/// Both passes over a region's map.
fn hide(region: &Region<'_>, estimate: Estimate, scratch: &mut RegionScratch) {
    let (mut nearest, mut sum, mut count) = (0.0f32, 0.0f32, 0.0f32);
    scratch.place(region, region.nearest);
    each_place(region, scratch, |_, _, x, y, texel| {
        let Some((piece, w)) = region.layer(texel, 0) else {
            return;
        };
        // A layer of several surfaces begins at its first one.
        let medium = region.medium(texel, 0);
        let w = w + medium.map_or(0.0, |m| m.first - piece.inverse_depth);
        if region.is_between(x, y, w) {
            nearest = nearest.max(w);
            sum += w;
            count += 1.0;
        }
    });
    if count == 0.0 {
        return;
    }
    let w = match estimate {
        Estimate::Nearest => nearest,
        Estimate::Mean => sum / count,
    };
    scratch.place(region, w.min(region.nearest));
    let mut through = std::mem::take(&mut scratch.through);
    each_place(region, scratch, |row, lane, x, y, texel| {
        through[row].0[lane] *= visibility(region, texel, x, y);
    });
    scratch.through = through;
}

/// The light that is left in a texel at the receiver's depth.
fn visibility(region: &Region<'_>, texel: Texel, x: f32, y: f32) -> f32 {
    // Behind the layers so far of the texel's own ray, and to the receiver.
    let (mut before, mut out) = (1.0f32, 1.0);
    for layer in 0..region.map.layers {
        let Some((piece, w)) = region.layer(texel, layer) else {
            break;
        };
        let Some(medium) = region.medium(texel, layer) else {
            // Opaque surfaces only.
            if region.is_between(x, y, w) {
                return 0.0;
            }
            continue;
        };
        if before <= 0.0 {
            break;
        }
        let kept = medium.visibility / before;
        if region.is_between(x, y, w) {
            out *= kept;
        } else if medium.count > 1 {
            let first = w + (medium.first - piece.inverse_depth);
            if region.is_between(x, y, first) {
                // The receiver is among its surfaces: visibility is linear in depth from end to end.
                out *= 1.0 + (kept - 1.0) * region.depth_part(x, y, first, w);
            }
        }
        before = medium.visibility;
    }
    out
}
