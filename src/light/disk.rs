//! Disks.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::contour;
use super::falloff::beyond_line_over_disk;
use super::{Light, Shape, SphereLight, check_finite, check_radius, unit};
use crate::error::{Error, Result};

/// A disk emitting towards `normal`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiskLight {
    /// Its middle.
    pub center: DVec3,
    /// Emitting side, unit length.
    pub normal: DVec3,
    /// Radius, may be zero.
    pub radius: f64,
}

impl Light {
    /// A disk; `normal` may have any length but zero.
    ///
    /// # Errors
    /// A value that is not finite, a zero normal or a negative radius.
    pub fn disk(center: DVec3, normal: DVec3, radius: f64, radiance: [f32; 3]) -> Result<Self> {
        check_finite("DiskLight", &[center, normal, DVec3::splat(radius)])?;
        let Some(normal) = unit(normal) else {
            return Err(Error::parameter("DiskLight", "normal must not be zero"));
        };
        check_radius("DiskLight", radius)?;
        Ok(Light {
            shape: Shape::Disk(DiskLight {
                center,
                normal,
                radius,
            }),
            radiance,
        })
    }
}

impl DiskLight {
    pub(super) fn mapped(
        &self,
        point: impl Fn(DVec3) -> DVec3,
        length: impl Fn(f64) -> f64,
    ) -> Shape {
        Shape::Disk(DiskLight {
            center: point(self.center),
            normal: self.normal,
            radius: length(self.radius),
        })
    }

    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let across = (DVec3::ONE - self.normal * self.normal).max(DVec3::ZERO);
        let half = self.radius * across.map(f64::sqrt);
        (self.center - half, self.center + half)
    }

    pub(super) fn normal(&self) -> Option<DVec3> {
        Some(self.normal)
    }

    pub(super) fn as_sphere(&self) -> Option<SphereLight> {
        None
    }

    pub(super) fn half_width(&self) -> f64 {
        self.radius
    }

    pub(super) fn reach(&self, axis: DVec3) -> f64 {
        self.radius * (axis - axis.dot(self.normal) * self.normal).length()
    }

    pub(super) fn farthest(&self, direction: DVec3) -> DVec3 {
        let along = direction - self.normal * direction.dot(self.normal);
        self.center + along.normalize_or_zero() * self.radius
    }

    pub(super) fn half_axes(&self, _: DVec3) -> (DVec3, DVec3, bool) {
        let e = self.normal.any_orthonormal_vector();
        (e * self.radius, self.normal.cross(e) * self.radius, true)
    }

    pub(super) fn emits_along(&self, d: DVec3) -> bool {
        self.normal.dot(d) < 0.0
    }

    pub(super) fn fraction_above(&self, d: DVec3, n: DVec3) -> f64 {
        // The tangent plane cuts the disk's plane in a line at this signed distance.
        let slope = (n - n.dot(self.normal) * self.normal).length() * self.radius;
        segment_fraction(n.dot(d), slope)
    }

    pub(super) fn irradiance(&self, d: DVec3, n: DVec3) -> f64 {
        disk_irradiance(d, self.normal, self.radius, n)
    }

    pub(super) fn slopes(
        &self,
        _: DVec3,
        distance: f64,
        [kappa, mu]: [DVec3; 2],
    ) -> Option<[f64; 2]> {
        // The disk is an ellipse seen along the axis: its support in direction v is
        // r |v - (v·n) n|.
        let (nk, nm) = (self.normal.dot(kappa), self.normal.dot(mu));
        let r2 = self.radius * self.radius;
        let (kk, km, mm) = (r2 * (1.0 - nk * nk), -r2 * nk * nm, r2 * (1.0 - nm * nm));
        let rest = distance * distance - mm;
        if rest <= 0.0 {
            return None;
        }
        let root = (km * km + rest * kk).max(0.0).sqrt();
        Some([(km + root) / rest, (km - root) / rest])
    }
}

/// Fraction of a disk on the positive side of a line at signed distance `height / slope` radii from
/// its centre; `slope` 0 (a plane parallel to the disk, or no size) is all or nothing.
fn segment_fraction(height: f64, slope: f64) -> f64 {
    if height.abs() >= slope {
        return if height > 0.0 { 1.0 } else { 0.0 };
    }
    beyond_line_over_disk(height / slope)
}

/// Irradiance from a disk of radiance 1 with centre `d` (from the receiver), unit normal `m` and
/// `radius`, the part above the tangent plane of `n` only.
///
/// Lambert's contour integral `½ ∮ n · (r × dr) / |r|²` over `r = d + radius (cos φ e₁ + sin φ e₂)`;
/// with `e₁` along the part of `d` in the disk's plane, `|r|² = a + b cos φ` and the integrand is
/// `(α + β cos φ + γ sin φ) / (a + b cos φ)`, which has an elementary antiderivative. Where the
/// tangent plane cuts the disk, the chord closes the contour.
pub(super) fn disk_irradiance(d: DVec3, m: DVec3, radius: f64, n: DVec3) -> f64 {
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
