use super::*;
use crate::light::Light;
use crate::sampling::{Pattern, Sampler};
use crate::simd::detect;
use fearless_simd::dispatch;

/// Numbers between 0 and 1 without end.
fn numbers() -> impl FnMut() -> f32 {
    let mut state = 1u32;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    }
}

/// A light seen as a square or a disk, and counts of nothing.
fn grid(disk: bool, normal: Option<DVec3>) -> Grid {
    let light = if disk {
        Light::disk(DVec3::Z, DVec3::NEG_Z, 0.5, [1.0; 3])
    } else {
        Light::rect(DVec3::Z, DVec3::Y, DVec3::X, [1.0; 3])
    };
    let square = Sampler::new(light.unwrap(), Pattern::new(1, 0), false).square(DVec3::ZERO);
    let mut grid = Grid::new(Layout::new(1024));
    grid.shift([0x1234_5678, 0x9abc_def0]);
    let chosen = dispatch!(detect(), simd => grid.choose(simd, &square, normal));
    let (width, all) = (grid.layout.columns as f64, grid.layout.points() as f64);
    let part = if disk {
        std::f64::consts::FRAC_PI_4
    } else {
        1.0
    };
    if normal.is_none() {
        // By a point or so a row at either end.
        assert!(
            (chosen as f64 - part * all).abs() < width,
            "{chosen} of {all}"
        );
    }
    grid
}

/// How many triangles cover a point, in f64.
fn cover(triangles: &[[[f32; 2]; 3]], [x, y]: [f64; 2]) -> i16 {
    let left = |a: [f32; 2], b: [f32; 2]| {
        let [ax, ay, bx, by] = [a[0], a[1], b[0], b[1]].map(f64::from);
        (bx - ax) * (y - ay) > (by - ay) * (x - ax)
    };
    let inside = |t: &&[[f32; 2]; 3]| {
        let sides = [0, 1, 2].map(|k| left(t[k], t[(k + 1) % 3]));
        sides == [true; 3] || sides == [false; 3]
    };
    triangles.iter().filter(inside).count() as i16
}

#[test]
fn counts_are_those_of_triangles_one_by_one() {
    let horizon = Some(DVec3::new(0.8, 0.2, 0.1).normalize());
    for (disk, normal) in [
        (false, None),
        (true, None),
        (false, horizon),
        (true, horizon),
    ] {
        let mut grid = grid(disk, normal);
        let mut number = numbers();
        let mut corner = || [number() * 120.0 - 30.0, number() * 60.0 - 15.0];
        let triangles: Vec<[[f32; 2]; 3]> =
            (0..40).map(|_| [corner(), corner(), corner()]).collect();
        for t in &triangles {
            let [a, b, c] = t.map(|p| p.map(f64::from));
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            for k in 0..3 {
                grid.draw(t[k], t[(k + 1) % 3], if area > 0.0 { 1 } else { -1 });
            }
        }
        dispatch!(detect(), simd => grid.count(simd));
        let mut constant = None;
        for row in 0..grid.layout.rows {
            for column in 0..grid.layout.columns {
                let block = row / LANES * (grid.layout.columns + 1);
                let count = grid.changes[block + column].0[row % LANES];
                if count == NOWHERE {
                    continue;
                }
                let x = column as f32 + grid.shifts[row / LANES].0[row % LANES];
                let covered = cover(&triangles, [f64::from(x), row as f64]);
                let difference = count - covered;
                assert_eq!(
                    difference,
                    *constant.get_or_insert(difference),
                    "{row} {column}"
                );
            }
        }
        assert!(constant.is_some());
    }
}

#[test]
fn points_beside_a_polygon_have_no_count() {
    let mut grid = grid(false, None);
    // A dart with a reflex corner, and corners on the border of the square.
    let dart = [[0.0f32, 0.0], [1.0, 0.5], [0.0, 1.0], [0.4, 0.5]];
    dispatch!(detect(), simd => grid.count(simd));
    grid.keep_within(&dart);
    let columns = grid.layout.columns;
    let (mut kept, mut wrong) = (0, 0);
    for r in grid.range() {
        for column in 0..columns {
            let [s, t] = grid.point([r, column]);
            let inside = |low: f64, high: f64| t > low && t < high;
            let (near, far) = (0.5 * s, 1.0 - 0.5 * s);
            let hollow = s < 0.4 && inside(1.25 * s, 1.0 - 1.25 * s);
            let expected = s > 0.0 && s < 1.0 && inside(near, far) && !hollow;
            let at = r / LANES * (columns + 1) + column;
            let found = grid.changes[at].0[r % LANES] != NOWHERE;
            kept += usize::from(found);
            wrong += usize::from(found != expected);
        }
    }
    // Half of the square less a fifth of it; points on its sides are on one or the other.
    let part = kept as f64 / grid.layout.points() as f64;
    assert!(wrong <= 2 && (part - 0.3).abs() < 0.02, "{wrong} {part}");
}
