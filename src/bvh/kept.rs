//! Triangles of leaves that a thread keeps after it has made them, for hierarchies of two levels.

use super::wide::Pack;

/// Packs that a thread keeps, a power of two: a part of the second cache.
const KEPT: usize = 1024;

/// No leaf.
const NONE: u64 = u64::MAX;

/// The packs that a thread has met last, each at a place that its leaf's number tells. What is kept saves work and
/// changes no answer.
#[derive(Debug, Clone, Default)]
pub(super) struct KeptPacks {
    /// The scene that they are of.
    of: u64,
    leaves: Vec<u64>,
    packs: Vec<Pack>,
    /// Instance and leaf that blocked a segment last, where one did.
    pub(super) blocker: Option<(u32, u32)>,
}

impl KeptPacks {
    /// Begins with a scene.
    #[inline]
    pub(super) fn enter(&mut self, scene: u64) {
        if self.of != scene {
            self.of = scene;
            self.blocker = None;
            self.leaves.clear();
            self.leaves.resize(KEPT, NONE);
            self.packs.resize(KEPT, Pack::new(&[]));
        }
    }

    /// Where the pack of a leaf is, and whether it is there: the caller makes it where not. `of` and `leaf` tell it from
    /// all others of the scene.
    #[inline(always)]
    pub(super) fn find(&mut self, of: u32, leaf: usize) -> (&mut Pack, bool) {
        let key = u64::from(of) << 32 | leaf as u64;
        // Neighbours among leaves and among instances have different places.
        let place = (key ^ (u64::from(of).wrapping_mul(0x9e37_79b9) >> 8)) as usize % KEPT;
        let known = std::mem::replace(&mut self.leaves[place], key) == key;
        (&mut self.packs[place], known)
    }
}
