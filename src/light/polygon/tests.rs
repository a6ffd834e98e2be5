use super::*;

/// An L in the plane z = 1, its emitting side down: 1 by 1 without a quarter.
fn corners_of_l() -> Vec<DVec3> {
    let plan = [
        (0.0, 0.0),
        (0.0, 1.0),
        (0.5, 1.0),
        (0.5, 0.5),
        (1.0, 0.5),
        (1.0, 0.0),
    ];
    plan.map(|(x, y)| DVec3::new(x, y, 1.0)).to_vec()
}

/// A rectangle of the same plane and side.
fn rect(x: [f64; 2], y: [f64; 2]) -> Light {
    let center = DVec3::new(0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]), 1.0);
    let (u, v) = (DVec3::Y * (y[1] - y[0]), DVec3::X * (x[1] - x[0]));
    Light::rect(center, u, v, [1.0; 3]).unwrap()
}

fn polygon(light: &Light) -> &PolygonLight {
    match &light.shape {
        Shape::Polygon(polygon) => polygon,
        other => panic!("{other:?}"),
    }
}

/// Normals that leave the light above the tangent plane, cut it once, and cut both arms of an L at its reflex corner.
const NORMALS: [DVec3; 5] = [
    DVec3::Z,
    DVec3::new(0.9, 0.1, 0.3),
    DVec3::new(-0.6, -0.6, 0.45),
    DVec3::new(0.6, 0.6, -0.4),
    DVec3::new(0.0, 1.0, -0.5),
];

#[test]
fn an_l_is_the_sum_of_two_rectangles() {
    let light = Light::polygon(&corners_of_l(), [1.0; 3]).unwrap();
    let parts = [rect([0.0, 0.5], [0.0, 1.0]), rect([0.5, 1.0], [0.0, 0.5])];
    let areas = [0.5, 0.25];
    let mut cut = 0;
    for p in [
        DVec3::ZERO,
        DVec3::new(0.7, 0.7, 0.2),
        DVec3::new(-1.0, 2.0, 0.5),
    ] {
        for n in NORMALS.map(DVec3::normalize) {
            let irradiance = parts.each_ref().map(|l| l.unshadowed_irradiance(p, n));
            let expected: f64 = irradiance.iter().sum();
            let found = light.unshadowed_irradiance(p, n);
            // Both are sums of some ten arcs.
            assert!(
                (found - expected).abs() < 1e-14,
                "{p} {n}: {found} {expected}"
            );
            let above: f64 = parts
                .iter()
                .zip(areas)
                .map(|(l, a)| l.fraction_above(p, n) * a)
                .sum();
            let found = light.fraction_above(p, n);
            assert!((found - above / 0.75).abs() < 1e-14, "{p} {n}: {found}");
            cut += usize::from(found > 0.0 && found < 1.0);
        }
    }
    assert!(cut > 5, "{cut}");
}

#[test]
fn a_tangent_plane_through_a_reflex_corner_cuts_an_l_exactly() {
    // The plane goes through the corner (½, ½) and cuts both arms, or neither.
    let light = Light::polygon(&corners_of_l(), [1.0; 3]).unwrap();
    let p = DVec3::new(0.5, 0.5, 0.0);
    // Triangle, square and triangle of a quarter by a half remain on the side of the inner corner of the plan.
    let outer = DVec3::new(1.0, 1.0, 0.0).normalize();
    assert!((light.fraction_above(p, outer) - 0.25 / 0.75).abs() < 1e-15);
    assert!((light.fraction_above(p, -outer) - 0.5 / 0.75).abs() < 1e-15);
    // Along an arm's border: what lies on the plane has no area.
    assert!((light.fraction_above(p, DVec3::X) - 0.25 / 0.75).abs() < 1e-15);
    assert!((light.fraction_above(p, -DVec3::Y) - 0.5 / 0.75).abs() < 1e-15);
}

#[test]
fn a_polygon_that_is_a_rectangle_is_that_rectangle() {
    let (center, u, v) = (
        DVec3::new(0.3, -0.2, 1.4),
        DVec3::new(0.1, 0.8, 0.2),
        DVec3::new(-0.8, 0.1, 0.0) * 0.4,
    );
    let rect = Light::rect(center, u, v, [1.0; 3]).unwrap();
    let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)];
    let corners = corners.map(|(s, t)| center + s * u + t * v);
    let light = Light::polygon(&corners, [1.0; 3]).unwrap();
    assert!((light.center() - center).length() < 1e-15);
    let own = polygon(&light);
    assert!((own.area() - u.cross(v).length()).abs() < 1e-15);
    let RectLight { u: a, v: b, .. } = own.stand_in();
    assert!(
        (a - u).length() < 1e-14 && (b - v).length() < 1e-14,
        "{a} {b}"
    );
    for p in [DVec3::ZERO, DVec3::new(1.0, 1.0, -0.3)] {
        for n in NORMALS.map(DVec3::normalize) {
            let both =
                [&light, &rect].map(|l| [l.fraction_above(p, n), l.unshadowed_irradiance(p, n)]);
            for (found, expected) in both[0].into_iter().zip(both[1]) {
                assert!((found - expected).abs() < 1e-14, "{p} {n}: {both:?}");
            }
        }
    }
    for axis in [DVec3::X, DVec3::new(0.3, -0.4, 0.7)] {
        assert!((light.reach(axis) - rect.reach(axis)).abs() < 1e-15);
        let far = |l: &Light| l.farthest(axis.normalize()).dot(axis);
        assert!((far(&light) - far(&rect)).abs() < 1e-15);
    }
}

#[test]
fn triangles_make_up_the_polygon_and_the_stand_in_has_its_area_and_middle() {
    // A comb of five teeth, slanted in space.
    let plan = (0..10).map(|i| DVec2::new(f64::from(i), if i % 2 == 0 { 1.0 } else { 4.0 }));
    let plan = plan.chain([DVec2::new(9.0, 0.0), DVec2::ZERO]);
    let (e, f) = (DVec3::new(0.6, 0.8, 0.0), DVec3::new(-0.64, 0.48, 0.6));
    let corners: Vec<DVec3> = plan
        .map(|c| DVec3::splat(50.0) - c.x * e + c.y * f)
        .collect();
    let light = Light::polygon(&corners, [1.0; 3]).unwrap();
    let own = polygon(&light);
    let normal = light.normal().unwrap();
    let (mut area, mut first) = (0.0, DVec3::ZERO);
    for [a, b, c] in own
        .triangles()
        .iter()
        .map(|t| t.map(|i| corners[i as usize]))
    {
        let twice = (b - a).cross(c - a).dot(normal);
        assert!(twice > 0.0);
        area += 0.5 * twice;
        first += 0.5 * twice * (a + b + c) / 3.0;
    }
    // Nine steps of a mean height of 2.5.
    assert!(
        (own.area() - 22.5).abs() < 1e-12 && (area - 22.5).abs() < 1e-12,
        "{area}"
    );
    assert!((first / area - light.center()).length() < 1e-12);
    let RectLight { center, u, v } = own.stand_in();
    assert_eq!(center, light.center());
    assert!((u.cross(v).dot(normal) - 22.5).abs() < 1e-12);
}

#[test]
fn what_is_no_polygon_is_refused_by_the_vertex() {
    let refused = |corners: &[[f64; 3]]| {
        let corners: Vec<DVec3> = corners.iter().map(|&c| c.into()).collect();
        Light::polygon(&corners, [1.0; 3]).unwrap_err().to_string()
    };
    let says = |corners: &[[f64; 3]], what: &str| {
        let text = refused(corners);
        assert!(text.contains(what), "{text}");
    };
    let [a, b, c, d] = [
        [0.0, 0.0, 2.0],
        [1.0, 0.0, 2.0],
        [1.0, 1.0, 2.0],
        [0.0, 1.0, 2.0],
    ];
    says(&[a, b], "expected 3 to 1024, got 2");
    says(&[a, b, [1.0, f64::NAN, 2.0]], "finite");
    says(&[a, b, c, [0.0, 1.0, 2.1]], "one plane");
    says(&[a, b, c, [0.0, 1.0, 2.1]], "vertex ");
    says(&[a, b, [2.0, 0.0, 2.0]], "no area");
    says(&[a, a, a], "all vertices are at");
    says(&[a, b, c, d, a], "vertices 4 and 0 are one point");
    says(&[a, b, b, c, d], "vertices 1 and 2 are one point");
    says(
        &[a, [2.0, 0.0, 2.0], b, c, d],
        "turns back on itself at vertex 1",
    );
    // A bow-tie with one wing larger than the other.
    says(
        &[a, b, [0.0, 1.0, 2.0], [3.0, 2.0, 2.0]],
        "from vertex 1 to 2 and that from vertex 3 to 0",
    );
    // A corner on another edge, and two corners at one place.
    says(&[a, b, c, [0.5, 0.0, 2.0], d], "meets itself");
    says(
        &[
            a,
            b,
            c,
            [0.5, 0.5, 2.0],
            d,
            [-1.0, 1.0, 2.0],
            [0.5, 0.5, 2.0],
        ],
        "meets itself",
    );
}

#[test]
fn corners_may_be_off_the_plane_by_the_rounding_of_their_coordinates() {
    let far = |x: f64| DVec3::new(1e6 + x.cos(), x.sin() - 2e6, 0.3 * x.cos() - 0.7 * x.sin());
    let corners: Vec<DVec3> = (0..7).map(|i| far(f64::from(i) * 0.9)).collect();
    let light = Light::polygon(&corners, [1.0; 3]).unwrap();
    let single: Vec<DVec3> = corners
        .iter()
        .map(|&c| (c - DVec3::new(1e6, -2e6, 0.0)).as_vec3().as_dvec3())
        .collect();
    assert!(Light::polygon(&single, [1.0; 3]).is_ok());
    // The outline's corners, back in the world, are the given ones but for rounding.
    let own = polygon(&light);
    for (c, corner) in own.corners().iter().zip(&corners) {
        let back = own.center + c.x * own.u + c.y * own.v;
        assert!((back - *corner).length() < 2e-9, "{back} {corner}");
    }
}
