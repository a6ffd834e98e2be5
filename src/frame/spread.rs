//! Whether the bounds of a scene's instances tell that it has no core, without a look at each of their triangles.
//!
//! A core has half of all weight within a few bins along each axis. Of an instance, every triangle weighs at most what the
//! smallest parts weigh, and lies within the bounds; and most of its triangles weigh just that, which is known from their
//! mesh whatever the transform. Where the most that a few bins can have is less than half of the least that all have, there
//! is no core.

use std::collections::HashMap;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::{BINS, FLAT, Frame, LARGEST, PARTS, Solid};

/// Largest condition (product of the norms of a matrix and its inverse, 3 for a similarity) of transforms for which it is known
/// that triangles keep an area.
const CONDITION: f64 = 30.0;

/// Classes of triangles by size: each has half the size of the one before.
const CLASSES: usize = 64;

/// How many triangles a mesh has whose longest edge is less than its size over 2^k and at least half of that, and that keep
/// an area under all transforms of [`CONDITION`].
struct Sizes {
    size: f64,
    count: [usize; CLASSES],
}

impl Sizes {
    fn new(vertices: &[DVec3], faces: &[[u32; 3]]) -> Self {
        let corners = |f: &[u32; 3]| f.map(|v| vertices[v as usize]);
        let bounds = |f: &[u32; 3]| {
            let [a, b, c] = corners(f);
            (a.min(b).min(c), a.max(b).max(c))
        };
        let union = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = faces.par_iter().map(bounds).reduce(|| none, union);
        // Longer than any edge.
        let size = 2.0 * (high - low).max_element();
        let class = |f: &[u32; 3]| {
            let [a, b, c] = corners(f).map(|p| p / size);
            let sides = [b - a, c - b, a - c];
            let longest = sides.iter().map(|s| s.length_squared()).fold(0.0, f64::max);
            let solid =
                sides[0].cross(sides[2]).length() > 1.01 * CONDITION * CONDITION * FLAT * longest;
            let class = -0.5 * longest.log2();
            (solid && class < CLASSES as f64).then_some(class as usize)
        };
        let add = |mut count: [usize; CLASSES], class: Option<usize>| {
            if let Some(class) = class {
                count[class] += 1;
            }
            count
        };
        let sum = |a: [usize; CLASSES], b: [usize; CLASSES]| std::array::from_fn(|k| a[k] + b[k]);
        let none = || [0; CLASSES];
        let count = faces
            .par_iter()
            .map(class)
            .fold(none, add)
            .reduce(none, sum);
        Sizes { size, count }
    }

    /// How many triangles are surely no larger than a part of an instance of some size, and have an area and a size at
    /// the scene's scale.
    fn small(&self, whole: &Frame, transform: &DAffine3, size: f64) -> usize {
        let norm = |m: glam::DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
        let inverse = transform.matrix3.inverse_or_zero();
        let (longer, shorter) = (norm(transform.matrix3), norm(inverse));
        let keeps_areas = longer * shorter < CONDITION;
        if inverse == glam::DMat3::ZERO || !keeps_areas {
            return 0;
        }
        let counts = self.count.iter().enumerate();
        let fits = counts.filter(|&(k, _)| {
            let most = self.size * (-(k as f64)).exp2() * longer;
            // Half of it, along the axis of a cube that it is longest along.
            let least = 0.25 * self.size * (-(k as f64)).exp2() / shorter;
            most * 1.01 < size / PARTS && least / whole.unit * LARGEST > 1.01
        });
        fits.map(|(_, count)| count).sum()
    }
}

/// Whether there is no core: no `width` bins along some axis have half of all weight. If not, there may be one.
pub(super) fn has_no_core(whole: &Frame, solids: &[Solid], width: usize) -> bool {
    let mut known: HashMap<*const DVec3, Sizes> = HashMap::new();
    // Differences of what windows have from each bin on.
    let mut most = vec![[0.0; 3]; BINS + 2];
    let mut least = 0.0;
    for solid in solids {
        let (low, high) = solid.all();
        let size = (high - low).max_element();
        let heaviest = whole.unit / (size / PARTS);
        let weight = solid.len() as f64 * heaviest;
        let bin = |x: f64| (0.5 * (x + 1.0) * BINS as f64).clamp(0.0, BINS as f64 - 1.0) as usize;
        let (low, high) = (whole.to_local(low), whole.to_local(high));
        for axis in 0..3 {
            // A bin on either side for rounding.
            let first = bin(low[axis]).saturating_sub(width);
            most[first][axis] += weight;
            most[(bin(high[axis]) + 2).min(BINS)][axis] -= weight;
        }
        if let Solid::Placed(vertices, faces, transform, _) = solid {
            let sizes = known
                .entry(vertices.as_ptr())
                .or_insert_with(|| Sizes::new(vertices, faces));
            least += sizes.small(whole, transform, size) as f64 * heaviest;
        }
    }
    (0..3).any(|axis| {
        let mut within = 0.0;
        let mut largest = 0.0f64;
        for window in &most {
            within += window[axis];
            largest = largest.max(within);
        }
        // Less than a half, for the rounding of all these sums.
        largest < 0.49 * least
    })
}

#[cfg(test)]
mod tests {
    use super::super::{core, may_have_core};
    use super::*;
    use glam::DMat3;

    #[test]
    fn what_is_said_to_have_no_core_has_none() {
        // Triangles are smaller than a sixteenth of the sheet.
        let n = 100;
        let vertex = |i: u32| {
            let (x, y) = (f64::from(i % (n + 1)), f64::from(i / (n + 1)));
            DVec3::new(x, y, (x * 0.7).sin() * (y * 0.4).cos()) / f64::from(n)
        };
        let vertices: Vec<DVec3> = (0..(n + 1) * (n + 1)).map(vertex).collect();
        let faces: Vec<[u32; 3]> = (0..n * n)
            .flat_map(|k| {
                let a = k / n * (n + 1) + k % n;
                [[a, a + 1, a + n + 1], [a + 1, a + n + 2, a + n + 1]]
            })
            .collect();
        let mut told = [0; 2];
        for (spread, scale) in [
            (4.0, 1.0),
            (4.0, 1e-3),
            (1e3, 1.0),
            (1e-3, 1.0),
            (300.0, 0.1),
        ] {
            for stretch in [1.0, 8.0, 1e9] {
                let place = |k: i32| {
                    let at = f64::from(k);
                    let at = DVec3::new(at.sin(), (2.3 * at).cos(), (0.7 * at).sin()) * spread;
                    let size = DVec3::new(1.0, stretch, -1.0) * scale;
                    let matrix = DMat3::from_rotation_y(at.x) * DMat3::from_diagonal(size);
                    DAffine3::from_mat3_translation(matrix, at)
                };
                let mut places: Vec<DAffine3> = (0..40).map(place).collect();
                // And one far away from the others.
                places.push(DAffine3::from_translation(DVec3::splat(spread * 100.0)));
                for count in [40, 41] {
                    let bounds = |t: &DAffine3| {
                        vertices
                            .iter()
                            .map(|&v| t.transform_point3(v))
                            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
                                (low.min(p), high.max(p))
                            })
                    };
                    let solids: Vec<Solid> = places[..count]
                        .iter()
                        .map(|t| Solid::Placed(&vertices, &faces, *t, bounds(t)))
                        .collect();
                    let all = solids.iter().map(Solid::all);
                    let (low, high) = all.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap();
                    let unit = super::super::power_above((0.5 * high - 0.5 * low).max_element());
                    let whole = Frame::new(0.5 * low + 0.5 * high, unit);
                    let none = has_no_core(&whole, &solids, super::super::WINDOW);
                    told[usize::from(none)] += 1;
                    if none {
                        assert!(!may_have_core(&whole, &solids));
                        assert!(core(&whole, &solids).is_none());
                    }
                }
            }
        }
        assert!(told.iter().all(|&t| t > 3), "{told:?}");
    }
}
