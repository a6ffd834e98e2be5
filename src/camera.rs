//! The pinhole camera, and any other pinhole view: a shadow map is one.
//!
//! Camera space has x right, y down, z forward; pixel `(x, y)` has its centre at `(x + ½, y + ½)` and
//! row 0 is on top. Depth is camera-space z.

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};
use crate::frame::Frame;

/// Largest width or height: pixel coordinates and their products stay exact.
pub const MAX_SIZE: u32 = 1 << 16;

/// A pinhole camera, in world or local coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Position.
    pub eye: DVec3,
    /// World to camera directions: its rows are right, down and forward.
    pub rotation: DMat3,
    /// Pixel coordinates of a camera-space point are those of `intrinsics * p`, over its z.
    pub intrinsics: DMat3,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Camera {
    /// Checks and stores a camera; `camera_to_world` has right, down, forward as its columns.
    ///
    /// # Errors
    /// Numbers that are not finite, a pose that is not rigid, a focal length that is not positive, a
    /// matrix that is not upper triangular with a last 1, or a size outside 1 to [`MAX_SIZE`].
    pub fn new(
        intrinsics: DMat3,
        camera_to_world: DMat3,
        eye: DVec3,
        width: i64,
        height: i64,
    ) -> Result<Self> {
        let bad = |reason: String| Err(Error::parameter("Camera", reason));
        for (name, size) in [("width", width), ("height", height)] {
            if !(1..=i64::from(MAX_SIZE)).contains(&size) {
                return bad(format!("{name} must be 1 to {MAX_SIZE}, got {size}"));
            }
        }
        if !(intrinsics.is_finite() && camera_to_world.is_finite() && eye.is_finite()) {
            return bad("expected finite numbers in its matrices".into());
        }
        let k = intrinsics.transpose();
        let zeros = [k.y_axis.x, k.z_axis.x, k.z_axis.y];
        if zeros != [0.0; 3] || k.z_axis.z != 1.0 || k.x_axis.x <= 0.0 || k.y_axis.y <= 0.0 {
            return bad("K must be [[fx, s, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0".into());
        }
        // A pose read from a file of single-precision numbers is rigid to about 1e-6.
        let gram = camera_to_world.transpose() * camera_to_world - DMat3::IDENTITY;
        let off = gram
            .to_cols_array()
            .into_iter()
            .fold(0.0f64, |m, x| m.max(x.abs()));
        if off > 1e-5 {
            return bad(format!(
                "the pose must be a rotation, to 1e-5; it is off by {off:.1e}"
            ));
        }
        if camera_to_world.determinant() < 0.0 {
            return bad(
                "the pose must be a rotation; it is mirrored: right x down must be forward, got \
                 backward"
                    .into(),
            );
        }
        let rotation = camera_to_world.transpose();
        let (width, height) = (width as u32, height as u32);
        Ok(Camera {
            eye,
            rotation,
            intrinsics,
            width,
            height,
        })
    }

    /// The same camera in a scene's local coordinates.
    pub fn to_local(&self, frame: &Frame) -> Camera {
        Camera {
            eye: frame.to_local(self.eye),
            ..*self
        }
    }

    /// Homogeneous pixel coordinates: `(x z, y z, z)`.
    #[inline(always)]
    pub fn project(&self, p: DVec3) -> DVec3 {
        self.intrinsics * (self.rotation * (p - self.eye))
    }

    /// Direction through a point of the image with camera-space depth 1, not normalised.
    #[inline(always)]
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        let k = &self.intrinsics;
        let dy = (y - k.z_axis.y) / k.y_axis.y;
        let dx = (x - k.z_axis.x - k.y_axis.x * dy) / k.x_axis.x;
        self.rotation.transpose() * DVec3::new(dx, dy, 1.0)
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let k = DMat3::from_cols_array(&[500.0, 0.0, 0.0, 3.0, 480.0, 0.0, 320.0, 250.0, 1.0]);
        let pose = DMat3::from_rotation_x(2.0) * DMat3::from_rotation_z(0.3);
        Camera::new(k, pose, DVec3::new(1.0, 2.0, 3.0), 640, 480).unwrap()
    }

    #[test]
    fn projecting_a_point_on_a_pixels_ray_gives_the_pixel() {
        let camera = camera();
        for (x, y) in [(0.5, 0.5), (320.0, 250.0), (639.5, 17.25)] {
            let h = camera.project(camera.eye + 7.0 * camera.direction(x, y));
            assert!((h.x / h.z - x).abs() < 1e-9 && (h.y / h.z - y).abs() < 1e-9);
            assert!((h.z - 7.0).abs() < 1e-12);
        }
    }

    #[test]
    fn bad_cameras_are_errors() {
        let good = camera();
        let pose = good.rotation.transpose();
        let k = good.intrinsics;
        assert!(Camera::new(k, pose, good.eye, 0, 480).is_err());
        assert!(Camera::new(k, pose * 2.0, good.eye, 640, 480).is_err());
        assert!(Camera::new(k, pose, DVec3::NAN, 640, 480).is_err());
        assert!(Camera::new(-k, pose, good.eye, 640, 480).is_err());
        assert!(Camera::new(k.transpose(), pose, good.eye, 640, 480).is_err());
    }
}
