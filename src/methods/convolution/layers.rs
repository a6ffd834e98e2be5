//! The hard shadow from the light's centre with the depths of what casts it, its parts, and what they hide.
//!
//! A texel's occluders lie between the parts `w` and `w'` of the way from the light to the receiver; as the light's
//! image is scaled by `1/w - 1` ([`super::kernel`]), the mean of both scales counts. At a silhouette they are
//! the same.
//!
//! Before a straight edge a light's image that is scaled by `t` instead of `s > t` puts visibility off by up to
//! `(1 - t/s) / 2`: at the end of the narrower penumbra. So a part whose scales run from `t` to `s` is halved
//! while that is more than the error that may be, and wide enough for a texel to show. Halves are taken in the
//! logarithm of the scale: the error depends on the scales' ratio.

use glam::{DMat2, DVec2};
use rayon::prelude::*;

use super::fourier::Transform;
use super::kernel::Spread;
use crate::control::Control;
use crate::error::Result;
use crate::raster::{SPAN, Sink, Tile, rasterize_projected};
use crate::textures::occluders::{PatchOccluders, Side};
use crate::textures::patches::Parallelogram;
use crate::textures::transform::camera;

/// Below this many texels times weights, or four a texel of the window, a sum is as fast as a transform.
const DIRECT: usize = 1 << 14;

/// The part of a receiver's plane that shadows are drawn in.
#[derive(Debug, Clone, Copy)]
pub struct Window {
    /// Lower end of the window, as fractions of the receiver's two edges.
    pub low: DVec2,
    /// Upper end of the window.
    pub high: DVec2,
    /// Texels along both edges.
    pub size: [u32; 2],
    /// The hard shadow has so many finer texels along a side of each.
    pub fine: u32,
    /// Whether its rows are turned against the receiver's edges (`TURN`), around the same middle, and longer, so
    /// that it holds all that lies between both ends.
    pub turned: bool,
}

/// Cosine and sine of the angle that a window is turned by. An edge along a row of texels is known to half a texel;
/// along one that crosses rows at a slope far from all simple fractions (the golden ratio's square), its texels'
/// errors cancel.
const TURN: [f64; 2] = [0.934_172_358_962_715_7, 0.356_822_089_773_089_9];

impl Window {
    /// Size of a texel in parts of the receiver's edges, of a window that is not turned.
    fn texel(&self) -> DVec2 {
        (self.high - self.low) / DVec2::new(f64::from(self.size[0]), f64::from(self.size[1]))
    }

    /// The window's edges, in parts of the receiver's.
    fn edges(&self) -> DMat2 {
        let size = DMat2::from_diagonal(self.high - self.low);
        if !self.turned {
            return size;
        }
        let [cos, sin] = TURN.map(|x| x * (TURN[0] + TURN[1]));
        size * DMat2::from_cols_array(&[cos, sin, -sin, cos])
    }

    /// A vector on the receiver, in parts of its edges, in texels.
    pub fn in_texels(&self, d: DVec2) -> DVec2 {
        let [w, h] = self.size.map(f64::from);
        self.edges().inverse() * d * DVec2::new(w, h)
    }

    /// Place of the point `(u, v)` of the receiver in the window's picture, in texels from the first texel's centre.
    pub fn place(&self, u: f64, v: f64) -> DVec2 {
        let [w, h] = self.size.map(f64::from);
        let middle = 0.5 * (self.low + self.high);
        self.in_texels(DVec2::new(u, v) - middle) + 0.5 * DVec2::new(w, h) - 0.5
    }

    fn on(&self, bounds: &Parallelogram) -> Parallelogram {
        let edges = self.edges();
        let corner = 0.5 * (self.low + self.high) - 0.5 * (edges.x_axis + edges.y_axis);
        let [ex, ey] = bounds.edges;
        Parallelogram {
            corner: bounds.at(corner.x, corner.y),
            edges: [edges.x_axis, edges.y_axis].map(|d| ex * d.x + ey * d.y),
        }
    }
}

/// Nearest and farthest inverse depth of a tile's texels.
struct Depths {
    tile: Tile,
    range: Vec<[f64; 2]>,
}

impl Sink for Depths {
    fn span(&mut self, x: u32, y: u32, mask: u8, inverse_depth: &[f64; SPAN], _: u32) {
        let first = ((y - self.tile.y) * self.tile.width + (x - self.tile.x)) as usize;
        for i in (0..SPAN).filter(|i| mask >> i & 1 == 1) {
            let range = &mut self.range[first + i];
            *range = [
                range[0].min(inverse_depth[i]),
                range[1].max(inverse_depth[i]),
            ];
        }
    }
}

/// How wide the zone is, in parts of the scale between two ranges, in which both draw a part of an occluder: far
/// wider than rounding, far narrower than what shows.
const SHARED: f64 = 1.0 / 1024.0;

/// Scales of the occluders that one window draws.
///
/// Two windows find the scale of a point to within rounding only. A sheet that is parallel to the receiver has one
/// scale, and may have the one between two ranges: with a bound that is compared strictly, both windows or none
/// would draw it. So around the bound both draw a part of it, and the parts of all ranges sum to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Smallest scale of the range; the first range has none.
    pub low: Option<f64>,
    /// Largest scale of the range; the last has none and draws all larger scales.
    pub high: Option<f64>,
}

impl Range {
    /// The part of an occluder of this scale that is drawn, 0 to 1.
    pub fn share(&self, scale: f64) -> f64 {
        let beyond = |bound: f64| ((scale / bound - 1.0) / SHARED + 0.5).clamp(0.0, 1.0);
        self.low.map_or(1.0, beyond) - self.high.map_or(0.0, beyond)
    }

    /// No scale that is drawn is larger, if none at all is larger than `largest`.
    pub fn most(&self, largest: f64) -> f64 {
        let most = |high: f64| (high * (1.0 + 0.5 * SHARED)).min(largest);
        self.high.map_or(largest, most)
    }
}

/// The hard shadow in a window.
pub struct HardShadow {
    /// The fine texels in shadow, by their number in rows, with their scales; tile by tile.
    pub dark: Vec<(u32, f32)>,
    /// The scales that are drawn.
    pub range: Range,
    /// Fine texels along a side of a texel.
    fine: u32,
}

/// A part of the shadow: the parts of texels that are in it, and the scale that stands for theirs.
pub struct Layer {
    texels: Vec<(u32, f32)>,
    scale: f64,
}

/// Steps of the logarithm of the scale that parts are told apart by.
const STEPS: usize = 512;

/// The parts of a shadow.
pub struct Parts {
    /// The scale that stands for all of a part.
    pub scales: Vec<f64>,
    /// The part of each dark texel.
    pub of: Vec<u32>,
}

impl HardShadow {
    /// Draws what casts with a scale in a range; what has one above `largest`, which only rounding and what
    /// casts on no part of the receiver has, counts as that.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    pub fn new(
        occluders: &PatchOccluders,
        side: &Side,
        eye: glam::DVec3,
        window: &Window,
        range: Range,
        largest: f64,
        control: &Control,
    ) -> Result<Self> {
        let fine = window.fine;
        let [width, height] = window.size.map(|s| s * fine);
        let mut dark = Vec::new();
        let Some(view) = camera(eye, &window.on(&side.bounds), [width, height]) else {
            return Ok(HardShadow { dark, range, fine });
        };
        let points: Vec<_> = occluders.points.iter().map(|p| view.project(*p)).collect();
        let faces: Vec<[u32; 3]> = [&occluders.opaque, &occluders.closed]
            .into_iter()
            .flatten()
            .copied()
            .collect();
        let make = |tile: Tile| Depths {
            tile,
            range: vec![[f64::INFINITY, 0.0]; (tile.width * tile.height) as usize],
        };
        // Its steps are no steps of the method's.
        let silent = control.silent();
        let tiles = rasterize_projected(&points, &faces, |_| true, &view, &silent, make)?;
        for (tile, depths) in tiles {
            for (i, [near, far]) in depths.range.iter().enumerate() {
                if far < near {
                    continue;
                }
                let (x, y) = (i as u32 % tile.width, i as u32 / tile.width);
                let scale = |inverse: f64| (inverse - 1.0).clamp(0.0, largest);
                let mean = 0.5 * (scale(*near) + scale(*far));
                if range.share(mean) > 0.0 {
                    dark.push(((tile.y + y) * width + tile.x + x, mean as f32));
                }
            }
        }
        Ok(HardShadow { dark, range, fine })
    }

    /// Splits the shadow until no part is off by more than `error`, or by what a texel can show: the light's image at
    /// scale 1 reaches `half` texels.
    pub fn parts(&self, error: f64, half: f64) -> Parts {
        let shadow = || self.dark.iter().map(|&(_, scale)| scale);
        let largest = f64::from(shadow().fold(0.0, f32::max));
        // What spreads less than this is sharp in any case.
        let least = (0.25 / half.max(1e-12)).min(largest);
        let span = (largest / least).ln().max(1e-12);
        let step_of = |scale: f32| {
            let along = (f64::from(scale).max(least) / least).ln() / span;
            ((along * STEPS as f64) as usize).min(STEPS - 1)
        };
        let steps: Vec<usize> = shadow().map(step_of).collect();
        let mut count = [0usize; STEPS];
        let mut sum = [0.0f64; STEPS];
        for (&step, scale) in steps.iter().zip(shadow()) {
            count[step] += 1;
            sum[step] += f64::from(scale);
        }
        let mut of_step = [0u32; STEPS];
        let mut scales = Vec::new();
        let mut stack = vec![(0, STEPS)];
        while let Some((first, end)) = stack.pop() {
            let used = |i: &usize| count[*i] > 0;
            let (Some(low), Some(high)) = ((first..end).find(used), (first..end).rev().find(used))
            else {
                continue;
            };
            let scale_of = |step: usize| least * (span * step as f64 / STEPS as f64).exp();
            let (narrow, wide) = (scale_of(low), scale_of(high + 1));
            let off = 0.5 * (1.0 - narrow / wide);
            let seen = (wide - narrow) * half > 0.5;
            if off > error && seen && low < high {
                let middle = (low + high).div_ceil(2);
                stack.extend([(low, middle), (middle, high + 1)]);
                continue;
            }
            let total: usize = count[low..=high].iter().sum();
            of_step[low..=high].fill(scales.len() as u32);
            scales.push(sum[low..=high].iter().sum::<f64>() / total as f64);
        }
        let of = steps.into_iter().map(|step| of_step[step]).collect();
        Parts { scales, of }
    }

    /// The parts of the shadow as pictures.
    pub fn layers(&self, error: f64, spread: &Spread, window: &Window) -> Vec<Layer> {
        let half = (spread.half() / window.texel()).max_element();
        let parts = self.parts(error, half);
        let layer = |&scale: &f64| Layer {
            texels: Vec::new(),
            scale,
        };
        let mut layers: Vec<Layer> = parts.scales.iter().map(layer).collect();
        let fine = self.fine as usize;
        let [width, height] = window.size.map(|s| s as usize);
        // Which dark texel is where, in rows.
        let mut number = vec![u32::MAX; width * height * fine * fine];
        for (i, &(at, _)) in self.dark.iter().enumerate() {
            number[at as usize] = i as u32;
        }
        let part = 1.0 / (fine * fine) as f32;
        for y in 0..height {
            for x in 0..width {
                let texel = (y * width + x) as u32;
                for i in 0..fine * fine {
                    let (fx, fy) = (x * fine + i % fine, y * fine + i / fine);
                    let i = number[fy * width * fine + fx] as usize;
                    let Some(&(_, scale)) = self.dark.get(i) else {
                        continue;
                    };
                    let texels = &mut layers[parts.of[i] as usize].texels;
                    let part = part * self.range.share(f64::from(scale)) as f32;
                    match texels.last_mut() {
                        Some((last, sum)) if *last == texel => *sum += part,
                        _ => texels.push((texel, part)),
                    }
                }
            }
        }
        layers
    }
}

/// What is hidden of the light, texel by texel of a window.
pub struct Hidden {
    window: Window,
    stride: usize,
    values: Vec<f32>,
}

impl Hidden {
    /// The hidden part at a point of the receiver, interpolated.
    pub fn at(&self, u: f64, v: f64) -> f32 {
        let [w, h] = self.window.size;
        let last = DVec2::new(f64::from(w - 1), f64::from(h - 1));
        let p = self.window.place(u, v).clamp(DVec2::ZERO, last);
        let (x, y) = (p.x as usize, p.y as usize);
        let (x1, y1) = ((x + 1).min(w as usize - 1), (y + 1).min(h as usize - 1));
        let (fx, fy) = ((p.x - x as f64) as f32, (p.y - y as f64) as f32);
        let value = |x: usize, y: usize| self.values[y * self.stride + x];
        let row = |y: usize| value(x, y) * (1.0 - fx) + value(x1, y) * fx;
        row(y) * (1.0 - fy) + row(y1) * fy
    }
}

/// The texels of a window that lie around the centres of a texture's.
fn wanted(window: &Window, size: [u32; 2]) -> Vec<u32> {
    let [width, height] = window.size;
    let mut marked = vec![false; width as usize * height as usize];
    for y in 0..size[1] {
        for x in 0..size[0] {
            let [u, v] = [(x, 0), (y, 1)]
                .map(|(i, k): (u32, usize)| (f64::from(i) + 0.5) / f64::from(size[k]));
            let p = window.place(u, v).floor();
            for (i, j) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let at = |p: f64, size: u32| p.clamp(0.0, f64::from(size - 1)) as u32;
                marked[(at(p.y + j, height) * width + at(p.x + i, width)) as usize] = true;
            }
        }
    }
    let all = (0..width * height).filter(|&t| marked[t as usize]);
    all.collect()
}

/// Convolves a picture of all of a receiver, hidden parts of texels row by row, with the light's image at one
/// scale; what is beside it is lit.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub fn convolve(
    picture: &[f32],
    size: [u32; 2],
    spread: &Spread,
    scale: f64,
    control: &Control,
) -> Result<Vec<f32>> {
    let window = Window {
        low: DVec2::ZERO,
        high: DVec2::ONE,
        size,
        fine: 1,
        turned: false,
    };
    let texels = (0..).zip(picture).filter(|(_, part)| **part != 0.0);
    let layer = Layer {
        texels: texels.map(|(t, part)| (t, *part)).collect(),
        scale,
    };
    Ok(hidden(&[layer], spread, &window, size, control)?.values)
}

/// Convolves every part with the light's image and adds them up, where a texture of this size needs it.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub fn hidden(
    layers: &[Layer],
    spread: &Spread,
    window: &Window,
    size: [u32; 2],
    control: &Control,
) -> Result<Hidden> {
    let [width, height] = window.size.map(|s| s as usize);
    let texel = window.texel();
    let mut values = vec![0.0f32; width * height];
    let half = spread.half() / texel;
    let mut transformed = Vec::new();
    let wanted = wanted(window, size);
    for layer in layers {
        control.check()?;
        let reach = half * layer.scale;
        let weights = ((2.0 * reach.x + 3.0) * (2.0 * reach.y + 3.0)) as usize;
        if weights * wanted.len() > DIRECT.max(4 * width * height) {
            transformed.push(layer);
            continue;
        }
        let mut picture = vec![0.0f32; width * height];
        for &(t, part) in &layer.texels {
            picture[t as usize] = part;
        }
        let [rx, ry] = reach.to_array().map(|r| r.ceil() as i32 + 1);
        let across = (2 * rx + 1) as usize;
        let mut kernel = vec![0.0f32; across * (2 * ry + 1) as usize];
        spread.weights(layer.scale, texel, |[i, j], w| {
            kernel[(j + ry) as usize * across + (i + rx) as usize] += w;
        });
        for &at in &wanted {
            let (x, y) = ((at as usize % width) as i32, (at as usize / width) as i32);
            let (first, last) = ((x - width as i32 + 1).max(-rx), x.min(rx));
            for j in (y - height as i32 + 1).max(-ry)..=y.min(ry) {
                let row = (y - j) as usize * width;
                let weights = &kernel[(j + ry) as usize * across..];
                let hidden = (first..=last)
                    .map(|i| weights[(i + rx) as usize] * picture[row + (x - i) as usize]);
                values[at as usize] += hidden.sum::<f32>();
            }
        }
    }
    if let Some(largest) = transformed.iter().map(|l| l.scale).reduce(f64::max) {
        // What is convolved around the end comes back at the start: room for the widest image.
        let reach = half * largest;
        let transform = Transform::new(
            width + reach.x.ceil() as usize + 2,
            height + reach.y.ceil() as usize + 2,
        );
        let [w, h] = transform.size();
        let spectra: Vec<_> = transformed
            .par_iter()
            .map(|layer| {
                control.check()?;
                let mut picture = transform.picture();
                for &(t, part) in &layer.texels {
                    picture[t as usize / width * w + t as usize % width].re = part;
                }
                let mut kernel = transform.picture();
                spread.weights(layer.scale, texel, |[i, j], weight| {
                    let x = i.rem_euclid(w as i32) as usize;
                    let y = j.rem_euclid(h as i32) as usize;
                    kernel[y * w + x].re += weight;
                });
                let (a, b) = (transform.forward(picture), transform.forward(kernel));
                Ok(a.iter().zip(&b).map(|(a, b)| a * b).collect::<Vec<_>>())
            })
            .collect::<Result<_>>()?;
        let mut sum = transform.picture();
        for spectrum in &spectra {
            sum.iter_mut().zip(spectrum).for_each(|(s, v)| *s += v);
        }
        let picture = transform.inverse(sum);
        for (row, added) in values.chunks_mut(width).zip(picture.chunks(w)) {
            row.iter_mut().zip(added).for_each(|(v, a)| *v += a);
        }
    }
    Ok(Hidden {
        window: *window,
        stride: width,
        values,
    })
}
