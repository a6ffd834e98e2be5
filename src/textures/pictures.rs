//! Pictures from textures: those of the polygons that a camera shows are painted at first sight and kept.
//!
//! Of a polygon whose whole texture is not worth painting, the texels that a picture looks up are found and kept.
//! Which polygons these are depends on the polygon alone, and a texel on nothing but itself, so a picture
//! does not depend on those before.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use super::atlas::{Atlas, Key};
use super::lookup::{Contacts, Drawn, Reader, TexelMask, Values};
use super::occluders::Gatherer;
use super::sparse::Sparse;
use super::texture::Texture;
use super::traced::Wanted;
use crate::control::Control;
use crate::error::{Error, Result};
use crate::light::Light;
use crate::method::{Irradiance, Prepared, Shading};
use crate::receivers::Receivers;

/// How a method makes a texture.
pub trait Painter: Send + Sync {
    /// Paints an empty texture; returns where occluders pass through it.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    fn paint(
        &self,
        atlas: &Atlas,
        key: Key,
        texture: &mut Texture,
        gatherer: &mut Gatherer,
        control: &Control,
    ) -> Result<Contacts>;

    /// Whether a texture's texels are found one by one, as pictures look them up ([`Painter::find`]).
    fn is_sparse(&self, _atlas: &Atlas, _key: Key, _gatherer: &mut Gatherer) -> bool {
        false
    }

    /// Visibility and irradiance of texels under one light, those of neighbouring pixels one after the other; calls
    /// `done` with the number of texels that were found.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    fn find(
        &self,
        _atlas: &Atlas,
        _light: u32,
        wanted: &[Wanted],
        _control: &Control,
        _done: &(dyn Fn(usize) + Sync),
    ) -> Result<Vec<[f32; 2]>> {
        Ok(vec![[0.0; 2]; wanted.len()])
    }

    /// Whether textures know nothing of tangent planes and emitting sides: pictures then show no more than the
    /// part of the light over them.
    fn knows_only_occluders(&self) -> bool {
        false
    }
}

/// A scene's textures, painted as they are needed.
pub struct Pictures<P> {
    atlas: Atlas,
    painter: P,
    drawn: Mutex<HashMap<Key, Arc<Drawn>>>,
    /// Nanoseconds that painting took so far.
    spent: AtomicU64,
}

impl<P: Painter> Pictures<P> {
    /// The pictures of `atlas`, of which none is painted yet.
    pub fn new(atlas: Atlas, painter: P) -> Self {
        Pictures {
            atlas,
            painter,
            drawn: Mutex::default(),
            spent: AtomicU64::new(0),
        }
    }

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
        let start = Instant::now();
        let mut known = self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        let missing: Vec<Key> = keys
            .iter()
            .copied()
            .filter(|k| !known.contains_key(k))
            .collect();
        let before = known.values().map(|d| d.bytes()).sum();
        self.atlas.check_memory(&missing, before)?;
        let sparse: Vec<(Key, Option<Drawn>)> = missing
            .par_iter()
            .map_init(Gatherer::default, |gatherer, &key| {
                control.check()?;
                Ok((key, self.sparse(key, gatherer)))
            })
            .collect::<Result<_>>()?;
        let whole = sparse.iter().filter(|(_, drawn)| drawn.is_none());
        let mut textures: Vec<_> = whole.map(|&(k, _)| (k, self.atlas.texture(k))).collect();
        textures.sort_by_key(|(k, t)| (std::cmp::Reverse(t.bytes()), *k));
        let total = textures
            .iter()
            .map(|(_, t)| t.size[0] as usize * t.size[1] as usize)
            .sum();
        let steps = Steps::new(steps, total, control);
        let paint = |key: Key, texture: &mut Texture, gatherer: &mut Gatherer| {
            self.painter
                .paint(&self.atlas, key, texture, gatherer, control)
        };
        let done = |texels| steps.advance(texels);
        let contacts = self.atlas.paint(&mut textures, paint, control, done)?;
        let drawn: Vec<_> = textures
            .into_par_iter()
            .zip(contacts)
            .map(|((key, texture), contacts)| {
                let drawn = Drawn {
                    values: Values::Whole(texture),
                    mask: TexelMask::new(&self.atlas, key.patch),
                    contacts,
                };
                (key, Arc::new(drawn))
            })
            .collect();
        let sparse = sparse.into_iter();
        known.extend(sparse.filter_map(|(k, drawn)| Some((k, Arc::new(drawn?)))));
        known.extend(drawn);
        self.count(start);
        Ok(keys.into_iter().map(|k| (k, known[&k].clone())).collect())
    }

    /// A texture without any texels yet, if they are to be found one by one.
    fn sparse(&self, key: Key, gatherer: &mut Gatherer) -> Option<Drawn> {
        let atlas = &self.atlas;
        if !self.painter.is_sparse(atlas, key, gatherer) {
            return None;
        }
        let (size, side) = (atlas.size(key.patch), atlas.side(key));
        let mask = TexelMask::new(atlas, key.patch);
        let contacts = if mask.has_one() {
            Contacts::default()
        } else {
            Contacts::new(&side.bounds, size, &atlas.contacts(key, &side, gatherer))
        };
        Some(Drawn {
            values: Values::Sparse(Sparse::new(size)),
            mask,
            contacts,
        })
    }

    /// Finds the texels that receivers show and that are not known; advances `steps` steps.
    fn find(
        &self,
        receivers: &Receivers,
        readers: &[Option<(Key, &Reader<'_>)>],
        light: u32,
        steps: usize,
        control: &Control,
    ) -> Result<()> {
        let start = Instant::now();
        // The first receiver that shows a texel gives it its place, so that neighbours stay neighbours.
        let mut wanted: Vec<(Wanted, usize)> = readers
            .par_iter()
            .enumerate()
            .fold(Vec::new, |mut out, (i, reader)| {
                if let Some((key, reader)) = reader {
                    reader.unknown(receivers.positions[i], |t| out.push(((*key, t), i)));
                }
                out
            })
            .flatten()
            .collect();
        wanted.par_sort_unstable();
        wanted.dedup_by_key(|(texel, _)| *texel);
        wanted.par_sort_unstable_by_key(|&(texel, i)| (i, texel));
        let steps = Steps::new(steps, wanted.len(), control);
        let texels: Vec<Wanted> = wanted.iter().map(|&(texel, _)| texel).collect();
        let done = |texels| steps.advance(texels);
        let found = self
            .painter
            .find(&self.atlas, light, &texels, control, &done)?;
        for (&((_, texel), i), value) in wanted.iter().zip(found) {
            if let Some((_, reader)) = readers[i] {
                reader.set(texel, value);
            }
        }
        self.count(start);
        Ok(())
    }

    fn count(&self, start: Instant) {
        let spent = start.elapsed().as_nanos() as u64;
        self.spent.fetch_add(spent, Ordering::Relaxed);
    }
}

/// Steps of a method's progress, told in parts of texels.
struct Steps<'a> {
    steps: usize,
    texels: usize,
    finished: AtomicUsize,
    control: &'a Control,
}

impl<'a> Steps<'a> {
    /// All steps at once where there is nothing to do.
    fn new(steps: usize, texels: usize, control: &'a Control) -> Self {
        if texels == 0 {
            control.advance(steps);
        }
        Steps {
            steps,
            texels,
            finished: AtomicUsize::new(0),
            control,
        }
    }

    fn advance(&self, texels: usize) {
        let part = |x: usize| (x as u128 * self.steps as u128 / self.texels as u128) as usize;
        let before = self.finished.fetch_add(texels, Ordering::Relaxed);
        self.control.advance(part(before + texels) - part(before));
    }
}

impl<P: Painter> Prepared for Pictures<P> {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let atlas = &self.atlas;
        let number = light as u32;
        let light = &atlas.lights[light];
        if receivers.faces.len() != receivers.len() {
            let reason = "it needs a camera: its textures belong to polygons, not to points".into();
            let method = atlas.layout.names[0];
            return Err(Error::Unsupported { method, reason });
        }
        let keys: Vec<Option<Key>> = (0..receivers.len())
            .into_par_iter()
            .map(|i| self.key(receivers, i, number))
            .collect();
        let wanted = keys.par_iter().flatten().copied().collect();
        let (first, all) = (receivers.group_count() / 2, receivers.group_count());
        let drawn = self.draw(wanted, first, control)?;
        let readers: HashMap<Key, Reader<'_>> = drawn
            .iter()
            .map(|(&key, d)| {
                let fitted = atlas.patches.list[key.patch as usize].fitted;
                let reader =
                    Reader::new(d, light, atlas.side(key), atlas.layout.interpolate, fitted);
                (key, reader)
            })
            .collect();
        let readers: Vec<Option<(Key, &Reader<'_>)>> = keys
            .into_par_iter()
            .map(|key| key.and_then(|k| Some((k, readers.get(&k)?))))
            .collect();
        self.find(receivers, &readers, number, all - first, control)?;
        let capped = self.painter.knows_only_occluders();
        let values: Vec<[f32; 2]> = (0..receivers.len())
            .into_par_iter()
            .map(|i| {
                let (p, n) = (receivers.positions[i], receivers.normals[i]);
                match readers[i].map(|(_, reader)| reader) {
                    Some(reader) if capped => {
                        let [seen, irradiance] = reader.at(p);
                        [seen.min(light.fraction_above(p, n) as f32), irradiance]
                    }
                    Some(reader) => reader.at(p),
                    // A sphere, or a sliver without a plane of its own: unshadowed.
                    None => unshadowed(light, p, n),
                }
            })
            .collect();
        let radiance = atlas.layout.radiance;
        Ok(Shading {
            visibility: values.iter().map(|v| v[0]).collect(),
            irradiance: radiance.then(|| Irradiance::Whole(values.iter().map(|v| v[1]).collect())),
            by_rays: 0,
        })
    }

    fn built_seconds(&self) -> Vec<(&'static str, f64)> {
        let nanoseconds = self.spent.load(Ordering::Relaxed);
        vec![("textures", nanoseconds as f64 * 1e-9)]
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
