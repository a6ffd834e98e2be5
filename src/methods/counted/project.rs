//! The images of edges on the light as one receiver sees them, sixteen edges at a time.
//!
//! An edge matters if it is a silhouette (its triangles are not both in front of the receiver or both behind), and if
//! its image reaches over the square in which the receiver sees the light. On which side of a triangle the receiver
//! is is decided in `f32` with a bound on rounding, and exactly where that leaves a doubt, so that all three edges of
//! a triangle are told the same.

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::Vec3;

use super::edges::Block;
use super::grid::Grid;
use crate::bvh::TriangleBvh;
use crate::sampling::LightProjection;
use crate::sampling::tracing::bits;
use crate::simd::{Lanes, Row, detect, dot, load_vector, splat_vector};

/// Rounding of a dot product of three terms, of its factors, and of the difference that one of them is:
/// fewer than 8 rounding errors (2⁻²⁴) of the product of their sizes.
const DOT_ERROR: f32 = 8.0 / (1 << 24) as f32;

/// Ends that are seen farther away than so many columns or rows are cut off: their images are known to
/// this times 2⁻²⁴, a part of a column that no light point will notice.
const FAR: f32 = 4096.0;

/// How many squares beyond the square an edge is cut off.
const BEYOND: f64 = 2.0;

/// How one receiver sees the light: rows of its [`LightProjection`], in columns and rows of a grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    pub(super) origin: Vec3,
    u: Vec3,
    v: Vec3,
    w: Vec3,
    /// `w·q` from which on something lies behind the light.
    front: f32,
    /// 1 if triangles that run counter-clockwise, seen from the receiver, do so in the grid, else -1.
    hand: i16,
}

impl View {
    pub(super) fn new(origin: Vec3, view: &LightProjection, front: f32, grid: &Grid) -> Self {
        let layout = grid.layout();
        let (columns, height) = (layout.columns as f64, layout.height() as f64);
        let [u, v, w] = [view.u, view.v, view.w].map(Vec3::as_dvec3);
        let rows = v * height + u * layout.fall as f64 - w * f64::from(grid.offset());
        View {
            origin,
            u: (u * columns).as_vec3(),
            v: rows.as_vec3(),
            w: view.w,
            front,
            // Seen from its front a triangle has a negative determinant.
            hand: if u.cross(v).dot(w) < 0.0 { 1 } else { -1 },
        }
    }
}

/// Draws what the receiver sees of the edges; false where an edge comes too close to it to tell.
pub(super) fn draw_edges(
    blocks: &[Block],
    bvh: &TriangleBvh,
    view: &View,
    grid: &mut Grid,
) -> bool {
    dispatch!(detect(), simd => draw_lanes(simd, blocks, bvh, view, grid))
}

#[inline(always)]
fn minus<S: Simd>(a: &[f32x16<S>; 3], b: &[f32x16<S>; 3]) -> [f32x16<S>; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Lanes whose triangle is certainly seen from its front, and from its back.
#[inline(always)]
fn sides<S: Simd>(to_end: &[f32x16<S>; 3], normal: &[f32x16<S>; 3], doubt: f32x16<S>) -> [u16; 2] {
    let along = dot(to_end, normal);
    [along.lt(doubt * -1.0), doubt.lt(along)]
}

/// The last row at or below a height, within a row of those between the first and the last that matter.
#[inline(always)]
fn row_of<S: Simd>(y: f32x16<S>, [first, last]: [f32; 2]) -> f32x16<S> {
    y.floor().greater(first - 1.0).lesser(last)
}

#[inline(always)]
fn draw_lanes<S: Simd>(
    simd: S,
    blocks: &[Block],
    bvh: &TriangleBvh,
    view: &View,
    grid: &mut Grid,
) -> bool {
    let zero = f32x16::splat(simd, 0.0);
    let range = grid.range();
    if range.is_empty() {
        return true;
    }
    let ends = [range.start as f32, (range.end - 1) as f32];
    let (reach, corner) = grid.border_reach();
    let (columns, rows) = (grid.layout().columns as f32, grid.layout().rows as f32);
    let origin = splat_vector(simd, view.origin);
    let (u, v, w) = (
        splat_vector(simd, view.u),
        splat_vector(simd, view.v),
        splat_vector(simd, view.w),
    );
    for block in blocks {
        let a = minus(&load_vector(simd, &block.ends[0]), &origin);
        let doubt = (a[0].abs() + a[1].abs() + a[2].abs()) * DOT_ERROR;
        let mut one = sides(&a, &load_vector(simd, &block.normals[0]), doubt);
        let mut two = sides(&a, &load_vector(simd, &block.normals[1]), doubt);
        let open = block.used & !(one[0] & two[0] | one[1] & two[1]);
        if open == 0 {
            continue;
        }
        let b = minus(&load_vector(simd, &block.ends[1]), &origin);
        let (ua, va, wa) = (dot(&a, &u), dot(&a, &v), dot(&a, &w));
        let (ub, vb, wb) = (dot(&b, &u), dot(&b, &v), dot(&b, &w));
        // Wholly beside all rows, behind the receiver or behind the light.
        let outside = ua.lt(zero) & ub.lt(zero)
            | va.lt(zero) & vb.lt(zero)
            | (wa * columns).lt(ua) & (wb * columns).lt(ub)
            | (wa * rows).lt(va) & (wb * rows).lt(vb)
            | wa.le(zero) & wb.le(zero)
            | wa.ge(view.front) & wb.ge(view.front);
        let seen = open & !outside;
        if seen == 0 {
            continue;
        }
        let doubtful = block.has[0] & !(one[0] | one[1]) | block.has[1] & !(two[0] | two[1]);
        for lane in bits(seen & doubtful) {
            for (side, of) in [&mut one, &mut two].into_iter().enumerate() {
                let exact = block.faces[lane][side].side(bvh, view.origin);
                of[0] = of[0] & !(1 << lane) | u16::from(exact > 0) << lane;
                of[1] = of[1] & !(1 << lane) | u16::from(exact < 0) << lane;
            }
        }
        let (xa, ya, xb, yb) = (ua / wa, va / wa, ub / wb, vb / wb);
        let near = xa.abs().le(FAR) & ya.abs().le(FAR) & xb.abs().le(FAR) & yb.abs().le(FAR);
        let whole = near & zero.lt(wa) & zero.lt(wb) & wa.lt(view.front) & wb.lt(view.front);
        let (row_a, row_b) = (row_of(ya, ends), row_of(yb, ends));
        // Between two rows it matters only if it crosses the border there.
        let leftmost = xa.lesser(xb);
        let by_border = leftmost.lt(reach[0]) | row_a.ge(corner) & leftmost.lt(reach[1]);
        let crosses = row_a.lt(row_b) | row_b.lt(row_a) | by_border;
        let change = |lane: usize| {
            let side = |of: &[u16; 2]| (of[0] >> lane & 1) as i16 - (of[1] >> lane & 1) as i16;
            view.hand * (side(&one) - side(&two))
        };
        let drawn = seen & whole & crosses;
        let cut = seen & !whole;
        if drawn | cut == 0 {
            continue;
        }
        let mut images = [Row::default(); 4];
        for (row, value) in images.iter_mut().zip([xa, ya, xb, yb]) {
            row.set(value);
        }
        let image = |lane: usize| {
            let [xa, ya, xb, yb] = [0, 1, 2, 3].map(|k| images[k].0[lane]);
            [[xa, ya], [xb, yb]]
        };
        for lane in bits(drawn) {
            let change = change(lane);
            if change != 0 {
                let [a, b] = image(lane);
                grid.draw(a, b, change);
            }
        }
        if cut != 0 {
            let mut ends = [Row::default(); 6];
            for (row, value) in ends.iter_mut().zip([ua, va, wa, ub, vb, wb]) {
                row.set(value);
            }
            for lane in bits(cut) {
                let change = change(lane);
                if change == 0 {
                    continue;
                }
                let end = |k: usize| [0, 1, 2].map(|i| f64::from(ends[k + i].0[lane]));
                match cut_off(
                    [end(0), end(3)],
                    image(lane),
                    f64::from(view.front),
                    [columns, rows],
                ) {
                    Cut::Nothing => {}
                    Cut::Part([a, b]) => grid.draw(a, b, change),
                    Cut::Unclear => return false,
                }
            }
        }
    }
    true
}

/// What is left of an edge that is seen from very near, from its end, or passes the light.
#[derive(Debug, PartialEq)]
enum Cut {
    Nothing,
    /// The image of the part that matters.
    Part([[f32; 2]; 2]),
    /// It ends over the light where it should not.
    Unclear,
}

/// Cuts an edge off some way beyond the square and at the light's far side (Liang and Barsky 1984, homogeneous):
/// `ends` are its ends in homogeneous coordinates, `images` what they look like where that can be told.
fn cut_off(ends: [[f64; 3]; 2], images: [[f32; 2]; 2], front: f64, size: [f32; 2]) -> Cut {
    let [columns, rows] = size.map(f64::from);
    let inside = |[u, v, w]: [f64; 3]| {
        [
            u + BEYOND * columns * w,
            v + BEYOND * rows * w,
            (1.0 + BEYOND) * columns * w - u,
            (1.0 + BEYOND) * rows * w - v,
            front - w,
        ]
    };
    let [a, b] = ends.map(inside);
    let (mut enter, mut leave) = (0f64, 1f64);
    for (a, b) in a.into_iter().zip(b) {
        if a < 0.0 && b < 0.0 {
            return Cut::Nothing;
        } else if a < 0.0 {
            enter = enter.max(a / (a - b));
        } else if b < 0.0 {
            leave = leave.min(a / (a - b));
        }
    }
    if enter >= leave {
        return Cut::Nothing;
    }
    let mut out = images;
    for (k, (t, uncut)) in [(enter, 0.0), (leave, 1.0)].into_iter().enumerate() {
        if t != uncut {
            let [u, v, w] = [0, 1, 2].map(|i| ends[0][i] + t * (ends[1][i] - ends[0][i]));
            out[k] = [(u / w) as f32, (v / w) as f32];
            // A cut end is far away, but where the edge passes through the receiver or the light's far side.
            let [x, y] = [u / w / columns, v / w / rows];
            let away = |t: f64| !(-0.01..=1.01).contains(&t);
            if !(w > 0.0 && (away(x) || away(y))) {
                return Cut::Unclear;
            }
        }
        if !(out[k][0].is_finite() && out[k][1].is_finite()) {
            return Cut::Unclear;
        }
    }
    Cut::Part(out)
}
