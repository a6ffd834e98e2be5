//! Segments between receivers and light points, traced against what casts.

use glam::Vec3;

use super::LightSamples;
use super::cells::cell_place;
use crate::bvh::Occluders;
use crate::bvh::packet::{Packet, Stack};
use crate::simd::{LANES, Row};

/// Segments of a group of receivers.
#[derive(Default)]
pub struct Tracer {
    packet: Packet,
    stack: Stack,
    /// Place on the light, receiver and target of each segment.
    segments: Vec<(u32, u32, Vec3)>,
    order: Vec<u64>,
    through: Vec<f32>,
    /// Transmittance of each sample of one receiver.
    samples: Vec<Row>,
}

impl Tracer {
    /// Adds the segment from the group's receiver `k` to a target in this cell of the light.
    pub fn add(&mut self, k: usize, cell: u16, target: Vec3) -> u32 {
        self.segments.push((cell_place(cell), k as u32, target));
        self.segments.len() as u32 - 1
    }

    /// Traces all segments, sorted by where on the light they end: the same sample of two receivers, each
    /// with digits of its own flipped, can lie anywhere. The segments are then gone, what was found stays.
    pub fn trace(&mut self, occluders: &Occluders, origins: &[Vec3]) {
        self.order.clear();
        let keys = self.segments.iter().enumerate();
        self.order
            .extend(keys.map(|(s, &(place, ..))| u64::from(place) << 32 | s as u64));
        self.order.sort_unstable();
        self.through.clear();
        self.through.resize(self.segments.len(), 0.0);
        for keys in self.order.chunks(LANES) {
            for (lane, &key) in keys.iter().enumerate() {
                let (_, k, target) = self.segments[key as u32 as usize];
                self.packet.set(lane, origins[k as usize], target);
            }
            let active = u16::MAX >> (LANES - keys.len());
            let mut through = [0.0; LANES];
            occluders.transmittance(&self.packet, active, &mut self.stack, &mut through);
            for (&key, t) in keys.iter().zip(through) {
                self.through[key as u32 as usize] = t;
            }
        }
        self.segments.clear();
    }

    /// Transmittance of a segment that was traced; nothing of one that was not.
    pub fn through(&self, segment: u32) -> f32 {
        self.through.get(segment as usize).copied().unwrap_or(0.0)
    }

    /// What the samples of a receiver tell, all of which are traced.
    pub fn trace_samples(
        &mut self,
        occluders: &Occluders,
        origin: Vec3,
        samples: &LightSamples,
    ) -> Sums {
        self.samples.clear();
        for (r, &valid) in samples.valid.iter().enumerate() {
            for lane in bits(valid) {
                self.packet
                    .set(lane, origin, samples.point(r * LANES + lane));
            }
            let mut through = Row::default();
            occluders.transmittance(&self.packet, valid, &mut self.stack, &mut through.0);
            self.samples.push(through);
        }
        Sums::new(&samples.weights, &self.samples, samples.count)
    }
}

/// The numbers of the bits that are set.
pub fn bits(mut mask: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (lane < LANES).then_some(lane)
    })
}

/// What a receiver's samples tell.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sums {
    /// Visibility and irradiance.
    pub both: [f32; 2],
    /// Visibility by the first half of the samples.
    pub early: f32,
    /// Irradiance if all valid samples were seen.
    pub unshadowed: f32,
}

impl Sums {
    /// From each sample's transmittance.
    ///
    /// Sixteen partial sums in `f32`, then one in order: the same operations whatever was culled.
    pub fn new(weights: &[Row], through: &[Row], count: usize) -> Self {
        let (mut seen, mut light) = (Row::default(), Row::default());
        let (mut early, mut all) = (Row::default(), Row::default());
        for (r, (w, t)) in weights.iter().zip(through).enumerate() {
            for lane in 0..LANES {
                seen.0[lane] += t.0[lane];
                light.0[lane] += w.0[lane] * t.0[lane];
                all.0[lane] += w.0[lane];
            }
            let half = (count / 2).saturating_sub(r * LANES).min(LANES);
            for (early, t) in early.0.iter_mut().zip(&t.0[..half]) {
                *early += t;
            }
        }
        Sums {
            both: [(total(&seen) / count as f32).min(1.0), total(&light)],
            early: (total(&early) / (count / 2).max(1) as f32).min(1.0),
            unshadowed: total(&all),
        }
    }

    /// [`Sums::new`] with every valid sample seen, to the bit: counts are exact, and so is a product with 1.
    /// Both halves of the samples are taken to see as much.
    pub fn of_valid(samples: &LightSamples) -> Self {
        let mut light = Row::default();
        for weights in &samples.weights {
            for lane in 0..LANES {
                light.0[lane] += weights.0[lane];
            }
        }
        let seen: u32 = samples.valid.iter().map(|v| v.count_ones()).sum();
        let seen = (seen as f32 / samples.count as f32).min(1.0);
        let light = total(&light);
        Sums {
            both: [seen, light],
            early: seen,
            unshadowed: light,
        }
    }

    /// The same receiver with every sample blocked.
    pub fn hidden(self) -> Self {
        Sums {
            both: [0.0; 2],
            early: 0.0,
            ..self
        }
    }
}

fn total(row: &Row) -> f32 {
    row.0.iter().sum()
}
