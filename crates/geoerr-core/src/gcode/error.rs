//! Why a program is refused: the line, what is wrong with it, and what to do.

use super::unsupported::Unsupported;

/// A program, or an option, with which nothing safe can be done. The message does not repeat the line's number.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GcodeError {
    /// Prusa's binary format.
    #[error("binary G-code, not text")]
    Binary,
    /// A NUL byte.
    #[error("a NUL byte: this is no text")]
    NulByte {
        /// 1-based line.
        line: u64,
    },
    /// An endless line.
    #[error("a line of more than {limit_bytes} bytes")]
    LineTooLong {
        /// 1-based line.
        line: u64,
        /// The limit.
        limit_bytes: usize,
    },
    /// The mark that geoerr leaves.
    #[error("{text}: geoerr has corrected this program already")]
    AlreadyCorrected {
        /// 1-based line.
        line: u64,
        /// The line.
        text: String,
    },
    /// A line that cannot be corrected safely.
    #[error("{text}: {what}")]
    Unsupported {
        /// 1-based line.
        line: u64,
        /// The line.
        text: String,
        /// Why.
        what: Unsupported,
    },
    /// A programmed position that the machine cannot reach.
    #[error("{text}: {axis} {position_mm} mm is outside the machine's range, {low_mm} to {high_mm} mm")]
    OutsideRange {
        /// 1-based line.
        line: u64,
        /// The line.
        text: String,
        /// X, Y or Z.
        axis: char,
        /// Machine coordinate.
        position_mm: f64,
        /// Range.
        low_mm: f64,
        /// Range.
        high_mm: f64,
    },
    /// A corrected command that the machine cannot reach.
    #[error(
        "{text}: the correction asks for {axis} {position_mm:.4} mm, outside the machine's range, {low_mm} to {high_mm} mm"
    )]
    CommandOutsideRange {
        /// 1-based line.
        line: u64,
        /// The line.
        text: String,
        /// X, Y or Z.
        axis: char,
        /// Machine coordinate.
        position_mm: f64,
        /// Range.
        low_mm: f64,
        /// Range.
        high_mm: f64,
    },
    /// A position at which the errors were not measured.
    #[error(
        "{text}: {axis} {} mm is outside the measured range, {} to {} mm",
        shown(*.position_mm),
        shown(*.low_mm),
        shown(*.high_mm)
    )]
    OutsideMeasured {
        /// 1-based line.
        line: u64,
        /// The line.
        text: String,
        /// X, Y or Z.
        axis: char,
        /// Machine coordinate.
        position_mm: f64,
        /// Measured range.
        low_mm: f64,
        /// Measured range.
        high_mm: f64,
    },
    /// No command puts the tool there.
    #[error("{text}: no command found that puts the tool there ({remaining_mm} mm remain)")]
    NotSolved {
        /// 1-based line.
        line: u64,
        /// The line.
        text: String,
        /// Distance that the best command leaves; NaN where the model gives none.
        remaining_mm: f64,
    },
    /// Splitting does not bring the path within the tolerance.
    #[error("{text}: the path stays {deviation_mm:.6} mm off, however short the pieces")]
    NotHeld {
        /// 1-based line.
        line: u64,
        /// The line.
        text: String,
        /// What is left.
        deviation_mm: f64,
    },
    /// Words too coarse for the tolerance.
    #[error("words of {digits} digits are too coarse for a tolerance of {tolerance_mm} mm")]
    TooFewDigits {
        /// 1-based line.
        line: u64,
        /// Digits behind the point of a printed word.
        digits: u8,
        /// Tolerance.
        tolerance_mm: f64,
    },
    /// An option that makes no sense.
    #[error("{name} {value}: {needed}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// What was given.
        value: String,
        /// What is needed.
        needed: &'static str,
    },
}

/// A place in as many digits as mean anything.
fn shown(place_mm: f64) -> f64 {
    (1e6 * place_mm).round() / 1e6
}

impl GcodeError {
    /// 1-based line of the program; 1 where the whole file is meant.
    pub fn line(&self) -> u64 {
        match self {
            Self::Binary | Self::Option { .. } => 1,
            Self::NulByte { line }
            | Self::LineTooLong { line, .. }
            | Self::AlreadyCorrected { line, .. }
            | Self::Unsupported { line, .. }
            | Self::OutsideRange { line, .. }
            | Self::CommandOutsideRange { line, .. }
            | Self::OutsideMeasured { line, .. }
            | Self::NotSolved { line, .. }
            | Self::NotHeld { line, .. }
            | Self::TooFewDigits { line, .. } => *line,
        }
    }

    /// What the user can do, for a `hint:` line.
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::Binary => "export the program as plain text (slicers have a switch for binary G-code)",
            Self::NulByte { .. } | Self::LineTooLong { .. } => {
                "give the program as plain text, one block a line"
            }
            Self::AlreadyCorrected { .. } => "correct the program as the slicer or CAM wrote it",
            Self::Unsupported { what, .. } => what.remedy(),
            Self::OutsideRange { .. } => {
                "give the place of the program's zero with --work-offset, or correct the ranges in machine.toml"
            }
            Self::CommandOutsideRange { .. } => {
                "move the part away from the end of the axis; a correction needs some travel of its own"
            }
            Self::OutsideMeasured { .. } => {
                "measure there, or --outside-measured hold: functions of an axis keep their last measured value, formulas of effects go on"
            }
            Self::NotSolved { .. } => "check the error tables: errors this steep cannot be corrected",
            Self::NotHeld { .. } => "use a larger --tolerance, or check the error tables for steps",
            Self::TooFewDigits { .. } => "print more digits with --digits, or use a larger --tolerance",
            Self::Option { .. } => "see geoerr compensate --help",
        }
    }
}
