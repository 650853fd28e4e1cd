//! Why a system is refused.

/// Why a system is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LeastSquaresError {
    /// A system without unknowns.
    #[error("no columns: a system needs at least one unknown")]
    NoColumns,
    /// An entry of `[A | b]` that is not finite.
    #[error("row {row}, column {column} is not a finite number")]
    NonFinite {
        /// Row in the whole system.
        row: usize,
        /// Column of `[A | b]`.
        column: usize,
    },
    /// Finite entries whose norm is not.
    #[error("column {column} is too large: its norm is beyond the range of double precision")]
    Overflow {
        /// Column of `[A | b]`.
        column: usize,
    },
    /// A matrix or vector of another height than the system needs.
    #[error("{found} rows where {expected} are needed")]
    RowsDiffer {
        /// Rows needed.
        expected: usize,
        /// Rows found.
        found: usize,
    },
    /// A matrix of another width than the system needs.
    #[error("{found} columns where {expected} are needed")]
    ColumnsDiffer {
        /// Columns needed.
        expected: usize,
        /// Columns found.
        found: usize,
    },
    /// Block starts that do not begin with 0 or that fall.
    #[error("block {index}: block starts must begin with 0 and must not fall or pass the last row")]
    Cuts {
        /// The offending block.
        index: usize,
    },
    /// An unknown of one group of rows that something else has or holds, too.
    #[error("column {column} belongs to one group of rows, and nothing else may have or hold it")]
    NotOwn {
        /// Column of the whole system.
        column: usize,
    },
    /// A tolerance outside [0, 1).
    #[error("a tolerance of {tolerance} is not in the range from 0 to below 1")]
    Tolerance {
        /// The value given.
        tolerance: f64,
    },
    /// A right-hand side that there is not.
    #[error("right-hand side {index} of {n_rhs}")]
    NoSuchRightHandSide {
        /// Index given.
        index: usize,
        /// Number of right-hand sides.
        n_rhs: usize,
    },
    /// A singular value or eigenvalue iteration that does not end.
    #[error("the singular values of {n_columns} columns could not be computed")]
    NotDecomposed {
        /// Columns of the matrix.
        n_columns: usize,
    },
}
