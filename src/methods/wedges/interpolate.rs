//! The paper's interpolation inside a wedge (Akenine-Möller and Assarsson 2002, Section 4.2).
//!
//! With `F`, `B` a receiver's distances to the front and back plane and `L`, `R` those to the side planes,
//! all positive inside,
//!
//! ```text
//!     s_l = t_lb / (t_lf + t_lb),   s_r alike                                         (2)
//!     s   = t_r / (t_l + t_r) · s_l + t_l / (t_l + t_r) · s_r                          (3)
//! ```
//!
//! where `t_lf`, `t_lb` are measured along the direction of interpolation of the left side plane, `t_l`, `t_r`
//! parallel to the edge. All are distances to planes times reciprocals that are constant for a wedge, and with
//! the least common denominator there is one division. (1) is (2) with both directions equal.
//!
//! In terms of distances from the lit side, a view ray's contributions telescope (Section 5: what side planes
//! add cancels between neighbours, front planes stand for 1 and back planes for 0): the intensity is 1, less
//! the volumes behind front planes that a receiver is in, plus `s` for every wedge that it is in. A
//! receiver is in a wedge once where it is between the side planes, and minus once where it is beyond both in
//! the order in which they cross; so neighbours add up to one everywhere around a loop.

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::DVec3;

use super::planes;
use super::planes::Plane;
use super::sector::angle;
use crate::light::{Light, RectLight, Shape};
use crate::simd::{LANES, Lanes, Row, detect};

/// How `s` turns into intensity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PlaneFalloff {
    /// `s` itself.
    Linear,
    /// `3 s² - 2 s³` (Parker, Shirley and Smits 1998).
    Smooth,
    /// The area of the light that a line at the offset `s` cuts off.
    Line,
}

/// A wedge as the kernel wants it.
#[derive(Debug, Clone, Copy)]
pub struct PlaneWedge {
    /// Front, back and the two side planes: normals and offsets.
    planes: [[f64; 4]; 4],
    /// Reciprocals of (2) for left and right, front and back, and of (3) for left and right.
    front: [f32; 2],
    back: [f32; 2],
    along: [f32; 2],
    layers: [f32; 2],
    falloff: PlaneFalloff,
    /// The part of a rectangle's width that its shorter side makes up, for the `Line` falloff, seen along the edge, at
    /// most 1/2; negative for a disk.
    part: f32,
}

impl PlaneWedge {
    /// Prepares a wedge.
    pub fn new(wedge: &planes::Wedge, light: &Light, falloff: PlaneFalloff) -> Self {
        let row = |p: &Plane| {
            let [x, y, z] = p.normal.to_array();
            [x, y, z, p.offset]
        };
        // A direction in a plane has no distance to it: everything is as far, which a large number says.
        let reciprocal = |n: DVec3, d: DVec3| (1.0 / n.dot(d).abs().max(1e-9)) as f32;
        let both = |n: DVec3, d: [DVec3; 2]| d.map(|d| reciprocal(n, d));
        let shorter = |&RectLight { u, v, .. }: &RectLight| {
            let (a, b) = (u.dot(wedge.outside).abs(), v.dot(wedge.outside).abs());
            (a.min(b) / (a + b)) as f32
        };
        PlaneWedge {
            planes: [
                row(&wedge.front),
                row(&wedge.back),
                row(&wedge.sides[0]),
                row(&wedge.sides[1]),
            ],
            front: both(wedge.front.normal, wedge.across),
            back: both(wedge.back.normal, wedge.across),
            along: wedge.sides.map(|s| reciprocal(s.normal, wedge.direction)),
            layers: wedge.layers.map(|n| n as f32),
            falloff,
            part: match &light.shape {
                Shape::Rect(light) => shorter(light),
                Shape::Polygon(polygon) => shorter(&polygon.stand_in()),
                Shape::Disk(_) | Shape::Sphere(_) | Shape::Distant(_) => -1.0,
            },
        }
    }
}

/// Adds what the wedges `ids` give back to up to sixteen receivers: less cover of front and of back layers.
pub fn cover(
    wedges: &[PlaneWedge],
    ids: &[u32],
    receivers: &[DVec3],
    steps: f32,
    out: &mut [Row; 2],
) {
    let mut position = [[0.0; LANES]; 3];
    for lane in 0..LANES {
        let p = receivers[if lane < receivers.len() { lane } else { 0 }];
        for axis in 0..3 {
            position[axis][lane] = p[axis];
        }
    }
    let position = &position;
    dispatch!(detect(), simd => cover_lanes(simd, wedges, ids, position, steps, out));
}

#[inline(always)]
fn cover_lanes<S: Simd>(
    simd: S,
    wedges: &[PlaneWedge],
    ids: &[u32],
    position: &[[f64; LANES]; 3],
    steps: f32,
    out: &mut [Row; 2],
) {
    let zero = f32x16::splat(simd, 0.0);
    let mut front = out[0].load(simd);
    let mut back = out[1].load(simd);
    for &id in ids {
        let wedge = &wedges[id as usize];
        let f = distance(simd, &wedge.planes[0], position);
        let b = distance(simd, &wedge.planes[1], position);
        // The front plane's own side as its quad's crossing has it; `distance` keeps signs.
        let between = f.lt(zero) & zero.lt(b);
        if between == 0 {
            continue;
        }
        let l = distance(simd, &wedge.planes[2], position);
        let r = distance(simd, &wedge.planes[3], position);
        let (after_l, after_r) = (zero.le(l), zero.le(r));
        let inside = between & after_l & !after_r;
        let inverted = between & !after_l & after_r;
        if inside | inverted == 0 {
            continue;
        }
        let f = zero - f;
        let t_l = l * wedge.along[0];
        let t_r = (zero - r) * wedge.along[1];
        let (t_lf, t_lb) = (f * wedge.front[0], b * wedge.back[0]);
        let (t_rf, t_rb) = (f * wedge.front[1], b * wedge.back[1]);
        let (sum_l, sum_r) = (t_lf + t_lb, t_rf + t_rb);
        let top = t_r * t_lb * sum_r + t_l * t_rb * sum_l;
        let bottom = (t_l + t_r) * sum_l * sum_r;
        // On the edge itself all distances are zero, and neither lit nor dark is wrong.
        let whole = zero.lt(bottom.abs());
        let s = (top / bottom).where_bits(whole, 0.5);
        let s = s.greater(zero).lesser(1.0);
        let s = match wedge.falloff {
            PlaneFalloff::Linear => s,
            PlaneFalloff::Smooth => {
                let smooth = s * s * (3.0 - (s + s));
                smooth.lesser(1.0)
            }
            PlaneFalloff::Line if wedge.part < 0.0 => line_over_disk(s),
            PlaneFalloff::Line => line_over_rectangle(s, wedge.part),
        };
        let s = if steps > 0.0 {
            let magic = f32x16::splat(simd, 12_582_912.0);
            (s * steps + magic - magic) / steps
        } else {
            s
        };
        let signed = (zero - s).where_bits(inside, s.where_bits(inverted, zero));
        front += signed * wedge.layers[0];
        back += signed * wedge.layers[1];
    }
    out[0].set(front);
    out[1].set(back);
}

/// Signed distances to a plane, found in `f64`; those that are not zero do not become zero.
#[inline(always)]
fn distance<S: Simd>(simd: S, plane: &[f64; 4], position: &[[f64; LANES]; 3]) -> f32x16<S> {
    let [x, y, z] = position;
    let mut out = Row::default();
    for i in 0..LANES {
        let value = plane[0] * x[i] + plane[1] * y[i] + plane[2] * z[i] - plane[3];
        let rounded = value as f32;
        out.0[i] = if value < 0.0 {
            rounded.min(-f32::MIN_POSITIVE)
        } else {
            rounded
        };
    }
    out.load(simd)
}

/// Part of a disk on the far side of a line at `2 s - 1` of its radius.
#[inline(always)]
fn line_over_disk<S: Simd>(s: f32x16<S>) -> f32x16<S> {
    let x = s + s - 1.0;
    let y = (1.0 - x * x).greater(0.0).sqrt();
    let pi = std::f32::consts::PI;
    // The angle of the arc, less the triangle.
    let hidden = (angle::<S>(y, x) - x * y) * (1.0 / pi);
    let one = f32x16::splat(s.simd, 1.0);
    (one - hidden).greater(0.0).lesser(one)
}

/// Part of a rectangle on the far side of a line at `s` of its width, of which its shorter side makes up
/// `part`: the distribution of the sum of two uniform numbers.
#[inline(always)]
fn line_over_rectangle<S: Simd>(s: f32x16<S>, part: f32) -> f32x16<S> {
    let zero = f32x16::splat(s.simd, 0.0);
    let short = part.max(1e-6);
    let ramp = s.lesser(short);
    let end = (s - (1.0 - short)).greater(zero);
    let straight = (s - short).greater(zero);
    let quadratic = (ramp * ramp - end * end) * (0.5 / short);
    let part = (quadratic + straight) * (1.0 / (1.0 - short));
    part.greater(zero).lesser(1.0)
}
