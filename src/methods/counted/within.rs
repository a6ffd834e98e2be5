//! No more receivers than an error asks for (`error`).
//!
//! A tolerance says how far receivers may be off what their neighbours let expect (`cells`). What error that makes is
//! not known before: where shadows are smooth hardly any, where they are not the tolerance itself, and of what passes
//! between the receivers that are asked no test tells. So some groups, spread over the picture, are answered in full first
//! (*pilots*), and the largest tolerance is taken with which they would have kept the error.

use super::{Answer, Group, PreparedCounted, PreparedLight, Scratch};
use crate::adaptive::surface::entries;
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Result;
use crate::receivers::Receivers;

/// Groups that are answered in full first, in a picture of many.
const PILOTS: usize = 64;

/// At most every so many-th group is one.
const LEAST_STRIDE: usize = 4;

/// Tolerances that are tried, as multiples of the error. The first is the most that a picture can use: with more,
/// hardly any more receivers have their answers from others.
const TOLERANCES: [f32; 7] = [8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.125];

/// Part of the squared error that pilots may have: the rest is for what they do not show.
const SHOWN: f64 = 0.5;

/// What receivers within an error are found by.
pub(super) struct Within {
    /// The entry of the scene that each receiver lies on.
    entries: Vec<u32>,
    /// Columns of pixels.
    columns: usize,
    /// How far a receiver may be off what its neighbours let expect.
    tolerance: f32,
}

/// Which of every so many groups is a pilot; another one each time, so that they are not all in one column.
fn is_pilot(group: usize, stride: usize) -> bool {
    let turn = ((group / stride) as u32).wrapping_mul(0x9e37_79b9) >> 16;
    group % stride == turn as usize % stride
}

impl PreparedCounted {
    /// Answers for the pixels of a camera, many from what others found.
    pub(super) fn answer_within(
        &self,
        error: f64,
        receivers: &Receivers,
        camera: &Camera,
        light: &PreparedLight,
        control: &Control,
    ) -> Result<Vec<Answer>> {
        let stride = (receivers.group_count() / PILOTS).max(LEAST_STRIDE);
        let pilot = |group: usize| is_pilot(group, stride);
        let before = self.answer_all(receivers, light, &control.silent(), pilot)?;
        let mut within = Within {
            entries: entries(&self.geometry, receivers),
            columns: camera.width as usize,
            tolerance: 0.0,
        };
        let mut s = Scratch::new(self.layout);
        let groups = (0..receivers.group_count()).filter(|&group| pilot(group));
        let pilots: Vec<_> = groups
            .map(|group| {
                let ids: Vec<usize> = receivers.group(group).collect();
                s.unshadow(receivers, &ids, light.sampler.light());
                (ids, s.unshadowed.clone())
            })
            .collect();
        let count: usize = pilots.iter().map(|(ids, _)| ids.len()).sum();
        let keeps = |tolerance: &f32| {
            let off = pilots.iter().map(|(ids, unshadowed)| {
                s.cells
                    .start(receivers, ids, within.columns, unshadowed, true);
                within.off(*tolerance, receivers, ids, &before, &mut s)
            });
            off.sum::<f64>() <= SHOWN * error * error * count as f64
        };
        let tolerances = TOLERANCES.map(|tolerance| tolerance * error as f32);
        within.tolerance = tolerances.into_iter().find(keeps).unwrap_or(0.0);
        receivers.by_groups(
            control,
            Answer::default(),
            || Scratch::new(self.layout),
            |scratch, range, out| {
                let first = range.start;
                if pilot(receivers.group_of(first)) {
                    out.copy_from_slice(&before[range]);
                    return Ok(());
                }
                let mut ids: Vec<usize> = range.collect();
                let mut put = |i: usize, answer| out[i - first] = answer;
                self.answer(receivers, &mut ids, light, Some(&within), scratch, &mut put);
                Ok(())
            },
        )
    }

    /// Asks receivers of a group until the others are told by them.
    pub(super) fn answer_cells(
        &self,
        group: &Group,
        light: &PreparedLight,
        within: &Within,
        s: &mut Scratch,
        put: &mut impl FnMut(usize, Answer),
    ) {
        let (receivers, ids) = (group.receivers, group.ids);
        let mut cells = std::mem::take(&mut s.cells);
        let mut wanted = std::mem::take(&mut s.wanted);
        let edges = !group.known || !s.edges.blocks().is_empty();
        cells.start(receivers, ids, within.columns, &s.unshadowed, edges);
        loop {
            cells.next(receivers, &within.entries, within.tolerance, &mut wanted);
            if wanted.is_empty() {
                break;
            }
            let mut take = |k: usize, answer: Answer| {
                cells.set(k, &answer);
                put(ids[k], answer);
            };
            self.answer_each(group, wanted.iter().copied(), light, s, &mut take);
        }
        for (k, &i) in ids.iter().enumerate() {
            if let Some(sums) = cells.interpolated(k) {
                let by_rays = false;
                put(i, Answer { sums, by_rays });
            }
        }
        (s.cells, s.wanted) = (cells, wanted);
    }
}

impl Within {
    /// The sum of squares by which the visibility of a group, of which all answers are known and whose cells have
    /// started, would be off with a tolerance.
    fn off(
        &self,
        tolerance: f32,
        receivers: &Receivers,
        ids: &[usize],
        answers: &[Answer],
        s: &mut Scratch,
    ) -> f64 {
        let Scratch { cells, wanted, .. } = s;
        loop {
            cells.next(receivers, &self.entries, tolerance, wanted);
            if wanted.is_empty() {
                break;
            }
            wanted.iter().for_each(|&k| cells.set(k, &answers[ids[k]]));
        }
        let off = |(k, &i): (usize, &usize)| {
            let [seen, _] = cells.interpolated(k)?;
            Some(f64::from(seen - answers[i].sums[0]).powi(2))
        };
        ids.iter().enumerate().filter_map(off).sum()
    }
}
