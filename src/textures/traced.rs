//! Single texels by rays.
//!
//! At a texel's centre an averaged texture is what rays from there to the light points see. A polygon that is a
//! triangle of a scan has a few texels under thousands of occluders, so its texture is not drawn: the texels that
//! a picture looks up are traced, those of neighbouring pixels together, sixteen to a light point at once. The
//! polygon's plane is moved as for drawing ([`super::occluders::LIFT`]), so the same part of what casts is over
//! it, and the sums are the same but where a shadow's edge passes within rounding of the texel's centre.

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::atlas::{Atlas, Key};
use super::occluders::Side;
use super::sums::{self, Beams, LaneSums, Texels, Weighting};
use super::texture::center_of;
use crate::bvh::any_hit::blocked;
use crate::bvh::packet::{Packet, Stack};
use crate::control::Control;
use crate::error::Result;
use crate::light::Light;
use crate::sampling::{Pattern, Sampler, SharedPoint};
use crate::simd::{LANES, Row, detect, load_vector, splat_vector};

/// A texel of a texture.
pub type Wanted = (Key, [u32; 2]);

/// What texels of one light are traced with.
pub struct Tracing<'a> {
    atlas: &'a Atlas,
    light: &'a Light,
    kind: Weighting,
    sampler: Sampler,
    /// Those of a flat light, which all receivers share.
    points: Vec<SharedPoint>,
}

/// What a thread keeps between texels.
#[derive(Default)]
struct Scratch {
    packet: Packet,
    stack: Stack,
    /// The light points of the last polygon, of a light whose points depend on it.
    points: Vec<SharedPoint>,
    key: Option<Key>,
}

/// Sixteen texels.
struct Block {
    sides: [Side; LANES],
    /// Their centres.
    at: [Row; 3],
    /// The lanes that have a texel.
    lanes: u16,
}

/// Sixteen texels' light points, one of each.
#[derive(Default)]
struct Beam {
    position: [Row; 3],
    normal: [Row; 3],
    height: Row,
    area: Row,
}

impl<'a> Tracing<'a> {
    /// Traces to so many points of a light.
    pub fn new(atlas: &'a Atlas, light: u32, samples: usize, seed: u64) -> Self {
        let light = &atlas.lights[light as usize];
        let sampler = Sampler::new(light.clone(), Pattern::part(0..samples, seed), true);
        let kind = Weighting::of(light);
        let points = match kind {
            Weighting::Sphere => Vec::new(),
            Weighting::Flat | Weighting::Point => sampler.shared(&[DVec3::ZERO]),
        };
        Tracing {
            atlas,
            light,
            kind,
            sampler,
            points,
        }
    }

    /// Visibility and irradiance (0 unless textures have it) of texels; neighbours should follow each other.
    /// Calls `done` with the number of texels that were found.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    pub fn texels(
        &self,
        wanted: &[Wanted],
        control: &Control,
        done: impl Fn(usize) + Sync,
    ) -> Result<Vec<[f32; 2]>> {
        let mut out = vec![[0.0; 2]; wanted.len()];
        out.par_chunks_mut(LANES)
            .zip(wanted.par_chunks(LANES))
            .try_for_each_init(Scratch::default, |scratch, (out, wanted)| {
                control.check()?;
                self.block(wanted, scratch, out);
                done(wanted.len());
                Ok(())
            })?;
        Ok(out)
    }

    fn block(&self, wanted: &[Wanted], scratch: &mut Scratch, out: &mut [[f32; 2]]) {
        let texel = |lane: usize| wanted[lane.min(wanted.len() - 1)];
        let mut block = Block {
            sides: std::array::from_fn(|lane| self.atlas.side(texel(lane).0)),
            at: [Row::default(); 3],
            lanes: u16::MAX >> (LANES - wanted.len()),
        };
        let center = |lane: usize, side: &Side| {
            let (key, place) = texel(lane);
            center_of(&side.bounds, self.atlas.size(key.patch), place)
        };
        for (lane, side) in block.sides.iter().enumerate() {
            let p = center(lane, side).as_vec3();
            scratch.packet.set(lane, p, p);
            for axis in 0..3 {
                block.at[axis].0[lane] = p[axis];
            }
        }
        let sums = dispatch!(detect(), simd => self.trace(simd, &block, wanted, scratch));
        let samples = self.sampler.len();
        for (lane, out) in out.iter_mut().enumerate() {
            let [seen, light, weight] = [0, 1, 2].map(|k| sums[k].0[lane]);
            let weight = (self.kind == Weighting::Sphere).then_some(weight);
            let center = || center(lane, &block.sides[lane]);
            let irradiance = sums::irradiance(light, weight, samples, self.light, center);
            let seen = sums::visibility(seen, weight.unwrap_or(samples as f32));
            *out = [seen, irradiance];
        }
    }

    /// The texels' sums.
    #[inline(always)]
    fn trace<S: Simd>(
        &self,
        simd: S,
        block: &Block,
        wanted: &[Wanted],
        scratch: &mut Scratch,
    ) -> [Row; 3] {
        let zero = f32x16::splat(simd, 0.0);
        let mut sums = LaneSums {
            seen: zero,
            light: zero,
            weight: zero,
        };
        let normal = self.points.first().map_or(DVec3::ZERO, |p| p.normal);
        let texels = Texels {
            at: load_vector(simd, &block.at),
            kind: self.kind,
            minus_normal: splat_vector(simd, -normal.as_vec3()),
            radiance: self.atlas.layout.radiance,
        };
        let of_polygon = self
            .points
            .is_empty()
            .then(|| self.lane_points(block, wanted, scratch));
        let mut beam = Beam::default();
        let mut in_front = u16::MAX;
        for i in 0..self.sampler.len() {
            let point = |lane: usize| match &of_polygon {
                Some(points) => points[lane * self.sampler.len() + i],
                None => self.points[i],
            };
            beam.set(block, point);
            let beams = Beams {
                position: load_vector(simd, &beam.position),
                normal: load_vector(simd, &beam.normal),
                height: beam.height.load(simd),
                area: beam.area.load(simd),
            };
            if i == 0 {
                in_front = texels.in_front(&beams.position);
            }
            let above = beam.above() & block.lanes;
            let mut through = Row::default();
            let open = self.open(&beam.position, above & in_front, scratch, &mut through);
            texels.add(&beams, open, through.load(simd), &mut sums);
        }
        let mut out = [Row::default(); 3];
        out[0].set(sums.seen);
        out[1].set(sums.light);
        out[2].set(sums.weight);
        out
    }

    /// The lanes of `active` that see their light points, and the part of the light that comes through.
    #[inline(always)]
    fn open(
        &self,
        targets: &[Row; 3],
        active: u16,
        scratch: &mut Scratch,
        through: &mut Row,
    ) -> u16 {
        if active == 0 {
            return 0;
        }
        let Scratch { packet, stack, .. } = scratch;
        packet.set_targets(targets);
        let occluders = self.atlas.geometry.occluders();
        match &occluders.transparent {
            Some((bvh, _)) if self.atlas.layout.opaque => {
                let open = active & !blocked(&occluders.opaque, packet, active, stack);
                through.0 = [1.0; LANES];
                open & !blocked(bvh, packet, open, stack)
            }
            _ => {
                occluders.transmittance(packet, active, stack, &mut through.0);
                active
            }
        }
    }

    /// The light points of each lane's polygon.
    fn lane_points(
        &self,
        block: &Block,
        wanted: &[Wanted],
        scratch: &mut Scratch,
    ) -> Vec<SharedPoint> {
        let mut out = Vec::with_capacity(LANES * self.sampler.len());
        for (lane, side) in block.sides.iter().enumerate() {
            let key = wanted[lane.min(wanted.len() - 1)].0;
            if scratch.key != Some(key) {
                scratch.points = self.sampler.shared(&side.bounds.corners());
                scratch.key = Some(key);
            }
            out.extend_from_slice(&scratch.points);
        }
        out
    }
}

impl Beam {
    fn set(&mut self, block: &Block, point: impl Fn(usize) -> SharedPoint) {
        for (lane, side) in block.sides.iter().enumerate() {
            let SharedPoint {
                position,
                normal,
                area,
            } = point(lane);
            let (p, n): (Vec3, Vec3) = (position.as_vec3(), normal.as_vec3());
            for axis in 0..3 {
                self.position[axis].0[lane] = p[axis];
                self.normal[axis].0[lane] = n[axis];
            }
            self.height.0[lane] = side.height(position) as f32;
            self.area.0[lane] = area as f32;
        }
    }

    /// The lanes whose light point is over the plane.
    fn above(&self) -> u16 {
        let lanes = self.height.0.iter().enumerate();
        lanes.fold(0, |m, (lane, h)| m | u16::from(*h > 0.0) << lane)
    }
}
