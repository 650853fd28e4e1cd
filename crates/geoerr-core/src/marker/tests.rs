//! Derivatives against differences, the lens against its inverse, and a picture drawn by brute force.

use proptest::prelude::*;

use super::model::{Evaluated, FIRST_BLUR, FIRST_LEVEL, N_LIGHT, N_UNKNOWNS, State};
use super::scene::Scene;
use super::*;

const SIDE: usize = 220;
const LENS: Lens = Lens {
    focal_px: [1200.0, 1190.0],
    principal_point_px: [-150.0, 420.0],
    distortion: [-0.12, 0.15, 6e-4, -4e-4, 0.01, 0.0, 0.0, 0.0, 1e-4, 0.0, -2e-4, 0.0],
};

/// A marker of four by four cells inside its border, that no turn makes the same.
fn pattern() -> Vec<bool> {
    let cells = ["......", ".#..#.", "..#...", ".##.#.", "....#.", "......"];
    cells.iter().flat_map(|row| row.chars().map(|cell| cell == '#')).collect()
}

/// Where a plane's points (in modules) are seen, undistorted: a homography written down.
fn ray_of([s, t]: [f64; 2]) -> [f64; 2] {
    let w = 1.0 + 0.011 * s - 0.007 * t;
    [(0.162 + 0.0141 * s + 0.0021 * t) / w, (-0.298 - 0.0013 * s + 0.0152 * t) / w]
}

fn corners_px() -> [[f64; 2]; 4] {
    [[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]].map(|corner| pixel_of(ray_of(corner)))
}

fn pixel_of(ray: [f64; 2]) -> [f64; 2] {
    let (bent, _) = LENS.bent(ray);
    [0, 1].map(|c| bent[c] * LENS.focal_px[c] + LENS.principal_point_px[c])
}

/// The place on the marker that a ray sees: Newton's method on `ray_of`.
fn place_of(ray: [f64; 2]) -> [f64; 2] {
    let mut place = [3.0, 3.0];
    for _ in 0..20 {
        let h = 1e-6;
        let now = ray_of(place);
        let [by_s, by_t] = [[h, 0.0], [0.0, h]].map(|step| {
            let next = ray_of([place[0] + step[0], place[1] + step[1]]);
            [(next[0] - now[0]) / h, (next[1] - now[1]) / h]
        });
        let off = [ray[0] - now[0], ray[1] - now[1]];
        let determinant = by_s[0] * by_t[1] - by_t[0] * by_s[1];
        place[0] += (off[0] * by_t[1] - by_t[0] * off[1]) / determinant;
        place[1] += (by_s[0] * off[1] - by_s[1] * off[0]) / determinant;
    }
    place
}

/// A picture of the marker, each pixel the mean of 8 × 8 points of the sharp pattern over a square of 2.4 px.
fn drawn() -> Vec<u8> {
    let pattern = pattern();
    let colour = |[s, t]: [f64; 2]| {
        let inside = (0.0..6.0).contains(&s) && (0.0..6.0).contains(&t);
        if inside && !pattern[t as usize * 6 + s as usize] { 40.0 } else { 210.0 }
    };
    let mut picture = Vec::with_capacity(SIDE * SIDE);
    for v in 0..SIDE {
        for u in 0..SIDE {
            let mut sum = 0.0_f64;
            for part in 0..64 {
                let off = [part % 8, part / 8].map(|index| 2.4 * ((f64::from(index) + 0.5) / 8.0 - 0.5));
                let ray = LENS.ray([u as f64 + off[0], v as f64 + off[1]]).unwrap();
                sum += colour(place_of(ray)) / 64.0;
            }
            picture.push(sum.round() as u8);
        }
    }
    picture
}

#[test]
fn corners_of_a_drawn_marker_are_found_from_two_pixels_off() {
    let picture = drawn();
    let start = corners_px();
    assert!(start.iter().flatten().all(|&place| (20.0..200.0).contains(&place)), "{start:?}");
    let off = [[2.0, -1.0], [-1.5, -1.0], [1.0, 2.0], [0.5, -2.0]];
    let start = std::array::from_fn(|i| [0, 1].map(|c| start[i][c] + off[i][c]));
    let seen = Picture { grey: &picture, width: SIDE };
    let fit = fit_marker(seen, &LENS, &pattern(), start).unwrap();
    let exact =
        [[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]].map(|corner| LENS.undistorted_pixel(ray_of(corner)));
    for (found, exact) in fit.corners_px.iter().flatten().zip(exact.iter().flatten()) {
        assert!((found - exact).abs() < 0.01, "{:?} is not {exact:?}", fit.corners_px);
    }
    assert!((fit.contrast_grey - 170.0).abs() < 2.0);
    // A square of 2.4 px has a standard deviation of 2.4/√12; it is steeper at its ends than a Gaussian.
    assert!(fit.blur_px.iter().all(|blur| (blur - 0.69).abs() < 0.1), "{:?}", fit.blur_px);
    let turned: Vec<bool> = (0..36).map(|cell| pattern()[(5 - cell % 6) * 6 + cell / 6]).collect();
    let another = fit_marker(seen, &LENS, &turned, start).unwrap_err();
    assert!(another.is_another(), "{another}");
}

/// The picture in other light, with noise of 2 grey levels (the sum of twelve even numbers, of a linear congruence).
fn lit(picture: &[u8], light: impl Fn(f64, f64) -> f64) -> Vec<u8> {
    let mut state = 9_u64;
    let mut even = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    (picture.iter().enumerate())
        .map(|(place, &grey)| {
            let noise: f64 = (0..12).map(|_| even()).sum();
            let light = light((place % SIDE) as f64, (place / SIDE) as f64);
            (f64::from(grey) * light + 2.0 * noise).round().clamp(0.0, 255.0) as u8
        })
        .collect()
}

#[test]
fn under_a_shadow_corners_are_off_by_what_they_state() {
    let picture = drawn();
    let fit = |grey: &[u8]| fit_marker(Picture { grey, width: SIDE }, &LENS, &pattern(), corners_px());
    let even = fit(&lit(&picture, |u, v| 1.05 - 1e-3 * u + 5e-4 * v - 2e-6 * u * v)).unwrap();
    assert_eq!(even.unevenness, 1.0);
    let shadow = |factor: f64, turn: f64, off_px: f64| {
        let grey = lit(&picture, |u, v| {
            let beyond = (u - 110.0) * turn.cos() + (v - 110.0) * turn.sin() - off_px;
            if beyond > 0.0 { 1.0 } else { factor }
        });
        fit(&grey)
    };
    let exact =
        [[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]].map(|corner| LENS.undistorted_pixel(ray_of(corner)));
    let (mut squares, mut by_pixels) = (0.0, 0.0);
    // Along the plate and across it, from one side of it to the other.
    for number in (0..32).map(f64::from) {
        let found = shadow(0.85, 0.8 * number, 40.0 * (2.4 * number).sin()).unwrap();
        for (i, (found_px, exact)) in
            found.corners_px.iter().flatten().zip(exact.iter().flatten()).enumerate()
        {
            let square = (found_px - exact).powi(2) / found.covariance_px2[i][i] / 256.0;
            squares += square;
            by_pixels += square * found.unevenness.powi(2);
        }
    }
    assert!(squares < 2.0 && by_pixels > 5.0, "{squares}, {by_pixels} pixel by pixel");
    assert!(matches!(shadow(0.55, 0.3, 0.0), Err(MarkerError::Uneven { .. })));
}

#[test]
fn derivatives_are_those_of_differences() {
    let picture = drawn();
    let seen = Picture { grey: &picture, width: SIDE };
    for blur in [0.8, 4.0] {
        let scene = Scene::new(seen, LENS, &pattern(), corners_px()).unwrap();
        let mut state = scene.starting_state().unwrap();
        state.blur_px2 = [blur, 0.1, 1.2 * blur];
        state.levels[0] = 42.0;
        state.levels[1] = 3.0;
        state.levels[N_LIGHT] = 205.0;
        state.levels[N_LIGHT + 4] = -5.0;
        let pixels = scene.select(&state, 5000, 1);
        let of = |state: &State| {
            let (mut residuals, mut columns) = (Vec::new(), Vec::new());
            pixels.each(state, &scene, false, |_, own: &Evaluated| {
                residuals.extend(own.residual.0);
                columns.push(own.columns);
            });
            (residuals, columns)
        };
        let (_, columns) = of(&state);
        for k in 0..N_UNKNOWNS {
            let size = if k < FIRST_LEVEL { 2e-3 } else { 0.5 };
            let moved = |sign: f64| {
                let mut state = state;
                match k {
                    0..FIRST_BLUR => state.homography[k] += sign * size,
                    FIRST_BLUR..FIRST_LEVEL => state.blur_px2[k - FIRST_BLUR] += sign * size,
                    _ => state.levels[k - FIRST_LEVEL] += sign * size,
                }
                of(&state).0
            };
            let own: Vec<f64> = columns.iter().flat_map(|block| block[k].0).map(f64::from).collect();
            let largest = own.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
            let squares: f64 = (moved(-1.0).iter().zip(moved(1.0)).zip(&own))
                .map(|((&before, after), column)| {
                    ((f64::from(before) - f64::from(after)) / (2.0 * size) - column).powi(2)
                })
                .sum();
            // By the blur, terms of the third order at the pattern's vertices are left out, and what follows from the
            // blur's change with the place.
            let bound = if (FIRST_BLUR..FIRST_LEVEL).contains(&k) { 0.06 } else { 0.03 };
            assert!((squares / own.len() as f64).sqrt() < bound * largest, "unknown {k}, blur {blur}");
        }
    }
}

#[test]
fn what_is_no_marker_is_refused() {
    let (picture, pattern) = (vec![120_u8; SIDE * SIDE], pattern());
    let seen = Picture { grey: &picture, width: SIDE };
    let fit = |corners| fit_marker(seen, &LENS, &pattern, corners).unwrap_err();
    assert!(fit(corners_px()).is_another());
    assert!(matches!(fit(corners_px().map(|corner| corner.map(|c| 0.05 * c))), MarkerError::TooSmall { .. }));
    assert_eq!(fit(corners_px().map(|corner| corner.map(|c| c + 9e3))), MarkerError::Outside);
    for times in [1e3, 1e21, 1e300] {
        assert_eq!(fit(corners_px().map(|corner| corner.map(|c| times * (c - 40.0)))), MarkerError::Outside);
    }
    assert!(matches!(fit([[f64::NAN; 2]; 4]), MarkerError::TooSmall { .. }));
    let straight = Lens { distortion: [0.0; 12], ..LENS };
    let line = [[20.0, 20.0], [60.0, 60.0], [100.0, 100.0], [140.0, 140.0]];
    assert_eq!(fit_marker(seen, &straight, &pattern, line).unwrap_err(), MarkerError::InOneLine);
    let short = Picture { grey: &picture[1..], width: SIDE };
    assert!(matches!(fit_marker(short, &LENS, &pattern, corners_px()), Err(MarkerError::Length { .. })));
    assert!(matches!(fit_marker(seen, &LENS, &pattern[1..], corners_px()), Err(MarkerError::Length { .. })));
}

proptest! {
    #[test]
    fn a_pixel_sees_the_ray_that_is_shown_there(x in -0.3..0.3_f64, y in -0.3..0.3_f64) {
        let back = LENS.ray(pixel_of([x, y])).unwrap();
        prop_assert!((back[0] - x).abs() < 1e-11 && (back[1] - y).abs() < 1e-11);
        let (at, slope) = LENS.bent([x, y]);
        for c in 0..2 {
            let h = 1e-6;
            let mut moved = [x, y];
            moved[c] += h;
            let (next, _) = LENS.bent(moved);
            for r in 0..2 {
                prop_assert!(((next[r] - at[r]) / h - slope[r][c]).abs() < 1e-5);
            }
        }
    }
}
