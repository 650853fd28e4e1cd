//! Programs corrected for the machine they run on.
//!
//! ```text
//! bytes ─ lines ─▶ usual moves ┐
//!                  plain moves ┤
//!                  lexer ─────┴▶ reader ─ moves ─▶ solver ─ nodes ─▶ writer ─▶ bytes
//!                               (modes, frame)    (parallel)       (frame)
//! ```
//!
//! A program is read line by line, in blocks, and written in the same order; while one block is read the one before is
//! solved and the one before that is written ([`Rewriter`]). Lines that are no straight moves pass byte for byte. Of
//! moves that only give X, Y and E, one behind another, no more is kept than their numbers (`usual`); what is a
//! straight move alone on its line needs no lexer (`plain`). The end of each move is solved once ([`crate::newton`], by
//! polynomials where a machine has a `Grid`); a move whose path would leave the tolerance is split (from box to box of
//! a `Grid`, or by [`path`]). The [`reader`](self) keeps the modes and where the program means the machine to be, the
//! writer where the rewritten program puts it: after `G92` the two differ.
//!
//! # Direction and speed
//! Where errors depend on how a place is approached, each move has its [`Course`]: directions and travel from the
//! program's own moves, speeds from its feed at full speed (ramps are not known). These are held while a command is solved.
//! At a reversal backlash makes the command jump: the jump belongs to the move that follows, which begins with a piece
//! that takes up the play at its begin and extrudes nothing. A jump below half of the tolerance is taken up along the
//! move instead, within the tolerance; so a path of many short moves at changing speeds is not doubled. An axis that the
//! program leaves at rest may be turned by its correction: its play is taken up in the same way (`turns`).

mod block;
mod block_writer;
mod codes;
mod course;
mod decimal;
mod draft;
mod eight;
mod error;
mod extrusion;
mod frame;
mod grid;
mod knots;
mod known;
mod lexer;
mod lines;
mod options;
mod passage;
mod patch;
pub mod path;
mod plain;
mod reader;
mod report;
mod rewriter;
mod shares;
mod solver;
mod still;
mod term_path;
mod turns;
mod unsupported;
mod usual;
mod wording;
mod words;
mod writer;

pub use course::{Course, Extremes};
pub use error::GcodeError;
pub use extrusion::Firmware;
pub use options::{OnUnsupported, Options};
pub use path::PathMap;
pub use report::{Movers, Summary, Warning, WarningKind};
pub use rewriter::Rewriter;
pub use term_path::TermPath;
pub use unsupported::Unsupported;
