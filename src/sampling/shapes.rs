//! What the samples of a flat light and of a sphere are laid out on: its edges, or the cap of directions in
//! which a receiver sees it.

use glam::DVec3;

use crate::light::{Light, PolygonLight, SphereLight};

/// A flat light: the square [-1, 1]² is the light, has it as its inscribed disk, or lies around it.
#[derive(Debug, Clone)]
pub(super) struct Flat {
    pub(super) center: DVec3,
    pub(super) u: DVec3,
    pub(super) v: DVec3,
    pub(super) normal: DVec3,
    pub(super) area: f64,
    pub(super) disk: bool,
    /// The light, if it is a polygon in the square.
    pub(super) polygon: Option<PolygonLight>,
}

/// The cap of directions in which a sphere is seen from outside.
pub(super) struct Cap {
    pub(super) axis: DVec3,
    pub(super) e1: DVec3,
    pub(super) e2: DVec3,
    pub(super) distance: f64,
    pub(super) radius: f64,
    pub(super) sin: f64,
    pub(super) cos: f64,
    /// 1 - cos of the half-angle, without cancellation.
    pub(super) height: f64,
}

impl Cap {
    pub(super) fn new(light: &Light, p: DVec3) -> Option<Cap> {
        let SphereLight { center, radius } = light.as_sphere()?;
        let d = center - p;
        let distance = d.length();
        if distance <= radius || distance == 0.0 {
            return None;
        }
        let axis = d / distance;
        let e1 = axis.any_orthonormal_vector();
        let sin = radius / distance;
        let cos = ((1.0 - sin) * (1.0 + sin)).sqrt();
        let height = sin * sin / (1.0 + cos);
        Some(Cap {
            axis,
            e1,
            e2: axis.cross(e1),
            distance,
            radius,
            sin,
            cos,
            height,
        })
    }
}
