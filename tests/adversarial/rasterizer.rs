//! The rasteriser neither drops nor doubles a pixel.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::{DMat3, DVec3, Vec3};
use softshadow::camera::Camera;
use softshadow::control::Control;
use softshadow::raster::{SPAN, Sink, rasterize};

use super::Random;

struct Count(HashMap<(u32, u32), Vec<u32>>);

impl Sink for Count {
    fn span(&mut self, x: u32, y: u32, mask: u8, inverse: &[f64; SPAN], triangle: u32) {
        for i in (0..SPAN as u32).filter(|i| mask >> i & 1 == 1) {
            assert!(inverse[i as usize].is_finite() && inverse[i as usize] > 0.0);
            self.0.entry((x + i, y)).or_default().push(triangle);
        }
    }
}

const SIZE: u32 = 64;

fn pixels(positions: &[Vec3], faces: &[[u32; 3]]) -> HashMap<(u32, u32), Vec<u32>> {
    let k = [64.0, 0.0, 0.0, 0.0, 64.0, 0.0, 32.0, 32.0, 1.0];
    let size = i64::from(SIZE);
    let k = DMat3::from_cols_array(&k);
    let camera = Camera::new(k, DMat3::IDENTITY, DVec3::ZERO, size, size).unwrap();
    let make = |_| Count(HashMap::new());
    let tiles = rasterize(
        positions,
        faces,
        |_| true,
        &camera,
        &Control::default(),
        make,
    );
    tiles.unwrap().into_iter().flat_map(|(_, s)| s.0).collect()
}

/// A fan around a pixel's centre that covers the image, its rim on a coarse lattice.
fn fan(random: &mut Random, depth: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut center = || (random.below(20) as f32 + 20.5 - 32.0) / 64.0 * depth;
    let hub = Vec3::new(center(), center(), depth);
    let n = 5 + random.below(6) as u32;
    let mut positions = vec![hub];
    for k in 0..n {
        let angle = (f64::from(k) + 0.8 * random.unit()) / f64::from(n) * TAU;
        let r = 20.0 + random.below(4) as f64;
        let snap = |x: f64| ((x * 8.0).round() / 8.0) as f32;
        positions.push(hub + Vec3::new(snap(r * angle.cos()), snap(r * angle.sin()), 0.0));
    }
    let faces = (0..n).map(|k| [0, 1 + k, 1 + (k + 1) % n]).collect();
    (positions, faces)
}

#[test]
fn random_fans_cover_every_pixel_once_also_across_the_near_plane() {
    let mut random = Random(3);
    for round in 0..500 {
        let depth = 1.0 + (round % 64) as f32 / 16.0;
        let (mut positions, mut faces) = fan(&mut random, depth);
        if round % 2 == 0 {
            // The rim comes towards the eye and past it: a cone around it, whose inside fills the image.
            for p in &mut positions[1..] {
                p.z -= [2.0, 6.0, 8.0][round / 2 % 3];
            }
        }
        for f in &mut faces {
            if random.bits() & 1 == 0 {
                f.swap(1, 2);
            }
        }
        let hits = pixels(&positions, &faces);
        assert_eq!(hits.len(), (SIZE * SIZE) as usize, "round {round}");
        assert!(hits.values().all(|h| h.len() == 1), "round {round}");
    }
}

#[test]
fn a_spoke_split_by_a_triangle_without_area_leaves_no_crack() {
    let mut random = Random(3);
    let mut cracks = Vec::new();
    for _ in 0..1000 {
        let depth = 1.0 + random.below(64) as f32 / 16.0;
        let (mut positions, faces) = fan(&mut random, depth);
        let mut split = Vec::new();
        for [hub, a, b] in faces {
            if a % 2 == 0 {
                split.push([hub, a, b]);
                continue;
            }
            let middle = positions.len() as u32;
            positions.push(0.5 * (positions[0] + positions[a as usize]));
            split.extend([[hub, middle, b], [middle, a, b], [hub, a, middle]]);
        }
        let hits = pixels(&positions, &split);
        let all = (0..SIZE * SIZE).map(|i| (i % SIZE, i / SIZE));
        cracks.extend(all.filter(|p| !hits.contains_key(p)));
    }
    // A pixel may be hit twice: rounding can fold the split triangle over its neighbour.
    assert!(
        cracks.is_empty(),
        "{} pixels, {:?}",
        cracks.len(),
        cracks[0]
    );
}
