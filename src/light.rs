//! Area lights: their shapes, the part of them that a point faces, and their unshadowed irradiance.
//!
//! Everything here is closed form, in `f64`, in any one coordinate system (world or local: no result
//! depends on the unit). `n` is the receiver's unit normal, or zero for a receiver without a tangent
//! plane. Points behind a flat light or inside a sphere receive nothing from it.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use crate::contour::{self, rect_corners};
use crate::error::{Error, Result};
use crate::geometry::Frame;

/// Local distance, in scene sizes, at which farther lights are put, along the same line and under the same angle: they
/// differ by less than a ten-thousandth of an `f32`'s ulp, and products of coordinates stay finite.
const FARTHEST: f64 = (1u64 << 40) as f64;

/// Where a light is and what it looks like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A parallelogram with full edge vectors, emitting towards `u × v`.
    Rect {
        /// Its middle.
        center: DVec3,
        /// First edge.
        u: DVec3,
        /// Second edge.
        v: DVec3,
    },
    /// A disk emitting towards `normal` (unit).
    Disk {
        /// Its middle.
        center: DVec3,
        /// Emitting side, unit length.
        normal: DVec3,
        /// Radius, may be zero.
        radius: f64,
    },
    /// A sphere emitting outwards.
    Sphere {
        /// Its middle.
        center: DVec3,
        /// Radius, may be zero.
        radius: f64,
    },
}

/// A light: a shape and the radiance that it emits, linear RGB.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Where it is.
    pub shape: Shape,
    /// What it emits.
    pub radiance: [f32; 3],
}

impl Light {
    /// A parallelogram.
    ///
    /// # Errors
    /// A value that is not finite, or edges that span no area.
    pub fn rect(center: DVec3, u: DVec3, v: DVec3, radiance: [f32; 3]) -> Result<Self> {
        finite("RectLight", &[center, u, v])?;
        for (name, edge) in [("edge_u", u), ("edge_v", v)] {
            let size = edge.abs().max_element();
            if size != 0.0 && !LENGTHS.contains(&size) {
                let allowed = format!("{:e} to {:e}", LENGTHS.start(), LENGTHS.end());
                let reason = format!("{name} must be {allowed} long, got {size:e}");
                return Err(Error::parameter("RectLight", reason));
            }
        }
        // Below 1e-12 of a rectangle's area the normal is the rounding of the edges.
        if u.cross(v).length() <= 1e-12 * u.length() * v.length() || u == DVec3::ZERO {
            let reason = format!("edge_u {u} and edge_v {v} span no area; a light needs area here");
            return Err(Error::parameter("RectLight", reason));
        }
        Ok(Light {
            shape: Shape::Rect { center, u, v },
            radiance,
        })
    }

    /// A disk; `normal` may have any length but zero.
    ///
    /// # Errors
    /// A value that is not finite, a zero normal or a negative radius.
    pub fn disk(center: DVec3, normal: DVec3, radius: f64, radiance: [f32; 3]) -> Result<Self> {
        finite("DiskLight", &[center, normal, DVec3::splat(radius)])?;
        let Some(normal) = unit(normal) else {
            return Err(Error::parameter("DiskLight", "normal must not be zero"));
        };
        check_radius("DiskLight", radius)?;
        Ok(Light {
            shape: Shape::Disk {
                center,
                normal,
                radius,
            },
            radiance,
        })
    }

    /// A sphere.
    ///
    /// # Errors
    /// A value that is not finite or a negative radius.
    pub fn sphere(center: DVec3, radius: f64, radiance: [f32; 3]) -> Result<Self> {
        finite("SphereLight", &[center, DVec3::splat(radius)])?;
        check_radius("SphereLight", radius)?;
        Ok(Light {
            shape: Shape::Sphere { center, radius },
            radiance,
        })
    }

    /// The same light in a scene's local coordinates; farther away than `FARTHEST`, one there that looks the same.
    pub fn to_local(&self, frame: &Frame) -> Light {
        let distance = frame.to_local(self.center()).length();
        let unit = frame.unit * (distance / FARTHEST).max(1.0);
        let frame = &Frame { unit, ..*frame };
        let shape = match self.shape {
            Shape::Rect { center, u, v } => Shape::Rect {
                center: frame.to_local(center),
                u: frame.vector_to_local(u),
                v: frame.vector_to_local(v),
            },
            Shape::Disk {
                center,
                normal,
                radius,
            } => Shape::Disk {
                center: frame.to_local(center),
                normal,
                radius: radius / frame.unit,
            },
            Shape::Sphere { center, radius } => Shape::Sphere {
                center: frame.to_local(center),
                radius: radius / frame.unit,
            },
        };
        Light {
            shape,
            radiance: self.radiance,
        }
    }

    /// A local light in world coordinates.
    pub fn to_world(&self, frame: &Frame) -> Light {
        let shape = match self.shape {
            Shape::Rect { center, u, v } => Shape::Rect {
                center: frame.to_world(center),
                u: u * frame.unit,
                v: v * frame.unit,
            },
            Shape::Disk {
                center,
                normal,
                radius,
            } => Shape::Disk {
                center: frame.to_world(center),
                normal,
                radius: radius * frame.unit,
            },
            Shape::Sphere { center, radius } => Shape::Sphere {
                center: frame.to_world(center),
                radius: radius * frame.unit,
            },
        };
        Light { shape, ..*self }
    }

    /// The light's middle.
    pub fn center(&self) -> DVec3 {
        match self.shape {
            Shape::Rect { center, .. }
            | Shape::Disk { center, .. }
            | Shape::Sphere { center, .. } => center,
        }
    }

    /// Axis-aligned bounds.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let (center, half) = match self.shape {
            Shape::Rect { center, u, v } => (center, 0.5 * (u.abs() + v.abs())),
            Shape::Disk {
                center,
                normal,
                radius,
            } => (
                center,
                radius
                    * (DVec3::ONE - normal * normal)
                        .max(DVec3::ZERO)
                        .map(f64::sqrt),
            ),
            Shape::Sphere { center, radius } => (center, DVec3::splat(radius)),
        };
        (center - half, center + half)
    }

    /// The side that a flat light emits to, unit length; `None` for a sphere.
    pub fn normal(&self) -> Option<DVec3> {
        match self.shape {
            Shape::Rect { u, v, .. } => Some(u.cross(v).normalize()),
            Shape::Disk { normal, .. } => Some(normal),
            Shape::Sphere { .. } => None,
        }
    }

    /// `h`: the fraction of the light above the tangent plane and emitting towards `p`.
    ///
    /// By area for flat lights, by solid angle for spheres; what visibility would be without
    /// occluders. A light of size zero is all or nothing.
    pub fn fraction_above(&self, p: DVec3, n: DVec3) -> f64 {
        if !self.emits_towards(p) {
            return 0.0;
        }
        let d = self.center() - p;
        if n == DVec3::ZERO {
            return 1.0;
        }
        match self.shape {
            Shape::Rect { u, v, .. } => {
                let corners = rect_corners(d, u, v);
                if corners.iter().all(|c| n.dot(*c) > 0.0) {
                    return 1.0;
                }
                let clipped = clip_above(&corners, n);
                let area = polygon_area(clipped.corners()) / u.cross(v).length();
                area.clamp(0.0, 1.0)
            }
            Shape::Disk { normal, radius, .. } => {
                // The tangent plane cuts the disk's plane in a line at this signed distance.
                let slope = (n - n.dot(normal) * normal).length() * radius;
                segment_fraction(n.dot(d), slope)
            }
            Shape::Sphere { radius, .. } => {
                let height = n.dot(d);
                if height.abs() >= radius {
                    return if height > 0.0 { 1.0 } else { 0.0 };
                }
                let distance = d.length();
                let sin = radius / distance;
                cap_fraction_above(n.dot(d) / distance, sin)
            }
        }
    }

    /// Irradiance at `p` from the whole light with radiance 1, without occluders.
    ///
    /// Lambert's contour formula, the contour clipped by the tangent plane: straight edges for a
    /// rectangle, a circle's arc for a disk; a sphere is the disk that its outline spans, seen along its axis.
    pub fn unshadowed_irradiance(&self, p: DVec3, n: DVec3) -> f64 {
        if !self.emits_towards(p) {
            return 0.0;
        }
        let d = self.center() - p;
        let value = match self.shape {
            Shape::Rect { u, v, .. } => {
                contour::polygon(clip_above(&rect_corners(d, u, v), n).corners(), n)
            }
            Shape::Disk { normal, radius, .. } => disk_irradiance(d, normal, radius, n),
            Shape::Sphere { radius, .. } => {
                let distance = d.length();
                let height = n.dot(d);
                if height >= radius {
                    return contour::sphere_irradiance(radius, distance, height);
                }
                cut_sphere_irradiance(radius, distance, height)
            }
        };
        value.max(0.0)
    }

    /// Whether `p` is in front of a flat light, or outside a sphere.
    pub fn emits_towards(&self, p: DVec3) -> bool {
        let d = self.center() - p;
        match self.shape {
            Shape::Rect { u, v, .. } => u.cross(v).dot(d) < 0.0,
            Shape::Disk { normal, .. } => normal.dot(d) < 0.0,
            Shape::Sphere { radius, .. } => d.length_squared() > radius * radius,
        }
    }
}

fn finite(what: &str, values: &[DVec3]) -> Result<()> {
    match values.iter().find(|v| !v.is_finite()) {
        None => Ok(()),
        Some(v) => Err(Error::parameter(
            what,
            format!("expected finite numbers, got {v}"),
        )),
    }
}

/// Lengths of which areas and their squares are neither 0 nor infinite in `f64`.
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-75..=1e75;

/// Radii of which squares are, as local units may be as large or small.
const RADII: std::ops::RangeInclusive<f64> = 1e-150..=1e150;

fn check_radius(what: &str, radius: f64) -> Result<()> {
    if radius == 0.0 || RADII.contains(&radius) {
        return Ok(());
    }
    let (least, most) = (RADII.start(), RADII.end());
    let reason =
        format!("radius must be 0 or more, and if more {least:e} to {most:e}, got {radius}");
    Err(Error::parameter(what, reason))
}

/// A vector at unit length, however long or short it is; `None` of zero.
pub(crate) fn unit(v: DVec3) -> Option<DVec3> {
    // Squares of what is very long or short are infinite or 0.
    let scaled = || (v / v.abs().max_element()).try_normalize();
    v.try_normalize().or_else(scaled)
}

/// A convex polygon of at most five corners: a rectangle cut by a plane.
struct Polygon {
    corners: [DVec3; 5],
    count: usize,
}

impl Polygon {
    fn push(&mut self, p: DVec3) {
        self.corners[self.count] = p;
        self.count += 1;
    }

    fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }
}

/// Sutherland–Hodgman against the plane through the origin with normal `n` (zero: no clipping).
///
/// A corner on the plane is kept, so that a cut adds a corner for every sign change only.
fn clip_above(rect: &[DVec3; 4], n: DVec3) -> Polygon {
    let mut out = Polygon {
        corners: [DVec3::ZERO; 5],
        count: 0,
    };
    for i in 0..4 {
        let (a, b) = (rect[i], rect[(i + 1) % 4]);
        let (ha, hb) = (n.dot(a), n.dot(b));
        if ha >= 0.0 {
            out.push(a);
        }
        // Rounding may give a third and fourth sign change only within an ulp of the plane.
        let crosses = (ha > 0.0 && hb < 0.0) || (ha < 0.0 && hb > 0.0);
        if crosses && out.count < 5 {
            out.push(a + (b - a) * (ha / (ha - hb)));
        }
    }
    out
}

fn polygon_area(polygon: &[DVec3]) -> f64 {
    let fan = polygon.windows(2).skip(1);
    let origin = polygon.first().copied().unwrap_or_default();
    0.5 * fan
        .map(|w| (w[0] - origin).cross(w[1] - origin))
        .sum::<DVec3>()
        .length()
}

/// Fraction of a disk on the positive side of a line at signed distance `height / slope` radii from
/// its centre; `slope` 0 (a plane parallel to the disk, or no size) is all or nothing.
fn segment_fraction(height: f64, slope: f64) -> f64 {
    if height.abs() >= slope {
        return if height > 0.0 { 1.0 } else { 0.0 };
    }
    beyond_line_over_disk(height / slope)
}

/// Fraction of a disk on the positive side of a line, its centre at `x` radii (-1 to 1) on that side.
pub(crate) fn beyond_line_over_disk(x: f64) -> f64 {
    let x = x.clamp(-1.0, 1.0);
    // Rounding leaves the interval by an ulp next to its ends.
    (1.0 - (x.acos() - x * (1.0 - x * x).sqrt()) / PI).clamp(0.0, 1.0)
}

/// Fraction of a rectangle beyond a line that has `s` (0 to 1) of its width beyond it, of which the shorter
/// side makes up `part`, at most 1/2: the distribution of the sum of two uniform numbers.
pub(crate) fn beyond_line_over_rectangle(s: f64, part: f64) -> f64 {
    let end = s - (1.0 - part);
    // The two triangles at the ends, of which a rectangle parallel to the line has none.
    let triangles = if part > 0.0 {
        (s.min(part).powi(2) - end.max(0.0).powi(2)) * 0.5 / part
    } else {
        0.0
    };
    // As for a disk, rounding leaves the interval next to its ends.
    ((triangles + (s - part).max(0.0)) / (1.0 - part)).clamp(0.0, 1.0)
}

/// Fraction of a spherical cap's solid angle above a plane through the sphere's centre: the cap's
/// axis has height `cos` over the plane, `sin` is the sine of the cap's half-angle. Tovchigrechko
/// and Vakser 2001, their intersection of two caps with one of them a hemisphere.
///
/// With `x = cos / sin`, `k = cap_cos / axis_sin` and `w = acos(-k x)` their area is
///
/// ```text
///     2π - 2 acos x - 2 cap_cos w  =  2 (asin x - asin(k x)) + 2 (1 - cap_cos) w
/// ```
///
/// of which the left side, and each arcsine of the right, loses all digits of a small cap. The difference of
/// the arcsines is that of one number, and both terms go with the square of `sin`, as the whole cap's area
/// `2π (1 - cap_cos)` does.
fn cap_fraction_above(cos: f64, sin: f64) -> f64 {
    if cos.abs() >= sin {
        return if cos > 0.0 { 1.0 } else { 0.0 };
    }
    let (x, squared) = ((cos / sin).clamp(-1.0, 1.0), sin * sin);
    let cap_cos = ((1.0 - sin) * (1.0 + sin)).max(0.0).sqrt();
    let axis_sin = ((1.0 - cos) * (1.0 + cos)).sqrt();
    let k = (cap_cos / axis_sin).min(1.0);
    let beyond = (1.0 - x) * (1.0 + x);
    let sum = ((1.0 - k * x) * (1.0 + k * x)).sqrt() + k * beyond.sqrt();
    // The sine of the difference, over `sin²`; at the ends both are zero.
    let sine = if beyond > 0.0 {
        x * beyond / (axis_sin * axis_sin * sum)
    } else {
        0.0
    };
    // An arcsine is its argument up to 1e-16 of it, where squares might underflow.
    let difference = if squared < 1e-16 {
        sine
    } else {
        (squared * sine).clamp(-1.0, 1.0).asin() / squared
    };
    let wedge = (-k * x).acos();
    ((wedge + difference * (1.0 + cap_cos)) / PI).clamp(0.0, 1.0)
}

/// Irradiance from a sphere of radiance 1 that the tangent plane cuts; `height` is that of its centre.
///
/// With `σ` the half-angle of its cone, `θ` the angle between axis and normal and `y = -cot θ cot σ`, Lambert's
/// contour integral over the circle's arc and the chord is
///
/// ```text
///     sin²σ cos θ acos y - sin σ cos σ t + atan(tan σ t),    t = sin θ √(1 - y²)
/// ```
fn cut_sphere_irradiance(radius: f64, distance: f64, height: f64) -> f64 {
    let (sin, cos_axis) = (radius / distance, height / distance);
    if cos_axis <= -sin {
        return 0.0;
    }
    let cos = ((1.0 - sin) * (1.0 + sin)).max(0.0).sqrt();
    let sin_axis = ((1.0 - cos_axis) * (1.0 + cos_axis)).max(f64::MIN_POSITIVE);
    let sin_axis = sin_axis.sqrt();
    let y = (-cos_axis * cos / (sin_axis * sin)).clamp(-1.0, 1.0);
    let across = sin * sin_axis * ((1.0 - y) * (1.0 + y)).sqrt();
    let arc = sin * sin * cos_axis * y.acos();
    if 4.0 * across < cos {
        // Of a small sphere the last two terms cancel to their third powers.
        let w = across / cos;
        return arc + sin * sin * w - beyond_arctangent(w);
    }
    arc - cos * across + across.atan2(cos)
}

/// `w - atan w` for `w` up to a quarter, by its series.
fn beyond_arctangent(w: f64) -> f64 {
    let z = w * w;
    let sum = (0..14)
        .rev()
        .fold(0.0, |sum, k| 1.0 / f64::from(2 * k + 3) - z * sum);
    w * z * sum
}

/// Irradiance from a disk of radiance 1 with centre `d` (from the receiver), unit normal `m` and
/// `radius`, the part above the tangent plane of `n` only.
///
/// Lambert's contour integral `½ ∮ n · (r × dr) / |r|²` over `r = d + radius (cos φ e₁ + sin φ e₂)`;
/// with `e₁` along the part of `d` in the disk's plane, `|r|² = a + b cos φ` and the integrand is
/// `(α + β cos φ + γ sin φ) / (a + b cos φ)`, which has an elementary antiderivative. Where the
/// tangent plane cuts the disk, the chord closes the contour.
fn disk_irradiance(d: DVec3, m: DVec3, radius: f64, n: DVec3) -> f64 {
    let in_plane = d - d.dot(m) * m;
    let offset = in_plane.length();
    // On the axis the part in the plane is rounding, and not even perpendicular to it. Taking an offset of
    // less than 1e-8 for none moves the disk by 1e-8 of its distance.
    let on_axis = offset <= 1e-8 * d.length();
    let (e1, offset) = if on_axis {
        (m.any_orthonormal_vector(), 0.0)
    } else {
        (in_plane / offset, offset)
    };
    let e2 = m.cross(e1);
    // Height over the tangent plane at φ: h0 + h1 cos(φ - φ0).
    let (h0, hc, hs) = (n.dot(d), radius * n.dot(e1), radius * n.dot(e2));
    let h1 = hc.hypot(hs);
    if h0 <= -h1 {
        return 0.0;
    }
    let a = d.length_squared() + radius * radius;
    let b = 2.0 * radius * offset;
    // The distances to the rim's nearest and farthest point, squared `a - b` and `a + b`: next to the rim those
    // differences are rounding.
    let to_rim = |across: f64| d.dot(m).hypot(across);
    let nearest = to_rim(radius - offset);
    let root = nearest * to_rim(radius + offset);
    // r × dr/dφ = radius (d × e(φ)') + radius² m
    let alpha = radius * radius * n.dot(m);
    let beta = radius * n.dot(d.cross(e2));
    let gamma = -radius * n.dot(d.cross(e1));
    if h0 >= h1 {
        // Over the whole turn γ's part is zero and β's -2π b / (root (root + a)), without cancellation.
        return (PI / root * (alpha - beta * b / (root + a))).abs();
    }
    let middle = hs.atan2(hc);
    let half = (-h0 / h1).clamp(-1.0, 1.0).acos();
    let (start, end) = (middle - half, middle + half);
    let point = |phi: f64| d + radius * (phi.cos() * e1 + phi.sin() * e2);
    let chord = contour::edge(point(end), point(start)).dot(n);
    let arc = rational_arc(
        [a, b, nearest * nearest, root],
        [alpha, beta, gamma],
        start,
        end,
    );
    (0.5 * arc + chord).abs()
}

/// `∫ (α + β cos φ + γ sin φ) / (a + b cos φ) dφ` from `start` to `end`, for `a > b ≥ 0` and an
/// interval no longer than a full turn; `less` is `a - b`, and `root` that of `a² - b²`.
fn rational_arc(
    [a, b, less, root]: [f64; 4],
    [alpha, beta, gamma]: [f64; 3],
    start: f64,
    end: f64,
) -> f64 {
    // Antiderivative of 1/(a + b cos φ), continuous over all φ: the half-angle's arctangent jumps
    // by π at every odd multiple of π, which the count of turns undoes.
    let inverse = |phi: f64| {
        let turns = ((phi + PI) / TAU).floor();
        let half = 0.5 * (phi - turns * TAU);
        2.0 / root * ((less * half.sin()).atan2(root * half.cos()) + turns * PI)
    };
    let i0 = inverse(end) - inverse(start);
    // Below this ratio (φ - a I0)/b loses more digits than the series' next term, (b/a)², holds.
    if b < 1e-6 * a {
        let k = b / a;
        let (s, c) = (end.sin() - start.sin(), end.cos() - start.cos());
        let cos2 = 0.5 * (end - start) + 0.25 * ((2.0 * end).sin() - (2.0 * start).sin());
        let sin_cos = -0.25 * ((2.0 * end).cos() - (2.0 * start).cos());
        return alpha * i0 + (beta * (s - k * cos2) + gamma * (-c - k * sin_cos)) / a;
    }
    let cosine = ((end - start) - a * i0) / b;
    // `a + b cos φ`, which cancels where the receiver is next to the rim.
    let squared = |phi: f64| less + 2.0 * b * (0.5 * phi).cos().powi(2);
    let sine = -(squared(end) / squared(start)).ln() / b;
    alpha * i0 + beta * cosine + gamma * sine
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A number and those some ulps beside it.
    fn beside(x: f64, ulps: i64) -> f64 {
        (0..ulps.abs()).fold(x, |x, _| if ulps > 0 { x.next_up() } else { x.next_down() })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        /// Next to the ends of their intervals, in the middle, and beyond.
        #[test]
        fn parts_of_a_light_are_never_negative_and_never_more_than_all(
            end in prop::sample::select(vec![-1.0, 0.0, 0.5, 1.0]), ulps in -40i64..=40, wide in -1.2..1.2f64,
            part in prop::sample::select(vec![0.0, 1e-300, 1e-17, 1e-9, 0.1, 1.0 / 3.0, 0.5]),
            sin in prop::sample::select(vec![1e-200, 1e-160, 1e-9, 1e-4, 0.3, 1.0 - 1e-16, 1.0]),
        ) {
            for x in [beside(end, ulps), wide, beside(part, ulps), beside(1.0 - part, ulps)] {
                let all = [
                    beyond_line_over_disk(x),
                    beyond_line_over_rectangle(x.clamp(0.0, 1.0), part),
                    cap_fraction_above(x * sin, sin),
                    cap_fraction_above(beside(end * sin, ulps), sin),
                ];
                prop_assert!(all.iter().all(|v| (0.0..=1.0).contains(v)), "{x} {part} {sin}: {all:?}");
            }
        }

        /// Tangent planes that touch a light's border or nearly do, and points on the rim of a disk or nearly so.
        #[test]
        fn a_light_that_the_tangent_plane_touches_sends_nothing_negative(
            direction in prop::array::uniform3(-1.0..1.0f64), turn in 0.0..TAU, ulps in -8i64..=8,
            exponent in -12..2i32, radius in prop::sample::select(vec![1e-74, 1e-8, 0.3, 5.0]),
        ) {
            let m = DVec3::from(direction).normalize_or(DVec3::Z);
            let e = m.any_orthonormal_vector();
            let rim = turn.cos() * e + turn.sin() * m.cross(e);
            let near = beside(radius, ulps) * rim - m * 10f64.powi(exponent);
            for light in [
                Light::disk(DVec3::ZERO, -m, radius, [1.0; 3]).unwrap(),
                Light::sphere(DVec3::ZERO, radius, [1.0; 3]).unwrap(),
                Light::rect(DVec3::ZERO, radius * e, m.cross(e), [1.0; 3]).unwrap(),
            ] {
                for p in [near, -near, near + 0.5 * rim, DVec3::from(direction)] {
                    // Normals across the direction to the border, and some ulps of it up and down.
                    let to = (radius * rim - p).normalize_or(m);
                    let across = to.cross(m).normalize_or(e);
                    for lift in [0.0, 1e-16, -1e-16, 1e-12, -1e-12, 0.1] {
                        for n in [to.cross(across) + lift * to, across + lift * to] {
                            let n = n.normalize_or(m);
                            let h = light.fraction_above(p, n);
                            prop_assert!((0.0..=1.0).contains(&h), "{light:?} {p} {n}: {h}");
                            let e = light.unshadowed_irradiance(p, n);
                            // All of a hemisphere sends π; next to a rim the terms cancel.
                            prop_assert!((0.0..=PI * (1.0 + 1e-4)).contains(&e), "{light:?} {p} {n}: {e}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn of_a_small_sphere_as_much_is_above_as_of_the_disk_that_it_looks_like() {
        for sin in [1e-200, 1e-150, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3] {
            for x in [-0.99, -0.3, 0.0, 0.2, 0.7, 0.999] {
                let (got, disk) = (cap_fraction_above(x * sin, sin), beyond_line_over_disk(x));
                assert!(
                    (got - disk).abs() < 1e-15 + sin * sin,
                    "{sin} {x}: {got} {disk}"
                );
            }
        }
        // A hemisphere: a lune.
        for x in [-0.9f64, -0.2, 0.0, 0.5, 0.8] {
            let lune = 1.0 - x.acos() / PI;
            assert!((cap_fraction_above(x, 1.0) - lune).abs() < 1e-15);
        }
    }

    /// Midpoint rule over the light's area or solid angle: irradiance and fraction above.
    fn brute_force(light: &Light, p: DVec3, n: DVec3, steps: usize) -> (f64, f64) {
        let (mut irradiance, mut above, mut total) = (0.0, 0.0, 0.0);
        for i in 0..steps {
            for j in 0..steps {
                let (s, t) = (
                    (i as f64 + 0.5) / steps as f64,
                    (j as f64 + 0.5) / steps as f64,
                );
                let (direction, weight) = match light.shape {
                    Shape::Rect { center, u, v } => {
                        let r = center + (s - 0.5) * u + (t - 0.5) * v - p;
                        (r, -u.cross(v).dot(r) / r.length().powi(3))
                    }
                    Shape::Disk {
                        center,
                        normal,
                        radius,
                    } => {
                        let e1 = normal.any_orthonormal_vector();
                        let (rho, phi) = (s.sqrt() * radius, TAU * t);
                        let e = phi.cos() * e1 + phi.sin() * normal.cross(e1);
                        let r = center + rho * e - p;
                        (
                            r,
                            -normal.dot(r) * PI * radius * radius / r.length().powi(3),
                        )
                    }
                    Shape::Sphere { center, radius } => {
                        let d = center - p;
                        let w = d.normalize();
                        let e1 = w.any_orthonormal_vector();
                        let cap = 1.0 - (1.0 - (radius / d.length()).powi(2)).sqrt();
                        let cos = 1.0 - s * cap;
                        let e = (TAU * t).cos() * e1 + (TAU * t).sin() * w.cross(e1);
                        (w * cos + e * (1.0 - cos * cos).sqrt(), TAU * cap)
                    }
                };
                total += 1.0;
                if n.dot(direction) > 0.0 {
                    above += 1.0;
                    irradiance += n.dot(direction.normalize()) * weight;
                }
            }
        }
        (irradiance / total, above / total)
    }

    fn lights() -> [Light; 4] {
        let c = DVec3::new(0.3, -0.2, 1.5);
        let (u, v) = (DVec3::new(0.1, 0.9, 0.2), DVec3::new(1.1, 0.1, -0.3));
        [
            Light::rect(c, u, v, [1.0; 3]).unwrap(),
            Light::disk(c, DVec3::new(0.2, 0.1, -1.0), 0.7, [1.0; 3]).unwrap(),
            Light::disk(DVec3::new(0.0, 0.0, 2.0), -DVec3::Z, 0.7, [1.0; 3]).unwrap(),
            Light::sphere(c, 0.6, [1.0; 3]).unwrap(),
        ]
    }

    #[test]
    fn closed_forms_agree_with_quadrature_above_and_across_the_tangent_plane() {
        // 400² midpoints: smooth integrands to 1e-5, the horizon's cut to about 1/400 of a row.
        let normals = [
            DVec3::Z,
            DVec3::new(0.9, 0.1, 0.3),
            DVec3::new(-1.0, 0.2, 0.02),
        ];
        for light in lights() {
            for n in normals.map(DVec3::normalize) {
                let p = DVec3::new(0.1, 0.2, -0.1);
                let (irradiance, above) = brute_force(&light, p, n, 400);
                let got = light.unshadowed_irradiance(p, n);
                assert!(
                    (got - irradiance).abs() < 2e-4 * irradiance.max(0.05),
                    "{light:?} {n}: {got} {irradiance}"
                );
                let h = light.fraction_above(p, n);
                assert!((h - above).abs() < 3e-3, "{light:?} {n}: {h} {above}");
            }
        }
    }

    #[test]
    fn a_sphere_that_the_tangent_plane_cuts_is_the_disk_that_its_outline_spans() {
        for sin in [1e-8f64, 1e-5, 1e-3, 0.02, 0.2, 0.24, 0.26, 0.5, 0.9, 0.999] {
            for part in [-0.999, -0.7, -0.2, 0.0, 0.3, 0.8, 0.999] {
                let cos_axis = part * sin;
                let axis = DVec3::new((1.0 - cos_axis * cos_axis).sqrt(), 0.0, cos_axis);
                let cos = (1.0 - sin * sin).sqrt();
                let disk = disk_irradiance(axis * cos, -axis, sin, DVec3::Z);
                let sphere = cut_sphere_irradiance(sin, 1.0, cos_axis);
                // Of the same size seen from the front; the disk's chord and arc cancel as the terms here would
                // without their series: to ulps of the sine, while the light falls with its square.
                let all = PI * sin * sin;
                let tolerance = (1e-14 + 2.0 * f64::EPSILON / sin) * all;
                assert!(
                    (sphere - disk).abs() < tolerance,
                    "{sin} {part}: {sphere} {disk}"
                );
            }
        }
        // Half of it above: (σ - sin σ cos σ), of a small one 2/3 σ³ but for 1/5 σ².
        for sin in [1e-9, 1e-6, 1e-4] {
            let got = cut_sphere_irradiance(sin, 1.0, 0.0);
            assert!((got / (2.0 / 3.0 * sin.powi(3)) - 1.0).abs() < 1e-14 + sin * sin);
        }
    }

    #[test]
    fn known_values() {
        // A disk overhead: π sin² of its half-angle. A sphere: the same. A huge square: π.
        let disk = Light::disk(DVec3::Z, -DVec3::Z, 1.0, [1.0; 3]).unwrap();
        assert!((disk.unshadowed_irradiance(DVec3::ZERO, DVec3::Z) - PI / 2.0).abs() < 1e-12);
        let sphere = Light::sphere(DVec3::Z * 2.0, 1.0, [1.0; 3]).unwrap();
        assert!((sphere.unshadowed_irradiance(DVec3::ZERO, DVec3::Z) - PI / 4.0).abs() < 1e-12);
        let sky = Light::rect(DVec3::Z, DVec3::Y * 1e7, DVec3::X * 1e7, [1.0; 3]).unwrap();
        assert!((sky.unshadowed_irradiance(DVec3::ZERO, DVec3::Z) - PI).abs() < 1e-6);
        // Half below the horizon.
        assert!((sphere.fraction_above(DVec3::ZERO, DVec3::X) - 0.5).abs() < 1e-12);
        assert!((disk.fraction_above(DVec3::ZERO, DVec3::X) - 0.5).abs() < 1e-12);
        assert!((sky.fraction_above(DVec3::ZERO, DVec3::X) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn nothing_reaches_the_back_of_a_flat_light_or_the_inside_of_a_sphere() {
        for light in lights() {
            let inside = match light.normal() {
                Some(m) => light.center() - 0.1 * m,
                None => light.center() + DVec3::new(0.1, 0.2, 0.3),
            };
            assert_eq!(light.unshadowed_irradiance(inside, DVec3::Z), 0.0);
            assert_eq!(light.fraction_above(inside, DVec3::Z), 0.0);
        }
    }

    #[test]
    fn bad_lights_are_errors_and_lights_of_size_zero_are_not() {
        let z = DVec3::Z;
        assert!(Light::rect(z, DVec3::X, DVec3::X * 2.0, [1.0; 3]).is_err());
        assert!(Light::rect(z, DVec3::X, DVec3::ZERO, [1.0; 3]).is_err());
        assert!(Light::disk(z, DVec3::ZERO, 1.0, [1.0; 3]).is_err());
        assert!(Light::sphere(z, -1.0, [1.0; 3]).is_err());
        assert!(Light::sphere(z, f64::NAN, [1.0; 3]).is_err());
        let point = Light::sphere(z, 0.0, [1.0; 3]).unwrap();
        assert_eq!(point.unshadowed_irradiance(DVec3::ZERO, z), 0.0);
        assert_eq!(point.fraction_above(DVec3::ZERO, z), 1.0);
        assert_eq!(point.fraction_above(DVec3::ZERO, -z), 0.0);
    }
}
