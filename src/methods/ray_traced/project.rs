//! The images of edges on the light, as sixteen receivers at a time see them.
//!
//! For every candidate edge and receiver: may the edge be a silhouette (its two triangles are not
//! certainly on different hands), may it cross the light, and if so, where in the grid over the light does
//! its image lie, clipped to the light's square (Liang and Barsky 1984, homogeneous)?

use glam::Vec3;

use super::grid::{Cells, Line, columns, draw};
use crate::bvh::outline::EdgePlanes;
use crate::receivers::GROUP;
use crate::sampling::{GRID, View, WHOLE};
use crate::simd::{LANES, Lanes, Row, detect, dispatch};

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
    pub(super) fn set(&mut self, views: &[Option<View>], origins: &[Vec3]) {
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
        let viewers = self;
        dispatch!(detect() => project_lanes(
            edges: &[EdgePlanes], viewers: &Viewers, images: &mut Images));
    }
}

#[inline(always)]
unsafe fn load<S: Lanes>(vectors: &[[Row; ROWS]; 3], row: usize) -> [S; 3] {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        [
            S::load(&vectors[0][row]),
            S::load(&vectors[1][row]),
            S::load(&vectors[2][row]),
        ]
    }
}

#[inline(always)]
unsafe fn splat<S: Lanes>(p: Vec3) -> [S; 3] {
    // SAFETY: the caller enabled the features of `S`.
    unsafe { [S::splat(p.x), S::splat(p.y), S::splat(p.z)] }
}

#[inline(always)]
unsafe fn from<S: Lanes>(p: Vec3, origin: &[S; 3]) -> [S; 3] {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let [x, y, z] = splat::<S>(p);
        [x.sub(origin[0]), y.sub(origin[1]), z.sub(origin[2])]
    }
}

#[inline(always)]
unsafe fn dot<S: Lanes>(a: &[S; 3], b: &[S; 3]) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe { a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2])) }
}

/// Sum of absolute values.
#[inline(always)]
unsafe fn size<S: Lanes>(p: &[S; 3]) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe { p[0].abs().add(p[1].abs()).add(p[2].abs()) }
}

#[inline(always)]
unsafe fn project_lanes<S: Lanes>(edges: &[EdgePlanes], viewers: &Viewers, images: &mut Images) {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let zero = S::splat(0.0);
        for row in 0..ROWS {
            if viewers.valid[row] == 0 {
                continue;
            }
            let origin = load::<S>(&viewers.origin, row);
            let u = load::<S>(&viewers.u, row);
            let v = load::<S>(&viewers.v, row);
            let w = load::<S>(&viewers.w, row);
            let steepness = S::load(&viewers.steepness[row]);
            let blur = S::load(&viewers.blur[row]);
            for edge in edges {
                let a = from(edge.ends[0], &origin);
                let b = from(edge.ends[1], &origin);
                let (size_a, size_b) = (size(&a), size(&b));
                // Certainly in front of both triangles, or behind both.
                let doubt = size_a.mul(S::splat(DOT_ERROR));
                let negative = zero.sub(doubt);
                let one = dot(&a, &splat(edge.normals[0]));
                let two = dot(&a, &splat(edge.normals[1]));
                let goes_on = doubt.lt(one.min(two)) | one.max(two).lt(negative);
                let open = viewers.valid[row] & !goes_on;
                if open == 0 {
                    continue;
                }
                // Certainly to one side of the light, or beyond it.
                let doubt = size_a
                    .max(size_b)
                    .mul(steepness)
                    .mul(S::splat(4.0 * DOT_ERROR));
                let (ua, va, wa) = (dot(&a, &u), dot(&a, &v), dot(&a, &w));
                let (ub, vb, wb) = (dot(&b, &u), dot(&b, &v), dot(&b, &w));
                let doubt = doubt.add(blur.mul(wa.max(wb).max(zero)));
                let negative = zero.sub(doubt);
                let one = S::splat(1.0);
                let outside = ua.max(ub).lt(negative)
                    | va.max(vb).lt(negative)
                    | wa.sub(ua).max(wb.sub(ub)).lt(negative)
                    | wa.sub(va).max(wb.sub(vb)).lt(negative)
                    | one.add(doubt).lt(wa.min(wb));
                let seen = open & !outside;
                if seen != 0 {
                    let clipped = clip(
                        [ua, va, wa],
                        [ub, vb, wb],
                        size_a.max(size_b).mul(steepness),
                        blur,
                        seen,
                    );
                    clipped.draw(row, seen, images);
                }
            }
        }
    }
}

/// Images of an edge, a lane a receiver.
struct Clipped<S> {
    ends: [[S; 2]; 2],
    thickness: S,
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
unsafe fn clip<S: Lanes>(a: [S; 3], b: [S; 3], size: S, light_blur: S, seen: u16) -> Clipped<S> {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let doubt = size
            .mul(S::splat(DOT_ERROR))
            .add(light_blur.mul(a[2].max(b[2]).max(zero)));
        // A bound may be the difference of two coordinates, each off by the rounding of a dot product and of
        // the light points that the grid stands for.
        let apart = doubt.mul(S::splat(4.0));
        // Keeps a quotient of two zeros at 0.
        let tiny = S::splat(f32::MIN_POSITIVE);
        let (mut enter, mut leave) = (zero, zero);
        for bound in 0..4 {
            let (fa, fb) = match bound {
                0 => (a[0], b[0]),
                1 => (a[1], b[1]),
                2 => (a[2].sub(a[0]), b[2].sub(b[0])),
                _ => (a[2].sub(a[1]), b[2].sub(b[1])),
            };
            let (fa, fb) = (fa.add(apart), fb.add(apart));
            // No receiver sees the edge cross this bound: both quotients would be 0.
            if (fa.lt(zero) | fb.lt(zero)) & seen == 0 {
                continue;
            }
            let (below_a, below_b) = (zero.sub(fa.min(zero)), zero.sub(fb.min(zero)));
            enter = enter.max(below_a.div(below_a.add(fb.max(tiny))));
            leave = leave.max(below_b.div(below_b.add(fa.max(tiny))));
        }
        let slack = S::splat(CLIP_SLACK);
        let start = enter.sub(slack).max(zero);
        let end = one.sub(leave).add(slack).min(one);
        let along = [b[0].sub(a[0]), b[1].sub(a[1]), b[2].sub(a[2])];
        let cells = S::splat(GRID as f32);
        let ws = a[2].add(start.mul(along[2]));
        let we = a[2].add(end.mul(along[2]));
        let scale_s = cells.div(ws);
        let scale_e = cells.div(we);
        let ends = [
            [
                a[0].add(start.mul(along[0])).mul(scale_s),
                a[1].add(start.mul(along[1])).mul(scale_s),
            ],
            [
                a[0].add(end.mul(along[0])).mul(scale_e),
                a[1].add(end.mul(along[1])).mul(scale_e),
            ],
        ];
        let nearest = ws.min(we);
        let blur = S::splat(4.0 * GRID as f32).mul(doubt).div(nearest);
        let thickness = S::splat(THICKNESS).add(blur).add(light_blur.mul(cells));
        let clear = zero.lt(nearest) & thickness.le(S::splat(WIDEST));
        Clipped {
            ends,
            thickness,
            nothing: end.lt(start),
            clear,
        }
    }
}

impl<S: Lanes> Clipped<S> {
    /// Draws the images into the grids of the receivers in `seen`.
    #[inline(always)]
    unsafe fn draw(self, row: usize, seen: u16, images: &mut Images) {
        let mut left = seen & !self.nothing;
        images.unclear |= u64::from(left & !self.clear) << (row * LANES);
        left &= self.clear;
        images.touched |= u64::from(left) << (row * LANES);
        let [[x0, y0], [x1, y1]] = self.ends;
        let mut rows = [Row::default(); 5];
        let (mut columns_of, mut rows_of) = ([Row::default(); 2], [Row::default(); 2]);
        // SAFETY: the caller enabled the features of `S`.
        unsafe {
            for (value, row) in [x0, y0, x1, y1, self.thickness].into_iter().zip(&mut rows) {
                value.store(row);
            }
            cell_range(x0, x1, self.thickness, &mut columns_of);
            cell_range(y0, y1, self.thickness, &mut rows_of);
        }
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
            let line = Line {
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
unsafe fn cell_range<S: Lanes>(a: S, b: S, thickness: S, out: &mut [Row; 2]) {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        cell_place(a.min(b).sub(thickness)).store(&mut out[0]);
        cell_place(a.max(b).add(thickness)).store(&mut out[1]);
    }
}

/// A coordinate as [`crate::sampling::grid_index`] rounds it, before its last step.
#[inline(always)]
unsafe fn cell_place<S: Lanes>(cells: S) -> S {
    // SAFETY: the caller enabled the features of `S`.
    unsafe {
        let place = cells.sub(S::splat(0.5)).max(S::splat(0.0));
        place.min(S::splat((GRID - 1) as f32)).add(S::splat(WHOLE))
    }
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
        let view = View {
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
            let line = Line {
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
