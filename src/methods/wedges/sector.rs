//! Vertices and edges as sixteen receivers see them on the light, and what lies in their sectors.
//!
//! The light is the unit disk or the square [-1, 1]² in coordinates of its own, with its centre at the origin.

use std::f32::consts::PI;

use super::block::ReceiverBlock;
use super::edge::{AreaEdge, Split};
use super::polygon::FlatPolygon;
use crate::simd::{Lanes, Row};
use fearless_simd::{f32x16, prelude::*};

/// Stands for infinitely far along a line on the light, whose half-width is 1.
const FAR: f32 = 1e9;

/// Distances from a receiver below this, in local units, count as this: products of two and a line's length
/// stay normal numbers, and vertices are known to a hundred times as much at best.
const NEAREST: f32 = 1e-9;

/// A vertex as sixteen receivers see it on the light.
#[derive(Clone, Copy)]
pub(super) struct VertexOnLight<S: Simd> {
    /// Homogeneous coordinates.
    q: [f32x16<S>; 3],
    /// Coordinates on the light.
    at: [f32x16<S>; 2],
    /// Its distance from the centre: squared, or on the square the larger of its coordinates.
    away: f32x16<S>,
    /// Lanes in which the last coordinate is positive.
    ahead: u16,
    /// Lanes in which it is not behind the light.
    before: u16,
    /// Lanes in which it hides a point of the light.
    pub(super) inside: u16,
}

impl<S: Simd> VertexOnLight<S> {
    /// Draws a vertex.
    #[inline(always)]
    pub(super) fn new(simd: S, block: &ReceiverBlock, vertex: &Split, square: bool) -> Self {
        let zero = f32x16::splat(simd, 0.0);
        let mut from = [zero; 3];
        for (axis, [high, low]) in block.position.iter().enumerate() {
            let difference = vertex.high[axis] - high.load(simd);
            from[axis] = difference + (vertex.low[axis] - low.load(simd));
        }
        let q = block.draw(simd, from);
        let inverse = 1.0 / q[2].greater(NEAREST);
        let [x, y] = [q[0] * inverse, q[1] * inverse];
        let away = if square {
            x.abs().greater(y.abs())
        } else {
            x * x + y * y
        };
        let (ahead, before) = (zero.lt(q[2]), q[2].lt(block.far.load(simd)));
        VertexOnLight {
            q,
            at: [x, y],
            away,
            ahead,
            before,
            inside: ahead & before & away.lt(1.0),
        }
    }

    /// Lanes in which an edge from here to `b` surely hides no point of the light.
    #[inline(always)]
    pub(super) fn misses(&self, b: &Self, square: bool) -> u16 {
        let ([ax, ay], [bx, by]) = (self.at, b.at);
        let away = if square {
            // Both ends beyond one side.
            let (high, low) = (
                ax.lesser(bx).greater(ay.lesser(by)),
                ax.greater(bx).lesser(ay.greater(by)),
            );
            high.greater(0.0 - low).ge(1.0)
        } else {
            // Both ends are outside, and the nearer one is the edge's nearest point.
            let nearer = self.away.lesser(b.away);
            nearer.ge(1.0) & nearer.le(ax * bx + ay * by)
        };
        away & self.ahead & b.ahead
    }

    /// How far around the centre it is seen, counter-clockwise from the first axis: from minus to plus half of
    /// [`turn`].
    #[inline(always)]
    pub(super) fn around(&self, square: bool) -> f32x16<S> {
        let [x, y] = self.at;
        let below = y.lt(0.0);
        if square {
            let far = x.abs().greater(y.abs()).greater(NEAREST);
            let way = border(self.at, 1.0 / far);
            (way - 8.0).where_bits(below & way.gt(1.0), way)
        } else {
            let angle = angle(y.abs(), x);
            (0.0 - angle).where_bits(below, angle)
        }
    }
}

/// All the way around the centre, as [`VertexOnLight::around`] and [`Inner::twice_triangle`] measure it: the way along
/// the square's border, or radians.
pub(super) fn turn(square: bool) -> f32 {
    if square { 8.0 } else { 2.0 * PI }
}

/// An edge between two vertices that both hide points of the light.
pub(super) struct Inner<S: Simd> {
    /// Twice the area of the triangle of edge and centre, positive if counter-clockwise.
    pub(super) twice_triangle: f32x16<S>,
    /// Lanes in which the way from the first vertex's [`VertexOnLight::around`] to the second's is a turn more, or less.
    pub(super) more: u16,
    /// See `more`.
    pub(super) less: u16,
}

impl<S: Simd> Inner<S> {
    /// The edge from `a` to `b` for the lanes `valid`.
    ///
    /// Receivers on the lit side of the plane through edge and light's centre see it run counter-clockwise.
    /// Where rounding might say otherwise, and change the sum by a layer, their exact side decides.
    #[inline(always)]
    pub(super) fn new(
        a: &VertexOnLight<S>,
        b: &VertexOnLight<S>,
        valid: u16,
        block: &ReceiverBlock,
        edge: &AreaEdge,
    ) -> Self {
        let ([ax, ay], [bx, by]) = (a.at, b.at);
        let zero = f32x16::splat(ax.simd, 0.0);
        let opposite = (ax * bx + ay * by).lt(zero) & valid;
        let (low_a, low_b) = (ay.lt(zero), by.lt(zero));
        let across = (low_a ^ low_b) & valid;
        let (mut more, mut less) = (0, 0);
        if across | opposite != 0 {
            // Within a right angle, past the axis where angles jump only if all to the left of the centre.
            let left = across & !opposite & ax.lt(zero) & bx.lt(zero);
            (more, less) = (left & low_b, left & low_a);
            if opposite != 0 {
                let lit = block.lit(edge);
                let (down, up) = (opposite & across & low_b, opposite & across & low_a);
                // Both on one side of the axis: half a turn, one way around or the other.
                let drawn = (bx.lt(ax) & !low_a) | (ax.lt(bx) & low_a);
                let wrong = opposite & !across & (drawn ^ lit);
                more |= (down & lit) | (wrong & lit);
                less |= (up & !lit) | (wrong & !lit);
            }
        }
        Inner {
            twice_triangle: ax * by - ay * bx,
            more,
            less,
        }
    }
}

/// An edge as sixteen receivers see it on the light.
pub(super) struct EdgeOnLight<S: Simd> {
    /// Its distance from the centre.
    h: f32x16<S>,
    /// Its direction, unit length.
    direction: [f32x16<S>; 2],
    /// Its point nearest to the centre.
    foot: [f32x16<S>; 2],
    /// Where the edge starts and ends, from that point.
    from: f32x16<S>,
    to: f32x16<S>,
    /// Lanes in which the edge is between receiver and light and its line crosses a circle around the light.
    valid: u16,
}

/// An [`EdgeOnLight`] in memory.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stored {
    rows: [Row; 7],
    valid: u16,
}

impl Stored {
    /// Writes an edge.
    #[inline(always)]
    pub(super) fn set<S: Simd>(&mut self, line: &EdgeOnLight<S>) {
        let [h, from, to, dx, dy, fx, fy] = &mut self.rows;
        h.set(line.h);
        from.set(line.from);
        to.set(line.to);
        dx.set(line.direction[0]);
        dy.set(line.direction[1]);
        fx.set(line.foot[0]);
        fy.set(line.foot[1]);
        self.valid = line.valid;
    }

    /// Reads it.
    #[inline(always)]
    pub(super) fn line<S: Simd>(&self, simd: S) -> EdgeOnLight<S> {
        let [h, from, to, dx, dy, fx, fy] = &self.rows;
        EdgeOnLight {
            h: h.load(simd),
            direction: [dx.load(simd), dy.load(simd)],
            foot: [fx.load(simd), fy.load(simd)],
            from: from.load(simd),
            to: to.load(simd),
            valid: self.valid,
        }
    }
}

impl<S: Simd> EdgeOnLight<S> {
    /// The edge from `a` to `b`, `edge` apart, for the lanes `wanted`; `None` if it adds nothing to any.
    #[inline(always)]
    pub(super) fn new(
        simd: S,
        block: &ReceiverBlock,
        a: &VertexOnLight<S>,
        b: &VertexOnLight<S>,
        edge: [f32; 3],
        wanted: u16,
        square: bool,
    ) -> Option<Self> {
        let (qa, qb) = (a.q, b.q);
        let qe = block.draw(
            simd,
            [
                f32x16::splat(simd, edge[0]),
                f32x16::splat(simd, edge[1]),
                f32x16::splat(simd, edge[2]),
            ],
        );
        // The line through both ends in homogeneous coordinates, from the edge vector and not the other
        // end, so that it stays accurate for short edges.
        let lx = qa[1] * qe[2] - qa[2] * qe[1];
        let ly = qa[2] * qe[0] - qa[0] * qe[2];
        let lz = qa[0] * qe[1] - qa[1] * qe[0];
        let length = lx * lx + ly * ly;
        // The square reaches to √2.
        let reach = f32x16::splat(simd, if square { 2.0 } else { 1.0 });
        let near = (lz * lz).lt(length * reach);
        let valid = wanted & (a.ahead | b.ahead) & (a.before | b.before) & near;
        if valid == 0 {
            return None;
        }
        // One division instead of three, which take longer than all the rest.
        let root = length.greater(f32::MIN_POSITIVE).sqrt();
        let near = f32x16::splat(simd, NEAREST);
        let za = qa[2].greater(near).where_bits(a.ahead, 1.0);
        let zb = qb[2].greater(near).where_bits(b.ahead, 1.0);
        let both = za * zb;
        let inverse = 1.0 / (both * root);
        let scale = both * inverse;
        let (lx, ly, lz) = (lx * scale, ly * scale, lz * scale);
        let zero = f32x16::splat(simd, 0.0);
        let direction = [ly, zero - lx];
        let along_a = qa[0] * direction[0] + qa[1] * direction[1];
        let along_b = qb[0] * direction[0] + qb[1] * direction[1];
        // What is behind the receiver starts or ends infinitely far away.
        let root = root * inverse;
        let from = along_a * (zb * root);
        let to = along_b * (za * root);
        Some(EdgeOnLight {
            h: lz.abs(),
            direction,
            foot: [zero - lz * lx, zero - lz * ly],
            from: from.where_bits(a.ahead, -FAR),
            to: to.where_bits(b.ahead, FAR),
            valid,
        })
    }

    /// Fraction of the light in the edge's sector beyond it; `shadow_side`: lanes that have the centre to its right.
    #[inline(always)]
    pub(super) fn beyond(
        &self,
        square: bool,
        polygon: Option<&FlatPolygon>,
        shadow_side: u16,
    ) -> f32x16<S> {
        let beyond = if let Some(polygon) = polygon {
            beyond_in_polygon(self, polygon, shadow_side)
        } else if square {
            beyond_in_square(self)
        } else {
            beyond_in_disk(self)
        };
        beyond.where_bits(self.valid, 0.0)
    }
}

/// Fraction of the unit disk in the edge's sector beyond it.
#[inline(always)]
fn beyond_in_disk<S: Simd>(line: &EdgeOnLight<S>) -> f32x16<S> {
    let h = line.h;
    let half = (1.0 - h * h).greater(0.0).sqrt();
    let low = 0.0 - half;
    let t0 = line.from.greater(low).lesser(half);
    let t1 = line.to.greater(low).lesser(half);
    let triangle = h * (t1 - t0).greater(0.0);
    let angle = angle(triangle, h * h + t0 * t1);
    let area = (angle - triangle).greater(0.0);
    let area = area * (0.5 / PI);
    area.where_bits(t0.lt(t1), 0.0)
}

/// Where an edge enters the square [-1, 1]² and leaves it.
#[inline(always)]
fn within_square<S: Simd>(line: &EdgeOnLight<S>) -> [f32x16<S>; 2] {
    let (mut t0, mut t1) = (line.from, line.to);
    // A line along a side leaves the slab nowhere: so far away that it does not matter.
    let slope = |d: f32x16<S>| {
        let least = f32x16::splat(d.simd, 1.0 / FAR);
        d.abs().simd_lt(least).select(least, d)
    };
    let [dx, dy] = line.direction.map(slope);
    let inverse = 1.0 / (dx * dy);
    for (axis, inverse) in [dy * inverse, dx * inverse].into_iter().enumerate() {
        let f = line.foot[axis];
        let low = (-1.0 - f) * inverse;
        let high = (1.0 - f) * inverse;
        t0 = t0.greater(low.lesser(high));
        t1 = t1.lesser(low.greater(high));
    }
    [t0, t1]
}

/// Fraction of the polygon in the edge's sector beyond it.
///
/// Where rounding has the centre on the other side of the edge than its exact one, the edge goes through the centre:
/// other than of a square or a disk, what lies on either side is not half of the light.
#[inline(always)]
fn beyond_in_polygon<S: Simd>(
    line: &EdgeOnLight<S>,
    polygon: &FlatPolygon,
    shadow_side: u16,
) -> f32x16<S> {
    let [t0, t1] = within_square(line);
    let [dx, dy] = line.direction;
    let along = line.foot[0] * dy - line.foot[1] * dx;
    let h = (0.0 - along).where_bits(shadow_side, along).greater(0.0);
    let beyond = polygon.beyond(h, line.direction, [t0, t1], shadow_side);
    beyond.where_bits(t0.lt(t1), 0.0)
}

/// Fraction of the square [-1, 1]² in the edge's sector beyond it.
#[inline(always)]
fn beyond_in_square<S: Simd>(line: &EdgeOnLight<S>) -> f32x16<S> {
    let [t0, t1] = within_square(line);
    let inside = t0.lt(t1);
    let ends = [t0, t1].map(|t| [0, 1].map(|axis| line.foot[axis] + line.direction[axis] * t));
    // Of a point in the centre any place on the border will do.
    let [m0, m1] = ends.map(|[x, y]| x.abs().greater(y.abs()).greater(NEAREST));
    let inverse = 1.0 / (m0 * m1);
    let p0 = border(ends[0], m1 * inverse);
    let p1 = border(ends[1], m0 * inverse);
    let way = (p0 - p1).abs();
    let way = way.lesser(8.0 - way);
    let area = (way - line.h * (t1 - t0)).greater(0.0);
    (area * 0.125).where_bits(inside, 0.0)
}

/// How far along the square's border, counter-clockwise from the middle of its right side, a point is seen
/// from the centre, `scale` times which is on the border; the border is 8 long.
#[inline(always)]
fn border<S: Simd>([x, y]: [f32x16<S>; 2], scale: f32x16<S>) -> f32x16<S> {
    let (ax, ay) = (x.abs(), y.abs());
    let (sx, sy) = (x * scale, y * scale);
    let right = sy;
    let left = 4.0 - sy;
    let top = 2.0 - sx;
    let bottom = 6.0 + sx;
    let horizontal = x.simd_lt(0.0).select(left, right);
    let vertical = y.simd_lt(0.0).select(bottom, top);
    ay.simd_lt(ax).select(horizontal, vertical)
}

/// Angle, 0 to π, of the direction `(cos, sin)` of any length, `sin >= 0`; wrong by at most 1e-7
/// (Abramowitz and Stegun 4.4.49, and rounding).
#[inline(always)]
pub(super) fn angle<S: Simd>(sin: f32x16<S>, cos: f32x16<S>) -> f32x16<S> {
    let c = cos.abs();
    let (small, large) = (sin.lesser(c), sin.greater(c).greater(f32::MIN_POSITIVE));
    let x = small / large;
    let x2 = x * x;
    // Pairs of terms, pairs of pairs, …: the next edge's work cannot start as long as this one's waits.
    let x4 = x2 * x2;
    let x8 = x4 * x4;
    let pair = |low: f32, high: f32| low + high * x2;
    let low = pair(1.0, -0.333_331_45) + pair(0.199_935_51, -0.142_089) * x4;
    let high = pair(0.106_562_64, -0.075_289_64) + pair(0.042_909_614, -0.016_165_737) * x4;
    let p = low + (high + 0.002_866_225_7 * x8) * x8;
    let first = p * x;
    let pi = PI;
    let octant = c.simd_lt(sin).select(0.5 * pi - first, first);
    cos.simd_lt(0.0).select(pi - octant, octant)
}
