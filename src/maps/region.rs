//! The part of a shadow map that can hide a light from a receiver, and where its light samples fall in it.
//!
//! Equation (1), for maps whose eye is not in the light: the segment from the receiver `p` to a light point
//! `l` passes the depth `z` at `p + t (l - p)`, `t = (p_z - z) / (p_z - l_z)`. Over all light points that is
//! the light's shape, scaled by `t` and projected; with the eye in a flat light's plane its radius is the
//! equation's `f r (1/z - 1/p_z)`. The whole of what can hide the light lies between this region, at the
//! depth of what is nearest to the light, and the receiver's own place in the map. That depth is found in
//! the map's quadtree, again for the region that follows from it, until it hardly changes: the paper's
//! conservative size with the least depth of its own region, instead of that of all the map. What is behind
//! the receiver, below its tangent plane or beside the segments is left out; where nothing remains, all
//! of the light is seen.
//!
//! A blocker lies nearer to the light than the receiver and above its tangent plane, by more than a bias of a
//! texel's width: a plane does not shadow itself, however oblique or wide the filter is, and convex bodies
//! do not either. A blocker closer to the receiver than the bias is missed.

use glam::{DVec2, DVec3};

use super::layers::map::{LayerMap, Medium, Piece};
use crate::camera::Camera;
use crate::light::Light;
use crate::sampling::LightSamples;
use crate::simd::{LANES, Row};

/// Rounds in which the region shrinks, the nodes that are looked at with it; the second gains most of it.
const ROUNDS: usize = 2;

/// Nodes of the quadtree along a region: with fewer, what is beside it counts; more cost more than they save.
const NODES: f64 = 8.0;

/// Least part of the depth that the distance from eye to tangent plane is taken as, where the eye is in it:
/// far above rounding, and less than a texel sees.
const EDGE_ON: f64 = 1e-9;

/// Bounds of a light in a view's homogeneous image coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Source {
    low: DVec3,
    high: DVec3,
}

impl Source {
    /// The bounds of a local light.
    pub fn new(light: &Light, camera: &Camera) -> Self {
        let center = camera.project(light.center());
        let rows = (camera.intrinsics * camera.rotation).transpose();
        let reach = |row: DVec3| light.reach(row);
        let reach = DVec3::new(reach(rows.x_axis), reach(rows.y_axis), reach(rows.z_axis));
        Source {
            low: center - reach,
            high: center + reach,
        }
    }

    /// Whether all of the light is nearer to the eye than depth `z`.
    pub fn is_nearer_than(&self, z: f64) -> bool {
        self.high.z < z
    }

    /// Bounds of the region of a receiver at homogeneous `h`, at depth `z`.
    fn region(&self, h: DVec3, z: f64) -> (DVec2, DVec2) {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for light_z in [self.low.z, self.high.z] {
            let t = part(h.z, light_z, z);
            for l in [self.low, self.high] {
                let l = l.truncate().extend(light_z);
                let at = h + t * (l - h);
                let q = at.truncate() / at.z;
                (low, high) = (low.min(q), high.max(q));
            }
        }
        (low, high)
    }
}

/// How far along the segment from depth `from` to depth `to` the depth `z` is.
#[inline(always)]
fn part(from: f64, to: f64, z: f64) -> f64 {
    let t = (from - z) / (from - to);
    // Not a number, where both are equal, becomes 0.
    if t > 0.0 { t.min(1.0) } else { 0.0 }
}

/// A place in a map: where the texel's first layer is, and how far off the texel's middle the place is.
#[derive(Debug, Clone, Copy)]
pub struct Texel {
    at: usize,
    child: usize,
    off: [f32; 2],
}

/// A receiver in a map, with what may be between it and the light.
#[derive(Debug, Clone, Copy)]
pub struct Region<'a> {
    /// The map.
    pub map: &'a LayerMap,
    /// Largest inverse depth of what can hide the light.
    pub nearest: f32,
    /// Homogeneous image coordinates of the receiver.
    h: DVec3,
    /// Its place in the image.
    q: [f32; 2],
    /// Least inverse depth of what is nearer to the light.
    floor: f32,
    /// Inverse depth of what is in its tangent plane: its change from column to column and row to row, and at
    /// `q`.
    plane: [f32; 3],
    /// Whether what is above the tangent plane is nearer to the eye than the plane.
    nearer: bool,
}

impl<'a> Region<'a> {
    /// The region of the local point `p` with normal `n` (zero: none); `None` if nothing in the map is between
    /// it and the light.
    pub fn new(
        map: &'a LayerMap,
        source: &Source,
        p: DVec3,
        n: DVec3,
        bias: Option<f64>,
    ) -> Option<Self> {
        let camera = &map.view.camera;
        let h = camera.project(p);
        if h.z <= 0.0 {
            return None;
        }
        let q = h.truncate() / h.z;
        let bias = bias.unwrap_or(h.z / map.view.focal);
        let (mut plane, mut nearer, mut floor) = ([0.0; 3], true, 1.0 / h.z);
        if n == DVec3::ZERO {
            // With a bias beyond the eye nothing is between.
            floor = 1.0 / (h.z - bias).max(f64::MIN_POSITIVE);
        } else {
            // A point of inverse depth w on the eye's ray d through the image is above the plane by more than
            // the bias where n·(d / w - (p - eye)) > bias.
            let d = camera.direction(q.x, q.y);
            let height = n.dot(p - camera.eye);
            let mut sum = height + bias;
            if sum.abs() < EDGE_ON * h.z {
                sum = EDGE_ON * h.z * sum.signum();
            }
            let change = |x: f64, y: f64| n.dot(camera.direction(q.x + x, q.y + y) - d) / sum;
            plane = [
                change(1.0, 0.0) as f32,
                change(0.0, 1.0) as f32,
                (height / (h.z * sum)) as f32,
            ];
            nearer = sum < 0.0;
        }
        let mut region = Region {
            map,
            nearest: map.view.inverse_near as f32,
            h,
            q: q.as_vec2().to_array(),
            floor: floor as f32,
            plane,
            nearer,
        };
        for _ in 0..ROUNDS {
            region.nearest = region.bound(source);
            if region.nearest <= region.floor {
                return None;
            }
        }
        Some(region)
    }

    /// A bound on the inverse depth of what can hide the light; 0 where nothing can.
    fn bound(&self, source: &Source) -> f32 {
        let levels = &self.map.levels;
        let size = DVec2::new(levels[0].width as f64, levels[0].height as f64);
        let q = DVec2::new(f64::from(self.q[0]), f64::from(self.q[1]));
        // All that can hide the light at a depth and behind it.
        let hull = |w: f32| {
            let (low, high) = source.region(self.h, 1.0 / f64::from(w));
            // A texel more, for light samples that are off the light, and rounding.
            (low.min(q) - 1.0, high.max(q) + 1.0)
        };
        let (low, high) = hull(self.nearest);
        let (low, high) = (low.max(DVec2::ZERO), high.min(size - 0.5));
        if !low.cmple(high).all() {
            return 0.0;
        }
        let whole = |v: DVec2| (v.x as usize, v.y as usize);
        let ((x0, y0), (x1, y1)) = (whole(low), whole(high));
        // From the level on which it lies in 2×2 nodes at most, down to nodes that are small beside it.
        let span = (x1 - x0).max(y1 - y0);
        let top = ((usize::BITS - span.leading_zeros()) as usize).min(levels.len() - 1);
        let finest = (span as f64 / NODES).max(1.0).log2() as usize;
        // Four children of each node on the way down at most, and the first four.
        let mut stack = [(0u32, 0u32, 0u32); 4 * 16 + 4];
        let mut count = 0;
        for y in y0 >> top..=y1 >> top {
            for x in x0 >> top..=x1 >> top {
                stack[count] = (top as u32, x as u32, y as u32);
                count += 1;
            }
        }
        let mut most = 0.0f32;
        while count > 0 {
            count -= 1;
            let (level, x, y) = stack[count];
            let (level, x, y) = (level as usize, x as usize, y as usize);
            let of = &levels[level];
            let quad = &of.quads[(y / 2) * of.width.div_ceil(2) + x / 2];
            let child = (y & 1) * 2 + (x & 1);
            let (near, far) = (quad.high[child].min(self.nearest), quad.low[child]);
            if near <= most.max(self.floor) || self.is_behind(level, x, y, near, far) {
                continue;
            }
            let (low, high) = hull(near);
            let corner = DVec2::new((x << level) as f64, (y << level) as f64);
            let side = (1usize << level) as f64;
            if high.x < corner.x
                || high.y < corner.y
                || low.x > corner.x + side
                || low.y > corner.y + side
            {
                continue;
            }
            if level <= finest {
                most = near;
                continue;
            }
            let finer = &levels[level - 1];
            for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (x, y) = (2 * x + i, 2 * y + j);
                if x < finer.width && y < finer.height {
                    stack[count] = (level as u32 - 1, x as u32, y as u32);
                    count += 1;
                }
            }
        }
        most
    }

    /// Whether all that a node can hold, between two inverse depths, is below the receiver's tangent plane.
    #[inline(always)]
    fn is_behind(&self, level: usize, x: usize, y: usize, near: f32, far: f32) -> bool {
        let [change_x, change_y, at] = self.plane;
        let half = 0.5 * (1usize << level) as f32;
        let middle = [x, y].map(|i| (i << level) as f32 + half);
        let plane = at + change_x * (middle[0] - self.q[0]) + change_y * (middle[1] - self.q[1]);
        let reach = half * (change_x.abs() + change_y.abs());
        if self.nearer {
            near <= plane - reach
        } else {
            far >= plane + reach
        }
    }

    /// Whether inverse depth `w` at an image point is between the receiver and the light.
    #[inline(always)]
    pub fn is_between(&self, x: f32, y: f32, w: f32) -> bool {
        let [change_x, change_y, at] = self.plane;
        let plane = at + change_x * (x - self.q[0]) + change_y * (y - self.q[1]);
        w > self.floor && (w > plane) == self.nearer
    }

    /// Which part of the depth between two surfaces, given by their inverse depths, the nearer first, is nearer
    /// to the light than the receiver or its tangent plane.
    pub fn depth_part(&self, x: f32, y: f32, first: f32, last: f32) -> f32 {
        let [change_x, change_y, at] = self.plane;
        let plane = at + change_x * (x - self.q[0]) + change_y * (y - self.q[1]);
        let w = if self.nearer {
            plane.max(self.floor)
        } else {
            self.floor
        };
        let (z, first, last) = (1.0 / w, 1.0 / first, 1.0 / last.max(f32::MIN_POSITIVE));
        let part = (z - first) / (last - first);
        if part > 0.0 { part.min(1.0) } else { 0.0 }
    }

    /// The texel at an image point.
    #[inline(always)]
    pub fn texel(&self, x: f32, y: f32) -> Option<Texel> {
        let level = &self.map.levels[0];
        // What is not a number fails both.
        if x >= 0.0 && y >= 0.0 {
            let (column, row) = (x as usize, y as usize);
            if column < level.width && row < level.height {
                let off = [x - column as f32 - 0.5, y - row as f32 - 0.5];
                let (at, child) = level.place(column, row, self.map.layers);
                return Some(Texel { at, child, off });
            }
        }
        None
    }

    /// One of a texel's layers, `None` beyond the last; and its inverse depth at the place asked for.
    #[inline(always)]
    pub fn layer(&self, texel: Texel, layer: usize) -> Option<(Piece, f32)> {
        let piece = self.map.levels[0].blocks[texel.at + layer].piece(texel.child);
        let [x, y] = piece.slope();
        let w = piece.inverse_depth + x * texel.off[0] + y * texel.off[1];
        piece.is_some().then_some((piece, w))
    }

    /// What one of a texel's layers lets through, in a transparent map.
    #[inline(always)]
    pub fn medium(&self, texel: Texel, layer: usize) -> Option<Medium> {
        let medium = self.map.levels[0].media.get(texel.at + layer);
        medium.map(|m| m[texel.child])
    }
}

/// A receiver's light samples, where they fall in a map, and what is left of them.
#[derive(Debug, Default)]
pub struct RegionScratch {
    /// The light samples.
    pub samples: LightSamples,
    /// Transmittance to each.
    pub through: Vec<Row>,
    /// Their homogeneous image coordinates.
    projected: [Vec<Row>; 3],
    /// Their places in the image at the depth that was asked for last.
    pub places: [Vec<Row>; 2],
}

impl RegionScratch {
    /// Begins with a receiver whose samples were filled in.
    pub fn start(&mut self) {
        let rows = self.samples.valid.len();
        self.through.clear();
        self.through.resize(rows, Row([1.0; LANES]));
        for axis in self.projected.iter_mut().chain(&mut self.places) {
            axis.resize(rows, Row::default());
        }
    }

    /// Projects the light samples into a region's map.
    pub fn project(&mut self, region: &Region<'_>) {
        let camera = &region.map.view.camera;
        let matrix = camera.intrinsics * camera.rotation;
        let shift = -(matrix * camera.eye);
        let rows = matrix.transpose();
        let [xs, ys, zs] = &self.samples.points;
        for (axis, out) in self.projected.iter_mut().enumerate() {
            let row = rows.col(axis).as_vec3();
            let shift = shift[axis] as f32;
            for (r, out) in out.iter_mut().enumerate() {
                for (lane, out) in out.0.iter_mut().enumerate() {
                    *out = row.x * xs[r].0[lane]
                        + row.y * ys[r].0[lane]
                        + row.z * zs[r].0[lane]
                        + shift;
                }
            }
        }
    }

    /// Finds where the segments to the light samples pass the inverse depth `w`.
    pub fn place(&mut self, region: &Region<'_>, w: f32) {
        let [hx, hy, hz] = region.h.as_vec3().to_array();
        let [xs, ys, zs] = &self.projected;
        let [places_x, places_y] = &mut self.places;
        let down = hz - 1.0 / w;
        for r in 0..xs.len() {
            for lane in 0..LANES {
                let to_light = zs[r].0[lane] - hz;
                let t = down / -to_light;
                let t = if t > 0.0 { t.min(1.0) } else { 0.0 };
                let inverse = 1.0 / (hz + t * to_light);
                places_x[r].0[lane] = (hx + t * (xs[r].0[lane] - hx)) * inverse;
                places_y[r].0[lane] = (hy + t * (ys[r].0[lane] - hy)) * inverse;
            }
        }
    }

    /// Mean transmittance over the samples; those that are not valid are hidden.
    pub fn visibility(&self) -> f32 {
        let mut sum = 0.0;
        for (row, &valid) in self.through.iter().zip(&self.samples.valid) {
            for (lane, through) in row.0.iter().enumerate() {
                if valid >> lane & 1 == 1 {
                    sum += through;
                }
            }
        }
        (sum / self.samples.count as f32).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::casters::Casters;
    use crate::control::Control;
    use crate::geometry::entry::Material;
    use crate::maps::layers::construction::{Layers, layer_map};
    use crate::maps::layers::views::light_views;
    use crate::scene::Scene;

    /// Some hundred loose triangles over a ground, and the light's map of them.
    fn map(light: &Light) -> (LayerMap, Light) {
        let mut scene = Scene::default();
        let looks = Material {
            albedo: [1.0; 3],
            opacity: 1.0,
            casts: true,
            receives: true,
        };
        // A low-discrepancy sequence, for corners of small triangles all over the place.
        let fraction = |i: u32, step: f64| (f64::from(i) * step).fract() - 0.5;
        let place = |i: u32| {
            let (x, y) = (fraction(i, 0.754_877_7), fraction(i, 0.569_840_3));
            DVec3::new(x, y, 0.5 * fraction(i, 0.618_034) + 0.4)
        };
        let vertices: Vec<DVec3> = (0..300)
            .flat_map(|i| [0, 1, 2].map(|k| place(i) + 0.1 * (place(3 * i + k) - place(i))))
            .collect();
        let faces: Vec<[i64; 3]> = (0..300).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        scene.add_mesh("leaves", vertices, &faces, looks).unwrap();
        let geometry: Arc<_> = scene.snapshot().unwrap();
        let light = light.to_local(&geometry.frame);
        let casters = Casters::new("pcf", geometry, false).unwrap();
        let views = light_views(&light, &casters, 128).unwrap();
        let layers = Layers::opaque(1);
        let view = views.groups.into_iter().flatten().next().unwrap();
        let map = layer_map(view, &casters, &layers, &Control::default()).unwrap();
        (map, light)
    }

    #[test]
    fn nothing_between_a_receiver_and_the_light_is_left_out() {
        let center = DVec3::new(0.2, -0.1, 2.0);
        let light = Light::disk(center, DVec3::NEG_Z, 0.4, [1.0; 3]).unwrap();
        let (map, light) = map(&light);
        let source = Source::new(&light, &map.view.camera);
        let (mut free, mut held) = (0, 0);
        for i in 0..400u32 {
            let at = |step: f64| 2.0 * (f64::from(i) * step).fract() - 1.0;
            let p = DVec3::new(
                2.0 * at(0.754_877_7),
                2.0 * at(0.569_840_3),
                0.5 * at(0.618_034) - 0.4,
            );
            let n = DVec3::new(at(0.137), at(0.291), 1.2).normalize();
            let found = Region::new(&map, &source, p, n, None);
            // All texels, by brute force: those that the receiver's segments pass at their depth.
            let every = Region {
                nearest: map.view.inverse_near as f32,
                ..found.unwrap_or_else(|| everything(&map, p, n))
            };
            let mut largest = 0.0f32;
            for y in 0..map.levels[0].height {
                for x in 0..map.levels[0].width {
                    let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
                    let texel = every.texel(x, y).unwrap();
                    let Some((_, w)) = every.layer(texel, 0) else {
                        continue;
                    };
                    let (low, high) = source.region(every.h, 1.0 / f64::from(w));
                    let at = DVec2::new(f64::from(x), f64::from(y));
                    let within = at.cmpge(low).all() && at.cmple(high).all();
                    if within && every.is_between(x, y, w) {
                        largest = largest.max(w);
                    }
                }
            }
            match found {
                Some(region) => {
                    assert!(
                        region.nearest >= largest,
                        "{i}: {} {largest}",
                        region.nearest
                    );
                    held += 1;
                }
                None => {
                    assert_eq!(largest, 0.0, "{i}");
                    free += 1;
                }
            }
        }
        assert!(free > 20 && held > 100, "{free} {held}");
    }

    /// The region of a receiver as if something were just before the light.
    fn everything<'a>(map: &'a LayerMap, p: DVec3, n: DVec3) -> Region<'a> {
        let h = map.view.camera.project(p);
        let d = map.view.camera.direction(h.x / h.z, h.y / h.z);
        let sum = n.dot(p - map.view.camera.eye) + h.z / map.view.focal;
        let change = |x: f64, y: f64| {
            let moved = map.view.camera.direction(h.x / h.z + x, h.y / h.z + y);
            (n.dot(moved - d) / sum) as f32
        };
        let height = n.dot(p - map.view.camera.eye);
        Region {
            map,
            nearest: map.view.inverse_near as f32,
            h,
            q: (h.truncate() / h.z).as_vec2().to_array(),
            floor: (1.0 / h.z) as f32,
            plane: [
                change(1.0, 0.0),
                change(0.0, 1.0),
                (height / (h.z * sum)) as f32,
            ],
            nearer: sum < 0.0,
        }
    }
}
