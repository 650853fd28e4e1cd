//! faer's kernels on [`Matrix`], each on the calling thread.
//!
//! faer would split one product among threads and so let the number of threads into the rounding. Here the parallel work is
//! cut above this file, into fixed blocks.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor as llt;
use faer::linalg::evd;
use faer::linalg::householder::{
    apply_block_householder_transpose_on_the_left_in_place_scratch as apply_scratch,
    apply_block_householder_transpose_on_the_left_in_place_with_conj as apply_transpose,
};
use faer::linalg::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::qr::no_pivoting::factor as qr;
use faer::linalg::svd;
use faer::linalg::triangular_inverse::invert_upper_triangular;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, Conj, Mat, MatMut, MatRef, Par};

use super::LeastSquaresError;
use super::matrix::Matrix;
use super::registers::WideRegisters;

/// Columns of one Householder block; 16 to 64 are within 5 % of one another at 300 columns.
const PANEL: usize = 32;

fn view(matrix: &Matrix) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(matrix.as_slice(), matrix.n_rows(), matrix.n_columns())
}

fn view_mut(matrix: &mut Matrix) -> MatMut<'_, f64> {
    let (n_rows, n_columns) = (matrix.n_rows(), matrix.n_columns());
    MatMut::from_column_major_slice_mut(matrix.as_mut_slice(), n_rows, n_columns)
}

/// `left · right`.
pub fn product(left: &Matrix, right: &Matrix) -> Matrix {
    let _wide = WideRegisters;
    let mut result = Matrix::zeros(left.n_rows(), right.n_columns());
    matmul::matmul(view_mut(&mut result), Accum::Replace, view(left), view(right), 1.0, Par::Seq);
    result
}

/// `leftᵀ · right`.
pub fn transposed_product(left: &Matrix, right: &Matrix) -> Matrix {
    let _wide = WideRegisters;
    let mut result = Matrix::zeros(left.n_columns(), right.n_columns());
    matmul::matmul(view_mut(&mut result), Accum::Replace, view(left).transpose(), view(right), 1.0, Par::Seq);
    result
}

/// `b − A x` of a block `[A | b]`.
pub fn residuals(block: &Matrix, x: &Matrix) -> Matrix {
    let _wide = WideRegisters;
    let n = x.n_rows();
    let mut result = block.with_columns(n..block.n_columns());
    let a = view(block).subcols(0, n);
    matmul::matmul(view_mut(&mut result), Accum::Add, a, view(x), -1.0, Par::Seq);
    result
}

/// `Aᵀ · right` for the first `n` columns A of a block.
pub fn leading_transposed_product(block: &Matrix, n: usize, right: &Matrix) -> Matrix {
    let _wide = WideRegisters;
    let mut result = Matrix::zeros(n, right.n_columns());
    let a = view(block).subcols(0, n).transpose();
    matmul::matmul(view_mut(&mut result), Accum::Replace, a, view(right), 1.0, Par::Seq);
    result
}

/// `A · right` for the first `right.n_rows()` columns A of a block.
pub fn leading_product(block: &Matrix, right: &Matrix) -> Matrix {
    let _wide = WideRegisters;
    let mut result = Matrix::zeros(block.n_rows(), right.n_columns());
    let a = view(block).subcols(0, right.n_rows());
    matmul::matmul(view_mut(&mut result), Accum::Replace, a, view(right), 1.0, Par::Seq);
    result
}

/// `matrixᵀ · matrix`, both triangles.
pub fn gram(matrix: &Matrix) -> Matrix {
    let mut result = lower_gram(matrix);
    mirror_lower(&mut result);
    result
}

/// `matrixᵀ · matrix`, the lower triangle; zeros above it.
pub fn lower_gram(matrix: &Matrix) -> Matrix {
    let _wide = WideRegisters;
    let n = matrix.n_columns();
    let mut result = Matrix::zeros(n, n);
    triangular::matmul(
        view_mut(&mut result),
        BlockStructure::TriangularLower,
        Accum::Replace,
        view(matrix).transpose(),
        BlockStructure::Rectangular,
        view(matrix),
        BlockStructure::Rectangular,
        1.0,
        Par::Seq,
    );
    result
}

/// Rows as NumPy has them, given with the distance at which they begin: columns of the transpose.
fn turned((rows, stride): (&[f64], usize), n_columns: usize, n_rows: usize) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice_with_stride(rows, n_columns, n_rows, stride)
}

/// `sum += AᵀA`, the lower triangle, for `n_rows` rows of A with `n` columns; `sum` may be larger.
pub fn add_lower_gram_of_rows(sum: &mut Matrix, n: usize, rows: (&[f64], usize), n_rows: usize) {
    let _wide = WideRegisters;
    let turned = turned(rows, n, n_rows);
    add_lower(view_mut(sum).submatrix_mut(0, 0, n, n), 1.0, turned, turned);
}

/// `sum += AᵀB` for `n_rows` rows of A and of B.
pub fn add_product_of_strided_rows(
    sum: &mut Matrix,
    left: (&[f64], usize),
    right: (&[f64], usize),
    n_rows: usize,
) {
    let _wide = WideRegisters;
    let (left, right) = (turned(left, sum.n_rows(), n_rows), turned(right, sum.n_columns(), n_rows));
    matmul::matmul(view_mut(sum), Accum::Add, left, right.transpose(), 1.0, Par::Seq);
}

/// `difference -= A x`, for as many rows of A as `difference` has.
pub fn subtract_product_of_strided_rows(difference: &mut Matrix, rows: (&[f64], usize), x: &Matrix) {
    let _wide = WideRegisters;
    let a = turned(rows, x.n_rows(), difference.n_rows()).transpose();
    matmul::matmul(view_mut(difference), Accum::Add, a, view(x), -1.0, Par::Seq);
}

/// `sum += Aᵀ · right`, for as many rows of A as `right` has, into all rows of `sum` but its last.
pub fn add_transposed_product_of_strided_rows(sum: &mut Matrix, rows: (&[f64], usize), right: &Matrix) {
    let _wide = WideRegisters;
    let n = sum.n_rows() - 1;
    let turned = turned(rows, n, right.n_rows());
    matmul::matmul(view_mut(sum).subrows_mut(0, n), Accum::Add, turned, view(right), 1.0, Par::Seq);
}

/// `sum += factor · matrix · matrixᵀ`, the lower triangle.
pub fn add_lower_outer(sum: &mut Matrix, factor: f64, matrix: &Matrix) {
    let _wide = WideRegisters;
    add_lower(view_mut(sum), factor, view(matrix), view(matrix));
}

/// `sum += left · rightᵀ`, the lower triangle of what is known to be symmetric.
pub fn add_lower_product(sum: &mut Matrix, left: &Matrix, right: &Matrix) {
    let _wide = WideRegisters;
    add_lower(view_mut(sum), 1.0, view(left), view(right));
}

fn add_lower(sum: MatMut<'_, f64>, factor: f64, left: MatRef<'_, f64>, right: MatRef<'_, f64>) {
    triangular::matmul(
        sum,
        BlockStructure::TriangularLower,
        Accum::Add,
        left,
        BlockStructure::Rectangular,
        right.transpose(),
        BlockStructure::Rectangular,
        factor,
        Par::Seq,
    );
}

/// `target = A · factor` for rows of A, one after another as those of `target`.
pub fn set_rows_times(target: &mut [f64], rows: &[f64], factor: &Matrix) {
    let _wide = WideRegisters;
    let (width, found) = (factor.n_rows(), factor.n_columns());
    let n_rows = target.len().checked_div(found).unwrap_or(0);
    let target = MatMut::from_column_major_slice_mut(target, found, n_rows);
    let rows = MatRef::from_column_major_slice(rows, width, n_rows);
    matmul::matmul(target, Accum::Replace, view(factor).transpose(), rows, 1.0, Par::Seq);
}

/// Columns of a triangle that are multiplied at once, without the zeros beyond them: products of the triangle as a whole
/// were measured a third slower at 150 columns.
const TRIANGLE_PANEL: usize = 24;

/// `target = A · upper` for rows of A, one after another as those of `target`.
pub fn set_rows_times_upper(target: &mut [f64], rows: &[f64], upper: &Matrix) {
    let _wide = WideRegisters;
    let n = upper.n_columns();
    let n_rows = target.len().checked_div(n).unwrap_or(0);
    let mut target = MatMut::from_column_major_slice_mut(target, n, n_rows);
    let rows = MatRef::from_column_major_slice(rows, n, n_rows);
    for first in (0..n).step_by(TRIANGLE_PANEL) {
        let width = TRIANGLE_PANEL.min(n - first);
        let panel = view(upper).submatrix(0, first, first + width, width);
        matmul::matmul(
            target.rb_mut().subrows_mut(first, width),
            Accum::Replace,
            panel.transpose(),
            rows.subrows(0, first + width),
            1.0,
            Par::Seq,
        );
    }
}

/// Copies the lower triangle to the upper one.
pub fn mirror_lower(matrix: &mut Matrix) {
    for column in 1..matrix.n_columns() {
        for row in 0..column {
            matrix[(row, column)] = matrix[(column, row)];
        }
    }
}

fn householder(matrix: MatMut<'_, f64>) -> (usize, Mat<f64>) {
    let (n_rows, n_columns) = (matrix.nrows(), matrix.ncols());
    let size = n_rows.min(n_columns);
    let panel = PANEL.min(size).max(1);
    let mut factors = Mat::zeros(panel, size);
    let scratch = qr::qr_in_place_scratch::<f64>(n_rows, n_columns, panel, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut memory);
    let info = qr::qr_in_place(matrix, factors.as_mut(), Par::Seq, stack, Default::default());
    (info.rank, factors)
}

/// The upper triangle that Householder reflections leave of `matrix`, `n_columns × n_columns` whatever its height.
///
/// The matrix is used up. A column whose part across the earlier ones is below 16·n_rows·ε of it counts as their combination (faer); the part is
/// dropped, a change of the matrix within what Householder reflections may round.
pub fn triangle(matrix: &mut Matrix) -> Matrix {
    let _wide = WideRegisters;
    let (n_rows, n) = (matrix.n_rows(), matrix.n_columns());
    let mut result = Matrix::zeros(n, n);
    if n_rows > 0 && n > 0 {
        householder(view_mut(matrix));
    }
    for column in 0..n {
        let height = n_rows.min(column + 1);
        result.column_mut(column)[..height].copy_from_slice(&matrix.column(column)[..height]);
    }
    result
}

/// The triangle of `top` over `below`, both upper triangles of the same size.
///
/// Panel by panel: under panel `k` only the first rows of `below` are not zero, so the work is `2/3 n³` where a QR of the
/// stack that knows nothing of zeros would take `10/3 n³`.
pub fn merged_triangle(mut top: Matrix, mut below: Matrix) -> Matrix {
    let _wide = WideRegisters;
    let n = top.n_columns();
    for start in (0..n).step_by(PANEL) {
        let width = PANEL.min(n - start);
        let height = start + width;
        let panel = start..height;
        if panel.clone().all(|column| below.column(column)[..height].iter().all(|&value| value == 0.0)) {
            continue;
        }
        let mut stack = Matrix::zeros(width + height, n - start);
        for column in start..n {
            let (upper, lower) = stack.column_mut(column - start).split_at_mut(width);
            upper.copy_from_slice(&top.column(column)[panel.clone()]);
            lower.copy_from_slice(&below.column(column)[..height]);
        }
        let (mut head, tail) = view_mut(&mut stack).split_at_col_mut(width);
        let (rank, factors) = householder(head.rb_mut());
        if rank > 0 && tail.ncols() > 0 {
            reflect(head.rb(), &factors, rank, tail);
        }
        for column in start..n {
            let (upper, lower) = stack.column(column - start).split_at(width);
            let above_diagonal = width.min(column - start + 1);
            top.column_mut(column)[start..start + above_diagonal].copy_from_slice(&upper[..above_diagonal]);
            let rest = &mut below.column_mut(column)[..height];
            if column < height {
                rest.fill(0.0);
            } else {
                rest.copy_from_slice(lower);
            }
        }
    }
    top
}

/// Applies the first `rank` of the reflections in `basis`, block by block.
fn reflect(basis: MatRef<'_, f64>, factors: &Mat<f64>, rank: usize, mut matrix: MatMut<'_, f64>) {
    let panel = factors.nrows();
    let mut memory = MemBuffer::new(apply_scratch::<f64>(basis.nrows(), panel, matrix.ncols()));
    for start in (0..rank).step_by(panel) {
        let width = panel.min(rank - start);
        apply_transpose(
            basis.get(start.., start..start + width),
            factors.as_ref().get(..width, start..start + width),
            Conj::No,
            matrix.rb_mut().get_mut(start.., ..),
            Par::Seq,
            MemStack::new(&mut memory),
        );
    }
}

/// Solves `R x = b` in place for the upper triangle `R`.
pub fn solve_upper(triangle: &Matrix, right: &mut Matrix) {
    let _wide = WideRegisters;
    solve_upper_triangular_in_place(view(triangle), view_mut(right), Par::Seq);
}

/// Solves `Rᵀ x = b` in place for the upper triangle `R`.
pub fn solve_upper_transposed(triangle: &Matrix, right: &mut Matrix) {
    let _wide = WideRegisters;
    solve_lower_triangular_in_place(view(triangle).transpose(), view_mut(right), Par::Seq);
}

/// Inverse of an upper triangle without a zero on its diagonal.
pub fn upper_inverse(triangle: &Matrix) -> Matrix {
    let _wide = WideRegisters;
    let n = triangle.n_columns();
    let mut result = Matrix::zeros(n, n);
    invert_upper_triangular(view_mut(&mut result), view(triangle), Par::Seq);
    result
}

/// The upper triangle `R` of `RᵀR = matrix`, `None` unless the symmetric matrix is positive definite to working precision.
pub fn cholesky(mut matrix: Matrix) -> Option<Matrix> {
    let _wide = WideRegisters;
    let n = matrix.n_columns();
    if n > 0 {
        let mut memory =
            MemBuffer::new(llt::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default()));
        let stack = MemStack::new(&mut memory);
        let regularization = llt::LltRegularization::default();
        llt::cholesky_in_place(view_mut(&mut matrix), regularization, Par::Seq, stack, Default::default())
            .ok()?;
    }
    let result = Matrix::from_fn(n, n, |row, column| if row <= column { matrix[(column, row)] } else { 0.0 });
    result.first_non_finite().is_none().then_some(result)
}

/// Singular values, largest first, and all `n_rows` left and `n_columns` right singular vectors.
pub struct Svd {
    /// Left singular vectors, one a column.
    pub u: Matrix,
    /// Singular values, `min(n_rows, n_columns)` of them.
    pub values: Vec<f64>,
    /// Right singular vectors, one a column.
    pub v: Matrix,
}

/// Singular value decomposition with square `U` and `V`.
pub fn svd(matrix: &Matrix) -> Result<Svd, LeastSquaresError> {
    let _wide = WideRegisters;
    use svd::ComputeSvdVectors::Full;
    let (n_rows, n_columns) = (matrix.n_rows(), matrix.n_columns());
    let mut u = Matrix::identity(n_rows);
    let mut v = Matrix::identity(n_columns);
    let mut values = Diag::<f64>::zeros(n_rows.min(n_columns));
    if n_rows > 0 && n_columns > 0 {
        let scratch = svd::svd_scratch::<f64>(n_rows, n_columns, Full, Full, Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        let (u, v) = (view_mut(&mut u), view_mut(&mut v));
        svd::svd(view(matrix), values.as_mut(), Some(u), Some(v), Par::Seq, stack, Default::default())
            .map_err(|_| LeastSquaresError::NotDecomposed { n_columns })?;
    }
    let values = values.column_vector().iter().copied().collect();
    Ok(Svd { u, values, v })
}

/// Eigenvalues, smallest first, and eigenvectors, one a column, of a symmetric matrix.
///
/// # Errors
/// [`LeastSquaresError::NotDecomposed`] where the iteration does not end.
pub fn symmetric_eigen(matrix: &Matrix) -> Result<(Vec<f64>, Matrix), LeastSquaresError> {
    let _wide = WideRegisters;
    let n = matrix.n_columns();
    let mut values = Diag::<f64>::zeros(n);
    let mut vectors = Matrix::identity(n);
    if n > 0 {
        let with_vectors = evd::ComputeEigenvectors::Yes;
        let scratch = evd::self_adjoint_evd_scratch::<f64>(n, with_vectors, Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        let vectors = Some(view_mut(&mut vectors));
        evd::self_adjoint_evd(view(matrix), values.as_mut(), vectors, Par::Seq, stack, Default::default())
            .map_err(|_| LeastSquaresError::NotDecomposed { n_columns: n })?;
    }
    Ok((values.column_vector().iter().copied().collect(), vectors))
}
