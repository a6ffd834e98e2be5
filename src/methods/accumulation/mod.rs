//! Averaged hard shadows on receiver polygons (Herf and Heckbert 1996, "Simulating Soft Shadows with
//! Graphics Hardware").
//!
//! Every receiver polygon has a texture. Seen from a light point, the occluders between it and the polygon are
//! flattened onto it by a projective transform and drawn; the mean over the light points is the texture.
//! - [`patches`]: the receiver polygons and the parallelograms around them;
//! - [`transform`]: the 4×4 matrix from a light point's pyramid to the unit box;
//! - [`occluders`]: what may cast on a polygon, cut at its plane;
//! - [`texture`]: drawing, averaging, refining;
//! - [`lookup`]: what a pixel sees of a texture;
//! - this file: parameters, and the textures of a scene.
//!
//! At a texel's centre the answer is that of `ray_traced` with the same light points for all receivers, but
//! where a shadow's edge passes within rounding of it. Between texels it is interpolated. Assumptions and
//! failures: receivers are polygons, so a finely tessellated mesh has as many textures as triangles, few
//! texels each; a shadow's edge is as sharp as texels are small; `n` light points make `n + 1` levels, which
//! show as steps where `n` is small. Analytic spheres are neither receivers nor occluders.
//!
//! Textures do not depend on the camera. A picture draws those that it shows and that are not yet drawn; they
//! are kept.

pub mod lookup;
pub mod occluders;
pub mod patches;
pub mod texture;
pub mod transform;

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::ray_traced::MOST_SAMPLES;
use super::{Method, Prepared, Shading};
use crate::control::Control;
use crate::error::{Error, Result};
use crate::geometry::Geometry;
use crate::light::Light;
use crate::receivers::Receivers;
use lookup::{Contacts, Mask, Reader};
use occluders::{Casting, Gatherer, Side, bodies};
use patches::Patches;
use texture::{Scene, Texture, drawing_bytes, texture_bytes};

/// Largest side of a texture that can be asked for.
pub const MOST_TEXELS: u32 = 1 << 13;

/// What a texture holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// Every light point's irradiance, and the fraction of them that is seen.
    Radiance,
    /// The fraction that is seen; the unshadowed light comes from its closed form.
    Modulation,
    /// The same in eight bits, drawn by adding `(256 - a) / n` for every light point that is seen.
    EightBit,
}

/// Parameters of averaged hard shadows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accumulation {
    /// Light points.
    pub samples: usize,
    /// Their seed.
    pub seed: u64,
    /// What a texture holds.
    pub content: Content,
    /// Grey level of what sees no light, 0 to 1 (a modulation texture), or the radiance that comes from
    /// everywhere (a radiance texture). It is in textures, not in a picture's visibility.
    pub ambient: f64,
    /// World size of a texel; `None`: the scene's largest extent over `most_texels`.
    pub texel: Option<f64>,
    /// Most texels along an edge, a power of two.
    pub most_texels: u32,
    /// Whether the four texels around a pixel are interpolated.
    pub interpolate: bool,
    /// Most bytes of textures.
    pub memory: usize,
    /// Whether meshes with an opacity above 0 block everything.
    pub opaque: bool,
}

impl Accumulation {
    /// Checks the parameters.
    ///
    /// # Errors
    /// What is out of its range.
    pub fn checked(self) -> Result<Self> {
        let bad = |reason: String| Err(Error::parameter("Accumulation", reason));
        if !(1..=MOST_SAMPLES).contains(&self.samples) {
            let got = self.samples;
            return bad(format!("samples must be 1 to {MOST_SAMPLES}, got {got}"));
        }
        if !(1..=MOST_TEXELS).contains(&self.most_texels) || !self.most_texels.is_power_of_two() {
            let got = self.most_texels;
            return bad(format!(
                "max_size must be a power of two from 1 to {MOST_TEXELS}, got {got}"
            ));
        }
        if let Some(texel) = self.texel.filter(|t| !(t.is_finite() && *t > 0.0)) {
            return bad(format!("texel must be positive and finite, got {texel}"));
        }
        let most = if self.content == Content::Radiance {
            f64::MAX
        } else {
            1.0
        };
        if !(0.0..=most).contains(&self.ambient) {
            let range = if most == 1.0 { "0 to 1" } else { "0 or more" };
            return bad(format!("ambient must be {range}, got {}", self.ambient));
        }
        if self.content == Content::EightBit {
            let left = 256 - self.ambient_level();
            if self.samples > left || left % self.samples != 0 {
                return bad(format!(
                    "samples must divide {left} (256 less the ambient level) for texture=\"eight_bit\", \
                     got {}",
                    self.samples
                ));
            }
        }
        Ok(self)
    }

    /// The ambient level of eight bits, `a`.
    pub fn ambient_level(&self) -> usize {
        (256.0 * self.ambient).round() as usize
    }

    /// What an eight-bit texture of so many light points holds at a visibility: `a` and `(256 - a) / n` for each
    /// point seen, added with saturation.
    pub fn eight_bits(&self, visibility: f32, samples: usize) -> u8 {
        let a = self.ambient_level();
        let step = (256 - a) / samples.max(1);
        let seen = (f64::from(visibility) * samples as f64).round() as usize;
        (a + step * seen).min(255) as u8
    }

    /// What a picture makes of eight bits: the light's part of them, the saturated level being all of it.
    fn from_eight_bits(&self, level: u8) -> f32 {
        let a = self.ambient_level();
        if level == 255 {
            return 1.0;
        }
        (usize::from(level) - a) as f32 / (256 - a) as f32
    }
}

/// A texture of a scene: a patch, the side that is looked at and a light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Key {
    /// Number in [`Patches::list`].
    pub patch: u32,
    /// Whether it is the side that the patch's normal points to.
    pub front: bool,
    /// Number of the light.
    pub light: u32,
}

/// What the textures of a scene are drawn from.
pub struct Atlas {
    /// The scene.
    pub geometry: Arc<Geometry>,
    /// Its receiver polygons.
    pub patches: Patches,
    /// The lights, in local coordinates.
    pub lights: Vec<Light>,
    /// The parameters.
    pub method: Accumulation,
    bodies: Vec<Option<[DVec3; 8]>>,
    /// Local size of a texel.
    texel: f64,
}

impl Atlas {
    /// Finds the receiver polygons of a scene; `lights` in world coordinates.
    ///
    /// # Errors
    /// Spheres that cast.
    pub fn new(geometry: Arc<Geometry>, lights: &[Light], method: Accumulation) -> Result<Self> {
        let casts = |s: &crate::geometry::Sphere| geometry.material(s.entry).casts;
        if geometry.spheres.iter().any(casts) {
            let reason =
                "spheres of add_spheres have no triangles to draw; add them as meshes, or \
                          with casts=False"
                    .into();
            let method = "accumulation";
            return Err(Error::Unsupported { method, reason });
        }
        let texel = match method.texel {
            Some(world) => world / geometry.frame.unit,
            None => extent(&geometry) / f64::from(method.most_texels),
        };
        geometry.occluders();
        let patches = Patches::new(&geometry);
        let bodies = bodies(&geometry);
        let lights = lights.iter().map(|l| l.to_local(&geometry.frame)).collect();
        Ok(Atlas {
            geometry,
            patches,
            lights,
            method,
            bodies,
            texel,
        })
    }

    /// Texels along the edges of a patch.
    pub fn size(&self, patch: u32) -> [u32; 2] {
        self.patches.list[patch as usize].texture_size(self.texel, self.method.most_texels)
    }

    /// Bytes of textures, and of what drawing them takes for a while.
    ///
    /// # Errors
    /// More than the method may take, or than there is.
    pub fn check_memory(&self, keys: &[Key], before: usize) -> Result<usize> {
        let radiance = self.method.content == Content::Radiance;
        let clear = self.geometry.occluders().transparent.is_some() && !self.method.opaque;
        let (mut bytes, mut drawing) = (before, 0);
        for key in keys {
            let size = self.size(key.patch);
            let light = &self.lights[key.light as usize];
            bytes = bytes.saturating_add(texture_bytes(size, light, radiance));
            drawing = drawing.max(drawing_bytes(size, clear));
        }
        let most = drawing.saturating_mul(rayon::current_num_threads());
        let total = bytes.saturating_add(most);
        let gigabytes = |b: usize| b as f64 / 1e9;
        if total > self.method.memory || Vec::<u8>::new().try_reserve_exact(total).is_err() {
            let reason = format!(
                "{} textures take {:.2} GB and drawing them {:.2} GB, more than memory_limit={:.2} GB or than \
                 there is; a larger texel or a smaller max_size takes less",
                keys.len(),
                gigabytes(bytes),
                gigabytes(most),
                gigabytes(self.method.memory),
            );
            return Err(Error::parameter("Accumulation", reason));
        }
        Ok(bytes)
    }

    /// The side of a patch that a texture shows.
    pub fn side(&self, key: Key) -> Side {
        let patch = &self.patches.list[key.patch as usize];
        let normal = if key.front {
            patch.normal
        } else {
            -patch.normal
        };
        Side::new(&patch.bounds, normal)
    }

    /// Draws light points into a texture until it has so many; returns where occluders pass through it.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn refine(
        &self,
        texture: &mut Texture,
        key: Key,
        samples: usize,
        gatherer: &mut Gatherer,
        control: &Control,
    ) -> Result<Contacts> {
        control.check()?;
        let side = self.side(key);
        let light = &self.lights[key.light as usize];
        let casting = Casting {
            geometry: &self.geometry,
            patches: &self.patches,
            bodies: &self.bodies,
            opaque: self.method.opaque,
        };
        let found = gatherer.collect(&casting, key.patch, &side, light);
        let scene = Scene {
            side,
            light,
            number: key.light,
            seed: self.method.seed,
            occluders: &found,
        };
        texture.refine(&scene, samples, control)?;
        Ok(Contacts::new(&side.bounds, texture.size, &found.contacts))
    }

    /// An empty texture.
    pub fn texture(&self, key: Key) -> Texture {
        let radiance = self.method.content == Content::Radiance;
        let light = &self.lights[key.light as usize];
        Texture::new(self.size(key.patch), light, radiance)
    }

    /// Draws textures, the largest first; calls `done` with the number of texels after each.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn draw(
        &self,
        textures: &mut [(Key, Texture)],
        samples: usize,
        control: &Control,
        done: impl Fn(usize) + Sync,
    ) -> Result<Vec<Contacts>> {
        // Large textures share their light points among threads, small ones are shared among them.
        textures
            .par_iter_mut()
            .with_max_len(1)
            .map_init(Gatherer::default, |gatherer, (key, texture)| {
                let contacts = self.refine(texture, *key, samples, gatherer, control)?;
                done(texture.size[0] as usize * texture.size[1] as usize);
                Ok(contacts)
            })
            .collect()
    }
}

/// The largest extent of a scene's meshes along an axis, local units.
fn extent(geometry: &Geometry) -> f64 {
    let positions = geometry.faces.par_iter().flatten();
    let (low, high) = positions
        .map(|&v| geometry.positions[v as usize])
        .map(|p| (p, p))
        .reduce(
            || (Vec3::INFINITY, Vec3::NEG_INFINITY),
            |a, b| (a.0.min(b.0), a.1.max(b.1)),
        );
    f64::from((high - low).max_element()).max(f64::MIN_POSITIVE)
}

struct PreparedAccumulation {
    atlas: Atlas,
    drawn: Mutex<HashMap<Key, Arc<Drawn>>>,
}

/// A finished texture, and what looking it up needs.
struct Drawn {
    texture: Texture,
    mask: Mask,
    contacts: Contacts,
}

impl Drawn {
    fn bytes(&self) -> usize {
        self.texture.bytes() + self.mask.bytes() + self.contacts.bytes()
    }
}

impl Method for Accumulation {
    fn name(&self) -> &'static str {
        "accumulation"
    }

    fn prepare(
        &self,
        geometry: Arc<Geometry>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        control.check()?;
        let atlas = Atlas::new(geometry, lights, *self)?;
        Ok(Box::new(PreparedAccumulation {
            atlas,
            drawn: Mutex::default(),
        }))
    }
}

impl PreparedAccumulation {
    /// The texture that a receiver of a camera's pixel shows, if it is on a polygon.
    fn key(&self, receivers: &Receivers, i: usize, light: u32) -> Option<Key> {
        let face = *receivers.faces.get(i)?;
        let patch = *self.atlas.patches.of_face.get(face as usize)?;
        let normal = self.atlas.patches.list.get(patch as usize)?.normal;
        let front = receivers.normals[i].dot(normal) >= 0.0;
        Some(Key {
            patch,
            front,
            light,
        })
    }

    /// Draws the textures that are missing; advances `steps` steps.
    fn draw(
        &self,
        mut keys: Vec<Key>,
        steps: usize,
        control: &Control,
    ) -> Result<HashMap<Key, Arc<Drawn>>> {
        keys.sort_unstable();
        keys.dedup();
        let mut known = self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        let missing: Vec<Key> = keys
            .iter()
            .copied()
            .filter(|k| !known.contains_key(k))
            .collect();
        let before = known.values().map(|d| d.bytes()).sum();
        self.atlas.check_memory(&missing, before)?;
        let mut textures: Vec<_> = missing
            .iter()
            .map(|&k| (k, self.atlas.texture(k)))
            .collect();
        textures.sort_by_key(|(k, t)| (std::cmp::Reverse(t.bytes()), *k));
        let total: usize = textures
            .iter()
            .map(|(_, t)| t.size[0] as usize * t.size[1] as usize)
            .sum();
        let finished = std::sync::atomic::AtomicUsize::new(0);
        let progress = |texels: usize| {
            use std::sync::atomic::Ordering::Relaxed;
            let part = |x: usize| (x as u128 * steps as u128 / total as u128) as usize;
            let before = finished.fetch_add(texels, Relaxed);
            control.advance(part(before + texels) - part(before));
        };
        let samples = self.atlas.method.samples;
        let contacts = self.atlas.draw(&mut textures, samples, control, progress)?;
        if textures.is_empty() {
            control.advance(steps);
        }
        let drawn: Vec<_> = textures
            .into_par_iter()
            .zip(contacts)
            .map(|((key, texture), contacts)| {
                let mask = Mask::new(&self.atlas, key.patch);
                let drawn = Drawn {
                    texture,
                    mask,
                    contacts,
                };
                (key, Arc::new(drawn))
            })
            .collect();
        known.extend(drawn);
        Ok(keys.into_iter().map(|k| (k, known[&k].clone())).collect())
    }
}

impl Prepared for PreparedAccumulation {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let atlas = &self.atlas;
        let number = light as u32;
        let light = &atlas.lights[light];
        if receivers.faces.len() != receivers.len() {
            let reason = "it needs a camera: its textures belong to polygons, not to points".into();
            let method = "accumulation";
            return Err(Error::Unsupported { method, reason });
        }
        let keys: Vec<Option<Key>> = (0..receivers.len())
            .into_par_iter()
            .map(|i| self.key(receivers, i, number))
            .collect();
        let wanted = keys.par_iter().flatten().copied().collect();
        let drawn = self.draw(wanted, receivers.group_count(), control)?;
        let readers: HashMap<Key, Reader<'_>> = drawn
            .iter()
            .map(|(&key, d)| {
                let reader = Reader::new(d, light, atlas.side(key), &atlas.method);
                (key, reader)
            })
            .collect();
        let values: Vec<[f32; 2]> = (0..receivers.len())
            .into_par_iter()
            .map(|i| {
                let (p, n) = (receivers.positions[i], receivers.normals[i]);
                match keys[i].and_then(|k| readers.get(&k)) {
                    Some(reader) => reader.at(p),
                    // A sphere, or a sliver without a plane of its own: unshadowed.
                    None => unshadowed(light, p, n),
                }
            })
            .collect();
        let radiance = atlas.method.content == Content::Radiance;
        Ok(Shading {
            visibility: values.iter().map(|v| v[0]).collect(),
            irradiance: radiance.then(|| values.iter().map(|v| v[1]).collect()),
        })
    }

    fn bytes(&self) -> usize {
        let known = self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        let textures: usize = known.values().map(|d| d.bytes()).sum();
        textures + self.atlas.patches.bytes()
    }
}

fn unshadowed(light: &Light, p: DVec3, n: DVec3) -> [f32; 2] {
    [
        light.fraction_above(p, n) as f32,
        light.unshadowed_irradiance(p, n) as f32,
    ]
}
