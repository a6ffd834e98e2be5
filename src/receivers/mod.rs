//! The points that visibility is wanted for: one type for a camera's pixels and a user's own points.
//!
//! Receivers come in groups of up to [`GROUP`] neighbours, 8×8 pixels or points that are close on a
//! Morton curve, so that methods can share work between them.
//!
//! Positions of pixels are found on the plane of the triangle that the rasteriser saw, in `f64`: they
//! lie on the surface to a few `f64` ulps.

mod pixels;
pub mod visible;

use std::ops::Range;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::control::Control;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::frame::POINT_OFFSET;
use crate::memory::{fill, unwritten, written};
use crate::mesh::check_finite;

/// Most receivers in a group.
pub const GROUP: usize = 64;

/// Most groups that one task takes: what is in the sky ends soon, and what is left is to be shared.
const MOST_GROUPS: usize = 64;

/// Side of a group of pixels.
pub const BLOCK: u32 = 8;

/// Receivers in local coordinates.
#[derive(Debug, Clone, Default)]
pub struct Receivers {
    /// Local positions.
    pub positions: Vec<DVec3>,
    /// Unit normals; zero where a receiver has no tangent plane.
    pub normals: Vec<DVec3>,
    /// Index of each receiver in the user's array or among the camera's pixels.
    pub index: Vec<u32>,
    /// Where each group starts, and the end.
    pub groups: Vec<u32>,
    /// What each receiver of a camera lies on: a triangle of [`crate::geometry::Geometry::faces`], or [`crate::raster::nearest::NONE`] for a sphere. Empty
    /// for a user's own points.
    pub faces: Vec<u32>,
    /// The camera (local) whose pixels they are; each group then lies in one block of 8×8 pixels.
    pub camera: Option<Camera>,
}

impl Receivers {
    /// Number of receivers.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Number of groups: the steps in which a method answers under one light.
    pub fn group_count(&self) -> usize {
        self.groups.len().saturating_sub(1)
    }

    /// The receivers of a group.
    pub fn group(&self, group: usize) -> Range<usize> {
        self.groups[group] as usize..self.groups[group + 1] as usize
    }

    /// The group that receiver `i` is in.
    pub fn group_of(&self, i: usize) -> usize {
        self.groups.partition_point(|&start| start as usize <= i) - 1
    }

    /// A value for each receiver: `find` gets what a thread keeps between groups, the receivers of a group, and
    /// their places, which hold `value`. A step of `control` for each group.
    ///
    /// # Errors
    /// The errors of `find`, or [`Error::Cancelled`].
    pub fn by_groups<S, T: Copy + Send + Sync>(
        &self,
        control: &Control,
        value: T,
        keep: impl Fn() -> S + Sync + Send,
        find: impl Fn(&mut S, Range<usize>, &mut [T]) -> Result<()> + Sync + Send,
    ) -> Result<Vec<T>> {
        let mut all = unwritten(self.len());
        let mut rest = &mut all[..];
        let mut groups = Vec::with_capacity(self.group_count());
        for range in (0..self.group_count()).map(|group| self.group(group)) {
            let (here, after) = rest.split_at_mut(range.len());
            rest = after;
            groups.push((range, here));
        }
        assert!(rest.is_empty(), "every receiver is in a group");
        groups
            .into_par_iter()
            .with_max_len(MOST_GROUPS)
            .try_for_each_init(keep, |kept, (range, here)| {
                control.step()?;
                find(kept, range, fill(here, value))
            })?;
        // SAFETY: the groups share all out among themselves, and each was filled.
        Ok(unsafe { written(all) })
    }

    /// Where rays of receiver `i` start: moved along its normal by four ulps of the largest coordinate
    /// (at least of 1), more than the rounding to `f32`, so that the start is strictly in front of the
    /// receiver's own plane.
    pub fn ray_origin(&self, i: usize) -> Vec3 {
        let (p, n) = (self.positions[i], self.normals[i]);
        (p + n * (POINT_OFFSET * p.abs().max_element().max(1.0))).as_vec3()
    }

    /// A user's own points, in world coordinates.
    ///
    /// # Errors
    /// A coordinate that is not finite, a zero normal, or more points than 32-bit indices.
    pub fn from_points(frame: &Frame, points: &[DVec3], normals: Option<&[DVec3]>) -> Result<Self> {
        let limit = u32::MAX as usize;
        if points.len() > limit {
            let (what, count) = ("points".to_string(), points.len());
            return Err(Error::TooLarge {
                what,
                count,
                items: "points",
                limit,
            });
        }
        check_finite("points", "point", points)?;
        if let Some(normals) = normals {
            if normals.len() != points.len() {
                let reason = format!(
                    "expected {}, one a point, got {}",
                    points.len(),
                    normals.len()
                );
                return Err(Error::parameter("normals", reason));
            }
            check_finite("normals", "normal", normals)?;
            if let Some(i) = normals.iter().position(|n| *n == DVec3::ZERO) {
                return Err(Error::parameter("normals", format!("normal {i} is zero")));
            }
        }
        let local: Vec<DVec3> = points.par_iter().map(|&p| frame.to_local(p)).collect();
        let mut order: Vec<(u64, u32)> = local
            .par_iter()
            .enumerate()
            .map(|(i, p)| (morton(*p), i as u32))
            .collect();
        order.par_sort_unstable();
        let index: Vec<u32> = order.into_iter().map(|(_, i)| i).collect();
        let normal = |&i: &u32| normals.map_or(DVec3::ZERO, |n| unit(n[i as usize]));
        // A user knows the surface, and not how far rounding moved it.
        let position = |i: &u32| local[*i as usize] + normal(i) * (2.0 * frame.rounding);
        let groups = (0..index.len())
            .step_by(GROUP)
            .chain([index.len()])
            .map(|g| g as u32);
        Ok(Receivers {
            positions: index.par_iter().map(position).collect(),
            normals: index.par_iter().map(normal).collect(),
            groups: groups.collect(),
            index,
            faces: Vec::new(),
            camera: None,
        })
    }
}

/// A vector that is not zero at unit length, however long or short.
fn unit(v: DVec3) -> DVec3 {
    (v / v.abs().max_element()).normalize()
}

/// Cell of a local position on a Morton curve of 2²¹ cells a side over [-2, 2]; what lies outside is
/// put on the border.
fn morton(p: DVec3) -> u64 {
    let spread = |x: f64| {
        let mut v = (((x + 2.0) * 0.25).clamp(0.0, 1.0) * f64::from((1 << 21) - 1)) as u64;
        v = (v | (v << 32)) & 0x001f_0000_0000_ffff;
        v = (v | (v << 16)) & 0x001f_0000_ff00_00ff;
        v = (v | (v << 8)) & 0x100f_00f0_0f00_f00f;
        v = (v | (v << 4)) & 0x10c3_0c30_c30c_30c3;
        (v | (v << 2)) & 0x1249_2492_4924_9249
    };
    spread(p.x) | (spread(p.y) << 1) | (spread(p.z) << 2)
}
