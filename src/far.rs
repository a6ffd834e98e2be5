//! Lights that are far away, seen from a scene that a projective map has brought nearer to them.
//!
//! Maps and wedges keep depths from the light in `f32`, or take differences of them in `f64`: from a light 10⁴ scene
//! sizes away a map cannot tell a caster from what it shades, and from 10⁷ on nothing can. What a point sees of a
//! light depends on lines and planes alone, and these a projective map keeps. With `s` the height of a local point
//! over the scene's middle, towards the light, every method answers here for the scene moved by
//!
//! `T(p) = p / (1 + α s)`
//!
//! - Lines stay lines, and what lies between two points stays between them, as `1 + α s` is positive on the scene and
//!   on the light. So all that is hidden stays hidden.
//! - A plane of one height is scaled as a whole. For a flat light `s` is along its normal: it stays the same light, moved
//!   and scaled, uniform in area.
//! - Directions from the scene's middle stay. A sphere keeps the cone in which the middle sees it; other points
//!   see it under an angle that is wrong by its own square over `NEAR`.
//!
//! A distant light is the limit: its cap of directions becomes a sphere with that cone. With `cos` that of half its
//! angle, `α = 1 / (NEAR cos²)` moves all that is infinitely far to the plane of the sphere's outline, so that nothing
//! of a scene reaches the sphere. Parallel lines meet there, planes along the light's direction become planes through
//! the outline's middle, and a view from there is a parallel projection of the scene. No receiver sees more than what is
//! above its tangent plane by the cap's closed form, whose signs the map has to rounding only.
//!
//! The light may be at any distance: in `T` it is at `NEAR`, or as near as a scene allows that reaches far beyond its
//! middle. Lengths of the scene change by parts of 1 / `NEAR`, and with them a method's thresholds.
//!
//! Fails where `1 + α s` all but changes sign within the scene (a flat light that is seen edge-on, a plain of more than
//! a thousand times what stands on it under a slanting light), and where a camera lies beyond that; both are
//! errors.

use crate::scene::snapshot::Snapshot;
use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::control::Control;
use crate::error::{Error, Result};
use crate::geometry::Geometry;
use crate::light::{DistantLight, Light, Shape, SphereLight};
use crate::method::{Method, Prepared, Shading};
use crate::raster::nearest::NONE;
use crate::receivers::Receivers;

/// Distance, in local units, that lights are brought to: far enough for lengths to stay what they are to a
/// sixtieth, near enough for depths in `f32`: beyond some 300 `ssoc` begins to tell edges apart from their own surfaces.
const NEAR: f64 = 128.0;

/// Distance of a light, in local units, from which on maps are given a nearer one: no error of theirs has grown there
/// (`tests/test_far_lights.py`); those of `ssoc` have at twice as far.
pub const REACH: f64 = NEAR;

/// Distance up to which depths do, at errors of a few thousandths at most: lights are left there, or brought there
/// where the scene is too large for `NEAR`, as a town on a plain is.
const DIRECT: f64 = 4096.0;

/// Least distance of a brought sphere's outline: four scene sizes, which all of the scene is before.
const OUTLINE: f64 = 4.0;

/// Least that `1 + α s` may be on the scene: its farthest parts are four times as large there as they are.
const LEAST_WEIGHT: f64 = 0.25;

/// `method`, ready for a scene and its lights (local), wherever they are.
///
/// # Errors
/// The errors of [`Method::prepare`], and one for a light too far away that is seen edge-on.
pub fn prepare(
    method: &dyn Method,
    geometry: Arc<Snapshot>,
    lights: &[Light],
    control: &Control,
) -> Result<Box<dyn Prepared>> {
    let most = method.reach().max(DIRECT);
    let mut near = Vec::new();
    let mut far = Vec::new();
    let mut places = Vec::with_capacity(lights.len());
    for light in lights {
        if method.reach().is_finite() {
            light.check_disk(method.name())?;
        }
        if distance(light) <= method.reach() {
            places.push((0, near.len()));
            near.push(light.clone());
            continue;
        }
        match Moved::holding(light, &geometry, most) {
            Some((moved, brought)) => {
                places.push((1 + far.len(), 0));
                far.push((moved, brought, light.as_distant().map(|_| light.clone())));
            }
            None if distance(light) <= most => {
                places.push((0, near.len()));
                near.push(light.clone());
            }
            None if light.as_distant().is_some() => {
                let reason = format!(
                    "it slants over a scene that reaches far beyond its middle: so {} cannot tell what hides the light; \
                     ray_traced, hard and accumulation can",
                    method.name(),
                );
                return Err(Error::parameter("light", reason));
            }
            None => {
                let reason = format!(
                    "it is {:.1e} away, and seen edge-on, or slanting over a scene that reaches far beyond its middle: so {} cannot tell what hides the light; \
                     ray_traced, hard and accumulation can",
                    light.center().length() * geometry.frame.unit,
                    method.name(),
                );
                return Err(Error::parameter("light", reason));
            }
        }
    }
    if far.is_empty() {
        return method.prepare(geometry, &near, control);
    }
    // The first part is that of near lights, also where there are none.
    let mut parts = vec![Part {
        moved: None,
        distant: None,
        prepared: method.prepare(geometry.clone(), &near, control)?,
    }];
    for (moved, brought, distant) in far {
        control.check()?;
        let scene = geometry.mapped(|p| moved.point(p));
        parts.push(Part {
            prepared: method.prepare(scene.clone(), &[brought], control)?,
            moved: Some((moved, scene)),
            distant,
        });
    }
    Ok(Box::new(PreparedFar {
        method: method.name(),
        parts,
        places,
    }))
}

/// How far away the nearest of a light is, about.
fn distance(light: &Light) -> f64 {
    let distance = light.center().length();
    distance - light.as_sphere().map_or(0.0, |sphere| sphere.radius)
}

/// The map `T`.
#[derive(Debug, Clone, Copy)]
struct Moved {
    /// `α` times the direction of heights.
    slope: DVec3,
}

impl Moved {
    /// The map that brings a local light as near as a scene allows, and the light in it; nothing beyond `most`.
    fn holding(light: &Light, geometry: &Geometry, most: f64) -> Option<(Moved, Light)> {
        let mut brought = NEAR;
        while brought <= most {
            let found = Moved::new(light, brought);
            if let Some((moved, light)) = found
                && moved.least_weight(geometry) >= LEAST_WEIGHT
            {
                return Some((moved, light));
            }
            brought *= 2.0;
        }
        None
    }

    /// The map that brings a local light to a distance, and the light in it; nothing if the light's plane goes through
    /// the scene's middle, or a sphere is as near as large.
    fn new(light: &Light, brought: f64) -> Option<(Moved, Light)> {
        if let Some(distant) = light.as_distant() {
            return Moved::from_infinity(light, &distant, brought);
        }
        let center = light.center();
        let distance = center.length();
        // What of the light keeps its directions: a flat light's middle, the outline of a sphere.
        let (towards, height, outline) = match light.as_sphere() {
            Some(SphereLight { radius, .. }) => {
                let sin = radius / distance;
                (
                    center / distance,
                    distance * (1.0 - sin * sin),
                    1.0 - sin * sin,
                )
            }
            None => {
                let towards = -light.normal()?;
                (towards, towards.dot(center), 1.0)
            }
        };
        let scale = brought / distance;
        // (1 + α s) of the light is 1 / scale.
        let alpha = (1.0 / scale - 1.0) / height;
        // A sphere whose surface is so near that its outline is beside the scene is not far away.
        if !alpha.is_finite() || outline * brought < OUTLINE {
            return None;
        }
        let moved = Moved {
            slope: alpha * towards,
        };
        Some((moved, light.mapped(|p| p * scale, |x| x * scale)))
    }

    fn from_infinity(
        light: &Light,
        distant: &DistantLight,
        brought: f64,
    ) -> Option<(Moved, Light)> {
        let outline = brought * distant.cos * distant.cos;
        if outline < OUTLINE {
            return None;
        }
        let center = distant.towards * brought;
        let radius = distant.sin * brought;
        let moved = Moved {
            slope: distant.towards / outline,
        };
        let shape = Shape::Sphere(SphereLight { center, radius });
        let radiance = light.radiance;
        Some((moved, Light { shape, radiance }))
    }

    fn weight(&self, p: DVec3) -> f64 {
        1.0 + self.slope.dot(p)
    }

    /// The least of it on a scene's triangles.
    fn least_weight(&self, geometry: &Geometry) -> f64 {
        let of = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|v| self.weight(geometry.positions[v as usize].as_dvec3()));
            a.min(b).min(c)
        };
        geometry
            .faces
            .par_iter()
            .map(of)
            .reduce(|| f64::INFINITY, f64::min)
    }

    fn point(&self, p: DVec3) -> DVec3 {
        p / self.weight(p)
    }

    /// The normal at `p` of a surface through it: planes `n·(x - p) = 0` stay planes, and turn with the map.
    fn normal(&self, p: DVec3, n: DVec3) -> DVec3 {
        (n + n.dot(p) * self.slope).normalize_or_zero()
    }

    /// The camera that sees `T` of what `camera` sees at the same places.
    fn camera(&self, camera: &Camera) -> Option<Camera> {
        let weight = self.weight(camera.eye);
        if weight <= 0.0 {
            return None;
        }
        // With x = y / (1 - slope·y), K R (x - e) is K R (I + e slopeᵀ) (y - T(e)), over a factor.
        let turned = DMat3::from_cols(
            camera.eye * self.slope.x,
            camera.eye * self.slope.y,
            camera.eye * self.slope.z,
        ) + DMat3::IDENTITY;
        let rows = (camera.intrinsics * camera.rotation * turned).transpose();
        // Its rows, taken apart into an upper triangular matrix and a rotation.
        let (forward, length) = (rows.z_axis.normalize(), rows.z_axis.length());
        let down = rows.y_axis - rows.y_axis.dot(forward) * forward;
        let down = down.normalize();
        let right = down.cross(forward);
        let k = DMat3::from_cols(
            DVec3::new(rows.x_axis.dot(right), 0.0, 0.0),
            DVec3::new(rows.x_axis.dot(down), rows.y_axis.dot(down), 0.0),
            DVec3::new(rows.x_axis.dot(forward), rows.y_axis.dot(forward), length),
        ) * (1.0 / length);
        Some(Camera {
            eye: self.point(camera.eye),
            rotation: DMat3::from_cols(right, down, forward).transpose(),
            intrinsics: k,
            ..*camera
        })
    }

    /// The receivers in `scene`, the moved one; nothing if the camera is beyond what the map holds.
    fn receivers(&self, of: &Receivers, scene: &Geometry) -> Option<Receivers> {
        let camera = match &of.camera {
            Some(camera) => Some(self.camera(camera)?),
            None => None,
        };
        let one = |i: usize| {
            let (p, n) = (of.positions[i], of.normals[i]);
            let (p, n) = (self.point(p), self.normal(p, n));
            match of.faces.get(i) {
                Some(&face) if face != NONE => on_triangle(scene.corners(face), p, n),
                _ => (p, n),
            }
        };
        let (positions, normals) = (0..of.len()).into_par_iter().map(one).unzip();
        Some(Receivers {
            positions,
            normals,
            camera,
            ..of.clone()
        })
    }
}

/// A receiver's position and normal on its own triangle again, whose corners were rounded when they were moved: methods
/// take receivers of a camera to lie on their triangles.
fn on_triangle([a, b, c]: [Vec3; 3], p: DVec3, n: DVec3) -> (DVec3, DVec3) {
    let [a, b, c] = [a, b, c].map(|v| v.as_dvec3());
    match (b - a).cross(c - a).try_normalize() {
        Some(own) if own.dot(n).abs() > 0.5 => {
            let own = if own.dot(n) < 0.0 { -own } else { own };
            (p - own * own.dot(p - a), own)
        }
        // A sliver, of which rounding has left no plane.
        _ => (p, n),
    }
}

/// A method, prepared for some of the lights.
struct Part {
    /// For lights that were far away: the projective map that brought them near, and the scene as that map has it.
    moved: Option<(Moved, Arc<Snapshot>)>,
    /// The light, if it was at infinity.
    distant: Option<Light>,
    prepared: Box<dyn Prepared>,
}

/// A method with scenes of their own for lights that are far away.
struct PreparedFar {
    method: &'static str,
    parts: Vec<Part>,
    /// For every light, the number of its part and its number within that part.
    places: Vec<(usize, usize)>,
}

impl Prepared for PreparedFar {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let (part, number) = self.places[light];
        let Part {
            moved,
            distant,
            prepared,
        } = &self.parts[part];
        let Some((moved, scene)) = moved else {
            return prepared.shade(receivers, number, control);
        };
        let within = |p: &DVec3| moved.weight(*p) > 0.0;
        if receivers.positions.iter().all(within)
            && let Some(seen) = moved.receivers(receivers, scene)
        {
            let mut shading = prepared.shade(&seen, number, control)?;
            if let Some(light) = distant {
                cut(&mut shading.visibility, receivers, light);
            }
            return Ok(shading);
        }
        let reason = format!(
            "under a light that is far away it cannot answer for a camera or points more than {NEAR} scene sizes \
             away on the other side of the scene"
        );
        Err(Error::Unsupported {
            method: self.method,
            reason,
        })
    }

    fn bytes(&self) -> usize {
        let scene = |p: &Part| p.moved.as_ref().map_or(0, |(_, scene)| scene.bytes());
        let of = |p: &Part| p.prepared.bytes() + scene(p);
        self.parts.iter().map(of).sum()
    }

    fn built_seconds(&self) -> Vec<(&'static str, f64)> {
        added(self.parts.iter().map(|p| p.prepared.built_seconds()))
    }

    fn seconds(&self) -> Vec<(&'static str, f64)> {
        added(self.parts.iter().map(|p| p.prepared.seconds()))
    }
}

/// Of no receiver more is seen than what is above its tangent plane, which the map has to rounding only.
fn cut(visibility: &mut [f32], receivers: &Receivers, light: &Light) {
    let one = |(i, seen): (usize, &mut f32)| {
        let above = light.fraction_above(receivers.positions[i], receivers.normals[i]);
        *seen = seen.min(above as f32);
    };
    visibility.par_iter_mut().enumerate().for_each(one);
}

/// Seconds of the same stages, added.
fn added(parts: impl Iterator<Item = Vec<(&'static str, f64)>>) -> Vec<(&'static str, f64)> {
    let mut out: Vec<(&'static str, f64)> = Vec::new();
    for (stage, seconds) in parts.flatten() {
        match out.iter_mut().find(|(s, _)| *s == stage) {
            Some((_, sum)) => *sum += seconds,
            None => out.push((stage, seconds)),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moved(distance: f64) -> (Light, Moved, Light) {
        let towards = DVec3::new(0.3, -0.5, 0.8).normalize();
        let tilted = (-towards + DVec3::new(0.0, 0.4, 0.1)).normalize();
        let light = Light::disk(towards * distance, tilted, 0.1 * distance, [1.0; 3]).unwrap();
        let (moved, near) = Moved::new(&light, NEAR).unwrap();
        (light, moved, near)
    }

    #[test]
    fn a_flat_light_keeps_its_points_and_lines_stay_lines() {
        for distance in [1e4, 1e8, 1e13] {
            let (light, moved, near) = moved(distance);
            let across = light.normal().unwrap().any_orthonormal_vector();
            let rim = light.center() + 0.1 * distance * across;
            let expected = near.center() + 0.1 * NEAR * across;
            assert!(
                moved.point(rim).distance(expected) < 1e-9 * NEAR,
                "{distance}"
            );
            // A point on the way to it stays on the way.
            let p = DVec3::new(0.2, 0.7, -0.4);
            let on = p + (rim - p) * (0.5 / distance);
            let [p, on, rim] = [p, on, rim].map(|p| moved.point(p));
            let off = (on - p).cross(rim - p).length() / (rim - p).length();
            assert!(off < 1e-12, "{distance}: {off}");
            assert!(((rim - p).dot(on - p)) > 0.0);
        }
    }

    #[test]
    fn a_light_at_infinity_is_moved_as_spheres_in_the_limit() {
        let towards = DVec3::new(0.3, -0.5, 0.8).normalize();
        for angle in [0.0, 0.53, 60.0, 150.0] {
            let light = Light::distant(-towards, angle, [1.0; 3]).unwrap();
            let (moved, near) = Moved::new(&light, NEAR).unwrap();
            let sin = (0.5 * angle).to_radians().sin();
            for distance in [1e6, 1e12] {
                let sphere = Light::sphere(towards * distance, sin * distance, [1.0; 3]);
                let (limit, expected) = Moved::new(&sphere.unwrap(), NEAR).unwrap();
                let off = (limit.slope - moved.slope).length() / moved.slope.length();
                assert!(off < 2.0 * NEAR / distance, "{angle} {distance}: {off}");
                assert!((near.center() - expected.center()).length() < 1e-9);
                let [a, b] = [&near, &expected].map(|l| l.as_sphere().unwrap().radius);
                assert!((a - b).abs() < 1e-9);
            }
            // Parallel lines along the direction meet in the middle of the outline, as all that is so far does.
            let p = DVec3::new(0.2, 0.7, -0.4);
            let end = moved.point(p + towards * 1e12);
            let outline = near.center() * (1.0 - sin * sin);
            assert!((end - outline).length() < 1e-6, "{angle}: {end} {outline}");
        }
        let wide = Light::distant(-towards, 179.9, [1.0; 3]).unwrap();
        assert!(Moved::new(&wide, DIRECT).is_none());
    }

    #[test]
    fn planes_turn_with_the_map_and_cameras_see_the_same() {
        let (_, moved, _) = moved(1e9);
        let (p, n) = (DVec3::new(0.2, 0.7, -0.4), DVec3::new(0.48, 0.6, -0.64));
        let turned = moved.normal(p, n);
        let on = p + 0.3 * n.any_orthonormal_vector();
        assert!(turned.dot(moved.point(on) - moved.point(p)).abs() < 1e-15);
        let above = moved.point(p + 0.1 * n) - moved.point(p);
        assert!(turned.dot(above) > 0.09);
        let k = DMat3::from_cols_array(&[500.0, 0.0, 0.0, 3.0, 480.0, 0.0, 320.0, 250.0, 1.0]);
        let pose = DMat3::from_rotation_x(2.0) * DMat3::from_rotation_z(0.3);
        let camera = Camera::new(k, pose, DVec3::new(1.0, 2.0, 3.0), 640, 480).unwrap();
        let seen = moved.camera(&camera).unwrap();
        let seen = Camera::new(
            seen.intrinsics,
            seen.rotation.transpose(),
            seen.eye,
            640,
            480,
        );
        let seen = seen.unwrap();
        for p in [p, on, DVec3::new(-0.9, 0.3, 0.8)] {
            let (a, b) = (camera.project(p), seen.project(moved.point(p)));
            assert!((a.truncate() / a.z - b.truncate() / b.z).length() < 1e-9);
            assert_eq!(a.z > 0.0, b.z > 0.0);
        }
    }

    #[test]
    fn a_far_light_that_is_seen_edge_on_turns_the_scene_inside_out() {
        let light = Light::disk(DVec3::X * 1e9, DVec3::Z, 1e8, [1.0; 3]).unwrap();
        assert!(Moved::new(&light, NEAR).is_none());
        let light = Light::disk(DVec3::new(1e9, 0.0, 1.0), -DVec3::Z, 1e8, [1.0; 3]).unwrap();
        assert!(Moved::new(&light, NEAR).unwrap().0.weight(-DVec3::Z) < 0.0);
    }
}
