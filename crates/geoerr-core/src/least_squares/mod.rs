//! Least squares: tall linear systems, what they determine, and how well.
//!
//! Rows come block by block ([`Design`]) and leave a [`Triangle`]; [`solve`] turns it into a [`Solution`] with rank, null
//! space and covariance. The only place that knows faer. Work is cut into fixed blocks and merged in a fixed tree, so the
//! bytes do not depend on the number of threads.

mod blocks;
mod bordered;
mod bordered_root;
mod definite;
mod dense;
mod error;
mod gram;
mod leave_out;
mod leave_out_bordered;
mod leave_out_tall;
mod matrix;
mod null_space;
mod orthonormal;
mod products;
mod quick_triangle;
mod rank;
mod registers;
mod restriction;
mod root;
mod row_design;
mod solution;
mod strided;
mod triangle;

pub use blocks::{Blocks, Design, FnDesign, StoredDesign, Sums, design_fn};
pub use bordered::{Border, BorderedTriangle, Group};
pub use definite::Definite;
pub use dense::{add_lower_outer, add_lower_product, set_rows_times_upper, symmetric_eigen};
pub(crate) use dense::{lower_gram, product, transposed_product};
pub use error::LeastSquaresError;
pub use gram::{CONDITION_LIMIT, Fit, Method, fit, residual_products};
pub use leave_out::{LeftOut, leave_blocks_out, leave_blocks_out_of_residuals, leave_bordered_blocks_out};
pub use matrix::Matrix;
pub use orthonormal::{orthonormal, orthonormalizing};
pub use products::{
    Real, add_cross_product, add_product_by_rows, add_product_of_columns, add_product_of_rows,
};
pub use rank::RankDecision;
pub use registers::clear_wide_registers;
pub use restriction::Restriction;
pub use row_design::RowDesign;
pub use solution::{Functional, Options, Solution, solve};
pub use strided::StridedRows;
pub use triangle::Triangle;
