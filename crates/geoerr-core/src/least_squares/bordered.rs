//! Systems of which most unknowns belong to one group of rows each: the pose of a session, beside a model of all of them.
//!
//! With L_s the columns that only the rows of group s have, B_s the columns of the border there, and Q_s an orthonormal
//! basis of the columns of L_s,
//!
//! ```math
//! \begin{bmatrix} L_1 & & B_1 \\ & \ddots & \vdots \\ & & L_k\;\;B_k \end{bmatrix},\qquad
//! Q_s = L_s F_s,\quad C_s = Q_s^\mathsf{T} B_s,\quad Z_s = B_s - Q_s C_s,\qquad
//! A^\mathsf{T}A = \ldots\;\Rightarrow\;
//! F = \begin{bmatrix} F_1 & & -F_1 C_1 F_Z \\ & \ddots & \vdots \\ & & F_Z \end{bmatrix},\quad F F^\mathsf{T} = (A^\mathsf{T}A)^{+}
//! ```
//!
//! | symbol | code | meaning | shape |
//! |---|---|---|---|
//! | `$F_s$` | `own` | makes the columns of a group orthonormal: `$L_s F_s = Q_s$` | (k, r) |
//! | `$C_s$` | `along` | what the border has along them | (r, m) |
//! | `$Z$` | [`Eliminated`] | what it has across them: a system of m unknowns | (rows, m) |
//! | `$F_Z$` | - | root of the covariance of the border's unknowns, by Z | (m, r) |
//!
//! The projections are orthogonal, so that nothing is worse conditioned than by QR of the whole, and rows, columns and
//! memory grow with one another: a group costs its rows times m², whatever the number of groups. What of a group's own
//! columns no row tells is dropped before (its poses' null space); what the border repeats of all groups together, as a
//! gauge, is what Z tells. Both are decided at the same tolerance, Z's columns against the norms that B's have.
//!
//! # Source
//! Björck 1996, 6.3 (block angular least squares: QR of each block, then of what is left of the border). Golub & Plemmons
//! 1980, "Large-scale geodetic least-squares adjustment by dissection and orthogonal decomposition", Linear Algebra Appl. 34.
//! Giraud, Langou, Rozložník & van den Eshof 2005, Numer. Math. 101 (an orthonormal basis made twice is one to rounding).
//!
//! # Verified
//! `tests/least_squares/bordered.rs`: rank, null space, covariance and steps against those of the whole.

use std::ops::Range;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::blocks::{Blocks, Design, check_finite};
use super::bordered_root::{BorderedRoot, GroupRoot};
use super::dense;
use super::error::LeastSquaresError;
use super::matrix::{Matrix, norm};
use super::rank::{RankDecision, decide};
use super::restriction::Restriction;
use super::root::Root;
use super::solution::{Options, Solution, divide_columns, largest_singular_of, noise_of, scales, solve};
use super::triangle::Triangle;

/// Rows that are made at once.
const ROWS_AT_ONCE: usize = 1536;

/// Rows that have unknowns of their own.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Group {
    /// Where they are in the system.
    pub rows: Range<usize>,
    /// Columns that no other row has.
    pub columns: Vec<usize>,
}

/// Which unknowns belong to one group of rows, and which are those of the border: all others.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Border {
    n_columns: usize,
    groups: Vec<Group>,
    columns: Vec<usize>,
}

impl Border {
    /// Groups, one behind the other, of all rows of a system with so many columns.
    ///
    /// # Errors
    /// [`LeastSquaresError`] where rows are left out, or a column is in two groups or there is none such.
    pub fn new(n_columns: usize, groups: Vec<Group>) -> Result<Self, LeastSquaresError> {
        let mut is_taken = vec![false; n_columns];
        let mut next = 0;
        for (index, group) in groups.iter().enumerate() {
            if group.rows.start != next || group.rows.end < next {
                return Err(LeastSquaresError::Cuts { index });
            }
            next = group.rows.end;
            for &column in &group.columns {
                match is_taken.get_mut(column) {
                    Some(is_taken) if !*is_taken => *is_taken = true,
                    _ => return Err(LeastSquaresError::NotOwn { column }),
                }
            }
        }
        let columns = (0..n_columns).filter(|&column| !is_taken[column]).collect();
        Ok(Self { n_columns, groups, columns })
    }

    /// The groups.
    #[must_use]
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// Unknowns of the whole system.
    #[must_use]
    pub fn n_columns(&self) -> usize {
        self.n_columns
    }

    /// Columns of the border.
    #[must_use]
    pub fn columns(&self) -> &[usize] {
        &self.columns
    }

    fn n_rows(&self) -> usize {
        self.groups.last().map_or(0, |group| group.rows.end)
    }

    /// Rows over all unknowns as rows over the border's (second), and over those of each group that has some (first).
    fn split(&self, rows: &Matrix) -> Result<(Vec<Matrix>, Matrix), LeastSquaresError> {
        if rows.n_columns() != self.n_columns {
            let (expected, found) = (self.n_columns, rows.n_columns());
            return Err(LeastSquaresError::ColumnsDiffer { expected, found });
        }
        let mut owner = vec![None; self.n_columns];
        for (number, group) in self.groups.iter().enumerate() {
            group.columns.iter().for_each(|&column| owner[column] = Some(number));
        }
        let mut of_groups = vec![Vec::new(); self.groups.len()];
        let mut of_border = Vec::new();
        let mut first: Vec<Option<usize>> = vec![None; rows.n_rows()];
        for column in 0..self.n_columns {
            for (row, _) in rows.column(column).iter().enumerate().filter(|(_, value)| **value != 0.0) {
                let earlier = *first[row].get_or_insert(column);
                if owner[earlier] != owner[column] {
                    return Err(LeastSquaresError::NotOwn { column });
                }
            }
        }
        for (row, first) in first.iter().enumerate() {
            match first.and_then(|column| owner[column]) {
                Some(group) => of_groups[group].push(row),
                None => of_border.push(row),
            }
        }
        let some = |own: &[usize], columns: &[usize]| {
            Matrix::from_fn(own.len(), columns.len(), |i, j| rows[(own[i], columns[j])])
        };
        let of_groups =
            of_groups.iter().zip(&self.groups).map(|(own, group)| some(own, &group.columns)).collect();
        Ok((of_groups, some(&of_border, &self.columns)))
    }
}

/// What is left of a group's own unknowns once they are eliminated.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Own {
    /// F_s (k, r).
    root: Matrix,
    /// C_s (r, m).
    along: Matrix,
    /// Directions of its unknowns that its rows do not tell (k, d), orthonormal in scaled unknowns.
    null: Matrix,
    /// Norms of its columns (k).
    scale: Vec<f64>,
    /// How many unknowns its restriction leaves free.
    n_free: usize,
    rank: RankDecision,
    /// Largest singular value, columns of norm 1.
    largest: f64,
}

/// What a bordered system leaves behind: its groups' unknowns eliminated, and the triangle of the border's.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BorderedTriangle {
    border: Border,
    own: Vec<Own>,
    of_border: Triangle,
}

impl BorderedTriangle {
    /// The counterpart of [`Triangle::for_rank_within`], for solutions that are all restricted to `C x = 0`.
    ///
    /// # Errors
    /// The design's own, and [`LeastSquaresError`] for entries that are not finite, and for rows of the constraints that
    /// hold unknowns of a group to others.
    pub fn for_rank_within<D: Design + ?Sized>(
        design: &D,
        border: Border,
        tolerance: f64,
        constraints: &Matrix,
    ) -> Result<Self, D::Error> {
        for (expected, found) in [(design.n_rows(), border.n_rows()), (design.n_columns(), border.n_columns)]
        {
            if expected != found {
                return Err(LeastSquaresError::RowsDiffer { expected, found }.into());
            }
        }
        let (of_groups, of_border) = border.split(constraints)?;
        let found: Vec<Result<(Own, Vec<f64>), _>> = border
            .groups
            .par_iter()
            .zip(of_groups)
            .map(|(group, constraints)| eliminated(design, &border.columns, group, constraints, tolerance))
            .collect();
        let mut squares = vec![0.0; border.columns.len()];
        let mut own = Vec::with_capacity(found.len());
        for found in found {
            let (one, of_group) = found?;
            own.push(one);
            squares.iter_mut().zip(of_group).for_each(|(sum, square)| *sum += square);
        }
        let norms: Vec<f64> = squares.iter().map(|square| square.sqrt()).collect();
        let left = Eliminated { design, border: &border, own: &own, norms };
        let of_border = Triangle::for_rank_within(&left, tolerance, &of_border)?;
        Ok(Self { border, own, of_border })
    }

    /// Adds rows over all unknowns that hold those of the border.
    ///
    /// # Errors
    /// [`LeastSquaresError`] for another number of columns, for entries that are not finite, and for a group's unknowns.
    pub fn append(&mut self, rows: &Matrix) -> Result<(), LeastSquaresError> {
        let (of_groups, of_border) = self.border.split(rows)?;
        let held = of_groups.iter().position(|rows| rows.n_rows() > 0);
        match held.and_then(|group| self.border.groups[group].columns.first()) {
            Some(&column) => Err(LeastSquaresError::NotOwn { column }),
            None => self.of_border.append(&of_border),
        }
    }

    /// The solution with further constraints (p, n) on the border's unknowns: its root is a bordered one.
    ///
    /// `Solution::condition` is a bound from above to within a factor of √2, `Solution::null_space` the border's
    /// directions, and then each group's own.
    ///
    /// # Errors
    /// As [`solve`], and where a group's unknowns are constrained that were not when they were eliminated.
    pub fn solve(&self, constraints: &Matrix, rank_tolerance: f64) -> Result<Solution, LeastSquaresError> {
        let (_, of_border) = self.border.split(constraints)?;
        let restriction = match of_border.n_rows() {
            0 => Restriction::None,
            _ => Restriction::Constraints(of_border),
        };
        let options = Options { restriction, rank_tolerance: Some(rank_tolerance), ..Options::default() };
        let within = solve(&self.of_border, &options)?;
        let root = self.root_of(&within)?;
        let n = self.border.n_columns;
        let mut scale = vec![1.0; n];
        for (columns, own) in self.places().map(|(columns, own)| (columns, &own.scale)) {
            columns.iter().zip(own).for_each(|(&column, &own)| scale[column] = own);
        }
        self.border.columns.iter().zip(&within.scale).for_each(|(&column, &own)| scale[column] = own);
        let condition = self.condition(&within, &root, &scale);
        let noise = noise_of(condition);
        let null = self.null_space(&within, &scale, noise)?;
        let mixes = |row: usize| {
            norm(&(0..null.scaled.n_columns()).map(|j| null.scaled[(row, j)]).collect::<Vec<_>>())
        };
        let kept = self.own.iter().map(|own| own.rank.rank).sum::<usize>() + within.rank.rank;
        let gap = self.own.iter().map(|own| own.rank.gap).fold(within.rank.gap, f64::min);
        Ok(Solution {
            x: Matrix::zeros(n, 0),
            residual_ss: Vec::new(),
            degrees_of_freedom: self.of_border.n_rows().saturating_sub(kept),
            n_free: self.own.iter().map(|own| own.n_free).sum::<usize>() + within.n_free,
            rank: RankDecision { rank: kept, tolerance: rank_tolerance, gap },
            condition,
            singular_values: None,
            is_determined: (0..n).map(|row| mixes(row) <= noise).collect(),
            null_space: null.readable,
            root: Root::Bordered(root),
            root_error: condition * f64::EPSILON,
            null_scaled: null.scaled,
            noise,
            scale,
        })
    }

    fn places(&self) -> impl Iterator<Item = (&[usize], &Own)> {
        self.border.groups.iter().zip(&self.own).map(|(group, own)| (group.columns.as_slice(), own))
    }

    fn root_of(&self, within: &Solution) -> Result<BorderedRoot, LeastSquaresError> {
        let of_border = within.root.to_matrix().into_owned();
        let mut first = of_border.n_columns();
        let groups = self
            .places()
            .map(|(columns, own)| {
                let along = negative(dense::product(&own.root, &dense::product(&own.along, &of_border)));
                let group = GroupRoot { columns: columns.to_vec(), first, own: own.root.clone(), along };
                first += group.own.n_columns();
                group
            })
            .collect();
        Ok(BorderedRoot::new(self.border.n_columns, self.border.columns.clone(), of_border, groups))
    }

    /// The largest singular value of the scaled system, from above, times that of its root.
    fn condition(&self, within: &Solution, root: &BorderedRoot, scale: &[f64]) -> f64 {
        let mut of_border = self.of_border.r();
        divide_columns(&mut of_border, &within.scale);
        let across = largest_singular_of(
            within.scale.len(),
            &|x| {
                let unscaled = Matrix::from_fn(x.n_rows(), 1, |row, _| x[(row, 0)] / within.scale[row]);
                let mut image = dense::product(&of_border, x).into_values();
                for own in &self.own {
                    image.extend_from_slice(dense::product(&own.along, &unscaled).as_slice());
                }
                Matrix::from_column(image)
            },
            &|image| {
                let n = within.scale.len();
                let first = Matrix::from_column(image.as_slice()[..n].to_vec());
                let mut back = dense::transposed_product(&of_border, &first);
                let mut at = n;
                for own in &self.own {
                    let r = own.along.n_rows();
                    let part = Matrix::from_column(image.as_slice()[at..at + r].to_vec());
                    let part = dense::transposed_product(&own.along, &part);
                    let parts = part.as_slice().iter().zip(&within.scale);
                    back.as_mut_slice().iter_mut().zip(parts).for_each(|(sum, (part, s))| *sum += part / s);
                    at += r;
                }
                back
            },
        );
        let inside = self.own.iter().map(|own| own.largest).fold(0.0, f64::max);
        let times_scale = |x: &Matrix| Matrix::from_fn(x.n_rows(), 1, |row, _| x[(row, 0)] * scale[row]);
        let of_root = largest_singular_of(
            root.n_columns(),
            &|x| times_scale(&Matrix::from_column(root.times(x.as_slice()))),
            &|x| Matrix::from_column(root.transposed_times(times_scale(x).as_slice())),
        );
        if root.n_columns() == 0 { 1.0 } else { (across.hypot(inside) * of_root).max(1.0) }
    }

    /// Directions of all unknowns: the border's, with what groups then do, and those of each group alone.
    fn null_space(
        &self,
        within: &Solution,
        scale: &[f64],
        noise: f64,
    ) -> Result<NullSpace, LeastSquaresError> {
        let n = self.border.n_columns;
        let d = within.null_space.n_columns();
        let mut whole = Matrix::zeros(n, d);
        for direction in 0..d {
            let of_border = Matrix::from_column(within.null_space.column(direction).to_vec());
            let target = whole.column_mut(direction);
            self.border.columns.iter().zip(of_border.as_slice()).for_each(|(&to, &value)| target[to] = value);
            for (columns, own) in self.places() {
                let moved = dense::product(&own.root, &dense::product(&own.along, &of_border));
                columns.iter().zip(moved.as_slice()).for_each(|(&to, &value)| target[to] = -value);
            }
            target.iter_mut().zip(scale).for_each(|(value, scale)| *value *= scale);
        }
        // Orthonormal by eigenvectors of their products: they are few, and a basis already.
        let (values, vectors) = dense::symmetric_eigen(&dense::gram(&whole))?;
        let turn = Matrix::from_fn(d, d, |i, j| vectors[(i, j)] / values[j].max(f64::MIN_POSITIVE).sqrt());
        let mut scaled = dense::product(&whole, &turn);
        let mut readable = super::null_space::readable(&scaled, scale, noise);
        for (columns, own) in self.places().filter(|(_, own)| own.null.n_columns() > 0) {
            let of_group = super::null_space::readable(&own.null, &own.scale, noise);
            scaled = beside(scaled, &own.null, columns);
            readable = beside(readable, &of_group, columns);
        }
        Ok(NullSpace { scaled, readable })
    }
}

/// Directions (n, d) that are not determined: orthonormal in scaled unknowns, and as they are read.
struct NullSpace {
    scaled: Matrix,
    readable: Matrix,
}

/// A matrix with further columns, whose entries are in some of the rows.
fn beside(matrix: Matrix, further: &Matrix, rows: &[usize]) -> Matrix {
    let (n, d) = (matrix.n_rows(), matrix.n_columns());
    let mut values = matrix.into_values();
    values.resize(n * (d + further.n_columns()), 0.0);
    for column in 0..further.n_columns() {
        let target = &mut values[n * (d + column)..][..n];
        rows.iter().zip(further.column(column)).for_each(|(&row, &value)| target[row] = value);
    }
    Matrix::of_values(n, d + further.n_columns(), values)
}

fn negative(mut matrix: Matrix) -> Matrix {
    matrix.as_mut_slice().iter_mut().for_each(|value| *value = -*value);
    matrix
}

/// Rows of a group in lots that are made at once, cut where rows that are made together end.
pub(super) fn chunks(rows: &Range<usize>, n_together: usize) -> impl Iterator<Item = Range<usize>> + use<> {
    let (start, end, step) = (rows.start, rows.end, ROWS_AT_ONCE.next_multiple_of(n_together));
    (start..end).step_by(step).map(move |first| first..(first + step).min(end))
}

/// Eliminates the unknowns of one group; gives the squared norms of the border's columns in its rows, too.
fn eliminated<D: Design + ?Sized>(
    design: &D,
    border: &[usize],
    group: &Group,
    constraints: Matrix,
    tolerance: f64,
) -> Result<(Own, Vec<f64>), D::Error> {
    let (k, m) = (group.columns.len(), border.len());
    let mut own = Matrix::zeros(group.rows.len(), k);
    design.fill_columns(group.rows.clone(), &group.columns, &mut own)?;
    let told = |block: &Matrix, columns: &[usize], first_row: usize| {
        check_finite(block, first_row).map_err(|error| match error {
            LeastSquaresError::NonFinite { row, column } => {
                LeastSquaresError::NonFinite { row, column: columns[column] }
            }
            other => other,
        })
    };
    told(&own, &group.columns, group.rows.start)?;
    let scale = scales((0..k).map(|column| norm(own.column(column))))?;
    let found = basis_of(own, &scale, constraints, tolerance)?;
    let columns: Vec<usize> = group.columns.iter().chain(border).copied().collect();
    let (mut along, mut squares) = (Matrix::zeros(found.root.n_columns(), m), vec![0.0; m]);
    for rows in chunks(&group.rows, design.n_together()) {
        let mut block = Matrix::zeros(rows.len(), columns.len());
        design.fill_columns(rows.clone(), &columns, &mut block)?;
        told(&block, &columns, rows.start)?;
        let beside = block.with_columns(k..k + m);
        let q = dense::product(&block.with_columns(0..k), &found.root);
        let part = dense::transposed_product(&q, &beside);
        along.as_mut_slice().iter_mut().zip(part.as_slice()).for_each(|(sum, part)| *sum += part);
        for (column, square) in squares.iter_mut().enumerate() {
            *square += beside.column(column).iter().map(|value| value * value).sum::<f64>();
        }
    }
    Ok((Own { along, scale, ..found }, squares))
}

/// F_s of a group's columns, without what the border has along them; made orthonormal twice.
fn basis_of(
    mut columns: Matrix,
    scale: &[f64],
    constraints: Matrix,
    tolerance: f64,
) -> Result<Own, LeastSquaresError> {
    let (n_rows, k) = (columns.n_rows(), columns.n_columns());
    divide_columns(&mut columns, scale);
    let basis = match constraints.n_rows() {
        0 => None,
        _ => Restriction::Constraints(constraints).basis(scale)?,
    };
    let free = match &basis {
        Some(basis) => dense::product(&columns, basis),
        None => columns,
    };
    let in_scaled = |z: Matrix| match &basis {
        Some(basis) => dense::product(basis, &z),
        None => z,
    };
    let n_free = free.n_columns();
    let svd = dense::svd(&dense::triangle(&mut free.clone()))?;
    let rank = decide(&svd.values, n_rows, n_free, Some(tolerance));
    let once = Matrix::from_fn(n_free, rank.rank, |row, j| svd.v[(row, j)] / svd.values[j]);
    let again = dense::upper_inverse(&dense::triangle(&mut dense::product(&free, &once)));
    let scaled = in_scaled(dense::product(&once, &again));
    let root = Matrix::from_fn(k, rank.rank, |row, j| scaled[(row, j)] / scale[row]);
    Ok(Own {
        root,
        along: Matrix::zeros(rank.rank, 0),
        null: in_scaled(svd.v.with_columns(rank.rank..n_free)),
        scale: scale.to_vec(),
        n_free,
        rank,
        largest: svd.values.first().copied().unwrap_or(0.0),
    })
}

/// Z: what the border's columns have across those of the groups.
struct Eliminated<'a, D: ?Sized> {
    design: &'a D,
    border: &'a Border,
    own: &'a [Own],
    norms: Vec<f64>,
}

impl<D: Design + ?Sized> Design for Eliminated<'_, D> {
    type Error = D::Error;

    fn n_rows(&self) -> usize {
        self.design.n_rows()
    }

    fn n_columns(&self) -> usize {
        self.border.columns.len()
    }

    fn n_rhs(&self) -> usize {
        0
    }

    fn n_together(&self) -> usize {
        self.design.n_together()
    }

    fn norms(&self) -> Option<&[f64]> {
        Some(&self.norms)
    }

    fn blocks(&self) -> Blocks {
        let height = ROWS_AT_ONCE.max(4 * self.n_columns()).next_multiple_of(self.n_together());
        let starts: Vec<usize> = (0..self.n_rows()).step_by(height).collect();
        let uniform = || Blocks::uniform(self.n_rows(), self.n_columns());
        Blocks::starting_at(&starts, self.n_rows()).unwrap_or_else(|_| uniform())
    }

    fn fill(&self, rows: Range<usize>, block: &mut Matrix) -> Result<(), D::Error> {
        let groups = &self.border.groups;
        let first = groups.partition_point(|group| group.rows.end <= rows.start);
        for (group, own) in groups.iter().zip(self.own).skip(first) {
            if group.rows.start >= rows.end {
                break;
            }
            let part = group.rows.start.max(rows.start)..group.rows.end.min(rows.end);
            let k = group.columns.len();
            let columns: Vec<usize> = group.columns.iter().chain(&self.border.columns).copied().collect();
            let mut made = Matrix::zeros(part.len(), columns.len());
            self.design.fill_columns(part.clone(), &columns, &mut made)?;
            let q = dense::product(&made.with_columns(0..k), &own.root);
            let taken = dense::product(&q, &own.along);
            for column in 0..self.border.columns.len() {
                let target = &mut block.column_mut(column)[part.start - rows.start..][..part.len()];
                let both = made.column(k + column).iter().zip(taken.column(column));
                target.iter_mut().zip(both).for_each(|(target, (value, taken))| *target = value - taken);
            }
        }
        Ok(())
    }
}
