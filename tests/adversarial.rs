//! x
use glam::{DMat3, DVec3, Vec3};
use robust::{Coord3D, orient3d};
use softshadow::bvh::packet::Packet;
use softshadow::camera::Camera;
use softshadow::control::Control;
use softshadow::geometry::Geometry;
use softshadow::light::Light;
use softshadow::methods::hard::Hard;
use softshadow::methods::ray_traced::RayTraced;
use softshadow::methods::{Method, Shading};
use softshadow::raster::{SPAN, Sink, rasterize};
use softshadow::receivers::{Receivers, from_camera};
use softshadow::scene::{Material, Scene};
use std::collections::HashMap;
use std::sync::Arc;

const OPAQUE: Material = Material {
    albedo: [0.8; 3],
    opacity: 1.0,
    casts: true,
    receives: true,
};
const NO: Material = Material {
    casts: false,
    ..OPAQUE
};

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

struct Rng(u64);
impl Rng {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e3779b97f4a7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58476d1ce4e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d049bb133111eb);
        z ^ (z >> 31)
    }
    fn f(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
    fn s(&mut self) -> f64 {
        2.0 * self.f() - 1.0
    }
    fn v(&mut self) -> DVec3 {
        v(self.s(), self.s(), self.s())
    }
    fn i(&mut self, n: i64) -> i64 {
        (self.next() % n as u64) as i64
    }
}

fn shade(g: &Arc<Geometry>, light: Light, r: &Receivers, samples: i64, cull: bool) -> Shading {
    let control = Control::default();
    RayTraced::new(samples, 3, false, cull)
        .unwrap()
        .prepare(g.clone(), &[light], &control)
        .unwrap()
        .shade(r, 0, &control)
        .unwrap()
}

fn diff(g: &Arc<Geometry>, light: Light, r: &Receivers, samples: i64) -> (usize, usize) {
    let (a, b) = (
        shade(g, light, r, samples, true),
        shade(g, light, r, samples, false),
    );
    let partial = b
        .visibility
        .iter()
        .filter(|v| **v > 0.0 && **v < 1.0)
        .count();
    let d = a
        .visibility
        .iter()
        .zip(&b.visibility)
        .filter(|(a, b)| a.to_bits() != b.to_bits())
        .count();
    let (ia, ib) = (a.irradiance.unwrap(), b.irradiance.unwrap());
    let e = ia
        .iter()
        .zip(&ib)
        .filter(|(a, b)| a.to_bits() != b.to_bits())
        .count();
    (d.max(e), partial)
}

#[test]
fn small_lights_near() {
    let c = v(0.7, 0.6, 0.8);
    for (size, dist) in [
        (5e-3, 0.02),
        (2e-3, 0.02),
        (1e-3, 0.02),
        (5e-4, 0.02),
        (2e-4, 0.02),
        (2e-4, 0.005),
        (1e-4, 0.05),
        (1e-4, 0.01),
        (1e-4, 0.002),
        (3e-5, 0.01),
        (1e-5, 0.01),
        (1e-5, 0.001),
    ] {
        let mut t = Scene::default();
        t.add_mesh(
            "g",
            vec![v(-1., -1., -1.), v(1., -1., -1.), v(0., 1., 1.)],
            &[[0, 1, 2]],
            NO,
        )
        .unwrap();
        let m = c + v(0., 0., -0.5 * dist);
        let d = 0.25 * dist;
        t.add_mesh(
            "card",
            vec![
                m + v(0.03 * size, -d, 0.0),
                m + v(d, 0.0, 0.01 * dist),
                m + v(0.1 * size, d, 0.0),
            ],
            &[[0, 1, 2]],
            OPAQUE,
        )
        .unwrap();
        let g = t.geometry().unwrap();
        let pts: Vec<_> = (0..4000)
            .map(|i| {
                c + v(
                    (i as f64 / 2000.0 - 1.0) * size,
                    (i * 7 % 1000) as f64 * 1e-3 * size,
                    -dist,
                )
            })
            .collect();
        let ns = vec![v(1.0, 0.2, 0.1); pts.len()];
        let r = Receivers::from_points(&g, &pts, Some(&ns)).unwrap();
        let sphere = Light::sphere(c, 0.5 * size, [1.0; 3]).unwrap();
        let r0 = Receivers::from_points(&g, &pts, None).unwrap();
        let rect = Light::rect(c, v(0., size, 0.), v(size, 0., 0.), [1.0; 3]).unwrap();
        let disk = Light::disk(c, -DVec3::Z, 0.5 * size, [1.0; 3]).unwrap();
        println!(
            "size {size} dist {dist}: rect {:?} disk {:?} sphere {:?} sphere nonormal {:?}",
            diff(&g, rect, &r0, 256),
            diff(&g, disk, &r0, 256),
            diff(&g, sphere, &r, 256),
            diff(&g, sphere, &r0, 256)
        );
    }
}

#[test]
fn extremes() {
    let mut t = Scene::default();
    t.add_mesh(
        "g",
        vec![v(-1., -1., 0.), v(1., -1., 0.), v(0., 1., 0.1)],
        &[[0, 1, 2]],
        OPAQUE,
    )
    .unwrap();
    t.add_mesh(
        "h",
        vec![v(-0.3, -0.3, 0.5), v(0.3, -0.3, 0.5), v(0., 0.3, 0.6)],
        &[[0, 1, 2]],
        OPAQUE,
    )
    .unwrap();
    let g = t.geometry().unwrap();
    let mut pts = vec![v(0., 0., 0.), v(0., 0., 0.2), v(0.1, 0.2, 0.0)];
    for e in [1e3, 1e6, 1e10, 1e18, 1e20, 1e30, 1e38, 1e39, 1e100, 1e300] {
        pts.push(v(e, e, e));
        pts.push(v(-e, 0., 0.));
        pts.push(v(0., 0., -e));
    }
    let n: Vec<_> = pts
        .iter()
        .enumerate()
        .map(|(i, _)| {
            if i % 2 == 0 {
                DVec3::Z
            } else {
                v(0.3, -0.4, 0.5)
            }
        })
        .collect();
    let n2: Vec<_> = pts
        .iter()
        .map(|p| {
            if *p == DVec3::ZERO {
                DVec3::Z
            } else {
                -*p * (1.0 / p.abs().max_element())
            }
        })
        .collect();
    for r in [
        Receivers::from_points(&g, &pts, Some(&n)).unwrap(),
        Receivers::from_points(&g, &pts, Some(&n2)).unwrap(),
        Receivers::from_points(&g, &pts, None).unwrap(),
    ] {
        for d in [
            0.0, 1e-3, 1.0, 1e3, 1e6, 1e10, 1e20, 1e30, 1e40, 1e100, 1e200,
        ] {
            for s in [0.0, 1e-30, 1e-10, 1e-5, 0.1, 1.0, 1e3, 1e12, 1e25, 1e50] {
                let c = v(0.1 * d, 0.2 * d, d + 0.01);
                let mut lights = vec![
                    Light::disk(c, v(0.1, 0.1, -1.0), s, [1.0; 3]),
                    Light::sphere(c, s, [1.0; 3]),
                ];
                if s > 0.0 {
                    lights.push(Light::rect(c, v(0., s, 0.1 * s), v(s, 0., 0.), [1.0; 3]));
                }
                for l in lights.into_iter().flatten() {
                    for cull in [false, true] {
                        let out = shade(&g, l, &r, 33, cull);
                        let bad = out
                            .visibility
                            .iter()
                            .filter(|x| !(0.0..=1.0).contains(*x))
                            .count();
                        let nan: Vec<_> = out
                            .irradiance
                            .unwrap()
                            .iter()
                            .enumerate()
                            .filter(|(_, x)| !x.is_finite() || **x < 0.0)
                            .map(|(i, x)| (r.positions[i].to_array(), *x))
                            .collect();
                        if bad > 0 || !nan.is_empty() {
                            println!(
                                "BAD d {d} s {s} cull {cull} {:?}: vis {bad}, irr {} {:?}",
                                l.shape,
                                nan.len(),
                                &nan[..nan.len().min(2)]
                            );
                        }
                    }
                    let df = diff(&g, l, &r, 33);
                    if df.0 > 0 {
                        println!("DIFF d {d} s {s} {df:?} {:?}", l.shape);
                    }
                    let control = Control::default();
                    let out = Hard
                        .prepare(g.clone(), &[l], &control)
                        .unwrap()
                        .shade(&r, 0, &control)
                        .unwrap();
                    if out.visibility.iter().any(|x| !(0.0..=1.0).contains(x)) {
                        println!("HARD BAD d {d} s {s} {:?}", l.shape);
                    }
                }
            }
        }
    }
}

#[test]
fn far_sun() {
    let mut t = Scene::default();
    t.add_mesh(
        "g",
        vec![v(-1., -1., 0.), v(1., -1., 0.), v(0., 1., 0.)],
        &[[0, 1, 2]],
        OPAQUE,
    )
    .unwrap();
    let g = t.geometry().unwrap();
    let r = Receivers::from_points(&g, &[v(0., 0., 0.)], Some(&[DVec3::Z])).unwrap();
    for d in [1e3, 1e6, 1e9, 1e10, 1.5e11, 1e15, 1e19, 1e20] {
        let s = 0.00465 * d;
        for l in [
            Light::disk(v(0., 0., d), -DVec3::Z, s, [1.0; 3]).unwrap(),
            Light::sphere(v(0., 0., d), s, [1.0; 3]).unwrap(),
        ] {
            let out = shade(&g, l, &r, 64, true);
            println!(
                "d {d} vis {:?} irr {:?} expected {}",
                out.visibility,
                out.irradiance,
                l.unshadowed_irradiance(DVec3::ZERO, DVec3::Z)
            );
        }
    }
}

fn ori(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> f64 {
    let k = |v: Vec3| Coord3D {
        x: f64::from(v.x),
        y: f64::from(v.y),
        z: f64::from(v.z),
    };
    orient3d(k(a), k(b), k(c), k(d))
}

/// 1: certainly crossed (strictly inside), 0: certainly not, -1: touches.
fn exact(tri: [Vec3; 3], o: Vec3, t: Vec3) -> i32 {
    let [a, b, c] = tri;
    let (s0, s1) = (ori(a, b, c, o), ori(a, b, c, t));
    if !((s0 > 0.0 && s1 < 0.0) || (s0 < 0.0 && s1 > 0.0)) {
        return 0;
    }
    let (u, w, x) = (ori(o, t, a, b), ori(o, t, b, c), ori(o, t, c, a));
    let (lo, hi) = (u.min(w).min(x), u.max(w).max(x));
    if lo > 0.0 || hi < 0.0 {
        1
    } else if lo >= 0.0 || hi <= 0.0 {
        -1
    } else {
        0
    }
}

#[test]
fn grid_soup() {
    let mut rng = Rng(7);
    let (mut hits, mut touch, mut bad) = (0, 0, 0);
    for round in 0..600 {
        let m = [3, 5, 9, 17][round % 4];
        let n = 1 + rng.i(40);
        let mut vs = vec![];
        let mut fs = vec![];
        for k in 0..n {
            for _ in 0..3 {
                vs.push(v(rng.i(m) as f64, rng.i(m) as f64, rng.i(m) as f64));
            }
            fs.push([3 * k, 3 * k + 1, 3 * k + 2]);
        }
        let mut t = Scene::default();
        let b = vs.len() as f64;
        let _ = b;
        if t.add_mesh("s", vs, &fs, OPAQUE).is_err() {
            continue;
        }
        t.add_mesh(
            "anchor",
            vec![v(0., 0., 0.), v(16., 16., 16.), v(0., 16., 0.)],
            &[[0, 1, 2]],
            NO,
        )
        .unwrap();
        let g = t.geometry().unwrap();
        let mut stack = vec![];
        for _ in 0..40 {
            let mut p = Packet::default();
            let mut seg = vec![];
            let o0 = g
                .frame
                .to_local(v(rng.i(m) as f64, rng.i(m) as f64, rng.i(m) as f64))
                .as_vec3();
            for lane in 0..16 {
                let o = if round % 2 == 0 {
                    o0
                } else {
                    g.frame
                        .to_local(v(rng.i(m) as f64, rng.i(m) as f64, rng.i(m) as f64))
                        .as_vec3()
                };
                let far = if lane == 15 { 1024.0 } else { 1.0 };
                let e = g
                    .frame
                    .to_local(v(rng.i(m) as f64, rng.i(m) as f64, rng.i(m) as f64))
                    .as_vec3()
                    * far;
                p.set(lane, o, e);
                seg.push((o, e));
            }
            let mut out = [0.0; 16];
            g.occluders()
                .transmittance(&p, u16::MAX, &mut stack, &mut out);
            for (lane, (o, e)) in seg.iter().enumerate() {
                let r: Vec<i32> = (0..n as u32).map(|f| exact(g.corners(f), *o, *e)).collect();
                let blocked = out[lane] == 0.0;
                if r.contains(&1) {
                    hits += 1;
                    if !blocked {
                        bad += 1;
                        println!("MISS {o} {e}");
                    }
                } else if r.contains(&-1) {
                    touch += 1;
                } else if blocked {
                    bad += 1;
                    println!(
                        "FALSE HIT {o} {e} {:?}",
                        (0..n as u32).map(|f| g.corners(f)).collect::<Vec<_>>()
                    );
                }
            }
        }
    }
    println!("hits {hits} touch {touch} bad {bad}");
}

struct Count(HashMap<(u32, u32), Vec<u32>>);
impl Sink for Count {
    fn span(&mut self, x: u32, y: u32, mask: u8, d: &[f64; SPAN], triangle: u32) {
        for i in (0..SPAN as u32).filter(|i| mask >> i & 1 == 1) {
            assert!(d[i as usize].is_finite());
            self.0.entry((x + i, y)).or_default().push(triangle);
        }
    }
}
fn cam(w: i64, h: i64) -> Camera {
    let k = DMat3::from_cols_array(&[
        64.0,
        0.0,
        0.0,
        0.0,
        64.0,
        0.0,
        w as f64 / 2.0,
        h as f64 / 2.0,
        1.0,
    ]);
    Camera::new(k, DMat3::IDENTITY, DVec3::ZERO, w, h).unwrap()
}
fn hits(p: &[Vec3], f: &[[u32; 3]], c: &Camera) -> HashMap<(u32, u32), Vec<u32>> {
    rasterize(
        p,
        f,
        |_| true,
        c,
        &Control::default(),
        |_| Count(HashMap::new()),
    )
    .unwrap()
    .into_iter()
    .flat_map(|(_, s)| s.0)
    .collect()
}

#[test]
fn raster_degenerate() {
    // Split spokes at points on them, filling with zero-area triangles.
    let mut rng = Rng(3);
    let c = cam(64, 64);
    let (mut cracks, mut doubles) = (0, 0);
    for round in 0..2000 {
        let z = if round % 2 == 0 {
            1.0
        } else {
            1.0 + rng.i(64) as f32 / 16.0
        };
        let px = |x: f64, y: f64, z: f32| {
            Vec3::new(
                ((x - 32.0) / 64.0) as f32 * z,
                ((y - 32.0) / 64.0) as f32 * z,
                z,
            )
        };
        let hub = px(20.5 + rng.i(20) as f64, 20.5 + rng.i(20) as f64, z);
        let n = 3 + rng.i(6) as u32;
        let mut p = vec![hub];
        for k in 0..n {
            let a = (k as f64 + 0.8 * rng.f()) / n as f64 * 6.283185307;
            let r = 4.0 + rng.i(4) as f64;
            let snap = |x: f64| (x * 8.0).round() / 8.0;
            p.push(hub + Vec3::new(snap(r * a.cos()) as f32, snap(r * a.sin()) as f32, 0.0));
        }
        for k in 0..n {
            let m = (p[0] + p[1 + k as usize]) * 0.5;
            p.push(m);
        }
        let mut f = vec![];
        for k in 0..n {
            let (a, b) = (1 + k, 1 + (k + 1) % n);
            let ma = 1 + n + k;
            f.push([0, a, b]);
            // degenerate triangle along the spoke
            let _ = ma;
        }
        // split: triangle [0,a,b] for even k uses mid of a, filler [0, ma, a]
        let mut f2 = vec![];
        for k in 0..n {
            let (a, b, ma) = (1 + k, 1 + (k + 1) % n, 1 + n + k);
            if k % 2 == 0 {
                f2.push([0, ma, b]);
                f2.push([ma, a, b]);
                f2.push([0, a, ma]);
            } else {
                f2.push([0, a, b]);
            }
        }
        for f in [&f, &f2] {
            let h = hits(&p, f, &c);
            let cr = 64 * 64 - h.len();
            let db = h.values().filter(|x| x.len() > 1).count();
            if cr + db > 0 && cracks + doubles < 10 {
                println!("round {round} z {z} n {n} cracks {cr} doubles {db}");
            }
            cracks += cr;
            doubles += db;
        }
    }
    println!("cracks {cracks} doubles {doubles}");
}
