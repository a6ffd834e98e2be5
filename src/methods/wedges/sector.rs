//! Vertices and edges as sixteen receivers see them on the light, and what lies in their sectors.
//!
//! The light is the unit disk or the square [-1, 1]² in coordinates of its own, with its centre at the origin.

use std::f32::consts::PI;

use super::block::Block;
use super::edge::{AreaEdge, Split};
use crate::simd::{Lanes, Row};

/// Stands for infinitely far along a line on the light, whose half-width is 1.
const FAR: f32 = 1e9;

/// Distances from a receiver below this, in local units, count as this: products of two and a line's length
/// stay normal numbers, and vertices are known to a hundred times as much at best.
const NEAREST: f32 = 1e-9;

/// A vertex as sixteen receivers see it on the light.
#[derive(Clone, Copy)]
pub(super) struct Seen<S> {
    /// Homogeneous coordinates.
    q: [S; 3],
    /// Coordinates on the light.
    at: [S; 2],
    /// Its distance from the centre: squared, or on the square the larger of its coordinates.
    away: S,
    /// Lanes in which the last coordinate is positive.
    ahead: u16,
    /// Lanes in which it is not behind the light.
    before: u16,
    /// Lanes in which it hides a point of the light.
    pub(super) inside: u16,
}

impl<S: Lanes> Seen<S> {
    /// Draws a vertex.
    ///
    /// # Safety
    /// The features of `S` are enabled; so for all functions of this module.
    #[inline(always)]
    pub(super) unsafe fn new(block: &Block, vertex: &Split, square: bool) -> Self {
        // SAFETY: the caller enabled the features of `S`; so for all calls below.
        unsafe {
            let zero = S::splat(0.0);
            let mut from = [zero; 3];
            for (axis, [high, low]) in block.position.iter().enumerate() {
                let difference = S::splat(vertex.high[axis]).sub(S::load(high));
                from[axis] = difference.add(S::splat(vertex.low[axis]).sub(S::load(low)));
            }
            let q = block.draw(from);
            let inverse = S::splat(1.0).div(q[2].max(S::splat(NEAREST)));
            let [x, y] = [q[0].mul(inverse), q[1].mul(inverse)];
            let away = if square {
                x.abs().max(y.abs())
            } else {
                x.mul(x).add(y.mul(y))
            };
            let (ahead, before) = (zero.lt(q[2]), q[2].lt(S::load(&block.far)));
            Seen {
                q,
                at: [x, y],
                away,
                ahead,
                before,
                inside: ahead & before & away.lt(S::splat(1.0)),
            }
        }
    }

    /// Lanes in which an edge from here to `b` surely hides no point of the light.
    #[inline(always)]
    pub(super) unsafe fn misses(&self, b: &Self, square: bool) -> u16 {
        // SAFETY: the caller enabled the features of `S`; so for all calls below.
        unsafe {
            let ([ax, ay], [bx, by]) = (self.at, b.at);
            let one = S::splat(1.0);
            let away = if square {
                // Both ends beyond one side.
                let zero = S::splat(0.0);
                let (high, low) = (ax.min(bx).max(ay.min(by)), ax.max(bx).min(ay.max(by)));
                one.le(high.max(zero.sub(low)))
            } else {
                // Both ends are outside, and the nearer one is the edge's nearest point.
                let nearer = self.away.min(b.away);
                one.le(nearer) & nearer.le(ax.mul(bx).add(ay.mul(by)))
            };
            away & self.ahead & b.ahead
        }
    }

    /// How far around the centre it is seen, counter-clockwise from the first axis: from minus to plus half of
    /// [`turn`].
    #[inline(always)]
    pub(super) unsafe fn around(&self, square: bool) -> S {
        // SAFETY: the caller enabled the features of `S`; so for all calls below.
        unsafe {
            let [x, y] = self.at;
            let zero = S::splat(0.0);
            let below = y.lt(zero);
            if square {
                let far = x.abs().max(y.abs()).max(S::splat(NEAREST));
                let way = border::<S>(self.at, S::splat(1.0).div(far));
                way.sub(S::splat(8.0))
                    .select(below & S::splat(1.0).lt(way), way)
            } else {
                let angle = angle::<S>(y.abs(), x);
                zero.sub(angle).select(below, angle)
            }
        }
    }
}

/// All the way around the centre, as [`Seen::around`] and [`Inner::twice_triangle`] measure it: the way along
/// the square's border, or radians.
pub(super) fn turn(square: bool) -> f32 {
    if square { 8.0 } else { 2.0 * PI }
}

/// An edge between two vertices that both hide points of the light.
pub(super) struct Inner<S> {
    /// Twice the area of the triangle of edge and centre, positive if counter-clockwise.
    pub(super) twice_triangle: S,
    /// Lanes in which the way from the first vertex's [`Seen::around`] to the second's is a turn more, or less.
    pub(super) more: u16,
    /// See `more`.
    pub(super) less: u16,
}

impl<S: Lanes> Inner<S> {
    /// The edge from `a` to `b` for the lanes `valid`.
    ///
    /// Receivers on the lit side of the plane through edge and light's centre see it run counter-clockwise.
    /// Where rounding might say otherwise, and change the sum by a layer, their exact side decides.
    #[inline(always)]
    pub(super) unsafe fn new(
        a: &Seen<S>,
        b: &Seen<S>,
        valid: u16,
        block: &Block,
        edge: &AreaEdge,
    ) -> Self {
        // SAFETY: the caller enabled the features of `S`; so for all calls below.
        unsafe {
            let zero = S::splat(0.0);
            let ([ax, ay], [bx, by]) = (a.at, b.at);
            let opposite = ax.mul(bx).add(ay.mul(by)).lt(zero) & valid;
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
                twice_triangle: ax.mul(by).sub(ay.mul(bx)),
                more,
                less,
            }
        }
    }
}

/// An edge as sixteen receivers see it on the light.
pub(super) struct Line<S> {
    /// Its distance from the centre.
    h: S,
    /// Its direction, unit length.
    direction: [S; 2],
    /// Its point nearest to the centre.
    foot: [S; 2],
    /// Where the edge starts and ends, from that point.
    from: S,
    to: S,
    /// Lanes in which the edge is between receiver and light and its line crosses a circle around the light.
    valid: u16,
}

/// A [`Line`] in memory.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stored {
    rows: [Row; 7],
    valid: u16,
}

impl Stored {
    /// Writes an edge.
    ///
    /// # Safety
    /// The features of `S` are enabled.
    #[inline(always)]
    pub(super) unsafe fn set<S: Lanes>(&mut self, line: &Line<S>) {
        let [h, from, to, dx, dy, fx, fy] = &mut self.rows;
        // SAFETY: the caller enabled the features of `S`; so for all calls below.
        unsafe {
            line.h.store(h);
            line.from.store(from);
            line.to.store(to);
            line.direction[0].store(dx);
            line.direction[1].store(dy);
            line.foot[0].store(fx);
            line.foot[1].store(fy);
        }
        self.valid = line.valid;
    }

    /// Reads it.
    ///
    /// # Safety
    /// The features of `S` are enabled.
    #[inline(always)]
    pub(super) unsafe fn line<S: Lanes>(&self) -> Line<S> {
        let [h, from, to, dx, dy, fx, fy] = &self.rows;
        // SAFETY: the caller enabled the features of `S`; so for all calls below.
        unsafe {
            Line {
                h: S::load(h),
                direction: [S::load(dx), S::load(dy)],
                foot: [S::load(fx), S::load(fy)],
                from: S::load(from),
                to: S::load(to),
                valid: self.valid,
            }
        }
    }
}

impl<S: Lanes> Line<S> {
    /// The edge from `a` to `b`, `edge` apart, for the lanes `wanted`; `None` if it adds nothing to any.
    #[inline(always)]
    pub(super) unsafe fn new(
        block: &Block,
        a: &Seen<S>,
        b: &Seen<S>,
        edge: [f32; 3],
        wanted: u16,
        square: bool,
    ) -> Option<Self> {
        // SAFETY: the caller enabled the features of `S`; so for all calls below.
        unsafe {
            let (qa, qb) = (a.q, b.q);
            let qe = block.draw([S::splat(edge[0]), S::splat(edge[1]), S::splat(edge[2])]);
            // The line through both ends in homogeneous coordinates, from the edge vector and not the other
            // end, so that it stays accurate for short edges.
            let lx = qa[1].mul(qe[2]).sub(qa[2].mul(qe[1]));
            let ly = qa[2].mul(qe[0]).sub(qa[0].mul(qe[2]));
            let lz = qa[0].mul(qe[1]).sub(qa[1].mul(qe[0]));
            let length = lx.mul(lx).add(ly.mul(ly));
            // The square reaches to √2.
            let reach = S::splat(if square { 2.0 } else { 1.0 });
            let near = lz.mul(lz).lt(length.mul(reach));
            let valid = wanted & (a.ahead | b.ahead) & (a.before | b.before) & near;
            if valid == 0 {
                return None;
            }
            // One division instead of three, which take longer than all the rest.
            let root = length.max(S::splat(f32::MIN_POSITIVE)).sqrt();
            let near = S::splat(NEAREST);
            let za = qa[2].max(near).select(a.ahead, S::splat(1.0));
            let zb = qb[2].max(near).select(b.ahead, S::splat(1.0));
            let both = za.mul(zb);
            let inverse = S::splat(1.0).div(both.mul(root));
            let scale = both.mul(inverse);
            let (lx, ly, lz) = (lx.mul(scale), ly.mul(scale), lz.mul(scale));
            let zero = S::splat(0.0);
            let direction = [ly, zero.sub(lx)];
            let along_a = qa[0].mul(direction[0]).add(qa[1].mul(direction[1]));
            let along_b = qb[0].mul(direction[0]).add(qb[1].mul(direction[1]));
            // What is behind the receiver starts or ends infinitely far away.
            let root = root.mul(inverse);
            let from = along_a.mul(zb.mul(root));
            let to = along_b.mul(za.mul(root));
            Some(Line {
                h: lz.abs(),
                direction,
                foot: [zero.sub(lz.mul(lx)), zero.sub(lz.mul(ly))],
                from: from.select(a.ahead, S::splat(-FAR)),
                to: to.select(b.ahead, S::splat(FAR)),
                valid,
            })
        }
    }

    /// Fraction of the light in the edge's sector beyond it.
    #[inline(always)]
    pub(super) unsafe fn beyond(&self, square: bool) -> S {
        // SAFETY: the caller enabled the features of `S`; so for all calls below.
        unsafe {
            let beyond = if square {
                beyond_in_square::<S>(self)
            } else {
                beyond_in_disk::<S>(self)
            };
            beyond.select(self.valid, S::splat(0.0))
        }
    }
}

/// Fraction of the unit disk in the edge's sector beyond it.
#[inline(always)]
unsafe fn beyond_in_disk<S: Lanes>(line: &Line<S>) -> S {
    // SAFETY: the caller enabled the features of `S`; so for all calls below.
    unsafe {
        let h = line.h;
        let half = S::splat(1.0).sub(h.mul(h)).max(S::splat(0.0)).sqrt();
        let low = S::splat(0.0).sub(half);
        let t0 = line.from.max(low).min(half);
        let t1 = line.to.max(low).min(half);
        let triangle = h.mul(t1.sub(t0).max(S::splat(0.0)));
        let angle = angle::<S>(triangle, h.mul(h).add(t0.mul(t1)));
        let area = angle.sub(triangle).max(S::splat(0.0));
        let area = area.mul(S::splat(0.5 / PI));
        area.select(t0.lt(t1), S::splat(0.0))
    }
}

/// Fraction of the square [-1, 1]² in the edge's sector beyond it.
#[inline(always)]
unsafe fn beyond_in_square<S: Lanes>(line: &Line<S>) -> S {
    // SAFETY: the caller enabled the features of `S`; so for all calls below.
    unsafe {
        let (mut t0, mut t1) = (line.from, line.to);
        // A line along a side leaves the slab nowhere: so far away that it does not matter.
        let slope = |d: S| S::splat(1.0 / FAR).select(d.abs().lt(S::splat(1.0 / FAR)), d);
        let [dx, dy] = line.direction.map(slope);
        let inverse = S::splat(1.0).div(dx.mul(dy));
        for (axis, inverse) in [dy.mul(inverse), dx.mul(inverse)].into_iter().enumerate() {
            let f = line.foot[axis];
            let low = S::splat(-1.0).sub(f).mul(inverse);
            let high = S::splat(1.0).sub(f).mul(inverse);
            t0 = t0.max(low.min(high));
            t1 = t1.min(low.max(high));
        }
        let inside = t0.lt(t1);
        let ends =
            [t0, t1].map(|t| [0, 1].map(|axis| line.foot[axis].add(line.direction[axis].mul(t))));
        // Of a point in the centre any place on the border will do.
        let [m0, m1] = ends.map(|[x, y]| x.abs().max(y.abs()).max(S::splat(NEAREST)));
        let inverse = S::splat(1.0).div(m0.mul(m1));
        let p0 = border::<S>(ends[0], m1.mul(inverse));
        let p1 = border::<S>(ends[1], m0.mul(inverse));
        let way = p0.sub(p1).abs();
        let way = way.min(S::splat(8.0).sub(way));
        let area = way.sub(line.h.mul(t1.sub(t0))).max(S::splat(0.0));
        area.mul(S::splat(0.125)).select(inside, S::splat(0.0))
    }
}

/// How far along the square's border, counter-clockwise from the middle of its right side, a point is seen
/// from the centre, `scale` times which is on the border; the border is 8 long.
#[inline(always)]
unsafe fn border<S: Lanes>([x, y]: [S; 2], scale: S) -> S {
    // SAFETY: the caller enabled the features of `S`; so for all calls below.
    unsafe {
        let (ax, ay) = (x.abs(), y.abs());
        let (sx, sy) = (x.mul(scale), y.mul(scale));
        let zero = S::splat(0.0);
        let right = sy;
        let left = S::splat(4.0).sub(sy);
        let top = S::splat(2.0).sub(sx);
        let bottom = S::splat(6.0).add(sx);
        let horizontal = left.select(x.lt(zero), right);
        let vertical = bottom.select(y.lt(zero), top);
        horizontal.select(ay.lt(ax), vertical)
    }
}

/// Angle, 0 to π, of the direction `(cos, sin)` of any length, `sin >= 0`; wrong by at most 1e-7
/// (Abramowitz and Stegun 4.4.49, and rounding).
#[inline(always)]
pub(super) unsafe fn angle<S: Lanes>(sin: S, cos: S) -> S {
    // SAFETY: the caller enabled the features of `S`; so for all calls below.
    unsafe {
        let c = cos.abs();
        let (small, large) = (sin.min(c), sin.max(c).max(S::splat(f32::MIN_POSITIVE)));
        let x = small.div(large);
        let x2 = x.mul(x);
        // Pairs of terms, pairs of pairs, …: the next edge's work cannot start as long as this one's waits.
        let x4 = x2.mul(x2);
        let x8 = x4.mul(x4);
        let pair = |low: f32, high: f32| S::splat(low).add(S::splat(high).mul(x2));
        let low = pair(1.0, -0.333_331_45).add(pair(0.199_935_51, -0.142_089).mul(x4));
        let high =
            pair(0.106_562_64, -0.075_289_64).add(pair(0.042_909_614, -0.016_165_737).mul(x4));
        let p = low.add(high.add(S::splat(0.002_866_225_7).mul(x8)).mul(x8));
        let first = p.mul(x);
        let pi = PI;
        let octant = S::splat(0.5 * pi).sub(first).select(c.lt(sin), first);
        S::splat(pi)
            .sub(octant)
            .select(cos.lt(S::splat(0.0)), octant)
    }
}
