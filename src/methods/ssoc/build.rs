//! Building the shadow map of a view, and its inside and outside distortion maps.
//!
//! Silhouette edges are projected into the view and extruded along their normals to both sides, as far as the
//! widest penumbra that they can cast in the scene; fans fill the gaps at corners.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::corners;
use super::drawing::{Distances, Drawing};
use super::maps::{Line, Maps, Trend};
use crate::casters::Casters;
use crate::casters::edges::Edge;
use crate::control::Control;
use crate::error::Result;
use crate::geometry::Geometry;
use crate::maps::views::View;
use crate::raster::nearest::{NONE, Nearest};
use crate::raster::setup::NEAR;
use crate::raster::{cover_projected, image, rasterize};

/// Texels that an edge reaches beyond its penumbra: a lookup's neighbours are up to one away in each
/// direction.
const REACH: f64 = 2.0;

/// Distances along an edge's normal, in texels, from and up to which what lies behind it is looked up. Farther
/// away it is no longer what is behind this edge: a bump's near an outline would pass for the outline.
const FIRST_PROBE: f64 = 1.5;
const LAST_PROBE: f64 = 4.0;

/// Half-width in texels of the narrowest penumbra that the maps hold, about half a texel's diagonal: the shadow
/// map's own staircase. Edges with less, such as those of bumps on a body, would take the texels around them from
/// its outline: they get what other edges leave, and say nothing about receivers for which theirs is twice as wide.
const NARROW: f64 = 0.75;

/// Half-width in texels that such an edge's penumbra would have at the scene's far end: where none is wider, as under
/// a small light, edges do not crowd, and all of them are alike.
const WIDE: f64 = 8.0 * NARROW;

impl Maps {
    /// The shadow map, and still no lines.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    pub fn shadow_map(
        view: View,
        casters: &Casters,
        casts: &[bool],
        control: &Control,
    ) -> Result<Maps> {
        let geometry = casters.geometry();
        let tiles = match &view.only {
            None => rasterize(
                &geometry.positions,
                &geometry.faces,
                |f| casts[f as usize],
                &view.camera,
                control,
                Nearest::new,
            )?,
            Some(only) => {
                let positions: Vec<_> = only.iter().flat_map(|&f| geometry.corners(f)).collect();
                let faces: Vec<_> = (0..only.len() as u32)
                    .map(|i| [0, 1, 2].map(|k| 3 * i + k))
                    .collect();
                let camera = &view.camera;
                rasterize(&positions, &faces, |_| true, camera, control, Nearest::new)?
            }
        };
        let inverse_depth = image(&tiles, &view.camera, |n| &n.inverse_depth);
        let mut triangle = image(&tiles, &view.camera, |n| &n.triangle);
        if let Some(only) = &view.only {
            let shown = triangle.iter_mut().filter(|t| **t != NONE);
            shown.for_each(|t| *t = only[*t as usize]);
        }
        Ok(Maps {
            view,
            inverse_depth,
            triangle,
            lines: Vec::new(),
            corners: Vec::new(),
            inside: Vec::new(),
            outside: Vec::new(),
            seen: Vec::new(),
        })
    }

    /// Draws the silhouettes into the distortion maps.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    pub fn distortion(
        &mut self,
        edges: &[Edge],
        geometry: &Geometry,
        control: &Control,
    ) -> Result<()> {
        let vertices: Option<Vec<u32>> = self.view.only.as_ref().map(|only| {
            let faces = only.iter().map(|&f| geometry.faces[f as usize]);
            let mut vertices: Vec<u32> = faces.flatten().collect();
            vertices.sort_unstable();
            vertices
        });
        let shown = |e: &&Edge| match &vertices {
            None => true,
            Some(v) => e.vertices.iter().all(|end| v.binary_search(end).is_ok()),
        };
        self.lines = edges
            .par_iter()
            .filter(shown)
            .filter_map(|e| match control.check() {
                Ok(()) => self.line(e).map(Ok),
                Err(cancelled) => Some(Err(cancelled)),
            })
            .collect::<Result<_>>()?;
        let (joints, loose) = ends(&self.lines);
        self.corners = corners::find(&mut self.lines, &joints);
        let drawing = Drawing::new(&self.lines, &joints, &loose, &self.view);
        let lines = &self.lines;
        let tiles = cover_projected(
            &drawing.points,
            &drawing.bounds,
            &drawing.faces,
            &self.view.camera,
            control,
            |tile| Distances::new(tile, lines, &drawing.line_of),
        )?;
        self.inside = image(&tiles, &self.view.camera, |d| &d.lines[0]);
        self.outside = image(&tiles, &self.view.camera, |d| &d.lines[1]);
        Ok(())
    }

    /// An edge in the image; `None` where it is out of sight, cannot matter, or is seen end-on.
    fn line(&self, edge: &Edge) -> Option<Line> {
        if edge.front + edge.back == 0 {
            return None;
        }
        let camera = &self.view.camera;
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let [a, b] = edge.ends.map(|p| camera.project(p));
        // Half an image around the image, which is more than its margin.
        let (t0, t1) = clip(a, b, -0.5 * size, 1.5 * size)?;
        let at = |t: f64| a + (b - a) * t;
        let (p, q) = (at(t0), at(t1));
        let (start, end) = (p.truncate() / p.z, q.truncate() / q.z);
        let length = start.distance(end);
        let along = (end - start) / length;
        if !(along.is_finite() && length > 0.0) {
            return None;
        }
        let (i, j) = (1.0 / p.z, 1.0 / q.z);
        let mut line = Line {
            start,
            along,
            length,
            inverse_depth: [i, (j - i) / length],
            inverse_far: self.view.inverse_far,
            inverse_least: 0.0,
            reach: 0.0,
            corners: [NONE; 2],
            trend: Trend::NONE,
            ends: [
                if t0 == 0.0 { edge.vertices[0] } else { NONE },
                if t1 == 1.0 { edge.vertices[1] } else { NONE },
            ],
        };
        line.inverse_far = self.behind(&line)?;
        let width = self.width(&line, line.inverse_far);
        let widest = self.width(&line, self.view.inverse_far);
        if width < NARROW && widest > WIDE {
            let near = line.inverse_nearest();
            let far = self.view.inverse_far;
            line.inverse_least = near - (near - far) * (2.0 * NARROW / widest);
            // Corners and fans are of other edges alone.
            line.ends = [NONE; 2];
        }
        line.reach = width + REACH;
        line.trend = self.trend(&line, width);
        Some(line)
    }

    /// Widest penumbra, in texels, of a line on receivers down to an inverse depth.
    fn width(&self, line: &Line, inverse_far: f64) -> f64 {
        let end = line.start + line.along * line.length;
        let radius = |q| {
            self.view
                .outline
                .radius(line.normal(), self.view.tangents(q))
                .0
        };
        let near = line.inverse_nearest();
        let widest = radius(line.start).max(radius(end));
        self.view.focal * widest * (near - inverse_far).max(0.0)
    }

    /// Inverse depth of the farthest surface that is seen behind a line on its lit side; `None` if wherever it
    /// is looked for something hides the line from the light by more than a texel's parallax.
    fn behind(&self, line: &Line) -> Option<f64> {
        let most = self
            .width(line, self.view.inverse_far)
            .clamp(FIRST_PROBE, LAST_PROBE);
        // A probe every 32 texels of a long line.
        let places = (line.length / 32.0).clamp(1.0, 16.0) as u32;
        let (mut inverse_far, mut open) = (f64::INFINITY, false);
        for place in 0..places {
            let t = line.length * (f64::from(place) + 0.5) / f64::from(places);
            let near = line.inverse_depth[0] + t * line.inverse_depth[1];
            let from = line.start + line.along * t;
            let mut distance = FIRST_PROBE;
            loop {
                let reach = distance.min(most);
                let Some(texel) = self.view.texel(from + line.normal() * reach) else {
                    // Out of the map nothing is known.
                    return Some(self.view.inverse_far);
                };
                let seen = self.inverse_depth[texel];
                let (radius, _) = self
                    .view
                    .outline
                    .radius(line.normal(), self.view.tangents(from));
                if self.view.focal * radius * (seen - near) <= 1.0 {
                    open = true;
                    let seen = if seen > 0.0 {
                        seen
                    } else {
                        self.view.inverse_far
                    };
                    inverse_far = inverse_far.min(seen);
                }
                if distance >= most {
                    break;
                }
                distance *= 1.5;
            }
        }
        open.then_some(inverse_far)
    }
}

/// The part of a homogeneous segment over a rectangle of the image, before the eye.
fn clip(a: DVec3, b: DVec3, low: DVec2, high: DVec2) -> Option<(f64, f64)> {
    let (mut t0, mut t1) = (0.0f64, 1.0f64);
    let planes = [
        |p: DVec3, low: DVec2, _: DVec2| p.x - low.x * p.z,
        |p: DVec3, _: DVec2, high: DVec2| high.x * p.z - p.x,
        |p: DVec3, low: DVec2, _: DVec2| p.y - low.y * p.z,
        |p: DVec3, _: DVec2, high: DVec2| high.y * p.z - p.y,
        |p: DVec3, _: DVec2, _: DVec2| p.z - NEAR,
    ];
    for plane in planes {
        let (d0, d1) = (plane(a, low, high), plane(b, low, high));
        if d0 < 0.0 && d1 < 0.0 {
            return None;
        }
        if d0 < 0.0 {
            t0 = t0.max(d0 / (d0 - d1));
        } else if d1 < 0.0 {
            t1 = t1.min(d0 / (d0 - d1));
        }
    }
    (t0 < t1).then_some((t0, t1))
}

/// Pairs of lines of which the second alone starts where the first alone ends; and all other ends, by line and
/// whether it starts there.
fn ends(lines: &[Line]) -> (Vec<[u32; 2]>, Vec<(u32, bool)>) {
    let mut ends: Vec<(u32, bool, u32)> = Vec::with_capacity(2 * lines.len());
    for (i, line) in lines.iter().enumerate() {
        ends.push((line.ends[0], true, i as u32));
        ends.push((line.ends[1], false, i as u32));
    }
    ends.par_sort_unstable();
    let (mut joints, mut loose) = (Vec::with_capacity(lines.len()), Vec::new());
    for at in ends.chunk_by(|a, b| a.0 == b.0 && a.0 != NONE) {
        match *at {
            [(_, false, before), (_, true, after)] => joints.push([before, after]),
            _ => loose.extend(at.iter().map(|&(_, starts, line)| (line, starts))),
        }
    }
    (joints, loose)
}
