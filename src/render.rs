//! From visibility to radiance, the same for all methods.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::geometry::Geometry;
use crate::light::Light;
use crate::method::Shading;
use crate::receivers::Receivers;
use crate::receivers::visible::Surface;

/// Receivers that one task lights.
const CHUNK: usize = 1024;

/// Where a surface does not receive shadows, replaces what the method found by the unshadowed light.
pub fn unshadow(
    shading: &mut Shading,
    geometry: &Geometry,
    surface: &Surface,
    receivers: &Receivers,
    light: &Light,
) {
    if geometry.materials.iter().all(|m| m.receives) {
        return;
    }
    let unshadowed = |(chunk, values): (usize, &mut [f32]), of: &dyn Fn(DVec3, DVec3) -> f64| {
        let mut last = None;
        for (i, value) in (chunk * CHUNK..).zip(values) {
            let hit = surface.hit[receivers.index[i] as usize];
            let entry = hit.entry(geometry, &mut last);
            if entry.is_some_and(|(entry, _)| !geometry.material(entry).receives) {
                *value = of(receivers.positions[i], receivers.normals[i]) as f32;
            }
        }
    };
    let chunks = shading.visibility.par_chunks_mut(CHUNK).enumerate();
    chunks.for_each(|chunk| unshadowed(chunk, &|p, n| light.fraction_above(p, n)));
    if let Some(irradiance) = &mut shading.irradiance {
        let chunks = irradiance.par_chunks_mut(CHUNK).enumerate();
        chunks.for_each(|chunk| unshadowed(chunk, &|p, n| light.unshadowed_irradiance(p, n)));
    }
}

/// Irradiance of some receivers from a light (local) of radiance 1: the method's own, or the unshadowed
/// one times visibility over the part of the light above the tangent plane, found in `out`.
pub fn irradiance<'a>(
    shading: &'a Shading,
    receivers: &Receivers,
    range: Range<usize>,
    light: &Light,
    out: &'a mut Vec<f32>,
) -> &'a [f32] {
    if let Some(own) = &shading.irradiance {
        return &own[range];
    }
    out.clear();
    let (positions, normals) = (&receivers.positions, &receivers.normals);
    let visibility = &shading.visibility[range.clone()];
    light.unshadowed(
        &positions[range.clone()],
        &normals[range],
        |i, h, irradiance| {
            out.push(if h > 0.0 && visibility[i] > 0.0 {
                (irradiance * f64::from(visibility[i]) / h) as f32
            } else {
                0.0
            });
        },
    );
    out
}
