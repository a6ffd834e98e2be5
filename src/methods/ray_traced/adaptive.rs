//! As many samples as an error asks for (`error`).
//!
//! Every receiver has a few samples first. What they tell together with those of its neighbours on the same
//! surface ([`Filter`]) has an expected error; while the mean over all receivers is above what was asked, those go on
//! whose error falls most for a sample ([`budget::bound`]). Samples are nested: a receiver's later ones continue its
//! sequence. Receivers before whose light there is no edge are exact with one segment.

use super::{Answer, PreparedLight, PreparedRayTraced, RayTraced, Scratch};
use crate::adaptive::Estimate;
use crate::adaptive::budget::{self, steps};
use crate::adaptive::filter::Filter;
use crate::control::Control;
use crate::error::Result;
use crate::method::{Irradiance, Shading};
use crate::receivers::Receivers;
use crate::sampling::tracing::Sums;
use crate::sampling::{Pattern, Sampler};

/// The samples of each step: all at once, or so that they are nested.
pub(super) fn patterns(method: &RayTraced) -> Vec<Pattern> {
    if method.error.is_none() {
        return vec![Pattern::new(method.samples as usize, method.seed)];
    }
    let ends = steps(method.samples);
    let starts = std::iter::once(0).chain(ends.iter().copied());
    let part =
        |(start, end): (u32, u32)| Pattern::halves(start as usize..end as usize, method.seed);
    starts.zip(ends.iter().copied()).map(part).collect()
}

impl PreparedRayTraced {
    /// Shades all receivers with as few samples as keep the error.
    pub(super) fn shade_within(
        &self,
        error: f64,
        receivers: &Receivers,
        light: &[PreparedLight],
        control: &Control,
    ) -> Result<Shading> {
        let ends: Vec<u32> = light
            .iter()
            .scan(0, |end, step| {
                *end += step.sampler.len() as u32;
                Some(*end)
            })
            .collect();
        let most = ends[ends.len() - 1];
        let pilot = self.sample(receivers, light, control, |_| Some(0))?;
        let mut estimates: Vec<Estimate> = pilot.into_iter().flatten().collect();
        let silent = control.silent();
        let filter = Filter::new(&self.geometry, receivers, &estimates, &silent)?;
        let wanted = error * error * receivers.len() as f64;
        let mut found = Vec::new();
        let mut grown = vec![true; receivers.len()];
        loop {
            found = filter.apply(&estimates, &grown, found, &silent)?;
            let left: f64 = found.iter().map(|f| f64::from(f.error)).sum();
            let told = found
                .iter()
                .zip(&estimates)
                .map(|(f, e)| (f.error, e.samples, e.samples < most));
            let bound = budget::bound(told, wanted).filter(|_| left > wanted);
            let step = |i: usize| {
                let e = &estimates[i];
                let grows = !e.is_exact() && found[i].error / e.samples as f32 >= bound?;
                let done = ends.iter().position(|end| *end == e.samples)?;
                grows.then_some(done + 1).filter(|s| *s < ends.len())
            };
            let more = self.sample(receivers, light, &silent, step)?;
            if more.iter().all(Option::is_none) {
                return Ok(Shading {
                    visibility: found.iter().map(|f| f.seen).collect(),
                    irradiance: Some(Irradiance::Part(found.iter().map(|f| f.part).collect())),
                    by_rays: 0,
                });
            }
            for ((e, grown), more) in estimates.iter_mut().zip(&mut grown).zip(&more) {
                *grown = more.is_some();
                if let Some(more) = more {
                    e.add(more);
                }
            }
        }
    }

    /// Estimates by the samples of a step for each receiver; none for those that have none.
    fn sample(
        &self,
        receivers: &Receivers,
        light: &[PreparedLight],
        control: &Control,
        step: impl Fn(usize) -> Option<usize> + Sync + Send,
    ) -> Result<Vec<Option<Estimate>>> {
        receivers.by_groups(control, None, Scratch::default, |scratch, range, out| {
            let first = range.start;
            let steps: Vec<_> = range.filter_map(|i| Some((i, step(i)?))).collect();
            if steps.is_empty() {
                return Ok(());
            }
            for (s, light) in light.iter().enumerate() {
                let its = steps.iter().filter(|(_, step)| *step == s);
                let mut ids: Vec<usize> = its.map(|(i, _)| *i).collect();
                if ids.is_empty() {
                    continue;
                }
                let mut put = |i: usize, answer: Answer| {
                    let mut found = estimate(&answer, light.sampler.len());
                    if s == 0 {
                        settle(&mut found, &answer, receivers, i, &light.sampler);
                    }
                    out[i - first] = Some(found);
                };
                if light.cull {
                    self.shade_neighbours(receivers, &mut ids, light, scratch, &mut put);
                } else {
                    self.shade_group(receivers, &mut ids, light, scratch, &mut put);
                }
            }
            Ok(())
        })
    }
}

/// What an answer by so many samples tells.
fn estimate(answer: &Answer, samples: usize) -> Estimate {
    let Sums {
        both: [seen, irradiance],
        early,
        unshadowed,
    } = answer.sums;
    let (half, all) = ((samples / 2) as f32, samples as f32);
    let late = (seen * all - early * half) / (all - half);
    Estimate {
        seen,
        // One sample tells nothing of its own spread.
        variance: if half == 0.0 {
            0.25
        } else {
            0.25 * (late - early).powi(2)
        },
        irradiance,
        unshadowed,
        samples: samples as u32,
    }
}

/// Makes an estimate of receiver `i` exact where its first samples say that all of the light is seen alike.
fn settle(
    found: &mut Estimate,
    answer: &Answer,
    receivers: &Receivers,
    i: usize,
    sampler: &Sampler,
) {
    if found.unshadowed > 0.0 && !answer.whole {
        return;
    }
    let light = sampler.light();
    let above = light.fraction_above(receivers.positions[i], receivers.normals[i]);
    if answer.whole || above == 0.0 {
        *found = Estimate {
            seen: found.part() * above as f32,
            variance: 0.0,
            samples: 0,
            ..*found
        };
    }
}
