//! Soft shadow volumes: depth complexity over the light, counted from silhouettes, and one ray a receiver
//! (Laine, Aila, Assarsson, Lehtinen and Akenine-Möller 2005; Lehtinen, Laine and Aila 2006).
//!
//! The number of triangles between a receiver and a light point, its depth complexity, changes from one light point
//! to the next only where the image of a silhouette edge lies between them, and by what the edge's triangles say
//! ([`crate::bvh::outline`]). So the counts of all light points are known up to one constant. A ray to a point of
//! the lowest count finds it: where that is free, points of the lowest count are seen and no others; where it is
//! blocked, none is.
//!
//! - `edges`: the edges that may be silhouettes for a group of neighbouring receivers, from the hierarchy;
//! - `project`: which of them one receiver sees as silhouettes, and where on the light;
//! - `grid`: the light points and their counts;
//! - `within` and `cells`: which receivers are asked where an error is allowed, and what the others have from them.
//!
//! **Any triangles do.** Nothing is asked of a mesh: an edge of many triangles counts as several, a triangle's three
//! edges are told the same side of it (exactly where rounding could decide), and the images of edges that meet share
//! their ends to the bit. A second ray to a point of the next count, which should be blocked, is a check.
//!
//! **Rays answer** for receivers where that cannot be, with `rays` samples each as [`crate::methods::ray_traced`]'s:
//! where a check fails or an edge passes through the receiver, where translucent triangles or analytic spheres are
//! in a group's shaft, for groups with too many edges, in and next to a sphere light that fills most of the
//! hemisphere, and everywhere under a light that a triangle cuts or touches, or that has no size.
//! [`Shading::by_rays`] counts them.
//!
//! Of visibility and irradiance a part of what they are without casters is taken, as large as the share of the light
//! points that are seen; so both are exact where all of the light is seen.

mod cells;
mod edges;
mod grid;
mod project;
mod region;
mod within;

use std::sync::Arc;

use fearless_simd::{Simd, dispatch};
use glam::{DVec3, Vec3};

use crate::adaptive::LEAST_ERROR;
use crate::bvh::outline::touches_light;
use crate::control::Control;
use crate::error::{Result, in_range};
use crate::light::{Light, PolygonLight};
use crate::method::{Irradiance, Method, Prepared, Shading};
use crate::receivers::Receivers;
use crate::sampling::shaft::halves;
use crate::sampling::square::Square;
use crate::sampling::tracing::Tracer;
use crate::sampling::{GRID, LightProjection, LightSamples, MOST_SAMPLES, Pattern, Sampler};
use crate::scene::snapshot::Snapshot;
use crate::simd::detect;
use cells::Cells;
use edges::{Edges, Found};
use grid::{Grid, Layout, Level};
use project::{View, draw_edges};
use within::Within;

/// Parameters of counting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Counted {
    /// Least number of light points.
    pub samples: u32,
    /// Light samples of receivers that rays answer.
    pub rays: u32,
    /// Seed of the light points and samples.
    pub seed: u64,
    /// Root mean square error of visibility that pixels may have since others answer for them; otherwise each is asked.
    pub error: Option<f64>,
}

impl Counted {
    /// Checks the parameters.
    ///
    /// # Errors
    /// What is out of its range.
    pub fn checked(self) -> Result<Self> {
        in_range("Counted", "samples", self.samples, 1..=MOST_SAMPLES)?;
        in_range("Counted", "rays", self.rays, 1..=MOST_SAMPLES)?;
        if let Some(error) = self.error {
            in_range("Counted", "error", error, LEAST_ERROR..=1.0)?;
        }
        Ok(self)
    }
}

impl Method for Counted {
    fn name(&self) -> &'static str {
        "counted"
    }

    fn prepare(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        control.check()?;
        let occluders = geometry.occluders();
        control.check()?;
        let pattern = Pattern::new(self.rays as usize, self.seed);
        let one = Pattern::new(1, self.seed);
        let lights: Vec<PreparedLight> = lights
            .iter()
            .map(|light| {
                let cut = touches_light(&occluders.opaque, light, &mut Vec::new());
                // All samples of a point are one.
                let pattern = if light.is_point() { &one } else { &pattern };
                let sampler = Sampler::new(light.clone(), pattern.clone(), false);
                let count = !cut && !light.is_point();
                PreparedLight {
                    polygon: sampler.polygon().map(PolygonLight::in_square),
                    sampler,
                    count,
                }
            })
            .collect();
        if lights.iter().any(|light| light.count) {
            occluders.opaque.outline(&geometry);
        }
        Ok(Box::new(PreparedCounted {
            geometry,
            lights,
            layout: Layout::new(self.samples),
            seed: Pattern::new(1, self.seed),
            error: self.error,
        }))
    }
}

struct PreparedLight {
    sampler: Sampler,
    /// Whether edges can be counted at all.
    count: bool,
    /// Corners of a polygon in the square in which receivers see it.
    polygon: Option<Vec<[f32; 2]>>,
}

struct PreparedCounted {
    geometry: Arc<Snapshot>,
    lights: Vec<PreparedLight>,
    layout: Layout,
    /// Gives each receiver random words of its own.
    seed: Pattern,
    error: Option<f64>,
}

impl Prepared for PreparedCounted {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let light = &self.lights[light];
        let answers = match (self.error, &receivers.camera) {
            (Some(error), Some(camera)) => {
                self.answer_within(error, receivers, camera, light, control)?
            }
            _ => self.answer_all(receivers, light, control, |_| true)?,
        };
        Ok(Shading {
            visibility: answers.iter().map(|a| a.sums[0]).collect(),
            irradiance: Some(Irradiance::Whole(
                answers.iter().map(|a| a.sums[1]).collect(),
            )),
            by_rays: answers.iter().filter(|a| a.by_rays).count(),
        })
    }

    fn bytes(&self) -> usize {
        self.geometry.occluders().bytes()
    }
}

/// Receivers that share their candidate edges.
struct Group<'a> {
    receivers: &'a Receivers,
    ids: &'a [usize],
    /// Whether these edges are at hand.
    known: bool,
}

/// What is found for a receiver.
#[derive(Debug, Clone, Copy, Default)]
struct Answer {
    /// Visibility and irradiance.
    sums: [f32; 2],
    /// Whether rays to all its light samples found it.
    by_rays: bool,
}

/// What a thread keeps between receivers.
struct Scratch {
    edges: Edges,
    grid: Grid,
    tracer: Tracer,
    samples: LightSamples,
    /// Where the rays of the receivers at hand start.
    origins: Vec<Vec3>,
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
    /// The part of the light above each receiver's tangent plane, and its irradiance without casters.
    unshadowed: Vec<[f32; 2]>,
    pending: Vec<Pending>,
    /// Which receivers are asked, and those that are next.
    cells: Cells,
    wanted: Vec<usize>,
}

impl Scratch {
    fn new(layout: Layout) -> Self {
        Scratch {
            edges: Edges::default(),
            grid: Grid::new(layout),
            tracer: Tracer::default(),
            samples: LightSamples::default(),
            origins: Vec::new(),
            positions: Vec::new(),
            normals: Vec::new(),
            unshadowed: Vec::new(),
            pending: Vec::new(),
            cells: Cells::default(),
            wanted: Vec::new(),
        }
    }

    /// Takes the positions and normals of receivers, and finds what they have without casters.
    fn unshadow(&mut self, receivers: &Receivers, ids: &[usize], light: &Light) {
        self.positions.clear();
        self.normals.clear();
        self.unshadowed.clear();
        let at = |&i: &usize| receivers.positions[i];
        self.positions.extend(ids.iter().map(at));
        self.normals
            .extend(ids.iter().map(|&i| receivers.normals[i]));
        let unshadowed = &mut self.unshadowed;
        light.unshadowed(&self.positions, &self.normals, |_, h, irradiance| {
            unshadowed.push([h as f32, irradiance as f32]);
        });
    }
}

/// A receiver that waits for its rays.
struct Pending {
    /// Its number in the group.
    k: usize,
    /// The ray to a point of the lowest count, and if there are higher ones to a point of the next.
    lowest: u32,
    next: Option<u32>,
    /// What is seen if the first is free.
    sums: [f32; 2],
}

impl PreparedCounted {
    /// Answers for the receivers of groups that are chosen by number; the others have nothing.
    fn answer_all(
        &self,
        receivers: &Receivers,
        light: &PreparedLight,
        control: &Control,
        chosen: impl Fn(usize) -> bool + Sync + Send,
    ) -> Result<Vec<Answer>> {
        receivers.by_groups(
            control,
            Answer::default(),
            || Scratch::new(self.layout),
            |scratch, range, out| {
                if chosen(receivers.group_of(range.start)) {
                    let first = range.start;
                    let mut ids: Vec<usize> = range.collect();
                    self.answer(
                        receivers,
                        &mut ids,
                        light,
                        None,
                        scratch,
                        &mut |i, answer| {
                            out[i - first] = answer;
                        },
                    );
                }
                Ok(())
            },
        )
    }

    /// Answers for any receivers, which share their candidate edges; halves them where there are too many.
    fn answer(
        &self,
        receivers: &Receivers,
        ids: &mut [usize],
        light: &PreparedLight,
        within: Option<&Within>,
        s: &mut Scratch,
        put: &mut impl FnMut(usize, Answer),
    ) {
        s.origins.clear();
        s.origins
            .extend(ids.iter().map(|&i| receivers.ray_origin(i)));
        let found = if light.count {
            s.edges.collect(&self.geometry, &light.sampler, &s.origins)
        } else {
            Found::ByRays
        };
        if let Found::Split(middle) = found
            && let Some(both) = halves(receivers, ids, middle)
        {
            for half in both {
                self.answer(receivers, half, light, within, s, put);
            }
            return;
        }
        let group = Group {
            receivers,
            ids,
            known: found == Found::All,
        };
        if group.known || within.is_some() {
            s.unshadow(receivers, ids, light.sampler.light());
        }
        match within {
            Some(within) => self.answer_cells(&group, light, within, s, put),
            None => {
                let mut put = |k: usize, answer| put(ids[k], answer);
                self.answer_each(&group, 0..ids.len(), light, s, &mut put);
            }
        }
    }

    /// Answers for those receivers of a group that have these numbers.
    fn answer_each(
        &self,
        group: &Group,
        numbers: impl Iterator<Item = usize>,
        light: &PreparedLight,
        s: &mut Scratch,
        put: &mut impl FnMut(usize, Answer),
    ) {
        if group.known {
            self.count_each(group, numbers, light, s, put);
        } else {
            for k in numbers {
                put(k, self.by_rays(group, k, light, s));
            }
        }
    }

    /// Traces all samples of the group's receiver `k`.
    fn by_rays(&self, group: &Group, k: usize, light: &PreparedLight, s: &mut Scratch) -> Answer {
        let (receivers, i) = (group.receivers, group.ids[k]);
        let (p, n) = (s.origins[k].as_dvec3(), receivers.normals[i]);
        light.sampler.fill(receivers.index[i], p, n, &mut s.samples);
        let occluders = self.geometry.occluders();
        let seen = s.samples.valid.iter().any(|&v| v != 0);
        let sums = if seen {
            s.tracer
                .trace_samples(occluders, s.origins[k], &s.samples)
                .both
        } else {
            [0.0; 2]
        };
        Answer {
            sums,
            by_rays: seen,
        }
    }

    /// Counts for those receivers of a group that have these numbers; the group's edges and what its receivers have
    /// without casters are at hand.
    fn count_each(
        &self,
        group: &Group,
        numbers: impl Iterator<Item = usize>,
        light: &PreparedLight,
        s: &mut Scratch,
        put: &mut impl FnMut(usize, Answer),
    ) {
        s.pending.clear();
        for k in numbers {
            let index = group.receivers.index[group.ids[k]];
            if s.unshadowed[k][0] == 0.0 {
                put(k, Answer::default());
                continue;
            }
            match s
                .edges
                .view(k)
                .map(|view| self.count(index, k, &view, light, s))
            {
                Some(Counting::Waits(pending)) => s.pending.push(pending),
                Some(Counting::Nothing) => put(k, Answer::default()),
                Some(Counting::Unclear) | None => put(k, self.by_rays(group, k, light, s)),
            }
        }
        s.tracer.trace(self.geometry.occluders(), &s.origins);
        // Rays that answer for a whole receiver forget those that were traced.
        let mut doubtful = std::mem::take(&mut s.pending);
        doubtful.retain(|waiting| {
            let free = |ray| s.tracer.through(ray) > 0.0;
            let contradicted = waiting.next.is_some_and(free);
            if !contradicted {
                let sums = if free(waiting.lowest) {
                    waiting.sums
                } else {
                    [0.0; 2]
                };
                put(
                    waiting.k,
                    Answer {
                        sums,
                        by_rays: false,
                    },
                );
            }
            contradicted
        });
        for waiting in &doubtful {
            let k = waiting.k;
            put(k, self.by_rays(group, k, light, s));
        }
        s.pending = doubtful;
    }

    /// Counts for the group's receiver `k`, which has this index and sees the light so.
    fn count(
        &self,
        index: u32,
        k: usize,
        view: &LightProjection,
        light: &PreparedLight,
        s: &mut Scratch,
    ) -> Counting {
        let (origin, normal) = (s.origins[k], s.normals[k]);
        let unshadowed = s.unshadowed[k];
        let p = origin.as_dvec3();
        let blocks = s.edges.blocks();
        if blocks.is_empty() && unshadowed[0] == 1.0 {
            // Any light point will do; the same for neighbours keeps their rays together.
            let lowest = s.tracer.add(k, MIDDLE, light.sampler.middle(p));
            return Counting::Waits(Pending {
                k,
                lowest,
                next: None,
                sums: unshadowed,
            });
        }
        let square = light.sampler.square(p);
        s.grid.shift(self.seed.scramble(index));
        let cuts = (unshadowed[0] < 1.0).then_some(normal);
        let grid = &mut s.grid;
        if dispatch!(detect(), simd => grid.choose(simd, &square, cuts)) == 0 {
            // Less of the light is above the tangent plane than any light point stands for.
            return Counting::Nothing;
        }
        let seen_so = View::new(origin, view, square.front, &s.grid);
        let bvh = &self.geometry.occluders().opaque;
        s.grid.clear();
        if !draw_edges(blocks, bvh, &seen_so, &mut s.grid) {
            return Counting::Unclear;
        }
        let (grid, polygon) = (&mut s.grid, light.polygon.as_deref());
        let Some(counted) =
            dispatch!(detect(), simd => count_lanes(simd, grid, &square, normal, polygon))
        else {
            return Counting::Nothing;
        };
        let grid = &s.grid;
        let mut ray = |level: &Level| {
            let at = grid.point(level.place);
            let cell = at.map(|x| (x * GRID as f64).clamp(0.0, (GRID - 1) as f64) as u16);
            s.tracer
                .add(k, cell[1] * GRID as u16 + cell[0], square.point(at))
        };
        Counting::Waits(Pending {
            k,
            lowest: ray(&counted.lowest),
            next: counted.next.as_ref().map(ray),
            sums: [0, 1].map(|i| unshadowed[i] * counted.share[i]),
        })
    }
}

/// The middle cell of the grid that rays are sorted by.
const MIDDLE: u16 = (GRID * GRID / 2 + GRID / 2) as u16;

/// What counting finds.
enum Counting {
    /// Rays are to decide.
    Waits(Pending),
    /// No light point is above the tangent plane.
    Nothing,
    /// An edge comes too close.
    Unclear,
}

/// What the counts of a receiver's light points say.
struct Counts {
    lowest: Level,
    next: Option<Level>,
    /// The share of those with the lowest count in visibility and irradiance.
    share: [f32; 2],
}

/// Nothing where no point of the light is above the tangent plane.
#[inline(always)]
fn count_lanes<S: Simd>(
    simd: S,
    grid: &mut Grid,
    square: &Square,
    normal: DVec3,
    polygon: Option<&[[f32; 2]]>,
) -> Option<Counts> {
    let all_alike = |count: i16, grid: &Grid| Counts {
        lowest: Level {
            count,
            place: grid.middle(),
        },
        next: None,
        share: [1.0; 2],
    };
    if !grid.is_changed() {
        // Also of a polygon: no edge is known to cross the square around it.
        return Some(all_alike(0, grid));
    }
    let mut count = grid.count(simd);
    if let Some(corners) = polygon {
        grid.keep_within(corners);
        count = grid.next_level(simd, i16::MIN)?.count;
    }
    let next = grid.next_level(simd, count);
    if next.is_none() {
        let mut counts = all_alike(count, grid);
        if polygon.is_some() {
            counts.lowest = grid.level(simd, count);
        }
        return Some(counts);
    }
    let sums = grid.sums(simd, count, square, normal);
    let share = |i: usize| {
        let part = sums.lowest[i] / sums.all[i];
        // Light at the horizon may have weights of 0 only.
        if part.is_finite() { part.min(1.0) } else { 0.0 }
    };
    Some(Counts {
        lowest: grid.level(simd, count),
        next,
        share: [share(0), share(1)],
    })
}
