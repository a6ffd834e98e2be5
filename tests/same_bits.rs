//! Every method's result on one small scene, as digests that are the same on every machine and at every SIMD
//! level: the scene, made of sums, products and roots only, and the digests are written down here.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use softshadow::camera::Camera;
use softshadow::control::Control;
use softshadow::far;
use softshadow::geometry::entry::Material;
use softshadow::light::Light;
use softshadow::light::falloff::Falloff;
use softshadow::method::{Irradiance, Method, Overlap};
use softshadow::methods::accumulation::{Accumulation, Content};
use softshadow::methods::convolution::Convolution;
use softshadow::methods::counted::Counted;
use softshadow::methods::filtered::deep::DeepShadow;
use softshadow::methods::filtered::pcf::Pcf;
use softshadow::methods::filtered::{Estimate, FilterSettings};
use softshadow::methods::hard::Hard;
use softshadow::methods::layered::{self, LayerKind, Layered};
use softshadow::methods::mvsm::Mvsm;
use softshadow::methods::ray_traced::RayTraced;
use softshadow::methods::single_sample::SingleSample;
use softshadow::methods::ssoc::Ssoc;
use softshadow::methods::ssoc::lookup::Rules;
use softshadow::methods::wedges::planes::Construction;
use softshadow::methods::wedges::volume::Counting;
use softshadow::methods::wedges::{self, ShadowVolume, Wedges};
use softshadow::receivers::visible::from_camera;
use softshadow::scene::Scene;
use softshadow::scene::snapshot::Snapshot;
use softshadow::textures::atlas::Layout;

const OPAQUE: Material = Material {
    albedo: [0.8; 3],
    opacity: 1.0,
    casts: true,
    receives: true,
};

fn vec(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// A ball of triangles: an octahedron whose faces are cut into four, twice.
fn ball(center: DVec3, radius: f64) -> (Vec<DVec3>, Vec<[i64; 3]>) {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let mut triangles = vec![];
    for signs in 0..8u32 {
        let side = |i: usize| {
            if signs >> i & 1 == 1 {
                -axes[i]
            } else {
                axes[i]
            }
        };
        let flipped = signs.count_ones() % 2 == 1;
        let [b, c] = if flipped { [2, 1] } else { [1, 2] };
        triangles.push([side(0), side(b), side(c)]);
    }
    for _ in 0..2 {
        let cut = |[a, b, c]: [DVec3; 3]| {
            let [ab, bc, ca] = [a + b, b + c, c + a].map(DVec3::normalize);
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        triangles = triangles.into_iter().flat_map(cut).collect();
    }
    let mut vertices: Vec<DVec3> = vec![];
    let mut index = |v: DVec3| {
        let at = vertices.iter().position(|&w| w == v);
        at.unwrap_or_else(|| {
            vertices.push(v);
            vertices.len() - 1
        }) as i64
    };
    let faces = triangles.into_iter().map(|t| t.map(&mut index)).collect();
    let vertices = vertices.into_iter().map(|v| center + radius * v).collect();
    (vertices, faces)
}

/// A ball, a leaning triangle and a ground.
fn scene(opacity: f32) -> Arc<Snapshot> {
    let mut scene = Scene::default();
    let material = Material { opacity, ..OPAQUE };
    let (vertices, faces) = ball(vec(0.1, 0.0, 0.6), 0.4);
    scene.add_mesh("ball", vertices, &faces, material).unwrap();
    let leaf = vec![
        vec(-0.8, 0.3, 0.2),
        vec(-0.3, -0.4, 0.5),
        vec(-0.4, 0.5, 1.1),
    ];
    scene
        .add_mesh("leaf", leaf, &[[0, 1, 2]], material)
        .unwrap();
    let ground = [[-2, -2], [2, -2], [2, 2], [-2, 2]];
    let ground = ground.map(|[x, y]| vec(f64::from(x), f64::from(y), 0.0));
    let faces = [[0, 1, 2], [0, 2, 3]];
    scene
        .add_mesh("ground", ground.to_vec(), &faces, OPAQUE)
        .unwrap();
    scene.snapshot().unwrap()
}

fn lights() -> [Light; 3] {
    let [u, v] = [vec(0.0, 0.7, 0.1), vec(0.6, 0.0, 0.0)];
    [
        Light::rect(vec(0.5, 0.2, 2.5), u, v, [1.0; 3]).unwrap(),
        Light::disk(vec(-0.6, 0.9, 2.2), vec(0.3, -0.4, -1.0), 0.3, [1.0; 3]).unwrap(),
        Light::sphere(vec(0.2, -0.7, 2.4), 0.3, [1.0; 3]).unwrap(),
    ]
}

fn methods() -> Vec<(&'static str, Box<dyn Method>)> {
    let layers = layered::LayeredSettings {
        resolution: Some(96),
        layers: None,
        samples: 64,
        seed: 0,
        z_threshold: None,
        bias: 0.0,
        detail: 40.0,
        near: 24.0,
        error: 0.02,
        threshold: 1.0 / 512.0,
        resets: 4,
        subtract: false,
        opaque: false,
    };
    let layered = |kind| {
        // As users have it: one layer is the map alone.
        let near = if kind == LayerKind::Single {
            0.0
        } else {
            layers.near
        };
        Box::new(Layered::new(kind, layered::LayeredSettings { near, ..layers }).unwrap())
    };
    let settings = FilterSettings {
        resolution: 96,
        layers: 8,
        samples: 64,
        seed: 0,
        estimate: Estimate::Nearest,
        bias: None,
    };
    let layout = |names: [&'static str; 2]| Layout {
        names,
        texel: None,
        most_texels: 64,
        interpolate: true,
        memory: 1 << 30,
        radiance: true,
        opaque: false,
    };
    let construction = Construction {
        vertex_angle: 0.5,
        paper_planes: false,
    };
    let wedges = |falloff| Wedges {
        falloff,
        overlap: Overlap::Multiply,
        integer: false,
        counting: Counting::ZPass,
        construction,
        opaque: false,
        cull: true,
    };
    let line = wedges::WedgeFalloff::Planes(wedges::interpolate::PlaneFalloff::Line);
    let ray_traced = |cull, error| RayTraced {
        samples: 64,
        seed: 3,
        fixed: false,
        cull,
        error,
    };
    let counted = |error| Counted {
        samples: 256,
        rays: 64,
        seed: 3,
        error,
    };
    let rules = Rules {
        steps: 3,
        falloff: Falloff::Light,
        interpolate: true,
        thin: true,
    };
    vec![
        ("hard", Box::new(Hard)),
        ("ray_traced", Box::new(ray_traced(true, None))),
        ("ray_traced, no culling", Box::new(ray_traced(false, None))),
        ("ray_traced, error", Box::new(ray_traced(true, Some(0.02)))),
        ("counted", Box::new(counted(None))),
        ("counted, error", Box::new(counted(Some(0.02)))),
        (
            "shadow_volume",
            Box::new(ShadowVolume {
                counting: Counting::ZPass,
                opaque: false,
                cull: true,
            }),
        ),
        ("wedges", Box::new(wedges(wedges::WedgeFalloff::Light))),
        ("wedges, line", Box::new(wedges(line))),
        (
            "ssoc",
            Box::new(Ssoc {
                resolution: 96,
                rules,
                distorted: false,
                opaque: false,
            }),
        ),
        ("slsm", layered(LayerKind::Single)),
        ("mlsm", layered(LayerKind::Multi)),
        ("mtsm", layered(LayerKind::Transparent)),
        (
            "single_sample",
            Box::new(SingleSample {
                falloff: Falloff::Light,
                overlap: Overlap::Minimum,
                triangles: false,
                opaque: false,
            }),
        ),
        (
            "mvsm",
            Box::new(Mvsm {
                resolution: 96,
                views: 5,
                samples: 64,
                seed: 0,
                gap: None,
                bias: None,
                opaque: false,
            }),
        ),
        (
            "pcf",
            Box::new(Pcf {
                settings: FilterSettings {
                    layers: 1,
                    ..settings
                },
                opaque: false,
            }),
        ),
        (
            "deep",
            Box::new(DeepShadow {
                settings,
                error: 0.02,
            }),
        ),
        (
            "accumulation",
            Box::new(Accumulation {
                samples: 16,
                seed: 0,
                content: Content::Radiance,
                ambient: 0.0,
                layout: layout(["accumulation", "Accumulation"]),
            }),
        ),
        (
            "convolution",
            Box::new(Convolution {
                error: 0.05,
                layout: Layout {
                    radiance: false,
                    ..layout(["convolution", "Convolution"])
                },
            }),
        ),
    ]
}

/// FNV-1a of the bits of numbers.
fn digest(digest: &mut u64, values: &[f32]) {
    for byte in values.iter().flat_map(|x| x.to_bits().to_le_bytes()) {
        *digest = (*digest ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    }
}

/// What a method finds under every light.
fn results(method: &dyn Method, geometry: &Arc<Snapshot>) -> [u64; 3] {
    let control = Control::default();
    let lights = lights();
    let intrinsics = DMat3::from_cols(
        vec(50.0, 0.0, 0.0),
        vec(0.0, 50.0, 0.0),
        vec(20.0, 15.0, 1.0),
    );
    let pose = DMat3::from_cols(DVec3::X, vec(0.0, -0.6, -0.8), vec(0.0, 0.8, -0.6));
    let camera = Camera::new(intrinsics, pose, vec(0.0, -2.5, 2.3), 40, 30).unwrap();
    let camera = camera.to_local(&geometry.frame);
    let (_, receivers) = from_camera(geometry, None, &camera, &control).unwrap();
    let prepared = far::prepare(method, geometry.clone(), &lights, &control).unwrap();
    std::array::from_fn(|light| {
        let shading = prepared.shade(&receivers, light, &control).unwrap();
        let mut out = 0xcbf2_9ce4_8422_2325;
        digest(&mut out, &shading.visibility);
        let irradiance = match &shading.irradiance {
            Some(Irradiance::Whole(values) | Irradiance::Part(values)) => &values[..],
            None => &[],
        };
        digest(&mut out, irradiance);
        out
    })
}

/// The digests: of a rectangle, a disk and a ball.
const OPAQUE_SCENE: &[(&str, [u64; 3])] = &[
    (
        "hard",
        [
            0x13ce_2b9b_a9f8_c9f0,
            0x0fc2_4ca5_7e75_02f2,
            0x53d0_ac5d_d7d0_35e1,
        ],
    ),
    (
        "ray_traced",
        [
            0x413e_cef4_734b_abef,
            0x09b7_e91f_8fd7_2ba9,
            0x1492_dca1_c07e_1c5b,
        ],
    ),
    (
        "ray_traced, no culling",
        [
            0x413e_cef4_734b_abef,
            0x09b7_e91f_8fd7_2ba9,
            0x1492_dca1_c07e_1c5b,
        ],
    ),
    (
        "ray_traced, error",
        [
            0x7f0f_4091_8504_e63e,
            0x19d4_bc80_7823_b9bb,
            0xf9fd_d45e_207e_685b,
        ],
    ),
    (
        "counted",
        [
            0x32af_3792_6d57_0b5f,
            0xde65_ea32_7f4d_316d,
            0x2e8c_117f_fe54_1ed4,
        ],
    ),
    (
        "counted, error",
        [
            0x15f7_6a2d_eb73_f7c8,
            0xe740_fdcf_41dd_ebe4,
            0x669a_0fce_2721_a6f6,
        ],
    ),
    (
        "shadow_volume",
        [
            0x13ce_2b9b_a9f8_c9f0,
            0x0fc2_4ca5_7e75_02f2,
            0x53d0_ac5d_d7d0_35e1,
        ],
    ),
    (
        "wedges",
        [
            0x8bab_51c3_4442_6555,
            0xfb1c_b526_336a_910c,
            0xcf33_e96d_64dd_fa81,
        ],
    ),
    (
        "wedges, line",
        [
            0x3a6f_a1c4_c6b7_69c7,
            0x5e23_d3ca_a688_4257,
            0xa11f_53ab_9af8_44c3,
        ],
    ),
    (
        "ssoc",
        [
            0xe0ba_a4e8_2789_a8d8,
            0x37f0_570c_6d93_e8a8,
            0x4c75_e71c_4af9_81db,
        ],
    ),
    (
        "slsm",
        [
            0x3614_dd04_f9e6_5a85,
            0x0f0a_58e8_6c4a_1d53,
            0xce21_5397_0a47_1a0a,
        ],
    ),
    (
        "mlsm",
        [
            0xdc0a_d45b_1fea_4d12,
            0x8c64_8618_7cfe_a51a,
            0xd495_c835_afd9_ff97,
        ],
    ),
    (
        "mtsm",
        [
            0xdc0a_d45b_1fea_4d12,
            0x8c64_8618_7cfe_a51a,
            0xd495_c835_afd9_ff97,
        ],
    ),
    (
        "single_sample",
        [
            0x1131_9406_8e8f_285a,
            0x6c48_36e5_0be7_b804,
            0x3f3f_27de_b9bb_0cd0,
        ],
    ),
    (
        "mvsm",
        [
            0xcf1e_db51_9fc4_4fdb,
            0xa52f_8430_1fb8_ed11,
            0xa2e5_4a96_da65_77a4,
        ],
    ),
    (
        "pcf",
        [
            0x4012_e486_e07e_6006,
            0x21a4_9f42_5dd1_0eae,
            0xdb33_60bd_726d_a3bf,
        ],
    ),
    (
        "deep",
        [
            0xf8d7_033c_097e_15f3,
            0xe841_a5c9_b5ff_a0ef,
            0xe195_e04e_f358_ee71,
        ],
    ),
    (
        "accumulation",
        [
            0x5afe_4ff7_bb13_658e,
            0x8f58_680f_eaac_24c3,
            0xbdf4_93cb_6a1f_2f89,
        ],
    ),
    (
        "convolution",
        [
            0x40f0_8934_e4a3_c2de,
            0xa024_8829_f7cf_429d,
            0xa8e1_67a7_368f_2765,
        ],
    ),
];

const TRANSPARENT_SCENE: &[(&str, [u64; 3])] = &[
    (
        "ray_traced",
        [
            0x4a19_0c29_e54f_7f80,
            0x5728_ab2d_4b1f_0c14,
            0x698f_3167_837c_b7ea,
        ],
    ),
    (
        "mtsm",
        [
            0x1c81_5575_3892_a41a,
            0x5be5_723e_dc70_722d,
            0x91c2_338c_b706_f947,
        ],
    ),
    (
        "deep",
        [
            0x322e_0ac4_53b9_e1a0,
            0x0da6_5eee_5bae_4ce0,
            0x26f1_16cf_c189_a4ea,
        ],
    ),
];

fn check(opacity: f32, known: &[(&str, [u64; 3])], only: fn(&str) -> bool) {
    let geometry = scene(opacity);
    let mut found = vec![];
    for (name, method) in methods() {
        if only(name) {
            found.push((name, results(&*method, &geometry)));
        }
    }
    let table = |rows: &[(&str, [u64; 3])]| -> Vec<String> {
        let row = |(name, values): &(&str, [u64; 3])| format!("({name:?}, {values:#018x?}),");
        rows.iter().map(row).collect()
    };
    assert_eq!(table(&found), table(known));
}

#[test]
fn opaque_scenes_have_the_same_bits_everywhere() {
    check(1.0, OPAQUE_SCENE, |_| true);
}

#[test]
fn transparent_scenes_have_the_same_bits_everywhere() {
    let with_transparency = |name: &str| ["ray_traced", "mtsm", "deep"].contains(&name);
    check(0.4, TRANSPARENT_SCENE, with_transparency);
}
