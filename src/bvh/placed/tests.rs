use super::super::{Occluders, seen};
use super::*;
use crate::camera::Camera;
use crate::control::Control;
use crate::geometry::entry::Material;
use crate::random::Random;
use crate::receivers::visible::from_camera;
use crate::scene::snapshot::Snapshot;
use crate::scene::{Instances, Scene};
use crate::simd::levels;
use glam::{DAffine3, DMat3};

const LOOKS: Material = Material {
    albedo: [1.0; 3],
    opacity: 1.0,
    casts: true,
    receives: true,
};

/// A closed wavy sheet over a lattice, and loose triangles around it.
fn mesh(random: &mut Random, side: i64) -> (Vec<DVec3>, Vec<[i64; 3]>) {
    let (mut points, mut faces) = (Vec::new(), Vec::new());
    for y in 0..=side {
        for x in 0..=side {
            let p = DVec3::new(x as f64, y as f64, 0.0) / side as f64 * 2.0 - 1.0;
            points.push(p + DVec3::Z * (1.0 + 0.3 * (3.0 * p.x).sin() * (4.0 * p.y).cos()));
        }
    }
    for y in 0..side {
        for x in 0..side {
            let a = y * (side + 1) + x;
            let (b, c) = (a + 1, a + side + 1);
            faces.extend([[a, b, c], [c, b, c + 1]]);
        }
    }
    for _ in 0..40 {
        let (first, centre) = (points.len() as i64, random.point());
        points.extend([0; 3].map(|_| centre + 0.3 * random.point()));
        faces.push([first, first + 1, first + 2]);
    }
    (points, faces)
}

/// Turned, sheared, mirrored, of very different sizes, flattened, one upon another and through one another.
fn transforms(random: &mut Random) -> Vec<DAffine3> {
    let turn = |random: &mut Random| {
        let p = random.point();
        DMat3::from_rotation_x(3.0 * p.x) * DMat3::from_rotation_y(3.0 * p.y)
    };
    let mut all = vec![DAffine3::IDENTITY, DAffine3::IDENTITY];
    for scale in [
        DVec3::ONE,
        DVec3::new(-1.0, 1.0, 1.0),
        DVec3::splat(-0.7),
        DVec3::new(1.0, 1.0, 1e-9),
        DVec3::new(1e-3, 2.0, 1.0),
        DVec3::splat(1e-3),
    ] {
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.8, 1.0, 0.0), DVec3::Z);
        let matrix = turn(random) * shear * DMat3::from_diagonal(scale);
        all.push(DAffine3::from_mat3_translation(
            matrix,
            3.0 * random.point(),
        ));
    }
    all
}

/// The same scene with all triangles in one list, and with instances.
fn both(random: &mut Random, whole: f64) -> [Arc<Snapshot>; 2] {
    let mut scene = Scene::new(Instances::Always);
    let (points, faces) = mesh(random, 12);
    scene.add_mesh("sheet", points, &faces, LOOKS).unwrap();
    let (points, faces) = mesh(random, 3);
    scene.add_mesh("small", points, &faces, LOOKS).unwrap();
    let whole = DAffine3::from_scale(DVec3::splat(whole));
    let all = transforms(random);
    for (k, transform) in all.iter().enumerate() {
        for (shared, kind) in [("sheet", 0), ("small", 1)] {
            let looks = Material {
                opacity: [1.0, 1.0, 0.5, 0.25][(k + kind) % 4],
                casts: (k + 2 * kind) % 5 != 4,
                ..LOOKS
            };
            let name = format!("{shared} {k}");
            scene.add_instance(&name, shared, looks).unwrap();
            scene.set_transform(&name, whole * *transform).unwrap();
        }
    }
    for name in ["sheet", "small"] {
        scene.set_transform(name, whole).unwrap();
    }
    let flat = scene.snapshot().unwrap();
    let placed = scene.snapshot_for_method(&[], "test", true).unwrap();
    assert!(placed.placed && placed.faces.is_empty() && !flat.placed);
    [flat, placed]
}

#[test]
fn corners_numbers_and_frames_are_those_of_one_list_to_the_bit() {
    let mut random = Random(3);
    for whole in [1.0, 0.37, 1e-7, 3e9] {
        let [flat, placed] = both(&mut random, whole);
        assert_eq!(flat.frame, placed.frame);
        let mut last = None;
        for face in 0..flat.faces.len() as u32 {
            let expected = flat.corners(face);
            assert_eq!(placed.any_corners(&mut last, face), expected);
            assert_eq!(placed.mesh_of(face).entry, flat.mesh_of(face).entry);
        }
        // So are the leaves' at every level.
        let instances = placed.occluders().placed.as_ref().unwrap();
        let mut count = 0;
        for set in instances.sets() {
            for instance in &set.instances {
                let tree = &instance.tree;
                let leaves = tree.wide.nodes.iter().flat_map(|node| {
                    node.child[..node.count as usize]
                        .iter()
                        .filter(|c| c.is_leaf())
                });
                for &leaf in leaves {
                    for (_, level) in levels() {
                        let found =
                            fearless_simd::dispatch!(level, simd => pack(simd, instance, leaf));
                        for (k, face) in tree.faces(leaf).iter().enumerate() {
                            let expected = flat.corners(instance.first_face + face);
                            assert_eq!(found.triangle(k), expected);
                            count += 1;
                        }
                    }
                }
            }
        }
        assert_eq!(count, flat.faces.len() * levels().len());
    }
}

#[test]
fn segments_pass_what_they_pass_in_one_list() {
    let mut random = Random(8);
    let (mut stack, mut packet) = (Stack::new(), Packet::default());
    for whole in [1.0, 1e-5] {
        let [flat, placed] = both(&mut random, whole);
        let (one, two): (&Occluders, &Occluders) = (flat.occluders(), placed.occluders());
        let mut hits = [0; 3];
        for round in 0..3000 {
            let same = random.point().as_vec3();
            // Sums of two, and so also next to corners.
            let near = if round % 3 == 0 { 0.0 } else { 1e-3 };
            for lane in 0..LANES {
                let face = random.below(flat.faces.len() as u64) as u32;
                let [a, b, c] = flat.corners(face);
                let on = match round % 5 {
                    0 => a,
                    1 => (a + b) * 0.5,
                    2 => (a + b + c) / 3.0,
                    _ => random.point().as_vec3(),
                };
                let away = near * random.point().as_vec3() * (on - same);
                let (from, to) = match round % 7 {
                    // Along a surface, from one and beyond one.
                    0 => (a + (b - a) * 0.25, b + (b - a) * 0.5),
                    1 => (on + away, random.point().as_vec3()),
                    2 => (same, on),
                    _ => (same, on + (on - same) + away),
                };
                packet.set(lane, from, to);
            }
            for active in [u16::MAX, 0x0124] {
                let (mut expected, mut found) = ([0.0; LANES], [0.0; LANES]);
                one.transmittance(&packet, active, &mut stack, &mut expected);
                two.transmittance(&packet, active, &mut stack, &mut found);
                assert_eq!(found, expected, "round {round}");
                for t in expected {
                    hits[if t == 0.0 {
                        0
                    } else {
                        1 + usize::from(t < 1.0)
                    }] += 1;
                }
            }
        }
        assert!(hits.iter().all(|&h| h > 1000), "{hits:?}");
    }
}

#[test]
fn a_camera_sees_what_it_sees_of_one_list() {
    let mut random = Random(21);
    let [flat, placed] = both(&mut random, 1.0);
    let control = Control::default();
    let turned = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-0.3);
    for (eye, pose, focal, width, height) in [
        (DVec3::ZERO, DMat3::IDENTITY, 64.0, 130, 70),
        (DVec3::new(0.1, 0.2, 0.9), turned, 40.0, 65, 129),
        (DVec3::new(0.0, 0.0, -1e6), DMat3::IDENTITY, 3e7, 64, 40),
        (DVec3::Z * 9.0, DMat3::from_rotation_y(3.1), 900.0, 301, 33),
    ] {
        let middle = [width, height].map(|size| 0.5 * size as f64);
        let intrinsics = DMat3::from_cols(
            DVec3::X * focal,
            DVec3::new(0.1, focal, 0.0),
            DVec3::new(middle[0], middle[1], 1.0),
        );
        let camera = Camera::new(intrinsics, pose, eye, width, height).unwrap();
        let camera = camera.to_local(&flat.frame);
        let tiles = |s: &Snapshot| seen::nearest(s, s.occluders(), &camera, &control).unwrap();
        let mut count = 0;
        for ((_, expected), (_, found)) in tiles(&flat).iter().zip(&tiles(&placed)) {
            assert_eq!(found.triangle, expected.triangle);
            assert_eq!(found.inverse_depth, expected.inverse_depth);
            count += expected.inverse_depth.iter().filter(|d| **d > 0.0).count();
        }
        assert!(count > 100, "{count}");
        let at = |s: &Snapshot| {
            from_camera(s, Some(s.occluders()), &camera, &control)
                .unwrap()
                .1
        };
        let (one, two) = (at(&flat), at(&placed));
        assert_eq!((one.positions, one.faces), (two.positions, two.faces));
    }
}
