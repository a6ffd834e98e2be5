//! The light points of one receiver.

use glam::Vec3;

use super::cells::cell;
use crate::simd::{LANES, Row};

/// Light points for one receiver, with the weights that its integrals need.
#[derive(Debug, Default)]
pub struct LightSamples {
    /// Number of samples; the rows behind are padded with invalid ones.
    pub count: usize,
    /// Local light points.
    pub points: [Vec<Row>; 3],
    /// Irradiance from each sample at radiance 1; 0 where it is not valid.
    pub weights: Vec<Row>,
    /// A bit for each sample: above the tangent plane and emitting towards the receiver.
    pub valid: Vec<u16>,
    /// Coordinates of each sample in [`LightProjection`](super::LightProjection)'s square, which here is [-1, 1]².
    pub(super) coordinates: [Vec<Row>; 2],
    /// Grid cell of each sample, row-major; filled by [`LightSamples::find_cells`].
    pub cells: Vec<[u16; LANES]>,
}

impl LightSamples {
    /// One light point.
    pub fn point(&self, i: usize) -> Vec3 {
        let (row, lane) = (i / LANES, i % LANES);
        Vec3::new(
            self.points[0][row].0[lane],
            self.points[1][row].0[lane],
            self.points[2][row].0[lane],
        )
    }

    pub(super) fn resize(&mut self, count: usize) {
        let rows = count.div_ceil(LANES);
        self.count = count;
        for axis in &mut self.points {
            axis.resize(rows, Row::default());
        }
        for axis in &mut self.coordinates {
            axis.resize(rows, Row::default());
        }
        self.weights.resize(rows, Row::default());
        self.valid.resize(rows, 0);
        self.cells.resize(rows, [0; LANES]);
    }

    /// Finds the grid cell of every sample; meaningful only where the receiver has a [`LightProjection`](super::LightProjection).
    pub fn find_cells(&mut self) {
        for (r, cells) in self.cells.iter_mut().enumerate() {
            for (lane, out) in cells.iter_mut().enumerate() {
                *out = cell(
                    self.coordinates[0][r].0[lane],
                    self.coordinates[1][r].0[lane],
                );
            }
        }
    }
}
