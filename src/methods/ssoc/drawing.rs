//! Silhouettes as quads and fans, and what they leave in the texels of the distortion maps: the nearest one on each
//! side.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::maps::Line;
use crate::maps::views::View;
use crate::memory::filled;
use crate::raster::coverage;
use crate::raster::coverage::Quadrilateral;
use crate::raster::nearest::NONE;
use crate::raster::setup::PixelBounds;
use crate::raster::{Cover, Tile};

/// Added to the squared distance of edges with narrow penumbrae: more than that of any other.
const LAST: f64 = 1e12;

/// Largest part of a turn that one triangle of a fan fills; its tip is then 8 % farther out than the reach.
const FAN: f64 = std::f64::consts::FRAC_PI_4;

/// Radians by which a fan overlaps what is beside it: edges that are equal but for rounding leave texels between
/// them. Where both cover a texel, the nearest line decides.
const OVERLAP: f64 = 1e-6;

/// Lines, or corners between them, that one task draws.
const PART: usize = 1024;

/// The quads and fans of all lines, for the rasteriser.
#[derive(Default)]
pub(super) struct Drawing {
    pub points: Vec<DVec3>,
    pub bounds: Vec<PixelBounds>,
    pub faces: Vec<Quadrilateral>,
    pub line_of: Vec<u32>,
}

impl Drawing {
    pub(super) fn new(
        lines: &[Line],
        joints: &[[u32; 2]],
        loose: &[(u32, bool)],
        view: &View,
    ) -> Self {
        let of_lines = lines.par_chunks(PART).enumerate().map(|(part, chunk)| {
            let mut out = Drawing::default();
            for (i, line) in (part * PART..).zip(chunk) {
                let side = line.normal() * line.reach;
                let end = line.start + line.along * line.length;
                let corners = [line.start - side, end - side, end + side, line.start + side];
                let first = out.points.len() as u32;
                out.points.extend(corners.map(|p| p.extend(1.0)));
                out.faces.push([0, 1, 2, 3].map(|k| first + k));
                out.line_of.push(i as u32);
            }
            out
        });
        let of_joints = joints.par_chunks(PART).map(|chunk| {
            let mut out = Drawing::default();
            for &[before, after] in chunk {
                out.corner(lines, before, after);
            }
            out
        });
        let of_loose = loose.par_chunks(PART).map(|chunk| {
            let mut out = Drawing::default();
            for &(line, starts) in chunk {
                // What a narrow penumbra has around an end is the texel's staircase.
                if !lines[line as usize].is_narrow() {
                    out.cap(lines, line, starts);
                }
            }
            out
        });
        Drawing::join(of_lines.chain(of_joints).chain(of_loose).collect(), view)
    }

    /// Joins several drawings into one; the faces keep the drawings' order.
    fn join(parts: Vec<Drawing>, view: &View) -> Self {
        let sum = |len: fn(&Drawing) -> usize| parts.iter().map(len).sum();
        let count = sum(|part| part.faces.len());
        let mut out = Drawing {
            points: filled(DVec3::ZERO, sum(|part| part.points.len())),
            faces: filled(Quadrilateral::default(), count),
            line_of: filled(NONE, count),
            ..Drawing::default()
        };
        let mut left = (
            &mut out.points[..],
            &mut out.faces[..],
            &mut out.line_of[..],
        );
        let (mut places, mut first) = (Vec::with_capacity(parts.len()), 0);
        for part in &parts {
            let (points, faces, line_of);
            (points, left.0) = left.0.split_at_mut(part.points.len());
            (faces, left.1) = left.1.split_at_mut(part.faces.len());
            (line_of, left.2) = left.2.split_at_mut(part.faces.len());
            places.push((part, first, points, faces, line_of));
            first += part.points.len() as u32;
        }
        places
            .into_par_iter()
            .for_each(|(part, first, points, faces, line_of)| {
                points.copy_from_slice(&part.points);
                line_of.copy_from_slice(&part.line_of);
                for (face, own) in faces.iter_mut().zip(&part.faces) {
                    *face = own.map(|point| first + point);
                }
            });
        let bounds = out.points.par_iter();
        out.bounds = bounds
            .map(|&p| PixelBounds::of_vertex(p, &view.camera))
            .collect();
        out
    }

    fn triangle(&mut self, line: u32, corners: [DVec2; 3]) {
        let first = self.points.len() as u32;
        self.points.extend(corners.map(|p| p.extend(1.0)));
        self.faces
            .push(coverage::triangle([first, first + 1, first + 2]));
        self.line_of.push(line);
    }

    /// Fills a sector around a line's end, from direction `from` over an angle (signed).
    fn sector(&mut self, line: u32, tip: DVec2, from: DVec2, angle: f64, reach: f64) {
        let overlap = OVERLAP.copysign(angle);
        let (from, angle) = (
            DVec2::from_angle(-overlap).rotate(from),
            angle + 2.0 * overlap,
        );
        let pieces = (angle.abs() / FAN).ceil().max(1.0);
        let step = DVec2::from_angle(angle / pieces);
        let reach = reach / (0.5 * angle / pieces).cos();
        let mut side = from * reach;
        for _ in 0..pieces as u32 {
            let next = step.rotate(side);
            self.triangle(line, [tip, tip + side, tip + next]);
            side = next;
        }
    }

    /// Fills the gap between two lines that follow each other, half with each.
    fn corner(&mut self, lines: &[Line], before: u32, after: u32) {
        let (a, b) = (&lines[before as usize], &lines[after as usize]);
        let turn = a.along.angle_to(b.along);
        if turn == 0.0 {
            return;
        }
        // The quads part on the side away from the turn.
        let side = if turn < 0.0 { 1.0 } else { -1.0 };
        self.sector(before, b.start, side * a.normal(), 0.5 * turn, a.reach);
        self.sector(after, b.start, side * b.normal(), -0.5 * turn, b.reach);
    }

    /// Fills the half disk at a line's loose end.
    fn cap(&mut self, lines: &[Line], line: u32, starts: bool) {
        let l = &lines[line as usize];
        let (tip, turn) = match starts {
            true => (l.start, std::f64::consts::PI),
            false => (l.start + l.along * l.length, -std::f64::consts::PI),
        };
        self.sector(line, tip, l.normal(), turn, l.reach);
    }
}

/// The nearest line of every texel of a tile, on the dark and the lit side.
pub(super) struct Distances<'a> {
    tile: Tile,
    all: &'a [Line],
    line_of: &'a [u32],
    distance: [Vec<f64>; 2],
    pub lines: [Vec<u32>; 2],
}

impl<'a> Distances<'a> {
    pub(super) fn new(tile: Tile, all: &'a [Line], line_of: &'a [u32]) -> Self {
        let n = (tile.width * tile.height) as usize;
        Distances {
            tile,
            all,
            line_of,
            distance: [vec![f64::INFINITY; n], vec![f64::INFINITY; n]],
            lines: [vec![NONE; n], vec![NONE; n]],
        }
    }
}

impl Cover for Distances<'_> {
    fn row(&mut self, y: u32, first: u32, last: u32, face: u32) {
        let start = ((y - self.tile.y) * self.tile.width + (first - self.tile.x)) as usize;
        let id = self.line_of[face as usize];
        let line = &self.all[id as usize];
        let from = DVec2::new(f64::from(first) + 0.5, f64::from(y) + 0.5) - line.start;
        let (at, across) = (from.dot(line.along), from.dot(line.normal()));
        for i in 0..=(last - first) as usize {
            let at = at + i as f64 * line.along.x;
            let across = across - i as f64 * line.along.y;
            let beyond = at - at.clamp(0.0, line.length);
            let distance = across * across + beyond * beyond;
            if distance > line.reach * line.reach {
                continue;
            }
            // Behind all others.
            let distance = match line.is_narrow() {
                true => distance + LAST,
                false => distance,
            };
            let side = usize::from(across > 0.0);
            if distance < self.distance[side][start + i] {
                self.distance[side][start + i] = distance;
                self.lines[side][start + i] = id;
            }
        }
    }
}
