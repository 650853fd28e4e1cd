//! Draws whitened by the noise that their own fits find: against such fits, one by one.

use geoerr_core::noise_likelihood::{Blocks, Likelihood, Logs};
use nalgebra::DMatrix;

use crate::draws::Draws;

const SHORTEST: f64 = 0.05;
const N_DRAWS: usize = 40;

/// Rows in blocks of twelve, two sessions of 40 blocks, passes of four blocks; columns for the mean of each session and
/// component.
struct Scene {
    weights: Vec<[f64; 3]>,
    basis: Vec<f64>,
    blocks: Blocks,
    n_rows: usize,
}

impl Scene {
    fn new() -> Self {
        let (n_blocks, rows_of_block) = (80, 12);
        let n_rows = n_blocks * rows_of_block;
        let of_row: Vec<usize> = (0..n_rows).map(|row| row / rows_of_block).collect();
        let passes = (0..n_blocks).map(|block| (block / 4) as i64).collect();
        let time = (0..n_blocks).map(|block| (block % 40) as f64 / 40.0).collect();
        let size = (2.0 / n_rows as f64).sqrt();
        let is_in = |row: usize, c: usize, column: usize| column == 3 * (2 * row / n_rows) + c;
        let basis = (0..3 * n_rows)
            .flat_map(|at| (0..6).map(move |column| if is_in(at / 3, at % 3, column) { size } else { 0.0 }))
            .collect();
        let blocks = Blocks::new(of_row, &[0, 40], passes, time).unwrap();
        Self { weights: vec![[1.0; 3]; n_rows], basis, blocks, n_rows }
    }

    /// Uᵀ y of each block.
    fn sums(&self, y: &[[f64; 3]], c: usize) -> Vec<f64> {
        y.chunks_exact(12)
            .map(|block| block.iter().map(|row| row[c]).sum::<f64>() / 12.0_f64.sqrt())
            .collect()
    }
}

/// Of a drift, offsets and scatter 1, as one component has them after the first-order process is run.
fn noise(scene: &Scene, draws: &mut Draws, offset: f64, drift: f64, memory: f64) -> Vec<f64> {
    let (mut y, mut state, mut own) = (Vec::new(), 0.0, 0.0);
    for block in 0..scene.blocks.len() {
        let keep = if block % 40 == 0 { 0.0 } else { (-1.0 / (40.0 * memory)).exp() };
        state = keep * state + drift * (1.0 - keep * keep).sqrt() * draws.normal();
        if block % 4 == 0 {
            own = offset * draws.normal();
        }
        y.extend((0..12).map(|_| draws.normal() + state + own));
    }
    y
}

/// T of either session of a component, written out: every block's weights are the same, and so are both sessions.
fn inverse_root(logs: Logs) -> DMatrix<f64> {
    let [_, offset2, drift2, memory] = logs.map(f64::exp);
    let covariance = DMatrix::from_fn(40, 40, |i, j| {
        let offset = if i / 4 == j / 4 { offset2 } else { 0.0 };
        let drift = drift2 * (-(i as f64 - j as f64).abs() / (40.0 * memory)).exp();
        12.0 * (offset + drift) + if i == j { 1.0 } else { 0.0 }
    });
    covariance.cholesky().unwrap().l().try_inverse().unwrap()
}

/// Falls of the sums of squares of every draw and component, by fits of the whole likelihood and by trial values.
fn falls(offset: f64, drift: f64, memory: f64) -> Vec<[f64; 2]> {
    let scene = Scene::new();
    let logs: [Logs; 3] = [[0.0, 2.0 * offset.max(1e-7).ln(), 2.0 * drift.max(1e-7).ln(), memory.ln()]; 3];
    let mut draws = Draws::new(11);
    let root = logs.map(inverse_root);
    let times = |own: &[f64], matrix: &DMatrix<f64>| -> Vec<f64> {
        (0..40).map(|i| (0..=i).map(|j| matrix[(i, j)] * own[j]).sum::<f64>()).collect()
    };
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    // Off what T Uᵀ makes of the means of sessions.
    let off_means = |values: &[f64], root: &DMatrix<f64>| -> Vec<f64> {
        let mut result = Vec::new();
        for own in values.chunks_exact(40) {
            let mean = times(&[1.0; 40], root);
            let share = product(own, &mean) / product(&mean, &mean);
            result.extend(own.iter().zip(&mean).map(|(own, mean)| own - share * mean));
        }
        result
    };
    let whitened = |sums: &[f64], root: &DMatrix<f64>| -> Vec<f64> {
        off_means(&sums.chunks_exact(40).flat_map(|own| times(own, root)).collect::<Vec<_>>(), root)
    };
    // (n_blocks, n_draws) of each component, off the means of sessions in the metric of the noise.
    let mut all = [vec![0.0; 80 * N_DRAWS], vec![0.0; 80 * N_DRAWS], vec![0.0; 80 * N_DRAWS]];
    let mut own_fits = Vec::new();
    for draw in 0..N_DRAWS {
        let by_component = [0, 1, 2].map(|_| noise(&scene, &mut draws, offset, drift, memory));
        let y: Vec<[f64; 3]> =
            (0..scene.n_rows).map(|row| by_component.each_ref().map(|own| own[row])).collect();
        let likelihood = Likelihood::new(scene.blocks.clone(), &scene.weights, &y, &scene.basis, 6).unwrap();
        let fitted = likelihood.fit(Some(logs), SHORTEST, true).unwrap();
        let refitted = likelihood.fit(None, SHORTEST, true).unwrap();
        let better = if refitted.minus_twice_ln_likelihood < fitted.minus_twice_ln_likelihood {
            refitted
        } else {
            fitted
        };
        let of_fit = better.logs.map(inverse_root);
        for c in 0..3 {
            let sums = scene.sums(&y, c);
            let own = whitened(&sums, &root[c]);
            let anew = whitened(&sums, &of_fit[c]);
            own_fits.push(product(&anew, &anew) - product(&own, &own));
            for (block, value) in own.iter().enumerate() {
                all[c][block * N_DRAWS + draw] = *value;
            }
        }
    }
    let sums = all.each_ref().map(Vec::as_slice);
    let changes = scene.blocks.fitted_to_draws(&scene.weights, &logs, SHORTEST, sums, N_DRAWS).unwrap();
    let mut result = Vec::new();
    for draw in 0..N_DRAWS {
        for c in 0..3 {
            let was: Vec<f64> = (0..80).map(|block| all[c][block * N_DRAWS + draw]).collect();
            let moved = was.iter().enumerate().map(|(block, was)| was + changes[c][block * N_DRAWS + draw]);
            let moved = off_means(&moved.collect::<Vec<_>>(), &root[c]);
            let fall = product(&moved, &moved) - product(&was, &was);
            result.push([own_fits[3 * draw + c], fall]);
        }
    }
    result
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count() as f64;
    values.sum::<f64>() / count
}

fn correlation(pairs: &[[f64; 2]]) -> f64 {
    let [a, b] = [0, 1].map(|i| mean(pairs.iter().map(move |pair| pair[i])));
    let product = |i: usize, j: usize| {
        let centre = [a, b];
        mean(pairs.iter().map(move |pair| (pair[i] - centre[i]) * (pair[j] - centre[j])))
    };
    product(0, 1) / (product(0, 0) * product(1, 1)).sqrt()
}

#[test]
fn trial_values_do_what_fits_of_the_whole_likelihood_do() {
    // White noise, of which fits find a little of both; offsets alone; a drift that is known well.
    for (offset, drift, memory) in [(0.0, 0.0, 0.3), (0.5, 0.0, 0.3), (0.2, 0.8, 0.2)] {
        let pairs = falls(offset, drift, memory);
        let [by_fits, by_trials] = [0, 1].map(|i| mean(pairs.iter().map(move |pair| pair[i])));
        let told = correlation(&pairs);
        // A sum of 80 squares scatters by 12.6, and trial values may move its mean by half of that otherwise than fits do;
        // coarse as they are, draw by draw they tell more than half of what differs.
        assert!((by_fits - by_trials).abs() < 6.3, "{offset} {drift}: {by_fits} and {by_trials}");
        assert!(told > 0.5_f64.sqrt(), "{offset} {drift}: {told}");
    }
}

#[test]
fn bytes_of_draws_do_not_depend_on_the_number_of_threads() {
    let scene = Scene::new();
    let logs: [Logs; 3] = [[0.0, -3.0, -2.0, -1.0], [0.0, -16.0, -16.0, 0.0], [0.0, -1.0, -16.0, 0.0]];
    let mut draws = Draws::new(5);
    let all = [0, 1, 2].map(|_| (0..80 * N_DRAWS).map(|_| draws.normal()).collect::<Vec<f64>>());
    let by = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let sums = all.each_ref().map(Vec::as_slice);
        pool.install(|| scene.blocks.fitted_to_draws(&scene.weights, &logs, SHORTEST, sums, N_DRAWS).unwrap())
    };
    let one = by(1);
    assert_eq!(one, by(2));
    assert_eq!(one, by(5));
}

#[test]
fn no_draws_and_components_without_numbers_change_nothing_and_lengths_are_held_to() {
    let scene = Scene::new();
    let logs = [[0.0, -3.0, -2.0, -1.0]; 3];
    let none = scene.blocks.fitted_to_draws(&scene.weights, &logs, SHORTEST, [&[]; 3], 0).unwrap();
    assert!(none.iter().all(Vec::is_empty));
    let sums = vec![1.0; 160];
    let weights: Vec<[f64; 3]> = scene.weights.iter().map(|_| [1.0, 0.0, 1.0]).collect();
    let some = scene.blocks.fitted_to_draws(&weights, &logs, SHORTEST, [&sums; 3], 2).unwrap();
    assert!(some[0].iter().any(|change| *change != 0.0) && some[1].iter().all(|change| *change == 0.0));
    assert!(scene.blocks.fitted_to_draws(&weights, &logs, SHORTEST, [&sums, &sums, &sums[1..]], 2).is_err());
    assert!(scene.blocks.fitted_to_draws(&weights[1..], &logs, SHORTEST, [&sums; 3], 2).is_err());
}

#[test]
fn what_is_taken_off_is_as_written_out_for_any_number_of_threads() {
    let scene = Scene::new();
    let logs: [Logs; 3] = [[0.0, -3.0, -2.0, -1.0], [0.0, -16.0, -16.0, 0.0], [0.0, -1.0, -16.0, 0.0]];
    let (n, n_draws, size) = (scene.n_rows, 7, 0.8);
    let mut draws = Draws::new(23);
    let drawn: Vec<f32> = (0..3 * n * n_draws).map(|_| (size * draws.normal()) as f32).collect();
    let by = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut own = drawn.clone();
        let (basis, weights) = (&scene.basis, &scene.weights);
        pool.install(|| scene.blocks.take_off(&mut own, n_draws, basis, weights, &logs, SHORTEST, size))
            .unwrap();
        own
    };
    let found = by(1);
    assert_eq!(found, by(2));
    assert_eq!(found, by(5));

    let off_basis = |values: &[f64]| -> Vec<f64> {
        let mut left = values.to_vec();
        for column in 0..6 {
            let inside: f64 = (0..3 * n).map(|at| scene.basis[6 * at + column] * values[at]).sum();
            (0..3 * n).for_each(|at| left[at] -= scene.basis[6 * at + column] * inside);
        }
        left
    };
    let column =
        |draw: usize| -> Vec<f64> { (0..3 * n).map(|at| f64::from(drawn[at * n_draws + draw])).collect() };
    let left: Vec<Vec<f64>> = (0..n_draws).map(|draw| off_basis(&column(draw))).collect();
    let sums = [0, 1, 2].map(|c| {
        let mut own = vec![0.0; 80 * n_draws];
        for (draw, left) in left.iter().enumerate() {
            let rows: Vec<[f64; 3]> = left.as_chunks::<3>().0.to_vec();
            for (block, sum) in scene.sums(&rows, c).into_iter().enumerate() {
                own[block * n_draws + draw] = sum / size;
            }
        }
        own
    });
    let own = sums.each_ref().map(Vec::as_slice);
    let changes = scene.blocks.fitted_to_draws(&scene.weights, &logs, SHORTEST, own, n_draws).unwrap();
    for draw in 0..n_draws {
        let mut expected = column(draw);
        for (at, value) in expected.iter_mut().enumerate() {
            *value += size * changes[at % 3][at / 36 * n_draws + draw] / 12.0_f64.sqrt();
        }
        for (at, value) in off_basis(&expected).into_iter().enumerate() {
            // Single precision, of numbers of about 1.
            let miss = f64::from(found[at * n_draws + draw]) - value;
            assert!(miss.abs() < 1e-5, "{at} {draw}: {miss}");
        }
    }
    let mut short = drawn[1..].to_vec();
    let (basis, weights) = (&scene.basis, &scene.weights);
    assert!(scene.blocks.take_off(&mut short, n_draws, basis, weights, &logs, SHORTEST, size).is_err());
    let mut own = drawn.clone();
    assert!(scene.blocks.take_off(&mut own, n_draws, &basis[1..], weights, &logs, SHORTEST, size).is_err());
    assert!(scene.blocks.take_off(&mut own, n_draws, basis, &weights[1..], &logs, SHORTEST, size).is_err());
}
