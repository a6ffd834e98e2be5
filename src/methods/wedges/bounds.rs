//! Which receivers a wedge can reach: boxes of receivers against the planes around wedges, sixteen wedges at
//! a time.

use std::ops::Range;

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::{DVec3, Vec3};

use super::planes;
use crate::simd::{LANES, Lanes, Row, detect};

/// Coordinates within 2 and unit normals: distances are wrong by a few ulps of 4 at most.
const SLACK: f32 = 16.0 * f32::EPSILON;

/// Four planes that bound the receivers whose light an edge can cut: a receiver is outside where one of
/// `n · p - offset` is positive.
#[derive(Debug, Clone, Copy)]
pub struct WedgeBounds {
    normal: [Vec3; 4],
    offset: [f32; 4],
    /// The last two are side planes that may cross: only what is inside or outside of both alike is in.
    crossing: bool,
}

impl WedgeBounds {
    /// Bounds from unit normals and points on the planes; `None` bounds nothing.
    pub fn new(planes: [Option<(DVec3, DVec3)>; 4]) -> Self {
        let mut out = WedgeBounds {
            normal: [Vec3::ZERO; 4],
            offset: [SLACK; 4],
            crossing: false,
        };
        for (i, plane) in planes.into_iter().enumerate() {
            let Some((n, p)) = plane else { continue };
            out.normal[i] = n.as_vec3();
            out.offset[i] = n.dot(p) as f32 + SLACK;
        }
        out
    }

    /// Bounds of a wedge that lies between planes.
    pub fn of_wedge(wedge: &planes::Wedge) -> Self {
        let plane = |n: DVec3, p: &planes::Plane| Some((n, p.offset * p.normal));
        let [start, end] = &wedge.sides;
        let mut out = WedgeBounds::new([
            plane(wedge.front.normal, &wedge.front),
            plane(-wedge.back.normal, &wedge.back),
            plane(-start.normal, start),
            plane(end.normal, end),
        ]);
        out.crossing = true;
        out
    }
}

/// A box around receivers.
#[derive(Debug, Clone, Copy)]
pub struct ReceiverBox {
    /// Its middle.
    pub center: Vec3,
    /// Distances from the middle to its faces.
    pub half: Vec3,
}

impl ReceiverBox {
    /// Around points.
    pub fn of(points: impl Iterator<Item = DVec3>) -> Self {
        let (low, high) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| {
            (l.min(p), h.max(p))
        });
        let center = (0.5 * (low + high)).as_vec3();
        // Rounded to `f32`, the middle moves by half an ulp; coordinates are within 2.
        let half = (0.5 * (high - low)).as_vec3() + Vec3::splat(2.0 * f32::EPSILON);
        ReceiverBox { center, half }
    }
}

/// The bounds of sixteen wedges.
#[derive(Debug, Clone, Default)]
struct Sixteen {
    normal: [[Row; 3]; 4],
    offset: [Row; 4],
}

/// Bounds of many wedges, each with its number.
#[derive(Debug, Clone, Default)]
pub struct BoundsList {
    ids: Vec<u32>,
    rows: Vec<Sixteen>,
    crossing: bool,
}

impl BoundsList {
    /// All bounds, numbered in order; all of one kind of wedge.
    pub fn new(all: &[WedgeBounds]) -> Self {
        let mut out = BoundsList::default();
        for (i, b) in all.iter().enumerate() {
            let lane = out.next(i as u32);
            out.crossing = b.crossing;
            let row = out.rows.last_mut().expect("made by `next`");
            for plane in 0..4 {
                for axis in 0..3 {
                    row.normal[plane][axis].0[lane] = b.normal[plane][axis];
                }
                row.offset[plane].0[lane] = b.offset[plane];
            }
        }
        out
    }

    fn next(&mut self, id: u32) -> usize {
        let lane = self.ids.len() % LANES;
        if lane == 0 {
            self.rows.push(Sixteen::default());
        }
        self.ids.push(id);
        lane
    }

    /// Numbers of the wedges.
    pub fn ids(&self) -> &[u32] {
        &self.ids
    }

    /// Bytes taken.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.rows[..]) + size_of_val(&self.ids[..])
    }

    /// Keeps those that a box meets, or all.
    pub fn keep(&self, extent: Option<&ReceiverBox>) -> BoundsList {
        let (mut all, mut part) = (Selection::default(), Selection::default());
        self.part(0..self.ids.len(), &mut all);
        self.meeting(&all, extent, &mut part);
        let mut out = BoundsList {
            crossing: self.crossing,
            ..BoundsList::default()
        };
        part.each(|place| {
            let lane = out.next(self.ids[place]);
            let from = &self.rows[place / LANES];
            let to = out.rows.last_mut().expect("made by `next`");
            for plane in 0..4 {
                for axis in 0..3 {
                    to.normal[plane][axis].0[lane] = from.normal[plane][axis].0[place % LANES];
                }
                to.offset[plane].0[lane] = from.offset[plane].0[place % LANES];
            }
        });
        out
    }

    /// Writes to `out` the bounds at the places in `range`.
    pub fn part(&self, range: Range<usize>, out: &mut Selection) {
        out.0.clear();
        let (first, last) = (range.start / LANES, range.end.div_ceil(LANES));
        for block in first..last.max(first) {
            let below = |place: usize| match place.saturating_sub(block * LANES) {
                n if n < LANES => (1 << n) - 1,
                _ => u16::MAX,
            };
            let mask = below(range.end) & !below(range.start);
            if mask != 0 {
                out.0.push((block as u32, mask));
            }
        }
    }

    /// Writes to `out` the bounds of `part` that meet the box `extent`; all of them without a box.
    pub fn meeting(&self, part: &Selection, extent: Option<&ReceiverBox>, out: &mut Selection) {
        out.0.clear();
        let (rows, crossing) = (&self.rows[..], self.crossing);
        match extent {
            None => out.0.extend(&part.0),
            Some(extent) => {
                dispatch!(detect(), simd => meeting_lanes(simd, rows, crossing, part, extent, out))
            }
        }
    }

    /// Lists the numbers of the wedges of a part.
    pub fn list(&self, part: &Selection, out: &mut Vec<u32>) {
        out.clear();
        part.each(|place| out.push(self.ids[place]));
    }
}

/// Some of a [`BoundsList`]: by rows of sixteen, a bit each.
#[derive(Debug, Clone, Default)]
pub struct Selection(Vec<(u32, u16)>);

impl Selection {
    /// Whether it holds no bounds.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Number of bounds in this part.
    pub fn len(&self) -> usize {
        self.0
            .iter()
            .map(|(_, mask)| mask.count_ones() as usize)
            .sum()
    }

    fn each(&self, mut found: impl FnMut(usize)) {
        for &(block, mut mask) in &self.0 {
            while mask != 0 {
                found(block as usize * LANES + mask.trailing_zeros() as usize);
                mask &= mask - 1;
            }
        }
    }
}

#[inline(always)]
fn meeting_lanes<S: Simd>(
    simd: S,
    rows: &[Sixteen],
    crossing: bool,
    part: &Selection,
    extent: &ReceiverBox,
    out: &mut Selection,
) {
    for &(block, mask) in &part.0 {
        let mask = mask & meets(simd, &rows[block as usize], crossing, extent);
        if mask != 0 {
            out.0.push((block, mask));
        }
    }
}

#[inline(always)]
fn meets<S: Simd>(simd: S, row: &Sixteen, crossing: bool, extent: &ReceiverBox) -> u16 {
    let (c, h) = (extent.center.to_array(), extent.half.to_array());
    let zero = f32x16::splat(simd, 0.0);
    // Per plane, wedges on whose inner side the box is in part, and on whose outer side.
    let (mut inner, mut outer) = ([0u16; 4], [0u16; 4]);
    for plane in 0..4 {
        let mut middle = zero - row.offset[plane].load(simd);
        let mut reach = f32x16::splat(simd, 0.0);
        for axis in 0..3 {
            let n = row.normal[plane][axis].load(simd);
            middle += n * c[axis];
            reach += n.abs() * h[axis];
        }
        inner[plane] = (middle - reach).le(zero);
        outer[plane] = (middle + reach).ge(-2.0 * SLACK);
    }
    let sides = inner[2] & inner[3];
    let sides = if crossing {
        sides | (outer[2] & outer[3])
    } else {
        sides
    };
    inner[0] & inner[1] & sides
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_on_the_inner_side_of_all_planes_are_met() {
        // A slab 0 <= x <= 1, 0 <= y <= 1, numbered 20 so that two rows are needed.
        let slab = |shift: f64| {
            let at = |x: f64| DVec3::splat(x);
            WedgeBounds::new([
                Some((-DVec3::X, at(shift))),
                Some((DVec3::X, at(1.0 + shift))),
                Some((-DVec3::Y, at(0.0))),
                Some((DVec3::Y, at(1.0))),
            ])
        };
        let all: Vec<WedgeBounds> = (0..20).map(|i| slab(f64::from(i))).collect();
        let list = BoundsList::new(&all);
        let extent =
            ReceiverBox::of([DVec3::new(1.5, 0.5, 0.0), DVec3::new(3.5, 0.6, 0.0)].into_iter());
        let listed = |list: &BoundsList, range: Range<usize>, extent: &ReceiverBox| {
            let (mut some, mut met, mut found) =
                (Selection::default(), Selection::default(), Vec::new());
            list.part(range, &mut some);
            list.meeting(&some, Some(extent), &mut met);
            list.list(&met, &mut found);
            found
        };
        assert_eq!(listed(&list, 0..20, &extent), [1, 2, 3]);
        assert_eq!(listed(&list, 2..20, &extent), [2, 3]);
        assert_eq!(listed(&list, 0..3, &extent), [1, 2]);
        assert!(listed(&list, 7..7, &extent).is_empty());
        let kept = list.keep(Some(&extent));
        assert_eq!(kept.ids(), [1, 2, 3]);
        assert_eq!(listed(&kept, 1..3, &extent), [2, 3]);
        let above = ReceiverBox::of([DVec3::new(1.5, 1.5, 0.0)].into_iter());
        assert!(listed(&list, 0..20, &above).is_empty());
    }
}
