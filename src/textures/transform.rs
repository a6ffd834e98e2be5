//! The projective transform of a pyramid from a light point through a parallelogram to the unit box.
//!
//! Herf and Heckbert 1996, "Math: Computing the Transform"; the handout leaves the matrix out. With the light
//! point `a`, the parallelogram `b + x e_x + y e_y`, `q = b - a` and `n = e_x × e_y`, a point `p` lies in the
//! plane parallel to the parallelogram's at the part
//!
//! ```text
//! w = n·(p - a) / n·q
//! ```
//!
//! of the way from `a` to it: 0 at the light point, 1 in the receiver's plane. The line from `a` through `p`
//! meets that plane at `a + (p - a) / w = b + x e_x + y e_y`. With the dual vectors
//! `d_x = (e_y × n) / ((e_y × n)·e_x)` and `d_y` likewise, for which `d_x·e_x = 1` and `d_x·e_y = 0`, scalar
//! products of that equation give
//!
//! ```text
//! x = d_x·((p - a) - w q) / w,    y = d_y·((p - a) - w q) / w,    z = 1 / w.
//! ```
//!
//! All of these are linear in `p - a` over `w`, so in homogeneous coordinates one 4×4 matrix:
//!
//! ```text
//! ⎛ x w ⎞   ⎛ d_x - (d_x·q) n / n·q   | -row·a ⎞
//! ⎜ y w ⎟ = ⎜ d_y - (d_y·q) n / n·q   | -row·a ⎟ ⎛ p ⎞
//! ⎜ z w ⎟   ⎜           0             |   1    ⎟ ⎝ 1 ⎠
//! ⎝  w  ⎠   ⎝       n / n·q           | -row·a ⎠
//! ```
//!
//! `z = 1` is the receiver's plane and `z = ∞` the plane parallel to it through `a`; what casts lies between,
//! in `[0, 1]² × [1, ∞]`. Flattening in `z` drops the third row. What is left is a pinhole view: `w` is the
//! depth, and [`camera`] gives it to the rasteriser with pixels for `x` and `y`.
//!
//! It fails where `n·q` is 0: a light point in the receiver's plane, which lights nothing there.

use glam::{DMat3, DMat4, DVec3};

use super::patches::Parallelogram;
use crate::camera::Camera;

/// The three rows that act on `p - a`: `x w`, `y w` and `w`. `None` where the light point is in the plane,
/// or the parallelogram has no area.
fn rows(light: DVec3, receiver: &Parallelogram) -> Option<[DVec3; 3]> {
    let q = receiver.corner - light;
    let n = receiver.cross();
    let depth = n / n.dot(q);
    let [dx, dy] = receiver.dual().map(|d| d - depth * d.dot(q));
    let rows = [dx, dy, depth];
    rows.iter().all(|r| r.is_finite()).then_some(rows)
}

/// The matrix to the unit box, if there is one.
pub fn matrix(light: DVec3, receiver: &Parallelogram) -> Option<DMat4> {
    let [x, y, w] = rows(light, receiver)?.map(|r| r.extend(-r.dot(light)));
    let z = glam::DVec4::W;
    Some(DMat4::from_cols(x, y, z, w).transpose())
}

/// The flattened transform as a view of `width` by `height` pixels, of which `x` and `y` run from 0 to 1 over
/// the image.
pub fn camera(light: DVec3, receiver: &Parallelogram, [width, height]: [u32; 2]) -> Option<Camera> {
    let [x, y, w] = rows(light, receiver)?;
    let (x, y) = (x * f64::from(width), y * f64::from(height));
    Some(Camera {
        eye: light,
        rotation: DMat3::IDENTITY,
        intrinsics: DMat3::from_cols(x, y, w).transpose(),
        width,
        height,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn receiver() -> Parallelogram {
        Parallelogram {
            corner: DVec3::new(-0.2, 0.1, 0.3),
            edges: [DVec3::new(0.5, 0.1, -0.2), DVec3::new(0.2, 0.7, 0.1)],
        }
    }

    #[test]
    fn points_of_the_pyramid_go_to_the_unit_box() {
        let (light, r) = (DVec3::new(0.3, -0.2, 1.9), receiver());
        let m = matrix(light, &r).unwrap();
        let view = camera(light, &r, [64, 32]).unwrap();
        for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.3, 0.8), (1.0, 1.0)] {
            for w in [1.0, 0.5, 0.01] {
                let p = light + (r.at(x, y) - light) * w;
                let h = m * p.extend(1.0);
                let found = h.truncate() / h.w;
                let expected = DVec3::new(x, y, 1.0 / w);
                // A few roundings of numbers near 1, over w.
                let tolerance = 1e-14 / w;
                assert!(
                    (found - expected).abs().max_element() < tolerance / w,
                    "{found} {expected}"
                );
                let pixel = view.project(p);
                assert!((pixel.x / pixel.z - 64.0 * x).abs() < 64.0 * tolerance);
                assert!((pixel.y / pixel.z - 32.0 * y).abs() < 64.0 * tolerance);
                assert!((pixel.z - w).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn a_light_point_in_the_plane_or_a_flat_parallelogram_has_no_transform() {
        let r = Parallelogram {
            corner: DVec3::ZERO,
            edges: [DVec3::X, DVec3::Y],
        };
        assert!(matrix(DVec3::new(3.0, 2.0, 0.0), &r).is_none());
        let flat = Parallelogram {
            edges: [DVec3::X, DVec3::X],
            ..r
        };
        assert!(camera(DVec3::Z, &flat, [4, 4]).is_none());
    }
}
