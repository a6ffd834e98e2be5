//! Lambert's contour formula for straight edges, without branches.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, SQRT_2};

use glam::DVec3;

/// Half the angle that two directions span, over the sine of that angle, times their cross product:
/// a contour edge's share in Lambert's formula.
#[inline(always)]
pub(crate) fn edge(a: DVec3, b: DVec3) -> DVec3 {
    let cross = a.cross(b);
    let sin = cross.length();
    let share = 0.5 * angle(sin, a.dot(b)) / sin;
    cross * if sin == 0.0 { 0.0 } else { share }
}

/// Irradiance from a polygon of radiance 1 above the tangent plane of `n`, its corners as seen from the
/// receiver.
#[inline(always)]
pub(crate) fn polygon(corners: &[DVec3], n: DVec3) -> f64 {
    let mut sum = DVec3::ZERO;
    for (i, &corner) in corners.iter().enumerate() {
        let next = if i + 1 < corners.len() { i + 1 } else { 0 };
        sum += edge(corner, corners[next]);
    }
    sum.dot(n).abs()
}

/// `y.atan2(x)` for `y >= 0`, to a relative 1e-15: the C library's has branches, and a call an edge.
#[inline(always)]
fn angle(y: f64, x: f64) -> f64 {
    /// `(atan(q) / q - 1) / q²` in powers of q², highest first: Chebyshev's fit for q up to tan(π/8), off by
    /// 4e-17.
    const FIT: [f64; 11] = [
        -0.01917688711906226,
        0.03923165829558719,
        -0.0508544973794026,
        0.0585814891280221,
        -0.06664511447381948,
        0.07692183190826087,
        -0.09090904578123903,
        0.11111111015256361,
        -0.14285714284666542,
        0.1999999999999552,
        -0.3333333333333333,
    ];
    let (steep, wide) = (y > x.abs(), x < 0.0);
    let (low, high) = if steep { (x.abs(), y) } else { (y, x.abs()) };
    // tan(t - π/4) = (tan t - 1) / (tan t + 1)
    let upper = low > (SQRT_2 - 1.0) * high;
    let (above, below) = if upper {
        (low - high, low + high)
    } else {
        (low, high)
    };
    let q = above / below;
    let z = q * q;
    let mut sum = FIT[0];
    for c in &FIT[1..] {
        sum = sum * z + c;
    }
    let angle = q + q * (z * sum) + if upper { FRAC_PI_4 } else { 0.0 };
    let angle = if steep { FRAC_PI_2 - angle } else { angle };
    if wide { PI - angle } else { angle }
}

/// Corners of the rectangle with centre `d` and edges `u` and `v`.
#[inline(always)]
pub(crate) fn rect_corners(d: DVec3, u: DVec3, v: DVec3) -> [DVec3; 4] {
    let (a, b) = (0.5 * u, 0.5 * v);
    [d - a - b, d + a - b, d + a + b, d - a + b]
}

/// Irradiance from a sphere of radiance 1 that is above the tangent plane: π sin² of its half-angle, times
/// the cosine of its axis; `height` is that of its centre.
#[inline(always)]
pub(crate) fn sphere_irradiance(radius: f64, distance: f64, height: f64) -> f64 {
    let sin = radius / distance;
    PI * sin * sin * height / distance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arctangent_is_the_librarys_to_a_few_ulps() {
        let signs = [1.0, -1.0];
        let across = (-60..=60).map(|e| 2f64.powf(f64::from(e) * 0.37));
        let near = (-50..=50).map(|k| 1.0 + f64::from(k) * 0.02);
        for x in across
            .chain(near)
            .chain([0.0])
            .flat_map(|x| signs.map(|s| s * x))
        {
            for y in [1e-9, 0.3, 1.0, 7.0] {
                let (got, expected) = (angle(y, x), y.atan2(x));
                assert!((got - expected).abs() <= 1e-15 * expected, "{y} {x}");
            }
        }
        assert_eq!(angle(0.0, 1.0), 0.0);
        assert_eq!(angle(0.0, -1.0), PI);
    }
}
