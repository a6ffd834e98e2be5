//! The light-intensity buffer, tile by tile: layers counted where view rays cross the volumes' surfaces,
//! what the wedges do to the receivers inside them, and how objects combine.
//!
//! Front layers and back layers are summed apart, and the larger sum is what hides the light: a closed
//! body has as many of both, an open sheet has one or the other, and an open mesh such as a scan with a hole
//! in its bottom has as many front layers as a closed one. Counting both together would make closed bodies
//! twice as dark in their penumbrae as sheets.

use glam::{DVec3, Vec3};

use super::area::{self, AreaEdge, Block};
use super::interpolate::{self, Wedge};
use super::planes;
use super::volume::Drawing;
use super::{Buffer, Cast, Overlap, Settings};
use crate::camera::Camera;
use crate::raster::{SPAN, Sink, TILE, Tile, tile_count};
use crate::receivers::Receivers;
use crate::simd::{LANES, Row};

/// Pixels of a tile, and a span more so that every span can be read whole.
const PIXELS: usize = (TILE * TILE) as usize + SPAN;

/// Side of a group of receivers.
const BLOCK: u32 = 8;

/// Coordinates within 2 and unit normals: distances are wrong by a few ulps of 4 at most.
const SLACK: f32 = 16.0 * f32::EPSILON;

/// Four planes that bound the receivers whose light an edge can cut: a receiver is outside where one of
/// `n · p - offset` is positive. Stored by component, so that a box is tested against all four at once.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    normal: [[f32; 4]; 3],
    offset: [f32; 4],
    /// The last two are side planes that may cross: only what is inside or outside of both alike is out.
    crossing: bool,
}

impl Bounds {
    /// From unit normals and points on the planes; `None` bounds nothing.
    pub fn new(planes: [Option<(DVec3, DVec3)>; 4]) -> Self {
        let mut out = Bounds {
            normal: [[0.0; 4]; 3],
            offset: [0.0; 4],
            crossing: false,
        };
        for (i, plane) in planes.into_iter().enumerate() {
            let Some((n, p)) = plane else { continue };
            for axis in 0..3 {
                out.normal[axis][i] = n[axis] as f32;
            }
            // Coordinates within 2 and unit normals: sums wrong by a few ulps of 4 at most.
            out.offset[i] = n.dot(p) as f32 + SLACK;
        }
        out
    }

    #[inline]
    fn meets(&self, center: Vec3, half: Vec3) -> bool {
        let [nx, ny, nz] = &self.normal;
        let (mut low, mut high) = ([0.0; 4], [0.0; 4]);
        for i in 0..4 {
            let middle = nx[i] * center.x + ny[i] * center.y + nz[i] * center.z - self.offset[i];
            let reach = nx[i].abs() * half.x + ny[i].abs() * half.y + nz[i].abs() * half.z;
            (low[i], high[i]) = (middle - reach, middle + reach);
        }
        if self.crossing {
            let in_between = low[2] <= 0.0 && low[3] <= 0.0;
            let in_crossed = high[2] >= -2.0 * SLACK && high[3] >= -2.0 * SLACK;
            return low[0] <= 0.0 && low[1] <= 0.0 && (in_between || in_crossed);
        }
        low.iter().all(|l| *l <= 0.0)
    }

    /// Of a wedge between planes.
    pub fn of_wedge(wedge: &planes::Wedge) -> Self {
        let plane = |n: DVec3, p: &planes::Plane| Some((n, p.offset * p.normal));
        let [start, end] = &wedge.sides;
        let mut out = Bounds::new([
            plane(wedge.front.normal, &wedge.front),
            plane(-wedge.back.normal, &wedge.back),
            plane(-start.normal, start),
            plane(end.normal, end),
        ]);
        out.crossing = true;
        out
    }
}

/// What happens to receivers inside a wedge.
pub enum Interior {
    /// Nothing: hard shadows.
    None,
    /// The light's area is cut by the edges ([`area`]).
    Area(Vec<AreaEdge>),
    /// The paper's interpolation between planes ([`interpolate`]).
    Planes(Vec<Wedge>),
}

/// All that the tiles of one image share.
pub(super) struct Frame<'a> {
    cast: &'a Cast,
    receivers: &'a Receivers,
    /// Groups of receivers by tile.
    groups: Vec<Vec<u32>>,
    /// Width of the image in pixels.
    width: u32,
    drawing: &'a Drawing,
    settings: &'a Settings,
}

impl<'a> Frame<'a> {
    /// Gathers what an image needs.
    pub(super) fn new(
        cast: &'a Cast,
        drawing: &'a Drawing,
        receivers: &'a Receivers,
        camera: &Camera,
        settings: &'a Settings,
    ) -> Self {
        Frame {
            cast,
            receivers,
            groups: groups_by_tile(receivers, camera),
            width: camera.width,
            drawing,
            settings,
        }
    }
}

impl Frame<'_> {
    /// Intensities between dark and lit that the buffer can hold; 0 for any.
    fn steps(&self) -> f32 {
        match self.settings.buffer {
            Buffer::Float => 0.0,
            Buffer::Integer { steps } => steps as f32,
        }
    }
}

/// Groups of receivers by the tile of the image that they are in.
fn groups_by_tile(receivers: &Receivers, camera: &Camera) -> Vec<Vec<u32>> {
    let (width, columns) = (camera.width, camera.width.div_ceil(TILE));
    let mut out = vec![Vec::new(); tile_count(camera)];
    for group in 0..receivers.group_count() as u32 {
        let pixel = receivers.index[receivers.groups[group as usize] as usize];
        let (x, y) = (pixel % width, pixel / width);
        out[(y / TILE * columns + x / TILE) as usize].push(group);
    }
    out
}

/// A box around receivers.
#[derive(Debug, Clone, Copy)]
struct Extent {
    center: Vec3,
    half: Vec3,
}

impl Extent {
    fn of(points: impl Iterator<Item = DVec3>) -> Self {
        let (low, high) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| {
            (l.min(p), h.max(p))
        });
        let center = (0.5 * (low + high)).as_vec3();
        // Rounded to `f32`, the middle moves by half an ulp; coordinates are within 2.
        let half = (0.5 * (high - low)).as_vec3() + Vec3::splat(2.0 * f32::EPSILON);
        Extent { center, half }
    }
}

/// The buffer of one tile.
pub(super) struct TileBuffer<'a> {
    frame: &'a Frame<'a>,
    tile: Tile,
    groups: &'a [u32],
    extents: Vec<Extent>,
    extent: Extent,
    position: [Vec<f64>; 3],
    layers: [Vec<i32>; 2],
    /// Blocks of 8×8 pixels in which layers were counted for the current object.
    touched: u64,
    object: Option<u32>,
    /// The surface being drawn lies before every receiver of the tile.
    before_all: bool,
    /// Wedges that can reach the tile, in the order of objects, and how many are done.
    wedges: Vec<u32>,
    done: usize,
    started: usize,
    visibility: Vec<f32>,
}

impl<'a> TileBuffer<'a> {
    /// An empty buffer: all light.
    pub(super) fn new(frame: &'a Frame<'a>, tile: Tile) -> Self {
        let index = (tile.y / TILE * frame.width.div_ceil(TILE) + tile.x / TILE) as usize;
        let groups = &frame.groups[index];
        let mut position = [(); 3].map(|()| vec![0.0; PIXELS]);
        let mut extents = Vec::with_capacity(groups.len());
        for &group in groups {
            let range = frame.range(group);
            for i in range.clone() {
                let place = frame.place(tile, i);
                let p = frame.receivers.positions[i];
                for axis in 0..3 {
                    position[axis][place] = p[axis];
                }
            }
            extents.push(Extent::of(range.map(|i| frame.receivers.positions[i])));
        }
        let all = groups.iter().flat_map(|&g| frame.range(g));
        let extent = Extent::of(all.map(|i| frame.receivers.positions[i]));
        let wedges = match groups.is_empty() {
            true => Vec::new(),
            false => (0..frame.cast.bounds.len() as u32)
                .filter(|&w| {
                    !frame.settings.cull
                        || frame.cast.bounds[w as usize].meets(extent.center, extent.half)
                })
                .collect(),
        };
        TileBuffer {
            frame,
            tile,
            groups,
            extents,
            extent,
            position,
            layers: [(); 2].map(|()| vec![0; PIXELS]),
            touched: 0,
            object: None,
            before_all: false,
            wedges,
            done: 0,
            started: 0,
            visibility: vec![1.0; PIXELS],
        }
    }

    /// Ends the tile: the visibility of every receiver of its groups.
    pub(super) fn finish(mut self) -> Vec<(u32, Vec<f32>)> {
        self.end_object(u32::MAX);
        let frame = self.frame;
        self.groups
            .iter()
            .map(|&group| {
                let values = frame.range(group).map(|i| {
                    let (p, n) = (frame.receivers.positions[i], frame.receivers.normals[i]);
                    let h = frame.cast.light.fraction_above(p, n) as f32;
                    self.visibility[frame.place(self.tile, i)].min(h)
                });
                (group, values.collect())
            })
            .collect()
    }

    /// Combines all objects before `next` that have layers, wedges or a start here.
    fn end_object(&mut self, next: u32) {
        let frame = self.frame;
        loop {
            let starts = &frame.drawing.start;
            let wedge = self
                .wedges
                .get(self.done)
                .map(|&w| frame.cast.objects[w as usize]);
            let start = starts.get(self.started).map(|s| s.object);
            let lowest = [self.object, wedge, start].into_iter().flatten().min();
            let Some(object) = lowest.filter(|o| *o < next) else {
                return;
            };
            let mut over = [0, 0];
            if start == Some(object) {
                let s = starts[self.started];
                over = [s.front, s.back];
                self.started += 1;
            }
            let first = self.done;
            while let Some(&w) = self.wedges.get(self.done) {
                if frame.cast.objects[w as usize] != object {
                    break;
                }
                self.done += 1;
            }
            let counted = self.object == Some(object);
            self.combine(first..self.done, over, counted);
            if counted {
                self.object = None;
                self.touched = 0;
            }
        }
    }

    /// Lets one object take its light away: its wedges, and the layers counted or over the eye.
    fn combine(&mut self, wedges: std::ops::Range<usize>, over: [i32; 2], counted: bool) {
        let frame = self.frame;
        let light = &frame.cast.light;
        let mut near = Vec::new();
        let mut block = Block::default();
        let mut points = [DVec3::ZERO; LANES];
        for (place, &group) in self.groups.iter().enumerate() {
            let range = frame.range(group);
            let first = frame.place(self.tile, range.start);
            let (x, y) = (first as u32 % TILE / BLOCK, first as u32 / TILE / BLOCK);
            let touched = counted && self.touched >> (y * 8 + x) & 1 == 1;
            let extent = self.extents[place];
            near.clear();
            near.extend(self.wedges[wedges.clone()].iter().copied().filter(|&w| {
                !frame.settings.cull
                    || frame.cast.bounds[w as usize].meets(extent.center, extent.half)
            }));
            if !touched && over == [0, 0] && near.is_empty() {
                continue;
            }
            let all: Vec<usize> = range.collect();
            for lanes in all.chunks(LANES) {
                let mut cover = [Row::default(); 2];
                if !near.is_empty() {
                    for (p, &i) in points.iter_mut().zip(lanes) {
                        *p = frame.receivers.positions[i];
                    }
                    match &frame.cast.interior {
                        Interior::None => {}
                        Interior::Area(edges) => {
                            block.set(light, &points[..lanes.len()]);
                            area::cover(light, edges, &near, &block, frame.steps(), &mut cover);
                        }
                        Interior::Planes(wedges) => {
                            let points = &points[..lanes.len()];
                            interpolate::cover(wedges, &near, points, frame.steps(), &mut cover);
                        }
                    }
                }
                for (lane, &i) in lanes.iter().enumerate() {
                    let at = frame.place(self.tile, i);
                    let layers = |side: usize| match touched {
                        true => (self.layers[side][at] + over[side]) as f32,
                        false => over[side] as f32,
                    };
                    let front = layers(0) / frame.cast.fan as f32 + cover[0].0[lane];
                    let back = layers(1) / frame.cast.fan as f32 + cover[1].0[lane];
                    let seen = match frame.settings.overlap {
                        // Clamped once all have been added.
                        Overlap::Add => 1.0 - front.max(back),
                        _ => (1.0 - front.max(back)).clamp(0.0, 1.0),
                    };
                    let v = &mut self.visibility[at];
                    *v = match frame.settings.overlap {
                        Overlap::Add => seen.clamp(0.0, 1.0),
                        Overlap::Multiply => *v * seen,
                        Overlap::Minimum => v.min(seen),
                    };
                }
            }
            if touched {
                for row in 0..BLOCK {
                    let from = ((y * BLOCK + row) * TILE + x * BLOCK) as usize;
                    for layers in &mut self.layers {
                        layers[from..from + BLOCK as usize].fill(0);
                    }
                }
            }
        }
    }
}

impl Frame<'_> {
    fn range(&self, group: u32) -> std::ops::Range<usize> {
        let groups = &self.receivers.groups;
        groups[group as usize] as usize..groups[group as usize + 1] as usize
    }

    /// Place of a receiver's pixel in its tile.
    fn place(&self, tile: Tile, receiver: usize) -> usize {
        let pixel = self.receivers.index[receiver];
        let (x, y) = (pixel % self.width, pixel / self.width);
        ((y - tile.y) * TILE + (x - tile.x)) as usize
    }
}

impl Sink for TileBuffer<'_> {
    fn wants(&mut self, triangle: u32) -> bool {
        let drawing = self.frame.drawing;
        let surface = &drawing.surfaces[triangle as usize];
        if self.groups.is_empty() {
            return false;
        }
        self.before_all = surface.cap;
        if !surface.cap && self.frame.settings.cull {
            // The largest Z of the paper's tiles, without depths: a box on the eye's side of a plane is
            // before the quad, a box on the other behind it.
            let center = self.extent.center.as_dvec3();
            let middle = surface.normal.dot(center) - surface.offset;
            let half = self.extent.half.as_dvec3();
            // Twice the box outweighs all rounding.
            let reach = 2.0 * surface.normal.abs().dot(half);
            let behind = middle < -reach;
            if behind || middle > reach {
                let counts = surface.counts(behind);
                self.before_all = counts;
                return counts;
            }
        }
        true
    }

    fn span(&mut self, x: u32, y: u32, mask: u8, _: &[f64; SPAN], triangle: u32) {
        let drawing = self.frame.drawing;
        let surface = &drawing.surfaces[triangle as usize];
        if self.object != Some(surface.object) {
            self.end_object(surface.object);
            self.object = Some(surface.object);
        }
        let (column, row) = (x - self.tile.x, y - self.tile.y);
        let first = (row * TILE + column) as usize;
        let mut crossed = mask;
        if !self.before_all {
            let [px, py, pz] = &self.position;
            let (px, py, pz) = (
                &px[first..first + SPAN],
                &py[first..first + SPAN],
                &pz[first..first + SPAN],
            );
            let n = surface.normal;
            let mut behind = 0;
            for i in 0..SPAN {
                let value = n.x * px[i] + n.y * py[i] + n.z * pz[i] - surface.offset;
                behind |= u8::from(value < 0.0) << i;
            }
            crossed &= if surface.counts(true) {
                behind
            } else {
                !behind
            };
        }
        if crossed == 0 {
            return;
        }
        for block in [
            column / BLOCK,
            (column + SPAN as u32 - 1).min(TILE - 1) / BLOCK,
        ] {
            self.touched |= 1 << (row / BLOCK * 8 + block);
        }
        for i in 0..SPAN {
            let one = i32::from(crossed >> i & 1);
            self.layers[0][first + i] += one * surface.front;
            self.layers[1][first + i] += one * surface.back;
        }
    }
}
