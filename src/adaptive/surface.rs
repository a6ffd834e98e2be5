//! Which receivers lie on one surface, so that one can tell something of the other: on the same entry of the scene,
//! near each other's tangent plane and turned alike.

use rayon::prelude::*;

use crate::geometry::Geometry;
use crate::raster::nearest::NONE;
use crate::receivers::Receivers;

/// Least cosine between normals of one surface.
const ALIKE: f32 = 0.9;

/// Largest part of the distance of two receivers of one surface that is across its tangent plane.
const ACROSS: f32 = 0.15;

/// The entry of the scene that each receiver of a camera lies on; [`NONE`] for spheres.
pub fn entries(geometry: &Geometry, receivers: &Receivers) -> Vec<u32> {
    let of = |last: &mut Option<_>, face: &u32| match *face {
        NONE => NONE,
        face => geometry.mesh_after(last, face).entry,
    };
    let faces = receivers.faces.par_iter().with_min_len(1024);
    faces.map_init(|| None, of).collect()
}

/// Whether receivers of one entry lie on one surface: by the dot product of their normals, how far the one lies over
/// the other's tangent plane, and their squared distance.
#[inline(always)]
pub fn is_one(turned: f32, across: f32, squared: f32) -> bool {
    (turned >= ALIKE) & (across * across <= ACROSS * ACROSS * squared)
}
