//! Visibility within an error that the user states: what is known of receivers, how far it may be off, what
//! neighbours on the same surface tell of each other, and who needs more samples.
//!
//! - this file: [`Estimate`], what a receiver's samples tell;
//! - [`filter`]: what they tell together with those of its neighbours, [`Filtered`](filter::Filtered);
//! - [`budget`]: for whom more samples lower the error most;
//! - [`surface`]: which receivers lie on one surface; `neighbours`: which pixels around each do;
//! - `window`: blocks of pixels with what is around them.

pub mod budget;
pub mod filter;
mod neighbours;
pub mod surface;
mod window;

/// Least error that may be asked: below, the visibility's own steps would decide.
pub const LEAST_ERROR: f64 = 1e-4;

/// What is known of a receiver under one light.
#[derive(Debug, Clone, Copy, Default)]
pub struct Estimate {
    /// Mean of its samples.
    pub seen: f32,
    /// Variance of that mean, as the difference of two parts of the samples tells.
    pub variance: f32,
    /// Irradiance at radiance 1, by its samples.
    pub irradiance: f32,
    /// What the irradiance would be if all samples that face the receiver were seen.
    pub unshadowed: f32,
    /// How many there were; none where the answer is not an estimate.
    pub samples: u32,
}

impl Estimate {
    /// Whether nothing is left to be estimated.
    pub fn is_exact(&self) -> bool {
        self.samples == 0
    }

    /// Part of the unshadowed irradiance that arrives.
    pub fn part(&self) -> f32 {
        part(self.irradiance, self.unshadowed)
    }

    /// Adds what more samples of the same receiver tell.
    ///
    /// The variance is the mean of what both parts' own tell and of what their difference does, each as if all
    /// samples were independent. They continue a sequence that fills the light evenly, so that their errors tend to cancel:
    /// it is too large rather than too small. Of the difference alone, which now and then is small by chance, too
    /// many receivers would be left too early.
    pub fn add(&mut self, more: &Estimate) {
        let all = self.samples + more.samples;
        let (a, b) = (
            self.samples as f32 / all as f32,
            more.samples as f32 / all as f32,
        );
        let apart = a * a * self.variance + b * b * more.variance;
        self.variance = 0.5 * (apart + a * b * (self.seen - more.seen).powi(2));
        self.seen = a * self.seen + b * more.seen;
        self.irradiance = a * self.irradiance + b * more.irradiance;
        self.unshadowed = a * self.unshadowed + b * more.unshadowed;
        self.samples = all;
    }
}

/// A part of a whole that may be nothing.
fn part(some: f32, whole: f32) -> f32 {
    if whole > 0.0 { some / whole } else { 0.0 }
}
