//! Single sample soft shadows (Parker, Shirley and Smits 1998).
//!
//! One shadow ray to the light's centre, against soft-edged objects: each occluder (the inner object) is
//! wrapped in an outer object that is larger by about a penumbra. A ray that meets the inner one sees
//! nothing, one that passes beyond the outer one everything, and one between them the fraction `s(τ)` of
//! the light, `τ` growing from 0 on the inner object to 1 on the outer one.
//!
//! # The outer object
//! The paper's Figure 3 wants the offset `b = a D / A` at the distance `a` along the ray, with `A` the
//! distance of the light and `D` its diameter. So the outer object is taken to be all discs of radius
//! `b(p)`, across the ray, around the points `p` of the object, and `τ` the smallest of
//! `d(p) A / (a(p) D)`, with `d(p)` the point's distance from the ray. That is a distance on the light: of
//! the object's projection from the receiver onto the light's plane from the light's centre, in diameters.
//! Projected triangles are triangles and their outer objects have rounded corners, as the paper's.
//!
//! The paper gives no formula for a triangle's sides. In the triangle's plane, let `e` be a side's unit
//! direction, `n` the triangle's normal, `v` the ray's direction and `δ` the side's offset along `e × n`.
//! The side's distance from the ray, both as lines, grows by `δ |(e × n) · (v × e)| / |v × e|`, which is
//! `δ |n · v| / |v × e|`. That has to be `b`, so `δ = b / cos γ`, with `cos γ = |n · v| / |v × e|` the cosine
//! between the normal and the ray projected along the side (into the plane that both the normal and `e ×
//! n` span). Its reciprocal grows without bound for triangles seen edge-on; their projections do not, which
//! is why the distance is measured there (`view`, `triangles`, `polygon`). Both agree to first order
//! in `D / A`; a test compares them. Analytic spheres follow the paper's appendix (`spheres`).
//!
//! The distance of a union is the least of its parts' distances. So under the minimum, the paper's way to
//! combine and the default here, the triangles of a mesh have exactly the outer object of their union:
//! inside its outline no side leaves a trace, and a finer tessellation changes nothing but the outline.
//! Products and sums would count every triangle; they combine objects (connected parts of meshes, and
//! spheres), within which the minimum counts, unless they are told to take single triangles.
//!
//! # The light
//! The paper assumes a sphere of diameter `D`. Here a light's equivalent diameter is its width across the
//! occluder's side, as the receiver sees it: the outer limit of a parallelogram or disk is itself at twice its
//! size (`view`), so that a straight side's penumbra is as wide as the real one whichever way it runs.
//! The falloff is that of a disk for all of them (closed form, the default), the paper's Bernstein
//! interpolant `3τ² - 2τ³`, or linear.
//!
//! # The receiver's own surface
//! Rays start where all methods start them, four ulps above the surface, and are blocked as those of
//! [`super::hard`] are. Triangles and spheres that do not rise over the plane through that start do not
//! count, so a surface has no outer object to itself, and its neighbours only where they stand up from it.
//! Where the light is within its own width of the horizon, occluders are cut at a height of a quarter of the
//! light (`STRIP` in `view`) over the tangent plane and fade in below it, and the sample is
//! the centre or, if that is lower, the nearest place at that height. So what is beside the horizon
//! comes and goes smoothly, `min(s, h)` tends to `h` at terminators, and visibility does not jump where
//! the light's centre sets.
//!
//! # Assumptions and failures
//! The penumbra begins at the hard shadow and lies all outside it, so umbras are too large: by half a
//! penumbra, and small objects, which should have no umbra, are far too dark (the paper's Figure 5).
//! Transparent occluders cannot be modelled. Triangles that reach behind the receiver or beyond the light are
//! cut there. Where an object passes through the light's plane beside the light its shadow ends at once,
//! as it does in nature.

mod found;
mod lanes;
mod polygon;
mod spheres;
#[cfg(test)]
mod tests;
mod triangles;
mod view;

use crate::scene::snapshot::Snapshot;
use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use crate::bvh::packet::{Packet, Stack};
use crate::bvh::{Occluders, TriangleBvh};
use crate::casters::check_opacity;
use crate::control::Control;
use crate::error::Result;
use crate::geometry::Geometry;
use crate::light::Light;
use crate::light::falloff::Falloff;
use crate::light::reach::LightOutline;
use crate::method::{Method, Overlap, Prepared, Shading};
use crate::receivers::Receivers;
use crate::simd::{LANES, detect};
use found::{Found, NearPart};
use lanes::ReceiverViews;
use view::DoubledLight;

/// Parameters of single sample soft shadows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingleSample {
    /// How visibility falls off from the outer to the inner object.
    pub falloff: Falloff,
    /// How objects combine.
    pub overlap: Overlap,
    /// Whether every triangle is an object of its own.
    pub triangles: bool,
    /// Whether transparent meshes count as opaque.
    pub opaque: bool,
}

impl SingleSample {
    /// Visibility at a distance `tau` from the inner object, of 1 where the outer one ends.
    pub fn visible(falloff: Falloff, tau: f64) -> f64 {
        falloff.visible(tau.clamp(0.0, 1.0), 0.0, &LightOutline::Sphere(1.0))
    }

    /// Prepares a scene; lights are in world coordinates.
    ///
    /// # Errors
    /// Something transparent that casts, or [`crate::error::Error::Cancelled`].
    pub fn ready(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<PreparedSingleSample> {
        control.check()?;
        let entries = geometry.meshes.iter().map(|m| m.entry);
        let entries = entries.chain(geometry.spheres.iter().map(|s| s.entry));
        let casts = entries.map(|e| geometry.material(e)).filter(|m| m.casts);
        check_opacity(self.name(), casts.map(|m| m.opacity), self.opaque)?;
        let occluders = geometry.occluders();
        let parts = |bvh: &TriangleBvh| match (self.overlap, self.triangles) {
            (Overlap::Minimum, _) => None,
            (_, true) => Some(bvh.faces.clone()),
            (_, false) => Some(objects(&geometry, bvh)),
        };
        let transparent = occluders.transparent.as_ref();
        let parts = [
            parts(&occluders.opaque),
            transparent.and_then(|(bvh, _)| parts(bvh)),
        ];
        control.check()?;
        Ok(PreparedSingleSample {
            lights: lights.to_vec(),
            geometry,
            parts,
            method: *self,
        })
    }
}

/// For every triangle of a tree a number of the connected mesh that it belongs to.
fn objects(geometry: &Geometry, bvh: &TriangleBvh) -> Vec<u32> {
    let object = |&face: &u32| {
        let mesh = geometry.mesh_of(face);
        let vertex = geometry.faces[face as usize][0] - mesh.first_vertex;
        mesh.first_vertex + mesh.mesh.components()[vertex as usize]
    };
    bvh.faces.par_iter().map(object).collect()
}

impl Method for SingleSample {
    fn name(&self) -> &'static str {
        "single_sample"
    }

    fn prepare(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        Ok(Box::new(self.ready(geometry, lights, control)?))
    }
}

/// Single sample soft shadows, ready to answer.
pub struct PreparedSingleSample {
    geometry: Arc<Snapshot>,
    lights: Vec<Light>,
    /// Numbers of what opaque and transparent triangles belong to, if that matters.
    parts: [Option<Vec<u32>>; 2],
    method: SingleSample,
}

/// What a thread keeps between groups.
#[derive(Default)]
struct Scratch {
    views: ReceiverViews,
    found: Found,
    stack: Stack,
    /// Receivers with some of the light above their horizon, and how much.
    lit: Vec<(usize, f64)>,
}

impl PreparedSingleSample {
    /// Calls `each` with every receiver of a light that is above its horizon, the light's part there, and
    /// either `None` where the ray is blocked or what it passes nearer than the outer limit: the nearest
    /// distance only, or that of each part, by their numbers.
    fn search<T: Copy + Send + Sync>(
        &self,
        receivers: &Receivers,
        light: usize,
        control: &Control,
        dark: T,
        each: impl Fn(f64, Option<&mut [NearPart]>) -> T + Sync,
    ) -> Result<Vec<T>> {
        let light = &self.lights[light];
        let occluders = self.geometry.occluders();
        let target = light.target();
        let doubled = (!light.is_point()).then(|| DoubledLight::new(light, target));
        receivers.by_groups(control, dark, Scratch::default, |scratch, range, out| {
            let first = range.start;
            let fraction = |i| {
                let h = light.fraction_above(receivers.positions[i], receivers.normals[i]);
                (i, h)
            };
            let mut lit = std::mem::take(&mut scratch.lit);
            lit.clear();
            lit.extend(range.map(fraction).filter(|l| l.1 > 0.0));
            for lanes in lit.chunks(LANES) {
                let blocked = match &doubled {
                    None => hard_shadows(occluders, receivers, lanes, target, scratch),
                    Some(doubled) => {
                        self.soft_shadows(occluders, receivers, lanes, doubled, scratch)
                    }
                };
                for (lane, &(i, h)) in lanes.iter().enumerate() {
                    let near = scratch.found.near(lane);
                    out[i - first] = each(h, (blocked >> lane & 1 == 0).then_some(near));
                }
            }
            scratch.lit = lit;
            Ok(())
        })
    }

    /// Which of these receivers' rays are blocked, and how far the others pass from what they pass.
    fn soft_shadows(
        &self,
        occluders: &Occluders,
        receivers: &Receivers,
        lanes: &[(usize, f64)],
        doubled: &DoubledLight,
        scratch: &mut Scratch,
    ) -> u16 {
        let Scratch {
            views,
            found,
            stack,
            ..
        } = scratch;
        let active = u16::MAX >> (LANES - lanes.len());
        let level = detect();
        views.clear(doubled);
        for (lane, &(i, _)) in lanes.iter().enumerate() {
            views.set(lane, receivers.ray_origin(i), receivers.normals[i]);
        }
        views.look(level, active);
        found.clear(self.method.overlap != Overlap::Minimum);
        let mut blocked = 0;
        let trees = [
            Some(&occluders.opaque),
            occluders.transparent.as_ref().map(|(bvh, _)| bvh),
        ];
        for (bvh, parts) in trees.into_iter().zip(&self.parts) {
            let (Some(bvh), open) = (bvh, active & !blocked) else {
                continue;
            };
            blocked |= triangles::search(level, bvh, parts.as_deref(), views, open, found, stack);
        }
        if let Some(bvh) = &occluders.spheres {
            blocked |= spheres::search(level, bvh, views, active & !blocked, found, stack);
        }
        blocked
    }

    /// Combines what a ray passes nearer than the outer limit.
    fn visible(&self, near: Option<&mut [NearPart]>) -> f64 {
        let Some(near) = near else {
            return 0.0;
        };
        let falloff = self.method.falloff;
        let seen = |part: &NearPart| SingleSample::visible(falloff, f64::from(part.1));
        if self.method.overlap == Overlap::Minimum {
            return near.iter().map(seen).fold(1.0, f64::min);
        }
        // In an order that does not depend on the tree's.
        near.sort_unstable_by_key(|p| p.0);
        match self.method.overlap {
            Overlap::Multiply => near.iter().map(seen).product(),
            _ => (1.0 - near.iter().map(|p| 1.0 - seen(p)).sum::<f64>()).max(0.0),
        }
    }

    /// For every receiver the smallest distance `tau` of its ray from what it passes: 0 where it is blocked or
    /// the light is below the horizon, 1 where nothing is near.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    pub fn distances(
        &self,
        receivers: &Receivers,
        light: usize,
        control: &Control,
    ) -> Result<Vec<f32>> {
        self.search(receivers, light, control, 0.0, |_, near| {
            near.map_or(0.0, |near| near.iter().map(|p| p.1).fold(1.0, f32::min))
        })
    }
}

/// Which of these receivers' rays meet anything.
fn hard_shadows(
    occluders: &Occluders,
    receivers: &Receivers,
    lanes: &[(usize, f64)],
    target: Vec3,
    scratch: &mut Scratch,
) -> u16 {
    let mut packet = Packet::default();
    for (lane, &(i, _)) in lanes.iter().enumerate() {
        packet.set(lane, receivers.ray_origin(i), target);
    }
    scratch.found.clear(false);
    let active = u16::MAX >> (LANES - lanes.len());
    let mut through = [0.0; LANES];
    occluders.transmittance(&packet, active, &mut scratch.stack, &mut through);
    let opaque = through.iter().enumerate().filter(|(_, t)| **t < 1.0);
    opaque.fold(0, |mask, (lane, _)| mask | 1 << lane)
}

impl Prepared for PreparedSingleSample {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let visibility = self.search(receivers, light, control, 0.0, |h, near| {
            self.visible(near).min(h) as f32
        })?;
        Ok(Shading {
            visibility,
            irradiance: None,
            by_rays: 0,
        })
    }

    fn bytes(&self) -> usize {
        let parts = self.parts.iter().flatten().map(|p| 4 * p.len());
        self.geometry.occluders().bytes() + parts.sum::<usize>()
    }
}
