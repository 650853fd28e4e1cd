//! What may be missing in a model: thousands of candidates judged at once, against noise that is not white.
//!
//! A candidate is a group of columns `B = Σ_p D_p f_p`: `D_p` the whitened displacement of every row by one unit on a
//! channel, `f_p` a column of a formula at one trial of its inner parameters. With the noise `V`, an orthonormal basis
//! `Q` of what the model is free to do and `r` what it leaves (both whitened by `V^(-1/2)`), adding B and refitting
//! everything lowers the sum of squares by `sᵀ I⁻¹ s`, where
//!
//! | symbol | is | here |
//! |---|---|---|
//! | s | `Bᵀ V^(-T/2) r` | one column of the products |
//! | I | `BᵀV⁻¹B − (QᵀV^(-1/2)B)ᵀ(QᵀV^(-1/2)B)` | `judge` |
//! | V^(-1/2) | `σ⁻¹ (I + U (T − I) Uᵀ)` by component | [`crate::noise_likelihood::Whitening`] |
//!
//! exactly, for all candidates in one product of matrices and without a refit. What chance alone finds comes from the
//! same product: noise drawn as the model has it stands beside `r`, and the largest gain of each draw is kept.
//!
//! Source: Westfall & Young, Resampling-based multiple testing (1993), for the maximum over everything that was looked
//! at. Verified in `tests/candidates` against least squares written out, and in the Python package against a second
//! implementation in NumPy.

mod by_nodes;
mod by_rows;
mod by_series;
mod by_waves;
mod error;
mod group;
mod judge;
mod lanes;
mod moments;
mod nodes;
mod scan;
mod scene;
mod series;
mod series_sums;
mod sources;
mod spectrum;
mod tile;
mod wave_blocks;
mod wave_sums;
mod waves;

pub use error::CandidateError;
pub use group::{Column, Group};
pub use scan::{Scanned, scan};
pub use scene::{Directions, Scene, Whitened};
pub use sources::{Formula, Sources};
