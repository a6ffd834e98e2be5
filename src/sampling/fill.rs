//! From the pattern's points to light points and their weights, sixteen at a time.

use glam::Vec3;

use super::shapes::{Cap, Flat};
use super::{LightSamples, Pattern};
use crate::simd::{LANES, Lanes, Row};

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

#[inline(always)]
unsafe fn splat<S: Lanes>(v: Vec3) -> [S; 3] {
    // SAFETY: the caller enabled the features of `S`.
    unsafe { [S::splat(v.x), S::splat(v.y), S::splat(v.z)] }
}

#[inline(always)]
unsafe fn dot<S: Lanes>(a: &[S; 3], b: &[S; 3]) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe { a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2])) }
}

/// `c + u x + v y`
#[inline(always)]
unsafe fn combine<S: Lanes>(c: &[S; 3], u: &[S; 3], v: &[S; 3], x: S, y: S) -> [S; 3] {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        [
            c[0].add(u[0].mul(x)).add(v[0].mul(y)),
            c[1].add(u[1].mul(x)).add(v[1].mul(y)),
            c[2].add(u[2].mul(x)).add(v[2].mul(y)),
        ]
    }
}

/// Stores a row of samples; the weights of invalid ones are 0.
#[inline(always)]
unsafe fn put<S: Lanes>(out: &mut LightSamples, r: usize, point: &[S; 3], weight: S, valid: u16) {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        for (axis, value) in out.points.iter_mut().zip(point) {
            value.store(&mut axis[r]);
        }
        weight.store(&mut out.weights[r]);
    }
    for (lane, weight) in out.weights[r].0.iter_mut().enumerate() {
        *weight = if valid >> lane & 1 == 1 { *weight } else { 0.0 };
    }
    out.valid[r] = valid;
}

#[inline(always)]
pub(super) unsafe fn fill_flat<S: Lanes>(
    flat: &Flat,
    pattern: &Pattern,
    scramble: [u32; 2],
    p: Vec3,
    n: Vec3,
    out: &mut LightSamples,
) {
    let has_normal = n != Vec3::ZERO;
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let c = splat::<S>(flat.center.as_vec3());
        let u = splat::<S>(flat.u.as_vec3());
        let v = splat::<S>(flat.v.as_vec3());
        let m = splat::<S>(flat.normal.as_vec3());
        let p = splat::<S>(p);
        let n = splat::<S>(n);
        let zero = S::splat(0.0);
        let scale = S::splat((flat.area / pattern.len() as f64) as f32);
        for r in 0..out.valid.len() {
            let (x, y) = coordinates(pattern, r, scramble, flat.disk);
            (out.coordinates[0][r], out.coordinates[1][r]) = (x, y);
            let l = combine(&c, &u, &v, S::load(&x), S::load(&y));
            let d = [l[0].sub(p[0]), l[1].sub(p[1]), l[2].sub(p[2])];
            let facing = zero.sub(dot(&m, &d));
            let squared = dot(&d, &d);
            let above = if has_normal {
                dot(&n, &d)
            } else {
                squared.sqrt()
            };
            // Light points are POINT_OFFSET off the light; the bound only guards a receiver in that gap.
            // Divided twice, since the fourth power overflows from 4e9 scene sizes on.
            let bound = squared.max(S::splat(1e-15));
            let weight = scale.mul(facing.div(bound)).mul(above.div(bound));
            put(out, r, &l, weight, zero.lt(facing) & zero.lt(above));
        }
    }
}

#[inline(always)]
pub(super) unsafe fn fill_cap<S: Lanes>(
    cap: &Cap,
    pattern: &Pattern,
    scramble: [u32; 2],
    p: Vec3,
    n: Vec3,
    offset: f32,
    out: &mut LightSamples,
) {
    let has_normal = n != Vec3::ZERO;
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let axis = splat::<S>(cap.axis.as_vec3());
        let e1 = splat::<S>(cap.e1.as_vec3());
        let e2 = splat::<S>(cap.e2.as_vec3());
        let p = splat::<S>(p);
        let n = splat::<S>(n);
        let (zero, one, two) = (S::splat(0.0), S::splat(1.0), S::splat(2.0));
        let height = S::splat(cap.height as f32);
        let distance = S::splat(cap.distance as f32);
        let squared_distance = distance.mul(distance);
        let squared_radius = S::splat(cap.radius as f32 * cap.radius as f32);
        let solid_angle = (std::f64::consts::TAU * cap.height / pattern.len() as f64) as f32;
        let cotangent = S::splat((cap.cos / cap.sin.max(1e-30)) as f32);
        for r in 0..out.valid.len() {
            let (x, y) = coordinates(pattern, r, scramble, true);
            let (x, y) = (S::load(&x), S::load(&y));
            // Equal-area map of the disk onto the cap: 1 - cos θ = r² (1 - cos σ).
            let fall = x.mul(x).add(y.mul(y)).mul(height);
            let cos = one.sub(fall);
            let stretch = height.mul(two.sub(fall)).sqrt();
            let along = [axis[0].mul(cos), axis[1].mul(cos), axis[2].mul(cos)];
            let direction = combine(&along, &e1, &e2, x.mul(stretch), y.mul(stretch));
            let sin2 = fall.mul(two.sub(fall));
            let reach = squared_radius
                .sub(squared_distance.mul(sin2))
                .max(zero)
                .sqrt();
            let t = distance.mul(cos).sub(reach).sub(S::splat(offset));
            let l = [
                p[0].add(direction[0].mul(t)),
                p[1].add(direction[1].mul(t)),
                p[2].add(direction[2].mul(t)),
            ];
            let above = if has_normal { dot(&n, &direction) } else { one };
            put(out, r, &l, S::splat(solid_angle).mul(above), zero.lt(above));
            // Onto the plane that touches the unit sphere at the axis, the cap's edge at 1.
            let gnomonic = stretch.mul(cotangent).div(cos.max(S::splat(1e-9)));
            x.mul(gnomonic).store(&mut out.coordinates[0][r]);
            y.mul(gnomonic).store(&mut out.coordinates[1][r]);
        }
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
