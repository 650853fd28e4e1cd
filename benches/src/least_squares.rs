//! Systems that least squares is measured with.

use geoerr_core::least_squares::Matrix;

/// Numbers from −0.5 to 0.5.
pub fn random(n_rows: usize, n_columns: usize) -> Matrix {
    let mut state = 0x2545_F491_4F6C_DD1D_u64;
    Matrix::from_fn(n_rows, n_columns, |_, _| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    })
}

/// Nine lines and 21 functions of hat functions: each row sees two columns of every function, each line a third of them all.
pub fn sparse(n_rows: usize, n_columns: usize) -> Matrix {
    let each = n_columns / 21;
    let levers = random(n_rows, 21);
    let mut a = Matrix::zeros(n_rows, n_columns);
    for row in 0..n_rows {
        let along = row as f64 * 9.0 / n_rows as f64;
        for function in 0..21 {
            let moves = (along as usize) % 3 == function % 3;
            let q = if moves { along.fract() } else { 0.5 } * (each - 1) as f64;
            let first = (q as usize).min(each - 2);
            let lever = levers[(row, function)];
            a[(row, function * each + first)] = lever * (1.0 + first as f64 - q);
            a[(row, function * each + first + 1)] = lever * (q - first as f64);
        }
        for column in 21 * each..n_columns {
            a[(row, column)] = levers[(row, column % 21)];
        }
    }
    a
}
