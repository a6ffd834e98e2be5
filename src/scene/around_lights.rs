//! The frame that lights want where they are small in a scene that is large.

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::frame::{Frame, LARGEST, MOVED};
use crate::geometry::{Geometry, MeshRange, distance};
use crate::light::Light;

/// Local size, of itself or of what is between it and the nearest surface, below which a light wants the frame
/// for itself: offsets would be a few ten-thousandths of it.
const SMALL_LIGHT: f64 = 1.0 / 1024.0;

/// The frame that lights want instead of the geometry's, if they do: a lamp over a plane without end has
/// nothing near it but the plane.
///
/// # Errors
/// A light that is moved by more than [`MOVED`] of its size, or of its distance from the nearest surface.
pub(crate) fn for_lights(geometry: &Geometry, lights: &[Light]) -> Result<Option<Frame>> {
    let frame = &geometry.frame;
    let mut least: Option<(f64, DVec3)> = None;
    // A light at infinity has no place to be near.
    for light in lights.iter().filter(|l| l.as_distant().is_none()) {
        let local = light.to_local(frame);
        let (low, high) = local.bounds();
        let own = (high - low).max_element();
        let far = local.center().abs().max_element();
        let moved = if frame.is_core {
            far * f64::from(f32::EPSILON)
        } else {
            0.0
        };
        if own >= SMALL_LIGHT && moved <= MOVED * own {
            continue;
        }
        let size = own.max(clearance(geometry, local.center()));
        if moved > MOVED * size && size > 0.0 {
            let reason = format!(
                "it is {:.3e} from where most of the scene is; there, single precision does not tell \
                 positions apart that are {:.3e} from each other, its size or distance from the nearest surface",
                far * frame.unit,
                size * frame.unit,
            );
            return Err(Error::parameter("light", reason));
        }
        if size >= SMALL_LIGHT {
            continue;
        }
        // A point that touches something is normal input; what has a size is not in a scene of such a size.
        if size * LARGEST < extent(geometry) {
            if own > 0.0 {
                let reason = format!(
                    "of its size and its distance from the nearest surface the larger, {:.3e}, is less than a \
                     billionth of the scene: single precision does not hold both",
                    size * frame.unit,
                );
                return Err(Error::parameter("light", reason));
            }
        } else if least.is_none_or(|l| size < l.0) {
            least = Some((size, light.center()));
        }
    }
    Ok(least.map(|(size, center)| Frame::around(center, size * frame.unit)))
}

/// Largest local coordinate of anything.
fn extent(geometry: &Geometry) -> f64 {
    let points = geometry.positions.par_iter();
    let largest = points.map(|p| f64::from(p.abs().max_element()));
    let largest = largest.reduce(|| 0.0, f64::max);
    let placed = placed(geometry).map(|(_, (low, high))| low.abs().max(high.abs()).max_element());
    let spheres = geometry.spheres.iter();
    let spheres = spheres.map(|s| s.center.abs().max_element() + s.radius);
    spheres.chain(placed).fold(largest, f64::max)
}

/// Distance of a point from the nearest surface.
fn clearance(geometry: &Geometry, p: DVec3) -> f64 {
    let faces = (0..geometry.faces.len() as u32).into_par_iter();
    let of = |face: u32| distance(geometry.corners(face).map(|v| v.as_dvec3()), p);
    let spheres = geometry.spheres.iter();
    let spheres = spheres.map(|s| ((s.center - p).length() - s.radius).abs());
    let least = spheres.fold(faces.map(of).reduce(|| f64::INFINITY, f64::min), f64::min);
    // The nearest instances first, until the others are farther away than what is found.
    let beyond = |(mesh, (low, high)): (_, (DVec3, DVec3))| {
        // Corners are rounded after their bounds are known.
        let rounding = f64::from(f32::EPSILON) * low.abs().max(high.abs()).max_element();
        ((p - p.clamp(low, high)).length() - rounding, mesh)
    };
    let mut instances: Vec<(f64, &MeshRange)> = placed(geometry).map(beyond).collect();
    instances.sort_by(|a, b| a.0.total_cmp(&b.0));
    instances.iter().fold(least, |least, &(beyond, mesh)| {
        if beyond > least {
            return least;
        }
        let placement = geometry.placement(mesh);
        let (vertices, faces) = (mesh.mesh.vertices(), mesh.mesh.faces().par_iter());
        let corner = |v: u32| placement.local(vertices[v as usize]).as_dvec3();
        let of = |f: &[u32; 3]| distance(f.map(corner), p);
        faces.map(of).reduce(|| least, f64::min)
    })
}

/// Placed meshes and their local bounds.
fn placed(geometry: &Geometry) -> impl Iterator<Item = (&MeshRange, (DVec3, DVec3))> {
    let meshes = geometry.meshes.iter().filter(|_| geometry.placed);
    meshes.map(|m| (m, geometry.local_bounds(m)))
}
