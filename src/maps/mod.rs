//! Maps of what a light sees, which several methods draw and read.
//!
//! - [`views`]: where maps are drawn from, one view or the faces of a cube, and what of a light they show;
//! - [`region`]: the part of a map that can hide a light from a receiver;
//! - [`layers`]: maps with several layers a texel.

pub mod layers;
pub mod region;
pub mod views;

use std::ops::RangeInclusive;

/// Texels on the longer side of a map.
pub const RESOLUTIONS: RangeInclusive<u32> = 16..=16384;
