//! What the samples of a light are laid out on: the edges of a flat one, or the cap of directions in which a receiver
//! sees a sphere or a distant light.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::light::{DistantLight, Light, PolygonLight, SphereLight};

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

/// The cap of directions in which a sphere is seen from outside, or a distant light from anywhere.
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
    /// What light samples at radiance 1 weigh together: the solid angle, or a distant light's own scale.
    pub(super) weight: f64,
    /// Whether all light points are as far from the receiver, and not on a sphere.
    pub(super) distant: bool,
}

impl Cap {
    pub(super) fn new(light: &Light, p: DVec3) -> Option<Cap> {
        if let Some(distant) = light.as_distant() {
            return Some(Cap::at_infinity(&distant));
        }
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
            weight: TAU * height,
            distant: false,
        })
    }

    fn at_infinity(light: &DistantLight) -> Cap {
        let axis = light.towards;
        let e1 = axis.any_orthonormal_vector();
        Cap {
            axis,
            e1,
            e2: axis.cross(e1),
            distance: light.distance,
            // In the middle, so that nothing of the scene is behind any of it.
            radius: 0.0,
            sin: light.sin,
            cos: light.cos,
            height: light.sin * light.sin / (1.0 + light.cos),
            weight: light.scale(),
            distant: true,
        }
    }
}
