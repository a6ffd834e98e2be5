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
//! at convex and concave creases alike, however large the texel. At a distorted place, what the texel saw must hide
//! the receiver by the same two planes, and for receivers that are lit at their own place, or were moved before, be within
//! the cone of rays to the light, `f r (1 / z - 1 / p_z) >= |distortion|`. With a reference image (`distorted`), what the
//! distorted ray saw takes its place. Edges that find each other in turn leave a penumbra.

use std::cell::RefCell;
use std::f64::consts::FRAC_2_PI;

use glam::{DVec2, DVec3};

use super::maps::{FirstHit, Maps};
use super::receiver::{Planes, Receiver, TrianglePlane, around};
use crate::geometry::Geometry;
use crate::light::falloff::Falloff;
use crate::maps::views::View;
use crate::raster::nearest::NONE;

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

/// How the maps are looked up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// Repeated distortions.
    pub steps: usize,
    /// How `S` becomes visibility.
    pub falloff: Falloff,
    /// Whether the four texels around a receiver are interpolated.
    pub interpolate: bool,
    /// Whether light past the other side of thin occluders is looked for.
    pub thin: bool,
}

/// The lookup for one light, with its rules and what a thread finds again and again.
pub struct Lookup<'a> {
    geometry: &'a Geometry,
    pub(super) rules: Rules,
    /// Whether the light is a point.
    hard: bool,
    planes: RefCell<Planes>,
}

impl<'a> Lookup<'a> {
    /// The lookup in the maps of one light over the scene that casts.
    pub fn new(geometry: &'a Geometry, rules: Rules, hard: bool) -> Self {
        Lookup {
            geometry,
            rules,
            hard,
            planes: RefCell::new(Planes::new()),
        }
    }

    /// Visibility of a receiver at `p` (local) with unit normal `n`, or zero; `None` where the view does not
    /// hold it.
    pub fn visibility(&self, maps: &Maps, p: DVec3, n: DVec3) -> Option<f64> {
        let view = &maps.view;
        let (receiver, depth) = Receiver::new(view, p, n);
        if depth.is_nan() || depth <= 0.0 {
            return None;
        }
        if !view.contains(receiver.at) {
            return None;
        }
        let (mut places, part) = around(view, receiver.at);
        let mut weights = [
            (1.0 - part.x) * (1.0 - part.y),
            part.x * (1.0 - part.y),
            (1.0 - part.x) * part.y,
            part.x * part.y,
        ];
        let mut count = 4;
        if self.hard || !self.rules.interpolate {
            (places[0], weights[0], count) = (receiver.at.floor(), 1.0, 1);
        }
        let (places, weights) = (&places[..count], &weights[..count]);
        let texel = |at: DVec2| at.y as usize * view.camera.width as usize + at.x as usize;
        let direction = |at: DVec2| view.tangents(at + 0.5).extend(1.0);
        // Most receivers: all of the texels saw what hides nothing of theirs, far from any edge.
        let free = |&at: &DVec2| {
            let t = texel(at);
            !receiver.is_below(direction(at), maps.inverse_depth[t], receiver.slack)
                && (self.hard || maps.outside[t] == NONE)
        };
        if n != DVec3::ZERO && places.iter().all(free) {
            return Some(1.0);
        }
        let mut sum = 0.0;
        let mut known = [((false, NONE), 0.0); 4];
        for i in 0..count {
            let t = texel(places[i]);
            let hidden = self.hidden(maps, t, direction(places[i]), &receiver);
            let edge = if self.hard {
                NONE
            } else {
                Self::edge(maps, t, hidden, &receiver)
            };
            let start = (hidden, edge);
            // Neighbours mostly start from the same edge.
            let same = known[..i].iter().find(|k| k.0 == start);
            let value = match same {
                Some(&(_, value)) => value,
                None => self.evaluate(maps, &receiver, start),
            };
            known[i] = (start, value);
            sum += weights[i] * value;
        }
        Some(sum)
    }

    /// The edge that the maps have at a texel for a receiver that is hidden there or not.
    #[inline(always)]
    fn edge(maps: &Maps, texel: usize, hidden: bool, receiver: &Receiver) -> u32 {
        let edge = if hidden {
            maps.inside[texel]
        } else {
            maps.outside[texel]
        };
        let line = maps.lines.get(edge as usize);
        match line {
            Some(line) if receiver.inverse_depth >= line.inverse_least => edge,
            _ => NONE,
        }
    }

    /// Whether the point that a texel saw is in front of the receiver's tangent plane by more than the slack.
    #[inline(always)]
    fn in_front(d: DVec3, inverse_depth: f64, receiver: &Receiver, slack: f64) -> bool {
        receiver.normal == DVec3::ZERO || receiver.is_below(d, inverse_depth, slack)
    }

    /// Whether the surface at a receiver's own texel, or a neighbour's, hides it from the light's centre; `d` is the
    /// direction of depth 1 through the texel's centre.
    #[inline(always)]
    fn hidden(&self, maps: &Maps, texel: usize, d: DVec3, receiver: &Receiver) -> bool {
        let (triangle, inverse_depth) = (maps.triangle[texel], maps.inverse_depth[texel]);
        // Cheap, and enough for most of what is lit.
        if triangle == NONE || !Self::in_front(d, inverse_depth, receiver, receiver.slack) {
            return false;
        }
        let mut planes = self.planes.borrow_mut();
        let Some(plane) = planes.get(self.geometry, maps, triangle) else {
            return false;
        };
        if !plane.hides(receiver, receiver.slack) {
            return false;
        }
        let slack = receiver.slack + Self::roughness(&maps.view, d, inverse_depth, receiver, plane);
        plane.hides(receiver, slack)
            && Self::in_front(d, inverse_depth, receiver, slack)
            && plane.starts_before(&maps.view.camera, receiver)
    }

    /// How far a surface of triangles that are smaller than a texel can stand out over the tangent plane
    /// within it: the part of half a diagonal that a triangle of its size does not cover, on the receiver's
    /// surface, times the sine between the normals.
    #[inline(always)]
    fn roughness(
        view: &View,
        d: DVec3,
        inverse_depth: f64,
        receiver: &Receiver,
        plane: &TrianglePlane,
    ) -> f64 {
        // Most are larger than a texel, seen from the light: no root is needed.
        let texels = (view.focal * inverse_depth).powi(2);
        let covered = plane.double_area * plane.towards * inverse_depth * texels;
        if covered * covered > 1.001 * d.length_squared() {
            return 0.0;
        }
        let depth = 1.0 / inverse_depth;
        // Area in texels: the triangle's, as seen along the ray, over the squared depth.
        let area = 0.5 * plane.double_area * plane.towards / (depth * d.length());
        let size = area.sqrt() * view.focal / depth;
        let uncovered = (std::f64::consts::FRAC_1_SQRT_2 - size).max(0.0) * depth / view.focal;
        if uncovered == 0.0 || receiver.normal == DVec3::ZERO {
            return 0.0;
        }
        let normal = view.camera.rotation.transpose() * receiver.normal;
        let sine = normal.cross(plane.normal).length();
        let apart =
            (view.camera.rotation * (receiver.local - view.camera.eye) - d * depth).length();
        let slope = (receiver.normal.dot(d) / d.length()).abs();
        (uncovered / slope).min(apart) * sine
    }

    /// What an edge, as seen from the image point `from`, does to a receiver.
    #[inline(always)]
    fn penumbra(&self, maps: &Maps, edge: u32, from: DVec2, receiver: &Receiver) -> Penumbra {
        let view = &maps.view;
        let line = &maps.lines[edge as usize];
        let mut foot = line.foot(from);
        let (radius, part) = view.outline.radius(foot.normal, view.tangents(foot.point));
        let scale = view.focal * radius;
        let w = scale * (foot.inverse_near - receiver.inverse_depth);
        // The silhouette goes on straight from the point nearest to where it was looked up.
        let mut x = (receiver.at - foot.point).dot(foot.normal);
        let trend = &line.trend;
        if trend.inverse_width > 0.0 && w > 0.0 {
            // The nearest edge for a light that is small against what the trend is of, and where the light only
            // just reaches over the silhouette, for the part of it that does is short: a chord, squared.
            let other = receiver.at.dot(trend.normal) - trend.offset;
            let place = (other / w).clamp(-1.0, 1.0);
            let share = (w * trend.inverse_width).clamp(0.0, 1.0) * (1.0 - place * place);
            x += share * (other - x);
            foot.normal = foot
                .normal
                .lerp(trend.normal, share)
                .normalize_or(foot.normal);
        }
        // An edge of the receiver's own surface is in front of it by rounding at most.
        let d = view.tangents(foot.point).extend(1.0);
        let over = receiver.is_below(d, foot.inverse_near, receiver.slack);
        let before = if receiver.normal == DVec3::ZERO {
            foot.inverse_near * (1.0 - receiver.slack * receiver.inverse_depth)
                > receiver.inverse_depth
        } else {
            over && w > 0.0
        };
        let s = if before {
            ((w + x) / (2.0 * w)).clamp(0.0, 1.0)
        } else {
            1.0
        };
        let mut visible = self.rules.falloff.visible(s, part, &view.outline);
        if self.rules.thin && before && trend.thickness + x < w {
            let beyond = ((w + x + trend.thickness) / (2.0 * w)).max(0.0);
            visible += 1.0 - self.rules.falloff.visible(beyond, part, &view.outline);
        }
        let mut found = Penumbra {
            x,
            w,
            before,
            scale,
            visible,
            trend: trend.inverse_width > 0.0,
            thickness: trend.thickness,
            normal: foot.normal,
            point: foot.point,
            corners: [NONE; 2],
        };
        if self.rules.falloff == Falloff::Light && before && x < w {
            self.cut_corners(maps, edge, receiver, &mut found);
        }
        found
    }

    /// Whether the receiver, moved to a place in the image, is in the hard shadow there.
    #[inline(always)]
    pub(super) fn hidden_at(&self, maps: &Maps, texel: usize, receiver: &Receiver) -> bool {
        self.hides(maps, &FirstHit::at(maps, texel), receiver)
    }

    /// Whether what a ray sees hides the receiver that was moved to it. The receiver is up to a texel's diagonal
    /// off the ray: as at its own place, two planes keep its surface from hiding it.
    #[inline(always)]
    fn hides(&self, maps: &Maps, seen: &FirstHit, receiver: &Receiver) -> bool {
        seen.inverse_depth > receiver.inverse_depth
            && (receiver.normal == DVec3::ZERO
                || receiver.is_below(seen.at.extend(1.0), seen.inverse_depth, receiver.slack))
            && self
                .planes
                .borrow_mut()
                .get(self.geometry, maps, seen.triangle)
                .is_some_and(|plane| plane.hides(receiver, receiver.slack))
    }

    /// Figure 5, repeated.
    fn evaluate(&self, maps: &Maps, receiver: &Receiver, start: (bool, u32)) -> f64 {
        let view = &maps.view;
        let (mut hidden, mut edge) = start;
        if edge == NONE {
            return if hidden { 0.0 } else { 1.0 };
        }
        let mut from = receiver.at;
        // One factor a penumbra.
        let mut known: [Option<Penumbra>; MOST_STEPS] = [None; MOST_STEPS];
        let mut edges = [NONE; MOST_STEPS];
        let mut count = 0;
        for step in 0..self.rules.steps {
            let here = self.penumbra(maps, edge, from, receiver);
            if !here.before {
                // An edge behind the receiver says nothing about it.
                break;
            }
            if here.x >= here.w {
                // Nor does one that is too far off; but the drawn silhouette may be a texel off the edge.
                hidden &= step == 0 && here.x > here.w + DRAWN;
                break;
            }
            let sees = !start.0 || (!hidden && !maps.seen.is_empty());
            let drawn = if step == 0 { DRAWN } else { 0.0 };
            if sees && here.x < -here.w - drawn {
                // It would hide all of the light from a receiver that sees some, from its own place or, as the
                // reference image knows, in the middle of what was left: it bounds what the receiver lies on.
                break;
            }
            edges[step] = edge;
            let same = |k: &Option<Penumbra>| k.is_some_and(|k| k.same(&here));
            let k = known[..count].iter().position(same).unwrap_or(count);
            let mut kept = here;
            if let Some(before) = known[k].filter(|_| k < count) {
                kept.visible = kept.visible.min(before.visible);
            }
            known[k] = Some(kept);
            count = count.max(k + 1);
            if here.visible == 0.0 {
                break;
            }
            let distortion = 0.5 * (here.w - here.x);
            from = here.middle(maps, receiver.at, distortion);
            let Some(texel) = view.texel(from) else {
                hidden = false;
                break;
            };
            let seen = FirstHit::at(maps, texel);
            hidden = self.hides(maps, &seen, receiver);
            if !(step == 0 && start.0) {
                // What is beside the cone to the light hides nothing.
                hidden &= here.scale * (seen.inverse_depth - receiver.inverse_depth) >= distortion;
            }
            let next = Self::edge(maps, texel, hidden, receiver);
            if next == NONE {
                break;
            }
            let foot = maps.lines[next as usize].foot(from);
            if hidden
                && foot.x > -DRAWN
                && foot.point.distance(here.point) <= CLOSE + 0.25 * here.w
                && !here.is_before(foot.normal, foot.point)
            {
                // The drawing of the same silhouette covers the distorted point by its rounding.
                hidden = false;
                break;
            }
            if here.has(maps, next) {
                hidden = false;
                break;
            }
            if edges[..=step].contains(&next) {
                // What they leave of the light is beyond none of them: no umbra.
                hidden = false;
                break;
            }
            edge = next;
        }
        if hidden && count < self.rules.steps {
            return 0.0;
        }
        let first = known[0];
        let product = together(&mut known[..count]);
        match first {
            Some(first) if self.rules.thin && !first.trend => {
                (product + self.past(maps, receiver, &first)).min(1.0)
            }
            _ => product,
        }
    }

    /// What a receiver sees past the other side of a thin occluder: beyond an edge in the part of the light
    /// that the first edge alone would hide.
    fn past(&self, maps: &Maps, receiver: &Receiver, first: &Penumbra) -> f64 {
        let from = receiver.at - first.normal * (0.5 * (first.w + first.x));
        let Some(texel) = maps.view.texel(from) else {
            return 0.0;
        };
        // No ray is bent from the lit side for what is looked for on the dark one.
        let hidden = self.hides(maps, &FirstHit::straight(maps, texel), receiver);
        let edge = Self::edge(maps, texel, hidden, receiver);
        if edge == NONE || first.has(maps, edge) {
            return 0.0;
        }
        let other = self.penumbra(maps, edge, from, receiver);
        if other.before && other.normal.dot(first.normal) < -SAME {
            other.visible
        } else {
            0.0
        }
    }
}

/// What several penumbrae leave of the light.
///
/// What the two sides of a gap hide lies on opposite sides of the light, and adds up; what edges across hide is in a
/// part of each other, and what they leave is multiplied. Between, the parts that two lines through a disk's middle
/// hide together are linear in the angle between them: so is what they leave.
fn together(known: &mut [Option<Penumbra>]) -> f64 {
    let mut product = 1.0;
    for i in 0..known.len() {
        let Some(one) = known[i].take() else {
            continue;
        };
        // The one across the gap, if there is any.
        let faces = |k: &Option<Penumbra>| k.map_or(0.0, |k| one.faces(k.normal, k.point));
        let other =
            (i + 1..known.len()).max_by(|&a, &b| faces(&known[a]).total_cmp(&faces(&known[b])));
        let found = other.map(|k| (k, faces(&known[k]))).filter(|f| f.1 > 0.0);
        let Some((k, sine)) = found else {
            product *= one.visible;
            continue;
        };
        let other = known[k].take().map_or(1.0, |k| k.visible);
        let apart = (one.visible + other - 1.0).max(0.0);
        let across = one.visible * other;
        product *= across + (apart - across) * sine.min(1.0).asin() * FRAC_2_PI;
    }
    product
}

/// What an edge does to a receiver.
#[derive(Clone, Copy)]
pub(super) struct Penumbra {
    /// Distance from the edge in texels, positive on its lit side.
    x: f64,
    /// Half-width in texels.
    pub w: f64,
    /// Half-width (texels) of the penumbra for each unit of inverse depth between edge and receiver.
    scale: f64,
    /// Whether the edge is before the receiver at all.
    before: bool,
    /// Whether the silhouette's trend stands for the edge, and how far away its other side is then, in texels.
    trend: bool,
    thickness: f64,
    /// The part of the light that the edge leaves.
    pub visible: f64,
    pub normal: DVec2,
    point: DVec2,
    /// Numbers in [`Maps::corners`] of the corners at its start and its end that the visibility takes into account, or
    /// [`NONE`].
    pub corners: [u32; 2],
}

impl Penumbra {
    /// Whether two edges are of one silhouette, or of nested ones, so that only the darker counts: by their
    /// normals, or by their places; or the two sides of what both are known to bound.
    fn same(&self, other: &Penumbra) -> bool {
        self.normal.dot(other.normal) > SAME
            || (self.point.distance(other.point) <= CLOSE + 0.25 * self.w.min(other.w)
                && (other.trend || !self.is_before(other.normal, other.point)))
            || self.is_other_side(other)
    }

    /// How much another edge faces this one over a gap: the cosine between this one's normal and the reverse of the
    /// other's; 0 or below where they do not, as the two sides of a bar.
    fn faces(&self, normal: DVec2, point: DVec2) -> f64 {
        let ahead = (point - self.point).dot(self.normal) > 0.0;
        if ahead { -self.normal.dot(normal) } else { 0.0 }
    }

    /// Whether another edge bounds a gap with this one, however narrow. Where the trend stands for an edge, what
    /// faces it is the other side of a dent of the same silhouette.
    fn is_before(&self, normal: DVec2, point: DVec2) -> bool {
        !self.trend && self.faces(normal, point) > SAME
    }

    /// Whether an edge that faces away is about as far off as the other side.
    fn is_other_side(&self, other: &Penumbra) -> bool {
        self.thickness < f64::INFINITY
            && self.normal.dot(other.normal) < -0.5
            && (self.point - other.point).dot(self.normal).abs() < 1.5 * self.thickness + CLOSE
    }
}
