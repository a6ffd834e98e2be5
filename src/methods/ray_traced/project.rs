//! The images of edges on the light, as sixteen receivers at a time see them.
//!
//! For every candidate edge and receiver: may the edge be a silhouette (its two triangles are not
//! certainly on different hands), may it cross the light, and if so, where in the grid over the light does
//! its image lie, clipped to the light's square (Liang and Barsky 1984, homogeneous)?

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::Vec3;

use super::grid::{Cells, EdgeImage, columns, draw};
use crate::bvh::outline::EdgePlanes;
use crate::receivers::GROUP;
use crate::sampling::{GRID, LightProjection, WHOLE};
use crate::simd::{LANES, Lanes, Row, detect, dot, splat_vector};

/// Rows of lanes in a group of receivers.
const ROWS: usize = GROUP / LANES;

/// Rounding of a dot product of three terms, of its factors, and of the difference that one of them is:
/// fewer than 8 rounding errors (2⁻²⁴) of the product of their sizes.
const DOT_ERROR: f32 = 8.0 / (1 << 24) as f32;

/// How far, in cells, an edge's image is thickened at least: the rounding of a clipped and projected
/// segment is below 0.005 cells (positions 1e-6 of the grid's 32 cells, slopes up to 32 over
/// [`super::grid::FLAT`]), and a sample's cell is known to 1e-5 cells.
const THICKNESS: f32 = 0.01;

/// An edge of which more than this many cells are in doubt is not drawn; the receiver gives up.
const WIDEST: f32 = 4.0;

/// How far, as a fraction of an edge, its clipped ends are moved outwards: more than a quotient's rounding.
const CLIP_SLACK: f32 = 1e-6;

/// Receivers and their views of the light, lane by lane.
#[derive(Debug, Clone, Default)]
pub(super) struct Viewers {
    origin: [[Row; ROWS]; 3],
    u: [[Row; ROWS]; 3],
    v: [[Row; ROWS]; 3],
    w: [[Row; ROWS]; 3],
    steepness: [Row; ROWS],
    /// Rounding of the light points, in the square.
    blur: [Row; ROWS],
    valid: [u16; ROWS],
}

/// What each receiver of a group sees.
#[derive(Debug, Clone)]
pub(super) struct Images {
    /// The cells of the grid over the light that edges touch.
    pub(super) marked: [[Cells; GRID]; GROUP],
    /// The receivers that see an edge, a bit each.
    pub(super) touched: u64,
    /// The receivers that an edge comes too close to.
    pub(super) unclear: u64,
}

impl Default for Images {
    fn default() -> Self {
        Images {
            marked: [[0; GRID]; GROUP],
            touched: 0,
            unclear: 0,
        }
    }
}

impl Viewers {
    /// Takes up to [`GROUP`] receivers; those without a view see nothing.
    pub(super) fn set(&mut self, views: &[Option<LightProjection>], origins: &[Vec3]) {
        self.valid = [0; ROWS];
        for (k, (view, origin)) in views.iter().zip(origins).enumerate() {
            let (row, lane) = (k / LANES, k % LANES);
            self.valid[row] |= u16::from(view.is_some()) << lane;
            let view = view.unwrap_or_default();
            for axis in 0..3 {
                self.origin[axis][row].0[lane] = origin[axis];
                self.u[axis][row].0[lane] = view.u[axis];
                self.v[axis][row].0[lane] = view.v[axis];
                self.w[axis][row].0[lane] = view.w[axis];
            }
            let l1 = |x: Vec3| x.abs().element_sum();
            self.steepness[row].0[lane] = l1(view.u).max(l1(view.v)).max(l1(view.w));
            self.blur[row].0[lane] = DOT_ERROR * view.reach * self.steepness[row].0[lane];
        }
    }

    /// Draws what each receiver sees of `edges`.
    pub(super) fn project(&self, edges: &[EdgePlanes], images: &mut Images) {
        *images = Images::default();
        dispatch!(detect(), simd => project_lanes(simd, edges, self, images));
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, vectors: &[[Row; ROWS]; 3], row: usize) -> [f32x16<S>; 3] {
    [
        vectors[0][row].load(simd),
        vectors[1][row].load(simd),
        vectors[2][row].load(simd),
    ]
}

#[inline(always)]
fn from<S: Simd>(simd: S, p: Vec3, origin: &[f32x16<S>; 3]) -> [f32x16<S>; 3] {
    let [x, y, z] = splat_vector(simd, p);
    [x - origin[0], y - origin[1], z - origin[2]]
}

/// Sum of absolute values.
#[inline(always)]
fn size<S: Simd>(p: &[f32x16<S>; 3]) -> f32x16<S> {
    p[0].abs() + p[1].abs() + p[2].abs()
}

#[inline(always)]
fn project_lanes<S: Simd>(simd: S, edges: &[EdgePlanes], viewers: &Viewers, images: &mut Images) {
    let zero = f32x16::splat(simd, 0.0);
    for row in 0..ROWS {
        if viewers.valid[row] == 0 {
            continue;
        }
        let origin = load(simd, &viewers.origin, row);
        let u = load(simd, &viewers.u, row);
        let v = load(simd, &viewers.v, row);
        let w = load(simd, &viewers.w, row);
        let steepness = viewers.steepness[row].load(simd);
        let blur = viewers.blur[row].load(simd);
        for edge in edges {
            let a = from(simd, edge.ends[0], &origin);
            let b = from(simd, edge.ends[1], &origin);
            let (size_a, size_b) = (size(&a), size(&b));
            // Certainly in front of both triangles, or behind both.
            let doubt = size_a * DOT_ERROR;
            let negative = zero - doubt;
            let one = dot(&a, &splat_vector(simd, edge.normals[0]));
            let two = dot(&a, &splat_vector(simd, edge.normals[1]));
            let goes_on = doubt.lt(one.lesser(two)) | one.greater(two).lt(negative);
            let open = viewers.valid[row] & !goes_on;
            if open == 0 {
                continue;
            }
            // Certainly to one side of the light, or beyond it.
            let doubt = size_a.greater(size_b) * steepness * (4.0 * DOT_ERROR);
            let (ua, va, wa) = (dot(&a, &u), dot(&a, &v), dot(&a, &w));
            let (ub, vb, wb) = (dot(&b, &u), dot(&b, &v), dot(&b, &w));
            let doubt = doubt + blur * wa.greater(wb).greater(zero);
            let negative = zero - doubt;
            let one = f32x16::splat(simd, 1.0);
            let outside = ua.greater(ub).lt(negative)
                | va.greater(vb).lt(negative)
                | (wa - ua).greater(wb - ub).lt(negative)
                | (wa - va).greater(wb - vb).lt(negative)
                | (one + doubt).lt(wa.lesser(wb));
            let seen = open & !outside;
            if seen != 0 {
                let clipped = clip(
                    [ua, va, wa],
                    [ub, vb, wb],
                    size_a.greater(size_b) * steepness,
                    blur,
                    seen,
                );
                clipped.draw(row, seen, images);
            }
        }
    }
}

/// Images of an edge, a lane a receiver.
struct Clipped<S: Simd> {
    ends: [[f32x16<S>; 2]; 2],
    thickness: f32x16<S>,
    /// Lanes in which nothing is left of the edge.
    nothing: u16,
    /// Lanes in which the image can be told to within [`WIDEST`].
    clear: u16,
}

/// Clips an edge, whose ends have these homogeneous coordinates, to the unit square, widened by what they
/// may be off, and projects what is left; only lanes in `seen` count.
///
/// A bound is crossed inwards at `a / (a - b)` where `a < 0 < b`, and outwards likewise from the other end;
/// with `a` and `b` cut off at 0 the same quotient is 0 where it is not crossed. So no lane branches.
#[inline(always)]
fn clip<S: Simd>(
    a: [f32x16<S>; 3],
    b: [f32x16<S>; 3],
    size: f32x16<S>,
    light_blur: f32x16<S>,
    seen: u16,
) -> Clipped<S> {
    let simd = size.simd;
    let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
    let doubt = size * DOT_ERROR + light_blur * a[2].greater(b[2]).greater(zero);
    // A bound may be the difference of two coordinates, each off by the rounding of a dot product and of
    // the light points that the grid stands for.
    let apart = doubt * 4.0;
    // Keeps a quotient of two zeros at 0.
    let tiny = f32x16::splat(simd, f32::MIN_POSITIVE);
    let (mut enter, mut leave) = (zero, zero);
    for bound in 0..4 {
        let (fa, fb) = match bound {
            0 => (a[0], b[0]),
            1 => (a[1], b[1]),
            2 => (a[2] - a[0], b[2] - b[0]),
            _ => (a[2] - a[1], b[2] - b[1]),
        };
        let (fa, fb) = (fa + apart, fb + apart);
        // No receiver sees the edge cross this bound: both quotients would be 0.
        if (fa.lt(zero) | fb.lt(zero)) & seen == 0 {
            continue;
        }
        let (below_a, below_b) = (zero - fa.lesser(zero), zero - fb.lesser(zero));
        enter = enter.greater(below_a / (below_a + fb.greater(tiny)));
        leave = leave.greater(below_b / (below_b + fa.greater(tiny)));
    }
    let slack = f32x16::splat(simd, CLIP_SLACK);
    let start = (enter - slack).greater(zero);
    let end = (one - leave + slack).lesser(one);
    let along = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let cells = f32x16::splat(simd, GRID as f32);
    let ws = a[2] + start * along[2];
    let we = a[2] + end * along[2];
    let scale_s = cells / ws;
    let scale_e = cells / we;
    let ends = [
        [
            (a[0] + start * along[0]) * scale_s,
            (a[1] + start * along[1]) * scale_s,
        ],
        [
            (a[0] + end * along[0]) * scale_e,
            (a[1] + end * along[1]) * scale_e,
        ],
    ];
    let nearest = ws.lesser(we);
    let blur = 4.0 * GRID as f32 * doubt / nearest;
    let thickness = THICKNESS + blur + light_blur * cells;
    let clear = zero.lt(nearest) & thickness.le(WIDEST);
    Clipped {
        ends,
        thickness,
        nothing: end.lt(start),
        clear,
    }
}

impl<S: Simd> Clipped<S> {
    /// Draws the images into the grids of the receivers in `seen`.
    #[inline(always)]
    fn draw(self, row: usize, seen: u16, images: &mut Images) {
        let mut left = seen & !self.nothing;
        images.unclear |= u64::from(left & !self.clear) << (row * LANES);
        left &= self.clear;
        images.touched |= u64::from(left) << (row * LANES);
        let [[x0, y0], [x1, y1]] = self.ends;
        let mut rows = [Row::default(); 5];
        let (mut columns_of, mut rows_of) = ([Row::default(); 2], [Row::default(); 2]);
        for (value, row) in [x0, y0, x1, y1, self.thickness].into_iter().zip(&mut rows) {
            row.set(value);
        }
        cell_range(x0, x1, self.thickness, &mut columns_of);
        cell_range(y0, y1, self.thickness, &mut rows_of);
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let marked = &mut images.marked[row * LANES + lane];
            let (low, high) = (index(&columns_of[0], lane), index(&columns_of[1], lane));
            let (first, last) = (index(&rows_of[0], lane), index(&rows_of[1], lane));
            if first == last || low == high {
                // An image in one row or column: all cells around it, without its slope.
                for cells in &mut marked[first as usize..=last as usize] {
                    *cells |= columns(low, high);
                }
                continue;
            }
            let line = EdgeImage {
                ends: [
                    [rows[0].0[lane], rows[1].0[lane]],
                    [rows[2].0[lane], rows[3].0[lane]],
                ],
                thickness: rows[4].0[lane],
            };
            draw(marked, &line);
        }
    }
}

/// First and last rows or columns within the thickness of both coordinates, to be read by [`index`].
#[inline(always)]
fn cell_range<S: Simd>(a: f32x16<S>, b: f32x16<S>, thickness: f32x16<S>, out: &mut [Row; 2]) {
    out[0].set(cell_place(a.lesser(b) - thickness));
    out[1].set(cell_place(a.greater(b) + thickness));
}

/// A coordinate as [`crate::sampling::grid_index`] rounds it, before its last step.
#[inline(always)]
fn cell_place<S: Simd>(cells: f32x16<S>) -> f32x16<S> {
    let place = (cells - 0.5).greater(0.0);
    place.lesser((GRID - 1) as f32) + WHOLE
}

/// The last step of [`crate::sampling::grid_index`].
fn index(places: &Row, lane: usize) -> u32 {
    places.0[lane].to_bits() & (GRID as u32 - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What one receiver at the origin, which sees the light as the unit square at distance 1 along z, sees of
    /// an edge: the cells, and whether it is unclear.
    fn seen(ends: [[f32; 3]; 2]) -> (Option<[Cells; GRID]>, bool) {
        let mut viewers = Viewers::default();
        let view = LightProjection {
            u: Vec3::X,
            v: Vec3::Y,
            w: Vec3::Z,
            reach: 0.0,
        };
        viewers.set(&[Some(view)], &[Vec3::ZERO]);
        let mut images = Images::default();
        let edge = EdgePlanes {
            ends: ends.map(Vec3::from),
            normals: [Vec3::ZERO; 2],
        };
        viewers.project(&[edge], &mut images);
        let touched = images.touched & 1 == 1;
        (touched.then_some(images.marked[0]), images.unclear & 1 == 1)
    }

    #[test]
    fn an_edge_is_projected_clipped_to_the_light_and_drawn() {
        // Ends in space, and where they are seen, in cells.
        let edges = [
            // At half and at 0.8 of the distance; the image runs from (-0.5, 0.25) to (0.5, 0.75), of which the
            // half with x > 0 is on the light.
            (
                [[-0.25, 0.125, 0.5], [0.4, 0.6, 0.8]],
                [[0.0, 16.0], [16.0, 24.0]],
            ),
            // In one row, in one column and in one cell.
            (
                [[0.1, 0.235, 0.5], [0.4, 0.235, 0.5]],
                [[6.4, 15.04], [25.6, 15.04]],
            ),
            (
                [[0.235, 0.1, 0.5], [0.235, 0.4, 0.5]],
                [[15.04, 6.4], [15.04, 25.6]],
            ),
            (
                [[0.235, 0.1, 0.5], [0.238, 0.105, 0.5]],
                [[15.04, 6.4], [15.232, 6.72]],
            ),
        ];
        for (ends, image) in edges {
            let mut expected = [0; GRID];
            let line = EdgeImage {
                ends: image,
                thickness: THICKNESS,
            };
            draw(&mut expected, &line);
            assert_eq!(seen(ends), (Some(expected), false), "{ends:?}");
        }
    }

    #[test]
    fn an_edge_through_the_receiver_is_unclear_and_one_behind_it_or_beside_the_light_is_not_seen() {
        assert_eq!(seen([[0.0, 0.0, 0.0], [0.3, 0.3, 0.5]]), (None, true));
        assert_eq!(seen([[0.0, 0.1, -0.5], [0.3, 0.3, -0.2]]), (None, false));
        assert_eq!(seen([[1.1, -0.5, 1.0], [1.5, 1.5, 1.0]]), (None, false));
        assert_eq!(seen([[0.1, 0.5, 1.1], [0.9, 0.5, 1.2]]), (None, false));
    }
}
