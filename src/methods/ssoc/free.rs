//! Groups of receivers of which most are far from any shadow: those that nothing hides are found together.
//!
//! The same that a lookup by itself finds first, from the same numbers: all four texels around a receiver saw what
//! hides nothing of it, far from any edge. Places and planes are found in registers, for all of a group.

use super::lookup::{Receiver, around};
use super::maps::Maps;
use crate::contour::Many;
use crate::methods::views::View;
use crate::raster::nearest::NONE;
use crate::receivers::GROUP;
use crate::simd::{Lanes, detect, dispatch};

/// What a view has around a group of receivers, a column for every number.
pub(super) struct Group {
    /// The four texels around each.
    texels: [[u32; GROUP]; 4],
    /// Height of the tangent plane along the texels' directions, and what it is compared with at an inverse depth
    /// of 1 ([`Receiver::is_below`]).
    height: [[f64; GROUP]; 4],
    reach: [f64; GROUP],
    /// 1 where the view holds a receiver.
    held: [u8; GROUP],
}

impl Group {
    /// An empty one.
    pub(super) fn new() -> Self {
        Group {
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
        dispatch!(detect() => look(group: &mut Group, receivers: &Many, view: &View));
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

/// Free of branches, for the compiler's vectoriser; the type says what `dispatch!` compiles it for.
#[allow(
    clippy::extra_unused_type_parameters,
    reason = "`dispatch!` names the lanes"
)]
#[inline(always)]
unsafe fn look<S: Lanes>(group: &mut Group, receivers: &Many, view: &View) {
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
