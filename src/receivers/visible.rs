//! What a camera sees: the receivers of its pixels.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::pixels::Pixels;
use super::{BLOCK, Receivers};
use crate::bvh::{Occluders, seen};
use crate::camera::Camera;
use crate::control::Control;
use crate::error::Result;
use crate::geometry::{Geometry, MeshRange, Sphere};
use crate::memory::{fill, unwritten, written};
use crate::raster::nearest::{NONE, Nearest};
use crate::raster::{TILE, rasterize};

/// What a camera sees through each pixel.
#[derive(Debug, Clone)]
pub struct Surface {
    /// Camera-space z in local units, infinite where nothing was hit.
    pub depth: Vec<f64>,
    /// What was hit.
    pub hit: Vec<Hit>,
}

/// What a pixel's ray hit first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hit {
    /// The ray hits nothing.
    Nothing,
    /// A triangle of [`Geometry::faces`].
    Triangle(u32),
    /// A sphere of [`Geometry::spheres`].
    Sphere(u32),
}

impl Hit {
    /// The entry hit, and the face or sphere within it; `last` is the mesh that the pixel before met.
    pub fn entry<'a>(
        &self,
        geometry: &'a Geometry,
        last: &mut Option<&'a MeshRange>,
    ) -> Option<(u32, u32)> {
        match *self {
            Hit::Nothing => None,
            Hit::Triangle(f) => {
                let mesh = geometry.mesh_after(last, f);
                Some((mesh.entry, f - mesh.first_face))
            }
            Hit::Sphere(s) => {
                let sphere = &geometry.spheres[s as usize];
                Some((sphere.entry, sphere.index))
            }
        }
    }
}

/// Most groups that a camera's pixels can make.
pub fn most_groups(camera: &Camera) -> usize {
    (camera.width.div_ceil(BLOCK) * camera.height.div_ceil(BLOCK)) as usize
}

/// Finds what a camera (in local coordinates) sees, by the hierarchies where they are there, and the receivers there: a
/// step a tile, and a step for each of [`most_groups`].
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub fn from_camera(
    geometry: &Geometry,
    occluders: Option<&Occluders>,
    camera: &Camera,
    control: &Control,
) -> Result<(Surface, Receivers)> {
    let surface = visible_surface(geometry, occluders, camera, control)?;
    // Counted first, so that every block's receivers have their place and are found in parallel.
    let counts: Vec<usize> = (0..most_groups(camera) as u32)
        .into_par_iter()
        .map(|block| {
            let (xs, ys) = pixels_of(block, camera);
            let seen = |hit: &&Hit| **hit != Hit::Nothing;
            let row = |y| surface.hit[place(xs.start, y, camera)..].iter();
            ys.map(|y| row(y).take(xs.len()).filter(seen).count()).sum()
        })
        .collect();
    let total = counts.iter().sum();
    let (mut all_positions, mut all_normals) = (unwritten(total), unwritten(total));
    let (mut all_index, mut groups) = (unwritten(total), vec![0]);
    let mut all_faces = unwritten(total);
    let (mut p, mut n) = (&mut all_positions[..], &mut all_normals[..]);
    let (mut id, mut f) = (&mut all_index[..], &mut all_faces[..]);
    let mut parts = Vec::with_capacity(counts.len());
    for (block, &count) in counts.iter().enumerate().filter(|(_, c)| **c > 0) {
        let here;
        (here, p) = p.split_at_mut(count);
        let (normals, rest) = n.split_at_mut(count);
        n = rest;
        let (index, rest) = id.split_at_mut(count);
        id = rest;
        let (faces, rest) = f.split_at_mut(count);
        f = rest;
        parts.push((block as u32, here, normals, (index, faces)));
        groups.push(groups.last().copied().unwrap_or(0) + count as u32);
    }
    control.advance(counts.len() - parts.len());
    parts.into_par_iter().try_for_each_init(
        Pixels::new,
        |pixels, (block, positions, normals, (index, faces))| {
            let (positions, normals) = (fill(positions, DVec3::ZERO), fill(normals, DVec3::ZERO));
            let (index, faces) = (fill(index, 0), fill(faces, NONE));
            let (xs, ys) = pixels_of(block, camera);
            let mut i = 0;
            for y in ys {
                for x in xs.clone() {
                    let at = place(x, y, camera);
                    match surface.hit[at] {
                        Hit::Nothing => continue,
                        Hit::Triangle(face) => faces[i] = face,
                        // Below.
                        Hit::Sphere(_) => {}
                    }
                    pixels.set(i, x, y, surface.depth[at]);
                    index[i] = at as u32;
                    i += 1;
                }
            }
            match faces {
                // Most blocks, of a mesh of few triangles.
                [first, rest @ ..] if *first != NONE && rest.iter().all(|f| f == first) => {
                    pixels.set_all_corners(geometry.any_corners(&mut None, *first));
                }
                _ => {
                    let seen = faces.iter().enumerate().filter(|(_, f)| **f != NONE);
                    let mut last = None;
                    seen.for_each(|(i, &f)| {
                        pixels.set_corners(i, geometry.any_corners(&mut last, f));
                    });
                }
            }
            pixels.find(camera);
            for (i, &at) in index.iter().enumerate() {
                (positions[i], normals[i]) = match surface.hit[at as usize] {
                    Hit::Sphere(s) => {
                        let (x, y) = (at % camera.width, at / camera.width);
                        let d = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
                        let z = surface.depth[at as usize];
                        on_sphere(&geometry.spheres[s as usize], camera.eye, d, z)
                    }
                    _ => pixels.point(i),
                };
            }
            control.step()
        },
    )?;
    // SAFETY: the blocks share them out among themselves, and each filled its part.
    let receivers = unsafe {
        Receivers {
            positions: written(all_positions),
            normals: written(all_normals),
            index: written(all_index),
            groups,
            faces: written(all_faces),
            camera: Some(*camera),
        }
    };
    Ok((surface, receivers))
}

/// Columns and rows of a block of pixels.
fn pixels_of(block: u32, camera: &Camera) -> (Range<u32>, Range<u32>) {
    let columns = camera.width.div_ceil(BLOCK);
    let (x, y) = (block % columns * BLOCK, block / columns * BLOCK);
    let end = |start: u32, size: u32| (start + BLOCK).min(size);
    (x..end(x, camera.width), y..end(y, camera.height))
}

/// Where a pixel is in the image's arrays.
fn place(x: u32, y: u32, camera: &Camera) -> usize {
    y as usize * camera.width as usize + x as usize
}

fn visible_surface(
    geometry: &Geometry,
    occluders: Option<&Occluders>,
    camera: &Camera,
    control: &Control,
) -> Result<Surface> {
    let (points, faces) = (&geometry.positions, &geometry.faces);
    let tiles = match occluders {
        Some(occluders) => seen::nearest(geometry, occluders, camera, control)?,
        None => rasterize(points, faces, |_| true, camera, control, Nearest::new)?,
    };
    let (mut depth, mut hit) = (unwritten(camera.pixels()), unwritten(camera.pixels()));
    let width = camera.width as usize;
    let rows_of_tiles = depth
        .par_chunks_mut(width * TILE as usize)
        .zip(hit.par_chunks_mut(width * TILE as usize))
        .zip(tiles.par_chunks(camera.width.div_ceil(TILE) as usize));
    rows_of_tiles.for_each(|((depth, hit), tiles)| {
        let (depth, hit) = (fill(depth, f64::INFINITY), fill(hit, Hit::Nothing));
        for (tile, nearest) in tiles {
            for row in 0..tile.height as usize {
                let from = row * tile.width as usize;
                let to = row * width + tile.x as usize;
                for i in 0..tile.width as usize {
                    let triangle = nearest.triangle[from + i];
                    if triangle != NONE {
                        hit[to + i] = Hit::Triangle(triangle);
                        depth[to + i] = 1.0 / nearest.inverse_depth[from + i];
                    }
                }
            }
        }
    });
    // SAFETY: every row of tiles filled its rows.
    let (mut depth, mut hit) = unsafe { (written(depth), written(hit)) };
    if !geometry.spheres.is_empty() {
        add_spheres(geometry, camera, &mut depth, &mut hit);
    }
    Ok(Surface { depth, hit })
}

/// Draws spheres over the triangles: each over the tiles that its bounds can cover.
fn add_spheres(geometry: &Geometry, camera: &Camera, depth: &mut [f64], hit: &mut [Hit]) {
    let tiles = camera.width.div_ceil(TILE);
    let boxes: Vec<_> = geometry
        .spheres
        .iter()
        .map(|s| screen_rows(camera, s))
        .collect();
    let rows = depth
        .par_chunks_mut(camera.width as usize)
        .zip(hit.par_chunks_mut(camera.width as usize));
    rows.enumerate().for_each(|(y, (depth, hit))| {
        for tile in 0..tiles {
            let columns = tile * TILE..((tile + 1) * TILE).min(camera.width);
            for (i, sphere) in geometry.spheres.iter().enumerate() {
                let (low, high) = boxes[i];
                if (y as f64) < low || y as f64 > high {
                    continue;
                }
                for x in columns.clone() {
                    let d = camera.direction(f64::from(x) + 0.5, y as f64 + 0.5);
                    if let Some(z) = sphere_depth(sphere, camera.eye, d) {
                        let x = x as usize;
                        if z < depth[x] {
                            (depth[x], hit[x]) = (z, Hit::Sphere(i as u32));
                        }
                    }
                }
            }
        }
    });
}

/// Rows of the image that a sphere can cover, from the image of its bounding box.
fn screen_rows(camera: &Camera, sphere: &Sphere) -> (f64, f64) {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for corner in 0..8 {
        let sign = |bit: u32| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let p = sphere.center + sphere.radius * DVec3::new(sign(0), sign(1), sign(2));
        let h = camera.project(p);
        if h.z <= 0.0 {
            return (f64::NEG_INFINITY, f64::INFINITY);
        }
        (low, high) = (low.min(h.y / h.z), high.max(h.y / h.z));
    }
    (low - 1.0, high + 1.0)
}

/// Ray parameter of the first surface of a sphere in front of the eye; `d` has depth 1, so it is the
/// depth. The roots are taken so that neither cancels.
fn sphere_depth(sphere: &Sphere, eye: DVec3, d: DVec3) -> Option<f64> {
    let q = eye - sphere.center;
    let a = d.length_squared();
    let b = q.dot(d);
    // Distance of the ray from the centre, instead of b² - a c, which cancels far away.
    let nearest = q - d * (b / a);
    let discriminant = sphere.radius * sphere.radius - nearest.length_squared();
    if discriminant < 0.0 {
        return None;
    }
    let c = q.length_squared() - sphere.radius * sphere.radius;
    let s = -b - (a * discriminant).sqrt().copysign(b);
    let (t0, t1) = if s == 0.0 { (0.0, 0.0) } else { (s / a, c / s) };
    [t0.min(t1), t0.max(t1)].into_iter().find(|t| *t > 0.0)
}

/// Position and normal, turned to the eye, where the ray from `eye` along `d` meets a sphere at depth `z`.
fn on_sphere(sphere: &Sphere, eye: DVec3, d: DVec3, z: f64) -> (DVec3, DVec3) {
    let p = eye + d * z;
    let n = (p - sphere.center).normalize();
    // Back onto the surface, so that the error does not grow with the eye's distance.
    let p = sphere.center + n * sphere.radius;
    (p, if n.dot(d) > 0.0 { -n } else { n })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_is_hit_at_its_near_side_and_from_inside_at_its_far_side() {
        let sphere = Sphere {
            center: DVec3::new(0.0, 0.0, 5.0),
            radius: 1.0,
            entry: 0,
            index: 0,
        };
        let from = |z: f64| sphere_depth(&sphere, DVec3::new(0.0, 0.0, z), DVec3::Z);
        assert_eq!(from(0.0), Some(4.0));
        assert_eq!(from(5.0), Some(1.0));
        assert_eq!(from(7.0), None);
        assert_eq!(
            sphere_depth(&sphere, DVec3::new(2.0, 0.0, 0.0), DVec3::Z),
            None
        );
    }
}
