//! The design against differences of the exact residuals, for every channel and several machines.

use geoerr_core::bases::Basis;
use geoerr_core::expression::{Definitions, Expression, Symbols};
use geoerr_core::kinematics::{Axis, Carrier, Chain, Channel, Pose};
use geoerr_core::least_squares::{Design, Matrix};
use geoerr_core::volumetric::{
    Frame, Part, Problem, Rows, Shape, Sightings, State, Term, VolumetricError, VolumetricModel,
    WhitenedDesign, channel_values, displacements,
};

use crate::draws::Draws;

fn formula(text: &str, coefficients: &[&str], inner: &[&str]) -> Expression {
    let names = |names: &[&str]| names.iter().map(ToString::to_string).collect();
    let symbols = Symbols {
        variables: names(&["x", "y", "temp"]),
        coefficients: names(coefficients),
        inner: names(inner),
    };
    Expression::parse(text, &symbols, &Definitions::from_iter([("T", "temp - 20")])).unwrap()
}

/// One constant on every channel, a spline on one joint, and a formula with an inner parameter on another.
fn model(chain: &str) -> VolumetricModel {
    let constant = |channel: Channel| Term {
        parts: vec![Part {
            channel,
            factor: 1.0,
            shape: Shape::Expression {
                expression: formula("c", &["c"], &[]),
                coefficients: vec![0],
                inner: vec![],
            },
        }],
        n_coefficients: 1,
        n_inner: 0,
    };
    let mut terms: Vec<Term> = Channel::ALL.into_iter().map(constant).collect();
    let basis = Basis::bspline(vec![0.0, 150.0, 400.0], 3).unwrap();
    let n_coefficients = basis.len();
    let straightness = Basis::tangent_integral(basis.clone()).unwrap();
    terms.push(Term {
        parts: vec![
            Part {
                channel: Channel::parse("ECX").unwrap(),
                factor: 1.0,
                shape: Shape::Basis { axis: Axis::X, basis },
            },
            Part {
                channel: Channel::parse("EYX").unwrap(),
                factor: -1.0,
                shape: Shape::Basis { axis: Axis::X, basis: straightness },
            },
        ],
        n_coefficients,
        n_inner: 0,
    });
    terms.push(Term {
        parts: vec![Part {
            channel: Channel::parse("EYY").unwrap(),
            factor: 1.0,
            shape: Shape::Expression {
                expression: formula("alpha*T*sin(y/p)", &["alpha"], &["p"]),
                coefficients: vec![0],
                inner: vec![0],
            },
        }],
        n_coefficients: 1,
        n_inner: 1,
    });
    VolumetricModel::new(Chain::parse(chain).unwrap(), [3.0, -2.0, 5.0], terms).unwrap()
}

fn problem(chain: &str) -> (Problem, State) {
    let mut draws = Draws::new(7);
    let model = model(chain);
    let n_rows = 40;
    let mut rows = Rows { starts: vec![0], ..Rows::default() };
    let (mut x, mut y, mut temp) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..n_rows {
        rows.carriers.push(Carrier::ALL[row % 4]);
        let q_mm = draws.three(200.0).map(|v| v + 200.0);
        rows.q_mm.push(q_mm);
        rows.offset_mm.push(draws.three(150.0));
        x.push(q_mm[0]);
        y.push(q_mm[1]);
        temp.push(20.0 + 30.0 * draws.symmetric());
    }
    rows.variables = vec![x, y, temp];
    let pose = Pose::default().moved(&[-200.0, 100.0, 900.0], &[0.4, -0.3, 0.2]);
    let frames = vec![
        Frame::Positions { pose, pivot_mm: [200.0; 3], turns: true },
        Frame::Positions { pose: Pose::default(), pivot_mm: [0.0; 3], turns: false },
        Frame::Circle { centre_mm: [210.0, 190.0, 5.0], excess_mm: 0.1 },
        Frame::Lengths,
    ];
    // Whitening of circles and lengths sees one number only; of some rows of the second session one component.
    let session: Vec<usize> = (0..n_rows).map(|row| row % 4).collect();
    // Ends of a length are seen from the same carrier, and need not stand together.
    let length = (0..n_rows).map(|row| (row % 4 == 3).then_some(row / 4 % 5)).collect();
    let whitening = session
        .iter()
        .enumerate()
        .map(|(row, &session)| match session {
            0 => [[120.0, 10.0, -5.0], [10.0, 90.0, 20.0], [-5.0, 20.0, 60.0]],
            1 if row % 2 == 0 => [[0.0; 3], [0.0, 100.0, 0.0], [0.0; 3]],
            1 => [[100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]],
            _ => [[50.0, 0.0, 0.0], [0.0; 3], [0.0; 3]],
        })
        .collect();
    let sightings = Sightings {
        measured_mm: (0..n_rows).map(|_| draws.three(300.0)).collect(),
        whitening,
        session,
        length,
        shared: (0..n_rows * 6).map(|_| draws.symmetric()).collect(),
        n_shared: 2,
        rows,
    };
    let state = State {
        coefficients: vec![0.0; model.n_coefficients()],
        inner: vec![70.0],
        frames: frames.clone(),
        shared: vec![0.0; 2],
    };
    (Problem::new(model, sightings, &frames, vec![0]).unwrap(), state)
}

const CHAINS: [&str; 5] = ["wZbXYt", "wbXYZt", "wXYbZt", "wXYZbt", "wYbZXt"];

#[test]
fn the_design_is_the_derivative_of_the_exact_residuals() {
    for chain in CHAINS {
        let (problem, mut state) = problem(chain);
        // The derivative by an inner parameter is 0 unless its coefficient is not.
        let alpha = state.coefficients.len() - 1;
        state.coefficients[alpha] = 1e-5;
        let n_rows = problem.n_rows();
        let height = 3 * n_rows;
        let block = problem.blocks(&state).unwrap();
        let mut design = vec![0.0; height * block.n_columns()];
        block.fill(&(0..n_rows).collect::<Vec<_>>(), &vec![1.0; n_rows], &mut design);
        for column in 0..problem.n_columns() {
            let moved = |step: f64| {
                let mut correction = vec![0.0; problem.n_columns()];
                correction[column] = step;
                let state = problem.corrected(&state, &correction).unwrap();
                problem.whitened(&problem.residuals(&state).unwrap())
            };
            // Rotations of 1e-6 rad at 700 mm and 900 mm: what is beyond first order is below 1e-6 of a column.
            let step = 1e-6;
            let (plus, minus) = (moved(step), moved(-step));
            for row in 0..n_rows {
                for c in 0..3 {
                    let difference = -(plus[row][c] - minus[row][c]) / (2.0 * step);
                    let analytic = design[column * height + 3 * row + c];
                    // alpha alone moves the chain: 2e-3 mm of it at a lever of 1, beside numbers of up to 1e5.
                    let bound = 2e-4 * analytic.abs().max(100.0);
                    assert!(
                        (difference - analytic).abs() < bound,
                        "{chain}, column {column}, row {row}, component {c}: {difference} {analytic}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_gradient_is_the_design_times_the_residuals() {
    let (problem, state) = problem("wZbXYt");
    let n_rows = problem.n_rows();
    let scale: Vec<f64> =
        (0..n_rows).map(|row| if row % 7 == 0 { 0.0 } else { 0.5 + 0.01 * row as f64 }).collect();
    let whitened = problem.whitened(&problem.residuals(&state).unwrap());
    let block = problem.blocks(&state).unwrap();
    let gradient = block.gradient(&whitened, &scale);
    let mut design = vec![0.0; 3 * n_rows * block.n_columns()];
    block.fill(&(0..n_rows).collect::<Vec<_>>(), &scale, &mut design);
    for (column, found) in design.chunks_exact(3 * n_rows).zip(&gradient) {
        let expected: f64 = (0..3 * n_rows).map(|k| column[k] * scale[k / 3] * whitened[k / 3][k % 3]).sum();
        assert!((found - expected).abs() <= 1e-9 * expected.abs().max(1.0), "{found} {expected}");
    }
}

#[test]
fn the_gram_matrix_is_that_of_the_design() {
    for chain in ["wZbXYt", "wbXYZt"] {
        let (problem, state) = problem(chain);
        let n_rows = problem.n_rows();
        let scale: Vec<f64> =
            (0..n_rows).map(|row| if row % 7 == 0 { 0.0 } else { 0.5 + 0.01 * row as f64 }).collect();
        let block = problem.blocks(&state).unwrap();
        let mut design = vec![0.0; 3 * n_rows * block.n_columns()];
        block.fill(&(0..n_rows).collect::<Vec<_>>(), &scale, &mut design);
        let columns: Vec<&[f64]> = design.chunks_exact(3 * n_rows).collect();
        let product = |one: usize, two: usize| -> f64 {
            columns[one].iter().zip(columns[two]).map(|(a, b)| a * b).sum()
        };
        let gram = block.gram(&scale);
        for one in 0..columns.len() {
            for two in 0..columns.len() {
                let size = (product(one, one) * product(two, two)).sqrt();
                let difference = (gram[(one, two)] - product(one, two)).abs();
                assert!(difference <= 1e-14 * size, "{chain} {one} {two}: {difference:e} of {size:e}");
            }
        }
        assert_eq!(gram, gram.transposed());
        // And along directions: against products with the matrix itself.
        let mut draws = Draws::new(8);
        let (n, d) = (columns.len(), 5);
        let directions = draws.matrix(n, d);
        let (across, squares) = block.along(&directions, &scale);
        let times = |row: usize, along: usize| -> f64 {
            (0..n).map(|column| gram[(row, column)] * directions[(column, along)]).sum()
        };
        let largest = (0..n).map(|column| gram[(column, column)].sqrt()).fold(0.0, f64::max);
        for along in 0..d {
            for row in 0..n {
                let size = gram[(row, row)].sqrt() * largest * n as f64;
                assert!(
                    (across[(row, along)] - times(row, along)).abs() <= 1e-14 * size,
                    "{chain} {row} {along}"
                );
            }
            for other in 0..d {
                let expected: f64 = (0..n).map(|row| directions[(row, other)] * times(row, along)).sum();
                let size = (largest * n as f64).powi(2);
                assert!(
                    (squares[(other, along)] - expected).abs() <= 1e-14 * size,
                    "{chain} {other} {along}"
                );
            }
        }
        // The rows themselves times a matrix.
        let all: Vec<usize> = (0..n_rows).collect();
        let moved = block.times(&directions, &all, &scale);
        for (row, along) in (0..3 * n_rows).flat_map(|row| (0..d).map(move |along| (row, along))) {
            let entries = || (0..n).map(|column| columns[column][row] * directions[(column, along)]);
            let (expected, sizes): (f64, f64) = (entries().sum(), entries().map(f64::abs).sum());
            assert!((moved[row * d + along] - expected).abs() <= 1e-14 * sizes, "{chain} {row} {along}");
        }
        assert!(block.times(&Matrix::zeros(n, 0), &all, &scale).is_empty());
        // Of some rows alone, and what each of them makes of a direction.
        let some: Vec<usize> = (0..n_rows).rev().step_by(3).collect();
        for (moved_alone, row) in block.times(&directions, &some, &scale).chunks_exact(3 * d).zip(&some) {
            let pairs = moved_alone.iter().zip(&moved[3 * d * row..]);
            pairs.for_each(|(alone, among)| assert!((alone - among).abs() <= 1e-12 * among.abs().max(1.0)));
        }
        let numbers: Vec<[f64; 3]> = some.iter().map(|_| [(); 3].map(|()| draws.symmetric())).collect();
        let weights: Vec<f64> = (0..3 * some.len()).map(|number| 0.5 + (number % 7) as f64).collect();
        let (own, weighted, products) = block.sums_of(&some, &numbers, Some(&weights), &scale);
        let weighted = weighted.unwrap();
        assert_eq!(block.sums_of(&some, &numbers, None, &scale), (own.clone(), None, products.clone()));
        let first_order = block.first_order(&some, &scale, directions.column(0));
        let mut expected = (Matrix::zeros(n, n), vec![0.0; n], Matrix::zeros(n, n));
        for (at, row) in some.iter().enumerate() {
            for c in 0..3 {
                let a: Vec<f64> = columns.iter().map(|column| column[3 * row + c]).collect();
                for one in 0..n {
                    expected.1[one] += a[one] * numbers[at][c];
                    for two in 0..n {
                        expected.0[(one, two)] += a[one] * a[two];
                        expected.2[(one, two)] += weights[3 * at + c] * a[one] * a[two];
                    }
                }
                let along: f64 = a.iter().zip(directions.column(0)).map(|(a, x)| a * x).sum();
                let sizes: f64 = a.iter().zip(directions.column(0)).map(|(a, x)| (a * x).abs()).sum();
                assert!((first_order[at][c] - along).abs() <= 1e-13 * sizes, "{chain} {row} {c}");
            }
        }
        for one in 0..n {
            let size = gram[(one, one)].sqrt();
            assert!((products[one] - expected.1[one]).abs() <= 1e-12 * size, "{chain} {one}");
            for two in 0..n {
                let size = size * gram[(two, two)].sqrt();
                for (found, expected, largest) in [(&own, &expected.0, 1.0), (&weighted, &expected.2, 6.5)] {
                    let difference = (found[(one, two)] - expected[(one, two)]).abs();
                    assert!(difference <= 1e-13 * largest * size, "{chain} {one} {two}");
                }
            }
        }
        // Some columns alone.
        let some_columns = [n - 1, 0, n / 2];
        let mut unscaled = vec![0.0; 3 * n_rows * n];
        block.fill(&(0..n_rows).collect::<Vec<_>>(), &vec![1.0; n_rows], &mut unscaled);
        for (&column, found) in some_columns.iter().zip(block.largest_entries(&some_columns).unwrap()) {
            let own = &unscaled[column * 3 * n_rows..][..3 * n_rows];
            assert_eq!(
                found,
                own.iter().fold(0.0, |most: f64, value| most.max(value.abs())),
                "{chain} {column}"
            );
        }
        let own = block.gram_columns(&some_columns, &scale);
        for (k, &column) in some_columns.iter().enumerate() {
            for row in 0..n {
                let size = (gram[(row, row)] * gram[(column, column)]).sqrt();
                assert!(
                    (own[(row, k)] - gram[(row, column)]).abs() <= 1e-14 * size,
                    "{chain} {row} {column}"
                );
            }
        }
        // From the matrix of another design, whose columns stand elsewhere: some of them are known.
        let design = WhitenedDesign::without_residuals(&problem, &state, &scale).unwrap();
        let known = Matrix::from_fn(n, n, |row, column| gram[(n - 1 - row, n - 1 - column)]);
        let places: Vec<_> = (0..n).map(|column| (column % 3 > 0).then_some(n - 1 - column)).collect();
        let from_known = design.gram_from(&known, &places).unwrap();
        for (row, column) in (0..n).flat_map(|row| (0..n).map(move |column| (row, column))) {
            let size = (gram[(row, row)] * gram[(column, column)]).sqrt();
            assert!(
                (from_known[(row, column)] - gram[(row, column)]).abs() <= 1e-14 * size,
                "{chain} {row} {column}"
            );
        }
        assert!(design.gram_from(&known, &places[1..]).is_err());
        assert!(design.gram_from(&known, &vec![Some(n); n]).is_err());
        let mut bad = scale;
        bad[3] = f64::NAN;
        assert!(block.gram(&bad).first_non_finite().is_some());
    }
}

#[test]
fn blocks_begin_at_the_sums_that_are_known_of_them() {
    let (problem, state) = problem("wZbXYt");
    let (n_rows, n) = (problem.n_rows(), problem.n_columns());
    let mut draws = Draws::new(41);
    let scale: Vec<f64> = (0..n_rows).map(|_| 1.0 + 0.5 * draws.symmetric()).collect();
    let residuals: Vec<[f64; 3]> = problem.residuals(&state).unwrap();
    let order: Vec<usize> = (0..n_rows).rev().collect();
    let design = || WhitenedDesign::in_order(&problem, &state, &residuals, &scale, order.clone()).unwrap();
    let rows = 0..3 * (n_rows / 2);
    let weights: Vec<f64> = rows.clone().map(|_| 3.0 + 2.5 * draws.symmetric()).collect();
    let same: Vec<Option<usize>> = (0..n).map(Some).collect();
    for weights in [None, Some(weights.as_slice())] {
        let whole = design().keeping_sums();
        let expected = whole.sums_of(rows.clone(), weights).unwrap();
        let known = whole.into_kept_sums().unwrap();
        // What is known of some columns only, and of all but the numbers.
        for places in [same.iter().map(|&place| place.filter(|place| place % 3 > 0)).collect(), same.clone()]
        {
            let found =
                design().beginning_at(&known, &places).unwrap().sums_of(rows.clone(), weights).unwrap();
            assert_eq!(found.rhs, expected.rhs);
            for one in 0..n {
                let size = expected.gram[(one, one)].sqrt();
                let length = expected.rhs.as_slice().iter().map(|b| b * b).sum::<f64>().sqrt();
                assert!(
                    (found.products[(one, 0)] - expected.products[(one, 0)]).abs() <= 1e-13 * size * length
                );
                for two in 0..n {
                    let size = size * expected.gram[(two, two)].sqrt();
                    assert!((found.gram[(one, two)] - expected.gram[(one, two)]).abs() <= 1e-13 * size);
                    if let (Some(found), Some(expected)) = (&found.weighted, &expected.weighted) {
                        assert!((found[(one, two)] - expected[(one, two)]).abs() <= 6e-13 * size);
                    }
                }
            }
            assert_eq!(found.weighted.is_some(), weights.is_some());
        }
        // Of other rows, or with weights where there were none, they are made whole.
        let begun = design().beginning_at(&known, &same).unwrap();
        let others = 0..rows.end - 3;
        assert_eq!(begun.sums_of(others.clone(), None), design().sums_of(others, None));
        assert!(design().beginning_at(&known, &same[1..]).is_err());
        assert!(design().beginning_at(&known, &vec![Some(n); n]).is_err());
    }
}

#[test]
fn parts_of_a_range_are_those_of_the_whole() {
    let (problem, state) = problem("wXYbZt");
    let n_rows = problem.n_rows();
    let block = problem.blocks(&state).unwrap();
    let scale = vec![1.0; n_rows];
    let mut whole = vec![0.0; 3 * n_rows * block.n_columns()];
    block.fill(&(0..n_rows).collect::<Vec<_>>(), &scale, &mut whole);
    let (first, last) = (11, 29);
    let mut part = vec![0.0; 3 * (last - first) * block.n_columns()];
    block.fill(&(first..last).collect::<Vec<_>>(), &scale, &mut part);
    for column in 0..block.n_columns() {
        let expected = &whole[column * 3 * n_rows..][3 * first..3 * last];
        assert_eq!(&part[column * 3 * (last - first)..][..3 * (last - first)], expected);
    }
}

#[test]
fn displacements_add_the_parts_on_their_channels() {
    let model = model("wbXYZt");
    let rows = Rows {
        carriers: vec![Carrier::Relative; 2],
        q_mm: vec![[10.0, 20.0, 30.0], [300.0, 20.0, 30.0]],
        offset_mm: vec![[0.0; 3]; 2],
        variables: vec![vec![10.0, 300.0], vec![20.0; 2], vec![45.0; 2]],
        starts: vec![0],
        t_s: None,
    };
    let mut theta = vec![0.0; model.n_coefficients()];
    theta[Channel::parse("EXX").unwrap().index()] = 0.25;
    *theta.last_mut().unwrap() = 1e-3;
    let values = channel_values(&model, &rows, &theta, &[70.0]).unwrap();
    let growth = 1e-3 * 25.0 * (20.0f64 / 70.0).sin();
    assert_eq!(values.at(1)[Channel::parse("EXX").unwrap().index()], 0.25);
    assert!((values.at(0)[Channel::parse("EYY").unwrap().index()] - growth).abs() < 1e-15);
    let moved = displacements(&model, &rows, &theta, &[70.0]).unwrap();
    assert!((moved[0][0] - 0.25).abs() < 1e-15 && (moved[0][1] - growth).abs() < 1e-15 && moved[0][2] == 0.0);
}

#[test]
fn ends_of_a_length_have_half_each_of_what_it_is_off() {
    let (problem, mut state) = problem("wYbXZt");
    state.coefficients.iter_mut().enumerate().for_each(|(k, value)| *value = 1e-3 * (k as f64).sin());
    state.shared = vec![0.0; 2];
    let residuals = problem.residuals(&state).unwrap();
    let Sightings { rows, measured_mm, length, .. } = problem.sightings();
    let moved = displacements(problem.model(), rows, &state.coefficients, &state.inner).unwrap();
    let place = |row: usize| {
        let chain = problem.model().chain();
        let tool = problem.model().tool_offset_mm();
        let nominal = chain.nominal(rows.carriers[row], &rows.q_mm[row], &rows.offset_mm[row], tool);
        [0, 1, 2].map(|c| nominal[c] + moved[row][c])
    };
    for number in 0..5 {
        let ends: Vec<usize> = (0..problem.n_rows()).filter(|&row| length[row] == Some(number)).collect();
        let (one, two) = (place(ends[0]), place(ends[1]));
        let distance = (0..3).map(|c| (two[c] - one[c]).powi(2)).sum::<f64>().sqrt();
        let off = measured_mm[ends[1]][0] - distance;
        // What both have in common is where the middle lies.
        let apart = residuals[ends[1]][0] - residuals[ends[0]][0];
        let own = 0.5 * (off + measured_mm[ends[0]][0] - distance);
        assert!((apart - own).abs() < 1e-9, "{number}: {apart} {own}");
    }
}

#[test]
fn a_length_has_two_ends_that_are_apart() {
    let (problem, state) = problem("wYbXZt");
    let again = |change: fn(&mut Sightings)| {
        let mut sightings = problem.sightings().clone();
        change(&mut sightings);
        Problem::new(problem.model().clone(), sightings, &state.frames, vec![0]).map(|_| ())
    };
    assert_eq!(again(|_| ()), Ok(()));
    let one_end = again(|sightings| sightings.length[3] = None);
    assert!(matches!(one_end, Err(VolumetricError::Ends { n_ends: 1, .. })), "{one_end:?}");
    let three_ends = again(|sightings| sightings.length[0] = Some(0));
    assert!(matches!(three_ends, Err(VolumetricError::Ends { row: 0, n_ends: 3 })), "{three_ends:?}");
    let of_one_place = again(|sightings| {
        sightings.rows.q_mm[23] = sightings.rows.q_mm[3];
        sightings.rows.offset_mm[23] = sightings.rows.offset_mm[3];
    });
    assert_eq!(of_one_place, Err(VolumetricError::NoExtent { row: 3 }));
    let short = again(|sightings| sightings.length.truncate(7));
    assert!(matches!(short, Err(VolumetricError::Length { what: "length", .. })), "{short:?}");
}
