//! Averaged hard shadows on receiver polygons (Herf and Heckbert 1996, "Simulating Soft Shadows with
//! Graphics Hardware").
//!
//! Every receiver polygon has a texture. Seen from a light point, the occluders between it and the polygon are
//! flattened onto it by a projective transform and drawn; the mean over the light points is the texture
//! ([`crate::textures`]).
//!
//! At a texel's centre the answer is that of `ray_traced` with the same light points for all receivers, but
//! where a shadow's edge passes within rounding of it. Between texels it is interpolated. Assumptions and
//! failures: receivers are polygons, so a finely tessellated mesh has as many textures as triangles, few
//! texels each; a shadow's edge is as sharp as texels are small; `n` light points make `n + 1` levels, which
//! show as steps where `n` is small. Analytic spheres are neither receivers nor occluders.
//!
//! Textures do not depend on the camera. A picture draws those that it shows and that are not yet drawn; they
//! are kept.

use crate::error::in_range;
use crate::scene::snapshot::Snapshot;
use std::sync::Arc;

use crate::control::Control;
use crate::error::{Error, Result};
use crate::light::Light;
use crate::method::{Method, Prepared};
use crate::sampling::MOST_SAMPLES;
use crate::textures::atlas::{Atlas, Key, Layout};
use crate::textures::lookup::Contacts;
use crate::textures::occluders::Gatherer;
use crate::textures::pictures::{Painter, Pictures};
use crate::textures::texture::{Texture, TextureScene};
use crate::textures::traced::{Tracing, Wanted};

/// Up to so many texels a texture is never drawn: to trace those that are looked up takes as long as to find what
/// casts on it.
const FEW_TEXELS: usize = 64;

/// What a texture holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// Every light point's irradiance, and the fraction of them that is seen.
    Radiance,
    /// The fraction that is seen; the unshadowed light comes from its closed form.
    Modulation,
    /// The same fraction in eight bits, drawn by adding `(256 - a) / n` for every light point that is seen.
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
    /// How polygons become textures.
    pub layout: Layout,
}

impl Accumulation {
    /// Checks the parameters.
    ///
    /// # Errors
    /// What is out of its range.
    pub fn checked(self) -> Result<Self> {
        let bad = |reason: String| Err(Error::parameter("Accumulation", reason));
        in_range(
            "Accumulation",
            "samples",
            self.samples as u32,
            1..=MOST_SAMPLES,
        )?;
        self.layout.check()?;
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
            if self.samples > left || !left.is_multiple_of(self.samples) {
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

    /// The visibility that a texture keeps.
    fn kept(&self, visibility: f32) -> f32 {
        if self.content == Content::EightBit {
            return self.visibility_of(self.eight_bits(visibility, self.samples));
        }
        visibility
    }

    /// What a picture makes of eight bits: the light's part of them, the saturated level being all of it.
    fn visibility_of(&self, level: u8) -> f32 {
        let a = self.ambient_level();
        if level == 255 {
            return 1.0;
        }
        (usize::from(level) - a) as f32 / (256 - a) as f32
    }

    /// Draws light points into a texture until it has so many; returns where occluders pass through it.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn refine(
        &self,
        atlas: &Atlas,
        key: Key,
        texture: &mut Texture,
        samples: usize,
        gatherer: &mut Gatherer,
        control: &Control,
    ) -> Result<Contacts> {
        let side = atlas.side(key);
        let found = atlas.occluders(key, &side, gatherer);
        let scene = TextureScene {
            side,
            light: &atlas.lights[key.light as usize],
            seed: self.seed,
            occluders: &found,
        };
        texture.refine(&scene, samples, control)?;
        Ok(Contacts::new(&side.bounds, texture.size, &found.contacts))
    }
}

impl Painter for Accumulation {
    fn paint(
        &self,
        atlas: &Atlas,
        key: Key,
        texture: &mut Texture,
        gatherer: &mut Gatherer,
        control: &Control,
    ) -> Result<Contacts> {
        let contacts = self.refine(atlas, key, texture, self.samples, gatherer, control)?;
        if self.content == Content::EightBit {
            texture.map_visibility(|v| self.kept(v));
        }
        Ok(contacts)
    }

    fn is_sparse(&self, atlas: &Atlas, key: Key, gatherer: &mut Gatherer) -> bool {
        let [width, height] = atlas.size(key.patch).map(|s| s as usize);
        let texels = width * height;
        texels <= FEW_TEXELS || atlas.has_more_occluders(key, texels, gatherer)
    }

    fn find(
        &self,
        atlas: &Atlas,
        light: u32,
        wanted: &[Wanted],
        control: &Control,
        done: &(dyn Fn(usize) + Sync),
    ) -> Result<Vec<[f32; 2]>> {
        let tracing = Tracing::new(atlas, light, self.samples, self.seed);
        let mut found = tracing.texels(wanted, control, done)?;
        for [visibility, _] in &mut found {
            *visibility = self.kept(*visibility);
        }
        Ok(found)
    }
}

impl Method for Accumulation {
    fn name(&self) -> &'static str {
        "accumulation"
    }

    fn prepare(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        control.check()?;
        let atlas = Atlas::new(geometry, lights, self.layout, control)?.fitted();
        Ok(Box::new(Pictures::new(atlas, *self)))
    }
}
