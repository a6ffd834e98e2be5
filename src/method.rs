//! What all methods have in common.
//!
//! A method prepares itself once for a scene and its lights ([`Method::prepare`]) and then answers for
//! any receivers ([`Prepared::shade`]). It says which fraction of a light each receiver sees; turning
//! that into radiance is the same for all ([`crate::render`]).

use std::sync::Arc;

use crate::control::Control;
use crate::error::Result;
use crate::light::Light;
use crate::receivers::Receivers;
use crate::scene::snapshot::Snapshot;

/// What a method finds for every receiver under one light, in the receivers' order.
#[derive(Debug, Clone, Default)]
pub struct Shading {
    /// Fraction of the light that is seen, 0 to 1.
    pub visibility: Vec<f32>,
    /// Where the method weights its own samples; otherwise it is the unshadowed irradiance times visibility over the
    /// part of the light above the tangent plane.
    pub irradiance: Option<Irradiance>,
    /// How many receivers a method answered by rays to all their light samples where that is not its way.
    pub by_rays: usize,
}

/// What a method finds of the light that arrives.
#[derive(Debug, Clone)]
pub enum Irradiance {
    /// Irradiance at radiance 1.
    Whole(Vec<f32>),
    /// Part of the unshadowed irradiance.
    Part(Vec<f32>),
}

/// How the shadows of different objects combine. [`crate::methods::single_sample`]'s paper takes the darkest,
/// [`crate::methods::wedges`]'s adds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overlap {
    /// The darkest counts.
    Minimum,
    /// What they leave visible is multiplied.
    Multiply,
    /// What they hide is added.
    Add,
}

/// A method with its parameters.
pub trait Method: Send + Sync {
    /// The name that users call it by.
    fn name(&self) -> &'static str;

    /// Distance of a light from the scene's middle, in local units, up to which the method takes it as it is; lights
    /// that are farther away are brought near ([`crate::far::prepare`]).
    fn reach(&self) -> f64 {
        f64::INFINITY
    }

    /// Whether it takes a snapshot whose meshes are placed instances; otherwise all triangles are to be in one list.
    fn takes_instances(&self) -> bool {
        false
    }

    /// Builds what is paid once for a scene and its lights, which are in local coordinates.
    ///
    /// # Errors
    /// What the method cannot do, or [`crate::error::Error::Cancelled`].
    fn prepare(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>>;
}

/// A method that is ready to answer.
pub trait Prepared: Send + Sync {
    /// Answers for all receivers under light number `light`, with one [`Control::step`] a group.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading>;

    /// Bytes of the method's own data structures.
    fn bytes(&self) -> usize;

    /// What frames found missing and built for all that come after, in seconds so far.
    fn built_seconds(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }

    /// Stages of preparing, in seconds.
    fn seconds(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }
}
