//! What a pixel sees of a texture.
//!
//! A pixel's receiver lies between four texels' centres, which are interpolated. Texels whose centre is not on
//! the polygon do not count, since what is there may be inside of a neighbouring body; where none of the four
//! is on it (a polygon narrower than a texel) all do. At the texture's border the nearest texels stand for
//! those beyond. So a shadow's edge is blurred by a texel, and at the foot of a body that stands on a polygon
//! its texels under the body darken up to half a texel in front of it.

use glam::DVec3;

use super::occluders::Side;
use super::patches::Parallelogram;
use super::texture::Texture;
use super::{Accumulation, Atlas, Content};
use crate::camera::Camera;
use crate::light::Light;
use crate::raster::coverage::{Bitmap, Projected, cover};

/// Which texels have their centre on the polygon; nothing is kept where all have.
#[derive(Debug, Clone, Default)]
pub struct Mask(Option<Bitmap>);

impl Mask {
    /// Draws a patch into its own texture.
    pub fn new(atlas: &Atlas, patch: u32) -> Self {
        let size = atlas.size(patch);
        let patch = &atlas.patches.list[patch as usize];
        let [dx, dy] = patch.bounds.dual();
        let (width, height) = (size[0], size[1]);
        // A view in which nothing is nearer than anything else.
        let view = Camera {
            eye: DVec3::ZERO,
            rotation: glam::DMat3::IDENTITY,
            intrinsics: glam::DMat3::IDENTITY,
            width,
            height,
        };
        let mut bitmap = Bitmap::default();
        bitmap.reset(width, height);
        for &face in &patch.faces {
            let points = atlas.geometry.corners(face).map(|p| {
                let d = p.as_dvec3() - patch.bounds.corner;
                let (x, y) = (dx.dot(d) * f64::from(width), dy.dot(d) * f64::from(height));
                Projected::new(DVec3::new(x, y, 1.0), &view)
            });
            cover(&[0, 1, 2], &points, &view, |y, a, b| bitmap.set(y, a, b));
        }
        let mut full = Bitmap::default();
        full.reset(width, height);
        (0..height).for_each(|y| full.set(y, 0, width - 1));
        Mask((bitmap.words != full.words).then_some(bitmap))
    }

    /// Whether a texel's centre is on the polygon.
    #[inline(always)]
    pub fn holds(&self, x: u32, y: u32) -> bool {
        self.0.as_ref().is_none_or(|b| b.get(x, y))
    }

    /// Bytes of the bits.
    pub fn bytes(&self) -> usize {
        self.0.as_ref().map_or(0, |b| 8 * b.words.len())
    }
}

/// A texture with what it takes to look a point up.
pub struct Reader<'a> {
    texture: &'a Texture,
    mask: &'a Mask,
    light: &'a Light,
    side: Side,
    method: &'a Accumulation,
    dual: [DVec3; 2],
    bounds: Parallelogram,
}

impl<'a> Reader<'a> {
    /// A reader of a texture that was drawn with `light` and `side`.
    pub fn new(
        texture: &'a Texture,
        mask: &'a Mask,
        light: &'a Light,
        side: Side,
        method: &'a Accumulation,
    ) -> Self {
        Reader {
            texture,
            mask,
            light,
            side,
            method,
            dual: side.bounds.dual(),
            bounds: side.bounds,
        }
    }

    /// Visibility and irradiance (0 unless the texture has it) at a point of the polygon.
    pub fn at(&self, p: DVec3) -> [f32; 2] {
        let d = p - self.bounds.corner;
        let size = self.texture.size;
        let [u, v] = [0, 1].map(|k| {
            let texels = f64::from(size[k]);
            // Not a number only where the polygon has no area.
            let t = (self.dual[k].dot(d) * texels - 0.5).clamp(0.0, texels - 1.0);
            if t.is_nan() { 0.0 } else { t }
        });
        if !self.method.interpolate {
            return self.texel((u + 0.5) as u32, (v + 0.5) as u32);
        }
        let (x0, y0) = (u as u32, v as u32);
        let (x1, y1) = ((x0 + 1).min(size[0] - 1), (y0 + 1).min(size[1] - 1));
        let (fx, fy) = ((u - f64::from(x0)) as f32, (v - f64::from(y0)) as f32);
        let four = [
            (x0, y0, (1.0 - fx) * (1.0 - fy)),
            (x1, y0, fx * (1.0 - fy)),
            (x0, y1, (1.0 - fx) * fy),
            (x1, y1, fx * fy),
        ];
        let mean = |wanted: &dyn Fn(u32, u32) -> bool| {
            let (mut sum, mut total) = ([0.0f32; 2], 0.0f32);
            for (x, y, weight) in four {
                if weight > 0.0 && wanted(x, y) {
                    let texel = self.texel(x, y);
                    sum = [sum[0] + weight * texel[0], sum[1] + weight * texel[1]];
                    total += weight;
                }
            }
            (total > 0.0).then(|| sum.map(|s| s / total))
        };
        mean(&|x, y| self.mask.holds(x, y))
            .or_else(|| mean(&|_, _| true))
            .unwrap_or_default()
    }

    #[inline(always)]
    fn texel(&self, x: u32, y: u32) -> [f32; 2] {
        let (x, y) = (x as usize, y as usize);
        let visibility = self.texture.visibility(x, y);
        match self.method.content {
            Content::Radiance => {
                let irradiance = self.texture.irradiance(x, y, self.light, &self.side);
                [visibility, irradiance.unwrap_or(0.0)]
            }
            Content::Modulation => [visibility, 0.0],
            Content::EightBit => {
                let level = self.method.eight_bits(visibility);
                [self.method.from_eight_bits(level), 0.0]
            }
        }
    }
}
