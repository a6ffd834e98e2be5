//! For whom more samples lower the error most.
//!
//! A receiver with `n` samples and a mean squared error of `e` is given `GROWTH` times as many, which leaves a
//! `GROWTH`th of the error. What that gains for its cost falls with every step like `e / n`, so the cheapest way
//! under an error is to let all receivers grow whose `e / n` is above one bound.

/// By how much the samples of a receiver grow at once.
pub const GROWTH: u32 = 2;

/// Samples that every receiver has first.
pub const PILOT: u32 = 4;

/// Part of the errors' sum that is wanted, under which the errors of those that are left out do not matter yet: where one
/// step cannot be enough, most receivers need none.
const SPARED: f64 = 0.25;

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
    let is_enough = |bound: usize| {
        let steps = |bucket: usize| (bound + 1 - bucket).div_ceil(buckets_a_step) as i32;
        let grown = |(bucket, error): (usize, &f64)| error / f64::from(GROWTH).powi(steps(bucket));
        let rest: f64 = growing[bound + 1..].iter().sum();
        let grown: f64 = growing[..=bound].iter().enumerate().map(grown).sum();
        fixed + rest + grown <= wanted || rest <= SPARED * wanted
    };
    let bound = (0..smallest)
        .find(|&bound| is_enough(bound))
        .unwrap_or(smallest);
    Some((-((bound + 1) as f32) / BUCKETS_AN_OCTAVE as f32).exp2())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_with_the_largest_errors_grow_and_no_others() {
        let small = std::iter::repeat_n((1e-6, 4, true), 99);
        let receivers = || small.clone().chain([(1e-2, 4, true)]);
        // A half of the large error and all of the small ones are less than is wanted.
        let found = bound(receivers(), 6e-3).unwrap();
        assert!((1e-6 / 4.0..=1e-2 / 4.0).contains(&found), "{found}");
        // Nothing is enough.
        let found = bound(receivers(), 0.0).unwrap();
        assert!(found <= 1e-6 / 4.0, "{found}");
    }

    #[test]
    fn nobody_grows_who_cannot_or_need_not() {
        assert_eq!(
            bound([(1e-2, 256, false), (0.0, 4, true)].into_iter(), 0.0),
            None
        );
        assert_eq!(bound(std::iter::empty(), 1.0), None);
    }

    #[test]
    fn steps_end_at_the_most_samples() {
        assert_eq!(steps(1), [1]);
        assert_eq!(steps(4), [4]);
        assert_eq!(steps(100), [4, 8, 16, 32, 64, 100]);
    }
}
