//! The light-intensity buffer, tile by tile: layers counted where view rays cross the volumes' surfaces,
//! what the wedges do to the receivers inside them, and how objects combine.
//!
//! Front layers and back layers are summed apart, and the larger sum is what hides the light: a closed
//! body has as many of both, an open sheet has one or the other, and an open mesh such as a scan with a hole
//! in its bottom has as many front layers as a closed one. Counting both together would make closed bodies
//! twice as dark in their penumbrae as sheets.

use fearless_simd::{Simd, dispatch};
use glam::DVec3;

use super::area;
use super::area::AreaScratch;
use super::block::LightFrame;
use super::bounds::{BoundsList, ReceiverBox, Selection};
use super::edge::AreaEdge;
use super::interpolate;
use super::interpolate::PlaneWedge;
use super::volume::{CountedFace, VolumeDrawing};
use super::{Buffer, Cast, WedgeSettings};
use crate::camera::Camera;
use crate::light::many::Many;
use crate::method::Overlap;
use crate::raster::{Cover, SPAN, TILE, Tile, tile_count};
use crate::receivers::{BLOCK, Receivers};
use crate::simd::{LANES, Row, detect, positive};

/// Pixels of a tile, and a span more so that every span can be read whole.
const PIXELS: usize = (TILE * TILE) as usize + SPAN;

/// What happens to receivers inside a wedge.
pub enum Interior {
    /// The layers are left as they are: hard shadows.
    None,
    /// The light's area is cut by the edges ([`area`]).
    Area(LightFrame, Vec<AreaEdge>),
    /// The paper's interpolation between planes ([`interpolate`]).
    Planes(Vec<PlaneWedge>),
}

/// All that the tiles of one image share.
pub(super) struct ImageContext<'a> {
    cast: &'a Cast,
    receivers: &'a Receivers,
    /// Groups of receivers by tile.
    groups: Vec<Vec<u32>>,
    /// Width of the image in pixels.
    width: u32,
    drawing: &'a VolumeDrawing,
    settings: &'a WedgeSettings,
    /// Whether tiles keep what covers the light.
    keep: bool,
}

impl<'a> ImageContext<'a> {
    /// Gathers what an image needs.
    pub(super) fn new(
        cast: &'a Cast,
        drawing: &'a VolumeDrawing,
        receivers: &'a Receivers,
        camera: &Camera,
        settings: &'a WedgeSettings,
        keep: bool,
    ) -> Self {
        ImageContext {
            cast,
            receivers,
            groups: groups_by_tile(receivers, camera),
            width: camera.width,
            drawing,
            settings,
            keep,
        }
    }

    /// Intensities between dark and lit that the buffer can hold; 0 for any.
    fn steps(&self) -> f32 {
        match self.settings.buffer {
            Buffer::Float => 0.0,
            Buffer::Integer { steps } => steps as f32,
        }
    }

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

/// The buffer of one tile.
pub(super) struct TileBuffer<'a> {
    image: &'a ImageContext<'a>,
    tile: Tile,
    groups: &'a [u32],
    /// Places of the groups' receivers in the tile, one after the other.
    places: Vec<u32>,
    extents: Vec<ReceiverBox>,
    extent: ReceiverBox,
    position: [Vec<f64>; 3],
    layers: [Vec<i32>; 2],
    /// Blocks of 8×8 pixels in which layers were counted for the current object.
    touched: u64,
    object: Option<u32>,
    /// The surface being drawn lies before every receiver of the tile.
    before_all: bool,
    /// Wedges that can reach the tile, in the order of objects, and how many are done.
    wedges: BoundsList,
    done: usize,
    started: usize,
    visibility: Vec<f32>,
    /// The buffer itself, front and back layers, for who asks for it.
    cover: Option<[Vec<f32>; 2]>,
}

/// What a tile leaves: for each of its groups of receivers their visibility, and what covers the light of
/// each, front and back layers, if it was asked for.
pub(super) type Groups = Vec<(u32, Vec<f32>, Vec<[f32; 2]>)>;

impl<'a> TileBuffer<'a> {
    /// An empty buffer: all light.
    pub(super) fn new(image: &'a ImageContext<'a>, tile: Tile) -> Self {
        let index = (tile.y / TILE * image.width.div_ceil(TILE) + tile.x / TILE) as usize;
        let groups = &image.groups[index];
        let mut position = [(); 3].map(|()| vec![0.0; PIXELS]);
        let mut extents = Vec::with_capacity(groups.len());
        let mut places = Vec::with_capacity(PIXELS);
        for &group in groups {
            let range = image.range(group);
            for i in range.clone() {
                let place = image.place(tile, i);
                places.push(place as u32);
                let p = image.receivers.positions[i];
                for axis in 0..3 {
                    position[axis][place] = p[axis];
                }
            }
            extents.push(ReceiverBox::of(range.map(|i| image.receivers.positions[i])));
        }
        let all = groups.iter().flat_map(|&g| image.range(g));
        let extent = ReceiverBox::of(all.map(|i| image.receivers.positions[i]));
        let wedges = match groups.is_empty() {
            true => BoundsList::default(),
            false => (image.cast.bounds).keep(image.settings.cull.then_some(&extent)),
        };
        TileBuffer {
            image,
            tile,
            groups,
            places,
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
            cover: image.keep.then(|| [(); 2].map(|()| vec![0.0; PIXELS])),
        }
    }

    /// Ends the tile.
    pub(super) fn finish(mut self) -> Groups {
        self.end_object(u32::MAX);
        let image = self.image;
        let light = &image.cast.light;
        let mut places = &self.places[..];
        let mut many = Many::new();
        let one = |&group: &u32| {
            let range = image.range(group);
            let (own, rest) = places.split_at(range.len());
            places = rest;
            let mut visible = Vec::with_capacity(range.len());
            let (p, n) = (&image.receivers.positions, &image.receivers.normals);
            many.set(&p[range.clone()], &n[range]);
            light.fractions_above(&mut many, |i, h| {
                visible.push(self.visibility[own[i] as usize].min(h as f32));
            });
            let cover = self.cover.iter().flat_map(|cover| {
                let at = |&place: &u32| [0, 1].map(|side: usize| cover[side][place as usize]);
                own.iter().map(at)
            });
            (group, visible, cover.collect())
        };
        self.groups.iter().map(one).collect()
    }

    /// Combines all objects before `next` that have layers, wedges or a start here.
    fn end_object(&mut self, next: u32) {
        let image = self.image;
        loop {
            let starts = &image.drawing.start;
            let ids = self.wedges.ids();
            let wedge = ids.get(self.done).map(|&w| image.cast.objects[w as usize]);
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
            while let Some(&w) = self.wedges.ids().get(self.done) {
                if image.cast.objects[w as usize] != object {
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
        let image = self.image;
        let [mut all_near, mut near, mut nearest] = [(); 3].map(|()| Selection::default());
        self.wedges.part(wedges, &mut all_near);
        let mut ids = Vec::new();
        let mut scratch = AreaScratch::default();
        let mut points = [DVec3::ZERO; LANES];
        let mut all = Vec::new();
        let mut places = &self.places[..];
        for (&group, extent) in self.groups.iter().zip(&self.extents) {
            let range = image.range(group);
            let (own, rest) = places.split_at(range.len());
            places = rest;
            let (x, y) = (own[0] % TILE / BLOCK, own[0] / TILE / BLOCK);
            let touched = counted && self.touched >> (y * 8 + x) & 1 == 1;
            let cull = image.settings.cull;
            (self.wedges).meeting(&all_near, cull.then_some(extent), &mut near);
            if !touched && over == [0, 0] && near.is_empty() {
                continue;
            }
            all.clear();
            all.extend(0..own.len());
            if near.len() > MANY {
                cluster(&image.receivers.positions[range.clone()], &mut all);
            }
            for lanes in all.chunks(LANES) {
                let mut cover = [Row::default(); 2];
                if !near.is_empty() {
                    for (p, &i) in points.iter_mut().zip(lanes) {
                        *p = image.receivers.positions[range.start + i];
                    }
                    let points = &points[..lanes.len()];
                    let extent = ReceiverBox::of(points.iter().copied());
                    (self.wedges).meeting(&near, cull.then_some(&extent), &mut nearest);
                    self.wedges.list(&nearest, &mut ids);
                    image
                        .cast
                        .cover(&ids, points, &mut scratch, image.steps(), &mut cover);
                }
                for (lane, &i) in lanes.iter().enumerate() {
                    let at = own[i] as usize;
                    let layers = |side: usize| match touched {
                        true => (self.layers[side][at] + over[side]) as f32,
                        false => over[side] as f32,
                    };
                    let front = layers(0) / image.cast.fan as f32 + cover[0].0[lane];
                    let back = layers(1) / image.cast.fan as f32 + cover[1].0[lane];
                    if let Some(cover) = &mut self.cover {
                        cover[0][at] += front;
                        cover[1][at] += back;
                    }
                    let seen = (1.0 - front.max(back)).clamp(0.0, 1.0);
                    let v = &mut self.visibility[at];
                    *v = match image.settings.overlap {
                        // All is one object.
                        Overlap::Add => seen,
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

/// Wedges from which on it pays to cluster a group's receivers.
const MANY: usize = 32;

/// Orders receivers so that every sixteen have a small box around them: a block of pixels may see surfaces far
/// apart, or one at a flat angle.
fn cluster(at: &[DVec3], order: &mut [usize]) {
    if order.len() <= LANES {
        return;
    }
    let (low, high) = order
        .iter()
        .map(|&i| at[i])
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
            (low.min(p), high.max(p))
        });
    let axis = (high - low).max_position();
    let middle = (order.len() / 2).next_multiple_of(LANES);
    order.select_nth_unstable_by(middle, |&i, &j| at[i][axis].total_cmp(&at[j][axis]));
    let (first, second) = order.split_at_mut(middle);
    cluster(at, first);
    cluster(at, second);
}

impl Cast {
    /// Adds what the wedges `ids` do to up to sixteen receivers.
    fn cover(
        &self,
        ids: &[u32],
        points: &[DVec3],
        scratch: &mut AreaScratch,
        steps: f32,
        out: &mut [Row; 2],
    ) {
        if ids.is_empty() {
            return;
        }
        match &self.interior {
            Interior::None => {}
            Interior::Area(frame, edges) => {
                scratch.block.set(frame, points);
                area::cover(frame, edges, ids, scratch, steps, out);
            }
            Interior::Planes(wedges) => interpolate::cover(wedges, ids, points, steps, out),
        }
    }
}

impl Cover for TileBuffer<'_> {
    fn wants(&mut self, face: u32) -> bool {
        let drawing = self.image.drawing;
        let surface = &drawing.surfaces[face as usize];
        if self.groups.is_empty() {
            return false;
        }
        self.before_all = surface.cap;
        if !surface.cap && self.image.settings.cull {
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

    fn row(&mut self, y: u32, first: u32, last: u32, face: u32) {
        let drawing = self.image.drawing;
        let surface = &drawing.surfaces[face as usize];
        if self.object != Some(surface.object) {
            self.end_object(surface.object);
            self.object = Some(surface.object);
        }
        let (row, columns) = (y - self.tile.y, [first, last].map(|x| x - self.tile.x));
        let places = columns.map(|x| (row * TILE + x) as usize);
        let (position, layers) = (&self.position, &mut self.layers);
        let before = self.before_all;
        let crossed = dispatch!(detect(), simd => cross_lanes(simd, surface, before, places, position, layers));
        if crossed {
            let [first, last] = columns.map(|x| x / BLOCK);
            self.touched |= (u64::MAX >> (63 - (last - first))) << (row / BLOCK * 8 + first);
        }
    }
}

/// Counts a surface where it lies before receivers, `before` all of a tile or those that it is asked about, from
/// the first to the last place of a row. Whether there are any.
#[inline(always)]
fn cross_lanes<S: Simd>(
    simd: S,
    surface: &CountedFace,
    before: bool,
    [first, last]: [usize; 2],
    position: &[Vec<f64>; 3],
    layers: &mut [Vec<i32>; 2],
) -> bool {
    let n = surface.normal;
    let [front, back] = layers;
    let mut any = false;
    let mut at = first;
    while at <= last {
        let mut crossed = u8::MAX >> (SPAN - (last - at + 1).min(SPAN));
        if !before {
            let x = &position[0][at..at + SPAN];
            let y = &position[1][at..at + SPAN];
            let z = &position[2][at..at + SPAN];
            let mut below = [0.0; SPAN];
            for i in 0..SPAN {
                below[i] = surface.offset - (n.x * x[i] + n.y * y[i] + n.z * z[i]);
            }
            let behind = positive(simd, &below);
            crossed &= if surface.counts(true) {
                behind
            } else {
                !behind
            };
        }
        if crossed != 0 {
            any = true;
            let (front, back) = (&mut front[at..at + SPAN], &mut back[at..at + SPAN]);
            for i in 0..SPAN {
                let one = i32::from(crossed >> i & 1);
                front[i] += one * surface.front;
                back[i] += one * surface.back;
            }
        }
        at += SPAN;
    }
    any
}
