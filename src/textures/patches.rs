//! Receiver polygons: the connected parts of meshes that lie in one plane, and the parallelograms around them.
//!
//! Herf and Heckbert 1996, "Math": every receiver polygon is bounded by a parallelogram; a triangle is half
//! of one, a polygon that is one is its own, any other has the smallest rectangle around it.
//!
//! A triangle belongs to the plane of the largest one that it is connected with through triangles of that plane
//! if its corners are within [`FLAT`] of it. Triangles without area have no patch.

use glam::{DVec2, DVec3};

use crate::control::Control;
use crate::error::Result;
use crate::frame::POINT_OFFSET;
use crate::geometry::{Geometry, MeshRange};
use crate::mesh::adjacency::Adjacency;

/// How far from a plane a corner may be to lie in it, local units: what the light points are moved by, more
/// than the rounding of coordinates.
pub const FLAT: f64 = POINT_OFFSET;

/// Marks a triangle without a patch.
pub const NONE: u32 = u32::MAX;

/// Corners of a polygon that differ from a parallelogram by less than this part of its size make one; ten
/// `f32` ulps.
const SAME: f64 = 1e-6;

/// A parallelogram `corner + x edges[0] + y edges[1]`, `x` and `y` from 0 to 1, in local coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parallelogram {
    /// The corner `b`.
    pub corner: DVec3,
    /// The edges `e_x` and `e_y`.
    pub edges: [DVec3; 2],
}

impl Parallelogram {
    /// A point of it.
    pub fn at(&self, x: f64, y: f64) -> DVec3 {
        self.corner + self.edges[0] * x + self.edges[1] * y
    }

    /// All four corners.
    pub fn corners(&self) -> [DVec3; 4] {
        [(0., 0.), (1., 0.), (1., 1.), (0., 1.)].map(|(x, y)| self.at(x, y))
    }

    /// `e_x × e_y`
    pub fn cross(&self) -> DVec3 {
        self.edges[0].cross(self.edges[1])
    }

    /// The vectors `d_x`, `d_y` in its plane with `d_x·e_x = 1`, `d_x·e_y = 0`, and the reverse.
    pub fn dual(&self) -> [DVec3; 2] {
        let n = self.cross();
        let [ex, ey] = self.edges;
        let area = n.length_squared();
        [ey.cross(n) / area, n.cross(ex) / area]
    }

    /// This parallelogram, moved by `by`.
    pub fn moved(&self, by: DVec3) -> Self {
        Parallelogram {
            corner: self.corner + by,
            edges: self.edges,
        }
    }
}

/// A receiver polygon.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Its triangles in [`Geometry::faces`].
    pub faces: Vec<u32>,
    /// What bounds it.
    pub bounds: Parallelogram,
    /// Unit normal, on the side from which its largest triangle is wound counterclockwise.
    pub normal: DVec3,
    /// Whether the bounds are those of shadows on it, and what is outside is lit.
    pub fitted: bool,
    /// Whether shadows can fall anywhere on its back and its front, and no bounds hold them.
    pub boundless: [bool; 2],
}

impl Patch {
    /// Texels along each edge: enough for texels of this size, a power of two, at most `most`.
    pub fn texture_size(&self, texel: f64, most: u32) -> [u32; 2] {
        // A triangle's parallelogram has its middle on the triangle's side; with two texels along an edge one
        // has its centre inside.
        let least = if self.faces.len() == 1 { 2 } else { 1 };
        self.bounds.edges.map(|e| {
            // A side that is whole texels long but for rounding has no further one.
            let texels = (e.length() / texel * (1.0 - SAME)).ceil();
            let texels = texels.clamp(1.0, f64::from(most)) as u32;
            texels.max(least).next_power_of_two().min(most)
        })
    }
}

/// The patches of a scene.
#[derive(Debug, Clone, Default)]
pub struct Patches {
    /// The patches, in the order of the meshes; within a mesh the largest first.
    pub list: Vec<Patch>,
    /// The patch of each triangle, or [`NONE`].
    pub of_face: Vec<u32>,
}

impl Patches {
    /// Finds the patches of all meshes.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`].
    pub fn new(geometry: &Geometry, control: &Control) -> Result<Self> {
        let mut patches = Patches {
            list: Vec::new(),
            of_face: vec![NONE; geometry.faces.len()],
        };
        for mesh in &geometry.meshes {
            control.check()?;
            patches.add(geometry, mesh, control)?;
        }
        Ok(patches)
    }

    fn add(&mut self, geometry: &Geometry, mesh: &MeshRange, control: &Control) -> Result<()> {
        let adjacency = mesh.mesh.adjacency();
        let edges = edges_of_faces(adjacency, mesh.faces as usize);
        let corners = |f: u32| geometry.corners(mesh.first_face + f).map(|p| p.as_dvec3());
        let cross = |f: u32| {
            let [a, b, c] = corners(f);
            (b - a).cross(c - a)
        };
        let mut order: Vec<(f64, u32)> = (0..mesh.faces)
            .map(|f| (cross(f).length_squared(), f))
            .filter(|(area, _)| *area > 0.0)
            .collect();
        order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut stack = Vec::new();
        for &(_, seed) in &order {
            control.check()?;
            if self.of_face[(mesh.first_face + seed) as usize] != NONE {
                continue;
            }
            let Some(normal) = cross(seed).try_normalize() else {
                continue;
            };
            let origin = corners(seed)[0];
            let in_plane = |f: u32| {
                let far = |p: &DVec3| normal.dot(*p - origin).abs() > FLAT;
                !corners(f).iter().any(far)
            };
            let id = self.list.len() as u32;
            let mut faces = Vec::new();
            stack.push(seed);
            self.of_face[(mesh.first_face + seed) as usize] = id;
            while let Some(f) = stack.pop() {
                faces.push(mesh.first_face + f);
                for &edge in edges[f as usize].iter().filter(|e| **e != NONE) {
                    for incident in adjacency.incident(edge as usize) {
                        let of = &mut self.of_face[(mesh.first_face + incident.face) as usize];
                        if *of == NONE && in_plane(incident.face) {
                            *of = id;
                            stack.push(incident.face);
                        }
                    }
                }
            }
            faces.sort_unstable();
            let bounds = bounds(geometry, &faces, normal);
            self.list.push(Patch {
                faces,
                bounds,
                normal,
                fitted: false,
                boundless: [false; 2],
            });
        }
        Ok(())
    }

    /// Bytes of the list.
    pub fn bytes(&self) -> usize {
        self.list.len() * size_of::<Patch>() + self.of_face.len() * 8
    }
}

/// For every face its three edges in the adjacency, [`NONE`] for a face without any.
fn edges_of_faces(adjacency: &Adjacency, faces: usize) -> Vec<[u32; 3]> {
    let mut out = vec![[NONE; 3]; faces];
    for edge in 0..adjacency.edges().len() {
        for incident in adjacency.incident(edge) {
            let slots = &mut out[incident.face as usize];
            if let Some(slot) = slots.iter_mut().find(|s| **s == NONE) {
                *slot = edge as u32;
            }
        }
    }
    out
}

/// The parallelogram around triangles of a plane.
fn bounds(geometry: &Geometry, faces: &[u32], normal: DVec3) -> Parallelogram {
    if let [one] = faces {
        return around_triangle(geometry.corners(*one).map(|p| p.as_dvec3()));
    }
    let origin = geometry.corners(faces[0])[0].as_dvec3();
    let (u, v) = normal.any_orthonormal_pair();
    let mut points: Vec<DVec2> = faces
        .iter()
        .flat_map(|&f| geometry.corners(f))
        .map(|p| {
            let d = p.as_dvec3() - origin;
            DVec2::new(d.dot(u), d.dot(v))
        })
        .collect();
    let hull = hull(&mut points);
    let lift = |p: DVec2| u * p.x + v * p.y;
    if let [a, b, c, d] = hull[..] {
        let size = (c - a).length().max((d - b).length());
        if (a + c - b - d).length() <= SAME * size {
            return Parallelogram {
                corner: origin + lift(a),
                edges: [lift(b - a), lift(d - a)],
            };
        }
    }
    let (corner, edges) = smallest_rectangle(&hull);
    Parallelogram {
        corner: origin + lift(corner),
        edges: edges.map(lift),
    }
}

/// The parallelogram that a triangle is half of, with the corner whose angle is nearest to a right one, so
/// that texels are slanted least.
fn around_triangle(corners: [DVec3; 3]) -> Parallelogram {
    let slant = |i: usize| {
        let (e, f) = (
            corners[(i + 1) % 3] - corners[i],
            corners[(i + 2) % 3] - corners[i],
        );
        e.normalize_or_zero().dot(f.normalize_or_zero()).abs()
    };
    let i = (0..3)
        .min_by(|&a, &b| slant(a).total_cmp(&slant(b)))
        .unwrap_or(0);
    Parallelogram {
        corner: corners[i],
        edges: [
            corners[(i + 1) % 3] - corners[i],
            corners[(i + 2) % 3] - corners[i],
        ],
    }
}

/// The convex hull, counterclockwise, without points on its sides (Andrew's monotone chain).
fn hull(points: &mut Vec<DVec2>) -> Vec<DVec2> {
    points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let size = points.iter().fold(0.0f64, |m, p| m.max(p.length()));
    let turns_left = |a: DVec2, b: DVec2, c: DVec2| {
        let (e, f) = (b - a, c - b);
        // A corner within rounding of the line through its neighbours is none.
        e.perp_dot(f) > 0.1 * SAME * size * (e.length() + f.length())
    };
    let chain = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut out: Vec<DVec2> = Vec::new();
        for p in points {
            while let [.., a, b] = out[..] {
                if turns_left(a, b, p) {
                    break;
                }
                out.pop();
            }
            out.push(p);
        }
        out.pop();
        out
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

/// The smallest rectangle around a convex polygon has a side on one of the polygon's.
fn smallest_rectangle(hull: &[DVec2]) -> (DVec2, [DVec2; 2]) {
    let mut best = (f64::INFINITY, DVec2::ZERO, [DVec2::ZERO; 2]);
    for i in 0..hull.len() {
        let Some(u) = (hull[(i + 1) % hull.len()] - hull[i]).try_normalize() else {
            continue;
        };
        let v = u.perp();
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for p in hull {
            let q = DVec2::new(p.dot(u), p.dot(v));
            (low, high) = (low.min(q), high.max(q));
        }
        let size = high - low;
        // The first of rectangles that rounding alone tells apart.
        if size.x * size.y < best.0 * (1.0 - SAME) {
            best = (
                size.x * size.y,
                u * low.x + v * low.y,
                [u * size.x, v * size.y],
            );
        }
    }
    (best.1, best.2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::entry::Material;
    use crate::scene::Scene;

    const LOOKS: Material = Material {
        albedo: [1.0; 3],
        opacity: 1.0,
        casts: true,
        receives: true,
    };

    fn patches(vertices: &[[f64; 3]], faces: &[[i64; 3]]) -> Patches {
        let mut scene = Scene::default();
        let vertices = vertices.iter().map(|&v| v.into()).collect();
        scene.add_mesh("mesh", vertices, faces, LOOKS).unwrap();
        Patches::new(&scene.snapshot().unwrap(), &Control::default()).unwrap()
    }

    #[test]
    fn a_cube_has_six_square_patches_and_a_triangle_is_half_of_one() {
        let corner = |i: usize| [0, 1, 2].map(|k| ((i >> k) & 1) as f64);
        let vertices: Vec<_> = (0..8).map(corner).collect();
        let quads = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let faces: Vec<_> = quads
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect();
        let found = patches(&vertices, &faces);
        assert_eq!(found.list.len(), 6);
        for patch in &found.list {
            let [ex, ey] = patch.bounds.edges;
            assert_eq!(patch.faces.len(), 2);
            assert!((ex.length() - ey.length()).abs() < 1e-12 && ex.dot(ey).abs() < 1e-12);
            assert!((patch.bounds.cross().normalize().dot(patch.normal).abs() - 1.0).abs() < 1e-12);
        }
        let one = patches(&vertices, &faces[..1]);
        let [ex, ey] = one.list[0].bounds.edges;
        // Its edges are 1 long, two units of its frame.
        assert!((ex.cross(ey).length() - 4.0).abs() < 1e-6);
    }

    #[test]
    fn a_polygon_has_the_smallest_rectangle_and_sheets_apart_are_apart() {
        // A pentagon as a fan, and a triangle in its plane that touches it at no edge.
        let vertices = [
            [0., 0., 0.],
            [2., 0., 0.],
            [2., 1., 0.],
            [1., 1.5, 0.],
            [0., 1., 0.],
            [5., 5., 0.],
            [6., 5., 0.],
            [5., 6., 0.],
        ];
        let found = patches(&vertices, &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [5, 6, 7]]);
        assert_eq!(found.list.len(), 2);
        let large = found.list.iter().find(|p| p.faces.len() == 3).unwrap();
        // 2 by 1.5, in units of half the frame's 4.
        assert!((large.bounds.cross().length() - 3.0 / 16.0).abs() < 1e-6);
        assert_eq!(large.texture_size(0.01, 256), [64, 64]);
        assert_eq!(large.texture_size(0.001, 256), [256, 256]);
        assert_eq!(large.texture_size(10.0, 256), [1, 1]);
    }
}
