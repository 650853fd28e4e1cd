//! Noise as it is: scatter from row to row, offsets of passes, a slow drift of each session, by restricted likelihood.
//!
//! For each component the covariance of whitened residuals is
//!
//! ```math
//! V = \sigma^2 (I + Z C Z^\mathsf{T}),\qquad C = a^2\,[\text{same pass}] + b^2 e^{-|t - t'|/\tau}\,[\text{same session}]
//! ```
//!
//! with Z the membership of rows in blocks. With `U` the columns of Z brought to length 1, `Z C Zᵀ = U K Uᵀ`, and all that
//! depends on the four numbers of a component are matrices of the size of a session's blocks, which a filter inverts:
//!
//! ```math
//! -2 \ln L = \sum_c \Bigl( n_c \ln \sigma_c^2 + \ln|I + K_c| + \tfrac{1}{\sigma_c^2}\, e_c^\mathsf{T}(I + U K_c U^\mathsf{T})^{-1} e_c \Bigr)
//!   + \ln|H|,\qquad H = \sum_c A_c^\mathsf{T} V_c^{-1} A_c
//! ```
//!
//! | symbol | code | meaning | shape |
//! |---|---|---|---|
//! | `$A$` | `basis` | what the fit is free to do; `$\ln\lvert H\rvert$` charges for it (restricted likelihood) | (n, 3, r) |
//! | `$e$` | - | residual off A, by generalised least squares | (n, 3) |
//! | `$U^\mathsf{T} A$` | `basis_sums` | sums by block; what is off U is in `inside`, `pull`, `square` | (n_blocks, r) |
//! | `$(I + K)^{-1}$` | `filter` | of one component and session | (m, m) |
//! | `$\ln\sigma^2, \ln a^2, \ln b^2, \ln\tau$` | [`Logs`] | of each component; τ in spans of its session | 4 |
//!
//! The maximum is found by the average of the observed and the expected information, in steps that stay within bounds
//! and in which the model can be believed ([`Likelihood::fit`]).
//!
//! # Source
//! Harville, *Maximum likelihood approaches to variance component estimation*, JASA 72 (1977); Gilmour, Thompson & Cullis,
//! *Average information REML*, Biometrics 51 (1995).
//!
//! # Verified
//! `tests/noise_likelihood`: value against dense matrices, derivatives against differences, any number of threads.

mod blocks;
mod box_step;
mod draws;
mod dual;
mod error;
mod evaluate;
mod filter;
mod fit;
mod lanes;
mod off_basis;
mod slopes;
mod sums;
mod whitening;

pub use blocks::Blocks;
pub use error::NoiseError;
pub use fit::Fitted;
pub use sums::{Likelihood, Logs};
pub use whitening::{Direction, Whitening};
