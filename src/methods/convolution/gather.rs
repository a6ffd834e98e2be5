//! What is hidden of the light at single points, without a picture of what is around them.
//!
//! Of a small polygon a picture shows a texel or two. To convolve a window around it for them takes the light's
//! image as weights, part by part; here a point adds up the shadow's fine texels that the light's image covers,
//! each by the part of it that is inside, in closed form.

use glam::DVec2;

use super::kernel::Spread;
use super::layers::{HardShadow, Window};

/// Least half extent of the light's image across each axis, in fine texels: half a texel is what a point shows.
const LEAST: f64 = 0.5;

/// Up to this half extent, in fine texels, the weights of all texels are added up and divided by: of larger images
/// they sum to 1 to a hundredth.
const SMALL: f64 = 3.0;

/// How much less than a texel parts may show.
const FINER: f64 = 4.0;

/// The light's image at the scale of one part.
#[derive(Debug, Clone, Copy)]
struct Image {
    /// Rows of the map from texels to the light's coordinates, -1 to 1 or in the unit disk.
    rows: [[f32; 2]; 2],
    /// Extent of a texel along both of these, the sum of both for a disk's radius.
    texel: [f32; 2],
    /// A texel's part of the image.
    weight: f32,
    disk: bool,
    /// Half extent in texels, of an image that is small.
    small: Option<i32>,
}

/// A dark fine texel.
struct Dark {
    at: [f32; 2],
    image: u32,
    share: f32,
}

/// A hard shadow, ready to be asked what it hides.
pub(super) struct Gather {
    window: Window,
    dark: Vec<Dark>,
    images: Vec<Image>,
}

impl Gather {
    /// Splits a shadow, whose window has no finer texels than its own, until no part is off by more than `error`.
    pub(super) fn new(shadow: &HardShadow, error: f64, spread: &Spread, window: &Window) -> Self {
        let axes = spread.axes().map(|d| window.in_texels(d));
        let half = axes[0].abs() + axes[1].abs();
        // Parts cost next to nothing here, so they may show less than a texel.
        let parts = shadow.parts(error, FINER * half.max_element());
        let image = |&scale: &f64| Image::new(axes.map(|d| d * scale), spread.is_disk());
        let width = window.size[0];
        let dark = |(&(at, scale), &part): (&(u32, f32), &u32)| Dark {
            at: [at % width, at / width].map(|x| x as f32),
            image: part,
            share: shadow.range.share(f64::from(scale)) as f32,
        };
        Gather {
            window: *window,
            dark: shadow.dark.iter().zip(&parts.of).map(dark).collect(),
            images: parts.scales.iter().map(image).collect(),
        }
    }

    /// The hidden part at a point of the receiver.
    pub(super) fn at(&self, u: f64, v: f64) -> f32 {
        let place = self.window.place(u, v).as_vec2();
        let mut hidden = vec![0.0f32; self.images.len()];
        for dark in &self.dark {
            let d = [dark.at[0] - place.x, dark.at[1] - place.y];
            let part = self.images[dark.image as usize].covers(d);
            hidden[dark.image as usize] += dark.share * part;
        }
        let sums = hidden.iter().zip(&self.images);
        sums.map(|(sum, image)| sum / image.total(place.fract()))
            .sum()
    }
}

impl Image {
    /// The image between its vectors, in texels.
    fn new(axes: [DVec2; 2], disk: bool) -> Self {
        let [a, b] = thick(axes);
        let det = a.perp_dot(b);
        let rows = [DVec2::new(b.y, -b.x) / det, DVec2::new(-a.y, a.x) / det];
        let texel = rows.map(|r| r.x.abs() + r.y.abs());
        let (area, half) = if disk {
            (
                std::f64::consts::PI,
                a.abs().max(b.abs()) * std::f64::consts::SQRT_2,
            )
        } else {
            (4.0, a.abs() + b.abs())
        };
        let half = half.max_element();
        Image {
            rows: rows.map(|r| r.as_vec2().to_array()),
            texel: texel.map(|t| t as f32),
            weight: (1.0 / (area * det.abs())) as f32,
            disk,
            small: (half <= SMALL).then(|| half.ceil() as i32 + 1),
        }
    }

    /// The part of the image that a texel at a distance covers.
    #[inline(always)]
    fn covers(&self, d: [f32; 2]) -> f32 {
        let [x, y] = self.rows.map(|[a, b]| (a * d[0] + b * d[1]).abs());
        let [w, h] = self.texel;
        if self.disk {
            let r = (x * x + y * y).sqrt();
            // A texel's extent along the radius.
            let w = if r > 0.0 { (x * w + y * h) / r } else { w };
            self.weight * inside(r, w)
        } else {
            self.weight * inside(x, w) * inside(y, h)
        }
    }

    /// What the parts of all texels around a point sum to.
    fn total(&self, part: glam::Vec2) -> f32 {
        let Some(reach) = self.small else {
            return 1.0;
        };
        let mut total = 0.0;
        for j in -reach..=reach {
            for i in -reach..=reach {
                total += self.covers([i as f32 - part.x, j as f32 - part.y]);
            }
        }
        if total > 0.0 { total } else { 1.0 }
    }
}

/// The part of an interval of length `w` around `x` that is within [-1, 1].
#[inline(always)]
fn inside(x: f32, w: f32) -> f32 {
    let (low, high) = (x - 0.5 * w, x + 0.5 * w);
    let low = if low > -1.0 { low } else { -1.0 };
    let high = if high < 1.0 { high } else { 1.0 };
    let both = high - low;
    if both > 0.0 { both / w } else { 0.0 }
}

/// The image's vectors, so long and so far apart that it is nowhere thinner than twice [`LEAST`].
fn thick([a, b]: [DVec2; 2]) -> [DVec2; 2] {
    let (long, short) = if a.length() >= b.length() {
        (a, b)
    } else {
        (b, a)
    };
    let long = if long.length() >= LEAST {
        long
    } else {
        DVec2::X * LEAST
    };
    let across = long.perp().normalize();
    let off = across.dot(short);
    if off.abs() >= LEAST {
        return [long, short];
    }
    // As long as both are, where one is along the other.
    let along = long.normalize();
    [
        along * (long.length() + along.dot(short).abs()),
        across * LEAST,
    ]
}
