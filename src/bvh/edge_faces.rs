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

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles at an edge, each in front of the receiver or behind it, forward or not.
    fn change(at: &[(bool, bool)], normals: &[Vec3]) -> i16 {
        let incident: Vec<Incident> = (0u32..)
            .zip(at)
            .map(|(face, &(forward, _))| Incident {
                face,
                opposite: 2,
                forward,
            })
            .collect();
        let (one, more) = pairs(&incident, |face| face, normals);
        let side = |normal: Vec3| normal.z as i16;
        let all = one.into_iter().chain(more);
        all.map(|(_, [one, two], _)| side(one) - side(two)).sum()
    }

    #[test]
    fn pairs_change_counts_by_as_much_as_all_triangles_one_by_one() {
        for code in 0u32..1 << 10 {
            let at: Vec<(bool, bool)> = (0..1 + code % 5)
                .map(|k| (code >> (2 * k) & 1 == 1, code >> (2 * k + 1) & 1 == 1))
                .collect();
            // Seen along z, a normal's z is the triangle's side; the third has no area.
            let normals: Vec<Vec3> = at
                .iter()
                .enumerate()
                .map(|(k, &(_, front))| match (k, front) {
                    (2, _) => Vec3::ZERO,
                    (_, true) => Vec3::Z,
                    (_, false) => Vec3::NEG_Z,
                })
                .collect();
            let one_by_one: i16 = at
                .iter()
                .zip(&normals)
                .map(|(&(forward, _), n)| if forward { n.z as i16 } else { -n.z as i16 })
                .sum();
            assert_eq!(change(&at, &normals), one_by_one, "{at:?}");
        }
    }

    #[test]
    fn an_edge_of_triangles_without_area_is_kept() {
        let alone = |n: usize| {
            let at = vec![(true, true); n];
            let incident: Vec<Incident> = (0u32..)
                .zip(&at)
                .map(|(face, _)| Incident {
                    face,
                    opposite: 2,
                    forward: face == 0,
                })
                .collect();
            let (one, more) = pairs(&incident, |face| face, &vec![Vec3::ZERO; n]);
            assert!(one.is_none());
            more.len()
        };
        assert_eq!([alone(1), alone(2)], [1, 1]);
    }
}
