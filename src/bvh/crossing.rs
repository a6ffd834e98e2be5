//! Exactly which surfaces one segment crosses, for transmittance.
//!
//! A product over crossings must count each surface once: a segment through an edge that two
//! triangles share crosses one of them, not both and not neither. So the signs of Woop's edge
//! functions are exact here (`robust::orient2d` on the sheared vertices where two products round to
//! the same number), and a segment that passes exactly through an edge is moved off it by an
//! infinitesimal amount, the same for all triangles (simulation of simplicity, Edelsbrunner and Mücke
//! 1990): first along x, then along y of the sheared plane. The first crossing is found by the same tests.

use glam::{DVec2, DVec3, Vec3};
use robust::{Coord, orient2d};

use super::packet::{Stack, plane_side};
use super::tree::{Node, Tree};
use super::{SphereBvh, TriangleBvh};
use crate::geometry::Sphere;

/// The first triangle that the segment crosses, of [`TriangleBvh::faces`], and the part of the segment before it.
pub fn first_triangle(
    bvh: &TriangleBvh,
    from: Vec3,
    to: Vec3,
    stack: &mut Stack,
) -> Option<(f64, u32)> {
    let shear = Shear::new(from, to);
    let mut first = (1.0, None);
    visit(&bvh.tree, from, to, &mut stack.nodes, |i| {
        if let Some([start, end]) = shear.sides(&bvh.corners[i], from, to) {
            let t = start / (start - end);
            if t <= first.0 {
                first = (t, Some(bvh.faces[i]));
            }
        }
        first.0
    });
    Some((first.0, first.1?))
}

/// Transmittance of the segment through spheres: each surface that it enters or leaves counts.
pub fn through_spheres(bvh: &SphereBvh, from: Vec3, to: Vec3, stack: &mut Stack) -> f32 {
    let [crossed, ..] = &mut stack.crossed;
    crossed.clear();
    let (o, end) = (from.as_dvec3(), to.as_dvec3());
    visit(&bvh.tree, from, to, &mut stack.nodes, |i| {
        let crossings = sphere_crossings(&bvh.spheres[i], o, end);
        if crossings > 0 {
            crossed.add(bvh.transmittance[i], crossings);
        }
        1.0
    });
    crossed.product()
}

/// How often a segment crosses a sphere: 0, 1 or 2 times.
pub(crate) fn sphere_crossings(s: &Sphere, from: DVec3, to: DVec3) -> i32 {
    let (q, d) = (from - s.center, to - from);
    let power = |p: DVec3| p.length_squared() - s.radius * s.radius;
    let (start, stop) = (power(q), power(to - s.center));
    if (start < 0.0) != (stop < 0.0) {
        return 1;
    }
    if start < 0.0 {
        return 0;
    }
    // Both ends outside: through, if the nearest point lies between them and inside.
    let t = -q.dot(d) / d.length_squared();
    if t > 0.0 && t < 1.0 && power(q + d * t) < 0.0 {
        2
    } else {
        0
    }
}

/// Calls `test` with every primitive whose box the segment may enter; it returns up to which part of the segment
/// the others still matter. Inlined, so that a limit that stays 1 costs nothing.
#[inline(always)]
fn visit(
    tree: &Tree,
    from: Vec3,
    to: Vec3,
    nodes: &mut Vec<u32>,
    mut test: impl FnMut(usize) -> f64,
) {
    if tree.nodes.is_empty() {
        return;
    }
    let (o, d) = (from.as_dvec3(), to.as_dvec3() - from.as_dvec3());
    // Slabs in f64 with the boxes' f32 corners: widened as in the packet test, in coordinates.
    let slack = 1e-6 * o.abs().max_element().max(1.0);
    let inverse = d.map(|x| 1.0 / if x.abs() < 1e-20 { 1e-20 } else { x });
    let mut limit = 1.0;
    let enters = |node: &Node, limit: f64| {
        let low = (Vec3::from(node.min).as_dvec3() - slack - o) * inverse;
        let high = (Vec3::from(node.max).as_dvec3() + slack - o) * inverse;
        low.min(high).max_element().max(0.0) <= low.max(high).min_element().min(limit)
    };
    nodes.clear();
    nodes.push(0);
    while let Some(i) = nodes.pop() {
        let node = &tree.nodes[i as usize];
        if !enters(node, limit) {
            continue;
        }
        if node.count == 0 {
            nodes.extend([node.first, i + 1]);
            continue;
        }
        for k in node.first..node.first + node.count {
            limit = test(k as usize);
        }
    }
}

/// The shear that lays a segment along one axis.
pub(super) struct Shear {
    origin: DVec3,
    axes: [usize; 3],
    slope: DVec2,
}

impl Shear {
    pub(super) fn new(from: Vec3, to: Vec3) -> Self {
        let d = to.as_dvec3() - from.as_dvec3();
        let size = d.abs();
        let axis = if size.z >= size.x && size.z >= size.y {
            2
        } else if size.x >= size.y {
            0
        } else {
            1
        };
        let axes = [(axis + 1) % 3, (axis + 2) % 3, axis];
        let slope = DVec2::new(d[axes[0]], d[axes[1]]) / d[axis];
        Shear {
            origin: from.as_dvec3(),
            axes,
            slope,
        }
    }

    fn point(&self, v: Vec3) -> DVec2 {
        let q = v.as_dvec3() - self.origin;
        DVec2::new(q[self.axes[0]], q[self.axes[1]]) - self.slope * q[self.axes[2]]
    }

    /// Whether the segment crosses the triangle: passes through it, with its ends strictly on
    /// different sides.
    pub(super) fn crosses(&self, corners: &[Vec3; 3], from: Vec3, to: Vec3) -> bool {
        self.sides(corners, from, to).is_some()
    }

    /// The distances of the ends from the triangle's plane, to scale and of opposite signs, where the segment
    /// crosses it.
    #[inline(always)]
    fn sides(&self, corners: &[Vec3; 3], from: Vec3, to: Vec3) -> Option<[f64; 2]> {
        let [a, b, c] = corners.map(|v| self.point(v));
        let (u, v, w) = (left_of(b, c), left_of(c, a), left_of(a, b));
        if u == 0 || u != v || v != w {
            return None;
        }
        let (start, end) = (plane_side(corners, from), plane_side(corners, to));
        ((start > 0.0 && end < 0.0) || (start < 0.0 && end > 0.0)).then_some([start, end])
    }
}

/// On which side of the line from `a` to `b` the origin lies, moved by an infinitesimal (ε, ε²);
/// 0 only where `a` equals `b`.
fn left_of(a: DVec2, b: DVec2) -> i8 {
    let (left, right) = (a.x * b.y, a.y * b.x);
    let sign = if left != right {
        left - right
    } else {
        let coord = |p: DVec2| Coord { x: p.x, y: p.y };
        orient2d(coord(a), coord(b), Coord { x: 0.0, y: 0.0 })
    };
    // d/dε of the cross product (b - a) × (o - a) is -(b - a).y, then +(b - a).x.
    let sign = if sign != 0.0 {
        sign
    } else if a.y != b.y {
        a.y - b.y
    } else {
        b.x - a.x
    };
    i8::from(sign > 0.0) - i8::from(sign < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::entry::Material;
    use crate::scene::Scene;

    #[test]
    fn a_segment_through_a_shared_edge_or_vertex_crosses_one_triangle() {
        // A fan of six triangles around the origin, and segments through the centre, along the
        // spokes and between them.
        let spoke = |k: usize| {
            let angle = k as f32 * std::f32::consts::FRAC_PI_3;
            Vec3::new(angle.cos(), angle.sin(), 0.25 * angle.sin())
        };
        let fan: Vec<[Vec3; 3]> = (0..6)
            .map(|k| [Vec3::ZERO, spoke(k), spoke((k + 1) % 6)])
            .collect();
        let mut targets = vec![Vec3::ZERO];
        for k in 0..6 {
            targets.push(spoke(k) * 0.5);
            targets.push((spoke(k) + spoke((k + 1) % 6)) * 0.25);
        }
        for target in targets {
            for direction in [Vec3::Z, Vec3::new(0.25, 0.5, 1.0), Vec3::new(0.0, 0.5, 1.0)] {
                let (from, to) = (target - direction, target + direction);
                let shear = Shear::new(from, to);
                let count = fan.iter().filter(|t| shear.crosses(t, from, to)).count();
                assert_eq!(count, 1, "{target} along {direction}");
            }
        }
    }

    #[test]
    fn the_first_of_many_sheets_is_found_from_either_end() {
        let mut scene = Scene::default();
        let looks = Material {
            albedo: [1.0; 3],
            opacity: 1.0,
            casts: true,
            receives: true,
        };
        let sheet = |i: usize| {
            let z = 0.01 * (i * 37 % 100) as f64;
            [(-1.0, -1.0), (1.0, -1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z))
        };
        for i in 0..100 {
            let name = i.to_string();
            scene
                .add_mesh(&name, sheet(i).to_vec(), &[[0, 1, 2]], looks)
                .unwrap();
        }
        let geometry = scene.snapshot().unwrap();
        let local = |z: f64| geometry.frame.to_local(DVec3::new(0.05, 0.1, z)).as_vec3();
        for (from, to, z) in [(-0.5, 1.5, 0.0), (1.5, -0.5, 0.99), (0.495, 0.0, 0.49)] {
            let ends = (local(from), local(to));
            let found = geometry
                .occluders()
                .first_triangle(ends.0, ends.1, &mut Stack::new());
            let (t, face) = found.unwrap();
            assert!((from + (to - from) * t - z).abs() < 1e-6, "{t}");
            assert!((sheet(face as usize)[0].z - z).abs() < 1e-12);
        }
        let beside = (local(2.0), local(1.0));
        let none = geometry
            .occluders()
            .first_triangle(beside.0, beside.1, &mut Stack::new());
        assert!(none.is_none());
    }

    #[test]
    fn ends_on_the_plane_do_not_cross() {
        let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let p = Vec3::new(0.25, 0.25, 0.0);
        for (from, to) in [(p, p + Vec3::Z), (p - Vec3::Z, p)] {
            assert!(!Shear::new(from, to).crosses(&triangle, from, to));
        }
        assert!(Shear::new(p - Vec3::Z, p + Vec3::Z).crosses(&triangle, p - Vec3::Z, p + Vec3::Z));
    }
}
