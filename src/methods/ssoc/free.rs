//! Groups of receivers of which most are far from any shadow: those that nothing hides are found together.
//!
//! A block of pixels on one triangle, where the map shows nothing but this triangle and is far from any edge, is free
//! as a whole ([`CellFaces`]): no surface hides itself. In other groups ([`GroupView`]), the same that a lookup by itself
//! finds first, from the same numbers: all four texels around a receiver saw what hides nothing of it, far from any
//! edge. Places and planes are found in registers, for all of a group.

use std::ops::Range;

use fearless_simd::dispatch;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::maps::Maps;
use super::receiver::{Receiver, around};
use crate::light::many::Many;
use crate::maps::views::View;
use crate::raster::nearest::NONE;
use crate::receivers::{BLOCK, GROUP, Receivers};
use crate::simd::detect;

/// Texels on a side of a cell.
const CELL: u32 = 8;

/// For cells of a view's texels, the triangle that all of a cell's texels show, far from what any edge could hide;
/// [`NONE`] where there is no such triangle.
pub(super) struct CellFaces {
    across: u32,
    shown: Vec<u32>,
}

impl CellFaces {
    /// The cells of a view's maps.
    pub(super) fn new(maps: &Maps) -> Self {
        let (width, height) = (maps.view.camera.width, maps.view.camera.height);
        let across = width.div_ceil(CELL);
        let shown = |cell: u32| {
            let (x, y) = (cell % across * CELL, cell / across * CELL);
            let shown = maps.triangle[(y * width + x) as usize];
            let alone = (y..(y + CELL).min(height)).all(|y| {
                let row = (y * width + x) as usize..(y * width + (x + CELL).min(width)) as usize;
                // Without a branch a texel.
                let of = maps.triangle[row.clone()].iter().zip(&maps.outside[row]);
                of.fold(true, |all, (&t, &edge)| all & (t == shown) & (edge == NONE))
            });
            if alone { shown } else { NONE }
        };
        let cells = across * height.div_ceil(CELL);
        CellFaces {
            across,
            shown: (0..cells).into_par_iter().map(shown).collect(),
        }
    }

    /// Whether nothing but its own triangle is around a block in the view that the cells are of.
    pub(super) fn show(&self, view: &View, block: &PixelBlock) -> bool {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for corner in block.corners {
            let (q, depth) = view.project(corner);
            if depth <= 0.0 || !view.contains(q) {
                return false;
            }
            (low, high) = (low.min(q), high.max(q));
        }
        // A lookup interpolates between texels up to one away.
        let cell = |q: DVec2| {
            let q = q.clamp(DVec2::ZERO, view.last());
            (q.x as u32 / CELL, q.y as u32 / CELL)
        };
        let ((x0, y0), (x1, y1)) = (cell(low - 1.0), cell(high + 1.0));
        (y0..=y1).all(|y| {
            let row = (y * self.across + x0) as usize..=(y * self.across + x1) as usize;
            self.shown[row].iter().all(|&shown| shown == block.triangle)
        })
    }
}

/// A whole block of a camera's pixels on one triangle.
pub(super) struct PixelBlock {
    triangle: u32,
    /// The receivers at its corners; the others lie among them on the triangle's plane.
    pub corners: [DVec3; 4],
}

impl PixelBlock {
    /// The block of a group of receivers, if the group is whole, lies on one triangle, and has a tangent plane.
    pub(super) fn new(receivers: &Receivers, group: &Range<usize>) -> Option<Self> {
        let (&first, rest) = receivers.faces.get(group.clone())?.split_first()?;
        let whole = group.len() == GROUP && first != NONE && rest.iter().all(|&f| f == first);
        if !whole || receivers.normals[group.start] == DVec3::ZERO {
            return None;
        }
        let side = BLOCK as usize;
        let corners = [0, side - 1, GROUP - side, GROUP - 1];
        Some(PixelBlock {
            triangle: first,
            corners: corners.map(|i| receivers.positions[group.start + i]),
        })
    }

    /// Whether a view holds none of it, as all of it is beyond one of the image's sides.
    pub(super) fn is_outside(&self, view: &View) -> bool {
        let [width, height] = [view.camera.width, view.camera.height].map(f64::from);
        let places = self.corners.map(|p| view.project(p));
        places.iter().all(|p| p.1 > 0.0)
            && (places.iter().all(|(q, _)| q.x < 0.0)
                || places.iter().all(|(q, _)| q.x > width)
                || places.iter().all(|(q, _)| q.y < 0.0)
                || places.iter().all(|(q, _)| q.y > height))
    }
}

/// What a view has around a group of receivers, a column for every number.
pub(super) struct GroupView {
    /// The four texels around each.
    texels: [[u32; GROUP]; 4],
    /// Height of the tangent plane along the texels' directions, and what it is compared with at an inverse depth
    /// of 1 ([`Receiver::is_below`]).
    height: [[f64; GROUP]; 4],
    reach: [f64; GROUP],
    /// 1 where the view holds a receiver.
    held: [u8; GROUP],
}

impl GroupView {
    /// An empty one.
    pub(super) fn new() -> Self {
        GroupView {
            texels: [[0; GROUP]; 4],
            height: [[0.0; GROUP]; 4],
            reach: [0.0; GROUP],
            held: [0; GROUP],
        }
    }

    /// Bit `i` is set where the maps show at once that nothing hides any light from receiver `i`. Also whether the view
    /// holds any of the receivers.
    pub(super) fn free(&mut self, maps: &Maps, receivers: &Many) -> (u64, bool) {
        let (group, view) = (&mut *self, &maps.view);
        dispatch!(detect(), _ => look(group, receivers, view));
        let mut free = 0;
        for i in 0..receivers.count() {
            let is_free = (0..4).all(|k| {
                let texel = self.texels[k][i] as usize;
                let below = self.height[k][i] > maps.inverse_depth[texel] * self.reach[i];
                !below && maps.outside[texel] == NONE
            });
            free |= u64::from(is_free) << i;
        }
        (free, self.held[..receivers.count()].contains(&1))
    }
}

/// Free of branches, for the compiler's vectoriser.
#[inline(always)]
fn look(group: &mut GroupView, receivers: &Many, view: &View) {
    for i in 0..GROUP {
        let (p, n) = receivers.at(i);
        let (receiver, depth) = Receiver::new(view, p, n);
        let q = receiver.at;
        let held = (depth > 0.0) & view.contains(q);
        group.held[i] = u8::from(held);
        // Without a normal, a look at more than the four is needed.
        let known = held & ((n.x != 0.0) | (n.y != 0.0) | (n.z != 0.0));
        let (places, _) = around(view, q);
        for (k, &place) in places.iter().enumerate() {
            group.texels[k][i] = place.y as u32 * view.camera.width + place.x as u32;
            let along = receiver.along(view.tangents(place + 0.5).extend(1.0));
            group.height[k][i] = if known { along } else { f64::INFINITY };
        }
        group.reach[i] = receiver.reach(receiver.slack);
    }
}
