//! Hard cases for the core's promises: exact occlusion, culling that changes no bit, finite answers to
//! any finite question, and a rasteriser that neither drops nor doubles a pixel.

mod culling;
mod extremes;
mod rasterizer;
mod segments;

use std::sync::Arc;

use crate::random::Random;
use glam::DVec3;
use softshadow::control::Control;
use softshadow::geometry::entry::Material;
use softshadow::light::Light;
use softshadow::method::{Irradiance, Method, Shading};
use softshadow::methods::ray_traced::RayTraced;
use softshadow::receivers::Receivers;
use softshadow::scene::Scene;
use softshadow::scene::snapshot::Snapshot;

const OPAQUE: Material = Material {
    albedo: [0.8; 3],
    opacity: 1.0,
    casts: true,
    receives: true,
};
const NO_CASTER: Material = Material {
    casts: false,
    ..OPAQUE
};

fn vec(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Vertices, faces and look of a mesh.
type Part<'a> = (&'a [DVec3], &'a [[i64; 3]], Material);

/// A scene with these meshes, and one that casts nothing and fixes the scale.
fn scene(meshes: &[Part], size: f64) -> Arc<Snapshot> {
    let mut scene = Scene::default();
    for (i, (vertices, faces, material)) in meshes.iter().enumerate() {
        let (name, vertices) = (format!("mesh {i}"), vertices.to_vec());
        scene.add_mesh(&name, vertices, faces, *material).unwrap();
    }
    let frame = vec![
        DVec3::splat(-size),
        DVec3::splat(size),
        vec(-size, size, 0.0),
    ];
    scene
        .add_mesh("frame", frame, &[[0, 1, 2]], NO_CASTER)
        .unwrap();
    scene.snapshot().unwrap()
}

/// The irradiance that a method weighted itself.
fn irradiance(shading: &Shading) -> &[f32] {
    match shading.irradiance.as_ref() {
        Some(Irradiance::Whole(values)) => values,
        other => panic!("{other:?}"),
    }
}

fn shade(geometry: &Arc<Snapshot>, light: &Light, at: &Receivers, n: u32, cull: bool) -> Shading {
    let control = Control::default();
    let method = RayTraced {
        samples: n,
        seed: 3,
        fixed: false,
        cull,
        error: None,
    };
    let prepared = method
        .prepare(
            geometry.clone(),
            &[light.to_local(&geometry.frame)],
            &control,
        )
        .unwrap();
    prepared.shade(at, 0, &control).unwrap()
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|x| x.to_bits()).collect()
}
