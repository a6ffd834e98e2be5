//! The outline of a polygon: what is asked of it, and what is derived from it once.
//!
//! Whether edges meet is decided exactly (Shewchuk's predicates, the `robust` crate), on the coordinates as they were
//! given without the one in which the polygon reaches least along its normal.

use glam::{DMat2, DVec2, DVec3};
use robust::{Coord, orient2d};

use super::strips::Strips;
use crate::error::{Error, Result};

/// Most corners of an outline: wedges take time in proportion to them, and strips memory in proportion to their square.
pub const MOST_CORNERS: usize = 1024;

/// Extents of which areas and their squares are neither 0 nor infinite in `f64`.
const EXTENTS: std::ops::RangeInclusive<f64> = 1e-75..=1e75;

/// Part of the square of its extent that a polygon's area is at least: below, its normal is rounding.
const LEAST_AREA: f64 = 1e-12;

/// How far a corner may be off the plane: this part of the polygon's extent, which kernels in single precision do not
/// tell from none, and what rounding in single precision leaves of corners whose coordinates are eight extents.
const OFF_PLANE: f64 = 8.0 * f32::EPSILON as f64;

/// And this part of the largest coordinate, what rounding in double precision leaves of corners far from the origin.
const ROUNDED: f64 = 8.0 * f64::EPSILON;

/// Relative difference of second moments below which a polygon has no principal axes, as a square has none.
const ISOTROPIC: f64 = 1e-6;

/// An outline in a frame of its own, in which it lies in [-1, 1]² with its centroid at the origin.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Outline {
    /// Its corners, counter-clockwise.
    pub(super) corners: Vec<DVec2>,
    /// Its area.
    pub(super) area: f64,
    /// Half axes of the rectangle that stands in for it.
    pub(super) half_axes: [DVec2; 2],
    /// The map onto it from the square.
    pub(super) strips: Strips,
}

impl Outline {
    /// Checks an outline; returns its centroid, its half axes in space and itself.
    pub(super) fn new(corners: &[DVec3]) -> Result<(DVec3, [DVec3; 2], Outline)> {
        let count = corners.len();
        if !(3..=MOST_CORNERS).contains(&count) {
            return fail(format!(
                "vertices: expected 3 to {MOST_CORNERS}, got {count}"
            ));
        }
        if let Some(i) = corners.iter().position(|c| !c.is_finite()) {
            return fail(format!(
                "vertex {i}: expected finite numbers, got {}",
                corners[i]
            ));
        }
        let (low, high) = corners
            .iter()
            .fold((corners[0], corners[0]), |(low, high), &c| {
                (low.min(c), high.max(c))
            });
        let extent = (high - low).max_element();
        if extent == 0.0 {
            return fail(format!("all vertices are at {low}; a light needs area"));
        }
        if !EXTENTS.contains(&extent) {
            let (least, most) = (EXTENTS.start(), EXTENTS.end());
            return fail(format!(
                "its extent must be {least:e} to {most:e}, got {extent:e}"
            ));
        }
        // The sum of the cross products about any point is twice the area along the normal (Newell).
        let from = |c: DVec3| (c - corners[0]) / extent;
        let next = |i: usize| (i + 1) % count;
        let sum: DVec3 = (0..count)
            .map(|i| from(corners[i]).cross(from(corners[next(i)])))
            .sum();
        if sum.length() <= LEAST_AREA {
            return fail(
                "vertices span no area, or as much on either side; a light needs area".into(),
            );
        }
        let normal = sum.normalize();
        check_planar(corners, normal, extent, low.abs().max(high.abs()))?;
        check_simple(corners, normal)?;
        let longest =
            (0..count)
                .map(|i| corners[next(i)] - corners[i])
                .fold(DVec3::ZERO, |a, b| {
                    if b.length_squared() > a.length_squared() {
                        b
                    } else {
                        a
                    }
                });
        let e = (longest - longest.dot(normal) * normal).normalize();
        let f = normal.cross(e);
        let flat: Vec<DVec2> = corners
            .iter()
            .map(|&c| DVec2::new(e.dot(from(c)), f.dot(from(c))))
            .collect();
        let moments = Moments::of(&flat);
        let half = flat.iter().fold(DVec2::ZERO, |most, &p| {
            most.max((p - moments.centroid).abs())
        });
        let corners_in_frame = flat.iter().map(|&p| (p - moments.centroid) / half);
        let corners_in_frame: Vec<DVec2> = corners_in_frame.collect();
        let half_axes = moments.half_axes().map(|axis| axis / half);
        let at = moments.centroid * extent;
        let outline = Outline {
            strips: Strips::new(&corners_in_frame),
            corners: corners_in_frame,
            area: moments.area / (half.x * half.y),
            half_axes,
        };
        let center = corners[0] + at.x * e + at.y * f;
        let axes = [e * (half.x * extent), f * (half.y * extent)];
        Ok((center, axes, outline))
    }
}

fn fail<T>(reason: String) -> Result<T> {
    Err(Error::parameter("PolygonLight", reason))
}

fn check_planar(corners: &[DVec3], normal: DVec3, extent: f64, largest: DVec3) -> Result<()> {
    let count = corners.len() as f64;
    let middle: DVec3 = corners.iter().map(|&c| (c - corners[0]) / count).sum();
    let off = |c: DVec3| normal.dot(c - corners[0] - middle).abs();
    let allowed = OFF_PLANE * extent + ROUNDED * largest.max_element();
    let farthest = corners.iter().map(|&c| off(c)).enumerate();
    let farthest = farthest.fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
    match farthest {
        (i, distance) if distance > allowed => fail(format!(
            "vertices must lie in one plane; vertex {i} is {distance:.3e} off it, allowed is {allowed:.3e}"
        )),
        _ => Ok(()),
    }
}

/// Whether no two edges of the outline have a point in common, but neighbours their corner.
fn check_simple(corners: &[DVec3], normal: DVec3) -> Result<()> {
    let away = normal.abs().max_position();
    let [x, y] = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| [i, j])[away];
    let flat: Vec<Coord<f64>> = (corners.iter().map(|c| Coord { x: c[x], y: c[y] })).collect();
    let count = flat.len();
    let next = |i: usize| (i + 1) % count;
    let along = |a: Coord<f64>, b: Coord<f64>, c: Coord<f64>| {
        DVec2::new(a.x - b.x, a.y - b.y).dot(DVec2::new(c.x - b.x, c.y - b.y))
    };
    for i in 0..count {
        let [a, b, c] = [flat[i], flat[next(i)], flat[next(next(i))]];
        if a == b {
            let (i, j) = (i, next(i));
            return fail(format!(
                "vertices {i} and {j} are one point; the outline closes by itself"
            ));
        }
        if b != c && orient2d(a, b, c) == 0.0 && along(a, b, c) > 0.0 {
            let b = next(i);
            return fail(format!("the outline turns back on itself at vertex {b}"));
        }
    }
    for i in 0..count {
        for j in i + 2..count {
            if next(j) == i {
                continue;
            }
            let (first, second) = ([flat[i], flat[next(i)]], [flat[j], flat[next(j)]]);
            if meet(first, second) {
                let ends = [i, next(i), j, next(j)];
                return fail(format!(
                    "the outline meets itself: its edge from vertex {} to {} and that from vertex {} to {}",
                    ends[0], ends[1], ends[2], ends[3],
                ));
            }
        }
    }
    Ok(())
}

/// Whether two segments have a point in common.
fn meet([a, b]: [Coord<f64>; 2], [c, d]: [Coord<f64>; 2]) -> bool {
    let apart = |p: [f64; 2], q: [f64; 2]| {
        p[0].max(p[1]) < q[0].min(q[1]) || q[0].max(q[1]) < p[0].min(p[1])
    };
    if apart([a.x, b.x], [c.x, d.x]) || apart([a.y, b.y], [c.y, d.y]) {
        return false;
    }
    let one_side = |p: f64, q: f64| (p > 0.0 && q > 0.0) || (p < 0.0 && q < 0.0);
    // Of segments in one line the bounds have answered.
    !one_side(orient2d(a, b, c), orient2d(a, b, d))
        && !one_side(orient2d(c, d, a), orient2d(c, d, b))
}

/// Area, centroid and second moments about it.
struct Moments {
    area: f64,
    centroid: DVec2,
    /// Along both axes, and mixed.
    second: [f64; 3],
}

impl Moments {
    fn of(corners: &[DVec2]) -> Moments {
        // About the mean of the corners, so that little cancels.
        let mean = corners.iter().sum::<DVec2>() / corners.len() as f64;
        let next = corners.iter().cycle().skip(1);
        let (mut area, mut first, mut second) = (0.0, DVec2::ZERO, [0.0; 3]);
        for (&a, &b) in corners.iter().zip(next) {
            let (a, b) = (a - mean, b - mean);
            let cross = a.perp_dot(b);
            area += 0.5 * cross;
            first += (a + b) * (cross / 6.0);
            let squares = a * a + a * b + b * b;
            second[0] += squares.x * cross / 12.0;
            second[1] += squares.y * cross / 12.0;
            second[2] += (2.0 * (a.x * a.y + b.x * b.y) + a.x * b.y + b.x * a.y) * cross / 24.0;
        }
        let at = first / area;
        second[0] -= area * at.x * at.x;
        second[1] -= area * at.y * at.y;
        second[2] -= area * at.x * at.y;
        Moments {
            area,
            centroid: mean + at,
            second,
        }
    }

    /// Half axes of the rectangle of the same area along the principal axes, its sides as the roots of the moments.
    fn half_axes(&self) -> [DVec2; 2] {
        let [xx, yy, xy] = self.second;
        let (sum, difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let root = difference.hypot(xy);
        let turn = if root <= ISOTROPIC * sum {
            0.0
        } else {
            0.5 * xy.atan2(difference)
        };
        let axes = DMat2::from_angle(turn);
        let moment = |e: DVec2| (e.x * e.x * xx + 2.0 * e.x * e.y * xy + e.y * e.y * yy).max(0.0);
        let ratio = (moment(axes.x_axis) / moment(axes.y_axis)).powf(0.25);
        let half = 0.5 * self.area.sqrt();
        [axes.x_axis * (half * ratio), axes.y_axis * (half / ratio)]
    }
}
