//! The methods, each in a file or folder of its own; none uses another.
//!
//! - [`accumulation`]: averaged hard-shadow textures;
//! - [`convolution`]: hard shadows convolved with the light's image;
//! - [`counted`]: silhouettes counted over the light, one ray a receiver;
//! - [`filtered`]: percentage-closer soft shadows and deep shadow maps;
//! - [`hard`]: one shadow ray to the light's centre;
//! - [`layered`]: ray-traced multilayer shadow maps;
//! - [`mvsm`]: ray-traced multi-view shadow maps;
//! - [`ray_traced`]: stratified light samples against the hierarchy, the reference;
//! - [`single_sample`]: one shadow ray against soft-edged outer objects;
//! - [`ssoc`]: the soft shadow occlusion camera;
//! - [`wedges`]: penumbra wedges, and shadow volumes.
//!
//! What they have in common is [`crate::method`]; of lights that are farther away than one reaches [`crate::far`] makes
//! near ones.

pub mod accumulation;
pub mod convolution;
pub mod counted;
pub mod filtered;
pub mod hard;
pub mod layered;
pub mod mvsm;
pub mod ray_traced;
pub mod single_sample;
pub mod ssoc;
pub mod wedges;
