//! What of a polygonal light lies in an edge's sector beyond it.
//!
//! The sector beyond the edge is an unbounded convex region `R` of three half-planes, two through the light's centre
//! `o`. The area of the outline's inside in `R` is a sum over the outline's sides, each cut to `R` from `p` to `q`:
//! the triangle `o p q`, less the triangle under its image on the edge as seen from `o`, with the sign of the way around
//! `o`. Whatever the outline encloses, and wherever `o` is: along a ray from `o` what begins beyond the edge and ends
//! there cancels.

use fearless_simd::{f32x16, prelude::*};

use crate::light::PolygonLight;
use crate::simd::Lanes;

/// A polygon in its own coordinates, in which its centroid is the origin and it lies in the square [-1, 1]².
#[derive(Debug, Clone, PartialEq)]
pub struct FlatPolygon {
    /// Corners, counter-clockwise.
    corners: Vec<[f32; 2]>,
    /// One over twice its area.
    scale: f32,
}

impl FlatPolygon {
    /// The outline of a light.
    pub(super) fn new(light: &PolygonLight) -> Self {
        let area = light.area() / light.u.cross(light.v).length();
        FlatPolygon {
            corners: light
                .corners()
                .iter()
                .map(|c| c.as_vec2().to_array())
                .collect(),
            scale: (0.5 / area) as f32,
        }
    }

    /// Fraction of the polygon in the sector of an edge beyond it. The edge runs along the unit vector `direction` from
    /// `from` to `to` at the distance `h` from the centre, which it has to its left, but in the lanes of `right`.
    #[inline(always)]
    pub(super) fn beyond<S: Simd>(
        &self,
        h: f32x16<S>,
        direction: [f32x16<S>; 2],
        [from, to]: [f32x16<S>; 2],
        right: u16,
    ) -> f32x16<S> {
        let zero = f32x16::splat(h.simd, 0.0);
        let one = f32x16::splat(h.simd, 1.0);
        let [dx, dy] = direction;
        let side = (zero - one).where_bits(right, one);
        let away = [dy * side, (zero - dx) * side];
        let end = |t: f32x16<S>| [away[0] * h + dx * t, away[1] * h + dy * t];
        let (start, stop) = (end(from), end(to));
        let cross = |[ax, ay]: [f32x16<S>; 2], [bx, by]: [f32x16<S>; 2]| ax * by - ay * bx;
        // Signed, positive in the region.
        let sides = |p: [f32x16<S>; 2]| {
            [
                cross(start, p) * side,
                cross(p, stop) * side,
                away[0] * p[0] + away[1] * p[1] - h,
            ]
        };
        let corner = |i: usize| self.corners[i].map(|x| f32x16::splat(h.simd, x));
        let least = h.greater(f32::MIN_POSITIVE);
        let mut p = corner(self.corners.len() - 1);
        let mut of_p = sides(p);
        let mut sum = zero;
        for i in 0..self.corners.len() {
            let q = corner(i);
            let of_q = sides(q);
            let (mut s0, mut s1) = (zero, one);
            for (a, b) in of_p.into_iter().zip(of_q) {
                let (a_out, b_out) = (a.lt(zero), b.lt(zero));
                // Where one is out and the other is not they differ.
                let at = a / (a - b).where_bits(a_out ^ b_out, one);
                let enter = at.where_bits(a_out & !b_out, one.where_bits(a_out, zero));
                let leave = at.where_bits(b_out & !a_out, one);
                s0 = s0.greater(enter);
                s1 = s1.lesser(leave);
            }
            let inside = s0.lt(s1);
            if inside != 0 {
                let place = |s: f32x16<S>| {
                    let [x, y] = [0, 1].map(|k| p[k] + (q[k] - p[k]) * s);
                    // Its image on the edge's line, along it.
                    let height = away[0] * x + away[1] * y;
                    (dx * x + dy * y) / height.greater(least) * h
                };
                let triangle = (s1 - s0) * cross(p, q);
                let under = (place(s1) - place(s0)) * h * side;
                sum += (triangle - under).where_bits(inside, zero);
            }
            (p, of_p) = (q, of_q);
        }
        (sum * self.scale).greater(0.0).lesser(1.0)
    }
}
