//! The map from the pattern's points to light points and their weights, sixteen points at once.

use fearless_simd::{f32x16, prelude::*};
use glam::Vec3;

use super::shapes::{Cap, Flat};
use super::{LightSamples, Pattern};
use crate::simd::{LANES, Lanes, Row, dot, splat_vector};

/// Row `r` of the scrambled pattern, in [-1, 1]², or mapped onto the unit disk.
#[inline(always)]
pub(super) fn coordinates(
    pattern: &Pattern,
    r: usize,
    scramble: [u32; 2],
    disk: bool,
) -> (Row, Row) {
    let (mut x, mut y) = (Row::default(), Row::default());
    for lane in 0..LANES {
        x.0[lane] = centered(pattern.x[r][lane] ^ scramble[0]);
        y.0[lane] = centered(pattern.y[r][lane] ^ scramble[1]);
    }
    if disk {
        for lane in 0..LANES {
            (x.0[lane], y.0[lane]) = concentric(x.0[lane], y.0[lane]);
        }
    }
    (x, y)
}

/// `c + u x + v y`
#[inline(always)]
fn combine<S: Simd>(
    c: &[f32x16<S>; 3],
    u: &[f32x16<S>; 3],
    v: &[f32x16<S>; 3],
    x: f32x16<S>,
    y: f32x16<S>,
) -> [f32x16<S>; 3] {
    [
        c[0] + u[0] * x + v[0] * y,
        c[1] + u[1] * x + v[1] * y,
        c[2] + u[2] * x + v[2] * y,
    ]
}

/// Stores a row of samples; the weights of invalid ones are 0.
#[inline(always)]
fn put<S: Simd>(
    out: &mut LightSamples,
    r: usize,
    point: &[f32x16<S>; 3],
    weight: f32x16<S>,
    valid: u16,
) {
    for (axis, value) in out.points.iter_mut().zip(point) {
        axis[r].set(*value);
    }
    out.weights[r].set(weight);
    for (lane, weight) in out.weights[r].0.iter_mut().enumerate() {
        *weight = if valid >> lane & 1 == 1 { *weight } else { 0.0 };
    }
    out.valid[r] = valid;
}

#[inline(always)]
pub(super) fn fill_flat<S: Simd>(
    simd: S,
    flat: &Flat,
    pattern: &Pattern,
    scramble: [u32; 2],
    [p, n]: [Vec3; 2],
    out: &mut LightSamples,
) {
    let has_normal = n != Vec3::ZERO;
    let c = splat_vector(simd, flat.center.as_vec3());
    let u = splat_vector(simd, flat.u.as_vec3());
    let v = splat_vector(simd, flat.v.as_vec3());
    let m = splat_vector(simd, flat.normal.as_vec3());
    let p = splat_vector(simd, p);
    let n = splat_vector(simd, n);
    let zero = f32x16::splat(simd, 0.0);
    let scale = f32x16::splat(simd, (flat.area / pattern.len() as f64) as f32);
    for r in 0..out.valid.len() {
        let (mut x, mut y) = coordinates(pattern, r, scramble, flat.disk);
        if let Some(polygon) = &flat.polygon {
            polygon.strips().place(&mut x, &mut y);
        }
        (out.coordinates[0][r], out.coordinates[1][r]) = (x, y);
        let l = combine(&c, &u, &v, x.load(simd), y.load(simd));
        let d = [l[0] - p[0], l[1] - p[1], l[2] - p[2]];
        let facing = zero - dot(&m, &d);
        let squared = dot(&d, &d);
        let above = if has_normal {
            dot(&n, &d)
        } else {
            squared.sqrt()
        };
        // Light points are POINT_OFFSET off the light; the bound only guards a receiver in that gap.
        // Divided twice, since the fourth power overflows from 4e9 scene sizes on.
        let bound = squared.greater(1e-15);
        let weight = scale * (facing / bound) * (above / bound);
        put(out, r, &l, weight, zero.lt(facing) & zero.lt(above));
    }
}

#[allow(clippy::too_many_arguments, reason = "one call")]
#[inline(always)]
pub(super) fn fill_cap<S: Simd>(
    simd: S,
    cap: &Cap,
    pattern: &Pattern,
    scramble: [u32; 2],
    [p, n]: [Vec3; 2],
    offset: f32,
    out: &mut LightSamples,
) {
    let has_normal = n != Vec3::ZERO;
    let axis = splat_vector(simd, cap.axis.as_vec3());
    let e1 = splat_vector(simd, cap.e1.as_vec3());
    let e2 = splat_vector(simd, cap.e2.as_vec3());
    let p = splat_vector(simd, p);
    let n = splat_vector(simd, n);
    let (zero, one, two) = (
        f32x16::splat(simd, 0.0),
        f32x16::splat(simd, 1.0),
        f32x16::splat(simd, 2.0),
    );
    let height = f32x16::splat(simd, cap.height as f32);
    let distance = f32x16::splat(simd, cap.distance as f32);
    let squared_distance = distance * distance;
    let squared_radius = f32x16::splat(simd, cap.radius as f32 * cap.radius as f32);
    let share = (cap.weight / pattern.len() as f64) as f32;
    let cotangent = f32x16::splat(simd, (cap.cos / cap.sin.max(1e-30)) as f32);
    for r in 0..out.valid.len() {
        let (x, y) = coordinates(pattern, r, scramble, true);
        let (x, y) = (x.load(simd), y.load(simd));
        // Equal-area map of the disk onto the cap: 1 - cos θ = r² (1 - cos σ).
        let fall = (x * x + y * y) * height;
        let cos = one - fall;
        let stretch = (height * (two - fall)).sqrt();
        let along = [axis[0] * cos, axis[1] * cos, axis[2] * cos];
        let direction = combine(&along, &e1, &e2, x * stretch, y * stretch);
        let sin2 = fall * (two - fall);
        let reach = (squared_radius - squared_distance * sin2)
            .greater(zero)
            .sqrt();
        let t = if cap.distant {
            distance
        } else {
            distance * cos - reach - offset
        };
        let l = [
            p[0] + direction[0] * t,
            p[1] + direction[1] * t,
            p[2] + direction[2] * t,
        ];
        let above = if has_normal { dot(&n, &direction) } else { one };
        put(out, r, &l, share * above, zero.lt(above));
        // Onto the plane that touches the unit sphere at the axis, the cap's edge at 1.
        let gnomonic = stretch * cotangent / cos.greater(1e-9);
        out.coordinates[0][r].set(x * gnomonic);
        out.coordinates[1][r].set(y * gnomonic);
    }
}

/// A 32-bit fraction as a number in (-1, 1), symmetric about 0.
#[inline(always)]
fn centered(bits: u32) -> f32 {
    ((bits >> 9) as f32 + 0.5) * (1.0 / (1 << 22) as f32) - 1.0
}

/// Shirley and Chiu's concentric map of [-1, 1]² onto the unit disk, equal in area.
///
/// Sine and cosine by their series up to the 9th and 8th power: on [-π/4, π/4] the first term left
/// out is below 2e-9 and 3e-8, an `f32` ulp of the result.
#[inline(always)]
fn concentric(x: f32, y: f32) -> (f32, f32) {
    let wide = x.abs() > y.abs();
    let (r, s) = if wide { (x, y) } else { (y, x) };
    let t = std::f32::consts::FRAC_PI_4 * (s / r);
    let t2 = t * t;
    let sin =
        t * (1.0 + t2 * (-1.0 / 6.0 + t2 * (1.0 / 120.0 + t2 * (-1.0 / 5040.0 + t2 / 362_880.0))));
    let cos = 1.0 + t2 * (-0.5 + t2 * (1.0 / 24.0 + t2 * (-1.0 / 720.0 + t2 / 40320.0)));
    if wide {
        (r * cos, r * sin)
    } else {
        (r * sin, r * cos)
    }
}
