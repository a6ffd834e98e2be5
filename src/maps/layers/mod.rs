//! Maps with several layers a texel, opaque or transparent.
//!
//! - [`map`]: what is stored; [`quadtree`]: least and largest depths ([`quad`]); [`coarser`]: coarser maps;
//! - [`views`]: where a map is drawn from, behind the light, or the faces of a cube;
//! - [`construction`]: the rasteriser's sinks; [`compress`]: from all crossings of a transparent texel to layers.

pub mod coarser;
pub mod compress;
pub mod construction;
pub mod map;
pub mod quad;
pub mod quadtree;
pub mod views;

/// Most layers of a map.
pub const MOST_LAYERS: u32 = 64;
