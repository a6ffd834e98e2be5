//! What a scene is made of: named meshes and spheres, and their looks.

use std::sync::Arc;

use glam::{DAffine3, DVec3};

use crate::mesh::TriMesh;

/// How an entry looks and what it takes part in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Diffuse reflectance, linear RGB.
    pub albedo: [f32; 3],
    /// 1 is opaque; below 1, each crossing multiplies transmittance by `1 - opacity`.
    pub opacity: f32,
    /// Whether it occludes.
    pub casts: bool,
    /// Whether it is shadowed; where not, it is shaded as unshadowed.
    pub receives: bool,
}

/// What an entry is made of.
#[derive(Debug, Clone)]
pub enum Body {
    /// A mesh and its object-to-world transform.
    Mesh(Arc<TriMesh>, DAffine3),
    /// World-space centres and radii.
    Spheres(Arc<Vec<(DVec3, f64)>>),
}

/// One named thing in a scene.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Its name, unique in the scene.
    pub name: String,
    /// What it is made of.
    pub shape: Body,
    /// How it looks.
    pub material: Material,
}
