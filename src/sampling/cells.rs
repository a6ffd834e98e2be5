//! The grid of cells over a light's outline, as a receiver sees it.

use glam::Vec3;

/// Side of the grid of cells over a light's outline.
pub const GRID: usize = 32;

/// How a receiver sees a light: the light's outline is the unit square or its inscribed disk in
/// `(u·q / w·q, v·q / w·q)` for directions `q` from the receiver, and `w·q` is 1 at the far end of
/// what can lie between the two.
#[derive(Debug, Clone, Copy, Default)]
pub struct LightProjection {
    /// Row of the first coordinate.
    pub u: Vec3,
    /// Row of the second coordinate.
    pub v: Vec3,
    /// Row of the homogeneous coordinate.
    pub w: Vec3,
    /// Largest number that goes into a coordinate of a light point.
    pub reach: f32,
}

/// Grid cell of a point in [-1, 1]², row-major.
#[inline(always)]
pub(super) fn cell(x: f32, y: f32) -> u16 {
    const HALF: f32 = 0.5 * GRID as f32;
    let index = |t: f32| grid_index(t * HALF + HALF) as u16;
    index(y) * GRID as u16 + index(x)
}

/// Place of a grid cell on the Morton curve over the grid.
pub fn cell_place(cell: u16) -> u32 {
    let (row, column) = (u32::from(cell) / GRID as u32, u32::from(cell) % GRID as u32);
    morton(column) | morton(row) << 1
}

/// The least `f32` from which on there is nothing between whole numbers.
pub const WHOLE: f32 = (1 << 23) as f32;

/// Row or column of a coordinate in cells, the nearest one outside of the grid; of a coordinate on a
/// border, either neighbour.
///
/// Adding [`WHOLE`] leaves the nearest whole number in the low bits: unlike a cast, an operation that the
/// compiler's vectoriser has for all lanes, and one without branches.
#[inline(always)]
pub fn grid_index(cells: f32) -> u32 {
    let place = (cells - 0.5).max(0.0).min((GRID - 1) as f32);
    (place + WHOLE).to_bits() & (GRID as u32 - 1)
}

/// Spreads 16 bits to the even positions of a word.
pub(super) fn morton(bits: u32) -> u32 {
    let mut x = bits & 0xffff;
    x = (x | (x << 8)) & 0x00ff_00ff;
    x = (x | (x << 4)) & 0x0f0f_0f0f;
    x = (x | (x << 2)) & 0x3333_3333;
    (x | (x << 1)) & 0x5555_5555
}
