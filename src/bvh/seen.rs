//! The nearest triangle of every pixel, by the hierarchies: tile by tile, from the front to the back.
//!
//! After Greene, Kass and Miller, *Hierarchical Z-Buffer Visibility*, 1993, with a bounding volume hierarchy in place of
//! their octree. A box is left out where no pixel's centre lies behind it, or where all that do show something nearer
//! already; what the leaves hold is drawn by the rasteriser's rules. Of a dense mesh, most is never looked at.
//!
//! A box bounds the places of its triangles in the image, and their depths, with all that rounding can be wrong by, so
//! that the picture is that of [`crate::raster::rasterize`] to the last bit: no answer depends on the hierarchy. The same
//! walk goes through the instances of a scene with two levels, and through the tree of each ([`super::placed`]).

use fearless_simd::{dispatch, f64x8, prelude::*};
use glam::{DMat3, DVec3};

use super::placed::{Instance, Set, pack};
use super::wide::{Child, Node, WIDTH, Wide};
use super::{Occluders, TriangleBvh};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Result;
use crate::geometry::Geometry;
use crate::raster::leaf::{LEAF, LeafPainter, Triangles};
use crate::raster::nearest::Nearest;
use crate::raster::setup::NEAR;
use crate::raster::{Tile, each_tile};
use crate::simd::detect;

const _: () = assert!(LEAF == WIDTH, "a pack is drawn at once");

/// What coordinates of projected points can be wrong by, over what they are sums of: more than a hundred roundings.
const ROUNDING: f64 = 128.0 * f64::EPSILON;

/// By how much corners are moved when they are rounded to single precision, over the largest coordinate: half an ulp, and as
/// much to spare.
const CORNER: f64 = 1.0 / (1 << 23) as f64;

/// What a place in the image can be wrong by after the division, in pixels: they are below 2¹⁶.
const MARGIN: f64 = 1e-9;

/// One over the depth of what may reach to the near plane: places in the image are then beyond all bounds.
const BOUNDLESS: f64 = 1e300;

/// Tiles of the image with the nearest triangles of all meshes, with a [`Control::step`] each.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub fn nearest(
    geometry: &Geometry,
    occluders: &Occluders,
    camera: &Camera,
    control: &Control,
) -> Result<Vec<(Tile, Nearest)>> {
    each_tile(camera, control, Nearest::new, |_, tile, sink| {
        let view = View::new(camera, tile);
        let mut painter = LeafPainter::new(camera, tile);
        let mut stack = Vec::new();
        for bvh in occluders.triangles() {
            let faces = &geometry.faces;
            let mut leaves = Flat {
                bvh,
                triangles: Triangles { faces, first: 0 },
                painter: &mut painter,
            };
            let (stack, sink) = (&mut stack, &mut *sink);
            dispatch!(detect(), simd => walk(simd, &bvh.wide, &view, &mut leaves, stack, sink));
        }
        let Some(placed) = &occluders.placed else {
            return;
        };
        let mut below = Vec::new();
        for set in placed.sets() {
            let mut leaves = Upper {
                set,
                view: &view,
                painter: &mut painter,
                stack: &mut below,
            };
            let (stack, sink) = (&mut stack, &mut *sink);
            dispatch!(detect(), simd => walk(simd, &set.tree, &view, &mut leaves, stack, sink));
        }
    })
}

/// What is done with the leaves of a tree that may show.
trait Leaves {
    fn draw<S: Simd>(&mut self, simd: S, leaf: Child, sink: &mut Nearest);
}

/// Leaves of a tree over all triangles.
struct Flat<'a, 'b> {
    bvh: &'a TriangleBvh,
    triangles: Triangles<'a>,
    painter: &'a mut LeafPainter<'b>,
}

impl Leaves for Flat<'_, '_> {
    #[inline(always)]
    fn draw<S: Simd>(&mut self, simd: S, leaf: Child, sink: &mut Nearest) {
        let tree = &self.bvh.wide;
        let first = tree.firsts[leaf.place()] as usize;
        let faces = &self.bvh.faces[first..first + leaf.triangles()];
        let corners = &tree.packs[leaf.place()].corners;
        self.painter
            .draw(simd, self.triangles, faces, corners, sink);
    }
}

/// Leaves of a tree over instances.
struct Upper<'a, 'b> {
    set: &'a Set,
    view: &'a View,
    painter: &'a mut LeafPainter<'b>,
    stack: &'a mut Vec<Open>,
}

impl Leaves for Upper<'_, '_> {
    #[inline(always)]
    fn draw<S: Simd>(&mut self, simd: S, leaf: Child, sink: &mut Nearest) {
        let first = self.set.tree.firsts[leaf.place()] as usize;
        for instance in &self.set.instances[first..first + leaf.triangles()] {
            let view = self.view.of_instance(instance);
            let mut leaves = Lower {
                instance,
                triangles: Triangles {
                    faces: instance.tree.mesh.faces(),
                    first: instance.first_face,
                },
                painter: &mut *self.painter,
            };
            self.stack.clear();
            walk(
                simd,
                &instance.tree.wide,
                &view,
                &mut leaves,
                self.stack,
                sink,
            );
        }
    }
}

/// Leaves of an instance's tree.
struct Lower<'a, 'b> {
    instance: &'a Instance,
    triangles: Triangles<'a>,
    painter: &'a mut LeafPainter<'b>,
}

impl Leaves for Lower<'_, '_> {
    #[inline(always)]
    fn draw<S: Simd>(&mut self, simd: S, leaf: Child, sink: &mut Nearest) {
        let faces = self.instance.tree.faces(leaf);
        let corners = pack(simd, self.instance, leaf).corners;
        self.painter
            .draw(simd, self.triangles, faces, &corners, sink);
    }
}

/// How boxes are projected to a tile.
struct View {
    eye: [f64; 3],
    /// From differences to the eye to homogeneous pixel coordinates with the tile's middle as their origin, where
    /// intervals of them are tightest: rows for x, y and z.
    rows: [[f64; 3]; 3],
    /// What is added to them.
    offset: [f64; 3],
    /// What each can be wrong by, over the largest difference, and besides.
    slack: [f64; 3],
    more_slack: [f64; 3],
    /// The middle of the tile from its first pixel's centre.
    middle: [f64; 2],
    /// The last column and row of the tile.
    last: [f64; 2],
}

impl View {
    fn new(camera: &Camera, tile: Tile) -> Self {
        let size = [tile.width, tile.height].map(f64::from);
        let corner = [tile.x, tile.y].map(f64::from);
        let middle = [0, 1].map(|k| corner[k] + 0.5 * size[k]);
        let k = camera.intrinsics;
        let shift = DVec3::new(middle[0], middle[1], 0.0);
        let moved = DMat3::from_cols(k.x_axis, k.y_axis, k.z_axis - shift);
        let matrix = moved * camera.rotation;
        let largest = |row: usize, k: DMat3| k.row(row).abs().element_sum();
        View {
            eye: camera.eye.to_array(),
            rows: [0, 1, 2].map(|row| matrix.row(row).to_array()),
            offset: [0.0; 3],
            slack: [0, 1, 2].map(|row| ROUNDING * (largest(row, k) + largest(row, moved))),
            more_slack: [0.0; 3],
            middle: size.map(|size| 0.5 * size - 0.5),
            last: size.map(|size| size - 1.0),
        }
    }

    /// How boxes in the coordinates of an instance's mesh are projected.
    fn of_instance(&self, instance: &Instance) -> View {
        let (matrix, middle) = instance.to_scene();
        let eye = DVec3::from_array(self.eye);
        let turned = |row: usize| DVec3::from_array(self.rows[row]);
        let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
        // As far as anything within the boxes is from the eye, with the parts of sums that may cancel.
        let reach = columns.map(|c| c.abs().max_element()).iter().sum::<f64>();
        let reach = 4.0 * (reach + middle.abs().max_element() + eye.abs().max_element());
        let more = |row: usize| {
            let corners = turned(row).abs().element_sum() * CORNER * instance.largest;
            corners + self.slack[row] * reach
        };
        View {
            eye: [0.0; 3],
            rows: [0, 1, 2].map(|row| columns.map(|c| turned(row).dot(c))),
            offset: [0, 1, 2].map(|row| turned(row).dot(middle - eye)),
            slack: [0.0; 3],
            more_slack: [0, 1, 2].map(more),
            middle: self.middle,
            last: self.last,
        }
    }
}

/// Where a node's children are in a tile.
#[derive(Default)]
struct Places {
    /// Bit `k` is set where child `k` can cover pixels.
    some: u32,
    /// First column and row of these, and the last.
    low: [[f64; WIDTH]; 2],
    high: [[f64; WIDTH]; 2],
    /// No less than the inverse depth of anything in the box.
    inverse_depth: [f64; WIDTH],
}

/// What is still to be drawn.
#[derive(Clone, Copy)]
struct Open {
    child: Child,
    low: [u8; 2],
    high: [u8; 2],
    inverse_depth: f64,
}

#[inline(always)]
fn walk<S: Simd, L: Leaves>(
    simd: S,
    tree: &Wide,
    view: &View,
    leaves: &mut L,
    stack: &mut Vec<Open>,
    sink: &mut Nearest,
) {
    if tree.nodes.is_empty() {
        return;
    }
    let mut child = Child::ROOT;
    loop {
        if child.is_leaf() {
            leaves.draw(simd, child, sink);
        } else {
            let node = &tree.nodes[child.place()];
            let places = project(simd, node, view);
            let (from, mut some) = (stack.len(), places.some);
            while some != 0 {
                let k = some.trailing_zeros() as usize % WIDTH;
                some &= some - 1;
                let corner = |at: &[[f64; WIDTH]; 2]| [at[0][k] as u8, at[1][k] as u8];
                tree.prefetch(node.child[k]);
                stack.push(Open {
                    child: node.child[k],
                    low: corner(&places.low),
                    high: corner(&places.high),
                    inverse_depth: places.inverse_depth[k],
                });
            }
            stack[from..].sort_unstable_by(|a, b| a.inverse_depth.total_cmp(&b.inverse_depth));
        }
        child = loop {
            let Some(open) = stack.pop() else {
                return;
            };
            let (low, high) = (open.low.map(u32::from), open.high.map(u32::from));
            if !sink.hides(low, high, open.inverse_depth) {
                break open.child;
            }
        };
    }
}

#[inline(always)]
fn project<S: Simd>(simd: S, node: &Node, view: &View) -> Places {
    // Along each axis, the lower and the upper sides from the eye.
    let sides = [
        [side(simd, node, view, 0, 0), side(simd, node, view, 0, 1)],
        [side(simd, node, view, 1, 0), side(simd, node, view, 1, 1)],
        [side(simd, node, view, 2, 0), side(simd, node, view, 2, 1)],
    ];
    let [x, y, z] = [farther(&sides[0]), farther(&sides[1]), farther(&sides[2])];
    let largest = larger(larger(x, y), z);
    let slack = largest * view.slack[2] + view.more_slack[2];
    let front = bound(view, &sides, 2, 0) - slack;
    let back = bound(view, &sides, 2, 1) + slack;
    let near = front
        .simd_ge(NEAR)
        .select(1.0 / front, f64x8::splat(simd, BOUNDLESS));
    let far = 1.0 / larger(back, f64x8::splat(simd, NEAR));
    let mut places = Places::default();
    let mut some = back.simd_ge(NEAR);
    for axis in 0..2 {
        let slack = largest * view.slack[axis] + view.more_slack[axis];
        let low = bound(view, &sides, axis, 0) - slack;
        let high = bound(view, &sides, axis, 1) + slack;
        let low = low * low.simd_gt(0.0).select(far, near) + (view.middle[axis] - MARGIN);
        let high = high * high.simd_gt(0.0).select(near, far) + (view.middle[axis] + MARGIN);
        // The first pixel with its centre after the one, and the last before the other.
        let low = larger(low, f64x8::splat(simd, 0.0)).ceil();
        let last = f64x8::splat(simd, view.last[axis]);
        let high = high.simd_lt(last).select(high, last).floor();
        some &= low.simd_le(high);
        low.store_array(&mut places.low[axis]);
        high.store_array(&mut places.high[axis]);
    }
    near.store_array(&mut places.inverse_depth);
    places.some = some.to_bitmask() as u32 & ((1 << node.count) - 1);
    places
}

/// Sides of all children's boxes along an axis, from the eye.
#[inline(always)]
fn side<S: Simd>(simd: S, node: &Node, view: &View, axis: usize, side: usize) -> f64x8<S> {
    let mut planes = [0.0; WIDTH];
    for (to, &plane) in planes.iter_mut().zip(&node.planes[axis][side]) {
        *to = f64::from(plane);
    }
    f64x8::load_array_ref(simd, &planes) - view.eye[axis]
}

/// The larger distance of two sides.
#[inline(always)]
fn farther<S: Simd>(sides: &[f64x8<S>; 2]) -> f64x8<S> {
    larger(sides[0].abs(), sides[1].abs())
}

#[inline(always)]
fn larger<S: Simd>(a: f64x8<S>, b: f64x8<S>) -> f64x8<S> {
    a.simd_gt(b).select(a, b)
}

/// The least value of a coordinate in all boxes, or with an `end` of 1 the largest.
#[inline(always)]
fn bound<S: Simd>(view: &View, sides: &[[f64x8<S>; 2]; 3], at: usize, end: usize) -> f64x8<S> {
    let row = &view.rows[at];
    // The sign of an axis' factor says which side it is.
    let [x, y, z] = [0, 1, 2].map(|axis| end ^ usize::from(row[axis] < 0.0));
    sides[0][x] * row[0] + sides[1][y] * row[1] + sides[2][z] * row[2] + view.offset[at]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::entry::Material;
    use crate::random::Random;
    use crate::raster::rasterize;
    use crate::scene::Scene;
    use glam::DMat3;

    /// Triangles of every kind, in front of a camera at the origin that looks along z, and around it.
    fn triangles(random: &mut Random, count: usize) -> (Vec<DVec3>, Vec<[i64; 3]>) {
        let (mut points, mut faces) = (Vec::new(), Vec::new());
        for k in 0..count {
            let size = [0.01, 0.03, 0.2, 2.0][k % 4];
            // Some next to the near plane and through it, most before it.
            let depth = if k % 11 == 0 { 0.0 } else { 1.5 };
            let centre = random.point() + DVec3::Z * depth;
            let corner = |random: &mut Random| match k % 7 {
                // On pixels' centres, if the depth is 1.
                0 => {
                    let p = (centre + size * random.point()) * 64.0;
                    DVec3::new(p.x.floor() + 0.5, p.y.floor() + 0.5, 64.0) / 64.0
                }
                _ => centre + size * random.point(),
            };
            let first = points.len() as i64;
            points.extend([corner(random), corner(random), corner(random)]);
            faces.push([first, first + 1, first + 2]);
            // Neighbours at an edge, doubles, and triangles without an area.
            match k % 13 {
                1 if k > 2 => faces.push([first + 1, first, first - 1]),
                2 => faces.push([first + 2, first, first + 1]),
                3 => points[first as usize + 2] = points[first as usize],
                4 => {
                    points[first as usize + 2] =
                        0.5 * (points[first as usize] + points[first as usize + 1]);
                }
                _ => {}
            }
        }
        (points, faces)
    }

    #[test]
    fn what_hierarchies_show_is_what_the_rasteriser_draws() {
        let mut random = Random(7);
        let mut scene = Scene::default();
        for (name, casts, opacity) in [("a", true, 1.0), ("b", true, 0.5), ("c", false, 1.0)] {
            let (points, faces) = triangles(&mut random, 1200);
            let material = Material {
                albedo: [1.0; 3],
                opacity,
                casts,
                receives: true,
            };
            scene.add_mesh(name, points, &faces, material).unwrap();
        }
        let geometry = scene.snapshot().unwrap();
        let control = Control::default();
        let turned = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-0.3);
        for (eye, pose, focal, width, height) in [
            (DVec3::ZERO, DMat3::IDENTITY, 64.0, 130, 70),
            (DVec3::new(0.1, 0.2, 0.9), turned, 40.0, 65, 129),
            (DVec3::new(0.0, 0.0, -1e6), DMat3::IDENTITY, 3e7, 64, 1),
            (DVec3::Z * 9.0, DMat3::from_rotation_y(3.1), 900.0, 301, 33),
        ] {
            let middle = [width, height].map(|size| 0.5 * size as f64);
            let intrinsics = DMat3::from_cols(
                DVec3::X * focal,
                DVec3::new(0.1, focal, 0.0),
                DVec3::new(middle[0], middle[1], 1.0),
            );
            let camera = Camera::new(intrinsics, pose, eye, width, height).unwrap();
            let camera = camera.to_local(&geometry.frame);
            let found = nearest(&geometry, geometry.occluders(), &camera, &control).unwrap();
            let (points, faces) = (&geometry.positions, &geometry.faces);
            let expected =
                rasterize(points, faces, |_| true, &camera, &control, Nearest::new).unwrap();
            let mut seen = 0;
            for ((tile, found), (same, expected)) in found.iter().zip(&expected) {
                assert_eq!(tile, same);
                assert_eq!(found.triangle, expected.triangle);
                assert_eq!(found.inverse_depth, expected.inverse_depth);
                let shows = |depth: &&f64| **depth > 0.0;
                seen += found.inverse_depth.iter().filter(shows).count();
            }
            assert!(seen > 20, "{seen}");
        }
    }
}
