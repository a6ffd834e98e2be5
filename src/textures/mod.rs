//! Receiver polygons' textures, which `accumulation` and `convolution` draw and read.
//!
//! - [`patches`]: the receiver polygons and the parallelograms around them;
//! - [`transform`]: the 4×4 matrix from a light point's pyramid to the unit box;
//! - [`occluders`]: what may cast on a polygon, cut at its plane;
//! - [`texture`]: drawing, averaging, refining;
//! - `traced`: single texels by rays, where drawing a polygon's whole texture would cost more;
//! - `sums`: what drawing and tracing add up;
//! - `sparse`: textures of which only the texels that were looked up are known;
//! - `window`: where on a polygon of a very large scene shadows can fall;
//! - [`atlas`]: the textures of a scene;
//! - [`lookup`]: what a pixel sees of a texture;
//! - [`pictures`]: a camera's pictures from textures.

pub mod atlas;
pub mod lookup;
pub mod occluders;
pub mod patches;
pub mod pictures;
mod sparse;
mod sums;
pub mod texture;
pub mod traced;
pub mod transform;
mod window;
