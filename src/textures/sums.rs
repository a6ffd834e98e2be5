//! What sixteen texels get from light points: the sums that textures hold, and the means that are read from them.
//!
//! - `seen`, the number of light points seen: the modulation texture;
//! - `light`, the irradiance from them at radiance 1, every light point with its own cosines and distance:
//!   the radiance texture, but for albedo and the light's colour.
//!
//! Of a sphere and of a distant light, whose points the texels may weigh differently, `seen` adds weights, and `weight` those of all
//! points. Sums go in the order of the light points' sequence.

use fearless_simd::{f32x16, prelude::*};
use glam::DVec3;

use crate::light::{Light, SphereLight};
use crate::simd::{Lanes, dot};

/// How light points count.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Weighting {
    /// Each as much; they emit along one normal.
    Flat,
    /// Light points count by the solid angle that they stand for, as a distant light's do, too.
    Sphere,
    /// Each as much, to all sides.
    Point,
}

impl Weighting {
    pub(super) fn of(light: &Light) -> Self {
        if light.as_distant().is_some() {
            return Weighting::Sphere;
        }
        match light.as_sphere() {
            Some(SphereLight { radius: 0.0, .. }) => Weighting::Point,
            Some(_) => Weighting::Sphere,
            None => Weighting::Flat,
        }
    }
}

/// A light point as each of sixteen texels sees it, which may be on polygons of their own.
#[derive(Clone, Copy)]
pub(super) struct Beams<S: Simd> {
    pub(super) position: [f32x16<S>; 3],
    /// Direction in which a sphere emits there.
    pub(super) normal: [f32x16<S>; 3],
    /// Height of the light point over the receivers' planes.
    pub(super) height: f32x16<S>,
    pub(super) area: f32x16<S>,
}

/// Sixteen texels, and what of the light is the same for all of its points.
#[derive(Clone, Copy)]
pub(super) struct Texels<S: Simd> {
    pub(super) at: [f32x16<S>; 3],
    pub(super) kind: Weighting,
    /// Against the direction in which a flat light emits.
    pub(super) minus_normal: [f32x16<S>; 3],
    pub(super) radiance: bool,
}

/// Sixteen texels' sums.
#[derive(Clone, Copy)]
pub(super) struct LaneSums<S: Simd> {
    pub(super) seen: f32x16<S>,
    pub(super) light: f32x16<S>,
    pub(super) weight: f32x16<S>,
}

impl<S: Simd> Texels<S> {
    /// From the texels to a light point.
    #[inline(always)]
    fn towards(&self, point: &[f32x16<S>; 3]) -> [f32x16<S>; 3] {
        let p = &self.at;
        [point[0] - p[0], point[1] - p[1], point[2] - p[2]]
    }

    /// The texels that are in front of a flat light, of which this is a point.
    #[inline(always)]
    pub(super) fn in_front(&self, point: &[f32x16<S>; 3]) -> u16 {
        match self.kind {
            Weighting::Flat => {
                f32x16::splat(point[0].simd, 0.0).lt(dot(&self.minus_normal, &self.towards(point)))
            }
            Weighting::Sphere | Weighting::Point => u16::MAX,
        }
    }

    /// Adds a light point that the texels of `open` see through what lets a part of its light through.
    #[inline(always)]
    pub(super) fn add(
        &self,
        beams: &Beams<S>,
        open: u16,
        through: f32x16<S>,
        sums: &mut LaneSums<S>,
    ) {
        let simd = through.simd;
        let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
        if !self.radiance && self.kind != Weighting::Sphere {
            sums.seen += through.where_bits(open, zero);
            return;
        }
        if open == 0 && self.kind != Weighting::Sphere {
            return;
        }
        let d = self.towards(&beams.position);
        // The bound only guards a texel that touches the light.
        let squared = dot(&d, &d).greater(1e-15);
        let above = beams.height.greater(zero);
        if self.kind == Weighting::Sphere {
            let facing = (zero - dot(&beams.normal, &d)).greater(zero);
            let length = squared.sqrt();
            let angle = beams.area * (facing / (squared * length));
            let part = (angle * through).where_bits(open, zero);
            sums.weight += angle;
            sums.seen += part;
            sums.light += part * (above / length);
        } else {
            let facing = dot(&self.minus_normal, &d).greater(zero);
            let inverse = one / squared;
            let cosines = facing * inverse * (above * inverse);
            let through = through.where_bits(open, zero);
            sums.seen += through;
            sums.light += beams.area * cosines * through;
        }
    }
}

/// The fraction of the light that is seen: what was seen of all.
#[inline(always)]
pub(super) fn visibility(seen: f32, all: f32) -> f32 {
    if all > 0.0 {
        (seen / all).min(1.0)
    } else {
        0.0
    }
}

/// The irradiance at radiance 1 of a texel at `p` by its sums over so many light points.
#[inline(always)]
pub(super) fn irradiance(
    light: f32,
    weight: Option<f32>,
    samples: usize,
    source: &Light,
    p: impl Fn() -> DVec3,
) -> f32 {
    let Some(weight) = weight else {
        return light / samples as f32;
    };
    // The weights estimate the sphere's solid angle, which is known.
    if weight > 0.0 {
        light / weight * solid_angle(source, p()) as f32
    } else {
        0.0
    }
}

/// Solid angle of a sphere, or a distant light's scale of cosines.
fn solid_angle(light: &Light, p: DVec3) -> f64 {
    if let Some(distant) = light.as_distant() {
        return distant.scale();
    }
    let Some(SphereLight { center, radius }) = light.as_sphere() else {
        return 0.0;
    };
    let sin = (radius / (center - p).length()).min(1.0);
    let cos = ((1.0 - sin) * (1.0 + sin)).sqrt();
    std::f64::consts::TAU * sin * sin / (1.0 + cos)
}
