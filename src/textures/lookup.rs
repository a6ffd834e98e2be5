//! What a pixel sees of a texture.
//!
//! A pixel's receiver lies between four texels' centres, which are interpolated. Texels whose centre is not on
//! the polygon do not count, since what is there may be inside of a neighbouring body; where none of the four
//! is left, as in a sharp corner, the nearest one on the polygon does, and if it is narrower than a texel, all do. At the texture's border the nearest texels stand for
//! those beyond. Nor do texels count that a line separates from the pixel in which an occluder passes through the
//! polygon: under a body that stands on it all is dark, and stays there. So a shadow's edge is blurred by a
//! texel, but for the one at a body's foot.

use glam::{DVec2, DVec3};

use super::atlas::Atlas;
use super::occluders::Side;
use super::patches::Parallelogram;
use super::sparse::Sparse;
use super::texture::Texture;
use crate::camera::Camera;
use crate::light::Light;
use crate::raster::coverage::{Bitmap, Projected, cover};

/// How many texels away the nearest one on the polygon is looked for.
const FAR: u32 = 2;

/// Which texels have their centre on the polygon; nothing is kept where all have.
#[derive(Debug, Clone, Default)]
pub struct TexelMask(Option<Bitmap>);

impl TexelMask {
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
        // Centres on a triangle's own edge are on its neighbour's too, which may rise there.
        let inwards = if patch.faces.len() == 1 { 1e-3 } else { 0.0 };
        for &face in &patch.faces {
            let corners = atlas.geometry.corners(face).map(|p| p.as_dvec3());
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let points = corners.map(|p| {
                let d = p + (middle - p) * inwards - patch.bounds.corner;
                let (x, y) = (dx.dot(d) * f64::from(width), dy.dot(d) * f64::from(height));
                Projected::new(DVec3::new(x, y, 1.0), &view)
            });
            cover(&[0, 1, 2], &points, &view, |y, a, b| bitmap.set(y, a, b));
        }
        let mut full = Bitmap::default();
        full.reset(width, height);
        (0..height).for_each(|y| full.set(y, 0, width - 1));
        TexelMask((bitmap.words != full.words).then_some(bitmap))
    }

    /// Whether a texel's centre is on the polygon.
    #[inline(always)]
    pub fn holds(&self, x: u32, y: u32) -> bool {
        self.0.as_ref().is_none_or(|b| b.get(x, y))
    }

    /// Whether a single texel of few has its centre on the polygon, so that every point of it shows that one.
    pub fn has_one(&self) -> bool {
        let one = |b: &Bitmap| {
            let few =
                b.words.len() <= FAR as usize + 1 && b.words.iter().all(|w| w >> (FAR + 1) == 0);
            few && b.words.iter().map(|w| w.count_ones()).sum::<u32>() == 1
        };
        self.0.as_ref().is_some_and(one)
    }

    /// Bytes of the bits.
    pub fn bytes(&self) -> usize {
        self.0.as_ref().map_or(0, |b| 8 * b.words.len())
    }
}

/// Where occluders pass through a texture, by the cells between four texels' centres.
#[derive(Debug, Clone, Default)]
pub struct Contacts {
    /// The contacts' lines, in texels from the first texel's centre.
    lines: Vec<[DVec2; 2]>,
    /// A cell and a line that passes through it, in order.
    cells: Vec<(u32, u32)>,
    size: [u32; 2],
}

impl Contacts {
    /// Sorts lines in space into the cells of a texture on `bounds`.
    pub fn new(bounds: &Parallelogram, size: [u32; 2], lines: &[[DVec3; 2]]) -> Self {
        let dual = bounds.dual();
        let place = |p: DVec3| {
            let d = p - bounds.corner;
            let [x, y] = [0, 1].map(|k| dual[k].dot(d) * f64::from(size[k]) - 0.5);
            DVec2::new(x, y)
        };
        let mut out = Contacts {
            size,
            ..Contacts::default()
        };
        let (first, last) = (
            DVec2::splat(-0.5),
            DVec2::new(f64::from(size[0]), f64::from(size[1])),
        );
        for line in lines {
            let [a, b] = line.map(place);
            let (low, high) = (a.min(b), a.max(b));
            // Lines that are not numbers are left out too.
            if !(low.cmple(last).all() && high.cmpge(first).all()) {
                continue;
            }
            let id = out.lines.len() as u32;
            out.lines.push([a, b]);
            for y in cell(low.y, size[1])..=cell(high.y, size[1]) {
                // The outermost cells reach to the texture's border and beyond.
                let top = if y == 0 {
                    f64::NEG_INFINITY
                } else {
                    f64::from(y)
                };
                let end = y + 1 >= size[1].saturating_sub(1).max(1);
                let bottom = if end { f64::INFINITY } else { f64::from(y + 1) };
                let along = |row: f64| {
                    let t = ((row - a.y) / (b.y - a.y)).clamp(0.0, 1.0);
                    if t.is_nan() {
                        a.x
                    } else {
                        a.x + (b.x - a.x) * t
                    }
                };
                let (mut x0, mut x1) = (along(top), along(bottom));
                if a.y == b.y {
                    (x0, x1) = (a.x, b.x);
                }
                // A thousandth of a texel covers rounding.
                let (x0, x1) = (x0.min(x1) - 1e-3, x0.max(x1) + 1e-3);
                for x in cell(x0, size[0])..=cell(x1, size[0]) {
                    out.cells.push((y * size[0] + x, id));
                }
            }
        }
        out.cells.sort_unstable();
        out
    }

    /// The lines in the cell around a point.
    #[inline(always)]
    fn near(&self, q: DVec2) -> &[(u32, u32)] {
        if self.cells.is_empty() {
            return &[];
        }
        let cell = cell(q.y, self.size[1]) * self.size[0] + cell(q.x, self.size[0]);
        let first = self.cells.partition_point(|c| c.0 < cell);
        let count = self.cells[first..]
            .iter()
            .take_while(|c| c.0 == cell)
            .count();
        &self.cells[first..first + count]
    }

    /// Whether one of these lines passes between a point and a texel's centre.
    fn separate(&self, near: &[(u32, u32)], q: DVec2, texel: DVec2) -> bool {
        let side = |a: DVec2, b: DVec2, p: DVec2| (b - a).perp_dot(p - a);
        near.iter().any(|&(_, line)| {
            let [a, b] = self.lines[line as usize];
            let (s, t) = (side(a, b, q), side(a, b, texel));
            let (u, v) = (side(q, texel, a), side(q, texel, b));
            s * t < 0.0 && u * v <= 0.0
        })
    }

    /// Bytes of lines and cells.
    pub fn bytes(&self) -> usize {
        self.lines.len() * size_of::<[DVec2; 2]>() + self.cells.len() * 8
    }
}

/// The cell of a coordinate: between this texel's centre and the next one's.
#[inline(always)]
fn cell(x: f64, size: u32) -> u32 {
    (x.max(0.0) as u32).min(size.saturating_sub(2))
}

/// Where a texture's values are.
pub(super) enum Values {
    /// All texels are known.
    Whole(Texture),
    /// Those that were looked up are.
    Sparse(Sparse),
}

/// A texture, and what looking it up needs.
pub(super) struct Drawn {
    pub(super) values: Values,
    pub(super) mask: TexelMask,
    pub(super) contacts: Contacts,
}

impl Drawn {
    pub(super) fn bytes(&self) -> usize {
        let values = match &self.values {
            Values::Whole(texture) => texture.bytes(),
            Values::Sparse(texture) => texture.bytes(),
        };
        values + self.mask.bytes() + self.contacts.bytes()
    }

    fn size(&self) -> [u32; 2] {
        match &self.values {
            Values::Whole(texture) => texture.size,
            Values::Sparse(texture) => texture.size,
        }
    }
}

/// Texels with their weights, which sum to more than 0.
#[derive(Default)]
struct Weighted {
    texels: [([u32; 2], f32); 4],
    count: usize,
}

impl Weighted {
    fn push(&mut self, texel: [u32; 2], weight: f32) {
        self.texels[self.count] = (texel, weight);
        self.count += 1;
    }

    fn one(texel: [u32; 2]) -> Self {
        let mut out = Weighted::default();
        out.push(texel, 1.0);
        out
    }

    fn iter(&self) -> impl Iterator<Item = &([u32; 2], f32)> {
        self.texels[..self.count].iter()
    }
}

/// A texture with what it takes to look a point up.
pub struct Reader<'a> {
    drawn: &'a Drawn,
    light: &'a Light,
    side: Side,
    interpolate: bool,
    /// Whether there is no shadow outside of the texture.
    fitted: bool,
    dual: [DVec3; 2],
}

impl<'a> Reader<'a> {
    /// A reader of a texture that was drawn with `light` and `side`.
    pub(super) fn new(
        drawn: &'a Drawn,
        light: &'a Light,
        side: Side,
        interpolate: bool,
        fitted: bool,
    ) -> Self {
        Reader {
            fitted,
            drawn,
            light,
            side,
            interpolate,
            dual: side.bounds.dual(),
        }
    }

    /// Visibility and irradiance (0 unless the texture has it) at a point of the polygon.
    pub fn at(&self, p: DVec3) -> [f32; 2] {
        let Some(texels) = self.texels(p) else {
            let (light, n) = (self.light, self.side.normal);
            let irradiance = light.unshadowed_irradiance(p, n);
            return [light.fraction_above(p, n), irradiance].map(|x| x as f32);
        };
        let (mut sum, mut total) = ([0.0f32; 2], 0.0f32);
        for &(texel, weight) in texels.iter() {
            let value = self.texel(texel);
            sum = [sum[0] + weight * value[0], sum[1] + weight * value[1]];
            total += weight;
        }
        sum.map(|s| s / total)
    }

    /// Calls `each` for the texels that a point of the polygon shows and that are not known.
    pub(super) fn unknown(&self, p: DVec3, mut each: impl FnMut([u32; 2])) {
        let Values::Sparse(known) = &self.drawn.values else {
            return;
        };
        let texels = self.texels(p);
        for &(texel, _) in texels.iter().flat_map(Weighted::iter) {
            if known.get(texel).is_none() {
                each(texel);
            }
        }
    }

    /// Keeps what was found for a texel.
    pub(super) fn set(&self, texel: [u32; 2], value: [f32; 2]) {
        if let Values::Sparse(known) = &self.drawn.values {
            known.set(texel, value);
        }
    }

    /// The texels that a point of the polygon shows; none where it is lit.
    fn texels(&self, p: DVec3) -> Option<Weighted> {
        let d = p - self.side.bounds.corner;
        let size = self.drawn.size();
        let q = [0, 1].map(|k| {
            let t = self.dual[k].dot(d) * f64::from(size[k]) - 0.5;
            // Not a number only where the polygon has no area.
            if t.is_nan() { 0.0 } else { t }
        });
        let outside = |k: usize| q[k] < 0.0 || q[k] > f64::from(size[k] - 1);
        if self.fitted && (outside(0) || outside(1)) {
            return None;
        }
        let [u, v] = [0, 1].map(|k| q[k].clamp(0.0, f64::from(size[k] - 1)));
        if !self.interpolate {
            return Some(Weighted::one([(u + 0.5) as u32, (v + 0.5) as u32]));
        }
        let (x0, y0) = (u as u32, v as u32);
        let (x1, y1) = ((x0 + 1).min(size[0] - 1), (y0 + 1).min(size[1] - 1));
        let (fx, fy) = ((u - f64::from(x0)) as f32, (v - f64::from(y0)) as f32);
        let four = [
            ([x0, y0], (1.0 - fx) * (1.0 - fy)),
            ([x1, y0], fx * (1.0 - fy)),
            ([x0, y1], (1.0 - fx) * fy),
            ([x1, y1], fx * fy),
        ];
        let choose = |wanted: &dyn Fn(u32, u32) -> bool| {
            let mut out = Weighted::default();
            for ([x, y], weight) in four {
                if weight > 0.0 && wanted(x, y) {
                    out.push([x, y], weight);
                }
            }
            (out.count > 0).then_some(out)
        };
        let (mask, contacts) = (&self.drawn.mask, &self.drawn.contacts);
        let q = DVec2::from_array(q);
        let near = contacts.near(q);
        let joined = |x: u32, y: u32| {
            near.is_empty() || !contacts.separate(near, q, DVec2::new(f64::from(x), f64::from(y)))
        };
        choose(&|x, y| mask.holds(x, y) && joined(x, y))
            .or_else(|| self.nearest_on_polygon(q).map(Weighted::one))
            .or_else(|| choose(&joined))
            .or_else(|| choose(&|_, _| true))
    }

    /// The nearest texel on the polygon of those up to [`FAR`] away, as at a triangle's sharp corner.
    fn nearest_on_polygon(&self, q: DVec2) -> Option<[u32; 2]> {
        let around = |q: f64, size: u32| {
            let middle = q.round().clamp(0.0, f64::from(size - 1)) as u32;
            middle.saturating_sub(FAR)..=(middle + FAR).min(size - 1)
        };
        let size = self.drawn.size();
        let texels = around(q.y, size[1])
            .flat_map(|y| around(q.x, size[0]).map(move |x| (x, y)))
            .filter(|&(x, y)| self.drawn.mask.holds(x, y));
        let far = |&(x, y): &(u32, u32)| (DVec2::new(f64::from(x), f64::from(y)) - q).length();
        let nearest = texels.min_by(|a, b| far(a).total_cmp(&far(b)));
        nearest.map(|(x, y)| [x, y])
    }

    #[inline(always)]
    fn texel(&self, [x, y]: [u32; 2]) -> [f32; 2] {
        match &self.drawn.values {
            Values::Whole(texture) => {
                let (x, y) = (x as usize, y as usize);
                let irradiance = texture.irradiance(x, y, self.light, &self.side);
                [texture.visibility(x, y), irradiance.unwrap_or(0.0)]
            }
            // A picture finds what it looks up before.
            Values::Sparse(known) => known.get([x, y]).unwrap_or_default(),
        }
    }
}
