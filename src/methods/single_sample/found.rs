//! What sixteen rays pass nearby: the nearest of everything, or of each part.

use crate::simd::{LANES, Row};

/// Something near a ray: its number and its distance.
pub(super) type NearPart = (u32, f32);

/// The distances found so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Found {
    /// Smallest distance so far, at most 1; stays 1 if parts are kept.
    pub(super) limit: Row,
    pub(super) changed: bool,
    /// Whether parts are kept.
    pub(super) keep: bool,
    parts: [Vec<NearPart>; LANES],
    nearest: [NearPart; LANES],
}

impl Found {
    /// Starts anew.
    pub(super) fn clear(&mut self, keep: bool) {
        self.keep = keep;
        self.limit = Row([1.0; LANES]);
        self.changed = true;
        self.parts.iter_mut().for_each(Vec::clear);
    }

    /// What a ray passes: each part, or the nearest distance alone.
    pub(super) fn near(&mut self, lane: usize) -> &mut [NearPart] {
        if self.keep {
            return &mut self.parts[lane];
        }
        self.nearest[lane] = (0, self.limit.0[lane]);
        std::slice::from_mut(&mut self.nearest[lane])
    }

    /// Takes note of a distance.
    pub(super) fn add(&mut self, lane: usize, part: u32, distance: f32) {
        if distance >= self.limit.0[lane] {
            return;
        }
        if !self.keep {
            self.limit.0[lane] = distance;
            self.changed = true;
            return;
        }
        // The part that was just there is likely to be there again.
        match self.parts[lane].iter_mut().rev().find(|p| p.0 == part) {
            Some(known) => known.1 = known.1.min(distance),
            None => self.parts[lane].push((part, distance)),
        }
    }

    /// Lets the next traversal start with cones as narrow as the limits.
    pub(super) fn restart(&mut self) {
        self.changed = true;
    }

    /// The limits.
    pub(super) fn limit(&self) -> &Row {
        &self.limit
    }

    /// The limits, if they are lower than at the last call.
    pub(super) fn narrowed(&mut self) -> Option<&Row> {
        let changed = std::mem::take(&mut self.changed);
        changed.then_some(&self.limit)
    }
}
