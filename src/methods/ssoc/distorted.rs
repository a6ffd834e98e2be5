//! The camera's reference image: what its distorted rays see (Section 4, Figure 9).
//!
//! The ray of a texel on the lit side of an edge, `x` texels from it, is straight down to the depth at which the
//! penumbra is as wide as `x`, `1/z_b = 1/z_near - x/s` with `s = f r`. Beyond it the ray holds the receivers that the
//! lookup moves to the texel, those at `2 x - w(z)` with `w(z) = s (1/z_near - 1/z)`. That times `z` is linear in `z`: the
//! second part is straight as well, on a line from the light's rim. So two segments are exact, of which the shadow
//! map has the first, and nothing has to be subdivided.

use rayon::prelude::*;

use super::maps::{FirstHit, Maps};
use crate::bvh::Occluders;
use crate::bvh::packet::Stack;
use crate::control::Control;
use crate::error::Result;
use crate::raster::nearest::NONE;

impl Maps {
    /// Finds what the distorted rays see first, [`Maps::seen`].
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    pub fn reference(&mut self, occluders: &Occluders, control: &Control) -> Result<()> {
        let width = self.view.camera.width as usize;
        let mut seen = vec![FirstHit::NOTHING; self.view.camera.pixels()];
        let rows = seen.par_chunks_mut(width).enumerate();
        rows.try_for_each_init(Stack::new, |stack, (row, out)| {
            control.check()?;
            for (column, out) in out.iter_mut().enumerate() {
                *out = self.first(occluders, row * width + column, stack);
            }
            Ok(())
        })?;
        self.seen = seen;
        Ok(())
    }

    /// What the ray of a texel sees first.
    fn first(&self, occluders: &Occluders, texel: usize, stack: &mut Stack) -> FirstHit {
        let view = &self.view;
        let q = view.center(texel);
        let straight = FirstHit::straight(self, texel);
        let edge = self.outside[texel];
        if edge == NONE {
            return straight;
        }
        let foot = self.lines[edge as usize].foot(q);
        let (radius, _) = view.outline.radius(foot.normal, view.tangents(foot.point));
        let scale = view.focal * radius;
        let bend = foot.inverse_near - foot.x / scale;
        if bend.is_nan() || bend <= straight.inverse_depth.max(view.inverse_far) {
            return straight;
        }
        let to_local = view.camera.rotation.transpose();
        let at = |inverse: f64| {
            let x = 2.0 * foot.x - scale * (foot.inverse_near - inverse);
            let d = view.tangents(foot.point + foot.normal * x).extend(1.0);
            (view.camera.eye + to_local * d / inverse).as_vec3()
        };
        // Past all of the scene.
        let (from, to) = (at(bend), at(0.5 * view.inverse_far));
        let Some((t, triangle)) = occluders.first_triangle(from, to, stack) else {
            return FirstHit::NOTHING;
        };
        let p = from.as_dvec3().lerp(to.as_dvec3(), t);
        let p = view.camera.rotation * (p - view.camera.eye);
        FirstHit {
            at: p.truncate() / p.z,
            inverse_depth: 1.0 / p.z,
            triangle,
        }
    }
}
