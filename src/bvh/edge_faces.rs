//! The triangles at an edge, in pairs: what tells by how much depth complexity changes across it.

use glam::Vec3;

use super::TriangleBvh;
use super::packet::plane_side;
use crate::mesh::adjacency::Incident;

/// A triangle at an edge: its number in the order of the leaves, and whether its normal is turned there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EdgeFace(u32);

impl EdgeFace {
    /// No triangle.
    pub const NONE: EdgeFace = EdgeFace(u32::MAX);
    /// Set where the normal is turned; there are fewer triangles than a quarter of what 32 bits count.
    const TURNED: u32 = 1 << 31;

    fn new(leaf: u32, turned: bool) -> Self {
        EdgeFace(leaf | if turned { Self::TURNED } else { 0 })
    }

    /// On which side of the triangle a point is, exactly: 1 where the edge's normal points to, -1 behind it, 0 in
    /// its plane or where there is no triangle.
    pub fn side(self, bvh: &TriangleBvh, p: Vec3) -> i16 {
        if self == Self::NONE {
            return 0;
        }
        let under = plane_side(&bvh.corners[(self.0 & !Self::TURNED) as usize], p);
        let side = i16::from(under < 0.0) - i16::from(under > 0.0);
        if self.0 & Self::TURNED != 0 {
            -side
        } else {
            side
        }
    }
}

/// A triangle that owns an edge, the edge's normals and its triangles.
pub(super) type Pair = (u32, [Vec3; 2], [EdgeFace; 2]);

/// The triangles at an edge in pairs whose normals are to the same side where the surface goes on: what runs
/// forwards with what runs backwards, then what is left among itself, one of them turned, and one alone. Nearly
/// always that is one pair.
///
/// `leaf` gives a triangle's place among the leaves, `normals` theirs. Triangles without area are not seen; where
/// nothing but pairs would be left, an edge of no triangle keeps those from being missed that rounding hits.
pub(super) fn pairs(
    incident: &[Incident],
    leaf: impl Fn(u32) -> u32,
    normals: &[Vec3],
) -> (Option<Pair>, Vec<Pair>) {
    let proper = |leaf: u32| normals[leaf as usize] != Vec3::ZERO;
    if let [a, b] = incident
        && a.forward != b.forward
    {
        let (f, b) = if a.forward { (a, b) } else { (b, a) };
        let (f, b) = (leaf(f.face), leaf(b.face));
        if proper(f) && proper(b) {
            return (
                Some(pair(normals, Some((f, false)), Some((b, false)))),
                Vec::new(),
            );
        }
    }
    let sorted = |forward: bool| {
        let chosen = incident.iter().filter(|at| at.forward == forward);
        let leaves = chosen.map(|at| leaf(at.face));
        leaves.filter(|&leaf| proper(leaf)).collect::<Vec<u32>>()
    };
    let (forwards, backwards) = (sorted(true), sorted(false));
    let both = forwards.len().min(backwards.len());
    let mut out = Vec::new();
    for (&f, &b) in forwards.iter().zip(&backwards) {
        out.push(pair(normals, Some((f, false)), Some((b, false))));
    }
    for two in forwards[both..].chunks(2) {
        let other = two.get(1).map(|&f| (f, true));
        out.push(pair(normals, Some((two[0], false)), other));
    }
    for two in backwards[both..].chunks(2) {
        let other = two.get(1).map(|&b| (b, true));
        out.push(pair(normals, other, Some((two[0], false))));
    }
    let count = forwards.len() + backwards.len();
    if count.is_multiple_of(2) && count < incident.len() {
        let owner = incident.iter().map(|at| leaf(at.face)).min();
        out.extend(owner.map(|owner| (owner, [Vec3::ZERO; 2], [EdgeFace::NONE; 2])));
    }
    (None, out)
}

/// Two triangles, each turned or not, or one.
fn pair(normals: &[Vec3], one: Option<(u32, bool)>, two: Option<(u32, bool)>) -> Pair {
    let faces =
        [one, two].map(|at| at.map_or(EdgeFace::NONE, |(f, turned)| EdgeFace::new(f, turned)));
    let normals = [one, two].map(|at| match at {
        Some((f, turned)) => normals[f as usize] * if turned { -1.0 } else { 1.0 },
        None => Vec3::ZERO,
    });
    let owner = one.into_iter().chain(two).map(|(f, _)| f).min();
    (owner.unwrap_or(u32::MAX), normals, faces)
}
