//! The shaft between a group of receivers and the light, in which silhouette edges are looked for.

use glam::Vec3;

use super::{LightProjection, Sampler};
use crate::bvh::outline::{Shaft, padded_bounds};
use crate::receivers::Receivers;

/// A group of so few receivers is not halved any more.
const FEWEST: usize = 4;

/// Where a group of receivers is halved: at a coordinate of an axis.
pub type Middle = (usize, f64);

/// The shaft from those receivers of a group that the light faces; the others have no say in it.
pub struct GroupShaft {
    /// What lies between them and the light.
    pub shaft: Shaft,
    low: Vec3,
    high: Vec3,
    /// Largest extent of the light.
    light: f32,
    count: usize,
}

impl GroupShaft {
    /// The shaft of receivers whose rays start at `origins`, and in `views` how each sees the light; `None` where the
    /// light faces none of them.
    pub fn new(
        sampler: &Sampler,
        origins: &[Vec3],
        views: &mut Vec<Option<LightProjection>>,
    ) -> Option<Self> {
        views.clear();
        views.extend(origins.iter().map(|o| sampler.view(o.as_dvec3())));
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for (_, &o) in views.iter().zip(origins).filter(|(v, _)| v.is_some()) {
            (low, high) = (low.min(o), high.max(o));
        }
        if low.x > high.x {
            return None;
        }
        let light = padded_bounds(sampler.light());
        Some(GroupShaft {
            shaft: Shaft::new((low, high), light),
            low,
            high,
            light: (light.1 - light.0).max_element(),
            count: origins.len(),
        })
    }

    /// Where to halve the group, if that may help: it narrows the shaft only where receivers are spread wide next to
    /// the light, by more than this part of its width, as over the step from an outline to what lies behind it.
    pub fn middle(&self, wide: f32) -> Option<Middle> {
        let spread = self.high - self.low;
        let axis = spread.max_position();
        let wide = spread[axis] > wide * self.light && self.count > FEWEST;
        wide.then(|| (axis, f64::from(0.5 * (self.low[axis] + self.high[axis]))))
    }
}

/// Sorts receivers into those below a group's middle and the others; `None` where one half would be empty.
pub fn halves<'a>(
    receivers: &Receivers,
    ids: &'a mut [usize],
    (axis, middle): Middle,
) -> Option<[&'a mut [usize]; 2]> {
    let key = |&i: &usize| receivers.positions[i][axis] < middle;
    ids.sort_by_key(key);
    let (low, high) = ids.split_at_mut(ids.partition_point(|i| !key(i)));
    (!low.is_empty() && !high.is_empty()).then_some([low, high])
}
