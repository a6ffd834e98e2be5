//! The soft shadow occlusion camera (Mo, Popescu and Wyman 2007).
//!
//! A camera at the light's centre whose rays bend around silhouettes, so that a receiver's place in the
//! penumbra is how far it has to be moved in the image to be seen. Silhouettes are found in the geometry and
//! drawn as quads into two distortion maps, for the two sides of the hard shadow's boundary ([`maps`]);
//! receivers look their edge up, at a cost that does not grow with the scene ([`lookup`]). Lights within a
//! scene get as many faces of a cube as something casts into ([`crate::maps::views`]).
//!
//! Assumptions and failures, as the paper states them: edges of one view of the scene, from the light's
//! centre, stand for all of the light; a texel keeps one edge a side, so that where several penumbrae cross
//! in the map (forks, foliage, large lights) some are missed and the seams show; shadows of different edges
//! are multiplied, but those of the two sides of a gap, which add up. Beside the paper, light past the far side of a thin occluder is looked for in the
//! maps (its Section 6, a wider search). Transparent occluders cannot be modelled. The penumbra's half-width `w` is exact for a flat light and a straight
//! edge in the view along the light's normal, and of first order in light size over distance
//! otherwise. Receivers farther from the light than all of the scene have their penumbrae cut to the width
//! that they have at the scene's far end.

mod build;
pub mod corners;
pub mod distorted;
mod drawing;
mod free;
pub mod lookup;
pub mod maps;
mod receiver;
pub mod trend;

use crate::maps::RESOLUTIONS;
use crate::scene::snapshot::Snapshot;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use crate::casters::Casters;
use crate::casters::edges::Edge;
use crate::control::Control;
use crate::error::{Result, in_range};
use crate::far::REACH;
use crate::light::Light;
use crate::light::many::Many;
use crate::maps::views::{View, most_central, views};
use crate::memory;
use crate::method::{Method, Prepared, Shading};
use crate::raster::tile_count;
use crate::receivers::Receivers;
use free::{CellFaces, GroupView, PixelBlock};
use lookup::{Lookup, MOST_STEPS, Rules};
use maps::Maps;

/// Bytes of a texel: inverse depth and triangle, an edge a side, and while the maps are drawn their tiles,
/// which are as large again with a distance a side.
const TEXEL_BYTES: usize = 20 + 36;

/// Bytes of a texel of the reference image (`distorted=True`).
const FIRST_HIT_BYTES: usize = size_of::<maps::FirstHit>();

/// Parameters of the soft shadow occlusion camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ssoc {
    /// Texels on the longer side of a map.
    pub resolution: u32,
    /// How a receiver is looked up.
    pub rules: Rules,
    /// Whether distorted receivers are compared with the reference image.
    pub distorted: bool,
    /// Whether transparent meshes count as opaque.
    pub opaque: bool,
}

impl Ssoc {
    /// Checks the parameters.
    ///
    /// # Errors
    /// What is out of its range.
    pub fn checked(self) -> Result<Self> {
        in_range("Ssoc", "resolution", self.resolution, RESOLUTIONS)?;
        let steps = 1..=MOST_STEPS as u32;
        in_range("Ssoc", "steps", self.rules.steps as u32, steps)?;
        Ok(self)
    }

    /// The maps of one light (local), its views one after the other, and the seconds of each stage.
    ///
    /// # Errors
    /// Maps that do not fit into memory, or [`crate::error::Error::Cancelled`].
    pub fn maps(
        &self,
        casters: &Casters,
        edges: &[Edge],
        light: &Light,
        control: &Control,
    ) -> Result<(Vec<Maps>, [f64; 2])> {
        let geometry = casters.geometry();
        let start = Instant::now();
        let mut casts = vec![false; geometry.faces.len()];
        for range in casters.face_ranges() {
            casts[range.start as usize..range.end as usize].fill(true);
        }
        let views = views(light, casters, self.resolution)?;
        let more = if self.distorted { FIRST_HIT_BYTES } else { 0 };
        check_memory(&views, TEXEL_BYTES + more)?;
        let tiles: usize = views.iter().map(|v| tile_count(&v.camera)).sum();
        let soft = !light.is_point();
        control.expect(tiles * (1 + usize::from(soft)));
        // Side by side, as most of a cube's faces hold little.
        let mut maps: Vec<Maps> = views
            .into_par_iter()
            .map(|view| Maps::shadow_map(view, casters, &casts, control))
            .collect::<Result<_>>()?;
        let shadow = start.elapsed().as_secs_f64();
        if soft {
            // The first holds most, and is drawn by all threads; the others side by side.
            let one = maps.len().min(1);
            let (first, rest) = maps.split_at_mut(one);
            for maps in [first, rest] {
                maps.par_iter_mut()
                    .try_for_each(|map| map.distortion(edges, geometry, control))?;
            }
        }
        Ok((maps, [shadow, start.elapsed().as_secs_f64() - shadow]))
    }

    /// Finds the reference images of the maps that hold everything that casts; the others are for points behind
    /// all of the scene, and what is in front of those is in no image of theirs.
    fn reference(maps: &mut [Maps], casters: &Casters, control: &Control) -> Result<()> {
        let occluders = casters.geometry().occluders();
        maps.iter_mut()
            .filter(|m| m.view.only.is_none())
            .try_for_each(|m| m.reference(occluders, control))
    }
}

/// Asks for all memory of the maps at once, so that what cannot be had is an error.
fn check_memory(views: &[View], texel_bytes: usize) -> Result<()> {
    let texels: usize = views.iter().map(|v| v.camera.pixels()).sum();
    let bytes = texels.saturating_mul(texel_bytes);
    memory::check(|| "Ssoc: all of its maps".into(), bytes)
}

struct PreparedSsoc {
    casters: Casters,
    lights: Vec<Light>,
    maps: Vec<Vec<Maps>>,
    /// For each light with a size, the cells of each of its maps.
    cells: Vec<Vec<CellFaces>>,
    method: Ssoc,
    seconds: Vec<(&'static str, f64)>,
}

impl Method for Ssoc {
    fn name(&self) -> &'static str {
        "ssoc"
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
        Ok(Box::new(self.ready(geometry, lights, control)?))
    }
}

impl Ssoc {
    fn ready(
        &self,
        geometry: Arc<Snapshot>,
        lights: &[Light],
        control: &Control,
    ) -> Result<PreparedSsoc> {
        let casters = Casters::new(self.name(), geometry, self.opaque)?;
        let lights: Vec<Light> = lights.iter().map(|l| casters.off_ceilings(l)).collect();
        let start = Instant::now();
        casters.connect(false, control)?;
        let adjacency = start.elapsed().as_secs_f64();
        let (mut silhouettes, mut shadow_map, mut distortion_maps) = (0.0, 0.0, 0.0);
        let mut reference_image = 0.0;
        let (mut maps, mut cells) = (Vec::new(), Vec::new());
        for light in &lights {
            control.check()?;
            let start = Instant::now();
            let edges = casters.silhouettes(light.center(), false);
            silhouettes += start.elapsed().as_secs_f64();
            let (mut found, [shadow, distortion]) = self.maps(&casters, &edges, light, control)?;
            shadow_map += shadow;
            let start = Instant::now();
            let soft = self.rules.interpolate && !light.is_point();
            let soft_maps = found.iter().filter(|_| soft);
            cells.push(soft_maps.map(CellFaces::new).collect());
            distortion_maps += distortion + start.elapsed().as_secs_f64();
            if self.distorted && !light.is_point() {
                let start = Instant::now();
                Ssoc::reference(&mut found, &casters, control)?;
                reference_image += start.elapsed().as_secs_f64();
            }
            maps.push(found);
        }
        Ok(PreparedSsoc {
            casters,
            lights,
            maps,
            cells,
            method: *self,
            seconds: vec![
                ("adjacency", adjacency),
                ("silhouettes", silhouettes),
                ("shadow map", shadow_map),
                ("distortion maps", distortion_maps),
                ("reference image", reference_image),
            ],
        })
    }
}

impl Prepared for PreparedSsoc {
    fn shade(&self, receivers: &Receivers, light: usize, control: &Control) -> Result<Shading> {
        let (maps, cells) = (&self.maps[light], &self.cells[light]);
        let light = &self.lights[light];
        let (rules, hard) = (self.method.rules, light.is_point());
        let central = |faces: &[Maps], p: DVec3| {
            let cameras = faces.iter().map(|m| &m.view.camera);
            most_central(cameras, light.center(), p)
        };
        // Faces that hold only what is behind everything come after a view that holds the rest.
        let (first, rest) = match &maps[..] {
            [first, rest @ ..] if rest.iter().all(|m| m.view.only.is_some()) => (Some(first), rest),
            faces => (None, faces),
        };
        let one = |lookup: &Lookup<'_>, i: usize, h: f64| {
            let (p, n) = (receivers.positions[i], receivers.normals[i]);
            if h == 0.0 {
                return 0.0;
            }
            let map = match first {
                Some(first) if rest.is_empty() || first.view.holds(p) => Some(first),
                _ => rest.get(central(rest, p)),
            };
            // At one place in the code, or the compiler makes a call of it.
            let seen = map.and_then(|m| lookup.visibility(m, p, n)).unwrap_or(1.0);
            seen.min(h) as f32
        };
        // Those of a group that nothing hides, from the same views.
        let free = |group: &mut GroupView, many: &Many, range: &Range<usize>| {
            let (Some(first), [first_cells, rest_cells @ ..]) = (first, &cells[..]) else {
                return 0;
            };
            let block = PixelBlock::new(receivers, range);
            let outside = block.as_ref().is_some_and(|b| b.is_outside(&first.view));
            if !outside {
                if block
                    .as_ref()
                    .is_some_and(|b| first_cells.show(&first.view, b))
                {
                    return u64::MAX;
                }
                let (free, held) = group.free(first, many);
                if held {
                    return free;
                }
            }
            let face_of = |&p: &DVec3| central(rest, p);
            let face = central(rest, many.at(0).0);
            let Some(map) = rest.get(face) else {
                return if outside { u64::MAX } else { 0 };
            };
            let one_face = match &block {
                Some(block) => block.corners.iter().all(|p| face_of(p) == face),
                None => (1..many.count()).all(|i| face_of(&many.at(i).0) == face),
            };
            if !one_face {
                return 0;
            }
            if block.is_some_and(|b| rest_cells[face].show(&map.view, &b)) {
                return u64::MAX;
            }
            group.free(map, many).0
        };
        let own = || {
            (
                Many::new(),
                GroupView::new(),
                Lookup::new(self.casters.geometry(), rules, hard),
            )
        };
        let visibility =
            receivers.by_groups(control, 0.0, own, |(many, group, lookup), range, out| {
                let (p, n) = (&receivers.positions, &receivers.normals);
                many.set(&p[range.clone()], &n[range.clone()]);
                let free = free(group, many, &range);
                light.fractions_above(many, |i, h| {
                    out[i] = match free >> i & 1 {
                        1 => h as f32,
                        _ => one(lookup, range.start + i, h),
                    };
                });
                Ok(())
            })?;
        Ok(Shading {
            visibility,
            irradiance: None,
            by_rays: 0,
        })
    }

    fn bytes(&self) -> usize {
        self.maps.iter().flatten().map(Maps::bytes).sum()
    }

    fn seconds(&self) -> Vec<(&'static str, f64)> {
        self.seconds.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::geometry::entry::Material;
    use crate::light::falloff::Falloff;
    use crate::raster::nearest::NONE;
    use crate::receivers::visible::from_camera;
    use crate::scene::Scene;
    use glam::{DMat3, DVec2};

    const LOOKS: Material = Material {
        albedo: [1.0; 3],
        opacity: 1.0,
        casts: true,
        receives: true,
    };

    /// A star with deep notches over a ground.
    fn star() -> Casters {
        Casters::new("ssoc", star_geometry(), false).unwrap()
    }

    fn star_geometry() -> Arc<Snapshot> {
        let mut scene = Scene::default();
        let rim = (0..14).map(|i| {
            let angle = std::f64::consts::TAU * f64::from(i) / 14.0;
            let radius = if i % 2 == 0 { 0.6 } else { 0.25 };
            DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.5)
        });
        let vertices = std::iter::once(DVec3::new(0.0, 0.0, 0.5))
            .chain(rim)
            .collect();
        let faces: Vec<[i64; 3]> = (0..14).map(|i| [0, 1 + i, 1 + (i + 1) % 14]).collect();
        scene.add_mesh("star", vertices, &faces, LOOKS).unwrap();
        let corner = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let ground = vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(0.0, 1.5)];
        scene
            .add_mesh("ground", ground, &[[0, 1, 2]], LOOKS)
            .unwrap();
        scene.snapshot().unwrap()
    }

    fn method(resolution: u32) -> Ssoc {
        let rules = Rules {
            steps: 3,
            falloff: Falloff::Light,
            interpolate: true,
            thin: true,
        };
        Ssoc {
            resolution,
            rules,
            distorted: false,
            opaque: false,
        }
    }

    fn maps(casters: &Casters, light: &Light) -> Vec<Maps> {
        let light = light.to_local(&casters.geometry().frame);
        let method = method(200);
        let edges = casters.silhouettes(light.center(), false);
        let control = Control::default();
        let (found, _) = method.maps(casters, &edges, &light, &control).unwrap();
        assert_eq!(control.fraction(), 1.0);
        found
    }

    #[test]
    fn every_texel_holds_the_nearest_edge_on_each_side() {
        let casters = star();
        let center = DVec3::new(0.1, -0.2, 2.0);
        let light = Light::disk(center, DVec3::NEG_Z, 0.3, [1.0; 3]).unwrap();
        let map = &maps(&casters, &light)[0];
        assert_eq!(map.lines.len(), 14 + 3);
        let width = map.view.camera.width as usize;
        let mut known = [0, 0];
        for texel in 0..map.view.camera.pixels() {
            let q = DVec2::new((texel % width) as f64, (texel / width) as f64) + 0.5;
            let all = map.lines.iter().map(|l| (l.foot(q).x.abs(), l.reach));
            let distance = all.clone().map(|l| l.0).fold(f64::INFINITY, f64::min);
            // At a corner two edges are as near, and each fills half of the fan.
            let tied = all.filter(|l| l.0 < distance + 1e-9);
            let reach = tied.map(|l| l.1).fold(f64::INFINITY, f64::min);
            let found = [map.inside[texel], map.outside[texel]];
            let x = found.map(|line| match line {
                NONE => f64::INFINITY,
                line => map.lines[line as usize].foot(q).x.abs(),
            });
            if distance < reach - 1e-9 {
                // One side has it, exactly; the other side has nothing or something farther.
                assert!(
                    (x[0].min(x[1]) - distance).abs() < 1e-9,
                    "texel {texel}: {x:?} {distance}"
                );
                let side = usize::from(x[1] < x[0]);
                known[side] += 1;
            }
        }
        assert!(known[0] > 1000 && known[1] > 1000, "{known:?}");
    }

    #[test]
    fn what_is_free_at_once_is_what_lookups_find_free_at_first() {
        let casters = star();
        let center = DVec3::new(0.1, -0.2, 2.0);
        let light = Light::sphere(center, 0.2, [1.0; 3]).unwrap();
        let frame = &casters.geometry().frame;
        let map = &maps(&casters, &light)[0];
        let rules = Rules {
            steps: 3,
            falloff: Falloff::Light,
            interpolate: true,
            thin: true,
        };
        let lookup = Lookup::new(casters.geometry(), rules, false);
        // Over and beyond the ground and the star, behind the light, in the view's border, and without normals.
        let point = |i: u32| {
            let turn = f64::from(i) * 2.4;
            let (radius, height) = (0.002 * f64::from(i), f64::from(i % 7) * 0.4 - 0.1);
            let height = if i.is_multiple_of(3) { 0.0 } else { height };
            frame.to_local(DVec3::new(radius * turn.cos(), radius * turn.sin(), height))
        };
        let normal = |i: u32| match i % 11 {
            0 => DVec3::ZERO,
            1 => DVec3::X,
            _ => DVec3::Z,
        };
        let (mut many, mut group, mut counts) = (Many::new(), GroupView::new(), [0, 0]);
        for first in (0..1200).step_by(50) {
            let ids = first..first + 50;
            let positions: Vec<_> = ids.clone().map(point).collect();
            let normals: Vec<_> = ids.map(normal).collect();
            many.set(&positions, &normals);
            let (free, _) = group.free(map, &many);
            for (i, (&p, &n)) in positions.iter().zip(&normals).enumerate() {
                let alone = lookup.visibility(map, p, n);
                if free >> i & 1 == 1 {
                    assert_eq!(alone, Some(1.0), "{p} {n}");
                    counts[0] += 1;
                } else if n == DVec3::Z && alone == Some(1.0) {
                    counts[1] += 1;
                }
            }
        }
        // What else is lit is near an edge: 110 and 51 were found.
        assert!(counts[0] >= 100 && counts[1] < counts[0], "{counts:?}");
    }

    #[test]
    fn blocks_that_are_free_as_a_whole_have_what_each_receiver_finds() {
        let geometry = star_geometry();
        let intrinsics =
            DMat3::from_cols_array(&[250.0, 0.0, 0.0, 0.0, 250.0, 0.0, 128.0, 100.0, 1.0]);
        // From above, a little aslant.
        let pose = DMat3::from_rotation_x(3.0);
        let camera = Camera::new(intrinsics, pose, DVec3::new(0.0, -0.3, 2.5), 256, 200).unwrap();
        let camera = camera.to_local(&geometry.frame);
        let control = Control::default();
        let receivers = from_camera(&geometry, None, &camera, &control).unwrap().1;
        let method = method(200);
        // Above all, and between the star and the ground, with several views.
        for height in [2.0, 0.3] {
            let light = Light::sphere(DVec3::new(0.1, -0.2, height), 0.1, [1.0; 3]).unwrap();
            let light = light.to_local(&geometry.frame);
            let mut prepared = method.ready(geometry.clone(), &[light], &control).unwrap();
            let blocks = prepared.shade(&receivers, 0, &control).unwrap();
            let views = prepared.maps[0].iter().zip(&prepared.cells[0]);
            let shown = |range: Range<usize>| {
                let block = PixelBlock::new(&receivers, &range)?;
                let mut views = views.clone();
                views.any(|(m, c)| c.show(&m.view, &block)).then_some(())
            };
            let ends = receivers.groups.windows(2);
            let count = ends
                .filter(|w| shown(w[0] as usize..w[1] as usize).is_some())
                .count();
            assert!(count >= 50, "{count}");
            prepared.cells[0].clear();
            let alone = prepared.shade(&receivers, 0, &control).unwrap();
            assert!(blocks.visibility == alone.visibility);
        }
    }

    #[test]
    fn the_reference_image_can_be_cancelled() {
        let casters = star();
        let light = Light::sphere(DVec3::new(0.1, -0.2, 2.0), 0.3, [1.0; 3]).unwrap();
        let mut all = maps(&casters, &light);
        let control = Control::default();
        control.cancel();
        let found = Ssoc::reference(&mut all, &casters, &control);
        assert!(matches!(found, Err(crate::error::Error::Cancelled)));
        assert!(all.iter().all(|m| m.seen.is_empty()));
    }

    #[test]
    fn a_distorted_ray_holds_what_the_lookup_moves_to_its_texel() {
        let casters = star();
        let center = DVec3::new(0.1, -0.2, 2.0);
        let light = Light::disk(center, DVec3::NEG_Z, 0.3, [1.0; 3]).unwrap();
        let mut all = maps(&casters, &light);
        Ssoc::reference(&mut all, &casters, &Control::default()).unwrap();
        assert!(all[1..].iter().all(|m| m.seen.is_empty()));
        let map = &all[0];
        let (view, width) = (&map.view, map.view.camera.width as usize);
        let mut bent = 0;
        for (texel, seen) in map.seen.iter().enumerate() {
            let q = DVec2::new((texel % width) as f64, (texel / width) as f64) + 0.5;
            if seen.inverse_depth == 0.0 || seen.at.distance(view.tangents(q)) < 1e-12 {
                assert!(seen.inverse_depth == 0.0 || seen.triangle == map.triangle[texel]);
                continue;
            }
            let foot = map.lines[map.outside[texel] as usize].foot(q);
            let radius = view
                .outline
                .radius(foot.normal, view.tangents(foot.point))
                .0;
            let w = view.focal * radius * (foot.inverse_near - seen.inverse_depth);
            // The place of what is seen in the image without distortion, and its distance from the edge.
            let p = DVec3::from((seen.at, 1.0)) / seen.inverse_depth;
            let at = view
                .project(view.camera.eye + view.camera.rotation.transpose() * p)
                .0;
            let x = (at - foot.point).dot(foot.normal);
            // Rays start and end at f32 coordinates of about 1, of 6e-8; a texel is 0.01 wide.
            let moved = foot.point + foot.normal * (0.5 * (w + x));
            assert!(moved.distance(q) < 1e-4, "texel {texel}: {moved} {q}");
            assert!(x.abs() < w + 1e-4);
            bent += 1;
        }
        assert!(bent > 1000, "{bent}");
    }

    #[test]
    fn a_light_amid_what_casts_gets_the_faces_that_are_needed() {
        let casters = star();
        let views = |light: &Light| maps(&casters, light).len();
        // Above: a view of the star, and coarser faces for the ground, which reaches beyond it.
        let above = Light::sphere(DVec3::new(0.0, 0.0, 4.0), 0.1, [1.0; 3]).unwrap();
        assert!((1..=2).contains(&views(&above)));
        let between = Light::sphere(DVec3::new(0.0, 0.0, 0.2), 0.05, [1.0; 3]).unwrap();
        assert_eq!(views(&between), 6);
        // A flat light faces one of the two.
        let down = Light::disk(DVec3::new(0.0, 0.0, 0.2), DVec3::NEG_Z, 0.05, [1.0; 3]).unwrap();
        assert!(views(&down) < 6);
    }
}
