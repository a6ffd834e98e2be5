//! Receivers of few samples, all of them traced: as many receivers together as a packet has lanes for.

use glam::Vec3;

use super::Answer;
use crate::bvh::Occluders;
use crate::bvh::packet::{Packet, Stack};
use crate::sampling::LightSamples;
use crate::sampling::tracing::{Sums, bits};
use crate::simd::{LANES, Row};

/// The receivers whose samples a packet holds.
#[derive(Default)]
pub(super) struct Batch {
    packet: Packet,
    stack: Stack,
    active: u16,
    /// Each receiver with the weights of its samples, of which it has `count`.
    waiting: Vec<(usize, Row)>,
    count: usize,
}

impl Batch {
    /// Whether there are lanes for a receiver's samples.
    pub(super) fn fits(&self, samples: &LightSamples) -> bool {
        (self.waiting.len() + 1) * samples.count <= LANES
    }

    /// Adds a receiver whose rays start at `origin`; all that wait have as many samples.
    pub(super) fn add(&mut self, receiver: usize, origin: Vec3, samples: &LightSamples) {
        self.count = samples.count;
        let first = self.waiting.len() * self.count;
        for lane in bits(samples.valid[0]) {
            self.packet.set(first + lane, origin, samples.point(lane));
        }
        self.active |= samples.valid[0] << first;
        self.waiting.push((receiver, samples.weights[0]));
    }

    /// Traces what waits, and tells what is found of each receiver.
    pub(super) fn trace(&mut self, occluders: &Occluders, put: &mut impl FnMut(usize, Answer)) {
        if self.waiting.is_empty() {
            return;
        }
        let mut all = [0.0; LANES];
        occluders.transmittance(&self.packet, self.active, &mut self.stack, &mut all);
        let each = all.chunks_exact(self.count);
        for ((receiver, weights), part) in self.waiting.drain(..).zip(each) {
            let mut through = Row::default();
            through.0[..self.count].copy_from_slice(part);
            let sums = Sums::new(&[weights], &[through], self.count);
            put(receiver, Answer::in_parts(sums));
        }
        self.active = 0;
    }
}
