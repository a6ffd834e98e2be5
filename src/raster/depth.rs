//! Inverse depth of triangles in the image, where it is linear.

use glam::DVec3;

/// Inverse depth of a triangle in the image.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Depth {
    /// The inverse depth at `(x, y)` is `plane · (x, y, 1)`.
    plane: DVec3,
    /// Least and largest of the corners.
    range: [f64; 2],
}

impl Depth {
    /// The depth plane of a triangle that is all in front of the near plane.
    #[inline(always)]
    pub(super) fn new(corners: &[DVec3; 3]) -> Self {
        let [a, b, c] = corners;
        Depth::on(plane(corners), [1.0 / a.z, 1.0 / b.z, 1.0 / c.z])
    }

    /// On a plane, with these inverse depths of the corners.
    #[inline(always)]
    pub(super) fn on(plane: DVec3, [a, b, c]: [f64; 3]) -> Self {
        let range = [a.min(b).min(c), a.max(b).max(c)];
        Depth { plane, range }
    }

    /// Change from column to column and from row to row.
    #[inline(always)]
    pub(super) fn slope(&self) -> [f64; 2] {
        [self.plane.x, self.plane.y]
    }

    /// Least and largest of the corners.
    #[inline(always)]
    pub(super) fn range(&self) -> [f64; 2] {
        self.range
    }

    /// The inverse depth at a point of the image; kept within the triangle's own range, which only matters for slivers.
    #[inline(always)]
    pub(super) fn at(&self, x: f64, y: f64) -> f64 {
        let row = self.plane.y * y + self.plane.z;
        (row + self.plane.x * x).clamp(self.range[0], self.range[1])
    }
}

/// The triangle's plane n·(x z, y z, z) = d gives 1/z = n·(x, y, 1) / d.
#[inline(always)]
pub(super) fn plane(corners: &[DVec3; 3]) -> DVec3 {
    let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let depth = n / n.dot(corners[0]);
    if depth.is_finite() {
        depth
    } else {
        DVec3::new(0.0, 0.0, 1.0 / corners[0].z)
    }
}
