//! Soft shadows of area lights on the CPU: the core, without Python.
//!
//! # Conventions
//! Right-handed world space; sizes in world units. *Visibility* is the fraction of a light that a point
//! sees, 1 fully lit. Images are stored row by row, row 0 on top. *Local* coordinates are those of
//! [`geometry::Frame`]: `f32`, within [-1, 1].
//!
//! # Map
//! [`scene`] holds named meshes ([`mesh`]) and spheres; [`geometry`] is a snapshot of it in local
//! coordinates. [`receivers`] are the points that visibility is wanted for, found by the rasteriser
//! ([`raster`]) for a [`camera`]. [`light`] has closed forms, [`sampling`] light points, [`bvh`] ray
//! queries. [`methods`] answer, [`render`] turns answers into radiance. The `python` feature adds the
//! bindings.

pub mod bvh;
pub mod camera;
mod contour;
pub mod control;
pub mod error;
pub mod frame;
pub mod geometry;
pub mod light;
mod memory;
pub mod mesh;
pub mod methods;
pub mod raster;
pub mod receivers;
pub mod render;
pub mod sampling;
pub mod scene;
pub mod simd;
mod surface;

#[cfg(feature = "python")]
mod python;

// Hard cases name the crate as others do, and use what is public.
#[cfg(test)]
extern crate self as softshadow;

#[cfg(test)]
#[path = "../tests/adversarial/main.rs"]
mod adversarial;
