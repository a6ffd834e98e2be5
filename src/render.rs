//! From visibility to radiance, the same for all methods.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::geometry::Geometry;
use crate::light::Light;
use crate::method::{Irradiance, Shading};
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
    match &mut shading.irradiance {
        None => {}
        Some(Irradiance::Whole(irradiance)) => {
            let chunks = irradiance.par_chunks_mut(CHUNK).enumerate();
            chunks.for_each(|chunk| unshadowed(chunk, &|p, n| light.unshadowed_irradiance(p, n)));
        }
        Some(Irradiance::Part(part)) => {
            let chunks = part.par_chunks_mut(CHUNK).enumerate();
            chunks.for_each(|chunk| unshadowed(chunk, &|_, _| 1.0));
        }
    }
}

/// Irradiance of some receivers from a light (local) of radiance 1: the method's own, or the unshadowed
/// one times the method's part of it or visibility over the part of the light above the tangent plane, found in `out`.
pub fn irradiance<'a>(
    shading: &'a Shading,
    receivers: &Receivers,
    range: Range<usize>,
    light: &Light,
    out: &'a mut Vec<f32>,
) -> &'a [f32] {
    let part = match &shading.irradiance {
        Some(Irradiance::Whole(own)) => return &own[range],
        Some(Irradiance::Part(part)) => Some(&part[range.clone()]),
        None => None,
    };
    out.clear();
    let (positions, normals) = (&receivers.positions, &receivers.normals);
    let visibility = &shading.visibility[range.clone()];
    light.unshadowed(
        &positions[range.clone()],
        &normals[range],
        |i, h, irradiance| {
            out.push(match part {
                Some(part) => (irradiance * f64::from(part[i])) as f32,
                None if h > 0.0 && visibility[i] > 0.0 => {
                    (irradiance * f64::from(visibility[i]) / h) as f32
                }
                None => 0.0,
            });
        },
    );
    out
}
