//! The root of the covariance of a bordered system: of every group its own columns, and those of the border.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::dense;
use super::matrix::Matrix;

/// F (n, rank) of a bordered system: the border's columns first, then those of each group.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct BorderedRoot {
    /// Columns of the border (m) in the system.
    pub border: Vec<usize>,
    /// F_Z (m, r).
    pub of_border: Matrix,
    pub groups: Vec<GroupRoot>,
    /// Of each unknown (n) the group that it belongs to, nothing for one of the border; and its place there.
    places: Vec<(Option<usize>, usize)>,
}

/// The rows of F that belong to a group.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct GroupRoot {
    /// Its columns (k) in the system.
    pub columns: Vec<usize>,
    /// The first column of F that no other group has.
    pub first: usize,
    /// F_s (k, r_s), in those.
    pub own: Matrix,
    /// −F_s C_s F_Z (k, r), in those of the border.
    pub along: Matrix,
}

impl BorderedRoot {
    pub fn new(n: usize, border: Vec<usize>, of_border: Matrix, groups: Vec<GroupRoot>) -> Self {
        let mut places = vec![(None, 0); n];
        for (at, &column) in border.iter().enumerate() {
            places[column] = (None, at);
        }
        for (number, group) in groups.iter().enumerate() {
            for (at, &column) in group.columns.iter().enumerate() {
                places[column] = (Some(number), at);
            }
        }
        Self { border, of_border, groups, places }
    }

    pub fn n_rows(&self) -> usize {
        self.places.len()
    }

    pub fn n_columns(&self) -> usize {
        let of_groups = self.groups.last().map(|group| group.first + group.own.n_columns());
        of_groups.unwrap_or(self.of_border.n_columns())
    }

    /// The entries of a row: those of the border's columns, and of its own ones from a first on.
    fn row(&self, row: usize) -> (impl Iterator<Item = f64>, usize, impl Iterator<Item = f64>) {
        let (group, at) = self.places[row];
        let group = group.map(|number| &self.groups[number]);
        let of_border = group.map_or(&self.of_border, |group| &group.along);
        let own = group.map(|group| (0..group.own.n_columns()).map(move |j| group.own[(at, j)]));
        let of_border = (0..of_border.n_columns()).map(move |j| of_border[(at, j)]);
        (of_border, group.map_or(0, |group| group.first), own.into_iter().flatten())
    }

    /// Some rows of it.
    pub fn rows(&self, rows: Range<usize>) -> Matrix {
        let mut some = Matrix::zeros(rows.len(), self.n_columns());
        for (to, row) in rows.enumerate() {
            let (of_border, first, own) = self.row(row);
            of_border.enumerate().for_each(|(j, value)| some[(to, j)] = value);
            own.enumerate().for_each(|(j, value)| some[(to, first + j)] = value);
        }
        some
    }

    pub fn row_norms(&self) -> Vec<f64> {
        let of = |row| {
            let (of_border, _, own) = self.row(row);
            of_border.chain(own).map(|value| value * value).sum::<f64>().sqrt()
        };
        (0..self.n_rows()).map(of).collect()
    }

    /// `F y`.
    pub fn times(&self, y: &[f64]) -> Vec<f64> {
        let mut x = vec![0.0; self.n_rows()];
        let of_border = Matrix::from_column(y[..self.of_border.n_columns()].to_vec());
        let moved = dense::product(&self.of_border, &of_border);
        self.border.iter().zip(moved.as_slice()).for_each(|(&column, &value)| x[column] = value);
        for group in &self.groups {
            let own = Matrix::from_column(y[group.first..][..group.own.n_columns()].to_vec());
            group.add_times(&own, &of_border, &mut x);
        }
        x
    }

    /// `Fᵀ x`.
    pub fn transposed_times(&self, x: &[f64]) -> Vec<f64> {
        let some = |columns: &[usize]| Matrix::from_column(columns.iter().map(|&column| x[column]).collect());
        let mut y = dense::transposed_product(&self.of_border, &some(&self.border)).into_values();
        for group in &self.groups {
            let own = some(&group.columns);
            let along = dense::transposed_product(&group.along, &own);
            y.iter_mut().zip(along.as_slice()).for_each(|(sum, value)| *sum += value);
            y.extend_from_slice(dense::transposed_product(&group.own, &own).as_slice());
        }
        y
    }
}

impl GroupRoot {
    /// Adds `F_s y_s − F_s C_s F_Z y` to its unknowns among all x.
    pub fn add_times(&self, own: &Matrix, of_border: &Matrix, x: &mut [f64]) {
        let (first, second) = (dense::product(&self.own, own), dense::product(&self.along, of_border));
        let sums = first.as_slice().iter().zip(second.as_slice());
        self.columns.iter().zip(sums).for_each(|(&column, (first, second))| x[column] += first + second);
    }
}
