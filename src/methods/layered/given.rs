//! A map that a user gives as arrays, checked and made into what is traced.
//!
//! Depths are a texel's own, along the view's axis, in `f64`: the inverse of an inverse depth in `f32` and back is
//! the same `f32`. With the local frame and the slopes that a map of [`crate::maps::layers::construction`] came with, its arrays
//! become the same map to the last bit. Without slopes, pieces face the view; without a frame, one is put around
//! the light and the map.

use glam::DVec3;

use crate::camera::Camera;
use crate::control::Control;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::light::Light;
use crate::maps::layers::construction::check_memory;
use crate::maps::layers::map::{LayerMap, Level, Medium, Piece};
use crate::maps::layers::quadtree::add_levels;
use crate::maps::layers::views::LayerView;

/// Most layers of a texel, as of maps that are drawn.
pub const MOST_LAYERS: usize = 64;

/// Largest relative difference of a camera's focal lengths, and largest skew over them: tracing knows one
/// length, and a texel in 10⁹ is less than a bin of any map.
const ONE_FOCAL: f64 = 1e-9;

/// Largest slope, local: coarser levels double it up to fourteen times, and tracing multiplies it by what lies
/// across a map, all in `f32`.
const STEEPEST: f32 = 1e24;

/// How surfaces let light through, layer by layer as the depths.
#[derive(Debug, Clone, Default)]
pub struct Clear {
    /// Visibility of the texel's own ray behind a layer.
    pub visibility: Vec<f32>,
    /// Depth of the first surface that a layer stands for; its own if not given.
    pub first_depths: Option<Vec<f64>>,
    /// Surfaces that it stands for; one if not given.
    pub counts: Option<Vec<i64>>,
    /// Transmittance of each of them; if not given, what the visibilities and counts ask for.
    pub transmittance: Option<Vec<f32>>,
}

/// One map in world units: the layers of a texel next to each other, texels row by row.
#[derive(Debug, Clone)]
pub struct Given {
    /// What the map is called in errors.
    pub name: String,
    /// Its view, in world coordinates.
    pub camera: Camera,
    /// Layers of a texel.
    pub layers: usize,
    /// Depths, the nearest first; infinite where there is no layer.
    pub depths: Vec<f64>,
    /// Change of inverse depth from texel to texel, along a row and along a column; none if not given.
    pub slopes: Option<Vec<f64>>,
    /// What transparent surfaces let through; nothing if all is opaque.
    pub clear: Option<Clear>,
}

/// A frame around a light and what maps hold, in world coordinates.
pub fn frame_around<'a>(light: &Light, maps: impl Iterator<Item = &'a Given>) -> Frame {
    let center = light.center();
    let (low, high) = light.bounds();
    let reach = |map: &Given| {
        let depths = map.depths.iter().filter(|d| d.is_finite());
        (map.camera.eye - center).length() + depths.fold(0.0f64, |m, &d| m.max(d))
    };
    let far = maps.map(reach).fold(0.0, f64::max);
    let unit = far.max((high - low).max_element()).log2().ceil().exp2();
    let known = unit > 0.0 && unit.is_finite();
    Frame::new(center, if known { unit } else { 1.0 })
}

/// The frame that a user gives.
///
/// # Errors
/// An origin that is not finite, or a unit that is no power of two: scaling by it would round.
pub fn frame_of(origin: [f64; 3], unit: f64) -> Result<Frame> {
    let origin = DVec3::from(origin);
    let power = unit.is_normal() && unit > 0.0 && unit.log2().fract() == 0.0;
    if origin.is_finite() && power {
        return Ok(Frame::new(origin, unit));
    }
    let reason = format!("expected finite numbers and a power of two, got {origin} and {unit}");
    Err(Error::parameter("origin and unit", reason))
}

impl Given {
    /// Checks the arrays and makes a map of them; `threshold` is the visibility behind which it starts again.
    ///
    /// # Errors
    /// What is not as described above, a camera that the light is not in front of, or a map that does not fit into
    /// memory; or [`Error::Cancelled`].
    pub fn map(
        &self,
        light: &Light,
        frame: &Frame,
        threshold: f32,
        control: &Control,
    ) -> Result<LayerMap> {
        let view = self.view(light, frame)?;
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let (k, transparent) = (self.layers, self.clear.is_some());
        check_memory(&view, k, k, transparent)?;
        let mut level = Level::new(width, height, k, transparent);
        for texel in 0..width * height {
            control.check()?;
            let (at, child) = level.place(texel % width, texel / width, k);
            let mut behind = Behind {
                depth: 0.0,
                visibility: 1.0,
            };
            for layer in 0..k {
                let i = texel * k + layer;
                let wrong = |reason: String| {
                    let (row, column) = (texel / width, texel % width);
                    let place = format!("texel ({row}, {column}), layer {layer}: {reason}");
                    Err(Error::parameter(&self.name, place))
                };
                let piece = match self.piece(i, &behind, frame) {
                    Ok(piece) => piece,
                    Err(reason) => return wrong(reason),
                };
                level.blocks[at + layer].set(child, piece);
                if let Some(clear) = &self.clear {
                    match clear.medium(i, self.depths[i], &behind, threshold, frame) {
                        Ok(medium) => level.media[at + layer][child] = medium,
                        Err(reason) => return wrong(reason),
                    }
                    behind.visibility = clear.visibility[i];
                }
                behind.depth = self.depths[i];
            }
        }
        let mut map = LayerMap {
            view,
            layers: k,
            levels: vec![level],
        };
        add_levels(&mut map, control)?;
        Ok(map)
    }

    fn view(&self, light: &Light, frame: &Frame) -> Result<LayerView> {
        let camera = self.camera.to_local(frame);
        let bad = |reason: &str| Err(Error::parameter(&self.name, format!("camera: {reason}")));
        let k = &camera.intrinsics;
        let (focal, other) = (k.x_axis.x, k.y_axis.y);
        if (focal - other).abs() > ONE_FOCAL * focal || k.y_axis.x.abs() > ONE_FOCAL * focal {
            return bad("it must have one focal length and no skew");
        }
        let axis = camera.rotation.row(2);
        let reach = light.reach(axis);
        let nearest = axis.dot(light.center() - camera.eye) - reach;
        if nearest.is_nan() || nearest <= 0.0 {
            return bad(
                "all of the light must lie in front of it: draw the map from behind the light",
            );
        }
        Ok(LayerView {
            camera,
            focal,
            // Of drawing only.
            inverse_near: f64::INFINITY,
            faces: [].into(),
        })
    }

    /// The piece of layer `i`; none where it is infinitely far.
    fn piece(
        &self,
        i: usize,
        behind: &Behind,
        frame: &Frame,
    ) -> std::result::Result<Piece, String> {
        let depth = self.depths[i];
        if depth.is_nan() || depth < behind.depth {
            return Err(format!(
                "depths must not decrease from layer to layer, got {depth} behind {}",
                behind.depth
            ));
        }
        if depth == f64::INFINITY {
            return Ok(Piece::default());
        }
        let slope = self.slopes.as_ref().map_or([0.0; 2], |s| {
            [s[2 * i], s[2 * i + 1]].map(|s| (s * frame.unit) as f32)
        });
        // Not so for NaN.
        if !slope.iter().all(|s| s.abs() <= STEEPEST) {
            let (steepest, unit) = (STEEPEST, frame.unit);
            return Err(format!(
                "slopes must be finite and at most {steepest:e} over {unit:e}, got {slope:?}"
            ));
        }
        Ok(Piece::new(inverse(depth, frame)?, slope))
    }
}

/// The layer before one.
struct Behind {
    depth: f64,
    visibility: f32,
}

impl Clear {
    fn medium(
        &self,
        i: usize,
        depth: f64,
        behind: &Behind,
        threshold: f32,
        frame: &Frame,
    ) -> std::result::Result<Medium, String> {
        let count = self.counts.as_ref().map_or(1, |c| c[i]);
        if depth == f64::INFINITY {
            return Ok(Medium::NONE);
        }
        let Some(count) = u32::try_from(count).ok().filter(|c| *c > 0) else {
            return Err(format!("counts must be 1 to {}, got {count}", u32::MAX));
        };
        let visibility = self.visibility[i];
        if !(0.0..=1.0).contains(&visibility) {
            return Err(format!("visibility must be 0 to 1, got {visibility}"));
        }
        let first = self.first_depths.as_ref().map_or(depth, |f| f[i]);
        if !(behind.depth..=depth).contains(&first) {
            return Err(format!(
                "first_depths must be from the depth of the layer before to its own, {} to {depth}, got {first}",
                behind.depth
            ));
        }
        let before = if behind.visibility <= threshold {
            1.0
        } else {
            behind.visibility
        };
        if visibility > before {
            return Err(format!(
                "visibility must not increase but from {threshold} or less, got {visibility} behind {before}"
            ));
        }
        let through = match &self.transmittance {
            Some(t) if (0.0..=1.0).contains(&t[i]) => t[i],
            Some(t) => return Err(format!("transmittance must be 0 to 1, got {}", t[i])),
            None => (visibility / before).powf(1.0 / count as f32),
        };
        Ok(Medium {
            first: inverse(first, frame)?,
            visibility,
            through,
            count,
        })
    }
}

/// Local inverse depth.
fn inverse(depth: f64, frame: &Frame) -> std::result::Result<f32, String> {
    let inverse = (frame.unit / depth) as f32;
    if inverse.is_normal() {
        Ok(inverse)
    } else {
        let unit = frame.unit;
        Err(format!(
            "depths must be positive and within single precision of {unit:e}, got {depth:e}"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_depths_survive_the_way_to_a_depth_and_back() {
        let frame = Frame::new(DVec3::ZERO, 8.0);
        for i in 0..100_000u32 {
            let w = f32::from_bits(0x3f00_0000 + 977 * i);
            let depth = frame.unit / f64::from(w);
            assert_eq!(inverse(depth, &frame), Ok(w));
        }
    }
}
