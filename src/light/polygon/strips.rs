//! An outline cut into strips across its first axis, and the map from the square onto it, equal in area.
//!
//! A strip reaches from one corner's first coordinate to the next. Edges run all through it, so that it is made of
//! trapezoids, and the outline's width in it changes in proportion. The map is the distribution's inverse, as of any
//! density in the plane (Rosenblatt 1952): the first coordinate goes to where that part of the area is passed, which is a
//! square root, the second to that part of the width there. So what is stratified in the square is in the polygon,
//! and neighbours stay together but where the outline has a gap between.

use std::fmt;

use glam::DVec2;

use crate::simd::{LANES, Row};

/// Entries of the table that says in which strip to begin.
const GUIDE: usize = 256;

/// What of an outline lies between two coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Strip {
    /// Part of the area before it, and the reciprocal of its own.
    before: f32,
    scale: f32,
    /// Where it starts, and how wide it is.
    x: f32,
    dx: f32,
    /// Width of the outline at its start and its end.
    widths: [f32; 2],
    /// Its trapezoids: the first and the one after the last.
    trapezoids: [u32; 2],
}

/// Lower and upper side of a trapezoid, each at the start and the end of its strip.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Trapezoid {
    low: [f32; 2],
    high: [f32; 2],
}

/// An outline in strips, in coordinates in which it fills [-1, 1] along both axes.
#[derive(Clone, PartialEq)]
pub(crate) struct Strips {
    /// Middle and half sides of the rectangle around the outline that becomes [-1, 1]².
    pub(super) around: (DVec2, DVec2),
    strips: Vec<Strip>,
    trapezoids: Vec<Trapezoid>,
    guide: Vec<u32>,
}

impl fmt::Debug for Strips {
    /// Its size: tables of hundreds of lines tell nobody anything.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (strips, trapezoids) = (self.strips.len(), self.trapezoids.len());
        write!(f, "Strips({strips}, of {trapezoids} trapezoids)")
    }
}

impl Strips {
    /// Cuts an outline without double points.
    pub(super) fn new(corners: &[DVec2]) -> Strips {
        let (low, high) = corners
            .iter()
            .fold((corners[0], corners[0]), |(low, high), &c| {
                (low.min(c), high.max(c))
            });
        let around = (0.5 * (low + high), 0.5 * (high - low));
        let places: Vec<DVec2> = corners.iter().map(|&c| (c - around.0) / around.1).collect();
        let next = places.iter().cycle().skip(1);
        let mut edges: Vec<[DVec2; 2]> = places
            .iter()
            .zip(next)
            .filter(|(a, b)| a.x != b.x)
            .map(|(&a, &b)| if a.x < b.x { [a, b] } else { [b, a] })
            .collect();
        edges.sort_by(|a, b| a[0].x.total_cmp(&b[0].x));
        let mut ends: Vec<f64> = places.iter().map(|p| p.x).collect();
        ends.sort_by(f64::total_cmp);
        ends.dedup();
        let mut areas = Vec::new();
        let (mut strips, mut trapezoids) = (Vec::new(), Vec::new());
        let (mut open, mut coming): (Vec<[DVec2; 2]>, _) =
            (Vec::new(), edges.into_iter().peekable());
        for ends in ends.windows(2) {
            open.retain(|[_, b]| b.x > ends[0]);
            open.extend(std::iter::from_fn(|| {
                coming.next_if(|[a, _]| a.x <= ends[0])
            }));
            let at = |[a, b]: &[DVec2; 2], x: f64| {
                let part = (x - a.x) / (b.x - a.x);
                a.y + (b.y - a.y) * part
            };
            let middle = 0.5 * (ends[0] + ends[1]);
            open.sort_by(|a, b| at(a, middle).total_cmp(&at(b, middle)));
            let (start, mut widths) = (trapezoids.len(), [0.0; 2]);
            // Between the first and the second, the third and the fourth, … is the inside.
            for pair in open.chunks_exact(2) {
                let [low, high] =
                    [&pair[0], &pair[1]].map(|edge| [at(edge, ends[0]), at(edge, ends[1])]);
                let high = [high[0].max(low[0]), high[1].max(low[1])];
                for (width, (low, high)) in widths.iter_mut().zip(low.into_iter().zip(high)) {
                    *width += high - low;
                }
                let [low, high] = [low, high].map(|side| side.map(|y| y as f32));
                trapezoids.push(Trapezoid { low, high });
            }
            let area = 0.5 * (widths[0] + widths[1]) * (ends[1] - ends[0]);
            if area > 0.0 {
                areas.push(area);
                strips.push(Strip {
                    before: 0.0,
                    scale: 0.0,
                    x: ends[0] as f32,
                    dx: (ends[1] - ends[0]) as f32,
                    widths: widths.map(|w| w as f32),
                    trapezoids: [start as u32, trapezoids.len() as u32],
                });
            } else {
                trapezoids.truncate(start);
            }
        }
        let all: f64 = areas.iter().sum();
        let mut before = 0.0;
        for (strip, area) in strips.iter_mut().zip(areas) {
            strip.before = (before / all) as f32;
            strip.scale = (all / area).min(f64::from(f32::MAX)) as f32;
            before += area;
        }
        let begin = |k: usize| {
            let part = k as f32 / GUIDE as f32;
            let after = strips.partition_point(|s| s.before <= part);
            after.saturating_sub(1) as u32
        };
        let guide = (0..GUIDE).map(begin).collect();
        Strips {
            around,
            strips,
            trapezoids,
            guide,
        }
    }

    /// Takes points of the square onto the outline.
    #[inline(always)]
    pub(crate) fn place(&self, x: &mut Row, y: &mut Row) {
        for lane in 0..LANES {
            [x.0[lane], y.0[lane]] = self.at(x.0[lane], y.0[lane]);
        }
    }

    /// The point of the outline that a point of (-1, 1)² becomes.
    #[inline(always)]
    fn at(&self, x: f32, y: f32) -> [f32; 2] {
        let part = 0.5 * x + 0.5;
        let mut k = self.guide[((part * GUIDE as f32) as usize).min(GUIDE - 1)] as usize;
        while let Some(strip) = self.strips.get(k + 1)
            && strip.before <= part
        {
            k += 1;
        }
        let strip = &self.strips[k];
        let within = ((part - strip.before) * strip.scale).clamp(0.0, 1.0);
        // With widths a and b, a t + (b - a) t² / 2 of the area is before t.
        let [a, b] = strip.widths;
        let root = (a * a + within * (b * b - a * a)).max(0.0).sqrt();
        let t = (within * (a + b) / (a + root).max(f32::MIN_POSITIVE)).min(1.0);
        let between = |[from, to]: [f32; 2]| from + (to - from) * t;
        let [first, after] = strip.trapezoids.map(|i| i as usize);
        let mut along = (0.5 * y + 0.5) * between(strip.widths);
        let mut found = 0.0;
        for trapezoid in &self.trapezoids[first..after] {
            let (low, high) = (between(trapezoid.low), between(trapezoid.high));
            let width = (high - low).max(0.0);
            found = low + along.min(width);
            if along <= width {
                break;
            }
            along -= width;
        }
        [strip.x + strip.dx * t, found]
    }
}
