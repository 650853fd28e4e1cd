//! The one model: terms on channels, what they predict, and the least-squares problem that fits them.
//!
//! ```math
//! \mathbf p_{measured} = \mathrm{rig}\bigl(\mathrm{chain}(q, \mathbf l;\; g)\bigr), \qquad
//! g_c = \sum_{parts\ on\ c} factor \cdot f(q, covariates; \theta, \varphi)
//! ```
//!
//! | symbol | code | meaning |
//! |---|---|---|
//! | `$c$` | [`Channel`](crate::kinematics::Channel) | a place where a displacement enters the chain, or the rig |
//! | `$f$` | [`Shape`] | an expression, or the functions of a basis |
//! | `$\theta$` | `coefficients` | linear, of all terms one after the other |
//! | `$\varphi$` | `inner` | not linear: periods, time constants |
//!
//! Residuals come from the exact chain; the columns of the design are first order at the nominal machine, so that one
//! triangle serves all iterations ([`Problem`]).

mod block;
mod by_session;
mod design;
mod design_products;
mod ends;
mod frame;
mod gram;
mod kept_sums;
mod machine;
mod problem;
mod rows;
mod shared_bases;
mod term;
mod values;

pub use block::Block;
pub use by_session::BySession;
pub use design::WhitenedDesign;
pub use frame::Frame;
pub use kept_sums::KeptSums;
pub use machine::{
    Approach, Approached, MAX_WINDUPS, MachineError, MachineInverseError, MotionNeeds, TermMachine, Windup,
};
pub use problem::{Problem, Sightings, State};
pub use rows::Rows;
pub use term::{Part, Shape, Term, VolumetricModel};
pub use values::{ChannelValues, channel_values, displacements};

use crate::expression::RowsError;
use crate::kinematics::KinematicsError;
use crate::least_squares::LeastSquaresError;

/// What cannot be fitted or predicted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum VolumetricError {
    /// A part whose shape does not pair with its term's parameters.
    #[error("a part of term {term} on {channel} does not fit the term's parameters")]
    PartCoefficients {
        /// The term's number.
        term: usize,
        /// The part's channel.
        channel: &'static str,
    },
    /// Arrays of different lengths.
    #[error("{what} has {found} entries, {needed} are needed")]
    Length {
        /// Which array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length that it should have.
        needed: usize,
    },
    /// A session's number beyond the sessions.
    #[error("row {row} belongs to session {session}, of {n_sessions}")]
    Session {
        /// The row, from 0.
        row: usize,
        /// Its session.
        session: usize,
        /// How many there are.
        n_sessions: usize,
    },
    /// A length that has not two ends.
    #[error("the length that row {row} is an end of has {n_ends} of them; a length has two")]
    Ends {
        /// The first row of it, from 0.
        row: usize,
        /// How many rows are ends of it.
        n_ends: usize,
    },
    /// A length from a place to itself.
    #[error("the length that row {row} is an end of leads from a place to itself")]
    NoExtent {
        /// The first row of it, from 0.
        row: usize,
    },
    /// A formula that cannot be evaluated on these rows.
    #[error(transparent)]
    Expression(#[from] RowsError),
    /// Kinematics.
    #[error(transparent)]
    Kinematics(#[from] KinematicsError),
    /// Linear algebra.
    #[error(transparent)]
    LeastSquares(#[from] LeastSquaresError),
}
