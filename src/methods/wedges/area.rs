//! The `light` falloff: the part of the light that an edge cuts off, in closed form.
//!
//! Seen from a receiver, the silhouette is drawn onto the light, and the light that it covers is summed
//! edge by edge (Green's theorem in polar coordinates about the light's centre `o`): with `H` the layers
//! that hide the centre, a contour covers
//!
//! ```text
//!     H + Σ ± |part of the light in the sector of the edge, beyond the edge as seen from o|
//! ```
//!
//! positive where the receiver is on the lit side of the plane through the edge and `o`, negative on the
//! other. An edge that does not cross the light as the receiver sees it adds nothing: the receivers where
//! it does are the edge's penumbra wedge. For one long edge this is the area that a line cuts off. The sum
//! needs no side planes and has no seams: at a vertex the neighbours' sectors meet, however many edges
//! there are, and an edge that points at the light spans no sector.
//!
//! For a line at distance `h` from `o` and its part from `t0` to `t1` within the light, the area beyond is
//! the light's sector less the triangle `h (t1 - t0) / 2`. The sector of a disk is half an angle; of a
//! square with half-edge 1, half the way along its border. A rectangle is a square and a sphere a disk in
//! coordinates of their own: per receiver a matrix maps directions to homogeneous coordinates on the light
//! (for a sphere, on the disk that its outline spans).

use glam::DVec3;

use super::contour::Edge;
use crate::light::{Light, Shape};
use crate::simd::{LANES, Lanes, Row, detect, dispatch};

/// Sixteen receivers.
#[derive(Debug, Clone, Default)]
pub struct Block {
    /// Local positions; `f64`, so that differences to vertices in contact are exact to `f32`.
    position: [[f64; LANES]; 3],
    /// From directions to homogeneous coordinates on the light, by rows.
    matrix: [[Row; 3]; 3],
    /// What the last row gives at the light's centre: silhouettes farther away do not occlude.
    far: Row,
    /// Room for what happens between the two steps of [`cover`].
    lines: [Stored; BATCH],
}

/// An edge as the kernel wants it.
#[derive(Debug, Clone, Copy)]
pub struct AreaEdge {
    ends: [[f64; 3]; 2],
    normal: [f64; 3],
    offset: f64,
    front: f32,
    back: f32,
}

/// The part of an edge in front of a flat light; `None` if there is none.
fn in_front(light: &Light, ends: [DVec3; 2]) -> Option<[DVec3; 2]> {
    let Some(n) = light.normal() else {
        return Some(ends);
    };
    let [a, b] = ends;
    let (za, zb) = (n.dot(a - light.center()), n.dot(b - light.center()));
    let cut = || a + (b - a) * (za / (za - zb));
    match (za > 0.0, zb > 0.0) {
        (true, true) => Some(ends),
        (true, false) => Some([a, cut()]),
        (false, true) => Some([cut(), b]),
        (false, false) => None,
    }
}

impl AreaEdge {
    /// Prepares an edge; one behind a flat light does not count.
    pub fn new(edge: &Edge, light: &Light, normal: DVec3, offset: f64) -> Self {
        let part = in_front(light, edge.ends);
        let weight = |layers: i32| part.map_or(0.0, |_| layers as f32);
        AreaEdge {
            ends: part.unwrap_or(edge.ends).map(|v| v.to_array()),
            normal: normal.to_array(),
            offset,
            front: weight(edge.front),
            back: weight(edge.back),
        }
    }
}

impl Block {
    /// Fills the lanes; what is left over repeats the first receiver.
    pub fn set(&mut self, frame: &LightFrame, receivers: &[DVec3]) {
        for lane in 0..LANES {
            let p = receivers[if lane < receivers.len() { lane } else { 0 }];
            let (rows, far) = frame.matrix(p);
            for axis in 0..3 {
                self.position[axis][lane] = p[axis];
                for (row, value) in rows.iter().enumerate() {
                    self.matrix[row][axis].0[lane] = value[axis] as f32;
                }
            }
            self.far.0[lane] = far as f32;
        }
    }
}

/// A light's own coordinates, in which it is the unit disk or the square [-1, 1]².
#[derive(Debug, Clone, Copy)]
pub enum LightFrame {
    /// A sphere: a disk towards each receiver.
    Sphere {
        /// Centre.
        center: DVec3,
        /// Radius.
        radius: f64,
    },
    /// A disk or a rectangle, by the dual basis of its half-axes.
    Flat {
        /// Centre.
        center: DVec3,
        /// From a point to its first coordinate.
        u: DVec3,
        /// To its second.
        v: DVec3,
        /// To its distance from the light's plane.
        n: DVec3,
        /// Whether it is a rectangle.
        square: bool,
    },
}

impl LightFrame {
    /// Of a light with a width.
    pub fn new(light: &Light) -> Self {
        match light.shape {
            Shape::Sphere { center, radius } => LightFrame::Sphere { center, radius },
            Shape::Disk {
                center,
                normal,
                radius,
            } => {
                let e = normal.any_orthonormal_vector();
                LightFrame::Flat {
                    center,
                    u: e / radius,
                    v: normal.cross(e) / radius,
                    n: normal,
                    square: false,
                }
            }
            Shape::Rect { center, u, v } => {
                let n = u.cross(v);
                let area = n.length_squared();
                LightFrame::Flat {
                    center,
                    u: 2.0 * v.cross(n) / area,
                    v: 2.0 * n.cross(u) / area,
                    n: n / area.sqrt(),
                    square: true,
                }
            }
        }
    }

    /// Rows of the matrix from directions at `p` to homogeneous coordinates on the light, and the last
    /// coordinate beyond which geometry is behind the light.
    fn matrix(&self, p: DVec3) -> ([DVec3; 3], f64) {
        match *self {
            LightFrame::Sphere { center, radius } => {
                let d = center - p;
                let distance = d.length();
                let axis = d / distance;
                let e = axis.any_orthonormal_vector();
                // Cotangent of the half-angle of the cone in which the light is seen; inside it, anything.
                let cot = (distance * distance - radius * radius).max(0.0).sqrt() / radius;
                ([e * cot, axis.cross(e) * cot, axis], distance)
            }
            LightFrame::Flat {
                center, u, v, n, ..
            } => {
                let d = p - center;
                // The ray p + t w meets the light's plane at t = -(d·n) / (w·n).
                let (x, y, z) = (u.dot(d), v.dot(d), n.dot(d));
                ([z * u - x * n, z * v - y * n, -n], f64::INFINITY)
            }
        }
    }
}

/// Adds what the edges `ids` cover for a block: front layers and back layers. `steps` is the number of
/// intensities that an edge's share is rounded to, 0 for none.
pub fn cover(
    frame: &LightFrame,
    edges: &[AreaEdge],
    ids: &[u32],
    block: &mut Block,
    steps: f32,
    out: &mut [Row; 2],
) {
    let square = matches!(frame, LightFrame::Flat { square: true, .. });
    dispatch!(detect() => cover_lanes(
        square: bool, edges: &[AreaEdge], ids: &[u32], block: &mut Block, steps: f32, out: &mut [Row; 2],
    ));
}

/// Stands for infinitely far along a line on the light, whose half-width is 1.
const FAR: f32 = 1e9;

/// Distances from a receiver below this, in local units, count as this: products of two and a line's length
/// stay normal numbers, and vertices are known to a hundred times as much at best.
const NEAREST: f32 = 1e-9;

#[inline(always)]
unsafe fn cover_lanes<S: Lanes>(
    square: bool,
    edges: &[AreaEdge],
    ids: &[u32],
    block: &mut Block,
    steps: f32,
    out: &mut [Row; 2],
) {
    // SAFETY: the caller enabled the features of `S`; so for all calls below.
    unsafe {
        let mut front = S::load(&out[0]);
        let mut back = S::load(&out[1]);
        for ids in ids.chunks(BATCH) {
            let mut count = 0;
            for &id in ids {
                let edge = &edges[id as usize];
                if let Some(line) = line_on_light::<S>(block, edge, square) {
                    block.lines[count].set(&line, edge);
                    count += 1;
                }
            }
            for stored in &block.lines[..count] {
                let line = stored.line::<S>();
                let beyond = if square {
                    beyond_in_square::<S>(&line)
                } else {
                    beyond_in_disk::<S>(&line)
                };
                let beyond = beyond.select(line.valid, S::splat(0.0));
                let beyond = if steps > 0.0 {
                    let magic = S::splat(12_582_912.0);
                    let rounded = beyond.mul(S::splat(steps)).add(magic).sub(magic);
                    rounded.div(S::splat(steps))
                } else {
                    beyond
                };
                let signed = S::splat(0.0).sub(beyond).select(line.shadow_side, beyond);
                front = front.add(signed.mul(S::splat(stored.front)));
                back = back.add(signed.mul(S::splat(stored.back)));
            }
        }
        front.store(&mut out[0]);
        back.store(&mut out[1]);
    }
}

/// Edges that are first all drawn onto the light and then all measured: each step for an edge is a chain of
/// operations that wait for each other, and a processor looks only so many instructions ahead for others.
/// Few enough to stay in the nearest cache.
const BATCH: usize = 16;

/// A [`Line`] in memory, and the layers that it counts.
#[derive(Debug, Clone, Copy, Default)]
struct Stored {
    rows: [Row; 7],
    valid: u16,
    shadow_side: u16,
    front: f32,
    back: f32,
}

impl Stored {
    #[inline(always)]
    unsafe fn set<S: Lanes>(&mut self, line: &Line<S>, edge: &AreaEdge) {
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
        (self.valid, self.shadow_side) = (line.valid, line.shadow_side);
        (self.front, self.back) = (edge.front, edge.back);
    }

    #[inline(always)]
    unsafe fn line<S: Lanes>(&self) -> Line<S> {
        // SAFETY: the caller enabled the features of `S`.
        let [h, from, to, dx, dy, fx, fy] = self.rows.each_ref().map(|r| unsafe { S::load(r) });
        Line {
            h,
            direction: [dx, dy],
            foot: [fx, fy],
            from,
            to,
            valid: self.valid,
            shadow_side: self.shadow_side,
        }
    }
}

/// An edge as sixteen receivers see it on the light.
struct Line<S> {
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
    /// Lanes whose receiver is on the shadow side of the plane through edge and centre.
    shadow_side: u16,
}

#[inline(always)]
unsafe fn line_on_light<S: Lanes>(block: &Block, edge: &AreaEdge, square: bool) -> Option<Line<S>> {
    // SAFETY: the caller enabled the features of `S`; so for all calls below.
    unsafe {
        let mut a = [Row::default(); 3];
        let e: [f32; 3] = std::array::from_fn(|i| (edge.ends[1][i] - edge.ends[0][i]) as f32);
        let [x, y, z] = &block.position;
        for i in 0..LANES {
            a[0].0[i] = (edge.ends[0][0] - x[i]) as f32;
            a[1].0[i] = (edge.ends[0][1] - y[i]) as f32;
            a[2].0[i] = (edge.ends[0][2] - z[i]) as f32;
        }
        let (ax, ay, az) = (S::load(&a[0]), S::load(&a[1]), S::load(&a[2]));
        let (ex, ey, ez) = (S::splat(e[0]), S::splat(e[1]), S::splat(e[2]));
        let m = &block.matrix;
        let qa = [
            row::<S>(&m[0], ax, ay, az),
            row::<S>(&m[1], ax, ay, az),
            row::<S>(&m[2], ax, ay, az),
        ];
        let qe = [
            row::<S>(&m[0], ex, ey, ez),
            row::<S>(&m[1], ex, ey, ez),
            row::<S>(&m[2], ex, ey, ez),
        ];
        let qb = [qa[0].add(qe[0]), qa[1].add(qe[1]), qa[2].add(qe[2])];
        let zero = S::splat(0.0);
        let (ahead_a, ahead_b) = (zero.lt(qa[2]), zero.lt(qb[2]));
        let far = S::load(&block.far);
        let before = qa[2].lt(far) | qb[2].lt(far);
        // The line through both ends in homogeneous coordinates, from the edge vector and not the other
        // end, so that it stays accurate for short edges.
        let lx = qa[1].mul(qe[2]).sub(qa[2].mul(qe[1]));
        let ly = qa[2].mul(qe[0]).sub(qa[0].mul(qe[2]));
        let lz = qa[0].mul(qe[1]).sub(qa[1].mul(qe[0]));
        let length = lx.mul(lx).add(ly.mul(ly));
        // The square reaches to √2.
        let reach = S::splat(if square { 2.0 } else { 1.0 });
        let near = lz.mul(lz).lt(length.mul(reach));
        let valid = (ahead_a | ahead_b) & before & near;
        if valid == 0 {
            return None;
        }
        let mut side = Row::default();
        for i in 0..LANES {
            let n = &edge.normal;
            let value = n[0] * x[i] + n[1] * y[i] + n[2] * z[i] - edge.offset;
            side.0[i] = if value < 0.0 { -1.0 } else { 1.0 };
        }
        // One division instead of three, which take longer than all the rest.
        let root = length.max(S::splat(f32::MIN_POSITIVE)).sqrt();
        let near = S::splat(NEAREST);
        let za = qa[2].max(near).select(ahead_a, S::splat(1.0));
        let zb = qb[2].max(near).select(ahead_b, S::splat(1.0));
        let both = za.mul(zb);
        let inverse = S::splat(1.0).div(both.mul(root));
        let scale = both.mul(inverse);
        let (lx, ly, lz) = (lx.mul(scale), ly.mul(scale), lz.mul(scale));
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
            from: from.select(ahead_a, S::splat(-FAR)),
            to: to.select(ahead_b, S::splat(FAR)),
            valid,
            shadow_side: S::load(&side).lt(zero),
        })
    }
}

#[inline(always)]
unsafe fn row<S: Lanes>(m: &[Row; 3], x: S, y: S, z: S) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let (a, b, c) = (S::load(&m[0]), S::load(&m[1]), S::load(&m[2]));
        a.mul(x).add(b.mul(y)).add(c.mul(z))
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
        let area = area.mul(S::splat(0.5 / std::f32::consts::PI));
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
        let pi = std::f32::consts::PI;
        let octant = S::splat(0.5 * pi).sub(first).select(c.lt(sin), first);
        S::splat(pi)
            .sub(octant)
            .select(cos.lt(S::splat(0.0)), octant)
    }
}
