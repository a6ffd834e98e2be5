//! A receiver polygon's texture: hard shadows drawn from light points and averaged.
//!
//! Herf and Heckbert 1996: for every light point the occluders are drawn black over the receiver's unshadowed
//! shading, and the pictures are averaged. Here the occluders leave a bitmap a light point
//! ([`crate::raster::coverage`]), and the texels that it leaves open add up, sixteen texels at once
//! (`super::sums`).
//!
//! Sums go in the order of the light points' sequence, so a texture refined from 64 to 128
//! points has the same bits as one drawn with 128.
//!
//! A light point under the receiver's plane, and a texel behind a flat light, do not see each other. What
//! lets a part of the light through multiplies at every crossing.

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::occluders::{PatchOccluders, Side};
use super::patches::Parallelogram;
use super::sums::{self, Beams, LaneSums, Texels, Weighting};
use super::transform::camera;
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Result;
use crate::light::Light;
use crate::raster::coverage::{Bitmap, Projected, cover, cover_facing};
use crate::sampling::{Pattern, Sampler, SharedPoint};
use crate::simd::{LANES, Row, detect, load_vector, splat_vector};

/// Most light points drawn at once: their bitmaps are kept until the texels add them up.
const BATCH: usize = 64;

/// Most bytes of the bitmaps drawn at once; a large texture has fewer points in a batch.
const BATCH_BYTES: usize = 64 << 20;

/// Below this many texels and triangles times light points, one thread is as fast as several.
const SMALL: usize = 1 << 18;

/// The centre of a texel of a parallelogram.
pub(super) fn center_of(bounds: &Parallelogram, size: [u32; 2], texel: [u32; 2]) -> DVec3 {
    let [u, v] = [0, 1].map(|k| (f64::from(texel[k]) + 0.5) / f64::from(size[k]));
    bounds.at(u, v)
}

/// Sums over light points.
#[derive(Debug, Clone, Default)]
pub struct Texture {
    /// Texels along both edges.
    pub size: [u32; 2],
    /// Light points that were drawn.
    pub samples: usize,
    /// Rows of sixteen texels in a row of the texture.
    stride: usize,
    seen: Vec<Row>,
    light: Vec<Row>,
    weight: Vec<Row>,
}

/// What a texture is drawn from.
pub struct TextureScene<'a> {
    /// The receiver's lit side.
    pub side: Side,
    /// The light, local.
    pub light: &'a Light,
    /// Seed of the light points.
    pub seed: u64,
    /// What may cast.
    pub occluders: &'a PatchOccluders,
}

/// A light point as the texels see it.
#[derive(Clone, Copy)]
struct Beam {
    position: Vec3,
    /// Direction in which a sphere emits there.
    normal: Vec3,
    /// Height of the light point over the receiver's plane.
    height: f32,
    area: f32,
}

/// What a light point's hard shadow leaves.
struct Shadow {
    beam: Beam,
    blocked: Bitmap,
    /// Transmittance of every texel, in rows of sixteen; empty where nothing is transparent.
    through: Vec<Row>,
}

/// Bytes of a texture under a light.
pub fn texture_bytes(size: [u32; 2], light: &Light, radiance: bool) -> usize {
    let rows = (size[0] as usize).div_ceil(LANES) * size[1] as usize;
    let sums = 1 + usize::from(radiance) + usize::from(Weighting::of(light) == Weighting::Sphere);
    rows.saturating_mul(sums * size_of::<Row>())
}

/// Bytes that drawing takes beside the texture.
pub fn drawing_bytes(size: [u32; 2], transparent: bool) -> usize {
    shadow_bytes(size, transparent).saturating_mul(batch(size, transparent))
}

fn shadow_bytes([width, height]: [u32; 2], transparent: bool) -> usize {
    let bits = (width as usize).div_ceil(64) * 8;
    let floats = (width as usize).div_ceil(LANES) * size_of::<Row>();
    (bits + if transparent { floats } else { 0 }) * height as usize
}

/// Light points in a batch.
fn batch(size: [u32; 2], transparent: bool) -> usize {
    (BATCH_BYTES / shadow_bytes(size, transparent).max(1)).clamp(1, BATCH)
}

impl Texture {
    /// A texture without any light points yet.
    pub fn new(size: [u32; 2], light: &Light, radiance: bool) -> Self {
        let stride = (size[0] as usize).div_ceil(LANES);
        let rows =
            |wanted: bool| vec![Row::default(); if wanted { stride * size[1] as usize } else { 0 }];
        Texture {
            size,
            samples: 0,
            stride,
            seen: rows(true),
            light: rows(radiance),
            weight: rows(Weighting::of(light) == Weighting::Sphere),
        }
    }

    /// Draws light points until there are so many; those that were drawn stay.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    pub fn refine(
        &mut self,
        scene: &TextureScene<'_>,
        samples: usize,
        control: &Control,
    ) -> Result<()> {
        let transparent = !scene.occluders.clear.is_empty();
        let kind = Weighting::of(scene.light);
        let corners = scene.side.bounds.corners();
        while self.samples < samples {
            let end = (self.samples + batch(self.size, transparent)).min(samples);
            let pattern = Pattern::part(self.samples..end, scene.seed);
            let sampler = Sampler::new(scene.light.clone(), pattern, true);
            let points = sampler.shared(&corners);
            let side = &scene.side;
            let draw = |point: &SharedPoint| {
                control.check()?;
                let height = side.normal.dot(point.position - side.bounds.corner);
                let beam = Beam {
                    position: point.position.as_vec3(),
                    normal: point.normal.as_vec3(),
                    height: height as f32,
                    area: point.area as f32,
                };
                let occluders = scene.occluders;
                Ok(draw(occluders, side, point.position, self.size, beam))
            };
            let work = self.seen.len() * LANES + 16 * scene.occluders.points.len();
            let small = work * points.len() < SMALL;
            let shadows: Vec<Shadow> = if small {
                points.iter().map(draw).collect::<Result<_>>()?
            } else {
                points.par_iter().map(draw).collect::<Result<_>>()?
            };
            self.add(
                &shadows,
                &scene.side,
                kind,
                points[0].normal.as_vec3(),
                small,
            );
            self.samples = end;
        }
        Ok(())
    }

    /// Adds up the shadows of a batch.
    fn add(&mut self, shadows: &[Shadow], side: &Side, kind: Weighting, normal: Vec3, small: bool) {
        let grid = Grid {
            side: *side,
            size: self.size,
            kind,
            normal,
            radiance: !self.light.is_empty(),
        };
        let stride = self.stride;
        let height = self.size[1] as usize;
        let each = |(y, seen, light, weight): (usize, &mut [Row], &mut [Row], &mut [Row])| {
            let (grid, sums) = (
                &grid,
                Sums {
                    seen,
                    light,
                    weight,
                },
            );
            dispatch!(detect(), simd => add_row(simd, grid, shadows, y, sums));
        };
        let mut lights = self.light.chunks_mut(stride);
        let mut weights = self.weight.chunks_mut(stride);
        let rows = self.seen.chunks_mut(stride).enumerate().map(|(y, seen)| {
            let light = lights.next().unwrap_or_default();
            (y, seen, light, weights.next().unwrap_or_default())
        });
        if small || height < 2 {
            rows.for_each(each);
        } else {
            let rows: Vec<_> = rows.collect();
            rows.into_par_iter().for_each(each);
        }
    }

    /// Where a texel's sums are.
    #[inline(always)]
    fn place(&self, x: usize, y: usize) -> (usize, usize) {
        (y * self.stride + x / LANES, x % LANES)
    }

    /// The fraction of the light that a texel sees.
    #[inline(always)]
    pub fn visibility(&self, x: usize, y: usize) -> f32 {
        let (row, lane) = self.place(x, y);
        let seen = self.seen[row].0[lane];
        let all = self
            .weight
            .get(row)
            .map_or(self.samples as f32, |w| w.0[lane]);
        sums::visibility(seen, all)
    }

    /// Replaces every texel's visibility by a function of it.
    pub fn map_visibility(&mut self, f: impl Fn(f32) -> f32) {
        let samples = self.samples.max(1) as f32;
        for (i, row) in self.seen.iter_mut().enumerate() {
            for (lane, seen) in row.0.iter_mut().enumerate() {
                let all = self.weight.get(i).map_or(samples, |w| w.0[lane]);
                *seen = f(sums::visibility(*seen, all)) * all;
            }
        }
    }

    /// Sets a texel's visibility, of a texture without light points.
    pub fn set(&mut self, x: usize, y: usize, visibility: f32) {
        self.samples = 1;
        let (row, lane) = self.place(x, y);
        self.seen[row].0[lane] = visibility;
        if let Some(weight) = self.weight.get_mut(row) {
            weight.0[lane] = 1.0;
        }
    }

    /// The irradiance of a texel at radiance 1, if it was asked for; `light` and `side` are those that the
    /// texture was drawn with.
    pub fn irradiance(&self, x: usize, y: usize, light: &Light, side: &Side) -> Option<f32> {
        let (row, lane) = self.place(x, y);
        let sum = self.light.get(row)?.0[lane];
        let weight = self.weight.get(row).map(|w| w.0[lane]);
        let center = || center_of(&side.bounds, self.size, [x as u32, y as u32]);
        Some(sums::irradiance(sum, weight, self.samples, light, center))
    }

    /// Bytes of the sums.
    pub fn bytes(&self) -> usize {
        (self.seen.len() + self.light.len() + self.weight.len()) * size_of::<Row>()
    }
}

/// The texels that a mesh's opaque triangles hide from one light point; all if it is under the receiver.
pub fn hard_shadow(
    occluders: &PatchOccluders,
    side: &Side,
    point: DVec3,
    size: [u32; 2],
) -> Bitmap {
    let beam = Beam {
        position: Vec3::ZERO,
        normal: Vec3::ZERO,
        height: side.normal.dot(point - side.bounds.corner) as f32,
        area: 0.0,
    };
    draw(occluders, side, point, size, beam).blocked
}

/// Draws the hard shadow of one light point.
fn draw(
    occluders: &PatchOccluders,
    side: &Side,
    point: DVec3,
    size: [u32; 2],
    beam: Beam,
) -> Shadow {
    let [width, height] = size;
    let mut shadow = Shadow {
        beam,
        blocked: Bitmap::default(),
        through: Vec::new(),
    };
    shadow.blocked.reset(width, height);
    let view = camera(point, &side.bounds, size).filter(|_| beam.height > 0.0);
    let Some(view) = &view else {
        shadow.blocked.words.fill(u64::MAX);
        return shadow;
    };
    let (stride, shadow_of) = ((width as usize).div_ceil(LANES), &mut shadow);
    dispatch!(detect(), _ => draw_lanes(occluders, view, stride, shadow_of));
    shadow
}

/// Draws the occluders.
#[inline(always)]
fn draw_lanes(occluders: &PatchOccluders, view: &Camera, stride: usize, shadow: &mut Shadow) {
    let points: Vec<Projected> = occluders
        .points
        .iter()
        .map(|p| Projected::new(*p, view))
        .collect();
    // A small texture is often full after a few triangles.
    let few = shadow.blocked.words.len() <= 4;
    let full = u64::MAX >> (63 - (view.width - 1) % 64);
    for face in &occluders.opaque {
        cover(face, &points, view, |y, a, b| shadow.blocked.set(y, a, b));
        if few && view.width <= 64 && shadow.blocked.words.iter().all(|w| *w == full) {
            return;
        }
    }
    for face in &occluders.closed {
        cover_facing(face, &points, view, true, |y, a, b| {
            shadow.blocked.set(y, a, b)
        });
    }
    if occluders.clear.is_empty() {
        return;
    }
    shadow.through = vec![Row([1.0; LANES]); stride * view.height as usize];
    for (face, part) in &occluders.clear {
        cover(face, &points, view, |y, a, b| {
            let row = &mut shadow.through[y as usize * stride..];
            for x in a as usize..=b as usize {
                row[x / LANES].0[x % LANES] *= part;
            }
        });
    }
}

/// What all texels have in common.
struct Grid {
    side: Side,
    size: [u32; 2],
    kind: Weighting,
    /// Direction in which a flat light emits.
    normal: Vec3,
    radiance: bool,
}

/// A row's sums.
struct Sums<'a> {
    seen: &'a mut [Row],
    light: &'a mut [Row],
    weight: &'a mut [Row],
}

/// Adds a batch's shadows to a row of texels, sixteen texels after the other.
#[inline(always)]
fn add_row<S: Simd>(simd: S, grid: &Grid, shadows: &[Shadow], y: usize, sums: Sums<'_>) {
    let [width, height] = grid.size;
    let v = (y as f64 + 0.5) / f64::from(height);
    let one = f32x16::splat(simd, 1.0);
    let minus_normal = splat_vector(simd, -grid.normal);
    for block in 0..sums.seen.len() {
        let mut at = [Row::default(); 3];
        for lane in 0..LANES {
            let u = ((block * LANES + lane) as f64 + 0.5) / f64::from(width);
            let p = grid.side.bounds.at(u, v).as_vec3();
            for axis in 0..3 {
                at[axis].0[lane] = p[axis];
            }
        }
        let texels = Texels {
            at: load_vector(simd, &at),
            kind: grid.kind,
            minus_normal,
            radiance: grid.radiance,
        };
        let zero = f32x16::splat(simd, 0.0);
        let in_front = texels.in_front(&splat_vector(simd, shadows[0].beam.position));
        let mut all = LaneSums {
            seen: sums.seen[block].load(simd),
            light: sums.light.get(block).map_or(zero, |r| r.load(simd)),
            weight: sums.weight.get(block).map_or(zero, |r| r.load(simd)),
        };
        for shadow in shadows {
            let beam = &shadow.beam;
            let open = !shadow.blocked.block(y, block) & in_front;
            let through = match shadow.through.get(y * sums.seen.len() + block) {
                Some(row) => row.load(simd),
                None => one,
            };
            let beams = Beams {
                position: splat_vector(simd, beam.position),
                normal: splat_vector(simd, beam.normal),
                height: f32x16::splat(simd, beam.height),
                area: f32x16::splat(simd, beam.area),
            };
            texels.add(&beams, open, through, &mut all);
        }
        sums.seen[block].set(all.seen);
        if let Some(row) = sums.light.get_mut(block) {
            row.set(all.light);
        }
        if let Some(row) = sums.weight.get_mut(block) {
            row.set(all.weight);
        }
    }
}
