//! Soft shadows of area lights on the CPU: the core, without Python.
//!
//! # Conventions
//! Right-handed world space; sizes in world units. *Visibility* is the fraction of a light that a point
//! sees, 1 fully lit. Images are stored row by row, row 0 on top. *Local* coordinates are those of
//! [`frame::Frame`]: `f32`, within [-1, 1].
//!
//! # Floors
//! From the ground up; a module uses only what is below it, and methods do not use each other.
//! - [`error`], `memory`, [`control`], [`simd`], [`frame`]: the ground;
//! - [`mesh`]: adjacency and silhouettes of a mesh;
//! - [`camera`], [`geometry`]: what a scene is made of, in local coordinates;
//! - [`raster`]: drawing triangles;
//! - [`light`]: closed forms, a file a shape; [`receivers`]: the points that visibility is wanted for;
//! - [`bvh`]: ray queries; [`sampling`]: light points;
//! - [`scene`]: named meshes and spheres, and snapshots of them with their hierarchies;
//! - [`method`]: what all methods have in common; [`far`]: far lights for those that need near ones;
//! - [`casters`], [`maps`], [`textures`], [`adaptive`]: what several methods share;
//! - [`methods`]: each in a file or folder of its own;
//! - [`render`]: from visibility to radiance. The `python` feature adds the bindings.

pub mod adaptive;
pub mod bvh;
pub mod camera;
pub mod casters;
pub mod control;
pub mod error;
pub mod far;
pub mod frame;
pub mod geometry;
pub mod light;
pub mod maps;
mod memory;
pub mod mesh;
pub mod method;
pub mod methods;
pub mod raster;
pub mod receivers;
pub mod render;
pub mod sampling;
pub mod scene;
pub mod simd;
pub mod textures;

#[cfg(feature = "python")]
mod python;

// Hard cases name the crate as others do, and use what is public.
#[cfg(test)]
extern crate self as softshadow;

#[cfg(test)]
#[path = "../tests/adversarial/main.rs"]
mod adversarial;

#[cfg(test)]
#[path = "../tests/random.rs"]
mod random;

#[cfg(test)]
#[path = "../tests/same_bits.rs"]
mod same_bits;
