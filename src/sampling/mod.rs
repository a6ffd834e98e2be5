//! The one light sampler: a scrambled (0, 2)-sequence, mapped to each light's shape.
//!
//! The first `n` points of the Sobol sequence's first two dimensions, Owen-scrambled by a hash of the
//! seed (Laine and Karras 2011; Burley 2020), so that every power of two is stratified in all
//! elementary intervals and the first `n` of `2n` samples are the samples of `n`: refining keeps what
//! was done. A receiver's own pattern flips the digits of all points by two random words, which keeps
//! the stratification and makes every sample uniform.
//!
//! Nothing here depends on a light's place among others, so that it has the same bits alone and in company. A
//! receiver's errors under several lights are then not independent: those of the sum are at most the sum of
//! each light's (Minkowski), so as a part of the light never more than those of the worst light alone.
//!
//! Flat lights are sampled uniformly in area, spheres uniformly in the solid angle of the cap that
//! the receiver sees; a distant light is a cap that all receivers share. Disks and caps use Shirley and Chiu's concentric
//! map, polygons that of their strips (`light::polygon`); a polygon's [`LightProjection`] is that of the rectangle around it.
//!
//! Light points are moved off the light towards the receiver's side by [`POINT_OFFSET`] so that an
//! occluder that touches the light from behind does not hide it.
//!
//! - this file: [`Sampler`], a light with what all receivers share;
//! - `pattern`: the points of the unit square, [`Pattern`];
//! - `shapes`: the frame of a flat light, the cap of a sphere;
//! - `fill`: the map from points of the square to light points and weights, sixteen points at once;
//! - `samples`: the light points of one receiver, [`LightSamples`];
//! - `shared`: the light points of a region of receivers, [`SharedPoint`];
//! - [`square`]: where in space the square of a [`LightProjection`] lies;
//! - [`tracing`]: segments from receivers to light points against what casts;
//! - [`shaft`]: what lies between a group of receivers and the light;
//! - `cells`: the grid of cells over the light's outline, as in a [`LightProjection`].

mod cells;
mod fill;
mod pattern;
mod samples;
pub mod shaft;
mod shapes;
mod shared;
pub mod square;
pub mod tracing;

use std::f64::consts::PI;

use fearless_simd::dispatch;
use glam::{DVec3, Vec3};

use crate::frame::POINT_OFFSET;
use crate::light::{DiskLight, Light, PolygonLight, RectLight, Shape};
use crate::simd::{LANES, Row, detect};
pub use cells::{GRID, LightProjection, WHOLE, cell_place, grid_index};
use fill::{fill_cap, fill_flat};
pub use pattern::Pattern;
pub use samples::LightSamples;
use shapes::{Cap, Flat};
pub use shared::SharedPoint;

/// Most samples a receiver.
pub const MOST_SAMPLES: u32 = 1 << 16;

/// Below this cosine of its half-angle a sphere's cap is too wide for a grid in its tangent plane.
const WIDEST_CAP: f64 = 0.17;

/// A light in local coordinates with what all receivers share.
#[derive(Debug, Clone)]
pub struct Sampler {
    light: Light,
    pattern: Pattern,
    fixed: bool,
    /// Flat lights: centre, half edges (a disk: two radii; a polygon: those of the rectangle around it) moved off the
    /// light, emitting normal.
    flat: Option<Flat>,
}

impl Sampler {
    /// Samples `light`; `fixed`: the same points for all receivers.
    pub fn new(light: Light, pattern: Pattern, fixed: bool) -> Self {
        let center = light.center() + light.lift();
        let flat = light.normal().map(|normal| {
            let (u, v, disk) = light.half_axes(normal);
            let (area, polygon) = match &light.shape {
                Shape::Rect(RectLight { u, v, .. }) => (u.cross(*v).length(), None),
                Shape::Disk(DiskLight { radius, .. }) => (PI * radius * radius, None),
                Shape::Sphere(_) | Shape::Distant(_) => (0.0, None),
                Shape::Polygon(polygon) => (polygon.area(), Some(polygon.clone())),
            };
            let (center, u, v) = match &polygon {
                Some(polygon) => {
                    let (center, u, v) = polygon.around();
                    (center + light.lift(), u, v)
                }
                None => (center, u, v),
            };
            Flat {
                center,
                u,
                v,
                normal,
                area,
                disk,
                polygon,
            }
        });
        Sampler {
            light,
            pattern,
            fixed,
            flat,
        }
    }

    /// The light, in local coordinates.
    pub fn light(&self) -> &Light {
        &self.light
    }

    /// A light point that every receiver shares, or on a sphere the one nearest to `p`: for a receiver to
    /// which all of the light is one.
    pub fn middle(&self, p: DVec3) -> Vec3 {
        match (&self.flat, Cap::new(&self.light, p)) {
            (Some(flat), _) => flat.center.as_vec3(),
            (None, Some(cap)) => {
                let size = cap.distance + self.light.center().abs().max_element().max(1.0);
                (p + cap.axis * (cap.distance - cap.radius - POINT_OFFSET * size)).as_vec3()
            }
            (None, None) => self.light.center().as_vec3(),
        }
    }

    /// Whether the light fills the disk in its [`LightProjection`]'s square, and not the square or a polygon in it.
    pub fn is_disk(&self) -> bool {
        self.flat.as_ref().is_none_or(|flat| flat.disk)
    }

    /// The light, if it is a polygon in the square.
    pub fn polygon(&self) -> Option<&PolygonLight> {
        self.flat.as_ref()?.polygon.as_ref()
    }

    /// Samples a receiver.
    pub fn len(&self) -> usize {
        self.pattern.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.pattern.is_empty()
    }

    /// How the receiver at `p` sees the light, or `None` where no grid can be laid over it: behind a
    /// flat light, in or close to a sphere, or where the light has no size.
    pub fn view(&self, p: DVec3) -> Option<LightProjection> {
        let (low, high) = self.light.bounds();
        let mut reach = low.abs().max(high.abs()).max_element();
        let (u, v, w) = match &self.flat {
            Some(flat) => {
                let to_center = flat.center - p;
                let height = flat.normal.dot(to_center);
                if height >= 0.0 || flat.area == 0.0 {
                    return None;
                }
                let w = flat.normal / height;
                // Dual basis of the edges in the light's plane; coordinates -½ to ½ around the centre.
                let cross = flat.u.cross(flat.v);
                let scale = 0.5 / cross.length_squared();
                let (du, dv) = (flat.v.cross(cross) * scale, cross.cross(flat.u) * scale);
                let row = |d: DVec3| d + w * (0.5 - d.dot(to_center));
                (row(du), row(dv), w)
            }
            None => {
                let cap = Cap::new(&self.light, p)?;
                // Points of a sphere are moved off it in proportion to the receiver's distance; from far away
                // by more than is looked at for triangles that touch the light.
                let size = self.light.center().abs().max_element().max(1.0);
                if cap.cos < WIDEST_CAP || cap.sin == 0.0 || cap.distance > 2.0 * size {
                    return None;
                }
                reach += cap.distance;
                let w = cap.axis / (cap.distance * (1.0 + cap.sin));
                let scale = 0.5 * cap.cos / (cap.sin * cap.distance * (1.0 + cap.sin));
                (cap.e1 * scale + 0.5 * w, cap.e2 * scale + 0.5 * w, w)
            }
        };
        Some(LightProjection {
            u: u.as_vec3(),
            v: v.as_vec3(),
            w: w.as_vec3(),
            reach: reach as f32,
        })
    }

    /// Fills `out` with the samples of receiver `index` at local `p` with unit normal `n` (zero: no
    /// tangent plane, and cosines of 1 in the weights).
    pub fn fill(&self, index: u32, p: DVec3, n: DVec3, out: &mut LightSamples) {
        out.resize(self.len());
        let scramble = if self.fixed {
            [0, 0]
        } else {
            self.pattern.scramble(index)
        };
        match (&self.flat, Cap::new(&self.light, p)) {
            (Some(flat), _) => {
                let (pattern, at) = (&self.pattern, [p.as_vec3(), n.as_vec3()]);
                dispatch!(detect(), simd => fill_flat(simd, flat, pattern, scramble, at, out));
            }
            (None, Some(cap)) => {
                let size = cap.distance + self.light.center().abs().max_element().max(1.0);
                let offset = (POINT_OFFSET * size) as f32;
                let (pattern, at, cap) = (&self.pattern, [p.as_vec3(), n.as_vec3()], &cap);
                dispatch!(detect(), simd => fill_cap(simd, cap, pattern, scramble, at, offset, out));
            }
            (None, None) => {
                // Inside a sphere: it emits outwards only.
                out.valid.fill(0);
                out.weights.fill(Row::default());
                for (axis, c) in out
                    .points
                    .iter_mut()
                    .zip(self.light.center().as_vec3().to_array())
                {
                    axis.fill(Row([c; LANES]));
                }
            }
        }
        let tail = out.count % LANES;
        if tail != 0 {
            let last = out.valid.len() - 1;
            out.valid[last] &= (1 << tail) - 1;
            for lane in tail..LANES {
                out.weights[last].0[lane] = 0.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Corners of a star, which is not convex.
    fn star(c: DVec3) -> Vec<DVec3> {
        let corner = |i: usize| {
            let (sin, cos) = (-TAU * i as f64 / 10.0).sin_cos();
            let r = [0.5, 0.2][i % 2];
            c + r * DVec3::new(cos, sin, 0.3 * cos)
        };
        (0..10).map(corner).collect()
    }

    #[test]
    fn weights_sum_to_the_unshadowed_irradiance_and_points_lie_on_the_light() {
        let c = DVec3::new(0.2, -0.3, 1.1);
        let lights = [
            Light::rect(
                c,
                DVec3::new(0.0, 0.6, 0.1),
                DVec3::new(0.7, 0.0, 0.0),
                [1.0; 3],
            )
            .unwrap(),
            Light::disk(c, DVec3::new(0.1, 0.2, -1.0), 0.4, [1.0; 3]).unwrap(),
            Light::sphere(c, 0.4, [1.0; 3]).unwrap(),
            Light::polygon(&star(c), [1.0; 3]).unwrap(),
            Light::distant(-c, 40.0, [1.0; 3]).unwrap(),
        ];
        let p = DVec3::new(-0.1, 0.2, 0.0);
        for light in lights {
            let sampler = Sampler::new(light.clone(), Pattern::new(4096, 1), false);
            let mut out = LightSamples::default();
            for n in [DVec3::Z, DVec3::new(0.98, 0.0, 0.2).normalize()] {
                sampler.fill(9, p, n, &mut out);
                let sum: f64 = out.weights.iter().flat_map(|r| r.0).map(f64::from).sum();
                let exact = light.unshadowed_irradiance(p, n);
                // 4096 stratified samples of a smooth integrand (one with a cut horizon): measured
                // 3e-5 and 4e-4 relative. The map to a polygon has kinks, and gaps between the tips of a star: 7e-4.
                let smooth = n == DVec3::Z && sampler.polygon().is_none();
                let tolerance = if smooth { 1e-4 } else { 2e-3 };
                assert!(
                    (sum - exact).abs() < tolerance * exact,
                    "{light:?}: {sum} {exact}"
                );
                let valid: u32 = out.valid.iter().map(|v| v.count_ones()).sum();
                let h = light.fraction_above(p, n);
                assert!(
                    (f64::from(valid) / 4096.0 - h).abs() < 2e-3,
                    "{light:?} {h} {valid}"
                );
            }
            let view = sampler.view(p).unwrap();
            out.find_cells();
            for i in 0..out.count {
                let q = out.point(i) - p.as_vec3();
                let (u, v) = (view.u.dot(q) / view.w.dot(q), view.v.dot(q) / view.w.dot(q));
                let side = GRID as f32;
                let (cx, cy) = ((u * side).floor(), (v * side).floor());
                let expected = (cy * side + cx) as i32;
                let got = i32::from(out.cells[i / LANES][i % LANES]);
                let near = |t: f32| (t * side - (t * side).round()).abs() < 1e-4;
                assert!(
                    expected == got || near(u) || near(v),
                    "{light:?} {i}: {u} {v}"
                );
                assert!((0.0..=1.0001).contains(&view.w.dot(q)));
            }
        }
    }
}
