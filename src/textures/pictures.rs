//! Pictures from textures: those of the polygons that a camera shows are painted at first sight and kept.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use super::atlas::{Atlas, Key};
use super::lookup::{Contacts, Drawn, Reader, TexelMask};
use super::occluders::Gatherer;
use super::texture::Texture;
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
        let mut textures: Vec<_> = missing
            .iter()
            .map(|&k| (k, self.atlas.texture(k)))
            .collect();
        textures.sort_by_key(|(k, t)| (std::cmp::Reverse(t.bytes()), *k));
        let total: usize = textures
            .iter()
            .map(|(_, t)| t.size[0] as usize * t.size[1] as usize)
            .sum();
        let finished = AtomicUsize::new(0);
        let progress = |texels: usize| {
            let part = |x: usize| (x as u128 * steps as u128 / total as u128) as usize;
            let before = finished.fetch_add(texels, Ordering::Relaxed);
            control.advance(part(before + texels) - part(before));
        };
        let paint = |key: Key, texture: &mut Texture, gatherer: &mut Gatherer| {
            self.painter
                .paint(&self.atlas, key, texture, gatherer, control)
        };
        let contacts = self.atlas.paint(&mut textures, paint, control, progress)?;
        if textures.is_empty() {
            control.advance(steps);
        }
        let drawn: Vec<_> = textures
            .into_par_iter()
            .zip(contacts)
            .map(|((key, texture), contacts)| {
                let mask = TexelMask::new(&self.atlas, key.patch);
                let drawn = Drawn {
                    texture,
                    mask,
                    contacts,
                };
                (key, Arc::new(drawn))
            })
            .collect();
        known.extend(drawn);
        let spent = start.elapsed().as_nanos() as u64;
        self.spent.fetch_add(spent, Ordering::Relaxed);
        Ok(keys.into_iter().map(|k| (k, known[&k].clone())).collect())
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
        let drawn = self.draw(wanted, receivers.group_count(), control)?;
        let readers: HashMap<Key, Reader<'_>> = drawn
            .iter()
            .map(|(&key, d)| {
                let fitted = atlas.patches.list[key.patch as usize].fitted;
                let reader =
                    Reader::new(d, light, atlas.side(key), atlas.layout.interpolate, fitted);
                (key, reader)
            })
            .collect();
        let capped = self.painter.knows_only_occluders();
        let values: Vec<[f32; 2]> = (0..receivers.len())
            .into_par_iter()
            .map(|i| {
                let (p, n) = (receivers.positions[i], receivers.normals[i]);
                match keys[i].and_then(|k| readers.get(&k)) {
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
