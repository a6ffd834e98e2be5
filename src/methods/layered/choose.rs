//! Resolution and layers of a map from the scene, where none are given (Section 6.2 leaves both to the user).
//!
//! - **Resolution:** a map as fine as what it is drawn from: `TEXELS` texels a triangle, to a power of two in
//!   `COARSEST` to `FINEST`. Pieces of planes cover in the mean what triangles cover, so that more helps
//!   little; the receivers are not known when a map is drawn.
//! - **Layers:** the scene is drawn coarsely with many layers, and as many are taken as all but `BEHIND`
//!   of the texels fill, at most `MOST`.
//!
//! A single bound serves all of a light's views: that of the view with the most layers.

use crate::casters::Casters;
use crate::control::Control;
use crate::error::Result;
use crate::light::Light;
use crate::maps::layers::construction::{Layers, layer_map};
use crate::maps::layers::views::light_views;

/// Texels a triangle, of those in front and behind together: measured on dense scenes, more of them cost
/// time and gain a tenth of the error.
const TEXELS: usize = 2;

/// The least resolution: the paper's own.
const COARSEST: u32 = 1024;

/// The largest: the paper's own largest (Section 7).
const FINEST: u32 = 2048;

/// Resolution of the coarse map: a thousandth of the time of a map of 2048, and some thousand texels to count.
const COARSE: u32 = 128;

/// Most layers; what lies behind so many is nearly always in the umbra already.
const MOST: usize = 8;

/// The part of the texels that may hold more.
const BEHIND: f64 = 0.02;

/// Texels on the longer side.
pub fn resolution(casters: &Casters) -> u32 {
    let triangles = casters.geometry().faces.len();
    let side = (triangles.saturating_mul(TEXELS) as f64).sqrt();
    let rounded = 2.0f64.powf(side.max(1.0).log2().round());
    (rounded as u32).clamp(COARSEST, FINEST)
}

/// Layers of a texel.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub fn layers(light: &Light, casters: &Casters, control: &Control) -> Result<usize> {
    let kept = Layers::opaque(MOST);
    let mut most = 1;
    let views = light_views(light, casters, COARSE)?;
    for view in views.groups.into_iter().flatten() {
        let map = layer_map(view, casters, &kept, control)?;
        let finest = &map.levels[0];
        // Texels by how many layers they fill.
        let mut filled = [0usize; MOST + 1];
        for y in 0..finest.height {
            for x in 0..finest.width {
                filled[map.texel(x, y).count()] += 1;
            }
        }
        let some: usize = filled[1..].iter().sum();
        let allowed = (BEHIND * some as f64) as usize;
        let mut behind = some;
        for (k, texels) in filled.iter().enumerate().skip(1) {
            behind -= texels;
            if behind <= allowed {
                most = most.max(k);
                break;
            }
        }
    }
    Ok(most)
}
