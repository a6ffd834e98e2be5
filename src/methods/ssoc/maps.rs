//! What the soft shadow occlusion camera keeps of a view: a shadow map, and an inside and an outside distortion map.
//!
//! Every texel of a distortion map keeps, on each side, the silhouette edge nearest to it (Section 3.2.1): the six
//! values of the paper follow from the edge exactly, instead of being interpolated from rounded ones.

use glam::DVec2;

use crate::maps::views::View;
use crate::raster::nearest::NONE;

/// A silhouette edge in the image, what it hides on its left (as rows run downwards, towards the negative
/// side of [`Line::normal`]).
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Where it starts, in texels.
    pub start: DVec2,
    /// Unit direction.
    pub along: DVec2,
    /// Length in texels.
    pub length: f64,
    /// Inverse depth at the start, and its change a texel.
    pub inverse_depth: [f64; 2],
    /// Inverse depth of the farthest surface behind it, as far as the map knows.
    pub inverse_far: f64,
    /// Inverse depth of the farthest receivers that it can matter for.
    pub inverse_least: f64,
    /// Texels to either side that it can matter for.
    pub reach: f64,
    /// Numbers in [`Maps::corners`] of the sharp corners at its start and its end, or [`NONE`].
    pub corners: [u32; 2],
    /// What the silhouette is like around it.
    pub trend: Trend,
    /// Vertices of the scene at its ends, or [`NONE`] where it was clipped.
    pub(super) ends: [u32; 2],
}

/// The point of a silhouette nearest to an image point.
#[derive(Debug, Clone, Copy)]
pub struct Foot {
    /// Signed distance from the silhouette, positive on the lit side.
    pub x: f64,
    /// Unit normal to the lit side.
    pub normal: DVec2,
    /// The nearest point.
    pub point: DVec2,
    /// Inverse depth there: that of `z_near`.
    pub inverse_near: f64,
}

impl Line {
    /// Unit normal, to the lit side.
    #[inline(always)]
    pub fn normal(&self) -> DVec2 {
        DVec2::new(-self.along.y, self.along.x)
    }

    /// Whether its penumbra is narrow on all that is behind it.
    #[inline(always)]
    pub(super) fn is_narrow(&self) -> bool {
        self.inverse_least > 0.0
    }

    /// Inverse depth of its end nearer to the light.
    pub(super) fn inverse_nearest(&self) -> f64 {
        let [start, change] = self.inverse_depth;
        start.max(start + self.length * change)
    }

    /// The nearest point to `q`.
    #[inline(always)]
    pub fn foot(&self, q: DVec2) -> Foot {
        let from = q - self.start;
        let at = from.dot(self.along);
        let t = at.clamp(0.0, self.length);
        let across = from.dot(self.normal());
        let inverse_near = self.inverse_depth[0] + t * self.inverse_depth[1];
        let point = self.start + self.along * t;
        if t == at {
            return Foot {
                x: across,
                normal: self.normal(),
                point,
                inverse_near,
            };
        }
        // Beyond an end: the distance from a corner.
        let beyond = q - point;
        let x = beyond.length().copysign(across);
        Foot {
            x,
            normal: beyond / x,
            point,
            inverse_near,
        }
    }
}

/// Where a silhouette turns sharply.
#[derive(Debug, Clone, Copy)]
pub struct Corner {
    /// Place of the corner in the map, in texels.
    pub point: DVec2,
    /// The lines that end and start there.
    pub lines: [u32; 2],
    /// How far the silhouette runs about straight on from there, on the first line's side and the second's, in
    /// texels.
    pub arms: [f64; 2],
    /// Image points on the lit side of the first line and of the second.
    pub beside: [DVec2; 2],
    /// Whether it hides what both lines hide, not what either does.
    pub convex: bool,
}

/// What a silhouette is like around an edge.
#[derive(Debug, Clone, Copy)]
pub struct Trend {
    /// Unit normal to the lit side.
    pub normal: DVec2,
    /// Product of the normal with the line's points.
    pub offset: f64,
    /// One over the half-width, in texels, of the penumbra that it is for; 0 where an edge stands for itself.
    pub inverse_width: f64,
    /// Distance to the other side of what the silhouette bounds, in texels; infinite if out of the light's reach.
    pub thickness: f64,
}

impl Trend {
    /// No trend: the edge stands for itself, and has no other side.
    pub const NONE: Trend = Trend {
        normal: DVec2::ZERO,
        offset: 0.0,
        inverse_width: 0.0,
        thickness: f64::INFINITY,
    };
}

/// What a distorted ray sees first.
#[derive(Debug, Clone, Copy)]
pub struct FirstHit {
    /// Where that is without distortion, in the image of focal length 1.
    pub at: DVec2,
    /// Its inverse depth, 0 where there is nothing.
    pub inverse_depth: f64,
    /// Its triangle, or [`NONE`].
    pub triangle: u32,
}

impl FirstHit {
    pub(super) const NOTHING: FirstHit = FirstHit {
        at: DVec2::ZERO,
        inverse_depth: 0.0,
        triangle: NONE,
    };

    /// What the ray of a texel sees: straight without a reference image.
    #[inline(always)]
    pub fn at(maps: &Maps, texel: usize) -> FirstHit {
        match maps.seen.get(texel) {
            Some(&seen) => seen,
            None => FirstHit::straight(maps, texel),
        }
    }

    /// What the shadow map has at a texel.
    #[inline(always)]
    pub fn straight(maps: &Maps, texel: usize) -> FirstHit {
        FirstHit {
            at: maps.view.tangents(maps.view.center(texel)),
            inverse_depth: maps.inverse_depth[texel],
            triangle: maps.triangle[texel],
        }
    }
}

/// The maps of a view.
pub struct Maps {
    /// The view that the maps are drawn from.
    pub view: View,
    /// Inverse depth of the nearest casting surface, 0 where there is none.
    pub inverse_depth: Vec<f64>,
    /// Its triangle.
    pub triangle: Vec<u32>,
    /// Silhouette edges in the image.
    pub lines: Vec<Line>,
    /// The silhouettes' sharp corners.
    pub corners: Vec<Corner>,
    /// For each texel on the dark side of silhouettes the nearest line, or [`NONE`].
    pub inside: Vec<u32>,
    /// For each texel on the lit side of silhouettes the nearest line, or [`NONE`].
    pub outside: Vec<u32>,
    /// The reference image, what the distorted ray of each texel sees first; empty without ([`Maps::reference`]).
    pub seen: Vec<FirstHit>,
}

impl Maps {
    /// Bytes of the maps.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.inverse_depth[..])
            + size_of_val(&self.triangle[..])
            + size_of_val(&self.lines[..])
            + size_of_val(&self.corners[..])
            + size_of_val(&self.inside[..])
            + size_of_val(&self.outside[..])
            + size_of_val(&self.seen[..])
    }
}
