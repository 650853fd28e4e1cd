//! Bordered systems, against the same solved as a whole.

use std::ops::Range;

use geoerr_core::least_squares::{
    Blocks, Border, BorderedTriangle, Group, LeastSquaresError, LeftOut, Matrix, Options, Restriction,
    Solution, StoredDesign, Triangle, leave_blocks_out_of_residuals, leave_bordered_blocks_out, solve,
};
use rayon::ThreadPoolBuilder;

use super::common::{difference, largest, product};
use crate::draws::Draws;

const TOLERANCE: f64 = 1e-5;
const N_BORDER: usize = 5;
const N_OWN: usize = 3;

/// Rows of a border of five columns and of groups of so many rows, with three columns each; the first rows of each group
/// are the last to be left out.
struct System {
    a: Matrix,
    b: Matrix,
    border: Border,
    group: Vec<usize>,
}

fn system(heights: &[usize], seed: u64) -> System {
    let mut draws = Draws::new(seed);
    let n_columns = N_BORDER + N_OWN * heights.len();
    let mut groups: Vec<Group> = Vec::new();
    let mut group = Vec::new();
    for (number, &height) in heights.iter().enumerate() {
        let rows = group.len()..group.len() + height;
        let first = N_BORDER + N_OWN * number;
        groups.push(Group { rows, columns: (first..first + N_OWN).collect() });
        group.resize(group.len() + height, number);
    }
    let dense = draws.matrix(group.len(), N_BORDER + N_OWN);
    let a = Matrix::from_fn(group.len(), n_columns, |row, column| match column.checked_sub(N_BORDER) {
        // Columns of very different size, as millimetres and radians are.
        None => dense[(row, column)] * 10.0_f64.powi(column as i32),
        Some(own) if own / N_OWN == group[row] => dense[(row, N_BORDER + own % N_OWN)],
        Some(_) => 0.0,
    });
    let b = draws.matrix(group.len(), 1);
    System { a, b, border: Border::new(n_columns, groups).unwrap(), group }
}

impl System {
    fn nothing(&self) -> Matrix {
        Matrix::zeros(self.a.n_rows(), 0)
    }

    fn bordered(&self, constraints: &Matrix) -> Solution {
        let nothing = self.nothing();
        let design = StoredDesign::new(&self.a, &nothing).unwrap();
        let border = self.border.clone();
        let triangle = BorderedTriangle::for_rank_within(&design, border, TOLERANCE, constraints).unwrap();
        triangle.solve(constraints, TOLERANCE).unwrap()
    }

    fn whole(&self, constraints: &Matrix) -> Solution {
        let nothing = self.nothing();
        let triangle = Triangle::of(&StoredDesign::new(&self.a, &nothing).unwrap()).unwrap();
        let restriction = match constraints.n_rows() {
            0 => Restriction::None,
            _ => Restriction::Constraints(constraints.clone()),
        };
        let options = Options { restriction, rank_tolerance: Some(TOLERANCE), ..Options::default() };
        solve(&triangle, &options).unwrap()
    }

    fn free(&self) -> Matrix {
        Matrix::zeros(0, self.a.n_columns())
    }

    /// What both say of the same system: everything that does not hang on the point taken along free directions.
    fn assert_same(&self, constraints: &Matrix) -> (Solution, Solution) {
        let (bordered, whole) = (self.bordered(constraints), self.whole(constraints));
        assert_eq!(bordered.rank.rank, whole.rank.rank);
        assert_eq!(bordered.n_free, whole.n_free);
        assert_eq!(bordered.is_determined, whole.is_determined);
        assert_eq!(bordered.null_space.n_columns(), whole.null_space.n_columns());
        assert!(largest(product(&self.a, &bordered.null_space).as_slice().iter().copied()) < 1e-9);
        assert!(bordered.condition > 0.8 * whole.condition && bordered.condition < 4.0 * whole.condition);
        // The hat matrix, and what it makes of the right-hand side.
        let hats = [&bordered, &whole].map(|solution| {
            let root = product(&self.a, &solution.covariance_root());
            product(&root, &root.transposed())
        });
        assert!(difference(hats[0].as_slice(), hats[1].as_slice()) < 1e-11);
        let gradient = product(&self.a.transposed(), &self.b).into_values();
        let steps = [&bordered, &whole].map(|solution| solution.solve_normal(&gradient).unwrap());
        let errors = [&bordered, &whole].map(Solution::standard_errors);
        for (column, _) in whole.is_determined.iter().enumerate().filter(|(_, determined)| **determined) {
            // What is held at 0 is it to rounding.
            let rounding = 1e-9 * errors[1][column] + 1e-17;
            assert!((steps[0][column] - steps[1][column]).abs() <= rounding);
            assert!((errors[0][column] - errors[1][column]).abs() <= rounding);
        }
        let first = bordered.covariance_root_of_first(N_BORDER).unwrap();
        let all = bordered.covariance_root();
        assert!((0..N_BORDER).all(|i| (0..first.n_columns()).all(|j| first[(i, j)] == all[(i, j)])));
        (bordered, whole)
    }
}

fn steps_of(system: &System, solution: &Solution) -> Matrix {
    let gradient = product(&system.a.transposed(), &system.b).into_values();
    Matrix::from_column(solution.solve_normal(&gradient).unwrap())
}

#[test]
fn few_and_many_groups_are_solved_as_the_whole_is() {
    for heights in [vec![40, 30], vec![12; 60], vec![2000, 7, 9]] {
        let system = system(&heights, 1);
        let (bordered, whole) = system.assert_same(&system.free());
        assert!(bordered.is_determined.iter().all(|&is_determined| is_determined));
        let covariances = [bordered.covariance(), whole.covariance()];
        let size = largest(covariances[1].as_slice().iter().copied());
        assert!(difference(covariances[0].as_slice(), covariances[1].as_slice()) < 1e-11 * size);
    }
}

#[test]
fn groups_with_too_few_rows_leave_their_own_unknowns_open() {
    // Of one row, of two, of none, and of as many as there are unknowns: these say nothing about the border.
    let system = system(&[30, 1, 2, 0, 3, 25], 2);
    let (bordered, _) = system.assert_same(&system.free());
    let open: Vec<usize> =
        (0..bordered.is_determined.len()).filter(|&i| !bordered.is_determined[i]).collect();
    assert_eq!(open, (N_BORDER + N_OWN..N_BORDER + 4 * N_OWN).collect::<Vec<_>>());
}

/// The sum of the first own columns of all groups as the border's last: what a gauge is.
fn with_gauge(mut system: System) -> System {
    for (row, &group) in system.group.iter().enumerate() {
        system.a[(row, N_BORDER - 1)] = 1e3 * system.a[(row, N_BORDER + N_OWN * group)];
    }
    system
}

#[test]
fn what_the_border_repeats_of_all_groups_is_open() {
    let system = with_gauge(system(&[20; 15], 3));
    let (bordered, _) = system.assert_same(&system.free());
    assert_eq!(bordered.null_space.n_columns(), 1);
    assert!(!bordered.is_determined[N_BORDER - 1] && bordered.is_determined[0]);
    assert!(!bordered.is_determined[N_BORDER] && bordered.is_determined[N_BORDER + 1]);
}

#[test]
fn constraints_hold_the_border_and_groups() {
    let system = with_gauge(system(&[20, 1, 18, 25], 4));
    let n = system.a.n_columns();
    // A gauge, and one direction in a group.
    let mut constraints = Matrix::zeros(2, n);
    constraints[(0, N_BORDER - 1)] = 1.0;
    constraints[(1, N_BORDER + 2 * N_OWN)] = 1.0;
    constraints[(1, N_BORDER + 2 * N_OWN + 1)] = -2.0;
    let (bordered, _) = system.assert_same(&constraints);
    let held = product(&constraints, &bordered.covariance_root());
    assert!(largest(held.as_slice().iter().copied()) < 1e-12);
}

#[test]
fn an_unknown_of_a_group_is_held_by_nothing_else() {
    let system = system(&[20, 20], 5);
    let nothing = system.nothing();
    let design = StoredDesign::new(&system.a, &nothing).unwrap();
    let mut across = system.free();
    assert!(BorderedTriangle::for_rank_within(&design, system.border.clone(), TOLERANCE, &across).is_ok());
    across = Matrix::zeros(1, system.a.n_columns());
    across[(0, 0)] = 1.0;
    across[(0, N_BORDER)] = 1.0;
    let refused = BorderedTriangle::for_rank_within(&design, system.border.clone(), TOLERANCE, &across);
    assert_eq!(refused.unwrap_err(), LeastSquaresError::NotOwn { column: N_BORDER });
    let twice = |rows: Range<usize>| Group { rows, columns: vec![1] };
    let refused = Border::new(3, vec![twice(0..2), twice(2..4)]);
    assert_eq!(refused.unwrap_err(), LeastSquaresError::NotOwn { column: 1 });
    let mut infinite = system.a.clone();
    infinite[(25, N_BORDER + N_OWN + 1)] = f64::NAN;
    let design = StoredDesign::new(&infinite, &nothing).unwrap();
    let refused =
        BorderedTriangle::for_rank_within(&design, system.border.clone(), TOLERANCE, &system.free());
    assert_eq!(refused.unwrap_err(), LeastSquaresError::NonFinite { row: 25, column: N_BORDER + N_OWN + 1 });
}

#[test]
fn rows_that_hold_the_border_are_appended() {
    let system = system(&[20, 1, 18], 6);
    let nothing = system.nothing();
    let design = StoredDesign::new(&system.a, &nothing).unwrap();
    let mut prior = Matrix::zeros(1, system.a.n_columns());
    prior[(0, 2)] = 300.0;
    let (border, free) = (system.border.clone(), system.free());
    let mut bordered = BorderedTriangle::for_rank_within(&design, border, TOLERANCE, &free).unwrap();
    bordered.append(&prior).unwrap();
    let mut whole = Triangle::of(&design).unwrap();
    whole.append(&prior).unwrap();
    let options = Options { rank_tolerance: Some(TOLERANCE), ..Options::default() };
    let (bordered, whole) = (bordered.solve(&free, TOLERANCE).unwrap(), solve(&whole, &options).unwrap());
    for column in (0..N_BORDER + N_OWN).chain(N_BORDER + 2 * N_OWN..N_BORDER + 3 * N_OWN) {
        let errors = [&bordered, &whole].map(|solution| solution.standard_errors()[column]);
        assert!((errors[0] / errors[1] - 1.0).abs() < 1e-11);
    }
}

/// Both ways to leave the blocks out, of the residuals that the bordered solution leaves.
fn left_out(system: &System, starts: &[usize], own: &[usize], weights: Option<&[f64]>) -> [LeftOut; 2] {
    let (bordered, whole) = system.assert_same(&system.free());
    let moved = product(&system.a, &steps_of(system, &bordered));
    let residual = Matrix::from_fn(system.b.n_rows(), 1, |row, _| system.b[(row, 0)] - moved[(row, 0)]);
    let design = StoredDesign::new(&system.a, &residual).unwrap();
    let blocks = Blocks::starting_at(starts, system.a.n_rows()).unwrap();
    [
        leave_bordered_blocks_out(&design, &bordered, &system.group, &blocks, own, weights).unwrap(),
        leave_blocks_out_of_residuals(&design, &whole, &blocks, own, weights).unwrap(),
    ]
}

fn assert_alike([bordered, whole]: &[LeftOut; 2]) {
    assert_eq!(bordered.is_determined, whole.is_determined);
    let close = |one: &[f64], other: &[f64]| {
        one.iter().zip(other).all(|(one, other)| {
            (one.is_nan() && other.is_nan()) || (one - other).abs() < 1e-8 * (1.0 + other.abs())
        })
    };
    assert!(close(&bordered.residual, &whole.residual));
    assert!(close(&bordered.held_out, &whole.held_out));
    assert!(close(&bordered.prediction_variance, &whole.prediction_variance));
}

#[test]
fn blocks_are_left_out_as_of_the_whole() {
    // Blocks within a group, of whole groups and across them. Of the fourth group one row is in another block than the
    // rest, and tells one of its unknowns.
    let system = system(&[30, 25, 6, 20, 1, 40], 7);
    let starts = [0, 10, 40, 55, 80];
    let weights: Vec<f64> = (0..system.a.n_rows()).map(|row| 1.0 + row as f64 % 3.0).collect();
    let found = left_out(&system, &starts, &[0, 0, 0, 5, 4], Some(&weights));
    assert_alike(&found);
    assert_eq!(found[0].is_determined, [true, true, true, true, true]);
    assert_alike(&left_out(&system, &starts, &[0, 0, 0, 5, 4], Some(&vec![2.5; weights.len()])));
    // Without unknowns of their own, blocks with whole groups are not determined.
    let found = left_out(&system, &starts, &[0; 5], None);
    assert_alike(&found);
    assert_eq!(found[0].is_determined, [true, true, true, false, false]);
}

#[test]
fn a_block_that_alone_tells_an_unknown_of_the_border_is_said_to() {
    let mut system = system(&[30, 25, 20], 8);
    for row in (0..30).chain(40..75) {
        system.a[(row, 2)] = 0.0;
    }
    let starts = [0, 15, 30, 40, 55];
    let found = left_out(&system, &starts, &[0, 0, 0, 0, 3], None);
    assert_alike(&found);
    assert_eq!(found[0].is_determined, [true, true, false, true, true]);
    let found = left_out(&system, &starts, &[0, 0, 1, 0, 3], None);
    assert_alike(&found);
    assert!(found[0].is_determined.iter().all(|&is_determined| is_determined));
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let system = system(&[12; 40], 9);
    let found = [1, 2, 5].map(|threads| {
        ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let solution = system.bordered(&system.free());
            (
                solution.covariance_root().as_slice().to_vec(),
                left_out(&system, &[0, 100, 230], &[24, 30, 61], None)[0].held_out.clone(),
            )
        })
    });
    assert!(found[0].1.iter().all(|value| value.is_finite()));
    assert!(found[0] == found[1] && found[0] == found[2]);
}
