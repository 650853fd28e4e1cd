//! Programs corrected for the machine they run on.
//!
//! ```text
//! bytes ─ lines ─▶ lexer ─ words ─▶ reader ─ steps ─▶ path ─ nodes ─▶ writer ─▶ bytes
//!                                  (modes, frame)    (parallel)      (frame)
//! ```
//!
//! A program is read line by line, in blocks, and written in the same order. Lines that are no straight moves pass byte for
//! byte. The end of each move is solved once ([`crate::newton`]); a move whose path would leave the tolerance is split
//! ([`path`]). The [`reader`](self) keeps the modes and where the program means the machine to be, the writer where
//! the rewritten program puts it: after `G92` the two differ.

mod codes;
mod decimal;
mod error;
mod extrusion;
mod frame;
mod lexer;
mod lines;
mod options;
pub mod path;
mod reader;
mod report;
mod rewriter;
mod unsupported;
mod words;
mod writer;

pub use error::GcodeError;
pub use extrusion::Firmware;
pub use options::{OnUnsupported, Options};
pub use path::PathMap;
pub use report::{Summary, Warning, WarningKind};
pub use rewriter::Rewriter;
pub use unsupported::Unsupported;
