//! Which edges can be silhouette edges inside the shaft between a group of receivers and a light.
//!
//! What a receiver sees of the light changes only across edges where the surface ends or turns away:
//! at an edge with one triangle on either side, as the receiver sees it, the surface goes on. So if no
//! such edge crosses a part of the light's outline, either all of that part is hidden or none is.
//! (Triangles that cut the light itself are an exception; [`touches_light`] finds them.)
//!
//! Every edge is stored with one of its triangles. A node of the tree knows a cone that holds the
//! normals of all triangles at its edges; where the whole group is in front of all of them, or behind
//! all, the node has no silhouette edge (Sander, Gu, Gortler, Hoppe and Snyder 2000). An edge of more
//! than two triangles is stored as several, of two triangles each but for one that may be left; an edge of
//! one proper triangle always counts.
//!
//! **Depth complexity.** How many triangles a line from a receiver to a light point crosses changes, where the
//! line moves across an edge, by what the triangles at it say: with `s = 1` in front of a triangle and `s = -1`
//! behind it, by the sum of `s` over triangles that run through the edge forwards less that over the others.
//! The normals of an edge's two triangles are stored so that this is `s₀ - s₁` (a normal is turned where both
//! run the same way), which is 0 where the surface goes on.

use std::ops::Range;

use fearless_simd::{dispatch, f32x16, prelude::*};
use glam::Vec3;
use rayon::prelude::*;

use super::TriangleBvh;
use super::edge_faces::{EdgeFace, pairs};
use super::tree::Node;
use crate::frame::POINT_OFFSET;
use crate::geometry::Geometry;
use crate::light::Light;
use crate::simd::{LANES, Lanes, Level, Row, detect};

/// An edge with the normals of its two triangles; a zero normal where there is no proper one, so
/// that every point is within doubt of its plane.
///
/// Vectors, not indices of vertices and triangles, which would be four more places to look for a candidate.
#[derive(Debug, Clone, Copy)]
pub struct EdgePlanes {
    /// Its ends.
    pub ends: [Vec3; 2],
    /// Unit normals, both to the same side of the surface if it goes on here.
    pub normals: [Vec3; 2],
}

impl EdgePlanes {
    /// The cone of its normals.
    fn cone(&self) -> Cone {
        let [one, two] = self.normals;
        if one == Vec3::ZERO || two == Vec3::ZERO {
            return Cone::ALL;
        }
        let around = |axis: Vec3| Cone { axis, cos: 1.0 };
        around(one).union(around(two))
    }
}

/// All normals lie within an angle of an axis; `cos` below -1 is every direction.
#[derive(Debug, Clone, Copy)]
struct Cone {
    axis: Vec3,
    cos: f32,
}

impl Cone {
    const ALL: Cone = Cone {
        axis: Vec3::Z,
        cos: -2.0,
    };

    fn union(self, other: Cone) -> Cone {
        if self.cos < -1.0 || other.cos < -1.0 {
            return Cone::ALL;
        }
        let (a, b) = (
            self.cos.clamp(-1.0, 1.0).acos(),
            other.cos.clamp(-1.0, 1.0).acos(),
        );
        let between = self
            .axis
            .cross(other.axis)
            .length()
            .atan2(self.axis.dot(other.axis));
        if between + b <= a {
            return self;
        }
        if between + a <= b {
            return other;
        }
        // 1e-4 covers the rounding of this very computation, and nothing is lost by it.
        let half = 0.5 * (a + b + between) + 1e-4;
        let turned = self.axis.cross(other.axis).try_normalize();
        match turned {
            Some(k) if half < std::f32::consts::FRAC_PI_2 => {
                let angle = half - a;
                let axis = self.axis * angle.cos() + k.cross(self.axis) * angle.sin();
                Cone {
                    axis: axis.normalize(),
                    // Below 2.4e-4 an angle's cosine is 1 in f32.
                    cos: half.cos() - 1.2e-7,
                }
            }
            _ => Cone::ALL,
        }
    }
}

/// The edges of a triangle hierarchy in the order of its leaves, with a cone of normals a node.
#[derive(Debug, Clone)]
pub struct Outline {
    edges: Vec<EdgePlanes>,
    /// The two triangles of each.
    faces: Vec<[EdgeFace; 2]>,
    /// First edge of every triangle in leaf order, and the end.
    first: Vec<u32>,
    cones: Vec<Option<Cone>>,
}

impl Outline {
    /// Collects the edges of `bvh`'s triangles.
    pub fn new(geometry: &Geometry, bvh: &TriangleBvh) -> Self {
        let mut place = vec![u32::MAX; geometry.faces.len()];
        for (k, &f) in bvh.faces.iter().enumerate() {
            place[f as usize] = k as u32;
        }
        // In leaf order, zero where a triangle has no area.
        let normals: Vec<Vec3> = bvh
            .faces
            .par_iter()
            .map(|&f| normal(geometry.corners(f)))
            .collect();
        // Edges of every mesh that casts, each at the first of its triangles in leaf order.
        let mut owned: Vec<(u32, EdgePlanes, [EdgeFace; 2])> = Vec::new();
        for mesh in &geometry.meshes {
            if place[mesh.first_face as usize] == u32::MAX {
                continue;
            }
            let adjacency = mesh.mesh.adjacency();
            let leaf = |face: u32| place[(face + mesh.first_face) as usize];
            let found = (0..adjacency.edges().len())
                .into_par_iter()
                .flat_map_iter(|e| {
                    let ends = adjacency.edges()[e]
                        .map(|v| geometry.positions[(v + mesh.first_vertex) as usize]);
                    let (one, more) = pairs(adjacency.incident(e), leaf, &normals);
                    one.into_iter()
                        .chain(more)
                        .map(move |(owner, normals, faces)| {
                            (owner, EdgePlanes { ends, normals }, faces)
                        })
                });
            owned.par_extend(found);
        }
        // Stable, so that a triangle's edges stay in the order of the adjacency.
        owned.par_sort_by_key(|&(owner, ..)| owner);
        let mut first = vec![0u32; bvh.faces.len() + 1];
        for &(owner, ..) in &owned {
            first[owner as usize + 1] += 1;
        }
        for k in 0..bvh.faces.len() {
            first[k + 1] += first[k];
        }
        let (edges, faces) = owned
            .into_par_iter()
            .map(|(_, edge, faces)| (edge, faces))
            .unzip();
        let mut outline = Outline {
            edges,
            faces,
            first,
            cones: Vec::new(),
        };
        outline.cones = outline.node_cones(&bvh.tree.nodes);
        outline
    }

    /// Cones from the leaves up; `None` for a node without edges.
    fn node_cones(&self, nodes: &[Node]) -> Vec<Option<Cone>> {
        let mut cones: Vec<Option<Cone>> = nodes
            .par_iter()
            .map(|node| {
                let edges = self.edges_of(node).iter();
                edges.map(EdgePlanes::cone).reduce(Cone::union)
            })
            .collect();
        for i in (0..nodes.len()).rev() {
            if nodes[i].count == 0 {
                cones[i] = match (cones[i + 1], cones[nodes[i].first as usize]) {
                    (Some(a), Some(b)) => Some(a.union(b)),
                    (a, b) => a.or(b),
                };
            }
        }
        cones
    }

    /// Edges of a leaf; nothing for an inner node.
    fn edges_of(&self, node: &Node) -> &[EdgePlanes] {
        &self.edges[self.range_of(node)]
    }

    fn range_of(&self, node: &Node) -> Range<usize> {
        if node.count == 0 {
            return 0..0;
        }
        let [first, end] = [node.first, node.first + node.count].map(|t| self.first[t as usize]);
        first as usize..end as usize
    }

    /// Hands to `take` the edges in the shaft that can be silhouette edges for one of its receivers.
    /// It returns what each costs; returns false, having stopped early, when there are more than cost `limit`.
    pub fn candidates(
        &self,
        nodes: &[Node],
        shaft: &Shaft,
        limit: usize,
        stack: &mut Vec<u32>,
        take: &mut impl FnMut(&EdgePlanes, [EdgeFace; 2]) -> usize,
    ) -> bool {
        dispatch!(detect(), simd => candidates_lanes(simd, self, nodes, shaft, limit, stack, take))
    }

    /// Bytes of edges and cones.
    pub fn bytes(&self) -> usize {
        self.edges.len() * (size_of::<EdgePlanes>() + size_of::<[EdgeFace; 2]>())
            + self.first.len() * 4
            + self.cones.len() * size_of::<Option<Cone>>()
    }
}

#[inline(always)]
fn candidates_lanes<S: Simd>(
    simd: S,
    outline: &Outline,
    nodes: &[Node],
    shaft: &Shaft,
    limit: usize,
    stack: &mut Vec<u32>,
    take: &mut impl FnMut(&EdgePlanes, [EdgeFace; 2]) -> usize,
) -> bool {
    let mut taken = 0;
    stack.clear();
    if !nodes.is_empty() {
        stack.push(0);
    }
    while let Some(i) = stack.pop() {
        let node = &nodes[i as usize];
        let Some(cone) = outline.cones[i as usize] else {
            continue;
        };
        let meets = shaft.meets_box(simd, node.min.into(), node.max.into());
        if !meets || shaft.sees_one_side(node, cone) {
            continue;
        }
        if node.count == 0 {
            stack.extend([node.first, i + 1]);
            continue;
        }
        for e in outline.range_of(node) {
            let edge = &outline.edges[e];
            if shaft.sees_edge(simd, edge) {
                if taken >= limit {
                    return false;
                }
                taken += take(edge, outline.faces[e]);
            }
        }
    }
    true
}

/// Unit normal by the right-hand rule, zero for a triangle without area.
///
/// In f64: the products of f32 differences are exact there, so that only a triangle whose corners lie
/// on one line to within an f32 ulp of its size can come out as zero or askew.
pub fn normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    let n = (b - a).cross(c - a);
    // The cross product rounds by 1e-16 of the product of the sides; above 1e-9 of it the normal is
    // right to an f32 ulp.
    if n.length() <= 1e-9 * (b - a).length() * (c - a).length() {
        return Vec3::ZERO;
    }
    n.normalize().as_vec3()
}

/// The convex hull of a box of receivers and a light's box, as a set of half-spaces (Haines and
/// Wallace 1991): the box of both, and planes parallel to a coordinate axis that touch both.
#[derive(Debug, Clone)]
pub struct Shaft {
    /// Positive and negative parts of the planes' normals, a lane a plane; a box has a part inside where
    /// `rising · min + falling · max <= offset`. Lanes without a plane let everything in.
    rising: [Row; 3],
    falling: [Row; 3],
    offset: Row,
    center: Vec3,
    radius: f32,
}

impl Shaft {
    /// The shaft from receivers in a box to a light in a box.
    pub fn new(receivers: (Vec3, Vec3), light: (Vec3, Vec3)) -> Self {
        let center = 0.5 * (receivers.0 + receivers.1);
        // The middle rounds by an ulp of its coordinates.
        let rounding = 1e-6 * center.abs().max_element().max(1.0);
        let mut shaft = Shaft {
            rising: [Row::default(); 3],
            falling: [Row::default(); 3],
            offset: Row([f32::MAX; LANES]),
            center,
            radius: 0.5 * (receivers.1 - receivers.0).length() + rounding,
        };
        let (low, high) = (receivers.0.min(light.0), receivers.1.max(light.1));
        let mut used = 0;
        for axis in 0..3 {
            let mut normal = Vec3::ZERO;
            normal[axis] = 1.0;
            shaft.set(used, normal, high[axis]);
            shaft.set(used + 1, -normal, -low[axis]);
            used += 2;
        }
        let corners = [[receivers.0, light.0], [receivers.1, light.1]];
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            for (si, sj) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                // The same corner of both boxes, and a normal that points to that corner's side.
                let [r, l] = [0, 1].map(|k| (corners[si][k][i], corners[sj][k][j]));
                let (di, dj) = (l.0 - r.0, l.1 - r.1);
                let out = (
                    if si == 1 { 1.0 } else { -1.0 },
                    if sj == 1 { 1.0 } else { -1.0 },
                );
                let turned = if dj * out.0 > 0.0 {
                    (dj, -di)
                } else {
                    (-dj, di)
                };
                // Boxes that cross can share four such planes a pair of axes, 18 in all with the sides of the
                // box; without the last of them the shaft is only wider.
                if turned.0 * out.0 <= 0.0 || turned.1 * out.1 <= 0.0 || used == LANES {
                    continue;
                }
                // Two products and a sum, rounded, of coordinates up to the light's or a box's.
                let reach = turned.0.abs()
                    + turned.1.abs()
                    + (turned.0 * l.0).abs().max((turned.0 * r.0).abs())
                    + (turned.1 * l.1).abs().max((turned.1 * r.1).abs());
                let offset = (turned.0 * r.0 + turned.1 * r.1).max(turned.0 * l.0 + turned.1 * l.1);
                let mut normal = Vec3::ZERO;
                (normal[i], normal[j]) = turned;
                shaft.set(used, normal, offset + 1e-6 * reach);
                used += 1;
            }
        }
        shaft
    }

    fn set(&mut self, lane: usize, normal: Vec3, offset: f32) {
        for axis in 0..3 {
            self.rising[axis].0[lane] = normal[axis].max(0.0);
            self.falling[axis].0[lane] = normal[axis].min(0.0);
        }
        self.offset.0[lane] = offset;
    }

    /// Whether a node's box may have a part in the shaft.
    pub fn meets(&self, node: &Node) -> bool {
        dispatch!(Level::baseline(), simd => self.meets_box(simd, node.min.into(), node.max.into()))
    }

    /// Whether a box may have a part in the shaft.
    #[inline(always)]
    fn meets_box<S: Simd>(&self, simd: S, min: Vec3, max: Vec3) -> bool {
        let mut nearest = f32x16::splat(simd, 0.0);
        for axis in 0..3 {
            let rising = self.rising[axis].load(simd) * min[axis];
            let falling = self.falling[axis].load(simd) * max[axis];
            nearest += rising + falling;
        }
        nearest.le(self.offset.load(simd)) == u16::MAX
    }

    /// Whether the edge may have a part in the shaft and may be a silhouette edge for a receiver.
    #[inline(always)]
    fn sees_edge<S: Simd>(&self, simd: S, edge: &EdgePlanes) -> bool {
        let [a, b] = edge.ends;
        let view = self.center - a;
        let [one, two] = edge.normals.map(|n| n.dot(view));
        // Rounding of the dot product, as where receivers are looked at one by one.
        let reach = self.radius + 1e-6 * view.abs().element_sum();
        let goes_on = one.min(two) > reach || one.max(two) < -reach;
        !goes_on && self.meets_box(simd, a.min(b), a.max(b))
    }

    /// Whether all receivers are in front of all triangles with normals in the cone and a corner in
    /// the box, or behind all.
    fn sees_one_side(&self, node: &Node, cone: Cone) -> bool {
        if cone.cos <= 0.0 {
            return false;
        }
        let (min, max) = (Vec3::from(node.min), Vec3::from(node.max));
        let view = 0.5 * (min + max) - self.center;
        let distance = view.length();
        let spread = 0.5 * (max - min).length() + self.radius;
        if spread >= distance {
            return false;
        }
        let sin_b = spread / distance;
        let cos_b = (1.0 - sin_b * sin_b).sqrt();
        let sin_a = (1.0 - cone.cos * cone.cos).max(0.0).sqrt();
        // The sum of both angles must stay under a right angle for its sine to grow with it.
        if cone.cos * cos_b - sin_a * sin_b <= 0.0 {
            return false;
        }
        let along = cone.axis.dot(view).abs() / distance;
        // 1e-4: as in the union of cones, for the rounding of a handful of unit-sized terms.
        along > sin_a * cos_b + cone.cos * sin_b + 1e-4
    }
}

/// How far from a light its points may lie, generously: they are moved off it by four ulps.
fn light_slack(light: &Light) -> f64 {
    let (low, high) = light.bounds();
    4.0 * POINT_OFFSET * low.abs().max(high.abs()).max_element().max(1.0)
}

/// A light's bounds with all its light points inside.
pub fn padded_bounds(light: &Light) -> (Vec3, Vec3) {
    let (low, high) = light.bounds();
    let slack = light_slack(light);
    ((low - slack).as_vec3(), (high + slack).as_vec3())
}

/// Whether a triangle reaches into the light, so that moving a light point can uncover it without an
/// edge in between. Triangles wholly on or behind a flat light's back cannot hide it.
pub fn touches_light(bvh: &TriangleBvh, light: &Light, stack: &mut Vec<u32>) -> bool {
    if light.as_distant().is_some() {
        return false;
    }
    let slack = light_slack(light);
    let (low, high) = padded_bounds(light);
    let overlaps = |min: Vec3, max: Vec3| !(min.cmpgt(high).any() || max.cmplt(low).any());
    stack.clear();
    if !bvh.tree.nodes.is_empty() {
        stack.push(0);
    }
    while let Some(i) = stack.pop() {
        let node = &bvh.tree.nodes[i as usize];
        if !overlaps(node.min.into(), node.max.into()) {
            continue;
        }
        if node.count == 0 {
            stack.extend([node.first, i + 1]);
            continue;
        }
        for &[a, b, c] in &bvh.corners[node.first as usize..(node.first + node.count) as usize] {
            if !overlaps(a.min(b).min(c), a.max(b).max(c)) {
                continue;
            }
            let in_front = match light.normal() {
                Some(n) => {
                    let height = |v: Vec3| n.dot(v.as_dvec3() - light.center());
                    // Half of what light points are moved off the light: more than the rounding of a panel in
                    // the light's plane, less than the height of the lowest light point.
                    height(a).max(height(b)).max(height(c)) > 0.125 * slack
                }
                None => true,
            };
            if in_front {
                return true;
            }
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(min: Vec3, max: Vec3) -> Node {
        Node {
            min: min.to_array(),
            max: max.to_array(),
            first: 0,
            count: 1,
        }
    }

    #[test]
    fn a_shaft_holds_every_point_between_its_boxes_and_little_else() {
        let receivers = (Vec3::new(0.0, 0.0, 0.0), Vec3::new(0.1, 0.2, 0.0));
        let light = (Vec3::new(0.5, -0.3, 2.0), Vec3::new(0.9, 0.1, 2.1));
        let shaft = Shaft::new(receivers, light);
        for step in 0..=10 {
            let t = step as f32 / 10.0;
            for corner in 0..8 {
                let pick = |b: (Vec3, Vec3)| {
                    Vec3::from_array(std::array::from_fn(|k| {
                        if corner >> k & 1 == 1 { b.1[k] } else { b.0[k] }
                    }))
                };
                let p = pick(receivers).lerp(pick(light), t);
                assert!(shaft.meets(&node(p, p)), "{p}");
            }
        }
        // In the box of both, but beside the shaft.
        for p in [
            Vec3::new(0.8, 0.1, 0.2),
            Vec3::new(0.05, 0.1, 1.9),
            Vec3::new(0.85, 0.18, 1.0),
        ] {
            assert!(!shaft.meets(&node(p, p)), "{p}");
        }
    }

    #[test]
    fn a_cone_of_a_union_holds_both() {
        let a = Cone {
            axis: Vec3::Z,
            cos: 0.99,
        };
        let b = Cone {
            axis: Vec3::new(0.5, 0.2, 1.0).normalize(),
            cos: 0.97,
        };
        let both = a.union(b);
        for cone in [a, b] {
            let half = cone.cos.acos() + cone.axis.dot(both.axis).min(1.0).acos();
            assert!(half <= both.cos.acos() + 1e-6);
        }
        assert!(
            a.union(Cone {
                axis: -Vec3::Z,
                cos: 1.0
            })
            .cos < -1.0
        );
        assert!(a.union(Cone::ALL).cos < -1.0);
    }
}
