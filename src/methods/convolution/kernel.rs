//! The light's image on a receiver, as weights of texels.
//!
//! A light that is not parallel to the receiver is projected into the plane through its centre that is, along
//! the line from its centre to the receiver's middle: seen from there it covers the same. A sphere counts as the
//! disk that faces the receiver's middle.

use glam::{DVec2, DVec3};

use crate::light::Light;
use crate::textures::occluders::Side;

/// Light points along a side of the grid that stands for the light, per texel of its image.
const POINTS: f64 = 1.0;

/// Fewest and most of them.
const POINTS_RANGE: (f64, f64) = (8.0, 512.0);

/// Least cosine between the receiver's normal and the direction to the light that the projection takes as it
/// is: below, the light's image would grow beyond all bounds, while it shines less and less.
const LEAST_COSINE: f64 = 0.25;

/// The light's image at scale 1, in parts of the receiver's edges: `a x + b y` for the light's points, `x` and
/// `y` from -1 to 1, or in the unit disk.
#[derive(Debug, Clone, Copy)]
pub struct Spread {
    a: DVec2,
    b: DVec2,
    disk: bool,
}

impl Spread {
    /// The light's image on a receiver, for a light whose hard shadow is cast from `eye`.
    pub fn new(light: &Light, side: &Side, eye: DVec3) -> Self {
        let middle = side.bounds.at(0.5, 0.5);
        let along = (middle - eye).normalize_or_zero();
        let (a, b, disk) = light.half_axes(along);
        let dual = side.bounds.dual();
        let fall = side.normal.dot(along).min(-LEAST_COSINE);
        let place = |d: DVec3| {
            let flat = d - along * (side.normal.dot(d) / fall);
            let place = DVec2::new(dual[0].dot(flat), dual[1].dot(flat));
            // Not finite only where the eye is in the receiver's plane.
            if place.is_finite() {
                place
            } else {
                DVec2::ZERO
            }
        };
        Spread {
            a: place(a),
            b: place(b),
            disk,
        }
    }

    /// Half of the image's extent along both edges.
    pub fn half(&self) -> DVec2 {
        if self.disk {
            let along = |k: usize| self.a[k].hypot(self.b[k]);
            DVec2::new(along(0), along(1))
        } else {
            self.a.abs() + self.b.abs()
        }
    }

    /// The vectors `a` and `b`.
    pub fn axes(&self) -> [DVec2; 2] {
        [self.a, self.b]
    }

    /// Whether the image is a disk between its vectors, and not their parallelogram.
    pub fn is_disk(&self) -> bool {
        self.disk
    }

    /// The image at a scale as weights that sum to 1: offsets in texels of the given size, and weights, those of
    /// one texel several times. The image is turned about the centre, as through a pinhole.
    pub fn weights(&self, scale: f64, texel: DVec2, mut add: impl FnMut([i32; 2], f32)) {
        let half = self.half() * scale / texel;
        let n = (POINTS * 2.0 * half.max_element())
            .ceil()
            .clamp(POINTS_RANGE.0, POINTS_RANGE.1) as usize;
        let at = |i: usize| (2.0 * i as f64 + 1.0) / n as f64 - 1.0;
        let inside = |x: f64, y: f64| !self.disk || x * x + y * y <= 1.0;
        let grid = || (0..n * n).map(|i| (at(i % n), at(i / n)));
        let count = grid().filter(|&(x, y)| inside(x, y)).count().max(1);
        let weight = 1.0 / count as f64;
        for (x, y) in grid().filter(|&(x, y)| inside(x, y)) {
            // Between four texels.
            let p = (self.a * x + self.b * y) * -scale / texel;
            let first = p.floor();
            let part = p - first;
            let [i, j] = [first.x as i32, first.y as i32];
            for (di, dj) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let share = |d: i32, t: f64| if d == 1 { t } else { 1.0 - t };
                let w = weight * share(di, part.x) * share(dj, part.y);
                if w > 0.0 {
                    add([i + di, j + dj], w as f32);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::textures::patches::Parallelogram;

    fn spread(light: &Light) -> Spread {
        let bounds = Parallelogram {
            corner: DVec3::new(-1.0, -0.5, 0.0),
            edges: [DVec3::X * 2.0, DVec3::Y],
        };
        let side = Side {
            bounds,
            normal: DVec3::Z,
        };
        Spread::new(light, &side, light.center())
    }

    #[test]
    fn weights_sum_to_one_and_lie_in_the_image() {
        let lights = [
            Light::rect(DVec3::Z, DVec3::Y * 0.2, DVec3::X * 0.4, [1.0; 3]).unwrap(),
            Light::disk(DVec3::Z, DVec3::NEG_Z, 0.2, [1.0; 3]).unwrap(),
            Light::sphere(DVec3::Z, 0.2, [1.0; 3]).unwrap(),
        ];
        for light in &lights {
            let spread = spread(light);
            let half = spread.half();
            // In parts of edges of 2 and 1.
            let rect = !light.half_axes(DVec3::Z).2;
            let expected = if rect {
                DVec2::new(0.1, 0.1)
            } else {
                DVec2::new(0.1, 0.2)
            };
            assert!(
                (half - expected).abs().max_element() < 1e-12,
                "{light:?} {half}"
            );
            for scale in [0.0, 0.01, 1.0] {
                let (mut sum, mut mean) = (0.0, DVec2::ZERO);
                let texel = DVec2::new(0.01, 0.01);
                spread.weights(scale, texel, |[i, j], w| {
                    let p = DVec2::new(f64::from(i), f64::from(j)) * texel;
                    assert!((p.abs().cmple(half * scale + texel)).all());
                    sum += f64::from(w);
                    mean += p * f64::from(w);
                });
                assert!((sum - 1.0).abs() < 1e-4, "{sum}");
                assert!(mean.abs().max_element() < 1e-5, "{mean}");
            }
        }
    }
}
