//! Hard shadows: one shadow ray from each receiver to the light's centre.
//!
//! Visibility is the ray's transmittance, at most `h`, the part of the light above the receiver's
//! tangent plane. Exact for a light of size zero, and wrong by the whole penumbra for any other: that is
//! what the other methods are measured against.

use crate::scene::snapshot::Snapshot;
use std::sync::Arc;

use crate::bvh::packet::{Packet, Stack};
use crate::control::Control;
use crate::error::Result;
use crate::light::Light;
use crate::method::{Method, Prepared, Shading};
use crate::receivers::Receivers;
use crate::simd::LANES;

/// Hard shadows; no parameters.
#[derive(Debug, Clone, Copy, Default)]
pub struct Hard;

impl Method for Hard {
    fn name(&self) -> &'static str {
        "hard"
    }

    fn takes_instances(&self) -> bool {
        true
    }

    fn prepare(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        control.check()?;
        geometry.occluders();
        let lights = lights.to_vec();
        Ok(Box::new(PreparedHard { geometry, lights }))
    }
}

struct PreparedHard {
    geometry: Arc<Snapshot>,
    lights: Vec<Light>,
}

impl Prepared for PreparedHard {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let light = &self.lights[light];
        let occluders = self.geometry.occluders();
        let target = light.target();
        let keep = <(Packet, Stack)>::default;
        let visibility =
            receivers.by_groups(control, 0.0, keep, |(packet, stack), range, out| {
                for (k, out) in out.chunks_mut(LANES).enumerate() {
                    let first = range.start + k * LANES;
                    for lane in 0..out.len() {
                        packet.set(lane, receivers.ray_origin(first + lane), target);
                    }
                    let active = u16::MAX >> (LANES - out.len());
                    let mut through = [0.0; LANES];
                    occluders.transmittance(packet, active, stack, &mut through);
                    for (i, (out, t)) in (first..).zip(out.iter_mut().zip(through)) {
                        let h = light.fraction_above(receivers.positions[i], receivers.normals[i]);
                        *out = t.min(h as f32);
                    }
                }
                Ok(())
            })?;
        Ok(Shading {
            visibility,
            irradiance: None,
            by_rays: 0,
        })
    }

    fn bytes(&self) -> usize {
        self.geometry.occluders().bytes()
    }
}
