//! Sixteen segments through both levels: through the tree of instances, and through the tree of each that they may enter.

use fearless_simd::{Simd, dispatch};

use super::super::any_hit::{self, Segments, descend, next_open};
use super::super::crossed::Crossed;
use super::super::kept::KeptPacks;
use super::super::packet::{Packet, Stack, longest_axes};
use super::super::through;
use super::super::wide::{Child, Pack, WIDTH};
use super::Set;
use super::packs::kept;
use crate::simd::{LANES, Level};

/// What is asked of the leaves that segments come to.
trait Meet {
    /// Looks at a leaf's triangles, which let through so much, and returns the segments that need no more.
    fn leaf<S: Simd, const AXIS: usize>(
        &mut self,
        simd: S,
        leaf: (&Pack, usize, f32),
        segments: &Segments<'_, S, AXIS>,
        mask: u16,
    ) -> u16;
}

/// Whether anything is in the way.
struct Block;

impl Meet for Block {
    #[inline(always)]
    fn leaf<S: Simd, const AXIS: usize>(
        &mut self,
        simd: S,
        (pack, count, _): (&Pack, usize, f32),
        segments: &Segments<'_, S, AXIS>,
        mask: u16,
    ) -> u16 {
        any_hit::meet_leaf(simd, pack, count, segments, mask)
    }
}

/// How many surfaces are in the way.
struct Count<'a>(&'a mut [Crossed; LANES]);

impl Meet for Count<'_> {
    #[inline(always)]
    fn leaf<S: Simd, const AXIS: usize>(
        &mut self,
        simd: S,
        (pack, count, through): (&Pack, usize, f32),
        segments: &Segments<'_, S, AXIS>,
        mask: u16,
    ) -> u16 {
        let all = [through; WIDTH];
        through::meet_leaf(simd, pack, &all[..count], segments, mask, self.0);
        0
    }
}

/// What a thread has for a traversal.
struct Room<'a> {
    upper: &'a mut Vec<u32>,
    lower: &'a mut Vec<u32>,
    packs: &'a mut KeptPacks,
    own: &'a mut Packet,
}

/// Which of the segments in `active` the instances block.
pub(super) fn blocked(
    level: Level,
    set: &Set,
    packet: &Packet,
    active: u16,
    stack: &mut Stack,
) -> u16 {
    let mut room = Room {
        upper: &mut stack.upper,
        lower: &mut stack.nodes,
        packs: &mut stack.packs,
        own: &mut stack.own,
    };
    dispatch!(level, simd => all_axes(simd, set, packet, active, &mut room, &mut Block))
}

/// Counts what the segments in `active` cross.
pub(super) fn pass(level: Level, set: &Set, packet: &Packet, active: u16, stack: &mut Stack) {
    let mut room = Room {
        upper: &mut stack.upper,
        lower: &mut stack.nodes,
        packs: &mut stack.packs,
        own: &mut stack.own,
    };
    // It is of the opaque instances.
    let blocker = room.packs.blocker.take();
    let mut count = Count(&mut stack.crossed);
    dispatch!(level, simd => all_axes(simd, set, packet, active, &mut room, &mut count));
    stack.packs.blocker = blocker;
}

/// Groups the segments by their longest axis and traverses once a group; almost always one.
#[inline(always)]
fn all_axes<S: Simd, M: Meet>(
    simd: S,
    set: &Set,
    packet: &Packet,
    active: u16,
    room: &mut Room<'_>,
    meet: &mut M,
) -> u16 {
    if set.instances.is_empty() {
        return 0;
    }
    let [along_x, along_y, along_z] = longest_axes(simd, packet);
    let mut out = 0;
    if along_z & active != 0 {
        out |= traverse::<S, M, 2>(simd, set, packet, along_z & active, room, meet);
    }
    if along_x & active != 0 {
        out |= traverse::<S, M, 0>(simd, set, packet, along_x & active, room, meet);
    }
    if along_y & active != 0 {
        out |= traverse::<S, M, 1>(simd, set, packet, along_y & active, room, meet);
    }
    out
}

#[inline(always)]
fn traverse<S: Simd, M: Meet, const AXIS: usize>(
    simd: S,
    set: &Set,
    packet: &Packet,
    active: u16,
    room: &mut Room<'_>,
    meet: &mut M,
) -> u16 {
    let segments = Segments::<S, AXIS>::new(simd, packet, active);
    let mut found = 0;
    if let Some((number, leaf)) = room.packs.blocker {
        let instance = &set.instances[number as usize];
        let leaf = Child::from_word(leaf);
        let pack = kept(simd, room.packs, instance, leaf);
        let leaf = (pack, leaf.triangles(), instance.through);
        found = meet.leaf(simd, leaf, &segments, active);
        if found == active {
            return found;
        }
        if found == 0 {
            room.packs.blocker = None;
        }
    }
    room.upper.clear();
    let (mut child, mut mask) = (Child::ROOT, active & !found);
    loop {
        if child.is_leaf() {
            let first = set.tree.firsts[child.place()] as usize;
            for number in first..first + child.triangles() {
                found |= inside(simd, set, number, &segments, mask & !found, room, meet);
                if active & !found == 0 {
                    return found;
                }
            }
        } else {
            let next = descend(simd, &set.tree, child, &segments.slabs, mask, room.upper);
            if let Some(next) = next {
                (child, mask) = next;
                continue;
            }
        }
        let Some(next) = next_open(room.upper, !found) else {
            return found;
        };
        (child, mask) = next;
    }
}

/// Segments of `active` that need no more after one instance.
#[inline(always)]
fn inside<S: Simd, M: Meet, const AXIS: usize>(
    simd: S,
    set: &Set,
    number: usize,
    segments: &Segments<'_, S, AXIS>,
    active: u16,
    room: &mut Room<'_>,
    meet: &mut M,
) -> u16 {
    if active == 0 {
        return 0;
    }
    let instance = &set.instances[number];
    let tree = &instance.tree.wide;
    let slabs = instance.slabs(simd, segments.packet, active, room.own);
    let mut found = 0;
    room.lower.clear();
    let (mut child, mut mask) = (Child::ROOT, active);
    loop {
        if child.is_leaf() {
            let pack = kept(simd, room.packs, instance, child);
            let leaf = (pack, child.triangles(), instance.through);
            let hit = meet.leaf(simd, leaf, segments, mask);
            if hit != 0 {
                room.packs.blocker = Some((number as u32, child.word()));
                found |= hit;
                if active & !found == 0 {
                    return found;
                }
            }
        } else if let Some(next) = descend(simd, tree, child, &slabs, mask, room.lower) {
            (child, mask) = next;
            continue;
        }
        let Some(next) = next_open(room.lower, !found) else {
            return found;
        };
        (child, mask) = next;
    }
}
