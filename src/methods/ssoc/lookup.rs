//! Visibility of a receiver from the maps of a view (Figure 5 and Section 3.2.3).
//!
//! A receiver at depth `p_z` sees the light, of equivalent radius `r`, past an edge at depth `z_near` in a band
//! of the image that is `w = f r (1 / z_near - 1 / p_z)` wide on both sides of the receiver. With `x` the
//! receiver's signed distance from the edge, the part of the band beyond the edge is `S = (w + x) / 2w`, and
//! `x + (w - x) / 2`, the distorted point, is the middle of that part. If something hides the receiver there
//! too, its edge is looked up at the distorted point and the receiver's distortion found again for it.
//!
//! What hides a receiver is decided by planes, not by a bias: at the receiver's own place in the image it must
//! be behind the plane of the nearest triangle, and the point that the texel saw in front of the receiver's
//! tangent plane, each by more than the rounding of coordinates. That leaves no shadow of a surface on itself
//! at convex and concave creases alike, however large the texel. At a distorted place, what the texel
//! saw must be in front of the tangent plane and within the cone of rays from the receiver to the
//! light, `f r (1 / z - 1 / p_z) >= |distortion|`.

use glam::{DVec2, DVec3};

use super::falloff::Falloff;
use super::maps::Maps;
use crate::geometry::Geometry;
use crate::raster::nearest::NONE;
use crate::sampling::POINT_OFFSET;

/// Most repeated distortions.
pub const MOST_STEPS: usize = 8;

/// Cosine of the largest angle between the normals of two edges of one penumbra, or of nested ones: their
/// darker one counts. 25°, at which the shadow of a corner is within 0.05 of a straight edge's.
const SAME: f64 = 0.9;

/// Texels by which the drawn silhouette may differ from the edge: half a diagonal, at both ends of a distortion.
const DRAWN: f64 = std::f64::consts::SQRT_2;

/// Texels within which the feet on two edges are on one silhouette, beside a quarter of the penumbra's
/// half-width: the drawing of either may be off by [`DRAWN`].
const CLOSE: f64 = 2.0 * DRAWN;

/// A receiver in a view.
struct Receiver {
    /// Local position.
    local: DVec3,
    /// Column and row in texels.
    at: DVec2,
    inverse_depth: f64,
    /// Normal in the view's coordinates, and its product with the position there; zero without one.
    normal: DVec3,
    height: f64,
    /// Farthest that a surface counts as the receiver's own.
    slack: f64,
}

/// The lookup with its parameters.
pub struct Lookup<'a> {
    /// The scene that casts.
    pub geometry: &'a Geometry,
    /// Repeated distortions.
    pub steps: usize,
    /// How `S` becomes visibility.
    pub falloff: Falloff,
    /// Whether the four texels around a receiver are interpolated.
    pub interpolate: bool,
    /// Whether the light is a point.
    pub hard: bool,
}

impl Lookup<'_> {
    /// Visibility of a receiver at `p` (local) with unit normal `n`, or zero; `None` where the view does not
    /// hold it.
    pub fn visibility(&self, maps: &Maps, p: DVec3, n: DVec3) -> Option<f64> {
        let view = &maps.view;
        let (at, depth) = view.project(p);
        if depth.is_nan() || depth <= 0.0 {
            return None;
        }
        let texel = view.texel(at)?;
        let normal = view.camera.rotation * n;
        let mut slack = POINT_OFFSET * p.abs().max_element().max(1.0);
        if n == DVec3::ZERO {
            // Half a texel's diagonal: a crease may stand out as far within the texel.
            slack += std::f64::consts::FRAC_1_SQRT_2 * depth / view.focal;
        }
        let receiver = Receiver {
            local: p,
            at,
            inverse_depth: 1.0 / depth,
            normal,
            height: normal.dot(view.camera.rotation * (p - view.camera.eye)),
            slack,
        };
        if self.hard {
            return Some(if self.hidden(maps, texel, &receiver) {
                0.0
            } else {
                1.0
            });
        }
        if !self.interpolate {
            return Some(self.evaluate(maps, &receiver, self.start(maps, texel, &receiver)));
        }
        let (width, height) = (view.camera.width as usize, view.camera.height as usize);
        let corner = at - 0.5;
        let base = corner.floor();
        let part = corner - base;
        let column = |i: f64| (base.x + i).max(0.0).min((width - 1) as f64) as usize;
        let row = |i: f64| (base.y + i).max(0.0).min((height - 1) as f64) as usize;
        let texels = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
            .map(|(i, j)| row(j) * width + column(i));
        let weights = [
            (1.0 - part.x) * (1.0 - part.y),
            part.x * (1.0 - part.y),
            (1.0 - part.x) * part.y,
            part.x * part.y,
        ];
        let starts = texels.map(|t| self.start(maps, t, &receiver));
        let mut sum = 0.0;
        let mut found: [Option<f64>; 4] = [None; 4];
        for i in 0..4 {
            // Neighbours mostly start from the same edge.
            let known = (0..i)
                .find(|&j| starts[j] == starts[i])
                .and_then(|j| found[j]);
            let value = known.unwrap_or_else(|| self.evaluate(maps, &receiver, starts[i]));
            found[i] = Some(value);
            sum += weights[i] * value;
        }
        Some(sum)
    }

    /// Whether a receiver is in the hard shadow at a texel, and the edge that this side of the maps has there.
    fn start(&self, maps: &Maps, texel: usize, receiver: &Receiver) -> (bool, u32) {
        let hidden = self.hidden(maps, texel, receiver);
        let map = if hidden { &maps.inside } else { &maps.outside };
        (hidden, map[texel])
    }

    /// Whether the point that a texel saw is in front of the receiver's tangent plane by more than the slack.
    fn in_front(maps: &Maps, texel: usize, receiver: &Receiver, slack: f64) -> bool {
        if receiver.normal == DVec3::ZERO {
            return true;
        }
        let over = receiver.normal.dot(direction(maps, texel));
        over > maps.inverse_depth[texel] * (receiver.height + slack)
    }

    /// Whether the surface at a receiver's own texel, or a neighbour's, hides it from the light's centre.
    fn hidden(&self, maps: &Maps, texel: usize, receiver: &Receiver) -> bool {
        let triangle = maps.triangle[texel];
        // Cheap, and enough for most of what is lit.
        if triangle == NONE || !Self::in_front(maps, texel, receiver, receiver.slack) {
            return false;
        }
        let [a, b, c] = self.geometry.corners(triangle).map(|v| v.as_dvec3());
        let cross = (b - a).cross(c - a);
        let Some(plane) = cross.try_normalize() else {
            return false;
        };
        let view = &maps.view;
        // Turned to the light.
        let towards = plane.dot(view.camera.eye - a);
        let plane = if towards < 0.0 { -plane } else { plane };
        let slack = receiver.slack + self.roughness(maps, texel, receiver, plane, cross, towards);
        if plane.dot(receiver.local - a) >= -slack || !Self::in_front(maps, texel, receiver, slack)
        {
            return false;
        }
        // A plane that is seen almost edge-on may pass over a receiver that is nearer than its triangle.
        let forward = view.camera.rotation.transpose().z_axis;
        let depth = |p: DVec3| forward.dot(p - view.camera.eye);
        let nearest = depth(a).min(depth(b)).min(depth(c));
        nearest * receiver.inverse_depth < 1.0
    }

    /// How far a surface of triangles that are smaller than a texel can stand out over the tangent plane
    /// within it: the part of half a diagonal that a triangle of its size does not cover, on the receiver's
    /// surface, times the sine between the normals.
    fn roughness(
        &self,
        maps: &Maps,
        texel: usize,
        receiver: &Receiver,
        plane: DVec3,
        cross: DVec3,
        towards: f64,
    ) -> f64 {
        let view = &maps.view;
        let depth = 1.0 / maps.inverse_depth[texel];
        let d = direction(maps, texel);
        // Area in texels: the triangle's, as seen along the ray, over the squared depth.
        let seen = 0.5 * cross.length() * towards.abs() / (depth * d.length());
        let size = seen.sqrt() * view.focal / depth;
        let uncovered = (std::f64::consts::FRAC_1_SQRT_2 - size).max(0.0) * depth / view.focal;
        if uncovered == 0.0 || receiver.normal == DVec3::ZERO {
            return 0.0;
        }
        let normal = view.camera.rotation.transpose() * receiver.normal;
        let sine = normal.cross(plane).length();
        let apart =
            (view.camera.rotation * (receiver.local - view.camera.eye) - d * depth).length();
        let slope = (receiver.normal.dot(d) / d.length()).abs();
        (uncovered / slope).min(apart) * sine
    }

    /// Figure 5, repeated.
    fn evaluate(&self, maps: &Maps, receiver: &Receiver, start: (bool, u32)) -> f64 {
        let view = &maps.view;
        let (mut hidden, mut edge) = start;
        // One factor a penumbra; edges of the same one are told by their normals.
        let mut normals = [DVec2::ZERO; MOST_STEPS];
        let mut points = [DVec2::ZERO; MOST_STEPS];
        let mut factors = [1.0f64; MOST_STEPS];
        let mut edges = [NONE; MOST_STEPS];
        let mut count = 0;
        for step in 0..self.steps {
            if edge == NONE {
                break;
            }
            let foot = maps.lines[edge as usize].foot(receiver.at);
            let (radius, part) = view.outline.radius(foot.normal, view.tangents(foot.point));
            let scale = view.focal * radius;
            let w = scale * (foot.inverse_near - receiver.inverse_depth);
            let x = foot.x;
            let concerned = w > 0.0 && x < w;
            if !concerned {
                // An edge that is behind the receiver, or too far off, says nothing about it; but the
                // drawn silhouette may be a texel off the edge.
                hidden &= w <= 0.0 || x > w + DRAWN;
                break;
            }
            let s = self
                .falloff
                .visible(((w + x) / (2.0 * w)).max(0.0), part, &view.outline);
            if s == 0.0 {
                return 0.0;
            }
            let same = (0..count).find(|&k| {
                let apart = points[k].distance(foot.point);
                normals[k].dot(foot.normal) > SAME || apart <= CLOSE + 0.25 * w
            });
            let k = same.unwrap_or(count);
            factors[k] = if same.is_some() { factors[k].min(s) } else { s };
            (normals[k], points[k]) = (foot.normal, foot.point);
            count = count.max(k + 1);
            edges[step] = edge;
            let distortion = 0.5 * (w - x);
            let distorted = receiver.at + foot.normal * distortion;
            let Some(texel) = view.texel(distorted) else {
                hidden = false;
                break;
            };
            let seen = maps.inverse_depth[texel];
            let within = scale * (seen - receiver.inverse_depth) >= distortion;
            hidden = within && Self::in_front(maps, texel, receiver, receiver.slack);
            let next = if hidden {
                maps.inside[texel]
            } else {
                maps.outside[texel]
            };
            if next == NONE {
                break;
            }
            // The drawing of the same silhouette may still cover the distorted point, by its rounding.
            let line = &maps.lines[next as usize];
            let close = line.foot(receiver.at).point.distance(foot.point) <= CLOSE + 0.25 * w;
            if close && hidden && line.foot(distorted).x > -DRAWN {
                hidden = false;
                break;
            }
            if edges[..=step].contains(&next) {
                break;
            }
            edge = next;
        }
        if hidden {
            return 0.0;
        }
        factors[..count].iter().product()
    }
}

/// Direction through a texel's centre, of depth 1, in the view's coordinates.
fn direction(maps: &Maps, texel: usize) -> DVec3 {
    let width = maps.view.camera.width as usize;
    let center = DVec2::new((texel % width) as f64, (texel / width) as f64) + 0.5;
    maps.view.tangents(center).extend(1.0)
}
