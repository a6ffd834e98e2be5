//! Where in space the square lies that a receiver sees a light in.

use glam::{DVec3, Vec3};

use super::shapes::{Cap, Flat};
use super::{POINT_OFFSET, Sampler};

/// The unit square of a [`LightProjection`](super::LightProjection) in space: directions from the receiver, one
/// corner and the two sides at it. Of a flat light it lies in the light's plane; of a sphere it touches the
/// unit sphere around the receiver at the direction to the light's middle.
#[derive(Debug, Clone, Copy)]
pub struct Square {
    /// The receiver.
    from: DVec3,
    /// From the receiver to the corner at (0, 0).
    pub corner: DVec3,
    /// The sides along both coordinates.
    pub sides: [DVec3; 2],
    /// The light fills the disk in the square.
    pub disk: bool,
    /// `w·q` up to which what does not touch the light, seen in the disk or anywhere in front of a flat light,
    /// lies before it, and beyond which it lies behind it.
    pub front: f32,
    ball: Option<Ball>,
}

/// What tells where a direction meets a sphere.
#[derive(Debug, Clone, Copy)]
struct Ball {
    axis: DVec3,
    distance: f64,
    radius: f64,
    /// By how much light points are moved off it.
    offset: f64,
}

impl Sampler {
    /// The square in which the receiver at `p` sees the light; meaningful only where it has a
    /// [`view`](Sampler::view).
    pub fn square(&self, p: DVec3) -> Square {
        match (&self.flat, Cap::new(&self.light, p)) {
            (Some(flat), _) => Square::flat(flat, p),
            (None, Some(cap)) => {
                let size = cap.distance + self.light.center().abs().max_element().max(1.0);
                Square::cap(&cap, p, POINT_OFFSET * size)
            }
            (None, None) => Square {
                from: p,
                corner: DVec3::ZERO,
                sides: [DVec3::ZERO; 2],
                disk: true,
                front: 0.0,
                ball: None,
            },
        }
    }
}

impl Square {
    fn flat(flat: &Flat, p: DVec3) -> Square {
        Square {
            from: p,
            corner: flat.center - flat.u - flat.v - p,
            sides: [2.0 * flat.u, 2.0 * flat.v],
            disk: flat.disk,
            front: f32::MAX,
            ball: None,
        }
    }

    fn cap(cap: &Cap, p: DVec3, offset: f64) -> Square {
        let tangent = cap.sin / cap.cos;
        let sides = [2.0 * tangent * cap.e1, 2.0 * tangent * cap.e2];
        Square {
            from: p,
            corner: cap.axis - 0.5 * (sides[0] + sides[1]),
            sides,
            disk: true,
            // The plane through the circle in which lines from the receiver touch the sphere: on any line that
            // meets the sphere it lies between where the line enters and where it leaves.
            front: if cap.distant {
                f32::MAX
            } else {
                (1.0 - cap.sin) as f32
            },
            ball: Some(Ball {
                axis: cap.axis,
                distance: cap.distance,
                radius: cap.radius,
                offset,
            }),
        }
    }

    /// Whether it lies in the plane of a flat light.
    pub fn is_flat(&self) -> bool {
        self.ball.is_none()
    }

    /// The light point that is seen at these coordinates.
    pub fn point(&self, [s, t]: [f64; 2]) -> Vec3 {
        let q = self.corner + s * self.sides[0] + t * self.sides[1];
        let to = match self.ball {
            None => q,
            Some(ball) => {
                let direction = q.normalize();
                let along = ball.distance * direction.dot(ball.axis);
                // Seldom the rim, where rounding may miss the sphere.
                let across = (ball.distance * ball.distance - along * along).max(0.0);
                let half = (ball.radius * ball.radius - across).max(0.0).sqrt();
                direction * (along - half - ball.offset)
            }
        };
        (self.from + to).as_vec3()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{LightSamples, Pattern};
    use super::*;
    use crate::light::Light;

    #[test]
    fn a_light_point_is_where_the_projection_has_it() {
        let c = DVec3::new(0.2, -0.3, 1.1);
        let (u, v) = (DVec3::new(0.0, 0.6, 0.1), DVec3::new(0.7, 0.0, 0.0));
        let lights = [
            Light::rect(c, u, v, [1.0; 3]).unwrap(),
            Light::disk(c, DVec3::new(0.1, 0.2, -1.0), 0.4, [1.0; 3]).unwrap(),
            Light::sphere(c, 0.4, [1.0; 3]).unwrap(),
            Light::polygon(&[c - u, c - v, c + u, c - 0.3 * v], [1.0; 3]).unwrap(),
        ];
        let p = DVec3::new(-0.1, 0.2, 0.0);
        for light in lights {
            let sampler = Sampler::new(light.clone(), Pattern::new(256, 1), false);
            let (view, square) = (sampler.view(p).unwrap(), sampler.square(p));
            let mut samples = LightSamples::default();
            sampler.fill(0, p, DVec3::ZERO, &mut samples);
            for i in 0..samples.count {
                let q = samples.point(i) - p.as_vec3();
                let w = view.w.dot(q);
                let at = [view.u.dot(q) / w, view.v.dot(q) / w].map(f64::from);
                // Coordinates are known to 1e-5 cells of a 32nd; a sphere's depth changes steeply at its rim.
                let away = (square.point(at) - samples.point(i)).length();
                assert!(away < 1e-3, "{light:?} {i}: {away}");
                assert!(w < square.front * 1.0001, "{light:?}: {w}");
            }
        }
    }
}
