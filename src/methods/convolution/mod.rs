//! Soft shadow textures by convolution (Soler and Sillion 1998, "Fast Calculation of Soft Shadow Textures Using
//! Convolution", as Akenine-Möller and Assarsson 2002 describe and compare with it).
//!
//! Where light, occluder and receiver lie in parallel planes, the shadow that the light's centre casts,
//! convolved with the light's image scaled by the distances, is the soft shadow. At the part `w` of the way
//! from the light's plane to the receiver's, an occluder projects a light point that is off the centre by `d`
//! to `-(1/w - 1) d` off the shadow from the centre ([`kernel`]).
//!
//! Receivers are the polygons of [`super::accumulation`]. A light that is not parallel to one is replaced by its
//! image in the parallel plane through its centre. Occluders at several depths are the error: the hard shadow
//! is split by the depth of what casts it, in halves, until the penumbrae within a part differ in width by
//! less than an error that was asked for; every part is convolved for its mean scale, and what the parts hide is
//! added ([`layers`]). With an error of 1 all of a receiver's occluders have one, average, depth.
//!
//! - [`layers`]: the hard shadow with depths, and its parts;
//! - [`kernel`]: the light's image as weights of texels;
//! - `gather`: what is hidden at single points, of polygons of few texels;
//! - [`fourier`]: convolution by the fast Fourier transform (rustfft's scalar code, the same bits everywhere).
//!
//! Assumptions and failures: only what the light's centre sees casts, so light that gets past behind an
//! occluder's silhouette, or under a large light, is missed; shadows of occluders that overlap as the centre sees
//! them are that of one of them, at the mean depth of the nearest and the farthest; penumbrae
//! that are wider than a receiver are drawn in coarser windows around it. Receivers much smaller than their
//! penumbrae are costly. Transparent occluders
//! and analytic spheres cannot be modelled.

pub mod fourier;
mod gather;
pub mod kernel;
pub mod layers;

use crate::scene::snapshot::Snapshot;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::casters::Casters;
use crate::control::Control;
use crate::error::{Error, Result};
use crate::light::Light;
use crate::method::{Method, Prepared};
use crate::textures::atlas::{Atlas, Key, Layout};
use crate::textures::lookup::Contacts;
use crate::textures::occluders::{Gatherer, PatchOccluders, Pyramid, Side};
use crate::textures::patches::Parallelogram;
use crate::textures::pictures::{Painter, Pictures};
use crate::textures::texture::Texture;
use crate::textures::traced::Wanted;
use gather::Gather;
use kernel::Spread;
use layers::{HardShadow, Range, Window};

/// Most texels along a side of the window around a receiver.
pub const MOST_WINDOW: u32 = 2048;

/// The hard shadow is drawn finer than the texture by this along each side, so that its edge is where it is and
/// not at a texel's border.
const FINE: u32 = 4;

/// Most texels along a side that it is drawn with.
const FINEST: u32 = 4096;

/// Fewest texels along a side of a window.
const SMALL_WINDOW: u32 = 64;

/// Up to so many texels, those of a texture that pictures look up are found one by one.
const FEW_TEXELS: u32 = 256;

/// Texels along a side of the blocks in which they are found: those of a block share what casts on them and its hard
/// shadow, and a texel has the same value whichever others are wanted.
const BLOCK: u32 = 4;

/// Texels along a side of the window around a block.
const BLOCK_WINDOW: u32 = 40;

/// How much wider than the texture its window may be, at the texture's resolution.
const WIDER: u32 = 4;

/// Texels of a window that the narrowest penumbra in it needs: beside what the parts' scales are off by, the error
/// of so many does not show.
const PENUMBRA: f64 = 64.0;

/// How much farther than the last one's the penumbrae of the next window reach.
const OCTAVE: f64 = 4.0;

/// Distance of a light, local units, from which on it is brought nearer: its direction differs by less than an `f32`'s
/// ulp across the scene, and depths, of which scales take the difference from 1, keep 24 binary digits.
const FAR: f64 = (1u64 << 28) as f64;

/// Largest scale of the light's image that is told apart: occluders nearer to the light than a thirtieth of
/// its distance, where a light's width away is thirty widths on the receiver.
pub const MOST_SCALE: f64 = 30.0;

/// Parameters of convolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Convolution {
    /// Largest error of visibility before a straight edge that parts of the shadow may have, 0 to 1.
    pub error: f64,
    /// How polygons become textures.
    pub layout: Layout,
}

impl Convolution {
    /// Checks the parameters.
    ///
    /// # Errors
    /// What is out of its range.
    pub fn checked(self) -> Result<Self> {
        if !(self.error > 0.0 && self.error <= 1.0) {
            let reason = format!("error must be above 0 and at most 1, got {}", self.error);
            return Err(Error::parameter("Convolution", reason));
        }
        self.layout.check()?;
        Ok(self)
    }
}

impl Method for Convolution {
    fn name(&self) -> &'static str {
        "convolution"
    }

    fn prepare(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        control.check()?;
        Casters::new(self.name(), geometry.clone(), self.layout.opaque)?;
        for light in lights {
            light.check_disk(self.name())?;
        }
        let atlas = Atlas::new(geometry, lights, self.layout, control)?.fitted();
        Ok(Box::new(Pictures::new(atlas, *self)))
    }
}

impl Painter for Convolution {
    fn paint(
        &self,
        atlas: &Atlas,
        key: Key,
        texture: &mut Texture,
        gatherer: &mut Gatherer,
        control: &Control,
    ) -> Result<Contacts> {
        let casting = Shadows::new(atlas, key, atlas.side(key), gatherer);
        let mut hidden = Vec::new();
        casting.each_range(|range, largest, eye, spread| {
            let window = window(&range, largest, spread, texture.size);
            let shadow = casting.hard(eye, &window, range, largest, control)?;
            let layers = shadow.layers(self.error, spread, &window);
            let size = texture.size;
            hidden.push(layers::hidden(&layers, spread, &window, size, control)?);
            Ok(())
        })?;
        for y in 0..texture.size[1] {
            for x in 0..texture.size[0] {
                let [u, v] = [(x, 0), (y, 1)]
                    .map(|(i, k): (u32, usize)| (f64::from(i) + 0.5) / f64::from(texture.size[k]));
                // None of a light below the receiver is seen.
                let hidden = match casting.eye {
                    Some(_) => hidden.iter().map(|h| h.at(u, v)).sum::<f32>(),
                    None => 1.0,
                };
                texture.set(x as usize, y as usize, (1.0 - hidden).clamp(0.0, 1.0));
            }
        }
        let contacts = &casting.occluders.contacts;
        Ok(Contacts::new(&casting.side.bounds, texture.size, contacts))
    }

    fn is_sparse(&self, atlas: &Atlas, key: Key, _: &mut Gatherer) -> bool {
        let [width, height] = atlas.size(key.patch);
        width * height <= FEW_TEXELS
    }

    fn find(
        &self,
        atlas: &Atlas,
        _light: u32,
        wanted: &[Wanted],
        control: &Control,
        done: &(dyn Fn(usize) + Sync),
    ) -> Result<Vec<[f32; 2]>> {
        let block = |i: usize| {
            let (key, texel) = wanted[i];
            (key, texel.map(|t| t / BLOCK))
        };
        let mut order: Vec<usize> = (0..wanted.len()).collect();
        order.par_sort_unstable_by_key(|&i| (block(i), i));
        let blocks: Vec<&[usize]> = order.chunk_by(|&i, &j| block(i) == block(j)).collect();
        let found: Vec<Vec<f32>> = blocks
            .par_iter()
            .with_max_len(16)
            .map_init(Gatherer::default, |gatherer, texels| {
                control.check()?;
                let (key, block) = block(texels[0]);
                let places = texels.iter().map(|&i| wanted[i].1);
                let found = self.texels(atlas, key, block, places, gatherer, control)?;
                done(texels.len());
                Ok(found)
            })
            .collect::<Result<_>>()?;
        let mut out = vec![[0.0; 2]; wanted.len()];
        for (&i, hidden) in order.iter().zip(found.into_iter().flatten()) {
            out[i][0] = (1.0 - hidden).clamp(0.0, 1.0);
        }
        Ok(out)
    }

    fn knows_only_occluders(&self) -> bool {
        true
    }
}

impl Convolution {
    /// What is hidden at the centres of some of a block's texels.
    fn texels(
        &self,
        atlas: &Atlas,
        key: Key,
        block: [u32; 2],
        texels: impl Iterator<Item = [u32; 2]>,
        gatherer: &mut Gatherer,
        control: &Control,
    ) -> Result<Vec<f32>> {
        // The block is a polygon of its own.
        let (all, whole) = (atlas.size(key.patch), atlas.side(key));
        let size = all.map(|s| s.min(BLOCK));
        let first = [0, 1].map(|k| block[k] * BLOCK);
        let [u, v] = [0, 1].map(|k| f64::from(first[k]) / f64::from(all[k]));
        let part = [0, 1].map(|k| f64::from(size[k]) / f64::from(all[k]));
        let [ex, ey] = whole.bounds.edges;
        let side = Side {
            bounds: Parallelogram {
                corner: whole.bounds.at(u, v),
                edges: [ex * part[0], ey * part[1]],
            },
            ..whole
        };
        let casting = Shadows::new(atlas, key, side, gatherer);
        let mut shadows = Vec::new();
        casting.each_range(|range, largest, eye, spread| {
            let window = block_window(&range, largest, spread, size);
            let shadow = casting.hard(eye, &window, range, largest, control)?;
            shadows.push(Gather::new(&shadow, self.error, spread, &window));
            Ok(())
        })?;
        let hidden = |texel: [u32; 2]| {
            let [u, v] =
                [0, 1].map(|k| (f64::from(texel[k] - first[k]) + 0.5) / f64::from(size[k]));
            match casting.eye {
                Some(_) => shadows.iter().map(|s| s.at(u, v)).sum::<f32>(),
                // None of a light below the receiver is seen.
                None => 1.0,
            }
        };
        Ok(texels.map(hidden).collect())
    }
}

/// What casts hard shadows on a polygon from the light's middle.
struct Shadows {
    light: Light,
    side: Side,
    occluders: PatchOccluders,
    eye: Option<DVec3>,
}

impl Shadows {
    fn new(atlas: &Atlas, key: Key, side: Side, gatherer: &mut Gatherer) -> Self {
        // What lies in a flat light's plane is behind it.
        let light = brought(&atlas.lights[key.light as usize].lifted());
        Shadows {
            eye: eye(&light, &side),
            light,
            side,
            occluders: atlas.occluders(key, &side, gatherer),
        }
    }

    /// Calls `each(range, largest, eye, spread)` for the ranges of scales that are drawn in windows of their own.
    fn each_range(
        &self,
        mut each: impl FnMut(Range, f64, DVec3, &Spread) -> Result<()>,
    ) -> Result<()> {
        let Some(eye) = self.eye.filter(|_| !self.occluders.points.is_empty()) else {
            return Ok(());
        };
        let spread = Spread::new(&self.light, &self.side, eye);
        let highest = Pyramid::new(&self.light, &self.side).highest(&self.occluders, &self.side);
        // None, where what was found is beside the pyramid after all.
        if highest <= 0.0 {
            return Ok(());
        }
        let full = self.side.normal.dot(eye - self.side.bounds.corner);
        let largest = largest_scale(highest, full);
        let ranges = octaves(largest, &spread);
        ranges
            .into_iter()
            .try_for_each(|range| each(range, largest, eye, &spread))
    }

    fn hard(
        &self,
        eye: DVec3,
        window: &Window,
        range: Range,
        largest: f64,
        control: &Control,
    ) -> Result<HardShadow> {
        HardShadow::new(
            &self.occluders,
            &self.side,
            eye,
            window,
            range,
            largest,
            control,
        )
    }
}

/// The hidden part as [`layers::convolve`] gives it, for the side of a parallelogram that a light's centre is on.
///
/// # Errors
/// A light's centre in the parallelogram's plane, or [`Error::Cancelled`].
pub fn convolve(
    picture: &[f32],
    size: [u32; 2],
    light: &Light,
    bounds: &Parallelogram,
    scale: f64,
    control: &Control,
) -> Result<Vec<f32>> {
    let up = bounds.cross().normalize();
    let height = up.dot(light.center() - bounds.corner);
    if height == 0.0 {
        let reason = "its centre lies in the parallelogram's plane".to_string();
        return Err(Error::parameter("light", reason));
    }
    let side = Side::new(bounds, up * height.signum());
    let spread = Spread::new(light, &side, light.center());
    layers::convolve(picture, size, &spread, scale, control)
}

/// A local light, no farther than [`FAR`], along the same line and under the same angle.
fn brought(light: &Light) -> Light {
    let scale = FAR / light.center().length();
    if scale < 1.0 {
        light.mapped(|p| p * scale, |x| x * scale)
    } else {
        light.clone()
    }
}

/// The point that hard shadows are cast from: the light's centre, or if that is not over the receiver, halfway
/// up to the light's highest point.
fn eye(light: &Light, side: &Side) -> Option<DVec3> {
    let center = light.center();
    let height = |p: DVec3| side.normal.dot(p - side.bounds.corner);
    if height(center) > 0.0 {
        return Some(center);
    }
    let highest = light.farthest(side.normal);
    let (low, high) = (height(center), height(highest));
    // Halfway between the plane and the highest point.
    (high > 0.0).then(|| center + (highest - center) * ((0.5 * high - low) / (high - low)))
}

/// The largest scale of occluders that are at most so high under an eye of height `full`.
fn largest_scale(highest: f64, full: f64) -> f64 {
    if highest < full {
        (highest / (full - highest)).min(MOST_SCALE)
    } else {
        MOST_SCALE
    }
}

/// Ranges of scales that are drawn in windows of their own: up to the one whose penumbrae reach half of the
/// receiver's size around it, and then [`OCTAVE`] times as far. So that what touches a small receiver is drawn
/// as fine as it is.
fn octaves(largest: f64, spread: &Spread) -> Vec<Range> {
    let half = spread.half().max_element();
    let mut out = Vec::new();
    let (mut low, mut bound) = (
        None,
        if half > 0.0 {
            0.5 / half
        } else {
            f64::INFINITY
        },
    );
    while bound < largest {
        let high = Some(bound);
        out.push(Range { low, high });
        (low, bound) = (high, OCTAVE * bound);
    }
    out.push(Range { low, high: None });
    out
}

/// How far the shadows of a range reach beyond a receiver.
fn margin(range: &Range, largest: f64, spread: &Spread, size: [u32; 2]) -> DVec2 {
    // A texel more for rounding.
    let texel = DVec2::new(1.0 / f64::from(size[0]), 1.0 / f64::from(size[1]));
    spread.half() * range.most(largest) + texel
}

/// The window around a block of texels that holds all shadows whose penumbrae reach it, drawn once and for all in
/// texels that [`gather`] adds up.
fn block_window(range: &Range, largest: f64, spread: &Spread, size: [u32; 2]) -> Window {
    let margin = margin(range, largest, spread, size);
    Window {
        low: -margin,
        high: DVec2::ONE + margin,
        size: [BLOCK_WINDOW; 2],
        fine: 1,
        turned: true,
    }
}

/// The window around a receiver that holds all shadows whose penumbrae reach it, of occluders with scales in a
/// range. Its texels are as fine as the texture's, or as the narrowest of the penumbrae needs.
fn window(range: &Range, largest: f64, spread: &Spread, size: [u32; 2]) -> Window {
    let margin = margin(range, largest, spread, size);
    let wanted = [0, 1].map(|k| {
        let narrowest = 2.0 * spread.half()[k] * range.low.unwrap_or(0.0);
        let texels = f64::from(size[k]).min(PENUMBRA / narrowest);
        texels * (1.0 + 2.0 * margin[k])
    });
    // A receiver of few texels is drawn finer than them, or what touches it would darken all of it.
    let [width, height] = [0, 1].map(|k| {
        let most = (WIDER * size[k]).clamp(SMALL_WINDOW, MOST_WINDOW);
        wanted[k]
            .ceil()
            .clamp(f64::from(SMALL_WINDOW), f64::from(most)) as u32
    });
    let coarser = (wanted[0] / f64::from(width)).max(wanted[1] / f64::from(height));
    Window {
        low: -margin,
        high: DVec2::ONE + margin,
        size: [width, height],
        fine: ((f64::from(FINE) * coarser).ceil() as u32)
            .min(FINEST / width.max(height))
            .clamp(1, FINE),
        turned: false,
    }
}
