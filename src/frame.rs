//! The local frame of a scene: where its origin is, and what its unit is.
//!
//! `f32` is relative, so that what is small loses nothing if it is near the origin, however large the rest
//! is; and what is said in units, such as how far rays start off a surface, has to be small for what is
//! small. In most scenes the origin is the middle of the bounds, and the unit their half. Where half of what
//! there is, counted in triangles that weigh as much as they are small, is within a part in `GAP` of that (a
//! house on a plain without end), origin and unit are those of this half, the *core*, and other local
//! coordinates are large. What is not held even so is an error (`check`).

mod spread;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::memory;

/// The map between world and local coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// World position of the local origin.
    pub origin: DVec3,
    /// World units in a local unit, a power of two.
    pub unit: f64,
    /// Whether the scene is larger than its core, and local coordinates may be beyond 1.
    pub is_core: bool,
    /// How far the rounding of corners moves a surface along its normal (local units), where that may be
    /// more than of surfaces within 1; otherwise 0.
    pub rounding: f64,
}

impl Frame {
    /// A frame in which all coordinates are within 1.
    pub fn new(origin: DVec3, unit: f64) -> Frame {
        Frame {
            origin,
            unit,
            is_core: false,
            rounding: 0.0,
        }
    }

    /// World position to local position.
    pub fn to_local(&self, p: DVec3) -> DVec3 {
        (p - self.origin) / self.unit
    }

    /// World direction or edge vector to local.
    pub fn vector_to_local(&self, v: DVec3) -> DVec3 {
        v / self.unit
    }

    /// Local position to world position.
    pub fn to_world(&self, p: DVec3) -> DVec3 {
        p * self.unit + self.origin
    }

    /// A frame for what is around `origin` within `radius`.
    pub(crate) fn around(origin: DVec3, radius: f64) -> Frame {
        Frame {
            origin,
            unit: power_above(ROOM * radius),
            is_core: true,
            rounding: 0.0,
        }
    }
}

/// How far a light point is moved off the light, times the largest of its coordinates and 1 (local
/// units): four `f32` ulps, more than the rounding of its coordinates.
pub const POINT_OFFSET: f64 = 4.0 / (1 << 23) as f64;

/// How many times larger than its core's unit a scene is that gets a frame of its core: below, offsets of
/// a few `f32` ulps of the scene are a few hundred-thousandths of the core.
const GAP: f64 = 64.0;

/// How many radii of the core its unit is: what is around it is looked at as well.
const ROOM: f64 = 4.0;

/// Most units in a scene: the product of four coordinates is still an `f32`.
pub const LARGEST: f64 = (1u64 << 30) as f64;

/// Part of its size by which rounding may move an entry's vertices.
pub(crate) const MOVED: f64 = 1.0 / 8.0;

/// Local units by which rounding may move a surface near the core: a 64th of the core's radius.
pub(crate) const ROUNDED: f64 = 1.0 / (64.0 * ROOM);

/// Twice a triangle's area over its squared size, below which it has no plane.
const FLAT: f64 = 1e-6;

/// Bins along an axis in which a core is looked for.
const BINS: usize = 1024;

/// Bins that a core is within: its radius on both sides of its middle, and a bin for where these begin.
const WINDOW: usize = (BINS as f64 / (GAP * ROOM)) as usize + 2;

/// Triangles that a task counts.
const CHUNK: usize = 4096;

/// Tasks whose bins, 24 kB each, are kept at the same time.
const COUNTED: usize = 512;

/// Triangles of a mesh in world coordinates, or spheres.
#[derive(Clone, Copy)]
pub(crate) enum Solid<'a> {
    /// Vertices and faces.
    Mesh(&'a [DVec3], &'a [[u32; 3]]),
    /// Vertices and faces of an instance in object space, where it is placed, and its bounds there.
    Placed(&'a [DVec3], &'a [[u32; 3]], DAffine3, (DVec3, DVec3)),
    /// Centres and radii.
    Spheres(&'a [(DVec3, f64)]),
}

impl<'a> Solid<'a> {
    fn len(&self) -> usize {
        match self {
            Solid::Mesh(_, faces) | Solid::Placed(_, faces, ..) => faces.len(),
            Solid::Spheres(spheres) => spheres.len(),
        }
    }

    /// Corners of a triangle; spheres have none.
    fn corners(&self, i: usize) -> Option<[DVec3; 3]> {
        match self {
            Solid::Mesh(vertices, faces) => Some(faces[i].map(|v| vertices[v as usize])),
            Solid::Placed(vertices, faces, transform, _) => {
                Some(faces[i].map(|v| transform.transform_point3(vertices[v as usize])))
            }
            Solid::Spheres(_) => None,
        }
    }

    /// Bounds of a triangle or a sphere.
    fn bounds(&self, i: usize) -> (DVec3, DVec3) {
        if let Some([a, b, c]) = self.corners(i) {
            return (a.min(b).min(c), a.max(b).max(c));
        }
        let Solid::Spheres(spheres) = self else {
            return (DVec3::INFINITY, DVec3::NEG_INFINITY);
        };
        let (center, radius) = spheres[i];
        (center - radius, center + radius)
    }

    /// Bounds of all.
    fn all(&self) -> (DVec3, DVec3) {
        if let Solid::Placed(.., bounds) = self {
            return *bounds;
        }
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let union = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        let all = (0..self.len()).into_par_iter().map(|i| self.bounds(i));
        all.reduce(|| none, union)
    }

    /// Its size.
    fn size(&self) -> f64 {
        let (low, high) = self.all();
        (high - low).max_element()
    }
}

/// The smallest power of two that is not below `x`.
fn power_above(x: f64) -> f64 {
    let power = x.log2().ceil().exp2();
    // `log2` may round down at a power of two.
    if power < x { power * 2.0 } else { power }
}

/// The frame of a scene within `low` and `high`.
///
/// # Errors
/// More triangles than there is memory to look for a core among.
pub(crate) fn choose(low: DVec3, high: DVec3, solids: &[Solid]) -> Result<Frame> {
    let unit = power_above((0.5 * high - 0.5 * low).max_element());
    let whole = Frame::new(0.5 * low + 0.5 * high, unit);
    let placed = solids.iter().any(|s| matches!(s, Solid::Placed(..)));
    if placed && spread::has_no_core(&whole, solids, WINDOW) || !may_have_core(&whole, solids) {
        return Ok(whole);
    }
    let count: usize = solids.iter().map(Solid::len).sum();
    let bytes = count * size_of::<(DVec3, f64, f64)>();
    let what = || "scene: finding where most of it is, which is far smaller than all of it,".into();
    memory::check(what, bytes)?;
    Ok(core(&whole, solids).unwrap_or(whole))
}

/// Bounds of a triangle or a sphere, and what it weighs: the less the larger it is. A part of an entry that is much
/// smaller than the entry weighs no more than its [`PARTS`]th part, or a speck would outweigh all else; what is no more than a
/// point at the scene's scale, and what has no area, has no weight.
fn weighed(whole: &Frame, solid: &Solid, entry: f64, i: usize) -> (DVec3, DVec3, f64) {
    let corners = solid.corners(i);
    let (low, high) = match corners {
        Some([a, b, c]) => (a.min(b).min(c), a.max(b).max(c)),
        None => solid.bounds(i),
    };
    let size = (high - low).max_element();
    // No area to speak of.
    let is_flat = |[a, b, c]: [DVec3; 3]| ((b - a) / size).cross((c - a) / size).length() <= FLAT;
    let weight = if size / whole.unit * LARGEST < 1.0 || corners.is_some_and(is_flat) {
        0.0
    } else {
        whole.unit / size.max(entry / PARTS)
    };
    (low, high, weight)
}

/// Into how many parts an entry may be divided for each to weigh more.
const PARTS: f64 = 16.0;

/// Whether half of all weight may be within a core: whether it is along each axis. Cheap, since few scenes
/// have one.
fn may_have_core(whole: &Frame, solids: &[Solid]) -> bool {
    let parts = solids.iter().flat_map(|solid| {
        let (starts, size) = ((0..solid.len()).step_by(CHUNK), solid.size());
        starts.map(move |start| (solid, size, start..(start + CHUNK).min(solid.len())))
    });
    let parts: Vec<_> = parts.collect();
    let count = |(solid, size, range): &(&Solid, f64, std::ops::Range<usize>)| {
        let mut bins = vec![[0.0; 3]; BINS];
        for i in range.clone() {
            let (low, high, weight) = weighed(whole, solid, *size, i);
            let middle = whole.to_local(0.5 * low + 0.5 * high);
            for axis in 0..3 {
                let bin = (0.5 * (middle[axis] + 1.0) * BINS as f64) as usize;
                bins[bin.min(BINS - 1)][axis] += weight;
            }
        }
        bins
    };
    let mut sums = vec![[0.0; 3]; BINS];
    for parts in parts.chunks(COUNTED) {
        let counted: Vec<Vec<[f64; 3]>> = parts.par_iter().map(count).collect();
        // In this order whatever the number of threads.
        for bins in &counted {
            for (sum, bin) in sums.iter_mut().zip(bins) {
                (0..3).for_each(|axis| sum[axis] += bin[axis]);
            }
        }
    }
    (0..3).all(|axis| {
        let all: f64 = sums.iter().map(|s| s[axis]).sum();
        let within = |window: &[[f64; 3]]| window.iter().map(|s| s[axis]).sum::<f64>();
        // A part in a million for the sums' rounding; what is all flat has no core.
        all > 0.0 && sums.windows(WINDOW).any(|w| within(w) >= 0.499_999 * all)
    })
}

/// Frame of the core, if there is one.
fn core(whole: &Frame, solids: &[Solid]) -> Option<Frame> {
    let mut all: Vec<(DVec3, f64, f64)> = Vec::new();
    for solid in solids {
        let size = solid.size();
        let of = |i: usize| {
            let (low, high, weight) = weighed(whole, solid, size, i);
            let half = 0.5 * (high - low).max_element();
            (0.5 * low + 0.5 * high, half, weight)
        };
        all.par_extend((0..solid.len()).into_par_iter().map(of));
    }
    all.retain(|a| a.2 > 0.0);
    let origin = DVec3::from_array([0, 1, 2].map(|axis| {
        let along = all.iter().map(|a| (a.0[axis], a.2));
        median(along.collect())
    }));
    let reach = |a: &(DVec3, f64, f64)| ((a.0 - origin).abs().max_element() + a.1, a.2);
    let radius = median(all.iter().map(reach).collect());
    let frame = Frame::around(origin, radius.max(whole.unit / LARGEST));
    (frame.unit * GAP <= whole.unit).then_some(frame)
}

/// The value below which there is half of the weight.
fn median(mut values: Vec<(f64, f64)>) -> f64 {
    values.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let half = 0.5 * values.iter().map(|v| v.1).sum::<f64>();
    let mut below = 0.0;
    for (value, weight) in &values {
        below += weight;
        if below >= half {
            return *value;
        }
    }
    values.last().map_or(0.0, |v| v.0)
}

/// Adds to a frame how far surfaces are moved, and checks that `f32` holds what is called `name`.
///
/// # Errors
/// Vertices that are moved by more than [`MOVED`] of an entry's size; triangles near the core that are moved by
/// more than [`ROUNDED`].
pub(crate) fn check(
    frame: &mut Frame,
    solids: &[Solid],
    name: impl Fn(usize) -> String,
) -> Result<()> {
    let local = |p: DVec3| frame.to_local(p);
    let moved = |p: DVec3| local(p).as_vec3().as_dvec3() - local(p);
    let mut rounding = 0.0f64;
    for (entry, solid) in solids.iter().enumerate() {
        let (low, high) = solid.all();
        let size = (high - low).max_element() / frame.unit;
        let far = local(low).abs().max(local(high).abs()).max_element();
        // At most half an ulp; most are far better, and then nothing is to be looked at.
        if far * f64::from(f32::EPSILON) > MOVED * size {
            // Spheres are in f64.
            let of = |i: usize| {
                let d = solid.corners(i);
                d.map_or(0.0, |d| {
                    let d = d.map(|v| moved(v).abs().max_element());
                    d[0].max(d[1]).max(d[2])
                })
            };
            let most = (0..solid.len()).into_par_iter().map(of);
            let most = most.reduce(|| 0.0, f64::max);
            if most > MOVED * size && size > 0.0 {
                let reason = format!(
                    "at {:.3e} from where most of the scene is, single precision moves its vertices by \
                     {:.3e}, more than an eighth of its size, {:.3e}; what is so small has to be nearer",
                    far * frame.unit,
                    most * frame.unit,
                    size * frame.unit,
                );
                return Err(Error::scene(name(entry), reason));
            }
        }
        if !frame.is_core {
            continue;
        }
        let of = |i: usize| {
            let Some(world) = solid.corners(i) else {
                return 0.0;
            };
            let [a, b, c] = world.map(local);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let normal = (b - a).cross(c - a);
            let size = (high - low).max_element();
            let near = low.max_element() <= 1.0 && high.min_element() >= -1.0;
            // What has no area has no plane that could move.
            if !near || normal.length() <= FLAT * size * size {
                return 0.0;
            }
            let normal = normal.normalize();
            let along = world.map(|v| normal.dot(moved(v)).abs());
            along[0].max(along[1]).max(along[2])
        };
        let most = (0..solid.len()).into_par_iter().map(of);
        let most = most.reduce(|| 0.0, f64::max);
        if most > ROUNDED {
            let reason = format!(
                "it is so large that single precision moves its surface by {:.3e}; around what is small in \
                 the scene {:.3e} are allowed: make it smaller, divide it, or lay it along the axes",
                most * frame.unit,
                ROUNDED * frame.unit,
            );
            return Err(Error::scene(name(entry), reason));
        }
        rounding = rounding.max(most);
    }
    frame.rounding = rounding;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frame_covers_the_bounds_and_its_unit_is_a_power_of_two() {
        for scale in [1e-30, 1e-6, 0.7, 1.0, 3.0, 1e6, 1e30] {
            let offset = DVec3::new(1e4, -2e4, 3e3) * scale;
            let frame = choose(
                offset - scale,
                offset + DVec3::new(scale, 0.5 * scale, 0.0),
                &[],
            )
            .unwrap();
            let corner = frame.to_local(offset + DVec3::new(scale, 0.0, 0.0));
            assert!((0.5..=1.0).contains(&corner.x), "{scale}: {corner}");
            assert_eq!(frame.unit.log2().fract(), 0.0);
            assert_eq!(frame.to_world(DVec3::ZERO), frame.origin);
        }
    }
}
