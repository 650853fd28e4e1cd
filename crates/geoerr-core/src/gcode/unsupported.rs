//! What this version cannot correct safely, each with its reason and what the user can do.

/// A line that is refused, or passed through untouched where the user asks for it.
///
/// Codes are ten times the number, so that 92.1 is 921.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsupported {
    /// `G2`, `G3`.
    #[error("an arc ({}) is not corrected yet", code(.code10))]
    Arc {
        /// Code.
        code10: u32,
    },
    /// `G2`, `G3` with Z alone, as slicers lift the nozzle.
    #[error("a helix ({}) that ends above or below its begin is not corrected", code(.code10))]
    Helix {
        /// Code.
        code10: u32,
    },
    /// `G5`, `G5.1`, `G5.2`, `G6`.
    #[error("a spline ({}) is not corrected", code(.code10))]
    Spline {
        /// Code.
        code10: u32,
    },
    /// `G70` to `G89`.
    #[error("a canned cycle ({}) moves the machine in ways that its line does not show", code(.code10))]
    CannedCycle {
        /// Code.
        code10: u32,
    },
    /// `G70`, `G71` without words of a cycle, where another unit holds.
    #[error("{} is {} for some controls and a canned cycle for others", code(.code10), if *.code10 == 700 { "inches" } else { "millimetres" })]
    UnitOrCycle {
        /// Code.
        code10: u32,
    },
    /// `G33`.
    #[error("a thread ({}) ties the axes to the spindle", code(.code10))]
    Thread {
        /// Code.
        code10: u32,
    },
    /// `G38.x`.
    #[error("a probing move ({}) ends where the probe touches", code(.code10))]
    Probing {
        /// Code.
        code10: u32,
    },
    /// `G41`, `G42`, and moves while they hold.
    #[error("cutter compensation ({}) makes the controller leave the programmed path", code(.code10))]
    CutterCompensation {
        /// Code.
        code10: u32,
    },
    /// `G93`, and moves while it holds.
    #[error("under inverse time feed (G93) F is a time, which the pieces of a move cannot keep")]
    InverseTime,
    /// `G43.1`, `G43.4`, `G43.5` and other tool length modes.
    #[error("{} moves the tool point in ways that the model of three axes does not have", code(.code10))]
    ToolPoint {
        /// Code.
        code10: u32,
    },
    /// A second tool length, or its end.
    #[error("{} changes the tool length, and with it the machine position, by a number the program does not tell", code(.code10))]
    OtherToolLength {
        /// Code.
        code10: u32,
    },
    /// A second edge of a tool (Siemens' `D2`), or its end.
    #[error(
        "{} changes the tool length, and with it the machine position, by a number the program does not tell",
        edge(.number)
    )]
    OtherEdge {
        /// Number of the edge; `u32::MAX` where the controller computes it.
        number: u32,
    },
    /// Another tool than that of the `D` that holds (Siemens).
    #[error(
        "another tool has another length, which changes the machine position by a number the program does not tell"
    )]
    LengthOfOtherTool,
    /// A word of an axis that the model does not have.
    #[error("the word {} moves an axis that the model of three axes does not have", char::from(*.letter))]
    ExtraAxis {
        /// Letter.
        letter: u8,
    },
    /// `G7`, `G16`, `G51`, `G68`, and moves while they hold.
    #[error("{} changes what axis words mean", code(.code10))]
    Transformed {
        /// Code.
        code10: u32,
    },
    /// `G52`, `G92.1` to `G92.3`, `G10 L20`, `G10 P X`, `G10 L2 R`, `G10 L2` after `G91`.
    #[error("{} moves the program's zero in a way that geoerr does not follow", code(.code10))]
    ZeroShift {
        /// Code.
        code10: u32,
    },
    /// `G92` without a word.
    #[error("G92 without words means different things to different controllers")]
    BareShift,
    /// `G55` to `G59.3`, `G54.1`, `G154` without a known offset.
    #[error("the program has not said where coordinate system {} is", code(.code10))]
    UnknownSystem {
        /// Code.
        code10: u32,
    },
    /// `G28` while a `G92` shift holds.
    #[error("some firmwares end the shift of G92 at G28, others keep it")]
    HomingAfterShift,
    /// `G0 Z0 M91` of Heidenhain's controls.
    #[error(
        "M{code} on the line of a move: it counts from the machine's zero, or from another place of the machine's"
    )]
    MachinePlaceByM {
        /// Code.
        code: u32,
    },
    /// `G53` under `G91`.
    #[error("machine coordinates (G53) together with increments (G91)")]
    MachineIncrement,
    /// A number that the controller computes.
    #[error("an expression or a parameter, which geoerr does not compute")]
    Expression,
    /// `X=AC(5)`, `X=IC(5)`.
    #[error(
        "{} with AC or IC says by itself whether it is a position or an increment, which geoerr does not follow",
        char::from(*.letter)
    )]
    OwnMode {
        /// Letter.
        letter: u8,
    },
    /// Subprograms, loops, branches.
    #[error("subprograms, loops and branches: geoerr reads a program once, from top to bottom")]
    FlowControl,
    /// Two words of one letter.
    #[error("the word {} stands twice", char::from(*.letter))]
    RepeatedWord {
        /// Letter.
        letter: u8,
    },
    /// A word without a number.
    #[error("the word {} has no number", char::from(*.letter))]
    MissingNumber {
        /// Letter.
        letter: u8,
    },
    /// A letter that has no meaning on a straight move.
    #[error("geoerr does not know what the word {} means on a straight move", char::from(*.letter))]
    OddWord {
        /// Letter.
        letter: u8,
    },
    /// Bytes that are no words.
    #[error("column {column}: no word can be read here")]
    Unreadable {
        /// 1-based.
        column: u32,
    },
    /// `SUPA G0 Z0`, `MSG("DEPTH") G91`.
    #[error("column {column}: a code stands behind a name, which may change what it means")]
    CodeBehindName {
        /// 1-based.
        column: u32,
    },
    /// Axis words before any `G0` or `G1`.
    #[error("axis words, but no G0 or G1 has said how to move")]
    NoMotionCode,
    /// Two different motion codes.
    #[error("two motion codes on one line")]
    TwoMotionCodes,
    /// Two codes that both want the line's words, such as `G92 X0 G28`.
    #[error("two codes on one line want its words")]
    TwoOwners,
    /// `G4` or `G28.1` with axis words that are no times.
    #[error("whether {} with axis words also moves, controllers differ on", code(.code10))]
    MoveBesides {
        /// Code.
        code10: u32,
    },
    /// `/` before a move.
    #[error("whether a line that begins with / runs is decided at the machine")]
    BlockSkip,
    /// `/` before a mode, such as `/G91`.
    #[error(
        "whether a line that begins with / runs is decided at the machine, and what follows depends on this one"
    )]
    BlockSkipOfMode,
    /// `TRANS`, `ROT`, `MIRROR` ... of Siemens' controls, `G107`.
    #[error("it changes what axis words mean, by numbers that geoerr does not follow")]
    OtherMeaning,
    /// A line with a checksum that would change.
    #[error("the line has a checksum, and correcting it would make the checksum wrong")]
    Checksum,
    /// `N10 G01 X+5 *`.
    #[error(
        "the line ends with * and no checksum, as blocks of Heidenhain's ISO do, whose codes mean other things"
    )]
    BlockEnd,
    /// `1 L X+5 R0`, `0 BEGIN PGM PART MM`.
    #[error("it begins with a number alone, as blocks of Heidenhain's plain text do, which is no G-code")]
    PlainText,
    /// A move that must be split and whose `E` is read differently.
    #[error("the move must be split, and firmwares differ on whether its E is a position or an increment")]
    ExtruderMode,
    /// A move that must be split, with an absolute `E` behind a change of the tool.
    #[error("the move must be split, and where its E begins nobody has said since the tool was changed")]
    ExtruderLost,
    /// A move that must be split, with a code on its line that is not said for its begin: `M30`, `M5`, `G9`.
    #[error("the move must be split, and {} on its line is or may be meant for its end", named(.letter, .code10))]
    StopOnMove {
        /// `M` or `G`.
        letter: u8,
        /// Code; `u32::MAX` where it is none.
        code10: u32,
    },
    /// `M72`, `M121` where other modes hold than were saved.
    #[error(
        "it takes up saved modes again (G90, M82, G20, G54, G92 ...), which are not those that hold here"
    )]
    RestoredState,
    /// `RESTORE_GCODE_STATE` with a name that the program has not saved.
    #[error(
        "it takes up a state that the program has not kept: which modes and which zero hold then it does not tell"
    )]
    UnknownState,
    /// `M64 X5` where no firmware is named.
    #[error("M{code} with axis words: printers have settings there, machine tools move")]
    AxisWordsOfM {
        /// Code.
        code: u32,
    },
    /// `G91 G1 Z5` for Klipper or Marlin.
    #[error("several codes on one line, of which the firmware that was named runs the first alone")]
    SeveralCodes,
    /// `G20` for Klipper (`cmd_G20` of its `klippy/extras/gcode_move.py`).
    #[error("Klipper has no inches: it stops at G20 with an error")]
    NoInches,
    /// A G code with axis words that geoerr does not know.
    #[error("geoerr does not know {}", code(.code10))]
    UnknownCode {
        /// Code; `u32::MAX` where it is none.
        code10: u32,
    },
}

/// What is known after an unsupported line was passed through untouched; the later, the less.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum After {
    /// The axes that the line names are where its words say; the others have not moved.
    AtItsEnd,
    /// All axes are somewhere.
    Somewhere,
    /// The program's zero is somewhere, and with it every position.
    ZeroLost,
    /// Which line comes next: the rest of the program is passed through.
    EverythingLost,
}

impl Unsupported {
    /// What the user can do, for a `hint:` line.
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::Arc { .. } => {
                "let the slicer or CAM write straight moves (switch arc fitting off), or pass it through untouched with --on-unsupported pass"
            }
            Self::Helix { .. } => {
                "choose another type of Z hop than spiral in the slicer, let the CAM write straight moves, or pass it through untouched with --on-unsupported pass"
            }
            Self::Spline { .. } | Self::Transformed { .. } | Self::OtherMeaning | Self::ToolPoint { .. } => {
                "let the CAM write straight moves in plain coordinates, or use --on-unsupported pass"
            }
            Self::CannedCycle { .. } => {
                "let the CAM write the cycle out as straight moves, or use --on-unsupported pass"
            }
            Self::UnitOrCycle { code10: 700 } => {
                "write G20 where inches are meant (G700 for Siemens' controls, which then has feeds in inches, too)"
            }
            Self::UnitOrCycle { .. } => "write G21 where millimetres are meant (G710 for Siemens' controls)",
            Self::Thread { .. } | Self::Probing { .. } | Self::ExtraAxis { .. } => {
                "such a line can only pass through untouched: --on-unsupported pass"
            }
            Self::CutterCompensation { .. } => {
                "let the CAM compute the path of the cutter's centre, or use --on-unsupported pass"
            }
            Self::InverseTime => "let the CAM write feeds per minute (G94), or use --on-unsupported pass",
            Self::OtherToolLength { .. } | Self::OtherEdge { .. } | Self::LengthOfOtherTool => {
                "write one program for each tool and put its length into --work-offset"
            }
            Self::UnknownSystem { .. } => {
                "let the program set it before (G10 L2 P2 X Y Z for G55, P3 for G56 ...), or work in G54, whose place is --work-offset"
            }
            Self::ZeroShift { .. } | Self::BareShift => {
                "write the offset as G10 L2 P1 or G92 with words, or give it with --work-offset"
            }
            Self::HomingAfterShift => "name the firmware: --firmware marlin, klipper or reprapfirmware",
            Self::MachineIncrement => "write G90 before G53",
            Self::MachinePlaceByM { .. } => {
                "such a line can only pass through untouched: --on-unsupported pass"
            }
            Self::OwnMode { .. } => "write G90 or G91 and a plain number",
            Self::Expression | Self::FlowControl => {
                "let the CAM write plain numbers and one straight sequence of lines"
            }
            Self::RepeatedWord { .. } | Self::MissingNumber { .. } | Self::Unreadable { .. } => {
                "correct the line"
            }
            Self::OddWord { .. } | Self::UnknownCode { .. } => {
                "take it out, or use --on-unsupported pass if it does not move the axes"
            }
            Self::CodeBehindName { .. } => {
                "write the code on a line of its own, or use --on-unsupported pass: nothing behind it is corrected then"
            }
            Self::NoMotionCode => "write G0 or G1 on the line",
            Self::NoInches => "let the slicer or CAM write millimetres (G21)",
            Self::AxisWordsOfM { .. } => {
                "write the move on a line of its own, or name the firmware of the printer: --firmware marlin, klipper or reprapfirmware"
            }
            Self::TwoMotionCodes | Self::TwoOwners | Self::MoveBesides { .. } | Self::SeveralCodes => {
                "write the codes on lines of their own"
            }
            Self::BlockSkip | Self::BlockSkipOfMode => "take the / away, or the line",
            Self::Checksum => {
                "strip line numbers and checksums; the host adds them when it sends the program"
            }
            Self::BlockEnd | Self::PlainText => {
                "correct the line; programs of Heidenhain's are not corrected: let the CAM write G-code if the control can run it"
            }
            Self::ExtruderMode => "name the firmware: --firmware marlin, klipper or reprapfirmware",
            Self::ExtruderLost => "write G92 E0 behind the change of the tool, or use M83",
            Self::StopOnMove { .. } => "write it on a line of its own behind the move",
            Self::RestoredState => {
                "write the modes that are to hold on lines of their own before it, so that it changes none"
            }
            Self::UnknownState => {
                "write SAVE_GCODE_STATE with the same NAME before it, or take the line out and write the modes"
            }
        }
    }

    /// What is known after the line has passed through.
    pub fn after(&self) -> After {
        match self {
            Self::Arc { .. }
            | Self::Helix { .. }
            | Self::Spline { .. }
            | Self::InverseTime
            | Self::Thread { .. }
            | Self::ExtraAxis { .. }
            | Self::UnknownSystem { .. }
            | Self::ExtruderMode
            | Self::ExtruderLost
            | Self::StopOnMove { .. }
            | Self::BlockEnd
            | Self::Checksum => After::AtItsEnd,
            Self::CannedCycle { .. }
            | Self::Probing { .. }
            | Self::CutterCompensation { .. }
            | Self::Transformed { .. }
            | Self::MachineIncrement
            | Self::Expression
            | Self::RepeatedWord { .. }
            | Self::MissingNumber { .. }
            | Self::OwnMode { .. }
            | Self::MachinePlaceByM { .. }
            | Self::OddWord { .. }
            | Self::Unreadable { .. }
            | Self::PlainText
            | Self::NoMotionCode
            | Self::TwoMotionCodes
            | Self::MoveBesides { .. }
            | Self::BlockSkip
            | Self::AxisWordsOfM { .. }
            | Self::UnknownCode { .. } => After::Somewhere,
            Self::ToolPoint { .. }
            | Self::OtherToolLength { .. }
            | Self::OtherEdge { .. }
            | Self::LengthOfOtherTool
            | Self::ZeroShift { .. }
            | Self::BareShift
            | Self::TwoOwners
            | Self::HomingAfterShift => After::ZeroLost,
            Self::FlowControl
            | Self::BlockSkipOfMode
            | Self::UnitOrCycle { .. }
            | Self::OtherMeaning
            | Self::CodeBehindName { .. }
            | Self::RestoredState
            | Self::UnknownState
            | Self::SeveralCodes
            | Self::NoInches => After::EverythingLost,
        }
    }
}

fn edge(number: &u32) -> String {
    if *number == u32::MAX { "this D".to_owned() } else { format!("D{number}") }
}

fn code(code10: &u32) -> String {
    named(&b'G', code10)
}

fn named(letter: &u8, code10: &u32) -> String {
    let letter = char::from(*letter);
    match (*code10, code10 % 10) {
        (u32::MAX, _) => format!("this {letter} code"),
        (whole, 0) => format!("{letter}{}", whole / 10),
        (whole, tenth) => format!("{letter}{}.{tenth}", whole / 10),
    }
}
