//! The receiver polygons of a scene, their sizes as textures, and what they are drawn from.

use crate::scene::snapshot::Snapshot;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::occluders::{Casting, Gatherer, PatchOccluders, Side, bodies};
use super::patches::Patches;
use super::texture::{Texture, drawing_bytes, texture_bytes};
use super::window;
use crate::control::Control;
use crate::error::{Error, Result};
use crate::geometry::{Geometry, Sphere};
use crate::light::Light;
use crate::memory;

/// Largest side of a texture that can be asked for.
pub const MOST_TEXELS: u32 = 1 << 13;

/// How a scene's polygons become textures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// The method's name, and that of its class, for errors.
    pub names: [&'static str; 2],
    /// World size of a texel; `None`: the scene's largest extent over `most_texels`.
    pub texel: Option<f64>,
    /// Most texels along an edge, a power of two.
    pub most_texels: u32,
    /// Whether the four texels around a pixel are interpolated.
    pub interpolate: bool,
    /// Most bytes of textures.
    pub memory: usize,
    /// Whether textures hold irradiance too.
    pub radiance: bool,
    /// Whether meshes with an opacity above 0 block everything.
    pub opaque: bool,
}

impl Layout {
    /// Checks the sizes.
    ///
    /// # Errors
    /// What is out of its range.
    pub fn check(&self) -> Result<()> {
        let bad = |reason: String| Err(Error::parameter(self.names[1], reason));
        if !(1..=MOST_TEXELS).contains(&self.most_texels) || !self.most_texels.is_power_of_two() {
            let got = self.most_texels;
            return bad(format!(
                "max_size must be a power of two from 1 to {MOST_TEXELS}, got {got}"
            ));
        }
        if let Some(texel) = self.texel.filter(|t| !(t.is_finite() && *t > 0.0)) {
            return bad(format!("texel must be positive and finite, got {texel}"));
        }
        Ok(())
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
    pub geometry: Arc<Snapshot>,
    /// Its receiver polygons.
    pub patches: Patches,
    /// The lights, in local coordinates.
    pub lights: Vec<Light>,
    /// How they become textures.
    pub layout: Layout,
    bodies: Vec<Option<[DVec3; 8]>>,
    /// Local size of a texel.
    texel: f64,
}

impl Atlas {
    /// Finds the receiver polygons of a scene; `lights` in local coordinates.
    ///
    /// # Errors
    /// Spheres that cast, or [`Error::Cancelled`].
    pub fn new(
        geometry: Arc<Snapshot>,
        lights: &[Light],
        layout: Layout,
        control: &Control,
    ) -> Result<Self> {
        let casts = |s: &Sphere| geometry.material(s.entry).casts;
        if geometry.spheres.iter().any(casts) {
            let reason =
                "spheres of add_spheres have no triangles to draw; add them as meshes, or \
                          with casts=False"
                    .into();
            let method = layout.names[0];
            return Err(Error::Unsupported { method, reason });
        }
        let texel = match layout.texel {
            Some(world) => world / geometry.frame.unit,
            None => extent(&geometry) / f64::from(layout.most_texels),
        };
        geometry.occluders();
        let patches = Patches::new(&geometry, control)?;
        control.check()?;
        let bodies = bodies(&geometry);
        Ok(Atlas {
            geometry,
            patches,
            lights: lights.to_vec(),
            layout,
            bodies,
            texel,
        })
    }

    /// The same atlas with the textures of large polygons where shadows can fall, in a scene that is far larger than
    /// what casts in it.
    pub fn fitted(mut self) -> Self {
        if !self.geometry.frame.is_core {
            return self;
        }
        window::fit(&self.geometry, &mut self.patches, &self.lights);
        if self.layout.texel.is_none() {
            let lengths = self.patches.list.iter().flat_map(|p| p.bounds.edges);
            let largest = lengths.map(DVec3::length).fold(f64::MIN_POSITIVE, f64::max);
            self.texel = largest / f64::from(self.layout.most_texels);
        }
        self
    }

    /// Texels along the edges of a patch.
    pub fn size(&self, patch: u32) -> [u32; 2] {
        self.patches.list[patch as usize].texture_size(self.texel, self.layout.most_texels)
    }

    /// Bytes of textures, and of what drawing them takes for a while.
    ///
    /// # Errors
    /// More than the method may take, or than there is; a polygon on which shadows can fall without bound.
    pub fn check_memory(&self, keys: &[Key], before: usize) -> Result<usize> {
        let radiance = self.layout.radiance;
        let clear = self.geometry.occluders().transparent.is_some() && !self.layout.opaque;
        let (mut bytes, mut drawing) = (before, 0);
        for key in keys {
            let patch = &self.patches.list[key.patch as usize];
            if patch.boundless[usize::from(key.front)] {
                let face = patch.faces[0];
                let mesh = self.geometry.mesh_of(face);
                let reason = format!(
                    "something over triangle {} of entry {} is as high as light {} or as large as that triangle, \
                     which is much larger than what is small in the scene: no texture holds the shadow; divide \
                     the triangle, or use a method without textures",
                    face - mesh.first_face,
                    mesh.entry,
                    key.light,
                );
                let method = self.layout.names[0];
                return Err(Error::Unsupported { method, reason });
            }
            let size = self.size(key.patch);
            let light = &self.lights[key.light as usize];
            bytes = bytes.saturating_add(texture_bytes(size, light, radiance));
            drawing = drawing.max(drawing_bytes(size, clear));
        }
        let most = drawing.saturating_mul(rayon::current_num_threads());
        let total = bytes.saturating_add(most);
        let gigabytes = |b: usize| b as f64 / 1e9;
        if total > self.layout.memory {
            let reason = format!(
                "{} textures take {:.2} GB and drawing them {:.2} GB, more than memory_limit={:.2} GB; \
                 a larger texel or a smaller max_size takes less",
                keys.len(),
                gigabytes(bytes),
                gigabytes(most),
                gigabytes(self.layout.memory),
            );
            return Err(Error::parameter(self.layout.names[1], reason));
        }
        let what = || {
            format!(
                "{}: {} textures and drawing them",
                self.layout.names[1],
                keys.len()
            )
        };
        memory::check(what, total)?;
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

    /// What may cast on a texture.
    pub fn occluders(&self, key: Key, side: &Side, gatherer: &mut Gatherer) -> PatchOccluders {
        gatherer.collect(
            &self.casting(),
            key.patch,
            side,
            &self.lights[key.light as usize],
        )
    }

    /// Lines along which what casts passes through a texture.
    pub fn contacts(&self, key: Key, side: &Side, gatherer: &mut Gatherer) -> Vec<[DVec3; 2]> {
        gatherer.contacts(
            &self.casting(),
            key.patch,
            side,
            &self.lights[key.light as usize],
        )
    }

    /// Whether more than so many triangles may cast on a texture.
    pub fn has_more_occluders(&self, key: Key, most: usize, gatherer: &mut Gatherer) -> bool {
        let light = &self.lights[key.light as usize];
        gatherer.has_more(&self.casting(), &self.side(key), light, most)
    }

    fn casting(&self) -> Casting<'_> {
        Casting {
            geometry: &self.geometry,
            patches: &self.patches,
            bodies: &self.bodies,
            opaque: self.layout.opaque,
        }
    }

    /// An empty texture.
    pub fn texture(&self, key: Key) -> Texture {
        let radiance = self.layout.radiance;
        let light = &self.lights[key.light as usize];
        Texture::new(self.size(key.patch), light, radiance)
    }

    /// Paints textures, each by one call for itself; calls `done` with the number of texels after each. The
    /// largest should come first, and share their work among threads.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn paint<T: Send>(
        &self,
        textures: &mut [(Key, Texture)],
        paint: impl Fn(Key, &mut Texture, &mut Gatherer) -> Result<T> + Sync,
        control: &Control,
        done: impl Fn(usize) + Sync,
    ) -> Result<Vec<T>> {
        textures
            .par_iter_mut()
            .with_max_len(1)
            .map_init(Gatherer::default, |gatherer, (key, texture)| {
                control.check()?;
                let result = paint(*key, texture, gatherer)?;
                done(texture.size[0] as usize * texture.size[1] as usize);
                Ok(result)
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
