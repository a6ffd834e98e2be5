//! From visibility to radiance, the same for all methods.

use glam::DVec3;
use rayon::prelude::*;

use crate::geometry::Geometry;
use crate::light::Light;
use crate::methods::Shading;
use crate::receivers::{Receivers, Surface};

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
    for i in 0..receivers.len() {
        let Some((entry, _)) = surface.hit[receivers.index[i] as usize].entry(geometry) else {
            continue;
        };
        if !geometry.material(entry).receives {
            let (p, n) = (receivers.positions[i], receivers.normals[i]);
            shading.visibility[i] = light.fraction_above(p, n) as f32;
            if let Some(irradiance) = &mut shading.irradiance {
                irradiance[i] = light.unshadowed_irradiance(p, n) as f32;
            }
        }
    }
}

/// Irradiance of every receiver from a light (local) of radiance 1: the method's own, or the unshadowed
/// one times visibility over the part of the light above the tangent plane.
pub fn irradiance(shading: Shading, receivers: &Receivers, light: &Light) -> Vec<f32> {
    if let Some(own) = shading.irradiance {
        return own;
    }
    let one = |i: usize| {
        let (p, n): (DVec3, DVec3) = (receivers.positions[i], receivers.normals[i]);
        let h = light.fraction_above(p, n);
        if h <= 0.0 || shading.visibility[i] <= 0.0 {
            return 0.0;
        }
        (light.unshadowed_irradiance(p, n) * f64::from(shading.visibility[i]) / h) as f32
    };
    (0..receivers.len()).into_par_iter().map(one).collect()
}
