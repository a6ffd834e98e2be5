//! Following a segment through one shadow map (Agrawala et al. 2000, Section 5).
//!
//! A segment is straight in the image, and inverse depth is linear along it. It is walked from texel to texel.
//! In each the map has a *floor*, the piece of the surface that it saw there; between neighbours whose depths at
//! their border are no farther apart than a gap, a *wall*. A segment that passes a floor or a wall is blocked.
//! What of it lies in front of the map's surfaces is free, seen from the map's eye; what lies behind is
//! hidden, and for other views to tell.
//!
//! Nodes of the quadtree of least and largest depth are passed in one step where the segment is in front of
//! all, or behind all, that they hold. Beside the original, floors are pieces of the surfaces' planes, as in
//! all layered maps here, so that plane surfaces have no steps for the walls to fill.

use glam::{DVec3, Vec3, Vec4};

use crate::maps::layers::map::{LayerMap, Piece};

/// Texels by which a hidden part is prolonged at both ends: what passes a surface just where another view
/// loses sight of it is not lost between them.
const OVERLAP: f32 = 1.5;

/// Texels around the last blocker in which a segment is tried first: neighbouring samples of a light are some
/// texels apart in a map, and a walk through this many takes a few steps.
const NEAR: u32 = 6;

/// Hidden parts kept of a segment; where there are more, the last ones are joined.
const MOST_PARTS: usize = 6;

/// Parts of a segment, by their start and end as fractions of its length.
#[derive(Debug, Clone, Copy, Default)]
pub struct Intervals {
    parts: [(f32, f32); MOST_PARTS],
    count: usize,
}

impl Intervals {
    /// A single part.
    pub fn one(start: f32, end: f32) -> Self {
        let mut out = Intervals::default();
        out.add(start, end);
        out
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The parts.
    pub fn iter(&self) -> impl Iterator<Item = (f32, f32)> {
        self.parts.into_iter().take(self.count)
    }

    fn add(&mut self, start: f32, end: f32) {
        if self.count > 0 && (start <= self.parts[self.count - 1].1 || self.count == MOST_PARTS) {
            let last = &mut self.parts[self.count - 1];
            (last.0, last.1) = (last.0.min(start), last.1.max(end));
        } else {
            self.parts[self.count] = (start, end);
            self.count += 1;
        }
    }
}

/// Where a map blocked a segment last: neighbouring segments are likely blocked there, too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Blocker {
    /// Number of the map.
    pub map: u32,
    /// Column.
    pub x: u32,
    /// Row.
    pub y: u32,
}

/// A segment in a map: homogeneous image coordinates of its ends.
#[derive(Debug, Clone, Copy)]
pub struct Segment {
    from: [f32; 3],
    to: [f32; 3],
}

/// A part of a segment as it is walked: place and inverse depth are `from + s (to - from)`.
#[derive(Debug, Clone, Copy)]
struct Walk {
    from: [f32; 3],
    change: [f32; 3],
}

impl Walk {
    #[inline(always)]
    fn at(&self, s: f32, axis: usize) -> f32 {
        self.from[axis] + s * self.change[axis]
    }

    /// How much nearer to the eye than a piece, in inverse depth, it is at `s`.
    #[inline(always)]
    fn before(&self, piece: Piece, x: usize, y: usize, s: f32) -> f32 {
        let [sx, sy] = piece.slope();
        let off_x = self.at(s, 0) - x as f32 - 0.5;
        let off_y = self.at(s, 1) - y as f32 - 0.5;
        self.at(s, 2) - (piece.inverse_depth + sx * off_x + sy * off_y)
    }
}

/// A map to trace in.
#[derive(Debug)]
pub struct Tracer<'a> {
    /// The map, of which the nearest layer is used.
    pub map: &'a LayerMap,
    /// Largest difference of depth that a wall closes, over depth.
    pub gap: f32,
    /// Or as it is, in local units.
    pub gap_fixed: Option<f32>,
    /// Homogeneous image coordinates of a local point.
    rows: [Vec4; 3],
}

/// What became of a part.
enum Found {
    Hit(u32, u32),
    Nothing,
}

impl<'a> Tracer<'a> {
    /// Prepares for tracing; `gap` is in local units, by default `texels` widths of a texel.
    pub fn new(map: &'a LayerMap, texels: f64, gap: Option<f32>) -> Self {
        let camera = &map.view.camera;
        let matrix = camera.intrinsics * camera.rotation;
        let shift = -(matrix * camera.eye);
        Tracer {
            map,
            gap: (texels / map.view.focal) as f32,
            gap_fixed: gap,
            rows: std::array::from_fn(|i| matrix.row(i).extend(shift[i]).as_vec4()),
        }
    }

    /// A segment from a point that was projected to a local one.
    #[inline(always)]
    pub fn segment(&self, from: [f32; 3], to: Vec3) -> Segment {
        Segment {
            from,
            to: self.rows.map(|r| r.dot(to.extend(1.0))),
        }
    }

    /// Homogeneous image coordinates of a point.
    pub fn project(&self, p: DVec3) -> [f32; 3] {
        self.map.view.camera.project(p).as_vec3().to_array()
    }

    /// Follows the parts of a segment through the map; what is hidden is added to `hidden`.
    ///
    /// Nothing of the map that can block it has a larger inverse depth than `nearest`.
    pub fn trace(
        &self,
        segment: &Segment,
        parts: &Intervals,
        nearest: f32,
        hidden: &mut Intervals,
    ) -> Option<(u32, u32)> {
        for (start, end) in parts.iter() {
            if let Some((start, end)) = self.clip(segment, start, end, nearest)
                && let Found::Hit(x, y) = self.walk(segment, start, end, Some(hidden), None)
            {
                return Some((x, y));
            }
        }
        None
    }

    /// Whether a segment, from `start` on, is blocked near a texel.
    pub fn is_blocked_at(&self, segment: &Segment, start: f32, x: u32, y: u32) -> bool {
        let level = &self.map.levels[0];
        let (w, h) = (level.width as u32, level.height as u32);
        let (x0, y0) = (x.saturating_sub(NEAR), y.saturating_sub(NEAR));
        let (x1, y1) = ((x + NEAR + 1).min(w), (y + NEAR + 1).min(h));
        let near = self.map.view.inverse_near as f32;
        let sides = [x0 as f32, x1 as f32, y0 as f32, y1 as f32];
        let Some((start, end)) = clip(segment, start, 1.0, sides, near) else {
            return false;
        };
        let within = Some([x0, y0, x1, y1]);
        matches!(self.walk(segment, start, end, None, within), Found::Hit(..))
    }

    fn clip(&self, segment: &Segment, start: f32, end: f32, nearest: f32) -> Option<(f32, f32)> {
        let level = &self.map.levels[0];
        let sides = [0.0, level.width as f32, 0.0, level.height as f32];
        clip(segment, start, end, sides, nearest)
    }

    /// Nearest piece of a texel.
    #[inline(always)]
    fn piece(&self, x: usize, y: usize) -> Piece {
        let level = &self.map.levels[0];
        let (at, child) = level.place(x, y, self.map.layers);
        level.blocks[at].piece(child)
    }

    /// Walks a part that is within the map.
    fn walk(
        &self,
        segment: &Segment,
        start: f32,
        end: f32,
        mut hidden: Option<&mut Intervals>,
        within: Option<[u32; 4]>,
    ) -> Found {
        let map = self.map;
        let (width, height) = (map.levels[0].width, map.levels[0].height);
        let ends = [start, end].map(|t| {
            let at = |axis: usize| segment.from[axis] + t * (segment.to[axis] - segment.from[axis]);
            let w = 1.0 / at(2);
            [at(0) * w, at(1) * w, w]
        });
        let walk = Walk {
            from: ends[0],
            change: std::array::from_fn(|i| ends[1][i] - ends[0][i]),
        };
        // From fractions of the part in the image to those of the segment.
        let (w0, w1) = (ends[0][2], ends[1][2]);
        let to_segment = |s: f32| start + (end - start) * (s * w1 / ((1.0 - s) * w0 + s * w1));
        let length = walk.change[0].abs().max(walk.change[1].abs());
        let overlap = OVERLAP / length.max(OVERLAP);
        let mut x = (ends[0][0].max(0.0) as usize).min(width - 1);
        let mut y = (ends[0][1].max(0.0) as usize).min(height - 1);
        let top = if within.is_some() {
            0
        } else {
            map.levels.len() - 1
        };
        let mut level = top.min(3);
        let (mut s, mut before) = (0.0f32, None::<(bool, usize, usize)>);
        loop {
            let quads = &map.levels[level].quads;
            let (nx, ny) = (x >> level, y >> level);
            let size = 1usize << level;
            // Where the segment leaves the node.
            let border = |axis: usize, n: usize| {
                let change = walk.change[axis];
                if change == 0.0 {
                    return f32::INFINITY;
                }
                let side = if change > 0.0 {
                    (n + 1) * size
                } else {
                    n * size
                };
                (side as f32 - walk.from[axis]) / change
            };
            let (leave_x, leave_y) = (border(0, nx), border(1, ny));
            let leave = leave_x.min(leave_y).max(s).min(1.0);
            let (w_in, w_out) = (walk.at(s, 2), walk.at(leave, 2));
            let quad = &quads[(ny / 2) * map.levels[level].width.div_ceil(2) + nx / 2];
            let child = (ny & 1) * 2 + (nx & 1);
            let front = if w_in.min(w_out) > quad.high[child] {
                true
            } else if w_in.max(w_out) < quad.low[child] {
                false
            } else if level > 0 {
                level -= 1;
                continue;
            } else {
                let piece = self.piece(x, y);
                let entered = walk.before(piece, x, y, s) >= 0.0;
                let left = walk.before(piece, x, y, leave) >= 0.0;
                if entered != left || self.is_wall(&walk, s, before, (entered, x, y)) {
                    return Found::Hit(x as u32, y as u32);
                }
                entered
            };
            if level > 0 && self.is_wall(&walk, s, before, (front, x, y)) {
                return Found::Hit(x as u32, y as u32);
            }
            if !front && let Some(hidden) = &mut hidden {
                let from = to_segment((s - overlap).max(0.0));
                hidden.add(from, to_segment((leave + overlap).min(1.0)));
            }
            if leave >= 1.0 {
                return Found::Nothing;
            }
            // On to the neighbour, at the texel where the border is passed.
            let along = |axis: usize, n: usize, most: usize| {
                let at = walk.at(leave, axis).max(0.0) as usize;
                at.clamp(n * size, ((n + 1) * size - 1).min(most - 1))
            };
            let (last_x, last_y);
            if leave_x <= leave_y {
                y = along(1, ny, height);
                let right = walk.change[0] > 0.0;
                if (right && (nx + 1) * size >= width) || (!right && nx == 0) {
                    return Found::Nothing;
                }
                (last_x, x) = if right {
                    ((nx + 1) * size - 1, (nx + 1) * size)
                } else {
                    (nx * size, nx * size - 1)
                };
                last_y = y;
            } else {
                x = along(0, nx, width);
                let down = walk.change[1] > 0.0;
                if (down && (ny + 1) * size >= height) || (!down && ny == 0) {
                    return Found::Nothing;
                }
                (last_y, y) = if down {
                    ((ny + 1) * size - 1, (ny + 1) * size)
                } else {
                    (ny * size, ny * size - 1)
                };
                last_x = x;
            }
            if let Some([x0, y0, x1, y1]) = within
                && !((x0 as usize..x1 as usize).contains(&x)
                    && (y0 as usize..y1 as usize).contains(&y))
            {
                return Found::Nothing;
            }
            before = Some((front, last_x, last_y));
            s = leave;
            level = (level + 1).min(top);
        }
    }

    /// Whether a wall stands between the texel that was left and the one that is entered at `s`.
    #[inline(always)]
    fn is_wall(
        &self,
        walk: &Walk,
        s: f32,
        left: Option<(bool, usize, usize)>,
        entered: (bool, usize, usize),
    ) -> bool {
        let Some((front, x, y)) = left else {
            return false;
        };
        if front == entered.0 {
            return false;
        }
        let (a, b) = (self.piece(x, y), self.piece(entered.1, entered.2));
        if !(a.is_some() && b.is_some()) {
            return false;
        }
        // Where the map says otherwise of the texel than of the node that it is in, it is at an edge.
        let (a, b) = (
            walk.before(a, x, y, s),
            walk.before(b, entered.1, entered.2, s),
        );
        if (a >= 0.0) == (b >= 0.0) {
            return false;
        }
        let w = walk.at(s, 2);
        let (z_a, z_b) = (
            1.0 / (w - a).max(f32::MIN_POSITIVE),
            1.0 / (w - b).max(f32::MIN_POSITIVE),
        );
        (z_a - z_b).abs() <= self.gap_fixed.unwrap_or(self.gap * z_a.min(z_b))
    }
}

/// The part of a segment within `sides` (least and largest column, least and largest row) and behind the nearest
/// plane.
fn clip(
    segment: &Segment,
    mut start: f32,
    mut end: f32,
    sides: [f32; 4],
    inverse_near: f32,
) -> Option<(f32, f32)> {
    let [x0, x1, y0, y1] = sides;
    let inside = |h: &[f32; 3]| {
        [
            h[0] - x0 * h[2],
            x1 * h[2] - h[0],
            h[1] - y0 * h[2],
            y1 * h[2] - h[1],
            // A little before the plane, where a flat light's points are.
            h[2] * inverse_near - 0.999,
        ]
    };
    for (a, b) in inside(&segment.from).into_iter().zip(inside(&segment.to)) {
        if a < 0.0 && b < 0.0 {
            return None;
        }
        let t = a / (a - b);
        if a < 0.0 {
            start = start.max(t);
        } else if b < 0.0 {
            end = end.min(t);
        }
    }
    (start < end).then_some((start, end))
}
