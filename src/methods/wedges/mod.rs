//! Penumbra wedges (Akenine-Möller and Assarsson 2002), and shadow volumes as their case of a light of
//! radius zero.
//!
//! Every silhouette edge that the light's centre sees is replaced by a wedge, the space in which the edge
//! cuts the light. Layers of hard shadow are counted at the surfaces of volumes ([`volume`]), receivers
//! inside wedges get what the edge leaves of the light, and both are summed in a light-intensity buffer
//! ([`buffer`]).
//!
//! Two ways to find the intensity inside a wedge:
//! - [`WedgeFalloff::Light`]: the area of the light that the edge cuts off ([`area`]), relative to the hard shadow
//!   of the light's centre. Exact where the silhouette that the centre sees is the one that all of the light
//!   sees, and continuous without side planes.
//! - the paper's interpolation between front, back and side planes ([`planes`], [`interpolate`]), with three
//!   falloffs, or each wedge as a fan of quads of constant intensity (its Figure 15).
//!
//! Assumptions and failures, as the paper states them: one silhouette, that of the light's centre, stands
//! for all of the light (Section 8; the error grows with the light); penumbrae of one object that overlap
//! are added (Figure 11), those of different objects combine as [`Overlap`] says; transparent occluders
//! cannot be modelled. A light that touches an occluder has no silhouettes there, and its shadow is
//! continuous but wrong.

pub mod area;
pub mod block;
pub mod bounds;
pub mod buffer;
pub mod edge;
pub mod interpolate;
pub mod planes;
pub mod polygon;
mod sector;
pub mod volume;

use crate::scene::snapshot::Snapshot;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use crate::casters::Casters;
use crate::casters::edges::{Edge, in_chains};
use crate::control::Control;
use crate::error::{Error, Result};
use crate::light::Light;
use crate::light::tangents::tangents;
use crate::method::{Method, Overlap, Prepared, Shading};
use crate::raster::cover_projected;
use crate::receivers::Receivers;
use block::LightFrame;
use bounds::{BoundsList, WedgeBounds};
use buffer::{Groups, ImageContext, Interior, TileBuffer};
use edge::area_edges;
use planes::{Construction, Wedge};
use volume::{Counting, VolumeQuad, VolumeView};

/// Distance of a light up to which wedges are right, in local units: their planes are found in `f64`, which begins to
/// fail ten times farther away.
const REACH: f64 = 65536.0;

/// How the intensity falls off across a wedge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WedgeFalloff {
    /// By the area of the light that the edge, with its ends, cuts off.
    Light,
    /// Interpolated between planes.
    Planes(interpolate::PlaneFalloff),
    /// The wedge is drawn as this many quads, each of constant intensity (the paper's Figure 15).
    Fan(usize),
}

/// How the light-intensity buffer stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Buffer {
    /// Floating point.
    Float,
    /// Integers, with so many steps between dark and lit: every wedge's share is rounded.
    Integer {
        /// The paper's `k`, 255 over the number of lights.
        steps: u32,
    },
}

/// Parameters of penumbra wedges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wedges {
    /// How the intensity falls off across a wedge.
    pub falloff: WedgeFalloff,
    /// How objects combine.
    pub overlap: Overlap,
    /// Whether the buffer holds integers.
    pub integer: bool,
    /// Where layers are counted from.
    pub counting: Counting,
    /// How wedges are built.
    pub construction: Construction,
    /// Whether transparent meshes count as opaque.
    pub opaque: bool,
    /// Whether tiles and groups of receivers skip what cannot reach them.
    pub cull: bool,
}

/// Shadow volumes: hard shadows of the light's centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShadowVolume {
    /// Where layers are counted from.
    pub counting: Counting,
    /// Whether transparent meshes count as opaque.
    pub opaque: bool,
    /// Whether tiles skip what cannot reach them.
    pub cull: bool,
}

/// What both need.
#[derive(Clone, Copy)]
struct WedgeSettings {
    method: &'static str,
    /// Whether transparent meshes count as opaque.
    opaque: bool,
    soft: Option<(WedgeFalloff, Construction)>,
    overlap: Overlap,
    buffer: Buffer,
    counting: Counting,
    cull: bool,
}

impl WedgeSettings {
    fn objects(&self) -> bool {
        self.overlap != Overlap::Add
    }
}

impl Method for Wedges {
    fn name(&self) -> &'static str {
        "wedges"
    }

    fn reach(&self) -> f64 {
        REACH
    }

    fn prepare(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        let settings = self.settings(lights.len());
        let prepared = PreparedWedges::new(geometry, lights, settings, control)?;
        Ok(Box::new(prepared))
    }
}

impl Method for ShadowVolume {
    fn name(&self) -> &'static str {
        "shadow_volume"
    }

    fn reach(&self) -> f64 {
        REACH
    }

    fn prepare(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<Box<dyn Prepared>> {
        let settings = WedgeSettings {
            method: self.name(),
            opaque: self.opaque,
            soft: None,
            overlap: Overlap::Add,
            buffer: Buffer::Float,
            counting: self.counting,
            cull: self.cull,
        };
        let prepared = PreparedWedges::new(geometry, lights, settings, control)?;
        Ok(Box::new(prepared))
    }
}

/// The wedges of one light.
struct Cast {
    light: Light,
    /// The sides of the volumes that are drawn: `fan` quads for every edge.
    quads: Vec<VolumeQuad>,
    /// Quads that stand for one edge.
    fan: usize,
    interior: Interior,
    bounds: BoundsList,
    objects: Vec<u32>,
}

struct PreparedWedges {
    casters: Casters,
    casts: Vec<Cast>,
    settings: WedgeSettings,
    seconds: Vec<(&'static str, f64)>,
}

/// Bounds of the receivers whose light an edge can cut.
fn bounds_of_edge(edge: &Edge, light: &Light) -> WedgeBounds {
    let [a, b] = edge.ends;
    let Some(along) = (b - a).try_normalize() else {
        return WedgeBounds::new([None; 4]);
    };
    let normal = (a - light.center()).cross(b - a);
    let limits = tangents(light, a, along, normal);
    // A plane at an end that has all of the light on its outer side has what the edge hides on its inner.
    let side = |p: DVec3, out: DVec3| {
        let axis = normal.try_normalize()?;
        tangents(light, p, axis, out).map(|t| (t.front, p))
    };
    WedgeBounds::new([
        limits.map(|t| (t.front, a)),
        limits.map(|t| (-t.back, a)),
        side(a, -along),
        side(b, along),
    ])
}

impl Cast {
    fn new(edges: &[Edge], light: &Light, settings: &WedgeSettings) -> Cast {
        let center = light.center();
        let hard = || {
            edges
                .par_iter()
                .map(|e| VolumeQuad::hard(e, center))
                .collect::<Vec<_>>()
        };
        let objects = |w: &[Wedge]| w.iter().map(|w| w.object).collect::<Vec<_>>();
        let soft = settings.soft.filter(|_| !light.is_point());
        let none = Cast {
            light: light.clone(),
            quads: Vec::new(),
            fan: 1,
            interior: Interior::None,
            bounds: BoundsList::default(),
            objects: Vec::new(),
        };
        match soft {
            None => Cast {
                quads: hard(),
                ..none
            },
            Some((WedgeFalloff::Light, _)) => {
                let quads = hard();
                let bounds: Vec<WedgeBounds> =
                    edges.par_iter().map(|e| bounds_of_edge(e, light)).collect();
                let kernel = area_edges(edges, &quads, light);
                Cast {
                    interior: Interior::Area(LightFrame::new(light), kernel),
                    bounds: BoundsList::new(&bounds),
                    objects: edges.iter().map(|e| e.object).collect(),
                    quads,
                    ..none
                }
            }
            Some((WedgeFalloff::Planes(falloff), construction)) => {
                let wedges = planes::wedges(edges, light, construction);
                let bounds: Vec<WedgeBounds> =
                    wedges.par_iter().map(WedgeBounds::of_wedge).collect();
                let kernel = wedges
                    .par_iter()
                    .map(|w| interpolate::PlaneWedge::new(w, light, falloff));
                Cast {
                    interior: Interior::Planes(kernel.collect()),
                    bounds: BoundsList::new(&bounds),
                    objects: objects(&wedges),
                    quads: wedges.iter().map(Wedge::front_quad).collect(),
                    ..none
                }
            }
            Some((WedgeFalloff::Fan(count), construction)) => {
                let wedges = planes::wedges(edges, light, construction);
                let part = |k: usize| (k as f64 + 0.5) / count as f64;
                let mut quads: Vec<VolumeQuad> = wedges
                    .par_iter()
                    .flat_map_iter(|w| (0..count).map(move |k| w.quad(part(k), center)))
                    .collect();
                quads.par_sort_by_key(|q| q.object);
                Cast {
                    quads,
                    fan: count,
                    ..none
                }
            }
        }
    }

    fn bytes(&self) -> usize {
        let interior = match &self.interior {
            Interior::None => 0,
            Interior::Area(_, edges) => size_of_val(&edges[..]),
            Interior::Planes(wedges) => size_of_val(&wedges[..]),
        };
        interior + size_of_val(&self.quads[..]) + self.bounds.bytes()
    }
}

impl PreparedWedges {
    fn new(
        geometry: Arc<Snapshot>,
        lights: &[Light],
        settings: WedgeSettings,
        control: &Control,
    ) -> Result<Self> {
        let casters = Casters::new(settings.method, geometry, settings.opaque)?;
        let lights: Vec<Light> = lights.iter().map(|l| casters.off_ceilings(l)).collect();
        let mut clock = Instant::now();
        let mut lap = || {
            let seconds = clock.elapsed().as_secs_f64();
            clock = Instant::now();
            seconds
        };
        casters.connect(settings.objects(), control)?;
        let adjacency = lap();
        control.check()?;
        // In parallel even for one light: what follows then stays with the workers, without a wake-up a step.
        let contours: Vec<Vec<Edge>> = lights
            .par_iter()
            .map(|l| in_chains(&casters.silhouettes(l.center(), settings.objects())))
            .collect();
        let silhouettes = lap();
        control.check()?;
        let casts = contours
            .iter()
            .zip(&lights)
            .map(|(edges, light)| Cast::new(edges, light, &settings))
            .collect();
        let seconds = vec![
            ("adjacency", adjacency),
            ("silhouettes", silhouettes),
            ("wedges", lap()),
        ];
        Ok(PreparedWedges {
            casters,
            casts,
            settings,
            seconds,
        })
    }
}

impl PreparedWedges {
    /// Fills the light-intensity buffer of one light.
    fn fill(
        &self,
        receivers: &Receivers,
        light: usize,
        keep: bool,
        control: &Control,
    ) -> Result<Groups> {
        let cast = &self.casts[light];
        let Some(camera) = &receivers.camera else {
            let reason = "it needs a camera".into();
            return Err(Error::Unsupported {
                method: self.settings.method,
                reason,
            });
        };
        let points = receivers.positions.par_iter();
        let low = points
            .clone()
            .copied()
            .reduce(|| DVec3::INFINITY, DVec3::min);
        let high = points.copied().reduce(|| DVec3::NEG_INFINITY, DVec3::max);
        let view = VolumeView {
            camera,
            receivers: [low, high],
            counting: self.settings.counting,
            objects: self.settings.objects(),
            copies: cast.fan as i32,
        };
        let drawing = volume::draw(&self.casters, &cast.quads, cast.light.center(), &view);
        let image = ImageContext::new(cast, &drawing, receivers, camera, &self.settings, keep);
        // Receivers are counted once a group, as by every method; tiles need no steps of their own.
        let silent = control.silent();
        let tiles = cover_projected(
            &drawing.points,
            &drawing.bounds,
            &drawing.faces,
            camera,
            &silent,
            |tile| TileBuffer::new(&image, tile),
        )?;
        let parts: Vec<Groups> = tiles
            .into_par_iter()
            .with_max_len(1)
            .map(|(_, buffer)| {
                let groups = buffer.finish();
                groups.iter().try_for_each(|_| control.step())?;
                Ok(groups)
            })
            .collect::<Result<_>>()?;
        Ok(parts.into_iter().flatten().collect())
    }
}

impl Wedges {
    /// The light-intensity buffer before it is clamped: for every receiver of a camera, the layers that
    /// cover the light, front and back, all objects added.
    ///
    /// # Errors
    /// As of [`Method::prepare`] and [`Prepared::shade`].
    pub fn cover(
        self,
        geometry: Arc<Snapshot>,
        light: &Light,
        receivers: &Receivers,
        control: &Control,
    ) -> Result<Vec<[f32; 2]>> {
        let settings = WedgeSettings {
            overlap: Overlap::Add,
            ..self.settings(1)
        };
        let lights = std::slice::from_ref(light);
        let prepared = PreparedWedges::new(geometry, lights, settings, control)?;
        let mut out = vec![[0.0; 2]; receivers.len()];
        for (group, _, cover) in prepared.fill(receivers, 0, true, control)? {
            let first = receivers.groups[group as usize] as usize;
            out[first..first + cover.len()].copy_from_slice(&cover);
        }
        Ok(out)
    }

    fn settings(&self, lights: usize) -> WedgeSettings {
        let steps = 255 / lights.clamp(1, 255) as u32;
        WedgeSettings {
            method: self.name(),
            opaque: self.opaque,
            soft: Some((self.falloff, self.construction)),
            overlap: self.overlap,
            buffer: if self.integer {
                Buffer::Integer { steps }
            } else {
                Buffer::Float
            },
            counting: self.counting,
            cull: self.cull,
        }
    }
}

impl Prepared for PreparedWedges {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let mut visibility = vec![1.0; receivers.len()];
        for (group, values, _) in self.fill(receivers, light, false, control)? {
            let first = receivers.groups[group as usize] as usize;
            visibility[first..first + values.len()].copy_from_slice(&values);
        }
        Ok(Shading {
            visibility,
            irradiance: None,
            by_rays: 0,
        })
    }

    fn bytes(&self) -> usize {
        self.casts.iter().map(Cast::bytes).sum()
    }

    fn seconds(&self) -> Vec<(&'static str, f64)> {
        self.seconds.clone()
    }
}
