//! The one light sampler: a scrambled (0, 2)-sequence, mapped to each light's shape.
//!
//! The first `n` points of the Sobol sequence's first two dimensions, Owen-scrambled by a hash of the
//! seed (Laine and Karras 2011; Burley 2020), so that every power of two is stratified in all
//! elementary intervals and the first `n` of `2n` samples are the samples of `n`: refining keeps what
//! was done. A receiver's own pattern flips the digits of all points by two random words, which keeps
//! the stratification and makes every sample uniform.
//!
//! Flat lights are sampled uniformly in area, spheres uniformly in the solid angle of the cap that
//! the receiver sees. Disks and caps use Shirley and Chiu's concentric map.
//!
//! Light points are moved off the light towards the receiver's side by [`POINT_OFFSET`] so that an
//! occluder that touches the light from behind does not hide it.

use glam::{DVec3, Vec3};

use crate::light::{Light, Shape};
use crate::simd::{LANES, Lanes, Row, detect, dispatch};

/// How far a light point is moved off the light, times the largest of its coordinates and 1 (local
/// units): four `f32` ulps, more than the rounding of its coordinates.
pub const POINT_OFFSET: f64 = 4.0 / (1 << 23) as f64;

/// Side of the grid of cells over a light's outline.
pub const GRID: usize = 32;

/// Below this cosine of its half-angle a sphere's cap is too wide for a grid in its tangent plane.
const WIDEST_CAP: f64 = 0.17;

/// The points of the unit square that all receivers start from, in Morton order of the grid's cells,
/// so that sixteen neighbours lie in a compact part of the light.
#[derive(Debug, Clone)]
pub struct Pattern {
    len: usize,
    /// Padded with zeros to whole rows.
    x: Vec<[u32; LANES]>,
    y: Vec<[u32; LANES]>,
    seed: u64,
}

impl Pattern {
    /// The first `n` points of the sequence with this seed.
    pub fn new(n: usize, seed: u64) -> Self {
        let (sx, sy) = (hash(seed, 0x51) as u32, hash(seed, 0x52) as u32);
        let mut points: Vec<(u32, u32)> = (0..n as u32)
            .map(|i| {
                (
                    owen_scramble(i.reverse_bits(), sx),
                    owen_scramble(sobol_second(i), sy),
                )
            })
            .collect();
        points.sort_unstable_by_key(|&(x, y)| (morton(x >> 16) | (morton(y >> 16) << 1), x, y));
        let rows = |pick: fn(&(u32, u32)) -> u32| {
            let row = |c: &[(u32, u32)]| std::array::from_fn(|i| c.get(i).map_or(0, pick));
            points.chunks(LANES).map(row).collect()
        };
        Pattern {
            len: n,
            x: rows(|p| p.0),
            y: rows(|p| p.1),
            seed,
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The digits that receiver `index` flips for its own pattern under light `light`.
    pub fn scramble(&self, light: u32, index: u32) -> [u32; 2] {
        let h = hash(
            self.seed ^ (u64::from(light) << 32),
            u64::from(index) + 0x9e37_79b9,
        );
        [h as u32, (h >> 32) as u32]
    }
}

/// How a receiver sees a light: the light's outline is the unit square or its inscribed disk in
/// `(u·q / w·q, v·q / w·q)` for directions `q` from the receiver, and `w·q` is 1 at the far end of
/// what can lie between the two.
#[derive(Debug, Clone, Copy, Default)]
pub struct View {
    /// Row of the first coordinate.
    pub u: Vec3,
    /// Row of the second coordinate.
    pub v: Vec3,
    /// Row of the homogeneous coordinate.
    pub w: Vec3,
    /// Largest number that goes into a coordinate of a light point.
    pub reach: f32,
}

/// Light points for one receiver, with the weights that its integrals need.
#[derive(Debug, Default)]
pub struct LightSamples {
    /// Number of samples; the rows behind are padded with invalid ones.
    pub count: usize,
    /// Local light points.
    pub points: [Vec<Row>; 3],
    /// Irradiance from each sample at radiance 1; 0 where it is not valid.
    pub weights: Vec<Row>,
    /// One bit a sample: above the tangent plane and emitting towards the receiver.
    pub valid: Vec<u16>,
    /// Coordinates of each sample in [`View`]'s square, which here is [-1, 1]².
    coordinates: [Vec<Row>; 2],
    /// Grid cell of each sample, row-major; filled by [`LightSamples::find_cells`].
    pub cells: Vec<[u16; LANES]>,
}

impl LightSamples {
    /// One light point.
    pub fn point(&self, i: usize) -> Vec3 {
        let (row, lane) = (i / LANES, i % LANES);
        Vec3::new(
            self.points[0][row].0[lane],
            self.points[1][row].0[lane],
            self.points[2][row].0[lane],
        )
    }

    fn resize(&mut self, count: usize) {
        let rows = count.div_ceil(LANES);
        self.count = count;
        for axis in &mut self.points {
            axis.resize(rows, Row::default());
        }
        for axis in &mut self.coordinates {
            axis.resize(rows, Row::default());
        }
        self.weights.resize(rows, Row::default());
        self.valid.resize(rows, 0);
        self.cells.resize(rows, [0; LANES]);
    }

    /// Finds the grid cell of every sample; meaningful only where the receiver has a [`View`].
    pub fn find_cells(&mut self) {
        for (r, cells) in self.cells.iter_mut().enumerate() {
            for (lane, out) in cells.iter_mut().enumerate() {
                *out = cell(
                    self.coordinates[0][r].0[lane],
                    self.coordinates[1][r].0[lane],
                );
            }
        }
    }
}

/// A light in local coordinates with what all receivers share.
#[derive(Debug, Clone)]
pub struct Sampler {
    light: Light,
    pattern: Pattern,
    number: u32,
    fixed: bool,
    /// Flat lights: centre, half edges (a disk: two radii) moved off the light, emitting normal.
    flat: Option<Flat>,
}

#[derive(Debug, Clone, Copy)]
struct Flat {
    center: DVec3,
    u: DVec3,
    v: DVec3,
    normal: DVec3,
    area: f64,
    disk: bool,
}

impl Sampler {
    /// Samples `light`, the `number`-th of a scene; `fixed`: the same points for all receivers.
    pub fn new(light: Light, number: u32, pattern: Pattern, fixed: bool) -> Self {
        let flat = light.normal().map(|normal| {
            let (low, high) = light.bounds();
            let size = low.abs().max(high.abs()).max_element().max(1.0);
            let center = light.center() + normal * (POINT_OFFSET * size);
            match light.shape {
                Shape::Disk { radius, .. } => {
                    let e1 = normal.any_orthonormal_vector();
                    let (u, v) = (e1 * radius, normal.cross(e1) * radius);
                    let area = std::f64::consts::PI * radius * radius;
                    Flat {
                        center,
                        u,
                        v,
                        normal,
                        area,
                        disk: true,
                    }
                }
                Shape::Rect { u, v, .. } => {
                    let area = u.cross(v).length();
                    Flat {
                        center,
                        u: 0.5 * u,
                        v: 0.5 * v,
                        normal,
                        area,
                        disk: false,
                    }
                }
                Shape::Sphere { .. } => unreachable!("a sphere has no normal"),
            }
        });
        Sampler {
            light,
            pattern,
            number,
            fixed,
            flat,
        }
    }

    /// The light, in local coordinates.
    pub fn light(&self) -> &Light {
        &self.light
    }

    /// A light point that every receiver shares, or on a sphere the one nearest to `p`: for a receiver to
    /// which all of the light is one.
    pub fn middle(&self, p: DVec3) -> Vec3 {
        match (self.flat, Cap::new(&self.light, p)) {
            (Some(flat), _) => flat.center.as_vec3(),
            (None, Some(cap)) => {
                let size = cap.distance + self.light.center().abs().max_element().max(1.0);
                (p + cap.axis * (cap.distance - cap.radius - POINT_OFFSET * size)).as_vec3()
            }
            (None, None) => self.light.center().as_vec3(),
        }
    }

    /// Whether the light fills the disk in its [`View`]'s square, and not the square.
    pub fn is_disk(&self) -> bool {
        self.flat.is_none_or(|flat| flat.disk)
    }

    /// Samples a receiver.
    pub fn len(&self) -> usize {
        self.pattern.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.pattern.is_empty()
    }

    /// How the receiver at `p` sees the light, or `None` where no grid can be laid over it: behind a
    /// flat light, in or close to a sphere, or where the light has no size.
    pub fn view(&self, p: DVec3) -> Option<View> {
        let (low, high) = self.light.bounds();
        let mut reach = low.abs().max(high.abs()).max_element();
        let (u, v, w) = match self.flat {
            Some(flat) => {
                let to_center = flat.center - p;
                let height = flat.normal.dot(to_center);
                if height >= 0.0 || flat.area == 0.0 {
                    return None;
                }
                let w = flat.normal / height;
                // Dual basis of the edges in the light's plane; coordinates -½ to ½ around the centre.
                let cross = flat.u.cross(flat.v);
                let scale = 0.5 / cross.length_squared();
                let (du, dv) = (flat.v.cross(cross) * scale, cross.cross(flat.u) * scale);
                let row = |d: DVec3| d + w * (0.5 - d.dot(to_center));
                (row(du), row(dv), w)
            }
            None => {
                let cap = Cap::new(&self.light, p)?;
                // Points of a sphere are moved off it in proportion to the receiver's distance; from far away
                // by more than is looked at for triangles that touch the light.
                let size = self.light.center().abs().max_element().max(1.0);
                if cap.cos < WIDEST_CAP || cap.sin == 0.0 || cap.distance > 2.0 * size {
                    return None;
                }
                reach += cap.distance;
                let w = cap.axis / (cap.distance * (1.0 + cap.sin));
                let scale = 0.5 * cap.cos / (cap.sin * cap.distance * (1.0 + cap.sin));
                (cap.e1 * scale + 0.5 * w, cap.e2 * scale + 0.5 * w, w)
            }
        };
        Some(View {
            u: u.as_vec3(),
            v: v.as_vec3(),
            w: w.as_vec3(),
            reach: reach as f32,
        })
    }

    /// Fills `out` with the samples of receiver `index` at local `p` with unit normal `n` (zero: no
    /// tangent plane, and cosines of 1 in the weights).
    pub fn fill(&self, index: u32, p: DVec3, n: DVec3, out: &mut LightSamples) {
        out.resize(self.len());
        let scramble = if self.fixed {
            [0, 0]
        } else {
            self.pattern.scramble(self.number, index)
        };
        match (&self.flat, Cap::new(&self.light, p)) {
            (Some(flat), _) => {
                let (pattern, p, n) = (&self.pattern, p.as_vec3(), n.as_vec3());
                dispatch!(detect() => fill_flat(
                    flat: &Flat, pattern: &Pattern, scramble: [u32; 2], p: Vec3, n: Vec3,
                    out: &mut LightSamples));
            }
            (None, Some(cap)) => {
                let size = cap.distance + self.light.center().abs().max_element().max(1.0);
                let offset = (POINT_OFFSET * size) as f32;
                let (pattern, p, n, cap) = (&self.pattern, p.as_vec3(), n.as_vec3(), &cap);
                dispatch!(detect() => fill_cap(
                    cap: &Cap, pattern: &Pattern, scramble: [u32; 2], p: Vec3, n: Vec3, offset: f32,
                    out: &mut LightSamples));
            }
            (None, None) => {
                // Inside a sphere: it emits outwards only.
                out.valid.fill(0);
                out.weights.fill(Row::default());
                for (axis, c) in out
                    .points
                    .iter_mut()
                    .zip(self.light.center().as_vec3().to_array())
                {
                    axis.fill(Row([c; LANES]));
                }
            }
        }
        let tail = out.count % LANES;
        if tail != 0 {
            let last = out.valid.len() - 1;
            out.valid[last] &= (1 << tail) - 1;
            for lane in tail..LANES {
                out.weights[last].0[lane] = 0.0;
            }
        }
    }
}

/// Row `r` of the scrambled pattern, in [-1, 1]², or mapped onto the unit disk.
#[inline(always)]
fn coordinates(pattern: &Pattern, r: usize, scramble: [u32; 2], disk: bool) -> (Row, Row) {
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
unsafe fn fill_flat<S: Lanes>(
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
unsafe fn fill_cap<S: Lanes>(
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

/// The cap of directions in which a sphere is seen from outside.
struct Cap {
    axis: DVec3,
    e1: DVec3,
    e2: DVec3,
    distance: f64,
    radius: f64,
    sin: f64,
    cos: f64,
    /// 1 - cos of the half-angle, without cancellation.
    height: f64,
}

impl Cap {
    fn new(light: &Light, p: DVec3) -> Option<Cap> {
        let Shape::Sphere { center, radius } = light.shape else {
            return None;
        };
        let d = center - p;
        let distance = d.length();
        if distance <= radius || distance == 0.0 {
            return None;
        }
        let axis = d / distance;
        let e1 = axis.any_orthonormal_vector();
        let sin = radius / distance;
        let cos = ((1.0 - sin) * (1.0 + sin)).sqrt();
        let height = sin * sin / (1.0 + cos);
        Some(Cap {
            axis,
            e1,
            e2: axis.cross(e1),
            distance,
            radius,
            sin,
            cos,
            height,
        })
    }
}

/// A 32-bit fraction as a number in (-1, 1), symmetric about 0.
#[inline(always)]
fn centered(bits: u32) -> f32 {
    ((bits >> 9) as f32 + 0.5) * (1.0 / (1 << 22) as f32) - 1.0
}

/// Grid cell of a point in [-1, 1]², row-major.
#[inline(always)]
fn cell(x: f32, y: f32) -> u16 {
    const HALF: f32 = 0.5 * GRID as f32;
    let index = |t: f32| grid_index(t * HALF + HALF) as u16;
    index(y) * GRID as u16 + index(x)
}

/// Place of a grid cell on the Morton curve over the grid.
pub fn cell_place(cell: u16) -> u32 {
    let (row, column) = (u32::from(cell) / GRID as u32, u32::from(cell) % GRID as u32);
    morton(column) | morton(row) << 1
}

/// The least `f32` from which on there is nothing between whole numbers.
pub const WHOLE: f32 = (1 << 23) as f32;

/// Row or column of a coordinate in cells, the nearest one outside of the grid; of a coordinate on a
/// border, either neighbour.
///
/// Adding [`WHOLE`] leaves the nearest whole number in the low bits: unlike a cast, an operation that the
/// compiler's vectoriser has for all lanes, and one without branches.
#[inline(always)]
pub fn grid_index(cells: f32) -> u32 {
    let place = (cells - 0.5).max(0.0).min((GRID - 1) as f32);
    (place + WHOLE).to_bits() & (GRID as u32 - 1)
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

/// Second dimension of the Sobol sequence, as a 32-bit fraction.
fn sobol_second(index: u32) -> u32 {
    let (mut v, mut bits, mut out) = (1u32 << 31, index, 0);
    while bits != 0 {
        if bits & 1 != 0 {
            out ^= v;
        }
        bits >>= 1;
        v ^= v >> 1;
    }
    out
}

/// Nested uniform scrambling of a 32-bit fraction: each digit is flipped by a hash of those above it.
fn owen_scramble(fraction: u32, seed: u32) -> u32 {
    let mut x = fraction.reverse_bits();
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// SplitMix64's mixing of two words.
fn hash(a: u64, b: u64) -> u64 {
    let mut z = a
        .wrapping_add(b.wrapping_mul(0x9e37_79b9_7f4a_7c15))
        .wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Spreads 16 bits to the even positions of a word.
fn morton(bits: u32) -> u32 {
    let mut x = bits & 0xffff;
    x = (x | (x << 8)) & 0x00ff_00ff;
    x = (x | (x << 4)) & 0x0f0f_0f0f;
    x = (x | (x << 2)) & 0x3333_3333;
    (x | (x << 1)) & 0x5555_5555
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_two_fill_every_elementary_interval_once_also_when_scrambled() {
        for n in [16usize, 64, 256, 1024] {
            let pattern = Pattern::new(n, 7);
            let m = n.trailing_zeros();
            for scramble in [[0, 0], pattern.scramble(0, 5), pattern.scramble(2, 123_456)] {
                for kx in 0..=m {
                    let mut seen = vec![0; n];
                    for i in 0..n {
                        let digits = |axis: &[[u32; LANES]], k: usize| {
                            u64::from(axis[i / LANES][i % LANES] ^ scramble[k])
                        };
                        let x = (digits(&pattern.x, 0) >> (32 - kx)) as usize;
                        let y = (digits(&pattern.y, 1) >> (32 - (m - kx))) as usize;
                        seen[(x << (m - kx)) | y] += 1;
                    }
                    assert!(seen.iter().all(|&c| c == 1), "n {n}, 2^{kx} columns");
                }
            }
        }
    }

    #[test]
    fn refining_keeps_the_samples_that_were_there() {
        let sorted = |n| {
            let p = Pattern::new(n, 3);
            let (x, y) = (p.x.into_iter().flatten(), p.y.into_iter().flatten());
            let mut points: Vec<_> = x.zip(y).take(n).collect();
            points.sort_unstable();
            points
        };
        let (few, many) = (sorted(100), sorted(200));
        assert!(few.iter().all(|p| many.binary_search(p).is_ok()));
    }

    #[test]
    fn sixteen_neighbours_of_256_samples_lie_in_one_sixteenth_of_the_light() {
        let p = Pattern::new(256, 1);
        for block in 0..16 {
            let corner = |i: usize| (p.x[block][i] >> 30, p.y[block][i] >> 30);
            assert!((0..16).all(|i| corner(i) == corner(0)));
        }
    }

    #[test]
    fn weights_sum_to_the_unshadowed_irradiance_and_points_lie_on_the_light() {
        let c = DVec3::new(0.2, -0.3, 1.1);
        let lights = [
            Light::rect(
                c,
                DVec3::new(0.0, 0.6, 0.1),
                DVec3::new(0.7, 0.0, 0.0),
                [1.0; 3],
            )
            .unwrap(),
            Light::disk(c, DVec3::new(0.1, 0.2, -1.0), 0.4, [1.0; 3]).unwrap(),
            Light::sphere(c, 0.4, [1.0; 3]).unwrap(),
        ];
        let p = DVec3::new(-0.1, 0.2, 0.0);
        for light in lights {
            let sampler = Sampler::new(light, 0, Pattern::new(4096, 1), false);
            let mut out = LightSamples::default();
            for n in [DVec3::Z, DVec3::new(0.98, 0.0, 0.2).normalize()] {
                sampler.fill(9, p, n, &mut out);
                let sum: f64 = out.weights.iter().flat_map(|r| r.0).map(f64::from).sum();
                let exact = light.unshadowed_irradiance(p, n);
                // 4096 stratified samples of a smooth integrand (one with a cut horizon): measured
                // 3e-5 and 4e-4 relative.
                let tolerance = if n == DVec3::Z { 1e-4 } else { 2e-3 };
                assert!(
                    (sum - exact).abs() < tolerance * exact,
                    "{light:?}: {sum} {exact}"
                );
                let valid: u32 = out.valid.iter().map(|v| v.count_ones()).sum();
                let h = light.fraction_above(p, n);
                assert!(
                    (f64::from(valid) / 4096.0 - h).abs() < 2e-3,
                    "{light:?} {h} {valid}"
                );
            }
            let view = sampler.view(p).unwrap();
            out.find_cells();
            for i in 0..out.count {
                let q = out.point(i) - p.as_vec3();
                let (u, v) = (view.u.dot(q) / view.w.dot(q), view.v.dot(q) / view.w.dot(q));
                let side = GRID as f32;
                let (cx, cy) = ((u * side).floor(), (v * side).floor());
                let expected = (cy * side + cx) as i32;
                let got = i32::from(out.cells[i / LANES][i % LANES]);
                let near = |t: f32| (t * side - (t * side).round()).abs() < 1e-4;
                assert!(
                    expected == got || near(u) || near(v),
                    "{light:?} {i}: {u} {v}"
                );
                assert!((0.0..=1.0001).contains(&view.w.dot(q)));
            }
        }
    }
}
