//! The `light` falloff: the part of the light that an edge cuts off, in closed form.
//!
//! Seen from a receiver, the silhouette is drawn onto the light, and the light that it covers is summed
//! edge by edge (Green's theorem in polar coordinates about the light's centre `o`): with `H` the layers
//! that hide the centre, a contour covers
//!
//! ```text
//!     H + Σ ± |part of the light in the sector of the edge, beyond the edge as seen from o|
//! ```
//!
//! positive where the receiver is on the lit side of the plane through the edge and `o`, negative on the
//! other. An edge that does not cross the light as the receiver sees it adds nothing: the receivers where
//! it does are the edge's penumbra wedge. For one long edge this is the area that a line cuts off. The sum
//! needs no side planes and has no seams: at a vertex the neighbours' sectors meet, however many edges
//! there are, and an edge that points at the light spans no sector.
//!
//! For a line at distance `h` from `o` and its part from `t0` to `t1` within the light, the area beyond is
//! the light's sector less the triangle `h (t1 - t0) / 2`. The sector of a disk is half an angle; of a
//! square with half-edge 1, half the way along its border. A rectangle is a square and a sphere a disk in
//! coordinates of their own: per receiver a matrix maps directions to homogeneous coordinates on the light
//! (for a sphere, on the disk that its outline spans).
//!
//! A polygon lies in the square, and is measured by its sides (`polygon.rs`).
//!
//! Under a large light most edges lie between two vertices that both hide points of the light (`Inner` in `sector.rs`).
//! Along a chain of those, sectors add up to the one between the first vertex and the last, and a whole number
//! of turns; only the triangles are left to sum.

use fearless_simd::{dispatch, f32x16, prelude::*};

use super::block::{LightFrame, ReceiverBlock};
use super::edge::AreaEdge;
use super::polygon::FlatPolygon;
use super::sector::{EdgeOnLight, Inner, Stored, VertexOnLight, turn};
use crate::simd::{Lanes, Row, detect};

/// What [`cover`] works on, kept between calls.
#[derive(Debug, Clone, Default)]
pub struct AreaScratch {
    /// The receivers.
    pub block: ReceiverBlock,
    /// Edges between its two steps.
    lines: [Pending; BATCH],
}

/// Adds what the edges `ids` cover for a block: front layers and back layers. `steps` is the number of
/// intensities that an edge's share is rounded to, 0 for none.
pub fn cover(
    frame: &LightFrame,
    edges: &[AreaEdge],
    ids: &[u32],
    scratch: &mut AreaScratch,
    steps: f32,
    out: &mut [Row; 2],
) {
    let (square, polygon) = match frame {
        LightFrame::Flat {
            square, polygon, ..
        } => (*square, polygon.as_ref()),
        LightFrame::Sphere { .. } => (false, None),
    };
    let unit = UnitLight { square, polygon };
    dispatch!(detect(), simd => cover_lanes(simd, unit, edges, ids, scratch, steps, out));
}

/// The light in its own coordinates: the unit disk or the square, or a polygon in the square.
#[derive(Clone, Copy)]
struct UnitLight<'a> {
    square: bool,
    polygon: Option<&'a FlatPolygon>,
}

#[inline(always)]
fn cover_lanes<S: Simd>(
    simd: S,
    unit: UnitLight<'_>,
    edges: &[AreaEdge],
    ids: &[u32],
    scratch: &mut AreaScratch,
    steps: f32,
    out: &mut [Row; 2],
) {
    let AreaScratch {
        block,
        lines: drawn,
    } = scratch;
    let square = unit.square;
    let mut lines = [out[0].load(simd), out[1].load(simd)];
    let mut pending = 0;
    let mut chain = Chain::new(simd, square);
    let mut last = u32::MAX;
    for &id in ids {
        let edge = &edges[id as usize];
        let follows = edge.follows && id == last.wrapping_add(1);
        last = id;
        let a = match chain.end {
            Some(end) if follows => end,
            _ => {
                chain.finish();
                VertexOnLight::new(simd, block, &edge.ends[0], square)
            }
        };
        let b = VertexOnLight::new(simd, block, &edge.ends[1], square);
        // Shares that are rounded one by one cannot be summed first, and vertices in the square may be beside a polygon.
        let alone = steps > 0.0 || unit.polygon.is_some();
        let inner = if alone { 0 } else { a.inside & b.inside };
        chain.extend(&a, &b, inner, block, edge);
        let open = !(inner | a.misses(&b, square));
        if open != 0
            && let Some(line) = EdgeOnLight::new(simd, block, &a, &b, edge.vector, open, square)
        {
            let shadow_side = !block.lit(edge);
            let next = &mut drawn[pending];
            next.line.set(&line);
            (next.shadow_side, next.weights) = (shadow_side, edge.weights);
            pending += 1;
            if pending == BATCH {
                measure(simd, drawn, unit, steps, &mut lines);
                pending = 0;
            }
        }
    }
    chain.finish();
    measure(simd, &drawn[..pending], unit, steps, &mut lines);
    let scale = f32x16::splat(simd, 1.0 / turn(square));
    out[0].set(lines[0] + chain.sum[0] * scale);
    out[1].set(lines[1] + chain.sum[1] * scale);
}

/// Edges that follow each other.
///
/// What a receiver gets is summed term by term in the order of edges, so that neither culling nor the other
/// receivers of a block change a bit.
struct Chain<S: Simd> {
    square: bool,
    /// Front and back layers that its last edge counts.
    weights: [f32; 2],
    /// Its last vertex.
    end: Option<VertexOnLight<S>>,
    /// Lanes in which its last edge is an [`Inner`] one.
    inner: u16,
    /// Front and back layers that inner edges cover, of this chain and those before, in units of [`turn`].
    sum: [f32x16<S>; 2],
}

impl<S: Simd> Chain<S> {
    /// An empty one.
    #[inline(always)]
    fn new(simd: S, square: bool) -> Self {
        Chain {
            square,
            weights: [0.0; 2],
            end: None,
            inner: 0,
            sum: [f32x16::splat(simd, 0.0); 2],
        }
    }

    /// Adds the edge from its end `a` to `b` for the lanes `inner`.
    #[inline(always)]
    fn extend(
        &mut self,
        a: &VertexOnLight<S>,
        b: &VertexOnLight<S>,
        inner: u16,
        block: &ReceiverBlock,
        edge: &AreaEdge,
    ) {
        self.weights = edge.weights;
        self.bound(a, self.inner & !inner, inner & !self.inner);
        if inner != 0 {
            let part = Inner::new(a, b, inner, block, edge);
            self.add(0.0 - part.twice_triangle, inner);
            if part.more | part.less != 0 {
                let turn = f32x16::splat(part.twice_triangle.simd, turn(self.square));
                self.add(turn, part.more);
                self.add(-turn, part.less);
            }
        }
        (self.inner, self.end) = (inner, Some(*b));
    }

    /// Lets inner edges end at a vertex in some lanes and start in others.
    #[inline(always)]
    fn bound(&mut self, at: &VertexOnLight<S>, ends: u16, starts: u16) {
        if ends | starts != 0 {
            let around = at.around(self.square);
            let signed = around.where_bits(ends, 0.0 - around);
            self.add(signed, ends | starts);
        }
    }

    /// Adds a term in some lanes.
    #[inline(always)]
    fn add(&mut self, term: f32x16<S>, lanes: u16) {
        let term = term.where_bits(lanes, 0.0);
        self.sum[0] += term * self.weights[0];
        self.sum[1] += term * self.weights[1];
    }

    /// Ends it.
    #[inline(always)]
    fn finish(&mut self) {
        if let Some(end) = self.end.take() {
            self.bound(&end, self.inner, 0);
            self.inner = 0;
        }
    }
}

/// Edges that are first drawn onto the light and then measured: each step for an edge is a chain of
/// operations that wait for each other, and a processor looks only so many instructions ahead for others.
/// Few enough to stay in the nearest cache.
const BATCH: usize = 16;

/// An edge drawn onto the light.
#[derive(Debug, Clone, Copy, Default)]
struct Pending {
    line: Stored,
    /// Lanes whose receiver is on the shadow side of the plane through edge and centre.
    shadow_side: u16,
    /// Front and back layers that it counts.
    weights: [f32; 2],
}

/// Adds what edges cut off.
#[inline(always)]
fn measure<S: Simd>(
    simd: S,
    lines: &[Pending],
    unit: UnitLight<'_>,
    steps: f32,
    out: &mut [f32x16<S>; 2],
) {
    for pending in lines {
        let UnitLight { square, polygon } = unit;
        let line = pending.line.line(simd);
        let beyond = line.beyond(square, polygon, pending.shadow_side);
        let beyond = if steps > 0.0 {
            let magic = f32x16::splat(simd, 12_582_912.0);
            let rounded = beyond * steps + magic - magic;
            rounded / steps
        } else {
            beyond
        };
        let signed = (0.0 - beyond).where_bits(pending.shadow_side, beyond);
        let [front, back] = pending.weights;
        out[0] += signed * front;
        out[1] += signed * back;
    }
}

#[cfg(test)]
mod tests {
    use super::super::edge::area_edges;
    use super::super::volume::VolumeQuad;
    use super::*;
    use crate::casters::edges::Edge;
    use crate::light::Light;
    use crate::simd::LANES;
    use glam::DVec3;
    use proptest::prelude::*;

    /// A closed contour of one front layer.
    fn contour(points: &[[f64; 2]], height: f64) -> Vec<Edge> {
        let n = points.len();
        let at = |i: usize| DVec3::new(points[i % n][0], points[i % n][1], height);
        let edge = |i: usize| Edge {
            ends: [at(i), at(i + 1)],
            vertices: [i as u32, ((i + 1) % n) as u32],
            front: 1,
            back: 0,
            object: 0,
        };
        (0..n).map(edge).collect()
    }

    fn covered(edges: &[Edge], light: &Light, p: &[DVec3], steps: f32) -> [f32; LANES] {
        let quads: Vec<VolumeQuad> = edges
            .iter()
            .map(|e| VolumeQuad::hard(e, light.center()))
            .collect();
        let kernel = area_edges(edges, &quads, light);
        let frame = LightFrame::new(light);
        let ids: Vec<u32> = (0..edges.len() as u32).collect();
        let (mut scratch, mut out) = (AreaScratch::default(), [Row::default(); 2]);
        scratch.block.set(&frame, p);
        cover(&frame, &kernel, &ids, &mut scratch, steps, &mut out);
        out[0].0
    }

    fn lights() -> [Light; 3] {
        let up = 1.5 * DVec3::Z;
        [
            Light::disk(up, -DVec3::Z, 0.5, [1.0; 3]).expect("valid"),
            Light::rect(up, DVec3::X, -0.8 * DVec3::Y, [1.0; 3]).expect("valid"),
            Light::sphere(up, 0.5, [1.0; 3]).expect("valid"),
        ]
    }

    proptest! {
        /// Rounded to steps, every edge is measured by itself: what chains leave out must be what cancels.
        /// Points on a grid make edges pass through the centre, and vertices meet it, as some receivers see it.
        #[test]
        fn chains_cover_what_their_edges_cover_one_by_one(
            grid in prop::collection::vec(prop::array::uniform2(-8i8..=8), 3..12),
            shift in prop::array::uniform2(-0.2..0.2),
            x in prop::collection::vec(-0.3..0.3, LANES),
        ) {
            let points: Vec<_> = grid.iter().map(|p| p.map(|x| f64::from(x) / 16.0)).collect();
            let receivers: Vec<DVec3> = x.iter().map(|&x| DVec3::new(x + shift[0], shift[1], 0.0)).collect();
            let edges = contour(&points, 0.75);
            for light in lights() {
                let once = covered(&edges, &light, &receivers, 0.0);
                let alone = covered(&edges, &light, &receivers, 1e6);
                for (once, alone) in once.into_iter().zip(alone) {
                    // Half a step and some ulps of half a turn an edge.
                    prop_assert!((once - alone).abs() < 2e-6 * edges.len() as f32, "{once} {alone}");
                }
            }
        }
    }

    proptest! {
        /// Sides of an outline, and what is known of a square: two ways to the same area.
        #[test]
        fn a_square_is_covered_as_the_polygon_that_it_is(
            grid in prop::collection::vec(prop::array::uniform2(-8i8..=8), 3..12),
            x in prop::collection::vec(-0.3..0.3, LANES),
        ) {
            let points: Vec<_> = grid.iter().map(|p| p.map(|x| f64::from(x) / 16.0)).collect();
            let receivers: Vec<DVec3> = x.iter().map(|&x| DVec3::new(x + 0.01, 0.02 - x, 0.0)).collect();
            let edges = contour(&points, 0.75);
            let corners = [(-0.5, -0.4), (-0.5, 0.4), (0.5, 0.4), (0.5, -0.4)];
            let corners = corners.map(|(x, y)| DVec3::new(x, y, 1.5));
            let polygon = Light::polygon(&corners, [1.0; 3]).expect("valid");
            let both = [&polygon, &lights()[1]].map(|light| covered(&edges, light, &receivers, 0.0));
            for (own, square) in both[0].into_iter().zip(both[1]) {
                // Some ulps of half the light an edge.
                prop_assert!((own - square).abs() < 1e-6 * edges.len() as f32, "{own} {square}");
            }
        }
    }

    #[test]
    fn a_polygon_within_the_light_covers_its_area() {
        // A star around the centre's shadow, wound so that it occludes its inside.
        let star: Vec<[f64; 2]> = (0..40)
            .map(|i| {
                let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 40.0).sin_cos();
                let r = if i % 2 == 0 { 0.2 } else { 0.1 };
                [r * cos, r * sin]
            })
            .collect();
        let area = 20.0 * 0.2 * 0.1 * (std::f64::consts::TAU / 40.0).sin();
        let edges = contour(&star, 0.75);
        let [disk, rect, _] = lights();
        for (light, all) in [(disk, std::f64::consts::PI * 0.25), (rect, 0.8)] {
            // From the middle the centre is hidden: one layer less the light around the polygon.
            let hidden = covered(&edges, &light, &[DVec3::ZERO], 0.0)[0];
            // Drawn onto the light, twice as large.
            let expected = 4.0 * area / all - 1.0;
            assert!(
                (f64::from(hidden) - expected).abs() < 1e-6,
                "{hidden} {expected}"
            );
            // From aside, the centre is free.
            let aside = covered(&edges, &light, &[DVec3::new(0.42, 0.0, 0.0)], 0.0)[0];
            let inside = f64::from(aside);
            assert!(
                inside > 0.0 && inside <= 4.0 * area / all + 1e-6,
                "{inside}"
            );
        }
    }

    #[test]
    fn edges_are_put_into_chains() {
        let edges = contour(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], 1.0);
        let mixed = [edges[2], edges[0], edges[3], edges[1]];
        let starts = |e: &[Edge]| e.iter().map(|e| e.vertices[0]).collect::<Vec<_>>();
        assert_eq!(
            starts(&crate::casters::edges::in_chains(&mixed)),
            [2, 3, 0, 1]
        );
        // One that bounds other layers does not continue a chain.
        let other = Edge {
            front: 2,
            ..edges[1]
        };
        let mixed = [edges[2], edges[0], edges[3], other];
        let chains = crate::casters::edges::in_chains(&mixed);
        assert_eq!(starts(&chains), [2, 3, 0, 1]);
        let quads: Vec<VolumeQuad> = chains
            .iter()
            .map(|e| VolumeQuad::hard(e, 2.0 * DVec3::Z))
            .collect();
        let kernel = area_edges(&chains, &quads, &lights()[2]);
        assert_eq!(
            kernel.iter().map(|e| e.follows).collect::<Vec<_>>(),
            [false, true, true, false]
        );
    }
}
