//! For whom more samples lower the error most.
//!
//! A receiver with `n` samples and a mean squared error of `e` is given `GROWTH` times as many, which leaves a
//! `GROWTH`th of the error. What that gains for its cost falls with every step like `e / n`, so the cheapest way
//! under an error is to let all receivers grow whose `e / n` is above one bound.

/// By how much the samples of a receiver grow at once.
pub const GROWTH: u32 = 4;

/// Samples that every receiver has first.
pub const PILOT: u32 = 4;

/// Bounds are powers of two of a quarter: a receiver more or less does not matter.
const BUCKETS_AN_OCTAVE: usize = 4;

/// Octaves of `e / n` that are told apart, below 1: squared errors of `f32` values over the most samples.
const OCTAVES: usize = 64;

/// The samples that a receiver has after each step, up to `most`.
pub fn steps(most: u32) -> Vec<u32> {
    let mut steps = vec![PILOT.min(most)];
    while let Some(&last) = steps.last().filter(|&&last| last < most) {
        steps.push(last.saturating_mul(GROWTH).min(most));
    }
    steps
}

/// The bound of `e / n` from which on receivers are given more samples, so that the sum of errors is expected to
/// come down to `wanted` with as few as may be; `None` where none can have more. Receivers are told by error, samples and
/// whether they can grow; those without an error cannot.
pub fn bound(receivers: impl Iterator<Item = (f32, u32, bool)>, wanted: f64) -> Option<f32> {
    let last = OCTAVES * BUCKETS_AN_OCTAVE - 1;
    let mut growing = vec![0.0f64; last + 1];
    let mut fixed = 0.0;
    for (error, samples, grows) in receivers {
        if grows && error > 0.0 {
            let octaves = -(error / samples as f32).log2();
            let bucket = (octaves * BUCKETS_AN_OCTAVE as f32).max(0.0) as usize;
            growing[bucket.min(last)] += f64::from(error);
        } else {
            fixed += f64::from(error);
        }
    }
    let smallest = growing.iter().rposition(|e| *e > 0.0)?;
    // Every step takes `e / n` down by GROWTH², and `e` by GROWTH.
    let buckets_a_step = 2 * GROWTH.ilog2() as usize * BUCKETS_AN_OCTAVE;
    let left = |bound: usize| {
        let steps = |bucket: usize| (bound + 1 - bucket).div_ceil(buckets_a_step) as i32;
        let grown = |(bucket, error): (usize, &f64)| error / f64::from(GROWTH).powi(steps(bucket));
        let rest: f64 = growing[bound + 1..].iter().sum();
        fixed + rest + growing[..=bound].iter().enumerate().map(grown).sum::<f64>()
    };
    let bound = (0..smallest)
        .find(|&b| left(b) <= wanted)
        .unwrap_or(smallest);
    Some((-((bound + 1) as f32) / BUCKETS_AN_OCTAVE as f32).exp2())
}
